"""Several minima are told where there are several, and a search that fell asleep is none."""

import re

import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration.compare import candidates as known
from calibration.compare.curves import observe
from calibration.compare.entries import fitted_entry
from calibration.compare.refits import Problem, from_starts, search, starts_of
from calibration.compare.zhou import zhou_candidate
from calibration.minima import MOVED, rises_between
from tests.cases import pair
from tests.fit_data import eq_17_data, twin

CONTACT = pair("nylon")
VELOCITY = np.linspace(1.0, 30.0, 40)
NOISE = np.random.default_rng(5).normal(size=40)
ZHOU = zhou_candidate("eps-up", "first-order", "consistent")


def steel(seed=0):
    """Forty points of Eq. (17) from 0.06 to 2 m/s."""
    critical = float(pair("stainless steel").critical_velocity)
    y = np.linspace(0.06, 2.0, 40) / critical
    return eq_17_data("stainless steel", y=y, noise=0.004, seed=seed, uncertainty=0.004)


def problem_of(candidate, data):
    return Problem(candidate, observe(data), candidate.units(data))


def cost_of(problem, z):
    return np.sum(problem.residual(z, problem.observed.weight) ** 2)


@pytest.mark.parametrize("start", [0.0, 1e-300, 4e-16, -1e-12, 0.7])
def test_where_a_search_ends_does_not_depend_on_how_near_zero_it_starts(start):
    data = steel()
    problem = problem_of(known.EQ_17, data)
    z, cost, at_minimum = search(problem, np.full(2, start), problem.observed.weight)
    expected = search(problem, np.array([1.3, -0.4]), problem.observed.weight)
    assert at_minimum
    assert np.allclose(z, expected[0], rtol=0, atol=1e-6)
    assert cost == pytest.approx(expected[1], rel=1e-12)
    assert np.max(np.abs(z)) > 2 * MOVED  # the start is another place


def gain(problem, z, step):
    """What the lowest point of the parabola through three costs lies below the middle one."""
    low, middle, high = (cost_of(problem, z + k * step) for k in (-1, 0, 1))
    return (high - low) ** 2 / (8 * (high - 2 * middle + low))


@pytest.mark.parametrize(
    ("candidate", "data"),
    [
        (known.EQ_17, steel()),
        (known.WALTON_BRAUN_GROWING, steel()),
        (ZHOU, twin("nylon", np.geomspace(1.3, 80, 40), noise=0.004)),
    ],
    ids=lambda one: getattr(one, "key", ""),
)
def test_the_gradient_vanishes_wherever_a_search_says_it_is_at_a_minimum(candidate, data):
    problem = problem_of(candidate, data)
    found = from_starts(problem, starts_of(candidate, data))
    assert np.sum(found.converged) >= 12
    lowest, steps = np.min(found.cost), 1e-4 * np.eye(found.z.shape[1])
    for z, cost in zip(found.z[found.converged], found.cost[found.converged], strict=True):
        if cost < 1.1 * lowest:  # the others are out where nothing acts
            assert cost == pytest.approx(lowest, rel=1e-9)
            assert all(gain(problem, z, step) < 1e-7 * cost for step in steps)


@pytest.mark.parametrize("seed", range(4))
def test_one_minimum_is_not_told_as_several(seed):
    """A fit of Eq. (17) to its own curve has one; a start there is as good within the noise."""
    data = steel(seed)
    problem = problem_of(known.EQ_17, data)
    start = starts_of(known.EQ_17, data)[0]
    found = fitted_entry(known.EQ_17, data, observe(data))
    near = (cost_of(problem, start) - cost_of(problem, found.z)) / problem.observed.variance
    assert 0 < near < 4
    assert "several-minima" not in [one.code for one in found.doubts]
    assert found.converged


def folded(tilt):
    """A made law with ε = 1/2 + (z² - 1)²/10 + tilt z: lowest near z = -1 and z = 1."""

    def law(contact, theta):
        z = jnp.log(theta)
        return sj.ConstantRestitution(contact, 0.5 + 0.1 * (z**2 - 1) ** 2 + tilt * z)

    return known.Candidate("folded", "folded", law, (known.Free("a"),), lambda data: [(0.05, 20.0)])


@pytest.mark.parametrize(("rise", "several"), [(0.0, True), (2.0, True), (6.0, False)])
def test_two_minima_are_told_where_they_are_as_good(rise, several):
    """Measured is 0.45, below both: χ² differs by 40 (0.05 ± tilt)²/0.01² = 80000 tilt."""
    noise = 0.01 * (NOISE - np.mean(NOISE))
    data = cal.RestitutionData(VELOCITY, 0.45 + noise, CONTACT, 0.01, name="made")
    entry = fitted_entry(folded(rise / 80000), data, observe(data))
    told = [one.cause for one in entry.doubts if one.code == "several-minima"]
    assert bool(told) == several
    assert abs(entry.z[0]) == pytest.approx(1, abs=1e-3)
    if rise:
        assert entry.z[0] < 0  # the lower one
    if several and rise:
        (value, higher) = re.fullmatch(
            r"also at a = (\S+), chi squared (\S+) higher", told[0]
        ).groups()
        assert float(value) == pytest.approx(np.e, rel=0.01)
        assert float(higher) == pytest.approx(rise, rel=0.06)


def double_well(x):
    return 1.0 + (x[0] ** 2 - 1) ** 2 + 3 * x[1] ** 2


def valley(x):
    """Rosenbrock's: one minimum, at (1, 1), along a bent and level valley."""
    return 1.0 + 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2


@pytest.mark.parametrize(
    ("cost", "first", "second", "rises"),
    [
        (double_well, [-1.0, 0.0], [1.0, 0.0], True),
        (double_well, [-1.0, 0.0], [0.0, 0.0], False),  # a saddle
        (double_well, [1.0, 0.0], [0.9, 0.2], False),  # one valley's wall
        (valley, [1.0, 1.0], [0.99, 0.99**2], False),  # a little way along a valley
        (lambda x: 1.0 + 0 * x[0], [0.0, 0.0], [1.0, 3.0], False),  # a level valley
        (lambda x: 2 - np.exp(-((x[0] * 200) ** 2)) + x[0] / 9, [0.0, 0.0], [-2.0, 0.0], True),
    ],
)
def test_a_rise_between_two_ends(cost, first, second, rises):
    one, other = np.array(first), np.array(second)
    assert rises_between(cost, one, other) == rises
    assert rises_between(cost, other, one) == rises
