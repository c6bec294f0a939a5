"""`fit.json`: a result as JSON and back. What is undefined is null, never NaN."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.as_json import data_from_dict, data_to_dict
from calibration.data.json_file import read_json
from calibration.errors import DataError, InputError, shown
from calibration.fitting.doubt import Doubt
from calibration.fitting.estimate import Estimate, Line
from calibration.fitting.freedom import Freedom
from calibration.fitting.known_laws import LAWS
from calibration.fitting.likelihood import Likelihood
from calibration.fitting.material import MaterialFit
from calibration.fitting.profiles import Profile
from calibration.fitting.request import checked
from calibration.fitting.request_json import request_from_dict, request_to_dict
from calibration.fitting.result_checks import check_result
from calibration.fitting.rows import Tree
from calibration.fitting.specs import law_model
from calibration.fitting.stages import Stage


def result_to_dict(result: Any, times: bool = True) -> dict[str, Any]:
    """The layout of `fit.json`."""
    table = {
        "fits": [_material_to_dict(material) for material in result.materials],
        "unloading_line": _line_to_dict(result.unloading_line),
        "settings": result.settings,
        "versions": result.versions,
        "converged": result.converged,
        "warnings": [_doubt_to_dict(doubt) for doubt in result.warnings],
        "covariance": {"names": result.covariance_names, "matrix": result.covariance},
        "covariance_of_predictions": result.of_predictions,
        "rank": result.rank,
        "condition_number": result.condition_number,
        "likelihood": None if result.likelihood is None else _likelihood(result.likelihood),
        "confidence": result.confidence,
        "freedom": [one.to_dict() for one in result.freedoms],
        "profiles": {label: asdict(profile) for label, profile in result.profiles.items()},
        "optimiser_report": [asdict(stage) for stage in result.optimiser_report],
        "beside": result.beside,
        "pooled": {name: _estimate_to_dict(one) for name, one in result.pooled.items()},
        "request": request_to_dict(result.request),
    }
    if times:
        table["times"] = result.times
    return plain(table)


def plain(value) -> Any:
    """JSON's own types; what is not finite becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.bool_ | bool):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if value is None or isinstance(value, str):
        return value
    if np.ndim(value):
        return plain(np.asarray(value).tolist())
    number = float(value)
    return number if math.isfinite(number) else None


def dumps(table: dict[str, Any]) -> str:
    return json.dumps(table, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def read_result(path: str | Path, law: Any = None) -> dict[str, Any]:
    """What a `FitResult` is made of, as `save` wrote it.

    Raises:
        InputError: a ValueError, where the file is no result of a fit.
        DataError: a ValueError, where it is of a law that was not given.
    """
    table = read_json(path)
    accepted = "only a fit's own fit.json is accepted"
    try:
        check_result(table)
        parts = _parts(table, law)
        for material in parts["materials"]:
            material.law  # noqa: B018  # that there can be one
        return parts
    except DataError as error:
        if error.argument == "law":
            raise
        problem = f"is no result of a fit: {error.argument} is {error.value}"
        raise InputError(path, None, problem, f"it must be {error.accepted}; {accepted}") from None
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        problem = f"is no result of a fit ({shown(str(error))})"
        raise InputError(path, None, problem, accepted) from None


def _parts(table: dict[str, Any], law: Any) -> dict[str, Any]:
    covariance = table["covariance"]
    size = len(covariance["names"])
    likelihood = table["likelihood"]
    datasets = tuple(data_from_dict(one["material"], one["data"]) for one in table["fits"])
    pairs = zip(table["fits"], datasets, strict=True)
    return {
        "request": checked(
            request_from_dict(table["request"], datasets, _law(table["request"], law))
        ),
        "materials": tuple(_material_from_dict(one, data, law) for one, data in pairs),
        "unloading_line": _line_from_dict(table["unloading_line"]),
        "covariance_names": tuple(covariance["names"]),
        "covariance": _matrix(covariance["matrix"], size),
        "of_predictions": _matrix(table["covariance_of_predictions"], size),
        "rank": table["rank"],
        "condition_number": table["condition_number"],
        "likelihood": None if likelihood is None else Likelihood(*_counts(likelihood)),
        "warnings": tuple(_doubt_from_dict(one) for one in table["warnings"]),
        "optimiser_report": tuple(_stage_from_dict(one) for one in table["optimiser_report"]),
        "beside": table["beside"],
        "profiles": {k: _profile_from_dict(one) for k, one in table["profiles"].items()},
        "pooled": {k: _estimate_from_dict(one) for k, one in table["pooled"].items()},
        "freedoms": tuple(Freedom.from_dict(one) for one in table["freedom"]),
        "settings": table["settings"],
        "versions": table["versions"],
        "times": table.get("times", {}),
    }


def _likelihood(one: Likelihood) -> dict[str, Any]:
    return {**asdict(one), "aic": one.aic, "bic": one.bic}


def _counts(table) -> tuple:
    return table["log"], table["fitted"], table["points"]


def _matrix(rows, size: int) -> np.ndarray:
    matrix = [[math.nan if x is None else x for x in row] for row in rows]
    return np.array(matrix, float).reshape(size, size)


def _law(table, law: Any) -> Any:
    """The law that a file names: a built-in one, or the one that was given."""
    name = table["law"]
    if name is None or name in LAWS:
        return name
    if law is None:
        raise DataError(
            "law", f"{name}, which is none of {', '.join(LAWS)}", "given: load(path, law=…)"
        )
    return type(law) if isinstance(law, sj.ContactLaw) else law


def _material_to_dict(material: MaterialFit) -> dict[str, Any]:
    return {
        "material": material.name,
        "n": material.n,
        "rms": material.rms,
        "rms_empirical": material.rms_empirical,
        "empirical": None if material.empirical is None else dict(material.empirical),
        "converged": material.converged,
        "warnings": [_doubt_to_dict(doubt) for doubt in material.warnings],
        "parameters": {k: _estimate_to_dict(e) for k, e in material.parameters.items()},
        "derived": {k: _estimate_to_dict(e) for k, e in material.derived.items()},
        "reduced_chi_squared": material.reduced_chi_squared,
        "objective": material.objective,
        "law": material.model.key,
        "options": dict(material.model.options),
        "values": dict(material.values),
        "labels": dict(material.labels),
        "status": material.status,
        "known": [material.known_from, material.known_to],
        "variances": dict(material.variances),
        "timing": material.timing,
        "standardised": material.standardised,
        "leverage": material.leverage,
        "residual_degrees": material.residual_degrees,
        "chi_squared_probability": material.probability,
        "data": data_to_dict(material.data),
    }


def _material_from_dict(table, data: RestitutionData, law: Any) -> MaterialFit:
    values = {k: np.array(v) if isinstance(v, list) else v for k, v in table["values"].items()}
    chosen = _law(table, law)
    known_from, known_to = table["known"]
    return MaterialFit(
        data=data,
        objective=table["objective"],
        model=law_model(data, chosen, table["options"], values),
        parameters={k: _estimate_from_dict(e) for k, e in table["parameters"].items()},
        derived={k: _estimate_from_dict(e) for k, e in table["derived"].items()},
        values=values,
        labels=table["labels"],
        trees=_trees(values, law),
        rms=table["rms"],
        rms_empirical=table["rms_empirical"],
        empirical=table["empirical"],
        reduced_chi_squared=table["reduced_chi_squared"],
        converged=table["converged"],
        status=tuple(table["status"]),
        known_from=known_from,
        known_to=math.inf if known_to is None else known_to,
        variances=table["variances"],
        timing=table["timing"],
        standardised=tuple(table["standardised"]),
        leverage=tuple(table["leverage"]),
        residual_degrees=table["residual_degrees"],
        warnings=tuple(_doubt_from_dict(one) for one in table["warnings"]),
    )


def _trees(values, law: Any) -> tuple[Tree, ...]:
    """How the numbers of whole parameters make up pytrees: as in the law that was given."""
    names = dict.fromkeys(name.partition("[")[0] for name in values if "[" in name)
    if names and not isinstance(law, sj.ContactLaw):
        accepted = "given as one such law, whose whole fields tell how their numbers are arranged"
        raise DataError("law", law, accepted)
    return tuple(Tree.of(name, getattr(law, name)) for name in names)


def _estimate_to_dict(e: Estimate) -> dict[str, Any]:
    table = asdict(e)
    return {
        "value": table.pop("value"),
        "standard_error": table.pop("standard_error"),
        "interval": [table.pop("low"), table.pop("high")],
        **table,
    }


def _estimate_from_dict(table) -> Estimate:
    rest = {key: table[key] for key in ("value", "standard_error", "method", "free", "at_bound")}
    low, high = table["interval"]
    return Estimate(low=low, high=high, **rest)


def _doubt_to_dict(doubt: Doubt) -> dict[str, Any]:
    return asdict(doubt) | {"remedy": doubt.remedy}


def _doubt_from_dict(table) -> Doubt:
    return Doubt(table["code"], table["cause"], table["material"], table["advice"])


def _stage_from_dict(table) -> Stage:
    return Stage(**table | {"materials": tuple(table["materials"])})


def _profile_from_dict(table) -> Profile:
    sequences = {k: tuple(v) for k, v in table.items() if isinstance(v, list)}
    return Profile(**table | sequences)


def _line_to_dict(line: Line | None) -> dict[str, Any] | None:
    if line is None:
        return None
    through = line.through_chi
    return {
        "c1": _estimate_to_dict(line.c1),
        "c2": _estimate_to_dict(line.c2),
        "rms": line.rms,
        "chi": {k: _estimate_to_dict(e) for k, e in line.chi.items()},
        "through_chi": through and {k: _estimate_to_dict(e) for k, e in through.items()},
        "converged": line.converged,
        "method": line.method,
    }


def _line_from_dict(table) -> Line | None:
    if table is None:
        return None
    through = table["through_chi"]
    return Line(
        c1=_estimate_from_dict(table["c1"]),
        c2=_estimate_from_dict(table["c2"]),
        rms=table["rms"],
        chi={k: _estimate_from_dict(e) for k, e in table["chi"].items()},
        through_chi=through and {k: _estimate_from_dict(e) for k, e in through.items()},
        converged=table["converged"],
        method=table["method"],
    )
