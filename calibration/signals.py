"""Signals that end a command, heard as Ctrl-C is: what is half done is put away, and one line told."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

SOON = 0.01  # s
HEARD = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Stopped(KeyboardInterrupt):
    """A signal came; `code` is what the shell expects of a command that it ended."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number, self.code = number, 128 + number


class _Ear:
    """What came, and whether it has to wait."""

    def __init__(self) -> None:
        self.waits = 0
        self.came: int | None = None

    def __call__(self, number: int, frame: object) -> None:
        self.came = number
        self.tell()

    def tell(self) -> None:
        """Raise what came, unless it has to wait."""
        if self.came is not None and not self.waits:
            number, self.came = self.came, None
            raise Stopped(number)


_ear = _Ear()


@contextmanager
def heard() -> Iterator[None]:
    """Raise `Stopped` in this block where such a signal comes; what is ignored stays so (nohup)."""
    before = {}
    try:
        for number in HEARD:
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, _ear)
    except ValueError:  # not in the main thread, which alone may listen
        pass
    hook = sys.unraisablehook
    sys.unraisablehook = lambda lost: _lost(lost, hook)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


def _lost(lost: "sys.UnraisableHookArgs", otherwise: Callable[[Any], object]) -> None:
    """What was raised in a callback (of the garbage collector) goes no further: once more, soon."""
    if not isinstance(lost.exc_value, Stopped):
        otherwise(lost)
        return
    timer = threading.Timer(SOON, _again, (lost.exc_value.number,))
    timer.daemon = True
    timer.start()


def _again(number: int) -> None:
    if signal.getsignal(number) is _ear:
        signal.raise_signal(number)


@contextmanager
def held() -> Iterator[None]:
    """Let them wait until this block has ended: what is begun in it is done whole."""
    _ear.waits += 1
    try:
        yield
    finally:
        _ear.waits -= 1
        _ear.tell()
