"""Options that say which collision, and by which route. Nothing heavy is imported for `--help`."""

import argparse
from contextlib import suppress
from pathlib import Path
from typing import Any

from calibration.errors import DataError, InputError
from calibration.options import LAW_OPTIONS, LAWS, add_options

COEFFICIENTS = ("chi", "sigma", "psi")
VARIANTS = tuple(name for name, laws in LAW_OPTIONS.items() if "zhou" in laws)

TABLES = (".csv", ".tsv", ".txt", ".dat", ".xlsx", ".xls", ".ods")


def add_source_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that `read_source` reads."""
    group = parser.add_argument_group("which collision")
    group.add_argument(
        "source",
        nargs="?",
        metavar="MATERIAL",
        help="stainless-steel (default), chrome-steel, nylon, or a material file FILE.toml",
    )
    group.add_argument("--fit", metavar="FIT.json", type=Path, help="a result of softjax fit")
    text = "of FILE.toml's material by Eq. (18) through the materials of a fit"
    group.add_argument("--line", metavar="FIT.json", type=Path, help=text)
    text = "restitution at first yield, with --line (default: mean of the fitted materials)"
    group.add_argument("--eps-up", type=float, metavar="X", help=text)
    group.add_argument("--material", metavar="NAME", help="which one of a file's or a fit's")
    for name in COEFFICIENTS:
        group.add_argument(f"--{name}", type=float, metavar="X", help=f"{name} of Zhou's law")
    group.add_argument("--area", choices=("zhou", "hertz"), help="contact area (default: zhou)")
    add_options(group, VARIANTS)
    default = "default: that of the file, else zhou"
    group.add_argument("--law", choices=LAWS, help=default)
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a field of the law, such as restitution=0.9; may be repeated",
    )


def add_route_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("route")
    routes = ("energy-balance", "closed-form", "ode")
    group.add_argument("--route", choices=routes, help="default: ode where the law has no other")
    group.add_argument("--rtol", type=float, metavar="X", help="tolerance of the ode (1e-8)")


def add_air_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--air`: the air of drops and bounces; overrides the file."""
    text = 'of drops and bounces: "false", or its density ("1.2 kg/m³", the default)'
    parser.add_argument("--air", metavar="DENSITY", type=_air, help=text)


def _air(text: str) -> bool | float | str:
    from calibration.data.air import checked_air

    value: bool | float | str = {"false": False, "true": True}.get(text.lower(), text)
    with suppress(ValueError):
        value = float(text)
    try:
        checked_air(value)
    except DataError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not {error.accepted}") from None
    return value


def read_material_file(path: str, needs_data: bool = True, air: Any = None) -> Any:
    """A material file; a table of measurements in its place is named as such.

    Args:
        air: overrides the file.

    Raises:
        InputError: with file and line, what is wrong and what is accepted.
    """
    from calibration.data.materials import read_problem

    if Path(path).suffix.lower() in TABLES:
        problem = "is a table of measurements, no material file"
        accepted = f"give the TOML file that names it, with data = {Path(path).name!r}"
        raise InputError(path, None, problem, accepted)
    return read_problem(path, needs_data, air=air)
