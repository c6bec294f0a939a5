"""All curves with every χ̃ on one line, χ̃ = c1 + c2 E/Y, in one fit.

It begins near its minimum. From where each material is alone, c1 and c2 take steps of Gauss and Newton, and
between these everything else is searched for with χ̃ held on the line, each material by itself. In one search
from farther off the curved valley of one material's σ and ψ would shorten the steps of all.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.laws import LINE
from calibration.fitting.methods import condense
from calibration.fitting.problem import DRAG, Lanes, Problem, acts_on_nothing
from calibration.fitting.request import Request, SetSpec, assemble
from calibration.fitting.search import Ends, search
from calibration.fitting.side_by_side import alike, as_one
from calibration.fitting.stages import ComponentFit, fit_component
from calibration.fitting.variances import first_variances
from calibration.parameters import NONE, Parameter

ROUNDS = 20
NEAR = 1e-6  # of a cost that a further step promises to save

Own = tuple[ComponentFit, SetSpec, int]  # of a data set with a χ̃: its fit, its options, its element


def joint_fit(
    request: Request, own: Sequence[Own], ratio: Float[np.ndarray, " sets"], c: np.ndarray
) -> ComponentFit:
    """The fit of c1, c2 and what else was free in the fit of each data set; everything as requested there.

    Args:
        ratio: E/Y of each.
        c: c1 and c2 to begin with.
    """
    ends: dict[int, Ends] = {}
    if all(fit.is_likelihood and fit.final.problem.elastic is None for fit, *_ in own):
        c, ends = _near(own, ratio, c)
    on_line = {name: Parameter(float(value)) for name, value in zip(LINE, c, strict=True)}
    parameters = []
    for fit, spec, k in own:
        stated = {e.name: e.parameter for e in spec.local if e.parameter.value is not None}
        z = ends[id(fit)].z[0] if ends else fit.z
        elements, theta = fit.component.elements, fit.final.problem.transform.physical(z)
        for name, place in fit.component.places(elements[k].sets[0]).items():
            start = {"value": float(theta[place])}
            stated[name] = elements[place].parameter.model_copy(update=start)
        stated = {name: value for name, value in stated.items() if name not in ("chi", DRAG)}
        parameters.append(stated | on_line | dict(spec.model.options))
    names = {spec.data.name for _, spec, _ in own}
    datasets = tuple(data for data in request.datasets if data.name in names)
    options = {"law": "zhou", "starts": 1, "optimiser": "levenberg-marquardt"}
    joint = replace(request, datasets=datasets, parameters=parameters).with_options(**options)
    (component,) = assemble(joint)
    if not ends:
        return fit_component(component, joint.options)
    begun = np.full(len(component.elements), np.nan)
    for g, (fit, _, k) in enumerate(own):
        here, end = component.places(g), ends[id(fit)]
        there = fit.component.places(fit.component.elements[k].sets[0])
        for name in here.keys() & there.keys():
            begun[here[name]] = end.begun[0, there[name]]
    problem = first_variances(component.stages[0][1], component.start)
    limit = joint.options.max_steps
    end = search(problem, component.start[None], begun=begun[None], limit=limit)
    return fit_component(component, joint.options, [end])


class _Group(NamedTuple):
    """Fits that are searched side by side."""

    members: list[int]  # which fits
    problem: Problem
    lanes: Lanes
    chi: Int[np.ndarray, " q"]  # elements that are χ̃, alike in all
    design: Float[np.ndarray, "fits q 2"]  # 1 and E/Y of each


def _near(own: Sequence[Own], ratio, c: np.ndarray) -> tuple[np.ndarray, dict[int, Ends]]:
    """c near the minimum of all curves, and where each fit ends with its χ̃ on that line, by its id."""
    fits = list({id(fit): fit for fit, *_ in own}.values())
    rows: dict[int, list[int]] = {}
    for i, (fit, *_) in enumerate(own):
        rows.setdefault(id(fit), []).append(i)
    groups = []
    for members in alike([fit.final.problem for fit in fits]):
        problem, lanes = as_one([fits[m].final.problem for m in members])
        of = [rows[id(fits[m])] for m in members]
        chi = np.array([own[i][2] for i in of[0]])
        design = np.stack([np.ones(np.shape(of)), ratio[of]], axis=-1)
        groups.append(_Group(members, problem, lanes, chi, design))
    # what has gone to an end of its range alone may go farther; another minimum may be lower on the line
    ends = [fit.final.ends._replace(begun=fit.final.ends.z) for fit in fits]
    others = [[*fit.final.others, _at_start(fit)] for fit in fits]
    best, at, step = np.inf, c, np.zeros_like(c)
    for _ in range(ROUNDS):
        cost, normal, gradient, found = 0.0, np.zeros((2, 2)), np.zeros(2), list(ends)
        for group in groups:
            end, *parts = _on_line(group, [[ends[m], *others[m]] for m in group.members], c)
            for k, m in enumerate(group.members):
                found[m] = end.some(slice(k, k + 1))
            cost += float(np.sum(end.cost))
            gradient, normal = gradient + parts[0], normal + parts[1]
        if cost < best:
            best, at, ends, step = cost, c, found, -np.linalg.pinv(normal) @ gradient
            if not -0.5 * step @ gradient > NEAR:
                break
        else:
            step = 0.25 * step
        c = at + step
    return at, {id(fit): end for fit, end in zip(fits, ends, strict=True)}


def _at_start(fit: ComponentFit) -> Ends:
    """The start of a fit in the place of an end."""
    z = fit.component.start[None]
    return fit.final.ends._replace(z=z, begun=z)


def _on_line(group: _Group, tries: list[list[Ends]], c: np.ndarray):
    """Ends of fits with χ̃ on the line; gradient of their costs in c, and JᵀJ with the others following.

    Args:
        tries: from where each is searched, of which the lowest end counts.
    """
    _, problem, lanes, chi, design = group
    part, active = problem.transform.part(chi), problem.active
    of = np.repeat(np.arange(len(tries)), list(map(len, tries)))
    every = [end for ends in tries for end in ends]
    z, begun = (np.concatenate([getattr(end, name) for end in every]) for name in ("z", "begun"))
    z[:, chi] = part.unconstrained(design[of] @ c)
    fixed = np.isin(active, chi)
    held = np.broadcast_to(fixed, (len(z), len(active)))
    end = search(problem, z, begun=begun, fixed=held, lanes=lanes.some(of))
    order = np.lexsort((np.nan_to_num(end.cost, nan=np.inf), of))
    end = end.some(order[np.searchsorted(of, np.arange(len(tries)))])
    linear = problem.linearise(end.z, lanes)
    columns = [active.tolist().index(k) for k in chi]
    along = linear.jacobian[:, :, columns] / part.slope(end.z[:, chi])[:, None] @ design
    gradient = np.einsum("fma,fm->a", along, linear.residual)
    size = np.where(problem.transform.kind[active] == NONE, np.abs(end.z[:, active]), 1.0)
    still = fixed | (end.limits != 0) | acts_on_nothing(linear.jacobian, size)
    others = [condense(along[..., a], linear.jacobian, still).newton for a in range(2)]
    along = along + np.where(still[:, None], 0.0, linear.jacobian) @ np.stack(others, axis=-1)
    return end, gradient, np.einsum("fma,fmb->ab", along, along)
