"""Text files as people save them: UTF-8, with or without a byte-order mark."""

from pathlib import Path

from calibration.errors import InputError


def read_text(path: str | Path) -> str:
    """The file's text, each line ended by a newline character alone.

    Raises:
        InputError: where there is no such file, it cannot be read, or it is not UTF-8.
    """
    try:
        raw = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(path, None, "no such file", "a file that exists is needed") from None
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(path, None, problem, "a readable file is needed") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputError(path, line, "is not UTF-8 text", "save it as UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")
