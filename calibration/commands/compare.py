"""Which contact law a data set prefers: every law fitted, and ranked by how well it predicts.

    softjax compare my_alloy.toml
    softjax compare my_alloy.toml --laws zhou,thornton,walton-braun
    softjax compare                 # the three materials of Zhou (2013)

Ranked by the expected log predictive density: each point (each group, where the data have groups)
predicted by the fit without it. Written are compare.json and compare.png. Without a file also
figure2.png, Fig. 2 of the paper again, and linear_spring.png, the paper's argument against the
linear model; `--figure2` and `--linear-spring` make these alone.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.console import print_first
from calibration.errors import DataError, did_you_mean, listed
from calibration.options import LAW_OPTIONS, LAWS, add_options
from calibration.output import check_writable, files_into, or_printed, write_text

FILES = {"figure2": "figure2.png", "linear_spring": "linear_spring.png"}
WRITTEN = ("compare.json", "compare.png", *FILES.values())
NAMES = (*LAWS, "thornton-fixed")
HEEDED = (*LAW_OPTIONS, "area")  # of a file's settings; the rest is for `softjax fit`


@dataclass(frozen=True)
class Job:
    """What is compared: data sets, laws by name (None: all), their options, and what is told."""

    datasets: list[Any]
    laws: list[str] | None
    options: dict[str, str]
    remarks: list[str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", nargs="?", metavar="FILE.toml", help="the materials and their data")
    names = f"which ones, by commas: {', '.join(NAMES)} (default: all)"
    parser.add_argument("--laws", metavar="A,B,C", help=names)
    parser.add_argument(
        "--law", action="append", default=[], metavar="A", help="one of them; may be repeated"
    )
    add_options(parser, LAW_OPTIONS)
    parser.add_argument("--figure2", action="store_true", help="only Fig. 2 of the paper again")
    parser.add_argument(
        "--linear-spring", action="store_true", help="only the case against the linear spring"
    )


def run(arguments: argparse.Namespace) -> int:
    """Fit, write, print; 0, or 1 where a law's fit did not converge."""
    import softjax as sj
    from calibration.console import Progress

    laws = _laws(arguments)
    wanted = [name for name in FILES if getattr(arguments, name)]
    _check(arguments, wanted)
    check_writable(arguments.out)
    sj.enable_x64()
    with Progress(arguments.quiet) as progress:
        if wanted:
            return _pictures(wanted, arguments, progress)
        return _compare(_job(arguments, laws), arguments, progress)


def _laws(arguments: argparse.Namespace) -> list[str] | None:
    """Names in the order they were given, each once."""
    every = [] if arguments.laws is None else arguments.laws.split(",")
    names = list(dict.fromkeys(name.strip() for name in [*every, *arguments.law]))
    for name in names:
        if name not in NAMES:
            accepted = f"one of {listed(NAMES)}{did_you_mean(name, NAMES)}"
            raise DataError("--law" if name in arguments.law else "--laws", repr(name), accepted)
    return names or None


def _check(arguments: argparse.Namespace, wanted: list[str]) -> None:
    """Options that would be ignored are refused."""
    for name in wanted:
        option = f"--{name.replace('_', '-')}"
        if arguments.file is not None:
            raise DataError(option, "given with a file", "left out with one: it needs no data")
        for other in ("laws", "law", *LAW_OPTIONS):
            if getattr(arguments, other):
                raise DataError(f"--{other}", f"given with {option}", "left out with it")


def _job(arguments: argparse.Namespace, laws: list[str] | None) -> Job:
    options = {name: getattr(arguments, name) for name in LAW_OPTIONS if getattr(arguments, name)}
    _check_options(options, laws)
    if arguments.file is None:
        from calibration.data.paper import paper_materials

        return Job(paper_materials(), laws, options, [])
    from calibration.problem_file import read_problem

    problem = read_problem(arguments.file)
    print_first(problem.implausible, arguments.quiet)
    told = {name: problem.settings[name] for name in LAW_OPTIONS if name in problem.settings}
    return Job(problem.datasets, laws, told | options, _unused(problem))


def _check_options(options: dict[str, str], laws: list[str] | None) -> None:
    for name in options:
        if laws is not None and not {*LAW_OPTIONS[name]} & {*laws}:
            accepted = f"left out without {' or '.join(LAW_OPTIONS[name])} among the laws"
            raise DataError(f"--{name}", "given", accepted)


def _unused(problem: Any) -> list[str]:
    """One line that names what of a file is for `softjax fit` alone."""
    names = [name for name in problem.settings if name not in HEEDED]
    names += sorted({name for said in problem.said for name in said})
    if not names:
        return []
    return [f"Of the file, this acts in `softjax fit` only: {', '.join(names)}."]


def _compare(job: Job, arguments: argparse.Namespace, progress: Any) -> int:
    from calibration.plots.comparison import comparison_figure
    from calibration.plots.style import save
    from calibration.report.comparison import comparison_json, comparison_text
    from calibration.studies.compare import compare

    said: dict[str, dict[str, str]] = {}
    for option, value in job.options.items():
        for law in LAW_OPTIONS[option]:
            if job.laws is None or law in job.laws:
                said.setdefault(law, {})[option] = value
    comparisons = [
        compare(data, job.laws, parameters=said, watch=progress.over) for data in job.datasets
    ]
    extra = tuple(FILES) if arguments.file is None else ()
    settings = {"file": arguments.file, "laws": job.laws, "options": job.options}
    told = [] if arguments.quiet else [comparison_text(comparisons, job.remarks, "compare.json")]
    with or_printed(told), files_into(arguments.out, WRITTEN) as folder:
        write_text(folder / "compare.json", comparison_json(comparisons, settings))
        save(comparison_figure(comparisons), folder / "compare.png")
        ended = _draw(folder, extra, progress)
    progress.close()
    if told:
        print(told[0])
        _told(arguments.out, ["compare.json", "compare.png", *(FILES[name] for name in extra)])
    return _code(ended and all(one.converged for one in comparisons))


def _pictures(wanted: list[str], arguments: argparse.Namespace, progress: Any) -> int:
    with files_into(arguments.out, WRITTEN) as folder:
        converged = _draw(folder, wanted, progress)
    progress.close()
    if not arguments.quiet:
        _told(arguments.out, [FILES[name] for name in wanted])
    return _code(converged)


def _draw(folder: Path, wanted, progress: Any) -> bool:
    """The pictures that need no file; whether the fits behind them converged."""
    from calibration.plots.style import save

    converged = True
    if "figure2" in wanted:
        from calibration.plots.figure_2 import figure_2, fit_materials

        result = fit_materials(progress)
        converged = result.converged
        save(figure_2(result), folder / FILES["figure2"])
    if "linear_spring" in wanted:
        from calibration.plots.linear_spring import linear_figure

        save(linear_figure(), folder / FILES["linear_spring"])
    return converged


def _told(out: Path, names: list[str]) -> None:
    print(f"\nWritten to {out}: {', '.join(names)}")


def _code(converged: bool) -> int:
    if converged:
        return 0
    print("softjax compare: a fit did not converge; it is written and marked so", file=sys.stderr)
    return 1
