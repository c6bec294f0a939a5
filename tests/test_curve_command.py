"""`softjax curve` from the command line to its files."""


import numpy as np
import pytest

import softjax as sj
from calibration.cli import main
from calibration.data.paper import CURVES, paper_data
from tests.cases import fitted
from tests.made_fits import material_fit, result_of

ALLOY = """[[material]]
name = "alloy"
youngs_modulus = 2.5e9
poisson_ratio = 0.3
density = 1140
yield_strength = 4.0e7
radius = 0.0127
"""


@pytest.fixture
def at(tmp_path, monkeypatch):
    """A directory to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def curve(*options: str) -> int:
    return main(["curve", *options])


def column(path, position: int) -> np.ndarray:
    rows = path.read_text(encoding="utf-8").splitlines()[1:]
    return np.array([float(row.split(",")[position]) for row in rows])


def test_a_named_material_gives_its_curve_in_every_format(at, capsys):
    options = ["nylon", "--from", "0.5", "--to", "20", "--points", "30", "--spacing", "log"]
    assert curve(*options, "--format", "csv", "npy", "png", "table") == 0
    told = capsys.readouterr()
    assert "χ̃ = 0.21998" in told.out
    assert told.err == ""
    out = at / "results"
    velocity = column(out / "curve.csv", 0)
    np.testing.assert_allclose(velocity, np.geomspace(0.5, 20, 30), rtol=1e-14)
    expected = np.asarray(sj.restitution(fitted("nylon"), velocity).coefficient)
    np.testing.assert_allclose(column(out / "curve.csv", 1), expected, rtol=1e-14)
    np.testing.assert_array_equal(np.load(out / "curve.npy")["velocity"], velocity)
    np.testing.assert_array_equal(np.loadtxt(out / "curve.txt")[:, 0], velocity)
    assert (out / "curve.png").read_bytes()[:4] == b"\x89PNG"


def test_a_material_file_needs_the_coefficients_it_does_not_hold(at, capsys):
    (at / "alloy.toml").write_text(ALLOY, encoding="utf-8")
    assert curve("alloy.toml") == 2
    assert "--chi" in capsys.readouterr().err
    assert not (at / "results").exists()
    given = ["--chi", "0.21998", "--sigma", "0.4355", "--psi", "0.5414"]
    assert curve("alloy.toml", *given, "--points", "30", "--from", "0.5", "--table") == 0
    found = np.loadtxt(at / "results" / "curve.txt")
    expected = sj.restitution(fitted("nylon"), found[:, 0]).coefficient
    np.testing.assert_allclose(found[:, 1], np.asarray(expected), rtol=1e-14)


def test_a_fit_gives_its_band_and_says_where_its_data_end(at, capsys):
    data = paper_data(CURVES[2])
    variant = {"form": "first-order", "kappa": "consistent"}
    result = result_of([material_fit(data, 0.21998, 0.4355, 0.5414)], settings=variant)
    result.save(at / "fit.json")
    velocity = data.velocity
    inside = ["--from", str(velocity[0]), "--to", str(velocity[-1]), "--points", "20"]
    assert curve("--fit", "fit.json", *inside, "--format", "csv", "png") == 0
    assert capsys.readouterr().err == ""
    path = at / "results" / "curve.csv"
    assert path.read_text(encoding="utf-8").startswith(
        "velocity [m/s],restitution,restitution_low,restitution_high,status\n"
    )
    value, low, high = (column(path, i) for i in (1, 2, 3))
    assert np.all((low < value) & (value < high))
    law = fitted("nylon")
    expected = np.asarray(sj.restitution(law, column(path, 0)).coefficient)
    np.testing.assert_allclose(value, expected, rtol=1e-12)
    assert curve("--fit", "fit.json", "--from", "0.1", "--to", "200", "--quiet") == 0
    told = capsys.readouterr()
    assert told.out == ""
    assert "extrapolation: the curve goes from 0.1 to 200 m/s" in told.err


def test_a_file_that_is_no_fit_is_refused(at, capsys):
    (at / "fit.json").write_text("{}", encoding="utf-8")
    assert curve("--fit", "fit.json") == 2
    assert capsys.readouterr().err.startswith("fit.json: is no result of a fit; ")


def test_another_law_is_asked_for_by_name(at):
    options = ["--law", "constant", "--set", "restitution=0.75", "--points", "5", "--format", "csv"]
    assert curve("nylon", *options) == 0
    np.testing.assert_allclose(column(at / "results" / "curve.csv", 1), 0.75, rtol=1e-15)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["brass"], "nylon"),
        (["nylon", "--from", "2", "--to", "1"], "--to"),
        (["nylon", "--velocities", "none.csv"], "none.csv: no such file"),
        (["nylon", "--velocities", "-", "--points", "3"], "--velocities"),
        (["nylon", "--area", "hertz"], "--chi"),
        (["nylon", "--rtol", "1e-9"], "--rtol"),
        (["nylon", "--chi", "-1"], "chi"),
        (["nylon", "--set", "restitution=1"], "--set"),
        (["nylon", "--law", "hertz", "--chi", "1"], "--chi"),
        (["nylon", "--law", "hertz", "--set", "sigma=1"], "--set"),
        (["nylon", "--law", "constant"], "restitution=…"),
        (["--fit", "none.json"], "none.json: no such file"),
        (["nylon", "--material", "x"], "--material"),
    ],
)
def test_unusable_options_are_told_in_one_line_and_write_nothing(at, capsys, options, said):
    assert curve(*options) == 2
    told = capsys.readouterr()
    assert said in told.err
    assert told.err.count("\n") == 1
    assert list(at.iterdir()) == []


def test_a_bad_line_far_down_leaves_no_file(at, capsys):
    lines = ["velocity", *["1.5"] * 70_000, "slow"]
    (at / "v.csv").write_text("\n".join(lines), encoding="utf-8")
    assert curve("nylon", "--velocities", "v.csv", "--format", "csv", "npy") == 2
    assert "v.csv:70002: 'slow' holds no velocity" in capsys.readouterr().err
    assert [path.name for path in at.iterdir()] == ["v.csv"]
