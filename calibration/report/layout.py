"""A report is a list of blocks; here it becomes terminal text or HTML."""

import base64
import io
import math
import re
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import pandas as pd
from markupsafe import Markup, escape
from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from calibration import console
from calibration.errors import printable
from calibration.rounding import ABSENT

# a word between backticks, in sentences of our own
CODE = re.compile(r"`((?:softjax )?[\w-]+)`")


class Block(NamedTuple):
    """A title, heading, lead, about, text, head, strong, code, list, warnings, table or picture.

    Its value is a text, of a head that of the block below; of a list texts or `Item`s; a DataFrame of texts; a picture's caption and file.
    """

    kind: str
    value: Any


class Item(NamedTuple):
    """An entry of a list: a name, a text and advice."""

    name: str
    text: str
    advice: str = ""


def terminal(blocks: Iterable[Block]) -> str:
    """Blocks as text as wide as the terminal; titles and pictures are left out."""
    parts = [(block.kind, "\n".join(lines)) for block in blocks if (lines := _lines(block))]
    return "".join(text + ("\n" if kind == "head" else "\n\n") for kind, text in parts).rstrip()


def page(blocks: Sequence[Block], folder: Path | None = None) -> str:
    """HTML of blocks: a full page with the pictures of a folder, or a fragment without."""

    files = {b.value[1]: folder / b.value[1] for b in blocks if folder and b.kind == "picture"}
    pictures = {n: Markup(base64.b64encode(f.read_bytes()).decode()) for n, f in files.items()}
    return _template().render(blocks=blocks, folder=folder, pictures=pictures)


def table_text(table: pd.DataFrame) -> str:
    """A table for a terminal, numbers on a common edge; a cell a line if the terminal is narrower."""
    layout: dict[str, Any] = {"show_edge": False, "pad_edge": False, "padding": (0, 1, 0, 0)}
    shown = Table(box=box.SIMPLE_HEAD, header_style="", **layout)
    cells = [[printable(str(cell)) for cell in row] for row in table.itertuples(index=False)]
    for name, column in zip(table.columns, zip(*cells, strict=True), strict=False):
        side: Any = "right" if _are_numbers(column) else "left"
        shown.add_column(Text(printable(name)), justify=side, no_wrap=True)
    for row in cells:
        shown.add_row(*map(Text, row))
    file = io.StringIO()
    # in a notebook too: Console would display it there and leave the file empty
    Console(file=file, width=10_000, color_system=None, force_jupyter=False).print(shown)
    lines = [line.rstrip() for line in file.getvalue().splitlines()]
    if max(map(cell_len, lines)) <= (console.columns() or math.inf):
        return "\n".join(lines)
    lines = []
    for first, *rest in cells:
        lines.append(f"{table.columns[0]}: {first}" if first else "")
        pairs = zip(table.columns[1:], rest, strict=True)
        lines += [f"  {name}: {cell}" for name, cell in pairs if cell]
    return "\n".join(lines)


def _lines(block: Block) -> list[str]:
    kind, value = block
    if kind in ("title", "heading", "picture"):
        return []
    if kind == "table":
        return [table_text(value)]
    if kind in ("list", "warnings"):
        if not value:
            return []
        texts = [e if isinstance(e, str) else f"{e[0]}{e[1]} {e[2]}".rstrip() for e in value]
        mark = "  ! " if kind == "warnings" else "  "
        lines = console.wrapped(map(printable, texts), mark, "    ")
        return ["Warnings:", *lines] if kind == "warnings" else lines
    return console.wrapped(map(printable, value.splitlines()))


@cache
def _template() -> jinja2.Template:
    """The template of a page, in which all text is escaped."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        autoescape=True,
        finalize=_escaped,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["prose"] = _prose
    environment.tests["of_numbers"] = _are_numbers
    return environment.get_template("report.html")


def _escaped(value: Any) -> Markup:
    """Text with entities in place of characters that HTML would interpret; control characters as codes."""
    return value if isinstance(value, Markup) else escape(printable(str(value)))


def _prose(text: str) -> Markup:
    """A sentence of our own, with words between backticks as code."""
    parts = CODE.split(text)  # text and code in turn
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if k % 2 else _escaped(part)
        for k, part in enumerate(parts)
    )


def _are_numbers(column: Iterable[Any]) -> bool:
    try:
        [float(cell) for cell in column if cell not in ("", ABSENT)]
    except ValueError:
        return False
    return True
