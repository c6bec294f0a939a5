"""What criterion c may be of: a parameter, or a number that follows from the parameters.

A number q that follows has the standard error of g · ln θ with g = ∂ ln q/∂ ln θ, so that c takes
the weight g gᵀ; a parameter's own g is 1 in its place and 0 elsewhere.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.errors import DataError, listed
from calibration.fitting.derived import chi_of, critical_velocity_of, eps_up_of
from calibration.fitting.problem import Element
from calibration.studies.planned import Column, Plan, relative_unit

STEP = 1e-4  # in z, of central differences


class Derived(NamedTuple):
    symbol: str
    of: Callable[[sj.Zhou], float]


DERIVED = {
    "eps_up": Derived("ε_up", eps_up_of),
    "chi": Derived("χ̃", chi_of),
    "critical_velocity": Derived("v_cr", critical_velocity_of),
}


def target_of(target: str | None, elements: Sequence[Element], plan: Plan) -> str:
    """Its label among the parameters, or its name among `DERIVED`.

    Unless told, chi of the data set that shots are planned for, or its first parameter.

    Raises:
        DataError: for another name, or a number that does not follow from this law.
    """
    spec, labels = plan.specs[plan.place], [e.label for e in elements]
    own = {e.name: e.label for e in elements if plan.place in e.sets}
    if target is None:
        first = next(one.name for one in spec.local if one.name in own)
        return own.get("chi", own[first])
    if target in labels or target in own:
        return own.get(target, target)
    follow = (
        [name for name in DERIVED if name not in labels] if spec.model.law_type is sj.Zhou else []
    )
    if target in follow:
        return target
    raise DataError("target", target, f"one of {listed([*labels, *follow])}")


def gradient_of(target: str, names: Sequence[str], plan: Plan, velocity: Column, errors: Column):
    """g of a target, (p,).

    Raises:
        DataError: where nothing that is free moves it.
    """
    if target in names:
        return (np.array(names) == target).astype(float)
    found = _gradient(DERIVED[target].of, plan, velocity, errors)
    if not np.any(found):
        accepted = f"one of {listed(names)}: these are free and none of them moves it"
        raise DataError("target", target, accepted)
    return found


def _gradient(
    what: Callable[[sj.Zhou], float], plan: Plan, velocity: Column, errors: Column
) -> Float[np.ndarray, "p"]:
    component, _ = plan.component(velocity, errors)
    problem, z = component.stages[-1][1], component.start

    def log(z: np.ndarray) -> float:
        law = problem.law_of(problem.transform.physical(z), plan.place)
        return float(np.log(max(what(law), np.finfo(float).tiny)))  # type: ignore[arg-type]

    with jax.enable_x64(True):
        steps = STEP * np.diag(np.maximum(np.abs(z), 1e-2))
        slopes = [(log(z + dz) - log(z - dz)) / (2 * np.sum(dz)) for dz in steps]
        return np.array(slopes) / relative_unit(problem, z)
