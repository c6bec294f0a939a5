"""`report.html`: the words of `report.md`, pictures inside, and nothing that a name could slip in."""

import base64
import re
from html.parser import HTMLParser

import pytest

from calibration.report import html_report
from calibration.report.tables import escaped, markdown

PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
TEXT = """# Coefficients, fitted

| material | χ²/ν |
| --- | --- |
| a\\|b <i>c</i> | 1.2 |

![Curves of `two`](curves.png)

- **model-misfit** (a): rms 0.02. *Look at both.*
"""


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


NAMES = (
    "<script>alert(1)</script>",
    "![x](http://example.org/x.png)",
    "a|b",
    "`x` *y* _z_ \\ &amp;",
)


@pytest.mark.parametrize("name", NAMES)
def test_names_are_shown_as_they_are(name, folder):
    """As the report writes them into its text and into its tables."""
    text = "\n".join(
        ["# A", f"## {escaped(name)}", "", f"- **{escaped(name)}**", "", *markdown(["a"], [[name]])]
    )
    page = Tags(html_report(text + "\n", folder))
    assert page.words.count(name) == 3
    assert page.named("script") == page.named("img") == page.named("code") == []


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "curves.png").write_bytes(PNG)
    return tmp_path


def test_tables_pictures_and_doubts_are_inside_one_file(folder):
    page = Tags(html_report(TEXT, folder))
    assert page.open == []
    assert len(page.named("td")) == len(page.named("th")) == 2
    assert "a|b <i>c</i>" in page.words  # shown, and no tag
    assert page.named("i") == []
    (picture,) = page.named("img")
    coded = picture["src"].removeprefix("data:image/png;base64,")
    assert base64.b64decode(coded) == PNG
    assert "Curves of two" in page.words
    assert "model-misfit (a): rms 0.02. Look at both." in page.words
    assert page.words.strip().startswith("Coefficients, fitted")  # the title of the window


def test_it_fetches_nothing_and_runs_nothing(folder):
    page = Tags(html_report(TEXT + "\n<script>alert(1)</script>\n[x](javascript:alert(1))", folder))
    assert page.named("script") == page.named("link") == []
    addresses = [attrs.get("href") or attrs.get("src") for _, attrs in page.tags]
    outside = [one for one in addresses if one and not one.startswith(("data:", "#"))]
    assert outside == []


def test_a_picture_that_a_name_asks_for_is_not_taken_in(folder):
    outside = folder.parent / "secret.png"
    outside.write_bytes(PNG)
    for path in ("../secret.png", str(outside), "https://example.org/a.png"):
        page = Tags(html_report(f"# A\n\n![named]({path})\n", folder))
        assert page.named("img") == []
        assert "named" in page.words


def test_it_is_laid_out_for_narrow_windows_and_paper(folder):
    text = html_report(TEXT, folder)
    assert '<meta name="viewport" content="width=device-width' in text
    assert "@media print" in text
    assert re.search(r'<div class="wide"><table>', text)  # scrolls by itself
