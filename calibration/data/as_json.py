"""A set of data as JSON's own types, and back."""

from typing import Any

import numpy as np

import softjax as sj
from calibration.data.bodies import Body
from calibration.data.errors_of_points import PointErrors
from calibration.data.measurements import RestitutionData

PLAIN = ("velocity", "restitution", "limit_velocity", "degrees")
UNCERTAINTIES = ("uncertainty", "velocity_uncertainty")


def data_to_dict(data: RestitutionData) -> dict[str, Any]:
    """What a file keeps of a set; where it came from is not kept."""
    contact, errors = data.contact, data.errors
    shared = bool(np.any(errors.index >= 0))
    return {
        **{name: getattr(data, name) for name in (*PLAIN, *UNCERTAINTIES)},
        "contact": contact and {**contact.leaves(), "area": contact.area},
        "bodies": [_body_to_dict(body) for body in data.bodies],
        "remarks": data.remarks,
        "group": None if data.group is None else [str(label) for label in data.group],
        "errors": dict(vars(errors)) if shared else None,
    }


def data_from_dict(name: str, table: dict[str, Any]) -> RestitutionData:
    """The same set again.

    Raises:
        ValueError: for numbers that are no measurements.
    """
    errors, contact = table["errors"], table["contact"]
    options = {key: _array(table[key]) for key in PLAIN}
    if errors is None:
        options |= {key: _array(table[key]) for key in UNCERTAINTIES}
    else:
        options["errors"] = PointErrors(**{key: _array(value) for key, value in errors.items()})
    if contact is not None:
        options["contact"] = sj.Contact(**{key: _array(leaf) for key, leaf in contact.items()})
    options["bodies"] = tuple(map(_body_from_dict, table.get("bodies", ())))
    options |= {"remarks": tuple(table["remarks"]), "group": table["group"]}
    return RestitutionData(name=name, plausibility=False, **options)  # it was checked once


def _body_to_dict(body: Body) -> dict[str, Any]:
    return {"name": body.name, "radius": body.radius, **body.material.leaves()}


def _body_from_dict(table: dict[str, Any]) -> Body:
    leaves = {key: _array(leaf) for key, leaf in table.items()}
    name, radius = leaves.pop("name"), leaves.pop("radius")
    return Body(name, sj.Material(**leaves), radius)


def _array(value: Any) -> Any:
    return np.array(value) if isinstance(value, list) else value
