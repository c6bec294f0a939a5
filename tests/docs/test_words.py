"""Pages, notebooks and messages in plain technical English: words of a private idiom are absent.

`ALLOWED` has the places where a word stands in its ordinary sense, by the text around it.
"""

import ast
import io
import json
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "notebooks" / "reference").glob("*.md"))]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
MODULES = sorted(
    path for package in ("softjax", "calibration") for path in (ROOT / package).rglob("*.py")
)
IDIOM = re.compile(
    r"\b(told|asked|heeded|beside|wanted|doubts?|suspicions?|remedy|handovers?|hand-over|"
    r"of one's own|one's own|what is none|(?:back )?door|a formality|a wish|stand for themselves|"
    r"hangs on|sound and heat|said before|how closely the curves follow|nothing is known of|"
    r"makes something else|made ready|where .{1,30} is put together|gives way|half done|put away|"
    r"what is said of|who shares|no law tried|bounce trains?|elementary errors?|quite another|a slip|"
    r"left open|knows? nothing|serves? as well)\b",
    re.I,
)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef)
ALLOWED = ("no doubt",)


def idioms(text: str) -> list[str]:
    """Words of the idiom in a text, with what stands around them."""
    text = " ".join(text.split())
    found = [text[max(m.start() - 25, 0) : m.end() + 15] for m in IDIOM.finditer(text)]
    return [one for one in found if not any(allowed in one for allowed in ALLOWED)]


def prose(path: Path) -> str:
    """Text of a page, or of a notebook's cells without code."""
    if path.suffix == ".md":
        return path.read_text(encoding="utf-8")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")


def messages(path: Path) -> str:
    """Texts of a module with more than one word that are no docstrings: messages, headings, helps."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    alone = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    texts = [n for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in alone]
    return "\n".join(n.value for n in texts if isinstance(n.value, str) and " " in n.value.strip())


def explanations(path: Path) -> str:
    """Docstrings and comments of a module."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    every = [n for n in ast.walk(tree) if isinstance(n, DOCUMENTED)]
    docstrings = [doc for n in every if (doc := ast.get_docstring(n))]
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return "\n".join([*docstrings, *(t.string for t in tokens if t.type == tokenize.COMMENT)])


@pytest.mark.parametrize("path", [*PAGES, *NOTEBOOKS], ids=lambda path: path.stem)
def test_pages_and_notebooks_are_in_plain_words(path):
    assert idioms(prose(path)) == []


def test_messages_docstrings_and_comments_are_in_plain_words():
    """Of messages "beside" may have its ordinary sense."""
    found = {
        path.relative_to(ROOT).as_posix(): [w for w in idioms(messages(path)) if "beside" not in w]
        for path in MODULES
    }
    assert {name: words for name, words in found.items() if words} == {}
    found = {p.relative_to(ROOT).as_posix(): idioms(explanations(p)) for p in MODULES}
    assert {name: words for name, words in found.items() if words} == {}
    assert idioms("No error is told of it") == ["No error is told of it"]
    assert idioms("The file's own units") == []
