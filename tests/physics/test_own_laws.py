"""Laws of the user's: forces of built-in ones, what a law states itself, and laws given in their scales."""

import itertools
from functools import partial

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from tests.laws import LAWS, QUANTITIES, WITH_FORCE, numbers, repeated, with_numbers
from tests.physics.by_forces import LENGTH, STEEL, Forces, columns
from tests.physics.own_laws import borrowed

ROUTES = {"energy": sj.EnergyBalance(), "ode": sj.ODE(rtol=1e-10)}
by_time_long = pytest.mark.parametrize(
    "route",
    [pytest.param(r, id=n, marks=[pytest.mark.long] * (n == "ode")) for n, r in ROUTES.items()],
)
OPEN = sj.Status.NO_RESIDUAL_OVERLAP


QUICK = [("walton-braun", "energy")]
BORROWED = [
    pytest.param(name, route, marks=[] if (name, route) in QUICK else pytest.mark.long)
    for name in WITH_FORCE
    for route in ROUTES
    if route == "ode" or isinstance(LAWS[name].law, sj.RateIndependentLaw)
]


@pytest.mark.parametrize(("name", "route"), BORROWED)
def test_laws_of_borrowed_forces_are_the_built_in_ones(name, route):
    """Values and slopes of ε_p, both overlaps and the duration, along a direction in all numbers."""
    law, by = LAWS[name].law, sj.ODE(rtol=1e-12) if route == "ode" else None
    values = repeated(law, LAWS[name].velocity)
    along = {name: np.cos(1.0 + k) for k, name in enumerate(values)}

    def quantities(values):
        hit = sj.restitution(borrowed(with_numbers(law, values)), values["velocity"], by)
        parts = ("plastic_coefficient", *QUANTITIES[1:])
        return jnp.stack([getattr(hit, part) for part in parts]), hit.status

    moved = {name: along[name] * x for name, x in values.items()}
    found, slopes, status = jax.jit(partial(jax.jvp, quantities, has_aux=True))((values,), (moved,))
    with mp.workdps(40):
        step, rows = mp.mpf("1e-10"), []
        for v in LAWS[name].velocity:
            at = {key: mp.mpf(float(x)) for key, x in numbers(law, v).items()}
            at |= {"sigma": mp.mpf(0)} if "sigma" in at else {}  # no losses but those of the force
            down, here, up = (
                LAWS[name].exact({key: x * (1 + s * along[key]) for key, x in at.items()})[:4]
                for s in (-step, 0, step)
            )
            rows.append([here, [(a - b) / (2 * step) for a, b in zip(up, down, strict=True)]])
        exact, exact_slopes = np.array(rows, float).transpose(1, 2, 0)
    size = np.max(np.abs(exact), axis=1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    assert np.all(np.abs(found - exact) <= 1e-9 * size)
    assert np.allclose(found[3], exact[3], rtol=1e-9, atol=0)
    assert np.all(np.abs(slopes - exact_slopes) <= 3e-9 * size)
    flags = LAWS[name].status if name != "hertz" else OPEN  # Hertz's forces cannot say never
    assert np.all(status == np.array(flags))


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
    if isinstance(route, sj.ODE):
        path = sj.collide(InScales(STEEL), 0.1 * y[1:6], samples=5, route=route)
        ends = y[1:6] * np.array([np.ones(5), -result.coefficient[1:6]])
        assert np.allclose(path.velocity[:, [0, -1]].T, 0.1 * ends, rtol=1e-9)
        assert np.allclose(path.overlap[:, 2], result.peak_overlap[1:6], rtol=1e-7)
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
