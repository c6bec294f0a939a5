"""Laws given by their forces alone, by both routes: against the built-in ones, SciPy and by hand."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import softjax as sj
from tests.cases import compiled_soon
from tests.laws import QUANTITIES, graded, numbers, repeated
from tests.physics.own_laws import PAIRS, STEEL, JacksonGreen, published_fit

ROUTES = {"energy": sj.EnergyBalance(), "ode": sj.ODE(rtol=1e-10)}
PRECISE = sj.ODE(rtol=1e-12)
both_routes = pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES)
by_time_long = pytest.mark.parametrize(
    "route",
    [pytest.param(r, id=n, marks=[pytest.mark.long] * (n == "ode")) for n, r in ROUTES.items()],
)
STIFFNESS = 1e6
PACE = np.sqrt(STEEL.mass / STIFFNESS)  # peak overlap over velocity, of a spring
INEXACT, OPEN = sj.Status.INEXACT, sj.Status.NO_RESIDUAL_OVERLAP


# the library's laws, written in SI

VELOCITY = STEEL.critical_velocity * np.array([0.3, 1.5, 4.0, 20.0, 300.0])
IN_SI = [
    pytest.param(
        name,
        route,
        id=f"{name}-{'ode' if route else 'energy'}",
        # up to 40 s to compile by the ODE, with slopes
        marks=pytest.mark.long,
    )
    for name in PAIRS
    for route in (None, PRECISE)
    if (name, route) != ("viscoelastic", None)
]


@pytest.mark.parametrize(("name", "route"), IN_SI)
def test_laws_in_si_are_the_built_in_ones(name, route):
    """Values and slopes of ε, both overlaps and the duration, and the status."""
    own, built_in = PAIRS[name]
    found, exact = (graded(law, repeated(law, VELOCITY), route) for law in (own, built_in))
    size = np.max(np.abs(exact[0]), axis=1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    assert np.all(np.abs(found[0] - exact[0]) <= 1e-9 * size)
    assert np.allclose(found[0][3], exact[0][3], rtol=1e-9, atol=0)
    same = list(numbers(own, 1.0))
    assert set(same) <= set(numbers(built_in, 1.0))
    rows = [k for k, number in enumerate(numbers(built_in, 1.0)) if number in same]
    for k in (2, 3):
        assert np.all(np.abs(found[k] - np.asarray(exact[k])[rows]) <= 3e-9 * size), QUANTITIES
    if name == "hertz":  # in SI it does not say that it never yields
        assert np.all(found[1].status == OPEN)
    else:
        assert np.array_equal(found[1].status, exact[1].status)


@pytest.mark.parametrize("name", ["thornton", "zhou"])
def test_values_in_si(name):
    found, exact = (sj.restitution(law, VELOCITY) for law in PAIRS[name])
    for quantity in QUANTITIES:
        one, other = getattr(found, quantity), getattr(exact, quantity)
        assert np.allclose(one, other, rtol=1e-9, atol=1e-9 * np.max(other)), quantity
    assert np.array_equal(found.status, exact.status)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long) for n in PAIRS])
def test_histories_in_si(name):
    own, built_in = PAIRS[name]
    velocity = VELOCITY[1:4:2]
    found = sj.collide(own, velocity, samples=21, route=PRECISE)
    exact = sj.collide(built_in, velocity, samples=2001, route=PRECISE)
    assert np.allclose(found.duration, exact.duration, rtol=1e-9, atol=0)
    assert np.allclose(found.velocity[:, -1], exact.velocity[:, -1], rtol=0, atol=1e-9)
    assert np.allclose(found.overlap[:, 10], exact.overlap[:, 1000], rtol=1e-9, atol=0)


# a law from the literature

RATIOS = np.array([1.5, 3.0, 10.0, 40.0, 80.0, 400.0, 900.0])


@by_time_long
def test_jackson_and_green(route):
    """Against SciPy's quadrature and root, and against what its authors fitted to theirs."""
    steel, rigid = sj.Material(1.93e11, 0.32, 8030.0, 3.1e8), sj.Material(1e16, 0.3, 1e4, 1e12)
    law = JacksonGreen(sj.Contact.with_wall(steel, rigid, 0.0127, area="hertz"), 0.32)
    critical, unit = float(law.critical_overlap()), float(law.critical_force())
    pace = np.sqrt(0.8 * unit * critical / float(law.contact.mass))
    loading, starts = jax.jit(law.loading_force), 1.9 + 1e-14  # the force jumps by a hair there

    def excess(w, energy):
        """The work of loading up to δ/δ_c = w beyond an energy, both over F_c δ_c."""
        beyond = quad(lambda x: float(loading(x * critical)) / unit, starts, w, epsrel=1e-12)[0]
        return 0.4 * 1.9**2.5 + beyond - energy

    result = sj.restitution(law, RATIOS * pace, route)
    assert list(result.status) == [sj.Status.ELASTIC] + [sj.Status.PLAIN] * (len(RATIOS) - 1)
    for k, ratio in list(enumerate(RATIOS))[1:]:
        energy = 0.4 * ratio**2
        peak = critical * brentq(excess, starts, 1e4, args=(energy,), xtol=1e-13, rtol=1e-14)
        rest = float(law.residual_overlap(peak))
        back = 0.4 * float(law.loading_force(peak)) * (peak - rest)  # Hertz's work
        assert result.peak_overlap[k] == pytest.approx(peak, rel=1e-8)
        assert result.residual_overlap[k] == pytest.approx(rest, rel=1e-8)
        assert result.coefficient[k] ** 2 == pytest.approx(
            back / (energy * unit * critical), rel=1e-8
        )
    strain = law.contact.yield_strength / law.contact.youngs_modulus
    assert np.max(np.abs(result.coefficient - published_fit(RATIOS, strain))) < 0.02


# springs that give back what a shape says


class Shaped(sj.RateIndependentLaw):
    """A linear spring that gives back P_m times a shape of s = (δ - ρ δ_m)/(δ_m - ρ δ_m)."""

    contact: sj.Contact
    kind: float
    rest: float

    def loading_force(self, overlap):
        return STIFFNESS * overlap

    def unloading_force(self, overlap, peak_overlap):
        s = (overlap / peak_overlap - self.rest) / (1 - self.rest)
        t = jnp.where(s > 0, s, 1.0)
        inside = lambda y: jnp.where(s > 0, y, 0.0)  # noqa: E731
        shapes = [
            s,
            inside(t),
            inside(t**1.5),
            inside(t**2.5),
            inside(jnp.sqrt(t)),
            s**3,
            -jnp.expm1(-20 * s) / -np.expm1(-20.0),
            jnp.where(s > 0, 0.5 * (1 + s), -0.5),
            inside(0.5 * (1 + s)),
        ]
        index = jnp.arange(len(shapes))
        return (
            STIFFNESS * peak_overlap * jnp.sum(jnp.where(index == self.kind, jnp.stack(shapes), 0))
        )


SHARES = np.array([0.5, 0.5, 0.4, 2 / 7, 2 / 3, 0.25, 1 / -np.expm1(-20.0) - 0.05, 0.75, 0.75])


@by_time_long
def test_where_an_unloading_force_ends(route):
    """ε² = 2 (1 - ρ) ∫ shape ds: straight, clipped, of any power, bent, and where it jumps or drops."""
    kind, rest = np.arange(9.0), np.array([[0.37], [0.9]])
    result = sj.restitution(Shaped(STEEL, kind, rest), 0.7, route)
    peak, smooth = 0.7 * PACE, kind < 7
    assert np.allclose(result.peak_overlap, peak, rtol=1e-9, atol=0)
    tolerance = 1e-9 if route == ROUTES["energy"] else 1e-7
    off = np.abs(result.coefficient**2 - 2 * (1 - rest) * SHARES)
    assert np.all(off[:, smooth] < tolerance)
    off = np.abs(result.residual_overlap / peak - rest)
    assert np.all(off[:, smooth] < tolerance)
    if route == ROUTES["energy"]:
        assert np.all(off < 1e-12)
        assert np.array_equal(result.status & int(INEXACT) > 0, np.ones((2, 1)) * ~smooth > 0)
        assert np.allclose(result.coefficient**2, 2 * (1 - rest) * SHARES, rtol=1e-4)


class Recoil(sj.RateIndependentLaw):
    """A linear spring that gives back P_m [c + (1 - c) s^n], not below c."""

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


class Told(Recoil):
    """Says itself what remains, which a search would find elsewhere."""

    def residual_overlap(self, peak_overlap):
        return 0.75 * peak_overlap


# positive down to zero overlap; zero there; clipped at zero; just above zero by a hair
FLOOR, POWER = np.array([0.2, 0.0, 0.0, 1e-9]), np.array([2.0, 2.0, 1.0, 3.0])
REST = np.array([0.0, 0.0, 0.5, 0.0])


@by_time_long
def test_unloading_down_to_zero_overlap(route):
    """ε² = 2 (1 - ρ) [c + (1 - c)/(n + 1)] by hand; under `jit`; and where the law tells δ*."""
    law = Recoil(STEEL, FLOOR, POWER, REST)
    result = jax.jit(lambda v: sj.restitution(law, v, route))(jnp.full(4, 0.7))
    squared = 2 * (1 - REST) * (FLOOR + (1 - FLOOR) / (POWER + 1))
    assert np.allclose(result.coefficient**2, squared, rtol=1e-9, atol=0)
    assert np.allclose(result.residual_overlap, REST * 0.7 * PACE, rtol=1e-10, atol=0)
    assert list(result.status) == [OPEN, OPEN, 0, OPEN]
    known = sj.restitution(Told(STEEL, 0.0, 1.0, 0.5), 0.7, route)
    assert np.isclose(known.residual_overlap, 0.75 * known.peak_overlap, rtol=1e-12)
    assert np.isclose(known.coefficient**2, 2 * 0.25 * 0.75, rtol=1e-9)  # a trapezium's area


def test_the_slope_of_where_a_force_ends():
    """δ* = ρ δ_m by a search, of a force that is flat there too."""
    law = Recoil(STEEL, 0.0, 2.0, 0.5)

    @compiled_soon
    @jax.value_and_grad
    def residual(rest):
        return sj.restitution(Recoil(STEEL, law.floor, law.power, rest), 0.7).residual_overlap

    value, slope = residual(0.5)
    assert value == pytest.approx(0.35 * PACE, rel=1e-9)
    assert slope == pytest.approx(0.7 * PACE, rel=1e-4)


# loading


class Loading(sj.RateIndependentLaw):
    """k L^{1-p} δ^p, or a force that falls from F at touch to 0 at `end`, or is no number from there."""

    contact: sj.Contact
    power: float
    end: float
    kind: float

    def loading_force(self, overlap):
        x = overlap / 1e-4
        inside = x > 0
        power = jnp.where(inside, jnp.where(inside, x, 1.0) ** self.power, self.power == 0)
        falls = 1 - x / self.end
        ends = jnp.where(x < self.end, 1.0, jnp.nan)
        force = jnp.where(self.kind == 0, power, jnp.where(self.kind == 1, falls, ends))
        return 100.0 * force

    def unloading_force(self, overlap, peak_overlap):
        return self.loading_force(peak_overlap) * overlap / peak_overlap


@by_time_long
def test_how_far_a_body_comes(route):
    """Powers of the overlap over 24 decades of energy: F L (δ/L)^{p+1}/(p + 1) = ½ M v²."""
    power, v = np.meshgrid([0.0, 1.0, 1.5, 4.0], [1e-9, 1e-3, 1.0, 1e3])
    result = sj.restitution(Loading(STEEL, power, 1.0, 0.0), v, route)
    energy = 0.5 * STEEL.mass * v**2 / (100.0 * 1e-4)
    peak = 1e-4 * ((power + 1) * energy) ** (1 / (power + 1))
    assert np.allclose(result.peak_overlap, peak, rtol=1e-9, atol=0)
    assert np.allclose(result.coefficient**2, 0.5 * (power + 1), rtol=1e-8)  # a straight line back
    gains = (result.status & int(sj.Status.ENERGY_GAIN)) > 0
    assert np.array_equal(gains, power > 1)


@by_time_long
def test_a_loading_force_that_ends(route):
    """A triangle of work F end/2 turns a body of less energy; so does what is no number from `end`."""
    share, kind, end = (
        np.array([0.8, 1.2, 0.9, 1.1]),
        np.array([1, 1, 2, 2]),
        np.array([1.3, 3, 2, 2]),
    )
    whole = 100.0 * 1e-4 * np.where(kind == 1, 0.5, 1.0) * end
    v = np.sqrt(2 * share * whole / STEEL.mass)
    result = sj.restitution(Loading(STEEL, 0.0, end, kind * 1.0), v, route)
    turns = result.status & int(sj.Status.NO_TURNING_POINT) == 0
    assert list(turns) == [True, False, True, False]
    exact = 1e-4 * end[0] * (1 - np.sqrt(1 - share[0]))
    assert result.peak_overlap[0] == pytest.approx(exact, rel=1e-8)
    assert result.peak_overlap[2] == pytest.approx(1e-4 * 2 * 0.9, rel=1e-8)
    assert np.all(np.asarray(result.coefficient)[~np.asarray(turns)] == 0)


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


@by_time_long
def test_a_plateau_up_to_a_million(route):
    """(2/5) y² = 2/5 + (x_m - 1) and ε² = (1/4)/((2/5) y²), by hand."""
    law, y = Plateau(STEEL, 1e-6), np.array([0.5, 1.5, 10.0, 1e3, 1e6])
    result = sj.restitution(law, y * float(law.elastic_velocity()), route)
    limit = np.sqrt(0.8 * STEEL.stiffness * 1e-6**2.5 / STEEL.mass)
    assert law.elastic_velocity() == pytest.approx(limit, rel=1e-13)
    peak = 1 + 0.4 * (y[1:] ** 2 - 1)
    assert np.allclose(result.peak_overlap[1:], 1e-6 * peak, rtol=1e-9, atol=0)
    assert np.allclose(result.residual_overlap[1:], 1e-6 * (peak - 0.5), rtol=1e-9, atol=0)
    # a law of overlaps alone knows x_m - x of a nearly plastic impact to the rounding of x_m
    assert np.allclose(result.coefficient[1:] ** 2, 0.625 / y[1:] ** 2, rtol=1e-8, atol=1e-15)
    assert list(result.status) == [1, 0, 0, 0, 0]
    assert result.coefficient[0] == 1


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


@by_time_long
def test_kinks_elastic_limits_and_ends(route):
    """Two parabolas for the peak, polynomials between the kinks for the work back."""
    y = np.array([1.0, 1.9**1.25 * 1.001, 2.5, 4.5, 6.0, 30.0, 500.0])
    result = sj.restitution(InScales(STEEL), 0.1 * y, route)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    law = Stages()
    assert list(result.status) == [1, 0, 0, 0, 0, 0, sj.Status.NO_TURNING_POINT]
    for k in range(1, 6):
        start, force = 0.4 * (y[k] ** 2 - 1.9**2.5), 1.9**1.5
        a = (np.sqrt(force**2 + 4 * start) - force) / 2
        if a > 1.1:
            rest, at = start - force * 1.1 - 1.1**2, force + 2.2
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


@by_time_long
def test_arcs_of_a_circle(route):
    """x'' = -x, then -(2x - 1), then -3 (x - x*): peak, what is left, ε and the duration by hand."""
    y = np.array([0.5, 1.5, 4.0])
    peak = np.where(y > 1, 0.5 * (1 + np.sqrt(np.maximum(2 * y**2 - 1, 0))), y)
    force = np.where(y > 1, 0.8 * (2 * peak - 1), 0.8 * peak)
    result = sj.restitution(InScales(STEEL, "spring"), 0.1 * y, route)
    assert np.allclose(result.peak_overlap, 1e-5 * peak, rtol=1e-10, atol=0)
    returned = np.where(y > 1, force**2 / 4.8 / (0.4 * y**2), 1.0)
    assert np.allclose(result.coefficient**2, returned, rtol=1e-9, atol=0)
    residual = np.where(y > 1, peak - force / 2.4, 0.0)
    assert np.allclose(result.residual_overlap, 1e-5 * residual, rtol=1e-9, atol=1e-14)
    beyond = np.arctan(np.sqrt(y[1:] ** 2 - 1) * np.sqrt(2)) / np.sqrt(2)
    time = np.append(np.pi, np.arcsin(1 / y[1:]) + beyond + 0.5 * np.pi / np.sqrt(3))
    assert np.allclose(result.duration, time * 1e-4, rtol=1e-8, atol=0)


# forces that are no numbers somewhere


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


class Broken(Open):
    def unloading_force(self, overlap, peak_overlap):
        inside = (overlap > 0.5 * peak_overlap) & (overlap < 0.7 * peak_overlap)
        return jnp.where(inside, jnp.nan, self.contact.stiffness * sj.power_3_2(overlap))


@by_time_long
def test_forces_that_are_no_numbers_below_their_zero_or_on_the_way(route):
    """∫ s^{3/2} = 2/5 of the way: ε² = (δ_m - δ*)/δ_m, with or without a clip; else it ends there."""
    velocity = np.geomspace(1e-3, 10.0, 200)
    found, clipped = (sj.restitution(Open(STEEL, 1e-4, c), velocity, route) for c in (0.0, 1.0))
    peak = np.asarray(found.peak_overlap)
    assert found.coefficient == pytest.approx(np.sqrt(1e-4 / (peak + 1e-4)), rel=1e-8)
    assert np.array_equal(found.status, clipped.status)
    assert found.duration == pytest.approx(np.asarray(clipped.duration), rel=1e-8)
    broken = sj.restitution(Broken(STEEL, 1e-4, 0.0), [0.1, 1.0], route)
    assert np.all(np.isfinite(broken.coefficient))
    ended = np.abs(broken.residual_overlap / broken.peak_overlap - 0.7) < 1e-6
    assert np.all((broken.status & int(sj.Status.SOLVER_FAILED) > 0) | ended)


@pytest.mark.parametrize("law", [law for _, law in PAIRS.values()][:4], ids=list(PAIRS)[:4])
def test_slopes_of_forces_at_zero_overlap(law):
    """Numbers, where `x √x` gave NaN."""
    for mode in (jax.grad, jax.jacfwd):
        assert np.isfinite(mode(law.loading_force)(0.0))
        assert np.isfinite(mode(law.unloading_force)(0.0, 1e-5))


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

    assert sj.restitution(Always(STEEL), 1.0).status == sj.Status.ELASTIC
