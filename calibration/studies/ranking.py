"""Which contact law a data set prefers: every law fitted, ranked by how well it predicts.

    elpd = Σ_i ln p(ε_i | all data but point i)        expected log predictive density

Differences between laws come with their standard error over the points; below twice that error two
laws are a tie. Stacking weights are those with which a mixture of the laws predicts best.

Source: Vehtari, Gelman and Gabry, Stat. Comput. 27, 1413 (2017); stacking: Yao, Vehtari, Simpson
and Gelman, Bayesian Anal. 13, 917 (2018).
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.data import PAPER_NOTE, RestitutionData
from calibration.errors import DataError
from calibration.fitting.door import fit
from calibration.fitting.known_laws import KNOWN, LAWS, WITHOUT_CONTACT
from calibration.fitting.refits import LeaveOneOut
from calibration.fitting.request import datasets_of
from calibration.fitting.request_json import law_name
from calibration.fitting.result import FitResult

FEWEST = 6  # points: three parameters, one point left out, and something to judge by
TIE = 2.0  # standard errors of a difference
STACKING_ROUNDS = 2000
MADE_BY_EQ_17 = (
    "These data are Eq. (17) itself: its residuals are rounding and say nothing for it. The others "
    "show how near a law comes to that formula."
)
FIXED_YIELD = "thornton, p_y = Y"  # Thornton's law without a free parameter
Watch = Callable[[Iterable, str], Iterable]


@dataclass(frozen=True, eq=False)
class Entry:
    """What became of one law.

    Attributes:
        key: its name in files.
        label: what tables and pictures call it.
        result: its fit.
        left_out: each point predicted by the fit without it.
        behind: elpd less that of the best law, and the standard error of that difference.
        weight: in the mixture that predicts best.
    """

    key: str
    label: str
    result: FitResult
    left_out: LeaveOneOut
    behind: tuple[float, float] = (0.0, 0.0)
    weight: float = 0.0

    @property
    def tie(self) -> bool:
        """Whether it predicts as well as the best, within the error of the difference."""
        difference, error = self.behind
        return difference > -TIE * error or difference == 0

    @property
    def converged(self) -> bool:
        return self.result.converged and self.left_out.converged

    @property
    def fitted(self) -> int:
        """How many parameters."""
        return len(self.result.covariance_names)

    @property
    def remark(self) -> str:
        """What a reader should know of the law."""
        known = KNOWN.get(self.key)
        if self.key == FIXED_YIELD:
            return "Nothing to fit: contact yield pressure p_y = Y, Hertz's contact area."
        return "" if known is None else known.remark


@dataclass(frozen=True, eq=False)
class Comparison:
    """Laws fitted to one data set, the best first; prints itself.

    Attributes:
        data: what was fitted.
        entries: one a law, by falling elpd.
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
        raise DataError("label", repr(label), f"one of {', '.join(map(repr, self.ranking))}")

    def __getitem__(self, label: str) -> FitResult:
        return self.entry(label).result

    def __iter__(self) -> Iterator[str]:
        return iter(self.ranking)

    def __str__(self) -> str:
        width = max(map(len, self.ranking))
        head = f"{'':{width}}  {'elpd':>9}  {'behind':>16}  {'left out':>9}  {'rms':>9}  weight"
        lines = [f"{self.data.name}: {len(self.data)} points", head]
        for e in self.entries:
            behind = "best" if e is self.entries[0] else f"{e.behind[0]:.1f} ± {e.behind[1]:.1f}"
            lines.append(
                f"{e.label:{width}}  {e.left_out.elpd:9.1f}  {behind + ' tie' * (e.tie and e is not self.entries[0]):>16}"
                f"  {e.left_out.rms:9.3g}  {e.result.rms:9.3g}  {e.weight:6.2f}"
            )
        return "\n".join([*lines, *self.notes])


def compare(
    data: RestitutionData,
    laws: Sequence[Any] | Mapping[str, Any] | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    seed: int = 0,
    watch: Watch = lambda items, stage: items,
) -> Comparison:
    """Fit every law to one data set and rank them by how well they predict points left out.

    Args:
        data: six points or more.
        laws: names of `LAWS`, classes or functions that build a law, or {label: law}; all built-in
            ones that the data allow where left out, Thornton's with and without its free factor.
        parameters: {label or name: what is said of that law's parameters}, as `fit` takes it.
        seed: of the starts.
        watch: passes items on while it shows how many were gone through.

    Returns:
        A `Comparison`, every entry a `FitResult` by `model`. Fits that did not converge are marked
        so, not raised. Points weigh as in the fits. Where the data have groups, all of a group is
        left out together.

    Raises:
        ValueError: for fewer points, or naming the law that cannot be used.
    """
    begun = time.perf_counter()
    datasets_of(data)
    if len(data) < FEWEST:
        raise data.refusal(f"{len(data)} points", f"a comparison needs {FEWEST} or more")
    chosen, missing = _chosen(data, laws)
    said = parameters or {}
    entries = []
    for label, law in watch(list(chosen.items()), data.name):
        own = {**_standing(label), **said.get(label, said.get(law_name(law) or "", {}))}
        result = fit(data, law, own, profiles=False, seed=seed, unloading_line=None)
        key = label if label == FIXED_YIELD else law_name(law) or label
        entries.append(Entry(key, label, result, result.leave_one_out()))
    return Comparison(data, _ranked(entries), missing, _notes(data), time.perf_counter() - begun)


def _chosen(data: RestitutionData, laws) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The laws by their labels, and why others are missing."""
    if isinstance(laws, Mapping):
        return dict(laws), ()
    if laws is not None:
        return {_label(law): law for law in laws}, ()
    if data.contact is None:
        why = ["without elastic properties no law of the contact of two bodies can be fitted"]
        names = [
            name for name in WITHOUT_CONTACT if name != "eq-17" or data.limit_velocity is not None
        ]
        if len(names) < len(WITHOUT_CONTACT):
            why.append("without a limit velocity Eq. (17) cannot be fitted either")
        return {KNOWN[name].label: name for name in names}, tuple(why)
    chosen = {known.label: name for name, known in KNOWN.items()}
    return chosen | {FIXED_YIELD: "thornton"}, ()


def _label(law: Any) -> str:
    name = law_name(law)
    return KNOWN[name].label if name in LAWS else str(name)


def _standing(label: str) -> dict[str, Any]:
    return {"yield_factor": 1.0} if label == FIXED_YIELD else {}


def _ranked(entries: list[Entry]) -> tuple[Entry, ...]:
    """By falling elpd, each with its distance to the best and its weight."""
    order = sorted(entries, key=lambda one: -np.nan_to_num(one.left_out.elpd, nan=-np.inf))
    best = order[0].left_out.log_density
    weights = stacking_weights(np.stack([one.left_out.log_density for one in order]))
    ranked = []
    for one, weight in zip(order, weights, strict=True):
        apart = one.left_out.log_density - best
        error = float(np.sqrt(len(apart) * np.var(apart)))
        behind = (float(np.sum(apart)), error)
        ranked.append(Entry(one.key, one.label, one.result, one.left_out, behind, float(weight)))
    return tuple(ranked)


def stacking_weights(density: Float[np.ndarray, "laws n"]) -> Float[np.ndarray, "laws"]:
    """w >= 0, Σw = 1, that make Σ_i ln Σ_k w_k p_k(ε_i) largest, by expectation–maximisation."""
    ratio = np.exp(density - np.max(density, axis=0))
    weights = np.full(len(density), 1 / len(density))
    for _ in range(STACKING_ROUNDS):
        shares = weights[:, None] * ratio
        moved = np.mean(shares / np.sum(shares, axis=0), axis=1)
        if np.max(np.abs(moved - weights)) < 1e-9:
            return moved
        weights = moved
    return weights


def _notes(data: RestitutionData) -> tuple[str, ...]:
    made = (MADE_BY_EQ_17,) if PAPER_NOTE in data.remarks else ()
    return (*data.notes, *made)
