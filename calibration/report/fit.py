"""The report of a fit: all its files, and what a terminal, `print` and a notebook show of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from calibration.output import files_into, write_text
from calibration.report.layout import Block, page, terminal
from calibration.report.sections import NOTEBOOK, PRINTED, TERMINAL, VERBOSE, chosen, sections
from calibration.report.tables import Printed, points_table

PICTURES = {
    "curves.png": "Data, fitted curves with their bands, and residuals below",
    "observables.png": "What else was measured, fitted curves with their bands, and residuals below",
    "profiles.png": "Profile likelihoods: the rise of χ² when one parameter is fixed elsewhere",
    "correlation.png": "Correlations of the fitted parameters",
    "budget.png": "What uncertain inputs and the scatter of the points contribute",
    "posterior.png": "Draws from the posterior, and the fit with its intervals",
    "track.png": "Tracks: frames, fitted flights, and impacts with their ε",
}
FILES = ("fit.json", "points.csv", "report.html", *PICTURES, "posterior.nc")
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
        lambda: plots.budget_figure(result),
        lambda: None if draws is None else plots.posterior_figure(draws, result),
        lambda: plots.track_figure(*_tracks(result)),
    ]
    with files_into(folder, FILES) as staged:
        result.save(staged / "fit.json")
        write_text(
            staged / "points.csv", points_table(result).to_csv(index=False, lineterminator="\n")
        )
        if draws is not None:
            from calibration.fitting.posterior.draws import write

            write(draws, staged / "posterior.nc")
        pictures = {}
        for done, (name, figure) in enumerate(zip(PICTURES, figures, strict=True)):
            progress("pictures", done, len(PICTURES))
            if plots.draw(figure, staged / name):
                pictures[PICTURES[name]] = name
        every = sections(result, pictures, command, printed, draws)
        blocks = [block for section in every for block in section.with_title]
        write_text(staged / "report.html", page(blocks, staged))
        return [name for name in FILES if (staged / name).exists()]


def _tracks(result: Any) -> tuple[list[Any], list[str]]:
    """The tracks that points are from, and their names."""
    every = [(fit.name, track) for fit in result.materials for track in fit.data.tracks]
    alone = len(result.materials) == len(every)
    return [track for _, track in every], [n if alone else f"{n}, {t.name}" for n, t in every]


def printed_values() -> dict[str, dict[str, float]]:
    """Table 1 of the paper, {material: {parameter: value}}."""
    from calibration.paper import TABLE_1

    names = ("chi", "sigma", "psi", "critical_velocity", "limit_velocity", "yield_ratio")
    return {entry.name: {name: getattr(entry, name) for name in names} for entry in TABLE_1}


def terminal_report(result: Any, intro: str = "", verbose: bool = False, **more: Any) -> str:
    """A fit on a terminal, after a remark on the data; `verbose` adds all that the page has.

    `more` as of `sections`.
    """
    names: tuple[str, ...] = (*TERMINAL, *VERBOSE) if verbose else TERMINAL
    if intro:  # which says what the data are
        names = tuple("exact" if name == "notes" else name for name in names)
    shown = chosen(sections(result, **more, brief=not verbose), names)
    first = [Block("text", intro)] if intro else []
    for k, section in enumerate(shown):  # the table would look like the fit's
        if section.name == "posterior" and section.blocks:
            shown[k] = section._replace(blocks=[Block("text", "Posterior:"), *section.blocks])
    return terminal([*first, *(block for section in shown for block in section.blocks)])


def result_text(result: Any) -> str:
    """The text that `print` shows."""
    shown = chosen(sections(result, brief=True), PRINTED)
    return terminal(block for section in shown for block in section.blocks)


def result_html(result: Any) -> str:
    """The HTML that a notebook shows."""
    shown = chosen(sections(result, brief=True), NOTEBOOK)
    return page([block for section in shown for block in section.blocks])
