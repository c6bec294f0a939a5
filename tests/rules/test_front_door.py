"""Tests go through the front door: public names and commands, not the modules behind them.

Public are `calibration`, `calibration.observables`, `calibration.paper` and `softjax` themselves, and
`calibration.cli` for its `main`. A module of
`softjax` may be imported where an algorithm has a contract of its own (roots, quadrature, works), with
a comment on the import, or a sentence of the file's docstring that names it, to say why. Oracles may
import what they like: they take part in no test of a module.
"""

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

TESTS = Path(__file__).parents[1]
PUBLIC = {
    "calibration",
    "calibration.cli",
    "calibration.observables",
    "calibration.paper",
    "softjax",
}
FILES = sorted(
    path.relative_to(TESTS).as_posix()
    for path in TESTS.rglob("*.py")
    if path.parent.name != "oracles"
)


class Use(NamedTuple):
    module: str
    line: int


def behind(text: str) -> list[str]:
    """Modules that a test file uses and should not, each with its line."""
    tree, lines = ast.parse(text), text.splitlines()
    docstring = ast.get_docstring(tree) or ""
    return [
        f"line {use.line}: {use.module}"
        for use in uses(tree)
        if use.module.startswith("calibration.") or not _says_why(use, docstring, lines)
    ]


def uses(tree: ast.Module) -> Iterator[Use]:
    """Modules of the two packages, other than public ones, that are imported or reached as attributes."""
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _hidden(alias.name, node.lineno)
                names[alias.asname or alias.name] = alias.name
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                yield from _hidden(_module_of(node.module, alias.name), node.lineno)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            package = names.get(node.value.id, "")
            if package in ("calibration", "softjax"):
                yield from _hidden(_module_of(package, node.attr), node.lineno)
        elif isinstance(node, ast.Call) and node.args and _loads(node.func):
            first = node.args[0]
            if isinstance(first, ast.JoinedStr):
                first = first.values[0]
            if isinstance(first, ast.Constant) and isinstance(first.value, str):
                yield from _hidden(first.value.rstrip("."), node.lineno)


def _loads(function) -> bool:
    """Whether a call takes a module by its name."""
    name = getattr(function, "attr", getattr(function, "id", ""))
    return name in ("import_module", "find_spec", "setattr")


def _module_of(package: str, name: str) -> str:
    """The module that `from package import name` reaches into: the package where the name is public."""
    if package not in ("calibration", "softjax"):
        return package
    whole = f"{package}.{name}"
    place = TESTS.parent / whole.replace(".", "/")
    if not (place.is_dir() or place.with_suffix(".py").exists()):
        return package
    return package if name in importlib.import_module(package).__all__ else whole


def _hidden(module: str, line: int) -> Iterator[Use]:
    if module.partition(".")[0] in ("calibration", "softjax") and module not in PUBLIC:
        yield Use(module, line)


def _says_why(use: Use, docstring: str, lines: list[str]) -> bool:
    above = lines[use.line - 2].strip() if use.line > 1 else ""
    return use.module in docstring or "#" in lines[use.line - 1] or above.startswith("#")


@pytest.mark.parametrize("file", FILES)
def test_no_test_reaches_behind_the_public_names(file):
    assert not behind((TESTS / file).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("text", "module"),
    [
        ("import calibration.fitting", "calibration.fitting"),
        ("from calibration import fitting", "calibration.fitting"),
        ("from calibration.fitting.result import FitResult", "calibration.fitting.result"),
        ("import calibration as cal\ncal.fitting.result", "calibration.fitting"),
        ("def f():\n    from calibration.data import checks", "calibration.data"),
        ("import_module(f'calibration.commands.{name}')", "calibration.commands"),
        ("from calibration.fitting import rows  # a reason is none here", "calibration.fitting"),
        ("from softjax.engine.energy import restitution", "softjax.engine.energy"),
        ("from softjax.engine import energy", "softjax.engine"),
        ("import softjax as sj\nsj.engine", "softjax.engine"),
    ],
)
def test_ways_behind_are_noticed(text, module):
    (found,) = behind(text)
    assert module in found


@pytest.mark.parametrize(
    "text",
    [
        "import calibration as cal\nimport softjax as sj\ncal.fit\nsj.restitution",
        "from calibration import fit, cli\nfrom calibration.cli import main",
        "from softjax import Zhou, restitution",
        "from softjax.engine.energy import x  # works are compared with quadrature",
        "# roots have a contract of their own\nfrom softjax.numerics import search",
        '"""Tests `softjax.engine.energy` as it is."""\nfrom softjax.engine import energy',
        "from softjaxes import energy\nimport calibrations.x",
    ],
)
def test_public_names_and_reasons_are_let_through(text):
    assert not behind(text)
