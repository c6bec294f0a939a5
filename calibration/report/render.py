"""Lay out tables and reports: on a terminal by rich, as Markdown and HTML by templates."""

import base64
import html
import io
import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup
from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from calibration import console
from calibration.errors import printable
from calibration.report.content import content
from calibration.rounding import ABSENT, number

MOST_SEARCHES = 12  # that are listed one by one
# signs of structure in Markdown; an underscore between letters is none, brackets are a link's where
# another follows
STRUCTURE = re.compile(r"[<>&`*\\#~$]|!(?=\[)|\](?=[\[(:])|:(?=//)|(?<![^\W_])_|_(?![^\W_])")
CODE = re.compile(r"(`(?:softjax )?[\w-]+`)")


def table_text(table: pd.DataFrame) -> str:
    """A table for a terminal; one cell a line where the terminal is narrower.

    Columns of numbers end on a common edge.
    """
    look: dict[str, Any] = {"show_edge": False, "pad_edge": False, "padding": (0, 1, 0, 0)}
    shown = Table(box=box.SIMPLE_HEAD, header_style="", **look)
    cells = [[printable(str(cell)) for cell in row] for row in table.itertuples(index=False)]
    for name, column in zip(table.columns, zip(*cells, strict=True), strict=False):
        right = all(map(_is_number, column))
        shown.add_column(Text(printable(name)), justify="right" if right else "left", no_wrap=True)
    for row in cells:
        shown.add_row(*map(Text, row))
    file = io.StringIO()
    Console(file=file, width=10_000, color_system=None).print(shown)
    lines = [line.rstrip() for line in file.getvalue().splitlines()]
    if max(map(cell_len, lines)) <= (console.columns() or math.inf):
        return "\n".join(lines)
    return "\n".join(_one_below_the_other(list(table.columns), cells))


def terminal_report(result: Any, intro: str = "", **more: Any) -> str:
    """A fit on a terminal: tables of parameters, goodness of fit, Eq. (18) and searches, warnings.

    Args:
        result: a `FitResult`.
        intro: what the reader must know of the data before anything else.
        more: as `content` takes it.
    """
    of = content(result, **more)
    methods = [f"{name} interval: {text}" for name, text in of["methods"].items()]
    blocks = [
        console.wrapped(intro.splitlines() or of["notes"]),
        console.wrapped([of["settings"]]),
        [table_text(of["parameters"])],
        _indented([*of["meanings"], *of["stated"], *methods]),
        [table_text(of["quality"])],
        _indented(of["quality_words"]),
        [] if of["line"] is None else [table_text(of["line"])],
        [] if of["line_converged"] else ["NOT CONVERGED"],
        _searches(result, of["searches"]),
        *_posterior(of["posterior"]),
        [] if result.converged else ["NOT CONVERGED: do not use these values."],
        warning_lines(result.warnings),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def warning_lines(warnings: Iterable[Any], head: str = "Warnings:") -> list[str]:
    """Warnings in a list, each with its cause and advice."""
    lines = console.wrapped(map(str, warnings), "  ! ", "    ")
    return [head, *lines] if lines else ["No warnings."]


def markdown_report(result: Any, **more: Any) -> str:
    """The report of a fit as Markdown; arguments as `content`'s."""
    text = _template("report.md").render(content(result, **more))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def html_report(result: Any, folder: Path | None = None, **more: Any) -> str:
    """The report of a fit as one page, with the pictures of a folder inside; arguments as `content`'s."""
    of = content(result, **more)
    pictures = of.pop("pictures") if folder is not None else {}
    coded = {
        caption: base64.b64encode((Path(folder or ".") / name).read_bytes()).decode("ascii")
        for caption, name in pictures.items()
    }
    return _template("report.html").render(of | {"pictures": coded})


def html_result(result: Any) -> str:
    """A fit in a notebook: its sentence, parameters, goodness of fit and warnings."""
    return _template("result.html").render(content(result))


@cache
def _template(name: str) -> jinja2.Template:
    """A template that shows every text as it is: what would be structure is escaped."""
    page = name.endswith(".html")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        autoescape=True,
        finalize=_shown if page else _escaped,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["prose"] = _prose_html if page else _prose
    environment.filters["code"] = _code
    environment.filters["row"] = lambda cells: Markup(f"| {' | '.join(map(_escaped, cells))} |")
    environment.tests["of_numbers"] = lambda column: all(map(_is_number, column))
    return environment.get_template(name)


def _shown(value: Any) -> Any:
    return value if isinstance(value, Markup) else printable(str(value))


def _escaped(value: Any) -> Markup:
    """Text that Markdown, and HTML made of it, show as it is: what would be structure as entities."""
    if isinstance(value, Markup):
        return value
    shown = STRUCTURE.sub(lambda match: f"&#{ord(match[0])};", printable(str(value)))
    return Markup(shown.replace("|", "\\|"))


def _prose(text: str) -> Markup:
    """A sentence of our own, where a word between backticks is code and stays so."""
    parts = CODE.split(text)
    return Markup("".join(part if k % 2 else _escaped(part) for k, part in enumerate(parts)))


def _prose_html(text: str) -> Markup:
    parts = [html.escape(printable(part)) for part in CODE.split(text)]
    shown = (f"<code>{p.strip('`')}</code>" if k % 2 else p for k, p in enumerate(parts))
    return Markup("".join(shown))


def _code(text: str) -> Markup:
    """Markdown's code, between more backticks than the text has in a row."""
    marks = "`" * (max(map(len, re.findall("`+", text)), default=0) + 1)
    space = " " * ("`" in text)
    return Markup(f"{marks}{space}{printable(text)}{space}{marks}")


def _one_below_the_other(header: list[str], rows: list[list[str]]) -> list[str]:
    """The cells of each row below its first, with their headers."""
    lines = []
    for row in rows:
        lines.append(f"{header[0]}: {row[0]}" if row[0] else "")
        lines += [
            f"  {name}: {cell}" for name, cell in zip(header[1:], row[1:], strict=True) if cell
        ]
    return lines


def _indented(lines: Iterable[str]) -> list[str]:
    return console.wrapped(lines, "  ", "    ")


def _searches(result: Any, table: pd.DataFrame) -> list[str]:
    """Each search; the sums of very many."""
    stages = result.optimiser_report
    if len(stages) <= MOST_SEARCHES:
        return [table_text(table)]
    seconds = sum(result.times.get(stage.label, 0.0) for stage in stages)
    evaluations = sum(stage.evaluations for stage in stages)
    return [f"{len(stages)} searches, {evaluations} evaluations, {number(seconds, 2)} s"]


def _posterior(section: Mapping[str, Any] | None) -> list[list[str]]:
    """The section of draws, without the priors."""
    if section is None:
        return []
    return [
        ["Posterior:", table_text(section["table"].drop(columns="prior"))],
        _indented(section["known"]),
        warning_lines(section["warnings"], "Warnings about the draws:"),
    ]


def _is_number(cell: Any) -> bool:
    if cell in ("", ABSENT):
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return True
