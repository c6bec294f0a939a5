"""ε² with its sign, and impacts that are held on a branch."""

import jax
import numpy as np
import pytest

import softjax as sj
from tests.cases import EPS, column, fitted, law_with, of_form


def test_it_is_the_square_where_something_rebounds():
    law = fitted("nylon")
    velocity = np.array([0.1, 2.0, 20.0]) * law.contact.critical_velocity
    result, signed = sj.restitution(law, velocity), sj.signed_restitution(law, velocity)
    assert np.allclose(signed.squared, np.square(result.coefficient), rtol=1e-14, atol=0)
    assert np.array_equal(signed.status, result.status)


def test_it_goes_below_zero_and_has_a_slope_there():
    """ε² = ε_p² + ε_up² - 1 of 40-digit ε_p², with losses that take more than there is."""
    records = [r for r in of_form("boxes", "first-order") if r["y"] > 1][:40]
    d, X, y = (column(records, name) for name in ("d", "X", "y"))
    law = law_with(d, X, "first-order")
    law = sj.Zhou(law.contact, law.chi, np.full(len(d), 5.0), np.full(len(d), 0.01))
    velocity = y * law.contact.critical_velocity
    signed = sj.signed_restitution(law, velocity)
    critical, limit = law.contact.critical_velocity, law.contact.limit_velocity
    up = np.exp(-2 * 5.0 * (critical / (limit - critical)) ** 0.01)
    expected = column(records, "eps_p_squared") + up - 1
    bound = 1e-12 + 8 * EPS * column(records, "log_sensitivity_sum")
    turned = (signed.status & int(sj.Status.NO_TURNING_POINT)) == 0
    assert np.all(np.abs(signed.squared - expected)[turned] <= bound[turned])
    lost = turned & (expected < 0)
    assert np.sum(lost) > 20
    assert np.all(signed.status[lost] & int(sj.Status.NO_REBOUND))

    def total(sigma):
        moved = sj.Zhou(law.contact, law.chi, sigma, law.psi)
        return sj.signed_restitution(moved, velocity).squared.sum()

    slope = jax.jit(jax.grad(total))(law.sigma)
    ratio = (critical / (limit - critical)) ** 0.01
    assert np.allclose(slope[lost], (-2 * ratio * up)[lost], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("route", [None, sj.ODE(rtol=1e-10)], ids=["energy", "ode"])
def test_impacts_are_held_on_their_branch(route):
    law = fitted("chrome steel")
    critical = law.elastic_velocity()
    assert critical == pytest.approx(float(law.contact.critical_velocity))
    velocity = np.array([0.5, 0.5, 3.0, 3.0]) * float(critical)
    held = np.array([True, False, True, False])
    found = sj.signed_restitution(law, velocity, route, elastic=held)
    squared = np.asarray(found.squared)
    alone = np.square(sj.restitution(law, velocity, route).coefficient)
    assert np.allclose(squared[[0, 3]], np.asarray(alone)[[0, 3]], rtol=1e-12, atol=0)
    # held elastic beyond yield: Eq. (17) at v; held yielding below it: taken at yield
    beyond = sj.empirical_restitution(velocity[2], law.contact.limit_velocity, law.sigma, law.psi)
    assert found.squared[2] == pytest.approx(float(beyond) ** 2, rel=1e-12)
    at_yield = np.square(sj.restitution(law, float(critical) * (1 + 1e-9), route).coefficient)
    assert found.squared[1] == pytest.approx(float(at_yield), rel=1e-7)
    assert np.array_equal((found.status & int(sj.Status.ELASTIC)) > 0, held)


def test_laws_without_a_jump_say_so():
    pair = fitted("nylon").contact
    assert sj.Zhou.jumps_at_yield
    assert not sj.Thornton(pair).jumps_at_yield
    assert np.isinf(sj.Hertz(pair).elastic_velocity())
    assert sj.WaltonBraun(pair, 1e6, 2e6).elastic_velocity() == 0


def test_laws_of_one_branch_take_no_notice():
    pair = fitted("nylon").contact
    spring = sj.signed_restitution(sj.WaltonBraun(pair, 1e6, 2e6), 1.0, elastic=True)
    assert spring.squared == pytest.approx(0.5, rel=1e-14)
    assert spring.status == 0
    hertz = sj.signed_restitution(sj.Hertz(pair), 1.0, elastic=False)
    assert (hertz.squared, hertz.status) == (1, sj.Status.ELASTIC)


def test_branches_as_lists_and_of_one_velocity():
    law = fitted("chrome steel")
    velocity = 3.0 * float(law.elastic_velocity())
    expected = sj.signed_restitution(law, np.full(2, velocity), elastic=np.array([True, False]))
    for some in (velocity, np.full(2, velocity)):
        found = sj.signed_restitution(law, some, elastic=[True, False])
        assert np.array_equal(found.squared, expected.squared)
        assert np.array_equal(found.status, expected.status)


@pytest.mark.parametrize("elastic", ["yes", 1, [1.0], [[True], [True, False]]])
def test_a_branch_that_is_none(elastic):
    with pytest.raises(ValueError, match="`elastic` must be True, False or an array of these"):
        sj.signed_restitution(fitted("nylon"), 1.0, elastic=elastic)
    with pytest.raises(ValueError, match=r"`velocity` \(2,\), `elastic` \(3,\)"):
        sj.signed_restitution(fitted("nylon"), np.ones(2), elastic=np.ones(3, bool))
