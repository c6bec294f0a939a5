"""What is refused: a name, where the blame lies, words that the one line has, and what was given.

`cases.json` has a section for each way in, `OBJECTS` what JSON cannot hold. The words, separated by |,
are what was given and what is accepted; the sentences around them are free, but for those that
`sentences.txt` keeps: a case joins by a line with its way and name, `CSV files | no rows |`, which
`pytest --record tests/refusals` completes.

A file is given by its text, or by lines of the good one that are replaced: `{"3": "fast,0.9,0.1"}`; of
a fit.json the place of an entry and what is put there, nothing takes it out.
"""

import copy
import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import calibration as cal
import softjax as sj

# two ε of three flights: the second is in both
LAUNCH = cal.PointErrors(
    np.array([[0, 1, -1], [1, 2, -1]]),
    np.array([[-4.0, 4.0, 0.0], [-4.0, 4.0, 0.0]]),
    np.array([[5.0, 0.0, 0.0], [5.0, 0.0, 0.0]]),
    np.full(3, 1e-3),
    "intervals",
)
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
WALL = "[material.wall]\n" + "\n".join(TOML.splitlines()[2:6]) + "\n"
GOOD = {"velocity": [1.0, 2.0], "restitution": [0.9, 0.8]}
# what JSON cannot hold, or is too long for it
OBJECTS = {
    "CSV files": {
        "UTF-16 with half a character": ("m.csv:1", "UTF-16|UTF-8", b"\xff\xfev\x00,"),
        "a spreadsheet": ("m.csv", "spreadsheet|CSV", b"PK\x03\x04\x14\x00"),
        "an old spreadsheet": ("m.csv", "spreadsheet|CSV", b"\xd0\xcf\x11\xe0\xa1\xb1"),
        "a cell without end": ("m.csv:3", "velocity|xxx", {"3": "x" * 70001 + ",1,1"}),
        "too large a file": ("m.csv", "64 MiB|smaller", "#" * 70_000_000),
        "brackets in brackets": ("m.csv:1", "restit", "velocity (" + "(" * 5000 + ",restitution\n1,1"),
    },
    "TOML files": {
        "a TOML that is not UTF-8": ("m.toml:2", "UTF-8", '[[material]]\nname = "Ø"'.encode("latin-1")),
        "a number of 5000 digits": ("m.toml:8", "TOML", {"5": "density = " + "9" * 5000}),
        "a data file beyond names": ("m.toml:8", "aaa|CSV", {"8": f'data = "{"a" * 5000}"'}),
        "a key without end": ("m.toml:3", "kkkkkkkk|known", {"3": "k" * 20000 + " = 1"}),
        "a TOML of 3 MB": ("m.toml", "2 MiB|smaller", "#" * 3_000_000),
    },
    "arguments": {
        "errors of three": ("errors", "3|as many points as `velocity`, 2", {"errors": cal.PointErrors.independent(3)}),
        "uncertainty beside other errors": ("uncertainty", "errors", {"uncertainty": 0.1, "errors": cal.PointErrors.independent(2, np.array([0.2, 0.2]))}),
        "a launch in two groups": ("group", "'a' and 'b'|share an error", {"group": ["a", "b"], "errors": LAUNCH}),
        "a material for a contact": ("contact", "softjax.Contact", {"contact": sj.NYLON}),
    },
    "results": {
        "rms: 10**400": ("fit.json", "fits[0].rms|finite number", "fits.0.rms", 10**400),
        "material: long": ("fit.json", "fits[0].material|xxx", "fits.0.material", "x" * 10_000),
    },
    "no results": {
        "nested lists": ("fit.json:1", "recursion", "[" * 100_000),
        "a bracket in line 2": ("fit.json:2", "JSON", '{\n"fits": [}'),
        "a NaN": ("fit.json", "fits|nan|list", '{"format": 1, "fits": NaN}'),
        "5000 digits": ("fit.json:1", "out of range", '{"fits": 1' + "0" * 5000 + "}"),
        "half a character": ("fit.json:1", "hex escape", '{"fits": "\\ud800"}'),
        "a result that is not UTF-8": ("fit.json:1", "UTF-8", b'{"fits": "\xfc"}'),
        "26 MB": ("fit.json", "24 MiB", b" " * 26_000_000),
        "many lists": ("fit.json", "fits[0]|[]", '{"format": 1, "fits": [' + "[]," * 20_000 + "[]]}"),
    },
}  # fmt: skip


def made(given, good: str) -> bytes:
    """A file by its text, or the good one with lines replaced."""
    if isinstance(given, dict):
        lines = good.splitlines()
        for number, text in given.items():
            lines[int(number) - 1 : int(number)] = [text]
        given = "\n".join(lines) + "\n"
    return given if isinstance(given, bytes) else given.encode()


def written(folder: Path, toml, csv=CSV) -> Path:
    """Put a pair of files into a folder; the path of the TOML file."""
    for name, given, good in (("m.toml", toml, TOML), ("m.csv", csv, CSV)):
        (folder / name).write_bytes(made(given, good))
    return folder / "m.toml"


@cache
def genuine() -> dict:
    """A result with bodies and groups, as a table: all kinds of entries, little to compute."""
    noise = 0.01 * np.random.default_rng(2).standard_normal(8)
    rows = zip(np.geomspace(0.5, 5.0, 8), 0.8 + noise, "aaabbbcc", strict=True)
    csv = "v,e,group\n" + "".join(f"{v},{e},{g}\n" for v, e, g in rows)
    with tempfile.TemporaryDirectory() as folder:
        data = cal.read_toml(written(Path(folder), TOML + WALL, csv))
    return json.loads(cal.fit(data, "constant").to_json())


def changed(table: dict, way, value) -> dict:
    """A copy with one entry set, or taken out where the value is `...`."""
    table = copy.deepcopy(table)
    *above, last = way
    inner: Any = table
    for part in above:
        inner = inner[part]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return table


def crafted(folder: Path, place: str, value=...):
    way = [int(part) if part.isdigit() else part for part in place.split(".")]
    return loaded(folder, json.dumps(changed(genuine(), way, value)))


def loaded(folder: Path, content):
    raw = content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
    (folder / "fit.json").write_bytes(raw)
    return cal.FitResult.load(folder / "fit.json")


def fitted(path):
    problem = cal.read_problem(path)
    return cal.fit(problem.datasets, parameters=problem.parameters)


# how a case of each section is given to the library
WAYS = {
    "CSV files": lambda folder, csv: cal.read_toml(written(folder, TOML, csv)),
    "TOML files": lambda folder, *files: cal.read_toml(written(folder, *files)),
    "problems": lambda folder, toml: cal.read_problem(written(folder, toml)),
    "fits": lambda folder, toml: fitted(written(folder, toml)),
    "tables": lambda _, table, more: cal.RestitutionData.from_table(table, **more),
    "arguments": lambda _, changes: cal.RestitutionData(**(GOOD | changes)),
    "results": crafted,
    "no results": loaded,
}
STATED = json.loads(Path(__file__).with_name("cases.json").read_text(encoding="utf-8"))
CASES = {
    (way, name): case
    for way in WAYS
    for name, case in {**STATED.get(way, {}), **OBJECTS.get(way, {})}.items()
}


def refusal(way: str, name: str, folder: Path) -> Exception | None:
    """What the library says to a case, None where it accepts it."""
    _, _, *given = CASES[way, name]
    try:
        WAYS[way](folder, *given)
    except (cal.InputError, cal.DataError) as error:
        return error
    return None


FILE = Path(__file__).with_name("sentences.txt")
