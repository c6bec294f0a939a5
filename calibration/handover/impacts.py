"""Impacts on a law over the range of velocities: ε, largest overlap, duration, without steps."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

import softjax as sj

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
    hit = sj.restitution(law, velocity)
    plastic = np.asarray(hit.plastic_coefficient)
    coefficient = np.minimum(np.asarray(hit.coefficient), 1.0) if losses else plastic
    return Impacts(
        velocity, coefficient, plastic, np.asarray(hit.peak_overlap), np.asarray(hit.duration)
    )
