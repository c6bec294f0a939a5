"""A curve whose rows are shared by several processes: the first one joins the parts that all make."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from calibration.curve.source import Source
from calibration.curve.stream import Route, Rows, curve_rows
from calibration.curve.velocities import BLOCK, Grid
from calibration.curve.writers import csv_text
from calibration.parts import Arrays, Parts, blocks

PARTS, LARGEST = 64, 16 * BLOCK  # of a curve, and rows of one: they are held whole


class CurveInParts:
    """ε of a grid of velocities, in parts of some rows each.

    Args:
        source, grid, route: whose curve, where, by what.
        text: whether the lines of a CSV file are made with the rows.
        draws: the file that the source's were read from, if it has any.
    """

    def __init__(
        self, source: Source, grid: Grid, route: Route, text: bool, draws: Path | None = None
    ):
        self.source, self.grid, self.route, self.text = source, grid, route, text
        self.draws = b"" if draws is None else draws.read_bytes()
        size = BLOCK * -(-grid.points // (BLOCK * PARTS))
        self._rows = blocks(grid.points, min(size, LARGEST))

    def made(self, parts: Parts) -> Iterator[Arrays]:
        """All parts, in order, once they are there."""
        return parts.each(self._settings(), len(self._rows), self._part)

    def _settings(self) -> tuple:
        source = self.source
        fit = None if source.result is None else source.result.to_json(times=False)
        told = source.law, fit, source.name, self.draws
        return *told, repr(self.grid), repr(self.route), self.text

    def _part(self, k: int) -> Arrays:
        velocities = self.grid.blocks(rows=self._rows[k])
        found = list(curve_rows(self.source, velocities, self.route))
        every = [[c for c in column if c is not None] for column in zip(*found, strict=True)]
        names = [name for name, column in zip(Rows._fields, every, strict=True) if column]
        part = {
            n: np.concatenate(c) for n, c in zip(Rows._fields, every, strict=True) if n in names
        }
        if self.text:
            part["text"] = np.frombuffer(b"".join(map(csv_text, found)), np.uint8)
        return part


def joined(made: Iterable[Arrays]) -> Iterator[tuple[Rows, bytes | None]]:
    """The rows of each part, and their text in a CSV file where it was made with them."""
    for part in made:
        text = part.pop("text").tobytes() if "text" in part else None
        yield Rows(**part), text
