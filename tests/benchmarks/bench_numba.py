"""Compiled loops against `softjax speed`, and a thousand refits against SciPy's: `python -m tests.benchmarks`.

Not collected with the tests: numba is needed, and times mean nothing beside other tests.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import calibration as cal
import softjax as sj
from tests.benchmarks import numba_loops

EXACT = json.loads(Path(cal.__file__).with_name("speed.json").read_text(encoding="utf-8"))["zhou"]
VELOCITY, PLASTIC = np.array(EXACT["rows"], float).T[:2]
REFITS, POINTS, NOISE, SEED = 1000, 30, 0.005, 0


def law():
    """Stainless steel of Table 1, as `softjax speed` has it."""
    x = EXACT["inputs"]
    contact = sj.Contact(x["E"], x["R"], x["M"], x["Y"], x["v_lim"], area=x["area"])
    return sj.Zhou(contact, x["chi"], x["sigma"], x["psi"], form=x["form"], kappa=x["kappa"])


def reduced(law):
    """d and X."""
    return float(law.plasticity()), float(law.chi * law.contact.yield_ratio)


def timed(benchmark, name, setting, batch, function, exact):
    """Measure a function of y, and note its error."""
    y = np.resize(VELOCITY / float(law().contact.critical_velocity), batch)
    found = benchmark(function, y)
    error = float(np.max(np.abs(found - np.resize(PLASTIC, batch))))
    benchmark.extra_info.update(family=name, setting=setting, batch=batch, error=error)
    assert error <= exact


def test_the_same_formulas(benchmark):
    one = law()
    ratio = 1 / (float(one.contact.limit_velocity / one.contact.critical_velocity) - 1)
    up_loss = float(np.expm1(-2 * one.sigma * ratio**one.psi))

    def plastic(y):
        return numba_loops.energy_balance(*reduced(one), y, up_loss)[1]

    timed(benchmark, "the same formulas in numba, all cores", "exact", 10**6, plastic, 1e-14)


@pytest.mark.parametrize(("steps", "most"), [(100, 2e-3), (1000, 1e-4), (3000, 1e-5)])
def test_verlet(benchmark, steps, most):
    numbers = reduced(law())
    name = "velocity Verlet, numba"
    timed(
        benchmark,
        name,
        f"{steps} steps",
        4096,
        lambda y: numba_loops.verlet(*numbers, y, steps),
        most,
    )


@pytest.fixture(scope="module")
def fitted():
    """A fit of 30 points on both sides of first yield."""
    sj.enable_x64()
    one = law()
    velocity = float(one.contact.critical_velocity) * np.geomspace(0.02, 200.0, POINTS)
    noise = NOISE * np.random.default_rng(1).standard_normal(POINTS)
    measured = np.asarray(sj.restitution(one, velocity).coefficient) + noise
    data = cal.RestitutionData(velocity, np.minimum(measured, 1.0), one.contact)
    start = {name: cal.Parameter(getattr(one, name)) for name in ("chi", "sigma", "psi")}
    return cal.fit(data, None, start, starts=1)


def refits(result):
    return result.bootstrap(REFITS, seed=SEED).values


def scipys_refits(result):
    """One fit after the other by SciPy's Levenberg–Marquardt, of the data that `bootstrap` draws."""
    law, velocity = result.law, result.data.velocity
    mean = np.asarray(sj.restitution(law, velocity).coefficient)
    noise = np.random.default_rng(SEED).standard_normal((REFITS, POINTS))
    drawn = np.maximum(mean + noise * result.materials[0].noise, 0.0)
    critical = float(law.contact.critical_velocity)
    d, ratio = float(law.plasticity()), float(law.contact.yield_ratio)
    limit, y = float(law.contact.limit_velocity) / critical, velocity / critical

    def at(z):
        chi, sigma, psi = np.exp(z)
        return numba_loops.curve(y, d, chi * ratio, sigma, psi, limit)

    start = np.log([result.values[name] for name in ("chi", "sigma", "psi")])
    options = {"method": "lm", "xtol": 1e-9, "ftol": 1e-12}
    ends = [
        least_squares(lambda z, m=m: at(z)[0] - m, start, lambda z: at(z)[1], **options)
        for m in drawn
    ]
    return np.exp([end.x for end in ends])


@pytest.mark.parametrize("way", [refits, scipys_refits])
def test_a_thousand_refits(benchmark, way, fitted):
    found = benchmark.pedantic(way, (fitted,), rounds=3, warmup_rounds=1)
    apart = np.max(np.abs(np.log(found / scipys_refits(fitted))), axis=1)
    share = float(np.mean(apart < 1e-4))
    benchmark.extra_info.update(refits=way.__name__, share=share)
    assert share > 0.95
