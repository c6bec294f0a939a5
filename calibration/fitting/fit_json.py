"""`fit.json`: a result as JSON and back. What is undefined is null, never NaN.

The models below, with the records that they hold, are the layout of the file:
`ResultFile.model_json_schema()` is its JSON Schema.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator, ValidationError, WithJsonSchema

import softjax as sj
from calibration.data import PointErrors, RestitutionData
from calibration.data.air import Fall
from calibration.data.bodies import Body
from calibration.data.json_file import plain
from calibration.data.measurements import BESIDE, LONGEST_NAME
from calibration.data.text_file import MIB, read_text
from calibration.errors import DataError, InputError, shown
from calibration.fitting.budget import Budget
from calibration.fitting.components import Likelihood
from calibration.fitting.degrees_of_freedom import DegreesOfFreedom
from calibration.fitting.laws import LAWS, Tree, law_name
from calibration.fitting.line import Line
from calibration.fitting.material import Estimate, Goodness, MaterialFit, Outlier
from calibration.fitting.noise import FAMILIES
from calibration.fitting.profiles import Profile
from calibration.fitting.request import Request, law_model, stated_parameters
from calibration.fitting.stages import Stage
from calibration.fitting.warnings import FitWarning
from calibration.options import FitOptions, route_named
from calibration.parameters import Parameter
from calibration.schema import Real, Strict, faults

FORMAT = 1
LARGEST = 24 * MIB
AS_THEY_ARE = (
    *("unloading_line", "settings", "versions", "warnings", "rank", "condition_number"),
    *("likelihood", "profiles", "optimiser_report", "pooled", "budget", "times"),
    "of_one_per_cent",
)
OWN = "only a fit's own fit.json is accepted"
# keys of the file that are not the names of the fields of `PointErrors`
KEYS_OF_ERRORS = {"u_restitution": "restitution_alone", "u_velocity": "velocity_alone"}


def as_covariance(rows: Any) -> np.ndarray:
    """A square matrix without negative variances, NaN where it is not known."""
    if not isinstance(rows, list) or [len(row) for row in rows] != [len(rows)] * len(rows):
        raise ValueError("a square matrix, row by row")
    matrix = np.array([[math.nan if x is None else x for x in row] for row in rows], float)
    matrix = matrix.reshape(len(rows), len(rows))
    if np.any(np.diag(matrix) < 0):
        raise ValueError("without a negative variance")
    return matrix


Count = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Column = list[float] | None
Leaf = Positive | list[Positive]  # of the bodies: one number, or one an impact
Several = Annotated[list[float], Field(min_length=1)]
Covariance = Annotated[
    np.ndarray,
    PlainValidator(as_covariance),
    WithJsonSchema({"type": "array", "items": {"type": "array"}, "accepted": "a covariance"}),
]


class DataRecord(Strict):
    """One set of data; where it came from is not kept."""

    velocity: list[Positive]
    restitution: list[NotNegative | None]  # None where ε was not measured
    limit_velocity: Leaf | None
    degrees: Leaf | None
    uncertainty: Column
    velocity_uncertainty: Column
    contact: dict[str, Leaf | str] | None
    bodies: list[dict[str, float | Several | str | None]] = Field(default_factory=list)
    remarks: tuple[str, ...]
    group: list[str] | None
    errors: dict[str, Any] | None
    observed: dict[Literal[BESIDE], list[Real]] = Field(default_factory=dict)  # type: ignore[valid-type]
    dent: Literal["largest", "residual"] = "largest"
    fall: Fall | None = None

    @classmethod
    def record_of(cls, data: RestitutionData) -> dict[str, Any]:
        return _by_names(
            cls,
            data,
            bodies=[{"name": b.name, "radius": b.radius, **vars(b.material)} for b in data.bodies],
            errors=_errors_entry(data.errors) if np.any(data.errors.index >= 0) else None,
            observed=dict(data.measured),
        )

    def data(self, name: str) -> RestitutionData:
        """The data set that the record describes; it was checked once."""
        entries = {key: np.array(x) if isinstance(x, list) else x for key, x in self}
        entries["measured"] = _arrays(entries.pop("observed"))
        if self.errors is not None:
            entries |= {"uncertainty": None, "velocity_uncertainty": None}
            names = {key: name for name, key in KEYS_OF_ERRORS.items()}
            named = {names.get(key, key): x for key, x in self.errors.items()}
            entries["errors"] = PointErrors(**_arrays(named))
        entries |= {
            "restitution": np.array(self.restitution, float),
            "contact": self.contact
            and sj.Contact(**_arrays(self.contact) | {"area": self.contact.get("area")}),
            "bodies": tuple(_body(**_arrays(body)) for body in self.bodies),
            "group": self.group,
        }
        return RestitutionData(**entries, name=name)


class FitRecord(Strict):
    """The fit of one data set."""

    material: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME, pattern=r"\S")]
    n: Annotated[int, Field(ge=1)]
    rms: float
    rms_empirical: float | None
    empirical: dict[str, float | None] | None
    converged: bool
    warnings: tuple[FitWarning, ...]
    parameters: dict[str, Estimate]
    derived: dict[str, Estimate]
    reduced_chi_squared: NotNegative | None
    objective: Literal["model", "two-step"]
    law: str
    options: dict[str, str]
    units: dict[str, str] = Field(default_factory=dict)  # of an own law's parameters
    values: dict[str, float | list[float]]
    labels: dict[str, str]
    status: tuple[Count, ...]
    observed: dict[str, Goodness]
    known: tuple[NotNegative, NotNegative | None]
    variances: dict[str, NotNegative | None]
    timing: NotNegative | None
    noise_dof: NotNegative | None
    noise_family: Literal[tuple(FAMILIES)]  # type: ignore[valid-type]
    outliers: tuple[Outlier, ...]
    standardised: tuple[Real, ...]
    deviations: tuple[Real, ...] = ()
    weights: tuple[Real, ...] = ()
    residuals: tuple[Real, ...]
    residual_degrees: NotNegative
    group_offsets: dict[str, tuple[Real, NotNegative | None]] = Field(default_factory=dict)
    chi_squared_probability: float | None
    data: DataRecord

    @classmethod
    def record_of(cls, fit: MaterialFit) -> dict[str, Any]:
        units = {name: p.unit for name, p in fit.model.parameters.items() if p.unit != "-"}
        return _by_names(
            cls,
            fit,
            material=fit.name,
            law=fit.model.key,
            options=fit.model.options,
            units={} if fit.model.key in LAWS else units,
            known=[fit.known_from, fit.known_to],
            chi_squared_probability=fit.probability,
            data=DataRecord.record_of(fit.data),
        )

    def fit(self, data: RestitutionData, law: Any) -> MaterialFit:
        values, (known_from, known_to) = _arrays(self.values), self.known
        model = law_model(data, _law(self.law, law), self.options, values).with_units(self.units)
        common = {field.name for field in fields(MaterialFit)} & set(FitRecord.model_fields)
        result = MaterialFit(
            **{name: getattr(self, name) for name in common - {"data", "values"}},
            data=data,
            model=replace(model, trees=_trees(values, law)),
            values=values,
            known_from=known_from,
            known_to=math.inf if known_to is None else known_to,
        )
        result.law  # noqa: B018  # that there can be one
        return result


class DegreesOfFreedomRecord(Strict):
    labels: tuple[str, ...]
    parts: list[Covariance]
    relative: Covariance
    sets: tuple[str, ...]
    names: tuple[str, ...]

    def dof(self) -> DegreesOfFreedom:
        size, count = len(self.labels), len(self.names)
        parts = np.reshape(self.parts, (count, size, size))
        return DegreesOfFreedom(**dict(self) | {"parts": parts})


class RequestRecord(Strict):
    """Requested fit: options as in `FitOptions`, and the name of a user's law."""

    parameters: list[dict[str, Any]]
    options: dict[str, Any]

    @classmethod
    def record_of(cls, request: Request) -> dict[str, Any]:
        stated = stated_parameters(request.parameters, request.datasets)
        options = request.options.model_dump(mode="json", exclude={"law"})
        options |= {"law": law_name(request.options.law)}
        tables = [{name: _parameter_entry(p) for name, p in each.items()} for each in stated]
        return {"parameters": tables, "options": options}

    def request(self, datasets: tuple[RestitutionData, ...], law: Any) -> Request:
        given = self.options | {"law": _law(self.options.get("law"), law)}
        if isinstance(given.get("route"), dict):
            given["route"] = route_named(**given["route"])
        stated = [{name: _parameter(p) for name, p in each.items()} for each in self.parameters]
        return Request(datasets, stated, FitOptions.of(**given))


class CovarianceRecord(Strict):
    names: tuple[str, ...]
    matrix: Covariance


class ResultFile(Strict):
    """The layout of `fit.json`."""

    format: Literal[1]
    fits: Annotated[list[FitRecord], Field(min_length=1)]
    unloading_line: Line | None
    settings: dict[str, Any]
    versions: dict[str, str]
    converged: bool
    warnings: tuple[FitWarning, ...]
    covariance: CovarianceRecord
    covariance_of_predictions: Covariance
    statistical_covariance: Covariance
    rank: Count
    condition_number: float | None
    likelihood: Likelihood | None
    confidence: Annotated[float, Field(gt=0, lt=1)]
    freedom: list[DegreesOfFreedomRecord]
    profiles: dict[str, Profile]
    optimiser_report: tuple[Stage, ...]
    pooled: dict[str, Estimate]
    budget: Budget | None
    of_one_per_cent: dict[str, dict[str, float]] = Field(default_factory=dict)
    request: RequestRecord
    times: dict[str, NotNegative] = Field(default_factory=dict)


def result_to_dict(result: Any, times: bool) -> dict[str, Any]:
    """Contents of `fit.json`."""
    table = _by_names(
        ResultFile,
        result,
        format=FORMAT,
        fits=[FitRecord.record_of(material) for material in result.materials],
        covariance={"names": result.covariance_names, "matrix": result.covariance},
        covariance_of_predictions=result.of_predictions,
        freedom=result.dof_by_component,
        request=RequestRecord.record_of(result.request),
    )
    entries = plain(table)
    return entries if times else {key: value for key, value in entries.items() if key != "times"}


def read_result(path: str | Path, law: Any = None) -> dict[str, Any]:
    """Fields of a `FitResult`, from a file that `save` wrote.

    Raises:
        InputError: a ValueError, where the file is no result of a fit.
        DataError: a ValueError, where it is of a law that was not given.
    """
    text = read_text(path, LARGEST)
    try:
        file = ResultFile.model_validate_json(text, strict=True)
        _check(file)
        datasets = tuple(entry.data.data(entry.material) for entry in file.fits)
        pairs = zip(file.fits, datasets, strict=True)
        return {name: getattr(file, name) for name in AS_THEY_ARE} | {
            "request": file.request.request(datasets, law),
            "materials": tuple(entry.fit(data, law) for entry, data in pairs),
            "covariance_names": file.covariance.names,
            "covariance": file.covariance.matrix,
            "of_predictions": file.covariance_of_predictions,
            "statistical_covariance": file.statistical_covariance,
            "dof_by_component": tuple(entry.dof() for entry in file.freedom),
        }
    except ValidationError as error:
        raise _refusal(path, error) from None
    except DataError as error:
        if error.argument == "law":
            raise
        raise _no_result(path, error) from None
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        of = "" if law is None else f" of {law_name(law)}"
        raise InputError(
            path, None, f"is no result of a fit{of} ({shown(str(error))})", OWN
        ) from None


def _refusal(path: str | Path, error: ValidationError) -> InputError:
    first = error.errors()[0]
    if first["type"] == "json_invalid":
        problem, _, line = first["msg"].partition(" at line ")
        return InputError(path, int(line.split()[0]), problem, "a JSON file is needed")
    if first["loc"] == ("format",):
        given = "without a format" if first["type"] == "missing" else f"of format {first['input']}"
        accepted = f"format {FORMAT} is read by this version: fit the data again"
        return InputError(path, None, f"is no result of a fit: {shown(given)}", accepted)
    return _no_result(path, next(faults(error, ResultFile)))


def _no_result(path: str | Path, error: DataError) -> InputError:
    problem = f"is no result of a fit: {error.argument} is {error.value}"
    return InputError(path, None, problem, f"it must be {error.accepted}; {OWN}")


def _check(file: ResultFile) -> None:
    """Refuse labels without a value or a row of the covariance, and matrices of other sizes.

    Raises:
        DataError: naming the place, what stands there and what is accepted.
    """
    names, count = file.covariance.names, len(file.covariance.names)
    lengths: list[tuple[str, Any, int]] = [
        ("request.parameters", file.request.parameters, len(file.fits)),
        ("covariance.matrix", file.covariance.matrix, count),
        ("covariance_of_predictions", file.covariance_of_predictions, count),
        ("statistical_covariance", file.statistical_covariance, count),
        ("freedom.labels", [name for entry in file.freedom for name in entry.labels], count),
    ]
    for i, entry in enumerate(file.freedom):
        for name in ("parts", "relative", "sets"):
            lengths.append((f"freedom[{i}].{name}", getattr(entry, name), len(entry.names)))
        lengths += [(f"freedom[{i}].parts", part, len(entry.labels)) for part in entry.parts]
    for place, values, expected in lengths:
        if len(values) != expected:
            raise DataError(place, f"of {len(values)}", f"of {expected}")
    for i, fit in enumerate(file.fits):
        for name, label in fit.labels.items():
            if not isinstance(fit.values.get(name), float) or label not in names:
                accepted = "of values and covariance.names"
                raise DataError(f"fits[{i}].labels", f"{name}: {label}", accepted)


def _by_names(record: type[Strict], thing: Any, **table: Any) -> dict[str, Any]:
    """The entries of a record: those of `table`, else the thing's attributes."""
    names = record.model_fields
    return {name: table[name] if name in table else getattr(thing, name) for name in names}


def _arrays(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: np.array(x) if isinstance(x, list) else x for key, x in table.items()}


def _errors_entry(errors: PointErrors) -> dict[str, Any]:
    return {KEYS_OF_ERRORS.get(name, name): x for name, x in vars(errors).items()}


def _body(name: str, radius: Any, **leaves: Any) -> Body:
    return Body(name, sj.Material(**leaves), radius)


def _parameter_entry(value: Any) -> Any:
    if not isinstance(value, Parameter):
        return value
    table = {name: entry for name, entry in vars(value).items() if name != "origin"}
    return table if value.is_number else table | {"value": None}  # of a network: what was found


def _parameter(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    low, high = value.get("bounds") or (None, None)
    ends = -math.inf if low is None else low, math.inf if high is None else high
    return Parameter(**value | ({"bounds": ends} if value.get("bounds") else {}))


def _law(name: str | None, law: Any) -> Any:
    """The law that a file names: a built-in one, or the one that was given."""
    if name is None or name in LAWS:
        return name
    if law is None:
        accepted = "given: load(path, law=…)"
        raise DataError("law", f"{name}, which is none of {', '.join(LAWS)}", accepted)
    return type(law) if isinstance(law, sj.ContactLaw) else law


def _trees(values: Iterable[str], law: Any) -> tuple[Tree, ...]:
    """Structure of parameters that are pytrees, as in the law that was passed."""
    names = dict.fromkeys(name.partition("[")[0] for name in values if "[" in name)
    if names and not isinstance(law, sj.ContactLaw):
        accepted = "given as one such law, whose array fields show how their numbers are arranged"
        raise DataError("law", law, accepted)
    return tuple(Tree.of(name, getattr(law, name)) for name in names)
