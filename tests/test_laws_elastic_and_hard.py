"""The two laws that need no integration: Hertz's, and hard spheres."""

import jax
import numpy as np
import pytest

import softjax as sj
from softjax.laws.hertz import ReducedHertz
from tests import law_cases as lc

HERTZ = sj.Hertz(lc.PAIR)
HARD = sj.ConstantRestitution(lc.PAIR, 0.9)
VELOCITY = np.array([1e-300, 1e-3, 1.0, 1e4])


@pytest.mark.parametrize("route", [None, lc.ODE], ids=["energy", "ode"])
def test_hertz_gives_everything_back(route):
    result = sj.restitution(HERTZ, VELOCITY, route)
    stiffness = 4 / 3 * lc.PAIR.youngs_modulus * np.sqrt(lc.PAIR.radius)
    peak = (5 * lc.PAIR.mass / (4 * stiffness)) ** 0.4 * VELOCITY**0.8
    assert np.all(result.coefficient == 1)
    assert np.all(result.status == sj.Status.ELASTIC)
    assert np.allclose(result.peak_overlap, peak, rtol=1e-13, atol=0)
    assert np.all(result.residual_overlap == 0)
    assert np.allclose(result.duration * VELOCITY / peak, 2.9432751843, rtol=5e-11, atol=0)


def test_hertz_does_not_know_of_yield():
    weak = sj.Contact(lc.PAIR.youngs_modulus, lc.PAIR.radius, lc.PAIR.mass, 1.0, 1.0)
    strong = sj.restitution(HERTZ, 1.0)
    found = sj.restitution(sj.Hertz(weak), 1.0)
    assert found.peak_overlap == strong.peak_overlap
    assert found.coefficient == 1


def test_hertz_works_are_those_of_the_force():
    # the root of the overlap is no root at x* = 0: Gauss nodes to 1e-11
    lc.assert_works_are_those_of_the_forces(ReducedHertz(), [1e-3, 1.0, 40.0], rtol=1e-11)
    overlap = np.array([1e-6, 1e-4])
    force = 4 / 3 * lc.PAIR.youngs_modulus * np.sqrt(lc.PAIR.radius) * overlap**1.5
    assert np.allclose(HERTZ.loading_force(overlap), force, rtol=1e-13, atol=0)
    assert np.allclose(HERTZ.unloading_force(overlap, 1e-4), force, rtol=1e-13, atol=0)


def test_hertz_history_is_a_mirror():
    hit = sj.collide(HERTZ, 2.0, samples=401)
    assert np.allclose(hit.overlap, hit.overlap[::-1], rtol=1e-12, atol=0)
    assert np.allclose(hit.velocity, -hit.velocity[::-1], rtol=0, atol=1e-12)
    # nothing is lost: the loop has no area
    impact = 0.5 * lc.PAIR.mass * 2.0**2
    assert abs(lc.loop_area(hit)) <= 1e-14 * impact
    assert np.isclose(hit.velocity[-1], -2.0, rtol=1e-14)


def test_hertz_slopes_are_zero_and_its_overlap_s_are_not():
    found, _, slopes = lc.derivatives(HERTZ, [1e-3, 1.0])
    assert np.all(found == 1)
    assert all(np.all(slope == 0) for slope in slopes.values())
    peak = lambda v: sj.restitution(HERTZ, v).peak_overlap  # noqa: E731
    value, slope = jax.value_and_grad(peak)(0.3)
    assert np.isclose(slope * 0.3 / value, 0.8, rtol=1e-13)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("law", [HERTZ, HARD], ids=["hertz", "hard"])
def test_hard_velocities(law, dtype):
    found, status = lc.assert_survives(law, dtype=dtype, least=1e-30)
    assert np.allclose(found[1:], 1.0 if law is HERTZ else 0.9, rtol=np.finfo(dtype).eps, atol=0)
    assert np.all(status[1:] == (sj.Status.ELASTIC if law is HERTZ else sj.Status.PLAIN))


def test_hard_spheres_give_what_was_put_in():
    result = sj.restitution(HARD, VELOCITY)
    assert np.allclose(result.coefficient, 0.9, rtol=2e-16, atol=0)
    assert np.array_equal(result.coefficient, result.plastic_coefficient)
    assert np.all(result.status == sj.Status.PLAIN)
    for name in ("peak_overlap", "residual_overlap", "duration"):
        assert np.all(getattr(result, name) == 0), name


@pytest.mark.parametrize("restitution", [0.0, 1.0])
def test_hard_spheres_take_both_ends(restitution):
    result = sj.restitution(sj.ConstantRestitution(lc.PAIR, restitution), 1.0)
    assert result.coefficient == restitution
    assert result.status == sj.Status.PLAIN


def test_hard_spheres_with_a_restitution_for_each_impact():
    each = np.array([0.2, 0.5, 0.8])
    result = sj.restitution(sj.ConstantRestitution(lc.PAIR, each), 1.0)
    assert np.allclose(result.coefficient, each, rtol=2e-16, atol=0)
    assert np.array_equal(result.duration, np.zeros(3))


def test_hard_slopes():
    _, _, slopes = lc.derivatives(HARD, [1e-3, 1.0])
    assert np.allclose(slopes.pop("restitution"), 0.9, rtol=1e-15)
    assert all(np.all(slope == 0) for slope in slopes.values())


def test_hard_spheres_have_no_force_to_integrate():
    with pytest.raises(ValueError, match=r"`route` must be EnergyBalance\(\).*, but is ODE"):
        sj.restitution(HARD, 1.0, lc.ODE)
    with pytest.raises(ValueError, match="`law` must be a law with a force"):
        sj.collide(HARD, 1.0)


def test_traced_failures():
    lc.assert_traced_failures(HARD, "restitution", 1.5)


def test_wrong_input_is_named():
    lc.assert_contact_refused(HERTZ)
    lc.assert_contact_refused(HARD)
    wrong = (-0.1, 1.1, np.nan, np.inf, "1", None, [0.5, 2.0])
    lc.assert_refused(lambda a: sj.ConstantRestitution(lc.PAIR, a), "restitution", *wrong)
