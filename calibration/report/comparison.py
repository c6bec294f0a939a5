"""A comparison of laws as table, terminal text and JSON."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from calibration import symbols
from calibration.data.json_file import dumps
from calibration.fitting.warnings import OTHER_LAWS
from calibration.report.layout import Block, Item, terminal
from calibration.report.tables import fitted_texts
from calibration.rounding import ABSENT, number

WHOLE = 1000  # larger elpd, AIC and BIC are rounded to whole numbers
EXPLAINED = (
    "Sorted by elpd, the expected log predictive density: each point is predicted by the fit without "
    "it. Δelpd: difference to the best law ± its standard error; below 4, or below two standard errors, "
    "it is a tie. Weight: share in the mixture of laws that predicts best, which decides no tie. LOO rms: rms of the "
    "predictions of points left out. k: number of fitted parameters, unknown variances among them."
)


def comparison_text(
    comparisons: Sequence[Any],
    remarks: Sequence[str] = (),
    causes: str = "comparison.entry(law).warnings",
) -> str:
    """Terminal text of some `Comparison`s; `causes`: where those of warnings are found."""
    common = [n for n in comparisons[0].notes if all(n in other.notes for other in comparisons)]
    blocks = [Block("text", "\n".join([*common, *remarks, EXPLAINED]))]
    for comparison in comparisons:
        data, groups = comparison.data, len(comparison.data.groups)
        span = f"{number(min(data.velocity), 3)} to {number(max(data.velocity), 3)} m/s"
        together = f", {groups} groups, each left out together" if groups else ""
        parameters, lines = parameter_table(comparison), list(_remarks(comparison, common))
        blocks += [
            Block("text", f"{data.name}: {len(data)} points, {span}{together}"),
            Block("table", ranking_table(comparison)),
            *([] if parameters.empty else [Block("table", parameters)]),
            *([Block("text", "\n".join(lines))] if lines else []),
            Block("warnings", _warnings(comparison)),
        ]
    if any(entry.warnings for comparison in comparisons for entry in comparison.entries):
        blocks.append(Block("text", f"The causes of warnings are in {causes}."))
    return terminal(blocks)


def ranking_table(comparison: Any) -> pd.DataFrame:
    """Laws from best to worst, with their scores as rounded text."""
    return pd.DataFrame(
        {
            "law": entry.label + ("" if entry.converged else " (NOT CONVERGED)"),
            "elpd": _score(None if entry.is_exact else entry.leave_one_out.elpd),
            "Δelpd": _difference(entry.delta_elpd),
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
    """Fitted parameters of each law, with errors and units; of networks, the number of weights."""
    fits = {entry.label: entry.result.material() for entry in comparison.entries}
    fitted = {label: ", ".join(fitted_texts(fit)) for label, fit in fits.items()}
    return pd.DataFrame({"law": law, "fitted": text} for law, text in fitted.items() if text)


def comparison_json(comparisons: Sequence[Any], settings: Mapping[str, Any]) -> str:
    """JSON of some `Comparison`s; undefined numbers are null."""
    table = {
        "comparisons": [_as_dict(comparison) for comparison in comparisons],
        "settings": dict(settings),
        "versions": comparisons[0].entries[0].result.versions,
    }
    return dumps(table)


def _score(value: float | None) -> str:
    """Text with one decimal; large scores as whole numbers."""
    if value is None:
        return ABSENT
    return f"{value:z.1f}" if abs(value) < WHOLE else f"{value:.0f}"


def _difference(delta: Any) -> str:
    if delta is None:
        return ABSENT
    if delta == (0.0, 0.0):
        return "best"
    return f"{_score(delta.value)} ± {_score(delta.standard_error)}" + " tie" * delta.is_tie


def _remarks(comparison: Any, common: Sequence[str]) -> Iterable[str]:
    """Notes on this data set alone, and laws with equal curves."""
    yield from (note for note in comparison.notes if note not in common)
    for first in comparison.ranking:
        equal = [entry.label for entry in comparison.entries if entry.same_as == first]
        if equal:
            yield f"The same curve as {first}: {'; '.join(equal)}. They share its weight."
    yield from (f"Left out: {why}." for why in comparison.left_out)


def _warnings(comparison: Any) -> list[Item]:
    """Each warning code once, with the laws that have it."""
    laws: dict[str, dict[str, None]] = {}
    advice = {}
    for entry in comparison.entries:
        for warning in entry.warnings:
            laws.setdefault(warning.code, {})[entry.label] = None
            advice[warning.code] = symbols.written(_advice(warning))
    return [Item(code, f": {'; '.join(names)}.", advice[code]) for code, names in laws.items()]


def _advice(warning: Any) -> str:
    """Advice without the suggestion to compare laws."""
    return warning.advice.replace(f" ({OTHER_LAWS})", "")


def _as_dict(comparison: Any) -> dict[str, Any]:
    return {
        "material": comparison.data.name,
        "n": len(comparison.data),
        "groups": len(comparison.data.groups) or None,
        "converged": comparison.converged,
        "notes": list(comparison.notes),
        "left_out": list(comparison.left_out),
        "ranking": [_entry_dict(entry) for entry in comparison.entries],
    }


def _entry_dict(entry: Any) -> dict[str, Any]:
    left_out, delta, fit = entry.leave_one_out, entry.delta_elpd, entry.result.material()
    scored = not entry.is_exact
    return {
        "law": entry.key,
        "label": entry.label,
        "options": dict(fit.model.options),
        "elpd": left_out.elpd if scored else None,
        "elpd_standard_error": left_out.elpd_se if scored else None,
        "delta_elpd": delta and delta.value,
        "delta_elpd_standard_error": delta and delta.standard_error,
        "tie": delta and delta.is_tie,
        "weight": entry.weight,
        "rms_leave_one_out": left_out.rms,
        "folds": int(left_out.fold.max()) + 1,
        **{name: getattr(entry.result, name) for name in ("rms", "aic", "bic")},
        "fitted_parameters": entry.fitted,
        "converged": entry.converged,
        "same_curve_as": entry.same_as,
        "parameters": {
            name: {n: getattr(e, n) for n in ("value", "standard_error", "free")}
            | {"unit": symbols.symbol(name, fit.model).unit}
            for name, e in fit.parameters.items()
        },
        "remark": entry.remark,
        "warnings": [
            {"code": w.code, "cause": w.cause, "advice": _advice(w)} for w in entry.warnings
        ],
    }
