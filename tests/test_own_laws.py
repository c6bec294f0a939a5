"""Laws of one's own by both routes: what unloads to zero overlap, plateaus, kinks and hooks."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import compiled_soon, pair

STEEL = pair("stainless steel", area="hertz")
ROUTES = {"energy": sj.EnergyBalance(), "ode": sj.ODE(rtol=1e-10)}
both_routes = pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES)
by_time_long = pytest.mark.parametrize(
    "route",
    [pytest.param(r, id=n, marks=[pytest.mark.long] * (n == "ode")) for n, r in ROUTES.items()],
)
STIFFNESS = 1e6


class Recoil(sj.RateIndependentLaw):
    """A linear spring that gives back P_m [c + (1 - c) s^n], s = (δ - ρ δ_m)/(1 - ρ)/δ_m, not below 0."""

    contact: sj.Contact
    floor: float
    power: float
    rest: float

    def loading_force(self, overlap):
        return STIFFNESS * overlap

    def unloading_force(self, overlap, peak_overlap):
        s = jnp.maximum((overlap / peak_overlap - self.rest) / (1 - self.rest), 0.0)
        inside = s > 0
        share = jnp.where(inside, jnp.where(inside, s, 1.0) ** self.power, 0.0)
        return STIFFNESS * peak_overlap * (self.floor + (1 - self.floor) * share)


# positive down to zero overlap; zero there; clipped at zero; just above zero by a hair
FLOOR, POWER = np.array([0.2, 0.0, 0.0, 1e-9]), np.array([2.0, 2.0, 1.0, 3.0])
REST = np.array([0.0, 0.0, 0.5, 0.0])


@both_routes
def test_unloading_down_to_zero_or_clipped(route):
    """ε² = 2 (1 - ρ) [c + (1 - c)/(n + 1)] by hand; the energy balance raised on all of them."""
    law = Recoil(STEEL, FLOOR, POWER, REST)
    result = jax.jit(lambda v: sj.restitution(law, v, route))(jnp.full(4, 0.7))
    squared = 2 * (1 - REST) * (FLOOR + (1 - FLOOR) / (POWER + 1))
    peak = 0.7 * np.sqrt(STEEL.mass / STIFFNESS)
    assert np.allclose(result.coefficient**2, squared, rtol=1e-9, atol=0)
    assert np.allclose(result.peak_overlap, peak, rtol=1e-10, atol=0)
    assert np.allclose(result.residual_overlap, REST * peak, rtol=1e-10, atol=0)
    no_residual = int(sj.Status.NO_RESIDUAL_OVERLAP)
    assert list(result.status) == [no_residual, no_residual, 0, no_residual]


class Dropping(Recoil):
    """The same, but nothing at all below ρ δ_m."""

    def unloading_force(self, overlap, peak_overlap):
        held = overlap > self.rest * peak_overlap
        return jnp.where(held, super().unloading_force(overlap, peak_overlap), 0.0)


def test_where_a_force_ends_moves_with_the_law_unless_it_drops():
    """δ* = ρ δ_m, of a force that is flat there too; a drop is told as INEXACT."""
    law = Dropping(STEEL, np.array([0.0, 0.2]), 2.0, np.array([0.5, 0.5]))

    @compiled_soon
    @jax.value_and_grad
    def residual(rest):
        moved = Dropping(STEEL, law.floor, law.power, rest)
        return sj.restitution(moved, 0.7).residual_overlap[0]

    peak = 0.7 * np.sqrt(STEEL.mass / STIFFNESS)
    value, slope = residual(law.rest)
    assert value == pytest.approx(0.5 * peak, rel=1e-9)
    assert slope[0] == pytest.approx(peak, rel=1e-4)
    assert slope[1] == 0
    status = sj.restitution(law, 0.7).status
    assert list(status & int(sj.Status.INEXACT) > 0) == [False, True]


class Plateau(sj.RateIndependentLaw):
    """Hertz's up to δ_y, the same force from there on, and back along a steep straight line."""

    contact: sj.Contact
    yield_overlap: float

    def yield_force(self):
        return self.contact.stiffness * self.yield_overlap**1.5

    def elastic_overlap(self):
        return self.yield_overlap

    def loading_force(self, overlap):
        return self.contact.stiffness * jnp.minimum(overlap, self.yield_overlap) ** 1.5

    def unloading_force(self, overlap, peak_overlap):
        steep = 2 * (peak_overlap - overlap) / self.yield_overlap
        return self.yield_force() * jnp.maximum(1 - steep, 0.0)


RATIOS = np.array([0.5, 1.5, 10.0, 1e3, 1e6])


@by_time_long
def test_a_plateau_up_to_a_million(route):
    """(2/5) y² = 2/5 + (x_m - 1) and ε² = (1/4)/((2/5) y²), by hand."""
    law = Plateau(STEEL, 1e-6)
    velocity = RATIOS * float(law.elastic_velocity())
    result = sj.restitution(law, velocity, route)
    peak = 1 + 0.4 * (RATIOS[1:] ** 2 - 1)
    assert np.allclose(result.peak_overlap[1:], 1e-6 * peak, rtol=1e-9, atol=0)
    assert np.allclose(result.residual_overlap[1:], 1e-6 * (peak - 0.5), rtol=1e-9, atol=0)
    # a law of overlaps alone knows x_m - x of a nearly plastic impact to the rounding of x_m
    assert np.allclose(result.coefficient[1:] ** 2, 0.625 / RATIOS[1:] ** 2, rtol=1e-8, atol=1e-15)
    assert list(result.status) == [1, 0, 0, 0, 0]
    assert result.coefficient[0] == 1


class Stages(sj.ReducedRateIndependent):
    """Elastic to 1.9, a straight line, one with a further slope of 20 beyond 3; back with a kink."""

    bound: jax.Array

    @property
    def elastic_limit(self):
        return 1.9

    def loading(self, x):
        line = 1.9**1.5 + 2 * (x - 1.9) + 20 * jnp.maximum(x - 3, 0)
        return jnp.where(x > 1.9, line, jnp.where(x > 0, x, 1.0) ** 1.5 * (x > 0))

    def unloading(self, x, peak):
        steep = 30.0 + 4.0 * jnp.maximum(1.9 - x, 0)
        return self.loading(peak) - steep * (peak - x)

    def breakpoints(self):
        return (3.0,)

    def end(self):
        return 40.0  # a Python number, beside fields that are arrays


class StagesLaw(sj.RateIndependentLaw):
    contact: sj.Contact
    bound: float

    def scales(self):
        return sj.Scales(1e-5, 0.1)

    def reduced(self):
        return Stages(jnp.asarray(self.bound))


@both_routes
def test_kinks_elastic_limits_and_ends(route):
    """Second slopes beyond x = 3 cost 1e-4 of ε_p in silence; `end` as a number raised."""
    y = np.array([1.0, 1.9**1.25 * 1.001, 2.5, 4.5, 6.0, 30.0, 500.0])
    result = sj.restitution(StagesLaw(STEEL, np.ones(7)), 0.1 * y, route)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    law = Stages(jnp.ones(()))
    turning = int(sj.Status.NO_TURNING_POINT)
    assert list(result.status) == [1, 0, 0, 0, 0, 0, turning]
    for k in range(1, 6):
        # two parabolas for the peak, polynomials for the work back
        start = 0.4 * (y[k] ** 2 - 1.9**2.5)
        force = 1.9**1.5
        a = (np.sqrt(force**2 + 4 * start) - force) / 2
        if a > 1.1:
            rest = start - force * 1.1 - 1.1**2
            at = force + 2.2
            a = 1.1 + (np.sqrt(at**2 + 44 * rest) - at) / 22
        peak = 1.9 + a
        assert np.isclose(result.peak_overlap[k], 1e-5 * peak, rtol=1e-9, atol=0)
        low = float(result.residual_overlap[k]) / 1e-5
        assert abs(float(law.unloading(jnp.asarray(low), jnp.asarray(peak)))) < 1e-7 * peak
        edges = [low, 1.9, peak] if low < 1.9 else [low, peak]
        work = 0.0
        for left, right in itertools.pairwise(edges):
            x = left + 0.5 * (right - left) * (nodes + 1)
            work += 0.5 * (right - left) * np.sum(weights * law.unloading(x, peak))
        assert np.isclose(result.coefficient[k] ** 2, work / (0.4 * y[k] ** 2), rtol=1e-8, atol=0)


class Told(Recoil):
    """Says itself what remains, which a search would find elsewhere."""

    def residual_overlap(self, peak_overlap):
        return 0.75 * peak_overlap


@both_routes
def test_what_remains_is_taken_from_the_law(route):
    result = sj.restitution(Told(STEEL, 0.0, 1.0, 0.5), 0.7, route)
    assert np.isclose(result.residual_overlap, 0.75 * result.peak_overlap, rtol=1e-12)
    assert np.isclose(result.coefficient**2, 2 * 0.25 * 0.75, rtol=1e-9)  # a trapezium's area


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


@pytest.mark.parametrize(
    "law", [sj.Hertz(STEEL), sj.Thornton(STEEL), sj.Zhou(STEEL, 1.8, 3.0, 0.5)]
)
def test_slopes_of_forces_at_zero_overlap(law):
    """0, where `x √x` gave NaN."""
    for mode in (jax.grad, jax.jacfwd):
        assert mode(law.loading_force)(0.0) == 0
        assert np.isfinite(mode(law.unloading_force)(0.0, 1e-5))


@pytest.mark.long
def test_slope_of_a_force_in_a_history():
    """Against differences; it was NaN."""
    route = sj.ODE(rtol=1e-12)
    squared = lambda q: sj.collide(sj.Thornton(STEEL, q), 1.0, 9, route).force[5] ** 2  # noqa: E731
    force = jax.jit(squared)
    step = 1e-5
    exact = (force(1.3 + step) - force(1.3 - step)) / (2 * step)
    assert np.isclose(jax.grad(force)(1.3), exact, rtol=1e-6)
    assert np.isclose(jax.jacfwd(force)(1.3), exact, rtol=1e-6)


class Open(sj.RateIndependentLaw):
    """Unloads by ((δ - δ*)/(δ_m - δ*))^{3/2}, no number below δ*; or 0 there, where `clipped`."""

    contact: sj.Contact
    length: float
    clipped: float

    def loading_force(self, overlap):
        return self.contact.stiffness * sj.power_3_2(overlap)

    def unloading_force(self, overlap, peak_overlap):
        rest = peak_overlap**2 / (peak_overlap + self.length)
        share = (overlap - rest) / (peak_overlap - rest)
        share = jnp.where(self.clipped > 0, jnp.maximum(share, 0.0), share)
        return self.loading_force(peak_overlap) * share**1.5


@by_time_long
def test_a_force_that_is_no_number_below_its_zero(route):
    """∫ s^{3/2} = 2/5 of the way: ε² = (δ_m - δ*)/δ_m; with or without a clip."""
    velocity = np.geomspace(1e-3, 10.0, 200)
    found, clipped = (sj.restitution(Open(STEEL, 1e-4, c), velocity, route) for c in (0.0, 1.0))
    peak = np.asarray(found.peak_overlap)
    assert found.coefficient == pytest.approx(np.sqrt(1e-4 / (peak + 1e-4)), rel=1e-8)
    assert np.array_equal(found.status, clipped.status)
    assert found.duration == pytest.approx(np.asarray(clipped.duration), rel=1e-8)


class Broken(Open):
    def unloading_force(self, overlap, peak_overlap):
        inside = (overlap > 0.5 * peak_overlap) & (overlap < 0.7 * peak_overlap)
        return jnp.where(inside, jnp.nan, self.contact.stiffness * sj.power_3_2(overlap))


@by_time_long
def test_a_force_that_is_no_number_on_its_way_has_no_answer_or_ends_there(route):
    """The contact ends where there is no force any more, as where there is none to begin with."""
    found = sj.restitution(Broken(STEEL, 1e-4, 0.0), [0.1, 1.0], route)
    assert np.all(np.isfinite(found.coefficient))
    ended = found.residual_overlap / found.peak_overlap
    assert np.all(found.status & int(sj.Status.SOLVER_FAILED) | (np.abs(ended - 0.7) < 1e-6))


class OfMath(Recoil):
    def loading_force(self, overlap):
        return STIFFNESS * overlap * math.exp(-overlap)


class OfNumpy(sj.RateDependentLaw):
    contact: sj.Contact
    end = "zero-force"

    def force(self, overlap, velocity):
        return STIFFNESS * overlap * np.exp(velocity)


class OfIf(Recoil):
    def unloading_force(self, overlap, peak_overlap):
        return 0.5 * STIFFNESS * overlap if overlap > 0.5 * peak_overlap else 0.0 * overlap


class HardOfMath(sj.HardSphereLaw):
    def restitution_squared(self, velocity):
        return math.exp(-velocity)


class KnownOfMath(OfNumpy):
    def closed_form(self, velocity):
        return sj.KnownCollision(math.exp(-velocity), velocity, velocity, velocity)


class Choosing(Recoil):
    def elastic_overlap(self):
        return 1e-7 if self.rest > 0 else 0.0


class Breaking(Recoil):
    def breakpoints(self):
        return (1e-7,) if self.rest > 0 else ()


@pytest.mark.parametrize(
    ("law", "method"),
    [
        (KnownOfMath(STEEL), "KnownOfMath.closed_form"),
        (Choosing(STEEL, 0.0, 1.0, 0.0), "Choosing.elastic_overlap"),
        (Breaking(STEEL, 0.0, 1.0, 0.0), "Breaking.breakpoints"),
        (OfMath(STEEL, 0.0, 1.0, 0.0), "OfMath.loading_force"),
        (OfIf(STEEL, 0.0, 1.0, 0.0), "OfIf.unloading_force"),
        (OfNumpy(STEEL), "OfNumpy.force"),
        (HardOfMath(), "HardOfMath.restitution_squared"),
    ],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_a_force_that_cannot_be_traced_is_named_in_one_line(law, method):
    with pytest.raises(ValueError, match=f"^`{method}` must be written with jax.numpy") as caught:
        sj.restitution(law, 1.0)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value.__cause__, TypeError)  # JAX's own, which knows the line
