"""Very many points: neighbours stand as one where a search begins and along profiles, and nothing changes."""

from dataclasses import replace

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration.fitting import neighbours
from calibration.fitting.assembly import assemble
from calibration.fitting.noise import first_weights, needs_weights
from calibration.fitting.specs import specs_of
from tests.cases import pair

NYLON = pair("nylon")
LAW = sj.Zhou(NYLON, 0.22, 0.4355, 0.5414)


def measured(count, seed=0, **options):
    velocity = np.geomspace(0.3, 60, count) * float(NYLON.critical_velocity)
    exact = np.asarray(sj.restitution(LAW, velocity).coefficient)
    noise = 0.005 * np.random.default_rng(seed).standard_normal(count)
    return cal.RestitutionData(velocity, exact + noise, NYLON, **options)


def fitted(data, monkeypatch, many):
    monkeypatch.setattr(neighbours, "MANY", many)
    monkeypatch.setattr(neighbours, "FEW", 400)
    return cal.fit(data, starts=8)


def test_limits_and_values_are_those_of_all_points(monkeypatch):
    data = measured(3000)
    every = fitted(data, monkeypatch, np.inf)
    few = fitted(data, monkeypatch, 3000)
    for name, one in every.materials[0].parameters.items():
        other, error = few.materials[0].parameters[name], one.standard_error
        assert other.value == pytest.approx(one.value, abs=1e-5 * error)
        assert other.standard_error == pytest.approx(error, rel=1e-5)
        assert (other.low, other.high) == pytest.approx((one.low, one.high), abs=2e-3 * error)
        assert other.method == one.method == "profile"


def problem_of(data):
    component = assemble(specs_of([data], "zhou", None, None), None)[0]
    problem = component.stages[0][1]
    problem = replace(problem, reweighed=needs_weights(problem))
    return first_weights(problem, component.start)


def test_a_neighbourhood_has_the_mean_and_the_weight_of_its_members(monkeypatch):
    monkeypatch.setattr(neighbours, "MANY", 100)
    monkeypatch.setattr(neighbours, "FEW", 10)
    error = np.where(np.arange(200) < 100, 0.005, 0.01)
    data = measured(200, uncertainty=error)
    whole = problem_of(data)
    few = neighbours.pooled(whole)
    assert few.count == 10
    weight = error[:20] ** -2
    assert few.points.restitution[0] == pytest.approx(
        np.average(data.restitution[:20], weights=weight)
    )
    assert few.points.velocity[4] == pytest.approx(np.mean(data.velocity[80:100]))
    assert few.points.weight[9] ** 2 == pytest.approx(20 / 0.01**2)


def test_what_shares_errors_is_never_pooled(monkeypatch):
    monkeypatch.setattr(neighbours, "MANY", 100)
    for options in ({"group": np.repeat(["a", "b", "c", "d"], 50)}, {"velocity_uncertainty": 0.01}):
        whole = problem_of(measured(200, **options))
        assert neighbours.pooled(whole) is whole


def test_where_neighbours_differ_too_much_all_points_are_taken(monkeypatch):
    monkeypatch.setattr(neighbours, "MANY", 100)
    monkeypatch.setattr(neighbours, "FEW", 3)
    whole = problem_of(measured(200))
    errors = np.full(len(whole.active), 1e-3)
    z = np.zeros(len(whole.elements))
    assert neighbours.pooled_about(whole, z, errors) is whole
