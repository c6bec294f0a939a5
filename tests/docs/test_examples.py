"""Worked examples with numbers in docstrings: every room that is hard to enter has one."""

import doctest
import importlib
import pkgutil

import pytest

import calibration as cal
import softjax as sj

NAMES = [
    module.name
    for package in (sj, cal)
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not module.name.endswith("__main__")
]
HARD = (
    *("compiling", "mapping", "bridge", "derivatives", "outcome", "motion"),
    *("uncertainty", "curvature", "small_samples", "degrees_of_freedom"),
    *("fitting.errors", "true_velocities", "variances", "variance_updates", "pools"),
    *("fitting.problem", "stages", "components", "search"),
    *("profiles", "refits", "left_out", "density", "coordinates"),
)


@pytest.mark.parametrize("name", NAMES)
def test_examples_of_docstrings_give_the_numbers_that_they_show(name):
    found = doctest.testmod(importlib.import_module(name))
    assert found.failed == 0
    if name.endswith(tuple(f".{room}" for room in HARD)):
        assert found.attempted > 1
