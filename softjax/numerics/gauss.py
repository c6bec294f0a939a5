"""Gauss–Legendre quadrature."""

from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


@lru_cache
def gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1), 0.5 * weights


def integrate(f: Callable[[Array], Array], lower: Array, upper: Array, count: int) -> Array:
    """Gauss–Legendre quadrature, elementwise in `lower` and `upper`.

    Summed node by node in a loop, so that nothing of the size (batch, nodes) is stored, and the
    integrand is compiled once: written out, it took three times as long to compile and to run the same.
    """
    width = upper - lower
    nodes, weights = (jnp.asarray(a, width.dtype) for a in gauss_legendre(count))

    def add(total, node_and_weight):
        node, weight = node_and_weight
        return total + weight * f(lower + node * width), None

    total, _ = jax.lax.scan(add, jnp.zeros_like(width), (nodes, weights))
    return total * width
