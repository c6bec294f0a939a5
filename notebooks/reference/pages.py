"""Markdown and notebooks as HTML; formulas as MathML, so that nothing is fetched to read a page."""

import html
import os
import re
from collections.abc import Mapping
from pathlib import Path

import mistune
import nbformat
from latex2mathml.converter import convert
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_by_name

COLOURED = ("python", "toml", "bash")
TEMPLATE = Path(__file__).with_name("page.html")


class Renderer(mistune.HTMLRenderer):
    """HTML with anchors at headings, coloured code, and formulas."""

    def heading(self, text: str, level: int, **attrs) -> str:
        words = re.sub(r"<[^>]+>|[^\w\s-]", "", html.unescape(text)).strip()
        anchor = words.lower().replace(" ", "-")
        return f'<h{level} id="{anchor}">{text}</h{level}>\n'

    def block_code(self, code: str, info: str | None = None) -> str:
        lexer = get_lexer_by_name(info if info in COLOURED else "text")
        return highlight(code, lexer, HtmlFormatter(cssclass="code"))

    def inline_math(self, text: str) -> str:
        return convert(text)

    def block_math(self, text: str) -> str:
        return convert(text, display="block")


def page(source: Path, targets: Mapping[Path, str]) -> tuple[str, list[Path]]:
    """A source's page, and the pictures that it shows.

    Args:
        targets: sources and the pages that they become, to which links between them lead.
    """
    text = _cells(source) if source.suffix == ".ipynb" else _marked(source.read_text("utf-8"))
    pictures: list[Path] = []

    def led(match: re.Match) -> str:
        attribute, link, anchor = match.groups(default="")
        path = Path(os.path.normpath(source.parent / link))
        if path.suffix == ".png":
            pictures.append(path)
            return f'{attribute}="figures/{path.name}"'
        return f'{attribute}="{targets.get(path, link)}{anchor}"'

    text = re.sub(r'(href|src)="(?![a-z]+:|#)([^"#]+)(#[^"]*)?"', led, text)
    title = re.search(r"<h1[^>]*>(.*?)</h1>", text)
    frame = TEMPLATE.read_text("utf-8").replace("{title}", title[1] if title else source.stem)
    return frame.replace("{body}", text), pictures


def _marked(text: str) -> str:
    return str(mistune.create_markdown(renderer=Renderer(), plugins=["table", "math"])(text))


def _cells(source: Path) -> str:
    blocks = []
    for cell in nbformat.read(source, as_version=4).cells:
        if cell.cell_type == "markdown":
            blocks.append(_marked(cell.source))
        else:
            blocks += [_marked(f"```python\n{cell.source}\n```"), *map(_shown, cell.outputs)]
    return "\n".join(blocks)


def _shown(output) -> str:
    """A cell's output: a picture, Markdown, or text."""
    data = output.get("data", {})
    if "image/png" in data:
        return f'<img alt="figure" src="data:image/png;base64,{data["image/png"].strip()}">'
    if "text/markdown" in data:
        return _marked(data["text/markdown"])
    return f"<pre>{html.escape(output.get('text') or data['text/plain'])}</pre>"
