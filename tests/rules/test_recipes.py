"""The recipes of `extending.md`: the places that they name exist, and they name every list of `test_lists`."""

import re
from pathlib import Path

import pytest

from tests.rules.test_lists import LISTS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "notebooks" / "reference" / "extending.md").read_text(encoding="utf-8")
RECIPES = {
    part.partition("\n")[0]: part
    for part in re.split(r"^### ", PAGE.partition("## Rules")[0], flags=re.M)[1:]
}
RULES = PAGE.partition("## Rules")[2]
KINDS = (
    "law, route, status, output of a collision, noise family, observable, kind of input, column, unit, "
    "warning, option, study, picture, section of the report, particle code"
)
OF = {  # the recipes of the kinds of `LISTS`
    **{"name of a law": "A law", "field of a law or route": "A law", "name of a route": "A route"},
    **{"kind of measurement": "A kind of input", "command": "A study"},
}
PLACE = re.compile(r"`((?:softjax|calibration|tests|notebooks)(?:/[\w.]+)+)(?::(\w+))?`")


def missing(text: str) -> list[str]:
    """Places that a text names and that are not there."""
    found = []
    for file, name in PLACE.findall(text):
        path = ROOT / file
        if path.stem == "NEW":
            path = path.parent
        if not path.exists():
            found.append(file)
        elif name and not re.search(rf"\b{name}\b", path.read_text(encoding="utf-8")):
            found.append(f"{file}:{name}")
    return found


def test_every_kind_of_extension_has_a_recipe():
    kinds = {re.sub(r"^An? ", "", title) for title in RECIPES}
    assert set(KINDS.split(", ")) <= kinds


@pytest.mark.parametrize("title", [*RECIPES, "rules"])
def test_the_places_of_a_recipe_exist(title):
    text = RECIPES.get(title, RULES)
    assert PLACE.search(text)
    assert missing(text) == []
    assert missing("`tests/none.py`, `softjax/status.py:Nothing`, `softjax/status.py:Status`") == [
        "tests/none.py",
        "softjax/status.py:Nothing",
    ]


@pytest.mark.parametrize("title", RECIPES)
def test_the_commands_of_a_recipe_run_what_exists(title):
    for line in re.findall(r"^(?:pytest|python) .*$", RECIPES[title], re.M):
        words = [word.split("::")[0] for word in line.split() if word.startswith("tests")]
        places = [ROOT / word.replace("tests.golden", "tests/golden") for word in words]
        assert places
        assert all(place.exists() for place in places), line


@pytest.mark.parametrize("kind", LISTS)
def test_a_recipe_names_every_list_that_its_kind_must_be_in(kind):
    title = OF.get(kind, f"{'An' if kind[0] in 'aeiou' else 'A'} {kind}")
    files = [re.match(r"[\w/]+\.\w+", place) for place in LISTS[kind][1]]
    named = {file for file, _ in PLACE.findall(RECIPES[title])} | {"README.md"}
    assert [file[0] for file in files if file and file[0] not in named] == []
