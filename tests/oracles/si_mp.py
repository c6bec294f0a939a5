"""The model in SI units: contact of two bodies, coefficient of restitution, its sensitivities.

Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013). Inputs are dicts of floats (taken exactly), strings
or mpf: the effective properties E, R, M, Y, v_lim of the contact, chi, sigma, psi, the impact
velocity v, and the choices area ("zhou" | "hertz"), form ("first-order" | "full"), kappa
("consistent" | "printed").
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from mpmath import mp, mpf

from . import dimensionless_mp as model
from .numeric_mp import Real

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


def coefficient(inputs: Inputs, *, duration: bool = True) -> dict[str, Any]:
    """One impact: eps, eps_p, their squares, overlaps, duration (unless not asked for), flags.

    Without a turning point eps = eps_p = 0, both overlaps are where the loading ends and the
    duration is NaN; at rest (v = 0) the duration is infinite. eps_squared is never clipped.
    """
    with _precise():
        scale = dimensionless(inputs)
        d, X, y, form = scale["d"], scale["X"], scale["y"], inputs["form"]
        flags = model.flags(form, d, X, y)
        x_m = model.peak(form, d, y)
        v, v_lim, loss = mpf(inputs["v"]), mpf(inputs["v_lim"]), (inputs["sigma"], inputs["psi"])
        eps_p_squared = model.plastic_squared(form, d, X, y)
        if x_m is None:
            eps_squared, x_m = mpf(0), model.loading_end(form, d)
            x_star = x_m
        else:
            x_star = model.residual(form, d, X, x_m)
            eps_squared = (
                empirical(min(v, scale["v_cr"]), v_lim, *loss) ** 2
            )  # ε_up, or ε_17 below yield
            eps_squared += eps_p_squared - 1  # Eq. (16)
        flags |= {"NO_REBOUND"} if eps_squared < 0 else set()
        flags |= {"ABOVE_LIMIT_VELOCITY"} if v >= v_lim else set()
        result = {
            "eps": mp.sqrt(max(eps_squared, mpf(0))),
            "eps_p": mp.sqrt(eps_p_squared),
            "eps_squared": eps_squared,
            "eps_p_squared": eps_p_squared,
            "peak_overlap": scale["delta_cr"] * x_m,
            "residual_overlap": scale["delta_cr"] * x_star,
            "flags": flags,
        }
        if duration:
            time = model.duration(form, d, X, y)
            result["duration"] = time * scale["delta_cr"] / scale["v_cr"]
        return result


def _as_given(inputs: Inputs) -> Inputs:
    return inputs


def _moved(inputs: Inputs, build: Build, **steps: mpf) -> dict[str, mpf]:
    """The impact with each named input times 1 + its step."""
    moved = inputs | {name: mpf(inputs[name]) * (1 + step) for name, step in steps.items()}
    result = coefficient(build(moved), duration=False)
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
