"""A result owns what it was made of, and means the same inside, outside and across `vmap`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import pair

STEEL = pair("stainless steel")
LAW = sj.Zhou(STEEL, 1.7944, 3.0432, 0.54)


@pytest.mark.parametrize("count", [1000, pytest.param(300_000, marks=pytest.mark.long)])
def test_an_array_that_is_written_again(count):
    """Dispatch is asynchronous: five of ten such results were those of a later velocity."""
    velocity, chi = np.empty(count), np.full(count, 1.7944)
    law = sj.Zhou(STEEL, chi, 3.0432, 0.54)
    results = []
    for k in range(10):
        velocity[:] = 0.5 * (k + 1)
        results.append(sj.restitution(law, velocity))
        chi[:] = 1.7944 + k  # the law took a copy: nothing of it reaches a result
    velocity[:] = np.nan
    for k, result in enumerate(results):
        alone = sj.restitution(LAW, 0.5 * (k + 1))
        assert np.all(result.coefficient == alone.coefficient)
        assert np.all(result.velocity == 0.5 * (k + 1))
        assert np.all(result.law.chi == 1.7944)
    assert np.allclose(results[3].duration, sj.restitution(LAW, 2.0).duration, rtol=1e-14)


CHI = np.array([0.5, 1.0, 2.0])
VELOCITY = np.array([0.1, 0.5, 2.0])


@pytest.mark.parametrize("count", [3, pytest.param(2, marks=pytest.mark.long)])
def test_durations_across_vmap(count):
    """Of as many laws as velocities the law went along the wrong axis; of fewer it raised."""
    velocity = VELOCITY[:count]

    def of(chi):
        return sj.restitution(sj.Zhou(STEEL, chi, 3.0432, 0.54), velocity)

    alone = np.array([np.asarray(of(float(chi)).duration) for chi in CHI])
    outside = jax.vmap(of)(CHI)
    assert np.allclose(outside.duration, alone, rtol=1e-13)
    inside = jax.vmap(lambda chi: of(chi).duration)(CHI)
    assert np.allclose(inside, alone, rtol=1e-13)
    across = jax.jit(jax.vmap(of, out_axes=1))(CHI)
    assert np.allclose(across.duration, alone.T, rtol=1e-13)
    assert np.array_equal(across.ok, jax.vmap(of)(CHI).ok.T)
    slope = jax.jacfwd(lambda chi: jax.vmap(of)(chi).duration.sum())(CHI)
    inner = jax.jacfwd(lambda chi: jax.vmap(lambda c: of(c).duration)(chi).sum())(CHI)
    assert np.allclose(slope, inner, rtol=1e-12)


def test_what_is_no_velocity_is_named():
    """A mask was ignored, and a longer float was told of as a bare TypeError."""
    masked = np.ma.array([0.1, 0.2], mask=[False, True])
    accepted = "`velocity` must be a finite impact velocity in m/s, zero or more, but is"
    for bad in (masked, np.array([0.1], np.longdouble), "fast", None):
        with pytest.raises(ValueError, match=accepted):
            sj.restitution(LAW, bad)
    assert sj.restitution(LAW, np.longdouble(0.1)).coefficient.dtype == np.float64  # one number
    whole = np.ma.array([0.1, 0.2], mask=[False, False])
    assert sj.restitution(LAW, whole).coefficient.shape == (2,)
    with pytest.raises(ValueError, match="`chi` must be an unloading factor of zero or more"):
        sj.Zhou(STEEL, np.ma.array([1.0, 2.0], mask=[True, False]), 3.0, 0.5)


FORMULAS = {
    "empirical": lambda v: sj.empirical_restitution(v, 340.0, 3.0, 0.5),
    "thornton": lambda v: sj.thornton_restitution(STEEL, v),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_formulas_check_their_velocity(name):
    """NaN gave 1.0, and a list a bare TypeError."""
    formula = FORMULAS[name]
    for bad in (np.nan, -1.0, [1.0, -2.0], "a", None, np.inf):
        with pytest.raises(ValueError, match="`velocity` must be a finite impact velocity"):
            formula(bad)
    listed = np.asarray(formula([0.5, 1.0]))
    assert np.array_equal(listed, np.asarray(formula(np.array([0.5, 1.0]))))
    traced = jax.jit(formula)(jnp.array([0.5, -1.0, jnp.nan, jnp.inf]))
    assert traced[0] == pytest.approx(float(listed[0]), rel=1e-14)
    assert np.all(traced[1:] == 0)  # 0 is what tells under `jit`


def test_formulas_check_their_numbers():
    with pytest.raises(ValueError, match="`sigma` must be"):
        sj.empirical_restitution(1.0, 340.0, np.nan, 0.5)
    with pytest.raises(ValueError, match="`yield_factor` must be"):
        sj.thornton_restitution(STEEL, 1.0, yield_factor=-1.0)
    assert jax.jit(lambda s: sj.empirical_restitution(1.0, 340.0, s, 0.5))(-1.0) == 0
    assert jax.jit(lambda f: sj.thornton_restitution(STEEL, 1.0, f))(jnp.nan) == 0
    slope = jax.grad(lambda v: sj.thornton_restitution(STEEL, v).sum())
    assert np.all(np.isfinite(slope(jnp.array([0.5, -1.0, jnp.nan, 0.0]))))
