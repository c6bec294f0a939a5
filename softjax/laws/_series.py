"""Functions of one number as Chebyshev series, made once in 60 digits (`tests.oracles.closed_forms`).

A series is differentiated as a series, to any order: no arithmetic of its own is, so that a gradient
costs one series more and is as exact as the value.
"""

import json
from functools import lru_cache, partial
from importlib import resources
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


@lru_cache
def _stored() -> dict[str, Any]:
    text = resources.files(__package__).joinpath("series.json").read_text(encoding="utf-8")
    return json.loads(text)


def taylor(name: str) -> list[float]:
    """The first coefficients of a function in powers of its number."""
    return _stored()["taylor"][name]


def series(name: str, x: Array) -> Array:
    """The function of that name, of x within its range."""
    stored = _stored()["series"][name]
    low, high = stored["low"], stored["high"]
    return _clenshaw(tuple(stored["coefficients"]), (2 * x - (low + high)) / (high - low))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _clenshaw(coefficients: tuple[float, ...], x: Array) -> Array:
    """Σ c_j T_j(x), |x| <= 1, by Clenshaw's recurrence."""
    after, value = jnp.zeros_like(x), jnp.zeros_like(x)
    for c in coefficients[:0:-1]:
        after, value = value, 2 * x * value - after + c
    return x * value - after + coefficients[0]


@_clenshaw.defjvp
def _clenshaw_jvp(coefficients, values, tangents):
    (x,), (change,) = values, tangents
    slope = tuple(np.polynomial.chebyshev.chebder(coefficients).tolist())
    return _clenshaw(coefficients, x), _clenshaw(slope, x) * change
