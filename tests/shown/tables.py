"""Tables read back from Markdown and from a terminal, and the tags of a page."""

import html
import re
from html.parser import HTMLParser


def markdown_tables(text: str) -> list[list[list[str]]]:
    """Every table as rows of cells, its header first."""
    tables: list[list[list[str]]] = []
    begun = False
    for line in text.splitlines():
        if line.startswith("|"):
            words = re.split(r"(?<!\\)\|", line)[1:-1]
            row = [html.unescape(cell.strip().replace("\\|", "|")) for cell in words]
            if not begun:
                tables.append([])
            if set("".join(row)) != {"-"}:
                tables[-1].append(row)
        begun = line.startswith("|")
    return tables


def cells(line: str) -> list[str]:
    return re.split(r"\s{2,}", line.strip())


def terminal_table(text: str, head: str) -> list[list[str]]:
    """Rows of cells below the header that begins so, up to the next empty line."""
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(head))
    rows = []
    for line in [lines[first], *lines[first + 2 :]]:
        if not line.strip():
            break
        rows.append(cells(line))
    return rows


class Tags(HTMLParser):
    """Tags with their attributes, and the text between."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.words, self.open = [], "", []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words += data

    def named(self, name):
        return [attrs for tag, attrs in self.tags if tag == name]
