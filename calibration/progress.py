"""Progress bars: on a terminal, and nowhere else."""

import sys
from collections.abc import Iterable
from typing import Any, TextIO


class Progress:
    """Shows `progress(stage, done, total)` as one bar a stage, on a terminal and not `quiet`.

        with Progress(quiet=False) as progress:
            cal.fit(data, progress=progress)

    The bar is on standard error and gone when it is left, so that output can be piped on.
    """

    def __init__(self, quiet: bool = False, file: TextIO | None = None):
        self._file = sys.stderr if file is None else file
        self._shown = not quiet and self._file.isatty()
        self._stage: str | None = None
        self._bar: Any = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        if not self._shown:
            return
        if stage != self._stage or total != self._bar.total:
            self.close()
            self._stage, self._bar = stage, self._new(stage, total)
        self._bar.update(done - self._bar.n)
        if done >= total:  # tqdm leaves out what follows quickly upon the last
            self._bar.refresh()

    def over(self, items: Iterable, stage: str, total: int | None = None) -> Iterable:
        """The same items, with a bar while they are gone through."""
        if not self._shown:
            return items
        self.close()
        return _tqdm()(items, desc=stage, total=total, leave=False, file=self._file)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
        self._stage = self._bar = None

    def _new(self, stage: str, total: int):
        return _tqdm()(desc=stage, total=total, leave=False, file=self._file)

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_) -> None:
        self.close()


def _tqdm():
    from tqdm import tqdm

    return tqdm
