"""A comparison of laws as tables for a terminal, and as JSON."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from calibration.console import wrapped
from calibration.data.json_file import dumps
from calibration.errors import printable
from calibration.fitting.doubt import OTHER_LAWS
from calibration.report import symbols
from calibration.report.rows import estimate_text
from calibration.report.tables import aligned
from calibration.rounding import ABSENT, number

WHOLE = 1000  # scores from here on are told in whole numbers
HEADER = ("law", "elpd", "behind", "weight", "left out", "rms", "AIC", "BIC", "k")
EXPLAINED = (
    "Sorted by elpd, the expected log predictive density: each point predicted by the fit without "
    "it. Behind: the difference to the best and its standard error, a tie below two of them. "
    "Weight: in the mixture of laws that predicts best. Left out: rms of these predictions. "
    "k: fitted parameters."
)


def comparison_text(
    comparisons: Iterable[Any],
    remarks: Sequence[str] = (),
    causes: str = "comparison.entry(law).doubts",
) -> str:
    """Everything that a terminal shows of some `Comparison`s.

    Args:
        remarks: lines about all of them.
        causes: where the causes of doubts are found; in Python unless told.
    """
    comparisons = list(comparisons)
    common = [n for n in comparisons[0].notes if all(n in other.notes for other in comparisons)]
    blocks = [_wrapped([*common, *remarks, EXPLAINED])]
    for one in comparisons:
        blocks += [
            [_title(one), *_ranking(one)],
            _parameters(one),
            _about(one, common),
            _doubts(one, causes),
        ]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def comparison_json(comparisons: Sequence[Any], settings: Mapping[str, Any]) -> str:
    """The whole of them; what is undefined is null."""
    table = {
        "comparisons": [_as_dict(one) for one in comparisons],
        "settings": dict(settings),
        "versions": comparisons[0].entries[0].result.versions,
    }
    return dumps(table)


def _title(one: Any) -> str:
    velocity, groups = one.data.velocity, len(one.data.groups)
    span = f"{number(min(velocity), 3)} to {number(max(velocity), 3)} m/s"
    together = f", {groups} groups, each left out together" if groups else ""
    return f"{printable(one.data.name)}: {len(velocity)} points, {span}{together}"


def _ranking(one: Any) -> list[str]:
    rows = [_row(entry) for entry in one.entries]
    return aligned(HEADER, rows, right=tuple(range(1, len(HEADER))))


def _row(entry: Any) -> list[str]:
    left_out, result = entry.leave_one_out, entry.result
    return [
        entry.label + ("" if entry.converged else " (NOT CONVERGED)"),
        _score(None if entry.is_exact else left_out.elpd),
        _behind(entry.behind),
        ABSENT if entry.weight is None else f"{entry.weight:.2f}",
        number(left_out.rms, 3),
        number(result.rms, 3),
        _score(result.aic),
        _score(result.bic),
        str(entry.fitted),
    ]


def _score(value: float | None) -> str:
    """Tenths, as far as anybody reads them."""
    if value is None:
        return ABSENT
    return f"{round(value, 1) + 0.0:.1f}" if abs(value) < WHOLE else f"{value:.0f}"


def _behind(behind: Any) -> str:
    if behind is None:
        return ABSENT
    if behind == (0.0, 0.0):
        return "best"
    return f"{_score(behind.value)} ± {_score(behind.standard_error)}" + " tie" * behind.is_tie


def _parameters(one: Any) -> list[str]:
    rows = [(entry.label, _fitted(entry.result.material())) for entry in one.entries]
    return aligned(("law", "fitted"), [row for row in rows if row[1]])


def _fitted(fit: Any) -> str:
    """The parameters that were free, each with its error and unit; numbers of networks counted."""
    told = []
    for name, estimate in fit.parameters.items():
        if estimate.free:
            one = symbols.symbol(name, fit.model)
            told.append(
                f"{one.text} {estimate_text(estimate)}" + (f" {one.unit}" if one.unit else "")
            )
    told += [f"{tree.size} numbers of {tree.name}" for tree in fit.trees]
    return ", ".join(told)


def _about(one: Any, told: Sequence[str]) -> list[str]:
    """What holds for all of a data set and was not told yet, and which curves are alike."""
    lines = [note for note in one.notes if note not in told]
    for first in one.ranking:
        alike = [entry.label for entry in one.entries if entry.same_as == first]
        if alike:
            lines.append(f"The same curve as {first}: {'; '.join(alike)}. They share its weight.")
    return _wrapped([*lines, *(f"Left out: {why}." for why in one.left_out)])


def _doubts(one: Any, causes: str) -> list[str]:
    """Each kind of doubt once, with the laws that have it."""
    by_code: dict[str, list[str]] = {}
    for entry in one.entries:
        for code in dict.fromkeys(doubt.code for doubt in entry.doubts):
            by_code.setdefault(code, []).append(entry.label)
    if not by_code:
        return ["No doubts were raised."]
    remedies = {doubt.code: _remedy(doubt) for entry in one.entries for doubt in entry.doubts}
    lines = [f"Doubts (their causes are in {causes}):"]
    told = (f"{code}: {'; '.join(labels)}. {remedies[code]}" for code, labels in by_code.items())
    return lines + wrapped(told, "  ! ", "    ")


def _remedy(doubt: Any) -> str:
    """Without the advice to compare laws, which is what was done."""
    return doubt.remedy.replace(f" ({OTHER_LAWS})", "").replace(f" {OTHER_LAWS}.", "")


def _wrapped(paragraphs: Iterable[str]) -> list[str]:
    return wrapped(map(printable, paragraphs))


def _as_dict(one: Any) -> dict[str, Any]:
    return {
        "material": one.data.name,
        "n": len(one.data),
        "groups": len(one.data.groups) or None,
        "converged": one.converged,
        "notes": list(one.notes),
        "left_out": list(one.left_out),
        "ranking": [_entry_dict(entry) for entry in one.entries],
    }


def _entry_dict(entry: Any) -> dict[str, Any]:
    left_out, behind, fit = entry.leave_one_out, entry.behind, entry.result.material()
    return {
        "law": entry.key,
        "label": entry.label,
        "options": dict(fit.model.options),
        "elpd": None if entry.is_exact else left_out.elpd,
        "elpd_standard_error": None if entry.is_exact else left_out.elpd_se,
        "behind": None if behind is None else behind.value,
        "behind_standard_error": None if behind is None else behind.standard_error,
        "tie": None if behind is None else behind.is_tie,
        "weight": entry.weight,
        "rms_leave_one_out": left_out.rms,
        "refitted": left_out.exact,
        "rms": entry.result.rms,
        "aic": entry.result.aic,
        "bic": entry.result.bic,
        "fitted_parameters": entry.fitted,
        "converged": entry.converged,
        "same_curve_as": entry.same_as,
        "parameters": {
            name: {
                "value": e.value,
                "standard_error": e.standard_error,
                "unit": symbols.symbol(name, fit.model).unit,
                "free": e.free,
            }
            for name, e in fit.parameters.items()
        },
        "remark": entry.candidate.remark,
        "doubts": [
            {"code": doubt.code, "cause": doubt.cause, "remedy": _remedy(doubt)}
            for doubt in entry.doubts
        ],
    }
