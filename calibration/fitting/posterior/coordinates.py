"""Coordinates in which a density is nearly normal: linear ones, or along the profile of the unknown known least.

Unknowns that the data determine only together (χ̃ and ε_up far above yield, σ and ψ) lie along a curved ridge. With
t the least known of those that belong together and r the others,

    t = t(u₁),   r = r(u₁) + diag s(u₁) L u₂…,     u₁ = ± √(2 (ln p_max - ln p_profile(t)))

where r(u₁) maximises the density at t, s are the errors of the others there and L the root of their correlations; where
these are not nearly normal either, L u₂… is such a map again. So u₁ is standard normal where the profile
determines t, and no ridge is left. The functions are cubic splines through a few points of the profile. What is
nearly normal in q is scaled by the observed information alone: of ½ [(q₁ - 3)/2]² + ½ q₂² the unit of q₁ is 2.

>>> def slope(q):
...     white = np.array([(q[0] - 3) / 2, q[1]])
...     return 0.5 * float(white @ white), white / np.array([2.0, 1.0])
>>> found = coordinates_of(slope, np.array([3.0, 0.0]), np.ones(2))
>>> found.centre.round(6), found.root.round(6)
(array([3., 0.]), array([[2., 0.],
       [0., 1.]]))
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

STEP = 1e-4  # of the prior's standard deviation, of differences of the gradient
FLAT = 0.05  # curvature in units of the prior's below which a direction counts as level
ROUNDS = 40  # of Newton's method in a region of trust
ARRIVED = 1e-3  # slope of -ln p in units of the prior's
REACH, KNOTS = 5.0, 16  # how far the profile is followed to each side, in u, and by how many points
STRIDE = 0.5  # in u, between two of them
ALIKE = 0.7  # of the largest bend, from which on two unknowns lie along one ridge
PROBE = 1.5  # errors at which it is looked whether ln p is nearly normal
NEARLY_NORMAL = 0.35  # how far it may be off there, in parts

Vector = Float[np.ndarray, "p"]
Places = Int[np.ndarray, "k"]
Slope = Callable[[Vector], tuple[float, Vector]]  # -ln p and its gradient


class Linear(NamedTuple):
    """q = centre + root u."""

    centre: Float[np.ndarray, " k"]
    root: Float[np.ndarray, "k k"]

    def q(self, u: Array) -> tuple[Array, Array]:
        """q, and ln |∂q/∂u| up to a constant."""
        return self.centre + self.root @ u, jnp.zeros(())


class Path(NamedTuple):
    """Coordinates along the profile of one of some unknowns.

    Attributes:
        order: places of t and of the others, (k,).
        knots: values of u₁, ascending, (m,).
        coefficients: of the cubics in u₁ between them, for t, r and ln s, (4, m - 1, 2 k - 1).
        others: from u₂… to the others in units of s around r.
    """

    order: Places
    knots: Float[np.ndarray, " m"]
    coefficients: Float[np.ndarray, "4 intervals both"]
    others: "Linear | Path"

    def q(self, u: Array) -> tuple[Array, Array]:
        """q, and ln |∂q/∂u| up to a constant; linear in u₁ beyond the knots."""
        knots, count = jnp.asarray(self.knots), len(self.order)
        inside = jnp.clip(u[0], knots[0], knots[-1])
        k = jnp.clip(jnp.searchsorted(knots, inside) - 1, 0, len(knots) - 2)
        (a, b, c, d), x = jnp.asarray(self.coefficients)[:, k], inside - knots[k]
        cubic = lambda x: ((a * x + b) * x + c) * x + d  # noqa: E731
        value, slope = jax.jvp(cubic, (x,), (jnp.ones_like(x),))
        value += slope * (u[0] - inside)
        apart, log_jacobian = self.others.q(u[1:])
        others = value[1:count] + jnp.exp(value[count:]) * apart
        q = jnp.zeros(count).at[self.order].set(jnp.concatenate([value[:1], others]))
        return q, log_jacobian + jnp.log(slope[0]) + jnp.sum(value[count:])


def lowest(slope: Slope, q: Vector, places: Any, scale: Vector):
    """Minimum of -ln p along some unknowns, and the precision there.

    Second derivatives are differences of the gradient.
    """
    from scipy.optimize import minimize

    unit = scale[places]
    some = of_some(slope, q, places, unit)
    steps = STEP * np.eye(len(unit))

    def curvature(x: Vector) -> Float[np.ndarray, "k k"]:
        rows = np.array([some(x + step)[1] - some(x - step)[1] for step in steps])
        return np.nan_to_num((rows + rows.T).reshape(len(x), len(x)) / (4 * STEP))

    end = np.zeros(len(unit))
    if len(unit):
        options = {"gtol": ARRIVED, "maxiter": ROUNDS}
        end = minimize(some, end, jac=True, hess=curvature, method="trust-exact", options=options).x
    sizes, vectors = np.linalg.eigh(curvature(end))
    precision = (vectors * np.maximum(np.abs(sizes), FLAT)) @ vectors.T / np.outer(unit, unit)
    minimum = q.copy()
    minimum[places] += unit * end
    return minimum, precision


def of_some(slope: Slope, q: Vector, places: Any, unit: Vector | None = None) -> Slope:
    """-ln p and its gradient as functions of x at some places: q itself, or q + unit x there."""

    def some(x: Vector) -> tuple[float, Vector]:
        moved = q.copy()
        moved[places] = x if unit is None else q[places] + unit * x
        value, gradient = slope(moved)
        gradient = gradient[places] * (1.0 if unit is None else unit)
        return (value, gradient) if np.isfinite(value) else (np.inf, 0 * gradient)

    return some


def coordinates_of(slope: Slope, q: Vector, scale: Vector, straight: bool = False) -> Linear | Path:
    """Coordinates of unknowns that belong together, from the maximum of their density."""
    every = np.arange(len(q))
    covariance = np.linalg.inv(lowest(slope, q, every, scale)[1])
    sizes = np.sqrt(np.diag(covariance))
    ahead = covariance / sizes  # what all move by where one moves by its error
    sides = np.array([[slope(q + side * step)[0] for side in (-PROBE, PROBE)] for step in ahead.T])
    rise = (sides.reshape(-1, 2) - slope(q)[0]) / (0.5 * PROBE**2)
    bent = np.nan_to_num(np.max(np.abs(rise - 1), axis=1, initial=0.0), nan=np.inf, posinf=np.inf)
    if straight or not np.any(bent > NEARLY_NORMAL):
        return Linear(q, np.linalg.cholesky(covariance))
    # all along one ridge have the same curvature: the one known least
    lead = max(np.flatnonzero(bent >= ALIKE * np.max(bent)), key=lambda k: sizes[k] / scale[k])
    others = np.delete(every, lead)
    order = np.array([lead, *others])
    errors = _errors(lowest(slope, q, others, scale)[1])
    top = np.concatenate([q[order], np.log(errors)])
    points = [(0.0, top)]
    for side in (-1, 1):
        followed = _followed(slope, q, order, scale, side * ahead[order, lead])
        if not followed:  # the profile is unknown: as if normal
            followed = [(1.0, top + side * np.append(ahead[order, lead], 0 * errors))]
        points += [(side * u, values) for u, values in followed]
    knots, values = (np.array(x) for x in zip(*sorted(points, key=lambda p: p[0]), strict=True))
    inner = coordinates_of(of_some(slope, q, others, errors), 0 * errors, scale[others] / errors)
    return Path(order, knots, _cubics(knots, values), inner)


def _errors(precision: Float[np.ndarray, "k k"]) -> Float[np.ndarray, " k"]:
    return np.sqrt(np.diag(np.linalg.inv(precision)))


def _cubics(knots: Vector, values: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "4 m k"]:
    """Splines through the values whose first column ascends everywhere."""
    from scipy.interpolate import CubicSpline, PchipInterpolator

    spline = CubicSpline(knots, values, bc_type="natural")
    between = np.linspace(knots[0], knots[-1], 20 * len(knots))
    ascends = np.min(spline(between, 1)[:, 0]) > 0
    return spline.c if ascends else PchipInterpolator(knots, values).c


def _followed(slope: Slope, top: Vector, order: Places, scale: Vector, ahead: Vector):
    """Points (|u₁|, (t, r, ln s)) of the profile to one side, from the top on."""
    steps: list[tuple[float, Vector]] = []
    least, q, u, stride = slope(top)[0], top, 0.0, STRIDE
    for _ in range(3 * KNOTS):
        moved = q.copy()
        moved[order] += stride * ahead
        moved, precision = lowest(slope, moved, order[1:], scale)
        rise = slope(moved)[0] - least
        gone = math.sqrt(2 * rise) - u if np.isfinite(rise) and rise > 0 else math.nan
        if not gone < 2 * STRIDE and stride > 1e-3:  # too far, or where there is no density
            stride *= 0.4
            continue
        if not gone > 1e-3:  # level, or upwards again
            if stride > 20 or gone < 0:
                break
            stride *= 2
            continue
        u += gone
        steps.append((u, np.concatenate([moved[order], np.log(_errors(precision))])))
        ahead = (moved - q)[order] / stride
        q, stride = moved, stride * min(max(STRIDE / gone, 0.4), 2.0)
        if u > REACH or len(steps) == KNOTS:
            break
    return steps
