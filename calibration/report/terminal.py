"""A fit on a terminal, of 100 columns or what there are."""

from collections.abc import Iterable
from typing import Any

from calibration.console import wrapped
from calibration.report import rows
from calibration.report.tables import aligned
from calibration.rounding import number

MOST_SEARCHES = 12  # that are told one by one


def terminal_report(result: Any, printed: rows.Printed | None = None, intro: str = "") -> str:
    """Tables of a fit: parameters, how closely it follows, Eq. (18), times, doubts.

    Args:
        result: a `FitResult`.
        printed: published values to stand beside the fitted ones, {material: {parameter: value}}.
        intro: what the reader must know of the data before anything else.
    """
    blocks = [
        wrapped(intro.splitlines() or rows.notes(result)),
        wrapped([rows.settings_line(result)]),
        _laid_out(rows.parameter_table(result, printed)),
        _explained([*rows.meanings(result), *rows.told(result), *_intervals(result)]),
        _laid_out(rows.quality_table(result)),
        _explained(rows.quality_words(result)),
        _line(result),
        _searches(result),
        doubts(result),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def doubts(result: Any) -> list[str]:
    """The warnings, each with its cause and remedy; whether the fit converged."""
    lines = [] if result.converged else ["NOT CONVERGED: do not use these values."]
    if not result.warnings:
        return [*lines, "No doubts were raised."]
    lines.append("Doubts:")
    return lines + wrapped(map(str, result.warnings), "  ! ", "    ")


def _explained(lines: Iterable[str]) -> list[str]:
    return wrapped(lines, "  ", "    ")


def _intervals(result: Any) -> list[str]:
    return [f"{name} interval: {text}" for name, text in rows.used_methods(result).items()]


def _laid_out(table: rows.Table) -> list[str]:
    return aligned(table.header, table.rows, table.right) if table.rows else []


def _searches(result: Any) -> list[str]:
    """What each search took; of very many the sums."""
    stages = result.optimiser_report
    if len(stages) <= MOST_SEARCHES:
        return _laid_out(rows.optimiser_table(result))
    seconds = sum(result.times.get(stage.label, 0.0) for stage in stages)
    evaluations = sum(stage.evaluations for stage in stages)
    return [f"{len(stages)} searches, {evaluations} evaluations, {number(seconds, 2)} s"]


def _line(result: Any) -> list[str]:
    line = result.unloading_line
    if line is None:
        return []
    return _laid_out(rows.line_table(result)) + ["NOT CONVERGED"] * (not line.converged)
