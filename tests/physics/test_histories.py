"""Histories: the equation of motion along them, what they enclose, and what they end with."""

from dataclasses import replace
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import softjax as sj
from tests.laws import LAWS, PRECISE, WITH_FORCE, expected

HISTORY = ("time", "overlap", "velocity", "force")
SAMPLES, PEAK = 2001, 1000  # unloading begins at the middle sample
QUICK = ("zhou", "viscoelastic", "thornton")
OVER_LAWS = [pytest.param(n, marks=() if n in QUICK else pytest.mark.long) for n in WITH_FORCE]
# v/v_cr of Zhou's law beside the plain ones: at rest, slow, just yielding, without a turning point
RATIOS = np.array([0.0, 1e-6, 1.0 + 1e-9, 3e3])


@lru_cache
def histories(name):
    """Those of the plain impacts, as NumPy's; by Zhou's law of hard ones too."""
    case = LAWS[name]
    velocity = case.velocity
    if "zhou" in name:
        hard = RATIOS * float(case.law.contact.critical_velocity)
        velocity = np.concatenate([velocity, hard]).reshape(2, -1)
    hit = sj.collide(case.law, velocity, samples=SAMPLES, route=PRECISE)
    parts = {name: np.asarray(getattr(hit, name)) for name in HISTORY}
    return case, velocity, hit, {n: x.reshape(-1, SAMPLES) for n, x in parts.items()}


@pytest.mark.parametrize("name", OVER_LAWS)
def test_motion_along_it_and_its_ends(name):
    """M Δv = -∫ P dt, Δδ = ∫ v dt, ∮ P dδ = what is lost; δ_max, δ*, -ε_p v and T at the ends."""
    case, _, hit, every = histories(name)
    exact, count = expected(name), len(case.velocity)
    parts = {name: x[:count] for name, x in every.items()}
    time, overlap, speed, force = (parts[n] for n in HISTORY)
    v, mass = np.asarray(case.velocity)[:, None], case.law.contact.mass
    plastic = np.asarray(hit.plastic_coefficient).ravel()[:count]
    for rate, path, scale in ((speed, overlap, exact[:, 1:2]), (-force / mass, speed, v)):
        middle = 0.5 * (rate[:, 1:] + rate[:, :-1]) * np.diff(time)
        moved = np.cumsum(middle, axis=-1)
        assert np.all(np.abs(moved - (path[:, 1:] - path[:, :1])) <= 2e-5 * scale)
    loop = np.trapezoid(force, overlap, axis=-1) / (0.5 * mass * v[:, 0] ** 2)
    assert np.allclose(loop, 1 - plastic**2, rtol=0, atol=3e-6)
    if "zhou" not in name:  # whose ε has losses beside the force
        assert np.allclose(plastic, exact[:, 0], rtol=0, atol=1e-9)
    assert np.allclose(speed[:, 0], v[:, 0], rtol=1e-14)
    assert np.allclose(speed[:, -1], -plastic * v[:, 0], rtol=1e-8)
    assert np.all(np.abs(overlap[:, -1] - exact[:, 2]) <= 1e-8 * exact[:, 1])
    assert np.allclose(overlap.max(axis=-1), exact[:, 1], rtol=1e-6)
    assert np.allclose(time[:, -1], exact[:, 3], rtol=1e-8)
    assert np.allclose(hit.duration.ravel()[:count], exact[:, 3], rtol=1e-8)
    assert np.all(np.diff(time) > 0)
    assert np.all(np.diff(speed) < 1e-12 * v) or name.startswith("linear")  # which pulls at its end


@pytest.mark.parametrize("name", OVER_LAWS)
def test_force_is_the_laws(name):
    case, _, _, parts = histories(name)
    overlap, speed, force = (parts[n][len(case.velocity) - 1] for n in HISTORY[1:])
    if isinstance(case.law, sj.RateDependentLaw):
        exact = case.law.force(overlap, speed)
    else:
        there = case.law.loading_force(overlap[: PEAK + 1])
        exact = np.append(there, case.law.unloading_force(overlap[PEAK + 1 :], overlap[PEAK]))
    assert np.allclose(force, exact, rtol=1e-9, atol=1e-12 * force.max())
    ends = -0.1 if name == "linear dashpot to zero-overlap" else 1e-8
    assert (force[-1] < ends * force.max()) or name == "hertz dashpot to zero-overlap"


@pytest.mark.parametrize("name", ["zhou", pytest.param("zhou full", marks=pytest.mark.long)])
def test_hard_impacts_have_finite_ones_and_what_is_no_collision_none(name):
    case, velocity, hit, parts = histories(name)
    assert hit.time.shape == (*velocity.shape, SAMPLES)
    for part in jax.tree.leaves(hit):
        assert np.all(np.isfinite(part))
    curve = sj.restitution(case.law, velocity)
    assert np.array_equal(hit.status, curve.status)
    still = np.isin(np.arange(velocity.size), [velocity.size - 4, velocity.size - 1])
    for part in parts.values():
        assert np.array_equal(np.all(part == 0, axis=-1), still)
    assert hit.status.ravel()[-1] & sj.Status.NO_TURNING_POINT
    moving = ~still
    assert np.allclose(hit.duration.ravel()[moving], curve.duration.ravel()[moving], rtol=1e-8)
    assert np.all(np.diff(parts["time"][moving]) > 0)


def test_the_states_are_those_of_an_ode_solver():
    """SciPy integrates Zhou's forces [N] in time, at 40 critical velocities."""
    case, _, _, parts = histories("zhou")
    k, law = len(case.velocity) - 1, case.law
    v, mass = float(case.velocity[k]), law.contact.mass
    hit = {name: x[k] for name, x in parts.items()}
    peak = hit["overlap"][PEAK]
    pace, length = peak / v, peak
    loading = jax.jit(lambda x: law.loading_force(x))
    unloading = jax.jit(lambda x: law.unloading_force(x, peak))

    def integrate(force, state, times):
        scale = pace / (mass * v)
        motion = lambda t, u: [u[1], -scale * float(force(max(u[0], 0.0) * length))]  # noqa: E731
        settings = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
        return solve_ivp(motion, times[[0, -1]], state, t_eval=times, **settings).y

    times = hit["time"][:: SAMPLES // 20] / pace
    half = len(times) // 2 + 1
    there = integrate(loading, [0.0, 1.0], times[:half])
    back = integrate(unloading, [1.0, 0.0], times[half - 1 :])
    states = np.array([hit["overlap"] / length, hit["velocity"] / v])[:, :: SAMPLES // 20]
    assert np.all(np.abs(states[:, :half] - there) <= 1e-7)
    assert np.all(np.abs(states[:, half - 1 :] - back) <= 1e-7)


def test_its_mirror_and_counts_of_numpy():
    """Hertz's history is the same forwards and backwards; `samples` may be an integer of NumPy."""
    hit = sj.collide(LAWS["hertz"].law, 2.0, samples=np.int64(401))
    assert hit.time.shape == (401,)
    assert np.allclose(hit.overlap, hit.overlap[::-1], rtol=1e-12, atol=0)
    assert np.allclose(hit.velocity, -hit.velocity[::-1], rtol=0, atol=1e-12)


LEAF = {
    "zhou": "chi",
    "thornton": "yield_factor",
    "walton-braun": "growth",
    "viscoelastic": "dissipation_time",
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n == "walton-braun" else pytest.mark.long) for n in LEAF]
)
def test_slopes_along_a_history(name):
    """In a number of the law and the velocity, both modes, against fourth-order differences."""
    law, velocity, route = LAWS[name].law, float(LAWS[name].velocity[-1]), sj.ODE(rtol=1e-12)

    def path(factors):
        moved = replace(law, **{LEAF[name]: getattr(law, LEAF[name]) * factors[0]})
        hit = sj.collide(moved, velocity * factors[1], samples=7, route=route)
        parts = [hit.time[1:], hit.overlap[1:-1], hit.velocity, hit.force[1:-1]]
        return jnp.concatenate(parts)

    @jax.jit
    def both(factors):
        """In one program."""
        values, push = jax.linearize(path, factors)
        pull = jax.vmap(jax.linear_transpose(push, factors))
        return jax.vmap(push)(jnp.eye(2)), pull(jnp.eye(len(values)))[0]

    step, sides = 1e-3, np.array([-2, -1, 1, 2])
    points = np.concatenate([1 + step * sides[:, None] * np.eye(2)[k] for k in range(2)])
    values = np.array([path(point) for point in points]).reshape(2, 4, -1)
    far_down, down, up, far_up = np.moveaxis(values, 1, 0)
    expected = (8 * (up - down) - (far_up - far_down)) / (12 * step)
    size = np.max(np.abs(values), axis=(0, 1))
    size = np.where(size > 0, size, 1.0)
    assert np.max(np.abs(expected) / size, axis=1).min() > 1e-3  # each input acts
    found, back = map(np.asarray, both(jnp.ones(2)))
    assert np.allclose(found / size, expected / size, rtol=0, atol=2e-8)
    assert np.allclose(back.T / size, found / size, rtol=0, atol=1e-11)
