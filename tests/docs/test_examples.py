"""Worked examples with numbers in docstrings: every room of the physics that is hard to enter has one."""

import doctest
import importlib
import pkgutil

import pytest

import softjax as sj

NAMES = [module.name for module in pkgutil.walk_packages(sj.__path__, "softjax.")]
HARD = ("compiling", "mapping", "bridge", "derivatives", "outcome", "motion")


@pytest.mark.parametrize("name", NAMES)
def test_examples_of_docstrings_give_the_numbers_that_they_show(name):
    found = doctest.testmod(importlib.import_module(name))
    assert found.failed == 0
    if name.rpartition(".")[2] in HARD:
        assert found.attempted > 1
