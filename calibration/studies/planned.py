"""A fit of impacts that are only planned: the fit's own problem, on data without noise.

What such a fit would find and how well is what the engine says of it: its searches, and its stacked
covariance at where they end. Under `model` they end at the law itself. Under `two-step` they need
not: Eq. (17) fitted to a law's curve is another curve than Eq. (17) with that law's σ and ψ, and the
errors are those of what is found.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from calibration.data import RestitutionData
from calibration.fitting.assembly import EMPIRICAL, Component, assemble
from calibration.fitting.collisions import Route
from calibration.fitting.problem import Problem
from calibration.fitting.refits import settled
from calibration.fitting.set_errors import SetErrors
from calibration.fitting.specs import SetSpec
from calibration.fitting.uncertainty import Settled, Uncertainty, gradient_slopes, stacked
from calibration.studies.exchange import Table
from calibration.studies.shot_errors import WithShots

USUAL_NOISE = 0.01  # standard uncertainty of ε unless told
PLACEHOLDER = 0.5  # ε of data that have none yet

Column = Float[np.ndarray, "n"]
Impacts = tuple[Column, Column]  # v [m/s], and standard uncertainty of ε


@dataclass(frozen=True)
class Plan:
    """What a fit of planned impacts rests on.

    Attributes:
        specs: of the data sets that are fitted together, every parameter where the law has it.
        measured: what each of them has already.
        place: which of them the planned impacts belong to.
        route: from a law to ε.
        by_first: whether the first stage's curve is what is measured, as a fit in two steps takes
            it; else the law's own.
        shared: the errors of what each data set has already, where points share some.
        noise: standard uncertainty of one more ε, which shares nothing.
        yields: the velocity at which an impact yields [m/s]; 0 for laws without.
        spreads: of parameters that data sets pool, on the scale that is searched.
    """

    specs: tuple[SetSpec, ...]
    measured: tuple[Impacts, ...]
    place: int
    route: Route
    by_first: bool = False
    shared: tuple[SetErrors, ...] | None = None
    noise: float = USUAL_NOISE
    yields: float = 0.0
    spreads: Mapping[str, float] = field(default_factory=dict)

    @property
    def objective(self) -> str:
        return self.specs[0].objective

    @property
    def is_likelihood(self) -> bool:
        """Whether the fit is one step, whose information is Fisher's."""
        return self.objective == "model"

    def component(
        self, velocity: Column, uncertainty: Column
    ) -> tuple[Component, Bool[np.ndarray, "points"]]:
        """The fit's problems on the curve itself, and which of the points are the planned ones."""
        points, new = list(self.measured), [np.zeros(len(v), bool) for v, _ in self.measured]
        v, u = points[self.place]
        points[self.place] = np.append(v, velocity), np.append(u, uncertainty)
        new[self.place] = np.arange(len(v) + len(velocity)) >= len(v)
        pairs = zip(self.specs, points, strict=True)
        specs = [replace(spec, data=unmeasured(spec.data, *own)) for spec, own in pairs]
        component = assemble(specs, self.route, EMPIRICAL)[0]
        source = component.stages[0 if self.by_first else -1][1]
        curve = source.predict(component.start[None])[0]
        rebounds = curve > 0  # what does not rebound tells nothing
        planned, told = np.concatenate(new), self._errors(uncertainty)
        alone = rebounds / np.concatenate([u for _, u in points])

        def known(problem: Problem, is_first: bool) -> Problem:
            weight, shared = alone, None
            if is_first and told is not None:  # what is measured counts as the fit has counted it
                weight, shared = np.where(planned, rebounds, 1.0), told
            points = problem.points._replace(restitution=curve, weight=weight)
            return self._pooled(replace(problem, points=points, shared=shared))

        stages = tuple((name, known(p, not k)) for k, (name, p) in enumerate(component.stages))
        return replace(component, stages=stages), planned

    def fitted(
        self, velocity: Column, uncertainty: Column
    ) -> tuple[Component, Column, Uncertainty]:
        """The fit's problems, what it finds, z, and how well."""
        component, _ = self.component(velocity, uncertainty)
        problems, z = [problem for _, problem in component.stages], component.start[None]
        if self.is_likelihood:  # the curve is the law's own: the search would stay there
            stages = [Settled(p, np.zeros((1, len(p.active)), int)) for p in problems]
        else:
            z, stages, _ = settled(problems, z)
        return component, z[0], stacked(stages, z)

    def _errors(self, uncertainty: Column) -> tuple[SetErrors, ...] | None:
        """Those of the measured points and the planned ones, where points share some."""
        if self.shared is None:
            return None
        own = [uncertainty if k == self.place else np.zeros(0) for k in range(len(self.shared))]
        return tuple(map(WithShots.of, self.shared, own))

    def _pooled(self, problem: Problem) -> Problem:
        """The same, held together by the spreads that a fit found."""
        pools = (p._replace(spread=self.spreads.get(p.name, p.spread)) for p in problem.pools)
        return replace(problem, pools=tuple(pools))


def relative_unit(problem: Problem, z: Column) -> Column:
    """dθ/dz over the size of θ: covariances in z times these are of ln θ."""
    theta = problem.transform.physical(z)
    return problem.transform.slope(z) / np.where(theta == 0, 1.0, np.abs(theta))


def equations(plan: Plan, velocity: Column, uncertainty: Column, z: Column) -> Table:
    """What planned impacts add to those of a plan's fit, in one stage or two, around z."""
    component, new = plan.component(velocity, uncertainty)
    problems, p = [problem for _, problem in component.stages], len(z)
    slope, score = np.zeros((len(new), p, p)), np.zeros((len(new), p))
    slope_before, middle_before = np.zeros((p, p)), np.zeros((p, p))
    for k, problem in enumerate(problems):
        own, jacobian = problem.active, problem.linearise(z[None]).jacobian[0]
        added = np.zeros((len(jacobian), len(own), p))
        if k:
            added[:] = gradient_slopes(problem, z[None], np.arange(p))[0]
        else:
            added[:, :, own] = jacobian[:, :, None] * jacobian[:, None, :]
        slope[:, own], score[:, own] = added[: len(new)], _scores(problem, problems[0], jacobian)
        slope_before[own] += np.sum(added[len(new) :], axis=0)  # of the priors
        middle_before[own, own] += np.sum(jacobian[len(new) :] ** 2, axis=0)
    slope_before += np.sum(slope[~new], axis=0)
    middle_before += score[~new].T @ score[~new]
    final = replace(problems[-1].weighed(np.ones(len(new))), active=np.arange(p), shared=None)
    curve = final.linearise(z[None]).jacobian[0, : len(new)]
    unit = 1 / relative_unit(final, z)
    both = np.outer(unit, unit)
    return Table(
        slope[new] * both,
        score[new] * unit,
        slope_before * both,
        middle_before * both,
        curve[new] * unit,
    )


def _scores(problem: Problem, first: Problem, jacobian: Float[np.ndarray, "m p"]):
    """What an error of one standard deviation in each point adds to a stage's equations."""
    own = jacobian[: problem.count]
    if problem.shared is None and first.shared is not None:
        return first.coloured((own * problem.points.weight[:, None])[None])[0]
    return own


def unmeasured(like: RestitutionData, velocity: Column, uncertainty: Column) -> RestitutionData:
    """Impacts of the same bodies, without a restitution yet."""
    limit = like.limit_velocity if like.contact is None else None
    level = np.full(len(velocity), PLACEHOLDER)
    return RestitutionData(
        velocity,
        level,
        like.contact,
        uncertainty,
        like.name,
        limit_velocity=limit,
        plausibility=False,
    )
