"""What comes in kinds has a row in every list that all of its kind must be in.

`LISTS` names the lists; `notebooks/reference/extending.md` says what a row of each is. A list that grows of
itself, such as a table that is made of the code, is none here.
"""

import re
from dataclasses import fields
from pathlib import Path

import pytest

import calibration as cal
import softjax as sj
from calibration.cli import COMMANDS
from calibration.data.columns import OBSERVED, QUANTITIES
from calibration.data.kinds import KINDS, Kind
from calibration.fitting.noise import FAMILIES
from calibration.fitting.warnings import ADVICE
from calibration.observables import OBSERVABLES
from calibration.options import LAWS, ROUTES, FitOptions
from calibration.schema import choices
from tests.laws import LAWS as EXAMPLES
from tests.refusals import test_softjax as arguments

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "notebooks" / "reference"


def every(base):
    """Classes of the package below a base."""
    found = [cls for below in base.__subclasses__() for cls in (below, *every(below))]
    return {cls for cls in found if cls.__module__.startswith("softjax.")}


def text(*places, but=()):
    files = [f for place in places for f in sorted(ROOT.glob(place)) if f.name not in but]
    assert files, places
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


def in_quotes(*places, but=()):
    return set(re.findall(r'"([^"\n]+)"', text(*places, but=but)))


def rows_of(page):
    """The names in the first column of all tables of a page."""
    return set(re.findall(r"^\| `([^`]+)`", (REFERENCE / page).read_text("utf-8"), re.M))


def names(things):
    return {type(thing).__name__ for thing in things}


LAW_CLASSES = {
    law for law in every(sj.ContactLaw) if not every(law)
}  # those with laws below them are bases
ROUTE_CLASSES = {c for c in every(sj.AbstractRoute) if not c.__name__.startswith("_")}
FIELDS = {
    f"{cls.__name__} {field.name}": field.name
    for cls in LAW_CLASSES | ROUTE_CLASSES
    for field in fields(cls)
}
CLASS = {name: type(made).__name__ for name, made in arguments.MADE.items()}
TESTS = text("tests/**/*.py", but=("test_lists.py",))
# cases are "name" or "name, what of it"
QUOTED_IN_TESTS = {words.partition(",")[0] for words in re.findall(r'["`]([^"`\n]+)["`]', TESTS)}
SETTINGS = re.findall(r'^    "([a-z_ ]+)": Case\(', text("tests/commands/test_fit.py"), re.M)

MEASUREMENTS = text("notebooks/reference/measurements.md")

# kind: what there is of it, and {list: what has a row there}
LISTS = {
    "law": (
        {cls.__name__ for cls in LAW_CLASSES},
        {
            "final=True, where the class is defined": {c.__name__ for c in LAW_CLASSES if c._final},
            "softjax/__init__.py, __all__": set(sj.__all__),
            "calibration/fitting/laws.py, KNOWN": {law.__name__ for law in cal.LAWS.values()},
            "tests/laws.py, LAWS": names(case.law for case in EXAMPLES.values()),
            "tests/refusals/test_softjax.py, MADE": names(arguments.MADE.values()),
        },
    ),
    "name of a law": (
        set(cal.LAWS),
        {
            "calibration/options.py, LAWS": set(LAWS),
            "notebooks/reference/laws.md": set(re.findall(r"\| `([a-z0-9-]+)` \|", text("notebooks/reference/laws.md"))),
            "tests/golden/errors.py, built_in_laws": in_quotes("tests/golden/errors.py"),
        },
    ),
    "field of a law or route": (
        set(FIELDS),
        {
            "tests/refusals/arguments.txt": {
                f"{CLASS.get(name, name)} {argument}"
                for name, argument in (place.rsplit(" ", 1) for place, *_ in arguments.ROWS)
            }
        },
    ),
    "route": (
        {cls.__name__ for cls in ROUTE_CLASSES},
        {
            "softjax/__init__.py, __all__": set(sj.__all__),
            "softjax/routes.py, ROUTES": {cls.__name__ for cls in sj.routes.ROUTES},
            "softjax/restitution.py, the docstring of restitution": set(
                re.findall(r"`(\w+)\(", sj.restitution.__doc__)
            ),
            "notebooks/reference/laws.md": set(
                re.findall(r"^\| `sj\.(\w+)\(", text("notebooks/reference/laws.md"), re.M)
            ),
            "tests": set(re.findall(r"sj\.(\w+)\(", TESTS)),
        },
    ),
    "name of a route": (
        set(ROUTES),
        {
            "tests/commands/test_fit.py": {
                name for name in ROUTES
                if {name, name.replace(" ", "-")} & in_quotes("tests/commands/test_fit.py")
            },
        },
    ),
    "status": (
        set(sj.Status.__members__),
        {
            "softjax/status.py, the table of Status": set(re.findall(r"^ *\| `(\w+)`", sj.Status.__doc__, re.M)),
            "notebooks/reference/symptoms.md": rows_of("symptoms.md") | {"PLAIN"},
            "a test that has it": set(re.findall(r"Status\.(\w+)", TESTS)) | QUOTED_IN_TESTS,
        },
    ),
    "noise family": (
        set(FAMILIES),
        {
            "calibration/options.py, FitOptions.noise": set(choices(FitOptions, "noise")),
            "tests/statistics/test_one_likelihood.py": in_quotes("tests/statistics/test_one_likelihood.py") | {"normal"},
            "tests/coverage/test_coverage.py": in_quotes("tests/coverage/test_coverage.py") | {"normal"},
            "tests/commands/test_fit.py, CASES": set(re.findall(r'"noise": "([^"]+)"', text("tests/commands/test_fit.py"))) | {"normal"},
            "tests/shown/test_fit.py, WEIGHTS": set(re.findall(r'"([^"]+)": ', re.search(r"WEIGHTS = {.*", text("tests/shown/test_fit.py"))[0])),
        },
    ),
    "observable": (
        set(OBSERVABLES) - {"restitution"},
        {
            # of a dent the `dent` of the data set says which
            "calibration/data/columns.py, OBSERVED_COLUMNS": set(OBSERVED) | {"residual_dent_diameter"},
            "tests/data/test_observed.py": in_quotes("tests/data/test_observed.py"),
            "tests/fit/test_observables.py": in_quotes("tests/fit/test_observables.py"),
        },
    ),
    "kind of measurement": (
        {kind.name for kind in KINDS.values() if kind.needs},
        {
            "calibration/data/columns.py": {
                kind.name for kind in KINDS.values() if {*kind.needs} <= {q.name for q in QUANTITIES}
            },
            "notebooks/reference/measurements.md": {
                kind.name
                for kind in KINDS.values()
                if kind.named in MEASUREMENTS or f"## {kind.name.capitalize()}" in MEASUREMENTS
            },
            # whose planned shots are readings; those of a film are planned as v and ε
            "calibration/data/kinds.py, `readings` of its class": {
                kind.name for kind in KINDS.values() if type(kind).readings is not Kind.readings
            }
            | {"", "tracks"},
            "calibration/data/kinds.py, `gravity` of a flight": {
                kind.name
                for kind in KINDS.values()
                if not kind.is_flight or type(kind).gravity is not Kind.gravity
            }
            | {"tracks"},
        },
    ),
    "column": (
        {column.name for column in QUANTITIES},
        {"tests/data": {q.name for q in QUANTITIES if {q.name, *q.spellings.split()} & set(re.findall(r"\w+", text("tests/data/*.py")))}},
    ),
    "warning": (
        set(ADVICE),
        {
            "notebooks/reference/symptoms.md": rows_of("symptoms.md"),
            "a function that raises it": in_quotes("calibration/**/*.py", but=("warnings.py",))
            | {"extrapolation"},
            "a test that has it": QUOTED_IN_TESTS,
        },
    ),
    "option": (
        set(FitOptions.model_fields),
        {
            "tests/commands/test_fit.py, CASES": {*" ".join(SETTINGS).split()}
            | in_quotes("tests/commands/test_fit.py"),
            "notebooks/reference/commands.md": {
                name.removeprefix("--").removeprefix("no-").replace("-", "_")
                for name in rows_of("commands.md")
            },
        },
    ),
    "picture": (
        set(re.findall(r'^    "(\w+\.png)": ', text("calibration/report/fit.py"), re.M)),
        {
            "notebooks/reference/commands.md": set(re.findall(r"`(\w+\.png)`", text("notebooks/reference/commands.md"))),
            "a test that has it": QUOTED_IN_TESTS,
        },
    ),
    "study": (
        set(re.findall(r'"(\w+)": _', text("calibration/commands/sensitivity.py"))),
        {
            "notebooks/reference/commands.md": set(re.findall(r"`(\w+)`", text("notebooks/reference/commands.md"))),
            "tests/commands/test_sensitivity.py": set(re.findall(r"\w+", text("tests/commands/test_sensitivity.py"))),
            "tests/commands/test_files_stay.py, COMMANDS": in_quotes("tests/commands/test_files_stay.py"),
        },
    ),
    "command": (
        set(COMMANDS),
        {
            "README.md": set(re.findall(r"`softjax (\w+)", text("README.md"))),
            "notebooks/reference/commands.md": set(
                re.findall(r"^## `softjax (\w+)", text("notebooks/reference/commands.md"), re.M)
            ),
        },
    ),
}  # fmt: skip


def without_row(things, lists):
    return {place: gone for place, rows in lists.items() if (gone := sorted(things - rows))}


@pytest.mark.parametrize("kind", LISTS)
def test_each_of_a_kind_has_a_row_in_every_list_and_a_new_one_is_missed_in_all(kind):
    things, lists = LISTS[kind]
    assert len(things) > 1
    assert without_row(things, lists) == {}, (
        f"{kind}: {without_row(things, lists)}; see extending.md"
    )
    assert without_row({*things, "no such name"}, lists) == {
        place: ["no such name"] for place in lists
    }
