"""What follows from draws: curves with their bands, and fits that stand at a draw each."""

from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from calibration.errors import DataError
from calibration.fitting.curves import band_of, curve_problem
from calibration.fitting.estimate import Band
from calibration.fitting.material import MaterialFit
from calibration.fitting.posterior.inference_data import dataset_of, variable
from calibration.fitting.set_likelihood import CALLED

MOST = 1000  # draws of a band


def labelled(data: Any, labels: list[str]) -> Float[np.ndarray, "draws p"]:
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
    """Mean, standard deviation and central limits of ε(v) over draws; NaN where the fit knows nothing.

    Args:
        kind: "mean", of the curve itself, or "prediction", of one more measurement.
    """
    values = _thinned(labelled(data, list(material.free.values())))

    def parts(velocity: Float[np.ndarray, "n"]) -> tuple[np.ndarray, ...]:
        with jax.enable_x64(True):
            curves = curve_problem(material, velocity).predict(values)
        if kind == "prediction":
            normal = np.random.default_rng(0).standard_normal(curves.shape)
            curves = curves + normal * np.sqrt(_variance(data, material))[:, None]
        ends = np.quantile(curves, [0.5 - confidence / 2, 0.5 + confidence / 2], axis=0)
        return np.mean(curves, axis=0), *ends, np.std(curves, axis=0, ddof=1)

    return band_of(material, velocity, kind, parts)


def at_draws(result: Any, data: Any, count: int) -> list[Any]:
    """The fit with the values of some draws, evenly taken from all, in place of its own."""
    found = []
    tables = [labelled(data, list(one.free.values())) for one in result.materials]
    size = len(tables[0])
    if not (isinstance(count, int) and 1 <= count <= size):
        raise DataError("count", count, f"a whole number from 1 to {size}")
    for k in np.linspace(0, size - 1, count).round().astype(int):
        pairs = zip(result.materials, tables, strict=True)
        materials = tuple(_moved(material, table[k]) for material, table in pairs)
        found.append(replace(result, materials=materials, fits=None))
    return found


def _moved(material: MaterialFit, row: np.ndarray) -> MaterialFit:
    moved = dict(zip(material.free, map(float, row), strict=True))
    return replace(material, values={**material.values, **moved})


def _thinned(values: np.ndarray) -> np.ndarray:
    places = np.linspace(0, len(values) - 1, min(len(values), MOST)).round().astype(int)
    return values[places]


def _variance(data: Any, material: MaterialFit) -> np.ndarray:
    """Of one more measurement: drawn where it was sampled, else as the fit has it."""
    posterior = dataset_of(data, "posterior")
    total: Any = 0.0
    for kind, variance in material.variances.items():
        names = [f"{CALLED.get(kind, kind)}{owner}" for owner in ("", f"[{material.name}]")]
        sampled = [
            n for n in map(variable, names) if n in posterior and kind in ("scatter", "group")
        ]
        drawn = np.ravel(np.asarray(posterior[sampled[0]])) ** 2 if sampled else variance
        total = total + drawn
    return _thinned(np.broadcast_to(total, posterior.sizes["chain"] * posterior.sizes["draw"]))
