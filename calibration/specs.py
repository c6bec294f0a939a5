"""What is asked of each data set: its objective, and its parameters as they were told."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibration.data.measurements import RestitutionData
from calibration.parameters import CONTACT_COLUMNS, LINE_COLUMNS
from calibration.parameters_spec import ParameterSpec

OBJECTIVES = ("two-step", "model", "empirical", "constant")

Specs = Mapping[str, Any] | Sequence[Any] | None


def plan_of(data: RestitutionData, objective: str | None) -> str:
    """The objective of one data set: what is asked for, as far as its properties allow it."""
    if objective is not None and objective not in OBJECTIVES:
        raise ValueError(f"`objective` must be one of {OBJECTIVES}, but is {objective!r}")
    if objective == "constant" or (data.contact is None and data.limit_velocity is None):
        return "constant"
    if objective == "empirical" or data.contact is None:
        return "empirical"
    return objective or "two-step"


def specs_of(parameters: Specs, datasets) -> list[dict[str, ParameterSpec]]:
    """What is said of each data set's parameters: {name: spec}, one dict a set.

    `parameters` is a mapping ("chi" for all sets, "chi[name]" for one; a number fixes), a sequence
    of specs, or one such mapping per data set.
    """
    if parameters is None:
        return [{} for _ in datasets]
    if isinstance(parameters, Mapping):
        return _from_mapping(parameters, datasets)
    parameters = list(parameters)
    if all(isinstance(one, ParameterSpec) for one in parameters):
        return _from_mapping({one.name: one for one in parameters}, datasets)
    if len(parameters) != len(datasets) or not all(isinstance(p, Mapping) for p in parameters):
        raise ValueError(
            "`parameters` must be a mapping, ParameterSpecs, or one mapping per data set, "
            f"but is {parameters!r}"
        )
    return [_from_mapping(own, [d])[0] for own, d in zip(parameters, datasets, strict=True)]


def _from_mapping(parameters, datasets) -> list[dict[str, ParameterSpec]]:
    specs: list[dict[str, ParameterSpec]] = [{} for _ in datasets]
    # names for one set come last, so that they win over those for all
    for key in sorted(parameters, key=lambda key: "[" in key):
        name, _, owner = key.partition("[")
        owner = owner.rstrip("]")
        spec = _spec(name, parameters[key])
        owners = [g for g, data in enumerate(datasets) if owner in ("", data.name)]
        if not owners:
            known = ", ".join(data.name for data in datasets)
            raise ValueError(f"parameter {key!r} must name one of the data sets: {known}")
        for g in owners:
            specs[g][name] = spec
    return specs


def _spec(name: str, value) -> ParameterSpec:
    if isinstance(value, ParameterSpec):
        if value.name != name:
            raise ValueError(f"the spec of {name!r} must have that name, but has {value.name!r}")
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(
            f"parameter {name!r} must be a ParameterSpec or a number, but is {value!r}"
        )
    return ParameterSpec(name, free=False, value=float(value))


def columns_of(data, plan, own, has_line) -> dict[str, ParameterSpec]:
    """The parameters that act for one data set, free unless said otherwise."""
    if plan == "constant":
        names = ["restitution"]
    elif plan == "empirical":
        names = ["sigma", "psi"]
    else:
        names = [*(LINE_COLUMNS if has_line else ("chi",)), *_losses(data, plan, own)]
        if np.all(data.velocity <= data.contact.critical_velocity) and not _moves(own):
            names = names[len(LINE_COLUMNS) if has_line else 1 :]  # χ̃ acts nowhere
    accepted = {*names, *(CONTACT_COLUMNS if plan in ("two-step", "model") else ())}
    if plan == "empirical":
        accepted.add("limit_velocity")
    for name in own:
        if name not in accepted and name not in ("chi", "sigma", "psi", "eps_up", *LINE_COLUMNS):
            raise ValueError(f"{name!r} does not act under {plan!r}; accepted: {sorted(accepted)}")
    chosen = {name: own.get(name, ParameterSpec(name)) for name in names}
    return chosen | {name: own[name] for name in CONTACT_COLUMNS if name in own}


def _moves(own) -> bool:
    """Whether the critical velocity is fitted too."""
    return any(name in own and own[name].free for name in CONTACT_COLUMNS[:2])


def _losses(data, plan, own) -> tuple[str, ...]:
    """σ and ψ, or ε_up in their place where nothing but ε_up can be told (`model`)."""
    told = "sigma" in own or "psi" in own
    below = np.any(data.velocity <= data.contact.critical_velocity)
    if plan == "model" and ("eps_up" in own or not (below or told)):
        return ("eps_up",)
    return ("sigma", "psi")
