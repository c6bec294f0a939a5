"""Restitution over impact velocity, as numbers, a look-up table or a picture.

For a material of the paper (stainless-steel, chrome-steel, nylon: σ and ψ of Table 1, χ̃ as
`softjax fit` finds it, unless given), a material file, or a fit with its confidence band:

    softjax curve nylon --from 0.1 --to 50 --points 500 --spacing log --format csv png
    softjax curve my_alloy.toml --set chi=0.2 sigma=0.4 psi=0.5 --table
    softjax curve --fit results/fit.json --material nylon
    softjax curve third.toml --line results/fit.json
    softjax curve --fit results/fit.json --posterior results/posterior.nc
    cut -d, -f1 shots.csv | softjax curve nylon --velocities -
    softjax curve nylon --law hertz-dashpot --set restitution=0.9
    softjax curve nylon --law viscoelastic --restitution 0.8 --at 1

At most a million rows; of more, from Python: softjax.restitution(law, velocity).coefficient

A table (--table) has more columns: ε_p, duration, largest overlap and peak force; two rows at first
yield, where ε may jump; and in its header the largest error of linear interpolation. Where the data of a
fit do not determine the curve, cells are empty and rows of a table are left out.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from calibration import console
from calibration.commands.source_options import add_route_arguments, add_source_arguments
from calibration.errors import DataError, InputError
from calibration.output import files_into, write_text

FILES = {"csv": "curve.csv", "png": "curve.png", "table": "curve.txt"}
OF_LINE = "line.png"
POINTS = 400
DRAWN = 4096  # rows of a picture


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser, posterior=True)
    add_route_arguments(parser)
    add = parser.add_argument_group("one measured restitution").add_argument
    text = "viscoelastic spheres that rebound with it at --at"
    add("--restitution", type=float, metavar="X", help=text)
    add("--at", type=float, metavar="V", help="impact velocity of --restitution [m/s]")
    add = parser.add_argument_group("velocities").add_argument
    add("--from", dest="first", type=float, metavar="V", help="lowest [m/s]")
    add("--to", dest="last", type=float, metavar="V", help="highest [m/s]")
    add("--points", type=int, metavar="N", help=f"how many (default: {POINTS})")
    add("--spacing", choices=("lin", "log"), help="default: log from above 0")
    text = "take them from a file, or from - (standard input)"
    add("--velocities", metavar="FILE.csv", help=text)
    add = parser.add_argument_group("output").add_argument
    text = "one or more of them (default: csv png)"
    add("--format", nargs="+", choices=FILES, default=[], help=text)
    add("--table", action="store_true", help="the same as --format table")


def run(arguments: argparse.Namespace) -> int:
    import numpy as np

    import softjax as sj
    from calibration.commands.source import read_source, route_of
    from calibration.curves import curve_of, with_knots

    sj.enable_x64()
    source, route = read_source(arguments), route_of(arguments)
    velocity = _velocities(arguments, source)
    if route is not None and (source.result or source.line) is not None:
        raise DataError("--route", arguments.route, "left out with --fit and --line")
    formats = {*arguments.format, *["table"] * arguments.table} or {"csv", "png"}
    if "table" in formats and arguments.velocities is None:
        velocity = with_knots(source, velocity)
    rows = curve_of(source, velocity, route)
    missing = int(sum(rows.coefficient != rows.coefficient))
    if missing == len(velocity):
        problem = f"the data do not determine {source.name} at these velocities"
        raise InputError(None, None, problem, f"they determine {_determined(source)}")
    with files_into(arguments.out, [*FILES.values(), OF_LINE]) as folder:
        _write(folder, formats, source, rows, route)
    if missing:
        text = f"of {len(velocity)} velocities {missing} are left empty"
        text = f"{text}; the data determine {_determined(source)}"
        print(f"warning: not-determined: {text}", file=sys.stderr)
    if rows.low is not None and (free := int(sum(np.isnan(rows.low)) - missing)):
        text = f"the interval of ε is left empty at {free} of {len(velocity)} velocities"
        text = f"{text}: there it depends on parameters that the data do not determine"
        print(f"warning: rank-deficient: {text}", file=sys.stderr)
    for warning in source.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if (beyond := source.extrapolation(velocity)) is not None:
        print(f"warning: {beyond}", file=sys.stderr)
    if not arguments.quiet:
        ends = f"{velocity.min():.4g} to {velocity.max():.4g} m/s"
        lines = console.wrapped(
            [
                *source.remark.splitlines(),
                f"{len(velocity)} {'velocities' if len(velocity) > 1 else 'velocity'}, {ends}",
            ]
        )
        print("\n".join(lines))
    return 0


def _velocities(arguments: argparse.Namespace, source: Any) -> Any:
    from calibration.curves import grid, read_velocities

    stated = [arguments.first, arguments.last, arguments.points, arguments.spacing]
    if arguments.velocities is None:
        pairs = zip(stated, [*source.span, POINTS, None], strict=True)
        return grid(*(default if value is None else value for value, default in pairs))
    if stated != [None] * 4:
        accepted = "left out with --from, --to, --points or --spacing"
        raise DataError("--velocities", arguments.velocities, accepted)
    return read_velocities(arguments.velocities)


def _write(folder: Path, formats: set[str], source: Any, rows: Any, route: Any) -> None:
    import numpy as np

    from calibration.curves import table_text
    from calibration.fitting.curves import yield_velocity

    if "csv" in formats:
        write_text(folder / FILES["csv"], rows.as_csv())
    if "table" in formats:
        write_text(folder / FILES["table"], table_text(source, rows, route))
    if "png" in formats:
        from calibration import plots

        kind = type(source.law).__name__
        label = source.name if kind == "Zhou" else f"{source.name}: {kind}"
        data = source.result and source.result.material(source.name).data
        banded = source.result or source.line
        some = rows.select(slice(None, None, -(-len(rows.velocity) // DRAWN)))
        some = some.select(np.argsort(some.velocity, kind="stable"))
        confidence, yields_at = banded and banded.confidence, yield_velocity(source.law)
        of = "of the mean" if source.line is None else "of a further material"
        shown = (some, label, yields_at, data, confidence, of)
        plots.draw(lambda: plots.restitution_figure(*shown), folder / FILES["png"])
        if source.line is not None:
            line = (source.line, source.law.contact, source.name)
            plots.draw(lambda: plots.unloading_line_figure(*line), folder / OF_LINE)


def _determined(source: Any) -> str:
    """The velocities at which the data, or the line through a fit's materials, determine the curve."""
    if source.result is None:
        critical = float(source.law.contact.critical_velocity)
        return f"the curve from first yield on, {critical:.4g} m/s"
    fit = source.result.material(source.name)
    if fit.known_from > 0:
        return f"the curve from {fit.known_from:.4g} m/s on"
    return f"the curve up to {fit.known_to:.4g} m/s"
