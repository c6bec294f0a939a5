"""Restitution over impact velocity, as numbers, a look-up table or a picture.

For a material of the paper (stainless-steel, chrome-steel, nylon: σ and ψ of Table 1, χ̃ as
`softjax fit` finds it, unless given), a material file, or a fit with its confidence band:

    softjax curve nylon --from 0.1 --to 50 --points 500 --spacing log --format csv png
    softjax curve my_alloy.toml --chi 0.2 --sigma 0.4 --psi 0.5 --table
    softjax curve --fit results/fit.json --material nylon
    softjax curve third.toml --line results/fit.json
    softjax curve --fit results/fit.json --posterior results/posterior.nc
    cut -d, -f1 shots.csv | softjax curve nylon --velocities -
    softjax curve nylon --law hertz-dashpot --set restitution=0.9

At most a million rows; of more, from Python: np.save("curve.npy", softjax.restitution(law, velocity).coefficient)

A table (--table) has more columns: ε_p, duration, largest overlap and peak force; two rows at first
yield, where ε may jump, and where ε ends; and in its header the largest error of linear interpolation. Where the data of a
fit do not determine the curve, cells are empty and rows of a table are left out.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from calibration.commands.source_options import add_route_arguments, add_source_arguments
from calibration.errors import DataError, InputError
from calibration.output import files_into, write_text

FORMATS = ("csv", "npy", "png", "table")
FILES = {"csv": "curve.csv", "npy": "curve.npy", "png": "curve.png", "table": "curve.txt"}
OF_LINE = "line.png"
POINTS = 400
DRAWN = 4096  # rows of a picture


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser)
    add_route_arguments(parser)
    group = parser.add_argument_group("velocities")
    group.add_argument("--from", dest="first", type=float, metavar="V", help="lowest [m/s]")
    group.add_argument("--to", dest="last", type=float, metavar="V", help="highest [m/s]")
    group.add_argument("--points", type=int, metavar="N", help=f"how many (default: {POINTS})")
    group.add_argument("--spacing", choices=("lin", "log"), help="default: log from above 0")
    group.add_argument(
        "--velocities", metavar="FILE.csv", help="take them from a file, or from - (standard input)"
    )
    parser.add_argument(
        "--posterior", metavar="FILE.nc", type=Path, help="draws of --fit: the band is theirs"
    )
    group = parser.add_argument_group("output")
    group.add_argument(
        "--format", nargs="+", choices=FORMATS, help="one or more of them (default: csv png)"
    )
    group.add_argument("--table", action="store_true", help="the same as --format table")


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj
    from calibration.commands.source import read_source, route_of
    from calibration.curves import curve_of

    sj.enable_x64()
    source, route = read_source(arguments), route_of(arguments)
    velocity = _velocities(arguments, source)
    if route is not None and (source.result, source.prediction) != (None, None):
        raise DataError("--route", arguments.route, "left out with --fit and --line")
    formats = set(arguments.format or ([] if arguments.table else ["csv", "png"]))
    formats |= {"table"} if arguments.table else set()
    if "table" in formats and arguments.velocities is None:
        from calibration.lookup_table import with_knots

        velocity = with_knots(source, velocity, route)
    rows = curve_of(source, velocity, route)
    if not rows.known.any():
        problem = f"the data do not determine {source.name} at these velocities"
        raise InputError(None, None, problem, f"they determine {_known(source)}")
    with files_into(arguments.out, [*FILES.values(), OF_LINE]) as folder:
        _write(folder, formats, source, rows, route)
    _tell(arguments, source, rows)
    return 0


def _velocities(arguments: argparse.Namespace, source: Any) -> Any:
    from calibration.curves import grid, read_velocities

    range_options = [arguments.first, arguments.last, arguments.points, arguments.spacing]
    if arguments.velocities is None:
        default = [*source.span, POINTS, None]
        return grid(
            *(
                d if value is None else value
                for value, d in zip(range_options, default, strict=True)
            )
        )
    if range_options != [None] * 4:
        accepted = "left out with --from, --to, --points or --spacing"
        raise DataError("--velocities", arguments.velocities, accepted)
    return read_velocities(arguments.velocities)


def _write(folder: Path, formats: set[str], source: Any, rows: Any, route: Any) -> None:
    import numpy as np

    from calibration.fitting.curves import yield_velocity
    from calibration.lookup_table import table_text

    if "csv" in formats:
        write_text(folder / FILES["csv"], rows.as_csv())
    if "npy" in formats:
        np.save(folder / FILES["npy"], rows.as_array())
    if "table" in formats:
        write_text(folder / FILES["table"], table_text(source, rows, route))
    if "png" in formats:
        from calibration import plots
        from calibration.plots.curves import restitution_figure

        kind = type(source.law).__name__
        label = source.name if kind == "Zhou" else f"{source.name}: {kind}"
        fit = source.result and source.result.material(source.name)
        banded = source.result or (source.prediction and source.prediction.line)
        some = rows.some(slice(None, None, -(-len(rows.velocity) // DRAWN)))
        some = some.some(np.argsort(some.velocity, kind="stable"))
        confidence = banded and banded.confidence
        data = fit and fit.data
        figure = restitution_figure(some, label, yield_velocity(source.law), data, confidence)
        plots.save(figure, folder / FILES["png"])
        if source.prediction is not None:
            line, contact = source.prediction.line, source.law.contact
            figure = plots.unloading_line_figure(line, contact, source.name)
            plots.save(figure, folder / OF_LINE)


def _known(source: Any) -> str:
    """The velocities at which the data, or the line through a fit's materials, determine the curve."""
    if source.result is None:
        critical = float(source.law.contact.critical_velocity)
        return f"the curve from first yield on, {critical:.4g} m/s"
    fit = source.result.material(source.name)
    if fit.known_from > 0:
        return f"the curve from {fit.known_from:.4g} m/s on"
    return f"the curve up to {fit.known_to:.4g} m/s"


def _tell(arguments: argparse.Namespace, source: Any, rows: Any) -> None:
    count, missing = len(rows.velocity), int((~rows.known).sum())
    if missing:
        text = f"of {count} velocities {missing} are left empty"
        print(
            f"warning: not-determined: {text}; the data determine {_known(source)}", file=sys.stderr
        )
    beyond = source.extrapolation(rows.velocity)
    if beyond is not None:
        print(f"warning: {beyond}", file=sys.stderr)
    if not arguments.quiet:
        low, high = rows.velocity.min(), rows.velocity.max()
        print(source.remark)
        print(f"{count} velocities, {low:.4g} to {high:.4g} m/s: {arguments.out}")
