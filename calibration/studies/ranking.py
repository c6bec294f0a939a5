"""Which contact law a data set prefers: every law fitted, ranked by how well it predicts.

    elpd = Σ_i ln p(ε_i | all data but point i)        expected log predictive density

Differences between laws come with their standard error over the points; below twice that error two
laws are a tie. Stacking weights are those with which a mixture of the laws predicts best.

Source: Vehtari, Gelman and Gabry, Stat. Comput. 27, 1413 (2017); stacking: Yao, Vehtari, Simpson
and Gelman, Bayesian Anal. 13, 917 (2018).
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.data import RestitutionData
from calibration.data.checks import check_whole
from calibration.errors import DataError, InputError, printable
from calibration.fitting.door import fit
from calibration.studies.candidates import Candidate, chosen, missing_laws
from calibration.studies.comparison import Comparison, Difference, Entry

FEWEST = 6  # points: three parameters, one point left out, and something to judge by
SAME_CURVE = 1e-6  # of ε at every point
STACKING_ROUNDS = 5000
SETTLED = 1e-10  # of a weight, between two rounds
EXACT = (
    "{} follows the data exactly: they have no noise, and its score says nothing. The others show "
    "how near a law comes to it."
)
TO_FIRST_ORDER = (
    "So many points were left out to first order, not by fitting again: exact for a law that is "
    "linear in its parameters."
)
Watch = Callable[[Iterable, str], Iterable]


def compare(
    data: RestitutionData,
    laws: Sequence[Any] | Mapping[str, Any] | None = None,
    *,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    seed: int = 0,
    watch: Watch = lambda items, stage: items,
) -> Comparison:
    """Fit every law to one data set and rank them by how well they predict points left out.

    Args:
        data: six points or more.
        laws: names of `LAWS` (and "thornton-fixed", p_y = Y), classes or functions that build a
            law, or {label: law}; all built-in ones that the data allow where left out.
        parameters: {label or name: what is said of that law's parameters}, as `fit` takes it.
        seed: of the starts.
        watch: passes items on while it shows how many were gone through.

    Returns:
        A `Comparison`, every entry a `FitResult` by `model`. Fits that did not converge are marked
        so, not raised. Points weigh as in the fits. Where the data have groups, all of a group is
        left out together, and standard errors are over groups. Of built-in laws that cannot be
        fitted to these data `left_out` says why.

    Raises:
        ValueError: for fewer points, or naming the law that was asked for and cannot be used.

    Example:
        >>> import calibration as cal
        >>> comparison = cal.compare(cal.paper_materials()[2], ["zhou", "constant", "hertz"])
        >>> comparison.ranking
        ['Zhou', 'constant ε (hard spheres)', 'Hertz']
    """
    begun = time.perf_counter()
    if not isinstance(data, RestitutionData):
        raise DataError("data", data, "one RestitutionData")
    check_whole("seed", seed, 0)
    if len(data) < FEWEST:
        raise data.refusal(f"{len(data)} points", f"a comparison needs {FEWEST} or more")
    candidates, left_out = chosen(laws, parameters), []
    if laws is None:
        without, reasons = missing_laws(data)
        candidates, left_out = [c for c in candidates if c.key not in without], list(reasons)
    entries = []
    for candidate in watch(candidates, printable(data.name)):
        try:
            entries.append(_entry(data, candidate, seed))
        except (DataError, InputError) as error:
            if laws is not None:
                raise data.refusal(
                    f"{candidate.label}: {error}", "another law is needed"
                ) from error
            left_out.append(f"{candidate.label}: {error}")
    if not entries:
        raise data.refusal("no law can be fitted", "; ".join(left_out))
    ranked = _ranked(entries)
    return Comparison(
        data, ranked, tuple(left_out), _notes(data, ranked), time.perf_counter() - begun
    )


def _entry(data: RestitutionData, candidate: Candidate, seed: int) -> Entry:
    result = fit(
        data, candidate.law, candidate.said, profiles=False, seed=seed, unloading_line=None
    )
    return Entry(candidate, result, result.leave_one_out())


def _ranked(entries: list[Entry]) -> tuple[Entry, ...]:
    """By falling elpd, each with its distance to the best and its weight; exact ones before them."""
    exact = [one for one in entries if one.is_exact]
    others = _with_same_curves([one for one in entries if not one.is_exact])
    if not others:
        return tuple(exact)
    scores = {one.label: one.leave_one_out.elpd for one in others}
    # laws of one curve differ by rounding, and stay in the order in which they were asked for
    order = sorted(others, key=lambda one: -scores[one.same_as or one.label])
    densities = np.stack([one.leave_one_out.log_density for one in order])
    ranked = []
    for one, weight in zip(order, stacking_weights(densities), strict=True):
        apart = one.leave_one_out.log_density - densities[0]
        behind = Difference(float(np.sum(apart)), one.leave_one_out.error_of_sum(apart))
        ranked.append(replace(one, behind=behind, weight=float(weight)))
    return (*exact, *ranked)


def _with_same_curves(entries: list[Entry]) -> list[Entry]:
    """The same, each with the label of the first that has its curve."""
    found: list[Entry] = []
    for one in entries:
        alike = (other.label for other in found if other.same_as is None and _agree(one, other))
        found.append(replace(one, same_as=next(alike, None)))
    return found


def _agree(one: Entry, other: Entry) -> bool:
    """Whether two laws predict every point alike."""
    apart = one.leave_one_out.predicted - other.leave_one_out.predicted
    return bool(np.max(np.abs(apart)) < SAME_CURVE)


def stacking_weights(log_density: Float[np.ndarray, "laws n"]) -> Float[np.ndarray, "laws"]:
    """w >= 0, Σw = 1, that make Σ_i ln Σ_k w_k p_k(ε_i) largest, by expectation–maximisation.

    Laws with the same curve share its weight equally.
    """
    ratio = np.exp(log_density - np.max(log_density, axis=0))
    weights = np.full(len(log_density), 1 / len(log_density))
    for _ in range(STACKING_ROUNDS):
        shares = weights[:, None] * ratio
        moved = np.mean(shares / np.sum(shares, axis=0), axis=1)
        if np.max(np.abs(moved - weights)) < SETTLED:
            return moved
        weights = moved
    return weights


def _notes(data: RestitutionData, entries: tuple[Entry, ...]) -> tuple[str, ...]:
    exact = [entry.label for entry in entries if entry.is_exact]
    made = (EXACT.format(" and ".join(exact)),) if exact else ()
    continued = () if all(e.leave_one_out.exact for e in entries) else (TO_FIRST_ORDER,)
    return (*data.notes, *made, *continued)
