"""Ends of every range, in both precisions: nearly at rest, nearly plastic, hardly damped, just yielding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests import laws
from tests.cases import mostly_long, same_flags
from tests.laws import LAWS, PAIR, numbers, with_numbers


@mostly_long("name", LAWS, ("thornton", "walton-braun", "hertz dashpot to zero-force", "eq. 17"))
def test_float32_from_rest_to_its_largest_velocities(name):
    """Plain impacts as in 40 digits, hard ones numbers; slopes of ε finite, in float32 throughout."""
    case, exact = LAWS[name], laws.expected(name)
    velocity = np.concatenate([case.velocity, [0.0, 1e-30, 1e-6, 1.0, 1e5]]).astype(np.float32)
    values = laws.repeated(case.law, velocity, np.float32)

    @jax.jit
    def graded(values):
        def total(values):
            hit = sj.restitution(with_numbers(case.law, values), values["velocity"])
            return hit.coefficient.sum(), hit

        return jax.value_and_grad(total, has_aux=True)(values)

    (_, hit), slopes = graded({name: jnp.asarray(x) for name, x in values.items()})
    found = [getattr(hit, name) for name in laws.QUANTITIES]
    for leaf in jax.tree.leaves((found, slopes)):
        assert leaf.dtype == np.float32
        assert np.all(np.isfinite(leaf))
    count = len(case.velocity)
    sure = exact[:, 0] > 1e-20
    for k in (0, 1, 3):
        error = np.abs(np.asarray(found[k], float)[:count] - exact[:, k])
        size = np.where(exact[:, k] > 0, exact[:, k], 1.0)
        assert np.all((error / size)[sure] < 3e-6), (k, error / size)
    assert np.all(same_flags(hit.status[:count], case.status))
    assert hit.coefficient[count] == 1
    assert same_flags(hit.status[count], sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY)


HARD = {
    "velocity": np.array([0.0, 5e-324, 1e-310, 1e-300, 1e-150, 1.0, 1e5, 1e300]),
    "time": np.array([0.0, 5e-324, 1e-300, 1e-6, 1.0, 1e30, 1e300]),
}
DAMPED = {
    "viscoelastic": lambda time, r: sj.ViscoelasticHertz(PAIR, time),
    "hertz-dashpot": lambda time, r: sj.HertzDashpot(PAIR, r, "zero-force"),
    "linear": lambda time, r: sj.LinearSpringDashpot(PAIR, 1e6, r, "zero-force"),
}


ENDS = [(law, dtype, 2) for law in DAMPED for dtype in (np.float64, np.float32)]
ENDS += [("viscoelastic", np.float32, 1)]


@mostly_long("law, dtype, order", ENDS, [("hertz-dashpot", np.float64, 2), ENDS[-1]])
def test_closed_forms_are_never_nan(law, dtype, order):
    """Values and derivatives of first and second order, wherever velocity and damping may be."""
    most = float(np.finfo(dtype).max) ** 0.8
    fit = lambda a: np.minimum(a, most).astype(dtype)  # noqa: E731
    v, time = (x.ravel() for x in np.meshgrid(*map(fit, HARD.values())))
    least = float(np.finfo(dtype).tiny) ** 0.5  # below it the square of a slope by ε is no number
    r = np.resize(np.array([1.0, least, 0.5, 1 - 1e-7, 1e-30], dtype), v.size)

    def of_one(x):
        hit = sj.restitution(DAMPED[law](*x[1:]), x[0])
        parts = (hit.coefficient, hit.duration, hit.peak_overlap, hit.residual_overlap)
        return jnp.stack([jnp.float32(1) * part for part in parts])

    def backwards(x):
        value, pull = jax.vjp(of_one, x)
        (slopes,) = jax.vmap(pull)(jnp.eye(len(value), dtype=value.dtype))
        return (value, slopes), (value, slopes)

    derivatives = backwards if order == 1 else jax.jacfwd(backwards, has_aux=True)
    found = jax.jit(jax.vmap(derivatives))(jnp.stack([v, time, r], -1))
    for number in jax.tree.leaves(found):
        assert number.dtype == dtype
        assert not np.any(np.isnan(number))
    for slopes in (found[1][1], found[0][0]) if order == 2 else (found[1][1],):  # and forward
        assert not np.any(slopes[1::5, :, 2])  # by so small an ε: 0


@mostly_long("route", [None, sj.ODE(rtol=1e-6)])
def test_slow_impacts_on_a_growing_spring_in_float32(route):
    """ε² = k1/(k20 + s v √(k1 M)) with s = 1e12, and its slopes, from 1e-12 m/s on."""
    velocity = np.array([1e-12, 1e-9, 1e-6, 1.0], np.float32)
    law = sj.WaltonBraun(PAIR, np.full(4, 1e6), 2e6, growth=1e12)
    short = jax.tree.map(lambda leaf: np.full(4, leaf, np.float32), law)

    @jax.jit
    def graded(law, v):
        def total(law, v):
            found = sj.restitution(law, v, route).coefficient
            return found.sum(), found

        return jax.value_and_grad(total, argnums=(0, 1), has_aux=True)(law, v)

    (_, found), (by_law, by_velocity) = graded(short, velocity)
    speed = velocity.astype(float) * np.sqrt(1e6 * PAIR.mass)
    exact = (1e6 / (2e6 + 1e12 * speed)) ** 0.5
    slope = -0.5 * exact * 1e12 * speed / (2e6 + 1e12 * speed)  # v ∂ε/∂v and s ∂ε/∂s
    assert np.allclose(found, exact, rtol=2e-6, atol=0)
    assert np.allclose(by_velocity * velocity, slope, rtol=1e-5, atol=1e-7)
    assert np.allclose(by_law.growth * 1e12, slope, rtol=1e-5, atol=1e-7)


def test_durations_just_above_yield():
    """A collision one number above v_cr, whose yielded branch is as long as √eps; both precisions."""
    case = LAWS["zhou"]
    limit = case.law.contact.critical_velocity
    velocity = (limit * np.array([1 + 1e-6, 1.01, 1.5, 3.0, 30.0])).astype(np.float32)
    at = np.append(velocity.astype(float), np.nextafter(limit, 9.0))

    def exact(v):
        with laws.mp.workdps(40):
            known = {k: laws.mp.mpf(float(x)) for k, x in numbers(case.law, v).items()}
            return float(case.exact(known).duration)

    expected = np.array([exact(v) for v in at[:-1]])
    found = np.asarray(sj.restitution(case.law, at).duration)
    assert np.allclose(found[:-1], expected, rtol=1e-10, atol=0)
    assert found[-1] == pytest.approx(exact(limit * (1 + 1e-15)), rel=1e-7)
    short = sj.restitution(jax.tree.map(np.float32, case.law), velocity).duration
    assert np.allclose(short, expected, rtol=2e-6, atol=0)


@pytest.mark.parametrize("route", [None, sj.ODE()], ids=["energy", "ode"])
def test_nothing_is_gained_by_rounding(route):
    """Elastic springs and Thornton's impacts just above yield carry no flag."""
    elastic = sj.restitution(sj.WaltonBraun(PAIR, 1e6, 1e6), np.geomspace(1e-3, 10, 1000), route)
    assert np.all(same_flags(elastic.status, sj.Status.PLAIN))
    assert np.max(np.abs(elastic.coefficient - 1)) < 1e-15
    if route is not None:
        return
    law = sj.Thornton(PAIR)
    near = float(law.elastic_velocity()) * (1 + np.geomspace(1e-15, 1e-3, 1000))
    yielding = sj.restitution(law, near, route)
    assert np.all(same_flags(yielding.status & ~int(sj.Status.ELASTIC), sj.Status.PLAIN))


@mostly_long("dtype", [np.float64, np.float32])
def test_thornton_far_beyond_yield(dtype):
    """d ln ε/d ln v = -1/4 up to where squares of v/V_y are no numbers; 0 with slope 0 at the end."""
    law, largest = jax.tree.map(dtype, LAWS["thornton"].law), np.finfo(dtype).max
    velocity = np.array([1e12, largest**0.45, largest**0.49, largest / 10], dtype)
    of = jax.value_and_grad(lambda v: sj.restitution(law, v).coefficient)
    value, slope = jax.jit(jax.vmap(of))(velocity)
    assert value.dtype == dtype
    assert (value[-1], slope[-1]) == (0, 0)
    assert np.allclose((slope * velocity / value)[:-1], -0.25, rtol=8 * np.finfo(dtype).eps, atol=0)


def test_at_rest_nothing_is_lost_however_large_the_loss_of_moving_spheres_is():
    """σ [v/(v_lim - v)]^ψ is 0 at v = 0, Eq. (17); with σ = 10⁶ nothing is left at 1 m/s."""
    for law in (sj.Zhou(PAIR, 2.0, 1e6, 0.5), sj.EmpiricalRestitution(300.0, 1e6, 0.5)):
        np.testing.assert_array_equal(sj.restitution(law, [0.0, 1.0]).coefficient, [1.0, 0.0])
