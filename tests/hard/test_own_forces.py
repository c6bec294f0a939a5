"""Forces of a user's law that steps and samples may miss: right, or flagged. Values are works by hand, and roots."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import softjax as sj
from tests.cases import mostly_long, pair, same_flags

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
    assert same_flags(hit.status, sj.Status.PLAIN)
    assert hit.coefficient**2 == pytest.approx(work / 0.4, rel=1e-8)
    assert hit.residual_overlap / hit.peak_overlap == pytest.approx(0.4 + 0.6 * root, rel=1e-8)


@ROUTES
def test_a_hard_core_is_flagged(route):
    """√½ is right; no overlap below the core has the work of the impact."""
    assert sj.Status.has_fault(sj.restitution(HardCore(PAIR), 1.0, route).status)


@pytest.mark.parametrize(
    ("route", "bound"), [(sj.ODE(), 1e-8), (sj.TimeODE(), 1e-6)], ids=["ode", "in time"]
)
def test_a_contact_that_never_ends_says_so(route, bound):
    """exp(-πξ/√(1 - ξ²)) below critical damping; the bound in time is 150 times its rtol."""
    hit = sj.restitution(Spring(PAIR, np.array([0.5, 1.0, 2.0])), 1.0, route)
    assert np.all(same_flags(hit.status, [sj.Status.PLAIN, sj.Status.NO_END, sj.Status.NO_END]))
    assert hit.coefficient[0] == pytest.approx(np.exp(-np.pi / np.sqrt(3)), rel=bound)
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


def linear_spring(restitution):
    """By the closed motion; times Z^{1/5} Hertz's dashpot, which δ^{5/4} turns into this motion over another time."""
    return largest_in_closed_form(restitution, 0), np.sqrt(1e6 * PAIR.mass)


def hertz_dashpot(restitution):
    unit = (0.8 * PAIR.stiffness * PAIR.mass) ** 0.5 * 1.25
    return largest_in_closed_form(restitution, mp.mpf(1) / 5), unit * (
        0.8 * PAIR.stiffness / PAIR.mass
    ) ** -0.1


def largest_in_closed_form(restitution, power):
    loss = -mp.log(restitution)
    damping = loss / mp.sqrt(mp.pi**2 + loss**2)
    w = mp.sqrt(1 - damping**2)

    def force(t):
        sine, decay = mp.sin(w * t) / w, mp.exp(-damping * t)
        speed = decay * (mp.cos(w * t) - damping * sine)
        return (decay * sine) ** power * (decay * sine + 2 * damping * speed)

    return force(mp.findroot(lambda t: mp.diff(force, t), 1.0))


def viscoelastic(damping):
    """s³ + (3/2) a s u over s = √x, whose rate of u = x' is -2 s² (s² + (3/2) a u)/u: smooth as far as the largest force."""
    damping = float(damping)

    def rate(s, u):
        return -2 * s**2 * (s**2 + 1.5 * damping * u) / u

    def slope(s, u):
        return 3 * s**2 + 1.5 * damping * (u[0] + s * rate(s, u[0]))

    slope.terminal, slope.direction = True, -1
    way = solve_ivp(rate, (0, 2), [1.0], "DOP853", events=slope, rtol=1e-13, atol=1e-13)
    at, u = way.t_events[0][0], way.y_events[0][0, 0]
    unit = PAIR.stiffness * (PAIR.mass / PAIR.stiffness) ** 0.6
    return at**3 + 1.5 * damping * at * u, unit


LENGTH_OF_ONE = float((PAIR.mass / PAIR.stiffness) ** 0.4)  # of impacts at 1 m/s
DAMPED = {
    "linear": (linear_spring, lambda x: sj.LinearSpringDashpot(PAIR, 1e6, x)),
    "hertz": (hertz_dashpot, lambda x: sj.HertzDashpot(PAIR, x)),
    "viscoelastic": (viscoelastic, lambda x: sj.ViscoelasticHertz(PAIR, x * LENGTH_OF_ONE)),
}


@mostly_long("name", DAMPED, ["hertz"])
def test_second_derivatives_of_the_largest_force_of_a_damped_law(name):
    """d²F/dε², or by the viscoelastic time: where the force is largest moves too."""
    exact, law = DAMPED[name]
    with mp.workdps(25):
        at, h = mp.mpf("0.4355"), mp.mpf("0.0025")
        low, before, here, after, high = (
            unit * F for F, unit in (exact(at + k * h) for k in range(-2, 3))
        )
        first = (low - 8 * before + 8 * after - high) / (12 * h)
        second = (-low + 16 * before - 30 * here + 16 * after - high) / (12 * h**2)
        expected = [float(here), float(first), float(second)]
    of = lambda x: sj.restitution(law(x), 1.0).peak_force  # noqa: E731
    slope = jax.jit(jax.value_and_grad(of))
    found = of(0.4355), *jax.jvp(lambda x: slope(x)[1], (0.4355,), (1.0,))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
