"""Hertz's spring with the dashpot of constant ε: both ends, and another program's number."""

import numpy as np
import pytest

import softjax as sj
from tests import law_cases as lc

INPUT = np.array([0.05, 0.2, 0.5, 0.8, 0.9, 0.95])
ZERO_FORCE = np.array([0.213700, 0.324863, 0.550283, 0.808099, 0.902026])  # of the first five
ENDS = ("zero-overlap", "zero-force")


def linear_zero_force(restitution):
    """e = exp(-(ξ/w) atan2(2ξw, 2ξ² - 1)), w = √(1 - ξ²): the linear law's."""
    loss = -np.log(restitution)
    xi = loss / np.sqrt(np.pi**2 + loss**2)
    w = np.sqrt(1 - xi**2)
    return np.exp(-xi / w * np.arctan2(2 * xi * w, 2 * xi**2 - 1))


@pytest.fixture(scope="module", params=ENDS)
def batch(request):
    law = sj.HertzDashpot(lc.PAIR, INPUT, request.param)
    return request.param, sj.restitution(law, np.array([[1e-4], [3.0]]), lc.ODE)


def test_restitution_is_that_of_the_linear_law_at_every_velocity(batch):
    end, result = batch
    expected = INPUT if end == "zero-overlap" else linear_zero_force(INPUT)
    assert result.coefficient.shape == (2, 6)
    assert np.allclose(result.coefficient, expected, rtol=0, atol=1e-9)
    assert np.all(result.status == sj.Status.PLAIN)


def test_published_numbers(batch):
    end, result = batch
    published = INPUT[:5] if end == "zero-overlap" else ZERO_FORCE
    assert np.allclose(result.coefficient[:, :5], published, rtol=0, atol=1e-6)


def test_overlap_left_is_where_the_force_vanishes(batch):
    """P = 0 at the rebound velocity: k δ^{3/2} = α √(M k) δ^{1/4} εv."""
    end, result = batch
    if end == "zero-overlap":
        assert np.all(result.residual_overlap == 0)
        return
    loss = -np.log(INPUT)
    alpha = np.sqrt(5) * loss / np.sqrt(np.pi**2 + loss**2)
    rebound = np.asarray(result.coefficient) * np.array([[1e-4], [3.0]])
    left = (alpha * np.sqrt(lc.PAIR.mass / lc.PAIR.stiffness) * rebound) ** 0.8
    assert np.allclose(result.residual_overlap, left, rtol=1e-8, atol=0)


def test_duration_falls_with_the_fifth_root_of_velocity():
    law = sj.HertzDashpot(lc.PAIR, INPUT)
    result = sj.restitution(law, np.array([[1e-4], [3.0]]), lc.ODE)
    assert np.allclose(result.duration[0] / result.duration[1], (3.0 / 1e-4) ** 0.2, rtol=1e-9)


def test_number_of_lammps():
    """LAMMPS 29 Sep 2021 update 2 (Debian's package 20220106): pair_style granular, hertz/material
    with damping tsuji and ε = 0.8, two equal steel spheres, 1000 steps a contact, gave a rebound
    ratio of 0.8534 at every velocity. Its polynomial α lacked a factor √2, as its later
    documentation says.
    """
    polynomial = (4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728)
    alpha = np.polyval(polynomial, 0.8)
    factors = np.resize([1, np.sqrt(2)], 6)
    law = sj.HertzDashpot.from_damping(lc.PAIR, factors * alpha)
    found = sj.restitution(law, np.array([[0.1], [2.0]]), lc.ODE).coefficient
    assert np.allclose(found[:, :2], [0.85338, 0.79891], rtol=0, atol=5e-6)
    # the program's own result, to what its 1000 steps a contact resolve
    assert np.allclose(found[:, 0], 0.8534, rtol=0, atol=5e-5)


def test_gradients_and_hard_velocities():
    law = sj.HertzDashpot(lc.PAIR, 0.6, "zero-force")
    step = 1e-5
    change = [linear_zero_force(0.6 * (1 + s)) for s in (-step, step)]
    slope = np.diff(change) / (2 * step)
    found, status = lc.assert_survives(law, lc.ODE)
    assert np.allclose(found[1:], linear_zero_force(0.6), rtol=0, atol=1e-9)
    assert np.all(status[1:] == sj.Status.PLAIN)
    _, _, slopes = lc.derivatives(law, lc.hard_velocities(), lc.ODE)
    assert np.allclose(slopes.pop("restitution")[1:], slope, rtol=0, atol=1e-8)
    assert all(np.allclose(slope, 0, atol=1e-12) for slope in slopes.values())


@pytest.mark.long
def test_history():
    law = sj.HertzDashpot(lc.PAIR, 0.5, "zero-force")
    hit = sj.collide(law, 0.7, samples=2001, route=lc.ODE)
    coefficient = linear_zero_force(0.5)
    impact = 0.5 * lc.PAIR.mass * 0.7**2
    assert np.isclose(lc.loop_area(hit) / impact, 1 - coefficient**2, rtol=0, atol=2e-6)
    assert np.isclose(hit.velocity[-1], -coefficient * 0.7, rtol=1e-9)
    alpha = np.sqrt(5) * np.log(2) / np.sqrt(np.pi**2 + np.log(2) ** 2)
    dashpot = alpha * np.sqrt(lc.PAIR.mass * lc.PAIR.stiffness) * hit.overlap**0.25
    force = lc.PAIR.stiffness * hit.overlap**1.5 + dashpot * hit.velocity
    assert np.allclose(hit.force, force, rtol=0, atol=1e-12 * hit.force.max())
    assert hit.force[0] == 0
    assert abs(hit.force[-1]) < 1e-9 * hit.force.max()


def test_wrong_input_is_named():
    law = sj.HertzDashpot
    lc.assert_contact_refused(law(lc.PAIR, 0.5))
    wrong = (0.0, -1.0, 1.01, np.nan, np.inf, "1", None)
    lc.assert_refused(lambda a: law(lc.PAIR, a), "restitution", *wrong)
    lc.assert_refused(lambda a: law(lc.PAIR, 0.5, a), "end", "zero", None, 0)
    lc.assert_refused(
        lambda a: law.from_damping(lc.PAIR, a), "alpha", -1.0, 2.24, np.nan, "1", None
    )
