"""Records of what users see: pictures, reports, refusals, help, defaults, tables in pages.

All are kept one way. A test compares what it finds with its record; where they differ it fails with both
and with the command that records anew, `pytest --record TEST`, which prints what it changed.
"""

import os
import shlex
import tempfile
from collections.abc import Callable
from difflib import SequenceMatcher
from itertools import zip_longest
from pathlib import Path

from filelock import FileLock

ROOT = Path(__file__).parents[1]
ANY = "…"  # in a sentence that is kept: any words, as those of Python's own parser, which differ by version

recording = False  # whether pytest was called with --record
_changed: list[str] = []


def changed() -> list[str]:
    """What was recorded since the last call."""
    found, _changed[:] = _changed[:], []
    return found


def settle(path: Path, name: str, differ: list[str], update: Callable[[str], str]) -> None:
    """Pass where nothing differs; else fail with the differences, or record them with --record.

    Args:
        path: the file of the record, and `name`, what of it.
        differ: lines for a reader; empty where the record is right.
        update: the file's text with the record as it is now, of the file's text.
    """
    __tracebackhide__ = True
    if not differ:
        return
    place = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
    lines = [f"{place}: {name}", *differ]
    if not recording:
        test = os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")[0]
        lines.append(f"If that is meant, record me: pytest --record {shlex.quote(test)}")
        raise AssertionError("\n".join(lines))
    with FileLock(Path(tempfile.gettempdir()) / "softjax-records.lock"):  # other workers write too
        path.write_text(update(path.read_text(encoding="utf-8")), encoding="utf-8")
    _changed.append("\n".join(lines))


def differences(old: list[str], new: list[str], agree: Callable = str.__eq__) -> list[str]:
    """Lines that went, came or do not agree with what they were, of long ones the part that changed."""
    found = []
    for _, a, b, c, d in SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        for was, now in zip_longest(old[a:b], new[c:d]):
            if was is None or now is None:
                found.append(f"is  {now}" if was is None else f"was {was}")
            elif not agree(was, now):
                found += [
                    f"{word} {part}"
                    for word, part in zip(("was", "is "), _apart(was, now), strict=True)
                ]
    return found


def _apart(old: str, new: str, context: int = 40) -> tuple[str, str]:
    """Both texts without what they have in common far before and after the change."""
    start = _in_common(old, new)
    rest = [text[start:][::-1] for text in (old, new)]
    end = _in_common(*rest)
    first = max(start - context, 0)
    before = (ANY if first else "") + old[first:start]
    after = rest[0][:end][::-1]
    after = after if end <= context else after[:context] + ANY
    return tuple(before + text[end:][::-1] + after for text in rest)


def _in_common(one: str, other: str) -> int:
    """How many characters two texts begin with both."""
    pairs = zip(one, other, strict=False)
    return next((k for k, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


def sentences(path: Path, columns: int = 1) -> dict[str, str]:
    """{case: sentence} of a file with a line `case | sentence` each; a case may have several columns.

    A sentence that is not recorded yet is empty: `case |`.
    """
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        parts = f"{line} ".split(" | ", columns)
        found[" | ".join(parts[:columns])] = parts[columns].strip()
    return found


def as_sentence(path: Path, case: str, now: str) -> None:
    """A case has the sentence that its line of the file has."""
    __tracebackhide__ = True

    def of_case(line: str) -> bool:
        return f"{line} ".startswith(f"{case} | ")

    def update(text: str) -> str:
        return "".join(f"{case} | {now}\n" if of_case(x) else f"{x}\n" for x in text.splitlines())

    (line,) = filter(of_case, path.read_text(encoding="utf-8").splitlines())
    kept = line.removeprefix(f"{case} |").strip()
    parts = kept.split(ANY)
    is_same = kept == now if len(parts) == 1 else all(part in now for part in parts)
    settle(path, case, [] if is_same else differences([kept] if kept else [], [now]), update)


def as_table(page: Path, marks: tuple[str, str], rows: list[str]) -> None:
    """A table that is made of the code as it stands in a page, between two marks."""
    __tracebackhide__ = True

    def update(text: str) -> str:
        before, _, rest = text.partition(marks[0])
        return "\n".join([before + marks[0], *rows, marks[1] + rest.partition(marks[1])[2]])

    text = page.read_text(encoding="utf-8")
    assert all(text.count(mark) == 1 for mark in marks), f"{page.name} needs {' and '.join(marks)}"
    kept = text.partition(marks[0])[2].partition(marks[1])[0].strip("\n").split("\n")
    settle(page, marks[0].strip("<!-> "), differences(kept, rows), update)
