"""Fields that all impacts share: a network's weights and a table's knots beside numbers of each impact."""

import itertools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import beta

import softjax as sj
from tests.cases import pair

STEEL = pair("stainless steel", area="hertz")
VELOCITY = np.array([0.05, 0.4, 3.0])
KNOTS, HEIGHTS = np.array([0.0, 0.2, 0.5, 1.0]), np.array([0.0, 0.05, 0.3, 1.0])
PACE = np.sqrt(STEEL.mass / 1e6)
LONG = pytest.mark.long


class Spring(sj.RateIndependentLaw):
    """Loading of 1e6 N/m; what comes back is a share of the force at the peak."""

    contact: sj.Contact

    def loading_force(self, overlap):
        return 1e6 * overlap

    def unloading_force(self, overlap, peak_overlap):
        return 1e6 * peak_overlap * self.share(overlap / peak_overlap, peak_overlap)


class Tabled(Spring):
    """A table of shares over the overlap relative to the peak."""

    knots: jax.Array = sj.array_field()
    heights: jax.Array = sj.array_field()

    def share(self, s, peak):
        return jnp.interp(s, self.knots, self.heights)


class Networked(Spring):
    """s² times what a network makes of s and the peak."""

    network: eqx.nn.MLP = sj.array_field()

    def share(self, s, peak):
        bend = jnp.tanh(self.network(jnp.stack([s, peak / 1e-4])))
        return s**2 * (1 + 0.5 * (1 - s) * bend)


class Layered(Spring):
    """The same with all weights in one array, a hidden layer of a fourth as many."""

    weights: jax.Array = sj.array_field()

    def share(self, s, peak):
        at, of_peak, shift, out = jnp.reshape(self.weights, (4, -1))
        bend = jnp.tanh(out @ jnp.tanh(at * s + of_peak * peak / 1e-4 + shift))
        return s**2 * (1 + 0.5 * (1 - s) * bend)


class Damped(sj.RateDependentLaw):
    """1e6 N/m beside a linear dashpot, ξ the sum of many numbers."""

    contact: sj.Contact
    parts: jax.Array = sj.array_field()
    end: str = sj.choice_field("zero-overlap", "zero-force")

    def force(self, overlap, velocity):
        return 1e6 * overlap + 2 * jnp.sum(self.parts) * 1e6 * PACE * velocity


class Weighted(Spring):
    """A straight line and a parabola, each with its weight; loading bent by other weights."""

    weights: jax.Array = sj.array_field()
    bend: jax.Array = sj.array_field(default=(0.0, 0.0))

    def loading_force(self, overlap):
        return 1e6 * overlap * (1 + jnp.sum(self.bend**2) * overlap / 1e-4)

    def unloading_force(self, overlap, peak_overlap):
        s = overlap / peak_overlap
        return self.loading_force(peak_overlap) * jnp.dot(self.weights, jnp.stack([s, s**2]))


class Named(Spring):
    """A straight line back, whose slope is found by name and place."""

    table: dict = sj.array_field()

    def unloading_force(self, overlap, peak_overlap):
        stiffness = {"one": 2e6, "other": 4e6}[self.table["kind"]]
        scale = jnp.asarray(self.table["of"])[self.table["at"]]
        scale *= jnp.asarray(self.table["of"])[self.table["over"]].sum()
        return stiffness * scale * (overlap - peak_overlap) + 1e6 * peak_overlap


class Staged(sj.RateIndependentLaw):
    """Hertz's up to w0, with half of the force back beyond."""

    contact: sj.Contact
    w: jax.Array = sj.array_field()

    def elastic_overlap(self):
        return self.w[0]

    def loading_force(self, overlap):
        return self.contact.stiffness * sj.power_3_2(overlap)

    def unloading_force(self, overlap, peak_overlap):
        return self.w[1] * self.loading_force(overlap)


class Shared(sj.HardSphereLaw):
    """ε² = a w0."""

    a: float
    w: jax.Array = sj.array_field()

    def restitution_squared(self, velocity):
        return self.a * jax.tree.leaves(self.w)[0][0] + 0 * velocity


TABLE = Tabled(STEEL, KNOTS, HEIGHTS)
NETWORK = Networked(STEEL, eqx.nn.MLP(2, "scalar", 8, 1, jax.nn.softplus, key=jax.random.key(0)))


def by_gauss(law):
    """ε² = 2 ∫ of the shares, over `VELOCITY`."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    over = jax.vmap(jax.vmap(law.share, (0, None)), (None, 0))
    return jnp.sqrt(over(0.5 * (nodes + 1), VELOCITY * PACE) @ weights)


def test_a_table_whatever_the_batch():
    """ε² = 2 ∫ of the table. Its kinks move with the peak and are not declared: 1e-9, or flagged."""
    exact = np.sum(np.diff(KNOTS) * (HEIGHTS[1:] + HEIGHTS[:-1]))
    for velocity in (0.4, VELOCITY, VELOCITY[:2, None] * np.ones(3)):
        result = sj.restitution(TABLE, velocity)
        assert result.coefficient.shape == np.shape(velocity)
        off = np.abs(np.asarray(result.coefficient) ** 2 - exact)
        assert np.all((off < 1e-9) | (np.asarray(result.status) & sj.Status.INEXACT > 0))
        assert np.all(off < 1e-3)


@LONG
def test_slopes_of_a_shared_table():
    """∂ε²/∂h = the widths beside each knot; the kinks are not declared: what a quadrature across them leaves over."""
    slopes = jax.grad(lambda law: (sj.restitution(law, VELOCITY).coefficient ** 2).sum())(TABLE)
    width = np.diff(KNOTS)
    exact = len(VELOCITY) * (np.append(0.0, width) + np.append(width, 0.0))
    assert np.allclose(slopes.heights, exact, rtol=0, atol=1e-2)


@pytest.mark.parametrize(
    "route", [None, pytest.param(sj.ODE(rtol=1e-10), marks=LONG)], ids=["energy", "ode"]
)
def test_a_network(route):
    """Values by Gauss's rule; slopes along a random direction through all weights by its differences."""
    weights, rest = eqx.partition(NETWORK, eqx.is_inexact_array)
    keys = iter(jax.random.split(jax.random.key(1), len(jax.tree.leaves(weights))))
    along = jax.tree.map(lambda w: jax.random.normal(next(keys), jnp.shape(w)), weights)

    def moved(t):
        return eqx.combine(jax.tree.map(lambda w, d: w + t * d, weights, along), rest)

    def total(t):
        hit = sj.restitution(moved(t), VELOCITY, route)
        return hit.coefficient.sum(), (hit.coefficient, hit.status)

    @jax.jit
    def both(t):
        _, push, found = jax.linearize(total, t, has_aux=True)
        return push(1.0), jax.linear_transpose(push, t)(1.0)[0], found

    rising, slope, (found, status) = both(0.0)
    step, gauss = 1e-4, jax.jit(lambda t: by_gauss(moved(t)))
    exact = [gauss(t) for t in (-step, 0.0, step)]
    assert np.allclose(found, exact[1], rtol=1e-8 if route else 1e-10, atol=0)
    assert np.all(status == sj.Status.NO_RESIDUAL_OVERLAP)
    steep = (np.sum(exact[2]) - np.sum(exact[0])) / (2 * step)
    assert abs(steep) > 1e-3
    assert np.allclose([slope, rising], steep, rtol=1e-6, atol=0)


def gradient_and_hessian(f):
    """In one program."""

    def gradients(x):
        first = jax.jacrev(f)(x)
        return first, first

    def both(x):
        second, first = jax.jacfwd(gradients, has_aux=True)(x)
        return first, second

    return both


DERIVATIVES = {"jacfwd": jax.jacfwd, "jacrev": jax.jacrev, "hessian": gradient_and_hessian}


@pytest.mark.parametrize(
    ("count", "mode", "stacked"),
    [
        pytest.param(*case, marks=() if case == (8, "hessian", False) else LONG)
        for case in itertools.product((8, 128), DERIVATIVES, (True, False))
    ],
)
def test_derivatives_by_every_weight(count, mode, stacked):
    """Of ε by the equation of motion, against those of Gauss's rule; of several networks under `vmap`."""

    def total(weights):
        return sj.restitution(Layered(STEEL, weights), VELOCITY, sj.ODE()).coefficient.sum()

    def exact(weights):
        return by_gauss(Layered(STEEL, weights)).sum()

    weights = 0.5 * np.random.default_rng(count).normal(size=(2, count))
    weights = weights if stacked else weights[0]
    mapped = jax.vmap if stacked else lambda f: f
    both = (jax.jit(mapped(DERIVATIVES[mode](f)))(weights) for f in (total, exact))
    for found, expected in zip(*map(jax.tree.leaves, both), strict=True):
        assert found.shape == expected.shape
        assert np.max(np.abs(found - expected)) < 1e-6 * np.max(np.abs(expected))


@pytest.mark.parametrize(
    ("route", "end", "bound"),
    [
        (sj.ODE(rtol=1e-9, solver="bosh3"), "zero-force", 1e-6),  # some hundred steps
        pytest.param(sj.ODE(), "zero-force", 1e-6, marks=LONG),
        pytest.param(sj.ODE(rtol=1e-9, solver="bosh3"), "zero-overlap", 1e-6, marks=LONG),
        pytest.param(sj.ODE(rtol=1e-9, solver="tsit5"), "zero-overlap", 1e-6, marks=LONG),
        pytest.param(sj.ODE(solver="dopri5", steps=100), "zero-overlap", 1e-6, marks=LONG),
        pytest.param(sj.ODE(solver=diffrax.Euler(), steps=4000), "zero-overlap", 1e-2, marks=LONG),
    ],
)
def test_slopes_in_many_numbers_of_a_dashpot(route, end, bound):
    """ε = exp(-ξ/w · φ), w = √(1 - ξ²), φ = π where the overlap vanishes or atan2(2ξw, 2ξ² - 1) where the force does.

    Those of the duration φ/(ω0 w), and of the largest overlap exp(-ξ/w acos ξ) v/ω0; of two laws at once.
    """
    parts = np.linspace(0.001, 0.03, 12)  # more than are differentiated forward
    parts = np.stack([parts, 1.5 * parts])

    def known(x):
        w = jnp.sqrt(1 - x * x)
        angle = np.pi if end == "zero-overlap" else jnp.arctan2(2 * x * w, 2 * x * x - 1)
        return jnp.exp(-x / w * angle), PACE * angle / w, PACE * jnp.exp(-x / w * jnp.arccos(x))

    def found(parts):
        hit = sj.restitution(Damped(STEEL, parts, end), 1.0, route)
        return hit.coefficient, hit.duration, hit.peak_overlap

    slopes = jax.jit(jax.vmap(jax.jacrev(found)))(parts)
    for slope, expected in zip(slopes, jax.vmap(jax.jacfwd(known))(parts.sum(1)), strict=True):
        assert np.allclose(slope, expected[:, None], rtol=bound, atol=0)


def test_networks_that_are_no_numbers():
    assert bool(NETWORK.is_valid())
    broken = eqx.tree_at(lambda law: law.network.layers[0].bias, NETWORK, np.full(8, np.nan))
    assert not bool(broken.is_valid())
    law = Shared(0.5, {"a": np.array([0.2]), "b": np.zeros(2)})
    law = eqx.tree_at(lambda law: law.w["b"], law, np.array([0.1, np.nan]))
    assert list(jax.jit(sj.restitution)(law, VELOCITY).status) == 3 * [sj.Status.INVALID_INPUT]
    law = eqx.tree_at(lambda law: law.a, Shared(0.5, [0.2]), np.array([0.5, np.inf]))
    found = jax.jit(sj.restitution)(law, 1.0)  # a bad number beside a good one
    assert list(found.status) == [0, sj.Status.INVALID_INPUT]
    assert np.allclose(found.coefficient, [np.sqrt(0.1), 0], rtol=1e-15)


def test_each_of_many_lasts_as_long_as_alone():
    """A quarter period there; back a quarter, or ∫ ds/√(1 - s³) of √(3/2) of it. Outside `vmap` too."""
    of = jax.vmap(lambda w: sj.restitution(Weighted(STEEL, w), VELOCITY))
    weights = np.array([[1.0, 0.0], [0.0, 1.0]])
    each = of(weights)
    cubic = np.sqrt(1.5) * beta(1 / 3, 1 / 2) / 3
    exact = PACE * np.array([np.pi, 0.5 * np.pi + cubic])
    assert np.allclose(each.duration, exact[:, None], rtol=1e-9, atol=0)
    assert np.allclose(each.coefficient**2, [[1.0], [2 / 3]], rtol=1e-9)
    for k, same in enumerate(weights[:, None] * np.ones((1, 2, 1))):  # beside itself, not the other
        alone = of(same)
        assert np.allclose(each.coefficient[k], alone.coefficient, rtol=1e-13, atol=0)
        assert np.allclose(each.duration[k], alone.duration, rtol=1e-12, atol=0)


@pytest.mark.parametrize(
    ("route", "count"),
    [
        pytest.param(None, 2, id="energy"),
        pytest.param(sj.ODE(rtol=1e-11), 2, id="ode", marks=LONG),
        pytest.param(sj.ODE(rtol=1e-11), 12, id="ode, many"),
    ],
)
def test_slopes_of_loading_in_shared_numbers(route, count):
    """ε² = P_m δ_m (w0/2 + w1/3)/(½ M v²), differentiated by hand through the cubic for δ_m."""

    def restitution(bend):
        found = sj.restitution(Weighted(STEEL, [0.3, 0.6], bend), 1.0, route).coefficient
        return found, found

    bend = np.linspace(0.1, 0.2, count)

    def exact(bend):
        c = np.sum(bend**2) / 1e-4
        roots = np.roots([1e6 * c / 3, 0.5e6, 0.0, -0.5 * STEEL.mass])
        peak = float(np.max(np.real(roots[np.abs(np.imag(roots)) < 1e-12])))
        force = 1e6 * peak * (1 + c * peak)
        return np.sqrt(force * peak * (0.15 + 0.2) / (0.5 * STEEL.mass))

    derivative = jax.jacrev if route is None else jax.jacfwd  # of many, forward too by reverse
    slopes, value = jax.jit(derivative(restitution, has_aux=True))(bend)
    assert value == pytest.approx(exact(bend), rel=1e-8)
    step = 1e-5
    for k, along in enumerate(np.eye(count) * step):
        steep = (exact(bend + along) - exact(bend - along)) / (2 * step)
        assert abs(steep) > 1e-3
        assert slopes[k] == pytest.approx(steep, rel=1e-6)


def test_words_and_indices():
    """ε² = 1/(k2/k1), by hand."""
    of = {"of": [0.5, 1.5], "at": 1, "over": np.array([0, 1])}
    found = sj.restitution(Named(STEEL, {"kind": "other", **of}), 1.0)
    assert found.coefficient**2 == pytest.approx(1 / (4 * 1.5 * 2), rel=1e-9)


def test_how_long_a_traced_result_lasts_where_yield_is_of_a_shared_number():
    """Half of Hertz's duration there; √2 of it back, by half the force."""
    law = Staged(STEEL, np.array([1e-7, 0.5]))
    found = jax.jit(sj.restitution)(law, VELOCITY)
    peak = (1.25 * STEEL.mass * VELOCITY**2 / STEEL.stiffness) ** 0.4
    exact = (1 + np.sqrt(2)) * 0.4 * beta(0.4, 0.5) * peak / VELOCITY
    assert np.allclose(found.duration, exact, rtol=1e-12, atol=0)
    assert np.allclose(found.coefficient, np.sqrt(0.5), rtol=1e-9, atol=0)
