"""Markdown and notebooks as HTML; formulas as MathML, so that nothing is fetched to read a page."""

import html
import os
import re
from collections.abc import Mapping
from pathlib import Path

import markdown2
import nbformat

EXTRAS = {
    "fenced-code-blocks": {"cssclass": "code"},
    "header-ids": None,
    "latex": None,
    "tables": None,
    "cuddled-lists": None,
    "code-friendly": None,  # names keep their underscores
}
TEMPLATE = Path(__file__).with_name("page.html")


def page(source: Path, targets: Mapping[Path, str]) -> tuple[str, list[Path]]:
    """A source's page, and the pictures that it shows.

    Args:
        targets: sources and the pages that they become, to which links between them lead.
    """
    text = _cells(source) if source.suffix == ".ipynb" else _marked(source.read_text("utf-8"))
    pictures: list[Path] = []

    def led(match: re.Match) -> str:
        attribute, link, anchor = match.groups()
        path = Path(os.path.normpath(source.parent / link))
        if path.suffix == ".png":
            pictures.append(path)
            return f'{attribute}="figures/{path.name}"'
        return f'{attribute}="{targets.get(path, link)}{anchor or ""}"'

    text = re.sub(r'(href|src)="(?![a-z]+:|#)([^"#]+)(#[^"]*)?"', led, text)
    title = re.search(r"<h1[^>]*>(.*?)</h1>", text)
    frame = TEMPLATE.read_text("utf-8")
    return frame.replace("{title}", title[1] if title else source.stem).replace(
        "{body}", text
    ), pictures


def _marked(text: str) -> str:
    return str(markdown2.markdown(text, extras=EXTRAS))


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
