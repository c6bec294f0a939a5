"""The equation of motion: |Δε²| <= 10 rtol for 99.9 % of the impacts, and orders of convergence.

Expected values are formulas, SciPy's quadratures of the same forces, or SciPy's own integration.
"""

from functools import lru_cache, partial
from itertools import product

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import column, law_with, mostly_long, of_form, pair, same_flags
from tests.laws import LAWS, WITH_FORCE
from tests.oracles.by_scipy import by_motion
from tests.physics.own_laws import Hardening

PAIR = pair("stainless steel")
K, M = float(PAIR.stiffness), float(PAIR.mass)
LENGTH = (1.25 * M / K) ** 0.4  # overlap of Hertz's collision at 1 m/s
VELOCITY = np.geomspace(0.02, 10, 1000)
LONG = pytest.mark.long


class Damped(sj.RateDependentLaw):
    """Hunt and Crossley's damping, Kelvin's, and friction, which jumps where the velocity changes its sign."""

    contact: sj.Contact
    dissipation: float = 0.0
    friction: float = 0.0
    viscosity: float = 0.0
    end = "zero-force"

    def force(self, overlap, velocity):
        damping = 1 + self.dissipation * velocity + self.friction * jnp.sign(velocity)
        return K * sj.power_3_2(overlap) * damping + self.viscosity * velocity


def hardening():
    return Hardening(PAIR), VELOCITY, 2.5 / (2.5 + LENGTH * VELOCITY**0.8 / 1e-4)


def built_in(name):
    """The other routes, by formulas and quadratures, are held to 30 digits by tests of their own."""
    law, fastest = LAWS[name].law, float(LAWS[name].velocity[-1])
    velocity = np.geomspace(0.01, 1, 1000) * fastest
    return law, velocity, np.asarray(sj.restitution(law, velocity).plastic_coefficient) ** 2


@lru_cache
def by_rates():
    rows = 3 * [(0.1, 0.0, 0.0), (0.0, 0.0, 20.0), (0.0, 0.3, 5.0), (0.0, 0.0, 5.0)]
    velocity = np.repeat([0.3, 1.0, 3.0], 4)
    pairs = zip(rows, velocity.tolist(), strict=True)
    exact = [by_motion(Damped(PAIR, *row), v) for row, v in pairs]
    return Damped(PAIR, *np.transpose(rows)), velocity, exact


def rates():
    law, velocity, exact = by_rates()
    return law, velocity, np.array([e.squared for e in exact])


CASES = {"hardening": hardening, "rates": rates}
CASES |= {name: partial(built_in, name) for name in WITH_FORCE}


def check(case, solver, rtol, every=1):
    """The share of impacts without a flag that err too much, and that of the flagged; the largest error."""
    law, velocity, exact = CASES[case]()
    velocity, exact = velocity[::every], exact[::every]
    found = sj.restitution(law, velocity, sj.ODE(rtol=rtol, solver=solver))
    error = np.abs(np.asarray(found.plastic_coefficient) ** 2 - exact)
    flagged = sj.Status.has_fault(np.asarray(found.status))
    message = f"{case} by {solver} at {rtol}: up to {np.max(error):.2g}"
    assert np.mean((error > 10 * rtol + 1e-12) & ~flagged) <= 1e-3, message
    if solver != "bosh3" and rtol >= 1e-10:
        assert np.mean(flagged) <= 1e-3, message
    return np.max(error)


QUICK = [("viscoelastic", "dopri5", 1e-7), ("hardening", "dopri8", 1e-10)]


@pytest.mark.parametrize(("case", "solver", "most"), QUICK)
def test_fields_that_are_flat_at_touch(case, solver, most):
    """Without a largest step one crosses the whole way: errors of 10³ tolerances, and no flag."""
    # a number of NumPy's is one too; few compile sooner
    errors = [check(case, solver, rtol, every=63) for rtol in np.array([1e-4, 1e-6, 1e-8])]
    assert errors[0] < most  # of the largest steps: half as long again err ten times as much


@LONG
@pytest.mark.parametrize("solver", ["dopri8", "dopri5", "tsit5", "bosh3"])
@pytest.mark.parametrize("case", CASES)
def test_every_solver_and_tolerance(case, solver):
    for rtol in 10.0 ** -np.arange(3, 13 if solver != "bosh3" else 9):
        check(case, solver, rtol)


def test_a_force_may_depend_on_the_rate_and_jump_where_it_changes_its_sign():
    law, velocity, exact = by_rates()
    found = sj.restitution(law, velocity, sj.ODE())
    assert np.allclose(found.coefficient**2, [one.squared for one in exact], rtol=1e-7, atol=0)
    off = np.abs(found.residual_overlap - np.array([one.residual for one in exact]))
    assert np.all(off <= 1e-7 * np.array([one.peak for one in exact]))
    assert np.all(same_flags(found.status, sj.Status.PLAIN))


def test_the_error_of_fixed_steps_is_no_gain_of_energy():
    """A law that unloads as it loads, by two steps of dopri5: off by up to some 1e-3, no gain."""

    class Elastic(sj.RateIndependentLaw):
        contact: sj.Contact

        def loading_force(self, overlap):
            return K * sj.power_3_2(overlap) * (1 + 20 * (overlap / LENGTH) ** 2.5)

        def unloading_force(self, overlap, peak_overlap):
            return self.loading_force(overlap)

    found = sj.restitution(Elastic(PAIR), VELOCITY[::50], sj.ODE(steps=2, solver="dopri5"))
    assert not np.any(np.asarray(found.status) & int(sj.Status.ENERGY_GAIN))


ORDERS = {"bosh3": 3, "tsit5": 5, "dopri5": 5, "dopri8": 8}
COUNTS = {3: (16, 32, 64), 5: (16, 32, 64), 8: (6, 8, 12)}  # of steps, by order


def largest_error(route):
    """Of ε_p² of Zhou's collisions that lose a good part of their energy."""
    records = [
        r
        for r in of_form("boxes", "first-order")
        if r["y"] > 2
        and "NO_TURNING_POINT" not in r["flags"]
        and float(r["log_sensitivity_sum"]) > 0.3
    ]
    assert len(records) > 20
    law = law_with(column(records, "d"), column(records, "X"))
    velocity = column(records, "y") * law.contact.critical_velocity
    found = sj.restitution(law, velocity, route).plastic_coefficient
    return float(np.max(np.abs(np.asarray(found) ** 2 - column(records, "eps_p_squared"))))


@mostly_long("solver, every", product(ORDERS, (1, 2)), [("dopri5", 2), ("dopri8", 2)])
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


def test_thornton_converges_at_the_order_of_the_solver():
    """(x - x*)^{3/2} over √x would hold every solver to order 2.5."""
    law = LAWS["thornton"].law
    velocity = float(law.elastic_velocity()) * np.array([2.0, 10.0, 50.0])
    exact = sj.thornton_restitution(law.contact, velocity, law.yield_factor)
    found = sj.restitution(law, velocity, sj.ODE(steps=16, solver="dopri8"))
    assert np.max(np.abs(found.coefficient - exact)) < 1e-11


def test_a_solver_of_diffrax_is_what_its_name_is():
    law, route = LAWS["hertz dashpot to zero-overlap"].law, sj.ODE(steps=4, solver="tsit5")
    found = sj.restitution(law, 2.0, sj.ODE(steps=4, solver=diffrax.Tsit5())).coefficient
    named = sj.restitution(law, 2.0, route).coefficient
    assert found == pytest.approx(float(named), rel=1e-14)


def test_a_solver_of_diffrax_has_derivatives():
    """JAX refused them as those of a "custom_vjp"; against differences of Thornton's formula."""
    law, route = LAWS["thornton"].law, sj.ODE(solver=diffrax.Tsit5())
    v = 10 * float(law.elastic_velocity())
    formula = lambda v: float(sj.thornton_restitution(law.contact, v, law.yield_factor))  # noqa: E731
    slope = (formula(1.0001 * v) - formula(0.9999 * v)) / (0.0002 * v)
    for derivative in (jax.grad, jax.jacfwd):
        found = derivative(lambda v: sj.restitution(law, v, route).coefficient)(v)
        assert float(found) == pytest.approx(slope, rel=1e-5)


def test_solvers_that_are_refused():
    with pytest.raises(ValueError, match=r"`solver` must have an error estimate unless"):
        sj.ODE(solver=diffrax.Euler())
    with pytest.raises(ValueError, match=r"`solver` must be an explicit solver of diffrax"):
        sj.ODE(solver=diffrax.Kvaerno5())
    assert sj.ODE(solver=diffrax.Midpoint(), steps=4).steps == 4
