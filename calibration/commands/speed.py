"""Measure speed against error on this machine.

Every method computes ε_p of the same collisions: the routes of this library, SciPy in a loop, and
diffrax with events. Errors are against 40-digit arithmetic. The command writes speed.csv and speed.png.
With `--law` it measures a law with damping, in closed form and by the ODE, or a user's law in SI units.
"""

import argparse
import warnings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--quick", action="store_true", help="fewer settings: about 15 s, not a minute"
    )
    laws = ("viscoelastic", "hertz-dashpot", "linear", "own")
    parser.add_argument(
        "--law",
        choices=laws,
        help="a law with damping, or a user's law in SI units (default: zhou)",
    )


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj
    from calibration.console import Progress
    from calibration.output import check_writable, files_into, or_printed, write_text
    from calibration.plots.style import save
    from calibration.speed import as_csv, as_text, draw, measure, methods, scene_of

    sj.enable_x64()
    check_writable(arguments.out)
    name = arguments.law or "zhou"
    scene, builders = scene_of(name), list(methods(name, arguments.quick))
    with warnings.catch_warnings(), Progress(arguments.quiet) as progress:
        warnings.simplefilter("ignore")  # from the baselines
        rows = [measure(build(), scene) for build in progress.over(builders, "measuring")]
    text = [] if arguments.quiet else [as_text(rows)]
    with or_printed(text), files_into(arguments.out) as folder:
        write_text(folder / "speed.csv", as_csv(rows))
        figure = draw(rows, scene.title).get_figure(root=True)
        assert figure is not None
        save(figure, folder / "speed.png")
    if text:
        print(text[0])
        print(f"\nWritten: {arguments.out / 'speed.csv'} and {arguments.out / 'speed.png'}")
    return 0
