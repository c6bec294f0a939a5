"""Speed against error: errors are true, ratios are fair. No time decides anything here."""

import csv
import sys
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import softjax as sj
from calibration import cli
from calibration.commands.speed import _scene_and_ways
from calibration.speed import fits, scipy_loop
from calibration.speed.damped import damped_plan, damped_scene
from calibration.speed.measure import Row, along_power_law, measure
from calibration.speed.own_law import Recoil, own_plan, own_scene
from calibration.speed.scene import stainless
from calibration.speed.ways import energy_balance
from tests.command import as_on_windows


def row(error, microseconds, family="rival"):
    return Row(family, "", "float64", 4096, microseconds, error, 0.0, None)


def test_a_rival_is_taken_between_its_settings():
    rows = [row(1e-4, 1.0), row(1e-8, 100.0), row(1e-6, 0.1, "another")]
    assert along_power_law(rows, "rival", 1e-6) == pytest.approx(10.0)
    assert along_power_law(rows, "rival", 1e-8) == pytest.approx(100.0)


def test_a_rival_that_was_not_measured_there_gives_no_ratio():
    rows = [row(1e-8, 100.0), row(1e-6, 10.0)]
    assert along_power_law(rows, "rival", 1e-3) is None
    assert along_power_law(rows, "rival", 2e-6) == 10.0
    assert along_power_law(rows, "rival", 1e-9) is None


def test_exact_answers_tell_errors():
    """The energy balance meets them; half of ε_p missing is seen; SciPy errs as its tolerance says."""
    scene = stainless()
    own = measure(energy_balance(scene, 64), scene)
    assert own.largest_error < 1e-14
    assert own.gradient_error < 1e-12
    wrong = energy_balance(scene, 64, gradient=False)
    halved = type(wrong)("half", "", 64, lambda v: 0.5 * np.asarray(wrong.value(v)))
    assert measure(halved, scene).largest_error > 0.3
    loop = measure(scipy_loop.scipy_loop(scene, 4, "DOP853", 1e-6), scene)
    assert 1e-12 < loop.largest_error < 1e-4


@pytest.mark.parametrize(
    "name",
    [
        "linear",
        *(pytest.param(n, marks=pytest.mark.long) for n in ("viscoelastic", "hertz-dashpot")),
    ],
)
def test_laws_with_damping_err_as_told(name):
    """The closed form meets 60 digits, in its gradient too; SciPy and diffrax err as their tolerance says."""
    scene = damped_scene(name)
    ways = [build() for build in damped_plan(name, scene, quick=True)]
    known = next(way for way in ways if way.family == "closed form")
    own = measure(replace(known, batch=32), scene)
    assert own.largest_error < 1e-14
    assert own.gradient_error < 1e-14
    loop = next(way for way in ways if way.family == "SciPy loop")
    assert 1e-12 < measure(replace(loop, batch=4), scene).largest_error < 1e-4


def test_a_law_of_ones_own_errs_as_told():
    """Its elementary works meet the energy balance, in its gradient too; SciPy's motion is the same."""
    scene = own_scene()
    ways = [build() for build in own_plan(scene, quick=True)]
    searched, told = ways[-2:]
    assert [way.setting for way in ways[-2:]] == ["exact", "exact, end told"]
    own = measure(replace(searched, batch=32), scene)
    assert own.gradient_error < 1e-13
    knows = measure(replace(told, batch=32, gradient=None), scene)
    assert max(own.largest_error, knows.largest_error) < 1e-14
    assert searched.family == told.family == "energy balance"
    loop = next(way for way in ways if way.family == "SciPy loop")
    assert 1e-12 < measure(replace(loop, batch=4), scene).largest_error < 1e-4
    motion = Recoil(2.5)
    for x, u in ((0.3, 0.7), (0.3, -0.7), (1.0, 0.0)):
        assert motion.kernel()(x, u, 2.5) == pytest.approx(motion.force(x, u))


def test_the_command_writes_its_table_and_picture(tmp_path, monkeypatch, capsys):
    few = lambda scene, quick: [  # noqa: E731
        partial(energy_balance, scene, 64, gradient=False),
        partial(scipy_loop.scipy_loop, scene, 2, "LSODA", 1e-6),
    ]
    monkeypatch.setattr("calibration.speed.plan.plan", few)
    as_on_windows(monkeypatch)
    assert cli.main(["speed", "--quick", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "speed.csv").read_bytes().decode()
    assert "\r" not in text
    rows = list(csv.DictReader(text.splitlines()))
    assert [r["family"] for r in rows] == ["energy balance", "SciPy loop"]
    assert (tmp_path / "speed.png").read_bytes().startswith(b"\x89PNG")
    assert "LSODA" in capsys.readouterr().out


def test_for_a_law_the_ways_of_zhou_s_are_not_built(monkeypatch):
    monkeypatch.delattr("calibration.speed.plan.plan")
    for law, own in (("own", own_scene()), ("linear", damped_scene("linear"))):
        scene, ways = _scene_and_ways(law, True)
        np.testing.assert_array_equal(scene.exact, own.exact)
        assert len(ways) > 4


def test_what_is_written_nowhere_is_told_unless_quiet(monkeypatch, capsys):
    monkeypatch.setattr("calibration.speed.fits.report", lambda: "what it took")
    assert cli.main(["speed", "--fits"]) == 0
    assert capsys.readouterr().out == "what it took\n"
    assert cli.main(["speed", "--fits", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "options",
    [
        ("--fits", "--law", "own"),
        ("--fits", "--quick"),
    ],
)
def test_options_that_would_do_nothing_are_refused(options, monkeypatch, capsys):
    monkeypatch.setattr("calibration.speed.fits.report", lambda: "what it took")
    try:
        code = cli.main(["speed", *options])
    except SystemExit as stop:
        code = stop.code
    told = capsys.readouterr()
    assert (code, told.out, len(told.err.splitlines())) == (2, "", 1)
    assert options[0] in told.err


def as_it_is(function=None, **options):
    """In place of numba's compiler."""
    return (lambda function: function) if function is None else function


def test_scipy_s_loop_fits_the_same_curve(monkeypatch):
    """Its formulas, as Python runs them, and their derivatives; and it finds the same minima."""
    monkeypatch.setitem(sys.modules, "numba", SimpleNamespace(njit=as_it_is))
    law, data = fits._measured()
    at, z = fits._curve_of(data, law), np.log([law.chi, law.sigma, law.psi])
    value, jacobian = at(z)
    exact = np.asarray(sj.restitution(law, data.velocity).coefficient)
    np.testing.assert_allclose(value, exact, rtol=1e-12)
    for k, step in enumerate(1e-5 * np.eye(3)):
        slope = (at(z + step)[0] - at(z - step)[0]) / 2e-5
        np.testing.assert_allclose(jacobian[:, k], slope, atol=1e-9)
    assert "the same minimum        100.0%" in fits.report(6)
