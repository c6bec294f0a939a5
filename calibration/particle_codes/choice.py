"""The cheapest law that a code has and that keeps the tolerance, with its time step."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.errors import DataError, InputError, did_you_mean, listed
from calibration.fitting.laws import LAWS
from calibration.particle_codes import surrogates
from calibration.particle_codes.c_header import is_tabulated
from calibration.particle_codes.c_table import table_of
from calibration.particle_codes.steps import (
    FEWEST,
    NONE,
    Steps,
    hold_error,
    steps_of,
    steps_within,
)
from calibration.particle_codes.target import (
    Impacts,
    Target,
    impacts_of,
    restitution_of,
    with_contact,
)

EXACT = "exact"
DAMPED = 20  # steps in a contact at least: a step makes dashpots weaker, never stronger
CONSTANT = "linear", "hertz-dashpot"  # the same ε at all velocities
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
class Backend:
    """How a code takes a law.

    Attributes:
        name: `INPUT` or `HEADER`.
        from_loading: whether k2 of Walton and Braun's spring can only grow from k1.
        of_mass: whether the damping that is written holds for one effective mass alone.
        fewest: time steps in the shortest contact, unless stated.
        lines_of_pairs: whether each pair of types of atoms has a line of its own.
        scheme_error: the error of ε by N steps in a contact is this over N² at least.
        at_walls: whether it acts at walls too.
    """

    name: str
    from_loading: bool = False
    of_mass: bool = False
    fewest: int = FEWEST
    lines_of_pairs: bool = False
    scheme_error: float = 0.0
    at_walls: bool = True


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export: see `calibration.particle_codes.entry.export`."""

    tolerance: float
    law: str
    steps: int | None
    overlap: float | None
    losses: bool
    prefix: str = "softjax"
    types: tuple[int, int] | None = None
    below: str = "none"
    sizes: tuple[float, ...] | None = None


@dataclass(frozen=True, eq=False)
class Choice:
    """A law for a code.

    Attributes:
        key, label: which one.
        law: with the contact's own stiffness.
        backend: how the code takes it.
        softening_factor: overlaps and durations in the code are this many times those of the law.
        impacts: on the law, over the target velocities.
        error: the largest difference of its ε from the target, without steps.
        steps: the time step of the law; `NONE` where there is no room for its error.
        table: of a user's law for its template, else None.
        hold: the fraction of critical damping that holds ε below the range, 0 where nothing does.
        hold_error: the error of that ε by the time step.
        shortest: the shortest contact of all sizes over that of the law's own.
    """

    key: str
    label: str
    law: Any
    backend: Backend
    softening_factor: float
    impacts: Impacts
    error: float
    steps: Steps
    table: dict[str, Any] | None = None
    hold: float = 0.0
    hold_error: float = 0.0
    shortest: float = 1.0

    @property
    def total(self) -> float:
        """The largest error of ε, steps included."""
        return self.error + self.steps.error

    @property
    def step(self) -> float:
        """Time step in the code [s]."""
        return self.steps.step * self.softening_factor * self.shortest


def choose(target: Target, code: Any, options: ExportOptions) -> tuple[Choice, list[Choice]]:
    """The first law of the ladder that keeps the tolerance, and all that were tried.

    Args:
        code: a module with `BACKENDS`, the laws it takes in the order of their cost, and `REFUSED`,
            the reasons why not of others.

    Raises:
        ValueError: where none does, naming the best, or where the requested law is none of these.
    """
    keys = _keys(target, code, options.law)
    tried: list[Choice] = []
    reasons = {key: _unsuited(key, target, code.BACKENDS[key], options) for key in keys}
    if all(reasons.values()):
        raise InputError(None, None, *reasons[keys[-1]])
    for key in (key for key in keys if not reasons[key]):
        tried.append(_tried(key, target, code.BACKENDS[key], options))
        if tried[-1].total <= options.tolerance:
            return tried[-1], tried
    best = min(tried, key=lambda one: (one.total, one.error))
    raise _refusal(best, options)


def _unsuited(key: str, target: Target, backend: Backend, options: ExportOptions) -> Any:
    """Why a law cannot be held below the range or be of several sizes, and what to do; None where it can."""
    if options.below == "hold" and key not in CONSTANT:
        rate_independent = key == "walton-braun" or isinstance(target.law, sj.RateIndependentLaw)
        if key == "viscoelastic" or backend.name == INPUT or not rate_independent:
            problem = f"the ε of {key} cannot be held below the range by what the code has"
            return problem, f"--export-law {' or '.join(CONSTANT)}, whose ε is constant"
    if target.on_wall and not backend.at_walls:
        return f"{key} loses nothing at a wall there", f"--export-law {' or '.join(CONSTANT)}"
    if options.sizes and key == EXACT and is_tabulated(target.law):
        accepted = "each pair exported by itself, with --prefix and --types"
        return "a table of forces is for one pair of sizes", accepted
    if options.sizes and backend.of_mass and not backend.lines_of_pairs:
        return f"the damping of {key} is for one mass there", "--export-law hertz-dashpot"
    return None


def _refusal(best: Choice, options: ExportOptions) -> InputError:
    problem = f"no law meets the tolerance {options.tolerance:g}"
    if best.steps is NONE:
        least, found = best.error / (1 - ROOM), f"{best.error:.3g} off without steps"
    else:
        least, found = best.total, f"{best.total:.3g} off at {best.steps.count} steps"
    accepted = f"try --tolerance {_upwards(least)}"
    return InputError(None, None, f"{problem}: the best, {best.label}, is {found}", accepted)


def _upwards(value: float) -> str:
    """Two digits, rounded up."""
    place = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / place) * place:.3g}"


def _keys(target: Target, code: Any, law: str) -> list[str]:
    """Which laws to try, in the order of their cost."""
    has_force = not isinstance(target.law, sj.HardSphereLaw)
    keys = [key for key in code.BACKENDS if key != EXACT or has_force]
    if law == "auto":
        return keys
    own = [name for name, one in LAWS.items() if one is type(target.law)]
    _refuse_unsayable(target, code, law, own)
    key = EXACT if law in own and law not in keys else law
    if key not in keys:
        accepted = f"auto, {listed(keys)}{did_you_mean(law, keys)}"
        raise DataError("law", law, accepted)
    return [key]


def _refuse_unsayable(target: Target, code: Any, law: str, own: list[str]) -> None:
    """What cannot be said in a code, in one line with the reason."""
    backend = code.BACKENDS.get(law)
    name = own[0] if law == EXACT and own else law
    if law not in code.BACKENDS and name in code.REFUSED:
        problem, accepted = code.REFUSED[name]
        raise InputError(None, None, problem, accepted)
    if backend is not None and backend.from_loading and type(target.law) is sj.WaltonBraun:
        k1, k20 = (float(getattr(target.law, f"{n}_stiffness")) for n in ("loading", "unloading"))
        if k20 > k1:
            problem = f"a constant k2 > k1 (here {k20 / k1:.4g} k1) cannot be written there"
            accepted = (
                "k2 starts at k1 and grows with the overlap; --export-law auto takes the nearest"
            )
            raise InputError(None, None, problem, accepted)


def _tried(key: str, target: Target, backend: Backend, options: ExportOptions) -> Choice:
    law = _law(key, target, backend)
    impacts = impacts_of(law, target.velocity, options.losses)
    error = float(np.max(np.abs(impacts.coefficient - target.restitution)))
    table = None
    if backend.name == HEADER and is_tabulated(law):
        table, interpolation = table_of(law, impacts, options.losses)
        error += interpolation
    off, shortest = _of_pairs(law, target, options.losses)
    error, shortest = max(error, off), min(shortest / float(np.min(impacts.duration)), 1.0)
    label = LABELS.get(key, f"{type(target.law).__name__}'s law, exact")
    held = options.below == "hold" and key not in CONSTANT
    fewest = max(backend.fewest, DAMPED * held)
    steps = _steps(law, impacts, error, options, backend, fewest)
    softer = _softening_factor(impacts, target, options)
    made = Choice(key, label, law, backend, softer, impacts, error, steps, table, shortest=shortest)
    if not held or steps is NONE:
        return made
    fraction = surrogates.hold_for(float(impacts.coefficient[0]))
    off = hold_error(law, impacts, fraction, steps.step)
    return replace(made, hold=fraction, hold_error=off)


def _of_pairs(law: Any, target: Target, losses: bool) -> tuple[float, float]:
    """The largest error of ε over all pairs of sizes, and their shortest contact [s]."""
    errors, durations = [0.0], [np.inf]
    for _, _, contact in target.pairs:
        found = impacts_of(with_contact(law, contact), target.velocity, losses)
        requested = restitution_of(with_contact(target.law, contact), target.velocity, losses)
        errors.append(float(np.max(np.abs(found.coefficient - requested))))
        durations.append(float(np.min(found.duration)))
    return max(errors), min(durations)


def _law(key: str, target: Target, backend: Backend) -> Any:
    if key == "linear":
        return surrogates.linear(target, _own_overlap(target))
    if key == "hertz-dashpot":
        return surrogates.hertz_dashpot(target)
    if key == "viscoelastic":
        return surrogates.viscoelastic(target)
    if key == "walton-braun":
        return surrogates.walton_braun(target, _own_overlap(target), backend.from_loading)
    return target.law


def _own_overlap(target: Target) -> float:
    """The largest overlap of the target's law, or of Hertz's where it has none [m]."""
    has_force = not isinstance(target.law, sj.HardSphereLaw)
    law = target.law if has_force else sj.Hertz(target.contact)
    return float(np.asarray(sj.restitution(law, target.velocity).peak_overlap)[-1])


def _softening_factor(impacts: Impacts, target: Target, options: ExportOptions) -> float:
    """The requested overlap over that of the fastest impact."""
    own = float(impacts.peak[-1]) / target.radius
    if options.overlap is None:
        return 1.0
    if not own <= options.overlap <= MOST_OVERLAP:
        least = f"above {own:.3g}, the largest overlap over the {target.radius_of} radius as it is"
        raise DataError("overlap", options.overlap, f"{least}, and {MOST_OVERLAP:g} at most")
    return options.overlap / own


def _steps(
    law: Any, impacts: Impacts, error: float, options: ExportOptions, backend: Backend, fewest: int
) -> Steps:
    room = options.tolerance - error
    if options.steps is not None:
        steps = steps_of(law, impacts, options.steps)
    elif room < ROOM * options.tolerance:
        return NONE
    else:
        fewest = max(fewest, int(np.ceil(np.sqrt(backend.scheme_error / room))))
        steps = steps_within(law, impacts, room, fewest)
    return replace(steps, error=max(steps.error, backend.scheme_error / steps.count**2))
