"""Which contact law a data set prefers: every law fitted, and sorted by leave-one-out rms.

    softjax compare my_alloy.toml
    softjax compare my_alloy.toml --free yield_factor
    softjax compare                 # the three materials of Zhou (2013)

Written are compare.json and compare.png. Without a file also figure2.png, Fig. 2 of the paper
again, and linear_spring.png, the paper's argument against the linear model; `--figure2` and
`--linear-spring` make these alone.
"""

import argparse
import sys
from pathlib import Path

from calibration.atomic import check_writable, files_into
from calibration.errors import DataError

FREE = ("yield_factor",)
FILES = {"figure2": "figure2.png", "linear_spring": "linear_spring.png"}
HEEDED = ("form", "kappa", "area")  # of a file's settings; the rest is for `softjax fit`


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", nargs="?", metavar="FILE.toml", help="the materials and their data")
    parser.add_argument(
        "--free",
        action="append",
        choices=FREE,
        default=[],
        help="fit Thornton's contact yield pressure too, as a factor of the yield strength",
    )
    parser.add_argument("--form", choices=("first-order", "full"), help="of Zhou's law")
    parser.add_argument("--kappa", choices=("consistent", "printed"), help="of Zhou's law")
    parser.add_argument("--figure2", action="store_true", help="only Fig. 2 of the paper again")
    parser.add_argument(
        "--linear-spring", action="store_true", help="only the case against the linear spring"
    )


def run(arguments: argparse.Namespace) -> int:
    """Fit, write, print; 0, or 1 where a law's fit did not converge."""
    import softjax as sj
    from calibration.progress import Progress

    _check(arguments)
    check_writable(arguments.out)
    sj.enable_x64()
    wanted = [name for name in FILES if getattr(arguments, name)]
    with Progress(arguments.quiet) as progress:
        if wanted:
            return _pictures(wanted, arguments, progress)
        return _compare(arguments, progress)


def _check(arguments: argparse.Namespace) -> None:
    if arguments.file is None:
        return
    for name in FILES:
        if getattr(arguments, name):
            option = f"--{name.replace('_', '-')}"
            raise DataError(option, "given with a file", "left out with one: it needs no data")


def _compare(arguments: argparse.Namespace, progress) -> int:
    from calibration.compare.ranking import rank

    datasets, laws, remarks = _read(arguments)
    free = tuple(dict.fromkeys(arguments.free))
    rankings = [rank(data, free, **laws, watch=progress.over) for data in datasets]
    extra = tuple(FILES) if arguments.file is None else ()
    with files_into(arguments.out) as folder:
        _write(folder, rankings, {"file": arguments.file, "free": list(free), **laws})
        ended = _draw(folder, extra, progress)
    progress.close()
    if not arguments.quiet:
        _print(rankings, remarks, arguments.out, extra)
    return _code(ended and all(ranking.converged for ranking in rankings))


def _read(arguments: argparse.Namespace):
    """Data sets, the variant of Zhou's law, and what the file says that does not act here."""
    laws = {"form": "first-order", "kappa": "consistent"}
    given = {name: getattr(arguments, name) for name in laws if getattr(arguments, name)}
    if arguments.file is None:
        from calibration.data.paper import paper_materials

        return paper_materials(), laws | given, []
    from calibration.problem_file import read_problem

    problem = read_problem(arguments.file)
    told = {name: problem.settings[name] for name in laws if name in problem.settings}
    return problem.datasets, laws | told | given, _unused(problem)


def _unused(problem) -> list[str]:
    """One line that names what is for `softjax fit` alone."""
    names = [name for name in problem.settings if name not in HEEDED]
    names += sorted({n for own in (*problem.parameters, problem.shared_parameters) for n in own})
    if not names:
        return []
    return [f"Of the file, this acts in `softjax fit` only: {', '.join(names)}."]


def _write(folder: Path, rankings, settings) -> None:
    from calibration.compare.pictures import comparison_figure
    from calibration.compare.telling import comparison_json
    from calibration.plots.style import save

    (folder / "compare.json").write_text(comparison_json(rankings, settings), encoding="utf-8")
    save(comparison_figure(rankings), folder / "compare.png")


def _draw(folder: Path, wanted, progress) -> bool:
    """The pictures that need no file; whether the fits behind them converged."""
    from calibration.plots.style import save

    converged = True
    if "figure2" in wanted:
        from calibration.compare.figure_2 import figure_2, fit_materials

        result = fit_materials(progress)
        converged = result.converged
        save(figure_2(result), folder / FILES["figure2"])
    if "linear_spring" in wanted:
        from calibration.compare.linear_picture import linear_figure

        save(linear_figure(), folder / FILES["linear_spring"])
    return converged


def _pictures(wanted, arguments: argparse.Namespace, progress) -> int:
    with files_into(arguments.out) as folder:
        converged = _draw(folder, wanted, progress)
    progress.close()
    if not arguments.quiet:
        print(f"Written to {arguments.out}: {', '.join(FILES[name] for name in wanted)}")
    return _code(converged)


def _print(rankings, remarks, out: Path, extra) -> None:
    from calibration.compare.telling import comparison_text

    print(comparison_text(rankings, remarks))
    names = ["compare.json", "compare.png", *(FILES[name] for name in extra)]
    print(f"\nWritten to {out}: {', '.join(names)}")


def _code(converged: bool) -> int:
    if converged:
        return 0
    print("softjax compare: a fit did not converge; it is written and marked so", file=sys.stderr)
    return 1
