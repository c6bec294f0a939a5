"""Results put together by hand, for what is told and drawn of them; nothing was searched."""

import numpy as np
from calibration.doubt import Doubt
from calibration.estimate import Estimate, Line
from calibration.material_fit import MaterialFit
from calibration.profiles import Profile
from calibration.result import FitResult
from calibration.stages import Stage

import calibration.data.paper as embedded
from calibration.data.measurements import RestitutionData
from tests.cases import pair

CHI = {"stainless steel": 1.7944, "chrome steel": 0.09867, "nylon": 0.21998}
LEAVES = ("limit_velocity", "yield_strength", "youngs_modulus")
ERRORS = {"chi": 0.05, "sigma": 0.02, "psi": 0.004}  # relative


def estimate(value: float, error: float, method: str = "sandwich") -> Estimate:
    return Estimate(value, error, value - 2 * error, value + 2 * error, method, True)


def material_fit(data: RestitutionData, chi: float, sigma: float, psi: float, **changed):
    """A two-step fit of `data` with these values and errors of a few percent."""
    values = {"chi": chi, "sigma": sigma, "psi": psi}
    given = {
        "data": data,
        "plan": "two-step",
        "parameters": {k: estimate(v, ERRORS[k] * v) for k, v in values.items()},
        "derived": {},
        "columns": values | {name: float(data.contact.leaves()[name]) for name in LEAVES},
        "rms": 0.0123456,
        "rms_empirical": 0.00456,
        "reduced_chi_squared": None,
        "converged": True,
        "status": (0,) * len(data),
        "warnings": (),
        "form": "first-order",
        "kappa": "consistent",
    }
    return MaterialFit(**given | changed)


def result_of(materials, **changed) -> FitResult:
    """A result of these materials; one of them has plain labels."""
    alone = len(materials) == 1
    names = [
        name if alone else f"{name}[{fit.name}]"
        for fit in materials
        for name, e in fit.parameters.items()
        if e.free
    ]
    errors = [e.standard_error for fit in materials for e in fit.parameters.values() if e.free]
    given = {
        "materials": tuple(materials),
        "unloading_line": None,
        "covariance_names": tuple(names),
        "covariance": _covariance(np.array(errors)),
        "rank": len(names),
        "condition_number": 12.5,
        "confidence": 0.95,
        "warnings": tuple(doubt for fit in materials for doubt in fit.warnings),
        "optimiser_report": (
            Stage("Eq. (17)", "optax L-BFGS", "closed form", 20, 6, 1e-9, 0.1, True, "step", 32),
            Stage("model", "optax L-BFGS", "ode", 11, 5, 2e-9, 0.2, True, "step", 32),
        ),
        "beside": None,
        "profiles": {},
        "degrees": tuple(len(fit.data) - 2 for fit in materials),
        "settings": {"objective": "two-step", "optimiser": "l-bfgs", "route": "ode", "seed": 0},
        "versions": {"softjax-contact": "0.1.0"},
        "times": {"Eq. (17)": 0.5, "model": 2.25},
    }
    return FitResult(**given | changed)


def _covariance(errors: np.ndarray) -> np.ndarray:
    """Neighbours correlated by -0.6."""
    correlation = np.eye(len(errors))
    near = np.abs(np.subtract.outer(np.arange(len(errors)), np.arange(len(errors)))) == 1
    correlation[near] = -0.6
    return correlation * np.outer(errors, errors)


def paper_fit() -> FitResult:
    """The three materials of the paper with their known χ̃ and a line in E/Y."""
    fits = [
        material_fit(embedded.paper_data(curve), CHI[curve.name], curve.sigma, curve.psi)
        for curve in embedded.CURVES
    ]
    ratios = {fit.name: float(fit.contact.yield_ratio) for fit in fits}
    line = Line(
        c1=estimate(0.03184, 0.002),
        c2=estimate(0.004554, 0.0003),
        rms={"stainless steel": 0.0167, "chrome steel": 0.0345, "nylon": 0.0162},
        chi={name: Estimate(0.03184 + 0.004554 * ratio) for name, ratio in ratios.items()},
        through_chi=None,
        converged=True,
    )
    return result_of(fits, unloading_line=line)


def noisy_data(name: str = "my alloy", **changed) -> RestitutionData:
    """24 impacts over two decades on both sides of first yield, with error bars."""
    contact = pair("nylon")
    velocity = np.geomspace(0.2, 30.0, 24)
    noise = 0.01 * np.random.default_rng(5).standard_normal(24)
    clean = embedded.eq_17(velocity, float(contact.limit_velocity), 0.4355, 0.5414)
    return RestitutionData(velocity, clean + noise, contact, 0.01, name, **changed)


def own_fit(**changed) -> FitResult:
    """One material with error bars, profiles (one of them open) and a doubt."""
    doubt = Doubt("model-misfit", "rms 0.02 against a noise of 0.01", "my alloy")
    fit = material_fit(noisy_data(), 0.21998, 0.4355, 0.5414, warnings=(doubt,))
    z = np.linspace(-1.3, 1.3, 19)
    sigma = Profile(
        "sigma",
        tuple(0.4355 * np.exp(0.05 * z)),
        tuple(3.84 * z**2),
        float(0.4355 * np.exp(-0.05)),
        float(0.4355 * np.exp(0.05)),
        3.84,
    )
    psi = Profile(
        "psi",
        tuple(0.5414 * np.exp(2 * z)),
        tuple(np.where(z > 0, 1.7 * (1 - np.exp(-2 * z)), 4 * z**2)),
        0.075,
        None,
        3.84,
    )
    return result_of([fit], **{"profiles": {"sigma": sigma, "psi": psi}} | changed)
