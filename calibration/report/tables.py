"""Tables of a fit: estimates as numbers; parameters, goodness of fit, groups, outliers and bodies as text."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from calibration import symbols
from calibration.data.bodies import yielding
from calibration.fitting.laws import OF_CONTACT
from calibration.fitting.material import Estimate
from calibration.fitting.warnings import FIRST, NO_INTERVAL_HOLDS
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.report.layout import Block, Item
from calibration.rounding import ABSENT, interval, number, to_place, with_error

Printed = Mapping[str, Mapping[str, float]]  # {material: {parameter: published value}}
MANY = 1000  # degrees of freedom: with more, Student's t counts as the normal distribution
MOST_OUTLIERS = 3
MOST_ADVISED = 2  # warnings with their advice on a terminal
MOST_SETS = 3  # that are named
MOST_GROUPS = 20  # rows of the table of their offsets
ROUNDING = 1e-12  # of ε
QUALITY = {  # columns of the goodness of fit
    "dof": "degrees of freedom of the residuals",
    "scatter": "",  # as the family of noise calls it
    "between groups": "estimated standard deviation of the groups' offsets in ε",
    "of times [ms]": "estimated standard deviation of the times of bounces",
    "of heights [mm]": "estimated standard deviation of the heights of bounces",
    "χ²/dof": "squared residuals over the stated variances, per degree of freedom",
    "factor": "by which the stated uncertainties were scaled, √(χ²/dof)",
    "P": "probability of a χ² at least as large if law and stated uncertainties hold",
}
METHODS = {
    "profile": "where the profile likelihood crosses its threshold; open if it never does",
    "wald": "the estimate and its standard error times a quantile, of ln θ where θ is positive",
    "derived": "from the covariance of the fitted parameters",
}
PROPERTIES = {
    "youngs_modulus": "E [Pa]",
    "poisson_ratio": "ν",
    "density": "ρ [kg/m³]",
    "yield_strength": "Y [Pa]",
}


def warning_items(warnings: Iterable[Any], result: Any, brief: bool = False) -> list[Item]:
    """Warnings with the symbols of the tables: χ̃, not chi; those of one code and advice together.

    Args:
        brief: the advice of lesser warnings is left out where there are many; where no interval holds they are
            named alone.
    """
    models, several = [fit.model for fit in result.materials], len(result.materials) > 1
    no_interval = has_intervals(result) and any(w.code in NO_INTERVAL_HOLDS for w in warnings)
    causes: dict[tuple[str, str], dict[str, list[str]]] = {}
    for warning in warnings:
        owners = causes.setdefault((warning.code, warning.advice), {}).setdefault(warning.cause, [])
        owners += [warning.material] if several and warning.material else []
    items = []
    lesser = [*dict.fromkeys(code for code, _ in causes if brief and code not in FIRST)]
    only_named = no_interval and len(lesser) > 1
    for (code, advice), of in causes.items():
        if only_named and code in lesser:
            continue
        parts = [
            f"{who}: {cause}" if (who := whose(names, result)) else cause
            for cause, names in of.items()
        ]
        is_lesser = code in lesser and (no_interval or len(causes) > MOST_ADVISED)
        text = symbols.written("; ".join(parts), models)
        items.append(Item(code, f": {text}.", "" if is_lesser else symbols.written(advice, models)))
    if only_named:
        items.append(Item("also", f": {', '.join(lesser)} (see the report, or --verbose)."))
    return items


def whose(names: list[str], result: Any) -> str:
    """Some data sets by name, or how many; nothing where it is about all of them."""
    if len(names) == len(result.materials):
        return ""
    return ", ".join(names) if len(names) <= MOST_SETS else f"{len(names)} data sets"


def estimates(result: Any) -> pd.DataFrame:
    """All estimates of a fit, one in each row, as `FitResult.to_frame` returns them.

    Columns: dataset, parameter, symbol, unit, value, standard_error, low, high, method, free,
    at_bound. Undefined values and open ends are NaN.
    """
    names = ("value", "standard_error", "low", "high")
    rows = []
    for owner, name, symbol, _, estimate in _estimates(result):
        numbers = {n: np.nan if (x := getattr(estimate, n)) is None else x for n in names}
        kind = {n: getattr(estimate, n) for n in ("method", "free", "at_bound")}
        place = {"dataset": owner, "parameter": name, "symbol": symbol.text, "unit": symbol.unit}
        rows.append(place | numbers | kind)
    return pd.DataFrame(rows)


def _estimates(
    result: Any, printed: Printed | None = None
) -> Iterator[tuple[str, str, symbols.Symbol, str, Estimate]]:
    """Yield data set, parameter, symbol, label in the covariance, and estimate; pooled ones last."""
    for fit in result.materials:
        known = {**fit.parameters, **fit.derived}
        for name in (printed or {}).get(fit.name, {}):  # of the contact, from the bodies
            if name not in known:
                known[name] = Estimate(float(getattr(fit.contact, name)), method="computed")
        for name, estimate in known.items():
            symbol = symbols.symbol(name, fit.model)
            yield fit.name, name, symbol, fit.labels.get(name, name), estimate
    for name, estimate in result.pooled.items():
        base = name.removesuffix("_spread")
        symbol = symbols.symbol(base, result.materials[0].model)
        if base != name:
            symbol = symbol._replace(text=f"spread of {symbol.text}")
        yield "all together", name, symbol, name, estimate


def parameter_table(
    result: Any, printed: Printed | None = None, brief: bool = False
) -> pd.DataFrame:
    """Value, standard error and interval of each parameter, and published values if any.

    Args:
        brief: without the material where there is one, and without where intervals come from.
    """
    rows: list[dict[str, str]] = []
    before, with_intervals = None, bool(interval_methods(result))
    for owner, name, symbol, label, estimate in _estimates(result, printed):
        row = {
            "material": "" if owner == before else owner,
            "parameter": symbol.label + _of_yielding(result, owner, name),
            "value ± std. error": estimate_text(estimate),
        }
        if result.budget is not None:
            row |= _error_parts(result, label, estimate)
        if with_intervals:
            row[f"{100 * result.confidence:g} % interval"] = ends = interval_text(estimate)
            dof = result.degrees_of_freedom(label)
            of_t = "" if dof is None or dof >= MANY else f", dof = {number(dof, 3)}"
            row |= (
                {} if brief else {"interval from": "" if ends == ABSENT else estimate.method + of_t}
            )
        if printed is not None:
            value = printed.get(owner, {}).get(name)
            row["Table 1"] = "" if value is None else f"{value:.5g}"
        rows.append(row)
        before = owner
    for fit in result.materials:
        for tree in fit.trees:
            text = f"{tree.size} numbers, shown by the band of the curve"
            owner = "" if fit.name == before else fit.name
            rows.append({"material": owner, "parameter": tree.name, "value ± std. error": text})
            before = fit.name
    table = pd.DataFrame(rows).fillna("")
    return table.drop(columns=["material"] * (brief and len(result.materials) == 1))


BY_YIELD = ("yield_factor", "critical_velocity")  # parameters that mean nothing without Y


def _of_yielding(result: Any, owner: str, name: str) -> str:
    """ " (Y = 350 MPa, wall)": the yield strength behind a parameter, and whose it is."""
    fit = next((fit for fit in result.materials if fit.name == owner), None)
    if fit is None or name not in BY_YIELD or f"{OF_CONTACT}yield_strength" in fit.free:
        return ""
    known = yielding(fit.data.bodies)
    return "" if known is None else f" (Y = {megapascals(known)}, {known.name})"


def yielding_notes(result: Any) -> list[tuple[str, str]]:
    """Sets of which the second body yields before the first, whose yield strength then has no effect."""
    notes = []
    for fit in result.materials:
        known, names = yielding(fit.data.bodies), {**fit.parameters, **fit.derived}
        if known is None or known is fit.data.bodies[0] or not {*BY_YIELD} & {*names}:
            continue
        first = fit.data.bodies[0]
        text = f"the {known.name} yields first, at Y = {megapascals(known)}: Y of the {first.name}"
        notes.append((f"{text}, {megapascals(first)}, has no effect", fit.name))
    return notes


def megapascals(body: Any) -> str:
    """The yield strength of a body."""
    return f"{number(body.material.yield_strength / 1e6, 4)} MPa"


def _error_parts(result: Any, label: str, estimate: Estimate) -> dict[str, str]:
    """Standard errors of the points and of uncertain inputs, in the digits of the combined one."""
    size = result.budget.input_error(label)
    both = estimate.statistical_error, size if estimate.printed_error is not None else None
    texts = (ABSENT if part is None else number(part, 2) for part in both)
    return dict(zip(("statistical", "from inputs"), texts, strict=True))


def has_intervals(result: Any) -> bool:
    """Whether any parameter has an interval."""
    return any(interval_text(estimate) != ABSENT for *_, estimate in _estimates(result))


def meanings(result: Any) -> list[str]:
    """Meanings of the symbols of the parameters."""
    words = {
        symbols.symbol(name, fit.model).text: symbols.words(name, fit.model)
        for fit in result.materials
        for name in {**fit.parameters, **fit.derived}
    }
    return [f"{symbol}: {text}" for symbol, text in words.items() if text]


def interval_methods(result: Any) -> dict[str, str]:
    """Methods of the intervals in this result, each with its description."""
    used = {e.method for *_, e in _estimates(result) if interval_text(e) != ABSENT}
    return {name: text for name, text in METHODS.items() if name in used}


def estimate_text(estimate: Any) -> str:
    """A value with its error, or the reason why it has no error."""
    if estimate.value is None:
        return "not determined" if estimate.free else ABSENT
    if estimate.method == "fixed" and not estimate.free:
        return f"{number(estimate.value, 5)} (fixed)"
    if estimate.at_bound:
        return f"{number(estimate.value, 5)} (at its bound)"
    if estimate.printed_error is None and estimate.rounding_error is not None:
        return to_place(estimate.value, estimate.rounding_error)
    return with_error(estimate.value, estimate.printed_error)


def interval_text(estimate: Any) -> str:
    """Text of the interval, or a dash."""
    if estimate.standard_error is None and estimate.low is None and estimate.high is None:
        return ABSENT
    return interval(estimate.low, estimate.high, estimate.rounding_error)


def fitted_texts(fit: Any, level: float | None = None, with_errors: bool = True) -> list[str]:
    """`χ̃ = 1.7 ± 0.1` of each free parameter of a data set, with unit and, at a level, interval.

    Args:
        with_errors: else three digits, as a value is known whose errors do not hold.
    """
    texts = []
    for name, estimate in fit.parameters.items():
        symbol = symbols.symbol(name, fit.model)
        text = estimate_text(estimate) if with_errors else number(estimate.value, 3)
        both = text, interval_text(estimate)
        value, ends = (t if t == ABSENT else f"{t} {symbol.unit}".rstrip() for t in both)
        if level is not None and ABSENT not in (value, ends):
            value += f" ({100 * level:g} % interval {ends})"
        texts += [f"{symbol.text} = {value}"] if estimate.free else []
    return texts + [f"{tree.size} numbers of {tree.name}" for tree in fit.trees]


def quality_words(result: Any) -> list[str]:
    """Meaning of the columns of the goodness of fit."""
    table = quality_table(result)
    words = QUALITY | {"scatter": result.materials[0].family.scale_words}
    return [f"{name}: {text}" for name, text in words.items() if name in table]


def quality_table(result: Any, brief: bool = False) -> pd.DataFrame:
    """Goodness of fit of each data set, and its estimated scatter; without columns of no number.

    Args:
        brief: without the material where there is one, and what holds of all that converged.
    """
    rows, line = [], result.unloading_line
    for fit in result.materials:
        chi_squared = fit.reduced_chi_squared
        what, unit = fit.data.errors.measured_by.reading
        numbers = {
            "dof": (fit.residual_degrees, max(3, len(f"{fit.residual_degrees:.0f}"))),
            "rms": (_size(fit.rms), 4),
            "rms of Eq. (17)": (_size(fit.rms_empirical), 3),
            "rms, χ̃ by Eq. (18)": (line and line.rms.get(fit.name), 4),
            "scatter": (_size(fit.noise), 3),
            "between groups": (fit.group_deviation, 3),
            f"of {what} [m{unit}]": (fit.timing and 1e3 * fit.timing, 3),
            "χ²/dof": (chi_squared, 3),
            "factor": (chi_squared**0.5 if "scale" in fit.variances else None, 3),
            "P": (fit.probability, 3),
        }
        row = {"material": fit.name, "law": fit.model.label, "points": str(len(fit.standardised))}
        row |= {name: number(*value_and_digits) for name, value_and_digits in numbers.items()}
        row |= {"P": "< 1e-300"} if fit.probability == 0 else {}
        rows.append(row | {"converged": "yes" if fit.converged else "NO"})
    table = pd.DataFrame(rows)
    empty = [name for name in table if (table[name] == ABSENT).all()]
    if brief:
        empty += ["material"] * (len(table) == 1) + ["converged"] * bool(result.converged)
    return table.drop(columns=[*empty, *["law"] * (table["law"].nunique() == 1)])


def quality_line(result: Any) -> str | None:
    """The goodness of fit of one data set as a line; None of several."""
    table = quality_table(result, brief=True)
    if len(table) > 1:
        return None
    return ", ".join(f"{name} {cell}" for name, cell in table.iloc[0].items())


def _size(value: float | None) -> float | None:
    """A deviation of ε; rounding is 0."""
    return value and value * (value > ROUNDING)


def observables_blocks(result: Any) -> list[Block]:
    """Goodness of fit of observables other than ε; no block if none was measured."""
    rows, remarks = [], []
    for fit in result.materials:
        for name, goodness in fit.observed.items():
            what, data = OBSERVABLES[name], next(o for o in fit.data.observed if o.name == name)
            row = {
                "material": fit.name,
                "observable": f"{name.replace('_', ' ')} {what.symbol}",
                "points": str(len(data)),
                "rms [%]": number(100 * goodness.rms, 3),
                "scatter [%]": "stated"
                if goodness.noise is None
                else number(100 * goodness.noise, 3),
            }
            chi_squared = goodness.reduced_chi_squared
            rows.append(row | {"χ²/dof": "" if chi_squared is None else number(chi_squared, 3)})
            remarks.append(f"{what.symbol}: {what.words}")
    remarks = sorted({*remarks})
    return [Block("table", pd.DataFrame(rows)), Block("list", remarks)] if rows else []


def points_table(result: Any) -> pd.DataFrame:
    """Every measured ε: material, row of its file, v, ε, u, residual, weight, group.

    u is the standard deviation as the fit has it (estimated scatter included, offsets of groups not), the
    residual is measured less fitted ε, the weight that in the fit over that of a point on the curve.
    """
    tables = []
    for fit in result.materials:
        data = fit.data
        rows = np.flatnonzero(np.isfinite(data.restitution))
        if not len(rows):
            continue
        lines = () if data.origin is None else data.origin.lines
        places = np.array(lines)[rows] if len(lines) == len(data.velocity) else rows + 1
        columns = {
            "material": fit.name,
            "row": places,
            "velocity [m/s]": data.velocity[rows],
            "restitution": data.restitution[rows],
            "uncertainty": fit.deviations or np.nan,
            "residual": -np.array(fit.residuals),
            "weight": fit.weights or 1.0,
            "group": "" if data.group is None else np.asarray(data.group)[rows],
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables) if tables else pd.DataFrame(columns=["material", "row"])


def group_blocks(result: Any) -> list[Block]:
    """The largest offsets of groups, in a table; no block without groups."""
    rows, several = [], len(result.materials) > 1
    for fit in result.materials:
        for name, goodness in {RESTITUTION: fit, **fit.observed}.items():
            owner = {"material": fit.name} if several else {}
            what = OBSERVABLES[name].symbol + " [relative]" * OBSERVABLES[name].is_relative
            for label, (offset, error) in list(goodness.group_offsets.items())[:MOST_GROUPS]:
                rows += [owner | {"group": label, "of": what, "offset": with_error(offset, error)}]
            if (more := len(goodness.group_offsets) - MOST_GROUPS) > 0:
                rows.append(owner | {"group": f"{more} smaller ones in fit.json", "of": what})
    if not rows:
        return []
    table = pd.DataFrame(rows).fillna("")
    text = (
        "Offsets of the groups from the curve (measured less fitted), the largest first. They are "
        "estimates with the standard deviation between groups as the prior, so that an offset of few "
        "points is drawn towards 0:"
    )
    return [Block("text", text), Block("table", table)]


def outlier_lines(result: Any) -> tuple[str, list[str]]:
    """How many points lie beyond the noise, and lines about at most three of them.

    These are those apart from the others by a robust fit, where one was made.
    """
    found, count, several = [], 0, len(result.materials) > 1
    for fit in result.materials:
        of_eps = (
            len(fit.standardised) if RESTITUTION in fit.measured else 0
        )  # else of an observable
        count += of_eps + sum(len(goodness.standardised) for goodness in fit.observed.values())
        owner = f"{fit.name}, " if several else ""
        found += [(owner, outlier, fit.data.fall) for outlier in fit.outliers]
    if not found:
        return "", []
    lie = "points lie" if len(found) > 1 else "points lies"
    beyond = f"{len(found)} of {count} {lie} beyond the noise"
    apart = [each for each in found if each[1].robust is not False]
    if not apart:
        return f"{beyond}, none apart from the others (by a robust fit): see points.csv.", []
    apart.sort(key=lambda each: -abs(each[1].residual))
    named = apart[:MOST_OUTLIERS]
    lines = [f"{owner}{outlier}{heights_text(outlier, fall)}" for owner, outlier, fall in named]
    if len(named) == len(found):
        return f"{beyond}:", lines
    is_robust = all(outlier.robust for _, outlier, _ in apart)
    which = "those apart from the others, by a robust fit" if is_robust else "the largest"
    return f"{beyond} (points.csv); {which}:", lines


def heights_text(outlier: Any, fall: Any) -> str:
    """The heights of an outlier as the file has them; no text without heights."""
    if fall is None:
        return ""
    heights = {"drop": fall.height(outlier.velocity)}
    if outlier.restitution is not None and fall.has_rebounds:
        heights["rebound"] = fall.rebound_height(outlier.restitution * outlier.velocity)
    texts = [f"{name} {height:.5g} {fall.unit}" for name, height in heights.items()]
    return f" ({', '.join(texts)})"


def bodies_table(result: Any) -> pd.DataFrame:
    """One body in each row, or effective properties if the bodies are unknown; empty without a contact."""
    if all(fit.data.contact is None for fit in result.materials):
        return pd.DataFrame()
    rows = []
    for fit in result.materials:
        for k, (body, *values) in enumerate(_bodies(fit.data)):
            rows.append([fit.name if k == 0 else "", body, *map(range_text, values)])
    header = ["material", "body", "radius [m]", "mass [kg]", *PROPERTIES.values()]
    return pd.DataFrame(rows, columns=header)


def _bodies(data: Any) -> Iterator[tuple[Any, ...]]:
    """Yield the name of each body, then radius, mass, E, ν, ρ and Y; None if unknown."""
    if data.contact is None:
        yield "not stated", *[None] * 6
    elif not data.bodies:
        pair = data.contact.leaves()
        effective = [pair[name] for name in ("radius", "mass", "youngs_modulus")]
        yield "the pair, effective", *effective, None, None, pair["yield_strength"]
    else:
        first, second = data.bodies
        equal = first.material == second.material and np.array_equal(first.radius, second.radius)
        for body in data.bodies[: 1 if equal else 2]:
            of, mass = body.material.leaves(), None
            if body.radius is not None:
                mass = 4 / 3 * np.pi * np.asarray(of["density"]) * np.asarray(body.radius) ** 3
            text = "two equal spheres" if equal else body.name
            yield text, body.radius, mass, *(of[name] for name in PROPERTIES)


def range_text(value: Any, digits: int = 4) -> str:
    """Text of a number, or of the range of an array."""
    if value is None:
        return ABSENT
    low, high = (number(float(end(np.asarray(value))), digits) for end in (np.min, np.max))
    return low if low == high else f"{low} to {high}"
