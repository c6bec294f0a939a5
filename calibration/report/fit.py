"""The report of a fit: tables and sentences as blocks, and all files of a fit."""

import datetime
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from calibration import symbols
from calibration.fitting.request import stated_parameters
from calibration.options import VALUES_ALONE
from calibration.output import files_into, write_text
from calibration.parameters import Parameter
from calibration.report.layout import Block, Item, page, terminal
from calibration.report.tables import (
    Printed,
    bodies_table,
    estimate_text,
    fitted_texts,
    group_blocks,
    interval_methods,
    observables_blocks,
    outlier_lines,
    parameter_table,
    quality_table,
    range_text,
    warning_items,
)
from calibration.rounding import interval, number, with_error

MOST_NAMED = 3  # data sets that the first sentence describes one by one
NOT_CONVERGED = "NOT CONVERGED: do not use these values."
OBJECTIVES = {
    "two-step": "σ and ψ from Eq. (17), then χ̃ from the law with them fixed (`two-step`)",
    "model": "all parameters at once from the likelihood of all points (`model`)",
}
LINE = (
    "One line for all materials, fitted to all curves at once. Its χ̃ follow the data less closely "
    "than a χ̃ for each material; the table above has the rms of both."
)
LINE_OF_TWO = (
    "One line for both materials. Any two χ̃ lie on a line, so it follows the data as closely as "
    "they do; only a third material can test it."
)
CONFIDENCE = (
    "Intervals contain the true value in {:g} % of experiments, if the law is right. Where the noise "
    "is estimated, dof is the number of degrees of freedom of Student's t:"
)
VALUES = f"{VALUES_ALONE[0].upper()}{VALUES_ALONE[1:]}."
NO_SCATTER = (
    "no scatter is estimated in addition to the errors of the tracks (it is from three points more than free parameters on, "
    "without scale_uncertainty): errors are too small if impacts scatter more than frames show"
)
QUALITY = {  # columns of the goodness of fit
    "dof": "degrees of freedom of the residuals",
    "scatter": "estimated standard deviation of one ε, of Student's t its scale (under `two-step` about Eq. (17))",
    "between groups": "estimated standard deviation of the groups' offsets in ε",
    "of times [ms]": "estimated standard deviation of the times of bounces",
    "χ²/dof": "squared residuals over the stated variances, per degree of freedom",
    "factor": "by which the stated uncertainties were scaled, √(χ²/dof)",
    "P": "probability of a χ² at least as large if law and stated uncertainties hold",
}
PICTURES = {
    "curves.png": "Data, fitted curves with their bands, and residuals below",
    "observables.png": "What else was measured, fitted curves with their bands, and residuals below",
    "profiles.png": "Profile likelihoods: the rise of χ² when one parameter is fixed elsewhere",
    "correlation.png": "Correlations of the fitted parameters",
    "posterior.png": "Draws from the posterior, and the fit with its intervals",
    "track.png": "Tracks: frames, fitted flights, and impacts with their ε",
}
FILES = ("fit.json", "report.html", *PICTURES, "posterior.nc")
PAPER_TITLE = (
    "Data: a published fit of measurements (Eq. 17 with Table 1's σ, ψ; Zhou, 2013), "
    "not measurements"
)


def write_report(
    result: Any,
    folder: str | Path,
    *,
    draws: Any = None,
    printed: Printed | None = None,
    command: str = "",
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> list[str]:
    """Write all files of a fit, or none; return their names.

    `printed`: published values of the paper's materials, with which the curves of Fig. 2 are drawn too;
    `command`: what makes the same files again; `progress` is called as progress(stage, done, total).
    """
    from calibration import plots

    lines = plots.lines_of(result, with_paper=printed is not None)
    more: dict[str, Any] = {"title": PAPER_TITLE, "ratio": True, "from_rest": True}
    figures: list[Callable[[], Any]] = [
        lambda: plots.curves_figure(result, lines, **more if printed else {}),
        lambda: plots.observables_figure(result),
        lambda: plots.profiles_figure(result),
        lambda: plots.correlation_figure(result),
        lambda: None if draws is None else plots.posterior_figure(draws, result),
        lambda: plots.track_figure(*_tracks(result)),
    ]
    with files_into(folder, FILES) as staged:
        result.save(staged / "fit.json")
        if draws is not None:
            from calibration.fitting.posterior.draws import write

            write(draws, staged / "posterior.nc")
        pictures = {}
        for done, (name, figure) in enumerate(zip(PICTURES, figures, strict=True)):
            progress("pictures", done, len(PICTURES))
            if (drawn := figure()) is not None:
                plots.save(drawn, staged / name)
                pictures[PICTURES[name]] = name
        parts = sections(result, pictures, command, printed, draws).values()
        blocks = [block for part in parts for block in part]
        write_text(staged / "report.html", page(blocks, staged))
        return [name for name in FILES if (staged / name).exists()]


def printed_values() -> dict[str, dict[str, float]]:
    """Table 1 of the paper, {material: {parameter: value}}."""
    from calibration.paper import TABLE_1

    names = ("chi", "sigma", "psi", "critical_velocity", "limit_velocity", "yield_ratio")
    return {entry.name: {name: getattr(entry, name) for name in names} for entry in TABLE_1}


def terminal_report(result: Any, intro: str = "", **more: Any) -> str:
    """A fit on a terminal, after a remark on the data; `more` as of `sections`."""
    of = sections(result, **more)
    if of["posterior"]:  # a heading is not printed, and its table would look like the fit's
        of["posterior"].insert(0, Block("text", "Posterior:"))
    names = ("parameters", "quality", "line", "posterior", "computed", "verdict", "warnings")
    first = [Block("text", intro)] if intro else of["notes"]
    return terminal([*first, *(block for name in names for block in of[name])])


def result_text(result: Any) -> str:
    """The text that `print` shows: first sentence, estimates, goodness of fit and warnings."""
    of = sections(result)
    names = ("parameters", "quality", "line")
    tables = [b for n in names for b in of[n] if b.kind == "table" or b.value == VALUES]
    outliers = _optional("list", outlier_lines(result))
    return terminal([*of["result"], *tables, *outliers, *of["verdict"], *of["warnings"]])


def result_html(result: Any) -> str:
    """The HTML that a notebook shows."""
    of = sections(result)
    names = ("parameters", "quality")
    tables = [b for n in names for b in of[n] if b.kind == "table" or b.value == VALUES]
    return page([*of["result"], *of["verdict"], *tables, *of["warnings"][1:]])


def _tracks(result: Any) -> tuple[list[Any], list[str]]:
    """The tracks that points are from, and their names."""
    every = [(fit.name, track) for fit in result.materials for track in fit.data.tracks]
    alone = len(result.materials) == len(every)
    return [track for _, track in every], [n if alone else f"{n}, {t.name}" for n, t in every]


def _unscattered(result: Any) -> list[tuple[str, str]]:
    """Sets of precise readings without an estimated scatter."""
    return [
        (NO_SCATTER, fit.name)
        for fit in result.materials
        if fit.data.errors.measured_by.is_precise
        and "scatter" not in fit.variances
        and result.request.options.extra_scatter is None
    ]


def sections(
    result: Any,
    pictures: Mapping[str, str] | None = None,
    command: str = "",
    printed: Printed | None = None,
    draws: Any = None,
) -> dict[str, list[Block]]:
    """The parts of a report by name, in their order; `pictures` are {caption: file next to the report}."""
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    notes = [(note, fit.name) for fit in result.materials for note in fit.data.notes]
    notes += _unscattered(result)
    implausible = [w for w in result.warnings if w.code == "plausibility"]
    methods = [f"{name}: {text}" for name, text in interval_methods(result).items()]
    quality, bodies = quality_table(result), bodies_table(result)
    words = [f"{name}: {text}" for name, text in QUALITY.items() if name in quality]
    warned, of_draws = warning_items(result.warnings, result), _warnings_of_draws(draws, result)
    return {
        "title": [Block("title", "Coefficients of restitution, fitted")],
        "implausible": _optional("list", warning_items(implausible, result)),
        "result": [Block("lead", _sentence(result))],
        "about": [Block("about", f"{datetime.date.today().isoformat()}; {versions}")],
        "verdict": [_verdict(result, len(of_draws))],
        "data": [Block("list", [_data_set(fit) for fit in result.materials])],
        "notes": _optional("list", _with_owners(result, notes, "{names}: {text}")),
        "bodies": [] if bodies.empty else [Block("heading", "Bodies"), Block("table", bodies)],
        "parameters": [
            Block("heading", "Parameters"),
            Block("table", parameter_table(result, printed)),
            *_optional("list", _meanings(result)),
            *_optional("list", _stated(result), "text", "Priors, bounds and shared parameters:"),
            *_optional("list", methods, "text", CONFIDENCE.format(100 * result.confidence)),
            *(
                [Block("text", VALUES)]
                if any(f.objective == "two-step" for f in result.materials)
                else []
            ),
        ],
        "quality": [
            Block("heading", "Goodness of fit"),
            Block("table", quality),
            *observables_blocks(result),
            *_optional("list", words + outlier_lines(result)),
            *group_blocks(result),
        ],
        "pictures": [Block("picture", pair) for pair in (pictures or {}).items()],
        "line": _line(result.unloading_line),
        "posterior": _posterior(draws, result),
        "warnings": _optional("warnings", warned + of_draws, "heading", "Warnings"),
        "computed": [
            Block("heading", "How it was computed"),
            *([Block("code", command)] if command else []),
            Block("text", _computed(result)),
        ],
    }


def _optional(kind: str, value: list[Any], before: str = "text", text: str = "") -> list[Block]:
    """A block, with another one before it that has a text if any; no block if `value` is empty."""
    return [*([Block(before, text)] if text else []), Block(kind, value)] if value else []


def _sentence(result: Any) -> str:
    """The fit in one sentence: law, data, fitted values and rms."""
    laws = dict.fromkeys(fit.model.label for fit in result.materials)
    law = f"{' and '.join(laws)} fitted to {sum(fit.n for fit in result.materials)} impacts"
    count = len(result.materials)
    if count > MOST_NAMED:
        return f"{law} of {count} data sets."
    parts = []
    for fit in result.materials:
        owner = f"on {fit.name}: " if count == 1 else f"{fit.name}, "
        texts = [*fitted_texts(fit, result.confidence), f"rms {number(fit.rms)}"]
        parts.append(owner + ", ".join(texts))
    return f"{law}{' ' if count == 1 else ': '}{'; '.join(parts)}."


def _meanings(result: Any) -> list[str]:
    """Meanings of the symbols of the parameters."""
    words = {
        symbols.symbol(name, fit.model).text: symbols.words(name, fit.model)
        for fit in result.materials
        for name in {**fit.parameters, **fit.derived}
    }
    return [f"{symbol}: {text}" for symbol, text in words.items() if text]


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


def _verdict(result: Any, of_draws: int) -> Block:
    """Whether the fit converged, and the number of warnings.

    Args:
        of_draws: warnings about the posterior.
    """
    if not result.converged:
        return Block("strong", NOT_CONVERGED)
    count = len(result.warnings)
    text = f"with {count} warning{'s' * (count > 1)}" if count else "without warnings"
    more = f"; its posterior has {of_draws} warning{'s' * (of_draws > 1)}" if of_draws else ""
    return Block("text", f"The fit converged {text}{more}.")


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
    return [
        Block("heading", "One line for all materials, Eq. (18)"),
        Block("text", text),
        Block("table", pd.DataFrame(columns)),
        *([] if line.converged else [Block("strong", "NOT CONVERGED: the fit of this line.")]),
    ]


def _computed(result: Any) -> str:
    """Settings, rank and searches; those of each search are in fit.json."""
    options, stages = result.request.options, result.optimiser_report
    estimated = {n: getattr(options, n) for n in ("extra_scatter", "scale_uncertainty")}
    settings = ", ".join(
        f"{name.replace('_', ' ')} {value}"
        for name, value in {**result.settings, **estimated}.items()
        if value is not None and value is not False and name != "shared"
    )
    others = {s.optimiser: s.stage for s in stages if s.optimiser != result.settings["optimiser"]}
    settings += "".join(f", {stage} by {optimiser}" for optimiser, stage in others.items())
    condition = number(result.condition_number, 2)
    rank = f"Rank {result.rank} of {len(result.covariance_names)} free parameters"
    seconds = number(result.times.get("searches"), 2)
    searches = f"{len(stages)} search{'es' * (len(stages) != 1)}, {sum(s.evaluations for s in stages)} evaluations"
    return f"{settings}. {rank}, condition number {condition}. {searches}, {seconds} s."


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
        Block("heading", "Posterior"),
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
