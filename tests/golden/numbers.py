"""Numbers of one scenario with a mark and a tolerance each; kept as JSON, compared one by one."""

import json
import re
from collections.abc import Callable, Iterator
from decimal import Decimal
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

PHYSICS, ESTIMATE, ERROR = "physics", "estimate", "error"
RELATIVE = 1e-9  # of physics: restitutions, ln L at given parameters
OF_ERROR = {ESTIMATE: 1e-4, ERROR: 1e-3}  # of the standard error
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
PRINTED = re.compile(r"(\d+(?:\.\d+)?(?:e[-+]?\d+)?)")  # and the words between
SCENARIOS: dict[str, "Scenario"] = {}


class Numbers:
    """What one scenario found: {mark: {name: [values, tolerances]}}; None stands for no number."""

    def __init__(self) -> None:
        self.table: dict[str, dict[str, list]] = {PHYSICS: {}, ESTIMATE: {}, ERROR: {}}

    def physics(self, name: str, value: Any, relative: float = RELATIVE, least=0.0) -> None:
        """A number that no data and no noise enter, or that follows from given parameters."""
        self._add(PHYSICS, name, value, np.maximum(relative * np.abs(_array(value)), least))

    def estimate(self, name: str, value: Any, error: Any) -> None:
        """What a fit found, and the standard error of it."""
        self._add(ESTIMATE, name, value, OF_ERROR[ESTIMATE] * _array(error))

    def error(self, name: str, value: Any, error: Any) -> None:
        """A standard error, an end of an interval or band, or what weights by errors decide."""
        self._add(ERROR, name, value, OF_ERROR[ERROR] * _array(error))

    def text(self, mark: str, name: str, entry: Any) -> None:
        """Words; printed numbers among them are compared to one unit of their last digit."""
        if name in self.table[mark]:
            raise KeyError(f"{name!r} stands twice")
        self.table[mark][name] = entry

    def printed(self, name: str, cells: list[str]) -> None:
        """The numbers in a row of a table: `a ± b` is an estimate and its error, others count as errors."""
        found: dict[str, list[str]] = {ESTIMATE: [], ERROR: []}
        for cell in cells:
            value, _, rest = cell.rpartition(" ± ")
            found[ESTIMATE] += NUMBER.findall(value)
            found[ERROR] += NUMBER.findall(rest)
        for mark, some in found.items():
            if some:
                self.text(mark, f"{name}, {mark}s", " ".join(some))

    def _add(self, mark: str, name: str, value: Any, tolerance: np.ndarray) -> None:
        value = _array(value)
        rounding = 1e-12 * np.abs(value)
        known = np.where(np.isfinite(tolerance), np.maximum(tolerance, rounding), rounding)
        allowed = np.broadcast_to(known, value.shape)
        every = {_plain(one, "%.1e") for one in allowed.ravel()}
        same = every.pop() if len(every) == 1 else _plain(allowed, "%.1e")
        self.text(mark, name, [_plain(value), same])


class Scenario(NamedTuple):
    """A case: `run(numbers, folder)` records what it finds; `long` where it takes long."""

    run: Callable[[Numbers, Path], None]
    long: bool


def scenario(run: Callable | None = None, *, long: bool = False) -> Callable:
    if run is None:
        return partial(scenario, long=long)
    SCENARIOS[run.__name__] = Scenario(run, long)
    return run


def differences(old: dict, new: dict) -> list[str]:
    """One line for each number that moved by more than the recorded tolerance, came or went."""
    return [
        f"{name} [{mark}]: {line}"
        for mark in old
        for name in sorted({*old[mark], *new[mark]})
        for line in _differences(old[mark].get(name), new[mark].get(name))
    ]


def renewed(old: dict, new: dict) -> dict:
    """What is to be recorded: numbers that did not move keep their old digits."""
    return {
        mark: {name: _renewed(old[mark].get(name), entry) for name, entry in entries.items()}
        for mark, entries in new.items()
    }


def _renewed(old: Any, new: Any) -> Any:
    same = old is not None and not list(_differences(old, new))
    return old if same and (isinstance(old, str) or old[1] == new[1]) else new


def _differences(old: Any, new: Any) -> Iterator[str]:
    if old is None or new is None:
        yield "new, not recorded" if old is None else "recorded, no longer there"
    elif isinstance(old, str) or isinstance(new, str):
        if not same_print(old, new):
            yield f"was {old}, is {new}"
    elif np.shape(old[0]) != np.shape(new[0]):
        yield f"was {old[0]}, is {new[0]}"
    else:
        before, tolerance, after = (np.array(x, float) for x in (*old, new[0]))  # NaN for None
        moved = (np.isnan(before) != np.isnan(after)) | (np.abs(after - before) > tolerance)
        for at in map(tuple, np.argwhere(moved)):
            yield f"{[*map(int, at)]} was {before[at]:.15g}, is {after[at]:.15g}"


def same_print(old: Any, new: Any) -> bool:
    """Whether both are texts with the same words, and with numbers that nearly agree."""
    if not (isinstance(old, str) and isinstance(new, str)):
        return False
    pairs = zip_longest(PRINTED.split(old), PRINTED.split(new), fillvalue="")
    return all(a == b or _nearly(a, b) for a, b in pairs)


def _nearly(old: str, new: str) -> bool:
    """Whether both are numbers that differ by one unit at most of the last digit of the longer one."""
    if not (NUMBER.fullmatch(old) and NUMBER.fullmatch(new)):
        return False
    first, second = Decimal(old), Decimal(new)
    unit = Decimal(1).scaleb(min(first.as_tuple().exponent, second.as_tuple().exponent))
    return abs(first - second) <= unit


def _array(value: Any) -> np.ndarray:
    return np.asarray(np.nan if value is None else value, float)


def _plain(array: np.ndarray, form: str = "%.15g") -> Any:
    if array.ndim:
        return [_plain(part, form) for part in array]
    return float(form % array) if np.isfinite(array) else None


def to_text(table: dict) -> str:
    parts = []
    for mark, entries in table.items():
        texts = (map(partial(json.dumps, ensure_ascii=False), pair) for pair in entries.items())
        lines = (f"  {name}: {entry}" for name, entry in texts)
        parts.append(f" {json.dumps(mark)}: {{\n" + ",\n".join(lines) + "\n }")
    return "{\n" + ",\n".join(parts) + "\n}\n"
