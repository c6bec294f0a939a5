"""Measure speed against error on this machine.

Every method computes ε_p of the same collisions: the routes of this library, SciPy in a loop, and
diffrax with events. Errors are against 40-digit arithmetic. The command writes speed.csv and speed.png.
"""

import argparse
import warnings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    text = "fewer settings: about 15 s, not a minute"
    parser.add_argument("--quick", action="store_true", help=text)


def run(arguments: argparse.Namespace) -> int:
    import pandas as pd

    import softjax as sj
    from calibration.console import Progress
    from calibration.output import check_writable, files_into, or_printed, write_text
    from calibration.plots import style
    from calibration.speed import as_text, draw, measure, methods, stainless_steel

    sj.enable_x64()
    check_writable(arguments.out)
    scene = stainless_steel()
    builders = list(methods(scene, arguments.quick))
    with warnings.catch_warnings(), Progress(arguments.quiet) as progress:
        warnings.simplefilter("ignore")  # from the baselines
        rows = [measure(build(), scene) for build in progress.over(builders, "measuring")]
    text = [] if arguments.quiet else [as_text(rows)]
    with or_printed(text), files_into(arguments.out) as folder:
        write_text(folder / "speed.csv", pd.DataFrame(rows).to_csv(index=False))
        style.draw(lambda: draw(rows), folder / "speed.png")
    if text:
        print(f"{text[0]}\n")
    return 0
