"""What was asked of a fit, as JSON and back."""

from typing import Any

from calibration.data import RestitutionData
from calibration.fitting.collisions import ROUTES, Route
from calibration.fitting.known_laws import LAWS
from calibration.fitting.request import Request
from calibration.fitting.specs import said_of
from calibration.fitting.stages import Options
from calibration.parameters import Parameter

SAID = ("free", "bounds", "prior", "transform", "shared")


def request_to_dict(request: Request) -> dict[str, Any]:
    """Data and progress left out; a law of one's own by its name."""
    said = said_of(request.parameters, request.datasets)
    told = {
        "law": law_name(request.law),
        "parameters": [{name: _told(value) for name, value in one.items()} for one in said],
        "route": None
        if request.route is None
        else {"name": request.route.name, **vars(request.route)},
        "options": {k: v for k, v in vars(request.options).items() if k != "progress"},
    }
    return {k: v for k, v in (vars(request) | told).items() if k != "datasets"}


def request_from_dict(table: dict[str, Any], datasets: tuple[RestitutionData, ...], law) -> Request:
    said = [{name: _heard(value) for name, value in one.items()} for one in table["parameters"]]
    made = {
        "law": law,
        "parameters": said,
        "route": _route(table["route"]),
        "options": Options(**table["options"]),
    }
    return Request(datasets, **table | made)


def law_name(law: Any) -> str | None:
    """The name by which a file tells a law."""
    if law is None or isinstance(law, str):
        return law
    built_in = next((key for key, one in LAWS.items() if one is law), None)
    return built_in or getattr(law, "__name__", type(law).__name__)


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


def _route(table: dict[str, Any] | None) -> Route:
    if table is None:
        return None
    options = {key: value for key, value in table.items() if key != "name"}
    return ROUTES[table["name"]](**options)
