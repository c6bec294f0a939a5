"""Measure speed against error on this machine.

Every way computes ε_p of the same collisions: the two routes of this library, and what one would
write instead (SciPy in a loop, diffrax with two events, velocity Verlet). Errors are against
40-digit arithmetic. Written are speed.csv and speed.png. `--law` does the same for a law with
damping, by its closed form and by the ODE, or for one's own, given by forces in SI.
"""

import argparse
import warnings
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--quick", action="store_true", help="fewer settings: about 20 s, not 2 min"
    )
    others = ("viscoelastic", "hertz-dashpot", "linear", "own")
    parser.add_argument(
        "--law", choices=others, help="a law with damping, or one's own in SI (default: zhou)"
    )
    parser.add_argument(
        "--processes",
        action="store_true",
        help="instead: two processes against one, on a core each",
    )
    parser.add_argument(
        "--fits", action="store_true", help="instead: a thousand fits against SciPy's loop in numba"
    )


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj
    from calibration.atomic import check_writable, files_into, or_told, write_text

    if arguments.processes:
        from calibration.speed.by_processes import report

        print(report())
        return 0
    sj.enable_x64()
    if arguments.fits:
        from calibration.speed.fits import report as of_fits

        print(of_fits())
        return 0
    check_writable(arguments.out)
    rows = _measure_all(arguments)
    from calibration.plots.style import save
    from calibration.speed.picture import draw_speed
    from calibration.speed.table import as_csv, as_text

    told = [] if arguments.quiet else [as_text(rows)]
    with or_told(told), files_into(arguments.out) as folder:
        write_text(folder / "speed.csv", as_csv(rows))
        figure = draw_speed(rows, law=arguments.law).get_figure(root=True)
        assert figure is not None
        save(figure, folder / "speed.png")
    if told:
        print(told[0])
        print(f"\nwrote {arguments.out / 'speed.csv'} and {arguments.out / 'speed.png'}")
    return 0


def _measure_all(arguments):
    from calibration.progress import Progress
    from calibration.speed.measure import measure
    from calibration.speed.plan import plan
    from calibration.speed.scene import stainless

    scene: Any = stainless()
    ways = plan(scene, arguments.quick)
    if arguments.law == "own":
        from calibration.speed.own_law import own_plan, own_scene

        scene = own_scene()
        ways = list(own_plan(scene, arguments.quick))
    elif arguments.law is not None:
        from calibration.speed.damped import damped_plan, damped_scene

        scene = damped_scene(arguments.law)
        ways = list(damped_plan(scene, arguments.quick))
    with warnings.catch_warnings(), Progress(arguments.quiet) as progress:
        warnings.simplefilter("ignore")  # of rivals, about what they were asked to do
        return [measure(build(), scene) for build in progress.over(ways, "measuring")]
