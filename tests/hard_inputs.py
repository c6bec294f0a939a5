"""How a row of the table of hard impacts is written down, and rounded to a precision."""

import math
from collections.abc import Callable
from dataclasses import dataclass
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
