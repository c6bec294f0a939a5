"""Zhou's contact law in high-precision arithmetic, independent of the library under test.

Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013). Good to 40 digits and more, durations to 25.
Nothing is shared with the library: roots are bracketed, works come from antiderivatives of their
own, durations from tanh-sinh quadrature, derivatives from central differences at 140 digits.

Results carry their digits, but arithmetic on them rounds to the caller's `mp.dps` (15 if never
set): work with them inside `mp.workdps(...)`.
"""

import math
from functools import reduce, wraps

import numpy as np
from mpmath import mp, mpf

QUADRATURE_DIGITS = 34  # what a duration is integrated to; its quadrature must certify 28 of them
DIGITS = 140  # carried in SI; a second difference at STEP leaves more than 60 of them
STEP = mpf("1e-30")  # relative; its square over (1 - y/y_max)² is the error of a difference
NUMBERS = ("E", "R", "M", "Y", "v_lim", "chi", "sigma", "psi", "v")
QUANTITIES = ("eps", "eps_squared", "eps_p_squared", "residual_overlap", "peak_overlap")


def bracketed_root(f, low, high, x):
    """Root of f between low (f < 0) and high (f > 0), where f gives value and slope.

    Newton's iteration inside a shrinking bracket, bisection wherever Newton leaves it or does not
    at least halve its step.
    """
    step, tolerance = high - low, mpf(10) ** (-(6 * mp.dps) // 10)
    for _ in range(40 * mp.dps):
        value, slope = f(x)
        low, high = (x, high) if value < 0 else (low, x)
        new = x - value / slope if slope > 0 else low
        if abs(new - x) <= tolerance * abs(x):  # what is left converges quadratically
            value, slope = f(new)
            return min(max(new - value / slope, low), high) if slope > 0 else new
        if not low < new < high or 2 * abs(new - x) > abs(step):
            new = (low + high) / 2
        step, x = new - x, new
    raise ArithmeticError("the bracketed root did not converge")


def polynomial(coefficients, s):
    return reduce(lambda total, c: total * s + c, reversed(coefficients))


def work_polynomial(force):
    """Antiderivative of force(s) dx with x = s², dx = 2 s ds, term by term."""
    return [mpf(0), mpf(0)] + [2 * c / (n + 2) for n, c in enumerate(force)]


# The two forms beyond yield, in the scales of first yield: overlap x in units of the overlap at first
# yield, force in units of the force there, d = 3 δ_cr/(2A), X = χ̃ E/Y, x_m > 1 the peak overlap.


class FirstOrder:
    """Eqs. (8) and (12): cos³θ expanded to first order, polynomials in s = √x."""

    def _loading(self, d):
        return [-d, d, mpf(0), mpf(1), d, -d]

    def _unloading(self, d, X, x_m):
        plastic = d * (x_m**2 - 1)
        return [plastic * (1 - X), d, plastic * X / x_m, 1 - d * x_m]

    def loading(self, d, x):
        return polynomial(self._loading(d), mp.sqrt(x))

    def unloading(self, d, X, x_m, x):
        return polynomial(self._unloading(d, X, x_m), mp.sqrt(x))

    def loading_work(self, d, x):
        """From 1, Eq. (9)."""
        work = work_polynomial(self._loading(d))
        return polynomial(work, mp.sqrt(x)) - polynomial(work, mpf(1))

    def unloading_work(self, d, X, x_m, x):
        """From x_m back to x."""
        work = work_polynomial(self._unloading(d, X, x_m))
        return polynomial(work, mp.sqrt(x_m)) - polynomial(work, mp.sqrt(x))

    def loading_end(self, d):
        """Where the loading force vanishes: (s - s⁻³)(s - 1) = 1/d, whose left side grows."""

        def excess(s):
            return (s - s**-3) * (s - 1) - 1 / d, (1 + 3 * s**-4) * (s - 1) + s - s**-3

        high = 2 + mp.sqrt(mpf("2.2") / d)
        return bracketed_root(excess, mpf(1), high, high) ** 2

    def residual(self, d, X, x_m):
        """By Descartes' rule the cubic in s has no zero in (0, s_m) for X <= 1 and one for X > 1."""
        if X <= 1:
            return mpf(0)
        force = self._unloading(d, X, x_m)
        slope = [n * c for n, c in enumerate(force)][1:]
        s_m = mp.sqrt(x_m)
        value = lambda s: (polynomial(force, s), polynomial(slope, s))  # noqa: E731
        return bracketed_root(value, mpf(0), s_m, s_m) ** 2

    def beyond_expansion(self, d, x_m):
        """The expansion's elastic part has changed sign."""
        return d * x_m > 1


class Full:
    """Eqs. (6) and (11): cos³θ kept; holds while the plastic radius is inside the contact."""

    def _elastic(self, d, x):
        """x cos²θ: the elastic part of the loading force to the power 2/3; no rounding below zero."""
        return max(x - 2 * d / 3 * (x**2 - 1), mpf(0))

    def _base(self, d, x_m, x):
        """The same of the unloading force: linear, from 2d/3 at x = 0 to the loading's at x_m."""
        return max((1 - 2 * d * x_m / 3) * x + 2 * d / 3, mpf(0))

    def loading(self, d, x):
        return mp.sqrt(self._elastic(d, x)) ** 3 + d * (x**2 - 1)

    def unloading(self, d, X, x_m, x):
        elastic = mp.sqrt(self._base(d, x_m, x)) ** 3
        return elastic + d * (x_m**2 - 1) * (1 - X * (1 - x / x_m))

    def loading_work(self, d, x):
        """From 1; the quadratic is completed to a (r² - t²), t = x - c, for an arcsine's primitive."""
        a = 2 * d / 3
        c = 1 / (2 * a)
        r_squared = c**2 + 1

        def primitive(z):
            t, q = z - c, mp.sqrt(self._elastic(d, z) / a)
            return t * q**3 / 4 + 3 * r_squared * (t * q + r_squared * mp.atan2(t, q)) / 8

        elastic = mp.sqrt(a) ** 3 * (primitive(x) - primitive(mpf(1)))
        return elastic + d * ((x**3 - 1) / 3 - (x - 1))

    def unloading_work(self, d, X, x_m, x):
        """A linear function's power 3/2 has the mean (2/5)(r⁵ - q⁵)/(r² - q²), r - q divided out."""
        r, q = (mp.sqrt(self._base(d, x_m, at)) for at in (x_m, x))
        elastic = (r**4 + r**3 * q + r**2 * q**2 + r * q**3 + q**4) / (r + q)
        plastic = d * (x_m**2 - 1) * (1 - X / 2 + X * x / (2 * x_m))
        return (2 * elastic / 5 + plastic) * (x_m - x)

    def loading_end(self, d):
        """Where the plastic radius reaches the contact radius."""
        a = 2 * d / 3
        return (1 + mp.sqrt(1 + 4 * a**2)) / (2 * a)

    def residual(self, d, X, x_m):
        """The force is convex in x and positive at x_m.

        Where it is positive at 0 too it can still dip below zero in between (only for d > 3.5): its
        zero next to x_m is then the end of contact.
        """
        tilt, line = 1 - 2 * d * x_m / 3, d * (x_m**2 - 1) * X / x_m

        def force(x):
            root = mp.sqrt(self._base(d, x_m, x))
            return self.unloading(d, X, x_m, x), 3 * tilt * root / 2 + line

        low = mpf(0)
        if force(low)[0] >= 0:
            if tilt >= 0:
                return low
            low = ((2 * line / (3 * tilt)) ** 2 - 2 * d / 3) / tilt  # where the slope is 0
            if not 0 < low < x_m or force(low)[0] >= 0:
                return mpf(0)
        return bracketed_root(force, low, x_m, x_m)

    def beyond_expansion(self, d, x_m):
        """The plastic radius is larger than the contact radius."""
        return 2 * d / 3 * (x_m**2 - 1) > x_m


FORMS = {"first-order": FirstOrder(), "full": Full()}

# A collision in these scales: y is the impact velocity in units of v_cr, time in units of δ_cr/v_cr.
# Then x'' = -(5/4) p(x), x(0) = 0, x'(0) = y.


def precise(function):
    """Of a form, d and other numbers, with 120 digits, and more where the full form's work cancels.

    Its antiderivative has terms of size d^(-5/2) that cancel to one of size 1.
    """

    @wraps(function)
    def found(form, d, *others):
        small = max(0, math.ceil(-float(mp.log10(mpf(d)))))
        with mp.workdps(max(mp.dps, 120 + 4 * small)):
            return function(form, mpf(d), *map(mpf, others))

    return found


@precise
def loading(form, d, x):
    """Force of loading."""
    return mp.sqrt(x) ** 3 if x <= 1 else FORMS[form].loading(d, x)


@precise
def unloading(form, d, X, x_m, x):
    """Force of unloading from the peak overlap x_m."""
    return mp.sqrt(x) ** 3 if x_m <= 1 else FORMS[form].unloading(d, X, x_m, x)


@precise
def loading_end(form, d):
    """Largest overlap of loading: its force vanishes (first-order) or the law ends (full)."""
    return FORMS[form].loading_end(d)


@precise
def y_max(form, d):
    """Impact velocity whose turning point is the end of loading; none turns above it."""
    return mp.sqrt(1 + 5 * FORMS[form].loading_work(d, loading_end(form, d)) / 2)


@precise
def peak(form, d, y):
    """Peak overlap x_m, or None where the loading has no turning point."""
    if y <= 1:
        return y ** (mpf(4) / 5)
    law, end, energy = FORMS[form], loading_end(form, d), 2 * (y**2 - 1) / 5
    if law.loading_work(d, end) < energy:
        return None

    def lacking(s):
        return law.loading_work(d, s**2) - energy, 2 * s * law.loading(d, s**2)

    high = mp.sqrt(end)
    return bracketed_root(lacking, mpf(1), high, min(y ** (mpf(2) / 5), high)) ** 2


@precise
def residual(form, d, X, x_m):
    """Residual overlap x*: where the unloading force first vanishes on the way back, 0 if it does not."""
    return mpf(0) if x_m <= 1 else FORMS[form].residual(d, X, x_m)


@precise
def plastic_squared(form, d, X, y):
    """ε_p²: work of unloading over work of loading; 1 below yield, 0 without a turning point."""
    if y <= 1:
        return mpf(1)
    x_m = peak(form, d, y)
    if x_m is None:
        return mpf(0)
    return 5 * FORMS[form].unloading_work(d, X, x_m, residual(form, d, X, x_m)) / (2 * y**2)


@precise
def flags(form, d, X, y):
    """What is special about this collision as far as d, X and y tell."""
    if y <= 1:
        return {"ELASTIC", "ZERO_VELOCITY"} if y == 0 else {"ELASTIC"}
    x_m = peak(form, d, y)
    if x_m is None:
        return {"NO_TURNING_POINT", "BEYOND_EXPANSION"}
    conditions = {
        "NO_RESIDUAL_OVERLAP": residual(form, d, X, x_m) == 0,
        "ENERGY_GAIN": plastic_squared(form, d, X, y) > 1,
        "BEYOND_EXPANSION": FORMS[form].beyond_expansion(d, x_m),
    }
    return {name for name, holds in conditions.items() if holds}


@precise
def duration(form, d, X, y):
    """Contact time in δ_cr/v_cr: infinite at y = 0, NaN without a turning point.

    Up to yield y² - x^(5/2) = x'² gives an incomplete beta function, beyond it x'² is 5/2 of the
    work still to be done, or already given back.
    """
    if y == 0:
        return mp.inf
    up_to_yield = min(y**-2, mpf(1))
    elastic = 2 * mp.betainc(mpf(2) / 5, mpf(1) / 2, 0, up_to_yield) / (5 * mp.root(y, 5))
    if y <= 1:
        return 2 * elastic
    x_m = peak(form, d, y)
    if x_m is None:
        return mp.nan
    law = FORMS[form]
    with mp.workdps(mp.dps + 120):  # of differences of works
        top = law.loading_work(d, x_m)
    there = _travel_time(lambda x: top - law.loading_work(d, x), mpf(1), x_m)
    rest = residual(form, d, X, x_m)
    return elastic + there + _travel_time(lambda x: law.unloading_work(d, X, x_m, x), rest, x_m)


def _travel_time(work, x, x_m):
    """Between overlap x and rest at x_m; x_m - x = length w² takes the root out of the end."""
    length, digits = x_m - x, mp.dps + 120

    def integrand(w):
        with mp.workdps(digits):
            return w / mp.sqrt(work(x_m - length * w**2))

    with mp.workdps(QUADRATURE_DIGITS):
        for points in ([0, 1], [0, mpf("1e-4"), mpf("1e-2"), 1]):
            value, error = mp.quad(integrand, points, error=True)
            if error <= abs(value) * mpf("1e-28"):
                return 2 * length * value / mp.sqrt(mpf("2.5"))
    raise ArithmeticError(f"quadrature reached {mp.nstr(error, 3)} only")


# In SI. Inputs are dicts of floats (taken exactly), strings or mpf: the effective properties E, R, M,
# Y, v_lim of the contact, chi, sigma, psi, the impact velocity v, and the choices area ("zhou" |
# "hertz"), form ("first-order" | "full"), kappa ("consistent" | "printed").


def in_si(function):
    @wraps(function)
    def found(*given, **more):
        with mp.workdps(max(mp.dps, DIGITS)):
            return function(*given, **more)

    return found


@in_si
def scales(E, R, M, Y, area):
    """Stiffness k, and overlap and impact velocity at first yield, of an effective contact."""
    E, R, M, Y = (mpf(z) for z in (E, R, M, Y))
    A = {"hertz": mpf(1), "zhou": mp.pi ** (mpf(2) / 3)}[area] * R  # a² = A δ
    k = 4 * E * mp.sqrt(R) / 3  # Eq. (2)
    delta_cr = (2 * mp.pi * A * Y / (3 * k)) ** 2  # Eq. (5a): q_max = 3 P/(2 π a²) = Y
    v_cr = mp.sqrt(4 * k / (5 * M)) * delta_cr ** (mpf(5) / 4)  # Eq. (5b), with M itself
    return {"A": A, "k": k, "delta_cr": delta_cr, "v_cr": v_cr}


@in_si
def contact(E1, nu1, rho1, Y1, R1, E2, nu2, rho2, Y2, R2, area="zhou"):
    """Effective properties and scales of two spheres, or of sphere 1 and a flat wall (R2 None)."""
    E1, nu1, rho1, Y1, R1 = (mpf(z) for z in (E1, nu1, rho1, Y1, R1))
    E2, nu2, rho2, Y2 = (mpf(z) for z in (E2, nu2, rho2, Y2))
    R, M = R1, 4 * mp.pi * rho1 * R1**3 / 3
    if R2 is not None:
        R2 = mpf(R2)
        M2 = 4 * mp.pi * rho2 * R2**3 / 3
        R, M = R1 * R2 / (R1 + R2), M * M2 / (M + M2)
    E = 1 / ((1 - nu1**2) / E1 + (1 - nu2**2) / E2)
    Y, rho = min((Y1, -rho1), (Y2, -rho2))  # of the body that yields, the denser of equal ones
    leaves = {"E": E, "R": R, "M": M, "Y": Y, "v_lim": mp.sqrt(3 * Y / -rho)}
    return leaves | scales(E, R, M, Y, area)


def equal_spheres(inputs):
    """Effective inputs from those of two equal spheres: E, nu, rho, Y, R become the contact's."""
    values = [inputs[name] for name in ("E", "nu", "rho", "Y", "R")]
    pair = contact(*values, *values, area=inputs["area"])
    rest = {name: z for name, z in inputs.items() if name not in ("nu", "rho")}
    return rest | {name: pair[name] for name in ("E", "R", "M", "Y", "v_lim")}


@in_si
def empirical(v, v_lim, sigma, psi):
    """ε of the losses that are not plastic, Eq. (17); 0 from the limit velocity on."""
    v, v_lim = mpf(v), mpf(v_lim)
    if v >= v_lim:
        return mpf(0)
    return mp.exp(-mpf(sigma) * (v / (v_lim - v)) ** mpf(psi)) if v > 0 else mpf(1)


@in_si
def dimensionless(inputs):
    """d, X and y of an impact, with the scales of its contact."""
    E, Y = mpf(inputs["E"]), mpf(inputs["Y"])
    unit = scales(E, inputs["R"], inputs["M"], Y, inputs["area"])
    d = 3 * unit["delta_cr"] / (2 * unit["A"])
    if inputs["kappa"] == "printed":
        d = 24 * (mp.pi / 2) ** (mpf(8) / 3) * (Y / E) ** 2  # 2κ/3, κ as beneath Eq. (10)
    return unit | {"d": d, "X": mpf(inputs["chi"]) * E / Y, "y": mpf(inputs["v"]) / unit["v_cr"]}


@in_si
def coefficient(inputs, *, lasts=True):
    """One impact: eps, eps_p, their squares, overlaps, duration (if `lasts`), flags.

    Without a turning point eps = eps_p = 0, both overlaps are where the loading ends and the
    duration is NaN; at rest (v = 0) the duration is infinite. eps_squared is never clipped.
    """
    scale = dimensionless(inputs)
    form, d, X, y = inputs["form"], scale["d"], scale["X"], scale["y"]
    found, x_m, eps_p_squared = (
        flags(form, d, X, y),
        peak(form, d, y),
        plastic_squared(form, d, X, y),
    )
    v, v_lim = mpf(inputs["v"]), mpf(inputs["v_lim"])
    if x_m is None:
        eps_squared = mpf(0)
        x_m = x_star = loading_end(form, d)
    else:
        x_star = residual(form, d, X, x_m)  # then Eq. (16): ε_up, or ε_17 below yield
        up = empirical(min(v, scale["v_cr"]), v_lim, inputs["sigma"], inputs["psi"])
        eps_squared = up**2 + eps_p_squared - 1
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
        result["duration"] = duration(form, d, X, y) * scale["delta_cr"] / scale["v_cr"]
    return result


def _at(inputs, build):
    """The quantities of the impact with each named input times 1 + its step."""

    def values(steps):
        moved = inputs | {name: mpf(inputs[name]) * (1 + step) for name, step in steps.items()}
        result = coefficient(build(moved), lasts=False)
        return np.array([result[name] for name in QUANTITIES])

    return values


@in_si
def log_sensitivities(inputs, names=NUMBERS, build=dict):
    """θ ∂q/∂θ for each θ in names: {θ: {q: value}}, q in QUANTITIES, by central differences.

    `build` maps the inputs to effective ones: `equal_spheres` for properties of a material.
    """
    at = _at(inputs, build)
    slopes = {name: (at({name: STEP}) - at({name: -STEP})) / (2 * STEP) for name in names}
    return {name: dict(zip(QUANTITIES, each, strict=True)) for name, each in slopes.items()}


@in_si
def second(inputs, a, b, build=dict):
    """θ_a θ_b ∂²q/∂θ_a∂θ_b for q in QUANTITIES, by central differences."""
    return dict(zip(QUANTITIES, mixed(_at(inputs, build), a, b, STEP), strict=True))


def mixed(value, a, b, step):
    """The second derivative of `value` of steps by name with those of a and b, which may be one."""

    def corner(i, j):
        steps = {a: i * step}
        return i * j * value(steps | {b: steps.get(b, 0) + j * step})

    return sum(corner(i, j) for i in (1, -1) for j in (1, -1)) / (4 * step**2)
