"""Shots being placed: on a grid of velocities first, then more and more finely."""

from collections.abc import Callable

import numpy as np

from calibration.studies.exchange import Criterion, Table, exchanged
from calibration.studies.information import NO_BOUND, information_of, symbol_of
from calibration.studies.planned import Column, Plan, equations
from calibration.studies.targets import gradient_of, target_of

SPREAD = 112  # velocities of the grid on each of two scales
NEAR_YIELD = 10.0 ** np.arange(-4, -0.9, 0.25)  # relative distances from yield that the grid has
CURVE = 128  # velocities over which a predicted curve is averaged
FINER = 9  # velocities around each shot when it is placed more finely
REFINEMENTS = 5

Errors = dict[str, float | None]
Progress = Callable[[str, int, int], None]


class Wanted:
    """What is sought, and what shots bring."""

    def __init__(self, plans: list[Plan], bounds, errors: Column, criterion: str, target, over):
        self.plans, self.bounds, self.errors = plans, bounds, errors
        self.even = np.linspace(bounds[0], bounds[1], len(errors))
        component, _ = plans[0].component(self.even, errors)
        self.names = tuple(e.label for e in component.elements)
        self.symbols = tuple(map(symbol_of, component.elements))
        self.target = target_of(target, component.elements, plans[0])
        aim = [gradient_of(self.target, self.names, one, self.even, errors) for one in plans]
        self.gradients = np.stack(aim)
        p = len(self.names)
        weight = np.zeros((len(plans), p, p)) + np.eye(p) / p
        if criterion == "c":
            weight = self.gradients[:, :, None] * self.gradients[:, None, :]
        elif criterion == "I":
            curve = self.table(np.linspace(over[0], over[1], CURVE), self.found(self.even)).curve
            weight = np.swapaxes(curve, 1, 2) @ curve / CURVE
        blocks = [problem.active for _, problem in component.stages]
        self.criterion = Criterion(criterion, weight, blocks)

    def found(self, velocity: Column) -> list[Column]:
        """What the fit of each law finds at these shots; under `model` the law itself."""
        errors = self.errors[: len(velocity)]
        return [
            plan.component(velocity, errors)[0].start
            if plan.is_likelihood
            else plan.fitted(velocity, errors)[1]
            for plan in self.plans
        ]

    def table(self, velocity: Column, found: list[Column]) -> Table:
        """What shots at these velocities add to the equations of each law, at what was found."""
        errors = np.full(len(velocity), self.errors[0])
        pairs = zip(self.plans, found, strict=True)
        each = [equations(plan, velocity, errors, z) for plan, z in pairs]
        return Table(*map(np.stack, zip(*each, strict=True)))

    def level(self, velocity: Column) -> float:
        """Log criterion of these shots, at what is found by them."""
        table = self.table(velocity, self.found(velocity))
        return float(self.criterion.value(table.covariance(np.arange(len(velocity)))))

    def errors_at(self, velocity: Column) -> tuple[Errors, str]:
        """Expected standard errors, of the target too; root mean squares over the laws; a remark."""
        every = [
            information_of(plan, velocity, self.errors[: len(velocity)]) for plan in self.plans
        ]
        table: Errors = {}
        for name in self.names:
            column = [one.relative_errors[name] for one in every]
            known = [error for error in column if error is not None]
            whole = len(known) == len(column)
            table[name] = float(np.sqrt(np.mean(np.square(known)))) if whole else None
        if self.target not in self.names:
            table[self.target] = self._error_of_target(velocity)
        return table, every[0].remark

    def _error_of_target(self, velocity: Column) -> float | None:
        """Of a number that follows from the parameters, which may be known where they are not."""
        shots = np.arange(len(velocity))
        every = self.table(velocity, self.found(velocity)).covariance(shots)
        variances = np.einsum("li,lij,lj->l", self.gradients, every, self.gradients)
        error = float(np.sqrt(np.mean(variances)))
        return error if error < NO_BOUND else None

    def grid(self) -> Column:
        """Velocities between the bounds, equally spaced on two scales, denser around yield."""
        low, high = self.bounds
        near = [plan.yields * (1 + side * NEAR_YIELD) for plan in self.plans for side in (-1, 1)]
        inside = [v for v in np.concatenate(near) if low < v < high]
        return np.unique(
            [*np.linspace(low, high, SPREAD), *np.geomspace(low, high, SPREAD), *inside]
        )


def sought(wanted: Wanted, grid: Column, found, starts: int, seed: int, progress) -> Column:
    """The best shots from all starts, placed finely, around what was found."""
    criterion, table, ends = wanted.criterion, wanted.table(grid, found), []
    for k, start in enumerate(_starts(wanted, grid, starts, seed)):
        ends.append(exchanged(table, criterion, start))
        if progress is not None:
            progress("velocities", k + 1, starts)
    shots, velocity = min(ends, key=lambda end: end[1])[0], grid
    for _ in range(REFINEMENTS):
        chosen, velocity = velocity[shots], _finer(velocity, np.unique(shots))
        places = np.asarray(np.searchsorted(velocity, chosen))
        shots, _ = exchanged(wanted.table(velocity, found), criterion, places)
    return velocity[shots]


def _starts(wanted: Wanted, grid: Column, starts: int, seed: int) -> list[np.ndarray]:
    """Equally spaced shots, then some at a few velocities drawn at random."""
    random, count = np.random.default_rng(seed), len(wanted.even)
    even = np.clip(np.searchsorted(grid, wanted.even), 0, len(grid) - 1)
    few = min(count, len(wanted.names) + 1)
    drawn = [random.choice(len(grid), few, replace=False) for _ in range(starts - 1)]
    return [even, *(np.resize(some, count) for some in drawn)]


def _finer(velocity: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The velocities at these places of a grid, and some between their neighbours."""
    last = len(velocity) - 1
    ends = [(velocity[max(k - 1, 0)], velocity[min(k + 1, last)]) for k in places]
    windows = [np.linspace(low, high, FINER) for low, high in ends]
    return np.unique(np.concatenate([*windows, velocity[places]]))
