"""What a report of a fit says: its tables, and the sentences around them.

`estimates` has numbers; the other tables have text rounded for a reader.
"""

import datetime
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from calibration import symbols
from calibration.fitting.curves import modulus_by_times
from calibration.fitting.material import Estimate
from calibration.fitting.request import said_of
from calibration.observables import OBSERVABLES
from calibration.parameters import Parameter
from calibration.report.layout import Block, Item, page, terminal
from calibration.rounding import ABSENT, interval, number, with_error

Printed = Mapping[str, Mapping[str, float]]  # {material: {parameter: published value}}
MANY = 1000  # degrees of freedom, from where on Student's t is the normal distribution
MOST_NAMED = 3  # data sets that the first sentence names one by one
MOST_SEARCHES = 12  # that are listed one by one
NOT_CONVERGED = "NOT CONVERGED: do not use these values."
OBJECTIVES = {
    "two-step": "σ and ψ from Eq. (17), then χ̃ from the law with them fixed (`two-step`)",
    "model": "all parameters at once from the likelihood of all points (`model`)",
}
LINE = (
    "One line for all materials, {}. Its χ̃ follow the data less closely than a χ̃ for each "
    "material; the table above has the rms of both."
)
LINE_METHODS = {"curves": "fitted to all curves at once", "weighted": "through the fitted χ̃"}
METHODS = {
    "sandwich": (
        "from the stacked estimating equations of both steps of `two-step`, as the same noise "
        "enters both"
    ),
    "profile": "where the profile likelihood crosses its threshold; open where it never does",
    "wald": "from the standard error, on the scale of the search",
    "derived": "from the covariance of the fitted parameters",
}
MISFIT = 0.1  # share of the points from which on outliers are a misfit
NOT_JUDGED = "not checked, without profiles: whether standard errors describe the intervals"
QUALITY = {
    "dof": "degrees of freedom of the residuals",
    "scatter": "estimated standard deviation of one ε (under `two-step` about Eq. (17))",
    "between groups": "estimated standard deviation of the groups' offsets in ε",
    "of times [ms]": "estimated standard deviation of the times of bounces",
    "χ²/dof": "squared residuals over the stated variances, per degree of freedom",
    "P": "probability of a χ² at least as large if law and stated uncertainties hold",
}
PROPERTIES = {
    "youngs_modulus": "E [Pa]",
    "poisson_ratio": "ν",
    "density": "ρ [kg/m³]",
    "yield_strength": "Y [Pa]",
}


def terminal_report(result: Any, intro: str = "", **more: Any) -> str:
    """A fit on a terminal.

    Args:
        result: a `FitResult`.
        intro: what the reader must know of the data before anything else.
        more: as `sections` takes it.
    """
    of = sections(result, **more)
    if of["posterior"]:  # a heading is not printed, and its table would look like the fit's
        of["posterior"] = [Block("text", "Posterior:"), *of["posterior"]]
    names = ("parameters", "quality", "line", "posterior", "computed", "verdict", "warnings")
    first = [Block("text", intro)] if intro else of["notes"]
    return terminal([*first, *(block for name in names for block in of[name])])


def result_text(result: Any) -> str:
    """A fit as `print` shows it: its sentence, estimates, goodness of fit and warnings."""
    of = sections(result)
    tables = [b for n in ("parameters", "quality", "line") for b in of[n] if b.kind == "table"]
    outliers = [Block("list", lines)] if (lines := outlier_lines(result)) else []
    return terminal([*of["result"], *tables, *outliers, *of["verdict"], *of["warnings"]])


def result_html(result: Any) -> str:
    """The same in a notebook."""
    of = sections(result)
    tables = [b for name in ("parameters", "quality") for b in of[name] if b.kind == "table"]
    return page([*of["result"], *of["verdict"], *tables, *of["warnings"][1:]])


def report_blocks(result: Any, *more: Any) -> list[Block]:
    """The whole report; arguments as `sections`'."""
    return [block for section in sections(result, *more).values() for block in section]


def sections(
    result: Any,
    pictures: Mapping[str, str] | None = None,
    command: str = "",
    printed: Printed | None = None,
    posterior: list[Block] | None = None,
) -> dict[str, list[Block]]:
    """The parts of a report by name, in their order.

    Args:
        result: a `FitResult`.
        pictures: {caption: file next to the report}.
        command: the command that makes the same results again.
        printed: published values to show with the fitted ones.
        posterior: `posterior.section` of draws.
    """
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    implausible = [w for w in result.warnings if w.code == "plausibility"]
    bodies, line = bodies_table(result), result.unloading_line
    condition = result.condition_number
    rank = f"Rank {result.rank} of {len(result.covariance_names)} free parameters, "
    rank += "condition number " + ("infinite" if condition is None else number(condition, 2))
    methods, warned = interval_methods(result), warning_items(result.warnings, result)
    confidence = (
        f"Intervals hold {100 * result.confidence:g} % of true values where the law is right; dof are "
        "the degrees of freedom of Student's t where the noise is estimated from the residuals:"
    )
    return {
        "title": [Block("title", "Coefficients of restitution, fitted")],
        "implausible": _optional("items", warning_items(implausible, result)),
        "result": [Block("lead", result_sentence(result))],
        "about": [Block("about", f"{datetime.date.today().isoformat()}; {versions}")],
        "verdict": [_verdict(result)],
        "data": [Block("items", [_data_set(fit) for fit in result.materials])],
        "notes": _optional("list", notes(result)),
        "bodies": [] if bodies is None else _headed("Bodies", Block("table", bodies)),
        "parameters": [
            *_headed("Parameters", Block("table", parameter_table(result, printed))),
            *_optional("list", meanings(result)),
            *_optional("list", stated(result), "Priors, bounds and shared parameters:"),
            *_optional("list", [f"{k}: {text}" for k, text in methods.items()], confidence),
        ],
        "quality": [
            *_headed("Goodness of fit", Block("table", quality_table(result))),
            *_observed(result),
            *_optional("list", quality_words(result) + outlier_lines(result)),
        ],
        "pictures": [Block("picture", pair) for pair in (pictures or {}).items()],
        "line": [] if line is None else _line(result),
        "posterior": posterior or [],
        "warnings": _headed("Warnings", Block("warnings", warned)) if warned else [],
        "computed": [
            *_headed("How it was computed", *([Block("code", command)] if command else [])),
            Block("text", f"{settings_line(result)}. {rank}."),
            _searches(result),
        ],
    }


def warning_items(warnings: Iterable[Any], result: Any) -> list[Item]:
    """Warnings with parameters written as in the tables: χ̃, not chi."""
    models = [fit.model for fit in result.materials]
    return [
        Item(
            one.code,
            f"{f' ({one.material})' if one.material else ''}: {symbols.written(one.cause, models)}.",
            symbols.written(one.advice, models),
        )
        for one in warnings
    ]


def result_sentence(result: Any) -> str:
    """The fit in one sentence: law, data, fitted values and how closely the curve follows."""
    laws = dict.fromkeys(fit.model.label for fit in result.materials)
    impacts = sum(fit.n for fit in result.materials)
    law = f"{' and '.join(laws)} fitted to {impacts} impacts"
    count = len(result.materials)
    if count > MOST_NAMED:
        return f"{law} of {count} data sets."
    parts, level = [], f"{100 * result.confidence:g} % interval "
    for fit in result.materials:
        values = [
            f"{one.text} = {_with_interval(estimate, level, one.unit)}"
            for name, estimate in fit.parameters.items()
            if estimate.free and (one := symbols.symbol(name, fit.model))
        ]
        values += [f"{tree.size} numbers of {tree.name}" for tree in fit.trees]
        owner = f"on {fit.name}: " if count == 1 else f"{fit.name}, "
        parts.append(owner + ", ".join([*values, f"rms {number(fit.rms)}"]))
    return f"{law}{' ' if count == 1 else ': '}{'; '.join(parts)}."


def _with_interval(estimate: Any, confidence: str, unit: str) -> str:
    """A value with its error and its interval, which need not be symmetric, in their unit."""
    text, ends = (
        f"{s} {unit}".rstrip() for s in (estimate_text(estimate), interval_text(estimate))
    )
    return text if ABSENT in (ends.split()[0], text.split()[0]) else f"{text} ({confidence}{ends})"


def estimates(result: Any) -> pd.DataFrame:
    """All estimates of a fit, one a row: what `FitResult.to_frame` returns.

    Columns: dataset, parameter, symbol, unit, value, standard_error, low, high, method, free,
    at_bound. What is undefined, or an open end, is NaN.
    """
    names = ("value", "standard_error", "low", "high")
    rows = []
    for owner, name, symbol, _, estimate in _estimates(result):
        numbers = {n: np.nan if (x := getattr(estimate, n)) is None else x for n in names}
        kind = {n: getattr(estimate, n) for n in ("method", "free", "at_bound")}
        place = {"dataset": owner, "parameter": name, "symbol": symbol.text, "unit": symbol.unit}
        rows.append(place | numbers | kind)
    return pd.DataFrame(rows)


def parameter_table(result: Any, printed: Printed | None = None) -> pd.DataFrame:
    """Each parameter's value, standard error and interval, with published values."""
    with_intervals = bool(interval_methods(result))
    rows: list[dict[str, str]] = []
    before = None
    for owner, name, symbol, label, estimate in _estimates(result, printed):
        row = {
            "material": "" if owner == before else owner,
            "parameter": symbol.text + (f" [{symbol.unit}]" if symbol.unit else ""),
            "value ± std. error": estimate_text(estimate),
        }
        if with_intervals:
            row[f"{100 * result.confidence:g} % interval"] = interval_text(estimate)
            row["interval from"] = _interval_from(result, estimate, label)
        if printed is not None:
            value = printed.get(owner, {}).get(name)
            row["Table 1"] = "" if value is None else f"{value:.5g}"
        rows.append(row)
        before = owner
    for fit in result.materials:
        for tree in fit.trees:
            text = f"{tree.size} numbers, shown by the band of the curve"
            owner = "" if len(result.materials) == 1 and rows else fit.name
            values = {"material": owner, "parameter": tree.name, "value ± std. error": text}
            rows.append(values)
    return pd.DataFrame(rows).fillna("")


def interval_methods(result: Any) -> dict[str, str]:
    """The methods of the intervals that there are, with what each does."""
    used = {e.method for *_, e in _estimates(result) if interval_text(e) != ABSENT}
    return {name: text for name, text in METHODS.items() if name in used}


def quality_table(result: Any) -> pd.DataFrame:
    """How closely each curve follows its data, and the scatter that was found."""
    line, fits = result.unloading_line, result.materials
    laws = [fit.model.label for fit in fits]
    on_line = None if line is None else [line.rms.get(fit.name) for fit in fits]
    timing = [None if fit.timing is None else 1e3 * fit.timing for fit in fits]
    columns = {
        "material": [fit.name for fit in fits],
        "law": laws if len(set(laws)) > 1 else None,
        "points": [str(fit.n) for fit in fits],
        "dof": _numbers([fit.residual_degrees for fit in fits]),
        "rms": _numbers([fit.rms for fit in fits]),
        "rms of Eq. (17)": _numbers([fit.rms_empirical for fit in fits], 3),
        "rms on Eq. (18)": on_line and _numbers(on_line),
        "scatter": _numbers([fit.noise for fit in fits], 3),
        "between groups": _numbers([fit.group_deviation for fit in fits], 3),
        "of times [ms]": _numbers(timing, 3),
        "χ²/dof": _numbers([fit.reduced_chi_squared for fit in fits], 3),
        "P": _numbers([fit.probability for fit in fits], 3),
        "converged": ["yes" if fit.converged else "NO" for fit in fits],
    }
    return pd.DataFrame({name: column for name, column in columns.items() if column})


def _observed(result: Any) -> list[Block]:
    """How closely the curves follow what else than ε was measured; nothing where nothing was."""
    rows = [
        [
            fit.name,
            f"{name.replace('_', ' ')} {OBSERVABLES[name].symbol}",
            str(next(len(data) for data in fit.data.observed if data.name == name)),
            number(100 * one.rms, 3),
            "stated" if one.noise is None else number(100 * one.noise, 3),
            "" if one.reduced_chi_squared is None else number(one.reduced_chi_squared, 3),
        ]
        for fit in result.materials
        for name, one in fit.observed.items()
    ]
    header = ["material", "observable", "points", "rms [%]", "scatter [%]", "χ²/dof"]
    words = {OBSERVABLES[name].words for fit in result.materials for name in fit.observed}
    told = [*sorted(words), *modulus_lines(result)]
    return [Block("table", pd.DataFrame(rows, columns=header)), Block("list", told)] if rows else []


def modulus_lines(result: Any) -> list[str]:
    """To what the contact times of each data set would determine E."""
    lines = []
    for fit in result.materials:
        found = modulus_by_times(fit)
        if found is not None:
            lines.append(
                f"{fit.name}: the contact times would determine E to {100 * found.error:.2g} %, at "
                f"{np.exp(found.off):.3g} times the stated one; name youngs_modulus free, or give it a prior"
            )
    return lines


def bodies_table(result: Any) -> pd.DataFrame | None:
    """A body a row; effective numbers where the bodies are not known; None without a contact."""
    if all(fit.data.contact is None for fit in result.materials):
        return None
    rows = []
    for fit in result.materials:
        for k, (body, *values) in enumerate(_bodies(fit.data)):
            rows.append([fit.name if k == 0 else "", body, *map(_range_text, values)])
    header = ["material", "body", "radius [m]", "mass [kg]", *PROPERTIES.values()]
    return pd.DataFrame(rows, columns=header)


def estimate_text(estimate: Any) -> str:
    """A value with its error, or why it has none."""
    if estimate.value is None:
        return "not determined" if estimate.free else ABSENT
    if estimate.method == "fixed" and not estimate.free:
        return f"{number(estimate.value, 5)} (fixed)"
    text = with_error(estimate.value, estimate.printed_error)
    return text + " (at its bound)" * estimate.at_bound


def interval_text(estimate: Any) -> str:
    """The interval, or a dash."""
    if estimate.standard_error is None and estimate.low is None and estimate.high is None:
        return ABSENT
    return interval(estimate.low, estimate.high, estimate.printed_error)


def meanings(result: Any) -> list[str]:
    """What the symbols of the parameters stand for."""
    return [
        f"{symbol}: {words}"
        for symbol, words in {
            symbols.symbol(name, fit.model).text: symbols.words(name, fit.model)
            for fit in result.materials
            for name in {**fit.parameters, **fit.derived}
        }.items()
        if words
    ]


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
    """Remarks about the data, each once."""
    found: dict[str, list[str]] = {}
    for fit in result.materials:
        for note in fit.data.notes:
            found.setdefault(note, []).append(fit.name)
    return _with_owners(result, found, "{names}: {text}")


def quality_words(result: Any) -> list[str]:
    """The meaning of the columns of the table of goodness of fit."""
    header = quality_table(result).columns
    return [f"{name}: {text}" for name, text in QUALITY.items() if name in header]


def outlier_lines(result: Any, most: int = 3) -> list[str]:
    """The farthest points that the noise does not explain; where they are many, a misfit."""
    lines: list[str] = []
    for fit in result.materials:
        outliers = sorted(fit.outliers, key=lambda one: -abs(one.residual))
        owner = f", {fit.name}" if len(result.materials) > 1 else ""
        count = fit.n + sum(len(one) for one in fit.data.observed)
        if len(outliers) > max(MISFIT * count, 3):
            lines.append(
                f"misfit{owner}: noise does not explain {len(outliers)} of {count} points: "
                "the law or the stated errors are wrong"
            )
        lines += [f"outlier{owner}: {one}" for one in outliers[:most]]
        more = len(outliers) - most
        lines += [f"outlier{owner}: {more} more in fit.json"] if more > 0 else []
    every = [e for fit in result.materials for e in fit.parameters.values()]
    return [*lines, NOT_JUDGED] if any(e.skewed is None for e in every) else lines


def settings_line(result: Any) -> str:
    """The settings of a fit in one line."""
    settings, options = result.settings, result.request.options
    known = ("law", "objective", "optimiser", "route", "noise", "noise_dof", "form", "kappa", "end")
    names = [name for name in (*known, "starts", "seed") if settings.get(name) is not None]
    parts = [f"{name.replace('_', ' ')} {settings[name]}" for name in names]
    parts += ["scatter added to the stated uncertainties"] * options.extra_scatter
    parts += ["stated uncertainties right up to a factor"] * options.scale_uncertainty
    return ", ".join(parts)


def _optional(kind: str, value: list[Any], first: str = "") -> list[Block]:
    """A block with a sentence before it; nothing where the block is empty."""
    return [*([Block("text", first)] if first else []), Block(kind, value)] if value else []


def _headed(heading: str, *blocks: Block) -> list[Block]:
    return [Block("heading", heading), *blocks]


def _verdict(result: Any) -> Block:
    count = len(result.warnings)
    if not result.converged:
        return Block("strong", NOT_CONVERGED)
    text = f"with {count} warning{'s' * (count > 1)}" if count else "without warnings"
    return Block("text", f"The fit converged {text}.")


def _data_set(fit: Any) -> Item:
    """Where a data set came from, what was measured, and where its curve is not determined."""
    data, origin = fit.data, fit.data.origin
    text = f": {fit.n} impacts at {min(data.velocity):.4g} to {max(data.velocity):.4g} m/s, "
    if data.uncertainty is None:
        text += "no uncertainty stated (it is estimated from the scatter)"
    else:
        text += f"uncertainty of the restitution {_range_text(data.uncertainty, 2)}"
    text += f" in {len(data.groups)} groups" if data.groups else ""
    text += "" if origin is None else f", from {origin.file}"
    text += f"; {fit.model.label}: {OBJECTIVES[fit.objective]}."
    below, above = fit.known_from > 0, fit.known_to < math.inf
    side, at = ("below", fit.known_from) if below else ("above", fit.known_to)
    unknown = f"The data do not constrain the curve {side} the critical velocity, {at:.4g} m/s."
    return Item(fit.name, text, unknown if below or above else "")


def _line(result: Any) -> list[Block]:
    """Eq. (18)'s coefficients, through all curves and through the fitted χ̃."""
    line = result.unloading_line
    how = "through all curves" if line.method == "curves" else "through the fitted χ̃, weighted"
    columns = {
        "Eq. (18), χ̃ = c1 + c2 E/Y": ["c1", "c2"],
        how: [estimate_text(line.c1), estimate_text(line.c2)],
    }
    if line.through_chi:
        through = [estimate_text(line.through_chi[name]) for name in ("c1", "c2")]
        columns["through the fitted χ̃"] = through
    return [
        *_headed("One line for all materials, Eq. (18)"),
        Block("text", LINE.format(LINE_METHODS[line.method])),
        Block("table", pd.DataFrame(columns)),
        *([] if line.converged else [Block("strong", "NOT CONVERGED: the fit of this line.")]),
    ]


def _searches(result: Any) -> Block:
    """Evaluations, seconds and final gradient of each search, and why it stopped; sums of very many."""
    stages, every = result.optimiser_report, len(result.materials)
    if len(stages) > MOST_SEARCHES:
        seconds = sum(result.times.get(stage.label, 0.0) for stage in stages)
        evaluations = sum(stage.evaluations for stage in stages)
        text = f"{len(stages)} searches, {evaluations} evaluations, {number(seconds, 2)} s"
        return Block("text", text)
    rows = [
        {
            "material": "all" if 1 < len(one.materials) == every else ", ".join(one.materials),
            "stage": one.stage,
            "optimiser": one.optimiser,
            "route": one.route,
            "starts": str(one.starts),
            "evaluations": str(one.evaluations),
            "seconds": number(result.times.get(one.label), 2),
            "gradient": number(one.gradient_norm, 1),
            "stop reason": one.reason,
        }
        for one in stages
    ]
    table = pd.DataFrame(rows)
    alike = len({one.optimiser for one in stages}) == 1  # then the settings name it
    return Block("table", table.drop(columns="optimiser") if alike else table)


def _numbers(values: list[float | None], digits: int = 4) -> list[str] | None:
    """A column of rounded numbers; None where there is no number at all."""
    return None if set(values) == {None} else [number(value, digits) for value in values]


def _estimates(
    result: Any, printed: Printed | None = None
) -> Iterator[tuple[str, str, symbols.Symbol, str, Estimate]]:
    """Data set, parameter, symbol, label in the covariance, and estimate; pooled ones last."""
    for fit in result.materials:
        own = {**fit.parameters, **fit.derived}
        # properties of the contact that were printed too: they follow from the bodies alone
        computed = [name for name in (printed or {}).get(fit.name, {}) if name not in own]
        own |= {n: Estimate(float(getattr(fit.contact, n)), method="computed") for n in computed}
        for name, estimate in own.items():
            symbol = symbols.symbol(name, fit.model)
            yield fit.name, name, symbol, fit.labels.get(name, name), estimate
    for name, estimate in result.pooled.items():
        base = name.removesuffix("_spread")
        symbol = symbols.symbol(base, result.materials[0].model)
        if base != name:
            symbol = symbol._replace(text=f"spread of {symbol.text}")
        yield "all together", name, symbol, name, estimate


def _interval_from(result: Any, estimate: Estimate, label: str) -> str:
    """The method of an interval; the degrees of freedom of its quantile, of estimated noise."""
    if interval_text(estimate) == ABSENT:
        return ""
    degrees = result.degrees_of_freedom(label)
    is_normal = degrees is None or degrees >= MANY
    return estimate.method + ("" if is_normal else f", dof = {number(degrees, 3)}")


def _bodies(data: Any) -> Iterator[tuple[Any, ...]]:
    """What a row is of, then radius, mass, E, ν, ρ and Y; None where not known."""
    if data.contact is None:
        yield "not stated", *[None] * 6
    elif not data.bodies:
        pair = data.contact.leaves()
        own = [pair[name] for name in ("radius", "mass", "youngs_modulus")]
        yield "the pair, effective", *own, None, None, pair["yield_strength"]
    else:
        one, two = data.bodies
        equal = one.material == two.material and np.array_equal(one.radius, two.radius)
        for body in data.bodies[: 1 if equal else 2]:
            of, mass = body.material.leaves(), None
            if body.radius is not None:
                mass = 4 / 3 * np.pi * np.asarray(of["density"]) * np.asarray(body.radius) ** 3
            text = "two equal spheres" if equal else body.name
            yield text, body.radius, mass, *(of[name] for name in PROPERTIES)


def _range_text(value: Any, digits: int = 4) -> str:
    """One number, or the range of those that differ from impact to impact."""
    if value is None:
        return ABSENT
    low, high = (number(float(end(np.asarray(value))), digits) for end in (np.min, np.max))
    return low if low == high else f"{low} to {high}"


def _stated(parameter: Parameter) -> str:
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


def _with_owners(result: Any, found: Mapping[str, list[str]], form: str) -> list[str]:
    """Texts with the names of the data sets that each is about, where these are not all."""
    every = len(result.materials)
    return [
        text if len(names) == every else form.format(text=text, names=", ".join(names))
        for text, names in found.items()
    ]
