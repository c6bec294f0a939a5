"""Derivatives of durations, overlaps and histories against differences, by both routes."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import compiled_soon, fitted, pair

PAIR = pair("nylon")
STEP = 1e-3  # relative; of fourth-order differences
SIDES = np.array([-2, -1, 1, 2])
LAWS = {
    "zhou": (fitted("nylon"), "chi"),
    "thornton": (sj.Thornton(PAIR, 1.6), "yield_factor"),
    "walton-braun": (sj.WaltonBraun(PAIR, 1e6, 2e6, growth=3e3), "growth"),
    "viscoelastic": (sj.ViscoelasticHertz(PAIR, 2e-5), "dissipation_time"),
}
ODE = sj.ODE(rtol=1e-12)
CASES = [
    ("zhou", None, False),
    pytest.param("zhou", ODE, True, marks=pytest.mark.long),
    pytest.param("thornton", None, False, marks=pytest.mark.long),
    pytest.param("thornton", ODE, True, marks=pytest.mark.long),
    pytest.param("walton-braun", None, False, marks=pytest.mark.long),
    pytest.param("walton-braun", ODE, True, marks=pytest.mark.long),
    pytest.param("viscoelastic", ODE, True, marks=pytest.mark.long),
]


@pytest.mark.parametrize(("name", "route", "whole"), CASES)
def test_slopes_are_those_of_differences(name, route, whole):
    law, field = LAWS[name]
    velocity = 6.0 * float(PAIR.critical_velocity)

    def motion(factors):
        """Each quantity over its own size: overlaps, duration and, by the ODE, a history."""
        moved = replace(law, **{field: getattr(law, field) * factors[0]})
        hit = sj.restitution(moved, velocity * factors[1], route)
        told = [hit.peak_overlap, hit.residual_overlap, hit.duration]
        if whole:
            path = sj.collide(moved, velocity * factors[1], samples=7, route=route)
            told += [*path.time[1:], *path.overlap[1:-1], *path.velocity, *path.force[1:-1]]
        return jnp.stack(told)

    one = jnp.ones(2)
    every = np.concatenate([1 + STEP * SIDES[:, None] * np.eye(2)[k] for k in range(2)])
    values = np.asarray(compiled_soon(jax.vmap(motion))(jnp.asarray(every))).reshape(2, 4, -1)
    far_down, down, up, far_up = np.moveaxis(values, 1, 0)
    expected = (8 * (up - down) - (far_up - far_down)) / (12 * STEP)
    found = np.asarray(compiled_soon(jax.jacfwd(motion))(one)).T
    back = np.asarray(compiled_soon(jax.jacrev(motion))(one)).T
    size = np.max(np.abs(values), axis=(0, 1))
    size = np.where(size > 0, size, 1.0)
    assert np.max(np.abs(expected) / size, axis=1).min() > 1e-3  # each input acts
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=2e-8)
    np.testing.assert_allclose(back / size, found / size, rtol=0, atol=1e-11)
