"""Eq. (18), χ̃ = c1 + c2 E/Y: one line for several materials."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.estimate import Estimate, Line
from calibration.parameters import LINE_COLUMNS
from calibration.stages import Options, StageFit, run_stage
from calibration.uncertainty import Uncertainty, noise_of, quantile, stacked


@dataclass(frozen=True)
class LineFit:
    """The line and the stage that found it (None where it goes through the fitted χ̃)."""

    line: Line
    stage: StageFit | None


def fit_line(fitted, options: Options, method: str, confidence: float) -> LineFit | None:
    """The line through all materials with a χ̃ of their own; None where there are fewer than two."""
    setup = fitted.setup
    own = [e for e in setup.elements if e.column == "chi"]
    if len(own) < 2:
        return None
    through = _through_chi(fitted, own, confidence)
    start = np.array([through["c1"].value, through["c2"].value])
    stage, known = _directly(fitted, options, start)
    if method == "weighted":
        return LineFit(_weighted_line(fitted, own, through, stage), None)
    c1, c2 = (_estimate(stage, known, i, confidence, setup) for i in (0, 1))
    line = Line(
        c1=c1,
        c2=c2,
        rms=_rms(fitted, stage.problem, stage.z),
        chi=_chi_on_line(setup, stage, known, confidence),
        through_chi=through,
        converged=stage.search.converged,
    )
    return LineFit(line, stage)


def _directly(fitted, options: Options, start) -> tuple[StageFit, Uncertainty]:
    """c1 and c2 against all curves at once; σ and ψ as they are, or with them under `model`."""
    setup = fitted.setup
    layout, positions = setup.line_layout()
    base = np.array(fitted.z)
    base[positions] = start
    old = fitted.stage("model").problem
    chi = {e.position for e in setup.elements if e.column == "chi"}
    kept = np.array([p for p in old.active if p not in chi], int)
    active = np.concatenate([positions, kept]).astype(int)
    problem = replace(old, layout=layout, base=base, active=active, loss="squared")
    own = replace(options, starts=1)
    if "two-step" in setup.plans:
        own = replace(own, loss="squared")  # the data are winsorised already
    stage = run_stage("Eq. (18)", setup, problem, own)
    problems = [s.problem for s in fitted.stages if s.problem.kind == "empirical"]
    problems = [replace(p, layout=layout, base=stage.z) for p in problems] + [stage.problem]
    exact = "two-step" in setup.plans
    noise, degrees = noise_of(setup, problems[0])
    return stage, stacked(setup, problems, exact, noise, degrees)


def _through_chi(fitted, own, confidence) -> dict[str, Estimate]:
    """Weighted least squares through the fitted χ̃; equal weights where they have no errors."""
    setup, known = fitted.setup, fitted.uncertainty
    theta = setup.layout.physical(fitted.z, np)
    ratio = np.array([_ratio(fitted, e.sets[0]) for e in own])
    chi = np.array([theta[e.position] for e in own])
    rows = [known.of(e.position) for e in own]
    variance = np.diag(known.covariance)[rows] * chi**2
    usable = np.all(np.isfinite(variance)) and np.all(variance > 0)
    weight = 1 / variance if usable else np.ones(len(chi))
    design = np.stack([np.ones_like(ratio), ratio], axis=1)
    normal = np.linalg.pinv(design.T @ (design * weight[:, None]))
    c = normal @ (design.T @ (weight * chi))
    degrees = [d for d in known.degrees if d is not None]
    reach = quantile(confidence, min(degrees) if degrees else None)
    table = {}
    for i, name in enumerate(LINE_COLUMNS):
        error = float(np.sqrt(normal[i, i])) if usable else None
        value = float(c[i])
        low, high = (
            (None, None) if error is None else (value - reach * error, value + reach * error)
        )
        table[name] = Estimate(value, error, low, high, "wald", True)
    return table


def _ratio(fitted, g: int) -> float:
    """E/Y of a data set with what was fitted of it."""
    table = fitted.setup.layout.numpy_table(fitted.z)
    return float(table["youngs_modulus"][g] / table["yield_strength"][g])


def _weighted_line(fitted, own, through, stage) -> Line:
    base = np.array(stage.problem.base)
    _, positions = fitted.setup.line_layout()
    base[positions] = [through["c1"].value, through["c2"].value]
    names = [fitted.setup.datasets[e.sets[0]].name for e in own]
    chi = {
        name: Estimate(through["c1"].value + through["c2"].value * _ratio(fitted, e.sets[0]))
        for name, e in zip(names, own, strict=True)
    }
    rms = _rms(fitted, stage.problem, base)
    return Line(through["c1"], through["c2"], rms, chi, through, True, "weighted")


def _estimate(stage, known: Uncertainty, i: int, confidence, setup) -> Estimate:
    """c1 or c2; both are searched as they are, so z is the value."""
    position = stage.problem.active[i]
    row = known.of(position)
    value = float(stage.z[position])
    error = float(np.sqrt(known.covariance[row, row]))
    if not np.isfinite(error):
        return Estimate(value, None, None, None, "sandwich", True)
    degrees = [d for d in known.degrees if d is not None]
    reach = quantile(confidence, sum(degrees) if degrees else None) * error
    method = "sandwich" if "two-step" in setup.plans else "wald"
    return Estimate(value, error, value - reach, value + reach, method, True)


def _chi_on_line(setup, stage, known: Uncertainty, confidence) -> dict[str, Estimate]:
    """c1 + c2 E/Y of each material, with its error."""
    rows = [known.of(position) for position in stage.problem.active[:2]]
    covariance = known.covariance[np.ix_(rows, rows)]
    table = stage.problem.layout.numpy_table(stage.z)
    degrees = [d for d in known.degrees if d is not None]
    reach = quantile(confidence, sum(degrees) if degrees else None)
    chi = {}
    for g in np.flatnonzero(stage.problem.layout.on_line):
        ratio = float(table["youngs_modulus"][g] / table["yield_strength"][g])
        slope = np.array([1.0, ratio])
        value = float(slope @ stage.z[stage.problem.active[:2]])
        error = float(np.sqrt(slope @ covariance @ slope))
        if np.isfinite(error):
            estimate = Estimate(value, error, value - reach * error, value + reach * error, "wald")
        else:
            estimate = Estimate(value, method="wald")
        chi[setup.datasets[g].name] = estimate
    return chi


def _rms(fitted, problem, z) -> dict[str, float]:
    """Of each material's curve with χ̃ from the line."""
    residual = problem.prediction(z) - fitted.setup.obs.restitution
    setup = fitted.setup
    return {
        setup.datasets[g].name: float(np.sqrt(np.mean(residual[setup.rows(g)] ** 2)))
        for g in np.flatnonzero(problem.layout.on_line)
    }
