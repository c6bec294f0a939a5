"""Laws by their forces alone: solved by hand, drawn at random, pulling and jumping, by both routes."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests import laws
from tests.cases import same_flags
from tests.physics import by_forces
from tests.physics.by_forces import LENGTH, STEEL, Columns, Drawn, Forces, Impact, columns

ROUTES = {"energy": sj.EnergyBalance(), "ode": sj.ODE(rtol=1e-10)}
over_routes = pytest.mark.parametrize("route", ROUTES)
DRAWN = 200  # of a batch: one program serves all
HAND = by_forces.by_hand()
FIELDS, VELOCITY = by_forces.draw(seed=0, count=DRAWN)
MOVED = ("slope", "more", "rest", "floor", "kink", "elastic", "velocity")  # slopes are of these
QUANTITIES = ("plastic_coefficient", "status", *laws.QUANTITIES)
FLAGS = ("ELASTIC", "NO_RESIDUAL_OVERLAP", "INEXACT", "SOLVER_FAILED", "NO_TURNING_POINT")


def has(result, name):
    assert name in FLAGS
    return (np.asarray(result.status) & int(sj.Status[name])) > 0


@jax.jit
def _solved(fields, velocity, remains):
    def total(moved):
        of = fields._replace(**{name: moved[name] for name in MOVED[:-1]})
        result = sj.restitution(Drawn(STEEL, *of), moved["velocity"])
        other = jnp.where(remains, result.residual_overlap / LENGTH, result.coefficient)
        return other.sum(), result

    moved = {name: getattr(fields, name) for name in MOVED[:-1]} | {"velocity": velocity}
    (_, result), slopes = jax.value_and_grad(total, has_aux=True)(moved)
    return result, slopes


def graded(fields: Columns, velocity, remains=False):
    """The result of drawn laws by the energy balance, and slopes of ε, or of δ*/LENGTH."""
    count, batches = len(velocity), []
    for k in range(0, count, DRAWN):
        some = [np.resize(x[k : k + DRAWN], DRAWN) for x in (*fields, velocity)]
        batches.append(_solved(Columns(*some[:-1]), some[-1], remains))
    return jax.tree.map(lambda *x: np.concatenate(x)[:count] if np.ndim(x[0]) else x[0], *batches)


def solved(fields: Columns, velocity, route="energy"):
    """The result, and its durations by the ODE."""
    of = lambda *row: sj.restitution(Forces(STEEL, *row[:-1]), row[-1], ROUTES[route])  # noqa: E731
    return laws.in_small_batches(QUANTITIES[: 5 + (route == "ode")], of, *fields, velocity)


def off(result, exact):
    """Errors of ε_p², and of both overlaps over the peak."""
    squared = np.abs(np.square(result.plastic_coefficient) - exact.squared)
    lengths = [
        np.abs(getattr(result, f"{name}_overlap") / LENGTH - getattr(exact, name)) / exact.peak
        for name in ("peak", "residual")
    ]
    return np.array([squared, *lengths])


@over_routes
def test_collisions_solved_by_hand(route):
    """ε², both overlaps, durations by the ODE, the status; and by the energy balance ∂δ*/∂ρ of a zero that is searched for."""
    velocity = np.array([row.velocity for row in HAND])
    hit = solved(columns([row.law for row in HAND]), velocity, route)
    squared, peak, residual, flags, tolerance, time = (
        np.array([getattr(row, name) for row in HAND], float) for name in Impact._fields[2:]
    )
    hole = np.array([row.law.get("shape") == by_forces.HOLE for row in HAND])
    sure = ~(hole & has(hit, "SOLVER_FAILED"))  # it may give up, but says so
    if route == "ode":
        sure &= flags != int(sj.Status.INEXACT)
        tolerance = np.maximum(tolerance, 1e-7)
    over = np.abs(hit.residual_overlap / LENGTH - residual)
    wrong = {
        "squared": np.abs(hit.coefficient**2 - squared) > tolerance * np.maximum(squared, 1e-15),
        "peak": np.abs(hit.peak_overlap / LENGTH - peak) > 1e-9 * peak,
        "residual": over > np.maximum(1e-9, tolerance) * peak,
        "status": ~same_flags(hit.status & ~int(sj.Status.ABOVE_LIMIT_VELOCITY), flags.astype(int)),
    }
    if route == "ode":
        wrong["duration"] = np.abs(hit.duration / LENGTH / time - 1) > 1e-8
    assert np.all(np.isfinite(hit.coefficient))
    for name, rows in wrong.items():
        assert [HAND[k] for k in np.flatnonzero(sure & rows)] == [], name


def test_a_force_that_is_no_number_below_its_zero():
    """s^{3/2} at 400 velocities: rounding decided which tenth gave up; 1 zero in 40 was missed by up to 0.2 %."""
    velocity = np.geomspace(0.05, 5, 400)
    law = {"shape": by_forces.BELOW, "rest": 1.0, "gap": 0.5, "sharp": 0.5}
    fields = columns([law] * len(velocity))
    found, slopes = graded(fields, velocity)
    peak = velocity * np.sqrt(0.8)
    rest = peak / (peak + 0.5)
    for hit in (found, solved(fields, velocity)):
        assert np.all(same_flags(hit.status, 0))
        np.testing.assert_allclose(hit.coefficient**2, 0.8 * (1 - rest), rtol=1e-9)
        np.testing.assert_allclose(hit.residual_overlap / LENGTH, rest * peak, rtol=1e-13)
    slope = -np.sqrt(0.4 * 0.2) / (peak + 0.5) ** 1.5
    np.testing.assert_allclose(slopes["velocity"], slope, rtol=1e-6)


def test_slopes_of_a_zero_that_is_searched_for():
    """δ* = ρ δ_m."""
    rows = [row for row in HAND if set(row.law) == {"back", "rest"} and row.law["rest"] < 1]
    fields, velocity = columns([row.law for row in rows]), np.array([row.velocity for row in rows])

    _, slopes = graded(fields, velocity, remains=True)
    peaks = [row.peak for row in rows]
    assert np.allclose(slopes["rest"], peaks, rtol=1e-4, atol=0)


@lru_cache
def pulled():
    rows, speeds = zip(*by_forces.PULLED, strict=True)
    fields, velocity = columns(rows), np.array(speeds)
    return fields, velocity, by_forces.answers(fields, velocity)


@over_routes
def test_forces_that_pull_and_jump(route):
    """A loading force that pulls is not clipped, and a declared jump costs no accuracy."""
    fields, velocity, exact = pulled()
    found = solved(fields, velocity, route)
    peak, error = found.peak_overlap, off(found, exact)[0]
    sure = ~has(found, "INEXACT")
    pulls, jumps = fields.pull + fields.snap > 0, fields.kink == by_forces.JUMPING["kink"]
    assert np.all(sure[jumps | pulls & ((fields.snap == 0) | (velocity == 1))])
    assert np.all(error[sure] < 1e-7 * exact.squared[sure]), error
    assert np.all(error[jumps] < 1e-8 * exact.squared[jumps]), error
    assert np.allclose(peak / LENGTH, exact.peak, rtol=1e-7, atol=0)


def test_a_pull_too_hard_for_the_integration_is_no_wrong_number():
    """A slow body is pulled through the snap: its speed grows threefold within a tenth of its way."""
    snaps, slow = pulled()[0].take(np.array([6])), np.array([0.3])
    assert snaps.snap == 2
    found = solved(snaps, slow, "ode")
    error = np.abs(found.plastic_coefficient**2 / by_forces.answers(snaps, slow).squared - 1)
    assert has(found, "SOLVER_FAILED") | (error < 1e-7)


# drawn at random


@lru_cache
def expected():
    """And which impacts yield."""
    exact = by_forces.answers(FIELDS, VELOCITY)
    return exact, exact.peak > FIELDS.elastic


@pytest.mark.parametrize(("route", "bound"), [("energy", 1e-9), ("ode", 1e-7)])
def test_drawn_laws_with_all_kinks_declared(route, bound):
    exact, yields = expected()
    result = graded(FIELDS, VELOCITY)[0] if route == "energy" else solved(FIELDS, VELOCITY, route)
    assert np.max(off(result, exact)[:, yields]) < bound
    assert np.array_equal(has(result, "ELASTIC"), ~yields)
    assert np.all(result.plastic_coefficient[~yields] == 1)
    for name in ("INEXACT", "SOLVER_FAILED", "NO_TURNING_POINT"):
        assert not np.any(has(result, name))
    assert np.array_equal(has(result, "NO_RESIDUAL_OVERLAP"), yields & (exact.residual == 0))
    for k in np.flatnonzero(yields)[: 12 * (route == "ode")]:
        time = by_forces.duration(FIELDS.take(k), VELOCITY[k], exact.peak[k], exact.residual[k])
        assert result.duration[k] == pytest.approx(time * LENGTH, rel=2e-7)


def test_drawn_laws_without_a_word_of_kinks():
    """Exact, or flagged."""
    exact, yields = expected()
    result, _ = graded(FIELDS._replace(declared=np.zeros(DRAWN)), VELOCITY)
    inexact = has(result, "INEXACT")
    worst = np.max(off(result, exact), 0)
    assert np.max(worst[yields & ~inexact]) < 1e-9
    assert np.max(worst[yields]) < 1e-2
    kinked = yields & (FIELDS.elastic > 0)
    assert np.sum(inexact[kinked]) > 0.5 * np.sum(kinked)
    assert not np.any(inexact[(FIELDS.elastic == 0) & (FIELDS.more == 0) & (FIELDS.jolt == 0)])


def test_a_thousand_more_are_numbers_with_good_neighbours():
    """Wilder ones: forces of any size, velocities over twelve decades; forward and backward."""
    size = 1000
    fields, velocity = by_forces.draw(seed=1, count=size)
    rng = np.random.default_rng(2)
    wild = np.arange(size) % 2 == 0
    velocity = np.where(wild, 10 ** rng.uniform(-9, 3, size), velocity)
    sizes = {n: getattr(fields, n) * 10 ** rng.uniform(-6, 6, size) for n in ("slope", "more")}
    wilder = sizes | {"back": rng.uniform(0.3, 6, size)}
    fields = fields._replace(
        **{n: np.where(wild, x, getattr(fields, n)) for n, x in wilder.items()}
    )
    result, slopes = graded(fields, velocity)
    for leaf in jax.tree.leaves((result.coefficient, result.status, slopes)):
        assert np.all(np.isfinite(leaf))
    calm = np.repeat(np.flatnonzero(~wild), 2)
    alone, slopes_alone = graded(fields.take(calm), velocity[calm])
    assert np.array_equal(alone.status, result.status[calm])
    assert np.allclose(alone.coefficient, result.coefficient[calm], rtol=0, atol=1e-13)
    assert np.allclose(slopes_alone["velocity"], slopes["velocity"][calm], rtol=1e-9, atol=1e-12)


def test_slopes_of_drawn_laws():
    """θ ∂ε/∂θ against differences of the answers, where no kink is beside the peak."""
    _, yields = expected()
    _, slopes = graded(FIELDS, VELOCITY)
    step = 1e-6
    for name in MOVED:
        moved = [
            by_forces.answers(FIELDS, VELOCITY * by)
            if name == "velocity"
            else by_forces.answers(FIELDS._replace(**{name: getattr(FIELDS, name) * by}), VELOCITY)
            for by in (1 + step, 1 - step)
        ]
        up, down = (np.sqrt(one.squared) for one in moved)
        exact = np.where(yields, (up - down) / (2 * step), 0.0)
        at = VELOCITY if name == "velocity" else getattr(FIELDS, name)
        assert np.allclose(slopes[name] * at, exact, rtol=2e-7, atol=2e-7), name


def test_where_a_plateau_begins():
    law = columns([{"elastic": 0.01, "slope": 0.0}]).law()
    limit = np.sqrt(0.8 * STEEL.stiffness * (0.01 * LENGTH) ** 2.5 / STEEL.mass)
    assert law.elastic_velocity() == pytest.approx(limit, rel=1e-13)
