"""Residuals and their derivatives, against SciPy's version of the model and against differences."""

from dataclasses import replace

import numpy as np
import pytest

import softjax as sj
from calibration import objective
from calibration.assemble import assemble
from calibration.objective import Model, extended_root, robust
from calibration.parameters import COLUMNS, LOG, LOGIT, NONE, Layout
from calibration.parameters_spec import ParameterSpec
from calibration.problem import Problem
from tests import fit_oracle
from tests.fit_data import TRUTH, pair, twin

ROUTES = [sj.EnergyBalance(), sj.ODE(steps=16, solver="dopri5")]


def problem_of(data, route=ROUTES[0], kind="model", objective_="model", **parameters):
    setup = assemble([data], objective_, parameters or None)
    active = np.array([e.position for e in setup.elements])
    return setup, Problem(
        setup.layout,
        setup.obs,
        setup.noise,
        Model(area=setup.area, route=route),
        kind,
        "squared",
        setup.layout.start(),
        active,
    )


def started(problem, setup, **values):
    """The problem based at these physical values."""
    theta = np.ones(len(problem.base))
    for e in setup.elements:
        theta[e.position] = values[e.column]
    return replace(problem, base=setup.layout.unconstrained(theta))


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: route.name)
def test_prediction_is_scipys_curve(route):
    for name in TRUTH:
        _, chi, sigma, psi, _ = TRUTH[name]
        data = twin(name)
        setup, problem = problem_of(data, route)
        problem = started(problem, setup, chi=2 * chi, sigma=0.7 * sigma, psi=1.1 * psi)
        expected = fit_oracle.curve(
            data.velocity, fit_oracle.numbers(data.contact), 2 * chi, 0.7 * sigma, 1.1 * psi
        )
        found = problem.prediction(problem.base)[: len(data)]
        assert np.max(np.abs(found - expected)) < 2e-9


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: route.name)
def test_jacobian_is_that_of_differences(route):
    name = "nylon"
    _, chi, sigma, psi, _ = TRUTH[name]
    free = {k: ParameterSpec(k) for k in ("yield_strength", "youngs_modulus", "limit_velocity")}
    setup, problem = problem_of(twin(name), route, **free)
    contact = pair(name)
    leaves = {k: float(getattr(contact, k)) for k in free}
    problem = started(problem, setup, chi=chi, sigma=sigma, psi=psi, **leaves)
    assert len(problem.active) == 6
    _, jacobian = problem.linearise(problem.start)
    h = 1e-4
    for k in range(6):
        step = h * np.eye(6)[k]
        ahead, behind = (problem.linearise(problem.start + s)[0] for s in (step, -step))
        difference = (ahead - behind) / (2 * h)
        assert np.max(np.abs(jacobian[:, k] - difference)) < 2e-7 * max(
            1.0, np.max(np.abs(difference))
        )
    assert np.linalg.matrix_rank(jacobian) == 6


def test_empirical_stage_is_eq_17_and_knows_no_collision():
    data = twin("stainless steel")
    setup, problem = problem_of(data, kind="empirical")
    problem = started(problem, setup, chi=1.0, sigma=2.0, psi=0.4)
    expected = fit_oracle.eq_17(data.velocity, float(data.contact.limit_velocity), 2.0, 0.4)
    np.testing.assert_allclose(problem.prediction(problem.base)[: len(data)], expected, rtol=1e-14)
    assert not np.any(problem.linearise(problem.start)[1][:, 0])


def test_padding_weighs_nothing():
    data = twin("chrome steel")
    _setup, problem = problem_of(data)
    value, jacobian = problem.linearise(problem.start)
    assert len(value) > len(data)
    assert not np.any(value[len(data) :])
    assert not np.any(jacobian[len(data) :])


def test_branches_are_held_while_yield_strength_moves():
    data = twin("nylon")
    setup, problem = problem_of(data, yield_strength=ParameterSpec("yield_strength"))
    elastic = np.array(problem.obs.elastic)
    stronger = np.array(problem.base)
    position = next(e.position for e in setup.elements if e.column == "yield_strength")
    stronger[position] += 0.3
    assert np.sum(problem.elastic_at(stronger)) > np.sum(elastic)
    below, above = (problem.prediction(z)[: len(data)] for z in (problem.base, stronger))
    own = elastic[: len(data)]
    np.testing.assert_array_equal(below[own], above[own])
    assert np.all(np.isfinite(above))


def test_transforms_go_there_and_back():
    count = 8
    kind = np.array([LOG, LOG, LOGIT, LOGIT, NONE, NONE, LOG, LOGIT])
    lower = np.array([0.0, 3.0, 0.0, -2.0, -np.inf, -1.0, 0.0, 1e8])
    upper = np.array([np.inf, np.inf, 1.0, 5.0, np.inf, 1.0, np.inf, 1e9])
    index = np.full((1, len(COLUMNS)), -1)
    layout = Layout(np.ones((1, len(COLUMNS))), index, kind, lower, upper, *np.zeros((2, 1), bool))
    theta = np.array([1e-7, 3.5, 0.25, 4.9, -17.0, 0.3, 1e11, 5e8])
    z = layout.unconstrained(theta)
    assert z.shape == (count,)
    np.testing.assert_allclose(layout.physical(z, np), theta, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(layout.physical(z)), theta, rtol=1e-12)
    far = layout.physical(np.full(count, 1e4), np)
    assert np.all(np.isfinite(far))
    bounded = np.isfinite(upper)
    assert np.all(far[bounded] <= upper[bounded])


def test_extended_root_is_smooth_and_goes_on_below_zero():
    s = objective.TINY_SQUARED
    np.testing.assert_allclose(extended_root(np.array([0.25, 0.81])), [0.5, 0.9])
    around = np.asarray(extended_root(np.array([s * (1 - 1e-6), s, s * (1 + 1e-6)])))
    assert abs(around[2] - 2 * around[1] + around[0]) < 1e-12
    below = np.asarray(extended_root(np.array([-0.5, -0.1, 0.0])))
    assert np.all(np.diff(below) > 0)
    np.testing.assert_allclose(below[2], objective.NO_REBOUND_BELOW, rtol=1e-12)


def test_losses_are_their_textbook_forms():
    r = np.array([-5.0, -1.0, -0.2, 0.0, 0.3, 1.0, 4.0])
    k = 1.3
    huber = np.where(np.abs(r) <= k, 0.5 * r**2, k * np.abs(r) - 0.5 * k**2)
    soft = k**2 * (np.sqrt(1 + (r / k) ** 2) - 1)
    np.testing.assert_allclose(0.5 * np.asarray(robust(r, k, "huber")) ** 2, huber, atol=1e-14)
    np.testing.assert_allclose(0.5 * np.asarray(robust(r, k, "soft-l1")) ** 2, soft, atol=1e-14)
    np.testing.assert_array_equal(robust(r, k, "squared"), r)
