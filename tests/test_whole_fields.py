"""Fields that are whole: a network's weights and a table's knots beside numbers of each impact."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import beta

import softjax as sj
from softjax.laws.zhou import FirstOrder
from tests.cases import compiled_soon, fitted, pair

STEEL = pair("stainless steel", area="hertz")
VELOCITY = np.array([0.05, 0.4, 3.0])
KNOTS = np.array([0.0, 0.2, 0.5, 1.0])
HEIGHTS = np.array([0.0, 0.05, 0.3, 1.0])


class Tabled(sj.RateIndependentLaw):
    """Back along a table of force over overlap, both relative to the peak."""

    contact: sj.Contact
    stiffness: float
    knots: jax.Array = sj.array_field()
    heights: jax.Array = sj.array_field()

    def loading_force(self, overlap):
        return self.stiffness * overlap

    def unloading_force(self, overlap, peak_overlap):
        share = jnp.interp(overlap / peak_overlap, self.knots, self.heights)
        return self.loading_force(peak_overlap) * share


class Networked(sj.RateIndependentLaw):
    """Back along s^2 times what a network makes of s and the peak."""

    contact: sj.Contact
    stiffness: float
    network: eqx.nn.MLP = sj.array_field()

    def loading_force(self, overlap):
        return self.stiffness * overlap

    def unloading_force(self, overlap, peak_overlap):
        s = overlap / peak_overlap
        bend = jnp.tanh(self.network(jnp.stack([s, peak_overlap / 1e-4])))
        return self.loading_force(peak_overlap) * s**2 * (1 + 0.5 * (1 - s) * bend)


TABLE = Tabled(STEEL, 1e6, KNOTS, HEIGHTS)
NETWORK = Networked(
    STEEL, 1e6, eqx.nn.MLP(2, "scalar", 8, 1, jax.nn.softplus, key=jax.random.key(0))
)


def squared_by_trapezoids(heights):
    """∫ of the table over its width: ε² = 2 × that."""
    return 2 * np.sum(0.5 * np.diff(KNOTS) * (heights[1:] + heights[:-1]))


def squared_by_gauss(law, peak):
    nodes, weights = np.polynomial.legendre.leggauss(60)
    x = 0.5 * peak * (nodes + 1)
    force = jax.vmap(lambda x: law.unloading_force(x, peak))(x)
    return 0.5 * peak * np.sum(weights * force) / (0.5 * 1e6 * peak**2)


def test_a_table_is_whole_whatever_the_batch():
    """Its kinks move with the peak and are not declared: 1e-9, or told."""
    exact = squared_by_trapezoids(HEIGHTS)
    for velocity in (0.4, VELOCITY, VELOCITY[:2, None] * np.ones(3)):
        result = sj.restitution(TABLE, velocity)
        assert result.coefficient.shape == np.shape(velocity)
        off = np.abs(np.asarray(result.coefficient) ** 2 - exact)
        assert np.all((off < 1e-9) | (np.asarray(result.status) & sj.Status.INEXACT > 0))
        assert np.all(off < 1e-3)


def test_a_network_by_both_routes():
    exact = sj.restitution(NETWORK, VELOCITY)
    peak = np.asarray(exact.peak_overlap)
    expected = [squared_by_gauss(NETWORK, x) for x in peak]
    assert np.allclose(exact.coefficient**2, expected, rtol=1e-10, atol=0)
    by_time = sj.restitution(NETWORK, VELOCITY, route=sj.ODE(rtol=1e-10))
    assert np.allclose(by_time.coefficient, exact.coefficient, rtol=1e-8, atol=0)
    assert np.allclose(by_time.duration, exact.duration, rtol=1e-7, atol=0)
    assert np.all(exact.status == sj.Status.NO_RESIDUAL_OVERLAP)
    hit = sj.collide(NETWORK, VELOCITY[1], samples=5)  # one impact, beside a bias of one number
    assert np.allclose(hit.overlap[2], exact.peak_overlap[1], rtol=1e-7, atol=0)


@pytest.mark.parametrize(
    "route",
    [
        pytest.param(None, id="energy"),
        pytest.param(sj.ODE(rtol=1e-9), id="ode", marks=pytest.mark.long),
    ],
)
def test_slopes_in_its_weights(route):
    """Along a random direction through all weights, forward and backward, against differences."""
    weights, rest = eqx.partition(NETWORK, eqx.is_inexact_array)
    keys = iter(jax.random.split(jax.random.key(1), len(jax.tree.leaves(weights))))
    along = jax.tree.map(lambda w: jax.random.normal(next(keys), jnp.shape(w)), weights)

    @jax.jit
    def total(t):
        moved = jax.tree.map(lambda w, d: w + t * d, weights, along)
        return sj.restitution(eqx.combine(moved, rest), VELOCITY, route).coefficient.sum()

    step = 1e-4
    exact = (total(step) - total(-step)) / (2 * step)
    assert abs(exact) > 1e-3
    assert np.isclose(jax.grad(total)(0.0), exact, rtol=1e-6)
    assert np.isclose(jax.jvp(total, (0.0,), (1.0,))[1], exact, rtol=1e-6)


def test_slopes_in_the_heights_of_a_table():
    slopes = jax.grad(lambda law: (sj.restitution(law, VELOCITY).coefficient ** 2).sum())(TABLE)
    width = np.diff(KNOTS)
    exact = 2 * len(VELOCITY) * 0.5 * (np.append(0.0, width) + np.append(width, 0.0))
    # the kinks are not declared: what a quadrature across them leaves over
    assert np.allclose(slopes.heights, exact, rtol=0, atol=1e-2)
    assert slopes.stiffness == pytest.approx(0.0, abs=1e-12)


@pytest.mark.long
def test_many_impacts_of_one_table():
    """Large batches keep it whole."""
    many = sj.restitution(TABLE, np.full(300_000, 0.4)).coefficient
    assert np.all(many == many[0])


class Weighted(sj.RateIndependentLaw):
    """Back along a straight line and a parabola, each with its weight."""

    contact: sj.Contact
    weights: jax.Array = sj.array_field()

    def loading_force(self, overlap):
        return 1e6 * overlap

    def unloading_force(self, overlap, peak_overlap):
        s = overlap / peak_overlap
        return self.loading_force(peak_overlap) * jnp.dot(self.weights, jnp.stack([s, s**2]))


@pytest.mark.long
def test_each_of_many_lasts_as_long_as_alone():
    """A quarter period there; back a quarter and ∫ ds/√(1 - s³) of √(3/2) of it."""
    weights = np.array([[1.0, 0.0], [0.0, 1.0]])
    lasts = compiled_soon(jax.vmap(lambda w: sj.restitution(Weighted(STEEL, w), VELOCITY).duration))
    each = lasts(weights)
    quarter = np.sqrt(STEEL.mass / 1e6)
    cubic = np.sqrt(1.5) * beta(1 / 3, 1 / 2) / 3
    exact = quarter * np.array([np.pi, 0.5 * np.pi + cubic])
    assert np.allclose(each, exact[:, None], rtol=1e-9, atol=0)


def test_many_tables():
    """`vmap` over tables is a table after the other."""
    heights = np.array([HEIGHTS, HEIGHTS**2])
    each = jax.vmap(lambda h: sj.restitution(Tabled(STEEL, 1e6, KNOTS, h), VELOCITY))(heights)
    for k in range(2):
        alone = sj.restitution(Tabled(STEEL, 1e6, KNOTS, heights[k]), VELOCITY)
        assert np.allclose(each.coefficient[k], alone.coefficient, rtol=1e-13)
        assert np.allclose(each.duration[k], alone.duration, rtol=1e-12)


class Shared(sj.HardSphereLaw):
    """ε² = a w0."""

    a: float
    w: jax.Array = sj.array_field()

    def restitution_squared(self, velocity):
        return self.a * self.w[0] + 0 * velocity


def test_an_invalid_impact_leaves_its_neighbours_what_is_whole():
    law = eqx.tree_at(lambda law: law.a, Shared(0.5, [0.2]), np.array([0.5, np.inf]))
    found = jax.jit(sj.restitution)(law, 1.0)
    assert list(found.status) == [0, sj.Status.INVALID_INPUT]
    assert np.allclose(found.coefficient, [np.sqrt(0.1), 0], rtol=1e-15)


class Named(sj.RateIndependentLaw):
    """A spring of a stiffness that is found by name and place, beyond an elastic stage or without."""

    contact: sj.Contact
    table: dict = sj.array_field()

    def loading_force(self, overlap):
        return 1e6 * overlap

    def unloading_force(self, overlap, peak_overlap):
        stiffness = {"one": 2e6, "other": 4e6}[self.table["kind"]]
        scale = jnp.asarray(self.table["of"])[self.table["at"]].sum()
        return stiffness * scale * (overlap - peak_overlap) + 1e6 * peak_overlap


@pytest.mark.parametrize(
    "route", [None, pytest.param(sj.ODE(rtol=1e-10), id="ode", marks=pytest.mark.long)]
)
def test_words_and_indices_in_what_is_whole(route):
    """ε² = 1/(k2/k1), by hand."""
    for at, scale in ((1, 1.5), (np.array([0, 1]), 2.0)):
        law = Named(STEEL, {"kind": "other", "of": [0.5, 1.5], "at": at})
        found = sj.restitution(law, 1.0, route)
        assert found.coefficient**2 == pytest.approx(1 / (4 * scale), rel=1e-9)


class Stage(sj.RateIndependentLaw):
    """Hertz's up to w0, with half of the force back beyond."""

    contact: sj.Contact
    w: jax.Array = sj.array_field()

    def elastic_overlap(self):
        return self.w[0]

    def loading_force(self, overlap):
        return self.contact.stiffness * sj.power_3_2(overlap)

    def unloading_force(self, overlap, peak_overlap):
        return self.w[1] * self.loading_force(overlap)


def test_how_long_a_traced_result_lasts_where_yield_is_of_what_is_whole():
    law = Stage(STEEL, np.array([1e-7, 0.5]))
    found = sj.restitution(law, VELOCITY)
    traced = jax.jit(sj.restitution)(law, VELOCITY)
    assert np.allclose(traced.duration, found.duration, rtol=1e-12, atol=0)


class Bent(FirstOrder):
    """Loading is stiffer by what some numbers together make."""

    bend: jax.Array = sj.array_field()

    def loading(self, x):
        return super().loading(x) + jnp.sum(self.bend**2) * jnp.maximum(x - 1, 0) ** 2


class BentZhou(sj.Zhou):
    bend: jax.Array = sj.array_field(default=(0.0, 0.0))

    def reduced(self):
        plain = super().reduced()
        return Bent(plain.d, plain.X, bend=self.bend)


def test_slopes_of_loading_in_whole_fields():
    """They have a column for each number, beside those of the law's single numbers."""
    zhou = fitted("stainless steel")

    @compiled_soon
    @partial(jax.value_and_grad, argnums=(0, 1))
    def graded(bend, chi):
        law = BentZhou(zhou.contact, chi, zhou.sigma, zhou.psi, bend=bend)
        return sj.restitution(law, 1.0, sj.ODE(rtol=1e-12)).coefficient

    bend, chi, step = jnp.array([0.01, 0.02]), jnp.asarray(zhou.chi), 1e-5
    _, (slopes, slope) = graded(bend, chi)
    for k, along in enumerate(np.eye(2) * step):
        moved = graded(bend + along, chi)[0] - graded(bend - along, chi)[0]
        assert slopes[k] == pytest.approx(float(moved) / (2 * step), rel=1e-5)
    moved = graded(bend, chi + step)[0] - graded(bend, chi - step)[0]
    assert slope == pytest.approx(float(moved) / (2 * step), rel=1e-5)
    assert np.all(np.abs(slopes) > 1e-5)


@pytest.mark.long
def test_a_law_with_a_network_goes_through_jit_as_it_is():
    compiled = jax.jit(sj.restitution)
    found = compiled(NETWORK, VELOCITY)
    expected = [squared_by_gauss(NETWORK, float(x)) for x in found.peak_overlap]
    assert np.allclose(found.coefficient**2, expected, rtol=1e-10, atol=0)
    assert bool(NETWORK.is_valid())
    broken = eqx.tree_at(lambda law: law.network.layers[0].bias, NETWORK, np.full(8, np.nan))
    result = compiled(broken, VELOCITY)
    assert np.all(result.status == sj.Status.INVALID_INPUT)
