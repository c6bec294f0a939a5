"""Two hundred laws drawn at random by both routes against SciPy, a thousand more for their manners."""

from functools import lru_cache, partial

import jax
import numpy as np
import pytest

import softjax as sj
from tests.physics import random_laws
from tests.physics.random_laws import LENGTH, PAIR, Declared, Drawn

COUNT = 200
FIELDS, VELOCITY = random_laws.draw(seed=0, count=COUNT)
ROUTES = {"energy": sj.EnergyBalance(), "ode": sj.ODE(rtol=1e-9)}


@lru_cache
def expected():
    """Peak and residual overlap, ε_p² and which impacts yield."""
    found = random_laws.answers(FIELDS, VELOCITY)
    names = ("peak", "residual", "squared")
    peak, residual, squared = (np.array([getattr(a, name) for a in found]) for name in names)
    return peak, residual, squared, peak > FIELDS["elastic"]


@lru_cache
def computed(kind, route):
    if (kind, route) == (Declared, "energy"):  # by the program that a thousand more go through
        many = {name: np.resize(field, 1000) for name, field in FIELDS.items()}
        (_, result), _ = value_and_slopes(many, np.resize(VELOCITY, 1000), ROUTES[route])
        return jax.tree.map(lambda leaf: leaf[:COUNT], result)
    return sj.restitution(random_laws.law_of(FIELDS, kind), VELOCITY, ROUTES[route])


def errors(kind, route):
    """Of ε_p², and of both overlaps over the peak."""
    peak, residual, squared, _ = expected()
    result = computed(kind, route)
    off = np.abs(np.asarray(result.plastic_coefficient) ** 2 - squared)
    lengths = [
        np.abs(np.asarray(found) / LENGTH - length) / peak
        for found, length in ((result.peak_overlap, peak), (result.residual_overlap, residual))
    ]
    return off, *lengths


def flags(result, flag):
    return (np.asarray(result.status) & int(flag)) > 0


def test_the_draw_has_all_kinds():
    peak, residual, squared, yields = expected()
    assert 10 < np.sum(~yields) < COUNT / 2
    assert np.sum(yields & (residual == 0)) > 30
    assert np.sum((FIELDS["more"] == 0) & (FIELDS["slope"] == 0)) > 5  # plateaus
    assert np.sum((peak > FIELDS["kink"]) & (FIELDS["more"] > 0)) > 20
    assert np.ptp(squared[yields]) > 0.8


@pytest.mark.parametrize(("route", "bound"), [("energy", 1e-9), ("ode", 1e-7)])
def test_against_scipy_with_all_kinks_declared(route, bound):
    *_, yields = expected()
    result = computed(Declared, route)
    for error in errors(Declared, route):
        assert np.max(error[yields]) < bound
    assert np.array_equal(flags(result, sj.Status.ELASTIC), ~yields)
    assert np.all(result.plastic_coefficient[~yields] == 1)
    assert not np.any(flags(result, sj.Status.INEXACT))
    assert not np.any(flags(result, sj.Status.SOLVER_FAILED | sj.Status.NO_TURNING_POINT))
    stays = expected()[1] > 0
    assert np.array_equal(flags(result, sj.Status.NO_RESIDUAL_OVERLAP), yields & ~stays)


def test_against_scipy_without_a_word_of_kinks():
    """Exact, or told not to be."""
    *_, yields = expected()
    result = computed(Drawn, "energy")
    told = flags(result, sj.Status.INEXACT)
    worst = np.max(errors(Drawn, "energy"), 0)
    assert np.max(worst[yields & ~told]) < 1e-9
    assert np.max(worst[yields]) < 1e-2
    kinked = yields & (FIELDS["elastic"] > 0)
    assert np.sum(told[kinked]) > 0.5 * np.sum(kinked)
    assert not np.any(
        told[(FIELDS["elastic"] == 0) & (FIELDS["more"] == 0) & (FIELDS["jolt"] == 0)]
    )


@pytest.mark.parametrize("route", ["energy", pytest.param("ode", marks=pytest.mark.long)])
def test_durations_against_scipy(route):
    chosen = np.flatnonzero(expected()[3])[:12]
    found = np.asarray(computed(Declared, route).duration)[chosen]
    laws = random_laws.answers({k: v[chosen] for k, v in FIELDS.items()}, VELOCITY[chosen])
    exact = np.array([law.duration() for law in laws]) * LENGTH
    assert np.allclose(found, exact, rtol=2e-7, atol=0)


@partial(jax.jit, static_argnames="route")
def value_and_slopes(fields, velocity, route):
    def total(fields, velocity):
        result = sj.restitution(Declared(PAIR, **fields), velocity, route)
        return result.coefficient.sum(), result

    return jax.value_and_grad(total, argnums=(0, 1), has_aux=True)(fields, velocity)


def test_a_thousand_more_are_numbers_with_good_neighbours():
    """Wilder ones: forces of any size, velocities over twelve decades; forward and backward."""
    fields, velocity = random_laws.draw(seed=1, count=1000)
    rng = np.random.default_rng(2)
    wild = np.arange(1000) % 2 == 0
    velocity = np.where(wild, 10 ** rng.uniform(-9, 3, 1000), velocity)
    for name in ("slope", "more"):
        fields[name] = np.where(wild, fields[name] * 10 ** rng.uniform(-6, 6, 1000), fields[name])
    fields["back"] = np.where(wild, rng.uniform(0.3, 6, 1000), fields["back"])
    (_, result), slopes = value_and_slopes(fields, velocity, sj.EnergyBalance())
    for leaf in jax.tree.leaves((result, slopes)):
        assert np.all(np.isfinite(leaf))
    calm = {name: value[~wild] for name, value in fields.items()}
    (_, alone), slopes_alone = value_and_slopes(
        {k: np.repeat(v, 2) for k, v in calm.items()},
        np.repeat(velocity[~wild], 2),
        sj.EnergyBalance(),
    )
    assert np.array_equal(alone.status[::2], result.status[~wild])
    assert np.allclose(alone.coefficient[::2], result.coefficient[~wild], rtol=0, atol=1e-13)
    assert np.allclose(slopes_alone[1][::2], slopes[1][~wild], rtol=1e-9, atol=1e-12)


@pytest.mark.long
def test_slopes_against_differences():
    """θ ∂ε/∂θ by both routes, where no kink is beside the peak."""
    fields, velocity = {k: v[:64] for k, v in FIELDS.items()}, VELOCITY[:64]
    yields = expected()[3][:64]
    names = ("slope", "more", "rest", "floor", "kink")
    found = {r: value_and_slopes(fields, velocity, ROUTES[r])[1] for r in ROUTES}
    step = 1e-6

    def squares(fields, velocity):
        return np.array([a.squared for a in random_laws.answers(fields, velocity)])

    for name in (*names, "velocity"):
        up, down = (squares(*_moved(fields, velocity, name, s * step)) ** 0.5 for s in (1, -1))
        exact = np.where(yields, (up - down) / (2 * step), 0.0)
        at = velocity if name == "velocity" else fields[name]
        for route, bound in (("energy", 2e-7), ("ode", 2e-6)):
            slopes = found[route][1] if name == "velocity" else found[route][0][name]
            assert np.allclose(slopes * at, exact, rtol=bound, atol=bound), (name, route)


def _moved(fields, velocity, name, step):
    if name == "velocity":
        return fields, velocity * (1 + step)
    return fields | {name: fields[name] * (1 + step)}, velocity
