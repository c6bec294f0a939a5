"""The report of a fit: tables and sentences as blocks, and all files of a fit.

`estimates` returns numbers; the other tables contain rounded text.
"""

import datetime
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from calibration import symbols
from calibration.fitting.curves import modulus_by_times
from calibration.fitting.material import Estimate
from calibration.fitting.request import stated_parameters
from calibration.observables import OBSERVABLES, RESTITUTION
from calibration.output import files_into, write_text
from calibration.parameters import Parameter
from calibration.report.layout import Block, Item, markdown, page, terminal
from calibration.rounding import ABSENT, interval, number, with_error

Printed = Mapping[str, Mapping[str, float]]  # {material: {parameter: published value}}
MANY = 1000  # degrees of freedom: with more, Student's t counts as the normal distribution
MOST_NAMED = 3  # data sets that the first sentence describes one by one
MOST_SEARCHES = 12  # searches that are listed one by one
MOST_OUTLIERS = 10
MOST_GROUPS = 20  # rows of the table of their offsets
MISFIT = 0.1  # share of the points above which outliers are reported as a misfit
DETERMINED = 0.3  # of the prior's width, up to which draws determine a parameter
NOT_CONVERGED = "NOT CONVERGED: do not use these values."
OBJECTIVES = {
    "two-step": "σ and ψ from Eq. (17), then χ̃ from the law with them fixed (`two-step`)",
    "model": "all parameters at once from the likelihood of all points (`model`)",
}
LINE = (
    "One line for all materials, {}. Its χ̃ follow the data less closely than a χ̃ for each "
    "material; the table above has the rms of both."
)
LINE_OF_TWO = (
    "One line for both materials. Any two χ̃ lie on a line, so it follows the data as closely as "
    "they do; only a third material can test it."
)
LINE_METHODS = {  # a sentence, and the column of the table
    "curves": ("fitted to all curves at once", "through all curves"),
    "weighted": ("through the fitted χ̃", "through the fitted χ̃, weighted"),
}
METHODS = {
    "sandwich": (
        "from the stacked estimating equations of both steps of `two-step`, as the same noise "
        "enters both"
    ),
    "profile": "where the profile likelihood crosses its threshold; open if it never does",
    "wald": "from the standard error, on the scale of the search",
    "derived": "from the covariance of the fitted parameters",
}
CONFIDENCE = (
    "Intervals contain the true value in {:g} % of experiments, if the law is right. Where the noise "
    "is estimated, dof is the number of degrees of freedom of Student's t:"
)
NOT_JUDGED = "not checked, without profiles: whether standard errors describe the intervals"
QUALITY = {  # columns of the goodness of fit
    "dof": "degrees of freedom of the residuals",
    "scatter": "estimated standard deviation of one ε (under `two-step` about Eq. (17))",
    "between groups": "estimated standard deviation of the groups' offsets in ε",
    "of times [ms]": "estimated standard deviation of the times of bounces",
    "χ²/dof": "squared residuals over the stated variances, per degree of freedom",
    "factor": "by which the stated uncertainties were scaled, √(χ²/dof)",
    "P": "probability of a χ² at least as large if law and stated uncertainties hold",
}
PROPERTIES = {
    "youngs_modulus": "E [Pa]",
    "poisson_ratio": "ν",
    "density": "ρ [kg/m³]",
    "yield_strength": "Y [Pa]",
}
PICTURES = {
    "curves.png": "Data, fitted curves with their bands, and residuals below",
    "observables.png": "What else was measured, fitted curves with their bands, and residuals below",
    "profiles.png": "Profile likelihoods: the rise of χ² when one parameter is fixed elsewhere",
    "correlation.png": (
        "Correlations of the fitted parameters: ellipses of equal probability, blue and leaning right "
        "for positive ones, orange and leaning left for negative ones"
    ),
    "posterior.png": "Draws from the posterior, and the fit with its intervals",
}
FILES = ("fit.json", "report.md", "report.html", *PICTURES, "posterior.nc")
PAPER_TITLE = (
    "Data: a published fit of measurements (Eq. 17 with Table 1's σ, ψ; Zhou, 2013), "
    "not measurements"
)


def write_report(
    result: Any,
    folder: str | Path,
    *,
    draws: Any = None,
    printed: Printed | None = None,
    command: str = "",
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> list[str]:
    """Write all files of a fit, or none; return their names.

    `printed`: published values of the paper's materials, with which the curves of Fig. 2 are drawn too;
    `command`: what makes the same files again; `progress` is called as progress(stage, done, total).
    """
    from calibration import plots

    lines = plots.lines_of(result, with_paper=printed is not None)
    more: dict[str, Any] = {"title": PAPER_TITLE, "ratio": True, "from_rest": True}
    figures: list[Callable[[], Any]] = [
        lambda: plots.curves_figure(result, lines, **more if printed else {}),
        lambda: plots.observables_figure(result),
        lambda: plots.profiles_figure(result),
        lambda: plots.correlation_figure(result),
        lambda: None if draws is None else plots.posterior_figure(draws, result),
    ]
    with files_into(folder, FILES) as staged:
        result.save(staged / "fit.json")
        if draws is not None:
            from calibration.fitting.posterior.draws import write

            write(draws, staged / "posterior.nc")
        pictures = {}
        for done, (name, figure) in enumerate(zip(PICTURES, figures, strict=True)):
            progress("pictures", done, len(PICTURES))
            if (drawn := figure()) is not None:
                plots.save(drawn, staged / name)
                pictures[PICTURES[name]] = name
        parts = sections(result, pictures, command, printed, draws).values()
        blocks = [block for part in parts for block in part]
        write_text(staged / "report.md", markdown(blocks))
        write_text(staged / "report.html", page(blocks, staged))
        return [name for name in FILES if (staged / name).exists()]


def printed_values() -> dict[str, dict[str, float]]:
    """Table 1 of the paper, {material: {parameter: value}}."""
    from calibration.paper import TABLE_1

    names = ("chi", "sigma", "psi", "critical_velocity", "limit_velocity", "yield_ratio")
    return {entry.name: {name: getattr(entry, name) for name in names} for entry in TABLE_1}


def terminal_report(result: Any, intro: str = "", **more: Any) -> str:
    """A fit on a terminal, after a remark on the data; `more` as of `sections`."""
    of = sections(result, **more)
    if of["posterior"]:  # a heading is not printed, and its table would look like the fit's
        of["posterior"].insert(0, Block("text", "Posterior:"))
    names = ("parameters", "quality", "line", "posterior", "computed", "verdict", "warnings")
    first = [Block("text", intro)] if intro else of["notes"]
    return terminal([*first, *(block for name in names for block in of[name])])


def result_text(result: Any) -> str:
    """The text that `print` shows: first sentence, estimates, goodness of fit and warnings."""
    of = sections(result)
    tables = [b for n in ("parameters", "quality", "line") for b in of[n] if b.kind == "table"]
    outliers = _optional("list", _outliers(result))
    return terminal([*of["result"], *tables, *outliers, *of["verdict"], *of["warnings"]])


def result_html(result: Any) -> str:
    """The HTML that a notebook shows."""
    of = sections(result)
    tables = [b for name in ("parameters", "quality") for b in of[name] if b.kind == "table"]
    return page([*of["result"], *of["verdict"], *tables, *of["warnings"][1:]])


def sections(
    result: Any,
    pictures: Mapping[str, str] | None = None,
    command: str = "",
    printed: Printed | None = None,
    draws: Any = None,
) -> dict[str, list[Block]]:
    """The parts of a report by name, in their order; `pictures` are {caption: file next to the report}."""
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    implausible = [w for w in result.warnings if w.code == "plausibility"]
    condition = result.condition_number
    rank = f"Rank {result.rank} of {len(result.covariance_names)} free parameters, "
    rank += "condition number " + ("infinite" if condition is None else number(condition, 2))
    methods = [f"{name}: {text}" for name, text in _methods(result).items()]
    quality, bodies = _quality_table(result), _bodies_table(result)
    words = [f"{name}: {text}" for name, text in QUALITY.items() if name in quality]
    warned, of_draws = warning_items(result.warnings, result), []
    if draws is not None:
        of_draws = _warnings_of_draws(draws, result)
    return {
        "title": [Block("title", "Coefficients of restitution, fitted")],
        "implausible": _optional("list", warning_items(implausible, result)),
        "result": [Block("lead", _sentence(result))],
        "about": [Block("about", f"{datetime.date.today().isoformat()}; {versions}")],
        "verdict": [_verdict(result, len(of_draws))],
        "data": [Block("list", [_data_set(fit) for fit in result.materials])],
        "notes": _optional("list", _notes(result)),
        "bodies": [] if bodies.empty else [Block("heading", "Bodies"), Block("table", bodies)],
        "parameters": [
            Block("heading", "Parameters"),
            Block("table", _parameter_table(result, printed)),
            *_optional("list", _meanings(result)),
            *_optional("list", _stated(result), "Priors, bounds and shared parameters:"),
            *_optional("list", methods, CONFIDENCE.format(100 * result.confidence)),
        ],
        "quality": [
            Block("heading", "Goodness of fit"),
            Block("table", quality),
            *_observed(result),
            *_optional("list", words + _outliers(result)),
            *_group_offsets(result),
        ],
        "pictures": [Block("picture", pair) for pair in (pictures or {}).items()],
        "line": _line(result.unloading_line),
        "posterior": [] if draws is None else _posterior(draws, result),
        "warnings": [Block("heading", "Warnings"), Block("warnings", warned + of_draws)]
        if warned + of_draws
        else [],
        "computed": [
            Block("heading", "How it was computed"),
            *([Block("code", command)] if command else []),
            Block("text", f"{_settings(result)}. {rank}."),
            _searches(result),
        ],
    }


def _optional(kind: str, value: list[Any], first: str = "") -> list[Block]:
    """A block with a sentence before it; no block if `value` is empty."""
    return [*([Block("text", first)] if first else []), Block(kind, value)] if value else []


def warning_items(warnings: Iterable[Any], result: Any) -> list[Item]:
    """Warnings, with the symbols of the tables: χ̃, not chi."""
    models = [fit.model for fit in result.materials]
    return [
        Item(
            warning.code,
            f"{f' ({warning.material})' if warning.material else ''}: {symbols.written(warning.cause, models)}.",
            symbols.written(warning.advice, models),
        )
        for warning in warnings
    ]


def _sentence(result: Any) -> str:
    """The fit in one sentence: law, data, fitted values and rms."""
    laws = dict.fromkeys(fit.model.label for fit in result.materials)
    law = f"{' and '.join(laws)} fitted to {sum(fit.n for fit in result.materials)} impacts"
    count = len(result.materials)
    if count > MOST_NAMED:
        return f"{law} of {count} data sets."
    parts, level = [], f"{100 * result.confidence:g} % interval "
    for fit in result.materials:
        values = []
        for name, estimate in fit.parameters.items():
            symbol = symbols.symbol(name, fit.model)
            texts = estimate_text(estimate), interval_text(estimate)
            value, ends = (
                text if text == ABSENT else f"{text} {symbol.unit}".rstrip() for text in texts
            )
            value += f" ({level}{ends})" if ABSENT not in (value, ends) else ""
            values += [f"{symbol.text} = {value}"] if estimate.free else []
        values += [f"{tree.size} numbers of {tree.name}" for tree in fit.trees]
        owner = f"on {fit.name}: " if count == 1 else f"{fit.name}, "
        parts.append(owner + ", ".join([*values, f"rms {number(fit.rms)}"]))
    return f"{law}{' ' if count == 1 else ': '}{'; '.join(parts)}."


def estimates(result: Any) -> pd.DataFrame:
    """All estimates of a fit, one in each row, as `FitResult.to_frame` returns them.

    Columns: dataset, parameter, symbol, unit, value, standard_error, low, high, method, free,
    at_bound. Undefined values and open ends are NaN.
    """
    names = ("value", "standard_error", "low", "high")
    rows = []
    for owner, name, symbol, _, estimate in _estimates(result):
        numbers = {n: np.nan if (x := getattr(estimate, n)) is None else x for n in names}
        kind = {n: getattr(estimate, n) for n in ("method", "free", "at_bound")}
        place = {"dataset": owner, "parameter": name, "symbol": symbol.text, "unit": symbol.unit}
        rows.append(place | numbers | kind)
    return pd.DataFrame(rows)


def _estimates(
    result: Any, printed: Printed | None = None
) -> Iterator[tuple[str, str, symbols.Symbol, str, Estimate]]:
    """Yield data set, parameter, symbol, label in the covariance, and estimate; pooled ones last."""
    for fit in result.materials:
        known = {**fit.parameters, **fit.derived}
        for name in (printed or {}).get(fit.name, {}):  # of the contact, from the bodies
            if name not in known:
                known[name] = Estimate(float(getattr(fit.contact, name)), method="computed")
        for name, estimate in known.items():
            symbol = symbols.symbol(name, fit.model)
            yield fit.name, name, symbol, fit.labels.get(name, name), estimate
    for name, estimate in result.pooled.items():
        base = name.removesuffix("_spread")
        symbol = symbols.symbol(base, result.materials[0].model)
        if base != name:
            symbol = symbol._replace(text=f"spread of {symbol.text}")
        yield "all together", name, symbol, name, estimate


def _parameter_table(result: Any, printed: Printed | None = None) -> pd.DataFrame:
    """Value, standard error and interval of each parameter, and published values if any."""
    rows: list[dict[str, str]] = []
    before, with_intervals = None, bool(_methods(result))
    for owner, name, symbol, label, estimate in _estimates(result, printed):
        row = {
            "material": "" if owner == before else owner,
            "parameter": symbol.text + (f" [{symbol.unit}]" if symbol.unit else ""),
            "value ± std. error": estimate_text(estimate),
        }
        if with_intervals:
            row[f"{100 * result.confidence:g} % interval"] = ends = interval_text(estimate)
            dof = result.degrees_of_freedom(label)
            of_t = "" if dof is None or dof >= MANY else f", dof = {number(dof, 3)}"
            row["interval from"] = "" if ends == ABSENT else estimate.method + of_t
        if printed is not None:
            value = printed.get(owner, {}).get(name)
            row["Table 1"] = "" if value is None else f"{value:.5g}"
        rows.append(row)
        before = owner
    for fit in result.materials:
        for tree in fit.trees:
            text = f"{tree.size} numbers, shown by the band of the curve"
            owner = "" if len(result.materials) == 1 and rows else fit.name
            rows.append({"material": owner, "parameter": tree.name, "value ± std. error": text})
    return pd.DataFrame(rows).fillna("")


def _methods(result: Any) -> dict[str, str]:
    """Methods of the intervals in this result, each with its description."""
    used = {e.method for *_, e in _estimates(result) if interval_text(e) != ABSENT}
    return {name: text for name, text in METHODS.items() if name in used}


def estimate_text(estimate: Any) -> str:
    """A value with its error, or the reason why it has no error."""
    if estimate.value is None:
        return "not determined" if estimate.free else ABSENT
    if estimate.method == "fixed" and not estimate.free:
        return f"{number(estimate.value, 5)} (fixed)"
    text = with_error(estimate.value, estimate.printed_error)
    return text + " (at its bound)" * estimate.at_bound


def interval_text(estimate: Any) -> str:
    """Text of the interval, or a dash."""
    if estimate.standard_error is None and estimate.low is None and estimate.high is None:
        return ABSENT
    return interval(estimate.low, estimate.high, estimate.printed_error)


def _quality_table(result: Any) -> pd.DataFrame:
    """Goodness of fit of each data set, and its estimated scatter; without columns of no number."""
    rows, line = [], result.unloading_line
    for fit in result.materials:
        chi_squared = fit.reduced_chi_squared
        numbers = {
            "dof": (fit.residual_degrees, 4),
            "rms": (fit.rms, 4),
            "rms of Eq. (17)": (fit.rms_empirical, 3),
            "rms on Eq. (18)": (line and line.rms.get(fit.name), 4),
            "scatter": (fit.noise, 3),
            "between groups": (fit.group_deviation, 3),
            "of times [ms]": (fit.timing and 1e3 * fit.timing, 3),
            "χ²/dof": (chi_squared, 3),
            "factor": (chi_squared**0.5 if "scale" in fit.variances else None, 3),
            "P": (fit.probability, 3),
        }
        row = {"material": fit.name, "law": fit.model.label, "points": str(fit.n)}
        row |= {name: number(*value_and_digits) for name, value_and_digits in numbers.items()}
        rows.append(row | {"converged": "yes" if fit.converged else "NO"})
    table = pd.DataFrame(rows)
    empty = [name for name in table if (table[name] == ABSENT).all()]
    return table.drop(columns=[*empty, *["law"] * (table["law"].nunique() == 1)])


def _observed(result: Any) -> list[Block]:
    """Goodness of fit of observables other than ε; no block if none was measured."""
    rows, remarks = [], []
    for fit in result.materials:
        for name, goodness in fit.observed.items():
            what, data = OBSERVABLES[name], next(o for o in fit.data.observed if o.name == name)
            row = {
                "material": fit.name,
                "observable": f"{name.replace('_', ' ')} {what.symbol}",
                "points": str(len(data)),
                "rms [%]": number(100 * goodness.rms, 3),
                "scatter [%]": "stated"
                if goodness.noise is None
                else number(100 * goodness.noise, 3),
            }
            chi_squared = goodness.reduced_chi_squared
            rows.append(row | {"χ²/dof": "" if chi_squared is None else number(chi_squared, 3)})
            remarks.append(what.words)
    remarks = sorted({*remarks})
    for fit in result.materials:
        if (modulus := modulus_by_times(fit)) is not None:
            remarks.append(
                f"{fit.name}: the contact times would determine E to {100 * modulus.error:.2g} %, at "
                f"{np.exp(modulus.off):.3g} times the stated value; free youngs_modulus, or give it a "
                "prior"
            )
    return [Block("table", pd.DataFrame(rows)), Block("list", remarks)] if rows else []


def _group_offsets(result: Any) -> list[Block]:
    """The largest offsets of groups, in a table; no block without groups."""
    rows, several = [], len(result.materials) > 1
    for fit in result.materials:
        for name, goodness in {RESTITUTION: fit, **fit.observed}.items():
            owner = {"material": fit.name} if several else {}
            what = "ε" if name == RESTITUTION else f"{OBSERVABLES[name].symbol} [relative]"
            for label, (offset, error) in list(goodness.group_offsets.items())[:MOST_GROUPS]:
                rows.append(
                    owner | {"group": label, "of": what, "offset": with_error(offset, error)}
                )
            if (more := len(goodness.group_offsets) - MOST_GROUPS) > 0:
                rows.append(owner | {"group": f"{more} smaller ones in fit.json", "of": what})
    if not rows:
        return []
    table = pd.DataFrame(rows).fillna("")
    text = (
        "Offsets of the groups from the curve (measured less fitted), the largest first. They are "
        "estimates with the standard deviation between groups as the prior, so that an offset of few "
        "points is drawn towards 0:"
    )
    return [Block("text", text), Block("table", table)]


def _outliers(result: Any) -> list[str]:
    """The largest outliers, and a line about misfit if there are many."""
    lines: list[str] = []
    for fit in result.materials:
        outliers = sorted(fit.outliers, key=lambda outlier: -abs(outlier.residual))
        owner = f", {fit.name}" if len(result.materials) > 1 else ""
        count = fit.n + sum(len(outlier) for outlier in fit.data.observed)
        if len(outliers) > max(MISFIT * count, 3):
            lines.append(
                f"misfit{owner}: noise does not explain {len(outliers)} of {count} points: "
                "the law or the stated errors are wrong"
            )
        lines += [
            f"outlier{owner}: {outlier}{_heights(outlier, fit.data.fall)}"
            for outlier in outliers[:MOST_OUTLIERS]
        ]
        more = len(outliers) - MOST_OUTLIERS
        lines += [f"outlier{owner}: {more} more in fit.json"] if more > 0 else []
    parameters = [e for fit in result.materials for e in fit.parameters.values()]
    return [*lines, NOT_JUDGED] if any(e.skewed is None for e in parameters) else lines


def _heights(outlier: Any, fall: Any) -> str:
    """The heights of an outlier as the file has them; no text without heights."""
    if fall is None:
        return ""
    heights = {"drop": fall.height(outlier.velocity)}
    if outlier.restitution is not None and fall.has_rebounds:
        heights["rebound"] = fall.rebound_height(outlier.restitution * outlier.velocity)
    texts = [f"{name} {height:.5g} {fall.unit}" for name, height in heights.items()]
    return f" ({', '.join(texts)})"


def _bodies_table(result: Any) -> pd.DataFrame:
    """One body in each row, or effective properties if the bodies are unknown; empty without a contact."""
    if all(fit.data.contact is None for fit in result.materials):
        return pd.DataFrame()
    rows = []
    for fit in result.materials:
        for k, (body, *values) in enumerate(_bodies(fit.data)):
            rows.append([fit.name if k == 0 else "", body, *map(_range, values)])
    header = ["material", "body", "radius [m]", "mass [kg]", *PROPERTIES.values()]
    return pd.DataFrame(rows, columns=header)


def _bodies(data: Any) -> Iterator[tuple[Any, ...]]:
    """Yield the name of each body, then radius, mass, E, ν, ρ and Y; None if unknown."""
    if data.contact is None:
        yield "not stated", *[None] * 6
    elif not data.bodies:
        pair = data.contact.leaves()
        effective = [pair[name] for name in ("radius", "mass", "youngs_modulus")]
        yield "the pair, effective", *effective, None, None, pair["yield_strength"]
    else:
        first, second = data.bodies
        equal = first.material == second.material and np.array_equal(first.radius, second.radius)
        for body in data.bodies[: 1 if equal else 2]:
            of, mass = body.material.leaves(), None
            if body.radius is not None:
                mass = 4 / 3 * np.pi * np.asarray(of["density"]) * np.asarray(body.radius) ** 3
            text = "two equal spheres" if equal else body.name
            yield text, body.radius, mass, *(of[name] for name in PROPERTIES)


def _range(value: Any, digits: int = 4) -> str:
    """Text of a number, or of the range of an array."""
    if value is None:
        return ABSENT
    low, high = (number(float(end(np.asarray(value))), digits) for end in (np.min, np.max))
    return low if low == high else f"{low} to {high}"


def _meanings(result: Any) -> list[str]:
    """Meanings of the symbols of the parameters."""
    words = {
        symbols.symbol(name, fit.model).text: symbols.words(name, fit.model)
        for fit in result.materials
        for name in {**fit.parameters, **fit.derived}
    }
    return [f"{symbol}: {text}" for symbol, text in words.items() if text]


def _stated(result: Any) -> list[str]:
    """Priors, bounds and sharing that were stated before the fit."""
    texts = []
    parameters_of = stated_parameters(result.request.parameters, result.request.datasets)
    for fit, parameters in zip(result.materials, parameters_of, strict=True):
        for name, parameter in parameters.items():
            if isinstance(parameter, Parameter) and (words := _stated_words(parameter)):
                symbol = symbols.text(fit.model.canonical(name), fit.model)
                texts.append((f"{symbol}: {words}", fit.name))
    return _with_owners(result, texts, "{text} ({names})")


def _stated_words(parameter: Parameter) -> str:
    parts = []
    if parameter.prior is not None:
        parts.append("prior {:.4g} ± {:.4g}".format(*parameter.prior))
    if parameter.bounds is not None:
        parts.append("between {:.4g} and {:.4g}".format(*parameter.bounds))
    if parameter.pooled:
        parts.append("partially pooled: a common mean with a spread (of ln θ where θ is positive)")
    elif parameter.shared:
        group = "all" if parameter.shared is True else f"the group {parameter.shared}"
        parts.append(f"one value for {group}")
    return ", ".join(parts)


def _notes(result: Any) -> list[str]:
    """Remarks about the data, each once."""
    texts = [(note, fit.name) for fit in result.materials for note in fit.data.notes]
    return _with_owners(result, texts, "{names}: {text}")


def _with_owners(result: Any, texts: Iterable[tuple[str, str]], form: str) -> list[str]:
    """Texts, each once and with the names of its data sets unless it applies to all."""
    owners: dict[str, list[str]] = {}
    for text, name in texts:
        owners.setdefault(text, []).append(name)
    count = len(result.materials)
    return [
        text if len(names) == count else form.format(text=text, names=", ".join(names))
        for text, names in owners.items()
    ]


def _verdict(result: Any, of_draws: int = 0) -> Block:
    """Whether the fit converged, and the number of warnings.

    Args:
        of_draws: warnings about the posterior.
    """
    if not result.converged:
        return Block("strong", NOT_CONVERGED)
    count = len(result.warnings)
    text = f"with {count} warning{'s' * (count > 1)}" if count else "without warnings"
    more = f"; its posterior has {of_draws} warning{'s' * (of_draws > 1)}" if of_draws else ""
    return Block("text", f"The fit converged {text}{more}.")


def _data_set(fit: Any) -> Item:
    """Source and range of a data set, its objective, and where its curve is not determined."""
    data, origin = fit.data, fit.data.origin
    text = f": {fit.n} impacts at {min(data.velocity):.4g} to {max(data.velocity):.4g} m/s, "
    if data.uncertainty is None:
        text += "no uncertainty stated (it is estimated from the scatter)"
    else:
        text += f"uncertainty of the restitution {_range(data.uncertainty, 2)}"
    text += f" in {len(data.groups)} groups" if data.groups else ""
    text += "" if origin is None else f", from {origin.file}"
    text += f"; {fit.model.label}: {OBJECTIVES[fit.objective]}."
    below, above = fit.known_from > 0, fit.known_to < math.inf
    side, at = ("below", fit.known_from) if below else ("above", fit.known_to)
    unknown = f"The data do not constrain the curve {side} the critical velocity, {at:.4g} m/s."
    return Item(fit.name, text, unknown if below or above else "")


def _line(line: Any) -> list[Block]:
    """Coefficients of Eq. (18), fitted to all curves and to the fitted χ̃."""
    if line is None:
        return []
    words, how = LINE_METHODS[line.method]
    columns = {
        "Eq. (18), χ̃ = c1 + c2 E/Y": ["c1", "c2"],
        how: [estimate_text(line.c1), estimate_text(line.c2)],
    }
    if line.through_chi:
        through = [estimate_text(line.through_chi[name]) for name in ("c1", "c2")]
        columns["through the fitted χ̃"] = through
    return [
        Block("heading", "One line for all materials, Eq. (18)"),
        Block("text", LINE.format(words) if len(line.rms) > 2 else LINE_OF_TWO),
        Block("table", pd.DataFrame(columns)),
        *([] if line.converged else [Block("strong", "NOT CONVERGED: the fit of this line.")]),
    ]


def _settings(result: Any) -> str:
    """The settings of a fit in one line."""
    settings, options = result.settings, result.request.options
    known = ("law", "objective", "optimiser", "route", "noise", "noise_dof", "form", "kappa", "end")
    names = [name for name in (*known, "starts", "seed") if settings.get(name) is not None]
    parts = [f"{name.replace('_', ' ')} {settings[name]}" for name in names]
    parts += ["scatter added to the stated uncertainties"] * options.extra_scatter
    parts += ["a common factor of the stated uncertainties estimated"] * options.scale_uncertainty
    return ", ".join(parts)


def _searches(result: Any) -> Block:
    """Evaluations, seconds, final gradient and stop reason of each search; only sums if they are many."""
    stages, count = result.optimiser_report, len(result.materials)
    if len(stages) > MOST_SEARCHES:
        seconds = sum(result.times.get(stage.label, 0.0) for stage in stages)
        evaluations = sum(stage.evaluations for stage in stages)
        text = f"{len(stages)} searches, {evaluations} evaluations, {number(seconds, 2)} s"
        return Block("text", text)
    rows = [
        {
            "material": "all" if 1 < len(stage.materials) == count else ", ".join(stage.materials),
            "stage": stage.stage,
            "optimiser": stage.optimiser,
            "route": stage.route,
            "starts": str(stage.starts),
            "evaluations": str(stage.evaluations),
            "seconds": number(result.times.get(stage.label), 2),
            "gradient": number(stage.gradient_norm, 1),
            "stop reason": stage.reason,
        }
        for stage in stages
    ]
    table = pd.DataFrame(rows)
    if len({stage.optimiser for stage in stages}) == 1:  # then the line of settings names it
        table = table.drop(columns="optimiser")
    return Block("table", table)


def _posterior(draws: Any, result: Any) -> list[Block]:
    """Settings of the sampler, a table of the draws, conclusions, and warnings."""
    from calibration.fitting.posterior.diagnostics import not_converged, summaries
    from calibration.fitting.posterior.draws import dataset_of

    by_parameter, failed = summaries(draws, result.confidence), not_converged(draws)
    names = {name: symbols.of_label(name, result) for name in by_parameter}
    posterior = dataset_of(draws, "posterior")
    sizes, about = posterior.sizes, posterior.attrs
    how = (
        f"{sizes['chain']} chains of {sizes['draw']} draws by NUTS "
        f"({about['inference_library']} {about['inference_library_version']}) after {about['warmup']} "
        f"of warm-up each, seed {about['seed']}; intervals are central. Widths are compared on the "
        "scale that is sampled, ln θ where θ is positive."
    )
    rows = [
        {
            "parameter": names[name] + (f" [{summary.unit}]" if summary.unit else ""),
            "mean ± std. deviation": with_error(summary.mean, summary.deviation),
            f"{100 * result.confidence:g} % interval": interval(
                summary.low, summary.high, summary.deviation
            ),
            "R-hat": f"{summary.r_hat:.3f}",
            "ESS": f"{summary.effective:.0f}",
            "posterior/prior width": number(summary.prior_share, 2),
            "prior": summary.prior or "derived",
        }
        for name, summary in by_parameter.items()
    ]
    return [
        Block("heading", "Posterior"),
        Block("text", how),
        Block("table", pd.DataFrame(rows)),
        Block("list", [failed] if failed else _determined(by_parameter, names)),
    ]


def _warnings_of_draws(draws: Any, result: Any) -> list[Item]:
    from calibration.fitting.posterior.diagnostics import doubts_of

    items = warning_items(doubts_of(draws), result)
    return [item._replace(text=f" (posterior){item.text}") for item in items]


def _determined(summaries: Mapping[str, Any], names: Mapping[str, str]) -> list[str]:
    """Sentences on which parameters the data determine, and which follow the prior."""
    from calibration.fitting.posterior.diagnostics import FOLLOWS

    kinds: dict[str, list[str]] = {"determine": [], "narrow": [], "do not determine": []}
    wide = {
        name: share
        for name, summary in summaries.items()
        if (share := summary.prior_share or 0) > DETERMINED
    }
    for name, summary in summaries.items():
        if name not in wide:
            kinds["determine"].append(
                f"{names[name]} = {with_error(summary.mean, summary.deviation)}"
            )
        else:
            share = f"{100 * wide[name]:.0f} % of its prior's width left"
            kind = "narrow" if wide[name] <= FOLLOWS else "do not determine"
            kinds[kind].append(f"{names[name]} ({share})")
    lines = [f"The data {kind} {', '.join(names)}." for kind, names in kinds.items() if names]
    if {"sigma", "psi"} & {name.partition("[")[0] for name in wide}:
        lines.append(
            "σ and ψ act through the loss that they make together: at the critical velocity it is "
            "ε_up, which is determined; each alone only as far as the velocities below reach."
        )
    return lines
