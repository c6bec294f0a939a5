"""The settings of a fit that a file may hold, in its `[fit]` table."""

from collections.abc import Callable
from typing import Any

from calibration.data.toml_table import TomlTable

CHOICES: dict[str, tuple[str, ...]] = {
    "objective": ("two-step", "model", "empirical", "constant"),
    "optimiser": ("l-bfgs", "adam", "levenberg-marquardt"),
    "loss": ("squared", "huber", "soft-l1"),
    "route": ("ode", "energy balance"),
    "form": ("first-order", "full"),
    "kappa": ("consistent", "printed"),
    "area": ("zhou", "hertz"),
    # Eq. (18) through all curves, through the fitted χ̃, or not at all
    "unloading_line": ("curves", "weighted", "none"),
}
COUNTS = {"seed": 0, "starts": 1, "max_steps": 1}  # and the smallest that is accepted
NUMBERS: dict[str, tuple[Callable[[float], bool], str]] = {
    "rtol": (lambda x: 1e-14 <= x <= 0.1, "a number in [1e-14, 0.1]"),
    "confidence": (lambda x: 0 < x < 1, "a number between 0 and 1, such as 0.95"),
    "loss_scale": (lambda x: x > 0, "a positive number, in standard errors of the residuals"),
}


def read_settings(table: TomlTable | None) -> dict[str, Any]:
    """The settings that the file gives, each checked; none of the others.

    Raises:
        InputError: with file and line.
    """
    if table is None:
        return {}
    table.allow([*CHOICES, *COUNTS, *NUMBERS])
    values = {key: _setting(table, key) for key in table.values}
    if values.get("route") == "energy balance" and "rtol" in values:
        problem, accepted = "rtol beside the energy balance", 'it acts with route = "ode" only'
        raise table.refusal("rtol", problem, accepted)
    return values


def _setting(table: TomlTable, key: str) -> Any:
    if key in CHOICES:
        return table.choice(key, CHOICES[key])
    if key in NUMBERS:
        return table.number(key, *NUMBERS[key])
    value = table.values[key]
    if not isinstance(value, int) or isinstance(value, bool) or value < COUNTS[key]:
        raise table.wrong(key, f"a whole number of {COUNTS[key]} or more")
    return value
