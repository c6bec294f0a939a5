"""Hard spheres that rebound with one coefficient of restitution at every velocity."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from softjax._checks import as_real, check, check_broadcast, check_type
from softjax.contact import Contact
from softjax.laws.base import HardSphereLaw, ReducedHardSphere, all_of, not_negative

Field = Float[ArrayLike, "..."]


class ConstantRestitution(HardSphereLaw):
    """v' = -ε v with one ε for all velocities, Newton's rule: ε is an input.

    Hard spheres: no force, no overlap, no duration; `restitution` gives ε as it is and zero for
    the rest, and `collide` has no history to give.

    Symbols: v, v' relative velocity before and after [m/s]; ε = `restitution` [-].

    Not to be confused with `LinearSpringDashpot` and `HertzDashpot`, which reach the same constant
    ε by a damped contact that takes time.

    Attributes:
        contact: the two bodies; nothing of them enters.
        restitution: ε in [0, 1] [-].

    Source: I. Newton, Philosophiae naturalis principia mathematica (1687), scholium to the laws of
    motion; the usual model of event-driven granular simulations.
    Range: none of its own. Measured ε depend on velocity, which makes this a baseline.

    Raises:
        ValueError: naming the field, its value and what is accepted.
    """

    contact: Contact
    restitution: Field = eqx.field(converter=as_real)

    def __check_init__(self):
        check_type("contact", self.contact, Contact, "a Contact")
        accepted = "a coefficient of restitution in [0, 1]"
        check("restitution", self.restitution, lambda e: (e >= 0) & (e <= 1), accepted)
        check_broadcast(self.contact.leaves() | {"restitution": self.restitution})

    def reduced(self) -> ReducedHardSphere:
        return ReducedHardSphere(jnp.square(self.restitution))

    def is_valid(self) -> Array:
        at_most_one = jnp.asarray(self.restitution) <= 1
        return all_of(super().is_valid(), not_negative(self.restitution), at_most_one)
