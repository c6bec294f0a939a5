"""Forces of a user's law that steps and samples may miss: right, or flagged. Values are works by hand, and roots."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from tests.cases import pair

PAIR = pair("stainless steel")
K, LENGTH, CORE = float(PAIR.stiffness), 1e-4, 5e-6
ROUTES = pytest.mark.parametrize("route", [sj.EnergyBalance(), sj.ODE()], ids=["energy", "ode"])


class Hertzian(sj.RateIndependentLaw):
    contact: sj.Contact

    def loading_force(self, overlap):
        return K * sj.power_3_2(overlap)

    def unloading_force(self, overlap, peak_overlap):
        return 0.6 * self.loading_force(overlap)


class Needle(Hertzian):
    """A bump of a two-thousandth of the length with a quarter of the work."""

    def loading_force(self, overlap):
        away = (overlap - 0.2 * LENGTH) / (0.0005 * LENGTH)
        return K * sj.power_3_2(overlap) * (1 + 300 * jnp.exp(-(away**2)))

    def unloading_force(self, overlap, peak_overlap):
        return 0.6 * K * sj.power_3_2(overlap)


class Dip(Hertzian):
    """Below zero over 0.4 % of the way."""

    def unloading_force(self, overlap, peak_overlap):
        share = (overlap / peak_overlap - 0.4) / 0.6
        return self.loading_force(peak_overlap) * (share**2 - 1e-5)


class HardCore(Hertzian):
    """Half of it comes back; loading takes the energy within a rounding error of the core."""

    def loading_force(self, overlap):
        left = 1 - jnp.minimum(overlap, CORE) / CORE
        return jnp.where(overlap < CORE, 10 * overlap / LENGTH / left, jnp.inf)

    def unloading_force(self, overlap, peak_overlap):
        return 0.5 * self.loading_force(overlap)


class Spring(sj.RateDependentLaw):
    contact: sj.Contact
    damping: float
    end = "zero-overlap"

    def force(self, overlap, velocity):
        return 1e6 * overlap + 2 * self.damping * jnp.sqrt(1e6 * PAIR.mass) * velocity


class HuntCrossley(sj.RateDependentLaw):
    contact: sj.Contact
    dissipation: float
    end = "zero-force"

    def force(self, overlap, velocity):
        return K * sj.power_3_2(overlap) * (1 + self.dissipation * velocity)


@ROUTES
def test_a_bump_between_all_samples_is_flagged_where_its_work_is_not(route):
    """Right is √(0.6/(1 + 1.0646)) or so; the ODE's 0.7746 had no flag."""
    assert sj.Status.INEXACT in sj.Status(int(sj.restitution(Needle(PAIR), 1.0, route).status))


@ROUTES
def test_an_unloading_force_that_vanishes_between_two_samples_ends_the_contact(route):
    root = 1e-5**0.5
    work = 0.6 * ((1 - root**3) / 3 - 1e-5 * (1 - root))
    hit = sj.restitution(Dip(PAIR), 1.0, route)
    assert hit.status == sj.Status.PLAIN
    assert hit.coefficient**2 == pytest.approx(work / 0.4, rel=1e-8)
    assert hit.residual_overlap / hit.peak_overlap == pytest.approx(0.4 + 0.6 * root, rel=1e-8)


@ROUTES
def test_a_hard_core_is_flagged(route):
    """√½ is right; no overlap below the core has the work of the impact."""
    assert sj.Status.has_fault(sj.restitution(HardCore(PAIR), 1.0, route).status)


def test_a_contact_that_never_ends_says_so():
    hit = sj.restitution(Spring(PAIR, np.array([0.5, 1.0, 2.0])), 1.0)
    assert list(hit.status) == [sj.Status.PLAIN, sj.Status.NO_END, sj.Status.NO_END]
    assert hit.coefficient[0] == pytest.approx(np.exp(-np.pi / np.sqrt(3)), rel=1e-8)
    assert list(hit.coefficient[1:]) == [0, 0]
    assert list(hit.ok) == [True, False, False]


def test_hunt_and_crossleys_law_with_much_damping():
    """ln(1 + a) - ln(1 - aε) = a (1 + ε), a = d v; the force never vanishes before the overlap."""
    damping = [0.5, 30.0, 1000.0]
    hit = sj.restitution(HuntCrossley(PAIR, np.array(damping)), 1.0)

    def exact(a):
        # of z = 1 - aε, which is e^{-a - ...} where a is large
        def equation(w):
            return mp.log(1 + a) - w - a * (1 + (1 - mp.exp(w)) / a)

        return (1 - mp.exp(mp.findroot(equation, mp.log(1 + a) - a - 1))) / a

    expected = [float(exact(mp.mpf(a))) for a in damping]
    np.testing.assert_allclose(hit.coefficient, expected, rtol=1e-6)
    assert np.all(hit.ok)


def test_second_derivatives_of_the_largest_force_of_a_damped_law():
    """d²F/dε² of a linear spring: where the force is largest moves too."""

    def largest(restitution):
        loss = -mp.log(restitution)
        damping = loss / mp.sqrt(mp.pi**2 + loss**2)
        w = mp.sqrt(1 - damping**2)

        def force(t):
            sine = mp.sin(w * t) / w
            return mp.exp(-damping * t) * (sine + 2 * damping * (mp.cos(w * t) - damping * sine))

        return force(mp.findroot(lambda t: mp.diff(force, t), 1.0))

    with mp.workdps(40):
        unit = mp.sqrt(mp.mpf(1e6) * mp.mpf(float(PAIR.mass)))
        expected = [float(unit * mp.diff(largest, mp.mpf("0.4355"), n)) for n in (0, 1, 2)]
    of = lambda x: sj.restitution(sj.LinearSpringDashpot(PAIR, 1e6, x), 1.0).peak_force  # noqa: E731
    slope = jax.jit(jax.value_and_grad(of))
    found, (first, second) = of(0.4355), jax.jvp(lambda x: slope(x)[1], (0.4355,), (1.0,))
    np.testing.assert_allclose([found, first, second], expected, rtol=1e-6)
