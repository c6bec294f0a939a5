"""A user's law with everything in closed form: ε = level · e^{-rate · v}."""

import jax.numpy as jnp
import numpy as np

import softjax as sj


class Decay(sj.HardSphereLaw):
    """ε = a e^{-b v}: ∂ε/∂ln a = ε, ∂ε/∂ln b = -b v ε."""

    level: float = sj.number_field("a", "-", "level", within="(0, inf)")
    rate: float = sj.number_field("b", "s/m", "rate", within="(0, inf)")

    def restitution_squared(self, velocity):
        return (jnp.asarray(self.level) * jnp.exp(-self.rate * velocity)) ** 2


def decay(v, level, rate):
    """The same by NumPy."""
    return level * np.exp(-rate * np.asarray(v))
