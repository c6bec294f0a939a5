"""An export: what was requested, what the code gives, what a scene needs to know; printed and drawn."""

from dataclasses import dataclass
from importlib.metadata import version as version_of
from typing import Any

import numpy as np

import softjax as sj
from calibration.errors import printable
from calibration.particle_codes.choice import CONSTANT, Choice, ExportOptions
from calibration.particle_codes.softening import softened
from calibration.particle_codes.target import Target, impacts_of, number_of
from calibration.rounding import number
from softjax.fields import numbers_of, options_of

POISSON_RATIO = 0.3
DEEP = 0.1  # of the radius: laws of contact are for small overlaps
SLACK = 1e-3  # of a velocity: text rounds
# by `Target.on_wall`
SCENES: dict[bool | None, str] = {True: "a ball on a flat wall", False: "two balls"}
REQUESTED, OTHER = ", as wanted", ", which needs numbers of its own"
SLOWER, NEARLY_ELASTIC = 10.0, 0.98  # below the range, and ε that leaves beds bouncing


@dataclass(frozen=True, eq=False, repr=False)
class Export:
    """A law written for a particle code; prints itself.

    Attributes:
        to: the code.
        target: the law and velocities that were requested.
        choice: the law that the code gets, its impacts and its time step.
        tried: all laws looked at, in the order of their cost.
        options: the tolerance and what else was requested.
        files: their names.
    """

    to: str
    target: Target
    choice: Choice
    tried: list[Choice]
    options: ExportOptions
    files: tuple[str, ...] = ()

    @property
    def law(self) -> sj.ContactLaw:
        """The law that the code follows, at its own stiffness."""
        return self.choice.law

    @property
    def code_law(self) -> Any:
        """The same as soft as the scene bears it."""
        return softened(self.choice.law, self.choice.softening_factor)

    @property
    def peak(self) -> float:
        """The largest overlap in the code [m]."""
        return float(self.choice.impacts.peak[-1]) * self.choice.softening_factor

    @property
    def poisson_ratio(self) -> float:
        """Where only the contact is known a usual one: the modulus goes with it."""
        ratio = self.target.poisson_ratio
        return POISSON_RATIO if ratio is None else ratio

    @property
    def of_balls(self) -> str:
        """Whether the line between two balls is what was requested."""
        return {None: "", True: OTHER, False: REQUESTED}[self.target.on_wall]

    @property
    def of_wall(self) -> str:
        """Whether the line of a wall is."""
        same = " of the same material"
        return {None: same, True: REQUESTED, False: same + OTHER}[self.target.on_wall]

    @property
    def time_step(self) -> float:
        """[s]"""
        return self.choice.step

    @property
    def duration(self) -> np.ndarray:
        """Of contacts in the code, over the velocities of the target [s]."""
        return self.choice.impacts.duration * self.choice.softening_factor

    @property
    def overlap(self) -> float:
        """The largest overlap in the code over the radius."""
        return (
            float(np.max(self.choice.impacts.peak))
            * self.choice.softening_factor
            / self.target.radius
        )

    @property
    def cautions(self) -> tuple[str, ...]:
        """What to know before it is used: deep overlaps, slow impacts, warnings about the fit."""
        told, target = [], self.target
        low, high = target.range
        if target.measured is not None:
            least, most = target.measured
            if low < (1 - SLACK) * least or high > (1 + SLACK) * most:
                span = f"{number(least)} to {number(most)} m/s"
                told.append(f"Measured were {span}: beyond them the curve is the law's alone.")
        if self.overlap > DEEP:
            told.append(
                f"Overlaps reach {100 * self.overlap:.0f} % of the radius: laws are for small ones."
            )
        told += self._below()
        if target.doubts:
            told.append(f"Warnings about the fit: {', '.join(target.doubts)}; its report has them.")
        return tuple(told)

    def _below(self) -> list[str]:
        """The law of impacts slower than the range."""
        choice, (low, _) = self.choice, self.target.range
        held = f"eps is held at {number(float(choice.impacts.coefficient[0]))}"
        if choice.key in CONSTANT:
            return []
        if choice.hold:
            error = number(choice.hold_error, 2)
            return [f"Below {number(low)} m/s {held} by a dashpot, within {error} at this step."]
        below = low / SLOWER
        slow = float(impacts_of(self.law, np.array([below]), self.options.losses).coefficient[0])
        lines = []
        if slow > NEARLY_ELASTIC:
            eps = f"eps {number(slow, 4)} at {number(below, 2)} m/s"
            lines.append(f"Slower impacts lose nearly nothing, {eps}: a bed settles slowly.")
        if below < self.target.determined_from:
            known = number(self.target.determined_from)
            lines.append(f"Below {known} m/s the data do not determine eps.")
        if lines:
            lines.append(f"With --below hold {held} below {number(low)} m/s.")
        return lines

    @property
    def energy_error(self) -> float:
        """Dissipated energy in excess of the target's, over that, of impacts even in ln v."""
        energy = self.target.velocity**2
        lost = float(np.sum((1 - self.target.restitution**2) * energy))
        given = float(np.sum((1 - self.choice.impacts.coefficient**2) * energy))
        return given / lost - 1 if lost > 0 else 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """The lines that every file begins with."""
        choice, target, contact = self.choice, self.target, self.target.contact
        low, high = target.range
        others = "two balls" if target.on_wall else "a wall in a ball's place"
        these = SCENES.get(target.on_wall, "this pair")
        notes = [
            f"{choice.label.replace('ε', 'eps')}, for {target.name}",
            "",
            f"Impacts of {number(low)} to {number(high)} m/s: eps within {number(choice.total, 2)} of the "
            f"one wanted, {_ends(target.restitution)},",
            f"at time steps of {number(choice.step, 3)} s, {choice.steps.count} in the shortest contact.",
            f"Effective radius {number(number_of(contact.radius))} m and mass "
            f"{number(number_of(contact.mass))} kg.",
        ]
        if target.pairs:
            radii = ", ".join(number(one) for one in self.options.sizes or ())
            notes.append(f"That error is of all pairs of spheres of radius {radii} m.")
        elif choice.backend.of_mass:
            notes.append(
                f"Its damping is for that mass, of {these}: other sizes, or {others}, need"
            )
            notes.append("an export of their own, or --sizes.")
        else:
            notes.append(f"That error is of {these}: other sizes, or {others}, have another.")
        if choice.softening_factor != 1:
            notes.append(
                f"Softer: overlaps {number(choice.softening_factor, 3)} times those of the law."
            )
        if isinstance(choice.law, sj.RateIndependentLaw):
            gain = 0.0 if self.options.losses else choice.impacts.gain
            notes.append(
                f"An impact gains at most {number(gain, 2)} of its energy (just above yield)."
                if gain
                else "No history of loading and unloading gains energy."
            )
        return tuple(map(_harmless, (*notes, *self.cautions)))

    def to_dict(self) -> dict[str, Any]:
        """What export.json holds."""
        choice, steps, impacts = self.choice, self.choice.steps, self.choice.impacts
        return {
            "material": self.target.name,
            "to": self.to,
            "law": choice.key,
            "label": choice.label,
            "backend": choice.backend.name,
            "parameters": parameters_of(choice.law),
            "wanted": {"law": type(self.target.law).__name__, **parameters_of(self.target.law)},
            "velocity_range": list(self.target.range),
            "tolerance": self.options.tolerance,
            "largest_error": choice.total,
            "error_of_law": choice.error,
            "error_of_time_step": steps.error,
            "error_of_dissipated_energy": self.energy_error,
            "energy_gain": impacts.gain,
            "largest_overlap_over_radius": self.overlap,
            "radius": {"value": self.target.radius, "of": self.target.radius_of},
            "bodies": SCENES.get(self.target.on_wall),
            "cautions": list(self.cautions),
            "contact_duration": {"longest": max(self.duration), "shortest": min(self.duration)},
            "below": {
                "law": self.options.below,
                "restitution": float(impacts.coefficient[0]) if choice.hold else None,
                "error_of_time_step": choice.hold_error,
            },
            "sizes": self.options.sizes and list(self.options.sizes),
            "time_step": self.time_step,
            "steps_in_shortest_contact": steps.count,
            "order_of_time_step": steps.order,
            "softer": {
                "overlaps": choice.softening_factor,
                "time_step": choice.softening_factor,
                "forces": 1 / choice.softening_factor,
            },
            "tried": [{"law": t.key, "label": t.label, "error": t.error} for t in self.tried],
            "curve": {
                "velocity": self.target.velocity.tolist(),
                "wanted": self.target.restitution.tolist(),
                "given": impacts.coefficient.tolist(),
                "contact_duration": self.duration.tolist(),
            },
            "files": list(self.files),
            "versions": {"softjax-contact": version_of("softjax-contact")},
        }

    def __str__(self) -> str:
        choice, steps = self.choice, self.choice.steps
        low, high = self.target.range
        shortest, longest = (number(1e6 * t, 3) for t in (min(self.duration), max(self.duration)))
        order = "" if steps.order is None else f", error ∝ step^{steps.order:.1f}"
        rows = {} if self.target.on_wall is None else {"bodies": SCENES[self.target.on_wall]}
        rows |= {
            "law": f"{choice.label} (by {choice.backend.name})",
            "range": f"{number(low)} to {number(high)} m/s, ε {_ends(self.target.restitution)}",
            "largest error": f"{number(choice.total, 2)}: law {number(choice.error, 2)}, "
            f"time step {number(steps.error, 2)}; tolerance {number(self.options.tolerance)}",
            "dissipated energy": f"{100 * self.energy_error:+.1f} %",
            "contact": f"{shortest} to {longest} µs",
            "largest overlap": f"{_percent(self.overlap)} % of the {self.target.radius_of} radius",
            "time step": f"{number(self.time_step, 3)} s, {steps.count} in the shortest contact{order}",
            "tried": "; ".join(f"{t.key} {number(t.error, 2)}" for t in self.tried),
        }
        if choice.softening_factor != 1:
            times = number(choice.softening_factor, 3)
            rows["softer"] = f"overlaps and time step {times} times, forces 1/{times}"
        if choice.impacts.gain:
            rows["energy gain"] = f"{number(choice.impacts.gain, 2)} of the impact's energy at most"
        width = max(map(len, rows))
        lines = [f"{self.target.name} for {self.to}"]
        lines += [f"  {name:<{width}}  {text}" for name, text in rows.items()]
        return "\n".join(lines + [f"  ! {caution}" for caution in self.cautions])

    __repr__ = __str__


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


def draw_export(made: Export) -> Any:
    """ε over v above, the difference from the target's below."""
    from calibration.plots import style

    figure = style.new_figure(6.0, 5.5)
    curve, errors = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    velocity, wanted = made.target.velocity, made.target.restitution
    given, step = made.choice.impacts.coefficient, made.choice.steps
    name = style.plain(made.target.name)
    curve.plot(velocity, wanted, color=style.BLACK, label=f"wanted, {name}")
    label = f"{made.to}: {made.choice.label}"
    curve.plot(velocity, given, color=style.BLUE, linestyle="--", label=label)
    curve.set(ylabel=r"restitution $\varepsilon$")
    look = {"color": style.BLUE, "alpha": 0.25, "linewidth": 0, "label": "time step"}
    off = given - wanted
    errors.fill_between(velocity, off - step.error, off + step.error, **look)
    errors.plot(velocity, off, color=style.BLUE, linestyle="--")
    for sign, words in ((-1, None), (1, "tolerance")):
        tolerance = sign * made.options.tolerance
        errors.axhline(tolerance, color=style.GREY, linestyle=":", label=words)
    errors.set(xlabel="impact velocity $v$ [m/s]", ylabel=r"given $-$ wanted")
    if style.spans_decades(velocity):
        style.logarithmic_x(errors)
    style.legend_below(figure, [curve, errors], 2)  # inside it would lie on a line
    return figure
