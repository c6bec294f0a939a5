"""Fit a contact law to measured coefficients of restitution.

Without a file it fits χ̃, σ and ψ of the three materials of Zhou, Theor. Appl. Mech. Lett. 3, 021003
(2013), by the paper's own procedure, to a published fit of measurements that comes with the program.
With one it fits your own: Zhou's law, or another (`--law`). Written are fit.json, curves.png,
report.md and, where there is something to show, profiles.png and correlation.png.
"""

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calibration.atomic import check_writable, files_into
from calibration.choices import CHOICES, NUMBERS, OPTIONS
from calibration.errors import InputError
from calibration.progress import Progress

WORDS = ("law", "objective", "optimiser", "route", "loss", *OPTIONS)
PICTURES = {
    "curves.png": "Data, fitted curves with their bands, and residuals below",
    "profiles.png": "Profiles of the cost: its rise when one parameter is held elsewhere",
    "correlation.png": "Correlations of the fitted parameters",
}
FILES = ("fit.json", "report.md", *PICTURES)
INTRO = (
    "These data are a published fit of measurements, not measurements: Eq. (17) with Table 1's σ "
    "and ψ (Zhou, Theor. Appl. Mech. Lett. 3, 021003, 2013) at 40 velocities a material. "
    "They have no scatter, so that standard errors are 0 and any misfit shows.\n"
    "Your own: softjax fit FILE.toml"
)
TITLE = (
    "Data: a published fit of measurements (Eq. 17 with Table 1's σ, ψ; Zhou, 2013), "
    "not measurements"
)


@dataclass(frozen=True)
class Job:
    """What is to be fitted, and how it is told."""

    datasets: Sequence[Any]
    parameters: Sequence[Mapping[str, Any]] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    file: str | None = None  # None: the embedded data
    beside: bool = False
    given: Mapping[str, Any] = field(default_factory=dict)  # on the command line

    @property
    def embedded(self) -> bool:
        return self.file is None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `softjax fit`; those given win over the file's `[fit]` table."""
    parser.add_argument("file", nargs="?", metavar="FILE.toml", help="the materials and their data")
    for name in WORDS:
        accepted = [choice.replace(" ", "-") for choice in CHOICES[name]]
        parser.add_argument(f"--{name}", choices=accepted, help=HELP[name])
    parser.add_argument("--starts", type=_whole(1), metavar="N", help="starts that are screened")
    parser.add_argument("--seed", type=_whole(0), metavar="N", help="of the starts")
    parser.add_argument(
        "--confidence", type=_number("confidence"), metavar="X", help="default: 0.95"
    )
    parser.add_argument(
        "--no-profiles",
        dest="profiles",
        action="store_const",
        const=False,
        help="no profile likelihoods: intervals from standard errors, in less time",
    )
    parser.add_argument(
        "--beside",
        action="store_true",
        help="fit again by Levenberg–Marquardt through the energy balance (always without a file)",
    )


HELP = {
    "law": "which contact law is fitted (default: zhou)",
    "objective": "the law's own likelihood (model, the default), or the paper's two steps",
    "optimiser": "default: l-bfgs",
    "route": "from a law to ε: time integration (default of two-step) or energy balance",
    "loss": "squared, or one that resists outliers (default: squared)",
    "form": "of Zhou's law (default: first-order)",
    "kappa": "consistent with the forces (default), or as the paper prints it",
    "end": "of a dashpot law's contact (default: zero-overlap)",
}


def run(arguments: argparse.Namespace) -> int:
    """Fit, write, print; 0, or 1 where the fit did not converge."""
    check_writable(arguments.out)
    job = _job(arguments)
    with Progress(arguments.quiet) as progress:
        result = _fitted(job, progress)
        _write(result, job, arguments.out, progress)
    if not arguments.quiet:
        _print(result, job, arguments.out)
    if result.converged:
        return 0
    print("softjax fit: did not converge; the results are written and marked so", file=sys.stderr)
    return 1


def _job(arguments: argparse.Namespace) -> Job:
    names = (*WORDS, "starts", "seed", "confidence", "profiles")
    given = {name: getattr(arguments, name) for name in names}
    given = {name: value for name, value in given.items() if value is not None}
    if "route" in given:
        given["route"] = given["route"].replace("-", " ")
    if arguments.file is None:
        from calibration.data.paper import paper_materials

        settings = {"objective": "two-step", **given}
        return Job(paper_materials(), settings=settings, beside=True, given=given)
    from calibration.problem_file import read_problem

    problem = read_problem(arguments.file)
    settings = {**problem.settings, **given}
    if given.get("route") == "energy balance":  # the file's tolerance was for its own route
        settings.pop("rtol", None)
    return Job(
        problem.datasets, problem.parameters, settings, arguments.file, arguments.beside, given
    )


def _fitted(job: Job, progress: Progress):
    import softjax as sj
    from calibration.fitting.door import fit

    sj.enable_x64()
    settings = dict(job.settings)
    options = {name: settings.pop(name) for name in OPTIONS if name in settings}
    said = job.parameters or [{} for _ in job.datasets]
    settings.pop("area", None)  # the contacts have it
    route = _route(settings.pop("route", None), settings.pop("rtol", None))
    if settings.get("unloading_line") == "none":
        settings["unloading_line"] = None
    data = job.datasets[0] if len(job.datasets) == 1 else list(job.datasets)
    try:
        return fit(
            data,
            settings.pop("law", None),
            [{**own, **options} for own in said],
            route=route,
            beside=job.beside,
            progress=progress,
            **settings,
        )
    except InputError:
        raise
    except ValueError as error:
        raise InputError(job.file, None, str(error), "nothing was fitted") from error


def _route(name: str | None, rtol: float | None):
    import softjax as sj

    if name == "energy balance":
        return sj.EnergyBalance()
    return None if rtol is None else sj.ODE(rtol=rtol)


def _write(result, job: Job, out: Path, progress: Progress) -> None:
    """All files of a fit, or none."""
    from calibration.report import markdown_report

    with files_into(out, owned=FILES) as staged:
        result.save(staged / "fit.json")
        pictures = _draw(result, job, staged, progress)
        report = markdown_report(result, pictures, _command(job, out), _printed(job))
        (staged / "report.md").write_text(report, encoding="utf-8")


def _draw(result, job: Job, directory: Path, progress: Progress) -> dict[str, str]:
    """The pictures there are, as {caption: file}."""
    from calibration import plots

    drawn = {}
    makers = {
        "curves.png": lambda: _curves(result, job),
        "profiles.png": lambda: plots.profiles_figure(result),
        "correlation.png": lambda: plots.correlation_figure(result),
    }
    for i, (name, make) in enumerate(makers.items()):
        progress("pictures", i, len(makers))
        figure = make()
        if figure is not None:
            plots.save(figure, directory / name)
            drawn[PICTURES[name]] = name
    return drawn


def _curves(result, job: Job):
    from calibration import plots

    lines = plots.lines_of(result, with_paper=job.embedded)
    if job.embedded:
        return plots.curves_figure(result, lines, ratio=True, from_rest=True, title=TITLE)
    return plots.curves_figure(result, lines)


def _print(result, job: Job, out: Path) -> None:
    from calibration.report import terminal_report

    print(terminal_report(result, _printed(job), INTRO if job.embedded else ""))
    written = ", ".join(name for name in FILES if (out / name).exists())
    print(f"\nWritten to {out}: {written}")


def _printed(job: Job) -> dict[str, dict[str, float]] | None:
    """Table 1, for the paper's materials."""
    if not job.embedded:
        return None
    from softjax.paper import TABLE_1

    names = ("chi", "sigma", "psi", "critical_velocity", "limit_velocity", "yield_ratio")
    return {entry.name: {name: getattr(entry, name) for name in names} for entry in TABLE_1}


def _command(job: Job, out: Path) -> str:
    """The command that makes the same results again."""
    parts = ["softjax", "fit", *([job.file] if job.file else [])]
    for name, value in job.given.items():
        parts += (
            ["--no-profiles"] if name == "profiles" else [f"--{name}", str(value).replace(" ", "-")]
        )
    parts += ["--beside"] * (job.beside and not job.embedded)
    return shlex.join([*parts, "--out", str(out)])


def _number(name: str):
    holds, accepted = NUMBERS[name]

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not holds(value):
            raise argparse.ArgumentTypeError(f"{text!r} is not {accepted}")
        return value

    return number


def _whole(least: int):
    def number(text: str) -> int:
        if not text.isascii() or not text.isdigit() or int(text) < least:
            problem = f"{text!r} is no whole number of {least} or more"
            raise argparse.ArgumentTypeError(problem)
        return int(text)

    return number
