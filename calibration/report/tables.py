"""What a fit found as DataFrames: `estimates` of numbers, the others of rounded text for a reader.

A table of text is shown by `calibration.report.render` on a terminal, in Markdown and in HTML.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from calibration import symbols
from calibration.fitting.assembly import label_of_law
from calibration.fitting.estimate import Estimate
from calibration.rounding import ABSENT, interval, number, with_error

Printed = Mapping[str, Mapping[str, float]]  # {material: {parameter: published value}}
MANY = 1000  # degrees of freedom, from where on Student's t is the normal distribution
METHODS = {
    "sandwich": (
        "from the stacked estimating equations of both steps of `two-step`, as the same noise "
        "enters both"
    ),
    "profile": "where the profile likelihood crosses its threshold, open where it never does",
    "wald": "from the standard error, on the scale that was searched",
    "derived": "from the covariance of the fitted parameters",
}
QUALITY = {
    "ν": "degrees of freedom of the residuals",
    "scatter": "estimated standard deviation of one ε (under `two-step` about Eq. (17))",
    "between groups": "estimated standard deviation of the groups' offsets in ε",
    "of times [ms]": "estimated standard deviation of the times of bounces",
    "χ²/ν": "squared residuals over the stated variances, per degree of freedom",
    "P": "probability of a χ² at least as large if law and stated uncertainties hold",
}


def estimates(result: Any) -> pd.DataFrame:
    """All estimates of a fit, one a row: what `FitResult.to_frame` returns.

    Columns: dataset, parameter, symbol, unit, value, standard_error, low, high, method, free,
    at_bound. What is undefined, or an open end, is NaN.
    """
    names = ("value", "standard_error", "low", "high")
    rows = []
    for owner, name, symbol, _, estimate in _estimates(result):
        numbers = {n: np.nan if (x := getattr(estimate, n)) is None else x for n in names}
        kind = {n: getattr(estimate, n) for n in ("method", "free", "at_bound")}
        place = {"dataset": owner, "parameter": name, "symbol": symbol.text, "unit": symbol.unit}
        rows.append(place | numbers | kind)
    return pd.DataFrame(rows)


def parameter_table(result: Any, printed: Printed | None = None) -> pd.DataFrame:
    """Each parameter's value, standard error and interval; published values beside them."""
    with_intervals = bool(interval_methods(result))
    rows, before = [], None
    for owner, name, symbol, label, estimate in _estimates(result, printed):
        row = {
            "material": "" if owner == before else owner,
            "parameter": symbol.text + (f" [{symbol.unit}]" if symbol.unit else ""),
            "value ± std. error": estimate_text(estimate),
        }
        if with_intervals:
            row[f"{100 * result.confidence:g} % interval"] = interval_text(estimate)
            row["interval from"] = _interval_from(result, estimate, label)
        if printed is not None:
            value = printed.get(owner, {}).get(name)
            row["Table 1"] = "" if value is None else f"{value:.5g}"
        rows.append(row)
        before = owner
    for fit in result.materials:
        for tree in fit.trees:
            text = f"{tree.size} numbers, shown by the band of the curve"
            place = "" if len(result.materials) == 1 and rows else fit.name
            values = {"material": place, "parameter": tree.name, "value ± std. error": text}
            rows.append(values)
    return pd.DataFrame(rows).fillna("")


def interval_methods(result: Any) -> dict[str, str]:
    """The methods of the intervals that there are, with what each does."""
    used = {e.method for *_, e in _estimates(result) if interval_text(e) != ABSENT}
    return {name: text for name, text in METHODS.items() if name in used}


def quality_table(result: Any) -> pd.DataFrame:
    """How closely each curve follows its data, and what scatter was found."""
    line, fits = result.unloading_line, result.materials
    columns: dict[str, list[str]] = {"material": [fit.name for fit in fits]}
    laws = [label_of_law(fit.model) for fit in fits]
    if len(set(laws)) > 1:
        columns["law"] = laws
    columns["points"] = [str(fit.n) for fit in fits]
    columns["ν"] = [number(fit.residual_degrees) for fit in fits]
    columns["rms"] = [number(fit.rms) for fit in fits]
    if any(fit.rms_empirical is not None for fit in fits):
        columns["rms of Eq. (17)"] = [number(fit.rms_empirical, 3) for fit in fits]
    if line is not None:
        columns["rms on Eq. (18)"] = [number(line.rms.get(fit.name)) for fit in fits]
    found = {
        "scatter": [fit.noise for fit in fits],
        "between groups": [fit.group_deviation for fit in fits],
        "of times [ms]": [None if fit.timing is None else 1e3 * fit.timing for fit in fits],
        "χ²/ν": [fit.reduced_chi_squared for fit in fits],
        "P": [fit.probability for fit in fits],
    }
    for name, values in found.items():
        if any(value is not None for value in values):
            columns[name] = [number(value, 3) for value in values]
    columns["converged"] = ["yes" if fit.converged else "NO" for fit in fits]
    return pd.DataFrame(columns)


def search_table(result: Any) -> pd.DataFrame:
    """Evaluations, seconds and final gradient of each search, and why it stopped."""
    stages = result.optimiser_report
    every = len(result.materials)
    columns = {
        "material": [
            "all" if 1 < len(one.materials) == every else ", ".join(one.materials) for one in stages
        ],
        "stage": [one.stage for one in stages],
        "optimiser": [one.optimiser for one in stages],
        "route": [one.route for one in stages],
        "starts": [str(one.starts) for one in stages],
        "evaluations": [str(one.evaluations) for one in stages],
        "seconds": [number(result.times.get(one.label), 2) for one in stages],
        "gradient": [number(one.gradient_norm, 1) for one in stages],
        "stop reason": [one.reason for one in stages],
    }
    if len(set(columns["optimiser"])) == 1:
        del columns["optimiser"]  # the settings name it
    return pd.DataFrame(columns)


def line_table(result: Any) -> pd.DataFrame:
    """Eq. (18)'s coefficients, through all curves and through the fitted χ̃."""
    line = result.unloading_line
    how = "through all curves" if line.method == "curves" else "through the fitted χ̃, weighted"
    columns = {
        "Eq. (18), χ̃ = c1 + c2 E/Y": ["c1", "c2"],
        how: [estimate_text(line.c1), estimate_text(line.c2)],
    }
    if line.through_chi:
        columns["through the fitted χ̃"] = [
            estimate_text(line.through_chi[name]) for name in ("c1", "c2")
        ]
    return pd.DataFrame(columns)


def bodies_table(result: Any) -> pd.DataFrame | None:
    """A body a row; effective numbers where the bodies are not known; None without a contact."""
    if all(fit.data.contact is None for fit in result.materials):
        return None
    rows = []
    for fit in result.materials:
        for k, (body, *values) in enumerate(_bodies(fit.data)):
            rows.append([fit.name if k == 0 else "", body, *map(_range_text, values)])
    header = ["radius [m]", "mass [kg]", "E [Pa]", "Poisson's ratio", "ρ [kg/m³]", "Y [Pa]"]
    return pd.DataFrame(rows, columns=["material", "body", *header])


def estimate_text(estimate: Any) -> str:
    """A value with its error, or why it has none."""
    if estimate.value is None:
        return "not determined" if estimate.free else ABSENT
    if estimate.method == "fixed" and not estimate.free:
        return f"{number(estimate.value, 5)} (fixed)"
    text = with_error(estimate.value, estimate.standard_error)
    return text + " (at its bound)" * estimate.at_bound


def interval_text(estimate: Any) -> str:
    """The interval, or a dash."""
    if estimate.standard_error is None and estimate.low is None and estimate.high is None:
        return ABSENT
    return interval(estimate.low, estimate.high, estimate.standard_error)


def _estimates(
    result: Any, printed: Printed | None = None
) -> Iterator[tuple[str, str, symbols.Symbol, str, Estimate]]:
    """Data set, parameter, symbol, label in the covariance, and estimate; pooled ones last."""
    for fit in result.materials:
        own = {**fit.parameters, **fit.derived}
        # properties of the contact that were printed too: they follow from the bodies alone
        computed = [name for name in (printed or {}).get(fit.name, {}) if name not in own]
        own |= {n: Estimate(float(getattr(fit.contact, n)), method="computed") for n in computed}
        for name, estimate in own.items():
            symbol = symbols.symbol(name, fit.model)
            yield fit.name, name, symbol, fit.labels.get(name, name), estimate
    for name, estimate in result.pooled.items():
        base = name.removesuffix("_spread")
        symbol = symbols.symbol(base, result.materials[0].model)
        if base != name:
            symbol = symbol._replace(text=f"spread of {symbol.text}")
        yield "all together", name, symbol, name, estimate


def _interval_from(result: Any, estimate: Estimate, label: str) -> str:
    """The method of an interval; the degrees of freedom of its quantile, of estimated noise."""
    if interval_text(estimate) == ABSENT:
        return ""
    degrees = result.degrees_of_freedom(label)
    stated = degrees is None or degrees >= MANY
    return estimate.method + ("" if stated else f", ν = {number(degrees, 3)}")


def _bodies(data: Any) -> Iterator[tuple[Any, ...]]:
    """What a row is of, then radius, mass, E, ν, ρ and Y; None where not known."""
    if data.contact is None:
        yield "not stated", *[None] * 6
    elif not data.bodies:
        pair = data.contact.leaves()
        own = [pair[name] for name in ("radius", "mass", "youngs_modulus")]
        yield "the pair, effective", *own, None, None, pair["yield_strength"]
    else:
        one, two = data.bodies
        equal = one[1:] == two[1:]
        for body in data.bodies[: 1 if equal else 2]:
            of, mass = body.material.leaves(), None
            if body.radius is not None:
                mass = 4 / 3 * np.pi * np.asarray(of["density"]) * np.asarray(body.radius) ** 3
            names = ("youngs_modulus", "poisson_ratio", "density", "yield_strength")
            text = "two equal spheres" if equal else body.name
            yield text, body.radius, mass, *(of[name] for name in names)


def _range_text(value: Any) -> str:
    """One number, or the range of those that differ from impact to impact."""
    if value is None:
        return ABSENT
    low, high = float(np.min(np.asarray(value))), float(np.max(np.asarray(value)))
    return number(low, 4) if low == high else f"{number(low, 4)} to {number(high, 4)}"
