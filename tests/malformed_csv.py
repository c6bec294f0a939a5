"""Malformed CSV files, each with what is to be told of it.

A case holds what differs from the good pair of files, `TOML` and `CSV`.
"""

from typing import NamedTuple

TOML = """\
[[material]]
name = "my alloy"
youngs_modulus = 1.93e11
poisson_ratio = 0.35
density = 8030
yield_strength = 3.10e8
radius = 0.0127
data = "m.csv"
"""
CSV = """\
velocity [m/s],restitution,uncertainty
0.12,0.95,0.004
0.5,0.9,0.004
2.0,0.8,0.004
"""


class Case(NamedTuple):
    """A malformed pair of files: the line to be told starts so and holds these words."""

    start: str  # file:line: problem
    says: str  # somewhere behind: what is accepted
    toml: str | bytes = TOML
    csv: str | bytes | None = CSV


def _csv(row: str, line: int = 3, header: str | None = None) -> str:
    """The good CSV file with one line replaced."""
    lines = CSV.splitlines()
    lines[line - 1] = row
    return "\n".join([header or lines[0], *lines[1:]]) + "\n"


POSITIVE_SPEED = "it must be a positive speed in m/s"
FINITE = "it must be a finite number"

CSV_CASES = {
    "empty file": Case("m.csv:1: nothing in the file", "header", csv=""),
    "comments alone": Case("m.csv:1: nothing in the file", "header", csv="# a\n\n# b\n"),
    "no rows": Case("m.csv:2: no rows of data", "one row a point", csv="# a\nvelocity,restitution"),
    "no header": Case("m.csv:1: no header, only numbers", "names the columns", csv="1.0,0.9\n"),
    "not UTF-8": Case(
        "m.csv:3: is not UTF-8 text", "UTF-8", csv=b"velocity,restitution\n1.0,0.9\n# \xb5s\n"
    ),
    "unknown column": Case(
        "m.csv:2: column is 'velocty [m/s]'",
        "did you mean 'velocity'?",
        csv="# rebounds\n" + _csv("0.5,0.9,0.1", header="velocty [m/s],restitution,uncertainty"),
    ),
    "unknown unit": Case(
        "m.csv:1: unit of velocity is [km/h]",
        "it must be in m/s, cm/s, mm/s",
        csv=_csv("0.5,0.9,0.1", header="velocity [km/h],restitution,uncertainty"),
    ),
    "unit that is not closed": Case(
        "m.csv:1: column is 'velocity [m/s'",
        "one of velocity",
        csv=_csv("0.5,0.9,0.1", header="velocity [m/s,restitution,uncertainty"),
    ),
    "column twice": Case(
        "m.csv:1: column velocity is there twice",
        "needed once",
        csv=_csv("0.5,0.9,0.1", header="velocity,restitution,velocity [cm/s]"),
    ),
    "columns that do not go together": Case(
        "m.csv:1: set of columns is drop_height, restitution",
        "drop_height with rebound_height",
        csv="drop_height,restitution\n1.0,0.9\n",
    ),
    "too few cells": Case(
        "m.csv:3: 2 cells", "3 are needed, one for each column", csv=_csv("0.5,0.9")
    ),
    "too many cells": Case("m.csv:4: 4 cells", "3 are needed", csv=_csv("2,0.8,0.1,0.1", line=4)),
    "open quotation mark": Case(
        "m.csv:3: a quotation mark is not closed", "close it", csv=_csv('"0.5,0.9,0.1')
    ),
    "a word for a number": Case("m.csv:3: velocity is 'fast'", FINITE, csv=_csv("fast,0.9,0.1")),
    "NaN": Case("m.csv:4: restitution is 'nan'", FINITE, csv=_csv("2.0,nan,0.1", line=4)),
    "infinite": Case("m.csv:3: velocity is 'inf'", FINITE, csv=_csv("inf,0.9,0.1")),
    "too large for a float": Case("m.csv:3: velocity is '1e999'", FINITE, csv=_csv("1e999,0.9,1")),
    "digits with underscores": Case("m.csv:3: velocity is '1_0'", FINITE, csv=_csv("1_0,0.9,0.1")),
    "empty cell": Case("m.csv:3: restitution is empty", FINITE, csv=_csv("0.5,,0.1")),
    "decimal comma": Case(
        "m.csv:2: velocity is '0,5'", "with a decimal point", csv="velocity;restitution\n0,5;0,9\n"
    ),
    "negative restitution": Case(
        "m.csv:3: restitution is -0.1", "it must be a number of 0 or more", csv=_csv("0.5,-0.1,0.1")
    ),
    "restitution far above one": Case(
        "m.csv:4: restitution is 1.013",
        "above it by no more than 3 of its uncertainties",
        csv=_csv("2.0,1.013,0.004", line=4),
    ),
    "restitution above one without uncertainties": Case(
        "m.csv:2: restitution is 1.06",
        "above it by no more than 0.05",
        csv="velocity,restitution\n0.5,1.06\n",
    ),
    "zero velocity": Case("m.csv:3: velocity is 0", POSITIVE_SPEED, csv=_csv("0,0.9,0.1")),
    "negative velocity": Case("m.csv:3: velocity is -0.5", POSITIVE_SPEED, csv=_csv("-0.5,0.9,1")),
    "velocity at the limit": Case(
        "m.csv:3: velocity is 341",
        "it must be below the limit velocity, 340.317 m/s",
        csv=_csv("341,0.9,0.1"),
    ),
    "zero uncertainty": Case(
        "m.csv:3: uncertainty is 0", "it must be a positive number", csv=_csv("0.5,0.9,0")
    ),
    "zero drop height": Case(
        "m.csv:3: drop_height is 0",
        "a positive height",
        csv="drop_height [cm],rebound_height [cm]\n10,8\n0,0\n",
    ),
    "a ratio of heights for a restitution": Case(
        "m.csv:3: restitution is 0.64, the ratio of the heights",
        "√(rebound_height/drop_height), 0.8,",
        csv="drop_height,rebound_height,restitution\n1.0,0.81,0.9\n1.0,0.64,0.64\n",
    ),
    "negative interval": Case(
        "m.csv:4: interval is -0.5",
        "a positive time",
        csv="interval [ms],launch\n600,1\n540,1\n-500,1\n",
    ),
    "one interval a launch": Case(
        "m.csv:1: launch is of one interval everywhere",
        "two or more",
        csv="interval,launch\n0.6,1\n0.5,2\n",
    ),
    "interval longer than the one before": Case(
        "m.csv:4: restitution is 1.2",
        "at most 1",
        csv="interval,launch\n0.6,1\n0.5,1\n0.5,2\n0.6,2\n",
    ),
    "launch without a label": Case(
        "m.csv:3: launch is empty", "a label", csv="interval,launch\n0.6,1\n0.5,\n"
    ),
}
