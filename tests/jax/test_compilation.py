"""Which calls compile: new shapes and static choices, no new numbers; nothing computes a hidden NaN."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import mostly_long, pair
from tests.laws import LAWS

NYLON = pair("nylon")
SPRING = sj.LinearSpringDashpot(NYLON, 1e6, 0.6)  # soon compiled by time


@pytest.fixture(scope="module", autouse=True)
def nothing_is_compiled_yet():
    """Whatever other tests did in this process before."""
    jax.clear_caches()


def everything(law, velocity, route=None):
    result = sj.restitution(law, velocity, route)
    return result.coefficient, result.duration, result.ok


OF_STATUS = {"jit(equal)", "jit(bitwise_or)", "jit(bitwise_and)"}


def test_the_same_shapes_compile_once(compiled):
    """Other numbers, velocities and materials; batches of up to 16 share one program, 17 need another."""
    velocity = np.linspace(1.0, 20.0, 7)
    everything(sj.Thornton(NYLON), velocity)
    assert compiled
    compiled.clear()
    for chi in (0.3, 0.4, 0.5):
        everything(sj.Thornton(NYLON, chi), velocity + chi)
        everything(sj.Thornton(pair("stainless steel"), chi), velocity[::-1])
        everything(sj.Thornton(NYLON), velocity * 10.0 ** -np.arange(7.0))  # some elastic
    for count in (2, 5, 16):  # `ok` compares for each
        everything(sj.Thornton(NYLON), np.linspace(1.0, 20.0, count))
    assert set(compiled) <= OF_STATUS
    compiled.clear()
    everything(sj.Thornton(NYLON), np.linspace(1.0, 20.0, 17))
    large = [name for name in compiled if name not in OF_STATUS]
    assert len(large) >= 2, compiled  # the value's and the duration's, so that the count can count


def test_another_tolerance_is_no_other_program(compiled):
    """It acts all the same: the looser one errs more."""
    velocity = np.linspace(1.0, 20.0, 3)
    found = {}
    for rtol in (1e-12, 1e-6, 1e-9):
        everything(SPRING, velocity / 2, sj.ODE(rtol=rtol))
        found[rtol] = everything(SPRING, velocity, sj.ODE(rtol=rtol))
        before = len(compiled)
        compiled.clear()
        assert before > 0 if len(found) == 1 else before == 0
    exact = sj.restitution(SPRING, velocity).coefficient
    errors = [np.max(np.abs(found[rtol][0] - exact)) for rtol in (1e-12, 1e-9, 1e-6)]
    assert errors[0] < 1e-12 < errors[1] < errors[2] < 1e-5


def test_a_traced_tolerance(compiled):
    """As an argument of the caller's program, in a route and alone under `vmap`; what it gives lasts as it should."""
    velocity = np.linspace(1.0, 20.0, 3)
    exact = sj.restitution(SPRING, velocity)

    def total(rtol):
        hit = sj.restitution(SPRING, velocity, sj.ODE(rtol=rtol))
        return hit.coefficient.sum(), hit

    @jax.jit
    def of(route):
        def lasting(stiffness):
            hit = sj.restitution(replace(SPRING, stiffness=stiffness), velocity, route)
            return hit.duration, hit

        return jax.jvp(lasting, (1e6,), (1e6,), has_aux=True)

    lasts, slope, strict = of(sj.ODE(rtol=1e-12))
    compiled.clear()
    *_, loose = of(sj.ODE(rtol=1e-6))
    assert compiled == []
    each = jax.jit(jax.vmap(jax.grad(total, has_aux=True)))
    slopes, at_once = each(np.array([1e-12, 1e-6, np.nan]))
    assert np.allclose(at_once.coefficient[1], loose.coefficient, rtol=0, atol=1e-14)
    assert 1e-9 < np.max(np.abs(loose.coefficient - exact.coefficient)) < 1e-5
    assert np.allclose(strict.coefficient, exact.coefficient, rtol=0, atol=1e-12)
    assert np.allclose(lasts, exact.duration, rtol=1e-11, atol=0)
    assert np.allclose(slope, -exact.duration / 2, rtol=1e-9, atol=0)  # T ∝ K^-1/2
    assert np.all(at_once.status[2] == sj.Status.SOLVER_FAILED)
    assert np.all(slopes == 0)


def test_a_history_compiles_one_program(compiled):
    """And another of the same shape none."""
    velocity = np.linspace(0.1, 3.0, 5)
    sj.collide(sj.Thornton(NYLON), velocity, samples=13).time.block_until_ready()
    assert 0 < len(compiled) <= 4
    compiled.clear()
    sj.collide(sj.Thornton(NYLON, 0.4), 2 * velocity, samples=13).time.block_until_ready()
    assert compiled == []


def test_derivatives_under_the_callers_jit_compile_once(compiled):
    slope = jax.jit(jax.grad(lambda law, v: sj.restitution(law, v).coefficient.sum()))
    velocity = jnp.linspace(0.0, 20.0, 7)
    faster = velocity + 1
    slope(sj.Thornton(NYLON), velocity)
    compiled.clear()
    slope(sj.Thornton(NYLON, 0.4), faster)
    assert compiled == []


WAYS = [("thornton", None), ("zhou", None), ("zhou full", None), ("zhou", sj.ODE())]


@mostly_long("name, route", WAYS)
def test_no_nan_is_made_and_hidden(name, route):
    """A core of everything once more while JAX looks into what each compiled function gives."""
    law = LAWS[name].law
    ratios = jnp.array([0.0, 1e-30, 0.5, 1.0, 1.0 + 1e-15, 1.001, 3.0, 40.0, 300.0, 2e3])
    velocity = ratios * law.elastic_velocity()

    def total(law, velocity):
        return sj.restitution(law, velocity, route=route).coefficient.sum()

    with jax.debug_nans(True):
        result = sj.restitution(law, velocity, route=route)
        assert np.all(np.isfinite(result.coefficient))
        assert np.all(np.isfinite(result.duration))
        slopes = jax.grad(total, (0, 1))(law, velocity)
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))
        with pytest.raises(FloatingPointError):  # so that one would be found
            jnp.log(jnp.array(-1.0)).block_until_ready()


class SI(sj.RateIndependentLaw):
    """Forces that say nothing of mass, yield strength and limit velocity."""

    contact: sj.Contact
    stiffness: float

    def loading_force(self, overlap):
        return self.stiffness * overlap**1.5

    def unloading_force(self, overlap, peak_overlap):
        return self.stiffness * overlap**2 / peak_overlap**0.5


def test_numbers_that_no_force_names_cost_no_derivative():
    """ε² = 5/6 whatever they are; the traced derivative is hardly longer than the value."""
    law = SI(pair("nylon"), 1e9)

    def lengths(name):
        """Of the program of the value, and of that with a derivative."""

        def total(x):
            values = law.contact.leaves() | {"stiffness": law.stiffness} | {name: x}
            stiffness = values.pop("stiffness")
            found = sj.restitution(SI(sj.Contact(**values), stiffness), jnp.ones(4))
            return found.coefficient.sum()

        at = jnp.asarray((law.contact.leaves() | {"stiffness": 1e9})[name])
        along = lambda x: jax.jvp(total, (x,), (1.0,))  # noqa: E731
        return [len(str(jax.make_jaxpr(f)(at))) for f in (total, along)]

    value, slope = lengths("yield_strength")
    assert slope < 1.1 * value
    value, slope = lengths("stiffness")
    assert slope > 1.3 * value
    assert sj.restitution(law, 1.0).coefficient ** 2 == pytest.approx(5 / 6, rel=1e-12)
