"""What a study of coverage found, and its table."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Coverage:
    """What came out of one case; arrays by parameter label.

    Attributes:
        name, sets: what was simulated, and how often.
        converged: share of the fits that did.
        covered: share of the intervals that hold the truth: those that a fit tells.
        by_error: share of the intervals from standard errors alone that do.
        spread, error: standard deviation of the estimates, and root mean square of the standard
            errors, both in z (log units for most).
        estimates, errors: of each set, in z.
        measurements: share of the prediction bands that hold one more measurement; NaN where
            none was drawn.
    """

    name: str
    sets: int
    converged: float
    covered: dict[str, float]
    by_error: dict[str, float]
    spread: dict[str, float]
    error: dict[str, float]
    estimates: dict[str, Float[np.ndarray, "sets"]]
    errors: dict[str, Float[np.ndarray, "sets"]]
    measurements: float = float("nan")

    @property
    def ratio(self) -> dict[str, float]:
        """Root mean square standard error over the actual spread."""
        return {name: self.error[name] / self.spread[name] for name in self.error}


def report(study: Sequence[Coverage]) -> str:
    """The study as a table: per cent of intervals that hold the truth, error over spread."""
    lines = []
    for one in study:
        parts = [
            f"{label} {100 * share:.1f} ({one.ratio[label]:.2f})"
            for label, share in one.covered.items()
        ]
        if one.measurements == one.measurements:
            parts.append(f"one more measurement {100 * one.measurements:.1f}")
        told = f"{', '.join(parts)}; converged {100 * one.converged:.1f} %"
        lines.append(f"{one.name:36}{told}")
    return "\n".join(["per cent covered (rms standard error over spread)", *lines])
