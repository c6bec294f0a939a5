"""The linear spring–dashpot: both ends against their closed forms."""

import numpy as np
import pytest

import softjax as sj
from tests import law_cases as lc

STIFFNESS = 1e6  # N/m
OMEGA = np.sqrt(STIFFNESS / lc.PAIR.mass)
INPUT = np.array([1e-6, 0.05, 0.2, 0.5, 0.8, 0.9, 0.95, 1.0])
# the published numbers of the zero-force end
ZERO_FORCE = {0.05: 0.213700, 0.2: 0.324863, 0.5: 0.550283, 0.8: 0.808099, 0.9: 0.902026}
ENDS = ("zero-overlap", "zero-force")


def fraction(restitution):
    """ξ and w = √(1 - ξ²)."""
    loss = -np.log(restitution)
    xi = loss / np.sqrt(np.pi**2 + loss**2)
    return xi, np.pi / np.sqrt(np.pi**2 + loss**2)


def angle(restitution):
    """ω0 w T of the zero-force end."""
    xi, w = fraction(restitution)
    return np.where(xi > 0, np.arctan2(2 * xi * w, 2 * xi**2 - 1), np.pi)


def expected(restitution, end):
    """ε and T."""
    xi, w = fraction(restitution)
    if end == "zero-overlap":
        return restitution, np.pi / (OMEGA * w)
    return np.exp(-xi / w * angle(restitution)), angle(restitution) / (OMEGA * w)


@pytest.fixture(scope="module", params=ENDS)
def batch(request):
    """One end, all ε: the same impacts serve every test."""
    law = sj.LinearSpringDashpot(lc.PAIR, STIFFNESS, INPUT, request.param)
    return request.param, sj.restitution(law, 0.7, lc.ODE)


def test_restitution_and_duration(batch):
    end, result = batch
    coefficient, duration = expected(INPUT, end)
    assert np.allclose(result.coefficient, coefficient, rtol=0, atol=1e-9)
    assert np.allclose(result.duration, duration, rtol=1e-9, atol=0)
    assert np.all(result.status == sj.Status.PLAIN)


def test_overlaps(batch):
    """At the peak ω0 w t = acos ξ; a force-free end leaves δ = -2ξ δ'/ω0."""
    end, result = batch
    xi, w = fraction(INPUT)
    peak = 0.7 / OMEGA * np.exp(-xi / w * np.arccos(xi))
    left = 2 * xi * np.asarray(result.coefficient) * 0.7 / OMEGA
    residual = np.zeros_like(peak) if end == "zero-overlap" else left
    assert np.allclose(result.peak_overlap, peak, rtol=1e-9, atol=0)
    assert np.allclose(result.residual_overlap, residual, rtol=0, atol=1e-9 * peak)


def test_published_numbers_of_the_zero_force_end():
    for given, published in ZERO_FORCE.items():
        assert abs(expected(given, "zero-force")[0] - published) <= 1e-6
    law = sj.LinearSpringDashpot(lc.PAIR, STIFFNESS, INPUT, "zero-force")
    found = dict(zip(INPUT, sj.restitution(law, 0.7, lc.ODE).coefficient, strict=True))
    for given, published in ZERO_FORCE.items():
        assert abs(found[given] - published) <= 1e-6


def test_duration_diverges_for_one_end_only():
    """The paper's T → ∞ as ε → 0 belongs to the zero-overlap end; the other tends to 2/ω0."""
    small = np.array([1e-2, 1e-4, 1e-8, 1e-16, 1e-32, 1e-64, 1e-128, 1e-256])
    times = {}
    for end in ENDS:
        law = sj.LinearSpringDashpot(lc.PAIR, STIFFNESS, small, end)
        times[end] = OMEGA * np.asarray(sj.restitution(law, 0.7, lc.ODE).duration)
        assert np.allclose(times[end], OMEGA * expected(small, end)[1], rtol=1e-9, atol=0)
    assert times["zero-overlap"][-1] > 100 * np.pi
    assert np.all(np.diff(times["zero-overlap"]) > 0)
    assert abs(times["zero-force"][-1] - 2) < 1e-4
    assert np.all(np.diff(times["zero-force"]) < 0)


def test_gradients_and_hard_velocities():
    """ε in is ε out, at every velocity: its slope is its own, and no other number has one."""
    law = sj.LinearSpringDashpot(lc.PAIR, STIFFNESS, 0.6)
    found, status = lc.assert_survives(law, lc.ODE)
    assert np.allclose(found[1:], 0.6, rtol=0, atol=1e-9)
    assert np.all(status[1:] == sj.Status.PLAIN)
    _, _, slopes = lc.derivatives(law, lc.hard_velocities(), lc.ODE)
    assert np.allclose(slopes.pop("restitution")[1:], 0.6, rtol=0, atol=1e-8)
    assert all(np.allclose(slope, 0, atol=1e-12) for slope in slopes.values())


def test_history():
    law = sj.LinearSpringDashpot(lc.PAIR, STIFFNESS, 0.5)
    hit = sj.collide(law, 0.7, samples=2001, route=lc.ODE)
    coefficient, duration = expected(0.5, "zero-overlap")
    impact = 0.5 * lc.PAIR.mass * 0.7**2
    assert np.isclose(lc.loop_area(hit) / impact, 1 - coefficient**2, rtol=0, atol=2e-6)
    assert np.isclose(hit.velocity[-1], -coefficient * 0.7, rtol=1e-9)
    assert np.isclose(hit.duration, duration, rtol=1e-9)
    xi, w = fraction(0.5)
    decay = np.exp(-xi * OMEGA * hit.time)
    overlap = 0.7 / (OMEGA * w) * decay * np.sin(w * OMEGA * hit.time)
    assert np.allclose(hit.overlap, overlap, rtol=0, atol=1e-7 * hit.overlap.max())
    force = STIFFNESS * hit.overlap + 2 * xi * OMEGA * lc.PAIR.mass * hit.velocity
    assert np.allclose(hit.force, force, rtol=1e-12, atol=1e-12 * hit.force.max())
    assert np.allclose(hit.force, law.force(hit.overlap, hit.velocity), rtol=1e-12, atol=1e-9)
    assert hit.force[-1] < -0.1 * hit.force.max()  # it pulls


def test_energy_balance_is_refused():
    law = sj.LinearSpringDashpot(lc.PAIR, STIFFNESS, 0.5)
    with pytest.raises(
        ValueError, match=r"`route` must be ClosedForm\(\) or ODE\(\.\.\.\) for Linear"
    ):
        sj.restitution(law, 1.0, sj.EnergyBalance())


def test_wrong_input_is_named():
    law = sj.LinearSpringDashpot
    lc.assert_contact_refused(law(lc.PAIR, STIFFNESS, 0.5))
    wrong = (0.0, -1.0, np.nan, np.inf, "1", None)
    lc.assert_refused(lambda a: law(lc.PAIR, a, 0.5), "stiffness", *wrong)
    lc.assert_refused(lambda a: law(lc.PAIR, STIFFNESS, a), "restitution", 1.01, *wrong)
    lc.assert_refused(lambda a: law(lc.PAIR, STIFFNESS, 0.5, a), "end", "zero", None, 0)
