"""Plans of fits whose points share errors: the fit's own errors, dense matrices, simulations."""

from dataclasses import replace

import numpy as np
import pytest

import calibration as cal
from tests.decay import Decay
from tests.fit_data import eq_17_data
from tests.statistics.test_information import agrees_with_its_fit

LEVEL, RATE = 0.85, 0.04
OFFSET, SCATTER, TIMING = 0.02, 0.01, 3e-4
GRAVITY = 9.80665
BOUNDS = (1.0, 30.0)
QUICK = {"profiles": False, "starts": 1}


def specimens(seed=3, groups=6, each=5, name="a", more=()):
    """Impacts of each specimen around a velocity of its own; further ones of new specimens."""
    random = np.random.default_rng(seed)
    label = np.append(np.repeat(np.arange(groups), each), groups + np.arange(len(more)))
    v = np.append(np.linspace(1.0, 12.0, groups * each), more)
    e = LEVEL * np.exp(-RATE * v) + OFFSET * random.standard_normal(groups + len(more))[label]
    e += SCATTER * random.standard_normal(len(v))
    return cal.RestitutionData(v, e, name=name, group=[f"s{k}" for k in label])


def trains(stated: bool, launches=4, count=8, seed=1):
    """Bounces of some launches; times have errors, and each launch has an offset."""
    random = np.random.default_rng(seed)
    times, labels = [], []
    for k in range(launches):
        offset, own = 0.01 * random.standard_normal(), [random.uniform(0.9, 1.5)]
        for _ in range(count):
            curve = LEVEL * np.exp(-0.02 * own[-1] * GRAVITY / 2)
            own.append(own[-1] * (curve + offset))
        times += list(own + TIMING * random.standard_normal(count + 1))
        labels += [f"l{k}"] * (count + 1)
    told = {"timing_uncertainty": TIMING} if stated else {}
    return cal.RestitutionData.from_table({"launch": labels, "interval": times}, **told)


def single(name="b"):
    v = np.linspace(1.0, 12.0, 12)
    off = SCATTER * np.random.default_rng(9).standard_normal(12)
    return cal.RestitutionData(v, 0.8 * np.exp(-RATE * v) + off, name=name)


def own_errors(result: cal.FitResult) -> dict[str, float]:
    """A fit's standard errors without what is added for variances that are estimates."""
    found = {}
    for fit in result.fits:
        for k, element in enumerate(fit.component.elements):
            widened = fit.uncertainty.widened[0, k]
            found[element.label] = result.standard_errors[element.label] / widened
    return found


SHARED = {"rate": cal.Parameter(shared=True)}
POOLED = {"rate": cal.Parameter(shared="pooled")}
CASES = {
    "specimens": (specimens(), {}),
    "timing stated": (trains(True), {}),
    "timing unknown": (trains(False), {}),
    "beside points that share nothing": ([specimens(), single()], SHARED),
    "pooled": ([specimens(k, name=f"p{k}") for k in range(3)] + [single()], POOLED),
}


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(c, marks=pytest.mark.long) if c in ("pooled", "timing stated") else c
        for c in CASES
    ],
)
def test_without_further_shots_a_plan_promises_the_fits_own_errors(case):
    data, parameters = CASES[case]
    result = cal.fit(data, Decay, parameters, **QUICK)
    expected = own_errors(result)
    for material in result.materials:
        found = cal.fisher_information(result, material=material.name)
        own = {name: expected[name] for name in found.names}
        assert found.standard_errors == pytest.approx(own, rel=1e-4)
        (told,) = found.taken_as_known
        assert told.startswith("the variances of errors that points share are taken as known: the")


def test_stated_errors_that_points_share_leave_nothing_to_tell():
    """One launch alone, whose times have a known uncertainty."""
    result = cal.fit(trains(True, launches=1, count=12), Decay, **QUICK)
    assert result.materials[0].data.errors.shares
    assert not agrees_with_its_fit(result).taken_as_known


def rows(v, result):
    """Slopes of a e^{-bv} in ln a and ln b."""
    level, rate = result.values["level"], result.values["rate"]
    curve = level * np.exp(-rate * np.asarray(v))
    return np.stack([curve, -rate * np.asarray(v) * curve], axis=-1)


def information(result):
    """Of the specimens, by V written down, and the variance of an impact of a further one."""
    found, data = result.materials[0].variances, result.data
    together = data.group_index[:, None] == data.group_index[None, :]
    whole = found["scatter"] * np.eye(len(data)) + found["group"] * together
    slopes = rows(data.velocity, result)
    return slopes.T @ np.linalg.solve(whole, slopes), found["scatter"] + found["group"]


def test_further_shots_are_of_specimens_of_their_own():
    result = cal.fit(specimens(), Decay, **QUICK)
    before, variance = information(result)
    slopes = rows([3.0, 20.0, 20.0], result)
    found = cal.fisher_information(result, [3.0, 20.0, 20.0])
    np.testing.assert_allclose(found.matrix, before + slopes.T @ slopes / variance, rtol=1e-5)
    finer = cal.fisher_information(result, [3.0, 20.0, 20.0], 0.002)
    np.testing.assert_allclose(finer.matrix, before + slopes.T @ slopes / 0.002**2, rtol=1e-5)
    whole = np.append(np.full(30, np.sqrt(variance)), np.full(3, 0.002))
    np.testing.assert_allclose(finer.uncertainty, whole, rtol=1e-5)
    np.testing.assert_allclose(finer.covariance, np.linalg.inv(finer.matrix), rtol=1e-5)


def test_further_shots_belong_to_one_of_the_data_sets():
    result = cal.fit([specimens(), single()], Decay, SHARED, **QUICK)
    before, v = cal.fisher_information(result, material="a"), np.array([3.0, 20.0])
    for k, name in enumerate("ab"):
        found = cal.fisher_information(result, v, material=name)
        level, rate = result.values[f"level[{name}]"], result.values["rate"]
        curve = level * np.exp(-rate * v)
        slopes = np.zeros((2, 3))
        slopes[:, found.names.index(f"level[{name}]")] = curve
        slopes[:, found.names.index("rate")] = -rate * v * curve
        variance = sum(result.materials[k].variances.values())
        expected = before.matrix + slopes.T @ slopes / variance
        np.testing.assert_allclose(found.matrix, expected, rtol=1e-6, atol=1e-6)


WEIGHTS = {"A": lambda _: np.eye(2) / 2, "I": lambda s: s.T @ s / len(s)}


@pytest.mark.parametrize(
    ("criterion", "uncertainty"),
    [("A", 0.004), *(pytest.param(c, None, marks=pytest.mark.long) for c in "AI")],
)
def test_a_design_beside_specimens_is_as_good_as_the_best_on_a_grid(criterion, uncertainty):
    result = cal.fit(specimens(), Decay, **QUICK)
    before, variance = information(result)
    variance = variance if uncertainty is None else uncertainty**2
    found = cal.optimal_velocities(result, 3, BOUNDS, criterion=criterion, uncertainty=uncertainty)
    weight = WEIGHTS[criterion](rows(np.linspace(*BOUNDS, 4001), result))

    def covariance(v):
        slopes = rows(v, result)
        return np.linalg.inv(before + slopes.T @ slopes / variance)

    def mean_variance(v):
        return np.trace(weight @ covariance(v))

    grid = np.linspace(*BOUNDS, 30)
    triples = ((a, b, c) for a in grid for b in grid[grid >= a] for c in grid[grid >= b])
    best = min(mean_variance(v) for v in triples)
    assert mean_variance(found.velocity) == pytest.approx(best, rel=1e-3)
    for errors, matrix in (
        (found.relative_errors, covariance(found.velocity)),
        (found.before, np.linalg.inv(before)),
    ):
        np.testing.assert_allclose(list(errors.values()), np.sqrt(np.diag(matrix)), rtol=1e-5)
    assert found.taken_as_known[0].startswith("the variances of errors that points share are")


@pytest.mark.long
def test_what_is_promised_beside_specimens_is_what_simulated_fits_reach():
    """300 fits of specimens and the shots planned, and the root mean square of what 60 promised."""
    new, sets = [20.0, 22.0, 25.0, 25.0], 300
    found = [cal.fit(specimens(100 + k, 8, more=new), Decay, **QUICK).values for k in range(sets)]
    fits = [cal.fit(specimens(100 + k, 8), Decay, **QUICK) for k in range(60)]
    plans = [cal.fisher_information(fit, new).standard_errors for fit in fits]
    for name in ("level", "rate"):
        reached = np.std([values[name] for values in found], ddof=1)
        promised = np.sqrt(np.mean([plan[name] ** 2 for plan in plans]))
        assert promised == pytest.approx(reached, rel=0.15)


def test_a_plan_in_two_steps_promises_its_fits_errors():
    """σ and ψ to rounding; χ̃ is found a little elsewhere without the noise."""
    data = eq_17_data("stainless steel", points=30, noise=0.006)
    of = np.arange(30) % 6
    off = 0.01 * np.random.default_rng(100).standard_normal(6)[of]
    data = replace(data, restitution=data.restitution + off, group=[f"s{k}" for k in of])
    result = cal.fit(data, objective="two-step", **QUICK)
    assert result.materials[0].variances["group"] > result.materials[0].variances["scatter"]
    found = cal.fisher_information(result)
    for name, rel in (("sigma", 1e-4), ("psi", 1e-4), ("chi", 0.01)):
        expected = result.standard_errors[name]
        assert found.standard_errors[name] == pytest.approx(expected, rel=rel)
    assert not found.taken_as_known
    # and a design of further shots promises what the information at its velocities does
    bounds = (float(np.min(data.velocity)), float(np.max(data.velocity)))
    design = cal.optimal_velocities(result, 3, bounds, uncertainty=0.004, starts=1)
    expected = cal.fisher_information(result, design.velocity, 0.004).relative_errors
    assert design.relative_errors == pytest.approx(expected, rel=1e-3)
    best = design.relative_errors["chi"]
    for factor in (0.7, 1.4):
        moved = np.clip(factor * design.velocity, *bounds)
        other = cal.fisher_information(result, moved, 0.004).relative_errors["chi"]
        assert best < 1.001 * other
