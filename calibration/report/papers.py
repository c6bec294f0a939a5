"""The table of parameters as a paper has it: in Markdown, and in LaTeX."""

import re
from collections.abc import Sequence
from typing import Any

from calibration import symbols
from calibration.report.tables import parameter_table
from calibration.rounding import ABSENT

NUMBER = re.compile(r"\(?-?\d.*?(?= \((?:at|fixed)|$)")  # with its error, or an interval
POWER = re.compile(r"(?<=[\d.)])e([+-]?\d+)")
SPECIAL = re.compile(r"([%&#_])")


def markdown(result: Any) -> str:
    """Parameters with units, values ± standard errors and intervals in Markdown."""
    table = parameter_table(result, brief=True)
    rows = [[*table.columns], ["---"] * table.shape[1], *table.values.tolist()]
    cells = [[str(cell).replace("|", r"\|") for cell in row] for row in rows]
    return "".join(f"| {' | '.join(row)} |\n" for row in cells)


def latex(result: Any) -> str:
    """Table of parameters as a tabular with the rules of booktabs, symbols and numbers in formulas."""
    table = parameter_table(result, brief=True)
    head = [_escaped(name).replace("±", r"$\pm$") for name in table.columns]
    rows = [
        [
            _symbol(x) if name == "parameter" else _cell(x)
            for name, x in zip(table, row, strict=True)
        ]
        for row in table.values.tolist()
    ]
    lines = [rf"\begin{{tabular}}{{{'l' * len(head)}}}", r"\toprule", _row(head), r"\midrule"]
    return "\n".join([*lines, *map(_row, rows), r"\bottomrule", r"\end{tabular}"]) + "\n"


def _row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _symbol(label: str) -> str:
    """`v_cr [m/s]` as $v_\\mathrm{cr}$ [m/s]."""
    letter, bracket, unit = label.partition(" [")
    written = symbols.in_math(letter)
    return (written if "$" in written else _escaped(written)) + _escaped(bracket + unit)


def _cell(text: str) -> str:
    """`(1.93 ± 0.12)e7` as $(1.93 \\pm 0.12) \\times 10^{7}$; words stay words."""
    if text == ABSENT:
        return "--"
    if not (found := NUMBER.match(text)):
        return _escaped(text)
    number = POWER.sub(lambda power: rf" \times 10^{{{int(power[1])}}}", found[0])
    number = number.replace("±", r"\pm").replace("…", r"\ldots")
    return f"${number}${_escaped(text[found.end() :])}"


def _escaped(text: str) -> str:
    return SPECIAL.sub(r"\\\1", text)
