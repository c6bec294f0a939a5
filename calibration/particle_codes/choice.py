"""The cheapest law that a code has and that keeps the tolerance, with its time step."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import softjax as sj
from calibration.errors import DataError, InputError, did_you_mean, listed
from calibration.fitting.laws import LAWS
from calibration.particle_codes import codes, surrogates
from calibration.particle_codes.c_table import FORMULAS, table_of
from calibration.particle_codes.steps import (
    NONE,
    Contact,
    Steps,
    hold_error,
    steps_within,
    weight_error,
)
from calibration.particle_codes.target import (
    Impacts,
    Target,
    impacts_of,
    number_of,
    restitution_of,
    with_contact,
)
from softjax.many_body import held_fraction

MOST_OVERLAP = 100.0  # over the radius: nothing that is meant is beyond
ROOM = 0.1  # of the tolerance, that a law leaves at least for the time step
LABELS = {
    "linear": "constant ε, linear spring and dashpot",
    "hertz-dashpot": "constant ε, Hertz's spring and a dashpot",
    "viscoelastic": "viscoelastic spheres",
    "walton-braun": "Walton and Braun's spring, k2 growing with the force",
}


@dataclass(frozen=True, eq=False)
class Choice:
    """A law for a code, with the contact's own stiffness, and its impacts over the target velocities.

    `error` is the largest difference of its ε from the target, without steps, whose count is 0 where
    there is no room for their error, and `weight` the largest that gravity makes; `of_pairs` are the impacts of
    the pairs of the target. Overlaps and durations in the code are `softening_factor` times the law's, and
    `impacts` those in the code; `hold` is the fraction of critical damping for ε below the range, 0 without.
    """

    key: str
    label: str
    law: Any
    backend: codes.Backend
    softening_factor: float
    impacts: Impacts
    of_pairs: tuple[Impacts, ...]
    error: float
    weight: float
    steps: Steps
    table: dict[str, Any] | None
    hold: float
    hold_error: float

    @property
    def total(self) -> float:
        """The largest error of ε, steps and weight included."""
        return self.error + self.weight + self.steps.error


def choose(target: Target, to: str) -> tuple[Choice, list[Choice]]:
    """The first law of a code that keeps the tolerance, and all that were tried.

    Raises:
        ValueError: where none does, naming the best, or where the requested law is none of these.
    """
    tried: list[Choice] = []
    for key in _keys(target, to):
        tried.append(_tried(key, target, codes.BACKENDS[to][key]))
        if tried[-1].total <= target.options.tolerance:
            return tried[-1], tried
    best = min(tried, key=lambda choice: (choice.total, choice.error + choice.weight))
    needed = best.total if best.steps.count else (best.error + best.weight) / (1 - ROOM)
    problem = f"no law meets the tolerance {target.options.tolerance:g}: the best is {best.label}"
    accepted = f"try --tolerance {1.01 * needed:.3g}"
    if best.weight > best.error:
        accepted += f" (the weight adds {best.weight:.2g}; --gravity 0 leaves it out)"
    raise InputError(None, None, problem, accepted)


def _keys(target: Target, to: str) -> list[str]:
    """Which laws to try, in the order of their cost."""
    backends, law = codes.BACKENDS[to], target.options.law
    hard = isinstance(target.law, sj.HardSphereLaw)
    keys = [key for key in backends if key != codes.EXACT or not hard]
    if law != "auto":
        is_own = LAWS.get(law) is type(target.law)
        key = codes.EXACT if is_own and law not in keys else law
        if key not in keys:
            accepted = f"auto, {listed(keys)}{did_you_mean(law, keys)}"
            others = [code for code, laws in codes.BACKENDS.items() if key in laws]
            if others and to not in others:
                accepted += f" ({law} is for {listed(others)})"
            raise DataError("law", law, accepted)
        keys = [key]
    reasons = {key: next(_refusals(key, target, backends[key]), None) for key in keys}
    if refused := reasons[keys[-1]] if all(reasons.values()) else None:
        raise InputError(None, None, *refused)
    return [key for key in keys if not reasons[key]]


def _refusals(key: str, target: Target, backend: codes.Backend) -> Iterator[tuple[str, str]]:
    """Why a code cannot have this law as it is requested, each with what to do."""
    law, options = target.law, target.options
    constant = f"--export-law {' or '.join(codes.CONSTANT)}"
    as_it_is = key == options.law and backend.from_loading and type(law) is sj.WaltonBraun
    if as_it_is and number_of(law.unloading_stiffness) > number_of(law.loading_stiffness):
        accepted = "k2 that grows from k1; --export-law auto takes the nearest"
        yield "a constant k2 > k1 cannot be written there", accepted
    if options.below == "hold" and not can_hold(key, law, backend):
        problem = f"the ε of {key} cannot be held below the range by what the code has"
        yield problem, f"{constant}, whose ε is constant"
    if target.on_wall and not backend.at_walls:
        yield f"{key} loses nothing at a wall there", constant
    if options.sizes and key == codes.EXACT and type(law) not in FORMULAS:
        accepted = "each pair exported by itself, with --prefix and --types"
        yield "a table of forces is for one pair of sizes", accepted
    if options.sizes and backend.of_mass and not backend.lines_of_pairs:
        yield f"the damping of {key} is for one mass there", "--export-law hertz-dashpot"
    if options.sizes and backend.from_loading:
        yield f"the growth of {key}'s k2 is for one size there", "--export-law hertz-dashpot"


def can_hold(key: str, law: sj.ContactLaw, backend: codes.Backend) -> bool:
    """Whether `below="hold"` is possible with this law: its ε is constant, or its damping may be added to."""
    independent = key == "walton-braun" or isinstance(law, sj.RateIndependentLaw)
    own_code = backend.name != codes.INPUT
    return key in codes.CONSTANT or (key != "viscoelastic" and own_code and independent)


def _tried(key: str, target: Target, backend: codes.Backend) -> Choice:
    """A law with its errors and its time step."""
    options, velocity = target.options, target.velocity
    law = target.law
    if key != codes.EXACT:
        law = surrogates.surrogate_of(key, target, backend.from_loading)
    impacts = impacts_of(law, velocity, options.losses)
    contacts = [Contact(law, impacts, target.restitution)]
    for pair in target.pairs:
        of_pair, asked = (with_contact(of, pair.contact) for of in (law, target.law))
        requested = restitution_of(asked, velocity, options.losses)
        contacts.append(Contact(of_pair, impacts_of(of_pair, velocity, options.losses), requested))
    error, table = max(contact.error for contact in contacts), None
    if backend.name == codes.HEADER and type(law) not in FORMULAS:
        table, interpolation = table_of(law, impacts, options.losses)
        error += interpolation
    factor = _softening_factor(impacts, target)
    # times and lengths in the code are `factor` times those of the law, accelerations 1/`factor`
    weight = weight_error(contacts, factor * target.gravity)
    is_held = options.below == "hold" and key not in codes.CONSTANT
    steps, room = NONE, options.tolerance - error - weight
    if options.steps is not None or room >= ROOM * options.tolerance:
        fewest = max(backend.fewest, codes.DAMPED * is_held)
        steps = steps_within(contacts, room, fewest, options.steps, backend.scheme_error)
    hold = off = 0.0
    if is_held and steps is not NONE:
        hold = float(held_fraction(impacts.coefficient[0]))
        off = hold_error(contacts, hold, steps)
    return Choice(
        key,
        LABELS.get(key, f"{type(target.law).__name__}'s law, exact"),
        law,
        backend,
        factor,
        impacts.softened(factor),
        tuple(contact.impacts.softened(factor) for contact in contacts[1:]),
        error,
        weight,
        replace(steps, step=steps.step * factor),
        table,
        hold,
        off,
    )


def _softening_factor(impacts: Impacts, target: Target) -> float:
    """The requested overlap over that of the fastest impact."""
    unscaled, overlap = float(impacts.peak[-1]) / target.radius, target.options.overlap
    if overlap is None:
        return 1.0
    if not unscaled <= overlap <= MOST_OVERLAP:
        limits = (
            f"above {unscaled:.3g}, the largest overlap over the {target.radius_of} radius as it is"
        )
        raise DataError("overlap", overlap, f"{limits}, and {MOST_OVERLAP:g} at most")
    return overlap / unscaled
