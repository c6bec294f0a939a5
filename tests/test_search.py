"""Where a force vanishes, and how far a body comes, from forces alone, against what is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softjax._search import crossing, reach

ZERO = 0.37
VANISHING = {  # a force that vanishes at ZERO, and how often it may be asked for
    "straight": (lambda x: ZERO - x, 4),
    "straight, clipped": (lambda x: jnp.maximum(ZERO - x, 0.0), 6),
    "power 3/2, clipped": (lambda x: jnp.maximum(ZERO - x, 0.0) ** 1.5, 9),
    "power 5/2, clipped": (lambda x: jnp.maximum(ZERO - x, 0.0) ** 2.5, 9),
    "root": (lambda x: jnp.sqrt(jnp.maximum(ZERO - x, 0.0)), 12),
    "cubic": (lambda x: (ZERO - x) ** 3, 9),
    "bent": (lambda x: jnp.exp(-20 * x) - np.exp(-20 * ZERO), 12),
    "jump": (lambda x: jnp.where(x < ZERO, 1.0 + x, -1.0), 60),
    "jump to zero": (lambda x: jnp.where(x < ZERO, 1.0 - x, 0.0), 60),
}


@pytest.mark.parametrize("name", VANISHING)
def test_a_force_vanishes_where_it_does(name):
    force, most = VANISHING[name]
    asked = []

    def counted(x):
        jax.debug.callback(lambda x: asked.append(float(x)), x)
        return force(x)

    search = jax.jit(lambda inside, outside: crossing(counted, inside, outside))
    for ends in ((0.25, 0.5), (0.0, 1.0), (0.369999, 7.0)):
        asked.clear()
        found = float(search(*ends))
        jax.effects_barrier()
        assert found == pytest.approx(ZERO, rel=1e-15, abs=1e-15)
        assert len(asked) <= (most if ends[1] < 1 else 64)
        assert "jump" not in name or found < ZERO <= np.nextafter(found, 1.0) * (1 + 1e-15)


def test_nothing_is_looked_for_where_no_force_vanishes():
    asked = []

    def force(x):
        jax.debug.callback(lambda x: asked.append(float(x)), x)
        return x

    assert crossing(force, jnp.asarray(0.5), jnp.asarray(0.5)) == 0.5
    jax.effects_barrier()
    assert set(asked) <= {0.5}


PEAK = 1e-3


@jax.jit
def against_a_power_law(power, guess):
    return reach(lambda x: (x / PEAK) ** power, PEAK / (power + 1), guess)


@pytest.mark.parametrize("power", [0.0, 1.0, 1.5, 4.0])
@pytest.mark.parametrize("away", [1e-200, 1e-12, 1e-3, 0.3, 1.0, 7.0, 1e4, 1e150])
def test_how_far_a_body_comes_against_a_power_law(power, away):
    """Wherever it was expected; its energy is that of a way of PEAK."""
    found = against_a_power_law(power, PEAK * away)
    assert found.turns
    assert float(found.rough) == pytest.approx(PEAK, rel=0.1)
    assert found.end == np.inf
    assert float(found.top) > 1.4 * PEAK


@jax.jit
def against_a_triangle(energy, end):
    return reach(lambda x: 1 - x / end, 0.5 * energy * end, jnp.ones_like(end))


@pytest.mark.parametrize("end", [1.3, 3.0])
@pytest.mark.parametrize("energy", [0.8, 1.2])
def test_a_loading_force_that_vanishes_beyond_the_peak_or_before(energy, end):
    """A triangle from 1 at touch to 0 at `end`, whose work is end/2."""
    found = against_a_triangle(energy, end)
    assert bool(found.turns) == (energy < 1)
    assert float(found.end) == pytest.approx(end, rel=1e-12)
    assert float(found.top) == float(found.end)


def test_a_law_ends_where_its_force_is_no_number():
    found = reach(lambda x: jnp.where(x < 2.0, 1.0, jnp.nan), jnp.asarray(3.0), jnp.asarray(1.0))
    assert not found.turns
    assert float(found.end) == pytest.approx(2.0, rel=1e-12)
