"""`report.md`: what was fitted to what, how well it is known, and what to doubt."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from calibration.fitting.assembly import label_of_law
from calibration.report import rows
from calibration.report.bodies import bodies_table
from calibration.report.tables import code, escaped, markdown, prose
from calibration.rounding import number

OBJECTIVES = {
    "two-step": (
        "σ and ψ from Eq. (17) against all points, then χ̃ from the law with them held (`two-step`)"
    ),
    "model": "the law against all points, all parameters at once (`model`)",
}


def markdown_report(
    result: Any,
    pictures: Mapping[str, str] | None = None,
    command: str = "",
    printed: rows.Printed | None = None,
    more: Sequence[Sequence[str]] = (),
) -> str:
    """The report as Markdown text.

    Args:
        result: a `FitResult`.
        pictures: {caption: file beside the report}.
        command: how the fit was asked for.
        printed: published values to stand beside the fitted ones.
        more: further blocks of lines, before the doubts.
    """
    blocks = [
        ["# Coefficients of restitution, fitted"],
        [doubt_item(one) for one in result.warnings if one.code == "plausibility"],
        _verdict(result),
        _what(result),
        *_bodies(result),
        ["## Parameters"],
        markdown(*rows.parameter_table(result, printed)[:2]),
        _listed("", map(escaped, rows.meanings(result))),
        _listed("Said before the fit:", map(escaped, rows.told(result))),
        _intervals(result),
        ["## How closely the curves follow"],
        markdown(*rows.quality_table(result)[:2]),
        _listed("", rows.quality_words(result)),
        *([line] for line in _pictures(pictures)),
        *_unloading_line(result),
        *more,
        ["## Doubts"],
        _doubts(result),
        ["## How it was computed"],
        _settings(result, command),
        markdown(*rows.optimiser_table(result)[:2]),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def _verdict(result: Any) -> list[str]:
    if not result.converged:
        return ["**The fit did not converge. Its values are not to be used.**"]
    count = len(result.warnings)
    if not count:
        return ["The fit converged, and no doubts were raised."]
    told = "1 doubt below qualifies" if count == 1 else f"{count} doubts below qualify"
    return [f"The fit converged; {told} it."]


def _what(result: Any) -> list[str]:
    lines = []
    for fit in result.materials:
        low, high = min(fit.data.velocity), max(fit.data.velocity)
        text = f"- **{escaped(fit.name)}**: {fit.n} impacts at {low:.4g} to {high:.4g} m/s, "
        law = f"; {escaped(label_of_law(fit.model))}: {OBJECTIVES[fit.objective]}."
        groups = f" in {len(fit.data.groups)} groups" * bool(fit.data.groups)
        lines.append(text + _uncertainty(fit.data) + groups + law)
        if not (fit.known_from == 0 and fit.known_to == math.inf):
            lines.append(f"  Nothing is known of the curve {_unknown(fit)}.")
    return lines + [f"- {prose(note)}" for note in rows.notes(result)]


def _bodies(result: Any) -> list[list[str]]:
    """What was measured; nothing where no contact is known."""
    if all(fit.data.contact is None for fit in result.materials):
        return []
    return [["## Bodies"], markdown(*bodies_table(result)[:2])]


def _unknown(fit: Any) -> str:
    """Where no points tell of the curve."""
    if fit.known_from > 0:
        return f"below the critical velocity, {fit.known_from:.4g} m/s: no points are there"
    return f"above the critical velocity, {fit.known_to:.4g} m/s: no points are there"


def _uncertainty(data: Any) -> str:
    if data.uncertainty is None:
        return "no uncertainty stated (it is taken from the scatter)"
    low, high = min(data.uncertainty), max(data.uncertainty)
    shown = number(low, 2) if low == high else f"{number(low, 2)} to {number(high, 2)}"
    return f"uncertainty of the restitution {shown}"


def _intervals(result: Any) -> list[str]:
    used = rows.used_methods(result)
    head = (
        f"Intervals hold {100 * result.confidence:g} % of true values where the law is right; "
        "ν are the degrees of freedom of Student's t where the noise was found from the residuals:"
    )
    return _listed(head, [f"{name}: {text}." for name, text in used.items()])


def _listed(head: str, lines: Iterable[str]) -> list[str]:
    items = [f"- {line}" for line in lines]
    return [head, "", *items] if items and head else items


def _pictures(pictures: Mapping[str, str] | None) -> Iterable[str]:
    return [f"![{caption}]({file})" for caption, file in (pictures or {}).items()]


def _unloading_line(result: Any) -> list[list[str]]:
    line = result.unloading_line
    if line is None:
        return []
    how = "fitted to all curves at once" if line.method == "curves" else "through the fitted χ̃"
    text = (
        f"One line for all materials, {how}. Its χ̃ follow the data less closely than a χ̃ for each "
        "material: the rms of both is in the table above."
    )
    mark = [] if line.converged else [["**The line's fit did not converge.**"]]
    return [
        ["## One line for all materials, Eq. (18)"],
        [text],
        markdown(*rows.line_table(result)[:2]),
        *mark,
    ]


def _doubts(result: Any) -> list[str]:
    if not result.warnings:
        return ["None."]
    return [doubt_item(doubt) for doubt in result.warnings]


def doubt_item(doubt: Any) -> str:
    """A doubt in a list."""
    owner = f" ({escaped(doubt.material)})" if doubt.material else ""
    return f"- **{doubt.code}**{owner}: {prose(doubt.cause)}. *{prose(doubt.remedy)}*"


def _settings(result: Any, command: str) -> list[str]:
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    first = [f"{code(command)}, with"] if command else []
    condition = result.condition_number
    condition = "infinite" if condition is None else number(condition, 2)
    return [
        *first,
        f"{escaped(rows.settings_line(result))}.",
        f"Rank {result.rank} of {len(result.covariance_names)} free parameters, condition number "
        f"{condition}. {escaped(versions)}.",
    ]
