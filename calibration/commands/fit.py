"""Fit a contact law to measured coefficients of restitution.

Without a file it fits χ̃, σ and ψ of the three materials of Zhou, Theor. Appl. Mech. Lett. 3, 021003
(2013), by the paper's own procedure, to a published fit of measurements that comes with the program.
With one it fits your own: Zhou's law, or another (`--law`). Written are fit.json, curves.png,
report.md, report.html (the same as one page, pictures inside) and, where there is something to show,
profiles.png and correlation.png.
"""

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from calibration.console import Progress, print_first
from calibration.errors import DataError, InputError, listed, printable
from calibration.options import LAW_OPTIONS, add_options, flag, given_options, idle
from calibration.output import check_writable, or_printed

INTRO = (
    "These data are a published fit of measurements, not measurements: Eq. (17) with Table 1's σ "
    "and ψ (Zhou, Theor. Appl. Mech. Lett. 3, 021003, 2013) at 40 velocities a material. "
    "They have no scatter, so that standard errors are 0 and any misfit shows.\n"
    "Your own: softjax fit FILE.toml"
)


@dataclass(frozen=True)
class Job:
    """What is to be fitted, and how it is told."""

    datasets: Sequence[Any]
    parameters: Sequence[Mapping[str, Any]] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    file: str | None = None  # None: the embedded data
    given: Mapping[str, Any] = field(default_factory=dict)  # on the command line
    problem: Any = None  # the file, as it was read
    draws: int | None = None  # of the posterior, a chain

    @property
    def embedded(self) -> bool:
        return self.file is None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `softjax fit`; those given win over the file's `[fit]` table."""
    parser.add_argument("file", nargs="?", metavar="FILE.toml", help="the materials and their data")
    add_options(parser)
    parser.add_argument(
        "--posterior",
        nargs="?",
        type=_whole(100),
        const=1000,
        metavar="DRAWS",
        help="sample the posterior: 4 chains of 1000 draws, or of as many as told; needs the extra bayes",
    )


def run(arguments: argparse.Namespace) -> int:
    """Fit, write, print; 0, or 1 where the fit did not converge."""
    check_writable(arguments.out)
    job = replace(_job(arguments), draws=arguments.posterior)
    if job.draws is not None:
        from calibration.fitting.posterior.door import check_possible

        check_possible(job.settings.get("objective"), job.settings.get("loss", "squared"))
    from calibration.report.folder import write_report

    with Progress(arguments.quiet) as progress:
        result = _fitted(job, progress)
        draws = _sampled(result, job, progress)
        text = [] if arguments.quiet else [_text(result, job, draws)]
        with or_printed(text):
            written = write_report(
                result,
                arguments.out,
                draws=draws,
                of_paper=job.embedded,
                command=_command(job, arguments.out),
                progress=progress,
            )
    if text:
        print(f"{text[0]}\n\nWritten to {arguments.out}: {listed(written)}")
    if result.converged:
        return 0
    print("softjax fit: did not converge; the results are written and marked so", file=sys.stderr)
    return 1


def _job(arguments: argparse.Namespace) -> Job:
    given = given_options(arguments)
    if arguments.file is None:
        from calibration.data.paper import paper_materials

        by_paper = given.get("law", "zhou") == "zhou"
        settings = _heeded({"objective": "two-step"} if by_paper else {}, given)
        return Job(paper_materials(), settings=settings, given=given)
    from calibration.problem_file import read_problem

    problem = read_problem(arguments.file)
    print_first(problem.implausible, arguments.quiet)
    settings = _heeded(problem.settings, given)
    own = (problem.datasets, problem.parameters, settings, arguments.file)
    return Job(*own, given=given, problem=problem)


def _heeded(of_file: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of both; of the file's not what was for another law, or would do nothing now."""
    others = LAW_OPTIONS if given.get("law", of_file.get("law")) != of_file.get("law") else ()
    settings = {name: value for name, value in of_file.items() if name not in others} | {**given}
    for name, accepted in idle(settings).items():
        if name in given:
            raise DataError(flag(name), "given", f"left out: {accepted}")
        del settings[name]
    return settings


def _fitted(job: Job, progress: Progress):
    import softjax as sj
    from calibration.fitting.door import fit

    sj.enable_x64()
    settings = {name: value for name, value in job.settings.items() if name != "area"}
    data = job.datasets[0] if len(job.datasets) == 1 else list(job.datasets)
    try:
        return fit(
            data,
            settings.pop("law", None),
            job.parameters,
            progress=progress,
            **settings,
        )
    except (DataError, sj.ArgumentError) as error:
        raise _refusal(job, error) from error


def _refusal(job: Job, error: ValueError) -> InputError:
    """What the fit refuses, with the line of the file that says it."""
    if isinstance(error, DataError) and job.problem is not None:
        name = error.argument
        if name in job.problem.settings and name not in job.given:
            return error.at(job.file, job.problem.line(name))
    return InputError(job.file, None, str(error), "nothing was fitted")


def _sampled(result, job: Job, progress: Progress) -> Any:
    """Draws from the posterior, where they were asked for."""
    if job.draws is None:
        return None
    seed = job.settings.get("seed", 0)
    return result.posterior(job.draws, seed=seed, warmup=job.draws, progress=progress)


def _text(result, job: Job, draws: Any) -> str:
    from calibration.report.folder import printed_values
    from calibration.report.render import terminal_report

    more: dict[str, Any] = {"printed": printed_values()} if job.embedded else {}
    if draws is not None:
        from calibration.report.posterior import section

        more["posterior"] = section(draws, result.confidence)
    return terminal_report(result, INTRO if job.embedded else "", **more)


def _command(job: Job, out: Path) -> str:
    """The command that makes the same results again."""
    parts = ["softjax", "fit", *([job.file] if job.file else [])]
    for name, value in job.given.items():
        parts += [flag(name), *([] if isinstance(value, bool) else [str(value).replace(" ", "-")])]
    parts += ["--posterior", str(job.draws)] * (job.draws is not None)
    return printable(shlex.join([*parts, "--out", str(out)]))


def _whole(least: int):
    def number(text: str) -> int:
        if not text.isascii() or not text.isdigit() or int(text) < least:
            problem = f"{text!r} is no whole number of {least} or more"
            raise argparse.ArgumentTypeError(problem)
        return int(text)

    return number
