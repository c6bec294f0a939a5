"""Pages, notebooks, messages, docstrings and comments in plain technical English: words of a private idiom are absent.

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
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "notebooks" / "reference").glob("*.md")),
]
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
    """Text of a page without names in code, or of a notebook's cells without code."""
    if path.suffix == ".md":
        return re.sub(r"`[^`\n]+`", "", path.read_text(encoding="utf-8"))
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
    """Of messages, and in tests, "beside" may have its ordinary sense."""
    strict = [(path, explanations(path)) for path in MODULES]
    lenient = [(path, messages(path)) for path in MODULES]
    lenient += [(path, explanations(path)) for path in (ROOT / "tests").rglob("*.py")]
    found = [(path.name, words) for path, text in strict if (words := idioms(text))]
    found += [(p.name, w) for p, text in lenient for w in idioms(text) if "beside" not in w.lower()]
    assert found == []
    assert idioms("No error is told of it") == ["No error is told of it"]
    assert idioms("The file's own units") == []
