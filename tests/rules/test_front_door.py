"""Tests use the public interface: names and commands, not the modules behind them.

A module of `softjax` may be imported where an algorithm has a contract of its own (roots, quadrature,
works), with a comment on the import, or a sentence of the file's docstring that names it, to say why.
Oracles may import what they like: they take part in no test of a module.
"""

import ast
import importlib
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
PACKAGES = ("calibration", "softjax")
PUBLIC = {f"calibration.{name}" for name in ("cli", "observables", "paper", "plots")} | {*PACKAGES}


def behind(text: str) -> list[str]:
    tree, lines = ast.parse(text), text.splitlines()
    docstring = ast.get_docstring(tree) or ""

    def says_why(module, line):
        explained = "#" in lines[line - 1] or (line > 1 and lines[line - 2].strip().startswith("#"))
        return module.startswith("softjax.") and (module in docstring or explained)

    found = sorted({(line, module) for module, line in used(tree) if _is_hidden(module)})
    return [f"line {line}: {module}" for line, module in found if not says_why(module, line)]


def used(tree: ast.Module):
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                names[alias.asname or alias.name] = alias.name
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module, node.lineno
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value.rstrip("."), node.lineno
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield f"{names.get(node.value.id, '')}.{node.attr}", node.lineno


def _is_hidden(name: str) -> bool:
    """Whether a name is a module behind the public ones: a file or folder that no public name hides."""
    package, _, inner = name.partition(".")
    if package not in PACKAGES or name in PUBLIC or not inner.replace(".", "").isidentifier():
        return False
    place = TESTS.parent / name.replace(".", "/")
    return inner not in importlib.import_module(package).__all__ and (
        place.is_dir() or place.with_suffix(".py").exists()
    )


def test_no_test_reaches_behind_the_public_names():
    files = [path for path in TESTS.rglob("*.py") if path.parent.name not in ("oracles", "rules")]
    assert len(files) > 50
    found = {path.name: behind(path.read_text(encoding="utf-8")) for path in files}
    assert {name: lines for name, lines in found.items() if lines} == {}


WAYS = {  # texts of a test, and the module behind that each uses; none where that is allowed
    "from calibration import fitting": "calibration.fitting",
    "from calibration.fitting.result import FitResult": "calibration.fitting.result",
    "import calibration as cal\ncal.fitting.result": "calibration.fitting",
    "def f():\n    from calibration.data import checks": "calibration.data",
    "import_module(f'calibration.commands.{name}')": "calibration.commands",
    "from calibration.fitting import rows  # a reason is none here": "calibration.fitting",
    "from softjax.engine import energy": "softjax.engine",
    "import calibration as cal\nimport softjax as sj\ncal.fit\nsj.restitution": None,
    "from calibration import fit, cli\nfrom calibration.cli import main": None,
    "from softjax.engine.energy import x  # works are compared with quadrature": None,
    "# roots have a contract of their own\nfrom softjax.numerics import search": None,
    '"""Tests `softjax.engine.energy` as it is."""\nfrom softjax.engine import energy': None,
}


@pytest.mark.parametrize("text", WAYS)
def test_ways_behind_are_noticed_and_reasons_let_through(text):
    found = {line.partition(": ")[2] for line in behind(text)}
    assert WAYS[text] in found if WAYS[text] else not found
