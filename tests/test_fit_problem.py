"""Residuals and their derivatives, against SciPy's version of the model and against differences."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.optimize import approx_fprime

import calibration as cal
import softjax as sj
from calibration.fitting.assembly import assemble
from calibration.fitting.losses import influence, transformed
from calibration.fitting.noise import _curves
from calibration.fitting.problem import Lanes
from calibration.fitting.specs import specs_of
from calibration.fitting.transform import FROM_ABOVE, LOG, LOGIT, NONE, Transform
from tests import fit_oracle
from tests.fit_data import TRUTH, pair, twin

ROUTES = [sj.EnergyBalance(), sj.ODE(steps=16, solver="dopri5")]
by_time_long = pytest.mark.parametrize(
    "route", [ROUTES[0], pytest.param(ROUTES[1], marks=pytest.mark.long)], ids=["energy", "ode"]
)


def component_of(data, route=ROUTES[0], law=None, said=None, objective="model"):
    return assemble(specs_of([data], law, said, objective), route)[0]


def z_of(component, **values):
    """z of physical values by name."""
    theta = [values.get(e.name, e.start) for e in component.elements]
    return component.stages[0][1].transform.unconstrained(np.array(theta))


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: route.name)
def test_prediction_is_scipys_curve(route):
    for name in TRUTH:
        _, chi, sigma, psi, _ = TRUTH[name]
        data = twin(name)
        component = component_of(data, route)
        z = z_of(component, chi=2 * chi, sigma=0.7 * sigma, psi=1.1 * psi)
        expected = fit_oracle.curve(
            data.velocity, fit_oracle.numbers(data.contact), 2 * chi, 0.7 * sigma, 1.1 * psi
        )
        found = component.stages[0][1].predict(z[None])[0]
        assert np.max(np.abs(found - expected)) < 2e-9


@by_time_long
def test_jacobian_is_that_of_differences(route):
    name = "nylon"
    _, chi, sigma, psi, _ = TRUTH[name]
    free = {k: cal.Parameter() for k in ("yield_strength", "youngs_modulus", "limit_velocity")}
    component = component_of(twin(name), route, said=free)
    problem = component.stages[0][1]
    z = z_of(component, chi=chi, sigma=sigma, psi=psi)
    assert [e.name for e in component.elements][3:] == [f"contact.{k}" for k in free]
    jacobian = problem.linearise(z[None]).jacobian[0]
    h = 1e-4
    steps = np.repeat(z[None], 12, axis=0) + np.kron(np.eye(6), [[h], [-h]])
    ends = problem.linearise(steps).residual
    for k in range(6):
        difference = (ends[2 * k] - ends[2 * k + 1]) / (2 * h)
        scale = max(1.0, np.max(np.abs(difference)))
        assert np.max(np.abs(jacobian[:, k] - difference)) < 2e-7 * scale
    assert np.linalg.matrix_rank(jacobian) == 6


def on_a_line(contact, c1, c2, sigma, psi):
    return sj.Zhou(contact, c1 + c2 * contact.yield_ratio, sigma, psi)


def by_loss(contact, loss=0.1, scale: str = "small"):
    return sj.ConstantRestitution(contact, 1 - loss**2)


def test_a_function_that_builds_a_law_has_exact_slopes_too():
    """Through the law's leaves and the chain rule; against differences over both data sets."""
    sets = [twin(name) for name in ("nylon", "chrome steel")]
    shared = {k: cal.Parameter(v, shared=True) for k, v in (("c1", 0.03), ("c2", 0.004))}
    component = assemble(specs_of(sets, on_a_line, shared, "model"), ROUTES[0])[0]
    problem = component.stages[0][1]
    z = component.start
    assert len(z) == 6
    jacobian = problem.linearise(z[None]).jacobian[0]
    residual = lambda z: problem.linearise(z[None]).residual[0]  # noqa: E731
    np.testing.assert_allclose(jacobian, approx_fprime(z, residual, 1e-6), rtol=1e-4, atol=2e-5)
    theta = dict(
        zip([e.label for e in component.elements], problem.transform.physical(z), strict=True)
    )
    for g, data in enumerate(sets):
        chi = theta["c1"] + theta["c2"] * float(data.contact.yield_ratio)
        losses = (theta[f"{name}[{data.name}]"] for name in ("sigma", "psi"))
        expected = fit_oracle.curve(data.velocity, fit_oracle.numbers(data.contact), chi, *losses)
        np.testing.assert_allclose(
            problem.predict(z[None])[0][problem.points.set == g], expected, atol=2e-9
        )


def test_a_function_needs_no_contact_and_its_words_are_options():
    data = cal.RestitutionData([1.0, 2.0, 3.0], [0.9, 0.91, 0.9], pair("nylon"))
    component = component_of(data, law=by_loss, said={"scale": "large"})
    (element,) = component.elements
    assert (element.name, element.start) == ("loss", 0.1)
    z = np.array([[0.3]])
    found = component.stages[0][1].linearise(z)
    np.testing.assert_allclose(found.prediction, 0.91)
    np.testing.assert_allclose(found.jacobian[0, :, 0], -0.6)


def test_eq_17_s_stage_knows_no_collision():
    data = twin("stainless steel")
    component = component_of(data, objective="two-step")
    (name, first), (_, second) = component.stages
    z = z_of(component, chi=1.0, sigma=2.0, psi=0.4)
    expected = fit_oracle.eq_17(data.velocity, float(data.contact.limit_velocity), 2.0, 0.4)
    np.testing.assert_allclose(first.predict(z[None])[0], expected, rtol=1e-14)
    names = [e.name for e in component.elements]
    assert name == "Eq. (17)"
    assert [names[k] for k in first.active] == ["sigma", "psi"]
    assert [names[k] for k in second.active] == ["chi"]


def test_fits_side_by_side_are_the_fits_alone():
    """Each lane with its own z, restitutions and weights, whatever stands beside it."""
    data = twin("nylon", noise=0.01)
    problem = component_of(data).stages[0][1]
    random = np.random.default_rng(0)
    z = z_of(component_of(data)) + 0.1 * random.standard_normal((5, 3))
    lanes = Lanes(*random.uniform(0.5, 1.0, (2, 5, len(data))))
    together = problem.linearise(z, lanes)
    for k in range(5):
        alone = problem.linearise(z[k : k + 1], lanes.some(slice(k, k + 1)))
        np.testing.assert_array_equal(together.residual[k], alone.residual[0])
        np.testing.assert_array_equal(together.jacobian[k], alone.jacobian[0])
        curve = problem.predict(z[k : k + 1])[0]
        expected = (curve - lanes.restitution[k]) * lanes.weight[k]
        np.testing.assert_allclose(alone.residual[0], expected, rtol=1e-13)


def test_branches_are_held_while_yield_strength_moves():
    data = twin("nylon")
    component = component_of(data, said={"yield_strength": cal.Parameter()})
    problem = component.stages[0][1]
    elastic = problem.elastic
    np.testing.assert_array_equal(elastic, data.velocity <= float(data.contact.critical_velocity))
    stronger = np.array(component.start)
    stronger[3] += 0.3
    assert np.sum(problem.elastic_at(stronger)) > np.sum(elastic)
    below, above = problem.predict(np.stack([component.start, stronger]))
    np.testing.assert_array_equal(below[elastic], above[elastic])
    assert np.all(np.isfinite(above))
    # what would be elastic now is kept beyond yield, where ε is higher by the jump there
    crossed = problem.elastic_at(stronger) & ~elastic
    free = replace(problem, elastic=None).predict(stronger[None])[0]
    assert np.any(crossed)
    assert np.all(np.abs(above[crossed] - free[crossed]) > 1e-4)
    np.testing.assert_array_equal(above[~crossed], free[~crossed])
    assert component_of(data).stages[0][1].elastic is None  # nothing moves yield


def test_slopes_along_the_velocity_are_the_laws():
    data = twin("nylon")
    component = component_of(data)
    z = z_of(component)
    (curve,) = _curves(component.stages[0][1], z)
    law = sj.Zhou(pair("nylon"), *(e.start for e in component.elements))

    def total(velocity):
        return sj.restitution(law, velocity).coefficient.sum()

    slope = jax.grad(total)(jax.numpy.asarray(data.velocity))
    np.testing.assert_allclose(curve.slope, slope, rtol=1e-4)
    np.testing.assert_allclose(curve.value, sj.restitution(law, data.velocity).coefficient)


def test_transforms_go_there_and_back():
    kinds = [LOG, LOG, LOGIT, LOGIT, NONE, NONE, LOG, LOGIT, FROM_ABOVE]
    lower = [0.0, 3.0, 0.0, -2.0, -np.inf, -1.0, 0.0, 1e8, -np.inf]
    upper = [np.inf, np.inf, 1.0, 5.0, np.inf, 1.0, np.inf, 1e9, 2.0]
    asked = [None, "log", None, "log", "none", "none", None, "logit", "log"]
    transform = Transform.of(list(zip(lower, upper, strict=True)), asked)
    np.testing.assert_array_equal(transform.kind, kinds)
    theta = np.array([1e-7, 3.5, 0.25, 4.9, -17.0, 0.3, 1e11, 5e8, -40.0])
    z = transform.unconstrained(theta)
    np.testing.assert_allclose(transform.physical(z), theta, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(transform.physical(z, jax.numpy)), theta, rtol=1e-12)
    slopes = jax.vmap(jax.grad(lambda z, k: transform.physical(z * np.ones(9), jax.numpy)[k]))(
        z, np.arange(9)
    )
    np.testing.assert_allclose(transform.slope(z), slopes, rtol=1e-12)
    for far in (1e4, -1e4):
        end = transform.physical(np.full(9, far))
        assert np.all(np.isfinite(end))
        assert np.all((end >= transform.lower) & (end <= transform.upper))


@pytest.mark.parametrize("loss", ["squared", "huber", "soft-l1"])
def test_losses_are_their_textbook_forms(loss):
    r = np.array([-5.0, -1.0, -0.2, 0.0, 0.3, 1.0, 4.0])
    k = 1.3
    huber = np.where(np.abs(r) <= k, 0.5 * r**2, k * np.abs(r) - 0.5 * k**2)
    soft = k**2 * (np.sqrt(1 + (r / k) ** 2) - 1)
    expected = {"squared": 0.5 * r**2, "huber": huber, "soft-l1": soft}[loss]
    value, slope = transformed(r, k, loss)
    np.testing.assert_allclose(0.5 * value**2, expected, atol=1e-14)
    h = 1e-6
    up, down = (transformed(r + step, k, loss)[0] for step in (h, -h))
    np.testing.assert_allclose(slope, (up - down) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(influence(r, k, loss), value * slope, atol=1e-14)


def test_priors_are_residuals_of_their_own():
    said = {"chi": cal.Parameter(prior=(0.3, 0.02)), "psi": 0.5}
    component = component_of(twin("nylon"), said=said)
    problem = component.stages[0][1]
    z = z_of(component, chi=0.34, sigma=0.4)
    found = problem.linearise(z[None])
    assert found.residual.shape[1] == problem.count + 1
    assert found.residual[0, -1] == pytest.approx(2.0)
    np.testing.assert_allclose(found.jacobian[0, -1], [0.34 / 0.02, 0.0])


def test_a_narrow_valley_is_walked_down():
    """Data that hardly tell σ from ψ: a thousand refits arrive, as many as were begun."""
    data = twin("stainless steel", y=np.geomspace(0.02, 200.0, 30), noise=0.005, seed=1)
    result = cal.fit(data, starts=1, profiles=False)
    assert abs(result.correlations[1, 2]) > 0.99
    assert np.all(result.bootstrap(1000, seed=0).converged)
