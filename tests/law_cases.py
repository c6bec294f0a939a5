"""What the tests of the contact laws share: one pair of spheres, derivatives, wrong inputs."""

from dataclasses import fields, replace
from functools import partial

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from tests.cases import compiled_soon, pair

PAIR = pair("stainless steel")
LEAVES = tuple(PAIR.leaves())
ODE = sj.ODE(rtol=1e-11)
# v, and whether a traced law can answer
TRACED = np.array([0.5, np.nan, -1.0, np.inf, 0.5])


def own_fields(law) -> tuple[str, ...]:
    """The numbers of a law beside its contact."""
    named = (field.name for field in fields(law) if not field.metadata.get("static"))
    return tuple(name for name in named if name != "contact")


def each_its_own(law, count: int, dtype=np.float64):
    """The law with every number repeated, so that each impact has derivatives of its own."""
    return jax.tree.map(lambda leaf: jnp.full(count, leaf, dtype), law)


def derivatives(law, velocity, route=None, dtype=np.float64):
    """ε, status and θ ∂ε/∂θ for every number θ of the law, the contact and the velocity."""
    velocity = np.asarray(velocity)
    many = each_its_own(law, len(velocity), dtype)
    answer, (by_law, by_velocity) = _graded(many, jnp.asarray(velocity, dtype), route)
    found, status = answer[1]
    slopes = {name: getattr(by_law.contact, name) * getattr(law.contact, name) for name in LEAVES}
    slopes |= {name: getattr(by_law, name) * getattr(law, name) for name in own_fields(law)}
    return found, status, slopes | {"velocity": by_velocity * velocity}


@partial(compiled_soon, static_argnames="route")
def _graded(law, velocity, route):
    def total(law, velocity):
        result = sj.restitution(law, velocity, route)
        return result.coefficient.sum(), (result.coefficient, result.status)

    return jax.value_and_grad(total, argnums=(0, 1), has_aux=True)(law, velocity)


def differences(formula, law, velocity, step=1e-12):
    """θ ∂ε/∂θ of `formula(**numbers)` by central differences in 40 digits."""
    with mp.workdps(40):
        numbers = {name: getattr(law.contact, name) for name in LEAVES}
        numbers |= {name: getattr(law, name) for name in own_fields(law)}
        rows = [_log_slopes(formula, numbers | {"velocity": float(v)}, step) for v in velocity]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _log_slopes(formula, numbers, step) -> dict[str, float]:
    numbers = {name: mp.mpf(float(value)) for name, value in numbers.items()}
    step = mp.mpf(step)
    up = {n: formula(**(numbers | {n: value * (1 + step)})) for n, value in numbers.items()}
    down = {n: formula(**(numbers | {n: value * (1 - step)})) for n, value in numbers.items()}
    return {name: float((up[name] - down[name]) / (2 * step)) for name in numbers}


def assert_slopes(found: dict, expected: dict, tolerance: float) -> None:
    assert set(found) == set(expected)
    for name in expected:
        assert np.allclose(found[name], expected[name], rtol=0, atol=tolerance), name
    assert any(np.any(np.abs(slope) > 100 * tolerance) for slope in expected.values())


def hard_velocities(least=1e-300):
    """Rest, the slowest impact, and on to the fastest."""
    return np.array([0.0, least, 1e-6, 1.0, 1e5])


def assert_survives(law, route=None, dtype=np.float64, least=1e-300):
    """At hard velocities: numbers, finite derivatives, and the status of rest."""
    velocity = hard_velocities(least)
    found, status, slopes = derivatives(law, velocity, route, dtype)
    assert found.dtype == dtype
    assert found[0] == 1
    assert status[0] == sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY
    assert not np.any(status[1:] & sj.Status.ZERO_VELOCITY)
    assert np.all((found >= 0) & (found <= 1 + 2 * np.finfo(dtype).eps))
    assert all(np.all(np.isfinite(slope)) for slope in slopes.values())
    return found, status


def assert_traced_failures(law, field: str, bad_value: float, route=None):
    """Under `jit` nothing is raised: what is no impact gets 0 and its flag, its neighbours not."""
    count = len(TRACED)
    many = each_its_own(law, count)
    broken = replace_leaf(many, field, getattr(many, field).at[-1].set(bad_value))
    (_, (coefficient, status)), slopes = _graded(broken, jnp.asarray(TRACED), route)
    failed = np.array([False, True, True, True, True])
    assert np.array_equal(status == sj.Status.INVALID_INPUT, failed)
    assert np.all(coefficient[failed] == 0)
    assert coefficient[0] > 0
    for slope in jax.tree.leaves(slopes):
        assert np.all(slope[failed] == 0)
        assert np.isfinite(slope[0])


def replace_leaf(law, name: str, value):
    """The law with one number replaced, unchecked, as tracing would leave it."""
    leaves, structure = jax.tree.flatten(law)
    paths = [str(path[-1]).lstrip(".") for path, _ in jax.tree_util.tree_flatten_with_path(law)[0]]
    leaves[paths.index(name)] = value
    return jax.tree.unflatten(structure, leaves)


def assert_refused(make, name: str, *values) -> None:
    """Each value is refused by a line that names the argument, the value and what is accepted."""
    for value in values:
        with pytest.raises(ValueError, match=f"`{name}` must be .*, but is ") as error:
            make(value)
        assert "\n" not in str(error.value)


def assert_contact_refused(law) -> None:
    wrong = (1.0, "steel") if isinstance(law, sj.ConstantRestitution) else (1.0, "steel", None)
    assert_refused(lambda contact: replace(law, contact=contact), "contact", *wrong)


def work_between(force, lower, upper, count=200):
    """∫ force over [lower, upper] by Gauss–Legendre in the square root of the way from below."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    way = 0.5 * (nodes + 1)
    x = lower + (upper - lower) * way**2
    return np.sum(weights * way * np.asarray(force(x))) * (upper - lower)


def loop_area(history):
    """Trapezoidal ∮ P dδ over the last axis."""
    return np.trapezoid(history.force, history.overlap, axis=-1)


def _turned(law, y):
    """Peak overlaps, how fast they grow with y, the force there, and what is given back from there."""
    peak, pace = jax.vmap(lambda y: jax.jvp(law.peak, (y,), (jnp.ones_like(y),)))(y)
    return peak, pace, jax.vmap(law.loading)(peak), jax.vmap(law.release)(peak)


def assert_works_are_those_of_the_forces(law, y, rtol=1e-12) -> None:
    """Closed forms of a reduced law against its forces: dW_L = p_L dx, and W_U by quadrature."""
    y = jnp.asarray(y)
    peak, pace, loading, released = compiled_soon(_turned)(law, y)
    assert np.allclose(loading * pace, 0.8 * y, rtol=rtol, atol=0)
    residual, recovered, work = released
    nodes, weights = np.polynomial.legendre.leggauss(200)
    nodes, weights = 0.5 * (nodes + 1), 0.5 * weights
    # in the root of what is left of the way, in which half powers of x - x* are smooth
    left = np.asarray(recovered)[:, None] * nodes**2
    x, top = np.asarray(residual)[:, None] + left, np.broadcast_to(peak[:, None], left.shape)
    force = jax.jit(lambda law, *at: jax.vmap(jax.vmap(law.unloading))(*at))(law, x, top)
    total = 2 * recovered * np.sum(weights * nodes * force, -1)
    assert np.allclose(work, total, rtol=rtol, atol=0)
