"""The phase plane: the equation of motion of any force over an angle, integrated by diffrax.

With X = x/L, U = x'/V and m = 2k, the elastic motion of work ∝ X^k is a circle

    X^{m/4} = r sinθ,  U = r cosθ,    sinθ = sin^mψ,  r = R^m,  so that  X = (R sinψ)^4

which ψ runs through from touch (0) over the peak (π/2) to zero overlap (π), whatever the force is,
while R changes by what the force differs from that of the circle. ψ instead of θ makes all powers
of X smooth at both ends. What is integrated over is u = tan(ψ/2 - π/4), from -1 over 0 to 1, in
which neither sine nor cosine is more than a quotient. The state is R, and the time where
requested.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from softjax.engine.bridge import solve

# how near to touch, and to zero overlap, the integration begins and ends: X is 1e-16 of its peak
# there, and any power of it still a number. What happens before is less than rounding.
EDGE = 1e-4
TOUCH, PEAK, PARTING = EDGE - 1, 0.0, 1 - EDGE
# Where the force vanishes the overlap runs away, instead of dividing by zero: of the circle's rate
LEAST_RATE = 1e-6
# A force may jump where the velocity changes its sign: each side of the peak is computed from its own
ASIDE = 1e-14


class Plane(NamedTuple):
    """Where a motion takes place.

    Attributes:
        excess: what the acceleration (over V²/L) of (X, U) exceeds that of the circle by, (k/2) X^{k-1}.
        m: 2k, a whole number, so that all powers here are products.
        bounded: whether the angle is kept from standing still, where the force vanishes.
        smooth: the force has no kinks or flat parts; the step size is unbounded.
    """

    excess: Callable[[Array, Array], Array]
    m: int
    bounded: bool = False
    smooth: bool = False


class States(NamedTuple):
    """u, R and, with a clock, the time [L/V]; single numbers, or samples."""

    way: Array
    radius: Array
    clock: Array | None = None


def circle_force(m: int, X: Array) -> Array:
    """(k/2) X^{k-1}, the acceleration on the circle."""
    return 0.25 * m * jnp.sqrt(X) ** (m - 2)


def position(m: int, states: States) -> tuple[Array, Array]:
    """X and U."""
    sine, cosine, root = _angle(states.way, m)
    return (states.radius * sine) ** 4, states.radius**m * cosine * root


def _angle(u, m: int):
    """sinψ, cosψ and √((1 - sin²θ)/cos²ψ)."""
    below = 1 + u * u
    sine = (1 - u) * (1 + u) / below
    return sine, -2 * u / below, _root(sine * sine, m)


def _root(square, m: int):
    return jnp.sqrt(sum(square**j for j in range(m)))


def at_touch(like: Array, clock: bool) -> States:
    """The start of a contact with U = 1."""
    one = jnp.ones_like(like)
    return States(TOUCH * one, one, 0 * one if clock else None)


def placed(m: int, X: Array, U: Array) -> States:
    """The state of a motion on the way to its peak, X > 0."""
    amplitude = X ** (0.25 * m)  # r sinθ
    radius = jnp.sqrt(amplitude * amplitude + U * U)
    sine = (amplitude / radius) ** (1 / m)
    cosine = U / radius / _root(sine * sine, m)
    return States(-cosine / (1 + sine), radius ** (1 / m))


def samples(start: float, end: float, fractions: np.ndarray) -> np.ndarray:
    """Shares of the way from u to u that are evenly spaced in the angle where the fractions are."""
    angles = np.arctan(start) + (np.arctan(end) - np.arctan(start)) * fractions
    return np.clip((np.tan(angles) - start) / (end - start), 0.0, 1.0).astype(fractions.dtype)


def over_angle(
    plane: Plane, states: States, end: float | Array, route: Any, save=None, idle=None
) -> tuple[States, Bool[Array, ""]]:
    """From there to another u, or at shares `save` of the way; and the solver's verdict.

    Args:
        idle: where nothing is to be integrated.
    """
    start = states.way
    stop, is_loading = jnp.full_like(start, end), isinstance(end, float) and end == PEAK

    def field(u, state):
        u = jnp.minimum(u, -ASIDE) if is_loading else jnp.where(start < PEAK, u, _after(u))
        return rates(plane, u, state[0])[: len(state)]

    begin = (states.radius,) if states.clock is None else (states.radius, states.clock)
    solution, solved = solve(field, start, stop, begin, route, save, smooth=plane.smooth, idle=idle)
    way = stop if save is None else start + (stop - start) * save
    return States(way, *solution), solved


def rates(plane: Plane, u: Array, radius: Array) -> tuple[Array, Array]:
    """dR/du and dτ/du."""
    m = plane.m
    sine, cosine, root = _angle(u, m)
    fourth = radius * sine
    X, whole = fourth**4, radius**m
    excess = plane.excess(X, whole * cosine * root)
    # divided one by one: the product's square, which derivatives meet, would underflow
    push = excess / whole / (0.25 * m * fourth ** (m - 4))  # over θ' on the circle, (k/2) X^{k/2-1}
    rate = 1 + push * sine**m  # θ' over that
    if plane.bounded:
        # a force that pulls so hard that the angle would fall has no way over it: the solver gives up
        rate = jnp.where(rate < -LEAST_RATE, jnp.nan, jnp.maximum(rate, LEAST_RATE))
    angle_rate = 2 / (1 + u * u) / (root * rate)  # dψ/du, and from ψ to θ but for a power of sinψ
    lost = push * cosine * root * sine ** (m - 1) * angle_rate
    return -radius * lost, 4 * sine**3 * angle_rate / radius ** (m - 4)


def to_zero_force(
    plane: Plane, ratio: Callable[[Array, Array], Array], states: States, route: Any, save=None
) -> tuple[States, Bool[Array, ""]]:
    """From the peak to where the force vanishes, or the overlap if that comes first.

    Over z = g (1 - u), in which g is the force over the elastic one: z falls from 1 at the peak to
    0 at either end (Hénon's trick), and near the peak as the angle grows, with damping or without.
    Where the force jumps as the velocity changes its sign, z begins lower. `ratio` gives g of (X, U);
    an event would cost a search and a derivative of its own.
    """
    first = ratio(*position(plane.m, States(_after(states.way), states.radius)))

    def field(_, state):
        u = jnp.minimum(_after(state[0]), PARTING)
        along, slope = ratio_and_rates(plane, ratio, u, state[1])
        # where z does not fall the way leads nowhere: the solver is to give up
        rate = -1 / jnp.where(slope < 0, slope, 0.0)
        return tuple(rate * part for part in (jnp.ones_like(u), *along)[: len(state)])

    begin = tuple(state for state in states if state is not None)
    way = jnp.maximum(first, ASIDE)  # a force that pulls at once ends the contact at its peak
    solution, solved = solve(field, jnp.zeros_like(way), way, begin, route, save)
    return States(*solution), solved & jnp.all(jnp.isfinite(solution[0]))


def ratio_and_rates(plane: Plane, ratio: Callable, u: Array, radius: Array):
    """What `rates` gives, and dz/du."""
    along = rates(plane, u, radius)
    of_state = lambda u, radius: ratio(*position(plane.m, States(u, radius)))  # noqa: E731
    g, change = jax.jvp(of_state, (u, radius), (jnp.ones_like(u), along[0]))
    return along, change * (1 - u) - g


def _after(u: Array) -> Array:
    """u just beyond the peak, where the overlap falls."""
    return jnp.maximum(u, ASIDE)
