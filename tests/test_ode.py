"""The equation of motion, integrated: against 40-digit arithmetic, and in its order of accuracy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from softjax import collision
from softjax.laws.zhou import FirstOrder, Full
from tests.cases import FORMS, column, flags_of, law_with, of_form

REDUCED = {"first-order": FirstOrder, "full": Full}
ORDERS = {"bosh3": 3, "tsit5": 5, "dopri5": 5, "dopri8": 8}


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
    # where the loading force nearly vanishes at the peak, no method can do better than this
    bound = 1e-9 * (1 + column(records, "log_sensitivity_sum"))
    assert np.all(error <= bound)
    assert np.quantile(error, 0.95) <= 1e-10
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


compiled = jax.jit(collision.collide, static_argnums=2)


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
    found = compiled(FirstOrder(d, X), y, route).plastic_squared
    return float(np.max(np.abs(found - column(records, "eps_p_squared"))))


@pytest.mark.parametrize(
    "solver",
    ["dopri5", "dopri8", *(pytest.param(s, marks=pytest.mark.long) for s in ("bosh3", "tsit5"))],
)
def test_error_falls_as_the_order_of_the_solver(solver):
    """With n equal steps the error goes as n^-order.

    The leading error of the methods of fifth order is small here, so that the next one shows.
    """
    order = ORDERS[solver]
    counts = {3: (16, 64), 5: (16, 64), 8: (6, 12)}[order]
    errors = [largest_error(sj.ODE(steps=n, solver=solver)) for n in counts]
    slope = np.diff(np.log(errors))[0] / np.diff(np.log(counts))[0]
    assert -order - 1.0 < slope < -order + 0.5


def test_error_falls_throughout_with_the_tolerance():
    errors = [largest_error(sj.ODE(rtol=rtol)) for rtol in (1e-3, 1e-6, 1e-9, 1e-11)]
    assert np.all(np.diff(errors) < 0)
    assert errors[0] < 1e-4
    assert errors[-1] < 1e-12


def test_too_few_steps_are_told_and_no_neighbour_suffers():
    """A solver that gives up is a status and not a number."""
    law = law_with(1e-3, 5.0)
    velocity = law.contact.critical_velocity * np.array([0.5, 3.0])
    result = sj.restitution(law, velocity, route=sj.ODE(rtol=1e-12, max_steps=2))
    assert result.status[0] == sj.Status.ELASTIC
    assert result.status[1] & sj.Status.NO_TURNING_POINT
    assert result.coefficient[1] == 0


def test_float32():
    d, X, y, records = boxes("first-order")
    calm = (y > 1.5) & (y < 200) & (column(records, "log_sensitivity_sum") < 1)
    d32, X32, y32 = (jnp.asarray(a[calm], jnp.float32) for a in (d, X, y))
    outcome = compiled(FirstOrder(d32, X32), y32, sj.ODE())
    assert outcome.plastic_squared.dtype == jnp.float32
    error = np.abs(outcome.plastic_squared - column(records, "eps_p_squared")[calm])
    assert np.max(error) < 1e-5
