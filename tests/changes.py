"""Small changes to a Python file, found in its syntax tree: what `tests.mutants` draws from.

A change is an operator, comparison or constant replaced, two arguments swapped, a keyword dropped,
min for max, a condition or sign negated. Annotations, docstrings, messages and the looks of pictures
are left alone, and so are the code's checks of itself: `zip(strict=True)`, `dataclass(frozen=True)`.
"""

import ast
from collections.abc import Iterator
from itertools import accumulate, islice
from pathlib import Path
from typing import NamedTuple

# the class of a node, how it is written, and what is written in its place
OPERATORS = "Add + -, Sub - +, Mult * /, Div / *, Pow ** *, FloorDiv // *, BitAnd & |, BitOr | &, "
OPERATORS += "And and or, Or or and"
COMPARISONS = "Lt < <=, LtE <= <, Gt > >=, GtE >= >, Eq == !=, NotEq != ==, Is is is_not, "
COMPARISONS += "IsNot is_not is, In in not_in, NotIn not_in in"
OPERATORS, COMPARISONS = (
    {getattr(ast, name): signs for name, *signs in map(str.split, words.split(", "))}
    for words in (OPERATORS, COMPARISONS)
)
OPPOSITES = [("min", "max"), ("minimum", "maximum"), ("all", "any"), ("floor", "ceil")]
OPPOSITE = {a: b for pair in OPPOSITES for a, b in (pair, pair[::-1])}
COMMUTE = {"min", "max", "minimum", "maximum", "hypot", "logical_and", "logical_or", "suppress"}
CHECKED = {"zip", "dataclass"}  # whose keywords change nothing but what is refused
LOOKS = {"linewidth", "elinewidth", "markersize", "markeredgewidth", "capsize", "alpha", "zorder"}
LOOKS |= {"fontsize", "frameon", "ha", "va", "lw", "ms", "mew"}
TEXT = (ast.List, ast.Tuple, ast.JoinedStr)  # + joins these
Site = tuple[str, int, int, str]  # kind, start, end, new text


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
    changes, whole = [], _Source(source)
    sites = (site for node in _nodes(ast.parse(source)) for site in whole.sites(node))
    for kind, start, end, new in sites:
        above, _, head = source[:start].rpartition(b"\n")
        tail = source[end:].partition(b"\n")[0]
        parts = (source[start:end], new.encode())
        before, after = (" ".join((head + part + tail).decode().split()) for part in parts)
        if parts[0] != parts[1]:
            line = above.count(b"\n") + 1 + (start > len(head))
            changes.append(Change(file, line, kind, start, end, new, before, after))
    return sorted(changes, key=lambda change: (change.start, change.kind))


class _Source:
    """Where the nodes of a file are in its bytes, and what may be changed there."""

    def __init__(self, source: bytes):
        lengths = map(len, source.splitlines(keepends=True))
        self.source, self.starts = source, [0, *accumulate(lengths)]

    def span(self, node) -> tuple[int, int]:
        start = self.starts[node.lineno - 1] + node.col_offset
        return start, self.starts[node.end_lineno - 1] + node.end_col_offset

    def text(self, start: int, end: int) -> str:
        return self.source[start:end].decode()

    def between(self, kind: str, left, right, old: str, new: str) -> Iterator[Site]:
        """The one `old` between two nodes replaced."""
        old, new = old.replace("_", " "), new.replace("_", " ")
        start, end = self.span(left)[1], self.span(right)[0]
        text = self.text(start, end)
        if text.count(old) == 1:
            yield kind, start, end, text.replace(old, new)

    def sites(self, node) -> Iterator[Site]:
        match node:
            case ast.BinOp(left, op, right) if type(op) in OPERATORS:
                if not any(isinstance(side, TEXT) or _is_text(side) for side in (left, right)):
                    yield from self.between("operator", left, right, *OPERATORS[type(op)])
            case ast.AugAssign(target, op, value) if type(op) in OPERATORS:
                if not isinstance(value, TEXT):
                    signs = (f"{sign}=" for sign in OPERATORS[type(op)])
                    yield from self.between("operator", target, value, *signs)
            case ast.BoolOp(op, [first, second, *_]):
                yield from self.between("operator", first, second, *OPERATORS[type(op)])
            case ast.Compare(left, [op], [right]):
                yield from self.between("comparison", left, right, *COMPARISONS[type(op)])
            case ast.Constant(bool(value)):
                yield "constant", *self.span(node), repr(not value)
            case ast.Constant(int(value)):
                yield "constant", *self.span(node), repr(value + 1)
            case ast.Constant(float(value)):
                yield "constant", *self.span(node), repr(value * 1.5 or 1.0)
            case ast.UnaryOp(ast.USub() | ast.Not() | ast.Invert() as op, operand):
                kind = "sign" if isinstance(op, ast.USub) else "negation"
                yield kind, self.span(node)[0], self.span(operand)[0], ""
            case ast.If(test) | ast.IfExp(test) if not _is_left_alone(node):
                start, end = self.span(test)
                yield "negation", start, end, f"not ({self.text(start, end)})"
            case ast.Call(function, arguments, keywords):
                yield from self._of_call(function, arguments, keywords)

    def _of_call(self, function, arguments, keywords) -> Iterator[Site]:
        """Two arguments swapped, the opposite function, each keyword dropped with the comma before it."""
        name = _name(function)
        starred = any(isinstance(argument, ast.Starred) for argument in arguments[:2])
        if len(arguments) >= 2 and not starred and name not in COMMUTE:
            (start, after), (before, end) = map(self.span, arguments[:2])
            parts = ((before, end), (after, before), (start, after))
            yield "arguments", start, end, "".join(self.text(*part) for part in parts)
        if name in OPPOSITE:
            end = self.span(function)[1]
            yield "opposite", end - len(name), end, OPPOSITE[name]
        if len(arguments) + len(keywords) < 2 or name in CHECKED:
            return
        for keyword in keywords:
            start, end = self.span(keyword)
            before = self.source[:start].rstrip()
            if keyword.arg and keyword.arg not in LOOKS and before.endswith(b","):
                yield "keyword", len(before) - 1, end, ""


def _nodes(node) -> Iterator[ast.AST]:
    """A node and those within that may change: no annotations, no messages."""
    yield node
    match node:
        case ast.AnnAssign(value=value):
            within = [value]
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            defaults = (*node.args.defaults, *node.args.kw_defaults)
            within = [*node.decorator_list, *defaults, *node.body]
        case ast.Call() if _name(node.func) in CHECKED:
            within = node.args
        case ast.Dict(keys, values):
            pairs = zip(keys, values, strict=True)
            kept = [value for key, value in pairs if getattr(key, "value", None) not in LOOKS]
            within = [*keys, *kept]
        case ast.keyword(name) if name in LOOKS:
            within = []
        case _:
            within = [] if _is_left_alone(node) else list(ast.iter_child_nodes(node))
    for child in within:
        yield from _nodes(child) if child is not None else ()


def _name(function) -> str:
    return getattr(function, "id", getattr(function, "attr", ""))


def _is_left_alone(node) -> bool:
    test = getattr(node, "test", None) if isinstance(node, ast.If) else None
    typing = test is not None and (_is_text(test) or getattr(test, "id", "") == "TYPE_CHECKING")
    return isinstance(node, ast.Raise) or typing


def _is_text(node) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def drawn(changes: list[Change], count: int, rng, top: Path) -> list[Change]:
    """`count` of them at random, each at most once, after which the file in `top` is still Python."""

    def parses(change: Change) -> bool:
        try:
            return bool(ast.parse(change.applied((top / change.file).read_bytes())))
        except SyntaxError:
            return False

    return list(islice(filter(parses, rng.sample(changes, len(changes))), count))
