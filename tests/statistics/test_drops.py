"""26 drops of a bronze ball far above first yield: χ̃ and ε_up are determined together, and χ̃ is skewed.

All that tells χ̃ agrees: table, profile, bootstrap and comparison.
"""

import io

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.golden import simulated

HEIGHTS = {f"{name}_height_uncertainty": "2 mm" for name in ("drop", "rebound")}


@pytest.fixture(scope="module")
def data():
    ball, plate = (sj.Material(*one) for one in (simulated.BRONZE, simulated.PLATE))
    contact = sj.Contact.with_wall(ball, plate, 0.006)
    table = pd.read_csv(io.StringIO(simulated.drops(0, (6.0, 3.0, 0.5), 0.0)))
    return cal.RestitutionData.from_table(table, contact, air=False, **HEIGHTS)


def deviance(data, curve):
    """-2 ln L of heights carried into ε by GUM's rule, as ε = √(h₂/h₁); without 2π."""
    v, step = data.velocity, 1e-3 * data.velocity
    drop = v**2 / (2 * simulated.GRAVITY)
    slope = (curve(v + step) - curve(v - step)) / (2 * step)
    of_rebound = 1 / (2 * data.restitution * drop)
    of_drop = -data.restitution / (2 * drop) - slope * v / (2 * drop)
    variance = 0.002**2 * (of_rebound**2 + of_drop**2)
    return np.sum((curve(v) - data.restitution) ** 2 / variance + np.log(variance))


@pytest.fixture(scope="module")
def result(data):
    return cal.fit(data)


def test_table_and_profile_have_the_interval_of_scipy(data, result):
    """No ± where the standard error describes no interval; χ² with ε_up refitted at its ends."""
    for fit in (result, cal.fit(data, profiles=False)):
        assert fit.estimates["chi"].skewed
        assert fit.standard_errors["chi"] > 0
        row = next(line for line in str(fit).splitlines() if " χ̃ " in line and "…" in line)
        assert "±" not in row
        codes = [warning.code for warning in fit.warnings]
        assert codes.count("skewed") == codes.count("collinear") == 1
    (cause,) = (warning.cause for warning in result.warnings if warning.code == "collinear")
    middle = float(np.median(data.velocity))
    band = result.band(middle)
    known = float(cause.partition("in their middle, ")[2].partition(" ±")[0])
    assert known == pytest.approx(float(band.coefficient), abs=0.1 * float(band.standard_error))
    assert band.standard_error < 0.002
    numbers = fit_oracle.numbers(data.contact)
    ratio = float(data.contact.critical_velocity) / float(data.contact.limit_velocity)

    def at(up, chi):
        sigma = -np.log(up) / (ratio / (1 - ratio)) ** 0.5
        return deviance(data, lambda v: fit_oracle.curve(v, numbers, chi, sigma, 0.5))

    def lowest(chi):
        ends = {"bounds": (0.85, 1.0), "options": {"xatol": 1e-7}}
        return optimize.minimize_scalar(at, args=(chi,), **ends).fun

    best = lowest(result.values["chi"])
    for end in result.intervals["chi"]:
        assert lowest(end) - best == pytest.approx(stats.chi2.ppf(0.95, 1), rel=0.05)


def test_bootstrap_and_comparison_agree(data, result):
    low, high = ends = result.intervals["chi"]
    near = 0.1 * (high - low)
    found = result.bootstrap(200, seed=1)
    assert np.median(found.values[:, 0]) == pytest.approx(result.values["chi"], abs=near)
    assert found.intervals["chi"] == pytest.approx(ends, abs=near)
    comparison = cal.compare(data, ["zhou", "constant"])
    assert comparison.ranking[0] == "Zhou"
    assert comparison["Zhou"].values["chi"] == pytest.approx(result.values["chi"], abs=1e-5)
    assert comparison["Zhou"].intervals["chi"] == pytest.approx(ends, abs=0.1 * near)


def test_nothing_free_is_a_fit_of_its_noise_alone(data):
    """Errors of heights and three given numbers: ln L of the given law, nothing searched."""
    given = {"chi": 6.0, "sigma": 3.0, "psi": 0.5}
    result = cal.fit(data, parameters=given)
    assert result.converged
    assert result.values["chi"] == 6
    numbers = fit_oracle.numbers(data.contact)
    twice = deviance(data, lambda v: fit_oracle.curve(v, numbers, *given.values()))
    expected = -0.5 * (twice + len(data) * np.log(2 * np.pi))
    assert result.log_likelihood == pytest.approx(expected, rel=1e-4)
