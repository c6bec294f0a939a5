"""Intervals hold the truth as often as they say, and as a fit that a user makes says it."""

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration.coverage import __main__ as command
from calibration.coverage.batched import coverage_study, simulated
from calibration.coverage.cases import Case, nylon_pair, standard_cases
from calibration.coverage.experiments import experiments
from calibration.coverage.one_by_one import experiments_study

PAIR = nylon_pair()
ABOVE = np.geomspace(1.3, 80, 30) * float(PAIR.critical_velocity)
ZHOU = sj.Zhou(PAIR, 0.22, 0.4355, 0.5414)
EXPERIMENTS = {one.name: one for one in experiments()}
QUICK = ["Thornton, specimens blocks", "Thornton, trains 0.7 ms", "Zhou, 2 repeats"]
QUICK += ["Zhou, velocities 10 %, stated"]


def assert_near(share, sets, level=0.95, chance=0.99):
    """Inside what chance allows of intervals that hold what they say."""
    low, high = stats.binom.interval(chance, sets, level)
    assert low <= round(share * sets) <= high


def of(name):
    (found,) = (case for case in standard_cases((30,)) if case.name == name)
    return found


@pytest.mark.parametrize("name", ["zhou, eps_up, n = 30", "viscoelastic, n = 30, stated"])
def test_intervals_hold_the_truth_as_often_as_they_say(name):
    (study,) = coverage_study([of(name)], 200, seed=5)
    assert study.converged == 1.0
    for parameter in study.covered:
        assert_near(study.covered[parameter], 200, chance=0.999)
        assert study.ratio[parameter] == pytest.approx(1, abs=0.2)


@pytest.mark.long
@pytest.mark.parametrize("case", standard_cases(), ids=lambda case: case.name)
def test_intervals_of_every_law_hold_the_truth(case):
    """Where n = 8, or σ and ψ lie in their valley, 93 % are asked for."""
    (study,) = coverage_study([case], 500, seed=1)
    easy = len(case.velocity) > 8 and "sigma and psi" not in case.name
    for parameter, share in study.covered.items():
        if easy:
            assert_near(share, 500)
            assert study.ratio[parameter] == pytest.approx(1, abs=0.15)
        assert share >= 0.93


@pytest.mark.parametrize("name", QUICK)
def test_errors_that_are_shared_or_unequal(name):
    """25 sets: enough to tell 95 % from the 20 to 80 % of intervals that take errors for equal."""
    (study,) = experiments_study([EXPERIMENTS[name]], 25, seed=2, profiles=False)
    assert study.converged == 1.0
    for parameter in study.covered:
        assert_near(study.covered[parameter], 25, chance=0.999)
        assert study.ratio[parameter] == pytest.approx(1, abs=0.4)
    if EXPERIMENTS[name].scatter is not None:
        assert study.measurements == pytest.approx(0.95, abs=0.06)


@pytest.mark.long
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_errors_as_laboratories_have_them(name):
    (study,) = experiments_study([EXPERIMENTS[name]], 300, seed=1)
    for parameter in study.covered:
        assert_near(study.covered[parameter], 300)
        assert study.ratio[parameter] == pytest.approx(1, abs=0.15)
    if EXPERIMENTS[name].scatter is not None:
        assert study.measurements == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("objective", ["model", "two-step"])
def test_the_batch_makes_the_fits_of_the_package(objective):
    limit = float(PAIR.limit_velocity)
    truth = {
        "model": ZHOU,
        "two-step": sj.EmpiricalRestitution(limit, 0.4355, 0.5414),
    }[objective]
    case = Case("nylon", truth, ABOVE, sj.Zhou, objective=objective, contact=PAIR)
    (study,) = coverage_study([case], 3, seed=8)
    noisy = simulated(case, 3, (8, 0))
    for k in range(3):
        data = cal.RestitutionData(ABOVE, noisy[k], PAIR)
        route = sj.EnergyBalance()
        result = cal.fit(data, objective=objective, route=route, profiles=False, starts=4)
        for parameter in study.covered:
            value = result.values[parameter]
            if parameter == "eps_up":  # between 0 and 1, searched by its logit
                value = value / (1 - value)
            error = result.standard_errors[parameter]
            error /= (
                result.values[parameter] * (1 - value / (1 + value))
                if parameter == "eps_up"
                else value
            )
            assert study.estimates[parameter][k] == pytest.approx(np.log(value), abs=1e-5)
            assert study.errors[parameter][k] == pytest.approx(error, rel=1e-5)


def test_the_command_prints_its_table(capsys, monkeypatch):
    monkeypatch.setattr(command, "standard_cases", lambda: [of("constant, n = 30")])
    assert command.main(["--sets", "4", "--case", "constant"]) == 0
    assert "constant, n = 30" in capsys.readouterr().out
    monkeypatch.setattr(command, "experiments", lambda: [EXPERIMENTS["Zhou, independent"]])
    assert command.main(["--errors", "--sets", "2", "--case", "Zhou"]) == 0
    assert "one more measurement" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (["--case", "typo"], "`--case` must be how the name of a case begins: zhou, thornton,"),
        (["--errors", "--case", "typo"], "`--case` must be how the name of a case begins: Zhou,"),
        (["--sets", "0"], "`sets` must be a whole number >= 1, but is 0"),
        (["--errors", "--sets", "0"], "`sets` must be a whole number >= 1, but is 0"),
        (["--seed", "-1"], "`seed` must be a whole number >= 0, but is -1"),
    ],
)
def test_the_command_refuses_what_it_cannot_study(asked, told, capsys):
    with pytest.raises(SystemExit) as caught:
        command.main(asked)
    assert caught.value.code == 2
    assert told in capsys.readouterr().err


def test_a_study_of_another_confidence_is_asked_in_parts_of_one():
    with pytest.raises(ValueError, match="`confidence` must be between 0 and 1, but is 95"):
        coverage_study([of("constant, n = 30")], 2, confidence=95)


@pytest.mark.parametrize("sets", [20, pytest.param(200, marks=pytest.mark.long)])
def test_a_robust_loss_keeps_outliers_from_moving_chi(sets):
    """10 % outliers of 10 standard deviations: the shift against the fit without them."""
    noise, random = 0.004, np.random.default_rng(3)
    exact = np.asarray(sj.restitution(ZHOU, ABOVE).coefficient)
    options = {"profiles": False, "starts": 1}
    shifts, errors = {"squared": [], "huber": []}, []

    def fit(restitution, **more):
        return cal.fit(cal.RestitutionData(ABOVE, restitution, PAIR), **options, **more)

    for _ in range(sets):
        row = exact + noise * random.standard_normal(len(exact))
        clean = fit(row)
        spoilt = np.array(row)
        hit = random.choice(len(row), len(row) // 10, replace=False)
        spoilt[hit] -= 10 * noise
        errors.append(clean.standard_errors["chi"])
        for loss, moved in shifts.items():
            moved.append(abs(fit(spoilt, loss=loss).values["chi"] - clean.values["chi"]))
    robust, squared = np.median(shifts["huber"]), np.median(shifts["squared"])
    assert robust < 2 * np.median(errors)
    assert robust < squared / 3
