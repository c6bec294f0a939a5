"""Progress: bars on a terminal, a line a stage on one that cannot go back, and nothing elsewhere."""

import sys
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, TextIO

from calibration.terminal import cannot_go_back

_sign = ""  # of life, where it still stands


def first_sign(text: str, quiet: bool = False) -> None:
    """A word before anything is loaded or compiled; it goes when there is more to tell."""
    global _sign
    if not quiet and _is_terminal(sys.stderr):
        _sign = "" if cannot_go_back() else text
        with suppress(OSError):
            print(text, end="\n" if cannot_go_back() else "", file=sys.stderr, flush=True)


def erase_sign() -> None:
    """Clear the line of the first sign."""
    global _sign
    if _sign:
        blank, _sign = " " * len(_sign), ""
        with suppress(OSError):
            print(f"\r{blank}\r", end="", file=sys.stderr, flush=True)


class Progress:
    """Shows `progress(stage, done, total)` as one bar a stage, on a terminal and not `quiet`.

        with Progress(quiet=False) as progress:
            cal.fit(data, progress=progress)

    The bar is on standard error and gone when it is left, so that output can be piped on.
    """

    def __init__(self, quiet: bool = False, file: TextIO | None = None):
        self._file = sys.stderr if file is None else file
        self._shown = not quiet and _is_terminal(self._file)
        self._stage: str | None = None
        self._bar: Any = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        if not self._shown:
            return
        with suppress(OSError):  # a terminal that was closed
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
        return _bar(items, desc=stage, total=total, file=self._file)

    def close(self) -> None:
        with suppress(OSError):
            if self._bar is not None:
                self._bar.close()
        self._stage = self._bar = None

    def _new(self, stage: str, total: int):
        return _bar(None, desc=stage, total=total, file=self._file)

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_) -> None:
        self.close()
        erase_sign()


def _bar(items: Iterable | None, **options: Any):
    from tqdm import tqdm

    erase_sign()
    if cannot_go_back():  # only the line that is left behind
        print(f"{options['desc']} ...", file=options.pop("file"), flush=True)
        return tqdm(items, disable=True, **options)
    return tqdm(items, leave=False, **options)


def _is_terminal(file: TextIO | None) -> bool:
    return file is not None and not file.closed and file.isatty()
