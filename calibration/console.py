"""The terminal of a command: streams, running text, progress and signals."""

import codecs
import io
import os
import shutil
import signal
import sys
import textwrap
import threading
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, TextIO

PLAIN = {"±": "+-", "–": "-", "−": "-", "─": "-"}  # where no decomposition in Unicode helps
WIDTH = 100  # of running text, on wider terminals too
PATIENCE = 1.0  # seconds until a signal is raised again that nothing has heard
MOST = 5  # times that it waits for the end of an import
SIGNALS = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]


def open_streams() -> None:
    """Make the three standard streams usable: letters that one lacks are spelled out, or "?".

    A stream that was closed (`2>&-`) becomes the null device, or a file of results would take its
    number. Writing to a closed standard output stays an error.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY)  # the lowest free one
            if getattr(sys, name) is None:
                mode = "w" if number else "r"
                setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="spelled")


def _spelled(error: UnicodeError) -> tuple[str, int]:
    """Greek letters by their names, others without accents, where an encoding lacks them; else "?"."""
    assert isinstance(error, UnicodeEncodeError)
    words = []
    for letter in unicodedata.normalize("NFKD", error.object[error.start : error.end]):
        *_, name = unicodedata.name(letter, "?").lower().split()
        other = "" if unicodedata.combining(letter) else PLAIN.get(letter, "?")
        other = name if "GREEK" in unicodedata.name(letter, "") else other
        words.append(letter if letter.isascii() else other)
    return "".join(words), error.end


codecs.register_error("spelled", _spelled)


def silence(stream: TextIO | None) -> None:
    """Discard what a stream that failed still holds."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[union-attr]
        os.close(nowhere)


def print_first(lines: Iterable[str], quiet: bool) -> None:
    """Print what comes before anything else; of a quiet command on standard error."""
    for line in lines:
        print(line, file=sys.stderr if quiet else sys.stdout, flush=True)


def columns() -> int | None:
    """Width of the terminal; None where standard output is not a terminal."""
    if sys.stdout is None or not sys.stdout.isatty():
        return None
    return shutil.get_terminal_size((WIDTH, 24)).columns


def wrapped(paragraphs: Iterable[str], first: str = "", rest: str = "") -> list[str]:
    """Paragraphs as lines that fit the terminal, with margins for the first of each and the rest."""
    width = max(20, min(WIDTH, columns() or WIDTH))
    wrapper = textwrap.TextWrapper(width, initial_indent=first, subsequent_indent=rest)
    return [line for text in paragraphs for line in wrapper.wrap(text)]


def is_terminal() -> bool:
    """Whether standard error is one."""
    return sys.stderr is not None and not sys.stderr.closed and sys.stderr.isatty()


class Progress:
    """Show `progress(stage, done, total)` on standard error: a bar on a terminal, else a line a stage.

        with Progress() as progress:
            cal.fit(data, progress=progress)

    Args:
        quiet: show nothing.
        lines: show the lines in a pipe or a notebook too; commands leave pipes alone.
    """

    def __init__(self, quiet: bool = False, lines: bool = False):
        self._has_bar = is_terminal() and os.environ.get("TERM") != "dumb"  # lines stay there
        self._shown = not quiet and (lines or is_terminal())
        self._stage: str | None = None
        self._bar: Any = None

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        with suppress(OSError):  # a terminal that was closed
            if self._shown and stage != self._stage:
                self.close()
                self._stage = stage
                self._begin(stage)
            if self._bar is not None:
                self._bar.update(self._bar.task_ids[0], completed=done, total=total)

    def over(self, items: Iterable, stage: str, total: int | None = None) -> Iterator:
        """Iterate over the items and count them."""
        self(stage, 0, total)
        for done, item in enumerate(items, 1):
            yield item
            self(stage, done, total)

    def close(self) -> None:
        """Clear the bar."""
        if self._bar is not None:
            with suppress(OSError):
                self._bar.stop()
        self._stage = self._bar = None

    def _begin(self, stage: str) -> None:
        if not self._has_bar:
            print(f"{stage} ...", file=sys.stderr)
            return
        from rich import console, progress

        keywords: dict[str, Any] = {"transient": True, "console": console.Console(file=sys.stderr)}
        keywords |= {"redirect_stdout": False, "redirect_stderr": False}
        columns = (*progress.Progress.get_default_columns(), progress.TimeElapsedColumn())
        self._bar = progress.Progress(*columns, **keywords)
        self._bar.add_task(stage, total=None)
        self._bar.start()

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_) -> None:
        self.close()


@contextmanager
def progress_of(progress: Any) -> Iterator[Any]:
    """Progress display for an argument `progress=`, while the function runs: True shows bars, or lines.

    A function is used as it is, and called as progress(stage, done, total); False means None.
    """
    if progress is True:
        with Progress(lines=True) as shown:
            yield shown
    else:
        yield None if progress is False else progress


class Stopped(KeyboardInterrupt):
    """A signal ended the command; `code` is the exit code that a shell expects then."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number, self.code = number, 128 + number


@contextmanager
def signals_handled() -> Iterator[list[Stopped]]:
    """Handle SIGTERM and SIGHUP like Ctrl-C: raise `Stopped`; what is ignored stays so (nohup).

    Yields those that came. Garbage collection and C code swallow what is raised in them, so it is raised
    again until this block has ended; and not while modules are imported, of which extensions crash by it.
    """
    came: list[Stopped] = []
    ended, hook = threading.Event(), sys.unraisablehook

    def stop(number: int, frame: FrameType | None) -> None:
        if not came:
            threading.Thread(target=insist, args=(number,), daemon=True).start()
        came.append(Stopped(number))
        if len(came) > MOST or not _is_import(frame):
            raise came[-1]

    def insist(number: int) -> None:
        while not ended.wait(PATIENCE):
            signal.raise_signal(number)

    def lost(unraisable: Any) -> None:
        if not isinstance(unraisable.exc_value, Stopped):
            hook(unraisable)

    sys.unraisablehook = lost
    try:
        with _handlers(stop):
            yield came
    finally:
        ended.set()
        sys.unraisablehook = hook


def _is_import(frame: FrameType | None) -> bool:
    """Whether a module is being imported."""
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        frame = frame.f_back
    return frame is not None


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Delay signals until this block has ended, so that it is not interrupted."""
    came: list[int] = []
    with _handlers(lambda number, frame: came.append(number)):
        yield
    for number in came[:1]:
        signal.raise_signal(number)


@contextmanager
def _handlers(handler: Any) -> Iterator[None]:
    """Another handler of these signals, where they are not ignored and this is the main thread."""
    before = {}
    with suppress(ValueError):  # another thread
        for number in SIGNALS:
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
