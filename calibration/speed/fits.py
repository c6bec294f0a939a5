"""Many fits side by side against a loop of SciPy's over the same formulas in numba: `softjax speed --fits`.

The refits of a bootstrap: 30 points of Zhou's law on both sides of first yield, three parameters in
logarithms, exact derivatives, each from the fit that the data were drawn from. Both ways run once
before, so that compilation is left out.
"""

import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import InputError
from calibration.fitting.door import fit
from calibration.parameters import Parameter
from calibration.speed.energy_numba import compiled_collision
from calibration.speed.scene import stainless

FITS, POINTS, NOISE = 1000, 30, 0.005
SEED = 0


def report(fits: int = FITS) -> str:
    """What both took, and how far their minima are apart, as lines.

    Raises:
        InputError: where numba is not installed.
    """
    law, data = _measured()
    said = {"chi": Parameter(law.chi), "sigma": Parameter(law.sigma), "psi": Parameter(law.psi)}
    result = fit(data, None, said, starts=1)
    curve = _curve_of(data, law)
    batched, many = _timed(lambda count: result.bootstrap(count, seed=SEED).values, fits)
    drawn = _drawn(result, fits)
    single, each = _timed(lambda count: _fitted(curve, drawn[:count], _at(result)), fits)
    apart = np.max(np.abs(np.log(many / each)), axis=1)
    lines = [
        f"{fits} fits of {POINTS} points, three parameters",
        f"  side by side            {batched:.2f} s",
        f"  SciPy's loop, numba     {single:.2f} s: {single / batched:.1f} times as long",
        f"  the same minimum        {np.mean(apart < 1e-4):.1%}, of them {_most(apart):.0e} apart at most",
    ]
    return "\n".join(lines)


def _most(apart: np.ndarray) -> float:
    return float(np.max(apart[apart < 1e-4], initial=0.0))


def _measured() -> tuple[sj.Zhou, RestitutionData]:
    """Points drawn around the law, half of them below first yield."""
    contact = stainless().contact
    law = sj.Zhou(contact, chi=1.7944, sigma=3.0432, psi=0.54)
    velocity = float(contact.critical_velocity) * np.geomspace(0.02, 200.0, POINTS)
    noise = NOISE * np.random.default_rng(1).standard_normal(POINTS)
    measured = np.asarray(sj.restitution(law, velocity).coefficient) + noise
    return law, RestitutionData(velocity, np.minimum(measured, 1.0), contact)


def _timed(run, fits: int):
    """Wall seconds of all fits, and what they gave."""
    run(2)
    run(fits)
    start = time.perf_counter()
    found = run(fits)
    return time.perf_counter() - start, found


def _at(result) -> Float[np.ndarray, "3"]:
    return np.array([result.values[name] for name in ("chi", "sigma", "psi")])


def _drawn(result, fits: int) -> Float[np.ndarray, "fits n"]:
    """The data that `bootstrap` draws: the same curve, noise and seed."""
    law, data = result.law, result.data
    curve = np.asarray(sj.restitution(law, data.velocity).coefficient)
    random = np.random.default_rng(SEED)
    noise = random.standard_normal((fits, POINTS)) * result.materials[0].noise
    return np.maximum(curve + noise, 0.0)


def _curve_of(data: RestitutionData, law: sj.Zhou) -> Callable:
    """ε of the data's impacts, and its derivatives, at ln χ̃, ln σ and ln ψ."""
    curve, contact = _compiled_curve(), law.contact
    d, ratio = float(law.plasticity()), float(contact.yield_ratio)
    ends = contact.critical_velocity, float(contact.limit_velocity)

    def at(z):
        chi, sigma, psi = np.exp(z)
        return curve(data.velocity, d, chi * ratio, sigma, psi, *ends)

    return at


def _fitted(at: Callable, drawn, start) -> Float[np.ndarray, "fits 3"]:
    """One fit after the other by SciPy's Levenberg–Marquardt."""
    from scipy.optimize import least_squares

    options = {"method": "lm", "xtol": 1e-9, "ftol": 1e-12}
    found = [
        least_squares(lambda z, m=m: at(z)[0] - m, np.log(start), lambda z: at(z)[1], **options)
        for m in drawn
    ]
    return np.exp([end.x for end in found])


def _compiled_curve():
    """ε and its derivatives by ln χ̃, ln σ and ln ψ. Below first yield Eq. (17), above it Eq. (16)."""
    try:
        import numba
    except ImportError:
        accepted = "numba is needed: pip install numba"
        raise InputError(
            None, None, "the loop to compare with is written in numba", accepted
        ) from None

    collision = compiled_collision()

    @numba.njit
    def curve(velocity, d, steepness, sigma, psi, critical, limit):
        value = np.empty(velocity.size)
        jacobian = np.zeros((velocity.size, 3))
        for j in range(velocity.size):
            at = min(velocity[j], critical)
            log = np.log(at / (limit - at))
            exponent = sigma * np.exp(psi * log)
            if velocity[j] <= critical:
                value[j] = np.exp(-exponent)
                jacobian[j, 1] = -exponent * value[j]
                jacobian[j, 2] = jacobian[j, 1] * psi * log
                continue
            plastic, slope = collision(d, steepness, velocity[j] / critical)
            squared = plastic + np.expm1(-2 * exponent)
            if squared <= 0:
                value[j] = 0.0
                continue
            value[j] = np.sqrt(squared)
            lost = -2 * exponent * np.exp(-2 * exponent)
            jacobian[j, 0] = 0.5 * slope * steepness / value[j]
            jacobian[j, 1] = 0.5 * lost / value[j]
            jacobian[j, 2] = jacobian[j, 1] * psi * log
        return value, jacobian

    return curve
