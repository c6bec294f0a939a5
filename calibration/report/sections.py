"""A fit as sections, each with a title and its blocks; readers choose by name which of them they show."""

import datetime
import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import pandas as pd

from calibration import symbols
from calibration.data.points import FALLEN
from calibration.fitting.request import stated_parameters
from calibration.fitting.warnings import NO_INTERVAL_HOLDS
from calibration.options import VALUES_ALONE
from calibration.parameters import Parameter
from calibration.report.budget import budget_blocks, exact_sentence
from calibration.report.layout import Block, Item
from calibration.report.tables import (
    Printed,
    bodies_table,
    estimate_text,
    fitted_texts,
    group_blocks,
    has_intervals,
    interval_methods,
    meanings,
    observables_blocks,
    outlier_lines,
    parameter_table,
    quality_line,
    quality_table,
    quality_words,
    range_text,
    warning_items,
    whose,
    yielding_notes,
)
from calibration.rounding import interval, number, with_error

MOST_NAMED = 3  # data sets that the first sentence of a page describes one by one
NOT_CONVERGED = "NOT CONVERGED: do not use these values."
OBJECTIVES = {
    "two-step": "σ and ψ from Eq. (17), then χ̃ from the law with them fixed (`two-step`)",
    "model": "all parameters at once from the likelihood of all points (`model`)",
}
VALUES = f"{VALUES_ALONE[0].upper()}{VALUES_ALONE[1:]}."
LINE = (
    "One line for all materials, fitted to all curves at once. Its χ̃ follow the data less closely "
    "than a χ̃ for each material; the table above has the rms of both."
)
LINE_OF_TWO = (
    "One line for both materials. Any two χ̃ lie on a line, so it follows the data as closely as "
    "they do; only a third material can test it."
)
NO_SCATTER = (
    "no scatter is estimated beyond the errors of the tracks (that takes three points more than free parameters, and no "
    "scale_uncertainty): errors are too small if impacts scatter more"
)
CONFIDENCE = (
    "Intervals contain the true value in {:g} % of experiments, if the law is right. Where noise is "
    "estimated, dof is the effective number of degrees of freedom of its standard errors (Welch and "
    "Satterthwaite); it exceeds the number of points where part of the noise is stated:"
)


NOT_JUDGED = "not checked, without profiles: whether standard errors describe the intervals"


class Section(NamedTuple):
    """A part of a report: the name that readers choose it by, its heading, and what is under it."""

    name: str
    title: str
    blocks: list[Block]

    @property
    def with_title(self) -> list[Block]:
        head = [Block("heading", self.title)] if self.title and self.blocks else []
        return [*head, *self.blocks]


# what each reader shows, in this order; a page has everything
TERMINAL = (
    "lead",
    "warnings",
    "notes",
    "parameters",
    "budget",
    "quality",
    "outliers",
    "line",
    "posterior",
)
VERBOSE = ("stated", "meanings", "intervals", "groups", "data", "bodies", "computed", "about")
PRINTED = ("lead", "warnings", "parameters", "exact", "budget", "quality", "outliers", "line")
NOTEBOOK = ("lead", "warnings", "parameters", "quality", "outliers")


def sections(
    result: Any,
    pictures: Mapping[str, str] | None = None,
    command: str = "",
    printed: Printed | None = None,
    draws: Any = None,
    brief: bool = False,
) -> list[Section]:
    """All sections of a fit in the order of a page.

    Args:
        pictures: {caption: file next to the report}.
        command: what makes the same files again.
        printed: published values of the paper's materials.
        draws: of the posterior.
        brief: as terminals have it: columns of one value and the advice of lesser warnings left out.
    """
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    notes = [(note, fit.name) for fit in result.materials for note in fit.data.notes]
    notes += [*_unscattered(result), *yielding_notes(result)]
    if brief:  # neither what the table's headings say nor what a warning says
        causes = {w.cause for w in result.warnings}
        notes = [n for n in notes if not n[0].startswith(FALLEN) and n[0] not in causes]
    exact = [sentence] if (sentence := exact_sentence(result, brief)) else []
    noted = _with_owners(result, notes, "{names}: {text}")
    methods = [f"{name}: {text}" for name, text in interval_methods(result).items()]
    estimated = [e for fit in result.materials for e in fit.parameters.values()]
    methods += [NOT_JUDGED] if methods and any(e.skewed is None for e in estimated) else []
    bodies = bodies_table(result)
    is_two_step = any(fit.objective == "two-step" for fit in result.materials)
    warned = [*warning_items(result.warnings, result, brief), *_warnings_of_draws(draws, result)]
    table, line = Block("table", quality_table(result, brief)), quality_line(result)
    quality = [Block("head", line) if brief and line else table, *observables_blocks(result)]
    words = [] if brief else _optional("list", quality_words(result))
    return [
        Section("title", "", [Block("title", "Coefficients of restitution, fitted")]),
        Section("lead", "", [lead(result, 1 if brief else MOST_NAMED)]),
        Section("warnings", "Warnings", _optional("warnings", warned)),
        Section("about", "", [Block("about", f"{datetime.date.today().isoformat()}; {versions}")]),
        Section("data", "Data", [Block("list", [_data_set(fit) for fit in result.materials])]),
        Section("notes", "", _optional("list", [*noted, *exact])),
        Section("exact", "", _optional("list", exact if brief else [])),
        Section("bodies", "Bodies", [] if bodies.empty else [Block("table", bodies)]),
        Section(
            "parameters",
            "Parameters",
            [
                Block("table", parameter_table(result, printed, brief)),
                *([Block("text", VALUES)] if is_two_step else []),
            ],
        ),
        Section("budget", "Uncertainty budget", budget_blocks(result, brief)),
        Section("meanings", "", _optional("list", meanings(result))),
        Section(
            "stated",
            "",
            _optional("list", _stated(result), "Priors, bounds and shared parameters:"),
        ),
        Section(
            "intervals",
            "",
            _optional("list", methods, CONFIDENCE.format(100 * result.confidence)),
        ),
        Section("quality", "Goodness of fit", [*quality, *words]),
        Section("outliers", "", _outliers(result)),
        Section("groups", "", group_blocks(result)),
        Section("pictures", "", [Block("picture", pair) for pair in (pictures or {}).items()]),
        Section("line", "One line for all materials, Eq. (18)", _line(result.unloading_line)),
        Section("posterior", "Posterior", _posterior(draws, result)),
        Section(
            "computed",
            "How it was computed",
            [
                *([Block("code", command)] if command else []),
                Block("text", _computed(result)),
            ],
        ),
    ]


def chosen(every: Iterable[Section], names: Iterable[str]) -> list[Section]:
    """Some sections, in the order of the names."""
    by_name = {section.name: section for section in every}
    return [by_name[name] for name in names]


def _optional(kind: str, value: list[Any], text: str = "") -> list[Block]:
    """A block, with a text before it if any; no block if `value` is empty."""
    return [*([Block("head", text)] if text else []), Block(kind, value)] if value else []


def lead(result: Any, most: int = MOST_NAMED) -> Block:
    """The first sentence: law, data, values and rms; or why no interval holds, and then none is given.

    Args:
        most: data sets that it describes one by one.
    """
    count, owner = len(result.materials), ""
    laws = dict.fromkeys(fit.model.label for fit in result.materials)
    if count == 1:
        owner = f" on {result.materials[0].name}"
    what = f"{' and '.join(laws)} fitted to {sum(fit.n for fit in result.materials)} impacts{owner}"
    if not result.converged:
        return Block("strong", f"{NOT_CONVERGED} {what}.")
    missed = any(warning.code == "level" for warning in result.warnings)  # and so without intervals
    holds = not ((missed or has_intervals(result)) and (reasons := _reasons(result)))
    if count > most:
        values = "" if count == 1 else f" of {count} data sets"
        what, values = what + values, ""
    else:
        level = result.confidence if holds else None
        parts = []
        for fit in result.materials:
            texts = [*fitted_texts(fit, level, holds), f"rms {number(fit.rms, 4 if holds else 2)}"]
            parts.append(("" if count == 1 else f"{fit.name}, ") + ", ".join(texts))
        values = "; ".join(parts)
    if not holds:
        whose = "" if count == 1 else " of this fit"
        text = f"No interval{whose} holds: {'; '.join(reasons)}."
        return Block("strong", f"{text} {what}{': ' * bool(values)}{values}.")
    end = "" if result.warnings else "; no warnings"
    return Block("lead", f"{what}{': ' * bool(values)}{values}{end}.")


def _unscattered(result: Any) -> list[tuple[str, str]]:
    """Sets of precise readings without an estimated scatter."""
    return [
        (NO_SCATTER, fit.name)
        for fit in result.materials
        if fit.data.errors.measured_by.is_precise
        and "scatter" not in fit.variances
        and result.request.options.extra_scatter is None
    ]


def _reasons(result: Any) -> list[str]:
    """Why no interval holds, each with its data sets where there are several."""
    warnings = [w for w in result.warnings if w.code in NO_INTERVAL_HOLDS]
    reasons = []
    for text in dict.fromkeys(warning.reason for warning in warnings):
        owners = dict.fromkeys(w.material for w in warnings if w.reason == text)
        names = [] if None in owners else [name for name in owners if name is not None]
        of = f" ({who})" if names and (who := whose(names, result)) else ""
        reasons.append(text + of)
    return reasons


def _outliers(result: Any) -> list[Block]:
    """Points beyond the noise."""
    head, lines = outlier_lines(result)
    return _optional("list", lines, head) or ([Block("text", head)] if head else [])


def _stated(result: Any) -> list[str]:
    """Priors, bounds and sharing that were stated before the fit."""
    texts = []
    parameters_of = stated_parameters(result.request.parameters, result.request.datasets)
    for fit, parameters in zip(result.materials, parameters_of, strict=True):
        for name, parameter in parameters.items():
            if isinstance(parameter, Parameter) and (words := _stated_words(parameter)):
                symbol = symbols.symbol(fit.model.canonical(name), fit.model).label
                texts.append((f"{symbol}: {words}", fit.name))
    return _with_owners(result, texts, "{text} ({names})")


def _stated_words(parameter: Parameter) -> str:
    parts = []
    if parameter.prior is not None:
        parts.append("prior {:.4g} ± {:.4g}".format(*parameter.prior))
    if parameter.bounds is not None:
        parts.append("between {:.4g} and {:.4g}".format(*parameter.bounds))
    if parameter.pooled:
        parts.append("partially pooled: a common mean with a spread (of ln θ where θ is positive)")
    elif parameter.shared:
        group = "all" if parameter.shared is True else f"the group {parameter.shared}"
        parts.append(f"one value for {group}")
    return ", ".join(parts)


def _with_owners(result: Any, texts: Iterable[tuple[str, str]], form: str) -> list[str]:
    """Texts, each once and with the names of its data sets unless it applies to all."""
    owners: dict[str, list[str]] = {}
    for text, name in texts:
        owners.setdefault(text, []).append(name)
    count = len(result.materials)
    return [
        text if len(names) == count else form.format(text=text, names=", ".join(names))
        for text, names in owners.items()
    ]


def _data_set(fit: Any) -> Item:
    """Source and range of a data set, its objective, and where its curve is not determined."""
    data, origin = fit.data, fit.data.origin
    uncertainty = "no uncertainty stated (it is estimated from the scatter)"
    if data.uncertainty is not None:
        uncertainty = f"uncertainty of the restitution {range_text(data.uncertainty, 2)}"
    groups = f" in {len(data.groups)} groups" if data.groups else ""
    source = "" if origin is None else f", from {origin.file}"
    span = f"{min(data.velocity):.4g} to {max(data.velocity):.4g} m/s"
    how = f"{fit.model.label}: {OBJECTIVES[fit.objective]}"
    text = f": {fit.n} impacts at {span}, {uncertainty}{groups}{source}; {how}."
    below, above = fit.known_from > 0, fit.known_to < math.inf
    side, at = ("below", fit.known_from) if below else ("above", fit.known_to)
    unknown = f"The data do not constrain the curve {side} the critical velocity, {at:.4g} m/s."
    return Item(fit.name, text, unknown if below or above else "")


def _line(line: Any) -> list[Block]:
    """Coefficients of Eq. (18), fitted to all curves; below, those of a straight line through the fitted χ̃."""
    if line is None:
        return []
    rows = {
        "fitted to all curves": vars(line),
        "straight line through the fitted χ̃": line.through_chi,
    }
    columns = {"Eq. (18), χ̃ = c1 + c2 E/Y": [*rows]}
    columns |= {name: [estimate_text(row[name]) for row in rows.values()] for name in ("c1", "c2")}
    text = LINE if len(line.rms) > 2 else LINE_OF_TWO
    if line.scatter and line.has_noise:
        text += (
            f" Errors of c1 and c2 include the scatter about the line, {100 * line.scatter:.2g} %."
        )
    if line.budget is not None and line.has_noise:
        text += " They include what uncertain inputs add."
    return [
        Block("text", text),
        Block("table", pd.DataFrame(columns)),
        *([] if line.converged else [Block("strong", "NOT CONVERGED: the fit of this line.")]),
    ]


def _computed(result: Any) -> str:
    """Settings, what the data determine, and searches; those of each search are in fit.json."""
    options, stages = result.request.options, result.optimiser_report
    estimated = {n: getattr(options, n) for n in ("extra_scatter", "scale_uncertainty")}
    settings = ", ".join(
        f"{name.replace('_', ' ')} {value}"
        for name, value in {**result.settings, **estimated}.items()
        if value is not None and value is not False and name != "shared"
    )
    others = {s.optimiser: s.stage for s in stages if s.optimiser != result.settings["optimiser"]}
    settings += "".join(f", {stage} by {optimiser}" for optimiser, stage in others.items())
    rank, count = result.rank, len(result.covariance_names)
    known = f"{rank} of {count} free parameters" if rank < count else "all free parameters"
    determined = f"The data and priors determine {known}"
    seconds = number(result.times.get("searches"), 2)
    searches = f"{len(stages)} search{'es' * (len(stages) != 1)}, {sum(s.evaluations for s in stages)} evaluations"
    return f"{settings}. {determined}. {searches}, {seconds} s."


def _posterior(draws: Any, result: Any) -> list[Block]:
    """Settings of the sampler, a table of the draws, and whether they converged."""
    if draws is None:
        return []
    from calibration.fitting.posterior.diagnostics import not_converged, summaries
    from calibration.fitting.posterior.draws import dataset_of

    by_parameter, failed = summaries(draws, result.confidence), not_converged(draws)
    names = {name: symbols.of_label(name, result) for name in by_parameter}
    posterior = dataset_of(draws, "posterior")
    sizes, about = posterior.sizes, posterior.attrs
    how = (
        f"{sizes['chain']} chains of {sizes['draw']} draws by NUTS "
        f"({about['inference_library']} {about['inference_library_version']}) after {about['warmup']} "
        f"of warm-up each, seed {about['seed']}; intervals are central. Widths are compared on the "
        "scale that is sampled, ln θ where θ is positive."
    )
    rows = [
        {
            "parameter": names[name] + (f" [{summary.unit}]" if summary.unit else ""),
            "mean ± std. deviation": with_error(summary.mean, summary.deviation),
            f"{100 * result.confidence:g} % interval": interval(
                summary.low, summary.high, summary.deviation
            ),
            "R-hat": f"{summary.r_hat:.3f}",
            "ESS": f"{summary.effective:.0f}",
            "posterior/prior width": number(summary.prior_share, 2),
            "prior": summary.prior or "derived",
        }
        for name, summary in by_parameter.items()
    ]
    return [
        Block("text", how),
        Block("table", pd.DataFrame(rows)),
        *_optional("list", [failed] if failed else []),
    ]


def _warnings_of_draws(draws: Any, result: Any) -> list[Item]:
    if draws is None:
        return []
    from calibration.fitting.posterior.diagnostics import warnings_of

    items = warning_items(warnings_of(draws), result)
    return [item._replace(text=f" (posterior){item.text}") for item in items]
