"""Laws that give only their forces take the same routes, and closed forms agree with the forces."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from softjax.laws.zhou import FirstOrder, Full
from tests.cases import FITTED, FORMS, collide, compiled_soon, fitted, pair
from tests.oracles import zhou_mp

CLOSED = {"first-order": FirstOrder, "full": Full}


class Forces(sj.ReducedRateIndependent):
    """A law of Zhou's two forms stripped of everything but its forces."""

    d: jax.Array
    X: jax.Array
    form: str = eqx.field(static=True)

    def closed(self):
        return CLOSED[self.form](self.d, self.X)

    def loading(self, x):
        return self.closed().loading(x)

    def unloading(self, x, peak):
        return self.closed().unloading(x, peak)

    def end(self):
        return jax.lax.stop_gradient(self.closed().end())


class ZhouByForces(sj.RateIndependentLaw):
    """The same law in SI units."""

    contact: sj.Contact
    chi: jax.Array
    form: str = eqx.field(static=True, default="first-order")

    def scales(self):
        return sj.Scales(self.contact.critical_overlap, self.contact.critical_velocity)

    def reduced(self):
        d = 1.5 * self.contact.yield_strain**2 / self.contact.area_factor
        return Forces(jnp.asarray(d), jnp.asarray(self.chi * self.contact.yield_ratio), self.form)


class Spring(sj.ReducedRateIndependent):
    """p = (4/5) x up to x = 1, twice as stiff from there, and thrice on unloading."""

    work_exponent = 2.0

    def loading(self, x):
        return 0.8 * jnp.where(x > 1, 2 * x - 1, x)

    def unloading(self, x, peak):
        return 2.4 * (x - peak) + self.loading(peak)


class SpringLaw(sj.RateIndependentLaw):
    contact: sj.Contact

    def scales(self):
        return sj.Scales(1e-4, 0.5)

    def reduced(self):
        return Spring()


class Sticky(sj.ReducedRateDependent):
    """Hertz's force and one of the velocity alone."""

    ends_at: str = eqx.field(static=True, default="zero-overlap")

    def dissipative(self, x, velocity):
        return 0.1 * velocity


class StickyLaw(sj.RateDependentLaw):
    contact: sj.Contact

    def scales(self):
        return sj.Scales(1e-4, 0.5)

    def reduced(self):
        return Sticky()


RATIOS = np.array([0.4, 1.05, 1.5, 3.0, 10.0, 40.0])
NUMBERS = ("coefficient", "peak_overlap", "residual_overlap")


@pytest.mark.parametrize(
    ("form", "route"),
    [
        ("first-order", None),
        pytest.param("full", None, marks=pytest.mark.long),
        ("first-order", sj.ODE(rtol=1e-11)),
    ],
    ids=["first-order", "full", "ode"],
)
def test_a_law_of_forces_alone_agrees_with_the_closed_forms(form, route):
    contact, chi = pair("nylon"), FITTED["nylon"]["chi"]
    velocity = RATIOS * contact.critical_velocity
    closed = sj.Zhou(contact, chi, sigma=0.0, psi=1.0, form=form)
    forces = ZhouByForces(contact, chi, form)
    expected = sj.restitution(closed, velocity)
    found = sj.restitution(forces, velocity, route=route)
    for name in NUMBERS:
        one, two = getattr(found, name), getattr(expected, name)
        assert np.allclose(one, two, rtol=1e-9, atol=1e-9 * np.max(two)), name
    assert np.allclose(found.duration, expected.duration, rtol=1e-8, atol=0)
    plain = ~int(sj.Status.BEYOND_EXPANSION)
    assert np.array_equal(found.status & plain, expected.status & plain)


@pytest.mark.parametrize(
    "route",
    [None, pytest.param(sj.ODE(rtol=1e-11), marks=pytest.mark.long)],
    ids=["energy", "ode"],
)
def test_its_derivatives_agree_too(route):
    form, contact = "first-order", pair("nylon")
    velocity = jnp.asarray(RATIOS * contact.critical_velocity)

    def quadrature(chi, velocity):
        return sj.restitution(ZhouByForces(contact, chi, form), velocity, route=route).coefficient

    def closed(chi, velocity):
        return sj.restitution(sj.Zhou(contact, chi, 0.0, 1.0, form), velocity).coefficient

    chi = jnp.full(len(RATIOS), FITTED["nylon"]["chi"])
    ones = jnp.ones_like(velocity)
    along = compiled_soon(lambda t: jax.jvp(quadrature, (chi, velocity), t)[1])
    exactly = compiled_soon(lambda t: jax.jvp(closed, (chi, velocity), t)[1])
    for tangent in ((ones * chi, 0 * ones), (0 * ones, velocity)):
        assert np.allclose(along(tangent), exactly(tangent), rtol=0, atol=1e-8)
    reverse = compiled_soon(jax.grad(lambda *a: quadrature(*a).sum(), (0, 1)))(chi, velocity)
    expected = compiled_soon(jax.grad(lambda *a: closed(*a).sum(), (0, 1)))(chi, velocity)
    assert np.allclose(reverse[0] * chi, expected[0] * chi, rtol=0, atol=1e-8)
    assert np.allclose(reverse[1] * velocity, expected[1] * velocity, rtol=0, atol=1e-8)


@pytest.mark.parametrize("route", [None, sj.ODE(rtol=1e-11)], ids=["energy", "ode"])
def test_a_law_of_its_own(route):
    """Two straight lines, by hand: W_L = (2/5)(2x² - 2x + 1), W_U = p_m²/(2·2.4)."""
    law = SpringLaw(pair("nylon"))
    y = np.array([0.5, 1.5, 4.0])
    peak = np.where(y > 1, 0.5 * (1 + np.sqrt(np.maximum(2 * y**2 - 1, 0))), y)
    force = np.where(y > 1, 0.8 * (2 * peak - 1), 0.8 * peak)
    returned = np.where(y > 1, force**2 / 4.8 / (0.4 * y**2), 1.0)
    result = sj.restitution(law, 0.5 * y, route=route)
    assert np.allclose(result.peak_overlap, 1e-4 * peak, rtol=1e-10, atol=0)
    assert np.allclose(result.coefficient**2, returned, rtol=1e-9, atol=0)
    residual = np.where(y > 1, peak - force / 2.4, 0.0)
    assert np.allclose(result.residual_overlap, 1e-4 * residual, rtol=1e-9, atol=1e-13)
    # x'' = -x, then -(2x - 1), then -3 (x - x*): arcs of a circle each
    soft, stiff, back = 1.0, np.sqrt(2.0), np.sqrt(3.0)
    on_loading = np.arcsin(1 / y[1:]) / soft
    beyond = np.arctan(np.sqrt(y[1:] ** 2 - 1) * stiff) / stiff
    time = on_loading + beyond + 0.5 * np.pi / back
    assert np.allclose(result.duration[1:], time * 1e-4 / 0.5, rtol=1e-8, atol=0)
    assert result.duration[0] == pytest.approx(np.pi * 1e-4 / 0.5, rel=1e-12)


def test_a_rate_dependent_law_has_no_energy_balance():
    with pytest.raises(ValueError, match=r"`route` must be ODE\(...\) for StickyLaw"):
        sj.restitution(StickyLaw(pair("nylon")), 1.0, route=sj.EnergyBalance())


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("d", [1e-5, 6.7e-3, 0.3])
def test_forces_and_works(form, d):
    law = CLOSED[form](jnp.asarray(d), jnp.asarray(7.6))
    end = min(float(law.end()), 80.0)
    x = jnp.asarray([0.0, 0.3, 0.999, 1.001, *np.linspace(1.2, 0.99 * end, 12)])
    exact = [float(zhou_mp.loading(form, d, float(value))) for value in x]
    assert np.allclose(law.loading(x), exact, rtol=1e-12, atol=1e-13)
    peak = jnp.asarray(0.7 * end + 0.3)
    scale = float(law.unloading(peak, peak))
    back = np.linspace(0.01, 0.6, 7) * peak
    exact = [zhou_mp.unloading(form, d, 7.6, float(peak), float(peak - b)) for b in back]
    found = law.unloading(peak - back, peak)
    assert np.allclose(found, [float(force) for force in exact], rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("form", FORMS)
def test_the_loop_encloses_the_plastic_loss(form):
    """∮ P dδ = ½ M v² (1 - ε_p²), from the law's forces in SI units by quadrature."""
    law = fitted("nylon", form)
    velocity = 20 * law.contact.critical_velocity
    result = sj.restitution(law, velocity)
    peak, residual = float(result.peak_overlap), float(result.residual_overlap)
    nodes, weights = np.polynomial.legendre.leggauss(200)

    def work(force, low, high):
        # in the root of the overlap, in which both branches are smooth
        start, width = np.sqrt(low), np.sqrt(high) - np.sqrt(low)
        root = start + 0.5 * width * (nodes + 1)
        return 0.5 * width * np.sum(weights * 2 * root * np.asarray(force(root**2)))

    critical = float(law.contact.critical_overlap)
    loaded = work(law.loading_force, 0.0, critical) + work(law.loading_force, critical, peak)
    returned = work(lambda x: law.unloading_force(x, peak), residual, peak)
    impact = 0.5 * law.contact.mass * velocity**2
    assert loaded == pytest.approx(impact, rel=1e-11)
    loss = impact * (1 - float(result.plastic_coefficient) ** 2)
    assert loaded - returned == pytest.approx(loss, rel=1e-10)


def test_forces_are_hertz_below_yield():
    """P = k δ^{3/2}, and both branches meet at the peak."""
    law = fitted("chrome steel")
    overlap = np.array([0.0, 0.2, 0.9]) * law.contact.critical_overlap
    assert np.allclose(law.loading_force(overlap), law.contact.stiffness * overlap**1.5, rtol=1e-12)
    peak = 5 * law.contact.critical_overlap
    both = law.loading_force(peak), law.unloading_force(peak, peak)
    assert both[0] == pytest.approx(float(both[1]), rel=1e-13)


def test_a_law_without_closed_forms_is_told_where_loading_ends():
    contact = pair("nylon")
    law = ZhouByForces(contact, 0.2)
    result = sj.restitution(law, np.array([0.4, 10.0, 2e3]) * contact.critical_velocity)
    assert list(result.status & int(sj.Status.NO_TURNING_POINT) > 0) == [False, False, True]
    outcome = collide(law.reduced(), jnp.asarray([10.0, 2e3]))
    assert list(outcome.turns) == [True, False]
    assert outcome.plastic_squared[1] == 0
