"""`fit.json`: a result as JSON and back. What is undefined is null, never NaN."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.atomic import replacing
from calibration.data.measurements import RestitutionData
from calibration.doubt import Doubt
from calibration.estimate import Estimate, Line
from calibration.material_fit import MaterialFit
from calibration.profiles import Profile
from calibration.result import FitResult
from calibration.stages import Stage


def result_to_dict(result: FitResult, times: bool = True) -> dict[str, Any]:
    """The layout of `fit.json`."""
    table = {
        "fits": [_material_to_dict(material) for material in result.materials],
        "unloading_line": _line_to_dict(result.unloading_line),
        "settings": result.settings,
        "versions": result.versions,
        "converged": result.converged,
        "warnings": [_doubt_to_dict(doubt) for doubt in result.warnings],
        "covariance": {"names": result.covariance_names, "matrix": result.covariance},
        "rank": result.rank,
        "condition_number": result.condition_number,
        "confidence": result.confidence,
        "degrees_of_freedom": result.degrees,
        "profiles": {label: asdict(profile) for label, profile in result.profiles.items()},
        "optimiser_report": [asdict(stage) for stage in result.optimiser_report],
        "beside": result.beside,
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


def save(result: FitResult, path: str | Path) -> None:
    with replacing(path) as staged:
        staged.write_text(result.to_json(), encoding="utf-8")


def load(path: str | Path) -> FitResult:
    try:
        table = json.loads(Path(path).read_text(encoding="utf-8"))
        return _result_from_dict(table)
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path}: no result of a fit ({error!r}); fit.json is accepted") from None


def _result_from_dict(table: dict[str, Any]) -> FitResult:
    covariance = table["covariance"]
    size = len(covariance["names"])
    matrix = [[math.nan if x is None else x for x in row] for row in covariance["matrix"]]
    return FitResult(
        materials=tuple(_material_from_dict(one, table["settings"]) for one in table["fits"]),
        unloading_line=_line_from_dict(table["unloading_line"]),
        covariance_names=tuple(covariance["names"]),
        covariance=np.array(matrix, float).reshape(size, size),
        rank=table["rank"],
        condition_number=table["condition_number"],
        confidence=table["confidence"],
        warnings=tuple(_doubt_from_dict(one) for one in table["warnings"]),
        optimiser_report=tuple(Stage(**one) for one in table["optimiser_report"]),
        beside=table["beside"],
        profiles={k: _profile_from_dict(one) for k, one in table["profiles"].items()},
        degrees=tuple(table["degrees_of_freedom"]),
        settings=table["settings"],
        versions=table["versions"],
        times=table.get("times", {}),
    )


def _material_to_dict(material: MaterialFit) -> dict[str, Any]:
    return {
        "material": material.name,
        "n": material.n,
        "rms": material.rms,
        "rms_empirical": material.rms_empirical,
        "converged": material.converged,
        "warnings": [_doubt_to_dict(doubt) for doubt in material.warnings],
        "parameters": {k: _estimate_to_dict(e) for k, e in material.parameters.items()},
        "derived": {k: _estimate_to_dict(e) for k, e in material.derived.items()},
        "reduced_chi_squared": material.reduced_chi_squared,
        "objective": material.plan,
        "columns": material.columns,
        "status": material.status,
        "data": _data_to_dict(material.data),
    }


def _material_from_dict(table, settings) -> MaterialFit:
    return MaterialFit(
        data=_data_from_dict(table["material"], table["data"]),
        plan=table["objective"],
        parameters={k: _estimate_from_dict(e) for k, e in table["parameters"].items()},
        derived={k: _estimate_from_dict(e) for k, e in table["derived"].items()},
        columns=table["columns"],
        rms=table["rms"],
        rms_empirical=table["rms_empirical"],
        reduced_chi_squared=table["reduced_chi_squared"],
        converged=table["converged"],
        status=tuple(table["status"]),
        warnings=tuple(_doubt_from_dict(one) for one in table["warnings"]),
        form=settings["form"],
        kappa=settings["kappa"],
    )


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
    return Doubt(table["code"], table["cause"], table["material"])


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


def _data_to_dict(data: RestitutionData) -> dict[str, Any]:
    contact = data.contact
    return {
        "velocity": data.velocity,
        "restitution": data.restitution,
        "uncertainty": data.uncertainty,
        "velocity_uncertainty": data.velocity_uncertainty,
        "limit_velocity": data.limit_velocity,
        "contact": contact and {**contact.leaves(), "area": contact.area},
        "remarks": data.remarks,
    }


def _data_from_dict(name: str, table) -> RestitutionData:
    arrays = {k: np.array(v) if isinstance(v, list) else v for k, v in table.items()}
    contact = table["contact"]
    if contact is not None:
        leaves = {k: np.array(v) if isinstance(v, list) else v for k, v in contact.items()}
        arrays["contact"] = sj.Contact(**leaves)
    arrays["remarks"] = tuple(table["remarks"])
    return RestitutionData(name=name, **arrays)
