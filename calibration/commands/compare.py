"""Fit every contact law to a data set and rank the laws by how well they predict.

    softjax compare my_alloy.toml
    softjax compare my_alloy.toml --laws zhou,thornton,walton-braun
    softjax compare my_alloy.toml --laws thornton,mine.py:MyLaw     # its code runs
    softjax compare                 # the three materials of Zhou (2013)

Ranked by the expected log predictive density: each point (each group, where the data have groups)
predicted by the fit without it. The command writes compare.json and compare.png.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from calibration.commands.source_options import read_material_file
from calibration.console import Progress, print_first
from calibration.errors import DataError, did_you_mean, listed
from calibration.options import (
    LAW_OPTIONS,
    LAWS,
    OF_ONE_FIT,
    OWN_LAW,
    FitOptions,
    add_options,
    given_options,
    law_of_file,
    merged,
)
from calibration.output import check_writable, files_into, or_printed, write_text

FILES = ("compare.json", "compare.png")
NAMES = (*LAWS, "thornton-fixed")
OPTIONS = tuple(name for name in FitOptions.model_fields if name not in OF_ONE_FIT)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", nargs="?", metavar="FILE.toml", help="the materials and their data")
    text = f"the laws to compare, separated by commas: {', '.join(NAMES)} (default: all); {OWN_LAW}"
    parser.add_argument("--laws", metavar="A,B,C", help=text)
    add_options(parser, OPTIONS)
    text = "print compare.json to standard output instead of the tables"
    parser.add_argument("--json", action="store_true", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Fit, write, print; 0, or 1 where a law's fit did not converge."""
    import softjax as sj
    from calibration.comparison import compare
    from calibration.fitting.laws import law_name
    from calibration.plots.curves import comparison_figure
    from calibration.plots.style import draw
    from calibration.report.comparison import comparison_json, comparison_text

    laws = _laws(arguments)
    check_writable(arguments.out)
    sj.enable_x64()
    datasets, stated, options, remarks = _problem(arguments, laws or ())
    with Progress(arguments.quiet) as progress:
        made = [
            compare(d, laws, parameters=of_laws, watch=progress.over, **options)
            for d, of_laws in zip(datasets, stated, strict=True)
        ]
        names = laws and [law_name(law) for law in laws]
        json = comparison_json(made, {"file": arguments.file, "laws": names, "options": options})
        text = json if arguments.json else comparison_text(made, remarks, "compare.json")
        shown = [text] if arguments.json or not arguments.quiet else []
        with or_printed(shown), files_into(arguments.out, FILES) as folder:
            write_text(folder / "compare.json", json)
            draw(lambda: comparison_figure(made), folder / "compare.png")
    if shown:
        print(text, end="" if arguments.json else "\n\n")
    every = [(entry, comparison.data.name) for comparison in made for entry in comparison.entries]
    failed = [f"{entry.label} ({name})" for entry, name in every if not entry.converged]
    if failed:
        message = f"did not converge: {', '.join(failed)}; the results are written and marked so"
        print(f"softjax compare: {message}", file=sys.stderr)
    return 1 if failed else 0


def _laws(arguments: argparse.Namespace) -> list[Any] | None:
    """Names, and laws of the user's own, in the order they were given, each once."""
    names = list(dict.fromkeys(map(str.strip, (arguments.laws or "").split(","))))
    names = [] if arguments.laws is None else names
    own = {name: law_of_file(name) for name in names if ".py:" in name}
    for name in names:
        if name not in (*NAMES, *own):
            accepted = f"one of {listed(NAMES)}{did_you_mean(name, NAMES)}"
            raise DataError("--laws", repr(name), accepted)
    for name in LAW_OPTIONS if names else ():
        if getattr(arguments, name) and not {*LAW_OPTIONS[name]} & {*names}:
            accepted = f"left out without {' or '.join(LAW_OPTIONS[name])} among the laws"
            raise DataError(f"--{name}", "given", accepted)
    return [own.get(name, name) for name in names] or None


def _problem(
    arguments: argparse.Namespace, laws: Sequence[Any]
) -> tuple[list[Any], list[dict[str, Any]], dict[str, Any], list[str]]:
    """Data sets, parameters of the user's own laws, settings, and a line on entries that only `softjax fit` uses."""
    command_options = given_options(arguments)
    options = {name: value for name, value in command_options.items() if name in OPTIONS}
    if arguments.file is None:
        from calibration.paper import paper_materials

        datasets = paper_materials()
        return datasets, [{} for _ in datasets], options, []
    problem = read_material_file(arguments.file)
    print_first(problem.implausible, arguments.quiet or arguments.json)
    stated = {name: value for name, value in problem.settings.items() if name in OPTIONS}
    unused = [name for name in problem.settings if name not in (*OPTIONS, "area")]
    pairs = [*zip(problem.datasets, problem.parameters, strict=True)]
    of_own = [_of_own(laws, data, parameters) for data, parameters in pairs]
    used = {name for laws in of_own for parameters in laws.values() for name in parameters}
    unused += sorted({name for _, parameters in pairs for name in parameters} - used)
    remark = f"Only `softjax fit` uses these entries of the file: {listed(unused)}."
    return problem.datasets, of_own, merged(stated, options), [remark] if unused else []


def _of_own(laws: Sequence[Any], data: Any, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a file by the user's own laws that have them."""
    from calibration.fitting.request import model_of_class

    models = [model_of_class(law, data.contact, {}) for law in laws if callable(law)]
    return {
        model.key: {name: x for name, x in stated.items() if name in model.parameters}
        for model in models
    }
