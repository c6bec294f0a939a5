"""Parameters of a fit: fixed or free, start, bounds, prior, sharing, and the scale of the search.

The one map between the search and physics is θ(z), element by element:

log      θ = lower + eᶻ, or upper - e^{-z} where only the upper end is finite
logit    θ = lower + (upper - lower)/(1 + e⁻ᶻ)
none     θ = z, clipped to its bounds
"""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from calibration.errors import DataError, Origin, is_finite_number, listed
from softjax.fields import Declared

TRANSFORMS = ("log", "logit", "none")
POOLED = "pooled"
NONE, LOG, LOGIT, FROM_ABOVE = range(4)
LARGEST_EXPONENT = 690.0
INSIDE = 1e-12  # a start at a bound, or beyond, is moved that far inside (of the range)

Vector = Float[np.ndarray, "... p"]


@dataclass(frozen=True)
class Parameter:
    """One parameter of a law; None is left to the fit.

    Attributes:
        value: its start where free, its value where not; SI. For a field shared by all impacts, an array
            or any pytree of arrays.
        free: whether it is fitted.
        bounds: (lowest, highest), infinite where open.
        prior: (mean, standard deviation) of a Gaussian prior.
        transform: "log", "logit" or "none": the scale it is searched on.
        shared: whether all data sets have one value of it, or the name of a group of those that do;
            "pooled": each has its own, around a common mean with a spread that is fitted.
        unit: as tables and pictures write it, of a parameter whose law declares none; converts nothing.

    Raises:
        ValueError: naming what is wrong, its value and what is accepted.
    """

    value: Any = None
    free: bool = field(default=True, kw_only=True)
    bounds: tuple[float, float] | None = field(default=None, kw_only=True)
    prior: tuple[float, float] | None = field(default=None, kw_only=True)
    transform: str | None = field(default=None, kw_only=True)
    shared: bool | str = field(default=False, kw_only=True)
    unit: str = field(default="", kw_only=True)
    origin: Origin | None = field(default=None, compare=False, kw_only=True, repr=False)

    def __post_init__(self):
        if not isinstance(self.free, bool):
            raise DataError("free", self.free, "true or false")
        _check_value(self.value)
        if is_finite_number(self.value):
            object.__setattr__(self, "value", self.value + 0)  # -0.0 is 0
        if self.bounds is not None:
            object.__setattr__(self, "bounds", _bounds(self.bounds, self.value))
        if self.prior is not None:
            object.__setattr__(self, "prior", _prior(self.prior))
        if self.transform is not None and self.transform not in TRANSFORMS:
            raise DataError("transform", self.transform, f"one of {listed(TRANSFORMS)}")
        _check_shared(self.shared)
        if not isinstance(self.unit, str):
            raise DataError("unit", self.unit, 'a text such as "N/m"')
        if self.pooled and self.prior is not None:
            raise DataError("prior", "given", "left out where shared is pooled")
        if not self.free:
            self._check_fixed()

    def _check_fixed(self) -> None:
        for name in ("bounds", "prior", "transform"):
            if getattr(self, name) is not None:
                raise DataError(name, "given", "left out where free is false")
        if self.shared:
            raise DataError("shared", "given", "left out where free is false")

    @property
    def pooled(self) -> bool:
        return self.shared == POOLED

    @property
    def is_number(self) -> bool:
        return self.value is None or is_finite_number(self.value)

    def range_within(self, declared: Declared) -> tuple[float, float]:
        """Its bounds, drawn in to what the law's field declares.

        Raises:
            ValueError: where bounds or value lie outside.
        """
        low, high = self.bounds or (-math.inf, math.inf)
        least, most = max(low, declared.lower), min(high, declared.upper)
        for bound, drawn in ((low, least), (high, most)):
            if bound != drawn and math.isfinite(bound):
                raise DataError("bounds", f"[{low:g}, {high:g}]", f"within {_interval(declared)}")
        if self.value is not None and self.is_number and not declared.holds(float(self.value)):
            raise DataError("value", self.value, declared.accepted)
        if self.transform == "log" and not (math.isfinite(least) or math.isfinite(most)):
            raise DataError("transform", "log", "none, or a bound given")
        if self.transform == "logit" and not (math.isfinite(least) and math.isfinite(most)):
            raise DataError("transform", "logit", "log or none, or both bounds given")
        return least, most


def as_parameter(name: str, value: Any) -> Parameter:
    """A `Parameter` as it is; a number fixes."""
    if isinstance(value, Parameter):
        return value
    if not is_finite_number(value) and not isinstance(value, np.number):
        accepted = "a calibration.Parameter, or a number that fixes it"
        raise DataError(f"parameters[{name!r}]", value, accepted)
    return Parameter(float(value), free=False)


def _check_value(value: Any) -> None:
    is_tree = isinstance(value, np.ndarray | dict | list | tuple) or hasattr(value, "dtype")
    is_module = hasattr(type(value), "__dataclass_fields__")
    if value is not None and not is_finite_number(value) and not (is_tree or is_module):
        raise DataError("value", value, "a finite number")


def _bounds(bounds: Any, value: Any) -> tuple[float, float]:
    low, high = _pair("bounds", bounds, "[lowest, highest]")
    if not low < high:
        raise DataError("bounds", f"[{low}, {high}]", "[lowest, highest], lowest below highest")
    if is_finite_number(value) and not low <= value <= high:
        raise DataError("value", value, f"within its bounds, [{low:g}, {high:g}]")
    return low, high


def _prior(stated: Any) -> tuple[float, float]:
    prior = _pair("prior", stated, "[mean, standard deviation]")
    if not (all(map(math.isfinite, prior)) and prior[1] > 0):
        raise DataError("prior", f"{list(prior)}", "[mean, positive standard deviation]")
    return prior


def _check_shared(shared: Any) -> None:
    if isinstance(shared, bool):
        return
    if not (isinstance(shared, str) and shared.strip()):
        raise DataError("shared", shared, "true, false or the name of a group of data sets")


def _pair(name: str, value: Any, accepted: str) -> tuple[float, float]:
    is_pair = isinstance(value, list | tuple) and len(value) == 2
    numbers = is_pair and all(
        is_finite_number(one) or one in (math.inf, -math.inf) for one in value
    )
    if not numbers:
        raise DataError(name, value, f"two numbers, {accepted}")
    return float(value[0]), float(value[1])


def _interval(declared: Declared) -> str:
    left, right = "[" if declared.with_lower else "(", "]" if declared.with_upper else ")"
    return f"{left}{declared.lower:g}, {declared.upper:g}{right}"


class Transform(NamedTuple):
    """Kind and bounds of p elements, each (p,)."""

    kind: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, ranges, requested) -> "Transform":
        """Transform for the (lowest, highest) of each element and the requested kind, or None."""
        kinds = [
            _kind(low, high, name) for (low, high), name in zip(ranges, requested, strict=True)
        ]
        low, high = np.array(ranges, float).reshape(-1, 2).T
        return cls(np.array(kinds, int), low, high)

    def physical(self, z: Any, xp: Any = np) -> Any:
        """θ(z) of (..., p); `xp` is numpy or jax.numpy."""
        low, high = self._finite()
        limit = LARGEST_EXPONENT
        z_safe = xp.clip(z, -limit, limit)
        # each branch sees z only where it is used: no overflow, no NaN in a gradient
        up = xp.exp(xp.where(self.kind == LOG, z_safe, 0.0))
        down = xp.exp(-xp.where(self.kind == FROM_ABOVE, z_safe, 0.0))
        part = 1 / (1 + xp.exp(-xp.where(self.kind == LOGIT, z_safe, 0.0)))
        plain = xp.clip(z, self.lower, self.upper)
        theta = xp.where(self.kind == LOG, low + up, plain)
        theta = xp.where(self.kind == FROM_ABOVE, high - down, theta)
        return xp.where(self.kind == LOGIT, low + (high - low) * part, theta)

    def slope(self, z: Vector) -> Vector:
        """dθ/dz."""
        inside = (self.lower <= z) & (z <= self.upper)
        return np.where(self.kind == NONE, inside, np.exp(self.log_slope(z, np)))

    def log_slope(self, z: Any, xp: Any = jnp) -> Any:
        """ln |dθ/dz| of (..., p): what a density of θ is multiplied by in z."""
        low, high = self._finite()
        at = xp.clip(z, -LARGEST_EXPONENT, LARGEST_EXPONENT)
        logit = np.log(np.where(self.kind == LOGIT, high - low, 1.0)) - xp.logaddexp(0.0, at)
        by_kind = [xp.zeros_like(at), at, logit - xp.logaddexp(0.0, -at), -at]
        return xp.choose(np.broadcast_to(self.kind, at.shape), by_kind, mode="clip")

    def unconstrained(self, theta: Any, xp: Any = np) -> Any:
        """z(θ), the inverse; values at a bound or beyond are moved just inside."""
        theta = xp.asarray(theta, float)
        low, high = self._finite()
        log = xp.log(xp.maximum(theta - low, 1e-290))
        above = -xp.log(xp.maximum(high - theta, 1e-290))
        span = np.where(self.kind == LOGIT, high - low, 1.0)
        part = xp.clip((theta - low) / span, INSIDE, 1 - INSIDE)
        logit = xp.log(part) - xp.log1p(-part)
        kinds = np.broadcast_to(self.kind, theta.shape)
        return xp.choose(kinds, [theta, log, logit, above], mode="clip")

    def bound_beyond(self, direction: Vector) -> Vector:
        """The bound that z nears when it goes up (+1) or down (-1); infinite where there is none."""
        return np.where(direction > 0, self.upper, self.lower)

    def part(self, which) -> "Transform":
        return Transform(*(a[which] for a in self))

    def _finite(self):
        """Bounds with harmless numbers where they are not used."""
        low = np.where(np.isfinite(self.lower), self.lower, 0.0)
        return low, np.where(np.isfinite(self.upper), self.upper, 1.0)


def _kind(low: float, high: float, requested: str | None) -> int:
    """The requested transform, or the one that suits the bounds.

    A logarithm between two bounds is the logit, which nears it at small values.
    """
    ends = math.isfinite(low), math.isfinite(high)
    natural = {(True, True): LOGIT, (True, False): LOG, (False, True): FROM_ABOVE}
    return NONE if requested == "none" else natural.get(ends, NONE)
