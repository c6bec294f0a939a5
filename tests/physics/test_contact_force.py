"""`sj.contact_force`: stepped impacts rebound as the law does, under jit, vmap and grad."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, pair

PAIR = pair("stainless steel")
LAWS = {
    "zhou": fitted("stainless steel"),
    "thornton": sj.Thornton(pair("stainless steel", "hertz"), 2.8),
    "hertz-dashpot": sj.HertzDashpot(PAIR, 0.8, end="zero-force"),
}
VELOCITY = np.array([0.1, 1.0, 5.0])
force_of = jax.jit(sj.contact_force)


def rebound(law, velocity, steps, **options):
    """ε of an impact by velocity Verlet with so many steps in Hertz's contact."""
    mass, stiffness = law.contact.mass, law.contact.stiffness
    peak = (1.25 * mass * velocity**2 / stiffness) ** 0.4
    dt = 2.94 * peak / velocity / steps

    def step(_, state):
        overlap, rate, memory = state
        overlap = overlap + dt * rate
        force, memory = sj.contact_force(law, overlap, rate, memory, **options)
        return overlap, rate - dt * force / mass, memory

    start = (-0.3 * dt * velocity, velocity, 0.0 * velocity)
    return -jax.lax.fori_loop(0, 2 * steps, step, start)[1] / velocity


@pytest.mark.parametrize("name", LAWS)
def test_an_impact_that_is_stepped_rebounds_as_the_law_does(name):
    law = LAWS[name]
    found = jax.jit(lambda v: rebound(law, v, 1000))(jnp.asarray(VELOCITY))
    memory = isinstance(law, sj.RateIndependentLaw)
    expected = sj.restitution(law, VELOCITY).coefficient
    np.testing.assert_allclose(found, expected, atol=5e-6 if memory else 2e-3)


def test_its_gradient_is_that_of_the_restitution():
    """∂ε/∂ of the yield strength's factor through all steps, with vmap over the impacts."""
    law = LAWS["thornton"]

    def of(factor):
        moved = sj.Thornton(law.contact, factor)
        return jax.vmap(lambda v: rebound(moved, v, 400))(jnp.asarray(VELOCITY[1:]))

    def exact(factor):
        return sj.thornton_restitution(law.contact, VELOCITY[1:], factor)

    found, exact = (jax.jit(jax.jacfwd(f))(law.yield_factor) for f in (of, exact))
    assert np.all(np.isfinite(found))
    np.testing.assert_allclose(found, exact, rtol=0.05)


def test_apart_there_is_no_force_and_no_memory():
    overlap, law = jnp.array([-1e-6, 0.0]), LAWS["thornton"]
    of = lambda x: sj.contact_force(law, x, 1.0, 1e-5)  # noqa: E731
    (force, memory), (slope, _) = jax.jit(lambda x: jax.jvp(of, (x,), (jnp.ones(2),)))(overlap)
    np.testing.assert_array_equal(force, 0)
    np.testing.assert_array_equal(memory, 0)
    assert slope[0] == 0


def test_beyond_what_any_impact_reaches_nothing_rebounds():
    """Past the last turning point of Zhou's expansion, where no work is left: no force, and no slope."""
    memory = jnp.array([1.0, 4.0]) * PAIR.radius
    of = lambda memory: sj.contact_force(fitted("nylon"), 0.97 * memory, -1.0, memory)[0]  # noqa: E731
    force, slope = jax.jit(lambda memory: jax.jvp(of, (memory,), (jnp.ones(2),)))(memory)
    assert force[0] > 0 == force[1]
    assert np.isfinite(slope[0])
    assert slope[1] == 0


def test_below_a_velocity_its_restitution_is_held():
    """Faster impacts are as they were, but where they load again a dashpot pushes."""
    law, velocity = LAWS["thornton"], np.array([1e-3, 0.05, 1.0, 5.0])
    found = jax.jit(lambda v: rebound(law, v, 2000, hold=0.1))(jnp.asarray(velocity))
    expected = sj.restitution(law, np.maximum(velocity, 0.1)).coefficient
    assert np.all(np.abs(found - expected)[:2] < [2e-4, 6e-3])  # elastic, and yielding
    np.testing.assert_allclose(found[2:], expected[2:], atol=3e-6)
    peak = float(sj.restitution(law, 1.0).peak_overlap)
    rates = jnp.array([-0.1, 0.0, 0.1])
    force, _ = force_of(law, 0.9 * peak, rates, peak, hold=0.1)
    assert force[0] == force[1] < force[2]
