"""Velocities of the most informative further shots.

What a shot adds to the information depends on its velocity alone, so it is tabulated over a grid once.
Shots are exchanged over the grid, one at a time, from several starts, then placed more finely. Several
laws, or draws of a posterior, stand side by side; the criterion's logarithm is averaged over them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import ArrayLike, Float, Int

import softjax as sj
from calibration.data.checks import check_whole
from calibration.data.json_file import plain
from calibration.errors import DataError, listed
from calibration.fitting.result import FitResult
from calibration.fitting.summary import chi_of, critical_velocity_of, eps_up_of
from calibration.studies.information import (
    ALMOST_NOTHING,
    NO_BOUND,
    USUAL_NOISE,
    Plan,
    covariance_of,
    in_range,
    of_sensors,
    plan_of,
    sensors_text,
)
from calibration.studies.inputs import both_ends

CRITERIA = ("c", "D", "A", "I")
SPREAD = 112  # velocities of the grid on each of two scales
NEAR_YIELD = 10.0 ** np.arange(-4, -0.9, 0.25)  # relative distances from yield that the grid has
CURVE = 128  # velocities over which a predicted curve is averaged
FINER = 9  # velocities around each shot when it is placed more finely
REFINEMENTS = 5
BETTER = 1e-10  # least decrease of a log criterion that is worth an exchange
MOVES = 500  # of a design's weights
TOGETHER = 0.01  # relative distance below which shots count as one velocity
DIFFERENCE = 1e-4  # of θ, of what follows from it
ONE_VELOCITY = (
    "Shots at one velocity cannot test the law, and are best only if it holds: add others."
)

Column = Float[np.ndarray, "n"]
Places = Int[np.ndarray, "shots"]
Errors = dict[str, float | None]
Progress = Callable[[str, int, int], None]


class Derived(NamedTuple):
    """A number that follows from the parameters of Zhou's law."""

    symbol: str
    of: Callable[[sj.Zhou], float]


DERIVED = {
    "eps_up": Derived("ε_up", eps_up_of),
    "chi": Derived("χ̃", chi_of),
    "critical_velocity": Derived("v_cr", critical_velocity_of),
}


@dataclass(frozen=True, eq=False)
class Design:
    """Velocities for further shots, and what they are expected to bring.

    Attributes:
        criterion, target: what was made small: "c" the standard error of the target, "D" the
            determinant of the covariance of ln θ, "A" its mean variance, "I" the mean variance of
            the predicted curve.
        names, symbols: the parameters.
        velocity: v [m/s] of the new shots, ascending.
        coefficient, uncertainty: ε expected of each of them, and its standard uncertainty.
        bounds: v [m/s] within which they were sought.
        relative_errors: expected standard error of ln θ with the new shots and what was known
            before, and of a target that follows from θ; of several laws the root mean square; None
            for parameters that are not determined.
        equally_spaced: the same for as many shots equally spaced over the bounds.
        before: the same without new shots; None where nothing was measured yet.
        gain: the criterion as a standard error (the target's for "c", the geometric mean of all for
            "D") with equally spaced shots over that with these.
        efficiency: what the design reaches at least of the best possible one of as many shots, by
            the equivalence theorem.
        grid, slopes: velocities [m/s], (k,), and θ ∂ε/∂θ there, (k, p), of the first law.
        taken_as_known: a sentence for each parameter of the fit that has no standard error.
        sensors: what else each new shot shows, and its relative uncertainty.
        without: relative errors of the best design of as many shots without the sensors.
    """

    criterion: str
    target: str
    names: tuple[str, ...]
    symbols: tuple[str, ...]
    velocity: Float[np.ndarray, "n"]
    coefficient: Float[np.ndarray, "n"]
    uncertainty: Float[np.ndarray, "n"]
    bounds: tuple[float, float]
    relative_errors: Errors
    equally_spaced: Errors
    before: Errors | None
    gain: float
    efficiency: float
    grid: Float[np.ndarray, "k"]
    slopes: Float[np.ndarray, "k p"]
    taken_as_known: tuple[str, ...] = ()
    sensors: Mapping[str, float] = field(default_factory=dict)
    without: Errors | None = None

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
        """A dictionary for JSON."""
        left_out = ("symbols", "grid", "slopes", "sensors", "without")
        table = {name: value for name, value in vars(self).items() if name not in left_out}
        support = [{"velocity": v, "shots": n} for v, n in self.support]
        return plain(table | {"support": support} | of_sensors(self.sensors, self.without))

    def __str__(self) -> str:
        shots = []
        for v, n in self.support:
            at = int(np.argmin(np.abs(self.velocity - v)))
            expected = f"ε = {self.coefficient[at]:.3f} ± {self.uncertainty[at]:.2g}"
            shots.append(f"{n} at {v:.4g} m/s ({expected})")
        known = self.relative_errors, self.equally_spaced, self.before or {}
        here, even, now = (
            "not determined" if error is None else f"{error:.3g}"
            for error in (one.get(self.target) for one in known)
        )
        text = f"{self.criterion}-optimal: {', '.join(shots)}; standard error of "
        text += f"ln {self.target_symbol} {here}, " + (f"now {now}, " if self.before else "")
        text += f"equally spaced {even}"
        text += f"; at least {math.floor(1000 * self.efficiency) / 10:.1f} % of the best"
        planned = in_range(self.velocity, self.uncertainty).removeprefix(",")
        sought = f"Sought from {self.bounds[0]:.4g} to {self.bounds[1]:.4g} m/s; planned{planned}."
        lone = [ONE_VELOCITY] if len(self.support) == 1 else []
        sensed = sensors_text(self.sensors, self.relative_errors, self.without)
        return "\n".join([text, *lone, sought, *sensed, *self.taken_as_known])


class Table(NamedTuple):
    """Information of shots at k velocities, for several laws.

    Attributes:
        shots: G, so that a shot adds Gᵀ G, (laws, k, r, p).
        before: A₀, (laws, p, p).
    """

    shots: Float[np.ndarray, "laws k r p"]
    before: Float[np.ndarray, "laws p p"]

    def information(self, places: Any = slice(None)) -> Float[np.ndarray, "laws p p"]:
        """Total information with one shot at each of the places."""
        chosen = self.shots[:, places]
        return self.before + np.einsum("lkri,lkrj->lij", chosen, chosen)


@dataclass(frozen=True, eq=False)
class Criterion:
    """Objective to minimise: the logarithm of a mean variance tr(L C), averaged over the laws.

    Attributes:
        weight: L, (laws, p, p); None for D: the geometric mean of the variances, correlations counted.
    """

    weight: Float[np.ndarray, "laws p p"] | None

    def value(self, information: Float[np.ndarray, "laws ... p p"]) -> Float[np.ndarray, "..."]:
        """Its logarithm, averaged over the laws."""
        covariance = covariance_of(information)
        if self.weight is None:
            level = np.linalg.slogdet(covariance)[1] / covariance.shape[-1]
        else:
            level = np.log(np.einsum("lij,l...ij->l...", self.weight, covariance))
        return np.mean(level, axis=0)

    def least(self, table: Table, count: int) -> float:
        """A value that no design of `count` shots at the table's velocities is below.

        With W = C L C / tr(L C) (D: C/p), 1/tr(L C) and its like are concave in A. So whatever the
        weights w of a design without whole numbers, A = A₀ + n Σ w_k G_kᵀ G_k, no design is better
        than this one by more than the factor max_k tr(W (A₀ + n G_kᵀ G_k)); the weights are moved
        to where that is nearly one.

        Source: Kiefer and Wolfowitz, Can. J. Math. 12, 363 (1960); Pukelsheim, Optimal Design of
        Experiments (2006), chapter 5.
        """
        before = table.before + ALMOST_NOTHING * np.eye(table.before.shape[-1])
        share = np.full(table.shots.shape[1], 1 / table.shots.shape[1])
        least = -np.inf
        for _ in range(MOVES):
            there = table._replace(
                shots=table.shots * np.sqrt(count * share)[:, None, None]
            ).information()
            weight = self._gradient(covariance_of(there))
            added = np.einsum("lkri,lij,lkrj->lk", table.shots, weight, table.shots)
            first = np.einsum("lij,lij->l", weight, before)
            factor = np.mean(first[:, None] + count * added, axis=0)
            least = max(least, float(self.value(there)) - math.log(np.max(factor)))
            share = share * (factor if self.weight is None else np.sqrt(factor))
            share = share / np.sum(share)
        return least

    def _gradient(self, there: Float[np.ndarray, "laws p p"]) -> Float[np.ndarray, "laws p p"]:
        """W of each law."""
        if self.weight is None:
            return there / there.shape[-1]
        level = np.einsum("lij,lij->l", self.weight, there)
        return there @ self.weight @ there / level[:, None, None]


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
        objective, parameters, material, route, sensors: as `fisher_information` takes them.
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
    for name, value, least in (("count", count, 1), ("starts", starts, 1), ("seed", seed, 0)):
        check_whole(name, value, least)
    if criterion not in CRITERIA:
        raise DataError("criterion", criterion, f"one of {', '.join(CRITERIA)}")
    low, high = both_ends("bounds", bounds)
    if not (0 < low < high < np.inf):
        raise DataError("bounds", bounds, "(lowest, highest) velocity above 0 m/s")
    acts: dict[str, tuple[Any, bool, str]] = {
        "target": (target, criterion == "c", f"left out with criterion {criterion}"),
        "over": (over, criterion == "I", f"left out with criterion {criterion}"),
        "measured_uncertainty": (measured_uncertainty, measured is not None, "given with measured"),
    }
    for name, (argument, acting, accepted) in acts.items():
        if argument is not None and not acting:
            raise DataError(name, argument, accepted)
    if uncertainty is not None and not (np.isfinite(uncertainty) and uncertainty > 0):
        raise DataError("uncertainty", uncertainty, "positive")
    over = (low, high) if over is None else both_ends("over", over)
    there = None
    if measured is not None:
        u = uncertainty if measured_uncertainty is None else measured_uncertainty
        there = measured, USUAL_NOISE if u is None else u
    laws: Sequence[Any] = law if isinstance(law, Sequence) else [law]
    if not laws:
        raise DataError("law", law, "one law or more, or a FitResult")
    settings: dict[str, Any] = {"parameters": parameters, "objective": objective, "route": route}
    settings |= {"material": material, "uncertainty": uncertainty, "measured": there}
    settings["sensors"] = sensors
    plans = [
        plan_of(one, [low, high, *(over if criterion == "I" else ())], **settings) for one in laws
    ]
    with jax.enable_x64(True):
        search = (low, high), count, criterion, target, over, starts, seed, progress
        found = _designed(plans, *search)
        if not sensors:
            return found
        without = _designed([replace(plan, sensors={}) for plan in plans], *search)
        return replace(found, sensors=plans[0].sensors, without=without.relative_errors)


def _designed(
    plans: list[Plan], bounds, count: int, criterion: str, target, over, *search
) -> Design:
    first, target = plans[0], _target_of(target, plans[0])
    aims = np.stack([_gradient_of(target, plan) for plan in plans])
    p = len(first.names)
    weight: Any = np.zeros((len(plans), p, p)) + np.eye(p) / p
    if criterion == "c":
        weight = aims[:, :, None] * aims[:, None, :]
    elif criterion == "I":
        curve = np.stack([plan.curve(np.linspace(over[0], over[1], CURVE))[1] for plan in plans])
        weight = np.swapaxes(curve, 1, 2) @ curve / CURVE
    rule, grid = Criterion(None if criterion == "D" else weight), _grid(plans, bounds)
    even = np.linspace(bounds[0], bounds[1], count)
    shots = _sought(plans, rule, even, grid, *search)
    known = {"new": _table(plans, shots).information(), "even": _table(plans, even).information()}
    known["none"] = np.stack([plan.before for plan in plans])
    errors = {name: _errors(one, first.names, target, aims) for name, one in known.items()}
    level, of_even = (float(rule.value(known[name])) for name in ("new", "even"))
    least = rule.least(_table(plans, np.union1d(grid, shots)), count)
    return Design(
        criterion=criterion,
        target=target,
        names=first.names,
        symbols=first.symbols,
        velocity=shots,
        coefficient=first.curve(shots)[0],
        uncertainty=np.array(first.shots(shots)[1]),
        bounds=(float(grid[0]), float(grid[-1])),
        relative_errors=errors["new"],
        equally_spaced=errors["even"],
        before=errors["none"] if np.any(first.before) else None,
        gain=math.exp(0.5 * (of_even - level)),
        efficiency=min(math.exp(least - level), 1.0),
        grid=grid,
        slopes=first.curve(grid)[1],
        taken_as_known=first.taken_as_known([target] if criterion == "c" else first.names),
    )


def _target_of(target: str | None, plan: Plan) -> str:
    """Its label among the parameters, or its name among `DERIVED`.

    Raises:
        DataError: for another name, or a number that does not follow from this law.
    """
    free = dict(plan.free)
    if target is None:
        return free.get("chi", plan.names[0])
    if target in free or target in plan.names:
        return free.get(target, target)
    follow = []
    if plan.material.model.law_type is sj.Zhou:
        follow = [name for name in DERIVED if name not in free]
    if target in follow:
        return target
    raise DataError("target", target, f"one of {listed([*plan.names, *follow])}")


def _gradient_of(target: str, plan: Plan) -> Float[np.ndarray, "p"]:
    """∂ ln q/∂ ln θ of a target q, which has the standard error of its product with ln θ.

    Raises:
        DataError: where nothing that is free moves it.
    """
    if target in plan.names:
        return (np.array(plan.names) == target).astype(float)

    def log(name: str, factor: float) -> float:
        values = plan.material.model.inside(plan.material.values)
        values = {**values, name: float(values[name]) * factor}
        law = replace(plan.material, values=values).law
        return math.log(max(DERIVED[target].of(law), np.finfo(float).tiny))  # type: ignore[arg-type]

    ends = [[log(name, 1 + side * DIFFERENCE) for side in (-1, 1)] for name in plan.free]
    found = np.array([(up - down) / (2 * DIFFERENCE) for down, up in ends])
    if not np.any(found):
        accepted = f"one of {listed(plan.names)}: these are free and none of them affects it"
        raise DataError("target", target, accepted)
    return found


def _table(plans: Sequence[Plan], velocity: Column) -> Table:
    """Information of shots at these velocities."""
    before = np.stack([plan.before for plan in plans])
    return Table(np.stack([plan.shots(velocity)[0] for plan in plans]), before)


def _errors(information, names: Sequence[str], target: str, aims) -> Errors:
    """Expected standard errors, of the target too; root mean squares over the laws."""
    covariance = covariance_of(information)
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    found = dict(zip(names, np.sqrt(np.mean(variances, axis=0)).tolist(), strict=True))
    found[target] = float(np.sqrt(np.mean(np.einsum("li,lij,lj->l", aims, covariance, aims))))
    return {name: error if error < NO_BOUND else None for name, error in found.items()}


def _grid(plans: Sequence[Plan], bounds: tuple[float, float]) -> Column:
    """Velocities between the bounds, equally spaced on two scales, denser around yield."""
    low, high = bounds
    near = [plan.yields * (1 + side * NEAR_YIELD) for plan in plans for side in (-1, 1)]
    inside = [v for v in np.concatenate(near) if low < v < high]
    return np.unique([*np.linspace(low, high, SPREAD), *np.geomspace(low, high, SPREAD), *inside])


def _sought(
    plans: Sequence[Plan],
    rule: Criterion,
    even: Column,
    grid: Column,
    starts: int,
    seed: int,
    progress,
) -> Column:
    """The best shots from all starts: equally spaced ones, and a few velocities drawn at random."""
    random, table, ends = np.random.default_rng(seed), _table(plans, grid), []
    few = min(len(even), len(plans[0].names) + 1)
    for k in range(starts):
        start = np.clip(np.searchsorted(grid, even), 0, len(grid) - 1)
        if k:
            start = np.resize(random.choice(len(grid), few, replace=False), len(even))
        ends.append(_exchanged(table, rule, start))
        if progress is not None:
            progress("velocities", k + 1, starts)
    places, velocity = min(ends, key=lambda end: end[1])[0], grid
    for _ in range(REFINEMENTS):
        last, chosen = len(velocity) - 1, velocity[places]
        around = [velocity[[max(k - 1, 0), min(k + 1, last)]] for k in np.unique(places)]
        velocity = np.unique(
            np.concatenate([*(np.linspace(low, high, FINER) for low, high in around), chosen])
        )
        places, _ = _exchanged(
            _table(plans, velocity), rule, np.asarray(np.searchsorted(velocity, chosen))
        )
    return velocity[places]


def _exchanged(table: Table, rule: Criterion, places: Places) -> tuple[Places, float]:
    """The design after each shot has been moved to its best place until none moves any more."""
    places = np.array(places)
    gram = np.einsum("lkri,lkrj->lkij", table.shots, table.shots)
    best = float(rule.value(table.information(places)))
    while True:
        before = best
        for i in range(len(places)):
            others = table.information(np.delete(places, i))
            values = rule.value(others[:, None] + gram)
            k = int(np.argmin(values))
            if values[k] < best - BETTER:
                places[i], best = k, float(values[k])
        if best >= before - BETTER:
            return np.sort(places), best
