"""What a comparison of contact laws found: an `Entry` a law, ranked in a `Comparison`."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from calibration.data import RestitutionData
from calibration.errors import DataError, listed
from calibration.fitting.doubt import Doubt
from calibration.fitting.left_out import LeaveOneOut
from calibration.fitting.result import FitResult
from calibration.report.comparison import comparison_text
from calibration.studies.candidates import Candidate

TIE = 2.0  # standard errors of a difference
ROUNDING = 1e-6  # of a difference between laws with the same curve


class Difference(NamedTuple):
    """elpd less that of the best law, and its standard error."""

    value: float
    standard_error: float

    @property
    def is_tie(self) -> bool:
        """Whether it is 0 within `TIE` standard errors."""
        return -self.value < TIE * self.standard_error + ROUNDING


@dataclass(frozen=True, eq=False)
class Entry:
    """What became of one law.

    Attributes:
        candidate: which law, and what was said of it.
        result: its fit.
        leave_one_out: each point predicted by the fit without it.
        behind: how far behind the best law it predicts; None for a law that follows the data
            exactly, which no score tells anything of.
        weight: in the mixture that predicts best; None as well.
        same_as: the label of a law before it that has the same curve, or None.
    """

    candidate: Candidate
    result: FitResult
    leave_one_out: LeaveOneOut
    behind: Difference | None = None
    weight: float | None = None
    same_as: str | None = None

    @property
    def key(self) -> str:
        return self.candidate.key

    @property
    def label(self) -> str:
        return self.candidate.label

    @property
    def converged(self) -> bool:
        """Whether the fit, and every fit without a point, ended at a minimum."""
        return self.result.converged and self.leave_one_out.converged

    @property
    def is_exact(self) -> bool:
        """Whether its residuals are rounding: data without noise, made by this very law."""
        return self.result.log_likelihood is None

    @property
    def fitted(self) -> int:
        """How many numbers were fitted."""
        return len(self.result.covariance_names)

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Those of the fit, and of the fits without a point."""
        if self.leave_one_out.converged:
            return self.result.warnings
        why = Doubt("not-converged", "not every fit without a point ended at a minimum")
        return (*self.result.warnings, why)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Laws fitted to one data set, the best first; prints itself.

    Attributes:
        data: what was fitted.
        entries: one a law, by falling elpd; those that follow the data exactly come first and are
            scored with none.
        left_out: why some laws are missing.
        notes: what a reader of the ranking should know.
        seconds: how long it took.
    """

    data: RestitutionData
    entries: tuple[Entry, ...]
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def ranking(self) -> list[str]:
        """Labels, the best first."""
        return [entry.label for entry in self.entries]

    @property
    def converged(self) -> bool:
        return all(entry.converged for entry in self.entries)

    def entry(self, label: str) -> Entry:
        """The entry of a law, by its label or key.

        Raises:
            ValueError: naming the accepted labels.
        """
        for entry in self.entries:
            if label in (entry.label, entry.key):
                return entry
        raise DataError("label", repr(label), f"one of {listed(map(repr, self.ranking))}")

    def __getitem__(self, label: str) -> FitResult:
        return self.entry(label).result

    def __iter__(self) -> Iterator[str]:
        return iter(self.ranking)

    def __str__(self) -> str:
        return comparison_text([self])

    __repr__ = __str__
