"""Derivatives of every law: ε, both overlaps and the duration in all numbers, forward and reverse.

Against central differences of the formulas in 40 digits. The same batch has impacts at rest, slow,
fast and invalid ones beside the plain: nothing of these reaches a neighbour.
"""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from tests import laws
from tests.cases import compiled_soon
from tests.laws import LAWS, PRECISE, QUANTITIES, numbers, with_numbers

HARD = np.array([0.0, 1e-100, 1e-6, 1.0, 1e5])  # dT/dv itself overflows at 1e-300
INVALID = np.array([np.nan, -1.0, np.inf, 0.5])  # the last one by a number of the law
QUICK = ("viscoelastic",)
CASES = [
    pytest.param(
        name,
        route,
        id=f"{name}-{route.name}",
        marks=[pytest.mark.long] if route == PRECISE and name not in QUICK else [],
    )
    for name, case in LAWS.items()
    for route in case.routes
]


@lru_cache
def solved(name, route):
    """What `laws.graded` gives of the whole batch; the slopes by number: (4, impacts)."""
    case = LAWS[name]
    field, wrong = case.invalid
    values = laws.repeated(case.law, np.concatenate([case.velocity, HARD, INVALID]))
    values[field][-1] = wrong
    found, result, forward, reverse = laws.graded(case.law, values, route)
    slopes = [dict(zip(values, np.asarray(s), strict=True)) for s in (forward, reverse)]
    return np.asarray(found), result, *slopes


@pytest.mark.parametrize(("name", "route"), CASES)
def test_first_derivatives(name, route):
    """θ ∂q/∂θ over the size of q; Eq. (17) at v_lim, where ε is 1e-29, over 1."""
    exact, expected = laws.expected(name), laws.expected_slopes(name)
    count = len(exact)
    size = np.where(exact > 0, np.abs(exact), 1.0).T
    size[0] = 1.0
    size[2] = np.maximum(size[1], 1e-300)  # an overlap left is known to rounding of the peak
    tolerance = 2e-12 if route != PRECISE else 1e-9
    found = solved(name, route)
    assert np.all(np.abs(found[0][:, :count] - exact.T) <= tolerance * size)
    for slopes in found[2:]:
        assert set(slopes) == set(expected)
        for key, exact_slope in expected.items():
            error = np.abs(slopes[key][:, :count] - exact_slope.T) / size
            assert np.all(error <= tolerance), (key, dict(zip(QUANTITIES, error, strict=True)))
            zero = np.all(exact_slope == 0, axis=0)
            assert np.all(np.abs(slopes[key][zero, :count] / size[zero]) <= 1e-13), key


@pytest.mark.parametrize(("name", "route"), CASES)
def test_hard_and_invalid_impacts(name, route):
    """From rest to 1e5 m/s numbers with finite slopes; at rest ε = 1; invalid ones are 0 and told."""
    count = len(LAWS[name].velocity)
    found, result, *both = solved(name, route)
    status = np.asarray(result.status)
    assert np.all(np.isfinite(found))
    eps = np.finfo(float).eps
    coefficient = found[0, count : count + len(HARD)]
    gains = status[count : count + len(HARD)] & int(sj.Status.ENERGY_GAIN) > 0
    assert np.all((coefficient >= 0) & ((coefficient <= 1 + 2 * eps) | gains))
    assert coefficient[0] == 1
    assert status[count] == sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY
    assert not np.any(status[count + 1 : count + 5] & int(sj.Status.ZERO_VELOCITY))
    assert np.all(status[-4:] == sj.Status.INVALID_INPUT)
    assert np.all(found[:, -4:] == 0)
    for slopes in both:
        for key, slope in slopes.items():
            known = slope[:, :-4] if key != LAWS[name].invalid[0] else slope[:, :-5]
            assert np.all(np.isfinite(known)), key
            # times the number itself, which is no number where it is invalid
            assert np.all((slope[:, -4:] == 0) | np.isnan(slope[:, -4:])), key


def _along(name):
    """A direction in the logarithms of all numbers and the velocity."""
    names = list(numbers(LAWS[name].law, 1.0))
    return dict(zip(names, np.cos(1.0 + np.arange(len(names))), strict=True))


SECOND = [pytest.param(n, marks=pytest.mark.long if "zhou" in n else ()) for n in LAWS]


@pytest.mark.parametrize("name", SECOND)
def test_second_derivatives_along_a_direction(name):
    """d²q/dt² with every number times e^{a t}: by forward over reverse, against differences."""
    case, along = LAWS[name], _along(name)

    def moved(t, v):
        at = numbers(case.law, v)
        at = {key: value * jnp.exp(along[key] * t) for key, value in at.items()}
        hit = sj.restitution(with_numbers(case.law, at), at["velocity"])
        return jnp.stack([hit.coefficient, hit.peak_overlap])

    @partial(compiled_soon)
    @partial(jax.vmap, in_axes=(None, 0))
    def second(t, v):
        return jax.jacfwd(jax.jacrev(moved))(t, v)

    found = np.asarray(second(0.0, jnp.asarray(case.velocity)))
    with mp.workdps(60):
        step = mp.mpf("1e-12")
        for i, v in enumerate(case.velocity):
            at = {key: mp.mpf(float(x)) for key, x in numbers(case.law, float(v)).items()}
            up, here, down = (
                case.exact({k: x * mp.exp(along[k] * s) for k, x in at.items()})
                for s in (step, 0, -step)
            )
            exact = [(a - 2 * b + c) / step**2 for a, b, c in zip(up, here, down, strict=True)][:2]
            size = np.array([1.0, float(here.peak) or 1.0])
            assert np.allclose(found[i] / size, np.array(exact, float) / size, atol=1e-8), (v, i)


def test_second_derivative_where_damping_begins():
    """ε = 1 - 1.15345 w² + 0.79826 w⁴ + …: a series of w², whose root has no second derivative."""
    pair = laws.PAIR
    unit = 1.5 * (pair.stiffness / pair.mass) ** 0.4

    def restitution(b):
        return sj.restitution(sj.ViscoelasticHertz(pair, b / unit), 1.0).coefficient

    slope = lambda b: jax.jvp(restitution, (b,), (1.0,))[1]  # noqa: E731
    first, second = compiled_soon(lambda b: jax.jvp(slope, (b,), (1.0,)))(0.0)
    assert first == pytest.approx(-1.153449, abs=1e-6)
    assert second == pytest.approx(2 * 0.798267, abs=2e-6)
