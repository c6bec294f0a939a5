"""Laws of the user's: what a law states itself, and laws given in their scales."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import softjax as sj
from tests.cases import mostly_long, same_flags
from tests.laws import LAWS, WITH_FORCE
from tests.physics.by_forces import LENGTH, STEEL, Forces, columns

by_time_long = mostly_long("route", [sj.EnergyBalance(), sj.ODE(rtol=1e-10)])


@pytest.mark.parametrize("name", [n for n in WITH_FORCE if "dashpot" not in n])
def test_slopes_of_forces_at_zero_overlap(name):
    """Numbers, where `x √x` gave NaN."""
    law = LAWS[name].law
    if isinstance(law, sj.RateDependentLaw):
        assert np.isfinite(jax.grad(law.force)(0.0, 1.0))
        return
    assert np.isfinite(jax.grad(law.loading_force)(0.0))
    assert np.isfinite(jax.jacfwd(law.unloading_force)(0.0, 1e-5))


class Told(Forces):
    """Says itself what remains, which a search would find elsewhere."""

    def residual_overlap(self, peak_overlap):
        return 0.75 * peak_overlap


@by_time_long
def test_what_a_law_tells_of_its_residual_overlap(route):
    """A trapezium's area."""
    known = sj.restitution(Told(STEEL, *columns([{"rest": 0.5}])), [0.7], route)
    assert known.peak_overlap == pytest.approx(0.7 * np.sqrt(0.8) * LENGTH, rel=1e-9)
    assert known.residual_overlap == pytest.approx(0.75 * np.asarray(known.peak_overlap), rel=1e-12)
    assert known.coefficient**2 == pytest.approx(2 * 0.25 * 0.75, rel=1e-9)


class Twice(sj.RateIndependentLaw):
    """A spring whose force vanishes at a share of the peak recovered, and again at `back` of it; or rough."""

    contact: sj.Contact
    share: float
    back: float
    rough: float = 0.0

    def loading_force(self, overlap):
        return 1e6 * overlap

    def unloading_force(self, overlap, peak_overlap):
        recovered = 1 - overlap / peak_overlap
        force = peak_overlap * (1 - recovered / self.share) * (1 - recovered / self.back)
        return 1e6 * force * (1 + self.rough * jnp.sin(1e5 * recovered))


def test_unloading_ends_where_the_force_vanishes_first():
    """The work back is that of a parabola; where it is rough, the integral says that it has not settled."""
    near, even = np.geomspace(1e-4, 0.24, 40), np.linspace(0.25, 0.93, 60)
    left = 0.5 ** np.arange(6, 20)
    share = np.concatenate([near, even, 1 - left])
    beyond = (np.where(near < 2**-8, 3, 1) * near, 0 * even + 0.05, 0.75 * left)
    back = share + np.concatenate(beyond)
    rough = share == share[50]
    hit = sj.restitution(Twice(STEEL, share, back, 0.9 * rough), 1.0)
    assert np.all(same_flags(hit.status, np.where(rough, sj.Status.INEXACT, 0)))
    expected = share * (1 - share / (3 * back))
    np.testing.assert_allclose((hit.coefficient**2)[~rough], expected[~rough], rtol=1e-9)
    np.testing.assert_allclose(hit.residual_overlap / hit.peak_overlap, 1 - share, rtol=1e-10)


# laws given in the units of their scales


class Stages(sj.ReducedRateIndependent):
    """Elastic to 1.9, a straight line, one with a further slope of 20 beyond 3; back with a kink."""

    @property
    def elastic_limit(self):
        return 1.9

    def loading(self, x):
        line = 1.9**1.5 + 2 * (x - 1.9) + 20 * jnp.maximum(x - 3, 0)
        return jnp.where(x > 1.9, line, jnp.where(x > 0, x, 1.0) ** 1.5 * (x > 0))

    def unloading(self, x, peak):
        return self.loading(peak) - (30.0 + 4.0 * jnp.maximum(1.9 - x, 0)) * (peak - x)

    def breakpoints(self):
        return (3.0,)

    def end(self):
        return 40.0


class Spring(sj.ReducedRateIndependent):
    """p = (4/5) x up to x = 1, twice as stiff from there, and thrice on unloading."""

    work_exponent = 2.0

    def loading(self, x):
        return 0.8 * jnp.where(x > 1, 2 * x - 1, x)

    def unloading(self, x, peak):
        return 2.4 * (x - peak) + self.loading(peak)


class InScales(sj.RateIndependentLaw):
    contact: sj.Contact
    law: str = sj.choice_field("stages", "spring")

    def scales(self):
        return sj.Scales(1e-5, 0.1)

    def reduced(self):
        return Stages() if self.law == "stages" else Spring()


class Bilinear(sj.RateIndependentLaw):
    """Four times as stiff from b on, and linear unloading."""

    contact: sj.Contact
    stiffness: float = 1e6
    kink: float = 2e-5

    def loading_force(self, overlap):
        return self.stiffness * (overlap + 3 * jnp.maximum(overlap - self.kink, 0))

    def unloading_force(self, overlap, peak_overlap):
        fallen = 8 * self.stiffness * (peak_overlap - overlap)
        return jnp.maximum(self.loading_force(peak_overlap) - fallen, 0)

    def breakpoints(self):
        return (self.kink,)


def test_an_integration_stops_at_a_kink_on_loading_and_goes_on_behind_it():
    """k b²/2 + k b u + 2 k u² = m v²/2 for δ_m = b + u; in 8 steps over the kink they err by 1e-4 to 1e-3."""
    law, velocity = Bilinear(STEEL), np.array([0.5, 1.0, 3.0])
    hit = sj.restitution(law, velocity, sj.ODE(steps=8))
    k, b, energy = 1e6, 2e-5, float(STEEL.mass) * velocity**2 / 2
    u = (np.sqrt((k * b) ** 2 + 8 * k * (energy - k * b**2 / 2)) - k * b) / (4 * k)
    assert np.all(u > 0.1 * b)
    squared = (k * b + 4 * k * u) ** 2 / (16 * k) / energy
    np.testing.assert_allclose(hit.peak_overlap, b + u, rtol=1e-9)
    np.testing.assert_allclose(hit.coefficient**2, squared, rtol=1e-9)


@by_time_long
def test_kinks_elastic_limits_and_ends(route):
    """Two parabolas for the peak, polynomials between the kinks for the work back."""
    y = np.array([1.0, 1.9**1.25 * 1.001, 2.5, 4.5, 6.0, 30.0, 500.0])
    result = sj.restitution(InScales(STEEL), 0.1 * y, route)
    if isinstance(route, sj.ODE):
        path = sj.collide(InScales(STEEL), 0.1 * y[1:6], samples=5, route=route)
        ends = y[1:6] * np.array([np.ones(5), -result.coefficient[1:6]])
        assert np.allclose(path.velocity[:, [0, -1]].T, 0.1 * ends, rtol=1e-9)
        assert np.allclose(path.overlap[:, 2], result.peak_overlap[1:6], rtol=1e-7)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    assert np.all(same_flags(result.status, [1, 0, 0, 0, 0, 0, sj.Status.NO_TURNING_POINT]))
    for k in range(1, 6):
        start, force = 0.4 * (y[k] ** 2 - 1.9**2.5), 1.9**1.5
        a = (np.sqrt(force**2 + 4 * start) - force) / 2
        if a > 1.1:
            rest, at = start - force * 1.1 - 1.1**2, force + 2.2
            a = 1.1 + (np.sqrt(at**2 + 44 * rest) - at) / 22
        peak, top = 1.9 + a, force + 2 * a + 20 * max(a - 1.1, 0)
        back = lambda x: top - (30 + 4 * np.maximum(1.9 - x, 0)) * (peak - x)  # noqa: B023, E731
        low = brentq(back, 0, peak, xtol=1e-14)
        edges = [low, max(low, 1.9), peak]
        half, middle = 0.5 * np.diff(edges), 0.5 * (np.array(edges[1:]) + edges[:-1])
        work = np.sum(half * weights[:, None] * back(middle + half * nodes[:, None]))
        overlaps = result.peak_overlap[k] / 1e-5, result.residual_overlap[k] / 1e-5
        assert np.allclose(overlaps, [peak, low], rtol=1e-9, atol=0)
        assert np.isclose(result.coefficient[k] ** 2, work / (0.4 * y[k] ** 2), rtol=1e-8, atol=0)


@by_time_long
def test_arcs_of_a_circle(route):
    """x'' = -x, then -(2x - 1), then -3 (x - x*): ε, peak, what is left and the duration; slopes of the others."""

    def exact(y):
        peak = np.where(y > 1, 0.5 * (1 + np.sqrt(np.maximum(2 * y**2 - 1, 0))), y)
        force = np.where(y > 1, 0.8 * (2 * peak - 1), 0.8 * peak)
        returned = np.where(y > 1, force**2 / 4.8 / (0.4 * y**2), 1.0)
        left = np.where(y > 1, peak - force / 2.4, 0.0)
        late = np.maximum(y, 1)
        beyond = np.arctan(np.sqrt(late**2 - 1) * np.sqrt(2)) / np.sqrt(2)
        back = np.where(y > 1, 0.5 * np.pi / np.sqrt(3), 0.5 * np.pi)
        return np.array([returned**0.5, peak, left, np.arcsin(1 / late) + beyond + back])

    def found(y):
        hit = sj.restitution(InScales(STEEL, "spring"), 0.1 * y, route)
        return jnp.stack([hit.coefficient, hit.peak_overlap / 1e-5, hit.residual_overlap / 1e-5])

    y, step = np.array([0.5, 1.5, 4.0]), 1e-5
    values, slopes = jax.jit(lambda y: jax.jvp(found, (y,), (np.ones(3),)))(y)
    lasts = sj.restitution(InScales(STEEL, "spring"), 0.1 * y, route).duration / 1e-4
    values = np.vstack([values, lasts])
    bound = np.array([[5e-10], [1e-10], [1e-9], [1e-8]])
    assert np.all(np.abs(values - exact(y)) <= bound * np.abs(exact(y)) + 1e-9 * (exact(y) == 0))
    differences = (exact(y + step) - exact(y - step)) / (2 * step)
    assert np.allclose(slopes, differences[:3], rtol=1e-7, atol=1e-8)


def test_laws_say_what_they_lack():
    class Half(sj.RateIndependentLaw):
        contact: sj.Contact

        def loading_force(self, overlap):
            return overlap

    with pytest.raises(ValueError, match="`Half` must define unloading_force"):
        Half(STEEL)

    class Endless(sj.RateDependentLaw):
        contact: sj.Contact

        def force(self, overlap, velocity):
            return overlap

    with pytest.raises(ValueError, match="`end` must be 'zero-overlap' or 'zero-force'"):
        Endless(STEEL)


def test_an_elastic_law_by_forces_says_so():
    class Always(sj.RateIndependentLaw):
        contact: sj.Contact
        never_yields = True

        def loading_force(self, overlap):
            return 0.5 * self.contact.stiffness * sj.power_3_2(overlap)

        def unloading_force(self, overlap, peak_overlap):
            return self.loading_force(overlap)

    assert same_flags(sj.restitution(Always(STEEL), 1.0).status, sj.Status.ELASTIC)
