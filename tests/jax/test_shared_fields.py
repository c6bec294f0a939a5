"""Fields that all impacts share: a network's weights and a table's entries beside numbers of each impact."""

import itertools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import beta

import softjax as sj
from tests.cases import mostly_long, pair, same_flags

STEEL = pair("stainless steel", area="hertz")
VELOCITY = np.array([0.05, 0.4, 3.0])
PACE = np.sqrt(STEEL.mass / 1e6)


class Spring(sj.RateIndependentLaw):
    """Loading of 1e6 N/m, which stiffens; what comes back is a share of the force at the peak."""

    contact: sj.Contact

    def stiffening(self):
        return 0.0

    def residual_overlap(self, peak_overlap):  # searched for otherwise: half of the program
        return 0 * peak_overlap

    def loading_force(self, overlap):
        return 1e6 * overlap * (1 + self.stiffening() * overlap / 1e-3)

    def unloading_force(self, overlap, peak_overlap):
        return self.loading_force(peak_overlap) * self.share(overlap / peak_overlap, peak_overlap)


class Layered(Spring):
    """s² times what a network makes of s and the peak, a hidden layer of a fourth of its numbers."""

    weights: jax.Array = sj.array_field()

    def share(self, s, peak):
        at, of_peak, shift, out = jnp.reshape(self.weights, (4, -1))
        bend = jnp.tanh(out @ jnp.tanh(at * s + of_peak * peak / 1e-4 + shift))
        return s**2 * (1 + 0.5 * (1 - s) * bend)


class Bent(Layered):
    """On a spring that two of the numbers stiffen."""

    def stiffening(self):
        return jnp.sum(self.weights[:2] ** 2) / 4


class Damped(sj.RateDependentLaw):
    """1e6 N/m beside a linear dashpot, ξ the sum of many numbers."""

    contact: sj.Contact
    parts: jax.Array = sj.array_field()
    end: str = sj.choice_field("zero-overlap", "zero-force")

    def force(self, overlap, velocity):
        return 1e6 * overlap + 2 * jnp.sum(self.parts) * 1e6 * PACE * velocity


class Stated(sj.RateDependentLaw):
    """A spring that says of its collisions what it is given."""

    contact: sj.Contact
    weights: jax.Array = sj.array_field()
    end = "zero-overlap"

    def force(self, overlap, velocity):
        return 1e6 * overlap

    def closed_form(self, velocity):
        return sj.KnownCollision(self.weights[0], velocity, 0.0, self.weights[1] / velocity)


class Named(Spring):
    """A straight line back, whose slope is found by name and place."""

    table: dict = sj.array_field()
    residual_overlap = sj.RateIndependentLaw.residual_overlap

    def unloading_force(self, overlap, peak_overlap):
        stiffness = {"one": 2e6, "other": 4e6}[self.table["kind"]]
        scale = jnp.asarray(self.table["of"])[self.table["at"]]
        scale *= jnp.asarray(self.table["of"])[self.table["over"]].sum()
        return stiffness * scale * (overlap - peak_overlap) + self.loading_force(peak_overlap)


class Staged(sj.RateIndependentLaw):
    """Hertz's up to w0, with half of the force back beyond."""

    contact: sj.Contact
    w: jax.Array = sj.array_field()

    def elastic_overlap(self):
        return self.w[0]

    def residual_overlap(self, peak_overlap):
        return 0 * peak_overlap

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


def by_gauss(law, velocity=VELOCITY):
    """ε² = P_m δ_m/(M v²) 2 ∫ of the shares; δ_m where δ² (1 + 2 b δ/3) = M v²/k, by Viète."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    over = jax.vmap(jax.vmap(law.share, (0, None)), (None, 0))
    bend, straight = law.stiffening() / 1e-3, velocity * PACE
    part = 2 / np.sqrt(3) * jnp.cos(jnp.arccos(np.sqrt(3) * bend * straight) / 3)
    returned = (1 + bend * straight / part) / part**2
    return jnp.sqrt(returned * (over(0.5 * (nodes + 1), straight / part) @ weights))


def gradient_and_hessian(f):
    """In one program."""

    def gradients(x):
        first = jax.jacrev(f)(x)
        return first, first

    def both(x):
        second, first = jax.jacfwd(gradients, has_aux=True)(x)
        return first, second

    return both


HUNDREDS = sj.ODE(rtol=1e-9, solver="bosh3")  # of steps
BY = {"energy": None, "time": HUNDREDS, "time, stacked": sj.ODE()}
DERIVATIVES = {
    "forward": jax.jacfwd,
    "reverse": jax.value_and_grad,
    "hessian": gradient_and_hessian,
}
BY_WEIGHTS = itertools.product((8, 128), DERIVATIVES, BY)


@mostly_long("count, mode, by", BY_WEIGHTS, [(8, "hessian", "time"), (8, "reverse", "energy")])
def test_derivatives_by_every_weight(count, mode, by):
    """ε, and of several networks under `vmap`, against those of Gauss's rule."""

    law = Bent if by == "energy" else Layered

    def total(weights):
        return sj.restitution(law(STEEL, weights), VELOCITY, BY[by]).coefficient.sum()

    def exact(weights):
        return by_gauss(law(STEEL, weights)).sum()

    weights = 0.5 * np.random.default_rng(count).normal(size=(2, count))
    weights = weights if "stacked" in by else weights[0]
    mapped = jax.vmap if "stacked" in by else lambda f: f
    both = (jax.jit(mapped(DERIVATIVES[mode](f)))(weights) for f in (total, exact))
    for found, expected in zip(*map(jax.tree.leaves, both), strict=True):
        assert found.shape == expected.shape
        near = 1e-9 if by == "energy" else 1e-6
        assert np.max(np.abs(found - expected)) < near * np.max(np.abs(expected))


DASHPOTS = [
    (HUNDREDS, "zero-overlap", 1e-6, 0.0),
    (HUNDREDS, "zero-overlap", 1e-6, 2.0),
    (sj.ODE(), "zero-force", 1e-6, 2.0),
    (sj.ODE(rtol=1e-9, solver="tsit5"), "zero-overlap", 1e-6, 2.0),
    (sj.ODE(solver="dopri5", steps=100), "zero-overlap", 1e-6, 2.0),
    (sj.ODE(solver=diffrax.Euler(), steps=4000), "zero-force", 1e-2, 2.0),
]


@mostly_long("route, end, bound, lasting", DASHPOTS)
def test_slopes_in_many_numbers_of_a_dashpot(route, end, bound, lasting):
    """ε = exp(-ξ/w · φ), w = √(1 - ξ²), φ = π where the overlap vanishes or atan2(2ξw, 2ξ² - 1) where the force does.

    With the duration φ/(ω0 w), which costs twice as much as the rest, and the largest overlap exp(-ξ/w acos ξ) v/ω0.
    """
    parts = np.linspace(0.001, 0.03, 12)  # more than are differentiated forward

    def known(x):
        w = jnp.sqrt(1 - x * x)
        angle = np.pi if end == "zero-overlap" else jnp.arctan2(2 * x * w, 2 * x * x - 1)
        peaks = VELOCITY * jnp.exp(-x / w * jnp.arccos(x))
        return jnp.sum(jnp.exp(-x / w * angle) + lasting * angle / w + 3 * peaks)

    def found(parts):
        hit = sj.restitution(Damped(STEEL, parts, end), VELOCITY, route)
        lasts = lasting * hit.duration if lasting else 0.0
        return jnp.sum(hit.coefficient + (lasts + 3 * hit.peak_overlap) / PACE)

    slopes = jax.jit(jax.grad(found))(parts)
    assert np.allclose(slopes, jax.jit(jax.grad(known))(parts.sum()), rtol=bound, atol=0)


def test_shared_numbers_that_are_none():
    law = Shared(0.5, {"a": np.array([0.2]), "b": np.zeros(2)})
    law = eqx.tree_at(lambda law: law.w["b"], law, np.array([0.1, np.nan]))
    assert np.all(
        same_flags(jax.jit(sj.restitution)(law, VELOCITY).status, sj.Status.INVALID_INPUT)
    )
    law = eqx.tree_at(lambda law: law.a, Shared(0.5, [0.2]), np.array([0.5, np.inf]))
    found = jax.jit(sj.restitution)(law, 1.0)  # a bad number beside a good one
    assert np.all(same_flags(found.status, [0, sj.Status.INVALID_INPUT]))
    assert np.allclose(found.coefficient, [np.sqrt(0.1), 0], rtol=1e-15)


@pytest.mark.parametrize("velocity", [0.4, VELOCITY, VELOCITY[:2, None] * np.ones(3)])
def test_words_and_indices_whatever_the_batch(velocity):
    """ε² = 1/(k2/k1), by hand."""
    of = {"of": [0.5, 1.5], "at": 1, "over": np.array([0, 1])}
    found = sj.restitution(Named(STEEL, {"kind": "other", **of}), velocity).coefficient
    assert found.shape == np.shape(velocity)
    assert np.allclose(found**2, 1 / (4 * 1.5 * 2), rtol=1e-9, atol=0)


def test_each_of_many_lasts_as_long_as_alone():
    """Outside `vmap` too, each beside itself and not the other."""
    weights = np.array([[0.5, 0.2], [0.8, 0.3]])
    each = jax.vmap(lambda w: sj.restitution(Stated(STEEL, w), VELOCITY))(weights)
    assert np.allclose(each.coefficient, weights[:, :1], rtol=1e-15, atol=0)
    assert np.allclose(each.duration, weights[:, 1:] / VELOCITY, rtol=1e-15, atol=0)


def test_how_long_a_traced_result_lasts_where_yield_is_of_a_shared_number():
    """Half of Hertz's duration there; √2 of it back, by half the force."""
    law = Staged(STEEL, np.array([1e-7, 0.5]))
    found = jax.jit(lambda law: sj.restitution(law, VELOCITY).duration)(law)
    peak = (1.25 * STEEL.mass * VELOCITY**2 / STEEL.stiffness) ** 0.4
    exact = (1 + np.sqrt(2)) * 0.4 * beta(0.4, 0.5) * peak / VELOCITY
    assert np.allclose(found, exact, rtol=1e-12, atol=0)
