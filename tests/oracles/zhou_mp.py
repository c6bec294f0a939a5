"""Zhou's contact law in high-precision arithmetic, independent of the library under test.

Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013). Good to 40 digits and more, durations to 25.
Nothing is shared with the library: roots are bracketed, works come from antiderivatives of their
own, durations from tanh-sinh quadrature, derivatives from central differences at 140 digits.

Results carry their digits, but arithmetic on them rounds to the caller's `mp.dps` (15 if never
set): work with them inside `mp.workdps(...)`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from mpmath import mp, mpf

# Root finding, polynomials and quadrature at any precision

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


# The two forms, in the scales of first yield: overlap x in units of the overlap at first yield, force
# in units of the force there, d = 3 δ_cr/(2A), X = χ̃ E/Y, x_m the peak overlap. For a contact that
# has yielded, x_m > 1, and loading beyond yield, x > 1. First-order forces are polynomials in √x and
# are integrated term by term; the full form's loading work comes from the arcsine antiderivative of
# (r² - t²)^(3/2), its unloading work from the mean of a linear function's power 3/2.

Quotient = Callable[[mpf], mpf]


class FirstOrder:
    """Eqs. (8) and (12): cos³θ expanded to first order."""

    @staticmethod
    def loading_coefficients(d: mpf) -> list[mpf]:
        return [-d, d, mpf(0), mpf(1), d, -d]  # Eq. (8) in powers of s

    @staticmethod
    def unloading_coefficients(d: mpf, X: mpf, x_m: mpf) -> list[mpf]:
        plastic = d * (x_m**2 - 1)
        return [plastic * (1 - X), d, plastic * X / x_m, 1 - d * x_m]  # Eq. (12) in powers of s

    def loading(self, d: mpf, x: mpf) -> mpf:
        """Loading force beyond yield, Eq. (8)."""
        return polynomial(self.loading_coefficients(d), mp.sqrt(x))

    def unloading(self, d: mpf, X: mpf, x_m: mpf, x: mpf) -> mpf:
        """Unloading force after yield, Eq. (12)."""
        return polynomial(self.unloading_coefficients(d, X, x_m), mp.sqrt(x))

    def loading_work(self, d: mpf, x: mpf) -> mpf:
        """Work of loading from 0 to x > 1, Eq. (9)."""
        work = work_polynomial(self.loading_coefficients(d))
        return mpf(2) / 5 + polynomial(work, mp.sqrt(x)) - polynomial(work, mpf(1))

    @staticmethod
    def loading_end(d: mpf) -> mpf:
        """Where the loading force vanishes: (s - s⁻³)(s - 1) = 1/d, whose left side grows."""

        def excess(s: mpf) -> tuple[mpf, mpf]:
            return (s - s**-3) * (s - 1) - 1 / d, (1 + 3 * s**-4) * (s - 1) + s - s**-3

        high = 2 + mp.sqrt(mpf("2.2") / d)
        return bracketed_root(excess, mpf(1), high, high) ** 2

    def residual(self, d: mpf, X: mpf, x_m: mpf) -> mpf | None:
        """Where the unloading force first vanishes on the way back, or None.

        By Descartes' rule the cubic in s has no zero in (0, s_m) for X <= 1 and one for X > 1,
        on both sides of d x_m = 1.
        """
        if X <= 1:
            return None
        force = self.unloading_coefficients(d, X, x_m)
        slope = [n * c for n, c in enumerate(force)][1:]
        s_m = mp.sqrt(x_m)
        return (
            bracketed_root(lambda s: (polynomial(force, s), polynomial(slope, s)), mpf(0), s_m, s_m)
            ** 2
        )

    def loading_quotient(self, d: mpf, x_m: mpf) -> Quotient:
        """Mean loading force between x and x_m, as a function of x."""
        return self._mean_force(self.loading_coefficients(d), x_m)

    def unloading_quotient(self, d: mpf, X: mpf, x_m: mpf) -> Quotient:
        """Mean unloading force between x and x_m, as a function of x."""
        return self._mean_force(self.unloading_coefficients(d, X, x_m), x_m)

    @staticmethod
    def _mean_force(force: list[mpf], x_m: mpf) -> Quotient:
        s_m = mp.sqrt(x_m)
        quotient = divided_difference(work_polynomial(force), s_m)

        def mean(x: mpf) -> mpf:
            s = mp.sqrt(x)
            return polynomial(quotient, s) / (s_m + s)

        return mean

    @staticmethod
    def beyond_expansion(d: mpf, x_m: mpf) -> bool:
        """d x_m > 1: the expansion's elastic part has changed sign."""
        return d * x_m > 1


class Full:
    """Eqs. (6) and (11): cos³θ kept; holds while the plastic radius is inside the contact."""

    @staticmethod
    def elastic_base(d: mpf, x: mpf) -> mpf:
        """x cos²θ: the elastic part of the loading force to the power 2/3.

        Rounding at the end of loading, where it is zero, must not make it negative.
        """
        return max(x - 2 * d / 3 * (x**2 - 1), mpf(0))

    @staticmethod
    def unloading_base(d: mpf, x_m: mpf, x: mpf) -> mpf:
        """The same of the unloading force: linear, from 2d/3 at x = 0 to the loading's at x_m."""
        return max((1 - 2 * d * x_m / 3) * x + 2 * d / 3, mpf(0))

    def loading(self, d: mpf, x: mpf) -> mpf:
        """Loading force beyond yield, Eq. (6)."""
        return mp.sqrt(self.elastic_base(d, x)) ** 3 + d * (x**2 - 1)

    def unloading(self, d: mpf, X: mpf, x_m: mpf, x: mpf) -> mpf:
        """Unloading force after yield, Eq. (11)."""
        elastic = mp.sqrt(self.unloading_base(d, x_m, x)) ** 3
        return elastic + d * (x_m**2 - 1) * (1 - X * (1 - x / x_m))

    def loading_work(self, d: mpf, x: mpf) -> mpf:
        """Work of loading from 0 to x > 1; the quadratic is completed to a (r² - t²), t = x - c."""
        a = 2 * d / 3
        c = 1 / (2 * a)
        r_squared = c**2 + 1

        def primitive(z: mpf) -> mpf:
            t = z - c
            q = mp.sqrt(self.elastic_base(d, z) / a)
            return t * q**3 / 4 + 3 * r_squared * (t * q + r_squared * mp.atan2(t, q)) / 8

        elastic = mp.sqrt(a) ** 3 * (primitive(x) - primitive(mpf(1)))
        return mpf(2) / 5 + elastic + d * ((x**3 - 1) / 3 - (x - 1))

    @staticmethod
    def loading_end(d: mpf) -> mpf:
        """The overlap where the plastic radius reaches the contact radius and the law ends."""
        a = 2 * d / 3
        return (1 + mp.sqrt(1 + 4 * a**2)) / (2 * a)

    def residual(self, d: mpf, X: mpf, x_m: mpf) -> mpf | None:
        """Where the unloading force first vanishes on the way back, or None.

        The force is convex in x and positive at x_m. Where it is positive at 0 too it can still dip
        below zero in between (only for d > 3.5): its zero next to x_m is then the end of contact.
        """
        tilt = 1 - 2 * d * x_m / 3
        line = d * (x_m**2 - 1) * X / x_m

        def force(x: mpf) -> tuple[mpf, mpf]:
            root = mp.sqrt(self.unloading_base(d, x_m, x))
            return self.unloading(d, X, x_m, x), 3 * tilt * root / 2 + line

        low = mpf(0)
        if force(low)[0] >= 0:
            if tilt >= 0:
                return None
            # slope 0: sqrt(base) = -2 line / (3 tilt)
            low = ((2 * line / (3 * tilt)) ** 2 - 2 * d / 3) / tilt
            if not 0 < low < x_m or force(low)[0] >= 0:
                return None
        return bracketed_root(force, low, x_m, x_m)

    def loading_quotient(self, d: mpf, x_m: mpf) -> Quotient:
        """Mean loading force between x and x_m; a difference of works, so at raised precision."""
        digits = mp.dps + 120
        with mp.workdps(digits):
            total = self.loading_work(d, x_m)

        def mean(x: mpf) -> mpf:
            with mp.workdps(digits):
                if x == x_m:
                    return self.loading(d, x_m)
                return (total - self.loading_work(d, x)) / (x_m - x)

        return mean

    def unloading_quotient(self, d: mpf, X: mpf, x_m: mpf) -> Quotient:
        """Mean unloading force between x and x_m.

        A linear function's power 3/2 has the mean (2/5)(r⁵ - q⁵)/(r² - q²) over an interval, r and
        q being its square roots at the ends; the common factor r - q is divided out.
        """
        plastic = d * (x_m**2 - 1)
        r = mp.sqrt(self.unloading_base(d, x_m, x_m))

        def mean(x: mpf) -> mpf:
            q = mp.sqrt(self.unloading_base(d, x_m, x))
            elastic = (r**4 + r**3 * q + r**2 * q**2 + r * q**3 + q**4) / (r + q)
            return 2 * elastic / 5 + plastic * (1 - X / 2 + X * x / (2 * x_m))

        return mean

    @staticmethod
    def beyond_expansion(d: mpf, x_m: mpf) -> bool:
        """The plastic radius is larger than the contact radius."""
        return 2 * d / 3 * (x_m**2 - 1) > x_m


FORMS: dict[str, FirstOrder | Full] = {"first-order": FirstOrder(), "full": Full()}


# A collision in these scales: y is the impact velocity in units of v_cr, time in units of δ_cr/v_cr.
# Then x'' = -(5/4) p(x), x(0) = 0, x'(0) = y.


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


# In SI. Inputs are dicts of floats (taken exactly), strings or mpf: the effective properties E, R, M,
# Y, v_lim of the contact, chi, sigma, psi, the impact velocity v, and the choices area ("zhou" |
# "hertz"), form ("first-order" | "full"), kappa ("consistent" | "printed").

Inputs = dict[str, Any]
Build = Callable[[Inputs], Inputs]

DIGITS = 140  # carried; a second difference at STEP leaves more than 60 of them
STEP = mpf("1e-30")  # relative; its square over (1 - y/y_max)² is the error of a difference
NUMBERS = ("E", "R", "M", "Y", "v_lim", "chi", "sigma", "psi", "v")
QUANTITIES = ("eps", "eps_squared", "eps_p_squared", "residual_overlap", "peak_overlap")


def _precise():
    return mp.workdps(max(mp.dps, DIGITS))


def scales(E: Real, R: Real, M: Real, Y: Real, area: str) -> dict[str, mpf]:
    """Stiffness k, and overlap and impact velocity at first yield, of an effective contact."""
    with _precise():
        E, R, M, Y = mpf(E), mpf(R), mpf(M), mpf(Y)
        A = {"hertz": mpf(1), "zhou": mp.pi ** (mpf(2) / 3)}[area] * R  # a² = A δ
        k = 4 * E * mp.sqrt(R) / 3  # Eq. (2)
        delta_cr = (2 * mp.pi * A * Y / (3 * k)) ** 2  # Eq. (5a): q_max = 3 P/(2 π a²) = Y
        v_cr = mp.sqrt(4 * k / (5 * M)) * delta_cr ** (mpf(5) / 4)  # Eq. (5b), with M itself
        return {"A": A, "k": k, "delta_cr": delta_cr, "v_cr": v_cr}


def contact(
    E1: Real,
    nu1: Real,
    rho1: Real,
    Y1: Real,
    R1: Real,
    E2: Real,
    nu2: Real,
    rho2: Real,
    Y2: Real,
    R2: Real | None,
    area: str = "zhou",
) -> dict[str, mpf]:
    """Effective properties and scales of two spheres, or of sphere 1 and a flat wall (R2 None)."""
    with _precise():
        E1, nu1, rho1, Y1, R1 = (mpf(z) for z in (E1, nu1, rho1, Y1, R1))
        E2, nu2, rho2, Y2 = (mpf(z) for z in (E2, nu2, rho2, Y2))
        R, M = R1, 4 * mp.pi * rho1 * R1**3 / 3
        if R2 is not None:
            R2 = mpf(R2)
            M2 = 4 * mp.pi * rho2 * R2**3 / 3
            R, M = R1 * R2 / (R1 + R2), M * M2 / (M + M2)
        E = 1 / ((1 - nu1**2) / E1 + (1 - nu2**2) / E2)
        Y = min(Y1, Y2)
        rho = (
            max(rho1, rho2) if Y1 == Y2 else (rho1 if Y1 < Y2 else rho2)
        )  # of the body that yields
        leaves = {"E": E, "R": R, "M": M, "Y": Y, "v_lim": mp.sqrt(3 * Y / rho)}
        return leaves | scales(E, R, M, Y, area)


def equal_spheres(inputs: Inputs) -> Inputs:
    """Effective inputs from those of two equal spheres: E, nu, rho, Y, R become the contact's."""
    own = [inputs[name] for name in ("E", "nu", "rho", "Y", "R")]
    pair = contact(*own, *own, area=inputs["area"])
    rest = {name: z for name, z in inputs.items() if name not in ("nu", "rho")}
    return rest | {name: pair[name] for name in ("E", "R", "M", "Y", "v_lim")}


def empirical(v: Real, v_lim: Real, sigma: Real, psi: Real) -> mpf:
    """ε of the losses that are not plastic, Eq. (17); 0 from the limit velocity on."""
    with _precise():
        v, v_lim = mpf(v), mpf(v_lim)
        if v >= v_lim:
            return mpf(0)
        return mp.exp(-mpf(sigma) * (v / (v_lim - v)) ** mpf(psi)) if v > 0 else mpf(1)


def dimensionless(inputs: Inputs) -> dict[str, mpf]:
    """d, X and y of an impact, with the scales of its contact."""
    with _precise():
        E, Y = mpf(inputs["E"]), mpf(inputs["Y"])
        unit = scales(E, inputs["R"], inputs["M"], Y, inputs["area"])
        if inputs["kappa"] == "printed":
            d = 24 * (mp.pi / 2) ** (mpf(8) / 3) * (Y / E) ** 2  # 2κ/3, κ as beneath Eq. (10)
        else:
            d = 3 * unit["delta_cr"] / (2 * unit["A"])
        return unit | {
            "d": d,
            "X": mpf(inputs["chi"]) * E / Y,
            "y": mpf(inputs["v"]) / unit["v_cr"],
        }


def coefficient(inputs: Inputs, *, lasts: bool = True) -> dict[str, Any]:
    """One impact: eps, eps_p, their squares, overlaps, duration (if `lasts`), flags.

    Without a turning point eps = eps_p = 0, both overlaps are where the loading ends and the
    duration is NaN; at rest (v = 0) the duration is infinite. eps_squared is never clipped.
    """
    with _precise():
        scale = dimensionless(inputs)
        d, X, y, form = scale["d"], scale["X"], scale["y"], inputs["form"]
        found = flags(form, d, X, y)
        x_m = peak(form, d, y)
        v, v_lim, loss = mpf(inputs["v"]), mpf(inputs["v_lim"]), (inputs["sigma"], inputs["psi"])
        eps_p_squared = plastic_squared(form, d, X, y)
        if x_m is None:
            eps_squared, x_m = mpf(0), loading_end(form, d)
            x_star = x_m
        else:
            x_star = residual(form, d, X, x_m)
            eps_squared = (
                empirical(min(v, scale["v_cr"]), v_lim, *loss) ** 2
            )  # ε_up, or ε_17 below yield
            eps_squared += eps_p_squared - 1  # Eq. (16)
        found |= {"NO_REBOUND"} if eps_squared < 0 else set()
        found |= {"ABOVE_LIMIT_VELOCITY"} if v >= v_lim else set()
        result = {
            "eps": mp.sqrt(max(eps_squared, mpf(0))),
            "eps_p": mp.sqrt(eps_p_squared),
            "eps_squared": eps_squared,
            "eps_p_squared": eps_p_squared,
            "peak_overlap": scale["delta_cr"] * x_m,
            "residual_overlap": scale["delta_cr"] * x_star,
            "flags": found,
        }
        if lasts:
            time = duration(form, d, X, y)
            result["duration"] = time * scale["delta_cr"] / scale["v_cr"]
        return result


def _as_given(inputs: Inputs) -> Inputs:
    return inputs


def _moved(inputs: Inputs, build: Build, **steps: mpf) -> dict[str, mpf]:
    """The impact with each named input times 1 + its step."""
    moved = inputs | {name: mpf(inputs[name]) * (1 + step) for name, step in steps.items()}
    result = coefficient(build(moved), lasts=False)
    return {name: result[name] for name in QUANTITIES}


def log_sensitivities(
    inputs: Inputs, names: Iterable[str] = NUMBERS, build: Build = _as_given
) -> dict[str, dict[str, mpf]]:
    """θ ∂q/∂θ for each θ in names: {θ: {q: value}}, q in QUANTITIES, by central differences.

    `build` maps the inputs to effective ones: `equal_spheres` for properties of a material.
    """
    with _precise():
        table = {}
        for name in names:
            above = _moved(inputs, build, **{name: STEP})
            below = _moved(inputs, build, **{name: -STEP})
            table[name] = {q: (above[q] - below[q]) / (2 * STEP) for q in QUANTITIES}
        return table


def second(inputs: Inputs, a: str, b: str, build: Build = _as_given) -> dict[str, mpf]:
    """θ_a θ_b ∂²q/∂θ_a∂θ_b for q in QUANTITIES, by central differences."""
    with _precise():
        if a == b:
            above, here, below = (_moved(inputs, build, **{a: h}) for h in (STEP, mpf(0), -STEP))
            return {q: (above[q] - 2 * here[q] + below[q]) / STEP**2 for q in QUANTITIES}
        total = dict.fromkeys(QUANTITIES, mpf(0))
        for i in (1, -1):
            for j in (1, -1):
                corner = _moved(inputs, build, **{a: i * STEP, b: j * STEP})
                total = {q: total[q] + i * j * corner[q] / (4 * STEP**2) for q in QUANTITIES}
        return total
