"""The equation of motion, integrated: against 40-digit arithmetic, and in its order of accuracy."""

import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from softjax.laws.zhou import FirstOrder
from tests.cases import FORMS, collide, column, flags_of, law_with, of_form

ORDERS = {"bosh3": 3, "tsit5": 5, "dopri5": 5, "dopri8": 8}
COUNTS = {3: (16, 32, 64), 5: (16, 32, 64), 8: (6, 8, 12)}  # of steps, by order
DOUBLED = {3: (8, 16, 32), 5: (6, 12, 24), 8: (2, 4, 8)}  # not yet down to rounding
TOLERANCES = {"four": (1e-3, 1e-6, 1e-9, 1e-11), "five": (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)}


def boxes(form):
    records = of_form("boxes", form)
    return *(column(records, name) for name in ("d", "X", "y")), records


@pytest.mark.parametrize("form", FORMS)
def test_restitution_over_the_box(form):
    d, X, y, records = boxes(form)
    law = law_with(d, X, form)
    result = sj.restitution(law, y * law.contact.critical_velocity, route=sj.ODE(rtol=1e-11))
    expected = column(records, "eps_p_squared")
    error = np.abs(np.square(result.plastic_coefficient) - expected)
    assert np.max(error) <= 1e-11
    assert np.quantile(error, 0.95) <= 1e-12
    assert np.array_equal(result.status, flags_of(records))
    overlap = result.peak_overlap / law.contact.critical_overlap
    assert np.allclose(overlap, column(records, "x_m"), rtol=1e-8, atol=0)


@pytest.mark.parametrize("form", FORMS)
def test_duration_over_the_box(form):
    d, X, y, records = boxes(form)
    law = law_with(d, X, form)
    result = sj.restitution(law, y * law.contact.critical_velocity, route=sj.ODE(rtol=1e-11))
    expected = column(records, "duration")
    ends = np.isfinite(expected)
    scaled = np.asarray(result.duration / law.scales().time)
    assert np.allclose(scaled[ends], expected[ends], rtol=1e-8, atol=0)
    assert np.all(result.duration[~ends] == 0)


def largest_error(route):
    """Of ε_p² over collisions that lose a good part of their energy, the answer from the table."""
    records = [
        r
        for r in of_form("boxes", "first-order")
        if r["y"] > 2
        and "NO_TURNING_POINT" not in r["flags"]
        and float(r["log_sensitivity_sum"]) > 0.3
    ]
    assert len(records) > 20
    d, X, y = (jnp.asarray(column(records, name)) for name in ("d", "X", "y"))
    found = collide(FirstOrder(d, X), y, route).plastic_squared
    return float(np.max(np.abs(found - column(records, "eps_p_squared"))))


@pytest.mark.parametrize(
    ("solver", "every"),
    [
        ("dopri5", 2),
        ("dopri8", 2),
        *(pytest.param(solver, 1, marks=pytest.mark.long) for solver in ORDERS),
    ],
)
def test_error_falls_as_the_order_of_the_solver(solver, every):
    """With n equal steps the error goes as n^-order, by regression over n.

    The leading error of the methods of fifth order is small here, so that the next one shows, until
    it is down to rounding at 64 steps.
    """
    order = ORDERS[solver]
    counts = COUNTS[order][::every]
    errors = [largest_error(sj.ODE(steps=n, solver=solver)) for n in counts]
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -order - 1.0 < slope < -order + 0.5


@pytest.mark.long
@pytest.mark.parametrize("solver", ORDERS)
def test_each_doubling_of_the_steps_gains_the_order(solver):
    order = ORDERS[solver]
    errors = [largest_error(sj.ODE(steps=n, solver=solver)) for n in DOUBLED[order]]
    assert errors[-1] > 1e-12
    assert np.all(np.diff(np.log2(errors)) < -order + 0.1)


@pytest.mark.parametrize("number", ["four", pytest.param("five", marks=pytest.mark.long)])
def test_error_falls_throughout_with_the_tolerance(number):
    errors = [largest_error(sj.ODE(rtol=rtol)) for rtol in TOLERANCES[number]]
    assert np.all(np.diff(errors) < 0)
    assert errors[0] < 1e-4
    assert errors[-1] < 1e-12


def test_too_few_steps_are_told_and_no_neighbour_suffers():
    """A solver that gives up is a status and not a number."""
    law = law_with(1e-3, 5.0)
    velocity = law.contact.critical_velocity * np.array([0.5, 3.0])
    result = sj.restitution(law, velocity, route=sj.ODE(rtol=1e-12, max_steps=2))
    assert result.status[0] == sj.Status.ELASTIC
    assert result.status[1] == sj.Status.SOLVER_FAILED
    assert result.coefficient[1] == 0


def test_float32():
    d, X, y, records = boxes("first-order")
    calm = (y > 1.5) & (y < 200) & (column(records, "log_sensitivity_sum") < 1)
    d32, X32, y32 = (jnp.asarray(a[calm], jnp.float32) for a in (d, X, y))
    outcome = collide(FirstOrder(d32, X32), y32, sj.ODE())
    assert outcome.plastic_squared.dtype == jnp.float32
    error = np.abs(outcome.plastic_squared - column(records, "eps_p_squared")[calm])
    assert np.max(error) < 1e-5
