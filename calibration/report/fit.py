"""Tables and sentences of the report of a fit.

`estimates` returns numbers; the other tables contain rounded text.
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
from calibration.fitting.request import stated_parameters
from calibration.observables import OBSERVABLES
from calibration.parameters import Parameter
from calibration.report.layout import Block, Item, page, terminal
from calibration.rounding import ABSENT, interval, number, with_error

Printed = Mapping[str, Mapping[str, float]]  # {material: {parameter: published value}}
MANY = 1000  # degrees of freedom: with more, Student's t counts as the normal distribution
MOST_NAMED = 3  # data sets that the first sentence describes one by one
MOST_SEARCHES = 12  # searches that are listed one by one
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
    "profile": "where the profile likelihood crosses its threshold; open if it never does",
    "wald": "from the standard error, on the scale of the search",
    "derived": "from the covariance of the fitted parameters",
}
MISFIT = 0.1  # share of the points above which outliers are reported as a misfit
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
        intro: a remark about the data, printed first.
        more: further arguments of `sections`.
    """
    of = sections(result, **more)
    if of["posterior"]:  # a heading is not printed, and its table would look like the fit's
        of["posterior"] = [Block("text", "Posterior:"), *of["posterior"]]
    names = ("parameters", "quality", "line", "posterior", "computed", "verdict", "warnings")
    first = [Block("text", intro)] if intro else of["notes"]
    return terminal([*first, *(block for name in names for block in of[name])])


def result_text(result: Any) -> str:
    """The text that `print` shows: first sentence, estimates, goodness of fit and warnings."""
    of = sections(result)
    tables = [b for n in ("parameters", "quality", "line") for b in of[n] if b.kind == "table"]
    outliers = [Block("list", lines)] if (lines := outlier_lines(result)) else []
    return terminal([*of["result"], *tables, *outliers, *of["verdict"], *of["warnings"]])


def result_html(result: Any) -> str:
    """The HTML that a notebook shows."""
    of = sections(result)
    tables = [b for name in ("parameters", "quality") for b in of[name] if b.kind == "table"]
    return page([*of["result"], *of["verdict"], *tables, *of["warnings"][1:]])


def report_blocks(result: Any, *more: Any) -> list[Block]:
    """All blocks of the report; `more` are further arguments of `sections`."""
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
        printed: published values, shown next to the fitted ones.
        posterior: blocks of `posterior.section`.
    """
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    implausible = [w for w in result.warnings if w.code == "plausibility"]
    bodies, line = bodies_table(result), result.unloading_line
    condition = result.condition_number
    rank = f"Rank {result.rank} of {len(result.covariance_names)} free parameters, "
    rank += "condition number " + ("infinite" if condition is None else number(condition, 2))
    methods, warned = interval_methods(result), warning_items(result.warnings, result)
    confidence = (
        f"Intervals contain the true value in {100 * result.confidence:g} % of experiments, if the law is "
        "right. Where the noise is estimated, dof is the number of degrees of freedom of Student's t:"
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
    """Warnings, with the symbols of the tables: χ̃, not chi."""
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
    """The fit in one sentence: law, data, fitted values and rms."""
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
    """A value with its error, interval and unit."""
    text, ends = (
        f"{s} {unit}".rstrip() for s in (estimate_text(estimate), interval_text(estimate))
    )
    return text if ABSENT in (ends.split()[0], text.split()[0]) else f"{text} ({confidence}{ends})"


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


def parameter_table(result: Any, printed: Printed | None = None) -> pd.DataFrame:
    """Value, standard error and interval of each parameter, and published values if any."""
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
    """Methods of the intervals in this result, each with its description."""
    used = {e.method for *_, e in _estimates(result) if interval_text(e) != ABSENT}
    return {name: text for name, text in METHODS.items() if name in used}


def quality_table(result: Any) -> pd.DataFrame:
    """Goodness of fit of each data set, and its estimated scatter."""
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
    """Goodness of fit of observables other than ε; no block if none was measured."""
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
    remarks = [*sorted(words), *modulus_lines(result)]
    return (
        [Block("table", pd.DataFrame(rows, columns=header)), Block("list", remarks)] if rows else []
    )


def modulus_lines(result: Any) -> list[str]:
    """How well the contact times of each data set would determine E."""
    lines = []
    for fit in result.materials:
        modulus = modulus_by_times(fit)
        if modulus is not None:
            lines.append(
                f"{fit.name}: the contact times would determine E to {100 * modulus.error:.2g} %, at "
                f"{np.exp(modulus.off):.3g} times the stated value; free youngs_modulus, or give it a prior"
            )
    return lines


def bodies_table(result: Any) -> pd.DataFrame | None:
    """One body in each row, or effective properties if the bodies are unknown; None without a contact."""
    if all(fit.data.contact is None for fit in result.materials):
        return None
    rows = []
    for fit in result.materials:
        for k, (body, *values) in enumerate(_bodies(fit.data)):
            rows.append([fit.name if k == 0 else "", body, *map(_range_text, values)])
    header = ["material", "body", "radius [m]", "mass [kg]", *PROPERTIES.values()]
    return pd.DataFrame(rows, columns=header)


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


def meanings(result: Any) -> list[str]:
    """Meanings of the symbols of the parameters."""
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
    owners: dict[str, list[str]] = {}
    parameters_of = stated_parameters(result.request.parameters, result.request.datasets)
    for fit, parameters in zip(result.materials, parameters_of, strict=True):
        for name, parameter in parameters.items():
            if isinstance(parameter, Parameter) and (words := _stated(parameter)):
                symbol = symbols.text(fit.model.canonical(name), fit.model)
                owners.setdefault(f"{symbol}: {words}", []).append(fit.name)
    return _with_owners(result, owners, "{text} ({names})")


def notes(result: Any) -> list[str]:
    """Remarks about the data, each once."""
    owners: dict[str, list[str]] = {}
    for fit in result.materials:
        for note in fit.data.notes:
            owners.setdefault(note, []).append(fit.name)
    return _with_owners(result, owners, "{names}: {text}")


def quality_words(result: Any) -> list[str]:
    """Meanings of the columns of the table of goodness of fit."""
    header = quality_table(result).columns
    return [f"{name}: {text}" for name, text in QUALITY.items() if name in header]


def outlier_lines(result: Any, most: int = 3) -> list[str]:
    """The largest outliers, and a line about misfit if there are many."""
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
    parts += ["a common factor of the stated uncertainties estimated"] * options.scale_uncertainty
    return ", ".join(parts)


def _optional(kind: str, value: list[Any], first: str = "") -> list[Block]:
    """A block with a sentence before it; no block if `value` is empty."""
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
    """Source and range of a data set, its objective, and where its curve is not determined."""
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
    """Coefficients of Eq. (18), fitted to all curves and to the fitted χ̃."""
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
    """Evaluations, seconds, final gradient and stop reason of each search; only sums if they are many."""
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
    one_optimiser = (
        len({one.optimiser for one in stages}) == 1
    )  # then the line of settings names it
    return Block("table", table.drop(columns="optimiser") if one_optimiser else table)


def _numbers(values: list[float | None], digits: int = 4) -> list[str] | None:
    """A column of rounded numbers; None if it contains no number."""
    return None if set(values) == {None} else [number(value, digits) for value in values]


def _estimates(
    result: Any, printed: Printed | None = None
) -> Iterator[tuple[str, str, symbols.Symbol, str, Estimate]]:
    """Yield data set, parameter, symbol, label in the covariance, and estimate; pooled ones last."""
    for fit in result.materials:
        estimates_of = {**fit.parameters, **fit.derived}
        # published properties of the contact, which follow from the bodies
        computed = [name for name in (printed or {}).get(fit.name, {}) if name not in estimates_of]
        estimates_of |= {
            n: Estimate(float(getattr(fit.contact, n)), method="computed") for n in computed
        }
        for name, estimate in estimates_of.items():
            symbol = symbols.symbol(name, fit.model)
            yield fit.name, name, symbol, fit.labels.get(name, name), estimate
    for name, estimate in result.pooled.items():
        base = name.removesuffix("_spread")
        symbol = symbols.symbol(base, result.materials[0].model)
        if base != name:
            symbol = symbol._replace(text=f"spread of {symbol.text}")
        yield "all together", name, symbol, name, estimate


def _interval_from(result: Any, estimate: Estimate, label: str) -> str:
    """Method of an interval and, for estimated noise, the degrees of freedom of its quantile."""
    if interval_text(estimate) == ABSENT:
        return ""
    degrees = result.degrees_of_freedom(label)
    is_normal = degrees is None or degrees >= MANY
    return estimate.method + ("" if is_normal else f", dof = {number(degrees, 3)}")


def _bodies(data: Any) -> Iterator[tuple[Any, ...]]:
    """Yield the name of each body, then radius, mass, E, ν, ρ and Y; None if unknown."""
    if data.contact is None:
        yield "not stated", *[None] * 6
    elif not data.bodies:
        pair = data.contact.leaves()
        effective = [pair[name] for name in ("radius", "mass", "youngs_modulus")]
        yield "the pair, effective", *effective, None, None, pair["yield_strength"]
    else:
        one, two = data.bodies
        equal = one.material == two.material and np.array_equal(one.radius, two.radius)
        for body in data.bodies[: 1 if equal else 2]:
            properties, mass = body.material.leaves(), None
            if body.radius is not None:
                mass = (
                    4 / 3 * np.pi * np.asarray(properties["density"]) * np.asarray(body.radius) ** 3
                )
            text = "two equal spheres" if equal else body.name
            yield text, body.radius, mass, *(properties[name] for name in PROPERTIES)


def _range_text(value: Any, digits: int = 4) -> str:
    """Text of a number, or of the range of an array."""
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


def _with_owners(result: Any, owners: Mapping[str, list[str]], form: str) -> list[str]:
    """Texts, each with the names of its data sets unless it applies to all."""
    every = len(result.materials)
    return [
        text if len(names) == every else form.format(text=text, names=", ".join(names))
        for text, names in owners.items()
    ]
