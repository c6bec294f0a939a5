"""Histories: the equation of motion along them, what they enclose, and what they end with."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from tests.cases import mostly_long
from tests.laws import LAWS, PRECISE, WITH_FORCE, expected

HISTORY = ("time", "overlap", "velocity", "force")
SAMPLES, PEAK = np.int64(2001), 1000  # unloading begins at the middle sample
# v/v_cr of Zhou's law beside the plain ones: at rest, slow, just yielding, without a turning point
RATIOS = np.array([0.0, 1e-6, 1.0 + 1e-9, 3e3])


@mostly_long("name", WITH_FORCE, ("zhou", "viscoelastic"))
def test_motion_along_it_and_its_ends(name):
    """M Δv = -∫ P dt, Δδ = ∫ v dt, ∮ P dδ = what is lost, P the law's; δ_max, δ*, -ε_p v and T at the ends."""
    case, exact = LAWS[name], expected(name)
    law, velocity, count = case.law, case.velocity, len(case.velocity)
    if "zhou" in name:
        hard = RATIOS * float(law.contact.critical_velocity)
        velocity = np.concatenate([velocity, hard]).reshape(2, -1)
    hit = sj.collide(law, velocity, samples=SAMPLES, route=PRECISE)
    every = [np.asarray(getattr(hit, n)).reshape(-1, SAMPLES) for n in HISTORY]
    if "zhou" in name:
        check_hard(hit, every, sj.restitution(law, velocity))
    time, overlap, speed, force = (x[:count] for x in every)
    v, mass = np.asarray(case.velocity)[:, None], law.contact.mass
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
    assert np.all(np.diff(speed) < 1e-12 * v) or "to zero-overlap" in name  # pulls at its end
    overlap, speed, force = overlap[-1], speed[-1], force[-1]
    if isinstance(law, sj.RateDependentLaw):
        forces = law.force(overlap, speed)
    else:
        back = jax.jit(law.unloading_force)(overlap[PEAK + 1 :], overlap[PEAK])
        forces = np.append(jax.jit(law.loading_force)(overlap[: PEAK + 1]), back)
    assert np.allclose(force, forces, rtol=1e-9, atol=1e-12 * force.max())
    ends = -0.1 if name == "linear dashpot to zero-overlap" else 1e-8
    assert (force[-1] < ends * force.max()) or name == "hertz dashpot to zero-overlap"


def check_hard(hit, every, curve):
    """What is no collision has a history of zeros, each other impact one of its own, all of them numbers."""
    assert hit.time.shape == (*curve.velocity.shape, SAMPLES)
    assert all(np.all(np.isfinite(part)) for part in jax.tree.leaves(hit))
    assert np.array_equal(hit.status, curve.status)
    moving = (curve.velocity.ravel() > 0) & np.append(np.ones(curve.velocity.size - 1, bool), False)
    for part in every:
        assert np.array_equal(np.all(part == 0, axis=-1), ~moving)
    assert hit.status.ravel()[-1] & sj.Status.NO_TURNING_POINT
    assert np.allclose(hit.duration.ravel()[moving], curve.duration.ravel()[moving], rtol=1e-8)
    assert np.all(np.diff(every[0][moving]) > 0)


def test_slopes_along_a_history():
    """In a number of the law and the velocity, in reverse, against fourth-order differences."""
    law, velocity, route = LAWS["walton-braun"].law, 20.0, sj.ODE(rtol=1e-12)

    def path(factors):
        moved = replace(law, growth=law.growth * factors[0])
        hit = sj.collide(moved, velocity * factors[1], samples=7, route=route)
        parts = [hit.time[1:], hit.overlap[1:-1], hit.velocity, hit.force[1:-1]]
        return jnp.concatenate(parts)

    step, sides = 1e-3, np.array([-2, -1, 1, 2])
    points = np.concatenate([1 + step * sides[:, None] * np.eye(2)[k] for k in range(2)])
    values = np.array([path(point) for point in points]).reshape(2, 4, -1)
    far_down, down, up, far_up = np.moveaxis(values, 1, 0)
    exact = (8 * (up - down) - (far_up - far_down)) / (12 * step)
    size = np.max(np.abs(values), axis=(0, 1))
    size = np.where(size > 0, size, 1.0)
    assert np.max(np.abs(exact) / size, axis=1).min() > 1e-3  # each input acts
    found = np.asarray(jax.jit(jax.jacrev(path))(jnp.ones(2))).T  # the transpose of forward slopes
    assert np.allclose(found / size, exact / size, rtol=0, atol=2e-8)
