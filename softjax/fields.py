"""What the fields of a law declare of themselves: range, unit, symbol; and what all impacts share.

    chi: Number = number_field("χ̃", "-", "unloading factor", within="[0, inf)")
    form: str = choice_field("first-order", "full")
    weights: Any = array_field()

Checks of arguments, validity under `jit`, bounds of a fit and labels of its report follow from it.
"""

import dataclasses
import re
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import SequenceKey
from jaxtyping import Array, ArrayLike, Bool, Float

from softjax.checks import (
    ArgumentError,
    as_real,
    check,
    check_broadcast,
    check_choice,
)

Number = Float[ArrayLike, "..."]
Numbers = Float[Array, "..."]  # one an impact, or a single one
Flags = Bool[Array, "..."]

NO_UNIT = ("-", "1", "")  # of a pure number
_WITHIN = re.compile(r"([\[(])\s*(\S+)\s*,\s*(\S+?)\s*([\])])")


class Declared(NamedTuple):
    """The declaration of a numeric field.

    Attributes:
        symbol, unit: as a report writes them; unit "-" or "1" for a pure number.
        what: the quantity in words.
        lower, upper: ends of its range.
        with_lower, with_upper: whether the ends themselves are accepted.
    """

    symbol: str = ""
    unit: str = "-"
    what: str = "number"
    lower: float = -float("inf")
    upper: float = float("inf")
    with_lower: bool = False
    with_upper: bool = False

    def holds(self, value) -> Flags:
        """Whether `value` is finite and in the range, elementwise."""
        above = value >= self.lower if self.with_lower else value > self.lower
        below = value <= self.upper if self.with_upper else value < self.upper
        return above & below

    @property
    def accepted(self) -> str:
        """The range in words: "a positive modulus in Pa"."""
        what = self.what if self.unit in NO_UNIT else f"{self.what} in {self.unit}"
        noun = f"an {what}" if what[0] in "aeiou" else f"a {what}"
        if (self.lower, self.upper) == (0, float("inf")):
            return f"{noun} of zero or more" if self.with_lower else f"a positive {what}"
        if (self.lower, self.upper) == (-float("inf"), float("inf")):
            return f"a finite {what}"
        left, right = "[" if self.with_lower else "(", "]" if self.with_upper else ")"
        return f"{noun} in {left}{self.lower:g}, {self.upper:g}{right}"


def number_field(
    symbol: str, unit: str = "-", what: str = "number", within: str = "(-inf, inf)", **options: Any
) -> Any:
    """A numeric field: a number or an array, one value an impact.

    Args:
        symbol: as equations write it, "σ".
        unit: SI, "N/m"; "-" or "1" for a pure number.
        what: the quantity in words, for messages. Numbers with a unit of their own (pint's) are converted.
        within: its range, "(0, inf)" or "[0, 1]": round brackets leave the end out.
        options: of `dataclasses.field`, such as `default`.

    Raises:
        ValueError: where `within` is no range.
    """
    match = _WITHIN.fullmatch(within)
    try:
        left, low, high, right = match.groups()  # type: ignore[union-attr]
        ends = float(low), float(high), left == "[", right == "]"
    except (AttributeError, ValueError):
        accepted = 'a range such as "(0, inf)" or "[0, 1]"'
        raise ArgumentError(f"`within` must be {accepted}, but is {within!r}") from None
    declared = Declared(symbol, unit, what, *ends)
    converter = partial(as_real, unit=unit)
    return eqx.field(converter=converter, metadata={"declared": declared}, **options)


def choice_field(*choices: str) -> Any:
    """An option in words, fixed when a program is compiled; the first choice is the default."""
    return eqx.field(static=True, default=choices[0], metadata={"choices": choices})


def array_field(**options: Any) -> Any:
    """A field shared by all impacts: one array, or any pytree.

    A network's weights or a table's knots, where numeric fields hold one value an impact. Its
    leaves need not broadcast against the velocity, and are differentiated like any other. Numbers
    become floating point; below a name, as in a dict or a module, whole numbers stay such: counts
    and indices. Functions in it, such as a network's activation, become `jax.tree_util.Partial`,
    which is no leaf, so that the law goes through `jax.jit` as it is.

    Args:
        options: of `dataclasses.field`, such as `default`.
    """
    return eqx.field(converter=_as_shared, metadata={"shared": True}, **options)


def _as_shared(value):
    """Arrays of this library's own, and functions that JAX need not look at."""
    if isinstance(value, list | tuple) and all(np.isscalar(item) for item in value):
        return as_real(value)
    return jax.tree_util.tree_map_with_path(_as_part, value)


def _as_part(path, leaf):
    dtype = getattr(leaf, "dtype", None)
    if callable(leaf) and dtype is None:
        return jax.tree_util.Partial(leaf)
    named = any(not isinstance(key, SequenceKey) for key in path)
    is_whole_number = isinstance(leaf, int) if dtype is None else jnp.issubdtype(dtype, jnp.integer)
    if named and is_whole_number:
        return leaf.copy() if isinstance(leaf, np.ndarray) else leaf
    return as_real(leaf)


def declarations(kind: type) -> dict[str, Declared]:
    """The numeric fields of a class by name, in their order; undeclared ones count as any number.

    Options, shared fields and nested modules are none.
    """
    numeric = (f for f in dataclasses.fields(kind) if f.name != "contact")
    return {
        field.name: field.metadata.get("declared") or Declared(field.name)
        for field in numeric
        if not field.metadata.get("static") and not field.metadata.get("shared")
    }


def options_of(kind: type) -> dict[str, tuple[str, ...]]:
    """The options of a class and their choices."""
    every = dataclasses.fields(kind)
    return {f.name: f.metadata["choices"] for f in every if "choices" in f.metadata}


def shared_fields(kind: type) -> tuple[str, ...]:
    """The names of the fields that all impacts share."""
    return tuple(f.name for f in dataclasses.fields(kind) if f.metadata.get("shared"))


def shared_leaves(tree: Any) -> list[bool]:
    """For every leaf of a pytree, in order, whether it is part of a shared field of some module."""
    return _shared_leaves(jax.tree.structure(tree))


@lru_cache(maxsize=256)
def _shared_leaves(structure) -> list[bool]:
    def marked(node) -> Any:
        if not isinstance(node, eqx.Module):
            return jax.tree.map(
                lambda n: marked(n) if isinstance(n, eqx.Module) else False,
                node,
                is_leaf=lambda n: isinstance(n, eqx.Module),
            )
        shared = shared_fields(type(node))
        parts = jax.tree_util.tree_leaves_with_path(node, is_leaf=lambda child: child is not node)
        return [
            jax.tree.map(lambda _: True, part) if path[0].name in shared else marked(part)
            for path, part in parts
        ]

    return jax.tree.leaves(marked(jax.tree.unflatten(structure, [0.0] * structure.num_leaves)))


def is_array(leaf) -> bool:
    """Whether a leaf is made of numbers: shared fields may hold options of any kind."""
    return hasattr(leaf, "dtype")


def is_float(leaf) -> bool:
    return is_array(leaf) and jnp.issubdtype(leaf.dtype, jnp.floating)


def partition(tree: Any) -> tuple[Any, Any]:
    """The arrays of a pytree, and the rest of it, hashable; `combine` puts them together."""
    arrays, rest = eqx.partition(tree, is_array)
    leaves, structure = jax.tree.flatten(rest)
    return arrays, (tuple(leaves), structure)


def combine(arrays: Any, static: Any) -> Any:
    """The pytree of which `partition` made this."""
    leaves, structure = static
    return eqx.combine(arrays, jax.tree.unflatten(structure, leaves))


def check_fields(module: eqx.Module) -> None:
    """Raise unless all options and numbers are accepted and the numbers broadcast."""
    for name, choices in options_of(type(module)).items():
        check_choice(name, getattr(module, name), choices)
    for name, declared, value in _values(module):
        check(name, value, declared.holds, declared.accepted)
    for name in shared_fields(type(module)):
        for leaf in jax.tree.leaves(getattr(module, name)):
            if isinstance(leaf, float) or is_float(leaf):
                check(name, leaf, np.isfinite, "finite numbers")
    check_broadcast(numbers_of(module))


def checked(law: eqx.Module, velocity) -> Any:
    """The impact velocity as an array or traced value, checked together with the law."""
    velocity = as_real(velocity, "m/s")
    accepted = "a finite impact velocity in m/s, zero or more"
    check("velocity", velocity, lambda v: v >= 0, accepted)
    numbers = numbers_of(law)
    if not all(type(value) is float or is_array(value) for value in numbers.values()):
        check_fields(law)  # raises, naming what has been put into a law that was made whole
    check_broadcast({"velocity": velocity} | numbers)
    return velocity


def numbers_of(module: eqx.Module) -> dict[str, Any]:
    """All numbers of a module and of those nested in it, by name; shared fields left out.

    A name that the module has too is `contact.radius`.
    """
    numbers = {name: value for name, _, value in _values(module)}
    for field, nested in _nested(module):
        for name, value in numbers_of(nested).items():
            numbers[f"{field}.{name}" if name in numbers else name] = value
    return numbers


def are_valid(module: eqx.Module) -> Flags:
    """Whether all numbers are in their ranges, one truth value an impact.

    Where tracing kept them unchecked. A shared field is valid where all of its numbers are finite.
    """
    valid = jnp.asarray(True)
    for _, declared, value in _values(module):
        valid = valid & jnp.isfinite(value) & declared.holds(jnp.asarray(value))
    for _, nested in _nested(module):
        valid = valid & are_valid(nested)
    for leaf in jax.tree.leaves([getattr(module, name) for name in shared_fields(type(module))]):
        if is_array(leaf) and jnp.issubdtype(leaf.dtype, jnp.inexact):
            valid = valid & jnp.all(jnp.isfinite(leaf))
    return valid


def _values(module: eqx.Module) -> Iterator[tuple[str, Declared, Any]]:
    for name, declared in declarations(type(module)).items():
        value = getattr(module, name)
        if not isinstance(value, eqx.Module):
            yield name, declared, value


def _nested(module: eqx.Module) -> Iterator[tuple[str, eqx.Module]]:
    shared = shared_fields(type(module))
    for field in dataclasses.fields(type(module)):
        value = getattr(module, field.name)
        if isinstance(value, eqx.Module) and field.name not in shared:
            yield field.name, value
