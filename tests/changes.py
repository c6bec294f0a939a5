"""Small changes to a Python file, found in its syntax tree: what `tests.mutants` draws from.

A change is an operator, comparison or constant replaced, two arguments swapped, a keyword dropped,
min for max, a condition or sign negated. Annotations, docstrings and messages are left alone.
"""

import ast
from itertools import islice
from pathlib import Path
from typing import NamedTuple

OPERATORS = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Pow: ("**", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
COMPARISONS = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}
OPPOSITES = [("min", "max"), ("minimum", "maximum"), ("all", "any"), ("floor", "ceil")]
OPPOSITE = {a: b for pair in OPPOSITES for a, b in (pair, pair[::-1])}
TEXT = (ast.List, ast.Tuple, ast.JoinedStr)  # + joins these


class Change(NamedTuple):
    """Bytes `start:end` of a file become `new`; `before` and `after` are the lines that differ."""

    file: str
    line: int
    kind: str
    start: int
    end: int
    new: str
    before: str
    after: str

    def applied(self, source: bytes) -> bytes:
        return source[: self.start] + self.new.encode() + source[self.end :]


def changes_of(file: str, source: bytes) -> list[Change]:
    """All changes, in their order; after some the file may be no Python any more."""
    found = []
    starts = _line_starts(source)
    for kind, start, end, new in _Finder(source, starts).found():
        changed = source[:start] + new.encode() + source[end:]
        if changed == source:
            continue
        first = source.rfind(b"\n", 0, start) + 1
        last = source.find(b"\n", end)
        last = len(source) if last < 0 else last
        after = changed[first : last + len(changed) - len(source)]
        line = source[:start].count(b"\n") + 1
        words = (_one_line(source[first:last]), _one_line(after))
        found.append(Change(file, line, kind, start, end, new, *words))
    return sorted(found, key=lambda change: (change.start, change.kind))


def _one_line(source: bytes) -> str:
    return " ".join(source.decode().split())


def _line_starts(source: bytes) -> list[int]:
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


class _Finder(ast.NodeVisitor):
    def __init__(self, source: bytes, starts: list[int]):
        self.source, self.starts = source, starts
        self.sites: list[tuple[str, int, int, str]] = []

    def found(self) -> list[tuple[str, int, int, str]]:
        self.visit(ast.parse(self.source))
        return self.sites

    def _span(self, node) -> tuple[int, int]:
        start = self.starts[node.lineno - 1] + node.col_offset
        return start, self.starts[node.end_lineno - 1] + node.end_col_offset

    def _text(self, start: int, end: int) -> str:
        return self.source[start:end].decode()

    def _between(self, kind: str, left, right, old: str, new: str) -> None:
        """Replace the one `old` between two nodes."""
        start, end = self._span(left)[1], self._span(right)[0]
        text = self._text(start, end)
        if text.count(old) == 1:
            self.sites.append((kind, start, end, text.replace(old, new)))

    def visit_AnnAssign(self, node) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node) -> None:
        for child in (*node.decorator_list, *node.args.defaults, *node.args.kw_defaults):
            if child is not None:
                self.visit(child)
        for child in node.body:
            self.visit(child)

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_Raise(self, node) -> None:
        """Messages are no matter of a change."""

    def visit_BinOp(self, node) -> None:
        pair = OPERATORS.get(type(node.op))
        texts = any(isinstance(side, TEXT) or _is_text(side) for side in (node.left, node.right))
        if pair is not None and not texts:
            self._between("operator", node.left, node.right, *pair)
        self.generic_visit(node)

    def visit_AugAssign(self, node) -> None:
        pair = OPERATORS.get(type(node.op))
        if pair is not None and not isinstance(node.value, TEXT):
            self._between("operator", node.target, node.value, f"{pair[0]}=", f"{pair[1]}=")
        self.generic_visit(node)

    def visit_BoolOp(self, node) -> None:
        self._between("operator", *node.values[:2], *OPERATORS[type(node.op)])
        self.generic_visit(node)

    def visit_Compare(self, node) -> None:
        if len(node.ops) == 1:
            pair = COMPARISONS[type(node.ops[0])]
            self._between("comparison", node.left, node.comparators[0], *pair)
        self.generic_visit(node)

    def visit_Constant(self, node) -> None:
        if isinstance(node.value, bool):
            self.sites.append(("constant", *self._span(node), repr(not node.value)))
        elif isinstance(node.value, int | float):
            new = node.value + 1 if isinstance(node.value, int) else node.value * 1.5 or 1.0
            self.sites.append(("constant", *self._span(node), repr(new)))

    def visit_UnaryOp(self, node) -> None:
        if isinstance(node.op, ast.USub | ast.Not | ast.Invert):
            kind = "sign" if isinstance(node.op, ast.USub) else "negation"
            self.sites.append((kind, self._span(node)[0], self._span(node.operand)[0], ""))
        self.generic_visit(node)

    def _condition(self, node) -> None:
        start, end = self._span(node.test)
        self.sites.append(("negation", start, end, f"not ({self._text(start, end)})"))
        self.generic_visit(node)

    def visit_If(self, node) -> None:
        if _is_text(node.test) or getattr(node.test, "id", "") == "TYPE_CHECKING":
            return
        self._condition(node)

    def visit_IfExp(self, node) -> None:
        self._condition(node)

    def visit_Call(self, node) -> None:
        if len(node.args) >= 2 and not any(isinstance(a, ast.Starred) for a in node.args[:2]):
            (start, after_first), (before_second, end) = map(self._span, node.args[:2])
            first, second = self._text(start, after_first), self._text(before_second, end)
            between = self._text(after_first, before_second)
            self.sites.append(("arguments", start, end, second + between + first))
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        if name in OPPOSITE:
            end = self._span(node.func)[1]
            self.sites.append(("opposite", end - len(name), end, OPPOSITE[name]))
        self._keywords(node)
        self.generic_visit(node)

    def _keywords(self, node) -> None:
        """Each keyword dropped, with the comma before it."""
        if len(node.args) + len(node.keywords) < 2:
            return
        for keyword in node.keywords:
            start, end = self._span(keyword)
            before = self.source[:start].rstrip()
            if keyword.arg and before.endswith(b","):
                self.sites.append(("keyword", len(before) - 1, end, ""))


def _is_text(node) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def drawn(changes: list[Change], count: int, rng, top: Path) -> list[Change]:
    """`count` of them at random, each at most once, after which the file in `top` is still Python."""
    shuffled = (one for one in rng.sample(changes, len(changes)) if _parses(one, top))
    return list(islice(shuffled, count))


def _parses(change: Change, top: Path) -> bool:
    try:
        ast.parse(change.applied((top / change.file).read_bytes()))
    except SyntaxError:
        return False
    return True
