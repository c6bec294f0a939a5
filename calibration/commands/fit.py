"""Fit a contact law to measured coefficients of restitution.

Without a file it fits χ̃, σ and ψ of the three materials of Zhou, Theor. Appl. Mech. Lett. 3, 021003
(2013), by the paper's own procedure, to a published fit of measurements that comes with the program.
With one it fits your own: Zhou's law, or another (`--law`). Written are fit.json, points.csv, curves.png,
report.html (one page, pictures inside) and, where there is something to show, profiles.png,
correlation.png, observables.png, budget.png and track.png.
"""

import argparse
import sys
from collections.abc import Mapping
from typing import Any

from calibration.commands.source_options import read_material_file
from calibration.console import Progress, print_first
from calibration.errors import DataError, InputError
from calibration.options import add_options, given_options, merged
from calibration.output import check_writable, or_printed

INTRO = (
    "These data are a published fit of measurements, not measurements: Eq. (17) with Table 1's σ "
    "and ψ (Zhou, Theor. Appl. Mech. Lett. 3, 021003, 2013) at 40 velocities a material, without "
    "scatter: any misfit is the law's. χ̃ is 4 to 14 times Table 1's, which goes with the printed κ.\n"
    "Your own: softjax fit FILE.toml"
)
FEWEST_DRAWS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `softjax fit`; those given win over the file's `[fit]` table."""
    parser.add_argument("file", nargs="?", metavar="FILE.toml", help="the materials and their data")
    add_options(parser)
    text = "sample the posterior: 4 chains of 1000 draws, or of as many as given (extra bayes)"
    parser.add_argument(
        "--posterior", nargs="?", type=_draws, const=1000, metavar="DRAWS", help=text
    )
    text = "print settings, meanings of symbols, bodies, versions and searches, too"
    parser.add_argument("--verbose", action="store_true", help=text)
    text = "print fit.json to standard output instead of the tables"
    parser.add_argument("--json", action="store_true", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Fit, write, print; 0, or 1 where the fit did not converge."""
    from calibration.report.fit import printed_values, terminal_report, write_report

    check_writable(arguments.out)
    options, of_paper = given_options(arguments), arguments.file is None
    more: dict[str, Any] = {}
    with Progress(arguments.quiet) as progress:
        result = _fitted(arguments, options, progress)
        if arguments.posterior is not None:
            count, seed = arguments.posterior, result.request.options.seed
            more["draws"] = result.posterior(count, seed=seed, warmup=count, progress=progress)
        more["printed"] = printed_values() if of_paper else None
        intro = INTRO if of_paper else ""
        more["command"] = arguments.as_typed
        text = result.to_json()
        if not arguments.json:
            text = terminal_report(result, intro, arguments.verbose, **more)
        shown = [text] if arguments.json or not arguments.quiet else []
        with or_printed(shown):
            write_report(result, arguments.out, **more, progress=progress)
    if shown:
        print(text, end="" if arguments.json else "\n\n")
    if result.converged:
        return 0
    print("softjax fit: did not converge; the results are written and marked so", file=sys.stderr)
    return 1


def _fitted(arguments: argparse.Namespace, options: Mapping[str, Any], progress: Progress) -> Any:
    """The fit of the file's data, or of the paper's."""
    import softjax as sj
    from calibration.fit_result import fit
    from calibration.fitting.posterior.draws import check_possible
    from calibration.paper import paper_materials

    sj.enable_x64()
    if arguments.file is None:
        problem, data, parameters = None, paper_materials(), None
        stated = {"objective": "two-step"} if options.get("law", "zhou") == "zhou" else {}
    else:
        problem = read_material_file(arguments.file)
        print_first(problem.implausible, arguments.quiet or arguments.json)
        data, parameters, stated = problem.datasets, problem.parameters, dict(problem.settings)
        stated.pop("area", None)  # the contacts have it
    settings = merged(stated, options)
    if arguments.posterior is not None:
        check_possible(settings.get("objective"))
    law = settings.pop("law", None)
    try:
        fitted_data = data[0] if len(data) == 1 else data
        return fit(fitted_data, law, parameters, progress=progress, **settings)
    except (DataError, sj.ArgumentError) as error:
        argument = getattr(error, "argument", None)
        if argument in options:
            raise
        if problem is not None and argument in stated.keys() - options.keys():
            raise error.at(arguments.file, problem.line(argument)) from error  # type: ignore[union-attr]
        raise InputError(arguments.file, None, str(error), "nothing was fitted") from error


def _draws(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) < FEWEST_DRAWS:
        problem = f"{text!r} is not a whole number of {FEWEST_DRAWS} or more"
        raise argparse.ArgumentTypeError(problem)
    return int(text)
