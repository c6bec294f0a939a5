"""Shapes: scalars, arrays of any shape, fields that broadcast against velocity, empty batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import RADIUS, fitted, pair

FIELDS = ("coefficient", "plastic_coefficient", "peak_overlap", "residual_overlap", "status")
FIELDS += ("ok",)


def close(one, two):
    for name in FIELDS:
        a, b = np.asarray(getattr(one, name)), np.asarray(getattr(two, name))
        assert a.shape == b.shape, name
        assert np.allclose(a, b, rtol=1e-13, atol=0), name


@pytest.mark.parametrize(
    "velocity", [3.0, 3, np.float64(3), np.int64(3), jnp.asarray(3.0)], ids=repr
)
def test_one_impact_is_a_scalar(velocity):
    result = sj.restitution(fitted("nylon"), velocity)
    for name in FIELDS:
        assert np.shape(getattr(result, name)) == (), name
    close(result, sj.restitution(fitted("nylon"), 3.0))


@pytest.mark.parametrize("shape", [(6, 1), (3, 1, 2)])
def test_any_shape(shape):
    velocity = np.linspace(0.1, 30.0, 6)
    law = fitted("nylon")
    flat = sj.restitution(law, velocity)
    shaped = sj.restitution(law, velocity.reshape(shape))
    for name in (*FIELDS, "duration"):
        assert getattr(shaped, name).shape == shape, name
        assert np.array_equal(getattr(shaped, name).ravel(), getattr(flat, name)), name


@pytest.mark.parametrize("route", [None, sj.ODE()], ids=["energy", "ode"])
@pytest.mark.parametrize("shape", [(0,), (3, 0)])
def test_no_impacts_at_all(shape, route):
    result = sj.restitution(fitted("nylon"), np.zeros(shape), route=route)
    for name in (*FIELDS, "duration"):
        assert getattr(result, name).shape == shape, name
    assert sj.restitution(fitted("nylon"), []).coefficient.shape == (0,)


def test_lists_and_whole_numbers():
    law = fitted("nylon")
    expected = sj.restitution(law, np.array([0.0, 1.0, 7.0]))
    close(sj.restitution(law, [0, 1, 7]), expected)
    close(sj.restitution(law, np.array([0, 1, 7])), expected)
    close(sj.restitution(law, jnp.array([0, 1, 7])), expected)
    close(sj.restitution(law, (0.0, 1, 7)), expected)


@pytest.mark.parametrize("route", [None, sj.ODE(rtol=1e-11)], ids=["energy", "ode"])
def test_another_material_radius_and_factor_for_each_impact(route):
    steel, nylon = sj.STAINLESS_STEEL, sj.NYLON
    both = jax.tree.map(lambda *leaves: np.array(leaves), steel, nylon)
    radii = np.array([0.001, 0.02, 0.3])[:, None]
    contact = sj.Contact.between_spheres(both, nylon, radii, 0.01)
    law = sj.Zhou(contact, chi=np.array([0.3, 0.6]), sigma=0.4, psi=0.5)
    together = sj.restitution(law, 5.0, route=route)
    assert together.coefficient.shape == (3, 2)
    for i, radius in enumerate(radii[:, 0]):
        for j, (material, chi) in enumerate(((steel, 0.3), (nylon, 0.6))):
            alone = sj.Contact.between_spheres(material, nylon, float(radius), 0.01)
            one = sj.restitution(sj.Zhou(alone, chi, 0.4, 0.5), 5.0)
            bound = 1e-13 if route is None else 1e-9
            assert together.coefficient[i, j] == pytest.approx(float(one.coefficient), abs=bound)
            assert together.status[i, j] == one.status


def test_vmap_over_laws_is_broadcasting():
    velocity = np.linspace(0.5, 20.0, 5)
    factors = jnp.array([0.1, 0.2, 0.4])
    contact = pair("nylon")

    def curve(chi):
        return sj.restitution(sj.Zhou(contact, chi, 0.4, 0.5), velocity).coefficient

    mapped = jax.vmap(curve)(factors)
    broadcast = sj.restitution(sj.Zhou(contact, factors[:, None], 0.4, 0.5), velocity).coefficient
    assert mapped.shape == (3, 5)
    assert np.allclose(mapped, broadcast, rtol=1e-13, atol=0)


def test_precision_is_that_of_the_arguments():
    law = jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), fitted("nylon"))
    for route in (None, sj.ODE()):
        result = sj.restitution(law, np.array([0.5, 5.0], np.float32), route=route)
        for name in FIELDS[:4]:
            assert getattr(result, name).dtype == np.float32, name
    assert sj.restitution(law, np.array([0.5, 5.0])).coefficient.dtype == np.float64


def test_python_numbers_take_the_precision_of_the_velocity():
    velocity = np.array([0.5, 5.0], np.float32)
    assert sj.restitution(fitted("nylon"), velocity).coefficient.dtype == np.float32


def test_jit_and_no_jit_agree():
    law, velocity = fitted("nylon"), np.array([0.0, 0.5, 5.0, 30.0, 3e3])
    close(jax.jit(sj.restitution)(law, velocity), sj.restitution(law, velocity))


@pytest.mark.long
def test_a_gradient_has_the_shape_of_the_law():
    law = fitted("nylon")
    slopes = jax.grad(lambda law: sj.restitution(law, jnp.array([5.0, 9.0])).coefficient.sum())(law)
    assert isinstance(slopes, sj.Zhou)
    assert slopes.chi < 0
    assert slopes.sigma < 0
    assert slopes.contact.limit_velocity > 0
    assert slopes.contact.radius.shape == ()
    assert law.contact.radius == RADIUS / 2


@pytest.mark.long
def test_what_is_constant_within_a_traced_function():
    """The law and the velocities take no part in what the caller differentiates and compiles."""
    law, velocity = fitted("nylon"), np.array([2.0, 5.0, 20.0])  # no size that programs have
    hit = sj.restitution(law, velocity)

    @jax.jit
    @jax.grad
    def slope(x):
        other = sj.restitution(law, velocity)
        return x * (other.coefficient.sum() + other.duration.sum())

    assert slope(2.0) == pytest.approx(float(hit.coefficient.sum() + hit.duration.sum()), rel=1e-14)
    large = np.full(300_000, 5.0)
    total = jax.jit(lambda x: x * sj.restitution(law, large, overlaps=False).coefficient[-1])(2.0)
    assert total == pytest.approx(2 * float(hit.coefficient[1]), rel=1e-14)


def test_lists_in_lists_of_traced_velocities():
    """By hand: ε² = k1/(k20 + s v √(k1 M))."""
    contact = fitted("nylon").contact
    law = sj.WaltonBraun(contact, 1e6, 2e6, 10.0)
    traced = jax.jit(lambda v: sj.restitution(law, [[v, 2 * v], [v, 3.0]]).coefficient)(1.0)
    velocity = np.array([[1.0, 2.0], [1.0, 3.0]])
    expected = np.sqrt(1e6 / (2e6 + 10.0 * velocity * np.sqrt(1e6 * contact.mass)))
    assert np.allclose(traced, expected, rtol=1e-14, atol=0)
    with pytest.raises(ValueError, match="`velocity` must be a finite impact velocity"):
        jax.jit(lambda v: sj.restitution(law, [[v], [v, v]]).coefficient)(1.0)
