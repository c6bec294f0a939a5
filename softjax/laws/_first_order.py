"""Zhou's law to first order in the size of the plastic region: forces, works and roots.

With s = √x everything is a polynomial. Relative to any scale e of s, with n = s/e, i = 1/e,
m = n - i and a = d e², the loading branch reads

    W_L/(2/5 e⁵) = n⁵ - (5/2) a m³ (8/3 i⁴ + 5 i³m + 4 i²m² + 5/3 i m³ + 2/7 m⁴)
    p_L/e³       = n³ - a m² (m + 2i)(m² + 2im + 2i²)

which are Eqs. (9) and (8) multiplied out: their differences cancel to third order in x - 1. Works are
taken at the scale e = y^{2/5}, √x of the elastic collision of the same velocity, so that all terms
stay near one and float32 neither cancels nor overflows.
"""

from dataclasses import replace

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from softjax.fields import Flags, Numbers
from softjax.laws.reduced import ReducedClosedForm
from softjax.numerics.powers import guessed_power, safe_sqrt
from softjax.numerics.roots import implicit_root, third_order_root

# Enough for 200 000 impacts at 1 - y/y_max from 1e-16 to 1e-1, the hardest: rounding error is left.
MOST_STEPS = 12
END_STEPS = 7


class PlasticCore(ReducedClosedForm):
    """What both forms of Zhou's law have in common: their numbers d and X."""

    d: Numbers
    X: Numbers

    def unloading(self, x: Numbers, peak: Numbers) -> Numbers:
        return self.unloading_at(x, peak - x, peak)

    def on_loading(self) -> "PlasticCore":
        return replace(self, X=lax.stop_gradient(self.X))


class FirstOrder(PlasticCore):
    """Eqs. (8) and (12), each divided by k δ_cr^{3/2}."""

    def loading(self, x: Numbers) -> Numbers:
        return force_ratio(safe_sqrt(x), 1.0, jnp.where(x > 1, self.d, 0.0))  # Eq. (8)

    def unloading_at(self, x: Numbers, recovered: Numbers, peak: Numbers) -> Numbers:
        root = safe_sqrt(x)
        elastic = (1 - self.d * peak) * x * root + self.d * root  # Eq. (12)
        yielded = self.d * ((peak - 1) * (peak + 1))
        return elastic + yielded * (1 - self.X * (recovered / peak))  # Eq. (12)

    def releases(self, peak: Numbers) -> Flags:
        return jnp.broadcast_to(self.X > 1, peak.shape)

    def end(self) -> Numbers:
        return _end(self.d) ** 2

    def beyond_expansion(self, peak: Numbers) -> Flags:
        return self.d * peak > 1

    def largest_velocity(self) -> Numbers:
        s = _end(self.d)
        return jnp.sqrt(s * work_ratio(1.0, 1 / s, self.d * s**2)) * s**2

    def peak(self, y: Numbers) -> Numbers:
        """x_m of W_L(x_m) = (2/5) y², Eq. (10)."""
        # Any scale near y^{2/5} will do, without a derivative; but it must be one number: of a scale
        # that is computed twice, each time rounded another way, x_m is as far off as the two are apart.
        short = lax.stop_gradient(jnp.clip(y, 1e-37, 1e37)).astype(jnp.float32)
        guess = guessed_power(short, 0.4)
        per_guess = 1 / guess
        off = jnp.square(short * per_guess**2) * per_guess - 1  # y²/guess⁵ - 1
        nearer = 1 + 0.2 * off
        start = lax.stop_gradient(self._peak_start(guess * nearer) * nearer)
        scale = guess.astype(y.dtype)
        per_scale = 1 / scale
        return jnp.square(scale * _peak_ratio(y, per_scale, self.d * scale**2, start))

    def _peak_start(self, scale):
        """n between 1 and the one of y_max, as large contacts (i -> 0) have it: error below 0.04."""
        per_largest = self.largest_velocity() ** -0.4
        top = _end(self.d) * per_largest - 1
        per_largest, top = (x.astype(jnp.float32) for x in (per_largest, top))
        # (y/y_max)^{4/5}, from which on the way to the last turning point is a square root
        h = jnp.sqrt(jnp.maximum(1 - (scale * per_largest) ** 2, 0.0))
        return 1 + top * (1 - h) * (1 - 0.52 * h)

    def release(self, peak: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """x* of p_U(x*) = 0, Eq. (14): X <= 1 leaves no root, then x* = 0."""
        has_root = self.X > 1
        s = jnp.sqrt(peak)
        steepness = jnp.where(has_root, self.X, 2.0)
        per_force = self.d / (peak * s)
        area = (peak + 1) * ((s - 1) * (s + 1))  # x_m² - 1
        c3, c1, yielded = 1 - self.d * peak, per_force * s, per_force * area
        r, q = _release_ratio(c3, c1, yielded, steepness)
        r, q = jnp.where(has_root, r, 0.0), jnp.where(has_root, q, 1.0)
        work = s**5 * release_work_ratio(r, q, c3, c1, yielded, self.X)
        return peak * r**2, peak * q * (1 + r), work


def work_ratio(n, i, a):
    """W_L/(2/5 e⁵), as above."""
    m = n - i
    lost = i**3 * (8 / 3 * i + 5 * m) + m**2 * (4 * i**2 + m * (5 / 3 * i + 2 / 7 * m))
    return n**5 - 2.5 * a * m**3 * lost


def force_ratio(n, i, a):
    """p_L/e³, as above."""
    m = n - i
    return n**3 - a * m**2 * (m + 2 * i) * (m * (m + 2 * i) + 2 * i**2)


def release_work_ratio(r, q, c3, c1, yielded, X):
    """W_U over x_m^{5/2}, the bracket of Eq. (15), with r = √(x/x_m).

    The differences are written in q = 1 - r where r nears one. Where it does not, that would make
    the derivative a difference of large ones: just above yield r moves 2X times as fast as x_m.
    """
    near = q < 0.5
    fifth = jnp.where(near, q * (1 + r * (1 + r * (1 + r * (1 + r)))), 1 - r**5)
    third = jnp.where(near, q * (1 + r * (1 + r)), 1 - r**3)
    part = jnp.where(near, q * (1 + r), 1 - r**2)
    return 0.4 * c3 * fifth + 2 / 3 * c1 * third + yielded * part * (1 - 0.5 * X * part)


def _work_residual(n, y, i, a, start):
    root = y * i * i
    return work_ratio(n, i, a) - root * root * i


def _expand_work(n, y, i, a, start):
    m = n - i
    force = force_ratio(n, i, a)
    slope = 3 * n**2 - a * m * (8 * i**3 + m * (18 * i**2 + m * (16 * i + 5 * m)))
    return _work_residual(n, y, i, a, start), 5 * n * force, 5 * (force + n * slope)


_peak_ratio = implicit_root(
    third_order_root(_expand_work, lambda y, i, a, start: start, MOST_STEPS, first_steps=1),
    _work_residual,
)


def _end_residual(s, d):
    e = s - 1
    return d * e**2 * (2 + e) * (2 + e * (2 + e)) / s**3 - 1


def _solve_end(d: Array) -> Array:
    """s_0 > 1 with p_L(s_0²) = 0."""

    def newton(_, s):
        e = s - 1
        f = e**2 * (2 + e) * (2 + e * (2 + e)) - s**3 / d
        return s - f / (e * (8 + e * (18 + e * (16 + e * 5))) - 3 * s**2 / d)

    # right of the root of a convex function: Newton stays right of it
    return lax.fori_loop(0, END_STEPS, newton, 1 + 1 / jnp.sqrt(d))


_end = implicit_root(_solve_end, _end_residual)


def _release_residual(r, c3, c1, yielded, X):
    """p_U/x_m^{3/2} at r = √(x/x_m), Eq. (14)."""
    return ((c3 * r + yielded * X) * r + c1) * r - yielded * (X - 1)


def _expand_release(r, c3, c1, yielded, X):
    """The cubic and its derivatives; near r = 1 in q = 1 - r, to the full relative precision of q."""
    yielded = jnp.maximum(yielded, 0.0)  # a collision that just yields may round to below yield
    q, c2 = 1 - r, yielded * X
    in_q = (c3 + c1 + yielded) - q * ((3 * c3 + 2 * c2 + c1) - q * ((3 * c3 + c2) - q * c3))
    in_r = _release_residual(r, c3, c1, yielded, X)
    return jnp.where(q < 0.5, in_q, in_r), (3 * c3 * r + 2 * c2) * r + c1, 6 * c3 * r + 2 * c2


def _release_start(c3, c1, yielded, X):
    """The root without the cubic term, and the cube root, joined as 1/r² = Σ 1/r_i².

    12 % off at most where c3 > 0; where it is not, 0.42 of r, and the steps are more.
    """
    c3, c1, yielded, X = (x.astype(jnp.float32) for x in (c3, c1, jnp.maximum(yielded, 0.0), X))
    c2, c0 = yielded * X, yielded * (X - 1)
    quadratic = 2 * c0 / (c1 + jnp.sqrt(c1**2 + 4 * c2 * c0))
    safe = jnp.where(quadratic > 0, quadratic, 1.0)
    cubic = guessed_power(jnp.maximum(c3, 0.0) * safe**3 / jnp.where(c0 > 0, c0, 1.0), 2 / 3)
    return jnp.minimum(quadratic * lax.rsqrt(1 + cubic), 1.0)


def _finish_release(r, change):
    return jnp.clip(r - change, 0.0, 1.0), jnp.clip((1 - r) + change, 0.0, 1.0)


_release_ratio = implicit_root(
    third_order_root(_expand_release, _release_start, MOST_STEPS, 2, _finish_release),
    _release_residual,
)
