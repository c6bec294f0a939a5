"""Tables of words and numbers for a terminal and for Markdown."""

import math
import re
import unicodedata
from collections.abc import Iterable, Sequence

from calibration import console
from calibration.errors import printable

Row = Sequence[str]
# in Markdown; an underscore between letters is none, brackets are a link's where another follows
STRUCTURE = re.compile(r"[<>&`*\\#~$]|!(?=\[)|\](?=[\[(:])|:(?=//)|(?<![^\W_])_|_(?![^\W_])")

CODE = re.compile(r"(`(?:softjax )?[\w-]+`)")


def aligned(header: Row, rows: Iterable[Row], right: Sequence[int] = ()) -> list[str]:
    """Lines of columns two spaces apart; columns named in `right` end on a common edge.

    One cell a line where the terminal is narrower than the table.
    """
    table = [[printable(cell) for cell in row] for row in (header, *rows)]
    widths = [max(map(width, column)) for column in zip(*table, strict=True)]
    lines = ["  ".join(map(_padded, row, widths, _ends(right, widths))) for row in table]
    if (console.columns() or math.inf) < max(map(width, lines)):
        return _one_below_the_other(table)
    rule = "  ".join("─" * w for w in widths)
    return [lines[0].rstrip(), rule, *(line.rstrip() for line in lines[1:])]


def _one_below_the_other(table: Sequence[Row]) -> list[str]:
    """The cells of each row below its first, with their headers."""
    header, *rows = table
    lines = []
    for row in rows:
        lines.append(f"{header[0]}: {row[0]}" if row[0] else "")
        cells = zip(header[1:], row[1:], strict=True)
        lines += [f"  {name}: {cell}".rstrip() for name, cell in cells if cell]
    return lines


def _ends(right: Sequence[int], widths: Sequence[int]) -> list[bool]:
    return [column in right for column in range(len(widths))]


def markdown(header: Row, rows: Iterable[Row]) -> list[str]:
    """The same as a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(map(escaped, row)) + " |" for row in lines]


def escaped(text: str) -> str:
    """Text that Markdown, and HTML made of it, show as it is: what would be structure as entities."""
    shown = STRUCTURE.sub(lambda match: f"&#{ord(match[0])};", printable(text))
    return shown.replace("|", "\\|")


def prose(text: str) -> str:
    """The same of a sentence of our own, where a word between backticks is code and stays so."""
    parts = CODE.split(text)
    return "".join(part if k % 2 else escaped(part) for k, part in enumerate(parts))


def code(text: str) -> str:
    """Text as Markdown shows a line of code, between more backticks than it has in a row."""
    marks = "`" * (max(map(len, re.findall("`+", text)), default=0) + 1)
    space = " " * ("`" in text)
    return f"{marks}{space}{printable(text)}{space}{marks}"


def width(text: str) -> int:
    """Columns on a terminal: χ̃ is two characters and one column wide."""
    return sum(not unicodedata.combining(letter) for letter in text)


def _padded(cell: str, columns: int, right: bool) -> str:
    space = " " * (columns - width(cell))
    return space + cell if right else cell + space
