"""Draws from the posterior of a fit as ArviZ data, and what follows from them.

ArviZ data are `InferenceData` of ArviZ 0.x, a `DataTree` of 1.x.
"""

import importlib.metadata
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data.checks import check_whole
from calibration.errors import DataError, InputError
from calibration.fitting.curves import band_of, curve_problem
from calibration.fitting.errors import CALLED
from calibration.fitting.laws import eps_up_of
from calibration.fitting.material import Band, MaterialFit
from calibration.fitting.posterior.density import Density, density_of
from calibration.fitting.posterior.nuts import Progress, needed, run_chains
from calibration.fitting.traceable import Traceable, traceable
from calibration.output import replacing

APART = 1.0  # standard deviations that chains start apart
LEAST = {"draws": 4, "chains": 1, "seed": 0, "warmup": 50}
AT_ONCE = 256  # draws that are carried over to measurements side by side, of at most
IMPACTS = 1 << 20  # points together
OF_BAND = 1000  # draws of a band
UNITS = {"timing": "s"}
POINTS = "restitution"  # what the variable of all points is called
DIMS = ("chain", "draw")


def sampled(
    result: Any,
    draws: int = 1000,
    chains: int = 4,
    seed: int = 0,
    warmup: int = 1000,
    progress: Progress = None,
) -> Any:
    """Draws from the posterior of a fit; see `FitResult.posterior`."""
    for name, value in {"draws": draws, "chains": chains, "seed": seed, "warmup": warmup}.items():
        check_whole(name, value, LEAST[name])
    check_possible(result.request.options.objective)
    with jax.enable_x64(True):
        problem = traceable(result.request)
        if not (problem.names or problem.noises):
            accepted = "one that is free, or noise that is not stated, for a posterior"
            raise DataError("parameters", "none free", accepted)
        density = density_of(problem).straightened(_found(result, problem))
        random = np.random.default_rng(seed)
        starts = APART * random.standard_normal((chains, len(density.labels)))
        position, statistics = run_chains(
            density.log_density, starts, draws, warmup, seed, progress
        )
        return _as_data(density, position, statistics, seed, _about(density, seed, warmup))


def check_possible(objective: str | None) -> None:
    """Refuse what has no posterior, or cannot be sampled here.

    Raises:
        ImportError: without the extra.
        ValueError: for what was no likelihood.
    """
    for package in ("blackjax", "arviz"):
        needed(package)
    if objective == "two-step":
        raise DataError("objective", "two-step", "model for a posterior: it has a likelihood")


def _found(result: Any, problem: Traceable) -> dict[str, float]:
    """Values of the unknowns where the fit ended, as far as it has any."""
    found = {name: result.values.get(name) for name in problem.names}
    for errors in problem.sets:
        material = result.materials[errors.set]
        known = material.observed.get(errors.block.observable, material)
        for kind, label in errors.labels.items():
            found[label] = known.variances.get(kind, 0.0) ** 0.5
        if "timing" in errors.labels:
            found[errors.labels["timing"]] = known.timing
        if "dof" in errors.labels:
            found[errors.labels["dof"]] = known.noise_dof
        if "scale" in errors.labels:
            found[errors.labels["scale"]] = None  # its own prior's centre is near enough
    return {name: float(value) for name, value in found.items() if value}


def _about(density: Density, seed: int, warmup: int) -> dict[str, Any]:
    """Attributes of the posterior: settings of the sampler."""
    versions = {name: importlib.metadata.version(name) for name in ("blackjax", "arviz", "jax")}
    priors = {one.label: one.text for one in density.priors}
    return {
        "inference_library": "blackjax",
        "inference_library_version": versions["blackjax"],
        "sampler": "NUTS",
        "seed": seed,
        "warmup": warmup,
        "priors": json.dumps(priors, ensure_ascii=False),
        "versions": json.dumps(versions),
    }


def _as_data(density: Density, position, statistics, seed: int, about: Mapping[str, Any]) -> Any:
    """Posterior, log likelihood of each point, predictions, statistics, measurements.

    In the statistics lp = ln p(data | θ) + log_prior + log_jacobian is the density that was sampled,
    up to a constant: log_prior of ln θ and the like (|dθ/dz| included), log_jacobian of the
    coordinates.
    """
    problem = density.problem
    velocity, value, unit = (
        np.concatenate([getattr(one.points, name) for one in problem.sets])
        for name in ("velocity", "value", "unit")
    )
    measured = value * unit
    counts = [len(one.errors) for one in problem.sets]
    names = np.repeat(np.array([one.data.name for one in problem.sets], object), counts)
    what = np.repeat(np.array([one.block.observable for one in problem.sets], object), counts)
    points = {
        "velocity": ("point", velocity, {"unit": "m/s"}),
        "data_set": ("point", names),
        "observable": ("point", what),
    }

    def one(some):
        u, key = some
        theta, log_prior, log_jacobian = density.at(u)
        laws = [problem.law(theta, g) for g in range(len(problem.specs))]
        return {
            "theta": jnp.stack(list(theta.values())),
            "log_prior": log_prior,
            "log_jacobian": log_jacobian,
            "eps_up": [_eps_up(law) for law in laws],
            "by_point": problem.point_log_likelihood(theta),
            "predicted": unit * problem.simulated(theta, jax.random.normal(key, (len(measured),))),
        }

    flat = position.reshape(-1, position.shape[-1])
    keys = jax.random.split(jax.random.key(seed), len(flat))
    size = max(min(AT_ONCE, IMPACTS // len(measured)), 1)
    found = jax.jit(lambda *some: jax.lax.map(one, some, batch_size=size))(flat, keys)
    shape = position.shape[:2]
    found = jax.tree.map(lambda a: np.asarray(a).reshape(*shape, *a.shape[1:]), found)
    statistics = {**statistics, **{n: found[n] for n in ("log_prior", "log_jacobian")}}
    dims = (*DIMS, "point")
    return _as_arviz(
        {
            "posterior": _dataset(_variables(density, found), about),
            "log_likelihood": _dataset({POINTS: (dims, found["by_point"])}, {}, points),
            "posterior_predictive": _dataset({POINTS: (dims, found["predicted"])}, {}, points),
            "sample_stats": _dataset({name: (DIMS, one) for name, one in statistics.items()}),
            "observed_data": _dataset({POINTS: (("point",), measured)}, {}, points),
        }
    )


def _eps_up(law: sj.ContactLaw) -> Any:
    """ε_up of Zhou's law; the mean for impacts that differ."""
    return jnp.mean(eps_up_of(law)) if isinstance(law, sj.Zhou) else jnp.nan


def _variables(density: Density, found: Mapping[str, Any]) -> dict[str, Any]:
    """Each parameter with its unit and prior, and ε_up of Zhou's law by σ and ψ."""
    variables = {}
    problem, transform = density.problem, density.transform
    centres = transform.unconstrained(found["theta"])
    middle = np.median(centres, axis=(0, 1))
    spreads = density.spread_in_z(middle)
    for pool in density.pools:
        spreads[pool.members] = np.inf  # their prior is the pool
    units = {e.label: e.declared.unit for e in problem.elements}
    for k, one in enumerate(density.priors):
        about = {
            "unit": units.get(one.label, UNITS.get(one.label.partition("[")[0], "-")),
            "prior": f"{one.text}, stated" if one.stated else one.text,
            "lower": float(transform.lower[k]),
            "upper": float(transform.upper[k]),
        }
        if np.isfinite(spreads[k]):
            about["prior_share"] = float(np.std(centres[..., k]) / spreads[k])
        variables[variable(one.label)] = (DIMS, found["theta"][..., k], about)
    for g, spec in enumerate(problem.specs):
        if spec.model.law_type is sj.Zhou and not spec.by_eps_up:
            owner = f"[{spec.data.name}]" if len(problem.specs) > 1 else ""
            values = found["eps_up"][g]
            variables[variable(f"eps_up{owner}")] = (DIMS, values, {"unit": "-", "derived": 1})
    return variables


def _dataset(variables: Mapping[str, Any], about: Mapping[str, Any] = {}, points=None) -> Any:
    coordinates: dict[str, Any] = dict(points or {})
    for dims, values, *_ in variables.values():
        coordinates |= {d: np.arange(n) for d, n in zip(dims, np.shape(values), strict=True)}
    return needed("xarray").Dataset(dict(variables), coordinates, attrs=dict(about))


def _as_arviz(groups: Mapping[str, Any]) -> Any:
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


def variable(label: str) -> str:
    """Name of a parameter in files: netCDF allows no slash."""
    return label.replace("/", "∕")


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


def _labelled(data: Any, labels: list[str]) -> Float[np.ndarray, "draws p"]:
    """Draws of some parameters, all chains in a row.

    Raises:
        ValueError: where the draws are of another fit.
    """
    posterior = dataset_of(data, "posterior")
    missing = [label for label in labels if variable(label) not in posterior]
    if missing:
        raise DataError("draws", f"without {missing[0]}", "of the posterior of this fit")
    columns = [np.ravel(np.asarray(posterior[variable(label)])) for label in labels]
    return np.stack(columns, axis=1)


def band_of_draws(
    data: Any, material: MaterialFit, velocity: Any, confidence: float, kind: str
) -> Band:
    """Mean, standard deviation and central limits of ε(v) over draws; NaN where the data determine nothing.

    Args:
        kind: "mean", of the curve itself, or "prediction", of one more measurement.
    """
    values = _thinned(_labelled(data, list(material.free.values())))

    def parts(velocity: Float[np.ndarray, "n"]) -> tuple[np.ndarray, ...]:
        with jax.enable_x64(True):
            curves = curve_problem(material, velocity).linearise(values, slopes=False).prediction
        if kind == "prediction":
            random, scale = np.random.default_rng(0), np.sqrt(_variance(data, material))
            if material.noise_dof is None:
                noise = random.standard_normal(curves.shape)
            else:
                noise = random.standard_t(_noise_dof(data, material)[:, None], curves.shape)
            curves = curves + scale[:, None] * noise
        ends = np.quantile(curves, [0.5 - confidence / 2, 0.5 + confidence / 2], axis=0)
        return np.mean(curves, axis=0), *ends, np.std(curves, axis=0, ddof=1)

    return band_of(material, velocity, kind, parts)


def at_draws(result: Any, data: Any, count: int) -> list[Any]:
    """The fit with the values of some draws, evenly taken from all, in place of its own."""
    tables = [_labelled(data, list(one.free.values())) for one in result.materials]
    size = len(tables[0])
    if not (isinstance(count, int) and 1 <= count <= size):
        raise DataError("count", count, f"a whole number from 1 to {size}")
    found = []
    for k in np.linspace(0, size - 1, count).round().astype(int):
        moved = []
        for one, table in zip(result.materials, tables, strict=True):
            drawn = dict(zip(one.free, map(float, table[k]), strict=True))
            moved.append(replace(one, values={**one.values, **drawn}))
        found.append(replace(result, materials=tuple(moved), fits=None))
    return found


def _thinned(values: np.ndarray) -> np.ndarray:
    places = np.linspace(0, len(values) - 1, min(len(values), OF_BAND)).round().astype(int)
    return values[places]


def _variance(data: Any, material: MaterialFit) -> np.ndarray:
    """Variance of one more measurement: drawn if it was sampled, else that of the fit."""
    posterior = dataset_of(data, "posterior")
    total: Any = 0.0
    for kind, variance in material.variances.items():
        drawn = _drawn(posterior, kind, material) if kind in ("scatter", "group") else None
        total = total + (variance if drawn is None else drawn**2)
    return _thinned(np.broadcast_to(total, posterior.sizes["chain"] * posterior.sizes["draw"]))


def _noise_dof(data: Any, material: MaterialFit) -> np.ndarray:
    """ν of Student's t, likewise."""
    posterior = dataset_of(data, "posterior")
    drawn = _drawn(posterior, "dof", material)
    nu = material.noise_dof if drawn is None else drawn
    return _thinned(np.broadcast_to(nu, posterior.sizes["chain"] * posterior.sizes["draw"]))


def _drawn(posterior: Any, kind: str, material: MaterialFit) -> np.ndarray | None:
    """Draws of an error of the data, all chains in a row; None where it was not sampled."""
    labels = [f"{CALLED.get(kind, kind)}{owner}" for owner in ("", f"[{material.name}]")]
    found = [n for n in map(variable, labels) if n in posterior]
    return np.ravel(np.asarray(posterior[found[0]])) if found else None
