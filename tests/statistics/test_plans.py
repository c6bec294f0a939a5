"""Plans of further points of the kind that a fit's data are: their errors, and what they bring."""

import numpy as np
import pytest

import calibration as cal
from tests.decay import Decay

LEVEL, RATE = 0.85, 0.04
OFFSET, SCATTER, TIMING = 0.02, 0.01, 3e-4
GRAVITY = 9.80665
BOUNDS = (1.0, 30.0)
QUICK = {"profiles": False, "starts": 1}


def curve(v):
    return LEVEL * np.exp(-RATE * np.asarray(v))


def drops(v, random):
    """Heights to 2 mm, both."""
    drop = v**2 / (2 * GRAVITY)
    heights = (h + 0.002 * random.standard_normal(len(v)) for h in (drop, curve(v) ** 2 * drop))
    table = dict(zip(("drop_height", "rebound_height"), heights, strict=True))
    return cal.RestitutionData.from_table(table, height_uncertainty=0.002)


def pairs(v, random):
    """Velocities to 1 % and 2 %."""
    both = [
        x * (1 + u * random.standard_normal(len(v))) for x, u in ((v, 0.01), (curve(v) * v, 0.02))
    ]
    table = dict(zip(("impact_velocity", "rebound_velocity"), both, strict=True))
    stated = {"impact_velocity_uncertainty": "1 %", "rebound_velocity_uncertainty": "2 %"}
    return cal.RestitutionData.from_table(table, **stated)


def bounces(v, random):
    """Two flights of a launch each, times to 2 ms."""
    first = 2 * v / GRAVITY
    times = np.stack([first, curve(v) * first], axis=1) + 0.002 * random.standard_normal(
        (len(v), 2)
    )
    table = {"launch": np.repeat([f"l{k}" for k in range(len(v))], 2), "interval": times.ravel()}
    return cal.RestitutionData.from_table(table, interval_uncertainty=0.002)


def stated(v, random):
    """ε with an uncertainty of its own, at velocities with one."""
    at = v + 0.05 * random.standard_normal(len(v))
    e = curve(v) + 0.01 * random.standard_normal(len(v))
    return cal.RestitutionData(at, e, None, 0.01, velocity_uncertainty=0.05)


KINDS = {"drops": drops, "pairs": pairs, "bounces": bounces, "stated": stated}


class Exact:
    """Errors of measurements that have none."""

    def standard_normal(self, shape):
        return np.zeros(shape)


@pytest.mark.parametrize("kind", KINDS)
def test_a_planned_point_has_the_errors_of_a_measured_one(kind):
    """Planned where data of the kind were measured, it has their variances about the curve."""
    data = KINDS[kind](np.linspace(1.0, 6.0, 9), Exact())
    found = cal.fisher_information(cal.fit(data, Decay, **QUICK), data.velocity)
    expected = data.errors.covariance(-RATE * curve(data.velocity)).diagonal
    # to first order in the error of the velocity
    np.testing.assert_allclose(found.uncertainty**2, expected, rtol=5e-3)


def test_a_drop_of_some_centimetres_is_known_worse_than_one_of_metres():
    """ε = √(h₂/h₁): u = ε/2 √((u/h₁)² + (u/h₂)²) and what the error of v adds; no plan asks for low drops."""
    result = cal.fit(drops(np.linspace(1.0, 6.0, 12), np.random.default_rng(1)), Decay, **QUICK)
    v = np.array([0.4, 1.0, 6.0])
    found = cal.fisher_information(result, v)
    level, rate = result.values["level"], result.values["rate"]
    h, e = v**2 / (2 * GRAVITY), level * np.exp(-rate * v)
    of_drop = -e / (2 * h) + rate * e * v / (2 * h)
    expected = 0.002 * np.hypot(of_drop, 1 / (2 * h * e))
    np.testing.assert_allclose(found.uncertainty, expected, rtol=1e-5)
    design = cal.optimal_velocities(result, 4, (0.3, 8.0), target="level", starts=2)
    assert np.min(design.velocity) > 1.0
    assert "Sought from 0.3 to 8 m/s; planned" in str(design)


def promised_over_reached(kind, sets):
    """Of fits of ten measured points and six planned ones: root mean square promise over the spread."""
    first, more = np.linspace(1.5, 4.0, 10), np.array([1.2, 1.2, 1.2, 6.0, 6.0, 6.0])
    plans, found = [], []
    for seed in range(sets):
        random = np.random.default_rng((3, seed))
        before, whole = KINDS[kind](first, random), KINDS[kind](np.append(first, more), random)
        if seed < max(sets // 5, 8):
            fit = cal.fit(before, Decay, **QUICK)
            plans.append([*cal.fisher_information(fit, more).relative_errors.values()])
        values = cal.fit(whole, Decay, **QUICK).values
        found.append([np.log(values[name]) for name in ("level", "rate")])
    return np.sqrt(np.mean(np.square(plans), axis=0)) / np.std(found, axis=0, ddof=1)


@pytest.mark.parametrize(
    ("kind", "sets", "off"),
    [
        ("drops", 40, 0.35),
        *(pytest.param(kind, 400, 0.1, marks=pytest.mark.long) for kind in KINDS),
    ],
)
def test_promised_errors_are_those_that_fits_of_all_points_reach(kind, sets, off):
    """The spread is known to 1/√(2 n): 11 % of 40 sets, 3.5 % of 400."""
    np.testing.assert_allclose(promised_over_reached(kind, sets), 1.0, atol=off)


def specimens(seed=3, groups=6, each=5, more=()):
    """Impacts of each specimen around a velocity of its own; further ones of new specimens."""
    random = np.random.default_rng(seed)
    label = np.append(np.repeat(np.arange(groups), each), groups + np.arange(len(more)))
    v = np.append(np.linspace(1.0, 12.0, groups * each), more)
    e = curve(v) + OFFSET * random.standard_normal(groups + len(more))[label]
    e += SCATTER * random.standard_normal(len(v))
    return cal.RestitutionData(v, e, group=[f"s{k}" for k in label])


def rows(v, result):
    """Slopes of a e^{-bv} in ln a and ln b."""
    level, rate = result.values["level"], result.values["rate"]
    value = level * np.exp(-rate * np.asarray(v))
    return np.stack([value, -rate * np.asarray(v) * value], axis=-1)


def known(result):
    """The fit's own information on ln θ, and the variance of an impact of a further specimen."""
    unit = np.array([result.values[name] for name in result.covariance_names])
    return np.linalg.inv(result.covariance / np.outer(unit, unit)), sum(
        result.materials[0].variances.values()
    )


def test_further_shots_are_of_specimens_of_their_own():
    result = cal.fit(specimens(), Decay, **QUICK)
    before, variance = known(result)
    slopes = rows([3.0, 20.0, 20.0], result)
    found = cal.fisher_information(result, [3.0, 20.0, 20.0])
    np.testing.assert_allclose(found.matrix, before + slopes.T @ slopes / variance, rtol=1e-6)
    np.testing.assert_allclose(found.uncertainty, np.sqrt(variance), rtol=1e-9)
    finer = cal.fisher_information(result, [3.0, 20.0, 20.0], 0.002)
    np.testing.assert_allclose(finer.matrix, before + slopes.T @ slopes / 0.002**2, rtol=1e-6)
    np.testing.assert_allclose(finer.covariance, np.linalg.inv(finer.matrix), rtol=1e-6)


WEIGHTS = {"A": lambda _: np.eye(2) / 2, "I": lambda s: s.T @ s / len(s)}


@pytest.mark.parametrize("criterion", ["A", pytest.param("I", marks=pytest.mark.long)])
def test_a_design_beside_specimens_is_as_good_as_the_best_on_a_grid(criterion):
    result = cal.fit(specimens(), Decay, **QUICK)
    before, variance = known(result)
    found = cal.optimal_velocities(result, 3, BOUNDS, criterion=criterion)
    weight = WEIGHTS[criterion](rows(np.linspace(*BOUNDS, 4001), result))

    def mean_variance(v):
        slopes = rows(v, result)
        return np.trace(weight @ np.linalg.inv(before + slopes.T @ slopes / variance))

    grid = np.linspace(*BOUNDS, 30)
    triples = ((a, b, c) for a in grid for b in grid[grid >= a] for c in grid[grid >= b])
    best = min(mean_variance(v) for v in triples)
    assert mean_variance(found.velocity) == pytest.approx(best, rel=1e-3)
    own = np.sqrt(np.diag(np.linalg.inv(before)))
    np.testing.assert_allclose(list(found.before.values()), own, rtol=1e-5)


@pytest.mark.long
def test_what_is_promised_beside_specimens_is_what_simulated_fits_reach():
    """300 fits of specimens and the shots planned, and the root mean square of what 60 promised."""
    new, sets = [20.0, 22.0, 25.0, 25.0], 300
    found = [cal.fit(specimens(100 + k, 8, more=new), Decay, **QUICK).values for k in range(sets)]
    fits = [cal.fit(specimens(100 + k, 8), Decay, **QUICK) for k in range(60)]
    plans = [cal.fisher_information(fit, new).standard_errors for fit in fits]
    for name in ("level", "rate"):
        reached = np.std([values[name] for values in found], ddof=1)
        promised = np.sqrt(np.mean([plan[name] ** 2 for plan in plans]))
        assert promised == pytest.approx(reached, rel=0.15)
