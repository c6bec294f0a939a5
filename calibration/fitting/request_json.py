"""What was asked of a fit, as JSON and back."""

from typing import Any

from calibration.data import RestitutionData
from calibration.fitting.collisions import ROUTES
from calibration.fitting.known_laws import law_name
from calibration.fitting.request import Request
from calibration.fitting.specs import said_of
from calibration.options import FitOptions
from calibration.parameters import Parameter

SAID = ("free", "bounds", "prior", "transform", "shared")


def request_to_dict(request: Request) -> dict[str, Any]:
    """Data and progress left out; a law of one's own by its name."""
    said = said_of(request.parameters, request.datasets)
    return {
        "parameters": [{name: _told(value) for name, value in one.items()} for one in said],
        "options": request.options.model_dump(mode="json") | {"law": law_name(request.options.law)},
    }


def request_from_dict(table: dict[str, Any], datasets: tuple[RestitutionData, ...], law) -> Request:
    said = [{name: _heard(value) for name, value in one.items()} for one in table["parameters"]]
    given = dict(table["options"])
    if isinstance(given["route"], dict):
        route = dict(given["route"])
        given["route"] = ROUTES[route.pop("name")](**route)
    return Request(datasets, said, FitOptions.of(**given | {"law": law}))


def _told(value: Any) -> Any:
    if not isinstance(value, Parameter):
        return value
    table = {name: getattr(value, name) for name in SAID}
    number = value.value if value.is_number else None  # of a network only what was found is kept
    return {"value": number, **table}


def _heard(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    pairs: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in value.items()}
    return Parameter(pairs.pop("value"), **pairs)
