"""Block after block of velocities through a law, or a fit with its band."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

import softjax as sj
from calibration.curve.source import Source


class Rows(NamedTuple):
    """One block of a curve: v [m/s], ε, status, and the confidence limits of a fit's ε."""

    velocity: Float[np.ndarray, " n"]
    coefficient: Float[np.ndarray, " n"]
    status: Int[np.ndarray, " n"]
    low: Float[np.ndarray, " n"] | None = None
    high: Float[np.ndarray, " n"] | None = None


@dataclass
class Span:
    """The velocities seen so far."""

    low: float = np.inf
    high: float = -np.inf
    rows: int = 0

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest."""
        return self.low, self.high

    def add(self, velocity: np.ndarray) -> None:
        self.low = min(self.low, float(np.min(velocity)))
        self.high = max(self.high, float(np.max(velocity)))
        self.rows += len(velocity)


def curve_rows(
    source: Source,
    blocks: Iterable[np.ndarray],
    route: sj.EnergyBalance | sj.ODE | None = None,
    seen: Span | None = None,
) -> Iterator[Rows]:
    """ε of each block of velocities, in order.

    Args:
        source: whose curve.
        blocks: velocities [m/s], all blocks but the last equally long.
        route: the energy balance, or the ODE for a law that needs it, unless told.
        seen: kept up to date with the velocities gone through.
    """
    evaluate = evaluator(source, route)
    size = 0
    for block in blocks:
        if seen is not None:
            seen.add(block)
        size = max(size, len(block))
        # a shorter last block is filled up, or all would be compiled again for it
        filled = np.pad(block, (0, size - len(block)), mode="edge")
        rows = evaluate(filled)
        yield Rows(*(None if column is None else column[: len(block)] for column in rows))


def evaluator(source: Source, route=None) -> Callable[[np.ndarray], Rows]:
    """The function from velocities to rows."""
    if source.result is not None:
        return partial(_of_fit, source)
    return partial(_of_law, source.law, route)


def _of_law(law, route, velocity: np.ndarray) -> Rows:
    coefficient, status = _restitution(law, velocity, route)
    return Rows(velocity, np.asarray(coefficient), np.asarray(status))


@partial(jax.jit, static_argnames="route")
def _restitution(law, velocity, route):
    # nothing else of the result is computed
    hit = sj.restitution(law, velocity, route=route)
    return hit.coefficient, hit.status


def _of_fit(source: Source, velocity: np.ndarray) -> Rows:
    band = source.result.band(velocity, source.name)
    return Rows(velocity, band.coefficient, _status(source, velocity), band.low, band.high)


def _status(source: Source, velocity: np.ndarray) -> np.ndarray:
    """The fitted law's flags."""
    return np.asarray(_restitution(source.law, velocity, None)[1])
