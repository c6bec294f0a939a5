"""Numbers that carry their unit: converted where pint can."""

import re
from typing import Any

import numpy as np


def has_unit(value: Any) -> bool:
    """Whether it carries a unit, as quantities of pint (`.units`) and astropy (`.unit`) do."""
    return hasattr(value, "units") or hasattr(value, "unit")


def in_unit(value: Any, unit: str) -> Any:
    """A number or an array with its own unit in another one, where pint can convert it; else as it is."""
    if not has_unit(value):
        return value
    plain = getattr(value, "magnitude", getattr(value, "value", None))
    stated = getattr(value, "units", None) or getattr(value, "unit", None)
    try:
        import pint  # where somebody has quantities
    except ImportError:
        return value  # for the check to name
    of = re.sub(r"(?<=[A-Za-z])(-?\d+)", r"**\1", str(stated or ""))  # astropy's powers: g / cm3
    try:
        size = pint.UnitRegistry().Quantity(1.0, of).m_as("" if unit == "-" else unit)
        numbers, mask = np.asarray(plain) * size, np.ma.getmask(plain)
        return np.ma.array(numbers, mask=mask) if np.any(mask) else numbers
    except (TypeError, ValueError, pint.errors.PintError):
        return value
