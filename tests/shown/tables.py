"""Tables read back from a terminal; the tags, words and tables of a page."""

import re
from html.parser import HTMLParser

# of the paragraphs of a page, by tag
STARTS = {"h1": "# ", "h2": "## ", "li": "- ", "p": "", "tr": "", "figcaption": "picture: "}


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
    """Tags with their attributes, the text between, tables as rows of cells with their header first, and
    `paragraphs`: the text of each heading, sentence, entry of a list and row of a table."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.words, self.open, self.tables, self.paragraphs = [], "", [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        if tag in STARTS:
            self.paragraphs.append(STARTS[tag])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        if tag == "tr":
            self.paragraphs[-1] = f"| {' | '.join(self.tables[-1][-1])} |"

    def handle_data(self, data):
        self.words += data
        if {"td", "th"} & {*self.open}:
            self.tables[-1][-1][-1] += data
        elif {*STARTS} & {*self.open}:
            self.paragraphs[-1] += data

    def named(self, name):
        return [attrs for tag, attrs in self.tags if tag == name]
