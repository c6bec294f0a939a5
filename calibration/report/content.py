"""What a report of a fit says, once for the terminal, Markdown and HTML."""

import datetime
import math
from collections.abc import Mapping
from typing import Any

from calibration import symbols
from calibration.fitting.assembly import label_of_law
from calibration.fitting.specs import said_of
from calibration.parameters import Parameter
from calibration.report import tables
from calibration.rounding import number

MOST = 3  # data sets that the first sentence names one by one
OBJECTIVES = {
    "two-step": (
        "σ and ψ from Eq. (17) against all points, then χ̃ from the law with them fixed (`two-step`)"
    ),
    "model": "the law against all points, all parameters at once (`model`)",
}
LINE = (
    "One line for all materials, {}. Its χ̃ follow the data less closely than a χ̃ for each "
    "material: the rms of both is in the table above."
)
LINE_METHODS = {"curves": "fitted to all curves at once", "weighted": "through the fitted χ̃"}


def content(
    result: Any,
    pictures: Mapping[str, str] | None = None,
    command: str = "",
    printed: tables.Printed | None = None,
    posterior: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The sentences and tables of a report, by the names that the templates use.

    Args:
        result: a `FitResult`.
        pictures: {caption: file beside the report}.
        command: the command that makes the same results again.
        printed: published values to stand beside the fitted ones.
        posterior: `posterior.section` of draws.
    """
    line, count = result.unloading_line, len(result.warnings)
    condition = result.condition_number
    converged = "The fit converged without warnings."
    if count:
        converged = f"The fit converged with {count} warning{'s' * (count > 1)}."
    return {
        "title": "Coefficients of restitution, fitted",
        "result": result_sentence(result),
        "verdict": converged if result.converged else None,
        "date": datetime.date.today().isoformat(),
        "versions": ", ".join(f"{name} {version}" for name, version in result.versions.items()),
        "implausible": [one for one in result.warnings if one.code == "plausibility"],
        "data": [_data_set(fit) for fit in result.materials],
        "notes": notes(result),
        "bodies": tables.bodies_table(result),
        "parameters": tables.parameter_table(result, printed),
        "meanings": meanings(result),
        "stated": stated(result),
        "confidence": f"{100 * result.confidence:g} %",
        "methods": tables.interval_methods(result),
        "quality": tables.quality_table(result),
        "quality_words": quality_words(result),
        "pictures": pictures or {},
        "line": None if line is None else tables.line_table(result),
        "line_converged": line is None or line.converged,
        "line_words": "" if line is None else LINE.format(LINE_METHODS[line.method]),
        "posterior": posterior,
        "warnings": result.warnings,
        "command": command,
        "settings": settings_line(result),
        "rank": result.rank,
        "free": len(result.covariance_names),
        "condition": "infinite" if condition is None else number(condition, 2),
        "searches": tables.search_table(result),
    }


def result_sentence(result: Any) -> str:
    """The fit in one sentence: law, data, fitted values and how closely the curve follows."""
    laws = dict.fromkeys(label_of_law(fit.model) for fit in result.materials)
    impacts = sum(fit.n for fit in result.materials)
    law = f"{' and '.join(laws)} fitted to {impacts} impacts"
    count = len(result.materials)
    if count > MOST:
        return f"{law} of {count} data sets."
    parts = []
    for fit in result.materials:
        values = [
            f"{symbols.symbol(name, fit.model).text} = {tables.estimate_text(one)}"
            + (f" {unit}" if (unit := symbols.symbol(name, fit.model).unit) else "")
            for name, one in fit.parameters.items()
            if one.free
        ]
        values += [f"{tree.size} numbers of {tree.name}" for tree in fit.trees]
        owner = f"on {fit.name}: " if count == 1 else f"{fit.name}, "
        parts.append(owner + ", ".join([*values, f"rms {number(fit.rms)}"]))
    return f"{law}{' ' if count == 1 else ': '}{'; '.join(parts)}."


def meanings(result: Any) -> list[str]:
    """What the symbols of the parameters stand for."""
    found = {}
    for fit in result.materials:
        for name in {**fit.parameters, **fit.derived}:
            if words := symbols.words(name, fit.model):
                found[symbols.symbol(name, fit.model).text] = words
    return [f"{symbol}: {words}" for symbol, words in found.items()]


def stated(result: Any) -> list[str]:
    """Priors, bounds and sharing that were stated before the fit."""
    found: dict[str, list[str]] = {}
    own = said_of(result.request.parameters, result.request.datasets)
    for fit, parameters in zip(result.materials, own, strict=True):
        for name, parameter in parameters.items():
            if isinstance(parameter, Parameter) and (words := _stated(parameter)):
                symbol = symbols.text(fit.model.canonical(name), fit.model)
                found.setdefault(f"{symbol}: {words}", []).append(fit.name)
    return _with_owners(result, found, "{text} ({names})")


def notes(result: Any) -> list[str]:
    """What was noticed about the data, each once."""
    found: dict[str, list[str]] = {}
    for fit in result.materials:
        for note in fit.data.notes:
            found.setdefault(note, []).append(fit.name)
    return _with_owners(result, found, "{names}: {text}")


def quality_words(result: Any) -> list[str]:
    """What the columns of the table of goodness of fit are."""
    header = tables.quality_table(result).columns
    words = [f"{name}: {text}" for name, text in tables.QUALITY.items() if name in header]
    return words + outlier_lines(result)


def outlier_lines(result: Any) -> list[str]:
    """The points that the noise does not explain, one a line."""
    several = len(result.materials) > 1
    return [
        (f"outlier, {fit.name}: " if several else "outlier: ") + str(one)
        for fit in result.materials
        for one in fit.outliers
    ]


def settings_line(result: Any) -> str:
    """The settings of a fit in one line."""
    settings, options = result.settings, result.request.options
    known = ("law", "objective", "optimiser", "route", "noise", "noise_dof", "form", "kappa", "end")
    names = [name for name in (*known, "starts", "seed") if settings.get(name) is not None]
    parts = [f"{name.replace('_', ' ')} {settings[name]}" for name in names]
    parts += ["scatter beside the stated uncertainties"] * options.extra_scatter
    parts += ["stated uncertainties right up to a factor"] * options.scale_uncertainty
    return ", ".join(parts)


def _data_set(fit: Any) -> dict[str, str]:
    """Where a data set came from, what was measured, and where its curve is not determined."""
    data, origin = fit.data, fit.data.origin
    low, high = min(data.velocity), max(data.velocity)
    text = f"{fit.n} impacts at {low:.4g} to {high:.4g} m/s, "
    if data.uncertainty is None:
        text += "no uncertainty stated (it is estimated from the scatter)"
    else:
        least, most = min(data.uncertainty), max(data.uncertainty)
        shown = number(least, 2) if least == most else f"{number(least, 2)} to {number(most, 2)}"
        text += f"uncertainty of the restitution {shown}"
    if data.groups:
        text += f" in {len(data.groups)} groups"
    text += "" if origin is None else f", from {origin.file}"
    below, above = fit.known_from > 0, fit.known_to < math.inf
    side, at = ("below", fit.known_from) if below else ("above", fit.known_to)
    unknown = f"The data do not constrain the curve {side} the critical velocity, {at:.4g} m/s."
    return {
        "name": fit.name,
        "text": text,
        "law": f"{label_of_law(fit.model)}: {OBJECTIVES[fit.objective]}",
        "unknown": unknown if below or above else "",
    }


def _stated(parameter: Parameter) -> str:
    parts = []
    if parameter.prior is not None:
        parts.append("prior {:.4g} ± {:.4g}".format(*parameter.prior))
    if parameter.bounds is not None:
        parts.append("between {:.4g} and {:.4g}".format(*parameter.bounds))
    if parameter.pooled:
        parts.append("around a common mean, with a spread (of ln θ where θ is positive)")
    elif parameter.shared:
        group = "all" if parameter.shared is True else f"the group {parameter.shared}"
        parts.append(f"one value for {group}")
    return ", ".join(parts)


def _with_owners(result: Any, found: Mapping[str, list[str]], form: str) -> list[str]:
    """Texts with the names of the data sets that each is about, where these are not all."""
    every = len(result.materials)
    return [
        text if len(names) == every else form.format(text=text, names=", ".join(names))
        for text, names in found.items()
    ]
