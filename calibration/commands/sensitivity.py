"""What moves the restitution, what data can tell, and where to measure next.

    softjax sensitivity nylon                        # θ ∂ε/∂θ over velocity: table, CSV, pictures
    softjax sensitivity nylon --study information    # what 30 shots would tell of χ̃, σ, ψ
    softjax sensitivity nylon --study design --shots 10 --criterion c
    softjax sensitivity nylon --study global --range chi=0.1:0.4 --range density=1100:1200
    softjax sensitivity --fit results/fit.json --material nylon --study design

With --fit, information and design count what was measured already.
"""

import argparse

from calibration.curve.options import add_route_arguments, add_source_arguments

STUDIES = ("local", "information", "design", "global")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser)
    add_route_arguments(parser)
    group = parser.add_argument_group("study")
    group.add_argument("--study", choices=(*STUDIES, "all"), default="local", help="default: local")
    group.add_argument(
        "--from", dest="first", type=float, metavar="V", help="lowest velocity [m/s]"
    )
    group.add_argument("--to", dest="last", type=float, metavar="V", help="highest velocity [m/s]")
    group.add_argument("--points", type=int, default=200, metavar="N", help="of a curve (200)")
    group.add_argument("--at", type=float, nargs="+", metavar="V", help="velocities of bars [m/s]")
    group = parser.add_argument_group("information and design")
    group.add_argument("--objective", choices=("two-step", "model"), default="two-step")
    group.add_argument("--uncertainty", type=float, default=0.01, metavar="U", help="of ε (0.01)")
    group.add_argument("--shots", type=int, default=30, metavar="N", help="planned ones (30)")
    group.add_argument("--criterion", choices=("c", "D"), default="c", help="of the design")
    group.add_argument("--target", default="chi", help="of criterion c (chi)")
    group = parser.add_argument_group("global")
    group.add_argument(
        "--range",
        action="append",
        default=[],
        metavar="NAME=LOW:HIGH",
        help="of an input; may be repeated (default: 10 %% about every input)",
    )
    group.add_argument("--samples", type=int, default=4096, metavar="N", help="a power of two")
    group.add_argument("--scale", choices=("uniform", "log"), default="uniform")
    group.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0")


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj

    sj.enable_x64()
    from calibration.curve.source import read_source, route_of
    from calibration.errors import DataError, InputError
    from calibration.sensitivities.studies import check, run_studies

    try:
        source, route = read_source(arguments), route_of(arguments)
        studies = STUDIES if arguments.study == "all" else (arguments.study,)
        check(arguments, source, studies)
        text = run_studies(arguments, source, route, studies)
    except (InputError, DataError):
        raise
    except ValueError as error:  # a study's own refusal, in one line
        accepted = "softjax sensitivity --help lists the options"
        raise InputError(None, None, str(error), accepted) from None
    if not arguments.quiet:
        print(text)
    return 0
