"""The layout of `fit.json`: which names it has, and what may stand at each.

What was undefined is null, and stays unknown.
"""

from calibration.data.json_file import (
    Kind,
    choice,
    each,
    either,
    every,
    flag,
    number,
    or_null,
    table,
    text,
    whole,
)
from calibration.fitting.doubt import REMEDIES

COUNT, NUMBER, MAYBE = whole(), number(), or_null(number())
NOT_NEGATIVE = number(lambda x: x >= 0, "a number of 0 or more")
POSITIVE = number(lambda x: x > 0, "a positive number")
PART = number(lambda x: 0 < x < 1, "a number between 0 and 1")
NUMBERS, COLUMN = each(NUMBER), or_null(each(NUMBER))
SCALAR = either(MAYBE, text, flag)
MATRIX = each(each(MAYBE))

ESTIMATE = table(
    {
        "value": MAYBE,
        "standard_error": or_null(NOT_NEGATIVE),
        "interval": each(MAYBE),
        "method": text,
        "free": flag,
        "at_bound": flag,
    }
)
DOUBT = table(
    {
        "code": choice(*REMEDIES),
        "cause": text,
        "material": or_null(text),
        "advice": or_null(text),
        "remedy": text,
    }
)
ERRORS = table(
    {
        "index": each(each(whole(-1))),
        "to_restitution": each(NUMBERS),
        "to_velocity": each(NUMBERS),
        "size": COLUMN,
        "kind": text,
        "restitution_alone": COLUMN,
        "velocity_alone": COLUMN,
    }
)
LEAF = either(POSITIVE, each(POSITIVE))
CONTACT = table(
    {
        "youngs_modulus": LEAF,
        "radius": LEAF,
        "mass": LEAF,
        "yield_strength": LEAF,
        "limit_velocity": LEAF,
        "area": choice("zhou", "hertz"),
    }
)
BODY = table(
    {
        "name": text,
        "radius": or_null(LEAF),
        "youngs_modulus": LEAF,
        "poisson_ratio": either(NUMBER, NUMBERS),
        "density": LEAF,
        "yield_strength": LEAF,
    }
)
DATA = table(
    {
        "velocity": each(POSITIVE),
        "restitution": each(NOT_NEGATIVE),
        "limit_velocity": or_null(LEAF),
        "degrees": or_null(LEAF),
        "uncertainty": COLUMN,
        "velocity_uncertainty": COLUMN,
        "contact": or_null(CONTACT),
        "bodies": each(BODY),
        "remarks": each(text),
        "group": or_null(each(text)),
        "errors": or_null(ERRORS),
    },
    optional=("bodies",),
)
FIT = table(
    {
        "material": text,
        "n": whole(1),
        "rms": NUMBER,
        "rms_empirical": MAYBE,
        "empirical": or_null(every(MAYBE)),
        "converged": flag,
        "warnings": each(DOUBT),
        "parameters": every(ESTIMATE),
        "derived": every(ESTIMATE),
        "reduced_chi_squared": or_null(NOT_NEGATIVE),
        "objective": choice("model", "two-step"),
        "law": text,
        "options": every(text),
        "values": every(either(NUMBER, NUMBERS)),
        "labels": every(text),
        "status": each(COUNT),
        "known": each(or_null(NOT_NEGATIVE)),
        "variances": every(or_null(NOT_NEGATIVE)),
        "timing": or_null(NOT_NEGATIVE),
        "standardised": each(MAYBE),
        "leverage": each(MAYBE),
        "residual_degrees": NOT_NEGATIVE,
        "chi_squared_probability": MAYBE,
        "data": DATA,
    },
    and_more=True,
)
LINE = table(
    {
        "c1": ESTIMATE,
        "c2": ESTIMATE,
        "rms": every(MAYBE),
        "chi": every(ESTIMATE),
        "through_chi": or_null(every(ESTIMATE)),
        "converged": flag,
        "method": choice("curves", "weighted"),
    }
)
PROFILE = table(
    {
        "parameter": text,
        "values": each(MAYBE),
        "delta_chi_squared": each(MAYBE),
        "low": MAYBE,
        "high": MAYBE,
        "threshold": MAYBE,
    }
)
FREEDOM = table(
    {
        "labels": each(text),
        "parts": each(each(NUMBERS)),
        "relative": each(NUMBERS),
        "sets": each(text),
        "names": each(text),
    }
)
STAGE = table(
    {
        "stage": text,
        "materials": each(text),
        "optimiser": text,
        "route": text,
        "evaluations": COUNT,
        "iterations": COUNT,
        "gradient_norm": MAYBE,
        "cost": MAYBE,
        "converged": flag,
        "reason": text,
        "starts": COUNT,
    }
)
SAID = table(
    {
        "value": MAYBE,
        "free": flag,
        "bounds": or_null(each(MAYBE)),
        "prior": COLUMN,
        "transform": or_null(text),
        "shared": either(flag, text),
    }
)
REQUEST = table(
    {
        "parameters": each(every(either(SAID, MAYBE, text, NUMBERS))),
        # checked as `FitOptions`
        "options": table({"law": or_null(text), "confidence": PART}, and_more=True),
    }
)
LIKELIHOOD = table({"log": NUMBER, "fitted": COUNT, "points": whole(1), "aic": MAYBE, "bic": MAYBE})
RESULT: Kind = table(
    {
        "fits": each(FIT),
        "unloading_line": or_null(LINE),
        "settings": every(either(SCALAR, every(each(text)))),  # of "shared" the data sets
        "versions": every(text),
        "converged": flag,
        "warnings": each(DOUBT),
        "covariance": table({"names": each(text), "matrix": MATRIX}),
        "covariance_of_predictions": MATRIX,
        "rank": COUNT,
        "condition_number": MAYBE,
        "likelihood": or_null(LIKELIHOOD),
        "confidence": PART,
        "freedom": each(FREEDOM),
        "profiles": every(PROFILE),
        "pooled": every(ESTIMATE),
        "optimiser_report": each(STAGE),
        "request": REQUEST,
        "times": every(NOT_NEGATIVE),
    },
    optional=("times",),
    and_more=True,
)
