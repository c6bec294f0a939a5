"""Block after block of velocities through a law, or a fit with its band."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

import softjax as sj
from calibration.curve.source import Source

Route = sj.EnergyBalance | sj.ClosedForm | sj.ODE | None
FILLED = 256  # rows


class Rows(NamedTuple):
    """One block of a curve: v [m/s], ε, status, and the confidence limits of a fit's ε.

    ε and its limits are NaN where a fit knows nothing.
    """

    velocity: Float[np.ndarray, " n"]
    coefficient: Float[np.ndarray, " n"]
    status: Int[np.ndarray, " n"]
    low: Float[np.ndarray, " n"] | None = None
    high: Float[np.ndarray, " n"] | None = None

    def some(self, which: Any) -> "Rows":
        return Rows._make(None if column is None else column[which] for column in self)


@dataclass
class Span:
    """The velocities seen so far, and of how many of them the source knows something."""

    low: float = np.inf
    high: float = -np.inf
    rows: int = 0
    known: int = 0

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest."""
        return self.low, self.high

    def add(self, rows: Rows) -> None:
        self.low = min(self.low, float(np.min(rows.velocity)))
        self.high = max(self.high, float(np.max(rows.velocity)))
        self.rows += len(rows.velocity)
        self.known += int(np.sum(np.isfinite(rows.coefficient)))


def curve_rows(source: Source, blocks: Iterable[np.ndarray], route: Route = None) -> Iterator[Rows]:
    """ε of each block of velocities [m/s], in order: by the law's first route, unless told."""
    return map(in_one_size(evaluator(source, route)), blocks)


def in_one_size(evaluate: Callable[[np.ndarray], Any]) -> Callable[[np.ndarray], Any]:
    """The same function, of blocks filled up to the longest yet, for which it is compiled.

    To a multiple of `FILLED`, so that a few rows more or less are no other program. What it gives
    has an array, or None, in each of its fields.
    """
    longest = 0

    def filled(block: np.ndarray) -> Any:
        nonlocal longest
        longest = max(longest, len(block) + -len(block) % FILLED)
        found = evaluate(np.pad(block, (0, longest - len(block)), mode="edge"))
        return type(found)(*(None if one is None else one[: len(block)] for one in found))

    return filled


def evaluator(source: Source, route: Route = None) -> Callable[[np.ndarray], Rows]:
    """The function from velocities to rows."""
    if source.result is not None:
        return partial(_of_fit, source)
    return partial(_of_law, source.law, route)


def _of_law(law: sj.ContactLaw, route: Route, velocity: np.ndarray) -> Rows:
    coefficient, status = _restitution(law, velocity, route)
    return Rows(velocity, np.asarray(coefficient), np.asarray(status))


@partial(jax.jit, static_argnames="route")
def _restitution(law, velocity, route):
    # nothing else of the result is computed
    hit = sj.restitution(law, velocity, route=route)
    return hit.coefficient, hit.status


def _of_fit(source: Source, velocity: np.ndarray) -> Rows:
    band = source.result.band(velocity, source.name, draws=source.draws)
    status = np.asarray(_restitution(source.law, velocity, None)[1])
    return Rows(velocity, band.coefficient, status, band.low, band.high)


class Thinned:
    """At most `most` rows of any number, evenly taken from those seen so far."""

    def __init__(self, most: int = 4096):
        self._most, self._stride, self._seen = most, 1, 0
        self._kept: list[np.ndarray] = []

    def add(self, rows: Rows) -> None:
        count = len(rows.velocity)
        first = -self._seen % self._stride
        columns = [np.asarray(c, float)[first :: self._stride] for c in rows if c is not None]
        self._kept.append(np.stack(columns))
        self._seen += count
        while sum(block.shape[1] for block in self._kept) > self._most:
            self._kept = [np.concatenate(self._kept, axis=1)[:, ::2]]
            self._stride *= 2

    def rows(self) -> Rows:
        """What was kept, by ascending velocity."""
        columns = np.concatenate(self._kept, axis=1)
        return Rows(*columns[:, np.argsort(columns[0], kind="stable")])
