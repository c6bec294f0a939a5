"""Thornton's law: published digits, closed form, both routes."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from softjax.laws.thornton import ReducedThornton
from tests import law_cases as lc
from tests.cases import pair

# e at V/V_y, Thornton, J. Appl. Mech. 64, 383 (1997), to four digits
RATIOS = np.array([1.5, 2, 5, 10, 50, 100, 1000])
PUBLISHED = np.array([0.9712, 0.9306, 0.7733, 0.6586, 0.4446, 0.3743, 0.2107])

LAW = sj.Thornton(lc.PAIR)
YIELD = float(LAW.scales().velocity)


def closed_form(
    youngs_modulus, radius, mass, yield_strength, limit_velocity, yield_factor, velocity
):
    """ε in mpmath's numbers, from the formulas as printed."""
    strain = mp.pi * yield_factor * yield_strength / (2 * youngs_modulus)
    stiffness = 4 * youngs_modulus * mp.sqrt(radius) / 3
    yields_at = mp.sqrt(4 * stiffness / (5 * mass)) * (radius * strain**2) ** mp.mpf("1.25")
    r = yields_at / velocity
    if r >= 1:
        return mp.mpf(1)
    bracket = r / (r + 2 * mp.sqrt(mp.mpf(6) / 5 - r**2 / 5))
    return mp.sqrt(6 * mp.sqrt(3) / 5) * mp.sqrt(1 - r**2 / 6) * bracket ** mp.mpf("0.25")


def test_published_digits():
    assert np.all(np.abs(sj.thornton_restitution(lc.PAIR, RATIOS * YIELD) - PUBLISHED) <= 5e-5)


@pytest.mark.parametrize("area", ["zhou", "hertz"])
def test_yields_where_hertz_does_whatever_the_contact_area(area):
    contact = pair("chrome steel", area)
    expected = pair("chrome steel", "hertz")
    scales = sj.Thornton(contact).scales()
    assert scales.velocity == expected.critical_velocity
    assert scales.overlap == expected.critical_overlap


def test_yields_where_the_contact_does_if_asked_to():
    law = sj.Thornton(lc.PAIR, area="contact")
    velocity = RATIOS * lc.PAIR.critical_velocity
    assert law.scales().velocity == lc.PAIR.critical_velocity
    assert np.allclose(sj.restitution(law, velocity).coefficient, PUBLISHED, rtol=0, atol=5e-5)
    found = sj.thornton_restitution(lc.PAIR, velocity, area="contact")
    assert np.allclose(found, PUBLISHED, rtol=0, atol=5e-5)


def test_yield_factor_moves_the_yield_velocity_with_its_power_of_5_halves():
    law = sj.Thornton(lc.PAIR, yield_factor=1.6)
    assert np.isclose(law.scales().velocity, 1.6**2.5 * YIELD, rtol=1e-14, atol=0)
    velocity = 1.6**2.5 * YIELD * RATIOS
    assert np.allclose(sj.restitution(law, velocity).coefficient, PUBLISHED, rtol=0, atol=5e-5)
    found = sj.thornton_restitution(lc.PAIR, velocity, yield_factor=1.6)
    assert np.allclose(found, PUBLISHED, rtol=0, atol=5e-5)


def test_energy_balance_is_the_closed_form():
    ratios = np.append(RATIOS, [1 + 1e-9, 1e6])
    result = sj.restitution(LAW, ratios * YIELD)
    expected = sj.thornton_restitution(lc.PAIR, ratios * YIELD)
    assert np.allclose(result.coefficient, expected, rtol=1e-14, atol=0)
    assert np.all(result.status == sj.Status.PLAIN)


def test_ode_is_the_closed_form():
    exact = sj.restitution(LAW, RATIOS * YIELD)
    result = sj.restitution(LAW, RATIOS * YIELD, lc.ODE)
    expected = sj.thornton_restitution(lc.PAIR, RATIOS * YIELD)
    assert np.allclose(result.coefficient, expected, rtol=0, atol=1e-9)
    assert np.allclose(result.peak_overlap, exact.peak_overlap, rtol=1e-9, atol=0)
    assert np.allclose(result.residual_overlap, exact.residual_overlap, rtol=1e-9, atol=0)
    assert np.all(result.status == sj.Status.PLAIN)


def test_elastic_up_to_yield():
    velocity = YIELD * np.array([1e-6, 0.5, 1.0])
    result = sj.restitution(LAW, velocity)
    assert np.all(result.coefficient == 1)
    assert np.all(result.status == sj.Status.ELASTIC)
    assert np.all(sj.thornton_restitution(lc.PAIR, velocity) == 1)


def test_works_are_those_of_the_forces():
    lc.assert_works_are_those_of_the_forces(ReducedThornton(), [1.001, 4.0, 300.0])


def test_unloading_starts_at_the_peak_and_ends_at_the_residual_overlap():
    result = sj.restitution(LAW, 20 * YIELD)
    peak, residual = result.peak_overlap, result.residual_overlap
    assert np.isclose(LAW.unloading_force(peak, peak), LAW.loading_force(peak), rtol=1e-14)
    below = residual * (1 - jnp.array([0.0, 1e-3, 1.0]))
    assert np.allclose(LAW.unloading_force(below, peak) / LAW.loading_force(peak), 0, atol=1e-20)
    assert LAW.unloading_force(residual * 1.001, peak) > 0


def test_loop_is_the_energy_lost():
    velocity = 20 * YIELD
    result = sj.restitution(LAW, velocity)
    peak, residual = float(result.peak_overlap), float(result.residual_overlap)
    first = float(LAW.scales().overlap)
    loading = lc.work_between(LAW.loading_force, 0.0, first)
    loading += lc.work_between(LAW.loading_force, first, peak)
    unloading = lc.work_between(lambda x: LAW.unloading_force(x, peak), residual, peak)
    impact = 0.5 * lc.PAIR.mass * velocity**2
    assert np.isclose(loading / impact, 1, rtol=0, atol=1e-12)
    assert np.isclose(unloading / impact, result.coefficient**2, rtol=0, atol=1e-12)


def test_history():
    velocity = np.array([0.5, 20.0]) * YIELD
    hit = sj.collide(LAW, velocity, samples=2001, route=lc.ODE)
    expected = sj.restitution(LAW, velocity)
    impact = 0.5 * lc.PAIR.mass * velocity**2
    lost = 1 - np.square(expected.coefficient)
    assert np.allclose(lc.loop_area(hit) / impact, lost, rtol=0, atol=1e-6)
    assert np.allclose(hit.velocity[:, -1], -expected.coefficient * velocity, rtol=1e-8, atol=0)
    assert np.allclose(hit.duration, expected.duration, rtol=1e-8, atol=0)
    assert np.allclose(hit.overlap[:, 1000], expected.peak_overlap, rtol=1e-9, atol=0)


@pytest.mark.parametrize(("route", "tolerance"), [(None, 1e-9), (lc.ODE, 1e-6)])
def test_gradients(route, tolerance):
    law = sj.Thornton(lc.PAIR, yield_factor=1.3)
    velocity = float(law.scales().velocity) * np.array([0.4, 1.2, 30.0])
    found, _, slopes = lc.derivatives(law, velocity, route)
    assert np.allclose(found, sj.thornton_restitution(lc.PAIR, velocity, 1.3), rtol=0, atol=1e-9)
    lc.assert_slopes(slopes, lc.differences(closed_form, law, velocity), tolerance)


def test_gradients_of_the_formula():
    law = sj.Thornton(lc.PAIR, yield_factor=1.3)
    velocity = float(law.scales().velocity) * np.array([0.4, 1.2, 30.0])
    expected = lc.differences(closed_form, law, velocity)
    each = jax.vmap(jax.grad(sj.thornton_restitution, argnums=(0, 1, 2)), (None, 0, None))
    by_contact, by_velocity, by_factor = each(lc.PAIR, jnp.asarray(velocity), 1.3)
    slopes = {name: getattr(by_contact, name) * getattr(lc.PAIR, name) for name in lc.LEAVES}
    slopes |= {"velocity": by_velocity * velocity, "yield_factor": by_factor * 1.3}
    lc.assert_slopes(slopes, expected, 1e-13)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_hard_velocities(dtype):
    found, _ = lc.assert_survives(LAW, dtype=dtype, least=1e-30)
    exact = sj.thornton_restitution(lc.PAIR, np.array([1e-30, 1e-6, 1.0, 1e5]))
    assert np.allclose(found[1:], exact, rtol=8 * np.finfo(dtype).eps, atol=0)
    rest = jax.value_and_grad(sj.thornton_restitution, argnums=1)(lc.PAIR, dtype(0))
    assert rest == (1, 0)


def test_traced_failures():
    lc.assert_traced_failures(LAW, "yield_factor", -1.0)


def test_wrong_input_is_named():
    lc.assert_contact_refused(LAW)
    wrong = (0.0, -1.0, np.nan, np.inf, "1", None, [1.0, -1.0])
    lc.assert_refused(lambda a: sj.Thornton(lc.PAIR, a), "yield_factor", *wrong)
    lc.assert_refused(lambda a: sj.Thornton(lc.PAIR, area=a), "area", "zhou", None, 1)
    for make in (sj.thornton_restitution, lambda c, v: sj.restitution(sj.Thornton(c), v)):
        lc.assert_refused(lambda v, f=make: f(lc.PAIR, v), "velocity", -1.0, np.nan, "fast")
    lc.assert_refused(lambda c: sj.thornton_restitution(c, 1.0), "contact", None, LAW)
    with pytest.raises(ValueError, match="shapes must broadcast"):
        sj.restitution(sj.Thornton(lc.PAIR, yield_factor=np.ones(3)), np.ones(2))


@pytest.mark.parametrize(
    ("dtype", "most", "bound"), [(np.float64, 150, 1e-13), (np.float32, 16, 2e-6)]
)
def test_far_beyond_yield(dtype, most, bound):
    """The closed form and its slope in 40 digits, up to where squares of v/V_y are no numbers."""
    velocity = (10.0 ** np.linspace(1, most, 6)).astype(dtype)
    yields = mp.mpf(float(LAW.elastic_velocity()))

    def formula(v):
        r = yields / v
        root = mp.sqrt(mp.mpf(6) / 5 - r * r / 5)
        return root * (3 * r / (r + 2 * root)) ** mp.mpf(0.25)

    with mp.workdps(40):
        exact = [formula(mp.mpf(float(v))) for v in velocity]
        steep = [mp.diff(lambda t: mp.log(formula(mp.exp(t))), mp.log(float(v))) for v in velocity]
    law = jax.tree.map(dtype, LAW)
    value, slope = jax.vmap(jax.value_and_grad(lambda v: sj.restitution(law, v).coefficient))(
        jnp.asarray(velocity)
    )
    assert value.dtype == dtype
    assert np.allclose(value, np.array(exact, float), rtol=bound, atol=0)
    assert np.allclose(slope * velocity / value, np.array(steep, float), rtol=bound, atol=0)
    far = dtype(np.finfo(dtype).max / 10)
    value, slope = jax.value_and_grad(lambda v: sj.restitution(law, v).coefficient)(far)
    assert (value, slope) == (0, 0)
