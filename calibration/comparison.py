"""Fit several contact laws to one data set and rank them by their predictions; see `calibration.studies.scores`."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from calibration.data import RestitutionData
from calibration.errors import DataError, InputError, did_you_mean, listed, printable
from calibration.fit_result import FitResult, fit
from calibration.fitting.laws import KNOWN, WITHOUT_CONTACT, law_name
from calibration.options import LAW_OPTIONS, OF_ONE_FIT, FitOptions, documented
from calibration.studies.scores import Entry, ranked

FIXED_YIELD = "thornton-fixed"  # Thornton's law without a free parameter
FEWEST = 6  # points: three parameters, one point left out, and something to judge by
EXACT = (
    "{} follows the data exactly: they have no noise, and its score says nothing. The others show "
    "how near a law comes to it."
)
IN_FOLDS = "So many points were left out in {} parts, drawn at random and each by a fit to the others, not one by one."
# of `MaterialFit.variances`, in words
ERRORS = {
    "stated": "uncertainties as stated",
    "scale": "stated uncertainties times a factor",
    "repeats": "the scatter of repeats",
    "timing": "an error of times or heights",
    "scatter": "scatter",
    "group": "an offset of each group",
}
Watch = Callable[[Iterable, str], Iterable]


class Candidate(NamedTuple):
    """A law to be fitted, its parameters as `fit` takes them; the others as of `Entry`."""

    key: str
    label: str
    law: Any
    stated: Mapping[str, Any] = {}
    remark: str = ""


# of laws with one curve the plainest is named first
ORDER = dict.fromkeys([*WITHOUT_CONTACT, *KNOWN])
BUILT_IN = {key: Candidate(key, KNOWN[key].label, key, {}, KNOWN[key].remark) for key in ORDER}
FIXED = "Nothing to fit: contact yield pressure p_y = Y, Hertz's contact area."
BUILT_IN[FIXED_YIELD] = Candidate(
    FIXED_YIELD, "Thornton, yield pressure Y", "thornton", {"yield_factor": 1.0}, FIXED
)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Laws fitted to one data set, the best first; prints itself.

    Attributes:
        data: what was fitted.
        entries: one a law, by falling elpd; those that follow the data exactly come first and have
            no score.
        left_out: why some laws are missing.
        notes: what a reader of the ranking should know.
    """

    data: RestitutionData
    entries: tuple[Entry, ...]
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def ranking(self) -> list[str]:
        """Labels, the best first."""
        return [entry.label for entry in self.entries]

    @property
    def converged(self) -> bool:
        return all(entry.converged for entry in self.entries)

    def entry(self, label: str) -> Entry:
        """The entry of a law, by its label or key."""
        for entry in self.entries:
            if label in (entry.label, entry.key):
                return entry
        raise DataError("label", repr(label), f"one of {listed(map(repr, self.ranking))}")

    def __getitem__(self, label: str) -> FitResult:
        return cast(FitResult, self.entry(label).result)

    def __iter__(self) -> Iterator[str]:
        return iter(self.ranking)

    def __str__(self) -> str:
        from calibration.report.comparison import comparison_text

        return comparison_text([self])

    __repr__ = __str__


@partial(documented, without=OF_ONE_FIT)
def compare(
    data: RestitutionData,
    laws: Sequence[Any] | Mapping[str, Any] | None = None,
    *,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    watch: Watch = lambda items, stage: items,
    **options: Any,
) -> Comparison:
    """Fit every law to one data set and rank them by how well they predict points left out.

    Args:
        data: six points or more.
        laws: names of `LAWS` (and "thornton-fixed", p_y = Y), classes or functions that build a
            law, or {label: law}; all built-in ones that the data allow where left out.
        parameters: {label or name: parameters of that law}, each as `fit` takes them.
        watch: passes items on while it shows how many were gone through.
        OPTIONS

    Returns:
        A `Comparison`, every entry a `FitResult` by `model`. Fits that did not converge are marked
        so, not raised. Points weigh as in the fits. Where the data have groups, all of a group is
        left out together, and standard errors are over groups. Of built-in laws that cannot be
        fitted to these data `left_out` says why.

    Raises:
        ValueError: for fewer points, or naming the requested law that cannot be used.

    Example:
        >>> import calibration as cal
        >>> comparison = cal.compare(cal.paper_materials()[2], ["zhou", "constant", "hertz"])
        >>> comparison.ranking
        ['Zhou', 'constant ε (hard spheres)', 'Hertz']
    """
    if not isinstance(data, RestitutionData):
        raise DataError("data", data, "one RestitutionData")
    FitOptions.of(**options)
    for alone in (name for name in OF_ONE_FIT if name in options):
        raise DataError(alone, options[alone], "left out of a comparison")
    if len(data) < FEWEST:
        raise data.refusal(f"{len(data)} points", f"a comparison needs {FEWEST} or more")
    candidates, left_out = _chosen(laws, parameters), []
    if laws is None and data.contact is None:
        left_out += ["without elastic properties no law of the contact of two bodies can be fitted"]
        usable = set(WITHOUT_CONTACT)
        if data.limit_velocity is None:
            usable -= {"eq-17"}
            left_out.append("without a limit velocity Eq. (17) cannot be fitted either")
        candidates = [candidate for candidate in candidates if candidate.key in usable]
    entries = []
    for candidate in watch(candidates, printable(data.name)):
        key = candidate.key
        acting = {n: v for n, v in options.items() if key in LAW_OPTIONS.get(n, (key,))}
        try:
            result = fit(data, candidate.law, candidate.stated, unloading_line=None, **acting)
            left = result.leave_one_out()
            entries.append(Entry(key, candidate.label, candidate.remark, result, left))
        except (DataError, InputError) as error:
            if laws is not None:
                raise data.refusal(
                    f"{candidate.label}: {error}", "another law is needed"
                ) from error
            left_out.append(f"{candidate.label}: {error}")
    if not entries:
        raise data.refusal("no law can be fitted", "; ".join(left_out))
    best_first = ranked(entries)
    exact = " and ".join(entry.label for entry in best_first if entry.is_exact)
    notes = [*data.notes, *([EXACT.format(exact)] if exact else [])]
    if (folds := best_first[0].leave_one_out.in_folds) is not None:
        notes.append(IN_FOLDS.format(folds))
    notes += _noise_and_lead(data, [entry for entry in best_first if not entry.is_exact])
    return Comparison(data, best_first, tuple(left_out), tuple(notes))


def _noise_and_lead(data: RestitutionData, scored: Sequence[Entry]) -> Iterator[str]:
    """The error model, which all laws share; by how much, at how many points and where the best leads."""
    if not scored:
        return
    material = scored[0].result.materials[0]
    estimated = {"scale", "timing", "scatter", "group"} & set(material.variances)
    sources = " and ".join(ERRORS[kind] for kind in material.variances)
    sizes = listed(ERRORS[kind] for kind in ERRORS if kind in estimated)
    estimates = f"; {sizes} estimated for each law" if estimated else ""
    yield f"Noise of every fit: {sources}, {material.family.words}{estimates}."
    best, *others = [entry for entry in scored if entry.same_as is None]
    if not others:
        return
    behind = {entry.label: best.ahead_of(entry) for entry in others}
    text = {
        law: f"{d.value:.2g} ± {d.standard_error:.2g} in elpd" for law, (d, _) in behind.items()
    }
    tied = [f"{law} ({text[law]} behind)" for law, (ahead, _) in behind.items() if ahead.is_tie]
    if tied:
        yield f"The data do not decide between {best.label} and {listed(tied)}."
        return
    second, (_, differences) = next(iter(behind.items()))
    wins = f"it predicts {int(np.sum(differences > 0))} of {len(differences)} points better"
    if len(differences) == len(data):  # ε of each impact, and nothing else
        best_velocities = data.velocity[np.argsort(-differences)[: max(len(differences) // 5, 1)]]
        ends = (f"{end(best_velocities):.3g}" for end in (np.min, np.max))
        wins += f", most at {' to '.join(dict.fromkeys(ends))} m/s"
    yield f"{best.label} is best: ahead of {second} by {text[second]}; {wins}."


def _chosen(laws: Any, parameters: Mapping[str, Any] | None) -> list[Candidate]:
    """The requested laws; all built-in ones where none were."""
    stated = {} if parameters is None else parameters
    if not isinstance(stated, Mapping) or not all(isinstance(p, Mapping) for p in stated.values()):
        raise DataError("parameters", parameters, "a mapping from laws to mappings of theirs")
    if laws is None:
        candidates = list(BUILT_IN.values())
    elif isinstance(laws, Mapping):
        candidates = [_candidate(law)._replace(label=str(label)) for label, law in laws.items()]
    else:
        alone = isinstance(laws, str) or not isinstance(laws, Iterable)
        candidates = [_candidate(law) for law in ([laws] if alone else laws)]
    labels = [candidate.label for candidate in candidates]
    if not labels:
        raise DataError("laws", "empty", f"one law or more, such as {listed(BUILT_IN)}")
    for twice in (label for label in labels if labels.count(label) > 1):
        raise DataError("laws", f"twice {twice}", "laws of different labels, as {label: law}")
    known = {*labels, *(candidate.key for candidate in candidates)}
    for unknown in (name for name in stated if name not in known):
        raise DataError(f"parameters[{unknown!r}]", "of no law compared", f"of {listed(labels)}")
    return [
        c._replace(stated={**c.stated, **stated.get(c.key, {}), **stated.get(c.label, {})})
        for c in candidates
    ]


def _candidate(law: Any) -> Candidate:
    name = law_name(law)
    if name in BUILT_IN and (isinstance(law, str) or law is KNOWN[name].law):
        return BUILT_IN[name]
    if isinstance(law, str):
        accepted = f"one of {listed(BUILT_IN)}{did_you_mean(law, BUILT_IN)}, a class or a function"
        raise DataError("laws", law, accepted)
    return Candidate(str(name), str(name), law)
