"""Draws as ArviZ data: `InferenceData` of ArviZ 0.x, a `DataTree` of 1.x."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.errors import InputError
from calibration.fitting.posterior.coordinates import Scaling
from calibration.fitting.posterior.density import Density
from calibration.fitting.posterior.extra import needed
from calibration.fitting.posterior.nuts import Chain
from calibration.fitting.traceable import Traceable
from calibration.fitting.zhou import eps_up_of
from calibration.output import replacing

AT_ONCE = 256  # draws that are carried over to measurements side by side
UNITS = {"timing": "s"}
POINTS = "restitution"  # what the variable of all points is called
DIMS = ("chain", "draw")


def inference_data(
    density: Density, scaling: Scaling, chains: Sequence[Chain], seed: int, told: Mapping[str, Any]
) -> Any:
    """Posterior, log likelihood of each point, predictions, statistics, measurements.

    Args:
        told: attributes of the posterior.
    """
    draws = np.stack([chain.draws for chain in chains])
    found = _carried_over(density, scaling, draws, seed)
    statistics = {
        name: (DIMS, np.stack([chain.statistics[name] for chain in chains]))
        for name in chains[0].statistics
    }
    measured = np.concatenate([one.data.restitution for one in density.problem.sets])
    points = _points(density.problem)
    dims = (*DIMS, "point")
    return as_arviz(
        {
            "posterior": _dataset(_variables(density, found), told),
            "log_likelihood": _dataset({POINTS: (dims, found["log_likelihood"])}, {}, points),
            "posterior_predictive": _dataset({POINTS: (dims, found["predicted"])}, {}, points),
            "sample_stats": _dataset(statistics),
            "observed_data": _dataset({POINTS: (("point",), measured)}, {}, points),
        }
    )


def as_arviz(groups: Mapping[str, Any]) -> Any:
    """xarray data sets as what this ArviZ works on."""
    arviz = needed("arviz")
    if _is_old(arviz):
        return arviz.InferenceData(**groups)
    return needed("xarray").DataTree.from_dict(dict(groups))


def _is_old(arviz: Any) -> bool:
    return int(arviz.__version__.partition(".")[0]) < 1


def dataset_of(data: Any, group: str) -> Any:
    """A group of ArviZ data as an xarray data set."""
    found = data[group]
    return found.to_dataset() if hasattr(found, "to_dataset") else found


def write(data: Any, path: str | Path) -> None:
    """A netCDF file; what is there already is replaced whole."""
    with replacing(path) as staged:
        data.to_netcdf(str(staged), engine="h5netcdf")


def read(path: str | Path) -> Any:
    """The data of such a file.

    Raises:
        InputError: where it is none.
    """
    arviz = needed("arviz")
    try:
        if _is_old(arviz):
            data = arviz.InferenceData.from_netcdf(str(path), engine="h5netcdf")
        else:
            data = needed("xarray").load_datatree(str(path), engine="h5netcdf")
        dataset_of(data, "posterior")
        return data
    except (OSError, KeyError, ValueError, AttributeError) as error:
        problem = f"no draws can be read: {error}"
        accepted = "a posterior.nc that `softjax fit --posterior` wrote"
        raise InputError(path, None, problem, accepted) from error


def variable(label: str) -> str:
    """What a parameter is called in files: netCDF has no slash in names."""
    return label.replace("/", "∕")


def _carried_over(density: Density, scaling: Scaling, draws: np.ndarray, seed: int):
    """From what was sampled to parameters, likelihoods and new measurements, (chains, draws, ...)."""
    problem = density.problem
    sets = range(len(problem.sets))
    count = sum(len(one.data) for one in problem.sets)

    def one(some):
        u, normal = some
        theta = density.theta(density.z(u, scaling)[0])
        laws = [problem.law(theta, g) for g in sets]
        return {
            "theta": theta,
            "eps_up": [_eps_up(law) for law in laws],
            "log_likelihood": problem.point_log_likelihood(theta),
            "predicted": problem.simulated(theta, normal),
        }

    flat = draws.reshape(-1, draws.shape[-1])
    normal = np.random.default_rng(seed).standard_normal((len(flat), count))
    with jax.enable_x64(True):
        found = jax.jit(lambda *some: jax.lax.map(one, some, batch_size=AT_ONCE))(flat, normal)
    shape = draws.shape[:2]
    return jax.tree.map(lambda a: np.asarray(a).reshape(*shape, *a.shape[1:]), found)


def _eps_up(law: sj.ContactLaw) -> Any:
    """Of Zhou's law; the mean of impacts that differ."""
    return jnp.mean(eps_up_of(law)) if isinstance(law, sj.Zhou) else jnp.nan


def _variables(density: Density, found) -> dict[str, Any]:
    """Each parameter with its unit and prior, and ε_up of Zhou's law by σ and ψ."""
    variables = {}
    problem, transform = density.problem, density.priors.transform
    centres = transform.unconstrained(np.stack([found["theta"][n] for n in density.labels], -1))
    spreads = density.priors.spread_in_z(np.median(centres, axis=(0, 1)))
    units = {e.label: e.declared.unit for e in problem.elements}
    for k, one in enumerate(density.priors.each):
        about = {
            "unit": units.get(one.label, UNITS.get(one.label.partition("[")[0], "-")),
            "prior": f"{one.told}, stated" if one.stated else one.told,
            "lower": float(transform.lower[k]),
            "upper": float(transform.upper[k]),
        }
        if np.isfinite(spreads[k]):
            about["prior_share"] = float(np.std(centres[..., k]) / spreads[k])
        variables[variable(one.label)] = (DIMS, found["theta"][one.label], about)
    for g, spec in enumerate(problem.specs):
        if spec.model.law_type is sj.Zhou and not spec.by_eps_up:
            owner = f"[{spec.data.name}]" if len(problem.sets) > 1 else ""
            values = found["eps_up"][g]
            variables[variable(f"eps_up{owner}")] = (DIMS, values, {"unit": "-", "derived": 1})
    return variables


def _points(problem: Traceable) -> dict[str, Any]:
    """Coordinates of the points."""
    names = np.concatenate([[one.data.name] * len(one.data) for one in problem.sets])
    velocity = np.concatenate([one.data.velocity for one in problem.sets])
    return {
        "velocity": ("point", velocity, {"unit": "m/s"}),
        "data_set": ("point", names.astype(object)),
    }


def _dataset(variables: Mapping[str, Any], told: Mapping[str, Any] = {}, points=None) -> Any:
    coordinates: dict[str, Any] = dict(points or {})
    for dims, values, *_ in variables.values():
        coordinates |= {d: np.arange(n) for d, n in zip(dims, np.shape(values), strict=True)}
    return needed("xarray").Dataset(dict(variables), coordinates, attrs=dict(told))
