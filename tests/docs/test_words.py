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
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md"]
PAGES += sorted((ROOT / "notebooks" / "reference").glob("*.md"))
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
MODULES = [path for name in ("softjax", "calibration") for path in (ROOT / name).rglob("*.py")]
IDIOM = re.compile(
    r"\b(told|asked|heeded|beside|wanted|doubts?|suspicions?|remedy|handovers?|hand-over|"
    r"of one's own|one's own|what is none|(?:back )?door|a formality|a wish|stand for themselves|"
    r"hangs on|sound and heat|said before|how closely the curves follow|nothing is known of|"
    r"makes something else|made ready|where .{1,30} is put together|gives way|half done|put away|"
    r"what is said of|who shares|no law tried|bounce trains?|elementary errors?|quite another|a slip|"
    r"left open|knows? nothing|serves? as well)\b",
    re.I,
)
ALLOWED = ("no doubt",)


def idioms(text: str) -> list[str]:
    text = " ".join(text.split())
    found = [text[max(m.start() - 25, 0) : m.end() + 15] for m in IDIOM.finditer(text)]
    return [one for one in found if not any(allowed in one for allowed in ALLOWED)]


def prose(path: Path) -> str:
    """Text of a page without names in code, or of a notebook's cells without code."""
    if path.suffix == ".md":
        return re.sub(r"`[^`\n]+`", "", path.read_text(encoding="utf-8"))
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")


def texts(path: Path) -> tuple[str, str]:
    """Messages, headings and helps of a module, which have more than one word; its docstrings and comments."""
    text = path.read_text(encoding="utf-8")
    nodes = list(ast.walk(ast.parse(text)))
    alone = {id(n.value) for n in nodes if isinstance(n, ast.Expr)}
    strings = [n for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    messages = [n.value for n in strings if id(n) not in alone and " " in n.value.strip()]
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    comments = [t.string for t in tokens if t.type == tokenize.COMMENT]
    return "\n".join(messages), "\n".join(
        [*comments, *(n.value for n in strings if id(n) in alone)]
    )


@pytest.mark.parametrize("path", [*PAGES, *NOTEBOOKS], ids=lambda path: path.stem)
def test_pages_and_notebooks_are_in_plain_words(path):
    assert idioms(prose(path)) == []


def test_messages_docstrings_and_comments_are_in_plain_words():
    """Of messages, and in tests, "beside" may have its ordinary sense."""
    found = []
    for path in [*MODULES, *(ROOT / "tests").rglob("*.py")]:
        messages, explanations = texts(path)
        is_test = path not in MODULES
        lenient = idioms(explanations if is_test else messages)
        found += [(path.name, words) for words in lenient if "beside" not in words.lower()]
        found += [(path.name, words) for words in idioms(explanations)] if not is_test else []
    assert found == []
    assert idioms("No error is told of it") == ["No error is told of it"]
    assert idioms("The file's own units") == []
