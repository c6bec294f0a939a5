"""What is shipped says the same of itself everywhere, and its types are told."""

import re
import tomllib
from importlib import resources
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.mark.parametrize("package", ["softjax", "calibration"])
def test_types_are_told(package):
    assert resources.files(package).joinpath("py.typed").is_file()


def test_the_version_is_one():
    version = re.escape(PROJECT["version"])
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\S+?),? ", changes, re.M)[1] == PROJECT["version"]
    assert re.search(rf"^version: {version}$", citation(), re.M)


def citation():
    return (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_authors_are_an_entity():
    authors = citation().partition("authors:\n")[2].partition("references:")[0]
    assert authors.strip() == "- name: The softjax authors"


def test_every_dependency_has_a_lower_bound():
    for name in PROJECT["dependencies"]:
        assert re.fullmatch(r"[a-z]+>=[\d.]+", name), name


def test_the_lowest_python_is_the_one_that_the_classifiers_begin_with():
    told = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if ":: 3." in c]
    assert told[0] == PROJECT["requires-python"].removeprefix(">=")
