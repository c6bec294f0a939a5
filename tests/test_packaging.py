"""What is shipped says the same of itself everywhere, and its types are told."""

import importlib
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


@pytest.mark.parametrize("package", ["calibration", "calibration.data"])
def test_the_stubs_that_tell_where_names_are_come_along(package):
    stub = resources.files(package).joinpath("__init__.pyi").read_text(encoding="utf-8")
    module = importlib.import_module(package)
    assert stub.count("\nfrom ") == len(module.__all__) > 5
    for name in module.__all__:
        assert f" import {name} as {name}\n" in stub
        assert getattr(module, name) is vars(module)[name]
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'ft'"):
        module.ft  # noqa: B018
    assert {*module.__all__, "__doc__"} <= {*dir(module)}


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
