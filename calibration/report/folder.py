"""Write the files of a fit: fit.json, pictures, report.md, report.html, draws."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from calibration import plots
from calibration.output import files_into, write_text
from calibration.report.fit import report_blocks
from calibration.report.layout import markdown, page

PICTURES = {
    "curves.png": "Data, fitted curves with their bands, and residuals below",
    "observables.png": "What else was measured, fitted curves with their bands, and residuals below",
    "profiles.png": "Profile likelihoods: the rise of χ² when one parameter is fixed elsewhere",
    "correlation.png": (
        "Correlations of the fitted parameters: ellipses of equal probability, blue and leaning right "
        "for positive ones, orange and leaning left for negative ones"
    ),
    "posterior.png": "Draws from the posterior, and the fit with its intervals",
}
FILES = ("fit.json", "report.md", "report.html", *PICTURES, "posterior.nc")
PAPER_TITLE = (
    "Data: a published fit of measurements (Eq. 17 with Table 1's σ, ψ; Zhou, 2013), "
    "not measurements"
)


def write_report(
    result: Any,
    folder: str | Path,
    *,
    draws: Any = None,
    of_paper: bool = False,
    command: str = "",
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> list[str]:
    """Write all files of a fit, or none; return their names.

    Args:
        result: a `FitResult`.
        folder: made where it is not there.
        draws: of its posterior.
        of_paper: whether the data are the paper's: Table 1 and the curves of Fig. 2 are shown too.
        command: the command that makes the same files again.
        progress: called as progress(stage, done, total).

    Raises:
        OSError: where the files cannot be written.
    """
    more: dict[str, Any] = {"title": PAPER_TITLE, "ratio": True, "from_rest": True}
    figures = {
        "curves.png": lambda: plots.curves_figure(
            result, plots.lines_of(result, with_paper=of_paper), **more if of_paper else {}
        ),
        "observables.png": lambda: plots.observables_figure(result),
        "profiles.png": lambda: plots.profiles_figure(result),
        "correlation.png": lambda: plots.correlation_figure(result),
        "posterior.png": lambda: None if draws is None else plots.posterior_figure(draws, result),
    }
    posterior = None
    with files_into(folder, FILES) as staged:
        result.save(staged / "fit.json")
        if draws is not None:
            from calibration.fitting.posterior.draws import write
            from calibration.report.posterior import section

            write(draws, staged / "posterior.nc")
            posterior = section(draws, result)
        pictures = {}
        for done, (name, caption) in enumerate(PICTURES.items()):
            progress("pictures", done, len(PICTURES))
            figure = figures[name]()
            if figure is not None:
                plots.save(figure, staged / name)
                pictures[caption] = name
        printed = printed_values() if of_paper else None
        blocks = report_blocks(result, pictures, command, printed, posterior)
        write_text(staged / "report.md", markdown(blocks))
        write_text(staged / "report.html", page(blocks, staged))
        return [name for name in FILES if (staged / name).exists()]


def printed_values() -> dict[str, dict[str, float]]:
    """Table 1 of the paper, {material: {parameter: value}}."""
    from calibration.paper import TABLE_1

    names = ("chi", "sigma", "psi", "critical_velocity", "limit_velocity", "yield_ratio")
    return {entry.name: {name: getattr(entry, name) for name in names} for entry in TABLE_1}
