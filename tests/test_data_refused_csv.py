"""Malformed CSV files (see `refused`)."""

import pytest

from calibration.data import read_toml
from tests.refused import CSV, Case, check_refused


def _csv(row: str, line: int = 3, header: str | None = None) -> str:
    """The good CSV file with one line replaced."""
    lines = CSV.splitlines()
    lines[line - 1] = row
    return "\n".join([header or lines[0], *lines[1:]]) + "\n"


POSITIVE_SPEED = "it must be a positive speed in m/s"
FINITE = "it must be a finite number"

CASES = {
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
        "m.csv:1: unit of velocity is [kn]",
        "it must be in m/s, cm/s, mm/s, km/h",
        csv=_csv("0.5,0.9,0.1", header="velocity [kn],restitution,uncertainty"),
    ),
    "unit that is not closed": Case(
        "m.csv:1: column is 'velocity [m/s'",
        "a name and one unit, as in",
        csv=_csv("0.5,0.9,0.1", header="velocity [m/s,restitution,uncertainty"),
    ),
    "column twice": Case(
        "m.csv:1: column is velocity twice, 'velocity' and 'velocity [cm/s]'",
        "it must be there once",
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
    "empty cell of an uncertainty": Case(
        "m.csv:3: uncertainty is empty", "a positive number", csv=_csv("0.5,0.9,")
    ),
    "empty cells alone": Case(
        "m.csv:1: set of rows is empty", "one with velocity, restitution", csv="v,e\n1,\n,0.9\n"
    ),
    "gap in a train": Case(
        "m.csv:3: interval is empty", "leaves no gap", csv="interval,u_t\n0.6,1\n,1\n0.5,1\n"
    ),
    "launch without a label": Case(
        "m.csv:3: launch is empty", "a label", csv="interval,launch\n0.6,1\n0.5,\n"
    ),
    "decimal comma between commas": Case(
        "m.csv:2: velocity is '0,5'",
        "with a decimal point (a comma only where ; or tabs",
        csv='velocity,restitution\n"0,5",0.9\n',
    ),
    "both decimal marks": Case(
        "m.csv:3: restitution is '0.9'",
        "decimals with a comma or with a point in the whole file",
        csv="velocity;restitution\n0,5;0,9\n0,6;0.9\n",
    ),
    "thousands by commas": Case(
        "m.csv:2: drop_height is '1,234.5'",
        "thousands not separated",
        csv='drop_height [mm],rebound_height [mm]\n"1,234.5",800\n',
    ),
    "thousands by points": Case(
        "m.csv:2: drop_height is '1.234,5'",
        "thousands not separated",
        csv="drop_height [mm];rebound_height [mm]\n1.234,5;800\n",
    ),
    "thousands by spaces": Case(
        "m.csv:2: drop_height is '1 234'",
        "thousands not separated",
        csv="drop_height [mm];rebound_height [mm]\n1 234;800\n",
    ),
    "percent in the cell": Case(
        "m.csv:2: restitution is '85 %'", "which stands in the header", csv="v,e\n1.0,85 %\n"
    ),
    "percent without its unit": Case(
        "m.csv:2: restitution is 85", "is it in percent? then the unit is [%]", csv="v,e\n1.0,85\n"
    ),
    "names that only a person can tell": Case(
        "m.csv:1: set of columns is 't', 'h', of which none is known",
        "is 't' interval or time?; is 'h' drop_height or rebound_height?",
        csv="t,h\n1,1\n",
    ),
    "a spreadsheet": Case(
        "m.csv: is a spreadsheet or an archive", "Save as, CSV UTF-8", csv=b"PK\x03\x04\x14\x00"
    ),
    "an old spreadsheet": Case(
        "m.csv: is a spreadsheet", "Save as, CSV UTF-8", csv=b"\xd0\xcf\x11\xe0\xa1\xb1"
    ),
    "UTF-16 without its mark": Case(
        "m.csv:1: a NUL character", "UTF-8", csv="v,e\n1,0.9\n".encode("utf-16-le")
    ),
    "UTF-16 with half a character": Case(
        "m.csv:1: is not UTF-16 text", "UTF-8", csv=b"\xff\xfev\x00,"
    ),
    "two units": Case(
        "m.csv:1: unit of velocity is [m/s] in its name and [cm/s] below",
        "told once",
        csv="velocity [m/s],e\ncm/s,-\n1,0.9\n",
    ),
    "unknown unit in a row of units": Case(
        "m.csv:1: unit of velocity is [furlong]", "in m/s", csv="velocity,e\nfurlong,\n1,0.9\n"
    ),
    "a line that is too long": Case(
        "m.csv:3: 70001 characters in a line", "65536", csv=_csv("x" * 70001)
    ),
    "too many columns": Case("m.csv:1: 2000 columns", "1000 are", csv="a," * 1999 + "a\n1\n"),
    "times that go back": Case(
        "m.csv:4: time is 0.1", "a launch column tells", csv="time\n0.2\n0.9\n0.1\n0.7\n"
    ),
    "negative restitution": Case(
        "m.csv:3: restitution is -0.1", "it must be a number of 0 or more", csv=_csv("0.5,-0.1,0.1")
    ),
    "restitution far above one": Case(
        "m.csv:4: restitution is 1.017",
        "above it by no more than noise brings it, 0.016 here",
        csv=_csv("2.0,1.017,0.004", line=4),
    ),
    "restitution above one without uncertainties": Case(
        "m.csv:2: restitution is 1.16",
        "by no more than noise brings it, 0.15 here",
        csv="velocity,restitution\n0.5,1.16\n",
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
        "m.csv:1: launch is of 1 row(s) everywhere",
        "of 2 rows or more",
        csv="interval,launch\n0.6,1\n0.5,2\n",
    ),
    "interval longer than the one before": Case(
        "m.csv:4: restitution is 1.2",
        "at most 1",
        csv="interval,launch\n0.6,1\n0.5,1\n0.5,2\n0.6,2\n",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_malformed_csv_files_are_told_in_one_line(name, tmp_path):
    check_refused(CASES[name], tmp_path, read_toml)
