"""A batch of impacts made ready for either route: checked, in one precision, reduced."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from softjax._checks import as_real, check, check_broadcast, is_traced
from softjax.laws.base import ContactLaw, RateIndependentLaw, ReducedRateIndependent


def check_law(law) -> None:
    if not isinstance(law, ContactLaw):
        raise ValueError(f"`law` must be a contact law such as Zhou(...), but is {law!r}")


def checked(law: ContactLaw, velocity) -> tuple[Array, str]:
    """The velocity as an array or traced value, made sure of, and what is known of the impacts."""
    velocity = as_real(velocity)
    accepted = "a finite impact velocity in m/s, zero or more"
    extremes = check("velocity", velocity, lambda v: v >= 0, accepted)
    names = _field_names(law)
    check_broadcast({"velocity": velocity} | names)
    return velocity, known_regime(law, velocity, extremes)


def _field_names(law: ContactLaw) -> dict[str, object]:
    paths, _ = jax.tree_util.tree_flatten_with_path(law)
    return {str(path[-1]).lstrip("."): leaf for path, leaf in paths}


def common_precision(law, velocity):
    """All leaves in the precision of the widest, at least float32."""
    leaves, structure = jax.tree.flatten((law, velocity))
    # a Python number, traced or not, has no precision of its own; alone they take JAX's
    typed = [leaf for leaf in leaves if hasattr(leaf, "dtype") and not _is_weak(leaf)]
    dtype = jnp.result_type(*typed, jnp.float32) if typed else jnp.result_type(float)
    cast = [_as_dtype(leaf, dtype) for leaf in leaves]
    return jax.tree.unflatten(structure, cast)


def _is_weak(leaf) -> bool:
    return getattr(leaf, "weak_type", False)


def _as_dtype(leaf, dtype):
    if isinstance(leaf, jax.Array):
        return leaf if leaf.dtype == dtype and not leaf.weak_type else jnp.asarray(leaf, dtype)
    return np.asarray(leaf, dtype)


def known_regime(law: ContactLaw, velocity, extremes: np.ndarray | None = None) -> str:
    """Whether all impacts are known beforehand to stay elastic, or to yield.

    `extremes` of the velocities, where they are known already, save a pass over them.
    """
    if not isinstance(law, RateIndependentLaw):
        return "mixed"
    reduced = law.reduced()
    if math.isinf(reduced.elastic_limit):
        return "elastic"
    if np.size(velocity) == 0:
        return "mixed"
    if any(is_traced(leaf) for leaf in jax.tree.leaves((law, velocity))):
        return "mixed"
    scale = np.asarray(law.scales().velocity)
    use_extremes = extremes is not None and scale.size == 1
    ratio = np.asarray(extremes if use_extremes else velocity) / scale
    limit = _elastic_velocity(reduced)
    # a margin of float32's rounding: compiled code decides what is on the edge
    if ratio.max() < limit * (1 - 1e-5):
        return "elastic"
    return "yielding" if ratio.min() > limit * (1 + 1e-5) else "mixed"


def _elastic_velocity(reduced) -> float:
    return reduced.elastic_limit ** (reduced.work_exponent / 2)


def lifted(reduced, y: Array) -> tuple[Array, Array | None]:
    """Velocities whose squares do not underflow, and y over them (None: nothing was lifted).

    Laws without an elastic stage act down to rest; near it they follow their elastic power law, by
    which overlaps and times of the lifted collision are scaled back.
    """
    if getattr(reduced, "elastic_limit", 0.0) > 0:
        return y, None
    tiny = float(jnp.finfo(y.dtype).tiny)
    # derivatives of works over y² meet y³; those of a damped collision y²
    works = isinstance(reduced, ReducedRateIndependent)
    least = tiny ** (0.25 if works else 0.4)
    high = jnp.maximum(y, least)
    return high, y / high


class Impact(eqx.Module):
    """One batch of impacts in reduced variables, with all invalid ones replaced by harmless."""

    law: ContactLaw
    velocity: Array
    y: Array
    valid: Array
    elastic: Array


def prepare(law: ContactLaw, velocity: Array, regime: str, branch: Array | None = None) -> Impact:
    """The impacts in reduced variables.

    Args:
        branch: True where an impact is to be taken for elastic, False where for yielding, wherever
            its velocity is; None: as the law has it.
    """
    law_valid = law.is_valid()
    law = jax.tree.map(lambda leaf: jnp.where(law_valid, leaf, 1.0).astype(leaf.dtype), law)
    scale = law.scales().velocity
    valid = law_valid & jnp.isfinite(velocity) & (velocity >= 0)
    velocity = jnp.where(valid, velocity, 0.5 * scale)
    y = velocity / scale
    if not isinstance(law, RateIndependentLaw):
        elastic = velocity == 0  # at rest nothing is lost
    elif regime == "mixed":
        # not y <= 1: a quotient may be compiled into a product that rounds otherwise
        limit = _elastic_velocity(law.reduced())
        elastic = velocity <= scale * limit if branch is None else jnp.broadcast_to(branch, y.shape)
        y = y + jax.lax.stop_gradient(jnp.where(elastic, 0.0, jnp.maximum(limit - y, 0.0)))
    else:
        elastic = jnp.full(y.shape, regime == "elastic")
    return Impact(law, velocity, y, valid, elastic)
