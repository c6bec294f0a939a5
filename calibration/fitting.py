"""Fit a law's parameters to measured restitutions: `fit` is the door to everything here."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.assemble import Setup, assemble
from calibration.data.measurements import RestitutionData
from calibration.impacts import Model
from calibration.line import fit_line
from calibration.parameters import COLUMNS
from calibration.problem import Problem
from calibration.result import FitResult
from calibration.search import OPTIMISERS
from calibration.stages import Options, StageFit, run_stage
from calibration.summary import summarise
from calibration.uncertainty import Uncertainty, noise_of, stacked, winsorised

DEFAULT_ROUTE = sj.ODE(steps=16, solver="dopri5")  # ε to 1e-11, compiled in half of dopri8's time
LOSSES = ("squared", "huber", "soft-l1")
EMPIRICAL_COLUMNS = ("sigma", "psi", "limit_velocity")
TWO_STEP_COLUMNS = ("chi", "c1", "c2", "yield_strength", "youngs_modulus")
STAGES = (  # kind, of data sets with these objectives, searching these columns
    ("empirical", ("two-step", "empirical"), EMPIRICAL_COLUMNS),
    ("constant", ("constant",), ("restitution",)),
    ("model", ("two-step",), TWO_STEP_COLUMNS),
    ("model", ("model",), COLUMNS),
)


@dataclass(frozen=True)
class Fitted:
    """All stages of a fit, before it is told as a result."""

    setup: Setup
    stages: tuple[StageFit, ...]
    z: np.ndarray
    uncertainty: Uncertainty

    def stage(self, kind: str) -> StageFit | None:
        """The stage of a kind: "empirical", "constant" or "model"."""
        return next((s for s in self.stages if s.problem.kind == kind), None)


def fit(
    data: RestitutionData | list[RestitutionData],
    objective: str | None = None,
    *,
    optimiser: str = "l-bfgs",
    route: sj.EnergyBalance | sj.ODE | None = None,
    parameters: Mapping[str, Any] | list | None = None,
    loss: str = "squared",
    loss_scale: float = 1.345,
    starts: int = 32,
    seed: int = 0,
    max_steps: int = 200,
    form: str = "first-order",
    kappa: str = "consistent",
    unloading_line: str | None = "curves",
    confidence: float = 0.95,
    profiles: bool = True,
    beside: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> FitResult:
    """Fit χ̃, σ, ψ (and what else is free) to one data set or several.

    Args:
        data: one `RestitutionData`, or a list of them with different names.
        objective: "two-step" (default with a contact): σ and ψ from Eq. (17) against all points,
            then χ̃ from the model against all points with ε_up as Eq. (17) gave it. "model": the
            model alone, Eq. (17) below v_cr and Eq. (16) above, all parameters at once.
            "empirical": Eq. (17) alone (default without a contact). "constant": one ε (default
            without a limit velocity either).
        optimiser: "l-bfgs" or "adam" (then L-BFGS) by optax, "levenberg-marquardt" by optimistix.
        route: `sj.ODE(...)` (default, fixed steps) or `sj.EnergyBalance()`.
        parameters: {"chi": spec} for all data sets, {"chi[name]": spec} for one, where spec is a
            `ParameterSpec` or a number that fixes it; or a list of such mappings, one a data set.
            With "c1" or "c2" every χ̃ lies on c1 + c2 E/Y (Eq. 18).
        loss: "squared", "huber" or "soft-l1"; the robust ones are scaled by the median absolute
            deviation of the residuals times `loss_scale`. Under "two-step" outliers are told by
            Eq. (17), and drawn in to it for the second step.
        starts: how many starts are screened (1: only the given one); the best few are refined.
        seed: of the starts. The same seed gives the same result.
        max_steps: iterations of one search.
        form, kappa: of the law, see `softjax.Zhou`.
        unloading_line: for several data sets, Eq. (18) fitted to all curves at once ("curves") or
            through the fitted χ̃ with their weights ("weighted"); None: not at all.
        confidence: of the intervals.
        profiles: whether to profile the likelihood where there is one.
        beside: whether to repeat the fit by Levenberg–Marquardt through the energy balance.
        progress: called as progress(stage, done, total).

    Returns:
        A `FitResult`. A fit that did not converge is marked so, not raised.

    All is computed in float64, whatever JAX is set to.

    Raises:
        ValueError: naming the argument, its value and what is accepted.

    Example:
        >>> import calibration as cal
        >>> result = cal.fit(cal.paper_materials()[0])
        >>> round(result.values["chi"], 4)
        1.7944
    """
    import jax

    datasets = _datasets(data)
    if route is not None and not isinstance(route, sj.EnergyBalance | sj.ODE):
        raise ValueError(f"`route` must be softjax.EnergyBalance or softjax.ODE, but is {route!r}")
    _check(optimiser, loss, unloading_line, starts, seed, max_steps, confidence, loss_scale)
    options = Options(optimiser, starts, seed, loss, loss_scale, max_steps, progress)
    begun = time.perf_counter()
    with jax.enable_x64(True):
        setup = assemble(datasets, objective, parameters)
        model = Model(form, kappa, setup.area, route or DEFAULT_ROUTE)
        _check_law(form, kappa, setup.area)
        fitted = run(setup, model, options)
        line = None
        if unloading_line is not None:
            line = fit_line(fitted, options, unloading_line, confidence)
        again = _beside(fitted, model, options, unloading_line) if beside else None
        result = summarise(fitted, model, options, line, again, confidence, profiles)
    result.times["total"] = time.perf_counter() - begun
    return result


def run(setup: Setup, model: Model, options: Options) -> Fitted:
    """All stages in their order, and the covariance of what they found."""
    z = setup.layout.start()
    stages: list[StageFit] = []
    for kind, plans, columns in STAGES:
        active = setup.positions(columns, plans)
        if np.any(np.isin(setup.plans, plans)):
            problem = _problem(setup, model, kind, plans, z, active)
            own = options
            if plans == ("two-step",) and options.loss != "squared":
                obs = winsorised(stages[0].problem, z, problem.obs)
                problem, own = replace(problem, obs=obs), replace(options, loss="squared")
            stages.append(run_stage(_stage_name(kind), setup, problem, own))
            z = stages[-1].z
    stages = [replace(s, problem=replace(s.problem, base=z)) for s in stages]
    return Fitted(setup, tuple(stages), z, covariance_of(setup, stages))


def _stage_name(kind: str) -> str:
    return {"empirical": "Eq. (17)", "model": "model", "constant": "constant"}[kind]


def _problem(setup: Setup, model: Model, kind, plans, z, active) -> Problem:
    return Problem(
        layout=setup.layout,
        obs=setup.stage_observations(plans),
        noise=setup.noise,
        model=model,
        kind=kind,
        loss="squared",
        base=z,
        active=active,
    )


def covariance_of(setup: Setup, stages: list[StageFit]) -> Uncertainty:
    """Noise from Eq. (17)'s step where there is one, else from the residuals; then the sandwich."""
    problems = [stage.problem for stage in stages]
    noise, degrees = noise_of(setup, problems[0])
    for problem in problems[1:]:
        if problem.kind == "model" and problems[0].kind == "empirical":
            continue
        own_noise, own_degrees = noise_of(setup, problem)
        owned = problem.obs.weight > 0
        noise = np.where(owned, own_noise, noise)
        degrees = tuple(
            own_degrees[g] if np.any(owned[setup.rows(g)]) else degrees[g]
            for g in range(len(degrees))
        )
    return stacked(setup, problems, "two-step" in setup.plans, noise, degrees)


def _beside(fitted: Fitted, model: Model, options: Options, unloading_line) -> dict[str, Any]:
    """The same fit by Levenberg–Marquardt through the energy balance, with what differs."""
    begun = time.perf_counter()
    other = replace(options, optimiser="levenberg-marquardt", starts=1, progress=None)
    again = run(fitted.setup, replace(model, route=sj.EnergyBalance()), other)
    theta = fitted.setup.layout.physical(fitted.z, np)
    theta_again = fitted.setup.layout.physical(again.z, np)
    labels = {e.label: e.position for e in fitted.setup.elements}
    differences = {
        label: float(abs(theta_again[i] - theta[i]) / max(abs(theta[i]), 1e-300))
        for label, i in labels.items()
    }
    values = {label: float(theta_again[i]) for label, i in labels.items()}
    line = fit_line(again, other, unloading_line, 0.95) if unloading_line else None
    if line is not None:
        values |= {"c1": line.line.c1.value, "c2": line.line.c2.value}
    return {
        "optimiser": OPTIMISERS["levenberg-marquardt"],
        "route": "energy balance",
        "values": values,
        "relative_difference": differences,
        "largest_difference": max(differences.values(), default=0.0),
        "converged": all(stage.search.converged for stage in again.stages),
        "evaluations": sum(stage.report.evaluations for stage in again.stages),
        "seconds": time.perf_counter() - begun,
    }


def _datasets(data) -> list[RestitutionData]:
    datasets = [data] if isinstance(data, RestitutionData) else list(data)
    if not datasets or not all(isinstance(one, RestitutionData) for one in datasets):
        raise ValueError(f"`data` must be RestitutionData or a list of them, but is {data!r}")
    return datasets


def _check_law(form: str, kappa: str, area: str) -> None:
    """The law's own refusal of an unknown form or kappa."""
    sj.Zhou(sj.Contact(1.0, 1.0, 1.0, 1.0, 1.0, area=area), 1.0, 1.0, 1.0, form, kappa)


def _check(optimiser, loss, line, starts, seed, max_steps, confidence, loss_scale) -> None:
    _check_choice("optimiser", optimiser, tuple(OPTIMISERS))
    _check_choice("loss", loss, LOSSES)
    _check_choice("unloading_line", line, ("curves", "weighted", None))
    for name, value, least in (
        ("starts", starts, 1),
        ("seed", seed, 0),
        ("max_steps", max_steps, 1),
    ):
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise ValueError(f"`{name}` must be a whole number >= {least}, but is {value!r}")
    if not 0 < confidence < 1:
        raise ValueError(f"`confidence` must be between 0 and 1, but is {confidence!r}")
    if not loss_scale > 0:
        raise ValueError(f"`loss_scale` must be positive, but is {loss_scale!r}")


def _check_choice(name: str, value, choices) -> None:
    if value not in choices:
        accepted = " or ".join(repr(choice) for choice in choices)
        raise ValueError(f"`{name}` must be {accepted}, but is {value!r}")
