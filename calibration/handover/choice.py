"""The cheapest law that a code has and that keeps the tolerance, with its time step."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import softjax as sj
from calibration.errors import DataError, InputError, did_you_mean, listed
from calibration.fitting.known_laws import LAWS
from calibration.handover import substitutes
from calibration.handover.c_header import is_tabulated
from calibration.handover.c_table import table_of
from calibration.handover.impacts import Impacts, impacts_of
from calibration.handover.steps import NONE, Steps, steps_of, steps_within, table_error
from calibration.handover.wanted import Wanted

ITSELF = "itself"
INPUT, HEADER = "input", "header"  # how a code takes a law: by what it has, or by generated source
MOST_OVERLAP = 100.0  # over the radius: nothing that is meant is beyond
ROOM = 0.1  # of the tolerance, that a law leaves at least for the time step
LABELS = {
    "linear": "constant ε, linear spring and dashpot",
    "hertz-dashpot": "constant ε, Hertz's spring and a dashpot",
    "viscoelastic": "viscoelastic spheres",
    "walton-braun": "Walton and Braun's spring, k2 growing with the force",
}


@dataclass(frozen=True)
class Carrier:
    """How a code takes a law.

    Attributes:
        name: `INPUT` or `HEADER`.
        from_loading: whether k2 of Walton and Braun's spring can only grow from k1.
        of_mass: whether what the code is told of the damping holds for one effective mass alone.
        of_mass_before: the version of the code from which on it holds for all; 0 where it always
            does.
    """

    name: str
    from_loading: bool = False
    of_mass: bool = False
    of_mass_before: int = 0

    def is_of_mass(self, version: int | None) -> bool:
        """Whether it is so with a version of the code, None the latest."""
        return self.of_mass or (version is not None and version < self.of_mass_before)


@dataclass(frozen=True)
class Order:
    """What is asked for beside the law: see `calibration.handover.door.export`."""

    tolerance: float
    law: str
    steps: int | None
    overlap: float | None
    losses: bool
    version: int | None = None


@dataclass(frozen=True, eq=False)
class Choice:
    """A law for a code.

    Attributes:
        key, label: which one.
        law: with the contact's own stiffness.
        carrier: how the code takes it.
        stretch: overlaps and durations in the code are this many times those of the law.
        impacts: on the law, over the wanted velocities.
        error: the largest difference of its ε from the wanted one, without steps.
        steps: the time step of the law; `NONE` where there is no room for its error.
    """

    key: str
    label: str
    law: Any
    carrier: Carrier
    stretch: float
    impacts: Impacts
    error: float
    steps: Steps

    @property
    def total(self) -> float:
        """The largest error of ε, steps included."""
        return self.error + self.steps.error

    @property
    def step(self) -> float:
        """Time step in the code [s]."""
        return self.steps.step * self.stretch


def choose(wanted: Wanted, code: Any, order: Order) -> tuple[Choice, list[Choice]]:
    """The first law of the ladder that keeps the tolerance, and all that were tried.

    Args:
        code: a module with `CARRIERS`, the laws it takes in the order of their cost, and `REFUSED`,
            the reasons why not of others.

    Raises:
        ValueError: where none does, naming the best, or where the law asked for is none of these.
    """
    keys = _keys(wanted, code, order.law)
    tried = []
    for key in keys:
        tried.append(_tried(key, wanted, code.CARRIERS[key], order))
        if tried[-1].total <= order.tolerance:
            return tried[-1], tried
    best = min(tried, key=lambda one: (one.total, one.error))
    raise _refusal(best, order)


def _refusal(best: Choice, order: Order) -> InputError:
    problem = f"no law tried keeps the tolerance {order.tolerance:g}"
    if best.steps is NONE:
        least, told = best.error / (1 - ROOM), f"{best.error:.3g} off without steps"
    else:
        least, told = best.total, f"{best.total:.3g} off at {best.steps.count} steps"
    accepted = f"--tolerance {_upwards(least)} writes it"
    return InputError(None, None, f"{problem}: the best, {best.label}, is {told}", accepted)


def _upwards(value: float) -> str:
    """Two digits, rounded up."""
    place = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / place) * place:.3g}"


def _keys(wanted: Wanted, code: Any, asked: str) -> list[str]:
    """Which laws to try, in the order of their cost."""
    has_force = not isinstance(wanted.law, sj.HardSphereLaw)
    keys = [key for key in code.CARRIERS if key != ITSELF or has_force]
    if asked == "auto":
        return keys
    own = [name for name, law in LAWS.items() if law is type(wanted.law)]
    _refuse_unsayable(wanted, code, asked, own)
    key = ITSELF if asked in own and asked not in keys else asked
    if key not in keys:
        accepted = f"auto, {listed(keys)}{did_you_mean(asked, keys)}"
        raise DataError("law", asked, accepted)
    return [key]


def _refuse_unsayable(wanted: Wanted, code: Any, asked: str, own: list[str]) -> None:
    """What cannot be said in a code, in one line with the reason."""
    carrier = code.CARRIERS.get(asked)
    name = own[0] if asked == ITSELF and own else asked
    if asked not in code.CARRIERS and name in code.REFUSED:
        problem, accepted = code.REFUSED[name]
        raise InputError(None, None, problem, accepted)
    if carrier is not None and carrier.from_loading and type(wanted.law) is sj.WaltonBraun:
        k1, k20 = (float(getattr(wanted.law, f"{n}_stiffness")) for n in ("loading", "unloading"))
        if k20 > k1:
            problem = f"a constant k2 > k1 (here {k20 / k1:.4g} k1) cannot be said there"
            accepted = "k2 starts at k1 and grows with the overlap; --law auto takes the nearest"
            raise InputError(None, None, problem, accepted)


def _tried(key: str, wanted: Wanted, carrier: Carrier, order: Order) -> Choice:
    law = _law(key, wanted, carrier)
    impacts = impacts_of(law, wanted.velocity, order.losses)
    error = float(np.max(np.abs(impacts.coefficient - wanted.restitution)))
    if carrier.name == HEADER and is_tabulated(law):
        error += table_error(law, table_of(law, wanted.range[1]), impacts)
    label = LABELS.get(key, f"{type(wanted.law).__name__}'s law itself")
    steps = _steps(law, impacts, error, order)
    return Choice(key, label, law, carrier, _stretch(impacts, wanted, order), impacts, error, steps)


def _law(key: str, wanted: Wanted, carrier: Carrier) -> Any:
    if key == "linear":
        return substitutes.linear(wanted, _own_overlap(wanted))
    if key == "hertz-dashpot":
        return substitutes.hertz_dashpot(wanted)
    if key == "viscoelastic":
        return substitutes.viscoelastic(wanted)
    if key == "walton-braun":
        return substitutes.walton_braun(wanted, _own_overlap(wanted), carrier.from_loading)
    return wanted.law


def _own_overlap(wanted: Wanted) -> float:
    """The largest overlap of the wanted law, or of Hertz's where it has none [m]."""
    has_force = not isinstance(wanted.law, sj.HardSphereLaw)
    law = wanted.law if has_force else sj.Hertz(wanted.contact)
    return float(np.asarray(sj.restitution(law, wanted.velocity).peak_overlap)[-1])


def _stretch(impacts: Impacts, wanted: Wanted, order: Order) -> float:
    """The overlap asked for over that of the fastest impact."""
    own = float(impacts.peak[-1]) / wanted.radius
    if order.overlap is None:
        return 1.0
    if not own <= order.overlap <= MOST_OVERLAP:
        least = f"above {own:.3g}, the largest overlap over the {wanted.radius_of} radius as it is"
        raise DataError("overlap", order.overlap, f"{least}, and {MOST_OVERLAP:g} at most")
    return order.overlap / own


def _steps(law: Any, impacts: Impacts, error: float, order: Order) -> Steps:
    if order.steps is not None:
        return steps_of(law, impacts, order.steps)
    if error > (1 - ROOM) * order.tolerance:
        return NONE
    return steps_within(law, impacts, order.tolerance - error)
