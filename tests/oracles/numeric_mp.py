"""Root finding, polynomials and quadrature at any precision; no physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from mpmath import mp, mpf

Real = float | int | str | mpf

QUADRATURE_DIGITS = 34  # what a duration is integrated to; its quadrature must certify 28 of them


def enough_digits(d: Real):
    """A precision context for parameter d: 120 digits, and more where the full form's work cancels.

    Its antiderivative has terms of size d^(-5/2) that cancel to one of size 1.
    """
    small = max(0, math.ceil(-float(mp.log10(mpf(d)))))
    return mp.workdps(max(mp.dps, 120 + 4 * small))


def bracketed_root(f: Callable[[mpf], tuple[mpf, mpf]], low: mpf, high: mpf, start: mpf) -> mpf:
    """Root of f between low (f < 0) and high (f > 0), where f gives value and slope.

    Newton's iteration inside a shrinking bracket, bisection wherever Newton leaves it or does not
    at least halve its step. Ends when a further step, converging quadratically, changes nothing.
    """
    x = min(max(start, low), high)
    step = high - low
    tolerance = mpf(10) ** (-(6 * mp.dps) // 10)
    for _ in range(40 * mp.dps):
        value, slope = f(x)
        if value == 0:
            return x
        low, high = (x, high) if value < 0 else (low, x)
        new = x - value / slope if slope > 0 else low
        if not low < new < high or 2 * abs(new - x) > abs(step):
            new = (low + high) / 2
        step, x = new - x, new
        if abs(step) <= tolerance * abs(x):
            value, slope = f(x)
            return min(max(x - value / slope, low), high) if slope > 0 else x
    raise ArithmeticError("the bracketed root did not converge")


def polynomial(coefficients: Sequence[mpf], s: mpf) -> mpf:
    """Horner's rule, coefficients from the constant upwards."""
    total = mpf(0)
    for c in reversed(coefficients):
        total = total * s + c
    return total


def work_polynomial(force: Sequence[mpf]) -> list[mpf]:
    """Antiderivative of force(s) dx with x = s², dx = 2 s ds, term by term."""
    return [mpf(0), mpf(0)] + [2 * c / (n + 2) for n, c in enumerate(force)]


def divided_difference(coefficients: Sequence[mpf], s_0: mpf) -> list[mpf]:
    """Coefficients of (P(s_0) - P(s)) / (s_0 - s): synthetic division, exact where s meets s_0."""
    quotient: list[mpf] = []
    carry = mpf(0)
    for c in reversed(coefficients[1:]):
        carry = carry * s_0 + c
        quotient.append(carry)
    return quotient[::-1]


def unit_integral(f: Callable[[mpf], mpf]) -> mpf:
    """Integral of f over (0, 1) by tanh-sinh, the integrand kept at the caller's precision."""
    digits = mp.dps

    def integrand(w: mpf) -> mpf:
        with mp.workdps(digits):
            return f(w)

    with mp.workdps(QUADRATURE_DIGITS):
        for points in ([0, 1], [0, mpf("1e-4"), mpf("1e-2"), 1]):
            value, error = mp.quad(integrand, points, error=True)
            if error <= abs(value) * mpf("1e-28"):
                return value
        raise ArithmeticError(f"quadrature reached {mp.nstr(error, 3)} only")
