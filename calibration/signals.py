"""Signals that end a command, heard as Ctrl-C is: what is half done is put away, and one line told."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

HEARD = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Stopped(KeyboardInterrupt):
    """A signal came; `code` is what the shell expects of a command that it ended."""

    def __init__(self, number: int):
        super().__init__(number)
        self.code = 128 + number


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
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def held() -> Iterator[None]:
    """Let them wait until this block has ended: what is begun in it is done whole."""
    _ear.waits += 1
    try:
        yield
    finally:
        _ear.waits -= 1
        _ear.tell()
