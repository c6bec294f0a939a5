"""The library's laws, written anew in newtons and metres, are the built-in ones."""

from functools import partial

import jax
import numpy as np
import pytest
from scipy.special import beta

import softjax as sj
from tests.cases import compiled_soon
from tests.si_laws import PAIRS, STEEL

VELOCITY = STEEL.critical_velocity * np.array([0.3, 1.5, 4.0, 20.0, 300.0])
NUMBERS = ("coefficient", "peak_overlap", "residual_overlap")
RATE_INDEPENDENT = [name for name, (own, _) in PAIRS.items() if name != "viscoelastic"]
PRECISE = sj.ODE(rtol=1e-12)
LONG = pytest.mark.long  # a law written in SI takes up to 40 s to compile by the ODE, with slopes
CASES = [
    pytest.param(
        name, None, id=f"{name}-energy", marks=() if name in ("hertz", "thornton") else LONG
    )
    for name in RATE_INDEPENDENT
]
CASES += [pytest.param(name, PRECISE, id=f"{name}-ode", marks=LONG) for name in PAIRS]
HISTORIES = [pytest.param(name, marks=LONG) for name in PAIRS]


def fields_of(law):
    return [
        name for name in ("yield_factor", "chi", "growth", "dissipation_time") if hasattr(law, name)
    ]


@partial(compiled_soon, static_argnames="route")
def everything(law, velocity, route):
    """Result, duration, and the slopes of both."""

    def total(law, velocity):
        result = sj.restitution(law, velocity, route)
        weights = 1 / result.duration
        lasts = result.duration * jax.lax.stop_gradient(weights)
        return result.coefficient.sum() + 0.1 * lasts.sum(), (result, result.duration)

    (_, found), slopes = jax.value_and_grad(total, argnums=(0, 1), has_aux=True)(law, velocity)
    return found, slopes


def close(one, two, tolerance=1e-9):
    """Relative to the largest of them."""
    one, two = np.asarray(one), np.asarray(two)
    return np.max(np.abs(one - two)) <= tolerance * max(np.max(np.abs(two)), 1e-300)


@pytest.mark.parametrize(("name", "route"), CASES)
def test_values_and_slopes(name, route):
    own, built_in = PAIRS[name]
    (result, lasts), (by_law, by_velocity) = everything(own, VELOCITY, route)
    (exact, time), (slopes, along) = everything(built_in, VELOCITY, route)
    for number in NUMBERS:
        assert close(getattr(result, number), getattr(exact, number)), number
    assert np.allclose(lasts, time, rtol=1e-9, atol=0)
    if name == "hertz":  # in SI it does not say that it never yields
        assert np.all(result.status == sj.Status.NO_RESIDUAL_OVERLAP)
        assert np.all(exact.status == sj.Status.ELASTIC)
    else:
        assert np.array_equal(result.status, exact.status)
    assert np.allclose(by_velocity * VELOCITY, along * VELOCITY, rtol=0, atol=1e-9)
    for field in fields_of(own):
        scale = getattr(own, field)
        assert np.allclose(
            getattr(by_law, field) * scale, getattr(slopes, field) * scale, rtol=1e-9, atol=1e-9
        ), field
    for leaf, value in own.contact.leaves().items():
        one, two = (getattr(s.contact, leaf) * value for s in (by_law, slopes))
        assert np.allclose(one, two, rtol=1e-9, atol=1e-9), leaf


@pytest.mark.parametrize("name", HISTORIES)
def test_histories(name):
    own, built_in = PAIRS[name]
    velocity = VELOCITY[1:4:2]
    found = sj.collide(own, velocity, samples=21, route=PRECISE)
    exact = sj.collide(built_in, velocity, samples=2001, route=PRECISE)
    assert np.allclose(found.duration, exact.duration, rtol=1e-9, atol=0)
    assert np.allclose(found.velocity[:, -1], exact.velocity[:, -1], rtol=0, atol=1e-9)
    for k in range(len(velocity)):
        # the same force and speed at the same overlap, on either side of the peak
        for half, sign in ((slice(0, 11), 1), (slice(10, None), -1)):
            at = np.asarray(found.overlap[k, half])
            force = _force(built_in, at, np.asarray(found.velocity[k, half]), at.max(), sign)
            assert close(found.force[k, half], force)
        impact = 0.5 * own.contact.mass * velocity[k] ** 2
        kinetic = 0.5 * own.contact.mass * np.asarray(found.velocity[k]) ** 2
        assert np.all(kinetic <= impact * (1 + 1e-9))


def _force(law, overlap, velocity, peak, sign):
    if isinstance(law, sj.RateDependentLaw):
        return law.force(overlap, velocity)
    return law.loading_force(overlap) if sign > 0 else law.unloading_force(overlap, peak)


RESTING = np.array([1e-300, 1e-100])
QUICK = ("walton-braun", None)
AT_REST = [
    pytest.param(name, route, marks=() if (name, route) == QUICK else LONG)
    for name in ("hertz", "walton-braun", "viscoelastic")
    for route in (None, PRECISE)
    if (name, route) != ("viscoelastic", None)
]


@pytest.mark.parametrize(("name", "route"), AT_REST)
def test_impacts_that_are_all_but_at_rest(name, route):
    """Overlaps, durations and ε are those of the power law near rest; no square underflows."""
    own, built_in = PAIRS[name]
    found, exact = (sj.restitution(law, RESTING, route) for law in (own, built_in))
    for number in ("coefficient", "peak_overlap", "duration"):
        assert np.allclose(getattr(found, number), getattr(exact, number), rtol=1e-11, atol=0)
    contact = built_in.contact
    if name == "hertz":
        peak = (1.25 * contact.mass / contact.stiffness) ** 0.4 * RESTING**0.8
        lasts = 0.8 * beta(0.4, 0.5) * peak / RESTING
    elif name == "viscoelastic":
        return
    else:  # a spring each way: π/2 (ω_1^-1 + ω_2^-1)
        rates = np.sqrt(np.array([own.loading_stiffness, own.unloading_stiffness]) / contact.mass)
        peak, lasts = RESTING / rates[0], np.full(2, 0.5 * np.pi * np.sum(1 / rates))
    assert np.allclose(found.peak_overlap, peak, rtol=1e-11, atol=0)
    assert np.allclose(found.duration, lasts, rtol=1e-11, atol=0)
