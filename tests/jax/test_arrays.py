"""Shapes, kinds of numbers, precision, `jit` and `vmap`: the same impact means the same everywhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import mostly_long, pair
from tests.laws import LAWS, QUANTITIES, numbers, with_numbers

FIELDS = ("coefficient", "plastic_coefficient", "peak_overlap", "residual_overlap", "status", "ok")
SPRING = LAWS["walton-braun"].law


def assert_alike(one, two):
    for name in FIELDS:
        a, b = np.asarray(getattr(one, name)), np.asarray(getattr(two, name))
        assert a.shape == b.shape, name
        assert np.allclose(a, b, rtol=1e-13, atol=0), name


KINDS = [2, 2.0, np.int32(2), np.float64(2.0), np.array(2), jnp.array(2), jnp.array(2.0)]


def test_kinds_of_numbers_and_lists():
    """Integers and floats of Python, NumPy and JAX mean the same, traced ones in float64 too."""
    law = SPRING
    alone = sj.restitution(law, np.array([2.0]))
    traced = jax.jit(lambda v: sj.restitution(law, v).coefficient)
    for velocity in KINDS:
        result = sj.restitution(law, velocity)
        for name in FIELDS:
            value = getattr(result, name)
            assert np.shape(value) == ()
            assert float(value) == pytest.approx(float(getattr(alone, name)[0]), rel=1e-15), name
        assert traced(velocity).dtype == result.coefficient.dtype == np.float64
        assert float(traced(velocity)) == pytest.approx(float(alone.coefficient[0]), rel=1e-15)
        assert sj.restitution(law, [velocity, 2]).coefficient.shape == (2,)
    expected = sj.restitution(law, np.array([0.0, 1.0, 7.0]))
    for some in ([0, 1, 7], np.array([0, 1, 7]), jnp.array([0, 1, 7]), (0.0, 1, 7)):
        assert_alike(sj.restitution(law, some), expected)


@pytest.mark.parametrize("shape", [(6, 1), (3, 1, 2)])
def test_any_shape(shape):
    law, velocity = SPRING, np.linspace(0.1, 30.0, 6)
    flat, shaped = sj.restitution(law, velocity), sj.restitution(law, velocity.reshape(shape))
    for name in (*FIELDS, "duration"):
        assert getattr(shaped, name).shape == shape, name
        assert np.array_equal(getattr(shaped, name).ravel(), getattr(flat, name)), name


def test_no_impacts_at_all():
    law = SPRING
    for shape in ((0,), (3, 0)):
        result = sj.restitution(law, np.zeros(shape))
        for name in (*FIELDS, "duration"):
            assert getattr(result, name).shape == shape, name
        slopes = jax.grad(lambda v: sj.restitution(law, v).coefficient.sum())
        assert slopes(np.zeros(shape)).shape == shape
    assert sj.restitution(law, []).coefficient.shape == (0,)


def test_another_material_radius_and_factor_for_each_impact():
    steel, nylon = sj.STAINLESS_STEEL, sj.NYLON
    both = jax.tree.map(lambda *leaves: np.array(leaves), steel, nylon)
    radii, chi = np.array([0.001, 0.02, 0.3]), np.array([0.3, 0.6])
    contact = sj.Contact.between_spheres(both, nylon, radii[:, None], 0.01)
    together = sj.restitution(sj.Thornton(contact, chi), 5.0)
    assert together.coefficient.shape == (3, 2)
    for i, radius in enumerate(radii):
        for j, material in enumerate((steel, nylon)):
            alone = sj.Contact.between_spheres(material, nylon, float(radius), 0.01)
            one = sj.restitution(sj.Thornton(alone, float(chi[j])), 5.0)
            assert together.coefficient[i, j] == pytest.approx(float(one.coefficient), abs=1e-13)
            assert together.status[i, j] == one.status


@mostly_long("name", LAWS, ("thornton", "hertz dashpot to zero-force", "eq. 17"))
def test_vmap_and_jit_are_what_arrays_are(name):
    """Over laws and velocities at once, along either axis, with durations."""
    case = LAWS[name]
    field = next(iter(numbers(case.law)))
    factors = np.array([0.8, 1.0])
    values = numbers(case.law)

    def of(factor, v):
        law = with_numbers(case.law, values | {field: values[field] * factor})
        hit = sj.restitution(law, v)
        return jnp.stack([getattr(hit, quantity) for quantity in QUANTITIES])

    outer = jax.jit(jax.vmap(jax.vmap(of, (None, 0)), (0, None)))
    mapped = outer(factors, jnp.asarray(case.velocity))
    array = of(factors[:, None], case.velocity)
    assert mapped.shape == (2, len(case.velocity), 4)
    assert np.allclose(np.moveaxis(mapped, -1, 0), array, rtol=1e-12, atol=1e-300)


def test_results_may_leave_vmap_and_be_read_there():
    """Of fewer laws than velocities: `duration` and `ok` go along the law's own axis."""
    contact, velocity = pair("stainless steel"), np.array([0.1, 0.5, 2.0])
    growth = np.array([10.0, 1e3])

    def of(growth):
        return sj.restitution(sj.WaltonBraun(contact, 1e6, 2e6, growth), velocity)

    stiffness = 2e6 + growth[:, None] * velocity * np.sqrt(1e6 * contact.mass)
    exact = 0.5 * np.pi * np.sqrt(contact.mass) * (1e-3 + stiffness**-0.5)
    outside = jax.vmap(of)(growth)
    assert np.allclose(outside.duration, exact, rtol=1e-12)
    across = jax.jit(jax.vmap(of, out_axes=1))(growth)
    assert np.allclose(across.duration, exact.T, rtol=1e-12)
    assert np.array_equal(across.ok, outside.ok.T)


def test_precision_is_that_of_the_arguments():
    """Of arrays; Python's numbers take that of the velocity."""
    velocity = np.array([0.5, 5.0], np.float32)
    short = jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), SPRING)
    for law in (short, SPRING):
        result = sj.restitution(law, velocity)
        for name in FIELDS[:4]:
            assert getattr(result, name).dtype == np.float32, name
    assert sj.restitution(short, velocity.astype(float)).coefficient.dtype == np.float64


def test_what_is_constant_within_a_traced_function():
    """The law and the velocities take no part in what the caller differentiates and compiles."""
    law, velocity = SPRING, np.array([2.0, 5.0, 20.0])
    hit = sj.restitution(law, velocity)

    @jax.jit
    @jax.grad
    def slope(x):
        other = sj.restitution(law, velocity)
        return x * (other.coefficient.sum() + other.duration.sum())

    assert slope(2.0) == pytest.approx(float(hit.coefficient.sum() + hit.duration.sum()), rel=1e-14)


def test_lists_in_lists_of_traced_velocities():
    """By hand: ε² = k1/(k20 + s v √(k1 M))."""
    contact = pair("nylon")
    law = sj.WaltonBraun(contact, 1e6, 2e6, 10.0)
    traced = jax.jit(lambda v: sj.restitution(law, [[v, 2 * v], [v, 3.0]]).coefficient)(1.0)
    velocity = np.array([[1.0, 2.0], [1.0, 3.0]])
    expected = np.sqrt(1e6 / (2e6 + 10.0 * velocity * np.sqrt(1e6 * contact.mass)))
    assert np.allclose(traced, expected, rtol=1e-14, atol=0)


def test_an_array_that_is_written_again():
    """A result owns what it was made of, though the computation is dispatched asynchronously."""
    steel, count = pair("stainless steel"), 1000
    plain = sj.WaltonBraun(steel, 1e6, 2e6, 10.0)
    velocity, growth = np.empty(count), np.full(count, 10.0)
    law = sj.WaltonBraun(steel, 1e6, 2e6, growth)
    results = []
    for k in range(10):
        velocity[:] = 0.5 * (k + 1)
        results.append(sj.restitution(law, velocity))
        growth[:] = 10.0 + k  # the law took a copy: nothing of it reaches a result
    velocity[:] = np.nan
    for k, result in enumerate(results):
        alone = sj.restitution(plain, 0.5 * (k + 1))
        assert np.allclose(result.coefficient, alone.coefficient, rtol=1e-14, atol=0)
        assert np.all(result.velocity == 0.5 * (k + 1))
        assert np.all(result.law.growth == 10.0)
    assert np.allclose(results[3].duration, sj.restitution(plain, 2.0).duration, rtol=1e-14)
