"""Restitution over impact velocity, as numbers, a look-up table or a picture.

For a material of the paper (stainless-steel, chrome-steel, nylon: σ and ψ of Table 1, χ̃ as
`softjax fit` finds it, unless given), a material file, or a fit with its confidence band:

    softjax curve nylon --from 0.1 --to 50 --points 500 --spacing log --format csv png
    softjax curve my_alloy.toml --chi 0.2 --sigma 0.4 --psi 0.5 --table
    softjax curve --fit results/fit.json --material nylon
    cut -d, -f1 shots.csv | softjax curve nylon --velocities -
    softjax curve nylon --law hertz-dashpot --set restitution=0.9
"""

import argparse
import sys
from contextlib import ExitStack, closing

from calibration.curve.options import add_route_arguments, add_source_arguments

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
    group = parser.add_argument_group("output")
    group.add_argument(
        "--format", nargs="+", choices=FORMATS, help="one or more of them (default: csv png)"
    )
    group.add_argument("--table", action="store_true", help="the same as --format table")


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj

    sj.enable_x64()
    from calibration.curve.source import read_source, route_of
    from calibration.errors import DataError, InputError

    try:
        source, route = read_source(arguments), route_of(arguments)
        velocities = _velocities(arguments, source)
        if source.result is not None and route is not None:
            raise DataError("--route", arguments.route, "left out with --fit")
        seen = _write(arguments, source, velocities, route)
    except (InputError, DataError):
        raise
    except ValueError as error:  # a law's own refusal, in one line
        raise InputError(None, None, str(error), "softjax curve --help lists the options") from None
    _tell(arguments, source, seen)
    return 0


def _velocities(arguments, source):
    from calibration.curve.velocities import Column, Grid
    from calibration.errors import DataError

    grid = {n: getattr(arguments, n) for n in ("first", "last", "points", "spacing")}
    if arguments.velocities is not None:
        given = [name for name, value in grid.items() if value is not None]
        if given:
            accepted = "left out with --from, --to, --points or --spacing"
            raise DataError("--velocities", arguments.velocities, accepted)
        return Column(arguments.velocities)
    first = source.span[0] if grid["first"] is None else grid["first"]
    last = source.span[1] if grid["last"] is None else grid["last"]
    points = POINTS if grid["points"] is None else grid["points"]
    return Grid(first, last, points, grid["spacing"] or ("log" if first > 0 else "lin"))


def _write(arguments, source, velocities, route):
    """All files at once, none of them where anything goes wrong."""
    from calibration.atomic import files_into
    from calibration.curve.stream import Span, curve_rows
    from calibration.progress import Progress

    formats = set(arguments.format or ([] if arguments.table else ["csv", "png"]))
    formats |= {"table"} if arguments.table else set()
    seen = Span()
    with files_into(arguments.out) as folder, Progress(arguments.quiet) as progress:
        with ExitStack() as stack:
            writers = [stack.enter_context(closing(w)) for w in _writers(formats, folder, source)]
            picture = _thinned() if "png" in formats else None
            for rows in curve_rows(source, velocities.blocks(), route, seen):
                for writer in writers:
                    writer.write(rows)
                if picture is not None:
                    picture.add(rows)
                progress("rows", seen.rows, velocities.total)
        if picture is not None:
            _draw(folder / FILES["png"], picture.rows(), source)
    return seen


def _writers(formats, folder, source):
    from calibration.curve.writers import CsvWriter, NpyWriter, TableWriter

    make = {
        "csv": CsvWriter,
        "npy": NpyWriter,
        "table": lambda path: TableWriter(path, source.name),
    }
    return [make[name](folder / FILES[name]) for name in FORMATS if name in formats & set(make)]


def _thinned():
    from calibration.curve.picture import Thinned

    return Thinned()


def _draw(path, rows, source) -> None:
    from calibration.curve.picture import plot_restitution
    from calibration.plots import style

    critical = None if source.law is None else float(source.law.contact.critical_velocity)
    data = None if source.result is None else source.result.material(source.name).data
    figure = style.new_figure(6.0, 4.0)
    plot_restitution(rows, source.name, figure.add_subplot(), critical, data)
    style.save(figure, path)


def _tell(arguments, source, seen) -> None:
    if source.result is not None:
        doubt = source.result.extrapolation(seen.ends, source.name)
        if doubt is not None:
            velocity = source.result.material(source.name).data.velocity
            curve, data = (f"{min(v):.4g} to {max(v):.4g} m/s" for v in (seen.ends, velocity))
            text = f"the curve goes from {curve}, the data of {source.name} from {data}"
            print(f"warning: {doubt.code}: {text}", file=sys.stderr)
    if not arguments.quiet:
        print(source.remark)
        print(f"{seen.rows} velocities, {seen.low:.4g} to {seen.high:.4g} m/s: {arguments.out}")
