"""The two forms of Zhou's law in the scales of first yield, written for high precision.

Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013). Overlap x in units of the overlap at first yield,
force in units of the force there, d = 3 δ_cr/(2A), X = χ̃ E/Y, x_m the peak overlap. Everything here
is for a contact that has yielded, x_m > 1, and for loading beyond yield, x > 1.

Works and roots are not taken from closed forms of the source: first-order forces are polynomials
in s = √x and are integrated term by term; the full form's loading work comes from the arcsine
antiderivative of (r² - t²)^(3/2), its unloading work from the mean of a linear function's power
3/2.
"""

from __future__ import annotations

from collections.abc import Callable

from mpmath import mp, mpf

from .numeric_mp import bracketed_root, divided_difference, polynomial, work_polynomial

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
