"""softjax: differentiable soft-sphere collisions after Zhou (2013)."""

from softjax.contact import Contact
from softjax.empirical import empirical_restitution
from softjax.history import History, collide
from softjax.laws.base import (
    ContactLaw,
    RateDependentLaw,
    RateIndependentLaw,
    ReducedClosedForm,
    ReducedRateDependent,
    ReducedRateIndependent,
    Scales,
)
from softjax.laws.zhou import Zhou
from softjax.materials import CHROME_STEEL, NYLON, STAINLESS_STEEL, Material
from softjax.restitution import Restitution, restitution
from softjax.routes import ODE, EnergyBalance
from softjax.status import Status

__all__ = [
    "CHROME_STEEL",
    "NYLON",
    "ODE",
    "STAINLESS_STEEL",
    "Contact",
    "ContactLaw",
    "EnergyBalance",
    "History",
    "Material",
    "RateDependentLaw",
    "RateIndependentLaw",
    "ReducedClosedForm",
    "ReducedRateDependent",
    "ReducedRateIndependent",
    "Restitution",
    "Scales",
    "Status",
    "Zhou",
    "collide",
    "empirical_restitution",
    "enable_x64",
    "restitution",
]


def enable_x64() -> None:
    """Let JAX compute in float64 from here on; `import softjax` alone changes no setting."""
    import jax

    jax.config.update("jax_enable_x64", True)
