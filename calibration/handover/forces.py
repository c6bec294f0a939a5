"""Forces of a law as particle codes follow them."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array


def end_of(law: Any) -> str:
    """Where a contact with damping ends: "zero-overlap" or "zero-force"."""
    return getattr(law, "end", None) or law.reduced().ends_at


def unloading_force(law: Any, overlap: Any, peak_overlap: Any) -> Array:
    """That of a law [N]; where nothing has yielded that of Hertz, as on loading."""
    after_yield = law.unloading_force(overlap, peak_overlap)
    if not hasattr(law, "elastic_velocity"):
        return after_yield
    yielded = peak_overlap > _elastic_overlap(law)
    return jnp.where(yielded, after_yield, law.loading_force(overlap))


def _elastic_overlap(law: Any) -> Array:
    """The largest overlap of an impact that just does not yield, by Hertz's force [m]."""
    energy = law.contact.mass * law.elastic_velocity() ** 2 / 2
    return (2.5 * energy / law.contact.stiffness) ** 0.4
