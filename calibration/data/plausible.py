"""Signs of mistakes in accepted measurements: units, columns, unlabelled groups, bodies.

Properties outside their plausible ranges are a warning, far outside a refusal.
"""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from calibration.data.points import FALLEN, FALLS

FASTEST = 5000.0  # m/s
LOWEST_RESTITUTION = 0.02  # all of them below this: a percentage taken of a fraction
SURE = 3.0  # standard deviations of a fair coin, by which more than half lie above 1
FEWEST = 8  # points in which an order may show
SHORTEST = 3  # points of a run
FAR = 100.0
CHECK = "Check the value and its unit."


class Implausible(NamedTuple):
    """A warning about the input: its code, the numbers that cause it, and what to check."""

    code: str
    cause: str
    advice: str = CHECK


class Range(NamedTuple):
    """Plausible range of a property, from foam and gel to diamond and osmium."""

    code: str
    name: str
    lowest: float
    highest: float
    unit: str
    usual: str  # in which it is tabulated, and forgotten

    @property
    def accepted(self) -> str:
        return f"{self.lowest:g} to {self.highest:g} {self.unit}"

    def is_far(self, value: Any) -> bool:
        """Whether a number, or one of an array, is more than 100 times outside."""
        return bool(np.any(value > FAR * self.highest) or np.any(value < self.lowest / FAR))

    def refusal(self, name: str, value: float) -> tuple[str, str]:
        """Words for a number that is refused: what is wrong with it, and what is accepted."""
        problem = f"{name} is {value:.3g} {self.unit}, more than 100 times outside {self.accepted}"
        accepted = f'is its unit missing, as in "{value:.4g} {self.usual}"?'
        return problem, f"{accepted} plausibility = false takes it as it is"


RANGES = {
    "radius": Range("radius", "radius", 1e-6, 1.0, "m", "mm"),
    "youngs_modulus": Range("modulus", "Young's modulus", 1e5, 1.3e12, "Pa", "GPa"),
    "density": Range("density", "density", 10.0, 23_000.0, "kg/m³", "g/cm^3"),
    "yield_strength": Range("yield-strength", "yield strength", 1e4, 1e11, "Pa", "MPa"),
}


def plausibility(data: Any) -> tuple[Implausible, ...]:
    """Likely mistakes in data, each with what to check; empty if there are none."""
    with np.errstate(all="ignore"):
        warnings = [*of_bodies(data.bodies, data.contact), *_of(data)]
    return tuple(dict.fromkeys(warnings))


def of_bodies(bodies: Iterable[Any], contact: Any) -> Iterator[Implausible]:
    """The properties outside their plausible ranges, of the bodies or else of the contact."""
    for name, quantity, value in _properties(bodies, contact):
        low, high = float(np.min(value)), float(np.max(value))
        if low < quantity.lowest or high > quantity.highest:
            value = high if high > quantity.highest else low
            cause = f"the {quantity.name} of the {name} is {value:.3g} {quantity.unit}"
            cause = f"{cause}, outside {quantity.accepted}".replace("the Young", "Young")
            advice = f'{CHECK} Is it missing, as in "{value:.4g} {quantity.usual}"?'
            yield Implausible(quantity.code, cause, advice)


def _properties(bodies: Iterable[Any], contact: Any) -> Iterator[tuple[str, Range, Any]]:
    """Properties of each body, or of the two equal spheres (of ν = 0.3) that the contact could be."""
    bodies_and_values = [
        (body.name, {"radius": body.radius, **body.material.leaves()}) for body in bodies
    ]
    if not bodies_and_values and contact is not None:
        leaves = {name: np.asarray(leaf, float) for name, leaf in contact.leaves().items()}
        radius = 2 * leaves["radius"]
        equal = {"radius": radius, "yield_strength": leaves["yield_strength"]}
        equal["density"] = 2 * leaves["mass"] / (4 / 3 * np.pi * radius**3)
        equal["youngs_modulus"] = 2 * (1 - 0.3**2) * leaves["youngs_modulus"]
        bodies_and_values = [("spheres, if they are equal,", equal)]
    for name, values in bodies_and_values:
        for key, quantity in RANGES.items():
            if values[key] is not None:  # a wall has no radius
                yield name, quantity, values[key]


def _of(data: Any) -> Iterator[Implausible]:
    contact, fastest = data.contact, float(np.max(data.velocity))
    if contact is not None:
        critical, limit = np.asarray(contact.critical_velocity), np.asarray(data.limit_velocity)
        if np.any(critical > limit):
            cause = f"first yield at {np.max(critical):.3g} m/s is beyond v_lim = {np.min(limit):.3g} m/s"
            advice = (
                "Check the units of yield strength and Young's modulus. Bodies that do not yield "
            )
            advice += "need another law, rubber `--law viscoelastic`."
            yield Implausible("yield-beyond-limit", cause, advice)
    if fastest > FASTEST:
        yield Implausible("velocity", f"the largest velocity is {fastest:.3g} m/s")
    for note in data.remarks:
        if note.startswith(FALLS):  # from higher than anybody drops a ball
            yield Implausible("height", note)
    fell = any(note.startswith(FALLEN) for note in data.remarks)
    if fell and sum(body.radius is not None for body in data.bodies) > 1:
        cause = "the dropped balls met a sphere like them, as no wall is given"
        advice = "For a wall give its properties as `[material.wall]`."
        yield Implausible("no-wall", cause, advice)
    largest = float(np.nanmax(data.restitution, initial=-1.0))
    if 0 <= largest < LOWEST_RESTITUTION:
        cause = f"all restitutions are below {LOWEST_RESTITUTION}, {largest:.3g} at most"
        yield Implausible("percent", cause)
    count, above = int(np.sum(np.isfinite(data.restitution))), int(np.sum(data.restitution > 1))
    if count and above >= 0.5 * count + 0.5 * SURE * count**0.5:
        cause = f"{above} of {count} restitutions are above 1, which noise would not do"
        yield Implausible("above-one", cause, "Check the columns and their units.")
    yield from _runs(data)


def _runs(data: Any) -> Iterator[Implausible]:
    """Velocities that go all through their range several times over, and no `group`."""
    sized = data.contact is not None and any(map(np.ndim, data.contact.leaves().values()))
    if sized or data.group is not None or data.errors.shares or len(data) < FEWEST:
        return
    for velocity, word in ((data.velocity, "ascend"), (-data.velocity, "descend")):
        starts = np.concatenate([[0], np.flatnonzero(np.diff(velocity) < 0) + 1, [len(data)]])
        # repeats at one velocity are no run, nor are parts of one series whose velocities have errors
        ways = velocity[starts[1:] - 1] - velocity[starts[:-1]]
        through = np.all(ways > 0.5 * np.ptp(velocity))
        if len(starts) > 2 and np.min(np.diff(starts)) >= SHORTEST and through:
            cause = (
                f"velocities {word} {len(starts) - 1} times over, and there is no column `group`"
            )
            advice = "Add a column `group` if rows share a specimen or a launch."
            yield Implausible("groups", cause, advice)
            return
