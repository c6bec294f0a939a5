"""Write a law for a particle code: the cheapest that meets a tolerance of ε over a range of velocities.

    softjax export --fit results/fit.json --material nylon --to lammps --range 0.1:5
    softjax export stainless-steel --to c --range 0.1:5 --tolerance 0.001
    softjax export my_alloy.toml --set chi=0.2 sigma=0.4 psi=0.5 --to yade --range 0.5:2
    softjax export nylon --to liggghts --range 1:2 --export-law hertz-dashpot --overlap 0.02

Written are input lines or source code, and export.json and export.png: ε of the law and of what the code
gets, their largest difference, the error in dissipated energy, the largest overlap, contact durations,
and the time step that the tolerance needs. Where no law of the code meets the tolerance, the best one
and its error are named, and nothing is written.
"""

import argparse

from calibration.commands.source_options import add_source_arguments
from calibration.particle_codes.codes import BACKENDS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser)
    add = parser.add_argument_group("requirements").add_argument
    add("--range", metavar="V:V", help="impact velocities [m/s] (default: those of the data)")
    add("--tolerance", type=float, default=0.01, metavar="X", help="largest error of ε (0.01)")
    add(
        "--overlap",
        type=float,
        metavar="X",
        help="softer springs, up to this largest overlap over the radius",
    )
    add("--steps", type=int, metavar="N", help="time steps in the shortest contact")
    text = "g [m/s²], whose weight is within the error (default: the file's, else 9.80665); 0: none"
    add("--gravity", type=float, metavar="G", help=text)
    text = "below the range: the law as it is (none), or the ε of the lowest velocity (hold)"
    add("--below", choices=("none", "hold"), default="none", help=text)
    text = "radii of atom types 1, 2, … [m]: the tolerance holds for all their pairs"
    add("--sizes", nargs="+", type=float, metavar="R", help=text)
    add = parser.add_argument_group("particle code").add_argument
    add(
        "--to", choices=tuple(BACKENDS), required=True, help="the code; c is a header for any other"
    )
    text = "auto (default), linear, hertz-dashpot, viscoelastic, walton-braun, or exact"
    add("--export-law", default="auto", metavar="NAME", help=text)
    text = "the contact force alone, without acoustic and thermal losses: rebounds of ε_p"
    add("--contact-force", dest="losses", action="store_false", help=text)
    add("--prefix", default="softjax", help="of names in C, of the law in LAMMPS, and of files")
    text = "of atoms in LAMMPS or LIGGGHTS (default: all)"
    add("--types", nargs=2, type=int, metavar=("I", "J"), help=text)


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj
    from calibration.commands.source import read_source
    from calibration.particle_codes.entry import export
    from calibration.studies.inputs import both_ends

    sj.enable_x64()
    source = read_source(arguments)
    names = ("tolerance", "steps", "overlap", "losses", "prefix", "below", "gravity")
    options = {name: getattr(arguments, name) for name in names}
    options["velocity_range"] = arguments.range and both_ends("--range", arguments.range)
    if source.result is None:
        known = source.properties or {}
        radii = [known[name] for name in ("radius", "radius_1", "radius_2") if name in known]
        options["velocity_range"] = options["velocity_range"] or source.span
        if arguments.gravity is None:
            options["gravity"] = source.gravity
        options |= {"radius": min(radii, default=None), "on_wall": source.bodies == "wall"}
    made = export(
        source.law if source.result is None else source.result,
        arguments.to,
        arguments.out,
        material=source.name,
        law=arguments.export_law,
        types=arguments.types and tuple(arguments.types),
        sizes=arguments.sizes and tuple(arguments.sizes),
        **options,
    )
    if not arguments.quiet:
        print(f"{source.remark}\n{made}")
    return 0
