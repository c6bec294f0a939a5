"""Draws from the posterior of a fit as ArviZ data, and what follows from them.

NUTS is blackjax', with its window adaptation: Hoffman and Gelman, J. Mach. Learn. Res. 15, 1593
(2014); Stan Reference Manual, 15.2. ArviZ data are `InferenceData` of ArviZ 0.x, a `DataTree` of 1.x.
"""

import importlib
import importlib.metadata
import json
import os
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.data.checks import check_whole
from calibration.errors import INSTALL, DataError, InputError
from calibration.fitting.curves import band_of, curve_and_slopes, curve_problem, further_variances
from calibration.fitting.errors import CALLED
from calibration.fitting.laws import eps_up_of
from calibration.fitting.material import Band, MaterialFit
from calibration.fitting.posterior.density import Density, density_of
from calibration.fitting.traceable import Traceable, traceable
from calibration.options import require_likelihood
from calibration.output import replacing

ACCEPTANCE = 0.9  # that step sizes are adapted to
STEP_SIZE = 0.5  # where the adaptation starts: what is sampled is nearly standard normal
LEAST = {"draws": 4, "chains": 1, "seed": 0, "warmup": 50}
AT_ONCE = 256  # draws that are carried over to measurements side by side, of at most
IMPACTS = 1 << 20  # points together
OF_BAND = 1000  # draws of a band
POINTS = "restitution"  # what the variable of all points is called
DIMS = ("chain", "draw")
Progress = Callable[[str, int, int], None] | None


class MissingExtra(InputError, ImportError):
    """A package of the extra `bayes` is not installed; one line says what to do."""


def needed(name: str) -> Any:
    """A module of the extra, or `MissingExtra`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # ArviZ 0.23 announces 1.0
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != name:
            raise
        problem = f"a posterior needs {name}, which is not installed"
        raise MissingExtra(
            None, None, problem, f"install it with {INSTALL.format('bayes')}"
        ) from None


def check_possible(objective: str | None) -> None:
    """Refuse what was no likelihood, or cannot be sampled without the extra."""
    require_likelihood(objective)
    for package in ("blackjax", "arviz"):
        needed(package)


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
    with jax.enable_x64(True):
        problem = traceable(result.request)
        if not (problem.names or problem.noises):  # whatever is installed
            accepted = "one that is free, or noise that is not stated, for a posterior"
            raise DataError("parameters", "none free", accepted)
        check_possible(result.request.options.objective)
        density = density_of(problem).straightened(_found(result, problem))
        starts = np.random.default_rng(seed).standard_normal((chains, len(density.labels)))
        position, statistics = _chains(density, starts, draws, warmup, seed, progress)
        priors = {prior.label: prior.text for prior in density.priors}
        about = {
            "inference_library": "blackjax",
            "inference_library_version": importlib.metadata.version("blackjax"),
            "sampler": "NUTS",
            "seed": seed,
            "warmup": warmup,
            "priors": json.dumps(priors, ensure_ascii=False),
        }
        return _as_data(density, position, statistics, about)


def _found(result: Any, problem: Traceable) -> dict[str, float]:
    """Values of the unknowns where the fit ended, as far as it has any."""
    values = {name: result.values.get(name) for name in problem.names}
    for errors in problem.sets:
        material = result.materials[errors.set]
        known = material.observed.get(errors.block.observable, material)
        other = {"timing": known.timing, "scale": None, **vars(known.family)}
        for kind, label in errors.labels.items():
            values[label] = other.get(kind, known.variances.get(kind, 0.0) ** 0.5)
    return {name: float(value) for name, value in values.items() if value}


def _chains(
    density: Density,
    starts: Float[np.ndarray, "chains p"],
    draws: int,
    warmup: int,
    seed: int,
    progress: Progress,
) -> tuple[Float[np.ndarray, "chains draws p"], Mapping[str, np.ndarray]]:
    """Draws of a chain from each start, and NUTS' statistics of each: a thread for each chain.

    Equal for equal seeds, however many chains run at once.
    """
    blackjax, log_density = needed("blackjax"), density.log_density
    adaptation = blackjax.window_adaptation(
        blackjax.nuts,
        log_density,
        is_mass_matrix_diagonal=False,
        initial_step_size=STEP_SIZE,
        target_acceptance_rate=ACCEPTANCE,
    )

    def chain(keys, start):
        (state, tuned), _ = adaptation.run(keys[0], start, warmup)
        step = blackjax.nuts(log_density, **tuned).step

        def drawn(state, key):
            state, info = step(key, state)
            statistics = {
                "lp": state.logdensity,
                "diverging": info.is_divergent,
                "energy": info.energy,
                "acceptance_rate": info.acceptance_rate,
                "n_steps": info.num_integration_steps,
                "tree_depth": info.num_trajectory_expansions,
                "step_size": tuned["step_size"],
            }
            return state, (state.position, statistics)

        return jax.lax.scan(drawn, state, jax.random.split(keys[1], draws))[1]

    keys = jax.random.split(jax.random.key(seed), (len(starts), 2))
    compiled = density.jitted(chain).lower(keys[0], starts[0]).compile()  # before the threads begin

    def run(k: int) -> Any:
        with jax.enable_x64(True):  # each thread has its own settings
            return jax.device_get(compiled(keys[k], starts[k]))

    has = getattr(os, "sched_getaffinity", None)
    cores = len(has(0)) if has else os.cpu_count() or 1
    with ThreadPoolExecutor(min(len(starts), cores)) as threads:
        running = [threads.submit(run, k) for k in range(len(starts))]
        for done, _ in enumerate(as_completed(running), 1):
            if progress is not None:
                progress("chains", done, len(starts))
    return jax.tree.map(lambda *every: np.stack(every), *(future.result() for future in running))


def _as_data(density: Density, position, statistics, about: Mapping[str, Any]) -> Any:
    """Posterior, log likelihood of each point, predictions, statistics, measurements.

    In the statistics lp = ln p(data | θ) + log_prior + log_jacobian is the density that was sampled,
    up to a constant: log_prior of ln θ and the like (|dθ/dz| included), log_jacobian of the
    coordinates.
    """
    problem, sets = density.problem, density.problem.sets
    velocity, value, unit = (
        np.concatenate([getattr(s.points, name) for s in sets])
        for name in ("velocity", "value", "unit")
    )
    named = [np.full(len(s.errors), s.data.name, object) for s in sets]
    what = [np.full(len(s.errors), s.block.observable, object) for s in sets]
    points = {
        "velocity": ("point", velocity, {"unit": "m/s"}),
        "data_set": ("point", np.concatenate(named)),
        "observable": ("point", np.concatenate(what)),
    }

    def at_draw(some):
        u, key = some
        theta, log_prior, log_jacobian = density.at(u)
        laws = [problem.law(theta, g) for g in range(len(problem.specs))]
        ups = [eps_up_of(a) if isinstance(a, sj.Zhou) else jnp.nan for a in laws]
        return {
            "theta": jnp.stack(list(theta.values())),
            "log_prior": log_prior,
            "log_jacobian": log_jacobian,
            "eps_up": ups,  # the mean for impacts that differ
            "by_point": problem.point_log_likelihood(theta),
            "predicted": unit * problem.simulated(theta, jax.random.normal(key, value.shape)),
        }

    flat, shape = position.reshape(-1, position.shape[-1]), position.shape[:2]
    keys = jax.random.split(jax.random.key(about["seed"]), len(flat))
    size = max(min(AT_ONCE, IMPACTS // len(value)), 1)
    of_draws = density.jitted(lambda *some: jax.lax.map(at_draw, some, batch_size=size))
    results = of_draws(flat, keys)
    results = jax.tree.map(lambda a: np.asarray(a).reshape(*shape, *a.shape[1:]), results)
    statistics = {**statistics, **{n: results[n] for n in ("log_prior", "log_jacobian")}}
    dims = (*DIMS, "point")
    groups = {
        "posterior": _dataset(_variables(density, results), about),
        "log_likelihood": _dataset({POINTS: (dims, results["by_point"])}, {}, points),
        "posterior_predictive": _dataset({POINTS: (dims, results["predicted"])}, {}, points),
        "sample_stats": _dataset({name: (DIMS, values) for name, values in statistics.items()}),
        "observed_data": _dataset({POINTS: (("point",), value * unit)}, {}, points),
    }
    if _is_old(needed("arviz")):
        return needed("arviz").InferenceData(**groups)
    return needed("xarray").DataTree.from_dict(groups)


def _variables(density: Density, drawn: Mapping[str, Any]) -> dict[str, Any]:
    """Each parameter with its unit and prior, and ε_up of Zhou's law by σ and ψ."""
    problem, transform, variables = density.problem, density.transform, {}
    centres = transform.unconstrained(drawn["theta"])
    spreads = density.spread_in_z(np.median(centres, axis=(0, 1)))
    for pool in density.pools:
        spreads[pool.members] = np.inf  # their prior is the pool
    units = {e.label: e.declared.unit for e in problem.elements}
    for k, prior in enumerate(density.priors):
        about = {
            "unit": units.get(prior.label, prior.unit),
            "prior": prior.text,
            "lower": float(transform.lower[k]),
            "upper": float(transform.upper[k]),
        }
        if np.isfinite(spreads[k]):
            about["prior_share"] = float(np.std(centres[..., k]) / spreads[k])
        variables[variable(prior.label)] = (DIMS, drawn["theta"][..., k], about)
    for spec, values in zip(problem.specs, drawn["eps_up"], strict=True):
        if spec.model.law_type is sj.Zhou and not spec.by_eps_up:
            owner = f"[{spec.data.name}]" if len(problem.specs) > 1 else ""
            variables[variable(f"eps_up{owner}")] = (DIMS, values, {"unit": "-", "derived": 1})
    return variables


def _dataset(variables: Mapping[str, Any], about: Mapping[str, Any] = {}, points=None) -> Any:
    coordinates: dict[str, Any] = dict(points or {})
    for dims, values, *_ in variables.values():
        coordinates |= {d: np.arange(n) for d, n in zip(dims, np.shape(values), strict=True)}
    return needed("xarray").Dataset(dict(variables), coordinates, attrs=dict(about))


def _is_old(arviz: Any) -> bool:
    return int(arviz.__version__.partition(".")[0]) < 1


def dataset_of(data: Any, group: str) -> Any:
    """A group of ArviZ data as an xarray data set."""
    contents = data[group]
    return contents.to_dataset() if hasattr(contents, "to_dataset") else contents


def variable(label: str) -> str:
    """Name of a parameter in files: netCDF allows no slash."""
    return label.replace("/", "∕")


def write(data: Any, path: str | Path) -> None:
    """Write a netCDF file, replacing an existing one."""
    with replacing(path) as staged:
        data.to_netcdf(str(staged), engine="h5netcdf")


def read(path: str | Path) -> Any:
    """The data of such a file."""
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
    """Draws of some parameters, all chains in a row."""
    posterior = dataset_of(data, "posterior")
    for label in (label for label in labels if variable(label) not in posterior):
        raise DataError("draws", f"without {label}", "of the posterior of this fit")
    columns = [np.ravel(np.asarray(posterior[variable(label)])) for label in labels]
    return np.stack(columns, axis=1)


def _evenly(values: np.ndarray, count: int) -> np.ndarray:
    """Some draws, evenly taken from all."""
    return values[np.linspace(0, len(values) - 1, min(len(values), count)).round().astype(int)]


def band_of_draws(
    data: Any, material: MaterialFit, velocity: Any, confidence: float, kind: str
) -> Band:
    """Mean, standard deviation and central limits of ε(v) over draws; NaN where the data determine nothing.

    Args:
        kind: "mean", of the curve itself, or "prediction", of one more measurement.
    """
    values = _evenly(_labelled(data, list(material.free.values())), OF_BAND)

    def drawn(kind: str, otherwise: float) -> np.ndarray:
        """Draws of an estimated scatter; the fit's value where it was not sampled."""
        owned = [f"{CALLED.get(kind, kind)}{owner}" for owner in ("", f"[{material.name}]")]
        for label in (n for n in owned if variable(n) in dataset_of(data, "posterior")):
            return _evenly(_labelled(data, [label]), OF_BAND)
        return np.full((len(values), 1), otherwise)

    def parts(velocity: Float[np.ndarray, " n"]) -> tuple[np.ndarray, ...]:
        with jax.enable_x64(True):
            curves = curve_problem(material, velocity).linearise(values, slopes=False).prediction
        if kind == "prediction":
            random, variance = np.random.default_rng(0), 0.0
            at = lambda v: curve_and_slopes(material, v)[0]  # noqa: E731
            for name, part in further_variances(material, velocity, at).items():
                if name in ("scatter", "group"):
                    part = drawn(name, material.variances[name] ** 0.5) ** 2
                elif name == "timing" and material.timing:
                    part = part * (drawn(name, material.timing) / material.timing) ** 2
                variance = variance + part
            noise = material.family.drawn(random.standard_normal(curves.shape), random)
            curves = curves + np.sqrt(variance) * noise
        ends = np.quantile(curves, [0.5 - confidence / 2, 0.5 + confidence / 2], axis=0)
        return np.mean(curves, axis=0), *ends, np.std(curves, axis=0, ddof=1)

    return band_of(material, velocity, kind, parts)
