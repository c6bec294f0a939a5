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
    subject = parser.add_mutually_exclusive_group()
    others = ("viscoelastic", "hertz-dashpot", "linear", "own")
    subject.add_argument(
        "--law", choices=others, help="a law with damping, or one's own in SI (default: zhou)"
    )
    subject.add_argument(
        "--fits", action="store_true", help="instead: a thousand fits against SciPy's loop in numba"
    )


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj
    from calibration.output import check_writable, files_into, or_printed, write_text

    if arguments.fits:
        report = _report(arguments)
        if not arguments.quiet:
            print(report)
        return 0
    sj.enable_x64()
    check_writable(arguments.out)
    rows = _measure_all(arguments)
    from calibration.plots.style import save
    from calibration.speed.picture import draw_speed
    from calibration.speed.table import as_csv, as_text

    told = [] if arguments.quiet else [as_text(rows)]
    with or_printed(told), files_into(arguments.out) as folder:
        write_text(folder / "speed.csv", as_csv(rows))
        figure = draw_speed(rows, law=arguments.law).get_figure(root=True)
        assert figure is not None
        save(figure, folder / "speed.png")
    if told:
        print(told[0])
        print(f"\nwrote {arguments.out / 'speed.csv'} and {arguments.out / 'speed.png'}")
    return 0


def _report(arguments: argparse.Namespace) -> str:
    """A thousand fits against SciPy's loop."""
    import softjax as sj
    from calibration.errors import DataError
    from calibration.speed import fits

    if arguments.quick:
        raise DataError("--quick", "given", "left out with --fits")

    sj.enable_x64()
    return fits.report()


def _measure_all(arguments):
    from calibration.console import Progress
    from calibration.speed.measure import measure

    scene, ways = _scene_and_ways(arguments.law, arguments.quick)
    with warnings.catch_warnings(), Progress(arguments.quiet) as progress:
        warnings.simplefilter("ignore")  # of rivals, about what they were asked to do
        return [measure(build(), scene) for build in progress.over(ways, "measuring")]


def _scene_and_ways(law: str | None, quick: bool) -> tuple[Any, list]:
    if law is None:
        from calibration.speed import plan, scene

        return scene.stainless(), list(plan.plan(scene.stainless(), quick))
    if law == "own":
        from calibration.speed import own_law

        own = own_law.own_scene()
        return own, list(own_law.own_plan(own, quick))
    from calibration.speed import damped

    with_damping = damped.damped_scene(law)
    return with_damping, list(damped.damped_plan(law, with_damping, quick))
