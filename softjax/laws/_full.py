"""Works and roots of the full form (Zhou, Eqs. 6 and 11), arranged against rounding.

With ε = 2d/3 the rim's part of the loading force is (x - ε(x² - 1))^{3/2} and

    x - ε(x² - 1) = ε (x_e - x)(x + 1/x_e),   x_e = [1 + √(1 + 4ε²)]/(2ε)

so that with x + 1/x_e = ℓ sin²φ, ℓ = x_e + 1/x_e, its work is
2 (ε ℓ)^{3/2} ℓ^{5/2} ∫ (cosφ sinφ)⁴ dφ.
The elementary antiderivative cancels badly at small d; Gauss–Legendre quadrature in φ is exact to
rounding over the whole range, its end included, since the integrand is a trigonometric polynomial.
"""

import jax.numpy as jnp
from jaxtyping import Array

from softjax.numerics.gauss import integrate
from softjax.numerics.powers import power_3_2, safe_power, safe_sqrt
from softjax.numerics.roots import implicit_root, parabolic_step, refine

# More steps than any case takes of E/Y from 2 to 1e6 and y from 1 to y_max, and nodes that bring
# them to rounding error.
MOST_STEPS = 20
NODES = 20


def end(d: Array) -> Array:
    """x_e, where the plastic region fills the contact."""
    e = 2 / 3 * d
    return (1 + jnp.sqrt(1 + 4 * e**2)) / (2 * e)


def _angle(x, d):
    """φ of x + 1/x_e = ℓ sin²φ."""
    x_e = end(d)
    return jnp.arctan2(safe_sqrt(x + 1 / x_e), safe_sqrt(x_e - x))


def loading_work(x: Array, d: Array) -> Array:
    """W_L(x), the integral of Eq. (6)."""
    yielded = jnp.maximum(x, 1.0)
    elastic = jnp.minimum(x, 1.0)
    m = yielded - 1
    plastic = d * m**2 * (1 + m / 3)  # d [(x³-1)/3 - (x-1)]
    return 0.4 * elastic**2 * safe_sqrt(elastic) + _rim_work(yielded, d) + plastic


def _rim_work(x, d):
    """∫_1^x (x - ε(x² - 1))^{3/2} dx, scaled by the power of x that it is for small ε."""
    first, last = _angle(1.0, d), _angle(x, d)
    sine = jnp.sin(last)
    start = first / last
    power = lambda t: (jnp.sin(2 * last * t) / (2 * sine)) ** 4  # noqa: E731
    integral = integrate(power, start, jnp.ones_like(start), NODES)
    span = jnp.sqrt(1 + 4 * (2 / 3 * d) ** 2)  # ε ℓ
    width = safe_sqrt(x + 1 / end(d))  # √ℓ sinφ
    return 2 * span * jnp.sqrt(span) * width**5 * (last / sine) * integral


def largest_velocity(d: Array) -> Array:
    """y_max of W_L(x_e) = (2/5) y_max²."""
    return jnp.sqrt(2.5 * loading_work(end(d), d))


def _force(x, d):
    return power_3_2(x - 2 / 3 * d * (x**2 - 1)) + d * (x**2 - 1)


def _force_slope(x, d):
    e = 2 / 3 * d
    return 1.5 * safe_sqrt(x - e * (x**2 - 1)) * (1 - 2 * e * x) + 2 * d * x


def peak(y: Array, d: Array) -> Array:
    """x_m of W_L(x_m) = (2/5) y², for 1 <= y < y_max."""
    return jnp.square(_peak_root(y, d))


def _peak_residual(s, y, d):
    per_velocity = 1 / y  # the derivative of a quotient by y² would overflow float32 at y = 1e13
    return 2.5 * (loading_work(s**2, d) * per_velocity) * per_velocity - 1


def _solve_peak(y, d):
    limit = jnp.sqrt(end(d))

    def step(s):
        x = s**2
        force = _force(x, d)
        slope = 5 * s * force / y**2
        curvature = 5 * (force + 2 * x * _force_slope(x, d)) / y**2
        return jnp.clip(s - parabolic_step(_peak_residual(s, y, d), slope, curvature), 1.0, limit)

    start = jnp.minimum(y**0.4, limit)
    return refine(step, start, start == start, MOST_STEPS)


_peak_root = implicit_root(_solve_peak, _peak_residual)


def release(peak: Array, d: Array, X: Array) -> tuple[Array, Array, Array]:
    """x* of p_U(x*) = 0, what is recovered x_m - x*, and the work from x* to x_m.

    Without a root x* = 0.
    """
    released = has_root(peak, d, X)
    steepness = jnp.where(released, X, 2.0)
    elastic, rest, yielded = _coefficients(peak, d)
    yielded_safe = jnp.where(released, yielded, 2 * rest**1.5 + elastic**2)
    f, g = _release_fraction(elastic, rest, yielded_safe, steepness)
    f, g = jnp.where(released, f, 0.0), jnp.where(released, g, 1.0)
    return peak * f, peak * g, _work(peak, f, g, elastic, rest, yielded, X)


def has_root(peak: Array, d: Array, X: Array) -> Array:
    """Whether p_U(0) < 0: (x_m² - 1)(X - 1) > (2/3)^{3/2} √d."""
    return (peak - 1) * (peak + 1) * (X - 1) > (2 / 3) ** 1.5 * jnp.sqrt(d)


def _coefficients(peak, d):
    """a, b, c of p_U = (a f + b)^{3/2} + c (1 - X (1 - f)) with f = x/x_m, Eq. (11)."""
    e = 2 / 3 * d
    return (1 - e * peak) * peak, e, d * (peak - 1) * (peak + 1)


def _work(peak, f, g, a, b, c, X):
    """∫ p_U over x_m - x = x_m g, in factors of g = 1 - f."""
    high, low = safe_sqrt(a + b), safe_sqrt(a * f + b)
    # ∫ (af+b)^{3/2} df = (2/5)(high⁵ - low⁵)/a, and a g = high² - low²
    quintic = (((high + low) * high + low**2) * high + low**3) * high + low**4
    both = jnp.maximum(high + low, jnp.finfo(g.dtype).tiny)
    return peak * g * (0.4 * quintic / both + c * (1 - 0.5 * X * g))


def _release_residual(f, a, b, c, X):
    return power_3_2(a * f + b) - c * ((X - 1) - X * f)


def _solve_release(a, b, c, X):
    def step(f):
        low = safe_sqrt(a * f + b)
        slope = 1.5 * a * low + c * X
        curvature = 0.75 * a**2 / jnp.where(low > 0, low, jnp.inf)
        change = parabolic_step(_release_residual(f, a, b, c, X), slope, curvature)
        return jnp.clip(f - change, 0.0, 1.0)

    start = _release_start(a, b, c, X)
    f = refine(step, start, start == start, MOST_STEPS)
    g = 1 - f  # to full relative precision: one step of the same equation written in g
    residual = power_3_2(a + b - a * g) + c * (1 - X * g)
    slope = 1.5 * a * safe_sqrt(a * f + b) + c * X
    return f, jnp.where(g < 0.5, g + residual / slope, g)


def _release_start(a, b, c, X):
    """Either term alone bounds the root from above (for a > 0; else the line does)."""
    line = 1 - 1 / X
    curve = (safe_power(c * (X - 1), 2 / 3) - b) / jnp.where(a > 0, a, 1.0)
    return jnp.clip(jnp.where(a > 0, jnp.minimum(line, curve), line), 0.0, 1.0)


_release_fraction = implicit_root(_solve_release, _release_residual)
