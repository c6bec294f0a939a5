"""Statuses: what is invalid, does not arrive, gains or gives no number is 0 or flagged, alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, mostly_long, pair, same_flags
from tests.laws import LAWS

STEEL = pair("stainless steel")
FAILED, ELASTIC, GAIN = sj.Status.SOLVER_FAILED, sj.Status.ELASTIC, sj.Status.ENERGY_GAIN


def test_each_flag_but_plain_and_elastic_has_a_remedy():
    for flag in sj.Status:
        expected = flag in (sj.Status.ELASTIC, sj.Status.ZERO_VELOCITY)
        assert (flag.advice == "") == expected, flag
    both = GAIN | sj.Status.NO_RESIDUAL_OVERLAP
    assert GAIN.advice in both.advice
    assert sj.Status.NO_RESIDUAL_OVERLAP.advice in both.advice
    assert sj.Status.PLAIN.advice == ""
    assert str(sj.Status.INVALID_INPUT) == "Status.INVALID_INPUT"


def chosen(hit, places):
    """Some impacts of a result."""
    return jax.tree.map(lambda x: x[jnp.array(places)] if jnp.ndim(x) else x, hit)


def test_a_printed_result_tells_the_numbers_of_a_few_impacts():
    """And `ok` is plain or elastic alone."""
    law = fitted("nylon")
    critical = float(law.contact.critical_velocity)
    hit = sj.restitution(law, critical * np.array([0.0, 0.5, 1.02, 10.0, 2e3]))
    assert list(hit.ok) == [False, True, False, True, False]
    few = chosen(hit, [1, 3])
    shown = " ".join(f"{one:.4f}".rstrip("0") for one in few.coefficient)
    assert repr(few) == f"Restitution(Zhou: eps=[{shown}], status=ok)"
    beyond = repr(chosen(hit, [1, 4])).partition("status=")[2]
    assert beyond == "(ELASTIC 1, BEYOND_EXPANSION|NO_TURNING_POINT|ABOVE_LIMIT_VELOCITY 1))"
    assert "coefficient=f64[40]" in repr(chosen(hit, [2] * 40))
    traced = []
    jax.make_jaxpr(lambda v: traced.append(repr(sj.restitution(law, v))))(few.velocity)
    assert "coefficient=f64[2]" in traced[0]


@pytest.mark.parametrize(
    ("name", "solver", "steps"), [("thornton", "dopri5", 8), ("viscoelastic", "bosh3", 256)]
)
def test_nothing_of_an_integration_that_did_not_arrive_looks_like_physics(name, solver, steps):
    """Numbers, slopes and histories are 0; an elastic neighbour does not suffer.

    The viscoelastic contact is loaded to its peak in 256 steps, and not released; Thornton's fastest
    one could be released in 8, but is not loaded.
    """
    law, velocity = LAWS[name].law, LAWS[name].velocity
    route = sj.ODE(rtol=1e-8, solver=solver, max_steps=steps)
    failed = slice(1 if name == "thornton" else 0, 3)  # Thornton's first impact stays elastic
    of = lambda v: (sj.restitution(law, v, route),) * 2  # noqa: E731
    if name == "thornton":
        slopes, hit = jax.jit(lambda v: jax.jvp(of, (v,), (v,), has_aux=True)[1:])(velocity)
        path = sj.collide(law, velocity, samples=5, route=route)
        assert np.array_equal(path.status, hit.status)
        numbers = [slopes.coefficient, path.time, path.overlap, path.velocity, path.force]
    else:
        hit = of(velocity)[0]
        numbers = [hit.duration]
    assert np.all(same_flags(hit.status[failed], FAILED))
    assert np.all(hit.ok[: failed.start])
    assert not np.any(hit.ok[failed])
    parts = ("coefficient", "plastic_coefficient", "peak_overlap", "residual_overlap")
    for number in numbers + [getattr(hit, part) for part in parts]:
        assert np.all(number[failed] == 0)
        assert np.all(np.isfinite(number))
    assert "max_steps" in FAILED.advice


class Formula(sj.HardSphereLaw):
    """ε² = a ln(2 - v)."""

    a: float

    def restitution_squared(self, velocity):
        return self.a * jnp.log(2 - velocity)


class Known(sj.RateDependentLaw):
    """An elastic spring whose coefficient is said to be another."""

    contact: sj.Contact
    coefficient: float
    end = "zero-overlap"

    def force(self, overlap, velocity):
        return 1e6 * overlap

    def closed_form(self, velocity):
        return sj.KnownCollision(velocity * self.coefficient, velocity, velocity, velocity)


class Driven(sj.RateDependentLaw):
    """A force of any power with a part that grows with the rate, or falls."""

    contact: sj.Contact
    power: float
    rate: float
    end = "zero-overlap"

    def force(self, overlap, velocity):
        return 100 * (overlap / 1e-5) ** self.power * (1 + self.rate * velocity)


def test_a_formula_that_gives_no_number_or_too_much():
    found = sj.restitution(Formula(10.0), np.array([0.5, 3.0]))
    assert found.coefficient[0] == pytest.approx(np.sqrt(10 * np.log(1.5)), rel=1e-15)
    assert np.all(same_flags(found.status, [GAIN, FAILED]))
    assert found.coefficient[1] == 0
    known = sj.restitution(Known(STEEL, np.array([1.0, 1.0 + 1e-9])), 1.0)
    assert np.all(same_flags(known.status, [sj.Status.PLAIN, GAIN]))
    assert known.route == sj.ClosedForm()
    overflow = sj.restitution(Known(STEEL, 1e200), 1e200)
    assert overflow.coefficient == 0
    assert same_flags(overflow.status, FAILED)


@mostly_long("route", [sj.ODE(rtol=1e-5), sj.ODE(steps=8, solver="dopri5")])
def test_gains_of_damped_laws_are_flagged_and_rounding_is_none(route):
    power, rate = np.array([0.5, 1.0, 1.5, 2.0, 1.5]), np.array([0.0, 0.0, 0.0, 0.0, -0.1])
    found = sj.restitution(Driven(STEEL, power, rate), 1.0, route)
    assert np.allclose(found.coefficient[:4], 1.0, atol=1e-3)
    assert found.coefficient[4] > 1.05
    assert np.all(same_flags(found.status, [0, 0, 0, 0, GAIN]))


def test_the_slowest_impact_is_at_rest_alone_and_among_others():
    """Compiled code takes for zero what is below the smallest normal number."""
    law = sj.WaltonBraun(STEEL, 1e6, 2e6)
    for velocity in ([1e-310], [1e-310, 1.0], [1e-310, 0.0]):
        found = sj.restitution(law, velocity)
        assert found.coefficient[0] == 1
        assert same_flags(found.status[0], ELASTIC | sj.Status.ZERO_VELOCITY)
