"""What a file, or a caller, says of a parameter: fixed or free, where, how well known before."""

import math
from dataclasses import dataclass, field

from calibration.errors import DataError, Origin, is_finite_number, listed

TRANSFORMS = ("log", "logit", "none")
ALL = "all"  # the group of what is shared by every data set

# the smallest and largest value that makes sense
RANGES = {
    "chi": (0.0, math.inf),
    "sigma": (0.0, math.inf),
    "psi": (0.0, math.inf),
    "eps_up": (0.0, 1.0),
    "restitution": (0.0, 1.0),
    "yield_strength": (0.0, math.inf),
    "youngs_modulus": (0.0, math.inf),
    "limit_velocity": (0.0, math.inf),
    "c1": (-math.inf, math.inf),
    "c2": (-math.inf, math.inf),
}
POSITIVE = ("psi", "yield_strength", "youngs_modulus", "limit_velocity")  # where 0 is no value
SHARED_ONLY = ("c1", "c2")  # Eq. (18)'s line belongs to all materials
OF_A_MATERIAL = tuple(name for name in RANGES if name not in SHARED_ONLY)
OF_THE_CONTACT = ("yield_strength", "youngs_modulus", "limit_velocity")  # have a value anyway
ELASTIC = ("chi", "eps_up", "yield_strength", "youngs_modulus")  # need the two bodies


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter as asked for; what is None is left to the fit.

    Attributes:
        name: one of `RANGES`. Moduli and strengths are those of the contact.
        free: whether it is fitted.
        value: its start where free, its value where not; SI.
        bounds: (lowest, highest), infinite where open.
        prior: (mean, standard deviation) of a Gaussian prior.
        transform: "log", "logit" or "none": the scale it is searched on.
        shared: name of a group of data sets that have one value of it; None: its own.

    Raises:
        ValueError: naming what is wrong, its value and what is accepted.
    """

    name: str
    free: bool = True
    value: float | None = None
    bounds: tuple[float, float] | None = None
    prior: tuple[float, float] | None = None
    transform: str | None = None
    shared: str | None = None
    origin: Origin | None = field(default=None, compare=False, kw_only=True)

    def __post_init__(self):
        if self.name not in RANGES:
            raise DataError("name", repr(self.name), f"one of {listed(RANGES)}")
        if not isinstance(self.free, bool):
            raise DataError("free", self.free, "true or false")
        self._check_value()
        self._check_bounds()
        self._check_prior()
        self._check_transform()
        if self.shared is not None and not (isinstance(self.shared, str) and self.shared.strip()):
            raise DataError("shared", self.shared, "the name of a group of data sets")
        if not self.free:
            self._check_fixed()

    @property
    def range(self) -> tuple[float, float]:
        """The smallest and largest value that makes sense."""
        return RANGES[self.name]

    def _check_value(self) -> None:
        if self.value is None:
            return
        low, high = self.range
        above = is_finite_number(self.value) and self.value >= low
        if not above or self.value > high or (self.value == 0 and self.name in POSITIVE):
            raise DataError("value", self.value, self._accepted())

    def _check_bounds(self) -> None:
        if self.bounds is None:
            return
        object.__setattr__(self, "bounds", _pair("bounds", self.bounds, "[lowest, highest]"))
        (low, high), (least, most) = self.bounds, self.range
        if not low < high:
            raise DataError("bounds", f"[{low}, {high}]", "[lowest, highest], lowest below highest")
        low, high = max(low, least), min(high, most)
        if (low, high) != self.bounds and not _only_infinite_moved(self.bounds, (low, high)):
            raise DataError("bounds", f"{list(self.bounds)}", f"within [{least:g}, {most:g}]")
        object.__setattr__(self, "bounds", (low, high))
        if self.value is not None and not low <= self.value <= high:
            raise DataError("value", self.value, f"within its bounds, [{low:g}, {high:g}]")

    def _check_prior(self) -> None:
        if self.prior is None:
            return
        prior = _pair("prior", self.prior, "[mean, standard deviation]")
        if not (all(map(math.isfinite, prior)) and prior[1] > 0):
            raise DataError("prior", f"{list(prior)}", "[mean, positive standard deviation]")
        object.__setattr__(self, "prior", prior)

    def _check_transform(self) -> None:
        if self.transform is None:
            return
        if self.transform not in TRANSFORMS:
            raise DataError("transform", self.transform, f"one of {listed(TRANSFORMS)}")
        low, high = self.bounds or self.range
        if self.transform == "log" and not math.isfinite(low):
            raise DataError("transform", "log", "logit or none without a lower bound")
        if self.transform == "logit" and not (math.isfinite(low) and math.isfinite(high)):
            raise DataError("transform", "logit", "log or none, or both bounds given")

    def _check_fixed(self) -> None:
        for name in ("bounds", "prior", "transform", "shared"):
            if getattr(self, name) is not None:
                raise DataError(name, "given", "left out where free is false")
        if self.value is None and self.name not in OF_THE_CONTACT:
            raise DataError("value", "missing", "given where free is false")

    def _accepted(self) -> str:
        low, high = self.range
        if math.isfinite(high):
            return f"a number in [{low:g}, {high:g}]"
        if self.name in POSITIVE:
            return "a positive number"
        return "a number of 0 or more" if math.isfinite(low) else "a finite number"


def _pair(name: str, value, accepted: str) -> tuple[float, float]:
    is_pair = isinstance(value, list | tuple) and len(value) == 2
    numbers = is_pair and all(
        is_finite_number(one) or one in (math.inf, -math.inf) for one in value
    )
    if not numbers:
        raise DataError(name, value, f"two numbers, {accepted}")
    return float(value[0]), float(value[1])


def _only_infinite_moved(given: tuple[float, float], moved: tuple[float, float]) -> bool:
    """Whether only open ends were drawn in to the range that makes sense."""
    return all(a == b or math.isinf(a) for a, b in zip(given, moved, strict=True))
