"""Files that appear whole or not at all: written beside their place, then renamed into it."""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from calibration.errors import InputError


def write_atomically(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8) whole or not at all.

    Raises:
        InputError: where its directory cannot be written to.
    """
    with replacing(path) as staged:
        staged.write_text(text, encoding="utf-8", newline="\n")


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A path to write one file to; it becomes `path` when the block ends without an error."""
    path = Path(path)
    with files_into(path.parent) as staged:
        yield staged / path.name


@contextmanager
def files_into(directory: str | Path, owned: Iterable[str] = ()) -> Iterator[Path]:
    """A directory to write files to; all of them move into `directory` when the block ends.

    Where the block raises nothing moves, and `directory` is not made if it was not there.

    Args:
        directory: where the files belong.
        owned: names of files that are all of one set; those that the block did not write are
            removed from `directory`, so that no picture of an older run stays beside a newer one.

    Raises:
        InputError: where `directory` cannot be written to.
    """
    directory = Path(directory)
    check_writable(directory)
    with _staging(directory) as staged:
        yield staged
        written = sorted(path.name for path in staged.iterdir())
        _check_targets(directory, written)
        directory.mkdir(parents=True, exist_ok=True)
        for name in written:
            os.replace(staged / name, directory / name)
        for name in set(owned) - set(written):
            (directory / name).unlink(missing_ok=True)


def check_writable(directory: str | Path) -> None:
    """Refuse early what could not be written in the end.

    Raises:
        InputError: where `directory` is a file, below one, or not to be written to.
    """
    there = _nearest_existing(Path(directory))
    if not there.is_dir():
        accepted = "results need a directory to go to"
        raise InputError(None, None, f"{str(there)!r} is a file", accepted)
    if not os.access(there, os.W_OK | os.X_OK):
        problem = f"directory {str(there)!r} cannot be written to"
        raise InputError(None, None, problem, "results need one that can")


@contextmanager
def _staging(directory: Path) -> Iterator[Path]:
    # on the same file system as the target, or renaming would be copying
    staged = Path(tempfile.mkdtemp(prefix=".softjax-", dir=_nearest_existing(directory)))
    try:
        yield staged
    finally:
        shutil.rmtree(staged, ignore_errors=True)


def _nearest_existing(directory: Path) -> Path:
    return next(
        path for path in (directory, *directory.absolute().parents) if os.path.lexists(path)
    )


def _check_targets(directory: Path, names: Iterable[str]) -> None:
    """A rename onto a directory would fail halfway."""
    for name in names:
        if (directory / name).is_dir():
            problem = f"{str(directory / name)!r} is a directory"
            raise InputError(None, None, problem, "it must be a file, or not be there")
