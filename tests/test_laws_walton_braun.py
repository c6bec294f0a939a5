"""Walton and Braun's bilinear law against its closed forms, by both routes."""

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from softjax.laws.walton_braun import ReducedWaltonBraun
from tests import law_cases as lc

K1, K2 = 1.2e6, 3.0e6  # N/m
CONSTANT = sj.WaltonBraun(lc.PAIR, K1, K2)
GROWING = sj.WaltonBraun(lc.PAIR, K1, K2, growth=2e4)
LAWS = {"constant": CONSTANT, "growing": GROWING}
VELOCITY = np.array([1e-4, 0.1, 1.0, 20.0])


def closed_form(loading_stiffness, unloading_stiffness, growth, mass, velocity, **_):
    """ε = √(k1/k2), k2 = k20 + s v √(k1 M)."""
    force = velocity * mp.sqrt(loading_stiffness * mass)
    return mp.sqrt(loading_stiffness / (unloading_stiffness + growth * force))


def half_periods(law, velocity):
    """T = (π/2) (√(M/k1) + √(M/k2))."""
    force = velocity * np.sqrt(law.loading_stiffness * lc.PAIR.mass)
    stiffer = law.unloading_stiffness + law.growth * force
    quarter = 1 / np.sqrt(law.loading_stiffness) + 1 / np.sqrt(stiffer)
    return 0.5 * np.pi * np.sqrt(lc.PAIR.mass) * quarter


def expected(law, velocity):
    numbers = {name: getattr(law, name) for name in lc.own_fields(law)}
    each = [closed_form(mass=lc.PAIR.mass, velocity=v, **numbers) for v in velocity]
    return np.array([float(value) for value in each])


def test_constant_stiffness_gives_one_restitution():
    result = sj.restitution(CONSTANT, VELOCITY)
    assert np.allclose(result.coefficient, np.sqrt(K1 / K2), rtol=1e-15, atol=0)


def test_restitution_falls_with_growing_stiffness():
    found = sj.restitution(GROWING, VELOCITY).coefficient
    assert np.all(np.diff(found) < 0)
    assert found[-1] < 0.5 * found[0]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("route", [None, lc.ODE], ids=["energy", "ode"])
def test_closed_forms(name, route):
    law = LAWS[name]
    result = sj.restitution(law, VELOCITY, route)
    coefficient = expected(law, VELOCITY)
    peak = VELOCITY * np.sqrt(lc.PAIR.mass / K1)
    # both springs end where they cross: x_m k1 = (x_m - x*) k2
    residual = peak * (1 - np.square(coefficient))
    assert np.allclose(result.coefficient, coefficient, rtol=0, atol=1e-13)
    assert np.allclose(result.peak_overlap, peak, rtol=1e-13, atol=0)
    assert np.allclose(result.residual_overlap, residual, rtol=1e-12, atol=0)
    assert np.allclose(result.duration, half_periods(law, VELOCITY), rtol=1e-9, atol=0)
    assert np.all(result.status == sj.Status.PLAIN)


def test_works_are_those_of_the_forces():
    lc.assert_works_are_those_of_the_forces(
        ReducedWaltonBraun(jnp.array(2.0), jnp.array(0.3)), [0.01, 1.0, 40.0]
    )


def test_forces_are_the_springs():
    overlap = np.array([1e-6, 1e-4])
    assert np.allclose(GROWING.loading_force(overlap), K1 * overlap, rtol=1e-14, atol=0)
    peak = 1e-4
    stiffness = K2 + GROWING.growth * K1 * peak
    force = K1 * peak - stiffness * (peak - 0.9 * peak)
    assert np.isclose(GROWING.unloading_force(0.9 * peak, peak), force, rtol=1e-13)


def test_loop_is_the_energy_lost():
    result = sj.restitution(GROWING, 5.0)
    peak, residual = float(result.peak_overlap), float(result.residual_overlap)
    loading = lc.work_between(GROWING.loading_force, 0.0, peak)
    unloading = lc.work_between(lambda x: GROWING.unloading_force(x, peak), residual, peak)
    lost = 0.5 * lc.PAIR.mass * 5.0**2 * (1 - result.coefficient**2)
    assert np.isclose(loading - unloading, lost, rtol=1e-12, atol=0)


def test_history():
    hit = sj.collide(GROWING, VELOCITY, samples=2001, route=lc.ODE)
    impact = 0.5 * lc.PAIR.mass * VELOCITY**2
    lost = 1 - np.square(expected(GROWING, VELOCITY))
    assert np.allclose(lc.loop_area(hit) / impact, lost, rtol=0, atol=1e-6)
    rebound = -expected(GROWING, VELOCITY) * VELOCITY
    assert np.allclose(hit.velocity[:, -1], rebound, rtol=1e-9, atol=0)
    assert np.allclose(hit.duration, half_periods(GROWING, VELOCITY), rtol=1e-9, atol=0)


@pytest.mark.parametrize(("route", "tolerance"), [(None, 1e-12), (lc.ODE, 1e-6)])
def test_gradients(route, tolerance):
    velocity = VELOCITY[1:]
    _, _, slopes = lc.derivatives(GROWING, velocity, route)
    lc.assert_slopes(slopes, lc.differences(closed_form, GROWING, velocity), tolerance)


@pytest.mark.parametrize(("dtype", "least"), [(np.float64, 1e-300), (np.float32, 1e-30)])
def test_hard_velocities(dtype, least):
    found, status = lc.assert_survives(GROWING, dtype=dtype, least=least)
    exact = expected(GROWING, [least, 1e-6, 1.0, 1e5])
    assert np.allclose(found[1:], exact, rtol=8 * np.finfo(dtype).eps, atol=0)
    assert np.all(status[1:] == sj.Status.PLAIN)


def test_slowest_impacts_keep_their_overlaps():
    result = sj.restitution(CONSTANT, 1e-300)
    assert np.isclose(result.peak_overlap, 1e-300 * np.sqrt(lc.PAIR.mass / K1), rtol=1e-12, atol=0)


def test_softer_unloading_gains_energy_where_tracing_hides_it():
    law = lc.replace_leaf(CONSTANT, "unloading_stiffness", 0.5 * K1)
    result = sj.restitution(law, 1.0)
    # W_U = k1 δ² - k2 δ²/2 against W_L = k1 δ²/2
    assert np.isclose(result.coefficient**2, 1.5, rtol=1e-14)
    assert result.status == sj.Status.ENERGY_GAIN | sj.Status.NO_RESIDUAL_OVERLAP
    assert result.residual_overlap == 0


def test_traced_failures():
    lc.assert_traced_failures(GROWING, "growth", -1.0)


def test_wrong_input_is_named():
    lc.assert_contact_refused(CONSTANT)
    wrong = (0.0, -1.0, np.nan, np.inf, "1", None)
    lc.assert_refused(lambda a: sj.WaltonBraun(lc.PAIR, a, K2), "loading_stiffness", *wrong)
    lc.assert_refused(lambda a: sj.WaltonBraun(lc.PAIR, K1, a), "unloading_stiffness", *wrong)
    lc.assert_refused(lambda a: sj.WaltonBraun(lc.PAIR, K1, K2, a), "growth", -1.0, np.nan, "1")
    with pytest.raises(ValueError, match=r"`unloading_stiffness` must be at least .*, but is 1"):
        sj.WaltonBraun(lc.PAIR, K1, 1.0)
