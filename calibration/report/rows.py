"""What a fit found as tables of text; the terminal and the report lay them out."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from calibration.fitting.assembly import label_of_law
from calibration.fitting.estimate import Estimate
from calibration.fitting.specs import said_of
from calibration.parameters import Parameter
from calibration.report import symbols
from calibration.rounding import ABSENT, interval, number, with_error

Printed = Mapping[str, Mapping[str, float]]  # {material: {parameter: printed value}}


MANY = 1000  # degrees of freedom, from where on nobody tells t from normal


class Table(NamedTuple):
    """`right`: the columns of numbers."""

    header: list[str]
    rows: list[list[str]]
    right: tuple[int, ...] = ()


METHODS = {
    "sandwich": (
        "from the stacked estimating equations of both steps of `two-step`, as the same noise "
        "enters both, or of a robust loss"
    ),
    "profile": "where the profile likelihood crosses its threshold, open where it never does",
    "wald": "from the standard error, on the scale that was searched",
    "derived": "carried over from the covariance of what was fitted",
}


def parameter_table(result: Any, printed: Printed | None = None) -> Table:
    """Each parameter's value, standard error and interval; what else there is to compare beside.

    Args:
        result: a `FitResult`.
        printed: published values, {material: {parameter: value}}.
    """
    with_intervals = bool(used_methods(result))
    header = ["material", "parameter", "value ± std. error"]
    header += [f"{100 * result.confidence:g} % interval", "kind"] * with_intervals
    first = len(header)
    header += ["Table 1"] * (printed is not None)
    table = Table(header, [], right=tuple(range(first, len(header))))
    for fit in result.materials:
        own = (printed or {}).get(fit.name, {})
        estimates = {**fit.parameters, **fit.derived, **_computed(fit, own)}
        for name, estimate in estimates.items():
            label = fit.labels.get(name, name)
            owner = fit.name if name == next(iter(estimates)) else ""
            row = [owner, symbols.text(name, fit.model), estimate_text(estimate)]
            if with_intervals:
                row += [interval_text(estimate), _kind(result, estimate, label)]
            if printed is not None:
                row.append(printed_text(own.get(name)))
            table.rows.append(row)
        for tree in fit.trees:
            told = f"{tree.size} numbers, told by the band of the curve"
            table.rows.append(["", tree.name, told, *[""] * (len(header) - 3)])
    for name, estimate in result.pooled.items():
        base = name.removesuffix("_spread")
        symbol = symbols.text(base, result.materials[0].model)
        row = ["all together", f"spread of {symbol}" if base != name else symbol]
        row += [estimate_text(estimate)]
        row += [interval_text(estimate), estimate.method] * with_intervals
        table.rows.append([*row, *[""] * (len(header) - len(row))])
    return table


def used_methods(result: Any) -> dict[str, str]:
    """Where intervals come from, of those that there are."""
    every = [e for fit in result.materials for e in {**fit.parameters, **fit.derived}.values()]
    used = {e.method for e in every if interval_text(e) != ABSENT}
    return {name: text for name, text in METHODS.items() if name in used}


def _kind(result: Any, estimate: Any, label: str) -> str:
    """Where an interval comes from; the degrees of freedom of its quantile, of a noise that was found."""
    if interval_text(estimate) == ABSENT:
        return ""
    degrees = result.degrees_of_freedom(label)
    told = degrees is not None and degrees < MANY
    return estimate.method + (f", ν = {number(degrees, 3)}" if told else "")


def meanings(result: Any) -> list[str]:
    """What the symbols of the table stand for."""
    found = {}
    for fit in result.materials:
        for name in {**fit.parameters, **fit.derived}:
            if symbols.words(name, fit.model):
                found[symbols.symbol(name, fit.model).text] = symbols.words(name, fit.model)
    return [f"{symbol}: {words}" for symbol, words in found.items()]


def told(result: Any) -> list[str]:
    """What was said of the parameters before the fit: priors, bounds, who shares them."""
    found: dict[str, list[str]] = {}
    said = said_of(result.request.parameters, result.request.datasets)
    for fit, own in zip(result.materials, said, strict=True):
        for name, parameter in own.items():
            if isinstance(parameter, Parameter) and (words := _of_parameter(parameter)):
                symbol = symbols.text(fit.model.canonical(name), fit.model)
                found.setdefault(f"{symbol}: {words}", []).append(fit.name)
    return _with_owners(result, found, "{text} ({names})")


def _of_parameter(parameter: Parameter) -> str:
    parts = []
    if parameter.prior is not None:
        parts.append("prior {:.4g} ± {:.4g}".format(*parameter.prior))
    if parameter.bounds is not None:
        parts.append("between {:.4g} and {:.4g}".format(*parameter.bounds))
    if parameter.pooled:
        parts.append("around a common mean, with a spread (of ln θ where θ is positive)")
    elif parameter.shared:
        group = "all" if parameter.shared is True else f"the group {parameter.shared}"
        parts.append(f"one value for {group}")
    return ", ".join(parts)


def _computed(fit: Any, printed: Mapping[str, float]) -> dict[str, Estimate]:
    """Properties of the contact that were printed too: they follow from the bodies alone."""
    names = [name for name in printed if name not in {**fit.parameters, **fit.derived}]
    return {name: Estimate(float(getattr(fit.contact, name)), method="computed") for name in names}


def quality_table(result: Any) -> Table:
    """How closely each curve follows its data, and what scatter was found."""
    line, fits = result.unloading_line, result.materials
    columns: dict[str, list[str]] = {"material": [fit.name for fit in fits]}
    if len({label_of_law(fit.model) for fit in fits}) > 1:
        columns["law"] = [label_of_law(fit.model) for fit in fits]
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
    return _table(columns, columns.keys() - {"material", "law", "converged"})


QUALITY = {
    "ν": "degrees of freedom of the residuals",
    "scatter": "standard deviation of one ε, found from the residuals (of `two-step` Eq. (17)'s)",
    "between groups": "standard deviation of the groups' offsets in ε, found as well",
    "of times [ms]": "standard deviation of the times of bounces, found as well",
    "χ²/ν": "squared residuals over the stated variances, per degree of freedom",
    "P": "probability of a χ² at least as large where law and stated uncertainties hold",
}


def quality_words(result: Any) -> list[str]:
    """What the columns of `quality_table` are."""
    header = quality_table(result).header
    return [f"{name}: {text}" for name, text in QUALITY.items() if name in header]


def optimiser_table(result: Any) -> Table:
    """Which optimiser took how many evaluations and seconds to which gradient."""
    stages = result.optimiser_report
    columns = {
        "material": [_of_stage(result, one) for one in stages],
        "stage": [one.stage for one in stages],
        "optimiser": [one.optimiser for one in stages],
        "route": [one.route for one in stages],
        "starts": [str(one.starts) for one in stages],
        "evaluations": [str(one.evaluations) for one in stages],
        "seconds": [number(result.times.get(one.label), 2) for one in stages],
        "gradient": [number(one.gradient_norm, 1) for one in stages],
        "ended by": [one.reason for one in stages],
    }
    if len(set(columns["optimiser"])) == 1:
        del columns["optimiser"]  # the settings name it
    return _table(columns, ("starts", "evaluations", "seconds", "gradient"))


def _table(columns: Mapping[str, list[str]], of_numbers: Iterable[str]) -> Table:
    right = tuple(k for k, name in enumerate(columns) if name in of_numbers)
    return Table(list(columns), [list(row) for row in zip(*columns.values(), strict=True)], right)


def _of_stage(result: Any, stage: Any) -> str:
    several = 1 < len(stage.materials) == len(result.materials)
    return "all" if several else ", ".join(stage.materials)


def line_table(result: Any) -> Table:
    """Eq. (18)'s coefficients, through all curves and through the fitted χ̃."""
    line = result.unloading_line
    how = "through all curves" if line.method == "curves" else "through the fitted χ̃, weighted"
    header = ["Eq. (18), χ̃ = c1 + c2 E/Y", how, *["through the fitted χ̃"] * bool(line.through_chi)]
    table = Table(header, [])
    for name, estimate in (("c1", line.c1), ("c2", line.c2)):
        row = [name, estimate_text(estimate)]
        row += [estimate_text(line.through_chi[name])] if line.through_chi else []
        table.rows.append(row)
    return table


def estimate_text(estimate: Any) -> str:
    """A value with its error, or with the word that says why it has none."""
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


def printed_text(value: float | None) -> str:
    return "" if value is None else f"{value:.5g}"


def settings_line(result: Any) -> str:
    """The settings of a fit in one line."""
    settings, options = result.settings, result.request.options
    known = ("law", "objective", "optimiser", "route", "loss", "loss_scale", "form", "kappa", "end")
    names = [name for name in (*known, "starts", "seed") if settings.get(name) is not None]
    parts = [f"{name.replace('_', ' ')} {settings[name]}" for name in names]
    parts += ["scatter beside the stated uncertainties"] * options.extra_scatter
    parts += ["stated uncertainties right up to a factor"] * options.scale_uncertainty
    return ", ".join(parts)


def notes(result: Any) -> list[str]:
    """What was noticed about the data, each once."""
    said: dict[str, list[str]] = {}
    for fit in result.materials:
        for note in fit.data.notes:
            said.setdefault(note, []).append(fit.name)
    return _with_owners(result, said, "{names}: {text}")


def _with_owners(result: Any, said: Mapping[str, list[str]], form: str) -> list[str]:
    """Texts with the names of the data sets that each is about, where these are not all."""
    every = len(result.materials)
    return [
        text if len(names) == every else form.format(text=text, names=", ".join(names))
        for text, names in said.items()
    ]
