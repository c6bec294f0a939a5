"""Files as people save them, of a size that is known before they are read."""

import codecs
import os
import stat
import sys
from contextlib import nullcontext
from pathlib import Path

from calibration.errors import InputError

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
MIB = 1 << 20


def read_text(path: str | Path, limit: int) -> str:
    """The text of a file in UTF-8, or in UTF-16 with its mark; raises InputError."""
    return decoded(path, read_bytes(path, limit))[0]


def read_bytes(path: str | Path, limit: int, or_pipe: bool = False) -> bytes:
    """A file of at most `limit` bytes, or a pipe, or standard input ("-"); raises InputError.

    Other than files only with `or_pipe`: a pipe or a device may never end.
    """
    is_input = or_pipe and path == "-"
    name = "standard input" if is_input else path
    try:
        # before it is opened, which may wait for ever
        if not or_pipe and not stat.S_ISREG(os.stat(path).st_mode):
            what = "a directory" if os.path.isdir(path) else "a device or a pipe"
            raise InputError(path, None, f"is {what}", "a file is needed")
        with nullcontext(sys.stdin.buffer) if is_input else open(path, "rb") as file:
            raw = file.read(limit + 1)
    except FileNotFoundError:
        raise InputError(path, None, "no such file", "a file that exists is needed") from None
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(name, None, problem, "a readable file is needed") from None
    if len(raw) > limit:
        problem = f"is larger than {limit // MIB} MiB"
        raise InputError(name, None, problem, "a smaller file is needed")
    return raw


def decoded(path: str | Path, raw: bytes, otherwise: str | None = None) -> tuple[str, str]:
    """Bytes as text, and its encoding: UTF-16 with its mark, UTF-8, or `otherwise`."""
    encodings = ["utf-16"] if raw.startswith(UTF_16) else ["utf-8-sig", otherwise]
    for encoding in filter(None, encodings):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError as error:
            line = raw[: error.start].count(b"\n") + 1
            continue
        if "\0" in text:
            line = text[: text.index("\0")].count("\n") + 1
            raise InputError(path, line, "a NUL character", "text is needed, saved as UTF-8")
        return text, encoding
    label = "UTF-16" if raw.startswith(UTF_16) else "UTF-8"
    raise InputError(path, line, f"is not {label} text", "save it as UTF-8")
