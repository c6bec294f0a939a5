"""Without the packages of the extra: one line that says what to install, and nothing else missed."""

import subprocess
import sys

import pytest

import calibration as cal
import softjax as sj
from tests.command import run

TOLD = (
    "a posterior needs {}, which is not installed; "
    'install it with pip install -e ".[bayes]" in its folder'
)


@pytest.fixture
def without(monkeypatch):
    """blackjax as where it was never installed."""
    monkeypatch.setitem(sys.modules, "blackjax", None)


def test_the_result_says_what_to_install(without):
    data = cal.RestitutionData([1.0, 2.0, 3.0], [0.9, 0.88, 0.89])
    result = cal.fit(data, sj.ConstantRestitution, profiles=False)
    with pytest.raises(ImportError) as caught:
        result.posterior()
    assert str(caught.value) == TOLD.format("blackjax")


def test_the_command_says_so_before_it_fits(without, tmp_path):
    code, out, err = run(
        "fit", "--objective", "model", "--posterior", "--out", tmp_path / "results"
    )
    assert (code, out, err) == (2, "", TOLD.format("blackjax") + "\n")
    assert not (tmp_path / "results").exists()


def test_nothing_else_imports_them():
    code = (
        "import sys, pkgutil, importlib, calibration, softjax\n"
        "for package in (calibration, softjax):\n"
        "    for one in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        "        if not one.name.endswith('__main__') and '.speed.' not in one.name:\n"
        "            importlib.import_module(one.name)\n"
        "print(sorted({'blackjax', 'arviz', 'xarray'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
