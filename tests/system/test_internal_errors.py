"""Errors of softjax itself are no fault of the input: a trace, and an exit code of their own."""

import matplotlib.figure
import numpy as np
import pytest
import scipy.linalg

from tests.command import run, write_alloy

INTERNAL = "softjax: an error of softjax itself, please report it with the lines above\n"
CURVE = ["curve", "nylon", "--law", "constant", "--set", "restitution=0.8", "--points", 20]


@pytest.fixture
def alloy(tmp_path):
    return write_alloy(tmp_path, 'law = "constant"\nprofiles = false')


def raising(error):
    def raises(*_, **__):
        raise error

    return raises


@pytest.mark.parametrize("kind", [np.linalg.LinAlgError, ValueError])
def test_what_fails_inside_a_fit_is_not_told_as_the_users_input(kind, alloy, tmp_path, monkeypatch):
    """Any ValueError within, LinAlgError is one, was one line, exit code 2 and "nothing was fitted"."""
    failing = raising(kind("did not converge"))
    for name in ("inv", "pinv", "solve", "svd", "qr", "eigh", "cholesky", "lstsq"):
        monkeypatch.setattr(np.linalg, name, failing)
    for name in ("solve_triangular", "cho_factor", "cho_solve", "cholesky"):
        monkeypatch.setattr(scipy.linalg, name, failing)
    code, _, error = run("--no-cache", "fit", alloy, "--out", tmp_path / "results")
    assert code == 70
    assert error.startswith("Traceback (most recent call last):\n")
    assert error.endswith(f"{kind.__name__}: did not converge\n{INTERNAL}")
    assert not (tmp_path / "results").exists()


def test_a_file_of_a_library_that_is_missing_is_no_want_of_space(tmp_path, monkeypatch):
    missing = FileNotFoundError(2, "No such file or directory", "/usr/share/fonts/none.ttf")
    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", raising(missing))
    code, _, error = run("--no-cache", *CURVE, "--out", tmp_path / "results")
    assert code == 70
    assert "/usr/share/fonts/none.ttf" in error
    assert error.endswith(INTERNAL)
    assert not (tmp_path / "results").exists()
