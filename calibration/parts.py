"""A long computation in parts, which the processes of one job share through a folder.

Each part is made by one process and is in the folder whole or not at all, so that a job that was
stopped goes on from those that are there, with as many processes as it likes. A folder's name tells
the settings: parts of other ones are never taken for these. Every process holds a lock while it is
at work, which the system lifts when the process ends: the others see it within a second.
"""

import hashlib
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from calibration.atomic import check_writable, replacing
from calibration.errors import InputError
from calibration.progress import erase_sign

try:
    import fcntl
except ImportError:  # Windows: a process that ends is not noticed
    fcntl = None  # type: ignore[assignment]

LOOK = 0.2  # s from one look at the others to the next
STOPPED = 3  # the exit code: results could not be written

Arrays = dict[str, np.ndarray]


class Parts:
    """The parts of one job, and the processes that make them.

        with Parts("parts") as parts:
            found = parts.arrays(settings, 20, make)

    Args:
        folder: that all processes see.
        index, count: which process this is, of how many; JAX's own unless told.
        meet: returns when all processes have called it; a sum over JAX's devices unless told.

    A process that ends before its parts are made ends the others: one line, exit code 3.
    """

    def __init__(
        self,
        folder: str | Path,
        index: int | None = None,
        count: int | None = None,
        meet: Callable[[], None] | None = None,
    ):
        self.folder = Path(folder)
        self.index = jax.process_index() if index is None else index
        self.count = jax.process_count() if count is None else count
        self._meet = meet
        self._lock: int | None = None
        self._earlier: set[Path] = set()  # what is in the folder at the start
        self._over = threading.Event()

    @property
    def first(self) -> bool:
        """Whether this is the process that joins the parts."""
        return self.index == 0

    def arrays(self, settings: Any, count: int, make: Callable[[int], Arrays]) -> list[Arrays]:
        """What `make(k)` gives for k = 0 … count - 1, each made by one process."""
        return list(self.each(settings, count, make))

    def each(self, settings: Any, count: int, make: Callable[[int], Arrays]) -> Iterator[Arrays]:
        """The same one after the other, read when it is asked for, once all are made."""

        def write(k: int, path: Path) -> None:
            with path.open("wb") as file:
                np.savez(file, **make(k))  # type: ignore[arg-type]

        return map(_read, self.files(settings, count, write))

    def files(self, settings: Any, count: int, write: Callable[[int, Path], None]) -> list[Path]:
        """The files that `write(k, path)` made, once all are there."""
        place = self.folder / fingerprint(settings, count)
        self._say(place.name)
        paths = [place / f"{k:06d}" for k in range(count)]
        for k in range(self.index, count, self.count):
            if not paths[k].exists():
                with replacing(paths[k]) as staged:
                    write(k, staged)
        self._wait(lambda: self._agree() and all(path.exists() for path in paths))
        return paths

    def clear(self) -> None:
        """Remove the parts that this job made: once they are joined, and nobody reads them any more.

        Those of an earlier start stay, and whatever else is in the folder.
        """
        self._wait(lambda: all(self._is_done(k) for k in range(1, self.count)))
        signs = [self._sign(k) for k in range(self.count)]
        signs += [one(k) for k in range(self.count) for one in (self._done, self._asked)]
        made = sorted({*self.folder.rglob("*")} - self._earlier - {*signs}, reverse=True)
        for path in [*signs, *made, self.folder]:
            with suppress(OSError):  # a folder that is not empty
                path.rmdir() if path.is_dir() else path.unlink()

    def __enter__(self) -> "Parts":
        check_writable(self.folder)
        if self._meet is None:
            _meet()  # nobody is still at what was made here before
        self.folder.mkdir(parents=True, exist_ok=True)
        self._earlier = set(self.folder.rglob("*"))
        for path in (self._done(self.index), self._asked(self.index), self._sign()):
            path.write_bytes(b"")
        self._lock = _lock_of(self._sign(), wait=True)
        (self._meet or _meet)()
        if self._lock is not None and self.count > 1:
            threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is None and self.count > 1:
            if not self._is_cleared():
                self._done(self.index).write_bytes(b"done")
            self._wait(self._is_over)
        self._over.set()
        if kind is None:
            self._sign().unlink(missing_ok=True)
        if self._lock is not None:
            os.close(self._lock)

    def _say(self, name: str) -> None:
        with self._asked(self.index).open("a") as file:
            file.write(f"{name}\n")

    def _agree(self) -> bool:
        """True; other settings of another process would leave both waiting."""
        mine = self._asked(self.index).read_text().split()
        for k in range(self.count):
            asked = self._asked(k).read_text().split() if self._asked(k).exists() else []
            if asked[: len(mine)] != mine[: len(asked)]:
                problem = f"process {k} of {self.count} makes something else"
                accepted = "all need the same command, of the same version"
                raise InputError(None, None, problem, accepted)
        return True

    def _is_over(self) -> bool:
        """Whether all have done what they had to do."""
        return self._is_cleared() or all(map(self._is_done, range(self.count)))

    def _is_cleared(self) -> bool:
        """Whether the first process has joined the parts and removed them."""
        return not self._sign(0).exists()

    def _is_done(self, k: int) -> bool:
        path = self._done(k)
        return path.exists() and path.stat().st_size > 0

    def _wait(self, holds: Callable[[], bool]) -> None:
        while not holds():
            time.sleep(LOOK)

    def _watch(self) -> None:
        while not self._over.wait(LOOK):
            for k in range(self.count):
                if k != self.index and self._has_ended(k) and not self._over.is_set():
                    self._stop(k)

    def _has_ended(self, k: int) -> bool:
        if self._is_done(k) or not self._sign(k).exists():
            return False
        lock = _lock_of(self._sign(k), wait=False)
        if lock is None:
            return False
        os.close(lock)
        return self._sign(k).exists() and not self._is_done(k)

    def _stop(self, k: int) -> None:
        erase_sign()
        line = f"softjax: process {k} of {self.count} ended before its parts were made; "
        print(f"{line}those in {str(self.folder)!r} are kept for another start", file=sys.stderr)
        sys.stderr.flush()
        os._exit(STOPPED)  # whatever the main thread is at

    def _sign(self, index: int | None = None) -> Path:
        return self.folder / f"process-{self.index if index is None else index}"

    def _done(self, index: int) -> Path:
        return self.folder / f"done-{index}"

    def _asked(self, index: int) -> Path:
        return self.folder / f"asked-{index}"


class Whole:
    """A computation in one go, by this process alone."""

    first = True

    def arrays(self, settings: Any, count: int, make: Callable[[int], Arrays]) -> list[Arrays]:
        return [make(k) for k in range(count)]


@contextmanager
def in_parts(parts: "Parts | str | Path | None") -> Iterator["Parts | Whole"]:
    """Parts in a folder, those of a job that goes on, or all in one go."""
    if isinstance(parts, str | Path):
        with Parts(parts) as opened:
            yield opened
    else:
        yield Whole() if parts is None else parts


def blocks(count: int, size: int) -> list[slice]:
    """Rows 0 … count - 1, at most so many at a time."""
    return [slice(first, min(first + size, count)) for first in range(0, count, size)]


def joined(parts: Sequence[Arrays], name: str, axis: int = 0) -> np.ndarray:
    """One array of all parts."""
    return np.concatenate([part[name] for part in parts], axis)


def fingerprint(*settings: Any) -> str:
    """A name for settings: numbers, text, bytes, arrays, and laws or other pytrees of them."""
    packages = [f"{name} {version(name)}" for name in ("softjax-contact", "jax", "diffrax")]
    leaves, structure = jax.tree.flatten((packages, settings))
    digest = hashlib.sha256(_lasting(structure))
    for leaf in leaves:
        array = np.asarray(leaf)
        whole = leaf if isinstance(leaf, bytes) else array.tobytes()
        told = _lasting(leaf) if array.dtype == object else whole
        digest.update(f"|{array.dtype} {array.shape} {len(told)}|".encode() + told)
    return digest.hexdigest()[:16]


def _lasting(thing: Any) -> bytes:
    """What it is in words, without its place in memory, which is another one each time."""
    return re.sub(r" at 0x[0-9a-f]+", "", repr(thing)).encode()


def _lock_of(place: Path, wait: bool) -> int | None:
    """A lock on a file, which the system lifts when the process ends; None where none is had."""
    if fcntl is None:
        return None
    try:
        handle = os.open(place, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        os.close(handle)
        return None
    return handle


def _read(path: Path) -> Arrays:
    with np.load(path, allow_pickle=False) as file:
        return dict(file)


def _meet() -> None:
    if jax.process_count() > 1:
        from jax.experimental.multihost_utils import sync_global_devices

        sync_global_devices("softjax")
