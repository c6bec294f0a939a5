"""Cheaper laws in place of the target, each with the smallest largest error of ε.

Constant ε by a linear spring or by Hertz's, viscoelastic spheres, Walton and Braun's spring. A spring
whose stiffness does not affect ε keeps the one that its own kind of law states, else it takes up the energy of the fastest
impact within the target's largest overlap.

Softer springs at the same ε: overlaps and durations grow by a factor μ, forces fall by it. With
P'(δ, δ') = P(δ/μ, δ')/μ every impact is the old one with lengths and times μ times as large.
"""

import dataclasses
import math
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize

import softjax as sj
from calibration.particle_codes.target import Target, number_of, restitution_of
from softjax.many_body import held_fraction

END = "zero-force"  # of damped contacts: nothing pulls
LEAST = math.exp(-2)  # ε of critical damping with this end
# w² = 3/2 A (k/M)^{2/5} v^{1/5}, the one number of viscoelastic spheres: ε from 1 - 1e-9 to 3e-7
LEAST_LOSS, MOST_LOSS = 1e-9, 1e4
FLOOR = 0.25  # of the tolerance: a smaller ε is not aimed at, as it costs ever shorter contacts
STATED: dict[
    str, tuple[type, str]
] = {  # laws that state the stiffness of a spring, and the name of it
    "linear": (sj.LinearSpringDashpot, "stiffness"),
    "walton-braun": (sj.WaltonBraun, "loading_stiffness"),
}
# of the factor, by which a field is multiplied; "contact": its modulus
POWERS: dict[type, dict[str, float]] = {
    sj.LinearSpringDashpot: {"stiffness": -2},
    sj.WaltonBraun: {"loading_stiffness": -2, "unloading_stiffness": -2, "growth": -1},
    sj.HertzDashpot: {"contact": -2.5},
    sj.ViscoelasticHertz: {"dissipation_time": 1, "contact": -2.5},
}


def surrogate_of(key: str, target: Target, from_loading: bool) -> Any:
    """The law of this key nearest to the target; `from_loading`: k2 grows from k1."""
    law, contact = target.law, target.contact
    if key == "viscoelastic":
        return law if type(law) is sj.ViscoelasticHertz else _viscoelastic(target)
    if key == "walton-braun" and type(law) is sj.WaltonBraun and not from_loading:
        return law
    stiffness = _stiffness(key, target)
    if key == "walton-braun":
        return _walton_braun(target, stiffness, from_loading)
    middle = float(np.max(target.restitution) + np.min(target.restitution)) / 2
    dashpot = dashpot_for(min(max(middle, 1.0005 * LEAST), 1.0))
    if key == "linear":
        return sj.LinearSpringDashpot(contact, stiffness, dashpot, end=END)
    return sj.HertzDashpot(contact, dashpot, end=END)


def _stiffness(key: str, target: Target) -> float:
    """Stiffness as the law states it, else by ½ K δ² = ½ M v² at its largest overlap [N/m]."""
    law, fastest = target.law, target.range[1]
    kind, field = STATED.get(key, (None, ""))
    if type(law) is kind:
        return number_of(getattr(law, field))
    with_force = sj.Hertz(target.contact) if isinstance(law, sj.HardSphereLaw) else law
    overlap = float(np.asarray(sj.restitution(with_force, fastest).peak_overlap))
    return number_of(target.contact.mass) * (fastest / overlap) ** 2


def dashpot_for(restitution: float) -> float:
    """Set `restitution` of a dashpot law so that ε in (e^-2, 1] comes out with this end.

    It means a contact that pulls until its overlap is zero, ln e = -π ξ/√(1 - ξ²). This one ends before, and loses as
    much on approach as a full contact that starts at its peak: ln ε = -2 ξ arccos ξ/√(1 - ξ²).
    """
    fraction = float(held_fraction(math.sqrt(restitution)))
    return math.exp(-math.pi * fraction / math.sqrt(1 - fraction**2))


def _aim(target: Target) -> np.ndarray:
    """ε that a law is fitted to."""
    return np.maximum(target.restitution, FLOOR * target.options.tolerance)


def _viscoelastic(target: Target) -> sj.ViscoelasticHertz:
    """ε falls with A at every velocity: the best A errs as much above the target's ε as below."""
    contact, aim = target.contact, _aim(target)
    rate = (number_of(contact.stiffness) / number_of(contact.mass)) ** 0.4
    slowest, fastest = (1.5 * rate * v**0.2 for v in target.range)  # w² over A
    low, high = np.log([LEAST_LOSS / fastest, MOST_LOSS / slowest])

    def law(log_time: float) -> sj.ViscoelasticHertz:
        return sj.ViscoelasticHertz(contact, float(np.exp(log_time)))

    def excess(log_time: float) -> float:
        off = restitution_of(law(log_time), target.velocity) - aim
        return float(np.max(off) + np.min(off))

    if excess(low) <= 0:
        return law(low)
    return law(brentq(excess, low, high) if excess(high) < 0 else high)


def _walton_braun(target: Target, stiffness: float, from_loading: bool) -> sj.WaltonBraun:
    """ε = (a + b v)^{-1/2}, a = k20/k1 and b = s √(M/k1); a is 1 where k2 grows from k1."""
    velocity, aim = target.velocity, _aim(target)
    inverse = np.clip(aim, 0.01, 1.0) ** -2

    def roots(x: np.ndarray) -> np.ndarray:  # of a - 1 and b
        return np.append(0.0, x) if from_loading else x

    def largest_error(x: np.ndarray) -> float:
        a, b = roots(x)
        return float(np.max(np.abs((1 + a**2 + b**2 * velocity) ** -0.5 - aim)))

    slope, level = np.polyfit(velocity, inverse, 1)
    start = np.sqrt(np.maximum([level - 1, slope], 1e-6))[int(from_loading) :]
    options = {"xatol": 1e-10, "fatol": 1e-10, "maxfev": 4000}
    a, b = roots(minimize(largest_error, start, method="Nelder-Mead", options=options).x)
    growth = b**2 * np.sqrt(stiffness / number_of(target.contact.mass))
    return sj.WaltonBraun(target.contact, stiffness, (1 + a**2) * stiffness, float(growth))


def softened(law: Any, factor: float) -> Any:
    """A law softer by `factor`, by its fields; headers soften any law by themselves."""
    powers, contact = dict(POWERS[type(law)]), law.contact
    modulus = contact.youngs_modulus * factor ** powers.pop("contact", 0)
    fields = {name: getattr(law, name) * factor**power for name, power in powers.items()}
    softer = dataclasses.replace(contact, youngs_modulus=modulus)
    return dataclasses.replace(law, contact=softer, **fields)
