"""Cheaper laws in place of the target, each with the smallest largest error of ε.

In the order of what they cost a code: constant ε by a linear spring, by Hertz's spring,
viscoelastic spheres, Walton and Braun's spring. Springs that ε says nothing of are as stiff as
gives the requested overlap at the fastest impact.

Softer springs at the same ε: overlaps and durations grow by a factor μ, forces fall by it. With
P'(δ, δ') = P(δ/μ, δ')/μ every impact is the old one with lengths and times μ times as large.
"""

import cmath
import dataclasses
import math
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize

import softjax as sj
from calibration.particle_codes.target import Target, number_of, restitution_of

END = "zero-force"  # of damped contacts: nothing pulls
LEAST = math.exp(-2)  # ε of critical damping with this end
MOST_DAMPING = 500.0  # Λ, of ε within 3e-5 of the least
# w² = 3/2 A (k/M)^{2/5} v^{1/5}, the one number of viscoelastic spheres: ε from 1 - 1e-9 to 3e-7
LEAST_LOSS, MOST_LOSS = 1e-9, 1e4
BEYOND = 2.0  # the overlap up to which k2 grows, over the largest of the range
POWERS = {  # of the factor, by which a field is multiplied
    sj.LinearSpringDashpot: {"stiffness": -2},
    sj.WaltonBraun: {"loading_stiffness": -2, "unloading_stiffness": -2, "growth": -1},
    sj.HertzDashpot: {},
    sj.ViscoelasticHertz: {"dissipation_time": 1},
}
OF_MODULUS = sj.HertzDashpot, sj.ViscoelasticHertz


def constant_restitution(target: Target) -> float:
    """The ε in the middle of the target."""
    return float(max(np.max(target.restitution) + np.min(target.restitution), 2.001 * LEAST) / 2)


def linear(target: Target, overlap: float) -> sj.LinearSpringDashpot:
    """Constant ε; its stiffness gives `overlap` [m] to the fastest impact."""
    return sj.LinearSpringDashpot(target.contact, _spring(target, overlap), _set(target), end=END)


def hertz_dashpot(target: Target) -> sj.HertzDashpot:
    """Constant ε, with the contact's own modulus."""
    return sj.HertzDashpot(target.contact, _set(target), end=END)


def dashpot_for(restitution: float) -> float:
    """What `restitution` of a dashpot law is set to, so that ε in (e^-2, 1] comes out with this end.

    It means a contact that pulls until its overlap is zero. With Λ = -ln of what is set, for the
    linear spring and for Hertz's with a dashpot ∝ δ^{1/4}:

        ln ε = -(2 Λ/π) atan2(π, Λ)
    """

    def off(loss: float) -> float:
        return math.log(restitution) + 2 * loss / math.pi * math.atan2(math.pi, loss)

    return math.exp(-brentq(off, 0.0, MOST_DAMPING, xtol=1e-15))


def hold_for(restitution: float) -> float:
    """The fraction ξ of critical damping with which a contact at rest at its peak returns ε of its speed.

    A dashpot c = ξ √(2 M (P/δ + dP/dδ)) and a force P ∝ δⁿ are a linear oscillator; it ends where the force
    vanishes:

        ln ε = -ξ arccos ξ/√(1 - ξ²)
    """

    def off(fraction: float) -> float:
        angle = abs(cmath.acos(fraction) / cmath.sqrt(1 - fraction**2))
        return math.log(restitution) + fraction * angle

    return brentq(off, 0.0, MOST_DAMPING, xtol=1e-15) if restitution < 1 else 0.0


def _set(target: Target) -> float:
    return dashpot_for(min(constant_restitution(target), 1.0))


def _spring(target: Target, overlap: float) -> float:
    """½ K δ² = ½ M v² [N/m]."""
    return number_of(target.contact.mass) * (target.range[1] / overlap) ** 2


def viscoelastic(target: Target) -> sj.ViscoelasticHertz:
    """ε falls with A at every velocity: the best A errs as much above the target's ε as below."""
    if type(target.law) is sj.ViscoelasticHertz:
        return target.law
    contact = target.contact
    rate = (number_of(contact.stiffness) / number_of(contact.mass)) ** 0.4
    slowest, fastest = (1.5 * rate * v**0.2 for v in target.range)  # w² over A
    low, high = np.log([LEAST_LOSS / fastest, MOST_LOSS / slowest])

    def law(log_time: float) -> sj.ViscoelasticHertz:
        return sj.ViscoelasticHertz(contact, float(np.exp(log_time)))

    def excess(log_time: float) -> float:
        off = restitution_of(law(log_time), target.velocity) - target.restitution
        return float(np.max(off) + np.min(off))

    if excess(low) <= 0:
        return law(low)
    return law(brentq(excess, low, high) if excess(high) < 0 else high)


def walton_braun(target: Target, overlap: float, starts_at_loading: bool) -> sj.WaltonBraun:
    """ε = (a + b v)^{-1/2}, a = k20/k1 and b = s √(M/k1).

    Args:
        starts_at_loading: whether k20 is k1, as where k2 grows from the loading stiffness.
    """
    if type(target.law) is sj.WaltonBraun and not starts_at_loading:
        return target.law
    velocity, inverse = target.velocity, np.clip(target.restitution, 0.01, 1.0) ** -2

    def curve(x: np.ndarray) -> np.ndarray:
        a, b = (0.0, x[0]) if starts_at_loading else x
        return (1 + a**2 + b**2 * velocity) ** -0.5

    slope, level = np.polyfit(velocity, inverse, 1)
    start = np.sqrt(np.maximum([level - 1, slope], 1e-6))[int(starts_at_loading) :]
    options = {"xatol": 1e-10, "fatol": 1e-10, "maxiter": 4000, "maxfev": 4000}
    best = minimize(
        lambda x: _largest(curve(x), target), start, method="Nelder-Mead", options=options
    )
    a, b = (0.0, best.x[0]) if starts_at_loading else best.x
    stiffness = _spring(target, overlap)
    growth = b**2 * np.sqrt(stiffness / number_of(target.contact.mass))
    return sj.WaltonBraun(target.contact, stiffness, (1 + a**2) * stiffness, float(growth))


def _largest(found: np.ndarray, target: Target) -> float:
    return float(np.max(np.abs(found - target.restitution)))


def softened(law: Any, factor: float) -> Any:
    """A law softer by `factor`, by its fields; headers soften any law by themselves."""
    if factor == 1:
        return law
    fields = {name: getattr(law, name) * factor**power for name, power in POWERS[type(law)].items()}
    if isinstance(law, OF_MODULUS):
        modulus = law.contact.youngs_modulus / factor**2.5
        fields["contact"] = dataclasses.replace(law.contact, youngs_modulus=modulus)
    return dataclasses.replace(law, **fields)


def growth_of(law: sj.WaltonBraun, peak: float) -> tuple[float, float]:
    """k_p/k1 and the plasticity depth over the radii, where k2 = k1 (1 + s δ) up to `BEYOND` peaks.

    As LIGGGHTS and YADE take them, without adhesion.
    """
    most = 1 + number_of(law.growth) * BEYOND * peak
    return most, BEYOND * peak * (most - 1) / most / (2 * number_of(law.contact.radius))
