"""Which laws a comparison fits, what is said of each, and why others are missing."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from calibration.data import RestitutionData
from calibration.errors import DataError, did_you_mean, listed
from calibration.fitting.known_laws import KNOWN, WITHOUT_CONTACT
from calibration.fitting.request_json import law_name

FIXED_YIELD = "thornton-fixed"  # Thornton's law without a free parameter


@dataclass(frozen=True)
class Candidate:
    """One law of a comparison.

    Attributes:
        key: its name in files: that of `LAWS`, "thornton-fixed", or its class's or function's.
        label: what tables and pictures call it.
        law: a name, a class, or a function that builds one.
        said: of its parameters, as `fit` takes it.
        remark: what a reader should know of it.
    """

    key: str
    label: str
    law: Any
    said: Mapping[str, Any] = field(default_factory=dict)
    remark: str = ""


# of laws with one curve the plainest is named first
ORDER = dict.fromkeys([*WITHOUT_CONTACT, *KNOWN])
BUILT_IN = {key: Candidate(key, KNOWN[key].label, key, {}, KNOWN[key].remark) for key in ORDER}
BUILT_IN[FIXED_YIELD] = Candidate(
    FIXED_YIELD,
    "Thornton, p_y = Y",
    "thornton",
    {"yield_factor": 1.0},
    "Nothing to fit: contact yield pressure p_y = Y, Hertz's contact area.",
)


def chosen(laws: Any, parameters: Mapping[str, Any] | None) -> list[Candidate]:
    """The laws that were asked for; all built-in ones where none were.

    Args:
        laws: None, or names, classes and functions, or {label: one of these}.
        parameters: {label or key: what is said of that law's parameters}.

    Raises:
        ValueError: naming the law or label that cannot be used.
    """
    given = {} if parameters is None else parameters
    if not isinstance(given, Mapping) or not all(isinstance(p, Mapping) for p in given.values()):
        raise DataError("parameters", parameters, "a mapping from laws to mappings of theirs")
    said = dict(given)
    found = [_with(one, said) for one in _candidates(laws)]
    labels = [one.label for one in found]
    if not labels:
        raise DataError("laws", "empty", f"one law or more, such as {listed(BUILT_IN)}")
    twice = next((label for label in labels if labels.count(label) > 1), None)
    if twice is not None:
        raise DataError("laws", f"twice {twice}", "laws of different labels, as {label: law}")
    unknown = next((name for name in said if name not in {c.key for c in found} | {*labels}), None)
    if unknown is not None:
        raise DataError(f"parameters[{unknown!r}]", "of no law compared", f"of {listed(labels)}")
    return found


def missing_laws(data: RestitutionData) -> tuple[set[str], tuple[str, ...]]:
    """Keys of built-in laws that some data do not allow, and why."""
    if data.contact is not None:
        return set(), ()
    keys = set(BUILT_IN) - set(WITHOUT_CONTACT)
    why = ["without elastic properties no law of the contact of two bodies can be fitted"]
    if data.limit_velocity is None:
        keys.add("eq-17")
        why.append("without a limit velocity Eq. (17) cannot be fitted either")
    return keys, tuple(why)


def _candidates(laws: Any) -> list[Candidate]:
    if laws is None:
        return list(BUILT_IN.values())
    if isinstance(laws, Mapping):
        return [replace(_candidate(law), label=str(label)) for label, law in laws.items()]
    alone = isinstance(laws, str | type) or callable(laws) or not isinstance(laws, Iterable)
    return [_candidate(law) for law in ([laws] if alone else laws)]


def _candidate(law: Any) -> Candidate:
    name = law_name(law)
    if name in BUILT_IN and (isinstance(law, str) or law is KNOWN[name].law):
        return BUILT_IN[name]
    if isinstance(law, str):
        accepted = f"one of {listed(BUILT_IN)}{did_you_mean(law, BUILT_IN)}, a class or a function"
        raise DataError("laws", law, accepted)
    return Candidate(str(name), str(name), law)


def _with(one: Candidate, said: Mapping[str, Any]) -> Candidate:
    return replace(one, said={**one.said, **said.get(one.key, {}), **said.get(one.label, {})})
