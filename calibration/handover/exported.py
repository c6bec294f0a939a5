"""An export as it is told: what was wanted, what the code gives, what a scene needs to know."""

from dataclasses import dataclass
from importlib.metadata import version as version_of
from typing import Any, NamedTuple

import numpy as np

import softjax as sj
from calibration.errors import printable
from calibration.handover.choice import Choice, Order
from calibration.handover.softer import softened
from calibration.handover.wanted import Wanted, number_of
from calibration.rounding import number
from softjax.fields import numbers_of, options_of

POISSON_RATIO = 0.3
DEEP = 0.1  # of the radius: laws of contact are for small overlaps
SLACK = 1e-3  # of a velocity: text rounds
# by `Wanted.on_wall`
SCENES: dict[bool | None, str] = {True: "a ball on a flat wall", False: "two balls"}


class Draft(NamedTuple):
    """What the files of a code are made of; `header` is empty where no source is needed."""

    wanted: Wanted
    choice: Choice
    notes: tuple[str, ...]
    header: str
    version: int | None

    @property
    def law(self) -> Any:
        """As soft as the scene bears it."""
        return softened(self.choice.law, self.choice.stretch)

    @property
    def peak(self) -> float:
        """The largest overlap in the code [m]."""
        return float(self.choice.impacts.peak[-1]) * self.choice.stretch

    @property
    def poisson_ratio(self) -> float:
        """Where only the contact is known a usual one: the modulus goes with it."""
        ratio = self.wanted.poisson_ratio
        return POISSON_RATIO if ratio is None else ratio


@dataclass(frozen=True, eq=False, repr=False)
class Export:
    """A law handed over to a particle code; prints itself.

    Attributes:
        to: the code.
        wanted: the law and velocities that were asked for.
        choice: the law that the code gets, its impacts and its time step.
        tried: all laws looked at, in the order of their cost.
        order: the tolerance and what else was asked for.
        interpolation_error: of a table of forces, over the largest force; 0 for formulas.
        files: their names.
    """

    to: str
    wanted: Wanted
    choice: Choice
    tried: list[Choice]
    order: Order
    interpolation_error: float
    files: tuple[str, ...]

    @property
    def law(self) -> sj.ContactLaw:
        """The law that the code follows, at its own stiffness."""
        return self.choice.law

    @property
    def time_step(self) -> float:
        """[s]"""
        return self.choice.step

    @property
    def duration(self) -> np.ndarray:
        """Of contacts in the code, over the wanted velocities [s]."""
        return self.choice.impacts.duration * self.choice.stretch

    @property
    def overlap(self) -> float:
        """The largest overlap in the code over the radius."""
        return _overlap(self.wanted, self.choice)

    @property
    def cautions(self) -> tuple[str, ...]:
        """What to know before it is used."""
        return _cautions(self.wanted, self.choice)

    @property
    def energy_error(self) -> float:
        """What is dissipated too much, over what is wanted, of impacts even in ln v."""
        energy = self.wanted.velocity**2
        wanted = float(np.sum((1 - self.wanted.restitution**2) * energy))
        given = float(np.sum((1 - self.choice.impacts.coefficient**2) * energy))
        return given / wanted - 1 if wanted > 0 else 0.0

    def to_dict(self) -> dict[str, Any]:
        """What export.json holds."""
        choice, steps, impacts = self.choice, self.choice.steps, self.choice.impacts
        return {
            "material": self.wanted.name,
            "to": self.to,
            "law": choice.key,
            "label": choice.label,
            "carrier": choice.carrier.name,
            "parameters": parameters_of(choice.law),
            "wanted": {"law": type(self.wanted.law).__name__, **parameters_of(self.wanted.law)},
            "velocity_range": list(self.wanted.range),
            "tolerance": self.order.tolerance,
            "largest_error": choice.total,
            "error_of_law": choice.error,
            "error_of_time_step": steps.error,
            "error_of_dissipated_energy": self.energy_error,
            "interpolation_error": self.interpolation_error,
            "energy_gain": impacts.gain,
            "largest_overlap_over_radius": self.overlap,
            "radius": {"value": self.wanted.radius, "of": self.wanted.radius_of},
            "bodies": SCENES.get(self.wanted.on_wall),
            "cautions": list(self.cautions),
            "contact_duration": {"longest": max(self.duration), "shortest": min(self.duration)},
            "time_step": self.time_step,
            "steps_in_shortest_contact": steps.count,
            "order_of_time_step": steps.order,
            "softer": {
                "overlaps": choice.stretch,
                "time_step": choice.stretch,
                "forces": 1 / choice.stretch,
            },
            "tried": [{"law": t.key, "label": t.label, "error": t.error} for t in self.tried],
            "curve": {
                "velocity": self.wanted.velocity.tolist(),
                "wanted": self.wanted.restitution.tolist(),
                "given": impacts.coefficient.tolist(),
                "contact_duration": self.duration.tolist(),
            },
            "files": list(self.files),
            "versions": {"softjax-contact": version_of("softjax-contact")},
        }

    def __str__(self) -> str:
        choice, steps = self.choice, self.choice.steps
        low, high = self.wanted.range
        shortest, longest = (number(1e6 * t, 3) for t in (min(self.duration), max(self.duration)))
        order = "" if steps.order is None else f", error ∝ step^{steps.order:.1f}"
        rows = {} if self.wanted.on_wall is None else {"bodies": SCENES[self.wanted.on_wall]}
        rows |= {
            "law": f"{choice.label} (by {choice.carrier.name})",
            "range": f"{number(low)} to {number(high)} m/s, ε {_ends(self.wanted.restitution)}",
            "largest error": f"{number(choice.total, 2)}: law {number(choice.error, 2)}, "
            f"time step {number(steps.error, 2)}; tolerance {number(self.order.tolerance)}",
            "dissipated energy": f"{100 * self.energy_error:+.1f} %",
            "contact": f"{shortest} to {longest} µs",
            "largest overlap": f"{_percent(self.overlap)} % of the {self.wanted.radius_of} radius",
            "time step": f"{number(self.time_step, 3)} s, {steps.count} in the shortest contact{order}",
            "tried": "; ".join(f"{t.key} {number(t.error, 2)}" for t in self.tried),
        }
        if choice.stretch != 1:
            times = number(choice.stretch, 3)
            rows["softer"] = f"overlaps and time step {times} times, forces 1/{times}"
        if self.interpolation_error:
            rows["table"] = f"forces off by {number(self.interpolation_error, 2)} of the largest"
        if choice.impacts.gain:
            rows["energy gain"] = f"{number(choice.impacts.gain, 2)} of the impact's energy at most"
        width = max(map(len, rows))
        lines = [f"{self.wanted.name} for {self.to}"]
        lines += [f"  {name:<{width}}  {text}" for name, text in rows.items()]
        return "\n".join(lines + [f"  ! {caution}" for caution in self.cautions])

    __repr__ = __str__


def notes_of(wanted: Wanted, choice: Choice, order: Order) -> tuple[str, ...]:
    """What every file that is written begins with."""
    steps = choice.steps
    low, high = wanted.range
    notes: tuple[str, ...] = (
        f"{choice.label.replace('ε', 'eps')}, for {wanted.name}",
        "",
        f"Impacts of {number(low)} to {number(high)} m/s: eps within {number(choice.total, 2)} of the "
        f"one wanted, {_ends(wanted.restitution)},",
        f"at time steps of {number(choice.step, 3)} s, {steps.count} in the shortest contact.",
        f"Effective radius {number(number_of(wanted.contact.radius))} m and mass "
        f"{number(number_of(wanted.contact.mass))} kg.",
    )
    others = "two balls" if wanted.on_wall else "a wall in a ball's place"
    these = SCENES.get(wanted.on_wall, "this pair")
    if choice.carrier.is_of_mass(order.version):
        notes += (f"Its damping is told for that mass, of {these}: other sizes,",)
        notes += (f"or {others}, need another.",)
    else:
        notes += (f"That error is of {these}: other sizes, or {others}, have another.",)
    if choice.stretch != 1:
        notes += (f"Softer: overlaps {number(choice.stretch, 3)} times those of the law.",)
    if isinstance(choice.law, sj.RateIndependentLaw):
        notes += (_balance(choice, order),)
    return tuple(map(_harmless, (*notes, *_cautions(wanted, choice))))


def _cautions(wanted: Wanted, choice: Choice) -> tuple[str, ...]:
    """What to know before it is used: where nobody measured, deep overlaps, doubts of the fit."""
    told = []
    low, high = wanted.range
    overlap = _overlap(wanted, choice)
    if wanted.measured is not None:
        least, most = wanted.measured
        if low < (1 - SLACK) * least or high > (1 + SLACK) * most:
            span = f"{number(least)} to {number(most)} m/s"
            told.append(f"Measured were {span}: beyond them the curve is the law's alone.")
    if overlap > DEEP:
        told.append(f"Overlaps reach {100 * overlap:.0f} % of the radius: laws are for small ones.")
    if wanted.doubts:
        told.append(f"Doubts about the fit: {', '.join(wanted.doubts)}; its report has them.")
    return tuple(told)


def _overlap(wanted: Wanted, choice: Choice) -> float:
    """The largest in the code, over the radius."""
    return float(np.max(choice.impacts.peak)) * choice.stretch / wanted.radius


def _balance(choice: Choice, order: Order) -> str:
    if order.losses or not choice.impacts.gain:
        return "No history of loading and unloading gains energy."
    gain = number(choice.impacts.gain, 2)
    return f"An impact gains at most {gain} of its energy (just above yield)."


def parameters_of(law: Any) -> dict[str, Any]:
    """Numbers and options of a law and its contact; what is whole left out."""
    numbers = {name: number_of(value) for name, value in numbers_of(law).items()}
    return numbers | {name: getattr(law, name) for name in options_of(type(law))}


def _percent(share: float) -> str:
    return number(100 * share, 2) if share < 1 else f"{100 * share:.0f}"


def _ends(values: np.ndarray) -> str:
    return f"{number(float(values[0]))} to {number(float(values[-1]))}"


def _harmless(note: str) -> str:
    """One line of ASCII that ends no comment: of C by its marks, of LAMMPS by three quotes."""
    text = printable(note).encode("ascii", "replace").decode()
    return text.replace("*/", "* /").replace("/*", "/ *").replace('"', "'")
