"""Checks of concrete arguments at the edge: `ValueError` names argument, value, what is accepted.

Values that JAX is tracing cannot be looked at; they pass here and become a `Status` later.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


class ArgumentError(ValueError):
    """An argument that this library refuses: one line with its name, its value and what is accepted."""


def is_traced(value) -> bool:
    return isinstance(value, jax.core.Tracer)


def as_real(value):
    """Numbers become floats and arrays floating point; anything else is left for the check to name.

    Python numbers stay Python floats: they take the precision of what they are computed with.
    NumPy arrays are copied, since a computation may still read them when its caller writes again.
    """
    if isinstance(value, bool | str | None):
        return value
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, np.generic) and not _is_short(value.dtype):
        return float(value) if np.isrealobj(value) and not isinstance(value, np.bool_) else value
    if isinstance(value, list | tuple):
        traced = any(is_traced(item) for item in jax.tree.leaves(value))
        try:
            value = _stacked(value) if traced else np.asarray(value)
        except (TypeError, ValueError):  # no rectangular array of anything
            return value
    if hasattr(value, "dtype") and _is_short(value.dtype):
        return value.astype(np.float32)
    if isinstance(value, np.ndarray):
        if _real_array(value) is None:
            return value
        is_integer = np.issubdtype(value.dtype, np.integer)
        return np.array(value, np.result_type(float) if is_integer else value.dtype)
    if getattr(value, "dtype", None) is not None and np.issubdtype(value.dtype, np.integer):
        return value * 1.0
    return value


def _stacked(value):
    """Lists in lists of traced numbers as an array."""
    return jnp.stack([_stacked(x) if isinstance(x, list | tuple) else x for x in value])


def _is_short(dtype) -> bool:
    """Whether these are floats that NumPy has no name for, as bfloat16; float32 computes with them."""
    return jnp.issubdtype(dtype, jnp.floating) and not np.issubdtype(dtype, np.floating)


def check(name: str, value, holds, accepted: str) -> np.ndarray | None:
    """Raise unless `value` is a real number or array with `holds(value)` true everywhere.

    Returns its extremes, if any could be looked at. What is accepted is an interval each time, so
    they decide, NaN included.
    """
    if is_traced(value) or type(value) is object:  # object(): a placeholder of JAX's own
        return None
    if isinstance(value, jax.ShapeDtypeStruct):
        return None
    array = _extremes_here(value) if isinstance(value, jax.Array) else _real_array(value)
    if array is not None:
        extremes = np.array([array.min(), array.max()]) if array.size else array
        if np.all(np.isfinite(extremes) & holds(extremes)):
            return extremes
    raise ArgumentError(f"`{name}` must be {accepted}, but is {shown(value)}")


def check_positive(name: str, value, what: str) -> None:
    check(name, value, lambda a: a > 0, f"a positive {what}")


def check_choice(name: str, value, choices: tuple[str, ...]) -> None:
    if not (isinstance(value, str) and value in choices):
        accepted = " or ".join(repr(choice) for choice in choices)
        raise ArgumentError(f"`{name}` must be {accepted}, but is {value!r}")


def check_type(name: str, value, kind: type, accepted: str) -> None:
    if not isinstance(value, kind):
        raise ArgumentError(f"`{name}` must be {accepted}, but is {shown(value)}")


def truth_values(name: str, value):
    """The same as an array, or traced; raises where it is anything but True and False."""
    try:
        values = value if hasattr(value, "dtype") else np.asarray(value)
    except ValueError:  # no rectangular array of anything
        values = None
    if not jnp.issubdtype(getattr(values, "dtype", float), np.bool_):
        raise ArgumentError(
            f"`{name}` must be True, False or an array of these, but is {shown(value)}"
        )
    return values


def check_broadcast(named: dict[str, Any]) -> tuple[int, ...]:
    """The common shape of all values; raises naming the ones that do not fit together."""
    shapes = {name: np.shape(value) for name, value in named.items()}
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        shown = ", ".join(f"`{name}` {shape}" for name, shape in shapes.items() if shape)
        raise ArgumentError(f"shapes must broadcast against each other, but are {shown}") from None


def _real_array(value) -> np.ndarray | None:
    if isinstance(value, np.ma.MaskedArray) and np.any(np.ma.getmaskarray(value)):
        return None  # what its owner takes for no value is none
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return None
    # longer floats than float64 are none of JAX's
    is_float = np.issubdtype(array.dtype, np.floating) and array.dtype.itemsize <= 8
    return array if is_float or np.issubdtype(array.dtype, np.integer) else None


def is_elsewhere(value) -> bool:
    """Whether other processes hold parts of an array, which cannot be looked at here."""
    return isinstance(value, jax.Array) and not is_traced(value) and not value.is_fully_addressable


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
