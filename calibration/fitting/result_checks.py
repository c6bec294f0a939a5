"""What must go together in a `fit.json`: checked before a result is made of it.

A variance that is negative, or degrees of freedom, would give a band of no width.
"""

from collections.abc import Mapping
from itertools import chain
from typing import Any

import numpy as np

from calibration.data.measurements import LONGEST_NAME
from calibration.errors import DataError
from calibration.fitting.result_schema import RESULT

ROUNDING = 1e-4  # of a covariance scaled to ones: below it a negative eigenvalue is rounding's


def check_result(found: Any) -> None:
    """Refuse what `FitResult.save` cannot have written.

    Raises:
        DataError: naming the place, what stands there and what is accepted.
    """
    RESULT(found, "")
    names = found["covariance"]["names"]
    _no_twice("covariance.names", names)
    _no_twice("fits.material", [fit["material"] for fit in found["fits"]])
    _same("fits", len(found["fits"]), "one or more", max(len(found["fits"]), 1))
    _same("request.parameters", len(found["request"]["parameters"]), "fits", len(found["fits"]))
    options = found["request"]["options"]
    _same("confidence", found["confidence"], "request.options.confidence", options["confidence"])
    for i, fit in enumerate(found["fits"]):
        _check_fit(fit, f"fits[{i}]", names)
    _check_covariance("covariance.matrix", found["covariance"]["matrix"], len(names))
    _check_covariance("covariance_of_predictions", found["covariance_of_predictions"], len(names))
    for i, freedom in enumerate(found["freedom"]):
        _check_freedom(freedom, f"freedom[{i}]", names)
    _same(
        "freedom.labels",
        sorted(chain.from_iterable(one["labels"] for one in found["freedom"])),
        "covariance.names",
        sorted(names),
    )
    line = found["unloading_line"]
    estimates = [
        e for fit in found["fits"] for e in [*fit["parameters"].values(), *fit["derived"].values()]
    ]
    estimates += [] if line is None else [line["c1"], line["c2"], *line["chi"].values()]
    for estimate in estimates:
        _same("interval", len(estimate["interval"]), "a pair", 2)


def _check_fit(fit: Mapping[str, Any], place: str, names: list[str]) -> None:
    data, n = fit["data"], fit["n"]
    if not 0 < len(fit["material"].strip()) <= LONGEST_NAME:
        accepted = f"a text of 1 to {LONGEST_NAME} characters"
        raise DataError(f"{place}.material", fit["material"], accepted)
    _same(f"{place}.data.velocity", len(data["velocity"]), f"{place}.n", n)
    for name in ("status", "standardised", "leverage"):
        _same(f"{place}.{name}", len(fit[name]), f"{place}.n", n)
    _same(f"{place}.known", len(fit["known"]), "a pair", 2)
    if fit["known"][0] is None:
        raise DataError(f"{place}.known[0]", None, "a number of 0 or more")
    for name, label in fit["labels"].items():
        if name not in fit["values"] or label not in names:
            raise DataError(f"{place}.labels", f"{name}: {label}", "of values and covariance.names")
    for name, value in fit["values"].items():
        if isinstance(value, list) and (name in fit["labels"] or len(value) != n):
            accepted = f"a number, or {n} of one that is held"
            raise DataError(f"{place}.values.{name}", value, accepted)
    if data["errors"] is not None:
        _check_errors(data["errors"], f"{place}.data.errors", n)


def _check_errors(errors: Mapping[str, Any], place: str, n: int) -> None:
    for name in ("index", "to_restitution", "to_velocity"):
        _same(f"{place}.{name}", len(errors[name]), f"{place[:-12]}.n", n)
        _same(f"{place}.{name}", {len(row) for row in errors[name]}, "three a point", {3})
    most = 3 * n if errors["size"] is None else len(errors["size"])
    if max(map(max, errors["index"])) >= most:
        raise DataError(f"{place}.index", "beyond the errors", f"below {most}")
    for name in ("restitution_alone", "velocity_alone"):
        if errors[name] is not None:
            _same(f"{place}.{name}", len(errors[name]), f"{place[:-12]}.n", n)


def _check_freedom(freedom: Mapping[str, Any], place: str, names: list[str]) -> None:
    labels, count = freedom["labels"], len(freedom["names"])
    _same(f"{place}.sets", len(freedom["sets"]), f"{place}.names", count)
    _same(f"{place}.parts", len(freedom["parts"]), f"{place}.names", count)
    for i, part in enumerate(freedom["parts"]):
        _check_covariance(f"{place}.parts[{i}]", part, len(labels))
    _check_covariance(f"{place}.relative", freedom["relative"], count)


def _check_covariance(place: str, rows: list[list[float | None]], size: int) -> None:
    """A square matrix without negative variances; what is null is not known."""
    shape = [len(row) for row in rows]
    if shape != [size] * size:
        raise DataError(place, f"rows of {shape}", f"{size} rows of {size}")
    matrix = np.array(rows, float).reshape(size, size)
    variance = np.diag(matrix)
    if np.any(variance < 0):
        raise DataError(place, f"with a variance of {np.min(variance)}", "without negative ones")
    if np.all(np.isfinite(matrix)):
        scale = np.sqrt(np.where(variance > 0, variance, 1.0))
        with np.errstate(over="ignore"):
            scaled = matrix / scale[:, None] / scale
        sound = np.all(np.isfinite(scaled)) and np.all(np.abs(scaled) <= 1 + ROUNDING)
        if not sound or np.min(np.linalg.eigvalsh(scaled + scaled.T), initial=0) < -2 * ROUNDING:
            raise DataError(place, "with a negative variance of a sum", "a covariance")


def _same(place: str, one: Any, other_place: str, other: Any) -> None:
    if one != other:
        raise DataError(
            place, f"of {one}" if isinstance(one, int) else one, f"{other} ({other_place})"
        )


def _no_twice(place: str, names: list[str]) -> None:
    if len(set(names)) != len(names):
        raise DataError(place, names, "each name once")
