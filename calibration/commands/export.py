"""Write a law for a particle code: the cheapest that meets a tolerance of ε over a range of velocities.

    softjax export --fit results/fit.json --material nylon --to lammps --range 0.1:5
    softjax export stainless-steel --to c --range 0.1:5 --tolerance 0.001
    softjax export my_alloy.toml --chi 0.2 --sigma 0.4 --psi 0.5 --to yade --range 0.5:2
    softjax export nylon --to liggghts --range 1:2 --export-law hertz-dashpot --overlap 0.02

Written are input lines or source code, and export.json and export.png: ε of the law and of what the code
gets, their largest difference, the error in dissipated energy, the largest overlap, contact durations,
and the time step that the tolerance needs. Where no law of the code meets the tolerance, the best one
and its error are named, and nothing is written.
"""

import argparse

from calibration.commands.source_options import add_source_arguments

CODES = ("c", "lammps", "liggghts", "yade")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser)
    group = parser.add_argument_group("requirements")
    group.add_argument(
        "--range", metavar="V:V", help="impact velocities [m/s] (default: those of the data)"
    )
    group.add_argument(
        "--tolerance", type=float, default=0.01, metavar="X", help="largest error of ε (0.01)"
    )
    group.add_argument(
        "--overlap", type=float, metavar="X", help="largest overlap over radius: softer springs"
    )
    group.add_argument("--steps", type=int, metavar="N", help="time steps in the shortest contact")
    group.add_argument(
        "--below",
        choices=("none", "hold"),
        default="none",
        help="below the range: the law as it is (none), or the ε of the lowest velocity (hold)",
    )
    group.add_argument(
        "--sizes", nargs="+", type=float, metavar="R", help="radii of atom types 1, 2, … [m]"
    )
    group = parser.add_argument_group("particle code")
    group.add_argument(
        "--to", choices=CODES, required=True, help="the code; c is a header for any other"
    )
    group.add_argument(
        "--export-law",
        default="auto",
        metavar="NAME",
        help="auto (default), linear, hertz-dashpot, viscoelastic, walton-braun, or exact",
    )
    group.add_argument(
        "--contact-force",
        dest="losses",
        action="store_false",
        help="the contact force alone, without acoustic and thermal losses: rebounds of ε_p",
    )
    group.add_argument(
        "--prefix", default="softjax", help="of names in C, and of the law in LAMMPS"
    )
    group.add_argument(
        "--types", nargs=2, type=int, metavar=("I", "J"), help="of atoms in LAMMPS (default: all)"
    )


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj

    sj.enable_x64()
    from calibration.commands.source import read_source
    from calibration.particle_codes.entry import export

    source = read_source(arguments)
    of_fit = source.result is not None
    made = export(
        source.result if of_fit else source.law,
        arguments.to,
        arguments.out,
        material=source.name,
        velocity_range=_range(arguments.range, None if of_fit else source.span),
        tolerance=arguments.tolerance,
        law=arguments.export_law,
        steps=arguments.steps,
        overlap=arguments.overlap,
        radius=None if of_fit else _radius(source.properties),
        on_wall=None if of_fit else source.bodies == "wall",
        losses=arguments.losses,
        prefix=arguments.prefix,
        types=arguments.types and tuple(arguments.types),
        below=arguments.below,
        sizes=arguments.sizes and tuple(arguments.sizes),
    )
    if not arguments.quiet:
        print(source.remark)
        print(made)
        print(f"{', '.join(made.files)}: {arguments.out}")
    return 0


def _range(text: str | None, otherwise: tuple[float, float] | None) -> tuple[float, float] | None:
    from calibration.errors import DataError

    if text is None:
        return otherwise
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise DataError("--range", text, "lowest:highest in m/s, such as 0.1:5") from None
    return low, high


def _radius(properties: dict[str, float] | None) -> float | None:
    """Radius of the smaller sphere [m], if it is known."""
    known = properties or {}
    radii = [known[name] for name in ("radius", "radius_1", "radius_2") if name in known]
    return min(radii, default=None)
