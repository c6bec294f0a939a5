"""Restitution over impact velocity, as numbers, a look-up table or a picture.

For a material of the paper (stainless-steel, chrome-steel, nylon: σ and ψ of Table 1, χ̃ as
`softjax fit` finds it, unless given), a material file, or a fit with its confidence band:

    softjax curve nylon --from 0.1 --to 50 --points 500 --spacing log --format csv png
    softjax curve my_alloy.toml --chi 0.2 --sigma 0.4 --psi 0.5 --table
    softjax curve --fit results/fit.json --material nylon
    softjax curve --fit results/fit.json --posterior results/posterior.nc
    cut -d, -f1 shots.csv | softjax curve nylon --velocities -
    softjax curve nylon --law hertz-dashpot --set restitution=0.9

A table (--table) has more columns: ε_p, duration, largest overlap and peak force; two rows at first
yield, where ε may jump, and where ε ends; and in its header how far linear interpolation is from the law. Where a fit
knows nothing, cells are empty and rows of a table are left out.
"""

import argparse
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from calibration.atomic import files_into
from calibration.curve.options import add_route_arguments, add_source_arguments
from calibration.errors import DataError, InputError

FORMATS = ("csv", "npy", "png", "table")
FILES = {"csv": "curve.csv", "npy": "curve.npy", "png": "curve.png", "table": "curve.txt"}
POINTS = 400


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
    from calibration.curve.source import read_source, refusing, route_of

    sj.enable_x64()
    with refusing("curve"):
        source, route = read_source(arguments), route_of(arguments)
        velocities = _velocities(arguments, source)
        if source.result is not None and route is not None:
            raise DataError("--route", arguments.route, "left out with --fit")
        seen = _write(arguments, source, velocities, route)
    _tell(arguments, source, seen)
    return 0


def _velocities(arguments: argparse.Namespace, source: Any) -> Any:
    from calibration.curve.velocities import Column, Grid

    grid = {n: getattr(arguments, n) for n in ("first", "last", "points", "spacing")}
    if arguments.velocities is not None:
        if any(value is not None for value in grid.values()):
            accepted = "left out with --from, --to, --points or --spacing"
            raise DataError("--velocities", arguments.velocities, accepted)
        return Column(arguments.velocities)
    first = source.span[0] if grid["first"] is None else grid["first"]
    last = source.span[1] if grid["last"] is None else grid["last"]
    points = POINTS if grid["points"] is None else grid["points"]
    return Grid(first, last, points, grid["spacing"] or ("log" if first > 0 else "lin"))


def _write(arguments: argparse.Namespace, source: Any, velocities: Any, route: Any):
    """All files at once, none of them where anything goes wrong; what was seen."""
    from calibration.curve.stream import Span, Thinned, curve_rows
    from calibration.progress import Progress

    formats = _formats(arguments)
    blocks = _blocks(velocities, source, route, "table" in formats)
    seen, picture = Span(), Thinned()
    with files_into(arguments.out, FILES.values()) as folder, Progress(arguments.quiet) as progress:
        with ExitStack() as stack:
            writers = [
                stack.enter_context(closing(one))
                for one in _writers(formats, folder, source, route)
            ]
            for rows in curve_rows(source, blocks, route):
                for writer in writers:
                    writer.write(rows)
                seen.add(rows)
                picture.add(rows)
                progress("rows", seen.rows, velocities.points)
        _finish(folder, formats, source, seen, picture)
    return seen


def _formats(arguments: argparse.Namespace) -> set[str]:
    formats = set(arguments.format or ([] if arguments.table else ["csv", "png"]))
    return formats | ({"table"} if arguments.table else set())


def _finish(folder: Path, formats: set[str], source: Any, seen: Any, picture: Any) -> None:
    """The picture, of curves of which anything is known."""
    if not seen.known:
        problem = f"nothing is known of {source.name} at these velocities"
        raise InputError(None, None, problem, f"a fit knows {_known(source)}")
    if "png" in formats:
        _draw(folder / FILES["png"], picture.rows(), source)


def _blocks(velocities: Any, source: Any, route: Any, for_a_table: bool) -> Any:
    """The velocities of the options; for a table of a grid those at first yield and at ends of ε too."""
    from calibration.curve.table import with_knots
    from calibration.curve.velocities import Grid

    if not for_a_table or not isinstance(velocities, Grid):
        return velocities.blocks()
    return with_knots(source, velocities.blocks(), (velocities.first, velocities.last), route)


def _writers(formats: set[str], folder: Path, source: Any, route: Any) -> Iterator[Any]:
    from calibration.curve.table import TableWriter
    from calibration.curve.writers import CsvWriter, NpyWriter

    if "csv" in formats:
        yield CsvWriter(folder / FILES["csv"])
    if "npy" in formats:
        yield NpyWriter(folder / FILES["npy"])
    if "table" in formats:
        yield TableWriter(folder / FILES["table"], source, route)


def _draw(path: Path, rows: Any, source: Any) -> None:
    from calibration.fitting.curves import yield_velocity
    from calibration.plots import style
    from calibration.plots.restitution import plot_restitution

    kind = type(source.law).__name__
    label = source.name if kind == "Zhou" else f"{source.name}: {kind}"
    result = source.result and (source.result.material(source.name), source.result.confidence)
    figure = style.new_figure(6.0, 4.0)
    plot_restitution(rows, label, figure.add_subplot(), yield_velocity(source.law), result)
    style.save(figure, path)


def _known(source: Any) -> str:
    """Where a fit knows anything of its curve."""
    fit = source.result.material(source.name)
    if fit.known_from > 0:
        return f"the curve from {fit.known_from:.4g} m/s on"
    return f"the curve up to {fit.known_to:.4g} m/s"


def _tell(arguments: argparse.Namespace, source: Any, seen: Any) -> None:
    if seen.known < seen.rows:
        text = f"of {seen.rows} velocities {seen.rows - seen.known} are left empty"
        print(f"warning: not-known: {text}; the fit knows {_known(source)}", file=sys.stderr)
    told = source.extrapolation(seen.ends)
    if told is not None:
        print(f"warning: {told}", file=sys.stderr)
    if not arguments.quiet:
        print(source.remark)
        print(f"{seen.rows} velocities, {seen.low:.4g} to {seen.high:.4g} m/s: {arguments.out}")
