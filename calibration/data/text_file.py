"""Text files as people save them, of a size that is known before they are read."""

import codecs
import io
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from calibration.errors import InputError

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
SPREADSHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx and .ods, .xls
MIB = 1 << 20


def read_text(path: str | Path, limit: int) -> str:
    """The file's text, each line ended by a newline character alone.

    UTF-8, with or without a byte-order mark, or UTF-16 with one.

    Args:
        path: a regular file: a pipe or a device may never end.
        limit: bytes that are accepted.

    Raises:
        InputError: where there is no such file, or it cannot be read, is too large or no text.
    """
    return _stream(read_bytes(path, limit)).read()


def text_lines(path: str | Path, limit: int) -> Iterator[str]:
    """The lines of such a file one by one, without their ends."""
    for line in _stream(read_bytes(path, limit)):
        yield line.rstrip("\n")


def read_bytes(path: str | Path, limit: int) -> bytes:
    """The text as UTF-8 without a mark; arguments and errors are those of `read_text`."""
    raw = _read(path, limit)
    if raw.startswith(SPREADSHEETS):
        accepted = "save the sheet as CSV: in the spreadsheet, Save as, CSV UTF-8"
        raise InputError(path, None, "is a spreadsheet or an archive, no text", accepted)
    encoding, told = ("utf-16", "UTF-16") if raw.startswith(UTF_16) else ("utf-8-sig", "UTF-8")
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputError(path, line, f"is not {told} text", "save it as UTF-8") from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise InputError(path, line, "a NUL character", "text is needed, saved as UTF-8")
    return raw.removeprefix(codecs.BOM_UTF8) if told == "UTF-8" else text.encode()


def _read(path: str | Path, limit: int) -> bytes:
    try:
        # before it is opened, as that may wait for ever
        raw = None
        if stat.S_ISREG(os.stat(path).st_mode):
            with open(path, "rb") as file:
                raw = file.read(limit + 1)
    except FileNotFoundError:
        raise InputError(path, None, "no such file", "a file that exists is needed") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL character in it
        told = getattr(error, "strerror", None) or "no name of a file"
        problem = f"cannot be read ({told})"
        raise InputError(path, None, problem, "a readable file is needed") from None
    if raw is None:
        what = "a directory" if os.path.isdir(path) else "a device or a pipe"
        raise InputError(path, None, f"is {what}", "a file of text is needed")
    if len(raw) > limit:
        raise InputError(
            path, None, f"is larger than {limit // MIB} MiB", "a smaller file is needed"
        )
    return raw


def _stream(raw: bytes) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(raw), encoding="utf-8", newline=None)
