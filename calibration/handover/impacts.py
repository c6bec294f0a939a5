"""Impacts on a law over the range of velocities: ε, largest overlap, duration, without steps."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.handover.damping import rebound
from calibration.handover.stepping import stepped
from calibration.handover.wanted import number_of
from softjax.laws.linear_dashpot import damping_fraction

FINE = 2000  # steps in an elastic contact, where a duration is found by steps: to 1e-3
LONGEST = 3  # times an elastic contact that a damped one may take
HERTZ_TIME = 2.9432751843  # T v/δ_max of Hertz's contact

Curve = Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class Impacts:
    """Arrays over velocities [m/s]: ε as a code has it, ε_p, largest overlap [m], duration [s].

    `factor` is (ε/ε_p)², by which the unloading force is multiplied; ε is 1 at most.
    """

    velocity: Curve
    coefficient: Curve
    plastic: Curve
    peak: Curve
    duration: Curve

    @property
    def factor(self) -> Curve:
        safe = np.where(self.plastic > 0, self.plastic, 1.0)
        return np.where(self.plastic > 0, (self.coefficient / safe) ** 2, 0.0)

    @property
    def gain(self) -> float:
        """The most energy that an impact brings back above what it had, over that."""
        return float(max(np.max(self.coefficient) ** 2 - 1, 0.0))


def impacts_of(law: Any, velocity: Curve, losses: bool = True) -> Impacts:
    """Impacts on a law with a force; `losses`: with what is in ε and in no force."""
    if type(law) in (sj.LinearSpringDashpot, sj.HertzDashpot):
        fraction = number_of(damping_fraction(law.restitution))
        coefficient = np.full_like(velocity, rebound(fraction, law.end))
        return _with_times(law, velocity, coefficient)
    if type(law) is sj.ViscoelasticHertz:
        return _with_times(law, velocity, np.asarray(sj.restitution(law, velocity).coefficient))
    hit = sj.restitution(law, velocity)
    plastic = np.asarray(hit.plastic_coefficient)
    coefficient = np.minimum(np.asarray(hit.coefficient), 1.0) if losses else plastic
    return Impacts(
        velocity, coefficient, plastic, np.asarray(hit.peak_overlap), np.asarray(hit.duration)
    )


def _with_times(law: Any, velocity: Curve, coefficient: Curve) -> Impacts:
    """Overlaps and durations by fine steps, which takes no compilation of an integrator."""
    step = jnp.asarray(_elastic_duration(law, velocity) / FINE)
    one = jnp.ones_like(step)
    hit = stepped(law, jnp.asarray(velocity), one, step, LONGEST * FINE, jnp.full((1, 1), 0.5))
    peak, duration = (np.asarray(part)[0] for part in (hit.peak, hit.duration))
    return Impacts(velocity, coefficient, coefficient, peak, duration)


def _elastic_duration(law: Any, velocity: Curve) -> Curve:
    mass = number_of(law.contact.mass)
    if type(law) is sj.LinearSpringDashpot:
        return np.full_like(velocity, np.pi * np.sqrt(mass / number_of(law.stiffness)))
    stiffness = number_of(law.contact.stiffness)
    return HERTZ_TIME * (1.25 * mass * velocity**2 / stiffness) ** 0.4 / velocity
