"""The uncertainty budget of a fit: what the stated uncertainties of its inputs add to its results.

Each input x_k (a modulus, a diameter, a ruler's zero) is moved by its standard uncertainty to both
sides, the data are read again, and the fit is continued from where it ended, with the variances that
it found. With Δ₊ and Δ₋, the changes of a result θ,

    c_k = (Δ₊ - Δ₋)/2,    u²(θ) = s²(θ) + Σ c_k²

where s is the statistical standard error. Inputs that are one thing (a ball and a plate of one
steel, a plate that several materials were dropped on) are moved together: their errors are fully
correlated. Limits of an interval are widened by the moves to their own side,

    low' = θ - √((θ - low)² + z² Σ min(Δ₊, Δ₋, 0)²)

with z the quantile of the normal distribution. Example: yield pressure factor 2.50 ± 0.017 from the
points, and Y = 350 MPa ± 10 % moves it by c = 0.25: u = √(0.017² + 0.25²) = 0.251.

ε(v) moves as the fitted curve does: with the law of the moved fit, of moved bodies.

Source: JCGM 100:2008 (GUM), 5.1.2 and 5.1.3 (note 2, of moves by ± u); Kragten, Analyst 119, 2161
(1994).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np
from scipy import special

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.inputs import Input
from calibration.errors import DataError
from calibration.fitting.components import ComponentFit
from calibration.fitting.material import Estimate, MaterialFit
from calibration.fitting.problem import Problem
from calibration.fitting.request import Component, Request, SetSpec, assemble, stated_parameters
from calibration.fitting.search import search
from calibration.observables import RESTITUTION, predicted

STEPS = 100  # of one refit
NOT_LINEAR = 0.1  # asymmetry |Δ₊ + Δ₋| / 2|c| from which on a contribution is noted
NO_CHANGE = 1e-9  # of a result or of its statistical error: a contribution below is none
PER_CENT = 0.01  # the move of an exact input whose effect is looked at
Leaves = list[Any]  # numbers of a law: one each, or one an impact
# of a component's problem at z: the values of all results by name
ResultsOf = Callable[[ComponentFit, Problem, np.ndarray], dict[str, float]]


@dataclass(frozen=True)
class Contribution:
    """Effect of one input on all results.

    Attributes:
        name: of the input, "youngs_modulus" or "wall.yield_strength".
        members: data set and name of all inputs that move with it.
        value, uncertainty: in SI, of the first member.
        unit: of both.
        up, down: changes Δ₊ and Δ₋ of the results by their names.
        laws: of each data set the numbers of the law with the input moved up, and down.
        refused: why there is no move to one side, or to both.
    """

    name: str
    members: tuple[tuple[str, str], ...]
    value: float
    uncertainty: float
    unit: str
    up: dict[str, float]
    down: dict[str, float]
    laws: dict[str, tuple[Leaves, Leaves]] = field(default_factory=dict, repr=False)
    refused: str | None = None

    def of(self, label: str) -> float:
        """c = (Δ₊ - Δ₋)/2."""
        return 0.5 * (self.up.get(label, 0.0) - self.down.get(label, 0.0))

    def asymmetry(self, label: str) -> float:
        """|Δ₊ + Δ₋| / 2|c|; 0 of what does not move."""
        c = abs(self.of(label))
        both = abs(self.up.get(label, 0.0) + self.down.get(label, 0.0))
        return 0.5 * both / c if c > 0 else 0.0


@dataclass(frozen=True)
class Budget:
    """Contributions of all stated inputs to the results of a fit.

    Attributes:
        inputs: in the order in which they were stated.
        statistical: standard error of each result by its name; None where there is none.
        values: the results.
    """

    inputs: tuple[Contribution, ...]
    statistical: dict[str, float | None]
    values: dict[str, float]

    def input_error(self, label: str) -> float:
        """√(Σ c²) of a result."""
        return float(np.sqrt(sum(part.of(label) ** 2 for part in self.inputs)))

    def moves(self, label: str) -> tuple[float, float]:
        """√(Σ min(Δ₊, Δ₋, 0)²) and √(Σ max(Δ₊, Δ₋, 0)²) of a result."""
        ends = [(p.up.get(label, 0.0), p.down.get(label, 0.0), 0.0) for p in self.inputs]
        down = sum(min(changes) ** 2 for changes in ends)
        return float(np.sqrt(down)), float(np.sqrt(sum(max(changes) ** 2 for changes in ends)))

    def shares(self, label: str) -> dict[str, float]:
        """Share of each input in the combined variance, the largest first; "statistical" as well.

        Without a statistical standard error the shares are those of the inputs alone.
        """
        parts = {part.name: part.of(label) ** 2 for part in self.inputs}
        size = self.statistical.get(label)
        if size is not None:
            parts["statistical"] = size**2
        total = sum(parts.values())
        ordered = sorted(parts.items(), key=lambda entry: -entry[1])
        return {name: part / total if total else 0.0 for name, part in ordered}

    def covariance(self, labels: Sequence[str]) -> np.ndarray:
        """Σ c cᵀ of some results."""
        size = len(labels)
        parts = np.array([[p.of(label) for label in labels] for p in self.inputs])
        return np.einsum("ki,kj->ij", parts.reshape(-1, size), parts.reshape(-1, size))

    def of_sum(self, label: str, weights: Mapping[str, float]) -> "Budget":
        """Contributions to Σ w θ, a sum over results, under a name of its own."""

        def total(changes: Mapping[str, float]) -> dict[str, float]:
            return {label: sum(w * changes.get(name, 0.0) for name, w in weights.items())}

        parts = (replace(part, up=total(part.up), down=total(part.down)) for part in self.inputs)
        return Budget(tuple(parts), {}, {})

    @property
    def not_linear(self) -> dict[str, list[str]]:
        """Inputs whose moves to both sides differ by more than a tenth, and of which results."""
        notes: dict[str, list[str]] = {}
        for part in self.inputs:
            for label, value in self.values.items():
                counts = abs(part.of(label)) > 1e-3 * abs(value)
                if counts and part.asymmetry(label) >= NOT_LINEAR:
                    notes.setdefault(part.name, []).append(label)
        return notes

    def curve_moves(
        self,
        material: MaterialFit,
        velocity: np.ndarray,
        observable: str = RESTITUTION,
        impact: int | None = None,
    ) -> np.ndarray:
        """Δ₊ and Δ₋ of ε(v), or another observable in SI, by each input, (inputs, 2, velocities).

        Args:
            impact: with the bodies of this one of the data, where they differ.
        """
        moved = [part.laws.get(material.name) for part in self.inputs]
        flat = np.asarray(velocity, float).ravel()
        changes = np.zeros((len(moved), 2, len(flat)))
        if not any(moved):
            return changes
        shape = jax.tree.structure(material.law)
        with jax.enable_x64(True):

            def curve(leaves: Leaves) -> np.ndarray:
                numbers = [np.asarray(leaf, float) for leaf in leaves]
                if impact is not None:
                    numbers = [x[impact] if x.ndim else x for x in numbers]
                hit = sj.restitution(jax.tree.unflatten(shape, numbers), flat)
                return np.asarray(predicted(observable, hit))

            here = curve(jax.tree.leaves(material.law))
            for k, pair in enumerate(moved):
                for side, leaves in enumerate(pair or ()):
                    changes[k, side] = curve(leaves) - here
        return changes

    def curve_error(self, *curve: Any) -> np.ndarray:
        """√(Σ c²) of ε, or another observable, at each velocity; arguments as of `curve_moves`."""
        changes = self.curve_moves(*curve)
        return np.sqrt(np.sum((0.5 * (changes[:, 0] - changes[:, 1])) ** 2, axis=0))

    def to_frame(self) -> Any:
        """A pandas DataFrame: input, value, uncertainty, unit, and of each result c and its share."""
        import pandas as pd

        rows = []
        for part in self.inputs:
            row: dict[str, Any] = {"input": part.name, "value": part.value}
            row |= {"uncertainty": part.uncertainty, "unit": part.unit}
            for label in self.values:
                row[label] = part.of(label)
                row[f"share of {label}"] = self.shares(label)[part.name]
            rows.append(row)
        return pd.DataFrame(rows)


def budget_of(
    request: Request,
    fits: Sequence[ComponentFit],
    inputs: Sequence[Sequence[Input]],
    estimates: Mapping[str, Estimate],
    curvature: Mapping[str, float],
    results_of: ResultsOf,
) -> Budget | None:
    """The budget of a fit; None without uncertain inputs.

    Args:
        inputs: of each data set.
        estimates: the results by name, with their statistical errors.
        curvature: those of free parameters by the curvature of the likelihood, where it is skewed too.
        results_of: of a component and a moved problem at its end, the values of all results by name.
    """
    groups = _groups(request.datasets, inputs)
    if not groups:
        return None
    parts = []
    base = {k: results_of(fit, fit.final.problem, fit.z) for k, fit in enumerate(fits)}
    for members in groups:
        ends, refused = {}, None
        for sign in (1, -1):
            try:
                ends[sign] = _moved_fits(request, fits, inputs, members, sign, base, results_of)
            except ValueError as error:
                refused = str(error)
        first = inputs[members[0][0]][members[0][1]]
        (up, laws_up), (down, laws_down) = (_side(ends, sign) for sign in (1, -1))
        parts.append(
            Contribution(
                first.name,
                tuple((request.datasets[g].name, inputs[g][k].name) for g, k in members),
                first.value,
                first.uncertainty,
                first.unit,
                up,
                down,
                {name: (laws_up[name], laws_down[name]) for name in laws_up},
                refused,
            )
        )
    moved = {label for part in parts for label in part.up}
    known = {label: e for label, e in estimates.items() if e.value is not None and label in moved}
    sizes = {label: e.standard_error for label, e in known.items()} | {
        label: size for label, size in curvature.items() if label in known
    }
    return Budget(
        tuple(parts),
        {label: size if _is_known(size) else None for label, size in sizes.items()},
        {label: e.value for label, e in known.items() if e.value is not None},
    )


def _is_known(size: float | None) -> bool:
    return size is not None and bool(np.isfinite(size))


def _side(ends: Mapping[int, Any], sign: int) -> tuple[dict[str, float], dict[str, Leaves]]:
    """Changes by a move to one side; where that was refused, those of the other side mirrored."""
    if sign in ends:
        return ends[sign]
    if -sign not in ends:
        return {}, {}
    changes, laws = ends[-sign]
    return {label: -change for label, change in changes.items()}, laws


def _groups(
    datasets: Sequence[RestitutionData], inputs: Sequence[Sequence[Input]]
) -> list[list[tuple[int, int]]]:
    """Places (data set, input) of what moves together."""
    groups: dict[Any, list[tuple[int, int]]] = {}
    for g, (data, some) in enumerate(zip(datasets, inputs, strict=True)):
        for k, one in enumerate(some):
            groups.setdefault(data.inputs.identity(one.name), []).append((g, k))
    return list(groups.values())


def _moved_fits(
    request: Request, fits: Any, inputs: Any, members: Any, sign: int, base: Any, results_of: Any
) -> tuple[dict[str, float], dict[str, Leaves]]:
    """Changes of all results, and the laws, by one group of inputs moved to one side."""
    moves: dict[int, dict[str, float]] = {}
    for g, k in members:
        one = inputs[g][k]
        moves.setdefault(g, {})[one.name] = sign * one.uncertainty
    changes: dict[str, float] = {}
    laws: dict[str, Leaves] = {}
    for k, fit in enumerate(fits):
        if not {*fit.component.sets} & {*moves}:
            continue
        component, problem = moved_problem(request, fit, moves)
        end = search(problem, fit.z[None], reference_start=fit.reference_start[None], limit=STEPS)
        results = results_of(fit, problem, end.z[0])
        changes |= {label: value - base[k][label] for label, value in results.items()}
        theta = problem.transform.physical(end.z[0])
        for place, spec in enumerate(component.specs):
            law = _law_of(spec, component.places(place), theta)
            laws[spec.data.name] = [_number(leaf) for leaf in jax.tree.leaves(law)]
    return changes, laws


def _law_of(spec: SetSpec, places: Mapping[str, int], theta: np.ndarray) -> sj.ContactLaw:
    """The law of a data set, of all its impacts."""
    values = {
        local.name: float(theta[places[local.name]]) if local.name in places else local.start
        for local in spec.local
    }
    return spec.model.law(spec.data.contact, spec.model.inside(values))


def _number(leaf: Any) -> Any:
    values = np.asarray(leaf, float)
    return float(values) if values.ndim == 0 else values.tolist()


def moved_problem(
    request: Request, fit: ComponentFit, moves: Mapping[int, Mapping[str, float]]
) -> tuple[Component, Problem]:
    """The component and last stage's problem of the data with some inputs moved, with the variances of the fit.

    Raises:
        ValueError: where such data are refused, or have other parameters (a point passes first yield).
    """
    entries, sets = stated_parameters(request.parameters, request.datasets), fit.component.sets
    datasets = tuple(request.datasets[g].moved(moves.get(g, {})) for g in sets)
    moved = Request(datasets, [entries[g] for g in sets], request.options)
    (component,) = assemble(moved)
    base, (_, problem) = fit.final.problem, component.stages[-1]
    before, now = ([e.name for e in p.elements] for p in (base, problem))
    if before != now or problem.count != base.count:
        raise DataError("inputs", "moved", "such that the same parameters and points remain")
    kept = {name: getattr(base, name) for name in ("variances", "transform", "pools")}
    return component, replace(problem, **kept)


def with_input_uncertainty(
    estimate: Estimate, budget: Budget, label: str, confidence: float
) -> Estimate:
    """An estimate with the combined standard uncertainty and the widened interval."""
    if estimate.value is None or estimate.method == "fixed":
        return estimate
    (down, up), size = budget.moves(label), budget.input_error(label)
    low, high, value, error = estimate.low, estimate.high, estimate.value, estimate.standard_error
    if not size > NO_CHANGE * (error if error is not None and error > 0 else abs(value)):
        return estimate
    z = float(special.ndtri(0.5 * (1 + confidence)))
    return replace(
        estimate,
        standard_error=None if error is None else float(np.hypot(error, size)),
        statistical_error=error,
        low=None if low is None else value - float(np.hypot(value - low, z * down)),
        high=None if high is None else value + float(np.hypot(high - value, z * up)),
    )


def effects_of_one_per_cent(
    request: Request, fits: Sequence[ComponentFit], results_of: ResultsOf
) -> dict[str, dict[str, float]]:
    """Change of each result in per cent where an input is 1 % larger, to first order; none where it is refused.

    dθ/dx = -(JᵀJ)⁻¹ Jᵀ ∂r/∂x: rows of the moved data at the estimate, without a refit.
    """
    effects: dict[str, dict[str, float]] = {}
    for fit in fits:
        base, z = fit.final.problem, fit.z[None]
        here, before = base.linearise(z), results_of(fit, base, fit.z)
        known = fit.uncertainty.known
        place = np.flatnonzero(known[base.active])
        solve = np.linalg.pinv(here.jacobian[0][:, place])
        fixed = {
            e.label
            for e, is_known in zip(fit.component.elements, known, strict=True)
            if not is_known
        }
        of_sets = [(g, request.datasets[g].inputs) for g in fit.component.sets]
        for name in dict.fromkeys(name for _, source in of_sets for name in source.exact):
            moves = {g: {name: PER_CENT * s.value(name)} for g, s in of_sets if name in s.exact}
            try:
                _, problem = moved_problem(request, fit, moves)
            except ValueError:
                continue
            rows = problem.linearise(z, slopes=False).residual[0] - here.residual[0]
            end = np.array(fit.z)
            end[base.active[place]] -= solve @ rows
            after = results_of(fit, problem, end)
            changes = {
                label: 100 * (after[label] / value - 1)
                for label, value in before.items()
                if value and label not in fixed
            }
            effects.setdefault(name, {}).update(changes)
    return effects
