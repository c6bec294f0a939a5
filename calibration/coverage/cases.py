"""Curves of known laws, measured with errors that are independent and equal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData


@dataclass(frozen=True)
class Case:
    """One simulated experiment.

    Attributes:
        name: what tables call it.
        truth: the law whose curve is measured.
        velocity: of the impacts [m/s].
        law, parameters, objective: what is fitted, as `fit` takes it; the truth's own class where
            left out, each search starting at the truth.
        noise: standard deviation of ε.
        stated: whether the fit is told of it.
        contact: the two bodies, where the truth is a law without them.
    """

    name: str
    truth: sj.ContactLaw
    velocity: Any
    law: Any = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    objective: str = "model"
    noise: float = 0.005
    stated: bool = False
    contact: sj.Contact | None = None

    def data(self) -> RestitutionData:
        """The noise-free measurements."""
        velocity = np.asarray(self.velocity, float)
        restitution = np.asarray(sj.restitution(self.truth, velocity).coefficient)
        told = np.asarray(self.noise) if self.stated else None
        contact = self.contact or getattr(self.truth, "contact", None)
        limit = getattr(self.truth, "limit_velocity", None)
        return RestitutionData(
            velocity, restitution, contact, told, self.name, limit_velocity=limit
        )


def standard_cases(points: Sequence[int] = (8, 30)) -> list[Case]:
    """Every built-in law with free parameters, with and without stated uncertainty."""
    cases = []
    for n in points:
        for case in _laws(n):
            for stated in (False, True):
                told = f"{case.name}, n = {n}" + ", stated" * stated
                cases.append(replace(case, name=told, stated=stated))
    return cases


def _laws(n: int) -> list[Case]:
    pair = nylon_pair()
    critical = float(pair.critical_velocity)
    above = np.geomspace(1.3, 80, n) * critical
    both = np.concatenate([np.linspace(0.1, 0.95, n // 3), np.geomspace(1.3, 80, n - n // 3)])
    zhou = sj.Zhou(pair, 0.22, 0.4355, 0.5414)
    empirical = sj.EmpiricalRestitution(float(pair.limit_velocity), 0.4355, 0.5414)
    spring = float(pair.stiffness) * float(pair.radius) ** 0.5
    return [
        Case("zhou, eps_up", zhou, above),
        Case("zhou, sigma and psi", zhou, both * critical, noise=0.0005),
        Case("zhou, two-step", empirical, above, sj.Zhou, objective="two-step", contact=pair),
        Case("thornton", sj.Thornton(pair, 1.6), above),
        Case("walton-braun", sj.WaltonBraun(pair, spring, 1.2 * spring, 60.0), above),
        Case("viscoelastic", sj.ViscoelasticHertz(pair, 2e-5), above),
        Case("hertz-dashpot", sj.HertzDashpot(pair, 0.8), above),
        Case("linear", sj.LinearSpringDashpot(pair, spring, 0.8), above),
        Case("constant", sj.ConstantRestitution(pair, 0.8), above),
        Case("eq-17", empirical, above),
    ]


def nylon_pair() -> sj.Contact:
    """Two of the paper's nylon spheres."""
    from calibration.data.paper import CURVES, RADIUS

    nylon = CURVES[2].material
    return sj.Contact.between_spheres(nylon, nylon, RADIUS, RADIUS)
