"""On which line of a TOML text each key stands, which `tomllib` does not tell, and how deep it goes.

A text is cut into statements by its strings, comments and brackets in one pass, in time that is
linear in its length. What a key is called, quoted or dotted, is read by the parser.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

Path = tuple[str | int, ...]

DEEPEST = 50  # brackets in brackets, parts of a key: the parser recurses, and is quadratic in keys
# strings of three quotes, of one, comments, and what structures the rest; nothing is tried twice
TOKEN = re.compile(
    r'"""(?:[^"\\]++|\\.|"{1,2}(?!"))*+"{0,5}'
    r"|'''(?:[^']++|'{1,2}(?!'))*+'{0,5}"
    r'|"(?:[^"\\\n]++|\\.)*+"?'
    r"|'[^'\n]*+'?|#[^\n]*+|[][{}\n.,=]",
    re.DOTALL,
)
BARE = re.compile(r"\s*([A-Za-z0-9_-]+)[ \t]*=[^{]*", re.DOTALL)


def too_deep(text: str) -> int | None:
    """The line on which brackets or dotted keys go deeper than `DEEPEST`, or None.

    Told for any text, up to where it stops being TOML.
    """
    line, depth, dots = 1, 0, 0
    for match in TOKEN.finditer(text):
        token = match[0]
        depth = max(depth + _step(token), 0)
        dots = dots + 1 if token == "." else 0 if token in "\n,=[]{}" else dots
        if max(depth, dots) > DEEPEST:
            return line
        line += token.count("\n")
    return None


def lines_of(text: str) -> dict[Path, int]:
    """Line, from 1, of every table and key of a valid TOML text, by its path.

    The path of `radius` in the second `[[material]]` is ("material", 1, "radius").
    """
    found: dict[Path, int] = {}
    last: dict[Path, int] = {}  # position of the latest entry of each array of tables
    here: Path = ()
    for line, statement in _statements(text):
        bare = BARE.fullmatch(statement)
        if bare:
            found[(*here, bare[1])] = line
        elif statement.lstrip().startswith("["):
            here = _table_path(tomllib.loads(statement), last)
            found.setdefault(here, line)
        else:
            found |= dict.fromkeys(_key_paths(tomllib.loads(statement), here), line)
    return found


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """The line and text of each header, and of each key with its value."""
    line, first, begin, depth = 1, 1, 0, 0
    for match in TOKEN.finditer(text + "\n"):
        token = match[0]
        depth += _step(token)
        line += token.count("\n")
        if token == "\n" and not depth:
            statement = text[begin : match.start()]
            if statement.strip() and statement.lstrip()[0] != "#":
                yield first, statement
            first, begin = line, match.end()


def _step(token: str) -> int:
    return 1 if token in "[{" else -1 if token in "]}" else 0


def _table_path(parsed: Mapping[str, Any], last: dict[Path, int]) -> Path:
    """Where a header points: `[[material]]` opens the next entry, `[material.wall]` its table."""
    path: Path = ()
    inner: Any = parsed
    while isinstance(inner, dict) and inner:
        ((name, inner),) = inner.items()
        path = (*path, name)
        if isinstance(inner, list):
            last[path] = last.get(path, -1) + 1
        if path in last:
            path = (*path, last[path])
    return path


def _key_paths(parsed: Mapping[str, Any], here: Path) -> Iterator[Path]:
    for name, value in parsed.items():
        yield (*here, name)
        if isinstance(value, dict):
            yield from _key_paths(value, (*here, name))
