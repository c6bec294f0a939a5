"""Options that say which collision, and by which route. Nothing heavy is imported for `--help`."""

import argparse
from pathlib import Path
from typing import Any

from calibration.errors import InputError
from calibration.options import ROUTES, add_law_option

TABLES = (".csv", ".tsv", ".txt", ".dat", ".xlsx", ".xls", ".ods")


def add_source_arguments(parser: argparse.ArgumentParser, posterior: bool = False) -> None:
    """The options that `read_source` reads."""
    add = parser.add_argument_group("which collision").add_argument
    text = "stainless-steel (default), chrome-steel, nylon, or a material file FILE.toml"
    add("source", nargs="?", metavar="MATERIAL", help=text)
    add("--fit", metavar="FIT.json", type=Path, help="a result of softjax fit")
    if posterior:
        add("--posterior", metavar="FILE.nc", type=Path, help="draws of --fit: the band is theirs")
    text = "the law of FILE.toml's material by Eq. (18) through the materials of a fit"
    add("--line", metavar="FIT.json", type=Path, help=text)
    text = "restitution at first yield, in place of sigma"
    add("--eps-up", type=float, metavar="X", help=text)
    add("--material", metavar="NAME", help="which one of a file's or a fit's")
    add("--area", choices=("zhou", "hertz"), help="area of the yielding contact (default: zhou)")
    add_law_option(add, "that of the file, else zhou")
    text = "parameters of the law and its variants: chi=0.2 sigma=0.4 psi=0.5 form=full"
    add("--set", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help=text)


def add_route_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("route").add_argument
    names = [name.replace(" ", "-") for name in ROUTES]
    add("--route", choices=names, help="default: ode where the law has no other")
    add("--rtol", type=float, metavar="X", help="tolerance of the ode (1e-8)")


def read_material_file(path: str, needs_data: bool = True) -> Any:
    """A material file; a table of measurements in its place is named as such."""
    from calibration.data.materials import read_problem

    if Path(path).suffix.lower() in TABLES:
        problem = "is a table of measurements, no material file"
        accepted = f"give the TOML file that names it, with data = {Path(path).name!r}"
        raise InputError(path, None, problem, accepted)
    return read_problem(path, needs_data)
