"""The candidates: contact laws with what of them is free, and Eq. (17) as a baseline.

A candidate is one line ε(v; θ). Its parameters θ are those on which ε depends and no others: of
Walton and Braun's stiffnesses the ratio, of a linear spring nothing but the damping. What had to be
chosen to build the law, and what the law takes as an input, is told in `remark`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import softjax as sj
from calibration.compare.linear import restitution_that_gives
from calibration.data.measurements import RestitutionData
from calibration.empirical import guess_losses

Box = list[tuple[float, float]]  # lowest and highest start of each parameter
# ε of a viscoelastic collision to 6e-7 over w² of 1e-4 to 3 (3e-9 with twice the steps and time)
VISCOELASTIC_ROUTE = sj.ODE(steps=8, solver="dopri5")
LOG, LOGIT = "log", "logit"
REACH = 17.0  # in z: 4e-8 of the unit, or from the bound


@dataclass(frozen=True)
class Free:
    """One fitted parameter, searched as z: θ = lower + unit · eᶻ ("log"), or 1/(1 + e⁻ᶻ) ("logit").

    The unit is of the size that the data suggest, so that z = 0 is a start and |z| = `REACH` is
    as good as the bound: it goes no further.
    """

    name: str
    unit: str = ""  # as printed
    lower: float = 0.0
    transform: str = LOG

    def physical(self, z: Any, unit: Any, xp: Any = np) -> Any:
        """θ(z)."""
        z = xp.clip(z, -REACH, REACH)
        return 1 / (1 + xp.exp(-z)) if self.transform == LOGIT else self.lower + unit * xp.exp(z)

    def searched(self, theta: float, unit: float) -> float:
        """z(θ)."""
        if self.transform == LOGIT:
            return math.log(theta) - math.log1p(-theta)
        return math.log((theta - self.lower) / unit)

    def slope(self, theta: float) -> float:
        """dθ/dz."""
        return theta * (1 - theta) if self.transform == LOGIT else theta - self.lower

    def middle(self, low: float, high: float) -> float:
        """The unit for starts between two values."""
        if self.transform == LOGIT:
            return 1.0
        return math.sqrt((low - self.lower) * (high - self.lower))


@dataclass(frozen=True)
class Candidate:
    """One way to describe ε(v).

    Attributes:
        key: its name in files; `label` in tables and pictures.
        law: θ -> contact law, as law(contact, *theta); None for Eq. (17), which is none.
        parameters: θ; none where nothing is fitted.
        box: where the starts of θ lie, for some data.
        route: from the law to ε; None: the law's default.
        remark: what is held, taken as an input or not told by ε.
        same_as: the key of the candidate whose curve this one has; it is then not fitted again.
        own: for those, the law's own inputs that give that ε, {name: value or None}.
    """

    key: str
    label: str
    law: Callable[..., sj.ContactLaw] | None
    parameters: tuple[Free, ...] = ()
    box: Callable[[RestitutionData], Box] | None = None
    route: sj.EnergyBalance | sj.ODE | None = None
    remark: str = ""
    same_as: str | None = None
    own: Callable[[float], dict[str, float | None]] | None = None

    def units(self, data: RestitutionData) -> np.ndarray:
        """The unit of each parameter for these data."""
        pairs = zip(self.parameters, self.box(data) if self.box else [], strict=True)
        return np.array([free.middle(*ends) for free, ends in pairs])

    def physical(self, z: Any, units: Any, xp: Any = np) -> list[Any]:
        """θ(z); z and the units (p, ...)."""
        triples = zip(self.parameters, z, units, strict=True)
        return [free.physical(one, unit, xp) for free, one, unit in triples]


CONSTANT = Candidate(
    "constant",
    "constant ε (hard spheres)",
    sj.ConstantRestitution,
    (Free("restitution", transform=LOGIT),),
    remark="ε is an input of the law; fitted is its mean.",
)


def same_restitution(restitution: float) -> dict[str, float | None]:
    """The input of a dashpot law for either end of its contact."""
    return {
        "restitution": restitution,
        "restitution, zero-force end": restitution_that_gives(restitution, "zero-force"),
    }


def stiffness_ratio(restitution: float) -> dict[str, float | None]:
    """k2/k1 = 1/ε²."""
    return {"stiffness_ratio": 1 / restitution**2 if restitution > 0 else None}


DASHPOT_REMARK = (
    "ε is an input of the law and the same at all velocities, for either end of the contact: not "
    "fitted again."
)
LINEAR = Candidate(
    "linear-spring-dashpot",
    "linear spring–dashpot",
    sj.LinearSpringDashpot,
    same_as="constant",
    own=same_restitution,
    remark=f"{DASHPOT_REMARK} The stiffness does not enter ε.",
)
HERTZ_DASHPOT = Candidate(
    "hertz-dashpot",
    "Hertz with dashpot",
    sj.HertzDashpot,
    same_as="constant",
    own=same_restitution,
    remark=DASHPOT_REMARK,
)
HERTZ = Candidate("hertz", "Hertz", sj.Hertz, remark="Nothing to fit: ε = 1.")
WALTON_BRAUN = Candidate(
    "walton-braun",
    "Walton–Braun, k2 constant",
    sj.WaltonBraun,
    same_as="constant",
    own=stiffness_ratio,
    remark="ε = √(k1/k2) at all velocities: not fitted again. ε does not tell k1.",
)


def walton_braun(contact: sj.Contact, ratio: Any, growth: Any) -> sj.WaltonBraun:
    """ε^-2 = ratio + growth v, with k1 = k √R: ε tells no k1, so that one is chosen."""
    stiffness = contact.stiffness * contact.radius**0.5
    per_force = growth * (stiffness / contact.mass) ** 0.5  # s [1/m]
    return sj.WaltonBraun(contact, stiffness, ratio * stiffness, per_force)


def _walton_braun_box(data: RestitutionData) -> Box:
    fastest = float(np.max(data.velocity))
    return [(1.01, 3.0), (0.01 / fastest, 30.0 / fastest)]


WALTON_BRAUN_GROWING = Candidate(
    "walton-braun-growing",
    "Walton–Braun, k2 growing",
    walton_braun,
    (Free("stiffness_ratio", lower=1.0), Free("growth_per_velocity", "s/m")),
    _walton_braun_box,
    remark="1/ε² = k2/k1 + growth · v, of the softest impact's k2; ε does not tell k1.",
)


def _viscoelastic_box(data: RestitutionData) -> Box:
    """A of w² = 3/2 A (k/M)^{2/5} v^{1/5} from 0.001 to 1 at the middle velocity."""
    assert data.contact is not None
    rate = np.asarray(data.contact.stiffness / data.contact.mass) ** 0.4
    per_time = 1.5 * float(np.median(rate)) * float(np.median(data.velocity)) ** 0.2
    return [(1e-3 / per_time, 1.0 / per_time)]


VISCOELASTIC = Candidate(
    "viscoelastic",
    "viscoelastic Hertz",
    sj.ViscoelasticHertz,
    (Free("dissipation_time", "s"),),
    _viscoelastic_box,
    VISCOELASTIC_ROUTE,
)
THORNTON = Candidate(
    "thornton",
    "Thornton",
    sj.Thornton,
    remark="Nothing to fit: contact yield pressure p_y = Y, Hertz's contact area.",
)
THORNTON_FREE = Candidate(
    "thornton-yield-factor",
    "Thornton, p_y/Y free",
    sj.Thornton,
    (Free("yield_factor"),),
    lambda data: [(0.3, 10.0)],
    remark="Hertz's contact area; the literature's p_y/Y are 1.6 to 2.8.",
)


def _eq_17_box(data: RestitutionData) -> Box:
    sigma, psi = guess_losses(data)
    return [(sigma / 10, sigma * 10), (psi / 3, psi * 3)]


EQ_17 = Candidate(
    "eq-17",
    "Eq. (17), empirical",
    None,
    (Free("sigma"), Free("psi")),
    _eq_17_box,
    remark="A formula without a collision, as a baseline.",
)
FREEABLE = {"yield_factor": THORNTON_FREE}  # what `--free` adds


def candidates_of(data: RestitutionData, free: tuple[str, ...] = ()) -> list[Candidate]:
    """What can be fitted to some data, Zhou's law apart: that depends on their properties."""
    found = [CONSTANT]
    if data.contact is not None:
        found += [LINEAR, HERTZ_DASHPOT, HERTZ, WALTON_BRAUN, WALTON_BRAUN_GROWING]
        found += [VISCOELASTIC, THORNTON, *(FREEABLE[name] for name in free)]
    if data.limit_velocity is not None:
        found.append(EQ_17)
    return found


def left_out(data: RestitutionData) -> list[str]:
    """Why some candidates are missing."""
    if data.contact is not None:
        return []
    why = ["without elastic properties no law of the contact of two bodies can be fitted"]
    if data.limit_velocity is None:
        why.append("without a limit velocity Eq. (17) cannot be fitted either")
    return why
