"""The candidates of Zhou's law: by `model`, with as many parameters as the data can tell apart.

Points above yield know σ and ψ only through ε_up = ε_17(v_cr), so that without others χ̃ and ε_up
are what is fitted. Where there are others σ and ψ are tried; if their standard errors say that they
are not separate, ε_up takes their place again (and is ε below yield). Below yield χ̃ does not act.
"""

from dataclasses import dataclass
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.compare.candidates import LOGIT, Box, Candidate, Free
from calibration.data.measurements import RestitutionData
from calibration.empirical import guess_losses

Losses = Literal["sigma-psi", "eps-up", "no-chi"]
FLAT = 1e-12  # ψ of an Eq. (17) that is the same at all velocities
NO_CHI = 1.0  # where χ̃ does not act
SIGMA, PSI, CHI = Free("sigma"), Free("psi"), Free("chi")
PARAMETERS = {
    "sigma-psi": (CHI, SIGMA, PSI),
    "eps-up": (CHI, Free("eps_up", transform=LOGIT)),
    "no-chi": (SIGMA, PSI),
}
REMARKS = {
    "sigma-psi": "By `model`: Eq. (17) below yield and Eq. (16) above, all at once.",
    "eps-up": "By `model`, with ε_up in place of σ and ψ, which these data do not tell apart.",
    "no-chi": "Nothing yields: χ̃ does not act, and the curve is Eq. (17).",
}


@dataclass(frozen=True)
class ZhouOf:
    """θ -> `Zhou`, for one choice of its parameters."""

    losses: Losses
    form: str = "first-order"
    kappa: str = "consistent"

    def __call__(self, contact: sj.Contact, *theta: Any) -> sj.Zhou:
        if self.losses == "sigma-psi":
            chi, sigma, psi = theta
        elif self.losses == "no-chi":
            chi, (sigma, psi) = NO_CHI, theta
        else:
            # with ψ → 0 Eq. (17) is e^{-σ} at all velocities
            (chi, eps_up), psi = theta, FLAT
            sigma = -jnp.log(eps_up)
        return sj.Zhou(contact, chi, sigma, psi, form=self.form, kappa=self.kappa)


def zhou_candidate(losses: Losses, form: str, kappa: str) -> Candidate:
    """Zhou's law with one choice of parameters."""
    return Candidate(
        "zhou",
        "Zhou",
        ZhouOf(losses, form, kappa),
        PARAMETERS[losses],
        _BOXES[losses],
        remark=REMARKS[losses],
    )


def losses_to_try(data: RestitutionData) -> Losses:
    """Which parameters the velocities alone leave a chance."""
    assert data.contact is not None
    below = data.velocity <= np.asarray(data.contact.critical_velocity)
    if np.all(below):
        return "no-chi"
    return "sigma-psi" if np.any(below) else "eps-up"


def _chi_box(data: RestitutionData) -> tuple[float, float]:
    """X = χ̃ E/Y from 1, where nothing is left over, to 3000, which is nearly plastic."""
    assert data.contact is not None
    ratio = float(np.median(np.asarray(data.contact.yield_ratio)))
    return 1.0 / ratio, 3000.0 / ratio


def _losses_box(data: RestitutionData) -> Box:
    sigma, psi = guess_losses(data)
    return [(sigma / 30, sigma * 10), (psi / 3, psi * 3)]


_BOXES = {
    "sigma-psi": lambda data: [_chi_box(data), *_losses_box(data)],
    "eps-up": lambda data: [_chi_box(data), (0.6, 0.9999)],
    "no-chi": _losses_box,
}
