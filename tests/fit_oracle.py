"""The model and its fits by SciPy alone: nothing of the package is used but its data classes.

First-order form: forces as in Eqs. (8) and (12), their works by Gauss–Legendre quadrature in √x,
roots by Brent's method, fits by `scipy.optimize.least_squares` with its own differences.
"""

import math
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq, least_squares

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)  # exact: the integrands are polynomials


def _work(force, low, high):
    """∫ force dx in s = √x."""
    a, b = math.sqrt(low), math.sqrt(high)
    s = 0.5 * (b - a) * NODES + 0.5 * (a + b)
    return float(0.5 * (b - a) * np.sum(WEIGHTS * 2 * s * force(s * s)))


@lru_cache(maxsize=100_000)  # what is searched for moves only one of d, X and y at a time, if any
def _peak(d, y):
    """The largest overlap, at which the loading force has done the impact's work."""

    def loading(x):
        return x**1.5 + d * (x**2 - 1) * (1 - np.sqrt(x))

    def work(x):
        return 0.4 + _work(loading, 1.0, x)

    target = 0.4 * y * y
    high = y**0.8
    while work(high) < target:
        high *= 1.1
    return brentq(lambda x: work(x) - target, 1.0, high, xtol=1e-15, rtol=1e-15)


@lru_cache(maxsize=100_000)
def plastic_squared(d, X, y):
    """ε_p² of one impact beyond yield."""
    x_m = _peak(d, y)

    def unloading(x):
        plastic = d * (x_m**2 - 1) * (1 - X * (1 - x / x_m))
        return (1 - d * x_m) * x**1.5 + d * np.sqrt(x) + plastic

    x_r = brentq(unloading, 0.0, x_m, xtol=1e-15, rtol=1e-15) if unloading(0.0) < 0 else 0.0
    return _work(unloading, x_r, x_m) / (0.4 * y * y)


def eq_17(v, v_lim, sigma, psi):
    return np.exp(-sigma * (v / (v_lim - v)) ** psi)


def thornton(velocity, critical, factor=1.0):
    """Thornton (1997), Eq. 5; the velocity of first yield goes with the power 5/2 of p_y."""
    r = np.minimum(critical * factor**2.5 / velocity, 1.0)
    inner = r / (r + 2 * np.sqrt(1.2 - r**2 / 5))
    return np.where(r < 1, (1.2 * 3**0.5) ** 0.5 * np.sqrt(1 - r**2 / 6) * inner**0.25, 1.0)


def own_model(data):
    """ε of Zhou's law at a data set's velocities, a function of χ̃, σ and ψ."""
    contact = numbers(data.contact)
    return lambda *p: curve(data.velocity, contact, *p)


def curve(velocity, contact, chi, sigma, psi):
    """ε of two bodies by Eqs. (16) and (17); `contact` is a dict of E, R, M, Y, v_lim, A/R."""
    E, R, M, Y, v_lim, area = (contact[k] for k in ("E", "R", "M", "Y", "v_lim", "area"))
    A, k = area * R, 4 / 3 * E * math.sqrt(R)
    delta = (2 * math.pi * A * Y / (3 * k)) ** 2
    v_cr = math.sqrt(4 * k / (5 * M)) * delta**1.25
    d, X = 1.5 * delta / A, chi * E / Y
    up = float(eq_17(v_cr, v_lim, sigma, psi))
    below = eq_17(velocity, v_lim, sigma, psi)
    above = [
        math.sqrt(max(plastic_squared(d, X, v / v_cr) + up**2 - 1, 0.0)) if v > v_cr else 0.0
        for v in velocity
    ]
    return np.where(velocity > v_cr, above, below)


def numbers(contact):
    """A package's contact as the plain numbers that `curve` takes."""
    return {
        "E": float(contact.youngs_modulus),
        "R": float(contact.radius),
        "M": float(contact.mass),
        "Y": float(contact.yield_strength),
        "v_lim": float(contact.limit_velocity),
        "area": {"zhou": math.pi ** (2 / 3), "hertz": 1.0}[contact.area],
    }


def fit(model, start, restitution, uncertainty=None):
    """Least squares in physical units: values, covariance (absolute where u is given), residual."""
    weight = np.ones(len(restitution)) if uncertainty is None else 1 / uncertainty
    start = np.asarray(start, float)
    minimum = least_squares(
        lambda p: weight * (model(*p) - restitution),
        start,
        jac="3-point",
        x_scale=start,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    scale = 1.0
    if uncertainty is None:
        scale = np.sum(minimum.fun**2) / (len(restitution) - len(start))
    off = lambda p: weight * (model(*p) - restitution)  # noqa: E731
    return minimum.x, np.linalg.inv(curvature(off, minimum.x, minimum.jac)) * scale, minimum.fun


def curvature(residual, at, jacobian):
    """Second derivatives of ½ rᵀ r: JᵀJ + Σ r r″, with r″ by central differences."""
    here = residual(at)
    bent = hessian(lambda p: here @ residual(p), at, 2e-3 * (np.abs(at) + 1e-12))
    return jacobian.T @ jacobian + bent


def hessian(cost, at, size):
    """Second derivatives by central differences over steps of these sizes."""
    found = np.empty((len(at), len(at)))
    for i, a in enumerate(np.diag(size)):
        for j, b in enumerate(np.diag(size)[: i + 1]):
            ends = cost(at + a + b) - cost(at + a - b) - cost(at - a + b) + cost(at - a - b)
            found[i, j] = found[j, i] = ends / (4 * size[i] * size[j])
    return found
