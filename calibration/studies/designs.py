"""Designs: the velocities at which further shots determine parameters best.

What a shot adds depends on its velocity alone, so it is tabulated over a grid. Shots are exchanged over
the grid, one at a time, from several starts, then placed more finely. Several laws, or draws of a
posterior, stand side by side; the logarithm of the criterion is averaged over them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float, Int

import softjax as sj
from calibration.data.checks import check_whole
from calibration.data.json_file import plain
from calibration.errors import DataError, listed
from calibration.fitting.curves import yield_velocity
from calibration.fitting.laws import eps_up_of
from calibration.fitting.result import FitResult
from calibration.fitting.summary import chi_of, critical_velocity_of
from calibration.studies.inputs import both_ends
from calibration.studies.plans import (
    NO_BOUND,
    USUAL_NOISE,
    Column,
    Errors,
    Matrices,
    Plan,
    Planned,
    covariance_of,
    errors_of,
    plan_of,
)
from calibration.symbols import symbol

CRITERIA = {  # what each makes small
    "c": "standard error of ln {target}",
    "D": "geometric mean of the standard errors of ln θ, correlations included",
    "A": "root mean square of the standard errors of ln θ",
    "I": "root mean square of the standard error of ε from {low:.4g} to {high:.4g} m/s",
}
SPREAD = 112  # velocities of the grid on each of two scales
NEAR_YIELD = 10.0 ** np.arange(-4, -0.9, 0.25)  # relative distances from yield that the grid has
CURVE = 128  # velocities over which a predicted curve is averaged
FINER = 9  # velocities around each shot when it is placed more finely
REFINEMENTS = 5  # how often that is done
BETTER = 1e-10  # least decrease of a log criterion that is worth an exchange
TOGETHER = 0.01  # relative distance below which shots count as one velocity
DIFFERENCE = 1e-4  # of θ, of what follows from it
# numbers that follow from the parameters of Zhou's law
DERIVED = {"eps_up": eps_up_of, "chi": chi_of, "critical_velocity": critical_velocity_of}
ONE_VELOCITY = (
    "Shots at one velocity cannot test the law, and are best only if it holds: add others."
)

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(Planned):
    """Velocities for further shots, and what they are expected to bring.

    Attributes:
        criterion, target: what was made small: "c" the standard error of the target, "D" the
            determinant of the covariance of ln θ, "A" its mean variance, "I" the mean variance of
            the predicted curve.
        target_symbol: of the target.
        coefficient: ε expected of each shot.
        bounds: v [m/s] within which they were searched for.
        over: v [m/s] between which criterion "I" predicts the curve.
        minimised: the criterion as a standard error: with the new shots, before them (None where
            nothing was known), and with as many shots equally spaced.
        relative_errors: expected standard error of ln θ with the new shots and what was known
            before, and of a target that follows from θ; of several laws the root mean square; None
            for parameters that are not determined.
        equally_spaced: the same for as many shots equally spaced over the bounds.
        gain: the criterion as a standard error (the target's for "c", the geometric mean of all for
            "D") with equally spaced shots over that with these.
        grid, slopes: velocities [m/s], (k,), and θ ∂ε/∂θ there, (k, p), of the first law.
    """

    criterion: str
    target: str
    target_symbol: str
    coefficient: Float[np.ndarray, " n"]
    bounds: tuple[float, float]
    over: tuple[float, float]
    minimised: tuple[float | None, ...]
    relative_errors: Errors
    equally_spaced: Errors
    gain: float
    grid: Float[np.ndarray, " k"]
    slopes: Float[np.ndarray, "k p"]

    @property
    def criterion_in_words(self) -> str:
        """The quantity that the design minimises."""
        low, high = self.over
        return CRITERIA[self.criterion].format(target=self.target_symbol, low=low, high=high)

    @property
    def support(self) -> list[tuple[float, int]]:
        """(velocity [m/s], number of shots there): shots within a percent taken together."""
        breaks = np.flatnonzero(self.velocity[1:] > self.velocity[:-1] * (1 + TOGETHER)) + 1
        groups = np.split(self.velocity, breaks)
        return [(float(np.mean(group)), len(group)) for group in groups]

    def to_dict(self) -> dict[str, Any]:
        """A dictionary for JSON."""
        left_out = ("symbols", "target_symbol", "grid", "slopes", "without")
        table = {name: value for name, value in vars(self).items() if name not in left_out}
        table["support"] = [{"velocity": v, "shots": n} for v, n in self.support]
        return plain(table | {"without_sensors": self.without})

    def __str__(self) -> str:
        shots = []
        for v, n in self.support:
            at = int(np.argmin(np.abs(self.velocity - v)))
            expected = f"ε = {self.coefficient[at]:.3f} ± {self.uncertainty[at]:.2g}"
            shots.append(f"{n} at {v:.4g} m/s ({expected})")
        after, now, even = ("not determined" if e is None else f"{e:.3g}" for e in self.minimised)
        text = f"Best shots: {', '.join(shots)}."
        reached = f"The {self.criterion_in_words} (criterion {self.criterion}) will be {after}; "
        reached += f"it is {now} now, and " if self.before else "it "
        reached += f"would be {even} with shots equally spaced."
        low, high = self.bounds
        searched = f"Velocities allowed: {low:.4g} to {high:.4g} m/s; planned {self._range}."
        lone = [ONE_VELOCITY] if len(self.support) == 1 else []
        sensed = self._sensed(self.relative_errors)
        return "\n".join([text, reached, *lone, searched, *sensed, *self.taken_as_known])


@dataclass(frozen=True, eq=False)
class Criterion:
    """Objective to minimise: the logarithm of a mean variance tr(L C), averaged over the laws.

    Attributes:
        weight: L, (laws, p, p); None for D: the geometric mean of the variances, correlations counted.
        before: A₀, (laws, p, p).
    """

    weight: Matrices | None
    before: Matrices

    def value(self, information: Matrices) -> Any:
        """Its logarithm, of (laws, ..., p, p)."""
        covariance = covariance_of(information)
        if self.weight is None:
            level = np.linalg.slogdet(covariance)[1] / covariance.shape[-1]
        else:
            level = np.log(np.einsum("lij,l...ij->l...", self.weight, covariance))
        return np.mean(level, axis=0)

    def exchanged(self, shots: Matrices, places: Any) -> tuple[Int[np.ndarray, " n"], float]:
        """Each shot moved to its best place until none moves any more, and the criterion there."""
        places = np.array(places)
        best = float(self.value(self.before + np.sum(shots[:, places], axis=1)))
        while True:
            begun = best
            for i in range(len(places)):
                others = self.before + np.sum(shots[:, np.delete(places, i)], axis=1)
                values = self.value(others[:, None] + shots)
                k = int(np.argmin(values))
                if values[k] < best - BETTER:
                    places[i], best = k, float(values[k])
            if best >= begun - BETTER:
                return np.sort(places), best


def optimal_velocities(
    law: sj.ContactLaw | FitResult | Sequence[sj.ContactLaw],
    count: int,
    bounds: tuple[float, float],
    *,
    criterion: str = "c",
    target: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    material: str | None = None,
    over: tuple[float, float] | None = None,
    uncertainty: float | None = None,
    sensors: Mapping[str, float] | None = None,
    measured: ArrayLike | None = None,
    measured_uncertainty: ArrayLike | None = None,
    route: sj.EnergyBalance | sj.ClosedForm | sj.ODE | None = None,
    starts: int = 8,
    seed: int = 0,
    progress: Progress | None = None,
) -> Design:
    """Velocities of `count` further shots that determine the parameters best.

    An optimum trusts the law: where it does not fit, what is fitted depends on where one measures,
    and a few shots elsewhere would show it.

    Args:
        law: with the parameters as far as they are known; several laws of one kind, over which the
            logarithm of the criterion is averaged; or a fit, as `fisher_information` takes it.
        count: number of new shots, each of a new specimen or launch where these share
            errors.
        bounds: (lowest, highest) velocity [m/s] that can be shot.
        criterion: "c": the standard error of `target`; "D", "A": determinant and trace of the
            covariance of ln θ; "I": the mean variance of the predicted curve between the
            velocities `over`.
        target: a parameter, or a number that follows from them as a fit's table has it, such as
            eps_up; chi where there is one, else the first parameter, if left out. For c alone.
        parameters, material, route, sensors: as `fisher_information` takes them.
        over: where the curve is to be predicted by criterion I; the bounds if left out.
        uncertainty: standard uncertainty of each new ε; 0.01 unless a fit has its own, which is
            that of a point of the same kind as its data at that velocity.
        measured, measured_uncertainty: v [m/s] and uncertainty of ε of what is there already; a
            fit has its own.
        starts, seed: of the search.
        progress: called as progress(stage, done, total).

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    for name, value, lowest in (("count", count, 1), ("starts", starts, 1), ("seed", seed, 0)):
        check_whole(name, value, lowest)
    if criterion not in CRITERIA:
        raise DataError("criterion", criterion, f"one of {', '.join(CRITERIA)}")
    low, high = both_ends("bounds", bounds)
    if not (0 < low < high < np.inf):
        raise DataError("bounds", bounds, "(lowest, highest) velocity above 0 m/s")
    if measured is None and measured_uncertainty is not None:
        raise DataError("measured_uncertainty", measured_uncertainty, "given with measured")
    for name, argument, acts in (("target", target, "c"), ("over", over, "I")):
        if argument is not None and criterion != acts:
            raise DataError(name, argument, f"left out with criterion {criterion}")
    if uncertainty is not None and not (np.isfinite(uncertainty) and uncertainty > 0):
        raise DataError("uncertainty", uncertainty, "positive")
    over = (low, high) if over is None else both_ends("over", over)
    u = USUAL_NOISE if uncertainty is None else uncertainty
    measured_u = u if measured_uncertainty is None else measured_uncertainty
    known = None if measured is None else (measured, measured_u)
    of: Any = {"parameters": parameters, "route": route, "material": material, "sensors": sensors}
    laws: Sequence[Any] = law if isinstance(law, Sequence) else [law]
    if not laws:
        raise DataError("law", law, "one law or more, or a FitResult")
    reach = [low, high, *over]
    plans = [plan_of(law, reach, uncertainty=uncertainty, measured=known, **of) for law in laws]
    first, even = plans[0], np.linspace(low, high, count)
    symbols = dict(zip(first.names, first.symbols, strict=True))
    with jax.enable_x64(True):
        target = _target_of(target, first)
        aims: dict[str, np.ndarray] = first.aims
        aims[target] = np.stack([_gradient_of(target, plan) for plan in plans])
        weight = _weight(criterion, plans, aims[target], over)
        rule = Criterion(weight, np.stack([plan.before for plan in plans]))
        grid, search = _grid(plans, low, high), (even, starts, seed, progress)
        shots = _sought(plans, rule, grid, *search)
        new, spaced = (rule.before + np.sum(_table(plans, v), axis=1) for v in (shots, even))
        without = None
        if first.sensors:
            bare = [replace(plan, sensors={}) for plan in plans]
            table = _table(bare, _sought(bare, rule, grid, *search))
            without = errors_of(rule.before + np.sum(table, axis=1), aims)
        each = new, rule.before, spaced
        after, before, even_errors = (errors_of(information, aims) for information in each)
        levels = [float(rule.value(information)) for information in each]
        sizes = [math.exp(0.5 * level) for level in levels]
        reached, now, by_even = (size if size <= NO_BOUND else None for size in sizes)
        is_known = bool(np.any(first.before))
        return Design(
            criterion=criterion,
            target=target,
            target_symbol=symbols.get(target, symbol(target).text),
            names=first.names,
            symbols=first.symbols,
            velocity=shots,
            coefficient=first.slopes(shots)[0],
            uncertainty=np.array(first.shots(shots)[1]),
            bounds=(float(grid[0]), float(grid[-1])),
            over=over,
            minimised=(reached, now if is_known else None, by_even),
            relative_errors=after,
            equally_spaced=even_errors,
            before=before if is_known else None,
            gain=sizes[2] / sizes[0],
            grid=grid,
            slopes=first.slopes(grid)[1],
            taken_as_known=first.taken_as_known,
            sensors=first.sensors,
            without=without,
        )


def _target_of(target: str | None, plan: Plan) -> str:
    """Its label among the parameters, or its name among `DERIVED`."""
    free = plan.material.free
    if target is None:
        return free.get("chi", plan.names[0])
    if target in free or target in plan.names:
        return free.get(target, target)
    is_zhou = plan.material.model.law_type is sj.Zhou
    follow = [name for name in DERIVED if is_zhou and name not in free]
    if target in follow:
        return target
    raise DataError("target", target, f"one of {listed([*plan.names, *follow])}")


def _gradient_of(target: str, plan: Plan) -> Float[np.ndarray, " p"]:
    """∂ ln q/∂ ln θ of a target q, which has the standard error of its product with ln θ."""
    if target in plan.names:
        return (np.array(plan.names) == target).astype(float)
    values = plan.material.model.inside(plan.material.values)

    def log(name: str, factor: float) -> float:
        law = replace(plan.material, values={**values, name: float(values[name]) * factor}).law
        return math.log(max(float(DERIVED[target](law)), 1e-300))

    ends = [[log(n, 1 + side * DIFFERENCE) for side in (-1, 1)] for n in plan.material.free]
    gradient = np.array([(up - down) / (2 * DIFFERENCE) for down, up in ends])
    if not np.any(gradient):
        accepted = f"one of {listed(plan.names)}: these are free and none of them affects it"
        raise DataError("target", target, accepted)
    return gradient


def _weight(criterion: str, plans: Sequence[Plan], aims: np.ndarray, over) -> Matrices | None:
    """L of each law, or None; see `Criterion`."""
    if criterion == "D":
        return None
    if criterion == "c":
        return aims[:, :, None] * aims[:, None, :]
    if criterion == "A":
        return np.broadcast_to(np.eye(aims.shape[1]) / aims.shape[1], (*aims.shape, aims.shape[1]))
    curve = np.stack([plan.slopes(np.linspace(over[0], over[1], CURVE))[1] for plan in plans])
    return np.swapaxes(curve, 1, 2) @ curve / CURVE


def _table(plans: Sequence[Plan], velocity: Column) -> Matrices:
    """Information of a shot at each velocity, (laws, k, p, p)."""
    return np.stack([plan.shots(velocity)[0] for plan in plans])


def _grid(plans: Sequence[Plan], low: float, high: float) -> Column:
    """Velocities between the bounds, equally spaced on two scales, denser around yield."""
    yields = np.array([yield_velocity(plan.material.law) or 0.0 for plan in plans])
    near = np.clip(np.outer(yields, [*(1 - NEAR_YIELD), *(1 + NEAR_YIELD)]).ravel(), low, high)
    return np.unique([*np.linspace(low, high, SPREAD), *np.geomspace(low, high, SPREAD), *near])


def _sought(
    plans: Sequence[Plan], rule: Criterion, grid: Column, even: Column, starts, seed, progress
):
    """The best shots from all starts: equally spaced ones, and a few velocities drawn at random."""
    random, table, ends = np.random.default_rng(seed), _table(plans, grid), []
    few = min(len(even), len(plans[0].names) + 1)
    for k in range(starts):
        start = np.clip(np.searchsorted(grid, even), 0, len(grid) - 1)
        if k:
            start = np.resize(random.choice(len(grid), few, replace=False), len(even))
        ends.append(rule.exchanged(table, start))
        if progress is not None:
            progress("velocities", k + 1, starts)
    places, velocity = min(ends, key=lambda end: end[1])[0], grid
    for _ in range(REFINEMENTS):
        chosen, padded = velocity[places], np.pad(velocity, 1, "edge")
        finer = [np.linspace(padded[k], padded[k + 2], FINER) for k in np.unique(places)]
        velocity = np.unique(np.concatenate([*finer, chosen]))
        start = np.searchsorted(velocity, chosen)
        places, _ = rule.exchanged(_table(plans, velocity), start)
    return velocity[places]
