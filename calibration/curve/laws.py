"""Contact laws by name, with their fields as the command line gives them."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import softjax as sj
from calibration.curve.options import LAWS
from calibration.errors import DataError, did_you_mean, listed


def make_law(name: str, contact: sj.Contact, fields: Mapping[str, Any]) -> sj.ContactLaw:
    """A law of a contact with the given fields.

    Raises:
        ValueError: naming the field, its value and what is accepted.
    """
    law = getattr(sj, LAWS[name])
    accepted = {f.name: f for f in dataclasses.fields(law) if f.name != "contact"}
    for field in fields:
        if field not in accepted:
            known = listed(accepted) or "none"
            raise DataError(
                "--set", field, f"a field of {name}: {known}{did_you_mean(field, accepted)}"
            )
    missing = [n for n, f in accepted.items() if n not in fields and _is_needed(f)]
    if missing:
        raise DataError("--law", name, f"given with {', '.join(f'--set {n}=…' for n in missing)}")
    try:
        return law(contact, **fields)
    except (ValueError, TypeError) as error:
        raise ValueError(str(error)) from None


def parse_fields(assignments: list[str]) -> dict[str, float | str]:
    """`name=value` pairs; a value that is no number is kept as text.

    Raises:
        DataError: for what is no pair.
    """
    fields: dict[str, float | str] = {}
    for assignment in assignments:
        name, mark, value = assignment.partition("=")
        if not mark or not name:
            raise DataError("--set", assignment, "name=value")
        fields[name.strip().replace("-", "_")] = _number_or_text(value.strip())
    return fields


def _is_needed(field: dataclasses.Field) -> bool:
    none = dataclasses.MISSING
    return field.default is none and field.default_factory is none


def _number_or_text(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value
