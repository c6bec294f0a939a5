"""Parameters of a fit: fixed or free, start, bounds, prior, sharing, and the scale of the search.

The one map between the search and physics is θ(z), element by element:

log      θ = lower + eᶻ, up to an end where the search has one; or upper - e^{-z} where only the
         upper end is finite
logit    θ = lower + (upper - lower)/(1 + e⁻ᶻ)
none     θ = z, clipped to its bounds
"""

import math
from typing import Annotated, Any, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from pydantic import Field, PlainValidator, ValidationError, WithJsonSchema, model_validator
from pydantic.json_schema import SkipJsonSchema

from calibration.errors import DataError, Origin, is_finite_number
from calibration.schema import Strict, faults
from softjax.fields import Declared

POOLED = "pooled"
NONE, LOG, LOGIT, FROM_ABOVE = range(4)
LARGEST_EXPONENT = 690.0
INSIDE = 1e-12  # a start at a bound, or beyond, is moved that far inside (of the range)

Vector = Float[np.ndarray, "... p"]


def _value(value: Any) -> Any:
    if is_finite_number(value):
        return value + 0  # -0.0 is 0
    is_array = isinstance(value, np.ndarray | dict | list | tuple) or hasattr(value, "dtype")
    if value is None or is_array or hasattr(type(value), "__dataclass_fields__"):
        return value
    raise ValueError("a finite number")


def _words(accepted: str, **more: Any) -> Any:
    return Field(json_schema_extra={"accepted": accepted}, **more)


Number = Annotated[float, Field(strict=True)]
End = Annotated[float, Field(strict=True, allow_inf_nan=True)]
ENDS = _words("two numbers, [lowest, highest], lowest below highest", strict=False)
PRIOR = _words("two numbers, [mean, standard deviation]", strict=False)
SHARED = _words("true, false or the name of a group of data sets")


class Parameter(Strict):
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

    value: Annotated[Any, PlainValidator(_value), WithJsonSchema({"type": "number"})] = None
    free: bool = True
    bounds: Annotated[tuple[End, End] | None, ENDS] = None
    prior: Annotated[tuple[Number, Number] | None, PRIOR] = None
    transform: Literal["log", "logit", "none"] | None = None
    shared: Annotated[bool | Annotated[str, Field(pattern=r"\S")], SHARED] = False
    unit: str = ""
    origin: SkipJsonSchema[Origin | None] = Field(default=None, repr=False)

    def __init__(self, value: Any = None, **more: Any):
        try:
            super().__init__(**{"value": value} | more)
        except ValidationError as error:
            raise next(faults(error, Parameter)) from None

    @model_validator(mode="after")
    def _together(self) -> "Parameter":
        if self.bounds is not None:
            low, high = self.bounds
            if not low < high:
                accepted = "[lowest, highest], lowest below highest"
                raise DataError("bounds", f"[{low}, {high}]", accepted)
            if is_finite_number(self.value) and not low <= self.value <= high:
                raise DataError("value", self.value, f"within its bounds, [{low:g}, {high:g}]")
        if self.prior is not None and self.prior[1] <= 0:
            raise DataError("prior", f"{[*self.prior]}", "[mean, positive standard deviation]")
        if self.pooled and self.prior is not None:
            raise DataError("prior", "given", "left out where shared is pooled")
        for name in ("bounds", "prior", "transform", "shared"):
            if not self.free and getattr(self, name) not in (None, False):
                raise DataError(name, "given", "left out where free is false")
        return self

    def __eq__(self, other: object) -> bool:  # wherever it was read
        mine, theirs = ({**vars(parameter), "origin": None} for parameter in (self, other))
        return isinstance(other, Parameter) and mine == theirs

    @property
    def pooled(self) -> bool:
        return self.shared == POOLED

    @property
    def is_number(self) -> bool:
        return self.value is None or is_finite_number(self.value)

    def range_within(self, declared: Declared) -> tuple[float, float]:
        """Bounds of the parameter, drawn in to what the law's field declares; raises DataError outside."""
        low, high = self.bounds or (-math.inf, math.inf)
        lowest, highest = max(low, declared.lower), min(high, declared.upper)
        for bound, drawn in ((low, lowest), (high, highest)):
            if bound != drawn and math.isfinite(bound):
                raise DataError("bounds", f"[{low:g}, {high:g}]", f"within {_interval(declared)}")
        if self.value is not None and self.is_number and not declared.holds(float(self.value)):
            raise DataError("value", self.value, declared.accepted)
        if self.transform == "log" and not (math.isfinite(lowest) or math.isfinite(highest)):
            raise DataError("transform", "log", "none, or a bound given")
        if self.transform == "logit" and not (math.isfinite(lowest) and math.isfinite(highest)):
            raise DataError("transform", "logit", "log or none, or both bounds given")
        return lowest, highest


def as_parameter(name: str, value: Any) -> Parameter:
    """A `Parameter` as it is; a number fixes."""
    if isinstance(value, Parameter):
        return value
    if not is_finite_number(value) and not isinstance(value, np.number):
        accepted = "a calibration.Parameter, or a number that fixes it"
        raise DataError(f"parameters[{name!r}]", value, accepted)
    return Parameter(float(value), free=False)


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
        """Transform for the (lowest, highest) of each element and the requested kind, or None.

        A logarithm between two bounds is the logit, which nears it at small values.
        """
        low, high = np.array(ranges, float).reshape(-1, 2).T
        natural = np.array([[NONE, FROM_ABOVE], [LOG, LOGIT]])
        kinds = natural[np.isfinite(low).astype(int), np.isfinite(high).astype(int)]
        is_plain = np.array([name == "none" for name in requested], bool)
        return cls(np.where(is_plain, NONE, kinds), low, high)

    def physical(self, z: Any, xp: Any = np) -> Any:
        """θ(z) of (..., p); `xp` is numpy or jax.numpy."""
        low, high = self._finite()
        z_safe = xp.clip(z, -LARGEST_EXPONENT, LARGEST_EXPONENT)
        # each branch sees z only where it is used: no overflow, no NaN in a gradient
        up, down, part = (
            xp.exp(sign * xp.where(self.kind == kind, z_safe, 0.0))
            for kind, sign in ((LOG, 1), (FROM_ABOVE, -1), (LOGIT, -1))
        )
        theta = xp.where(self.kind == LOG, low + up, xp.clip(z, self.lower, self.upper))
        theta = xp.where(self.kind == FROM_ABOVE, high - down, theta)
        return xp.where(self.kind == LOGIT, low + (high - low) * (1 / (1 + part)), theta)

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

    def highest(self) -> Vector:
        """The largest z; infinite where the upper bound is not reached, or there is none."""
        span = np.where(np.isfinite(self.upper), self.upper - self._finite()[0], np.inf)
        of_log = np.log(np.where(self.kind == LOG, span, 1.0))
        highest = np.where(self.kind == LOG, of_log, np.inf)
        return np.where(self.kind == NONE, self.upper, highest)

    def part(self, which) -> "Transform":
        return Transform(*(a[which] for a in self))

    def _finite(self):
        """Bounds with harmless numbers where they are not used."""
        low = np.where(np.isfinite(self.lower), self.lower, 0.0)
        return low, np.where(np.isfinite(self.upper), self.upper, 1.0)
