"""The equation of motion: errors fall as the order of the solver and with its tolerance, by every law."""

from functools import lru_cache

import numpy as np
import pytest

import softjax as sj
from tests.cases import column, law_with, of_form
from tests.laws import LAWS, WITH_FORCE, mp, numbers

ORDERS = {"bosh3": 3, "tsit5": 5, "dopri5": 5, "dopri8": 8}
COUNTS = {3: (16, 32, 64), 5: (16, 32, 64), 8: (6, 8, 12)}  # of steps, by order
LONG = pytest.mark.long


@lru_cache
def collisions():
    """Zhou's that lose a good part of their energy, and what they give back."""
    records = [
        r
        for r in of_form("boxes", "first-order")
        if r["y"] > 2
        and "NO_TURNING_POINT" not in r["flags"]
        and float(r["log_sensitivity_sum"]) > 0.3
    ]
    assert len(records) > 20
    d, X, y = (column(records, name) for name in ("d", "X", "y"))
    law = law_with(d, X)
    return law, y * law.contact.critical_velocity, column(records, "eps_p_squared")


def largest_error(route):
    law, velocity, exact = collisions()
    found = sj.restitution(law, velocity, route).plastic_coefficient
    return float(np.max(np.abs(np.asarray(found) ** 2 - exact)))


@pytest.mark.parametrize(
    ("solver", "every"),
    [("dopri5", 2), ("dopri8", 2), *(pytest.param(s, 1, marks=LONG) for s in ORDERS)],
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


def test_error_falls_throughout_with_the_tolerance():
    errors = [largest_error(sj.ODE(rtol=rtol)) for rtol in (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)]
    assert np.all(np.diff(errors) < 0)
    assert errors[0] < 1e-4
    assert errors[-1] < 1e-12


STEPS = {"bosh3": (12, 24, 48), "dopri5": (8, 16, 32)}


@LONG
@pytest.mark.parametrize("solver", STEPS)
@pytest.mark.parametrize("name", [name for name in WITH_FORCE if name != "hertz"])
def test_every_law_converges_at_the_order(name, solver):
    """Of ε_p, the largest overlap and the duration, in 40 digits; by regression or the last doubling."""
    case = LAWS[name]
    velocity = float(case.velocity[-1]) * np.geomspace(0.4, 1.0, 5)
    rows = []
    for v in velocity:
        with mp.workdps(40):
            at = {key: mp.mpf(float(x)) for key, x in numbers(case.law, v).items()}
            found = case.exact(at | ({"sigma": mp.mpf(0)} if "zhou" in name else {}))
            rows.append([float(found.coefficient), float(found.peak), float(found.duration)])
    exact = np.array(rows).T

    def off(route):
        hit = sj.restitution(case.law, velocity, route)
        found = np.array([hit.plastic_coefficient, hit.peak_overlap, hit.duration])
        return np.max(np.abs(found - exact) / np.max(exact, axis=1, keepdims=True), axis=1)

    errors = np.array([off(sj.ODE(steps=n, solver=solver)) for n in STEPS[solver]])
    errors = np.maximum(errors, 1e-16)
    order = -np.polyfit(np.log(STEPS[solver]), np.log(errors), 1)[0]
    order = np.maximum(order, np.log2(errors[-2] / errors[-1]))  # few steps may not show it yet
    settled = errors[-1] < 1e-12  # rounding, where nothing falls any more
    assert np.all((order > ORDERS[solver] - 0.6) | settled), (order, errors)


def test_thornton_converges_at_the_order_of_the_solver():
    """(x - x*)^{3/2} over √x would hold every solver to order 2.5."""
    law = LAWS["thornton"].law
    velocity = float(law.elastic_velocity()) * np.array([2.0, 10.0, 50.0])
    exact = sj.thornton_restitution(law.contact, velocity, law.yield_factor)

    def error(steps):
        route = sj.ODE(steps=steps, solver="dopri8")
        return float(np.max(np.abs(sj.restitution(law, velocity, route).coefficient - exact)))

    assert error(4) < 1e-8
    assert error(16) < 1e-11
