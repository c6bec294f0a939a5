"""Where to measure next: velocities of further shots that tell most."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.data.checks import check_whole
from calibration.data.json_file import plain
from calibration.errors import DataError
from calibration.fitting.result import FitResult
from calibration.studies.exchange import CRITERIA
from calibration.studies.inputs import both_ends
from calibration.studies.placing import Errors, Progress, Wanted, sought
from calibration.studies.planned import USUAL_NOISE
from calibration.studies.planning import checked_impacts, plan_of, taken_as_known
from calibration.studies.targets import DERIVED

TOGETHER = 0.01  # relative distance below which shots are told as one velocity
ONE_VELOCITY = (
    "One velocity tells one number, and this one tells {} best if the law holds; a few shots at "
    "other velocities would show whether it does."
)
ROUNDS = 3  # of a design in two steps, where what is found depends on the design


@dataclass(frozen=True, eq=False)
class Design:
    """Velocities for further shots, and what they are expected to bring.

    Attributes:
        objective, criterion, target: what was made small: "c" the standard error of the target,
            "D" the determinant of the covariance of ln θ, "A" its mean variance, "E" its largest
            eigenvalue, "I" the mean variance of the predicted curve.
        names: the parameters.
        velocity: v [m/s] of the new shots, ascending.
        uncertainty: of ε in each of them.
        bounds: v [m/s] within which they were sought.
        relative_errors: expected standard error of ln θ with the new shots, beside the old ones,
            and of a target that follows from θ;
            of several laws the root mean square; None for what is left open.
        equally_spaced: the same for as many shots equally spaced over the bounds.
        before: the same without new shots; None where too little was measured yet.
        gain: the criterion as a standard error (the target's for "c", the geometric mean of all for
            "D") with equally spaced shots over that with these.
        efficiency: what the design reaches at least of the best possible one of as many shots, by
            the equivalence theorem; None for `two-step`, for which there is none.
        symbols: of the parameters.
        grid, slopes: velocities [m/s], (k,), and θ ∂ε/∂θ there, (k, p), of the first law.
        remark: what two steps find instead of the law's own parameters, if anything.
        taken_as_known: a sentence for each parameter of the fit that has no standard error, and on
            errors that its points share.
    """

    objective: str
    criterion: str
    target: str
    names: tuple[str, ...]
    velocity: Float[np.ndarray, "n"]
    uncertainty: float
    bounds: tuple[float, float]
    relative_errors: Errors
    equally_spaced: Errors
    before: Errors | None
    gain: float
    efficiency: float | None
    symbols: tuple[str, ...]
    grid: Float[np.ndarray, "k"]
    slopes: Float[np.ndarray, "k p"]
    remark: str = ""
    taken_as_known: tuple[str, ...] = ()

    @property
    def support(self) -> list[tuple[float, int]]:
        """(velocity [m/s], number of shots there): shots within a percent taken together."""
        groups: list[list[float]] = []
        for v in self.velocity.tolist():
            if groups and v <= groups[-1][0] * (1 + TOGETHER):
                groups[-1].append(v)
            else:
                groups.append([v])
        return [(float(np.mean(group)), len(group)) for group in groups]

    @property
    def target_symbol(self) -> str:
        if self.target in self.names:
            return self.symbols[self.names.index(self.target)]
        return DERIVED[self.target].symbol

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        left_out = ("symbols", "grid", "slopes")
        table = {name: value for name, value in vars(self).items() if name not in left_out}
        support = [{"velocity": v, "shots": n} for v, n in self.support]
        return plain(table | {"support": support})

    def __str__(self) -> str:
        shots = ", ".join(f"{n} at {v:.4g} m/s" for v, n in self.support)
        here, even = (
            "left open" if error is None else f"{error:.3g}"
            for error in (e[self.target] for e in (self.relative_errors, self.equally_spaced))
        )
        text = f"{self.criterion}-optimal for {self.objective}: {shots}; standard error of "
        text += f"ln {self.target_symbol} {here}, equally spaced {even}"
        if self.efficiency is not None:
            percent = math.floor(1000 * self.efficiency) / 10
            text += f"; at least {percent:.1f} % of the best"
        lone = ONE_VELOCITY.format(self.target_symbol) if len(self.support) == 1 else ""
        return "\n".join(filter(None, (text, lone, self.remark, *self.taken_as_known)))


def optimal_velocities(
    law: sj.ContactLaw | FitResult | Sequence[sj.ContactLaw],
    count: int,
    bounds: tuple[float, float],
    *,
    criterion: str = "c",
    target: str | None = None,
    objective: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    material: str | None = None,
    over: tuple[float, float] | None = None,
    uncertainty: float | None = None,
    measured: ArrayLike | None = None,
    measured_uncertainty: ArrayLike | None = None,
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
    starts: int = 8,
    seed: int = 0,
    progress: Progress | None = None,
) -> Design:
    """Velocities of `count` further shots that tell most of the parameters.

    Shots are exchanged over a grid of velocities from several starts, then placed more finely.
    Under `two-step`, where what is found depends on the shots, they are sought again around what
    the last ones find. An optimum trusts the law: where it does not fit, what is fitted depends on
    where one measures, and a few shots elsewhere would show it.

    Args:
        law: with the parameters as far as they are known; several laws of one kind, over which the
            logarithm of the criterion is averaged; or a fit, as `fisher_information` takes it.
        count: number of new shots, each of a specimen, or launch, of its own where these share
            errors.
        bounds: (lowest, highest) velocity [m/s] that can be shot.
        criterion: "c": the standard error of `target`; "D", "A", "E": determinant, trace and
            largest eigenvalue of the covariance of ln θ (under `two-step` "D" takes those of each
            step: over all three the covariance is singular for impacts at two velocities); "I":
            the mean variance of the predicted curve between the velocities `over`.
        target: a parameter, or a number that follows from them as a fit's table tells it, such as
            eps_up; chi where there is one, else the first parameter, if left out. For c alone.
        objective, parameters, material, route: as `fisher_information` takes them.
        over: where the curve is to be predicted by criterion I; the bounds if left out.
        uncertainty: standard uncertainty of each new ε; 0.01 unless a fit has its own, the scatter
            between its groups included.
        measured, measured_uncertainty: v [m/s] and uncertainty of ε of what is there already; a
            fit has its own.
        starts, seed: of the search.
        progress: called as progress(stage, done, total).

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    _check_search(count, bounds, criterion, starts, seed)
    acts = {
        "target": (target, criterion == "c", f"left out with criterion {criterion}"),
        "over": (over, criterion == "I", f"left out with criterion {criterion}"),
        "measured_uncertainty": (measured_uncertainty, measured is not None, "given with measured"),
    }
    for name, (value, acting, accepted) in acts.items():
        if value is not None and not acting:
            raise DataError(name, value, accepted)
    over = bounds if over is None else both_ends("over", over)
    there = None
    if measured is not None:
        u = uncertainty if measured_uncertainty is None else measured_uncertainty
        there = measured, USUAL_NOISE if u is None else u
    laws: Sequence[Any] = law if isinstance(law, Sequence) else [law]
    if not laws:
        raise DataError("law", law, "one law or more, or a FitResult")
    plans = [
        plan_of(
            one,
            [*bounds, *over] if criterion == "I" else bounds,
            parameters=parameters,
            objective=objective,
            route=route,
            material=material,
            measured=there,
        )
        for one in laws
    ]
    error = plans[0].noise if uncertainty is None else uncertainty
    errors = np.full(count, checked_impacts(np.zeros(1), error, "uncertainty")[1])
    with jax.enable_x64(True):
        wanted = Wanted(plans, bounds, errors, criterion, target, over)
        found = _designed(wanted, starts, seed, progress)
    targets = [found.target] if criterion == "c" else found.names
    return replace(found, taken_as_known=taken_as_known(laws[0], material, targets, plans[0]))


def _designed(wanted: Wanted, starts: int, seed: int, progress: Progress | None) -> Design:
    even, grid = wanted.even, wanted.grid()
    shots, is_likelihood = even, wanted.plans[0].is_likelihood
    for _ in range(1 if is_likelihood else ROUNDS):
        tried = sought(wanted, grid, wanted.found(shots), starts, seed, progress)
        shots = min(shots, tried, key=wanted.level)
    level, found = wanted.level(shots), wanted.found(shots)
    efficiency = None
    if is_likelihood:
        least = wanted.criterion.least(wanted.table(np.union1d(grid, shots), found), len(shots))
        efficiency = min(math.exp(least - level), 1.0)
    errors, remark = wanted.errors_at(shots)
    enough = all(len(v) > len(wanted.names) for v, _ in wanted.plans[0].measured)
    return Design(
        objective=wanted.plans[0].objective,
        criterion=wanted.criterion.name,
        target=wanted.target,
        names=wanted.names,
        velocity=shots,
        uncertainty=float(wanted.errors[0]),
        bounds=(float(grid[0]), float(grid[-1])),
        relative_errors=errors,
        equally_spaced=wanted.errors_at(even)[0],
        before=wanted.errors_at(np.zeros(0))[0] if enough else None,
        gain=math.exp(0.5 * (wanted.level(even) - level)),
        efficiency=efficiency,
        symbols=wanted.symbols,
        grid=grid,
        slopes=wanted.table(grid, found).curve[0],
        remark=remark,
    )


def _check_search(count: Any, bounds: Any, criterion: Any, starts: Any, seed: Any) -> None:
    for name, value, least in (("count", count, 1), ("starts", starts, 1), ("seed", seed, 0)):
        check_whole(name, value, least)
    if criterion not in CRITERIA:
        raise DataError("criterion", criterion, f"one of {', '.join(CRITERIA)}")
    low, high = both_ends("bounds", bounds)
    if not (0 < low < high < np.inf):
        raise DataError("bounds", bounds, "(lowest, highest) velocity above 0 m/s")
