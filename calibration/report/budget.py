"""The uncertainty budget as a table, sentences, and what a fit says of inputs that it took as exact."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from calibration import symbols
from calibration.fitting.elements import DRAG
from calibration.report.layout import Block
from calibration.rounding import number

DOMINATES = 0.5  # share of a variance from which on one part is said to be most of it
LEAST_MOVE = 0.1  # per cent of a result; what 1 % of an input moves by less is left out
MOST_NAMED = 3
FEW_NAMED = 2  # on a terminal
AT = 3  # velocities at which ε is in the table
STATISTICAL = "statistical"
NO_SHARE = 1e-6  # of a variance: less is written as 0
LETTERS = {"youngs_modulus": "E", "poisson_ratio": "ν", "density": "ρ", "yield_strength": "Y"}
LETTERS |= {"radius": "R", "mass": "M", "diameter": "the diameter"}


def lettered(name: str) -> str:
    """An input as a letter: "Y of the wall"."""
    owner, _, key = name.rpartition(".")
    of = {"wall": " of the wall", "second": " of the second sphere", "contact": " of the pair"}
    return LETTERS.get(key, key.replace("_", " ")) + of.get(owner, "")


def curve_points(result: Any) -> Iterator[tuple[Any, np.ndarray]]:
    """Each fit with velocities of its data at which ε is in the table: the lowest, the middle and the highest."""
    for fit in result.materials:
        velocity = fit.data.velocity[fit.determined(fit.data.velocity)]
        if velocity.size:
            ends = float(np.min(velocity)), float(np.max(velocity))
            yield fit, np.unique(np.geomspace(*ends, AT))


def budget_table(result: Any) -> pd.DataFrame:
    """A row for each input: value ± u, what it contributes to each free parameter and to ε, shares.

    Contributions have the unit of the result, with their share of the variance in per cent.
    """
    budget = result.budget
    labels = _labels(result)
    columns: dict[str, list[str]] = {
        "input": [symbols.input_words(p.name).removeprefix("the ") for p in budget.inputs]
        + [STATISTICAL],
        "value ± u": [_stated(p) for p in budget.inputs] + [""],
    }
    for label in labels:
        parts = np.array([p.of(label) for p in budget.inputs])
        columns[symbols.of_label(label, result)] = _with_shares(parts, budget.statistical[label])
    for fit, velocity in curve_points(result):
        changes = budget.curve_moves(fit, velocity)
        halves = 0.5 * (changes[:, 0] - changes[:, 1])
        combined = result.band(velocity, fit.name).standard_error ** 2
        of_points = np.sqrt(np.maximum(combined - np.sum(halves**2, axis=0), 0.0))
        owner = "" if len(result.materials) == 1 else f" {fit.name}"
        for k, v in enumerate(velocity):
            columns[f"ε({v:.3g} m/s){owner}"] = _with_shares(halves[:, k], of_points[k])
    table = pd.DataFrame(columns)
    order = np.argsort(-_largest_shares(budget, labels), kind="stable")
    return table.iloc[[*order, len(budget.inputs)]].reset_index(drop=True)


def _stated(part: Any) -> str:
    unit = "" if part.unit == "1" else f" {part.unit}"
    relative = f" ({number(100 * part.uncertainty / abs(part.value), 2)} %)" if part.value else ""
    return f"{number(part.value, 4)} ± {number(part.uncertainty, 2)}{unit}{relative}"


def _with_shares(parts: np.ndarray, statistical: float | None) -> list[str]:
    """ "+0.025 (12 %)" of each part, and of the points."""
    known = statistical is not None and np.isfinite(statistical)
    total = np.sum(parts**2) + (statistical**2 if known else 0.0)  # type: ignore[operator]
    texts = []
    for part in [*parts, statistical if known else np.nan]:
        share = part**2 / total if total > 0 else 0.0
        text = "–" if not np.isfinite(part) else f"{number(float(part), 2)} ({_percent(share)})"
        texts.append("0" if share < NO_SHARE else text.replace("below ", "< "))
    return texts


def _labels(result: Any) -> list[str]:
    """Free parameters of the laws, without the error of the drag coefficient, which has its prior."""
    names = (name for name in result.covariance_names if name.partition("[")[0] != DRAG)
    return [name for name in names if name in result.budget.values]


def _percent(share: float) -> str:
    part = 100 * share
    return "below 0.01 %" if part < 0.01 else f"{part:.0f} %" if part >= 10 else f"{part:.2g} %"


def _largest_shares(budget: Any, labels: list[str]) -> np.ndarray:
    shares = [budget.shares(label) for label in labels]
    return np.array([max((s[p.name] for s in shares), default=0.0) for p in budget.inputs])


def budget_sentences(result: Any) -> list[str]:
    """Sentences about what dominates each parameter, and which inputs act on one side more than on the other."""
    budget, lines, of_points = result.budget, [], []
    for label in _labels(result):
        name, share = next(iter(budget.shares(label).items()))
        letter = symbols.of_label(label, result)
        if name == STATISTICAL:
            of_points.append((letter, 1 - share))
        elif share >= DOMINATES:
            lines.append(
                f"{_percent(share)} of the variance of {letter} is {symbols.input_words(name)}"
            )
    if of_points:
        letters, shares = zip(*of_points, strict=True)
        most = f"at most {_percent(max(shares))} of the variance of {' and '.join(letters)}"
        lines.append(f"uncertain inputs are {most}; the rest is the scatter of the points")
    for name, labels in budget.not_linear.items():
        moved = ", ".join(dict.fromkeys(symbols.of_label(label, result) for label in labels))
        lines.append(
            f"{symbols.input_words(name).removeprefix('the ')} moves {moved} farther to one side than to the other: the interval "
            "follows each side, the standard error their mean"
        )
    for part in budget.inputs:
        if part.refused is not None:
            lines.append(
                f"{symbols.input_words(part.name).removeprefix('the ')} could not be moved both ways: {part.refused}"
            )
    return lines


def exact_sentence(result: Any, brief: bool = False) -> str | None:
    """That nothing is stated of the inputs, and by how much 1 % of those that matter moves a parameter.

    Args:
        brief: with fewer of those.
    """
    if result.budget is not None:
        return None
    effects, most = result.of_one_per_cent, FEW_NAMED if brief else MOST_NAMED
    moves = [
        (abs(change), lettered(name), symbols.of_label(label, result), change)
        for name, of_results in effects.items()
        for label, change in of_results.items()
        if label in result.covariance_names
        and not label.startswith(DRAG)
        and abs(change) >= LEAST_MOVE
    ]
    if not moves:
        return None
    first = next(label for *_, label, _ in sorted(moves, reverse=True))
    ranked = sorted((entry for entry in moves if entry[2] == first), reverse=True)[:most]
    (_, letter, _, change), *others = ranked
    parts = [f"1 % of {letter} moves {first} by {abs(change):.1f} %"]
    parts += [f"of {letter} by {abs(change):.1f} %" for _, letter, _, change in others]
    exact = ", ".join(dict.fromkeys(LETTERS.get(n.rpartition(".")[2], n) for n in effects))
    head, _, last = exact.rpartition(", ")
    taken = f"{head} and {last}" if head else last
    return f'{taken} are taken as exact; {", ".join(parts)}: state them ("115 ± 5 GPa") to have them in the interval'


def budget_blocks(result: Any, brief: bool) -> list[Block]:
    """The budget of a fit; no block without one."""
    if result.budget is None:
        return []
    lines = budget_sentences(result)
    listed = [Block("list", lines)] if lines else []
    return listed if brief else [Block("table", budget_table(result)), *listed]
