"""A collision in the scales of first yield: peak and residual overlap, restitution, duration.

Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013). y is the impact velocity in units of v_cr; overlap
in units of δ_cr, force of k δ_cr^(3/2), time of δ_cr/v_cr. Then x'' = -(5/4) p(x), x(0) = 0,
x'(0) = y.
"""

from __future__ import annotations

from collections.abc import Callable

from mpmath import mp, mpf

from .forms_mp import FORMS
from .numeric_mp import Real, bracketed_root, enough_digits, unit_integral


def loading(form: str, d: Real, x: Real) -> mpf:
    """Loading force at overlap x; Hertz's below yield."""
    with enough_digits(d):
        d, x = mpf(d), mpf(x)
        return mp.sqrt(x) ** 3 if x <= 1 else FORMS[form].loading(d, x)


def unloading(form: str, d: Real, X: Real, x_m: Real, x: Real) -> mpf:
    """Unloading force at overlap x from the peak overlap x_m; Hertz's if x_m <= 1."""
    with enough_digits(d):
        d, X, x_m, x = mpf(d), mpf(X), mpf(x_m), mpf(x)
        return mp.sqrt(x) ** 3 if x_m <= 1 else FORMS[form].unloading(d, X, x_m, x)


def loading_work(form: str, d: Real, x: Real) -> mpf:
    """Work of loading from 0 to x; the impact's is (2/5) y²."""
    with enough_digits(d):
        d, x = mpf(d), mpf(x)
        return 2 * mp.sqrt(x) ** 5 / 5 if x <= 1 else FORMS[form].loading_work(d, x)


def unloading_work(form: str, d: Real, X: Real, x_m: Real, x: Real) -> mpf:
    """Work of unloading from x_m back to x."""
    with enough_digits(d):
        d, X, x_m, x = mpf(d), mpf(X), mpf(x_m), mpf(x)
        if x_m <= 1:
            return 2 * (mp.sqrt(x_m) ** 5 - mp.sqrt(x) ** 5) / 5
        return FORMS[form].unloading_quotient(d, X, x_m)(x) * (x_m - x)


def loading_end(form: str, d: Real) -> mpf:
    """Largest overlap of loading: its force vanishes (first-order) or the law ends (full)."""
    with enough_digits(d):
        return FORMS[form].loading_end(mpf(d))


def y_max(form: str, d: Real) -> mpf:
    """Impact velocity whose turning point is the end of loading; none turns above it."""
    with enough_digits(d):
        return mp.sqrt(5 * loading_work(form, d, loading_end(form, d)) / 2)


def peak(form: str, d: Real, y: Real) -> mpf | None:
    """Peak overlap x_m, or None where the loading has no turning point."""
    with enough_digits(d):
        d, y = mpf(d), mpf(y)
        if y <= 1:
            return y ** (mpf(4) / 5)
        end = loading_end(form, d)
        energy, law = 2 * y**2 / 5, FORMS[form]
        if law.loading_work(d, end) < energy:
            return None

        def lacking(s: mpf) -> tuple[mpf, mpf]:
            x = s**2
            return law.loading_work(d, x) - energy, 2 * s * law.loading(d, x)

        s = bracketed_root(lacking, mpf(1), mp.sqrt(end), y ** (mpf(2) / 5))
        return s**2


def residual(form: str, d: Real, X: Real, x_m: Real) -> mpf:
    """Residual overlap x*: where the unloading force vanishes, 0 if it does not."""
    with enough_digits(d):
        return _residual(form, mpf(d), mpf(X), mpf(x_m)) or mpf(0)


def _residual(form: str, d: mpf, X: mpf, x_m: mpf) -> mpf | None:
    return None if x_m <= 1 else FORMS[form].residual(d, X, x_m)


def plastic_squared(form: str, d: Real, X: Real, y: Real) -> mpf:
    """ε_p²: work of unloading over work of loading; 1 below yield, 0 without a turning point."""
    with enough_digits(d):
        d, X, y = mpf(d), mpf(X), mpf(y)
        if y <= 1:
            return mpf(1)
        x_m = peak(form, d, y)
        if x_m is None:
            return mpf(0)
        return 5 * unloading_work(form, d, X, x_m, residual(form, d, X, x_m)) / (2 * y**2)


def flags(form: str, d: Real, X: Real, y: Real) -> set[str]:
    """What is special about this collision as far as d, X and y tell."""
    with enough_digits(d):
        d, X, y = mpf(d), mpf(X), mpf(y)
        if y <= 1:
            return {"ELASTIC", "ZERO_VELOCITY"} if y == 0 else {"ELASTIC"}
        x_m = peak(form, d, y)
        if x_m is None:
            return {"NO_TURNING_POINT", "BEYOND_EXPANSION"}
        conditions = {
            "NO_RESIDUAL_OVERLAP": _residual(form, d, X, x_m) is None,
            "ENERGY_GAIN": plastic_squared(form, d, X, y) > 1,
            "BEYOND_EXPANSION": FORMS[form].beyond_expansion(d, x_m),
        }
        return {name for name, holds in conditions.items() if holds}


def duration(form: str, d: Real, X: Real, y: Real) -> mpf:
    """Contact time in δ_cr/v_cr: infinite at y = 0, NaN without a turning point.

    Up to yield y² - x^(5/2) = x'² gives an incomplete beta function, beyond it x'² is 5/2 of the
    work still to be done, or already given back.
    """
    with enough_digits(d):
        d, X, y = mpf(d), mpf(X), mpf(y)
        if y == 0:
            return mp.inf
        up_to_yield = min(y**-2, mpf(1))
        elastic = 2 * mp.betainc(mpf(2) / 5, mpf(1) / 2, 0, up_to_yield) / (5 * mp.root(y, 5))
        if y <= 1:
            return 2 * elastic
        x_m = peak(form, d, y)
        if x_m is None:
            return mp.nan
        law, x_star = FORMS[form], residual(form, d, X, x_m)
        plastic = _travel_time(law.loading_quotient(d, x_m), mpf(1), x_m)
        return elastic + plastic + _travel_time(law.unloading_quotient(d, X, x_m), x_star, x_m)


def _travel_time(mean_force: Callable[[mpf], mpf], x: mpf, x_m: mpf) -> mpf:
    """Time between overlap x and rest at x_m; x_m - x = length w² takes the root out of the end."""
    length = x_m - x
    integral = unit_integral(lambda w: 1 / mp.sqrt(mean_force(x_m - length * w**2)))
    return 2 * mp.sqrt(2 * length / 5) * integral
