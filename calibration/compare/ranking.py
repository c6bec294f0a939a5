"""All candidates against one data set, sorted by how well they predict points left out."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from calibration.compare.candidates import CONSTANT, Candidate, candidates_of, left_out
from calibration.compare.curves import Observed, observe
from calibration.compare.doubts import separation
from calibration.compare.entries import Entry, alike, constant_entry, fitted_entry
from calibration.compare.zhou import losses_to_try, zhou_candidate
from calibration.data.measurements import RestitutionData
from calibration.doubt import Doubt

FEWEST = 6  # points: three parameters, one point left out, and something to judge by
MADE_BY_EQ_17 = (
    "These data are Eq. (17) itself: its residuals are rounding and say nothing for it. The others "
    "show how near a law comes to that formula."
)
Watch = Callable[[Iterable, str], Iterable]


@dataclass(frozen=True)
class Ranking:
    """One data set's entries, the lowest leave-one-out rms first.

    Attributes:
        data: what was fitted.
        entries: one a candidate; those with the same number stay in their order.
        left_out: why some candidates are missing.
        notes: what a reader of the ranking should know.
    """

    data: RestitutionData
    entries: tuple[Entry, ...]
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        return all(entry.converged for entry in self.entries)

    def entry(self, key: str) -> Entry:
        """The entry of a candidate, by its key."""
        return next(entry for entry in self.entries if entry.candidate.key == key)


def rank(
    data: RestitutionData,
    free: tuple[str, ...] = (),
    form: str = "first-order",
    kappa: str = "consistent",
    watch: Watch = lambda items, stage: items,
) -> Ranking:
    """Fit every law to one data set.

    Args:
        data: six points or more.
        free: parameters to free beside those that always are: "yield_factor" of `Thornton`.
        form, kappa: of `Zhou`.
        watch: passes items on while it shows how many were gone through.

    Returns:
        A `Ranking`. Fits that did not converge are marked so, not raised.

    Raises:
        InputError: for fewer points.
    """
    import jax

    if len(data) < FEWEST:
        raise data.refusal(f"{len(data)} points", f"a comparison needs {FEWEST} or more")
    with jax.enable_x64(True):
        observed = observe(data)
        zhou = [] if data.contact is None else [None]
        jobs = [*candidates_of(data, free), *zhou]
        constant = constant_entry(CONSTANT, data, observed)

        def entry_of(candidate: Candidate | None) -> Entry:
            if candidate is None:
                return _zhou(data, observed, form, kappa)
            if candidate is CONSTANT:
                return constant
            if candidate.same_as:
                return alike(candidate, constant)
            return fitted_entry(candidate, data, observed)

        entries = [entry_of(job) for job in watch(jobs, data.name)]
    return Ranking(data, _sorted(entries), tuple(left_out(data)), _notes(data))


def _zhou(data: RestitutionData, observed: Observed, form: str, kappa: str) -> Entry:
    """Zhou's law with as many parameters as the data can tell apart."""
    losses = losses_to_try(data)
    entry = fitted_entry(zhou_candidate(losses, form, kappa), data, observed)
    if losses == "no-chi":
        return _doubted(entry, Doubt("all-below-yield", "nothing reaches the critical velocity"))
    if losses == "eps-up":
        cause = "no points below the critical velocity: sigma and psi act through eps_up alone"
        return _doubted(entry, Doubt("eps-up-only", cause))
    why = separation(entry)
    if why is None:
        return entry
    return _doubted(fitted_entry(zhou_candidate("eps-up", form, kappa), data, observed), why)


def _doubted(entry: Entry, one: Doubt) -> Entry:
    return replace(entry, doubts=(one, *entry.doubts))


def _sorted(entries: list[Entry]) -> tuple[Entry, ...]:
    def score(entry: Entry) -> float:
        value = entry.rms_leave_one_out
        return value if np.isfinite(value) else np.inf

    return tuple(sorted(entries, key=score))


def _notes(data: RestitutionData) -> tuple[str, ...]:
    from calibration.data.paper import PAPER_NOTE

    if PAPER_NOTE not in data.remarks:
        return tuple(data.notes)
    return (*data.notes, MADE_BY_EQ_17)
