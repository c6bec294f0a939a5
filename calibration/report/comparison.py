"""A comparison of laws as a table, as text for a terminal, and as JSON."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from calibration import symbols
from calibration.data.json_file import dumps
from calibration.fitting.warnings import OTHER_LAWS
from calibration.report.fit import estimate_text
from calibration.report.layout import Block, Item, terminal
from calibration.rounding import ABSENT, number

WHOLE = 1000  # elpd, AIC and BIC from here on are rounded to whole numbers
EXPLAINED = (
    "Sorted by elpd, the expected log predictive density: each point predicted by the fit without "
    "it. Δelpd: the difference to the best and its standard error, a tie below two of them. "
    "Weight: in the mixture of laws that predicts best. LOO rms: rms of the predictions of points "
    "left out. k: fitted parameters."
)


def comparison_text(
    comparisons: Sequence[Any],
    remarks: Sequence[str] = (),
    causes: str = "comparison.entry(law).warnings",
) -> str:
    """Everything that a terminal shows of some `Comparison`s.

    Args:
        remarks: lines about all of them.
        causes: where the causes of warnings are found; in Python unless stated.
    """
    common = [n for n in comparisons[0].notes if all(n in other.notes for other in comparisons)]
    blocks = [Block("text", "\n".join([*common, *remarks, EXPLAINED]))]
    for one in comparisons:
        data, groups = one.data, len(one.data.groups)
        span = f"{number(min(data.velocity), 3)} to {number(max(data.velocity), 3)} m/s"
        together = f", {groups} groups, each left out together" if groups else ""
        parameters, own = parameter_table(one), list(_remarks(one, common))
        blocks += [
            Block("text", f"{data.name}: {len(data)} points, {span}{together}"),
            Block("table", ranking_table(one)),
            *([] if parameters.empty else [Block("table", parameters)]),
            *([Block("text", "\n".join(own))] if own else []),
            Block("warnings", _warnings(one)),
        ]
    if any(entry.warnings for one in comparisons for entry in one.entries):
        blocks.append(Block("text", f"The causes of warnings are in {causes}."))
    return terminal(blocks)


def ranking_table(comparison: Any) -> pd.DataFrame:
    """The laws, the best first, with their scores as rounded text."""
    return pd.DataFrame(
        {
            "law": entry.label + ("" if entry.converged else " (NOT CONVERGED)"),
            "elpd": _score(None if entry.is_exact else entry.leave_one_out.elpd),
            "Δelpd": _difference(entry.behind),
            "weight": number(entry.weight) if entry.weight is None else f"{entry.weight:.2f}",
            "LOO rms": number(entry.leave_one_out.rms, 3),
            "rms": number(entry.result.rms, 3),
            "AIC": _score(entry.result.aic),
            "BIC": _score(entry.result.bic),
            "k": str(entry.fitted),
        }
        for entry in comparison.entries
    )


def parameter_table(comparison: Any) -> pd.DataFrame:
    """What was fitted of each law, with errors and units; numbers of networks counted."""
    rows = []
    for entry in comparison.entries:
        fit = entry.result.material()
        fitted = []
        for name, estimate in fit.parameters.items():
            one = symbols.symbol(name, fit.model)
            if estimate.free:
                fitted.append(f"{one.text} {estimate_text(estimate)} {one.unit}".rstrip())
        fitted += [f"{tree.size} numbers of {tree.name}" for tree in fit.trees]
        if fitted:
            rows.append({"law": entry.label, "fitted": ", ".join(fitted)})
    return pd.DataFrame(rows)


def comparison_json(comparisons: Sequence[Any], settings: Mapping[str, Any]) -> str:
    """The whole of them; what is undefined is null."""
    table = {
        "comparisons": [_as_dict(one) for one in comparisons],
        "settings": dict(settings),
        "versions": comparisons[0].entries[0].result.versions,
    }
    return dumps(table)


def _score(value: float | None) -> str:
    """To tenths, large scores to whole numbers."""
    if value is None:
        return ABSENT
    return f"{round(value, 1) + 0.0:.1f}" if abs(value) < WHOLE else f"{value:.0f}"


def _difference(behind: Any) -> str:
    if behind is None:
        return ABSENT
    if behind == (0.0, 0.0):
        return "best"
    return f"{_score(behind.value)} ± {_score(behind.standard_error)}" + " tie" * behind.is_tie


def _remarks(one: Any, common: Sequence[str]) -> Iterable[str]:
    """What holds for this data set alone, and which curves are alike."""
    yield from (note for note in one.notes if note not in common)
    for first in one.ranking:
        alike = [entry.label for entry in one.entries if entry.same_as == first]
        if alike:
            yield f"The same curve as {first}: {'; '.join(alike)}. They share its weight."
    yield from (f"Left out: {why}." for why in one.left_out)


def _warnings(one: Any) -> list[Item]:
    """Each kind of warning once, with the laws that have it."""
    laws: dict[str, dict[str, None]] = {}
    advice = {}
    for entry in one.entries:
        for warning in entry.warnings:
            laws.setdefault(warning.code, {})[entry.label] = None
            advice[warning.code] = symbols.written(_advice(warning))
    return [Item(code, f": {'; '.join(names)}.", advice[code]) for code, names in laws.items()]


def _advice(warning: Any) -> str:
    """Without the advice to compare laws, which is what was done."""
    return warning.advice.replace(f" ({OTHER_LAWS})", "").replace(f" {OTHER_LAWS}.", "")


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
    scored = not entry.is_exact
    return {
        "law": entry.key,
        "label": entry.label,
        "options": dict(fit.model.options),
        "elpd": left_out.elpd if scored else None,
        "elpd_standard_error": left_out.elpd_se if scored else None,
        "delta_elpd": behind and behind.value,
        "delta_elpd_standard_error": behind and behind.standard_error,
        "tie": behind and behind.is_tie,
        "weight": entry.weight,
        "rms_leave_one_out": left_out.rms,
        "refitted": left_out.exact,
        **{name: getattr(entry.result, name) for name in ("rms", "aic", "bic")},
        "fitted_parameters": entry.fitted,
        "converged": entry.converged,
        "same_curve_as": entry.same_as,
        "parameters": {
            name: {n: getattr(e, n) for n in ("value", "standard_error", "free")}
            | {"unit": symbols.symbol(name, fit.model).unit}
            for name, e in fit.parameters.items()
        },
        "remark": entry.candidate.remark,
        "warnings": [
            {"code": w.code, "cause": w.cause, "advice": _advice(w)} for w in entry.warnings
        ],
    }
