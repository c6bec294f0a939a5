"""Designs: the velocities at which further shots determine parameters best.

What a shot adds depends on its velocity alone, so it is tabulated over a grid. Shots are exchanged over
the grid, one at a time, from several starts, then placed more finely.
"""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float, Int

import softjax as sj
from calibration.data.checks import check_whole
from calibration.data.json_file import plain
from calibration.errors import DataError, listed
from calibration.fitting.curves import yield_velocity
from calibration.fitting.estimates import FitEstimates
from calibration.fitting.laws import eps_up_of
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
}
SPREAD = 112  # velocities of the grid on each of two scales
NEAR_YIELD = 10.0 ** np.arange(-4, -0.9, 0.25)  # relative distances from yield that the grid has
FINER = 9  # velocities around each shot when it is placed more finely
REFINEMENTS = 5  # how often that is done
MOST_SHOTS = 1000  # that are planned for a precision
BETTER = 1e-10  # least decrease of a log criterion that is worth an exchange
TOGETHER = 0.01  # relative distance below which shots count as one velocity
DIFFERENCE = 1e-4  # of θ, of what follows from it
CURVE = "eps"  # of a target: ε at a velocity, eps@2
MANY = 64  # shots from which on two starts are enough
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
            determinant of the covariance of ln θ.
        target_symbol: of the target.
        coefficient: ε expected of each shot.
        bounds: v [m/s] within which they were searched for.
        minimised: the criterion as a standard error: with the new shots, before them (None where
            nothing was known), and with as many shots equally spaced.
        relative_errors: expected standard error of ln θ with the new shots and what was known
            before, and of a target that follows from θ; None for parameters that are not determined.
        equally_spaced: the same for as many shots equally spaced over the bounds.
        gain: the criterion as a standard error (the target's for "c", the geometric mean of all for
            "D") with equally spaced shots over that with these.
        grid, slopes: velocities [m/s], (k,), and θ ∂ε/∂θ there, (k, p).
    """

    criterion: str
    target: str
    target_symbol: str
    coefficient: Float[np.ndarray, " n"]
    bounds: tuple[float, float]
    minimised: tuple[float | None, ...]
    relative_errors: Errors
    equally_spaced: Errors
    gain: float
    grid: Float[np.ndarray, " k"]
    slopes: Float[np.ndarray, "k p"]

    @property
    def criterion_in_words(self) -> str:
        """The quantity that the design minimises."""
        return CRITERIA[self.criterion].format(target=self.target_symbol)

    @property
    def support(self) -> list[tuple[float, int]]:
        """(velocity [m/s], number of shots there): shots within a percent taken together."""
        breaks = np.flatnonzero(self.velocity[1:] > self.velocity[:-1] * (1 + TOGETHER)) + 1
        groups = np.split(self.velocity, breaks)
        return [(float(np.mean(group)), len(group)) for group in groups]

    def to_dict(self) -> dict[str, Any]:
        """A dictionary for JSON."""
        left_out = ("symbols", "target_symbol", "grid", "slopes")
        table = {name: value for name, value in vars(self).items() if name not in left_out}
        table["support"] = [{"velocity": v, "shots": n} for v, n in self.support]
        return plain(table)

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
        return "\n".join([text, reached, *lone, searched, *self.taken_as_known])


@dataclass(frozen=True, eq=False)
class Criterion:
    """Objective to minimise: the logarithm of the variance aᵀ C a.

    Attributes:
        aim: a, (p,); None for D: the geometric mean of the variances, correlations counted.
        before: A₀, (p, p).
        of_inputs: covariance of ln θ of uncertain inputs, which no shot makes smaller, for D; None: none.
        by_inputs: standard deviation of the target by these, relative.
    """

    aim: Float[np.ndarray, " p"] | None
    before: Matrices
    of_inputs: Matrices | None = None
    by_inputs: float = 0.0

    def value(self, information: Matrices) -> Any:
        """Logarithm of the criterion, of (..., p, p)."""
        if self.aim is None:
            covariance = covariance_of(information, self.of_inputs)
            return np.linalg.slogdet(covariance)[1] / covariance.shape[-1]
        variance = np.einsum("i,...ij,j->...", self.aim, covariance_of(information), self.aim)
        return np.log(variance + self.by_inputs**2)

    def size(self, information: Matrices) -> float:
        """The criterion as a standard error."""
        return math.exp(0.5 * float(self.value(information)))

    def exchanged(self, shots: Matrices, places: Any) -> tuple[Int[np.ndarray, " n"], float]:
        """Each shot moved to its best place until none moves any more, and the criterion there."""
        places = np.array(places)
        best = float(self.value(self.before + np.sum(shots[places], axis=0)))
        while True:
            before = best
            for i in range(len(places)):
                others = self.before + np.sum(shots[np.delete(places, i)], axis=0)
                values = self.value(others + shots)
                k = int(np.argmin(values))
                if values[k] < best - BETTER:
                    places[i], best = k, float(values[k])
            if best >= before - BETTER:
                return np.sort(places), best

    def greedy(self, shots: Matrices, size: float) -> Int[np.ndarray, " n"]:
        """The best shot, and the best further one, until the criterion is of a size; `MOST_SHOTS` at most."""
        places: list[int] = []
        information = self.before
        while len(places) < MOST_SHOTS and not (places and self.size(information) <= size):
            places.append(int(np.argmin(self.value(information + shots))))
            information = information + shots[places[-1]]
        return np.array(places)


@dataclass(frozen=True, eq=False)
class Search:
    """The velocities that a design may have, and how the best of them are looked for."""

    plan: Plan
    rule: Criterion
    grid: Column
    starts: int
    seed: int
    progress: Progress | None

    @cached_property
    def shots(self) -> Matrices:
        """Information of a shot at each velocity of the grid, (k, p, p)."""
        return self.plan.shots(self.grid)[0]

    def added(self, velocity: Column) -> Matrices:
        """Information with further shots."""
        return self.rule.before + np.sum(self.plan.shots(velocity)[0], axis=0)

    def best(self, count: int, first: Any = None) -> Column:
        """The best shots from all starts: `first`, equally spaced ones, a few velocities drawn at random."""
        random, grid, ends = np.random.default_rng(self.seed), self.grid, []
        few = min(count, len(self.plan.names) + 1)
        even = np.linspace(grid[0], grid[-1], count)
        starts = [] if first is None else [np.resize(first, count)]
        starts += [np.clip(np.searchsorted(grid, even), 0, len(grid) - 1)]
        total = self.starts if count <= MANY else min(2, self.starts)
        while len(starts) < total:
            starts.append(np.resize(random.choice(len(grid), few, replace=False), count))
        for k, start in enumerate(starts[:total]):
            ends.append(self.rule.exchanged(self.shots, start))
            if self.progress is not None:
                self.progress("velocities", k + 1, total)
        return self._refined(min(ends, key=lambda end: end[1])[0])

    def _refined(self, places: np.ndarray) -> Column:
        velocity = self.grid
        for _ in range(REFINEMENTS):
            chosen, padded = velocity[places], np.pad(velocity, 1, "edge")
            finer = [np.linspace(padded[k], padded[k + 2], FINER) for k in np.unique(places)]
            velocity = np.unique(np.concatenate([*finer, chosen]))
            start = np.searchsorted(velocity, chosen)
            places, _ = self.rule.exchanged(self.plan.shots(velocity)[0], start)
        return velocity[places]

    def fewest(self, precision: float) -> Column:
        """The fewest shots that reach a standard error.

        Raises:
            DataError: where it is reached without any, or is not by `MOST_SHOTS`.
        """
        if np.any(self.rule.before) and (now := self.rule.size(self.rule.before)) <= precision:
            accepted = f"below {100 * now:.2g} %, which is known already"
            raise DataError("precision", f"{100 * precision:.4g} %", accepted)
        places = self.rule.greedy(self.shots, precision)
        reached = self.rule.size(self.rule.before + np.sum(self.shots[places], axis=0))
        if reached > precision:
            ends = f"from {self.grid[0]:.4g} to {self.grid[-1]:.4g} m/s"
            accepted = f"of what shots {ends} determine"
            if reached <= NO_BOUND:
                least = 100 * reached
                step = 10 ** (math.floor(math.log10(least)) - 1)
                best = f"{step * math.ceil(least / step):.2g} % or more, the best that"
                accepted = f"{best} {len(places)} shots {ends} bring"
                if self.rule.by_inputs > precision:
                    part = 100 * self.rule.by_inputs
                    accepted += (
                        f"; uncertain inputs alone leave {part:.2g} %, state them more exactly"
                    )
            raise DataError("precision", f"{100 * precision:.4g} %", accepted)
        too_few, enough = 0, len(places)
        found = self.best(enough, places)
        while enough - too_few > 1:
            middle = (too_few + enough) // 2
            shots = self.best(middle, places)
            if self.rule.size(self.added(shots)) <= precision:
                enough, found = middle, shots
            else:
                too_few = middle
        return found


def optimal_velocities(
    law: sj.ContactLaw | FitEstimates,
    count: int | None,
    bounds: tuple[float, float],
    *,
    criterion: str = "c",
    target: str | None = None,
    precision: float | None = None,
    parameters: Mapping[str, Any] | None = None,
    material: str | None = None,
    uncertainty: float | None = None,
    measured: ArrayLike | None = None,
    measured_uncertainty: ArrayLike | None = None,
    route: sj.AbstractRoute | None = None,
    starts: int = 8,
    seed: int = 0,
    progress: Progress | None = None,
) -> Design:
    """Velocities of further shots that determine the parameters best.

    An optimum trusts the law: where it does not fit, what is fitted depends on where one measures,
    and a few shots elsewhere would show it.

    Args:
        law: with the parameters as far as they are known; or a fit, as `fisher_information` takes it.
        count: number of new shots, each of a new specimen or launch where these share
            errors; None with `precision`.
        bounds: (lowest, highest) velocity [m/s] that can be shot.
        criterion: "c": the standard error of `target`; "D": the determinant of the covariance of ln θ.
        target: a parameter, a number that follows from them as a fit's table has it, such as
            eps_up, or ε at a velocity: "eps@2" [m/s]; chi where there is one, else the first
            parameter, if left out. For c alone.
        precision: relative standard error of the target, in place of `count`: as few shots as reach
            it, 1000 at most. For c alone.
        parameters, material, route: as `fisher_information` takes them.
        uncertainty: standard uncertainty of each new ε; 0.01 unless a fit has its own, which is
            that of a point of the same kind as its data at that velocity.
        measured, measured_uncertainty: v [m/s] and uncertainty of ε of what is there already; a
            fit has its own.
        starts, seed: of the search.
        progress: called as progress(stage, done, total).

    Raises:
        ValueError: naming the argument, its value and what is accepted; where the precision cannot
            be reached, with the best there is.
    """
    if (count is None) == (precision is None):
        raise DataError("count", count, "given, or precision in its place")
    if count is not None:
        check_whole("count", count, 1)
    for name, value, lowest in (("starts", starts, 1), ("seed", seed, 0)):
        check_whole(name, value, lowest)
    if criterion not in CRITERIA:
        raise DataError("criterion", criterion, f"one of {', '.join(CRITERIA)}")
    low, high = both_ends("bounds", bounds)
    if not (0 < low < high < np.inf):
        raise DataError("bounds", bounds, "(lowest, highest) velocity above 0 m/s")
    if measured is None and measured_uncertainty is not None:
        raise DataError("measured_uncertainty", measured_uncertainty, "given with measured")
    for name, argument in (("target", target), ("precision", precision)):
        if argument is not None and criterion != "c":
            raise DataError(name, argument, f"left out with criterion {criterion}")
    for name, size in (("uncertainty", uncertainty), ("precision", precision)):
        if size is not None and not (np.isfinite(size) and size > 0):
            raise DataError(name, size, "positive")
    u = USUAL_NOISE if uncertainty is None else uncertainty
    measured_u = u if measured_uncertainty is None else measured_uncertainty
    known = None if measured is None else (measured, measured_u)
    reach = [low, high, *([] if (at := _velocity_of(target)) is None else [at])]
    of: Any = {"parameters": parameters, "route": route, "material": material}
    plan = plan_of(law, reach, uncertainty=uncertainty, measured=known, **of)
    symbols = dict(zip(plan.names, plan.symbols, strict=True))
    with jax.enable_x64(True):
        target = _target_of(target, plan)
        aims: dict[str, np.ndarray] = plan.aims
        aims[target] = _gradient_of(target, plan)
        aim = aims[target] if criterion == "c" else None
        by_inputs = plan.by_inputs | {target: _by_inputs(target, plan)}
        rule = Criterion(aim, plan.before, plan.of_inputs, by_inputs[target])
        search = Search(plan, rule, _grid(plan, low, high), starts, seed, progress)
        shots = search.best(count) if count is not None else search.fewest(precision)  # type: ignore[arg-type]
        even = np.linspace(low, high, len(shots))
        each = search.added(shots), plan.before, search.added(even)
        after, before, even_errors = (errors_of(matrix, aims, by_inputs) for matrix in each)
        sizes = [rule.size(information) for information in each]
        reached, now, by_even = (size if size <= NO_BOUND else None for size in sizes)
        is_known = bool(np.any(plan.before))
        return Design(
            criterion=criterion,
            target=target,
            target_symbol=symbols.get(target, _symbol_of(target)),
            names=plan.names,
            symbols=plan.symbols,
            velocity=shots,
            coefficient=plan.slopes(shots)[0],
            uncertainty=np.array(plan.shots(shots)[1]),
            bounds=(float(search.grid[0]), float(search.grid[-1])),
            minimised=(reached, now if is_known else None, by_even),
            relative_errors=after,
            equally_spaced=even_errors,
            before=before if is_known else None,
            gain=sizes[2] / sizes[0],
            grid=search.grid,
            slopes=plan.slopes(search.grid)[1],
            taken_as_known=plan.taken_as_known,
        )


def _velocity_of(target: str | None) -> float | None:
    """v [m/s] of a target eps@v; None for others."""
    name, at, text = (target or "").partition("@")
    if not at:
        return None
    with suppress(ValueError):
        if name == CURVE and 0 < (velocity := float(text)) < math.inf:
            return velocity
    raise DataError("target", target, f"{CURVE}@v with a velocity above 0 m/s, as {CURVE}@2")


def _symbol_of(target: str) -> str:
    velocity = _velocity_of(target)
    return symbol(target).text if velocity is None else f"ε({velocity:g} m/s)"


def _target_of(target: str | None, plan: Plan) -> str:
    """Target of a plan: a label of the parameters, a name of `DERIVED`, or eps@v."""
    free = plan.material.free
    if target is None:
        return free.get("chi", plan.names[0])
    if target in free or target in plan.names:
        return free.get(target, target)
    is_zhou = plan.material.model.law_type is sj.Zhou
    follow = [name for name in DERIVED if is_zhou and name not in free]
    if target in follow or _velocity_of(target) is not None:
        return target
    raise DataError("target", target, f"one of {listed([*plan.names, *follow])}, or {CURVE}@v")


def _gradient_of(target: str, plan: Plan) -> Float[np.ndarray, " p"]:
    """∂ ln q/∂ ln θ of a target q, which has the standard error of its product with ln θ."""
    if target in plan.names:
        return (np.array(plan.names) == target).astype(float)
    if (velocity := _velocity_of(target)) is not None:
        value, slope = plan.slopes(np.array([velocity]))
        if not value[0] > 0:
            raise DataError("target", target, "a velocity at which the law rebounds")
        return slope[0] / value[0]
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


def _by_inputs(target: str, plan: Plan) -> float:
    """Relative standard deviation of a target by uncertain inputs of the fit."""
    budget = plan.result and plan.result.budget
    if not budget:
        return 0.0
    if (velocity := _velocity_of(target)) is not None:
        at = np.array([velocity])
        return float((budget.curve_error(plan.material, at) / plan.slopes(at)[0])[0])
    label = target if target in budget.values else f"{target}[{plan.material.name}]"
    value = budget.values.get(label)
    return budget.input_error(label) / abs(value) if value else 0.0


def _grid(plan: Plan, low: float, high: float) -> Column:
    """Velocities between the bounds, equally spaced on two scales, denser around yield."""
    yields = yield_velocity(plan.material.law) or 0.0
    near = np.clip(yields * np.append(1 - NEAR_YIELD, 1 + NEAR_YIELD), low, high)
    return np.unique([*np.linspace(low, high, SPREAD), *np.geomspace(low, high, SPREAD), *near])
