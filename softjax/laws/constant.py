"""Hard spheres that rebound with one coefficient of restitution at every velocity."""

import jax.numpy as jnp

from softjax.checks import check_type
from softjax.contact import Contact
from softjax.fields import Number, Numbers, number_field
from softjax.laws.base import HardSphereLaw


class ConstantRestitution(HardSphereLaw, final=True):
    """v' = -ε v with one ε for all velocities, Newton's rule: ε is an input.

    Hard spheres: no force, no overlap, no duration; `restitution` gives ε as it is and zero for
    the rest, and `collide` has no history to give.

    Symbols: v, v' relative velocity before and after [m/s]; ε = `restitution` [-].

    Not to be confused with `LinearSpringDashpot` and `HertzDashpot`, which reach the same constant
    ε by a damped contact that takes time.

    Attributes:
        contact: the two bodies, of which nothing enters; or None.
        restitution: ε in [0, 1] [-].

    Source: I. Newton, Philosophiae naturalis principia mathematica (1687), scholium to the laws of
    motion; the usual model of event-driven granular simulations.
    Range: none of its own. Measured ε depend on velocity, which makes this a baseline.
    """

    contact: Contact | None
    restitution: Number = number_field("ε", "-", "coefficient of restitution", within="[0, 1]")

    def __check_init__(self):
        if self.contact is not None:
            check_type("contact", self.contact, Contact, "a Contact or None")

    def restitution_squared(self, velocity: Numbers) -> Numbers:
        return jnp.square(self.restitution) + jnp.zeros_like(velocity)
