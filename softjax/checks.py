"""Checks of concrete arguments at the edge: `ValueError` names argument, value, what is accepted.

Values that JAX is tracing cannot be looked at; they pass here and become a `Status` later.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from softjax.units import has_unit, in_unit


class ArgumentError(ValueError):
    """An argument that this library refuses: one line with its name, its value and what is accepted."""


def is_traced(value) -> bool:
    return isinstance(value, jax.core.Tracer)


def standard_promotion(function: Callable) -> Callable:
    """The function with types promoted as JAX does by default: precisions of arguments may differ."""

    @wraps(function)
    def promoting(*arguments, **keywords):
        with jax.numpy_dtype_promotion("standard"):
            return function(*arguments, **keywords)

    return promoting


def as_real(value, unit: str = ""):
    """Numbers become floats and arrays floating point; anything else is left for the check to name.

    Python numbers stay Python floats: they take the precision of what they are computed with.
    NumPy arrays are copied, since a computation may still read them when its caller writes again.

    Args:
        unit: that of the numbers; what has another one is converted.
    """
    value = in_unit(value, unit)
    if isinstance(value, bool | str | None):
        return value
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, list | tuple):
        traced = any(is_traced(item) for item in jax.tree.leaves(value))
        try:
            value = jnp.asarray(value) if traced else np.asarray(value)
        except (TypeError, ValueError):  # no rectangular array of anything
            return value
    dtype = getattr(value, "dtype", None)
    if dtype is None:
        return value
    if jnp.issubdtype(dtype, jnp.floating) and not np.issubdtype(dtype, np.floating):
        return value.astype(np.float32)  # NumPy has no name for these, as bfloat16
    is_integer = jnp.issubdtype(dtype, jnp.integer)
    if isinstance(value, np.generic):
        if np.issubdtype(dtype, np.floating) and value.itemsize < 8:
            return np.asarray(value)  # which keeps its precision
        return float(value) if is_integer or np.issubdtype(dtype, np.floating) else value
    if not isinstance(value, np.ndarray):
        return value * 1.0 if is_integer else value
    if _real_array(value) is None:
        return value
    return np.array(value, np.result_type(float) if is_integer else dtype)


def check(name: str, value, holds, accepted: str) -> None:
    """Raise unless `value` is a real number or array with `holds(value)` true everywhere.

    What is accepted is an interval each time, so the extremes decide, NaN included.
    """
    # object(): a placeholder of JAX's own
    if is_traced(value) or type(value) is object or isinstance(value, jax.ShapeDtypeStruct):
        return
    array = _extremes_here(value) if isinstance(value, jax.Array) else _real_array(value)
    if array is not None:
        extremes = np.array([array.min(), array.max()]) if array.size else array
        if np.all(np.isfinite(extremes) & holds(extremes)):
            return
    raise ArgumentError(f"`{name}` must be {accepted}, but is {shown(value)}")


def check_choice(name: str, value, choices: tuple[str, ...]) -> None:
    if not (isinstance(value, str) and value in choices):
        accepted = " or ".join(repr(choice) for choice in choices)
        raise ArgumentError(f"`{name}` must be {accepted}, but is {value!r}")


def check_type(name: str, value, kind: type, accepted: str) -> None:
    if not isinstance(value, kind):
        raise ArgumentError(f"`{name}` must be {accepted}, but is {shown(value)}")


def check_broadcast(named: dict[str, Any]) -> tuple[int, ...]:
    """The common shape of all values; raises naming the ones that do not fit together."""
    shapes = {name: np.shape(value) for name, value in named.items()}
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        shown = ", ".join(f"`{name}` {shape}" for name, shape in shapes.items() if shape)
        raise ArgumentError(f"shapes must broadcast against each other, but are {shown}") from None


def _real_array(value) -> np.ndarray | None:
    """The value as an array of real numbers, none of them masked or with a unit, if it is one."""
    if has_unit(value):
        return None
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return None
    # longer floats than float64 are none of JAX's
    is_float = np.issubdtype(array.dtype, np.floating) and array.dtype.itemsize <= 8
    is_real = is_float or np.issubdtype(array.dtype, np.integer)
    return array if is_real and not np.any(np.ma.getmaskarray(value)) else None


def _extremes_here(value: jax.Array) -> np.ndarray | None:
    """Of what this process holds, device by device: nothing is fetched together."""
    parts = [array for s in value.addressable_shards if (array := _real_array(s.data)) is not None]
    if len(parts) < len(value.addressable_shards):
        return None
    ends = [end for part in parts if part.size for end in (part.min(), part.max())]
    return np.array(ends, parts[0].dtype if parts else float)


def shown(value) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."
