"""The coverage study in small, and that its batched fits are the fits a user makes."""

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration import coverage

SETS = 100
TWO_STEP = [case for case in coverage.CASES if case.objective == "two-step"]
SEPARATE = coverage.Case("chrome steel", "model", 0.001, 30, 10, ("chi",))


def assert_near_95(share, sets):
    """Inside what chance allows once in a thousand."""
    low, high = stats.binom.interval(0.999, sets, 0.95)
    assert low <= round(share * sets) <= high


@pytest.mark.parametrize("case", TWO_STEP, ids=lambda case: case.material)
def test_two_step_s_intervals_hold_the_truth_as_often_as_they_say(case):
    (study,) = cal.coverage_study([case], SETS, seed=5)
    assert study.converged == 1.0
    for parameter in ("chi", "sigma", "psi"):
        assert_near_95(study.covered[parameter], SETS)
    for parameter in ("sigma", "psi"):
        assert_near_95(study.profiled[parameter], SETS)
        spread = np.std(np.log(study.estimates[parameter]))
        assert np.median(study.errors[parameter]) == pytest.approx(spread, rel=0.35)


def test_model_s_intervals_where_sigma_and_psi_are_separate():
    (study,) = cal.coverage_study([SEPARATE], SETS, seed=5)
    for parameter in ("chi", "sigma", "psi", "eps_up"):
        assert_near_95(study.covered[parameter], SETS)
    assert study.not_separate == 0.0


def test_where_they_are_not_it_is_said_of_every_set():
    case = coverage.Case("chrome steel", "model", 0.01, 30, 10, ("chi",))
    (study,) = cal.coverage_study([case], 40, seed=5)
    assert study.not_separate == 1.0
    assert_near_95(study.profiled["chi"], 40)
    assert_near_95(study.covered["eps_up"], 40)


@pytest.mark.parametrize("case", [TWO_STEP[0], SEPARATE], ids=lambda case: case.objective)
def test_the_batch_makes_the_fits_of_the_package(case):
    (study,) = cal.coverage_study([case], 3, seed=8)
    data, noisy = coverage.simulated(case, 3, (8, 0))
    for k in range(3):
        own = cal.RestitutionData(data.velocity, noisy[k], data.contact)
        result = cal.fit(own, case.objective, route=sj.EnergyBalance(), profiles=False, starts=4)
        for parameter in ("chi", "sigma", "psi"):
            value = result.values[parameter]
            assert study.estimates[parameter][k] == pytest.approx(value, rel=1e-5)
            error = result.standard_errors[parameter] / value
            assert study.errors[parameter][k] == pytest.approx(error, rel=1e-5)


def test_the_command_prints_its_table(capsys, monkeypatch):
    monkeypatch.setattr(coverage, "CASES", TWO_STEP[:1])
    monkeypatch.setattr(coverage, "coverage_study", lambda **_: cal.coverage_study(TWO_STEP[:1], 4))
    assert coverage.main(["--sets", "4"]) == 0
    assert "stainless steel" in capsys.readouterr().out


@pytest.mark.parametrize("sets", [30, pytest.param(200, marks=pytest.mark.long)])
def test_a_robust_loss_keeps_outliers_from_moving_chi(sets):
    """10 % outliers of 10 standard deviations: the shift against the fit without them."""
    case = coverage.Case("stainless steel", "two-step", 0.004, 40)
    data, noisy = coverage.simulated(case, sets, 3)
    options = {"route": sj.EnergyBalance(), "profiles": False, "starts": 1}
    shifts = {"squared": [], "huber": []}
    errors = []
    for k, row in enumerate(noisy):
        random = np.random.default_rng(k)
        clean = cal.fit(cal.RestitutionData(data.velocity, row, data.contact), **options)
        spoilt = np.array(row)
        hit = random.choice(len(row), len(row) // 10, replace=False)
        spoilt[hit] += 10 * case.noise * random.choice([-1, 1], len(hit))
        errors.append(clean.standard_errors["chi"])
        for loss, moved in shifts.items():
            own = cal.RestitutionData(data.velocity, spoilt, data.contact)
            moved.append(
                abs(cal.fit(own, loss=loss, **options).values["chi"] - clean.values["chi"])
            )
    robust, squared = np.median(shifts["huber"]), np.median(shifts["squared"])
    assert robust < np.median(errors)
    assert robust < squared / 3
