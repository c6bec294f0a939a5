"""Every law is fitted, and every sort of parameter, as SciPy fits it."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import calibration as cal
import softjax as sj
from tests.fit_data import TRUTH, pair

Free = cal.Parameter
QUICK = {"profiles": False, "starts": 8}
NOISE = 0.005
PAIR = pair("nylon")
CRITICAL, LIMIT = float(PAIR.critical_velocity), float(PAIR.limit_velocity)
VELOCITY = np.geomspace(1.3, 40, 30) * CRITICAL


def measured(curve, seed=0, **told):
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(VELOCITY))
    return cal.RestitutionData(VELOCITY, curve(VELOCITY) + noise, PAIR, **told)


def hertz_dashpot(v, ratio):
    """ε of Hertz's spring with f = 2 ζ √(M k_t) dashpot: (−π β) with β = ζ√5 closed form."""
    beta = ratio
    return np.exp(-np.pi * beta / np.sqrt(1 - beta**2)) + 0 * v


def thornton(v, factor):
    """Thornton (1997), Eq. for ε(V_y/V), with V_y from p_y = factor · Y."""
    material = TRUTH["nylon"][0]
    del material
    p_y = factor * float(PAIR.yield_strength)
    E, R, M = (float(getattr(PAIR, n)) for n in ("youngs_modulus", "radius", "mass"))
    v_y = math.sqrt(math.pi**5 * R**3 * p_y**5 / (40 * E**4 * M)) * 2  # below, checked in the test
    return v, v_y


SPRING = float(PAIR.stiffness) * float(PAIR.radius) ** 0.5


class Decaying(sj.HardSphereLaw):
    """ε = a exp(-v/w)."""

    a: Array = sj.number_field("a", "-", "positive")
    w: Array = sj.number_field("w", "m/s", "positive")

    def restitution_squared(self, velocity):
        return (self.a * jnp.exp(-velocity / self.w)) ** 2
