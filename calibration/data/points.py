"""The rows of a table in SI, and the points that become of them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from calibration.data.air import Air, Fall
from calibration.data.checks import Column
from calibration.data.columns import Kind
from calibration.data.errors_of_points import PointErrors
from calibration.errors import DataError

STANDARD_GRAVITY = 9.80665  # m/s²
FASTEST_FALL = 20.0  # m/s, of more than 20 m
FALLEN = "impact velocities follow from the drop heights"  # a remark
FALLS = "falls as fast as"  # a remark on those that are faster


class Measured(NamedTuple):
    """The rows of a table.

    Attributes:
        kind: what the columns are together.
        columns: by name, in SI; NaN where a cell is empty; those of labels are text.
        relative: names of uncertainties that are parts of the quantity itself.
        gravity: g [m/s²].
        air: what balls fly in; None: their flights are taken as if in vacuum.
    """

    kind: Kind
    columns: Mapping[str, np.ndarray]
    relative: frozenset[str] = frozenset()
    gravity: float = STANDARD_GRAVITY
    air: Air | None = None

    def uncertainty(self, name: str, of: Column) -> Column | None:
        """The uncertainty of `of` in the column of that name, None where there is none."""
        if name not in self.columns:
            return None
        return self.columns[name] * np.abs(of) if name in self.relative else self.columns[name]

    def take(self, rows) -> "Measured":
        columns = {name: one[rows] for name, one in self.columns.items()}
        return self._replace(columns=columns, air=None if self.air is None else self.air.take(rows))


class Points(NamedTuple):
    """n impacts: v [m/s], ε, their errors, the row each came from, its group, remarks."""

    velocity: Column
    restitution: Column
    errors: PointErrors
    rows: Int[np.ndarray, " n"]
    group: Sequence[str] | np.ndarray | None
    remarks: tuple[str, ...] = ()
    more: Mapping[str, Column] = {}  # what else was measured, its uncertainties, and sizes
    fall: Fall | None = None


def with_own(errors: PointErrors, table: Measured, velocity: Column, restitution: Column):
    """The errors with what is stated of each ε and each v, and remarks on it.

    Raises:
        DataError: for an invalid uncertainty.
    """
    alone = table.uncertainty("uncertainty", restitution)
    if alone is not None:
        alone = np.where(np.isnan(restitution), 1.0, alone)  # of what was not measured
    of_velocity = table.uncertainty("velocity_uncertainty", velocity)
    remarks: tuple[str, ...] = ()
    if (
        alone is not None and errors.size_is_unknown
    ):  # stated of each ε: nothing is left to estimate
        errors = replace(PointErrors.alone(len(errors)), by_drag=errors.by_drag)
    elif alone is not None and errors.kind:
        remarks = (f"uncertainty is added to that of the {errors.kind}",)
    if errors.kind == "velocities":  # of which v is one: see `singles`
        of_velocity = None
    return replace(errors, restitution_alone=alone, velocity_alone=of_velocity), remarks


def of_falls(velocity: Column, gravity: float) -> tuple[str, ...]:
    """Remarks: that they are, and on falls from higher than anybody drops a ball, in air too."""
    fastest = float(np.max(velocity))
    if not FASTEST_FALL < fastest < np.inf:
        return (FALLEN,)
    return (
        FALLEN,
        f"{FALLS} {fastest:.3g} m/s, from {fastest * (fastest / (2 * gravity)):.3g} m",
    )


def of_row(error: DataError, rows: np.ndarray) -> DataError:
    """The refusal of a point as that of its row in the table, where NaN is an empty cell."""
    index = None if error.index is None else int(rows[error.index])
    value = "empty" if error.value == "nan" else error.value
    return DataError(error.argument, value, error.accepted, index)
