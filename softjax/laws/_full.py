"""The full form of Zhou's law (Eqs. 6 and 11, cos³θ kept): forces, works and roots.

With ε = 2d/3 the rim's part of the loading force is (x - ε(x² - 1))^{3/2} and

    x - ε(x² - 1) = ε (x_e - x)(x + 1/x_e),   x_e = [1 + √(1 + 4ε²)]/(2ε)

so that with x + 1/x_e = ℓ sin²φ, ℓ = x_e + 1/x_e, its work is
2 (ε ℓ)^{3/2} ℓ^{5/2} ∫ (cosφ sinφ)⁴ dφ.
The elementary antiderivative cancels badly at small d; Gauss–Legendre quadrature in φ is exact to
rounding over the whole range, its end included, since the integrand is a trigonometric polynomial.
"""

import jax.numpy as jnp
from jaxtyping import Array

from softjax.fields import Flags, Numbers
from softjax.laws._first_order import PlasticCore
from softjax.numerics.gauss import integrate
from softjax.numerics.powers import power_3_2, safe_sqrt
from softjax.numerics.roots import implicit_root, parabolic_step, refine

# More steps than any case takes of E/Y from 2 to 1e6 and y from 1 to y_max, and nodes that bring
# them to rounding error.
MOST_STEPS = 20
NODES = 20


class Full(PlasticCore):
    """Eqs. (6) and (11), each divided by k δ_cr^{3/2}.

    Ends where the plastic region fills the contact, x = (2d/3)(x² - 1): beyond, cosθ is not real.
    """

    def loading(self, x: Numbers) -> Numbers:
        return loading_force(x, jnp.where(x > 1, self.d, 0.0))  # Eq. (6)

    def unloading_at(self, x: Numbers, recovered: Numbers, peak: Numbers) -> Numbers:
        rim = (1 - 2 / 3 * self.d * peak) * x + 2 / 3 * self.d  # x x_m - 1 as in Eq. (12)
        yielded = self.d * ((peak - 1) * (peak + 1))
        return power_3_2(rim) + yielded * (1 - self.X * (recovered / peak))  # Eq. (11)

    def releases(self, peak: Numbers) -> Flags:
        """Whether p_U(0) < 0: (x_m² - 1)(X - 1) > (2/3)^{3/2} √d."""
        return (peak - 1) * (peak + 1) * (self.X - 1) > (2 / 3) ** 1.5 * jnp.sqrt(self.d)

    def end(self) -> Numbers:
        return full_contact(self.d)

    def beyond_expansion(self, peak: Numbers) -> Flags:
        return peak >= self.end()

    def largest_velocity(self) -> Numbers:
        return jnp.sqrt(2.5 * loading_work(self.end(), self.d))

    def peak(self, y: Numbers) -> Numbers:
        return jnp.square(_peak_root(y, self.d))

    def release(self, peak: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """With p_U = (a f + b)^{3/2} + c (1 - X (1 - f)) and f = x/x_m, Eq. (11)."""
        released = self.releases(peak)
        steepness = jnp.where(released, self.X, 2.0)
        b = 2 / 3 * self.d
        a, c = (1 - b * peak) * peak, self.d * (peak - 1) * (peak + 1)
        f, g = _release_fraction(a, b, jnp.where(released, c, 2 * b**1.5 + a**2), steepness)
        f, g = jnp.where(released, f, 0.0), jnp.where(released, g, 1.0)
        # ∫ (af+b)^{3/2} df = (2/5)(high⁵ - low⁵)/a, and a g = high² - low²
        high, low = safe_sqrt(a + b), safe_sqrt(a * f + b)
        quintic = (((high + low) * high + low**2) * high + low**3) * high + low**4
        both = jnp.maximum(high + low, jnp.finfo(g.dtype).tiny)
        work = peak * g * (0.4 * quintic / both + c * (1 - 0.5 * self.X * g))
        return peak * f, peak * g, work


def loading_force(x, d):
    """p_L(x) of Eq. (6) for x >= 1, with x cos²θ of Eq. (7) as its rim."""
    return power_3_2(x - 2 / 3 * d * (x**2 - 1)) + d * (x**2 - 1)


def full_contact(d: Array) -> Array:
    """x_e, where the plastic region fills the contact."""
    e = 2 / 3 * d
    return (1 + jnp.sqrt(1 + 4 * e**2)) / (2 * e)


def loading_work(x: Array, d: Array) -> Array:
    """W_L(x), the integral of Eq. (6)."""
    yielded = jnp.maximum(x, 1.0)
    elastic = jnp.minimum(x, 1.0)
    m = yielded - 1
    plastic = d * m**2 * (1 + m / 3)  # d [(x³-1)/3 - (x-1)]
    return 0.4 * elastic**2 * safe_sqrt(elastic) + _rim_work(yielded, d) + plastic


def _rim_work(x, d):
    """∫_1^x (x - ε(x² - 1))^{3/2} dx, scaled by the power of x that it is for small ε."""
    x_e = full_contact(d)
    width = safe_sqrt(x + 1 / x_e)  # √ℓ sinφ
    first = jnp.arctan2(safe_sqrt(1 + 1 / x_e), safe_sqrt(x_e - 1.0))
    last = jnp.arctan2(width, safe_sqrt(x_e - x))
    sine = jnp.sin(last)
    start = first / last
    power = lambda t: (jnp.sin(2 * last * t) / (2 * sine)) ** 4  # noqa: E731
    integral = integrate(power, start, jnp.ones_like(start), NODES)
    span = jnp.sqrt(1 + 4 * (2 / 3 * d) ** 2)  # ε ℓ
    return 2 * span * jnp.sqrt(span) * width**5 * (last / sine) * integral


def _peak_residual(s, y, d):
    per_velocity = 1 / y  # the derivative of a quotient by y² would overflow float32 at y = 1e13
    return 2.5 * (loading_work(s**2, d) * per_velocity) * per_velocity - 1


def _solve_peak(y, d):
    limit = jnp.sqrt(full_contact(d))

    def step(s):
        x, e = s**2, 2 / 3 * d
        force = loading_force(x, d)
        slope = 1.5 * safe_sqrt(x - e * (x**2 - 1)) * (1 - 2 * e * x) + 2 * d * x
        first, second = 5 * s * force / y**2, 5 * (force + 2 * x * slope) / y**2
        return jnp.clip(s - parabolic_step(_peak_residual(s, y, d), first, second), 1.0, limit)

    start = jnp.minimum(y**0.4, limit)
    return refine(step, start, start == start, MOST_STEPS)


_peak_root = implicit_root(_solve_peak, _peak_residual)


def _release_residual(f, a, b, c, X):
    return power_3_2(a * f + b) - c * ((X - 1) - X * f)


def _solve_release(a, b, c, X):
    def step(f):
        low = safe_sqrt(a * f + b)
        slope = 1.5 * a * low + c * X
        curvature = 0.75 * a**2 / jnp.where(low > 0, low, jnp.inf)
        change = parabolic_step(_release_residual(f, a, b, c, X), slope, curvature)
        return jnp.clip(f - change, 0.0, 1.0)

    start = jnp.clip(1 - 1 / X, 0.0, 1.0)  # of the line alone: from above
    f = refine(step, start, start == start, MOST_STEPS)
    g = 1 - f  # to full relative precision: one step of the same equation written in g
    residual = power_3_2(a + b - a * g) + c * (1 - X * g)
    slope = 1.5 * a * safe_sqrt(a * f + b) + c * X
    return f, jnp.where(g < 0.5, g + residual / slope, g)


_release_fraction = implicit_root(_solve_release, _release_residual)
