"""What is shipped says the same of itself everywhere, and its types are known to mypy."""

import re
import tomllib
from importlib import resources
from pathlib import Path

import pytest

import calibration as cal

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_types_are_told_and_the_stubs_name_all_that_is_public():
    for package in ("softjax", "calibration"):
        assert resources.files(package).joinpath("py.typed").is_file()
    stub = resources.files("calibration").joinpath("__init__.pyi").read_text(encoding="utf-8")
    assert stub.count("\nfrom ") == len(cal.__all__) > 5
    for name in cal.__all__:
        assert f" import {name} as {name}\n" in stub
        assert getattr(cal, name) is vars(cal)[name]
    with pytest.raises(AttributeError, match="module 'calibration' has no attribute 'ft'"):
        cal.ft  # noqa: B018
    assert {*cal.__all__, "__doc__"} <= {*dir(cal)}


def test_version_authors_dependencies_and_python_are_told_alike():
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\S+?),? ", changes, re.M)[1] == PROJECT["version"]
    assert re.search(rf"^version: {re.escape(PROJECT['version'])}$", CITATION, re.M)
    authors = CITATION.partition("authors:\n")[2].partition("references:")[0]
    assert authors.strip() == "- name: The softjax authors"
    for name in PROJECT["dependencies"]:
        assert re.fullmatch(r"[a-z0-9]+>=[\d.]+", name), name
    versions = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if ":: 3." in c]
    assert versions[0] == PROJECT["requires-python"].removeprefix(">=")
