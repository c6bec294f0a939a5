"""Forces in newtons, integrated by SciPy, give the restitution that the library computes from them."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import bisect, brentq

import softjax as sj

sj.enable_x64()
PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)
STIFF = {"loading_stiffness": 1e6, "unloading_stiffness": 1.6e6, "growth": 2e5}

RATE_INDEPENDENT = [
    sj.Hertz(PAIR),
    sj.Zhou(PAIR, 1.7944, 3.0432, 0.54),
    sj.Zhou(PAIR, 0.1, 3.0432, 0.54, form="full"),
    sj.Zhou(PAIR, 1.7944, 3.0432, 0.54, form="full", kappa="printed"),
    sj.Thornton(PAIR, 1.6),
    sj.WaltonBraun(PAIR, **STIFF),
]
RATE_DEPENDENT = [
    kind(PAIR, *numbers, end)
    for end in ("zero-overlap", "zero-force")
    for kind, numbers in ((sj.LinearSpringDashpot, (1e6, 0.7)), (sj.HertzDashpot, (0.7,)))
] + [sj.ViscoelasticHertz(PAIR, 1e-6)]
RATIOS = (0.02, 0.7, 0.999, 1.5, 20.0)  # velocity over that of first yield


def name(law):
    return " ".join(str(getattr(law, part, "")) for part in ("form", "kappa", "end")).strip()


def collided(law, velocity):
    """ε_p, largest and residual overlap [m] by SciPy's quadrature of the two forces."""
    energy = 0.5 * float(law.contact.mass) * velocity**2
    kinks = [float(kink) for kink in law.breakpoints() if np.isfinite(kink)]

    def work(force, low, high):
        ends = [low, *(kink for kink in kinks if low < kink < high), high]
        parts = itertools.pairwise(ends)
        return sum(quad(force, a, b, epsabs=0, epsrel=1e-12)[0] for a, b in parts)

    loading = jax.jit(law.loading_force)
    unloading = jax.jit(law.unloading_force)
    hertz = (2.5 * energy / float(law.contact.stiffness)) ** 0.4
    peak = brentq(
        lambda x: work(loading, 0.0, x) / energy - 1, 0.0, 100 * hertz, xtol=1e-20, rtol=1e-14
    )
    back = lambda x: float(unloading(x, peak))  # noqa: E731
    steps = peak * np.linspace(1, 0, 400)
    below = next((k for k, x in enumerate(steps[:-1]) if back(x) <= 0), None)
    pulls = lambda x: back(x) or -1.0  # noqa: E731  (some laws' force is 0 below its zero)
    ends = {"xtol": 1e-20, "rtol": 1e-14}
    rest = 0.0 if below is None else bisect(pulls, steps[below], steps[below - 1], **ends)
    return math.sqrt(work(back, rest, peak) / energy), peak, rest


@pytest.mark.parametrize("law", RATE_INDEPENDENT, ids=lambda law: type(law).__name__ + name(law))
@pytest.mark.parametrize("ratio", RATIOS)
def test_integrated_forces_give_the_plastic_restitution(law, ratio):
    """An unloading force that is not Hertz's below first yield, or is in other units, shows here."""
    velocity = ratio * float(PAIR.critical_velocity)
    found = sj.restitution(law, velocity)
    coefficient, peak, rest = collided(law, velocity)
    assert coefficient == pytest.approx(float(found.plastic_coefficient), rel=1e-10)
    assert peak == pytest.approx(float(found.peak_overlap), rel=1e-10)
    assert rest == pytest.approx(float(found.residual_overlap), rel=1e-8, abs=1e-6 * peak)


@pytest.mark.parametrize("law", RATE_DEPENDENT, ids=lambda law: type(law).__name__ + name(law))
def test_integrated_damped_forces_give_the_restitution(law):
    """A damping force off by a factor, or the other end of the contact, shows here."""
    velocity, force = 0.3, jax.jit(law.force)
    duration = float(sj.restitution(law, velocity).duration)

    def motion(_, state):
        return [state[1], -float(force(max(state[0], 0.0), state[1])) / float(PAIR.mass)]

    def ended(time, state):
        pulls = float(force(max(state[0], 0.0), state[1])) if law.end == "zero-force" else 1.0
        return 1.0 if state[1] > 0 else min(state[0], pulls)

    ended.terminal, ended.direction = True, -1
    options = {"rtol": 1e-10, "atol": 1e-17, "events": ended, "method": "DOP853"}
    flight = solve_ivp(motion, (0.0, 3 * duration), [0.0, velocity], **options)
    rebound = -flight.y[1, -1] / velocity
    assert rebound == pytest.approx(float(sj.restitution(law, velocity).coefficient), rel=1e-6)
    assert flight.t[-1] == pytest.approx(duration, rel=1e-6)


class Sum(sj.RateIndependentLaw):
    """Zhou's two forces, in a law of the user's."""

    contact: sj.Contact
    zhou: sj.Zhou

    def loading_force(self, overlap):
        return self.zhou.loading_force(overlap)

    def unloading_force(self, overlap, peak_overlap):
        return self.zhou.unloading_force(overlap, peak_overlap)

    def breakpoints(self):
        return self.zhou.breakpoints()


@pytest.mark.parametrize("form", ["first-order", "full"])
def test_a_law_made_of_a_built_in_ones_forces_is_elastic_where_that_is(form):
    """ε_p = 1 below first yield; plastic unloading continued there gave NO_REBOUND and 1.0855."""
    zhou = sj.Zhou(PAIR, 1.7944, 3.0432, 0.54, form=form)
    velocity = np.array(RATIOS) * float(PAIR.critical_velocity)
    found, wanted = sj.restitution(Sum(PAIR, zhou), velocity), sj.restitution(zhou, velocity)
    assert np.asarray(found.plastic_coefficient) == pytest.approx(
        np.asarray(wanted.plastic_coefficient), rel=1e-9
    )
    assert not np.any(found.status & int(sj.Status.NO_REBOUND))


@pytest.mark.parametrize("form", ["first-order", "full"])
def test_an_elastic_unloading_force_has_hertzs_slopes(form):
    """k δ^{3/2} below first yield: no slope in the peak nor in χ̃, (3/2) k √δ in the overlap."""
    zhou = sj.Zhou(PAIR, 1.7944, 3.0432, 0.54, form=form)
    peak = 0.5 * float(PAIR.critical_overlap)
    overlap = 0.3 * peak
    slopes = jax.grad(lambda law, x, top: law.unloading_force(x, top), (0, 1, 2))(
        zhou, overlap, jnp.asarray(peak)
    )
    assert float(slopes[1]) == pytest.approx(
        1.5 * float(PAIR.stiffness) * math.sqrt(overlap), rel=1e-12
    )
    assert float(slopes[2]) == 0
    assert float(slopes[0].chi) == 0
