"""A comparison as tables for a terminal, and as JSON."""

import importlib.metadata
import json
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from calibration.compare.entries import Entry, Value
from calibration.compare.ranking import Ranking
from calibration.report import symbols
from calibration.report.rounding import ABSENT, number, with_error
from calibration.report.tables import aligned

WIDTH = 100
HEADER = ("law", "left out", "rms", "AICc", "k", "fitted")
EXPLAINED = (
    "Sorted by the leave-one-out rms (left out): each point predicted by a fit without it. "
    "k: fitted parameters; AICc counts the variance as one more."
)
PACKAGES = ("softjax-contact", "jax", "diffrax", "numpy", "scipy")
NAMES = {
    "restitution, zero-force end": "ε_in (zero-force end)",
    "stiffness_ratio": "k2/k1",
    "growth_per_velocity": "growth",
    "dissipation_time": "A",
    "yield_factor": "p_y/Y",
}


def comparison_text(rankings: Iterable[Ranking], remarks: Sequence[str] = ()) -> str:
    """Everything that a terminal shows of a comparison."""
    rankings = list(rankings)
    common = [one for one in rankings[0].notes if all(one in other.notes for other in rankings)]
    blocks = [_wrapped([*common, *remarks, EXPLAINED])]
    for ranking in rankings:
        about = _about(ranking, common)
        blocks += [_title(ranking), ranking_table(ranking), about, _doubts(ranking)]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def ranking_table(ranking: Ranking) -> list[str]:
    """Lines of one ranking's table."""
    return aligned(HEADER, map(_row, ranking.entries), right=(1, 2, 3, 4))


def comparison_json(rankings: Sequence[Ranking], settings: Mapping[str, Any]) -> str:
    """The whole comparison; what is undefined is null."""
    table = {
        "comparisons": [_ranking_dict(ranking) for ranking in rankings],
        "settings": dict(settings),
        "versions": {name: importlib.metadata.version(name) for name in PACKAGES},
    }
    return json.dumps(table, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _title(ranking: Ranking) -> list[str]:
    velocity = ranking.data.velocity
    span = f"{number(min(velocity), 3)} to {number(max(velocity), 3)} m/s"
    return [f"{ranking.data.name}: {len(velocity)} points, {span}"]


def _row(entry: Entry) -> list[str]:
    errors = number(entry.rms_leave_one_out, 3), number(entry.rms, 3)
    criterion = ABSENT if entry.aicc is None else f"{entry.aicc:.1f}"
    label = entry.candidate.label + ("" if entry.converged else " (NOT CONVERGED)")
    return [label, *errors, criterion, str(entry.fitted), _parameters(entry)]


def _parameters(entry: Entry) -> str:
    """The parameters that were fitted; of a law with another's curve the first of its own."""
    shown = list(entry.parameters.items())[: 1 if entry.candidate.same_as else None]
    return ", ".join(_parameter(name, value) for name, value in shown) or ABSENT


def _parameter(name: str, value: Value) -> str:
    text = (
        f"{NAMES.get(name) or symbols.text(name)} {with_error(value.value, value.standard_error)}"
    )
    return text + (f" {value.unit}" if value.unit else "")


def _about(ranking: Ranking, told: Sequence[str]) -> list[str]:
    """What holds for all of a data set and was not told yet, and which curves are alike."""
    alike = [e.candidate.label for e in ranking.entries if e.candidate.same_as]
    lines = [note for note in ranking.notes if note not in told]
    if alike:
        lines.append(f"The curve of the constant ε again, not fitted twice: {'; '.join(alike)}.")
    lines += [f"Left out: {why}." for why in ranking.left_out]
    return _wrapped(lines)


def _doubts(ranking: Ranking) -> list[str]:
    """Each kind of doubt once, with the laws that have it."""
    by_code: dict[str, list[str]] = {}
    remedies = {}
    for entry in ranking.entries:
        for code in dict.fromkeys(doubt.code for doubt in entry.doubts):
            by_code.setdefault(code, []).append(entry.candidate.label)
        remedies |= {doubt.code: doubt.remedy for doubt in entry.doubts}
    if not by_code:
        return ["No doubts were raised."]
    lines = ["Doubts (their causes are in compare.json):"]
    for code, labels in by_code.items():
        text = f"{code}: {'; '.join(labels)}. {remedies[code]}"
        lines += textwrap.wrap(text, WIDTH, initial_indent="  ! ", subsequent_indent="    ")
    return lines


def _wrapped(paragraphs: Iterable[str]) -> list[str]:
    return [line for text in paragraphs for line in textwrap.wrap(text, WIDTH)]


def _ranking_dict(ranking: Ranking) -> dict[str, Any]:
    return {
        "material": ranking.data.name,
        "n": len(ranking.data),
        "converged": ranking.converged,
        "notes": list(ranking.notes),
        "left_out": list(ranking.left_out),
        "ranking": [_entry_dict(entry) for entry in ranking.entries],
    }


def _entry_dict(entry: Entry) -> dict[str, Any]:
    candidate = entry.candidate
    return {
        "law": candidate.key,
        "label": candidate.label,
        "rms_leave_one_out": _finite(entry.rms_leave_one_out),
        "rms": _finite(entry.rms),
        "aicc": _finite(entry.aicc),
        "fitted_parameters": entry.fitted,
        "converged": entry.converged,
        "same_curve_as": candidate.same_as,
        "parameters": {name: _value_dict(value) for name, value in entry.parameters.items()},
        "remark": candidate.remark,
        "doubts": [
            {"code": doubt.code, "cause": doubt.cause, "remedy": doubt.remedy}
            for doubt in entry.doubts
        ],
    }


def _value_dict(value: Value) -> dict[str, Any]:
    return {
        "value": _finite(value.value),
        "standard_error": _finite(value.standard_error),
        "unit": value.unit,
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
