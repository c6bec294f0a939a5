"""Write the files of a command all or none: in a folder next to their place, then rename them into it.

No command removes a file that it did not write itself: files of an earlier run that are not written again
stay, and are named. What is read and written, and that nothing in a file is executed, is in
notebooks/reference/running.md.
"""

import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from calibration.console import signals_deferred
from calibration.errors import InputError, NotWritten

UNFINISHED = ".softjax-unfinished-"
# directories that this command wrote to: the files written, and files that look like results of this
# command but were not written by it
written: dict[Path, tuple[list[str], list[str]]] = {}
lost: dict[str, str] = {}  # pictures of this command that failed, and why


def write_text(path: Path, text: str) -> None:
    """Write text as UTF-8; bytes of a path that are not UTF-8 become their codes."""
    path.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A path to write one file to; it becomes `path` when the block ends without an error."""
    path = Path(path)
    with files_into(path.parent) as staged:
        yield staged / path.name


@contextmanager
def files_into(directory: str | Path, names: Iterable[str] = ()) -> Iterator[Path]:
    """A directory to write files to; all move into `directory` when the block ends without an error.

    Of `names`, all files that the command may write, what stays from earlier is listed in `written`.
    Raises InputError where `directory` cannot be one, NotWritten where the system refuses.
    """
    directory = Path(directory)
    check_writable(directory)
    target = Path(os.path.realpath(directory))
    try:
        # on the same file system as the target, or renaming would be copying
        existing = _nearest_existing(target)
        with tempfile.TemporaryDirectory(prefix=UNFINISHED, dir=existing) as folder:
            staged = Path(folder) / target.relative_to(existing)
            staged.mkdir(parents=True, exist_ok=True)  # fails before anything is computed
            yield staged
            new = sorted(path.name for path in staged.iterdir())
            with signals_deferred():  # old files or new ones, not some of both
                target.mkdir(parents=True, exist_ok=True)
                _replace(staged, target, new)
            if not any(part.startswith(UNFINISHED) for part in target.parts):
                older = [name for name in names if (target / name).exists() and name not in new]
                written[directory] = new, older
    except OSError as error:
        if error.filename is not None and not _concerns(error.filename, target):
            raise
        raise NotWritten(directory, error) from error


@contextmanager
def or_printed(paragraphs: Sequence[str]) -> Iterator[None]:
    """Print the results where they cannot be written: what was computed is not lost."""
    try:
        yield
    except NotWritten:
        if paragraphs:
            print("\n\n".join(paragraphs))
        raise


def check_writable(directory: str | Path) -> None:
    """Refuse early what could not be written in the end, by InputError or NotWritten."""
    existing = _nearest_existing(Path(directory))
    if not existing.is_dir():
        problem = f"{str(existing)!r} is a file, or a link to nothing"
        raise InputError(None, None, problem, "results need a directory to go to")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise NotWritten(existing, "no permission")
    try:  # what rights do not tell: file systems of the kernel, or mounted to be read only
        with tempfile.TemporaryDirectory(prefix=UNFINISHED, dir=existing):
            pass
    except OSError as error:
        raise NotWritten(directory, error) from None


def _replace(staged: Path, target: Path, names: Sequence[str]) -> None:
    for name in names:  # a rename onto a directory would fail halfway
        if (target / name).is_dir():
            problem = f"{str(target / name)!r} is a directory"
            raise InputError(None, None, problem, "it must be a file, or not be there")
    for name in names:
        os.replace(staged / name, target / name)


def _concerns(name: str | bytes, directory: Path) -> bool:
    """Whether a file is one to be written, or above: an error on any other is no want of space or rights."""
    place = Path(os.fsdecode(name)).absolute()
    is_new = any(part.startswith(UNFINISHED) for part in place.parts)
    return is_new or directory.is_relative_to(place)


def _nearest_existing(directory: Path) -> Path:
    try:
        return next(p for p in (directory, *directory.absolute().parents) if os.path.lexists(p))
    except OSError as error:  # the working directory was removed
        raise NotWritten(directory, error) from None
