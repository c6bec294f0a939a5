"""`fit.json`: a result as JSON and back. What is undefined is null, never NaN."""

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.data.as_json import data_from_dict, data_to_dict
from calibration.data.json_file import plain, read_json
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

# a material's entries that are its fields, in the order of the file
FIRST = (
    "rms",
    "rms_empirical",
    "empirical",
    "converged",
    "warnings",
    "parameters",
    "derived",
    "reduced_chi_squared",
    "objective",
)
THEN = ("values", "labels", "status")
LAST = ("variances", "timing", "standardised", "leverage", "residual_degrees")
Table = Mapping[str, Any]


def result_to_dict(result: Any, times: bool = True) -> dict[str, Any]:
    """The layout of `fit.json`."""
    table = {
        "fits": [_material_to_dict(material) for material in result.materials],
        "unloading_line": result.unloading_line,
        "settings": result.settings,
        "versions": result.versions,
        "converged": result.converged,
        "warnings": result.warnings,
        "covariance": {"names": result.covariance_names, "matrix": result.covariance},
        "covariance_of_predictions": result.of_predictions,
        "rank": result.rank,
        "condition_number": result.condition_number,
        "likelihood": result.likelihood,
        "confidence": result.confidence,
        "freedom": result.freedoms,
        "profiles": result.profiles,
        "optimiser_report": result.optimiser_report,
        "pooled": result.pooled,
        "request": request_to_dict(result.request),
    }
    if times:
        table["times"] = result.times
    return plain(table)


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


def _parts(table: Table, law: Any) -> dict[str, Any]:
    covariance = table["covariance"]
    size = len(covariance["names"])
    likelihood = table["likelihood"]
    datasets = tuple(data_from_dict(one["material"], one["data"]) for one in table["fits"])
    pairs = zip(table["fits"], datasets, strict=True)
    same = ("rank", "condition_number", "settings", "versions")
    return {name: table[name] for name in same} | {
        "request": checked(request_from_dict(table["request"], datasets, _asked(table, law))),
        "materials": tuple(_material_from_dict(one, data, law) for one, data in pairs),
        "unloading_line": _line(table["unloading_line"]),
        "covariance_names": tuple(covariance["names"]),
        "covariance": _matrix(covariance["matrix"], size),
        "of_predictions": _matrix(table["covariance_of_predictions"], size),
        "likelihood": None if likelihood is None else _made(Likelihood, likelihood),
        "warnings": _doubts(table["warnings"]),
        "optimiser_report": tuple(_made(Stage, one) for one in table["optimiser_report"]),
        "profiles": {label: _made(Profile, one) for label, one in table["profiles"].items()},
        "pooled": _estimates(table["pooled"]),
        "freedoms": tuple(Freedom.from_dict(one) for one in table["freedom"]),
        "times": table.get("times", {}),
    }


def _made(kind: type, table: Table) -> Any:
    """A record of the entries that have the names of its fields."""
    entries = {field.name: table[field.name] for field in fields(kind)}
    return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in entries.items()})


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


def _asked(table, law: Any) -> Any:
    return _law(table["request"]["options"], law)


def _material_to_dict(material: MaterialFit) -> dict[str, Any]:
    first, then, last = (
        {name: getattr(material, name) for name in names} for names in (FIRST, THEN, LAST)
    )
    return {
        "material": material.name,
        "n": material.n,
        **first,
        "law": material.model.key,
        "options": material.model.options,
        **then,
        "known": [material.known_from, material.known_to],
        **last,
        "chi_squared_probability": material.probability,
        "data": data_to_dict(material.data),
    }


def _material_from_dict(table: Table, data: RestitutionData, law: Any) -> MaterialFit:
    values = {k: np.array(v) if isinstance(v, list) else v for k, v in table["values"].items()}
    known_from, known_to = table["known"]
    entries = {name: table[name] for name in (*FIRST, *THEN, *LAST)} | {
        "data": data,
        "model": law_model(data, _law(table, law), table["options"], values),
        "values": values,
        "trees": _trees(values, law),
        "parameters": _estimates(table["parameters"]),
        "derived": _estimates(table["derived"]),
        "known_from": known_from,
        "known_to": math.inf if known_to is None else known_to,
        "warnings": _doubts(table["warnings"]),
    }
    return _made(MaterialFit, entries)


def _trees(values, law: Any) -> tuple[Tree, ...]:
    """How the numbers of whole parameters make up pytrees: as in the law that was given."""
    names = dict.fromkeys(name.partition("[")[0] for name in values if "[" in name)
    if names and not isinstance(law, sj.ContactLaw):
        accepted = "given as one such law, whose whole fields tell how their numbers are arranged"
        raise DataError("law", law, accepted)
    return tuple(Tree.of(name, getattr(law, name)) for name in names)


def _estimate(table: Table) -> Estimate:
    low, high = table["interval"]
    return _made(Estimate, {**table, "low": low, "high": high})


def _estimates(table: Table) -> dict[str, Estimate]:
    return {name: _estimate(one) for name, one in table.items()}


def _doubts(rows: list[Table]) -> tuple[Doubt, ...]:
    return tuple(_made(Doubt, one) for one in rows)


def _line(table: Table | None) -> Line | None:
    if table is None:
        return None
    ends = {name: _estimate(table[name]) for name in ("c1", "c2")}
    through = table["through_chi"] and _estimates(table["through_chi"])
    return _made(Line, {**table, **ends, "chi": _estimates(table["chi"]), "through_chi": through})
