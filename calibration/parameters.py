"""What is said of a parameter: fixed or free, where it starts, its bounds, its prior, who shares it."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calibration.errors import DataError, Origin, is_finite_number, listed
from softjax.fields import Declared

TRANSFORMS = ("log", "logit", "none")
POOLED = "pooled"


@dataclass(frozen=True)
class Parameter:
    """One parameter of a law; what is None is left to the fit.

    Attributes:
        value: its start where free, its value where not; SI. For a field that is whole, an array
            or any pytree of arrays.
        free: whether it is fitted.
        bounds: (lowest, highest), infinite where open.
        prior: (mean, standard deviation) of a Gaussian prior.
        transform: "log", "logit" or "none": the scale it is searched on.
        shared: whether all data sets have one value of it, or the name of a group of those that do;
            "pooled": each has its own, around a common mean with a spread that is fitted.

    Raises:
        ValueError: naming what is wrong, its value and what is accepted.
    """

    value: Any = None
    free: bool = field(default=True, kw_only=True)
    bounds: tuple[float, float] | None = field(default=None, kw_only=True)
    prior: tuple[float, float] | None = field(default=None, kw_only=True)
    transform: str | None = field(default=None, kw_only=True)
    shared: bool | str = field(default=False, kw_only=True)
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
        for given, drawn in ((low, least), (high, most)):
            if given != drawn and math.isfinite(given):
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


def _bounds(given: Any, value: Any) -> tuple[float, float]:
    low, high = _pair("bounds", given, "[lowest, highest]")
    if not low < high:
        raise DataError("bounds", f"[{low}, {high}]", "[lowest, highest], lowest below highest")
    if is_finite_number(value) and not low <= value <= high:
        raise DataError("value", value, f"within its bounds, [{low:g}, {high:g}]")
    return low, high


def _prior(given: Any) -> tuple[float, float]:
    prior = _pair("prior", given, "[mean, standard deviation]")
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
