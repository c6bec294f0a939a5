"""Hard impacts, each with its reason and the status that physics gives it, and how they are rounded.

What they come out as is in `oracles/hard_cases.json`, written by `python -m
tests.oracles.write_hard_cases` in high-precision arithmetic, for the inputs rounded to float64 and
for the same rounded to float32. A row that float32 cannot hold, or the ODE cannot tell, says why.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpmath import mp, mpf

import softjax as sj
from tests import cases
from tests.oracles import zhou_mp as z

Inputs = dict[str, Any]
PRECISIONS = {"float64": np.float64, "float32": np.float32}


@dataclass(frozen=True)
class Ulps:
    """A number and how many units in the last place beside it, in whichever precision."""

    base: float
    count: int

    def rounded(self, dtype) -> float:
        return _step(dtype(self.base), self.count)


@dataclass(frozen=True)
class AtYield:
    """v_cr as the library computes it in that precision, and ulps beside it."""

    count: int


@dataclass(frozen=True)
class Case:
    """One hard impact.

    Attributes:
        inputs: E, R, M, Y, v_lim, chi, sigma, psi in SI; v [m/s], or y = v/v_cr as a number or a
            function of (form, d); sigma may be a function of all others.
        flags: names of the status flags, from physics alone.
        float32: why float32 cannot hold it, if so.
        ode: how many tolerances its gradient by the ODE may be off beyond the bound.
    """

    name: str
    reason: str
    inputs: Inputs
    flags: tuple[str, ...] = ()
    form: str = "first-order"
    float32: str | None = None
    ode: float = 0.0

    def rounded(self, precision: str) -> Inputs:
        """The inputs as that precision holds them, v included."""
        dtype = PRECISIONS[precision]
        given = {k: v for k, v in self.inputs.items() if k not in ("v", "y", "sigma")}
        own = {k: _rounded(v, dtype) for k, v in given.items()}
        own |= {"area": "zhou", "kappa": "consistent", "form": self.form}
        own["v"] = float(dtype(self._velocity(own, dtype)))
        sigma = self.inputs["sigma"]
        own["sigma"] = float(dtype(sigma(own) if callable(sigma) else sigma))
        return own

    @property
    def at_yield(self) -> int | None:
        """Ulps from v_cr, where the row is at yield."""
        v = self.inputs.get("v")
        return v.count if isinstance(v, AtYield) else None

    def _velocity(self, own: Inputs, dtype):
        v = self.inputs.get("v")
        if isinstance(v, AtYield):
            return _step(dtype(_library_critical_velocity(own, dtype)), v.count)
        if v is not None:
            return _rounded(v, dtype)
        y = self.inputs["y"]
        with mp.workdps(60):
            scale = z.dimensionless(own | {"v": 1})
            return float((y(self.form, scale["d"]) if callable(y) else mpf(y)) * scale["v_cr"])


def _rounded(value, dtype) -> float:
    return value.rounded(dtype) if isinstance(value, Ulps) else float(dtype(value))


def _step(value, count: int) -> float:
    for _ in range(abs(count)):
        value = np.nextafter(value, type(value)(math.inf if count > 0 else -math.inf))
    return float(value)


def _library_critical_velocity(own: Inputs, dtype):
    names = ("E", "R", "M", "Y", "v_lim")
    contact = sj.Contact(*(np.asarray(own[name], dtype) for name in names))
    return np.asarray(contact.critical_velocity)


def of_turning_point(share: float | str) -> Callable:
    """y as a share of y_max."""
    return lambda form, d: mpf(share) * z.y_max(form, d)


def of_expansion(product: str) -> Callable:
    """y at which d x_m is `product`."""

    def y(form, d):
        with mp.workdps(60):
            return mp.sqrt(5 * z.loading_work(form, d, mpf(product) / d) / 2)

    return y


def of_threshold(X: float, share: str) -> Callable:
    """y at which (x_m² - 1)(X - 1) is a share of (2/3)^{3/2} √d: the full form's last root."""

    def y(form, d):
        with mp.workdps(60):
            least = mpf(share) * mp.sqrt(mpf(8) / 27 * d) / (mpf(X) - 1)
            return mp.sqrt(5 * z.loading_work(form, d, mp.sqrt(1 + least)) / 2)

    return y


def leaving(rest: str) -> Callable:
    """σ with which ε_p² + ε_up² - 1 is `rest` above yield."""

    def sigma(own):
        with mp.workdps(60):
            at = z.dimensionless(own)
            back = z.plastic_squared(own["form"], at["d"], at["X"], at["y"])
            slowness = at["v_cr"] / (own["v_lim"] - at["v_cr"])
            return -mp.log(1 + mpf(rest) - back) / 2 / slowness ** own["psi"]

    return sigma


def material(name: str, **changed) -> Inputs:
    """Two equal spheres of Table 1 with the fitted χ̃."""
    contact = cases.pair(name)
    leaves = dict(zip(("E", "R", "M", "Y", "v_lim"), contact.leaves().values(), strict=True))
    return leaves | cases.FITTED[name] | changed


def ratio(E_over_Y: float, X: float | Ulps, **changed) -> Inputs:
    """A contact of the given E/Y and X = χ̃ E/Y; losses of sound and heat as for nylon."""
    chi = Ulps(X.base / E_over_Y, X.count) if isinstance(X, Ulps) else X / E_over_Y
    contact = {"E": E_over_Y * 2.0**27, "R": 0.01, "M": 0.02, "Y": 2.0**27, "v_lim": 5e4}
    return contact | {"chi": chi, "sigma": 0.4355, "psi": 0.5414} | changed


def size(radius: float, y: float) -> Inputs:
    """Chrome steel spheres of another radius."""
    steel = sj.CHROME_STEEL
    contact = sj.Contact.between_spheres(steel, steel, radius, radius)
    leaves = dict(zip(("E", "R", "M", "Y", "v_lim"), contact.leaves().values(), strict=True))
    return leaves | cases.FITTED["chrome steel"] | {"y": y}


STEEL, CHROME, NYLON = "stainless steel", "chrome steel", "nylon"
ELASTIC, AT_REST = "ELASTIC", "ZERO_VELOCITY"
OPEN, GAIN, STUCK = "NO_RESIDUAL_OVERLAP", "ENERGY_GAIN", "NO_REBOUND"
BEYOND, LOST, FAST = "BEYOND_EXPANSION", "NO_TURNING_POINT", "ABOVE_LIMIT_VELOCITY"

DIGITS = "needs inputs of more than float32's seven digits"
RANGE = "float32 ends at 3.4e38 and 1.2e-38"
# `ode` in tolerances: where √x* has just left 0 it moves up to 1e7 times faster than θ, and with it
# what the tolerance costs the ODE's gradient: measured 2e-4 at 1e-12 from the threshold and 3e-10
# at 1e-3 from it (rtol 1e-11). Just above yield at X = 637 it is 4e-4 in float32.
# How near y_max the ODE can tell whether the bodies turn, measured for E/Y from 2 to 1e4: to 1e-10
# at the default rtol = 1e-8, to 1e-13 at the rtol = 1e-11 of these tests, float32 to 3e-7.
NEAR = "y = {} y_max, where the condition number is (1 - y/y_max)^{{-1/2}}"


def both(name: str, reason: str, inputs, *flags: str, **more) -> tuple[Case, Case]:
    """The same row for both forms of the law."""
    first = Case(name, reason, inputs, flags, **more)
    return first, replace(first, name=f"{name}, full", form="full")


# fmt: off
AT_YIELD = (
    *both('v one ulp below v_cr', 'last elastic impact', material(NYLON, v=AtYield(-1)), ELASTIC),
    *both('v = v_cr', 'y <= 1 is elastic, and v_cr itself too', material(NYLON, v=AtYield(0)), ELASTIC),
    Case('v one ulp above v_cr', 'ε_p² jumps by 2d/3', material(NYLON, v=AtYield(1)), (GAIN,)),
    Case('v one ulp above v_cr, full', 'jumps too, and has no root of p_U yet though X > 1', material(NYLON, v=AtYield(1)), (OPEN, GAIN), form='full'),
    Case('v = v_cr, steel', 'the same of other digits', material(STEEL, v=AtYield(0)), (ELASTIC,)),
    Case('one ulp above, steel', '2d/3 = 4e-5', material(STEEL, v=AtYield(1)), (GAIN,), ode=1000.0),
    Case('v = v_cr, chrome', 'the same of other digits', material(CHROME, v=AtYield(0)), (ELASTIC,)),
    Case('one ulp above, chrome', '2d/3 = 2e-3', material(CHROME, v=AtYield(1)), (GAIN,)),
)
VELOCITIES = (
    Case('at rest, ψ < 1', '∂ε/∂v is infinite', material(NYLON, v=0.0), (ELASTIC, AT_REST)),
    Case('at rest, ψ = 1', '∂ε/∂v is finite', material(NYLON, psi=1.0, v=0.0), (ELASTIC, AT_REST)),
    Case('at rest, no losses', 'σ = 0', material(NYLON, sigma=0.0, v=0.0), (ELASTIC, AT_REST)),
    *(Case(f'v = {v:g}', 'no zero, and √v too', material(NYLON, v=v), (ELASTIC,), float32=RANGE) for v in (1e-300, 1e-200, 1e-100)),
    *(Case(f'v = {v:g}', 'no zero, and √v too', material(STEEL, v=v), (ELASTIC,)) for v in (1e-37, 1e-20, 1e-08, 0.0001)),
    *both('elastic', 'half of v_cr', material(NYLON, y=0.5), ELASTIC),
    Case('losses underflow', 'ε_17 = e^{-4400}', material(NYLON, sigma=100000.0, y=0.9), (ELASTIC,)),
    Case('v_lim less an ulp', 'Eq. (17) acts at v_cr only', material(STEEL, v=339.0)),
    Case('v = v_lim', 'Eq. (16) knows no v_lim', material(STEEL, v=400.0, v_lim=400.0), (FAST,)),
    Case('v = 2 v_lim', 'Eq. (16) still', material(STEEL, v=680.0), (FAST,)),
    Case('v > 2 v_lim', 'beyond the expansion as well', material(STEEL, y=of_expansion('1.003'), sigma=0.0), (FAST, BEYOND)),
    Case('v = 1000 m/s', 'beyond y_max as well', material(STEEL, v=1000.0), (FAST, LOST, BEYOND)),
    Case('v = 1e30 m/s', 'far beyond', material(STEEL, v=1e+30), (FAST, LOST, BEYOND)),
    Case('v = 1e300 m/s', 'v² overflows', material(STEEL, v=1e+300), (FAST, LOST, BEYOND), float32=RANGE),
    Case('elastic, v just below v_lim', 'the ratio in Eq. (17) has a pole', material(NYLON, v_lim=0.5, v=Ulps(0.5, -1)), (ELASTIC,)),
    Case('elastic, v = v_lim', 'ε_17 = 0', material(NYLON, v_lim=0.5, v=0.5), (ELASTIC, FAST)),
    Case('elastic, v > v_lim', 'ε_17 = 0', material(NYLON, v_lim=0.5, v=0.6), (ELASTIC, FAST)),
    Case('v_cr > v_lim', 'ε_up = 0: nothing is left', material(NYLON, v_lim=0.5, y=9.0), (FAST, STUCK)),
)
UNLOADING = (
    Case('printed χ̃ of nylon', 'three conditions in one', material(NYLON, chi=0.016, y=3.0), (OPEN, GAIN)),
    Case('printed χ̃ of nylon, y = 20', 'gains still', material(NYLON, chi=0.016, y=20.0), (OPEN, GAIN)),
    Case('printed χ̃ of nylon, y = 23', 'no more', material(NYLON, chi=0.016, y=23.0), (OPEN,)),
    *both('χ̃ = 0', 'nothing is lost but by the rim', ratio(64.0, 0.0, y=3.0), OPEN, GAIN),
    *both('X = 1e-6', 'nearly the same', ratio(64.0, 1e-06, y=3.0), OPEN, GAIN),
    *both('X = 0.5, y = 40', 'no root of p_U', ratio(200.0, 0.5, y=40.0), OPEN),
    *both('X = 1', 'p_U vanishes at x = 0 (full: not even)', ratio(64.0, 1.0, y=8.0), OPEN),
    Case('X = 1 less an ulp', 'no root', ratio(64.0, Ulps(1.0, -1), y=8.0), (OPEN,)),
    Case('X = 1 and an ulp', 'x* = 1e-31', ratio(64.0, Ulps(1.0, 1), y=8.0)),
    *both('X = 3', 'plain', ratio(64.0, 3.0, y=8.0)),
    *both('X = 100', 'plain', ratio(200.0, 100.0, sigma=0.1, y=20.0)),
    *both('X = 1e4', 'x* near x_m', ratio(200.0, 10000.0, sigma=0.0, y=20.0)),
    *both('X = 1e8', 'ε_p² = 1e-7: unloading short and stiff', ratio(200.0, 100000000.0, sigma=0.0, y=20.0)),
    *both('X = 1e8, just yields', 'both at once', ratio(200.0, 100000000.0, sigma=0.0, y=1.0001)),
    *both('X = 1e8, y = 900', 'the most plastic', ratio(10000.0, 100000000.0, sigma=0.0, y=900.0)),
    Case("full form's last root, below", 'p_U(0) > 0 though X > 1', ratio(64.0, 2.0, y=of_threshold(2.0, '0.999')), (OPEN, GAIN), form='full'),
    Case("full form's last root, above", 'p_U(0) < 0', ratio(64.0, 2.0, y=of_threshold(2.0, '1.001')), (GAIN,), form='full', ode=100.0),
    Case("full form's last root, just below", 'to twelve digits', float32=DIGITS, inputs=ratio(64.0, 2.0, y=of_threshold(2.0, '0.999999999999')), flags=(OPEN, GAIN), form='full'),
    Case("full form's last root, just above", 'to twelve digits', float32=DIGITS, inputs=ratio(64.0, 2.0, y=of_threshold(2.0, '1.000000000001')), flags=(GAIN,), form='full', ode=100000000.0),
    Case('gain ends, steel', 'ε_p = 1 at y = 1.0005', material(STEEL, y=1.0004), (GAIN,)),
    Case('gain ended, steel', 'ε_p = 1 at y = 1.0005', material(STEEL, y=1.0006)),
    Case('gain ends, chrome', 'ε_p = 1 at y = 1.0814', material(CHROME, y=1.081), (GAIN,)),
    Case('gain ended, chrome', 'ε_p = 1 at y = 1.0814', material(CHROME, y=1.082)),
    Case('gain ends, nylon', 'ε_p = 1 at y = 1.0537', material(NYLON, y=1.053), (GAIN,)),
    Case('gain ended, nylon', 'ε_p = 1 at y = 1.0537', material(NYLON, y=1.054)),
)
ENDS = (
    Case('ε² = 1e-13', 'what is left', material(NYLON, y=20.0, sigma=leaving('1e-13')), (), float32=DIGITS),
    Case('ε² = -1e-13', 'a little more lost', material(NYLON, y=20.0, sigma=leaving('-1e-13')), (STUCK,), float32=DIGITS),
    *both('ε² = 1e-4', 'nothing but rounding is left', material(NYLON, y=20.0, sigma=leaving('1e-4'))),
    *both('ε² = -1e-4', 'nothing but rounding is lost', material(NYLON, y=20.0, sigma=leaving('-1e-4')), STUCK),
    Case('ε² far below 0', 'σ = 100', material(NYLON, y=2.0, sigma=100.0), (STUCK,)),
    Case('ε² = 1 - 1e-13, elastic', 'σ = 1e-12', material(NYLON, y=0.5, sigma=1e-12), (ELASTIC,)),
    Case('ε² = 1 + 4e-13', 'd = 8e-12', ratio(1000000.0, 2.0, sigma=0.0, y=1.36), (GAIN,), float32=DIGITS),
    Case('ε² = 1 - 6e-13', 'd = 8e-12', ratio(1000000.0, 2.0, sigma=0.0, y=1.45), (), float32=DIGITS),
)
STIFFNESS = (
    Case('E/Y = 2, just yields', 'd = 2', ratio(2.0, 3.0, y=1.1), (GAIN, BEYOND)),
    Case('E/Y = 2, just yields, full', 'd = 2', ratio(2.0, 3.0, y=1.1), (GAIN, OPEN), form='full'),
    Case('E/Y = 2, first order', 'y_max = 1.94', ratio(2.0, 3.0, y=1.7, sigma=0.01), (BEYOND,)),
    Case('E/Y = 2, full', 'y_max = 1.62', ratio(2.0, 3.0, y=1.5, sigma=0.01), (), form='full'),
    *both('E/Y = 5', 'd = 0.32', ratio(5.0, 3.0, y=2.0, sigma=0.01)),
    *both('E/Y = 1e3', 'd = 8e-6', ratio(1000.0, 30.0, y=100.0)),
    *both('E/Y = 1e4', 'd = 8e-8', ratio(10000.0, 1000.0, y=1000.0)),
    *both('E/Y = 1e5', 'd = 8e-10', ratio(100000.0, 10000.0, y=10000.0)),
    *both('E/Y = 1e6', 'd = 8e-12', ratio(1000000.0, 1000000.0, y=10.0, sigma=0.01)),
    *both('E/Y = 1e6, y = 1e6', 'x_m = 6e4', ratio(1000000.0, 100000.0, y=1000000.0, sigma=0.01)),
    Case('E/Y = 1e6, near y_max', 'y = 3.6e13', ratio(1000000.0, 3.0, y=of_turning_point('0.9'), sigma=0.0, v_lim=1e+20)),
    Case('E/Y = 1e6, full, near y_max', 'y = 4.8e13', ratio(1000000.0, 3.0, y=of_turning_point('0.9'), sigma=0.0, v_lim=1e+20), (), form='full'),
)
SIZES = tuple(
    Case(f"R = {radius:g} m, y = {y:g}", "mass from 1e-23 to 1e13 kg", size(radius, y), flags)
    for radius in (1e-9, 1e-6, 1.0, 1e3)
    for y, flags in ((0.5, (ELASTIC,)), (5.0, ()))
)
# fmt: on


def turning_point(name: str, share: str, *flags: str, X=5.0, **more) -> tuple[Case, Case]:
    """Both forms at a share of y_max, by the energy balance's own ε_p (σ = 0)."""
    reason = NEAR.format(share)
    inputs = ratio(64.0, X, sigma=0.0, y=of_turning_point(share))
    # the first-order form turns a little beyond d x_m = 1, the full form ends where it holds
    first = (*flags, BEYOND) if share != "0.9" else flags
    full = (*flags, BEYOND) if LOST in flags else flags
    return (
        Case(name, reason, inputs, first, **more),
        Case(f"{name}, full", reason, inputs, full, form="full", **more),
    )


# fmt: off
TURNING_POINTS = (
    *turning_point('90 % of y_max', '0.9'),
    *turning_point('110 % of y_max', '1.1', LOST),
    *turning_point('just below y_max', '0.9999'),
    *turning_point('just above y_max', '1.0001', LOST),
    *turning_point('closer below y_max', '0.99999999', float32=DIGITS),
    *turning_point('closer above y_max', '1.00000001', LOST, float32=DIGITS),
    *turning_point('closest below y_max', '0.999999999999', float32=DIGITS),
    *turning_point('closest above y_max', '1.000000000001', LOST, float32=DIGITS),
    *(Case(f'beyond y_max of {name}', f'y_max = {y / 1.01:.4g}', material(name, y=y), (LOST, BEYOND)) for name, y in ((CHROME, 947.0), (NYLON, 316.0))),
)
EXPANSION = (
    Case('d x_m = 0.999', 'the elastic part is nearly gone', ratio(64.0, 5.0, y=of_expansion('0.999'))),
    Case('d x_m = 1.001', 'it has changed sign', ratio(64.0, 5.0, y=of_expansion('1.001')), (BEYOND,)),
    Case('d x_m = 1 - 1e-10', 'nearly', ratio(64.0, 5.0, y=of_expansion('0.9999999999')), (), float32=DIGITS),
    Case('d x_m = 1 + 1e-10', 'nearly', ratio(64.0, 5.0, y=of_expansion('1.0000000001')), (BEYOND,), float32=DIGITS),
    Case('d x_m > 1 without a root', 'X < 1', ratio(64.0, 0.5, y=of_expansion('1.03')), (BEYOND, OPEN)),
    Case('d x_m > 1, X = 1e6', 'stiff as well', ratio(64.0, 1000000.0, y=of_expansion('1.03'), sigma=0.0), (BEYOND,)),
)
# fmt: on
TABLE = AT_YIELD + VELOCITIES + UNLOADING + ENDS + STIFFNESS + SIZES + TURNING_POINTS + EXPANSION
