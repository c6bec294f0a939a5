"""Each data set fitted by `fit`, one after the other: where errors are shared or estimated."""

from collections.abc import Callable, Sequence

import numpy as np

import softjax as sj
from calibration.coverage.experiments import Experiment
from calibration.coverage.table import Coverage
from calibration.data.checks import check_whole
from calibration.fitting.door import fit
from calibration.fitting.result import FitResult

ANOTHER = 5  # more measurements drawn for each fit


def experiments_study(
    cases: Sequence[Experiment],
    sets: int = 300,
    seed: int = 0,
    *,
    profiles: bool = True,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Coverage]:
    """Measure and fit every experiment many times.

    Args:
        profiles: whether intervals are those of the likelihood's profile, as by default.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """
    check_whole("sets", sets, 1)
    check_whole("seed", seed, 0)

    found = []
    for k, case in enumerate(cases):
        found.append(_study(case, sets, (seed, k), profiles))
        if progress is not None:
            progress("experiments", k + 1, len(cases))
    return found


def _study(case: Experiment, sets: int, seed: tuple[int, int], profiles: bool) -> Coverage:
    true = case.true_values
    converged, held = 0, []
    rows: dict[str, list[tuple[float, float, bool]]] = {name: [] for name in true}
    for k in range(sets):
        random = np.random.default_rng((*seed, k))
        result = _fitted(case, random, profiles)
        converged += result.converged
        for name, value in true.items():
            rows[name].append(_row(result, name, value))
        if case.scatter is not None:
            held.append(_holds_another(case, result, random))
    tables = {name: np.array(table, float) for name, table in rows.items()}
    return Coverage(
        name=case.name,
        sets=sets,
        converged=converged / sets,
        covered={n: float(np.mean(t[:, 2])) for n, t in tables.items()},
        by_error={},
        spread={n: float(np.std(t[:, 0])) for n, t in tables.items()},
        error={n: float(np.sqrt(np.mean(t[:, 1] ** 2))) for n, t in tables.items()},
        estimates={n: t[:, 0] for n, t in tables.items()},
        errors={n: t[:, 1] for n, t in tables.items()},
        measurements=float(np.mean(held)) if held else float("nan"),
    )


def _fitted(case: Experiment, random: np.random.Generator, profiles: bool) -> FitResult:
    data, law = case.draw(random), type(case.truth)
    return fit(data, law, profiles=profiles, starts=1, optimiser="levenberg-marquardt")


def _row(result: FitResult, name: str, true: float) -> tuple[float, float, bool]:
    """Relative error, its standard error, and whether the interval holds the truth."""
    part = result.materials[0]
    one = {**part.derived, **part.parameters}[name]
    if one.value is None or one.standard_error is None or one.low is None or one.high is None:
        return np.nan, np.nan, False
    return one.value / true - 1, one.standard_error / true, one.low <= true <= one.high


def _holds_another(case: Experiment, result: FitResult, random: np.random.Generator) -> float:
    """Share of further measurements inside the prediction band."""
    velocity = random.choice(result.data.velocity, ANOTHER)
    exact = np.asarray(sj.restitution(case.truth, velocity).coefficient)
    drawn = exact + case.scatter * random.standard_normal(ANOTHER)
    band = result.band(velocity, kind="prediction")
    return float(np.mean((band.low <= drawn) & (drawn <= band.high)))
