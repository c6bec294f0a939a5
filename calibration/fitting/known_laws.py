"""The built-in laws as a fit knows them: what of each ε tells, where a search starts, what is held.

What ε does not tell is held at a value of the right size: Walton and Braun's loading stiffness and
that of a linear spring at k √R. Eq. (17) takes its limit velocity from the data.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData

Numbers = Mapping[str, Any]
Ranges = Mapping[str, tuple[float, float]]


def _nothing(_: RestitutionData) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class Known:
    """What is known of a built-in law.

    Attributes:
        law, label: its class, and its name in tables and pictures.
        guess: where a search starts, from the data.
        held: what ε does not tell, with the value it is held at.
        ranges: ends of a parameter's range that depend on the data.
        remark: what a reader of a comparison should know.
    """

    law: type
    label: str
    guess: Callable[[RestitutionData], Numbers] = _nothing
    held: Callable[[RestitutionData], Numbers] = _nothing
    ranges: Callable[[RestitutionData], Ranges] = _nothing
    remark: str = ""


def _measured(data: RestitutionData) -> tuple[np.ndarray, np.ndarray]:
    """v and ε of the impacts with an ε; one of a half where there is none."""
    known = np.isfinite(data.restitution)
    if not np.any(known):
        return data.velocity[:1], np.array([0.5])
    return data.velocity[known], data.restitution[known]


def _mean(data: RestitutionData) -> float:
    return float(np.clip(np.mean(_measured(data)[1]), 1e-3, 0.999))


def _one(values: Any) -> float:
    """A single number for what may differ from impact to impact."""
    return float(np.mean(np.asarray(values)))


def _unless_observed(name: str) -> Callable[[RestitutionData], Numbers]:
    """A stiffness, which ε does not tell, and forces, times and overlaps do."""
    return lambda data: {} if data.observed else {name: _spring(data)}


def _spring(data: RestitutionData) -> float:
    """k √R [N/m], the size of a linear spring that is as stiff as Hertz's contact."""
    assert data.contact is not None
    return _one(data.contact.stiffness) * _one(data.contact.radius) ** 0.5


def _losses(data: RestitutionData) -> Numbers:
    """σ and ψ from the straight line ln(-ln ε) = ln σ + ψ ln[v/(v_lim - v)]."""
    velocity, restitution = _measured(data)
    inside = (restitution > 0) & (restitution < 1)
    if np.sum(inside) < 2 or data.limit_velocity is None:
        return {"sigma": 0.5, "psi": 0.5}
    limit = np.broadcast_to(np.asarray(data.limit_velocity, float), len(data))
    limit = limit[np.isfinite(data.restitution)]
    x = np.log((velocity / (limit - velocity))[inside])
    loss = -np.log(restitution[inside])
    centred = x - np.average(x, weights=loss)
    spread = np.sum(loss * centred**2)
    slope = np.sum(loss * centred * np.log(loss)) / spread if spread > 0 else 0.5
    psi = float(np.clip(slope, 0.05, 3.0))
    level = np.average(np.log(loss) - psi * x, weights=loss)
    return {"sigma": float(np.exp(np.clip(level, -20, 20))), "psi": psi}


def guess_zhou(data: RestitutionData) -> Numbers:
    """χ̃ of X = 10, in the middle of what materials have, and Eq. (17)'s coefficients."""
    assert data.contact is not None
    ratio = _one(data.contact.yield_ratio)
    up = float(np.clip(np.max(_measured(data)[1]), 0.1, 0.999))
    line = {"c1": 0.0, "c2": 10 / ratio**2}
    return {"chi": 10 / ratio, "eps_up": up, **line, **_losses(data)}


def _guess_thornton(data: RestitutionData) -> Numbers:
    """ε ≈ 1.185 (V_y/v)^{1/4} far above yield, and V_y ∝ p_y^{5/2}."""
    assert data.contact is not None
    at_one = _one(sj.Thornton(data.contact).elastic_velocity())
    velocity, restitution = _measured(data)
    yields = np.median(velocity * (np.clip(restitution, 0.05, 0.99) / 1.185) ** 4)
    return {"yield_factor": float(np.clip((yields / at_one) ** 0.4, 1e-3, 1e3))}


def _guess_walton_braun(data: RestitutionData) -> Numbers:
    """1/ε² = k20/k1 + s v √(M/k1), a straight line."""
    assert data.contact is not None
    velocity, restitution = _measured(data)
    inverse = np.clip(restitution, 0.05, 1.0) ** -2
    slope, level = np.polyfit(velocity, inverse, 1) if np.ptp(velocity) else (0, 1.5)
    stiffness = _spring(data)
    growth = max(slope, 0.01 * float(np.mean(inverse)) / float(np.max(velocity)))
    per_velocity = (stiffness / _one(data.contact.mass)) ** 0.5
    unloading = max(level, 1.01) * stiffness
    told = {"unloading_stiffness": unloading, "growth": growth * per_velocity}
    return told | {"loading_stiffness": stiffness}


def _guess_viscoelastic(data: RestitutionData) -> Numbers:
    """1 - ε ≈ 1.15345 · 3/2 A (k/M)^{2/5} v^{1/5} of slow impacts."""
    assert data.contact is not None
    velocity, restitution = _measured(data)
    rate = np.asarray(data.contact.stiffness / data.contact.mass) ** 0.4
    rate = np.broadcast_to(rate, len(data))[: len(velocity)] * velocity**0.2
    lost = np.clip(1 - restitution, 1e-3, 0.9)
    return {"dissipation_time": float(np.median(lost / (1.5 * 1.15345 * rate)))}


def _limit(data: RestitutionData) -> Numbers:
    return {} if data.limit_velocity is None else {"limit_velocity": data.limit_velocity}


def _beyond_fastest(data: RestitutionData) -> Ranges:
    return {"limit_velocity": (float(np.max(data.velocity)), np.inf)}


def _set_restitution(data: RestitutionData) -> Numbers:
    return {"restitution": _mean(data)}


KNOWN: dict[str, Known] = {
    "zhou": Known(
        sj.Zhou,
        "Zhou",
        guess_zhou,
        ranges=lambda data: {"contact." + k: v for k, v in _beyond_fastest(data).items()},
    ),
    "thornton": Known(
        sj.Thornton,
        "Thornton, p_y/Y free",
        _guess_thornton,
        remark="Hertz's contact area; the literature's p_y/Y are 1.6 to 2.8.",
    ),
    "walton-braun": Known(
        sj.WaltonBraun,
        "Walton–Braun",
        _guess_walton_braun,
        held=_unless_observed("loading_stiffness"),
        ranges=lambda data: (
            {} if data.observed else {"unloading_stiffness": (_spring(data), np.inf)}
        ),
        remark="ε does not tell k1, which is held at k √R; k20 and s are in proportion to it.",
    ),
    "viscoelastic": Known(sj.ViscoelasticHertz, "viscoelastic Hertz", _guess_viscoelastic),
    "hertz": Known(sj.Hertz, "Hertz", remark="Nothing to fit: ε = 1."),
    "hertz-dashpot": Known(
        sj.HertzDashpot,
        "Hertz with dashpot",
        _set_restitution,
        remark="ε is an input of the law, the same at all velocities.",
    ),
    "linear": Known(
        sj.LinearSpringDashpot,
        "linear spring–dashpot",
        lambda data: {"restitution": _mean(data), "stiffness": _spring(data)},
        held=_unless_observed("stiffness"),
        remark="ε is an input of the law, the same at all velocities; it does not tell K.",
    ),
    "constant": Known(
        sj.ConstantRestitution,
        "constant ε (hard spheres)",
        _set_restitution,
        remark="ε is an input of the law; fitted is its mean.",
    ),
    "eq-17": Known(
        sj.EmpiricalRestitution,
        "Eq. (17), empirical",
        _losses,
        held=_limit,
        ranges=_beyond_fastest,
        remark="A formula without a collision, as a baseline.",
    ),
}
LAWS: dict[str, type] = {key: known.law for key, known in KNOWN.items()}
"""The built-in contact laws by the names that `fit`, `compare` and the commands take."""
WITHOUT_CONTACT = ("constant", "eq-17")  # laws that need no elastic properties


def law_name(law: Any) -> str | None:
    """The name by which files call a law."""
    if law is None or isinstance(law, str):
        return law
    built_in = next((key for key, one in LAWS.items() if one is law), None)
    return built_in or getattr(law, "__name__", type(law).__name__)
