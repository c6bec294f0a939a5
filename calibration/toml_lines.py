"""On which line of a TOML text each key stands, which `tomllib` does not tell."""

import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

Path = tuple[str | int, ...]


def lines_of(text: str) -> dict[Path, int]:
    """Line, from 1, of every table and key of a valid TOML text, by its path.

    The path of `radius` in the second `[[material]]` is ("material", 1, "radius"). The text is cut
    into statements, each as few lines as parse by themselves, so that strings and arrays over
    several lines, quoted and dotted keys are read by the parser and not by guesses.
    """
    found: dict[Path, int] = {}
    last: dict[Path, int] = {}  # position of the latest entry of each array of tables
    here: Path = ()
    for line, statement in _statements(text):
        parsed = tomllib.loads(statement)
        if statement.lstrip().startswith("["):
            here = _table_path(parsed, last)
            found.setdefault(here, line)
        else:
            found |= dict.fromkeys(_key_paths(parsed, here), line)
    return found


def _statements(text: str) -> Iterator[tuple[int, str]]:
    gathered: list[str] = []
    for number, line in enumerate(text.split("\n"), start=1):
        gathered.append(line)
        try:
            tomllib.loads("\n".join(gathered))
        except tomllib.TOMLDecodeError:
            continue
        yield number - len(gathered) + 1, "\n".join(gathered)
        gathered = []


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
