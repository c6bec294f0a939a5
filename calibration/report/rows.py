"""What a fit found as tables of text; the terminal and the report lay them out."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from calibration.fitting.assembly import label_of_law
from calibration.report import symbols
from calibration.rounding import ABSENT, interval, number, with_error

Printed = Mapping[str, Mapping[str, float]]  # {material: {parameter: printed value}}


class Table(NamedTuple):
    """`right`: the columns of numbers."""

    header: list[str]
    rows: list[list[str]]
    right: tuple[int, ...] = ()


def parameter_table(result: Any, printed: Printed | None = None, methods: bool = True) -> Table:
    """Each parameter's value, standard error and interval; what else there is to compare beside.

    Args:
        result: a `FitResult`.
        printed: published values, {material: {parameter: value}}.
        methods: whether to say where each interval comes from.
    """
    header = [
        "material",
        "parameter",
        "value ± std. error",
        f"{100 * result.confidence:g} % interval",
    ]
    header += ["Table 1"] * (printed is not None) + ["LM: differs by"] * (result.beside is not None)
    table = Table(header, [], right=tuple(range(4, len(header))))
    for fit in result.materials:
        own = (printed or {}).get(fit.name, {})
        estimates = {**fit.parameters, **fit.derived, **_computed(fit, own)}
        for name, estimate in estimates.items():
            first = fit.name if name == next(iter(estimates)) else ""
            row = [first, symbols.text(name, fit.model), estimate_text(estimate)]
            row.append(interval_text(estimate, methods))
            if printed is not None:
                row.append(printed_text(own.get(name)))
            if result.beside is not None:
                label = fit.labels.get(name, name)
                row.append(difference_text(result, label, estimate))
            table.rows.append(row)
        for tree in fit.trees:
            told = f"{tree.size} numbers, told by the band of the curve"
            table.rows.append(["", tree.name, told, *[""] * (len(header) - 3)])
    return table


def _computed(fit: Any, printed: Mapping[str, float]) -> dict[str, Any]:
    """Properties of the contact that were printed too and are no estimates."""
    names = [name for name in printed if name not in {**fit.parameters, **fit.derived}]
    return {name: Computed(float(getattr(fit.contact, name))) for name in names}


class Computed(NamedTuple):
    """A number that follows from the bodies alone, told as an estimate without an error."""

    value: float
    standard_error: None = None
    low: None = None
    high: None = None
    method: str = "computed"
    free: bool = False
    at_bound: bool = False


def quality_table(result: Any) -> Table:
    """How closely each curve follows its data."""
    line = result.unloading_line
    with_17 = any(fit.rms_empirical is not None for fit in result.materials)
    header = ["material", "law", "objective", "points", "rms"]
    header += ["rms of Eq. (17)"] * with_17
    header += ["rms on Eq. (18)"] * (line is not None) + ["reduced χ²", "converged"]
    rows = []
    for fit in result.materials:
        row = [fit.name, label_of_law(fit.model), fit.objective, str(fit.n), number(fit.rms)]
        row += [number(fit.rms_empirical, 3)] * with_17
        if line is not None:
            row.append(number(line.rms.get(fit.name)))
        row += [number(fit.reduced_chi_squared, 3), "yes" if fit.converged else "NO"]
        rows.append(row)
    return Table(header, rows, right=tuple(range(3, len(header) - 1)))


def optimiser_table(result: Any) -> Table:
    """Which optimiser took how many evaluations and seconds to which gradient."""
    header = ["stage", "optimiser", "route", "starts", "evaluations", "seconds", "gradient norm"]
    header += ["ended by"]
    rows = [
        [
            stage.stage,
            stage.optimiser,
            stage.route,
            str(stage.starts),
            str(stage.evaluations),
            number(result.times.get(stage.stage), 3),
            number(stage.gradient_norm, 1),
            stage.reason,
        ]
        for stage in result.optimiser_report
    ]
    return Table(header, rows, right=(3, 4, 5, 6))


def line_table(result: Any) -> Table:
    """Eq. (18)'s coefficients, through all curves and through the fitted χ̃."""
    line, beside = result.unloading_line, result.beside is not None
    how = "through all curves" if line.method == "curves" else "through the fitted χ̃, weighted"
    header = ["Eq. (18), χ̃ = c1 + c2 E/Y", how, *["through the fitted χ̃"] * bool(line.through_chi)]
    header += ["LM: differs by"] * beside
    table = Table(header, [])
    for name, estimate in (("c1", line.c1), ("c2", line.c2)):
        row = [name, estimate_text(estimate)]
        row += [estimate_text(line.through_chi[name])] if line.through_chi else []
        row += [difference_text(result, name, estimate)] if beside else []
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


def interval_text(estimate: Any, method: bool = True) -> str:
    """The interval, and where it comes from."""
    if estimate.standard_error is None and estimate.low is None and estimate.high is None:
        return ABSENT
    limits = interval(estimate.low, estimate.high, estimate.standard_error)
    return f"{limits} ({estimate.method})" if method and limits != ABSENT else limits


def printed_text(value: float | None) -> str:
    return "" if value is None else f"{value:.5g}"


def difference_text(result: Any, label: str, estimate: Any) -> str:
    """The second fit's value less the first's, relative."""
    other = result.beside["values"].get(label)
    if other is None or not estimate.value:
        return ""
    return f"{other / estimate.value - 1:.0e}".replace("0e+00", "0")


def settings_line(settings: Mapping[str, Any]) -> str:
    """The settings of a fit in one line."""
    known = ("law", "objective", "optimiser", "route", "loss", "form", "kappa", "starts", "seed")
    return ", ".join(f"{name} {settings[name]}" for name in known if settings.get(name) is not None)


def notes(result: Any) -> Iterable[str]:
    """What was noticed about the data, each once."""
    said: dict[str, list[str]] = {}
    for fit in result.materials:
        for note in fit.data.notes:
            said.setdefault(note, []).append(fit.name)
    everywhere = len(result.materials)
    return [
        note if len(names) == everywhere else f"{', '.join(names)}: {note}"
        for note, names in said.items()
    ]
