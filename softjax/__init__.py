"""softjax: differentiable soft-sphere collisions after Zhou (2013)."""

from softjax.checks import ArgumentError
from softjax.contact import CHROME_STEEL, NYLON, STAINLESS_STEEL, Contact, Material
from softjax.engine.outcome import Collision
from softjax.fields import array_field, choice_field, number_field
from softjax.history import History, collide
from softjax.laws.base import (
    ContactLaw,
    HardSphereLaw,
    RateDependentLaw,
    RateIndependentLaw,
)
from softjax.laws.constant import ConstantRestitution
from softjax.laws.dashpots import HertzDashpot, LinearSpringDashpot
from softjax.laws.empirical import EmpiricalRestitution, empirical_restitution
from softjax.laws.forces import KnownCollision
from softjax.laws.hertz import Hertz
from softjax.laws.reduced import (
    Reduced,
    ReducedClosedForm,
    ReducedRateDependent,
    ReducedRateIndependent,
    Scales,
)
from softjax.laws.thornton import Thornton, thornton_restitution
from softjax.laws.viscoelastic import ViscoelasticHertz
from softjax.laws.walton_braun import WaltonBraun
from softjax.laws.zhou import Zhou
from softjax.many_body import contact_force
from softjax.numerics.powers import power_3_2
from softjax.restitution import (
    Restitution,
    SignedRestitution,
    restitution,
    signed_restitution,
)
from softjax.routes import ODE, AbstractRoute, ClosedForm, EnergyBalance, TimeODE
from softjax.status import Status

__all__ = [
    "CHROME_STEEL",
    "NYLON",
    "ODE",
    "STAINLESS_STEEL",
    "AbstractRoute",
    "ArgumentError",
    "ClosedForm",
    "Collision",
    "ConstantRestitution",
    "Contact",
    "ContactLaw",
    "EmpiricalRestitution",
    "EnergyBalance",
    "HardSphereLaw",
    "Hertz",
    "HertzDashpot",
    "History",
    "KnownCollision",
    "LinearSpringDashpot",
    "Material",
    "RateDependentLaw",
    "RateIndependentLaw",
    "Reduced",
    "ReducedClosedForm",
    "ReducedRateDependent",
    "ReducedRateIndependent",
    "Restitution",
    "Scales",
    "SignedRestitution",
    "Status",
    "Thornton",
    "TimeODE",
    "ViscoelasticHertz",
    "WaltonBraun",
    "Zhou",
    "array_field",
    "choice_field",
    "collide",
    "contact_force",
    "empirical_restitution",
    "enable_x64",
    "number_field",
    "power_3_2",
    "restitution",
    "signed_restitution",
    "thornton_restitution",
]


def enable_x64() -> None:
    """Let JAX compute in float64 from here on; `import softjax` alone changes no setting."""
    import jax

    jax.config.update("jax_enable_x64", True)
