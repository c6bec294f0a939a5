"""Tables of words and numbers for a terminal and for Markdown."""

import unicodedata
from collections.abc import Iterable, Sequence

from calibration.errors import printable

Row = Sequence[str]


def aligned(header: Row, rows: Iterable[Row], right: Sequence[int] = ()) -> list[str]:
    """Lines of columns two spaces apart; columns named in `right` end on a common edge."""
    table = [[printable(cell) for cell in row] for row in (header, *rows)]
    widths = [max(map(width, column)) for column in zip(*table, strict=True)]
    lines = ["  ".join(map(_padded, row, widths, _ends(right, widths))) for row in table]
    rule = "  ".join("─" * w for w in widths)
    return [lines[0].rstrip(), rule, *(line.rstrip() for line in lines[1:])]


def _ends(right: Sequence[int], widths: Sequence[int]) -> list[bool]:
    return [column in right for column in range(len(widths))]


def markdown(header: Row, rows: Iterable[Row]) -> list[str]:
    """The same as a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(map(_cell, row)) + " |" for row in lines]


def _cell(text: str) -> str:
    return printable(text).replace("|", "\\|")


def width(text: str) -> int:
    """Columns on a terminal: χ̃ is two characters and one column wide."""
    return sum(not unicodedata.combining(letter) for letter in text)


def _padded(cell: str, columns: int, right: bool) -> str:
    space = " " * (columns - width(cell))
    return space + cell if right else cell + space
