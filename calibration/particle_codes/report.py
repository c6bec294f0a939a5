"""The result of an export: its law, errors and time step; printed, drawn and as export.json."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version as version_of
from typing import Any

import numpy as np

import softjax as sj
from calibration.errors import printable
from calibration.particle_codes.choice import Choice, can_hold
from calibration.particle_codes.codes import CONSTANT, HEADER, HOW, PLUGINS
from calibration.particle_codes.target import (
    POINTS,
    ExportOptions,
    Target,
    coefficient_of,
    impacts_of,
    number_of,
)
from calibration.rounding import number
from softjax.fields import numbers_of, options_of

DEVIATIONS = {"contact time": "duration", "largest overlap": "peak", "peak force": "force"}
SMALL = 0.005  # a deviation that is not stated
DEEP = 0.1  # of the radius: contact laws are for small overlaps
SLACK = 1e-3  # of a velocity: text rounds
SCENES: dict[bool | None, str] = {True: "a ball on a flat wall", False: "two balls"}
WALL_ALONE = {  # by code and law, what its file of a wall does to balls
    (
        "yade",
        "hertz-dashpot",
    ): "For walls alone: YADE takes a wall for a ball as large as the other, for which the modulus "
    "is √2 times larger; two balls would be as much too stiff.",
}
SLOWER, NEARLY_ELASTIC = 10.0, 0.98  # below the range, and an ε that leaves beds bouncing


@dataclass(frozen=True, eq=False, repr=False)
class Export:
    """A law written for a particle code; prints itself.

    Attributes:
        to: the code.
        target: the law and the velocities that were requested.
        choice: the law that the code gets, its impacts and its time step.
        tried: all laws that were tried, in the order of their cost.
        files: names of the files.
        stale: whether a plugin of an earlier export is in the folder.
    """

    to: str
    target: Target
    choice: Choice
    tried: list[Choice]
    files: tuple[str, ...] = ()
    stale: bool = False

    @property
    def law(self) -> sj.ContactLaw:
        """The law in the code, as stiff as it is."""
        return self.choice.law

    @property
    def options(self) -> ExportOptions:
        """The tolerance and the other options."""
        return self.target.options

    @property
    def overlap(self) -> float:
        """The largest overlap in the code over the radius, of all pairs."""
        pairs = zip(self.target.pairs, self.choice.of_pairs, strict=True)
        shares = [float(np.max(impacts.peak)) / pair.smaller for pair, impacts in pairs]
        return max(float(np.max(self.choice.impacts.peak)) / self.target.radius, *shares, 0.0)

    @property
    def time_step(self) -> float:
        """[s]"""
        return self.choice.steps.step

    @property
    def duration(self) -> np.ndarray:
        """Contact durations in the code over the velocities of the target [s]."""
        return self.choice.impacts.duration

    @property
    def durations(self) -> tuple[float, float]:
        """The shortest contact in the code and the longest one, of all pairs [s]."""
        all_of = np.concatenate(
            [of.duration for of in (self.choice.impacts, *self.choice.of_pairs)]
        )
        return float(np.min(all_of)), float(np.max(all_of))

    @property
    def weight_number(self) -> float:
        """g T/v of the slowest impact of all pairs, of duration T: by how much weight changes its speed meanwhile."""
        slowest = max(float(of.duration[0]) for of in (self.choice.impacts, *self.choice.of_pairs))
        return self.target.gravity * slowest / self.target.range[0]

    @cached_property
    def deviations(self) -> dict[str, tuple[float, float]]:
        """Contact time, largest overlap and peak force in the code over those of the law, less 1: slowest and fastest."""
        law = self.target.law
        if isinstance(law, sj.HardSphereLaw):
            return {}
        own = impacts_of(law, self.target.velocity, self.options.losses)
        made = self.choice.impacts
        ratios = {name: getattr(made, f) / getattr(own, f) - 1 for name, f in DEVIATIONS.items()}
        return {name: (float(ratio[0]), float(ratio[-1])) for name, ratio in ratios.items()}

    @property
    def energy_error(self) -> float:
        """Relative error of the dissipated energy, over impacts uniform in ln v."""
        energy = self.target.velocity**2
        requested = float(np.sum((1 - self.target.restitution**2) * energy))
        dissipated = float(np.sum((1 - self.choice.impacts.coefficient**2) * energy))
        return dissipated / requested - 1 if requested > 0 else 0.0

    @property
    def headline(self) -> str:
        """Headline of what a file lacks; empty if nothing."""
        if not self.target.on_wall:
            return ""
        if self.to == "lammps" and not self.options.types:
            return "No law between balls: they pass through each other until another file sets one."
        return WALL_ALONE.get((self.to, self.choice.key), "")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings before a file is used: extrapolation, deep overlaps, slow impacts, warnings of the fit."""
        fit, (low, high) = self.target.fit, self.target.range
        texts = [self.headline] if self.headline else []
        if self.stale:
            texts.append("Build again by build.sh: softjaxplugin.so there is of an earlier export.")
        measured = (low, high) if fit is None else fit.data.velocity
        slowest, fastest = float(np.min(measured)), float(np.max(measured))
        if low < (1 - SLACK) * slowest or high > (1 + SLACK) * fastest:
            ends = f"{number(slowest)} to {number(fastest)} m/s"
            texts.append(f"Measured: {ends}. Outside, ε is that of the law.")
        if self.overlap > DEEP:
            percent = f"{100 * self.overlap:.0f} %"
            texts.append(
                f"Overlaps reach {percent} of the radius: contact laws are for small ones."
            )
        if self.choice.key not in CONSTANT:
            texts += self._below(low)
        elif self.options.below == "hold":
            constant = number(float(self.choice.impacts.coefficient[0]))
            texts.append(f"Below {number(low)} m/s ε is {constant} too, by the same dashpot.")
        if fit is not None and fit.warnings:
            names = dict.fromkeys(warning.code for warning in fit.warnings)
            texts.append(f"Warnings of the fit: {', '.join(names)}; see its report.")
        return tuple(texts)

    def _below(self, low: float) -> Iterator[str]:
        """The law of impacts slower than the range."""
        choice, fit, below = self.choice, self.target.fit, low / SLOWER
        constant = f"ε is held at {number(float(choice.impacts.coefficient[0]))}"
        if choice.hold:
            within = f"within {number(choice.hold_error, 2)} at this time step"
            yield f"Below {number(low)} m/s {constant} by a dashpot, {within}."
            return
        hit = sj.restitution(self.law, np.full(POINTS, below))  # by the program of the range
        slow = float(coefficient_of(hit, self.options.losses)[0])
        elastic, unknown = slow > NEARLY_ELASTIC, fit is not None and fit.known_from > 0
        if elastic:
            where = f"ε is {number(slow, 4)} at {number(below, 2)} m/s"
            yield f"Slower impacts lose nearly nothing ({where}): a bed settles slowly."
        if fit is not None and unknown:
            yield f"Below {number(fit.known_from)} m/s the data do not determine ε."
        if (elastic or unknown) and not can_hold(choice.key, self.target.law, choice.backend):
            yield "--below hold needs another law: the ε of this one cannot be held."
        elif elastic or unknown:
            yield f"With --below hold {constant} below {number(low)} m/s."

    @property
    def notes(self) -> tuple[str, ...]:
        """The first lines of every file."""
        choice, target, contact = self.choice, self.target, self.target.contact
        radius, mass = (number(number_of(size)) for size in (contact.radius, contact.mass))
        others = "two balls" if target.on_wall else "a wall in place of a ball"
        this = SCENES.get(target.on_wall, "this pair")
        of_sizes = f"That error is of {this}: other sizes, or {others}, have another."
        if target.pairs:
            radii = ", ".join(number(size) for size in self.options.sizes or ())
            of_sizes = f"That error is of all pairs of spheres of radius {radii} m."
        elif choice.backend.of_mass:
            of_sizes = f"Its damping is for that mass, of {this}: other sizes, or {others}, need --sizes or another export."
        lines = [
            f"{choice.label}, for {target.name}",
            "",
            *(f"{name}: {text}" for name, text in self._rows().items()),
            f"Effective radius {radius} m, effective mass {mass} kg.",
            of_sizes,
        ]
        first = [self.headline, ""] if self.headline else []
        rest = self.warnings[1:] if self.headline else self.warnings
        return tuple(map(_harmless, (*first, *lines, *rest)))

    def to_dict(self) -> dict[str, Any]:
        """The content of export.json."""
        choice, steps, impacts = self.choice, self.choice.steps, self.choice.impacts
        factor = choice.softening_factor
        return {
            "material": self.target.name,
            "to": self.to,
            "law": choice.key,
            "label": choice.label,
            "backend": choice.backend.name,
            "parameters": parameters_of(choice.law),
            "requested": {"law": type(self.target.law).__name__, **parameters_of(self.target.law)},
            "velocity_range": list(self.target.range),
            "tolerance": self.options.tolerance,
            "largest_error": choice.total,
            "error_of_law": choice.error,
            "error_of_time_step": steps.error,
            "error_of_weight": choice.weight,
            "gravity": self.target.gravity,
            "weight_number": self.weight_number,
            "deviations": {n.replace(" ", "_"): x for n, x in self.deviations.items()},
            "error_of_dissipated_energy": self.energy_error,
            "energy_gain": impacts.gain,
            "largest_overlap_over_radius": self.overlap,
            "radius": {"value": self.target.radius, "of": self.target.radius_of},
            "bodies": SCENES.get(self.target.on_wall),
            "warnings": list(self.warnings),
            "contact_duration": dict(zip(("shortest", "longest"), self.durations, strict=True)),
            "below": {
                "law": self.options.below,
                "restitution": float(impacts.coefficient[0]) if choice.hold else None,
                "error_of_time_step": choice.hold_error,
            },
            "sizes": self.options.sizes and list(self.options.sizes),
            "time_step": self.time_step,
            "steps_in_shortest_contact": steps.count,
            "order_of_time_step": steps.order,
            "softer": {"overlaps": factor, "time_step": factor, "forces": 1 / factor},
            "tried": [{"law": t.key, "label": t.label, "error": t.error} for t in self.tried],
            "curve": {
                "velocity": self.target.velocity.tolist(),
                "requested": self.target.restitution.tolist(),
                "exported": impacts.coefficient.tolist(),
                "contact_duration": self.duration.tolist(),
            },
            "files": list(self.files),
            "versions": {"softjax-contact": version_of("softjax-contact")},
        }

    def _rows(self) -> dict[str, str]:
        choice, steps = self.choice, self.choice.steps
        low, high = self.target.range
        shortest, longest = (number(1e6 * t, 3) for t in self.durations)
        order = ""
        if steps.order is not None:
            order = f"; half of it has {100 * 0.5**steps.order:.0f} % of its error"
        share = f"{float(number(100 * self.overlap, 2)):g}"
        rows = {} if self.target.on_wall is None else {"bodies": SCENES[self.target.on_wall]}
        weight = f"g T/v {number(self.weight_number, 2)} at {number(low)} m/s"
        if not self.target.gravity:
            weight = "none (gravity 0)"
        error = f"law {number(choice.error, 2)}, time step {number(steps.error, 2)}"
        if self.target.gravity:
            error += f", weight {number(choice.weight, 2)}"
        rows |= {
            "law": f"{choice.label} ({HOW[choice.backend.name]})",
            "range": f"{number(low)} to {number(high)} m/s, ε {_ends(self.target.restitution)}",
            "largest error": f"{number(choice.total, 3)}: {error}; tolerance {number(self.options.tolerance, 3)}",
            "dissipated energy": f"{100 * self.energy_error:+.1f} %",
            "contact": f"{shortest} to {longest} µs",
            "largest overlap": f"{share} % of the {self.target.radius_of} radius",
            "time step": f"{number(self.time_step, 3)} s, {steps.count} in the shortest contact{order}",
            "weight": weight,
            "errors of laws": "; ".join(f"{t.key} {number(t.error, 2)}" for t in self.tried),
        }
        if choice.backend.name == HEADER and self.to in PLUGINS:
            rows["plugin"] = "build it by sh build.sh"
        if choice.softening_factor != 1:
            times = number(choice.softening_factor, 3)
            rows["softer"] = f"overlaps and time step {times} times, forces 1/{times}"
        if any(abs(x) > SMALL for ends in self.deviations.values() for x in ends):
            columns = zip(*self.deviations.values(), strict=True)
            ends = (", ".join(map(_deviation, self.deviations, column)) for column in columns)
            rows["deviations"] = "; ".join(
                f"{number(v)} m/s: {end}" for v, end in zip((low, high), ends, strict=True)
            )
        if choice.impacts.gain:
            rows["energy gain"] = f"{number(choice.impacts.gain, 2)} of the impact's energy at most"
        return rows

    def __str__(self) -> str:
        rows = self._rows()
        width = max(map(len, rows))
        lines = [f"{self.target.name} for {self.to}"]
        lines += [f"  {name:<{width}}  {text}" for name, text in rows.items()]
        return "\n".join(lines + [f"  ! {warning}" for warning in self.warnings])

    __repr__ = __str__

    def draw(self) -> Any:
        """ε over v above, the difference from the requested one below."""
        from calibration.plots import style

        figure = style.new_figure(5.5)
        curve, errors = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        velocity, requested = self.target.velocity, self.target.restitution
        exported, step = self.choice.impacts.coefficient, self.choice.steps.error
        off, name = exported - requested, style.plain(self.target.name)
        curve.plot(velocity, requested, color=style.BLACK, label=f"requested, {name}")
        label = f"{self.to}: {self.choice.label}"
        curve.plot(velocity, exported, "--", color=style.BLUE, label=label)
        curve.set(ylabel=r"restitution $\varepsilon$")
        within = f"± error of the time step, {number(1e6 * self.time_step, 3)} µs"
        style.band(errors, velocity, off - step, off + step, label=within)
        errors.plot(velocity, off, "--", color=style.BLUE)
        for end in (-self.options.tolerance, self.options.tolerance):
            errors.axhline(end, color=style.GREY, ls=":", label="tolerance")
        errors.set(xlabel=style.VELOCITY, ylabel=r"exported $-$ requested")
        if style.spans_decades(velocity):
            style.logarithmic_x(errors)
        style.legend_below(figure, [curve, errors])  # inside it would lie on a line
        return figure


def parameters_of(law: Any) -> dict[str, Any]:
    """Numbers and options of a law and its contact, without its array fields."""
    numbers = {name: number_of(value) for name, value in numbers_of(law).items()}
    return numbers | {name: getattr(law, name) for name in options_of(type(law))}


def _deviation(name: str, ratio: float) -> str:
    return f"{name} {100 * ratio:+.0f} %"


def _ends(values: np.ndarray) -> str:
    return f"{number(float(values[0]))} to {number(float(values[-1]))}"


def _harmless(note: str) -> str:
    """One line of ASCII that ends no comment: of C by its marks, of LAMMPS by three quotes."""
    text = (
        printable(note)
        .replace("ε", "eps")
        .replace("µ", "u")
        .replace("√2", "sqrt(2)")
        .encode("ascii", "replace")
        .decode()
    )
    return text.replace("*/", "* /").replace("/*", "/ *").replace('"', "'")
