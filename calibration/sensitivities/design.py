"""Where to measure next: velocities of further shots that tell most, by gradient."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

import softjax as sj
from calibration.sensitivities import estimating
from calibration.sensitivities.estimating import Rows
from calibration.sensitivities.information import (
    check_law,
    check_objective,
    check_uncertainty,
    fisher_information,
)
from calibration.sensitivities.search import Goal, Task, search, starting_points

CRITERIA = ("c", "D")
TOGETHER = 0.01  # relative distance below which shots are told as one velocity


@dataclass(frozen=True, eq=False)
class Design:
    """Velocities for further shots, and what they are expected to bring.

    Attributes:
        objective, criterion, target: what was made small: "c" the standard error of the target,
            "D" the determinant of the covariance.
        names: the parameters of the objective.
        velocity: v [m/s] of the new shots, ascending.
        uncertainty: of ε in each of them.
        bounds: v [m/s] within which they were sought.
        relative_errors: expected standard error of ln θ with the new shots, beside the old ones.
        equally_spaced: the same for as many shots equally spaced over the bounds.
        before: the same without new shots; None where nothing was measured yet.
        gradient_norm: of the criterion's logarithm at the end, in the unconstrained variables.
        starts: log criterion at which each start ended, ascending.
    """

    objective: str
    criterion: str
    target: str
    names: tuple[str, ...]
    velocity: Float[np.ndarray, " n"]
    uncertainty: float
    bounds: tuple[float, float]
    relative_errors: dict[str, float]
    equally_spaced: dict[str, float]
    before: dict[str, float | None] | None
    gradient_norm: float
    starts: Float[np.ndarray, " starts"]

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
    def gain(self) -> float:
        """Standard error of the target with equally spaced shots over that with these."""
        return self.equally_spaced[self.target] / self.relative_errors[self.target]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "objective": self.objective,
            "criterion": self.criterion,
            "target": self.target,
            "velocity": self.velocity.tolist(),
            "support": [{"velocity": v, "shots": n} for v, n in self.support],
            "uncertainty": self.uncertainty,
            "bounds": list(self.bounds),
            "relative_standard_errors": self.relative_errors,
            "relative_standard_errors_equally_spaced": self.equally_spaced,
            "relative_standard_errors_before": self.before,
            "gain": self.gain,
            "gradient_norm": self.gradient_norm,
            "log_criterion_of_starts": self.starts.tolist(),
        }

    def __str__(self) -> str:
        shots = ", ".join(f"{n} at {v:.4g} m/s" for v, n in self.support)
        return (
            f"{self.criterion}-optimal for {self.objective}: {shots}; standard error of "
            f"ln {self.target} {self.relative_errors[self.target]:.3g}, equally spaced "
            f"{self.equally_spaced[self.target]:.3g}"
        )


def optimal_velocities(
    law: sj.Zhou,
    count: int,
    bounds: tuple[float, float],
    *,
    criterion: str = "c",
    target: str = "chi",
    objective: str = "two-step",
    uncertainty: float = 0.01,
    measured: Float[ArrayLike, " m"] | None = None,
    measured_uncertainty: float | Float[ArrayLike, " m"] | None = None,
    starts: int = 16,
    steps: int = 400,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> Design:
    """Velocities of `count` further shots that tell most of the parameters.

    The criterion is followed down its gradient through the information matrix, which takes the
    second derivatives of ε in parameter and velocity (energy balance: exact), by Adam from
    several starts at once. An optimum trusts the law: where it does not fit, what is fitted
    depends on where one measures, and a few shots elsewhere would show it.

    Args:
        law: Zhou's law with the parameters as far as they are known.
        count: number of new shots.
        bounds: (lowest, highest) velocity [m/s] that can be shot.
        criterion: "c": the standard error of `target`; "D": the determinants of the
            covariance (see `search.Goal`).
        target: "chi", "sigma" or "psi" ("eps_up" for `model` above yield).
        objective: "two-step" or "model".
        uncertainty: standard uncertainty of each new ε.
        measured, measured_uncertainty: v [m/s] and uncertainty of ε of what is there already.
        starts, steps, seed: of the search.
        progress: called as progress(stage, done, total).

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    check_law(law)
    check_objective(objective)
    _check_search(law, count, bounds, criterion, starts, steps)
    check_uncertainty(uncertainty)
    old = np.zeros(0) if measured is None else np.asarray(measured, float).ravel()
    lowest = min([bounds[0], *old.tolist()])
    names = estimating.parameters_of(objective, law, lowest)
    if target not in names:
        raise ValueError(f"`target` must be one of {', '.join(names)}, but is {target!r}")
    u_old = uncertainty if measured_uncertainty is None else measured_uncertainty
    known_weight = np.broadcast_to(check_uncertainty(u_old), old.shape) ** -2.0
    task = Task(law, np.asarray(bounds, float), _known(law, old), known_weight, uncertainty**-2.0)
    goal = Goal(names, objective, criterion, names.index(target))
    found = search(starting_points(count, starts, seed), task, goal, steps, progress)
    best = int(np.nanargmin(found.cost))
    velocity = np.sort(found.velocity[best])
    expected = [_errors(goal, task, v) for v in (velocity, np.linspace(*bounds, count))]
    before = None
    if len(old):
        before = fisher_information(law, old, u_old, objective).relative_errors
    return Design(
        objective=objective,
        criterion=criterion,
        target=target,
        names=names,
        velocity=velocity,
        uncertainty=float(uncertainty),
        bounds=(float(bounds[0]), float(bounds[1])),
        relative_errors=expected[0],
        equally_spaced=expected[1],
        before=before,
        gradient_norm=float(found.gradient_norm[best]),
        starts=np.sort(found.cost),
    )


def _check_search(law, count, bounds, criterion, starts, steps) -> None:
    for name, value in (("count", count), ("starts", starts), ("steps", steps)):
        if not (isinstance(value, int | np.integer) and value >= 1):
            raise ValueError(f"`{name}` must be a whole number >= 1, but is {value!r}")
    if criterion not in CRITERIA:
        raise ValueError(f"`criterion` must be 'c' or 'D', but is {criterion!r}")
    low, high = bounds
    limit = float(law.contact.limit_velocity)
    if not 0 < low < high < limit:
        accepted = f"(lowest, highest) velocity between 0 and {limit:.6g} m/s"
        raise ValueError(f"`bounds` must be {accepted}, but is {bounds!r}")


def _known(law: sj.Zhou, old) -> Rows:
    """Slopes of what was measured."""
    if not len(old):
        return Rows(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    return estimating.slopes(law, old)


def _errors(goal: Goal, task: Task, velocity) -> dict[str, float]:
    """Expected standard errors of ln θ with these shots."""
    covariance = goal.covariance(*task.joined(estimating.slopes(task.law, velocity)))
    errors = np.sqrt(np.diag(np.asarray(covariance)))
    return dict(zip(goal.names, errors.tolist(), strict=True))
