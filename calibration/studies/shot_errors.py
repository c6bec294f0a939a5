"""The errors of one data set's points and of further shots, each of which has an error of its own."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from calibration.fitting.set_errors import Columns, SetErrors


@dataclass(frozen=True, eq=False)
class WithShots(SetErrors):
    """V of the measured points, as a fit found it, and a variance of each shot after them.

    No variance of it is unknown any more.

    Attributes:
        measured: V of the points.
        uncertainty: standard uncertainty of ε of each shot.
    """

    measured: SetErrors
    uncertainty: Float[np.ndarray, "shots"]

    @classmethod
    def of(cls, measured: SetErrors, uncertainty: Float[np.ndarray, "shots"]) -> "WithShots":
        return cls(measured.structure, {}, measured, uncertainty)

    @property
    def diagonal(self) -> Float[np.ndarray, "n"]:
        return np.concatenate([self.measured.diagonal, self.uncertainty**2])

    def whiten(self, values: Columns) -> Columns:
        return self._apart(self.measured.whiten, values, 1 / self.uncertainty)

    def unwhiten(self, white: Columns) -> Columns:
        return self._apart(self.measured.unwhiten, white, 1 / self.uncertainty)

    def coloured(self, values: Columns) -> Columns:
        return self._apart(self.measured.coloured, values, self.uncertainty)

    def _apart(self, of_measured: Callable[[Columns], Columns], rows: Columns, factor) -> Columns:
        """The points' rows so, and each shot's times its factor."""
        points = len(rows) - len(factor)
        return np.concatenate([of_measured(rows[:points]), rows[points:] * factor[:, None]])
