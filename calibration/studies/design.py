"""Where to measure next: velocities of further shots that tell most."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.errors import DataError
from calibration.fitting.result import FitResult
from calibration.fitting.result_json import plain
from calibration.studies.exchange import CRITERIA, Criterion, Table, exchanged
from calibration.studies.information import information_of, symbol_of
from calibration.studies.planned import (
    USUAL_NOISE,
    Column,
    Plan,
    checked_impacts,
    equations,
    plan_of,
)

TOGETHER = 0.01  # relative distance below which shots are told as one velocity
SPREAD = 112  # velocities of the grid on each of two scales
NEAR_YIELD = 10.0 ** np.arange(-4, -0.9, 0.25)  # relative distances from yield that the grid has
CURVE = 128  # velocities over which a predicted curve is averaged
FINER = 9  # velocities around each shot when it is placed more finely
REFINEMENTS = 5
MOVES = 40  # of its places, at the end
ROUNDS = 3  # of a design in two steps, where what is found depends on the design

Errors = dict[str, float | None]


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
        relative_errors: expected standard error of ln θ with the new shots, beside the old ones;
            of several laws the root mean square; None for what is left open.
        equally_spaced: the same for as many shots equally spaced over the bounds.
        before: the same without new shots; None where too little was measured yet.
        gain: the criterion as a standard error (the target's for "c", the geometric mean of all for
            "D") with equally spaced shots over that with these.
        efficiency: what the design reaches at least of the best possible one of as many shots, by
            the equivalence theorem; None for `two-step`, for which there is none.
        starts: log criterion at which each start ended, ascending.
        symbols: of the parameters.
        grid, slopes: velocities [m/s], (k,), and θ ∂ε/∂θ there, (k, p), of the first law.
        remark: what two steps find instead of the law's own parameters, if anything.
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
    starts: Float[np.ndarray, "starts"]
    symbols: tuple[str, ...]
    grid: Float[np.ndarray, "k"]
    slopes: Float[np.ndarray, "k p"]
    remark: str = ""

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

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return plain(
            {
                "objective": self.objective,
                "criterion": self.criterion,
                "target": self.target,
                "velocity": self.velocity,
                "support": [{"velocity": v, "shots": n} for v, n in self.support],
                "uncertainty": self.uncertainty,
                "bounds": self.bounds,
                "relative_standard_errors": self.relative_errors,
                "relative_standard_errors_equally_spaced": self.equally_spaced,
                "relative_standard_errors_before": self.before,
                "gain": self.gain,
                "efficiency": self.efficiency,
                "log_criterion_of_starts": self.starts,
            }
        )

    def __str__(self) -> str:
        shots = ", ".join(f"{n} at {v:.4g} m/s" for v, n in self.support)
        here, even = (
            "left open" if e[self.target] is None else f"{e[self.target]:.3g}"
            for e in (self.relative_errors, self.equally_spaced)
        )
        text = (
            f"{self.criterion}-optimal for {self.objective}: {shots}; standard error of "
            f"ln {self.target} {here}, equally spaced {even}"
        )
        if self.efficiency is not None:
            text += (
                f"; at least {100 * math.floor(1000 * self.efficiency) / 1000:.1f} % of the best"
            )
        return f"{text}\n{self.remark}" if self.remark else text


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
    route: sj.EnergyBalance | sj.ODE | None = None,
    starts: int = 8,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> Design:
    """Velocities of `count` further shots that tell most of the parameters.

    Shots are exchanged over a grid of velocities from several starts, then placed more finely. An
    optimum trusts the law: where it does not fit, what is fitted depends on where one measures,
    and a few shots elsewhere would show it.

    Args:
        law: with the parameters as far as they are known; several laws of one kind, over which the
            logarithm of the criterion is averaged; or a fit, as `fisher_information` takes it.
        count: number of new shots.
        bounds: (lowest, highest) velocity [m/s] that can be shot.
        criterion: "c": the standard error of `target`; "D", "A", "E": determinant, trace and
            largest eigenvalue of the covariance of ln θ (under `two-step` "D" takes those of each
            step: over all three the covariance is singular for impacts at two velocities); "I":
            the mean variance of the predicted curve between the velocities `over`.
        target: a parameter; chi where there is one, else the first, if left out.
        objective, parameters, material, route: as `fisher_information` takes them.
        over: where the curve is to be predicted; the bounds if left out.
        uncertainty: standard uncertainty of each new ε; 0.01 unless a fit has its own.
        measured, measured_uncertainty: v [m/s] and uncertainty of ε of what is there already; a
            fit has its own.
        starts, seed: of the search.
        progress: called as progress(stage, done, total).

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    _check_search(count, bounds, criterion, starts)
    over = bounds if over is None else over
    there = None
    if measured is not None:
        u = uncertainty if measured_uncertainty is None else measured_uncertainty
        there = measured, USUAL_NOISE if u is None else u
    laws: Sequence[Any] = law if isinstance(law, Sequence) else [law]
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
    errors = checked_impacts(np.zeros(count), error, "count")[1]
    with jax.enable_x64(True):
        wanted = _Wanted(plans, bounds, errors, criterion, target, over)
        return _designed(wanted, starts, seed, progress)


class _Wanted:
    """What is sought, and what shots bring."""

    def __init__(self, plans: list[Plan], bounds, errors: Column, criterion: str, target, over):
        self.plans, self.bounds, self.errors = plans, bounds, errors
        self.even = np.linspace(*bounds, len(errors))
        component, _ = plans[0].component(self.even, errors)
        self.names = tuple(e.label for e in component.elements)
        self.symbols = tuple(map(symbol_of, component.elements))
        self.target = _target(target, self.names, plans[0].specs[plans[0].place].data.name)
        p = len(self.names)
        weight = np.zeros((len(plans), p, p)) + np.eye(p) / p
        if criterion == "c":
            weight = weight * p * (np.array(self.names) == self.target)
        elif criterion == "I":
            curve = self.table(np.linspace(*over, CURVE), self.found(self.even)).curve
            weight = np.swapaxes(curve, 1, 2) @ curve / CURVE
        blocks = [problem.active for _, problem in component.stages]
        self.criterion = Criterion(criterion, weight, blocks)

    def found(self, velocity: Column) -> list[Column]:
        """What the fit of each law finds at these shots; under `model` the law itself."""
        return [
            plan.component(velocity, self.errors)[0].start
            if plan.is_likelihood
            else plan.fitted(velocity, self.errors)[1]
            for plan in self.plans
        ]

    def table(self, velocity: Column, found: list[Column]) -> Table:
        """What shots at these velocities add to the equations of each law, at what was found."""
        errors = np.full(len(velocity), self.errors[0])
        parts = []
        for plan, z in zip(self.plans, found, strict=True):
            component, new = plan.component(velocity, errors)
            told = equations(component, z)
            slope = told.prior_slope + np.sum(told.slope[~new], axis=0)
            middle = told.prior_middle + told.score[~new].T @ told.score[~new]
            parts.append((told.slope[new], told.score[new], slope, middle, told.curve[new]))
        return Table(velocity, *map(np.array, zip(*parts, strict=True)))

    def level(self, velocity: Column) -> float:
        """Log criterion of these shots, at what is found by them."""
        table = self.table(velocity, self.found(velocity))
        return float(self.criterion.value(table.covariance(np.arange(len(velocity)))))

    def errors_at(self, velocity: Column) -> tuple[Errors, str]:
        """Expected standard errors, the root mean square over the laws; and a remark."""
        every = [
            information_of(plan, velocity, self.errors[: len(velocity)]) for plan in self.plans
        ]
        table: Errors = {}
        for name in self.names:
            column = [one.relative_errors[name] for one in every]
            known = [error for error in column if error is not None]
            whole = len(known) == len(column)
            table[name] = float(np.sqrt(np.mean(np.square(known)))) if whole else None
        return table, every[0].remark

    def grid(self) -> Column:
        """Velocities between the bounds, equally spaced on two scales, denser around yield."""
        low, high = self.bounds
        near = [plan.yields * (1 + side * NEAR_YIELD) for plan in self.plans for side in (-1, 1)]
        inside = [v for v in np.concatenate(near) if low < v < high]
        return np.unique(
            [*np.linspace(low, high, SPREAD), *np.geomspace(low, high, SPREAD), *inside]
        )


def _designed(wanted: _Wanted, starts: int, seed: int, progress) -> Design:
    """Where what is found depends on the design, it is sought again with what the last one found."""
    even, grid = wanted.even, wanted.grid()
    shots, ends = even, np.zeros(0)
    is_likelihood = wanted.plans[0].is_likelihood
    for _ in range(1 if is_likelihood else ROUNDS):
        tried, values = _sought(wanted, grid, wanted.found(shots), starts, seed, progress)
        if wanted.level(tried) < wanted.level(shots):
            shots, ends = tried, values
    shots = shots if is_likelihood else _moved(wanted, shots)
    level, count = wanted.level(shots), len(shots)
    efficiency = None
    if is_likelihood:
        every = wanted.table(np.union1d(grid, shots), wanted.found(shots))
        efficiency = min(math.exp(wanted.criterion.least(every, count) - level), 1.0)
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
        starts=ends,
        symbols=wanted.symbols,
        grid=grid,
        slopes=wanted.table(grid, wanted.found(shots)).curve[0],
        remark=remark,
    )


def _moved(wanted: _Wanted, shots: Column) -> Column:
    """The places moved until the level itself, with what is found there, falls no more."""
    from scipy import optimize

    places, count = np.unique(shots, return_counts=True)

    def there(z: Column) -> Column:
        return np.sort(np.repeat(np.clip(np.exp(z), *wanted.bounds), count))

    first, ends = np.log(places), tuple(np.log(wanted.bounds))
    simplex = np.clip(first + 0.1 * np.vstack([0 * first, -np.eye(len(first))]), *ends)
    found = optimize.minimize(
        lambda z: wanted.level(there(z)),
        first,
        method="Nelder-Mead",
        bounds=[ends] * len(first),
        options={"maxfev": MOVES, "initial_simplex": simplex, "xatol": 1e-4},
    )
    return there(found.x) if found.fun < wanted.level(shots) else shots


def _sought(wanted: _Wanted, grid: Column, found, starts: int, seed: int, progress):
    """The best shots from all starts, placed finely; and how each start ended."""
    criterion, table, ends = wanted.criterion, wanted.table(grid, found), []
    for k, start in enumerate(_starts(wanted, grid, starts, seed)):
        ends.append(exchanged(table, criterion, start))
        if progress is not None:
            progress("velocities", k + 1, starts)
    shots, velocity = min(ends, key=lambda end: end[1])[0], grid
    for _ in range(REFINEMENTS):
        chosen, velocity = velocity[shots], _finer(velocity, np.unique(shots))
        start = np.searchsorted(velocity, chosen)
        shots, _ = exchanged(wanted.table(velocity, found), criterion, start)
    return velocity[shots], np.sort([value for _, value in ends])


def _starts(wanted: _Wanted, grid: Column, starts: int, seed: int) -> list[np.ndarray]:
    """Equally spaced shots, then some at a few velocities drawn at random."""
    random, count = np.random.default_rng(seed), len(wanted.even)
    even = np.minimum(np.searchsorted(grid, wanted.even), len(grid) - 1)
    few = min(count, len(wanted.names) + 1)
    drawn = [random.choice(len(grid), few, replace=False) for _ in range(starts - 1)]
    return [even, *(np.resize(some, count) for some in drawn)]


def _finer(velocity: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The velocities at these places of a grid, and some between their neighbours."""
    last = len(velocity) - 1
    ends = [(velocity[max(k - 1, 0)], velocity[min(k + 1, last)]) for k in places]
    windows = [np.linspace(low, high, FINER) for low, high in ends]
    return np.unique(np.concatenate([*windows, velocity[places]]))


def _target(target: str | None, names: Sequence[str], data: str) -> str:
    """The parameter that "c" is of: chi, or the first, unless told."""
    if target is None:
        target = next((name for name in names if name.partition("[")[0] == "chi"), names[0])
    for name in (target, f"{target}[{data}]"):
        if name in names:
            return name
    raise DataError("target", target, f"one of {', '.join(names)}")


def _check_search(count: Any, bounds: Any, criterion: Any, starts: Any) -> None:
    for name, value in (("count", count), ("starts", starts)):
        if not (isinstance(value, int | np.integer) and value >= 1):
            raise DataError(name, value, "a whole number >= 1")
    if criterion not in CRITERIA:
        raise DataError("criterion", criterion, f"one of {', '.join(CRITERIA)}")
    low, high = bounds
    if not (0 < low < high < np.inf):
        raise DataError("bounds", bounds, "(lowest, highest) velocity above 0 m/s")
