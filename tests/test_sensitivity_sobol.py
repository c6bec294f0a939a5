"""Global indices: a model with known answers, and ε against a brute-force run."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import FITTED, MATERIALS, RADIUS

A, B = 7.0, 0.1
RANGES = {
    "yield_strength": (3.2e7, 4.8e7),
    "chi": (0.1, 0.4),
    "sigma": (0.3, 0.6),
}
VELOCITY = 3.0


def ishigami(sample):
    """sin a + 7 sin² b + 0.1 c⁴ sin a, each uniform on [-π, π]."""
    a, b, c = sample["a"], sample["b"], sample["c"]
    return jnp.sin(a) + A * jnp.sin(b) ** 2 + B * c**4 * jnp.sin(a)


def nylon() -> cal.Inputs:
    return cal.of_spheres(MATERIALS["nylon"], RADIUS, **FITTED["nylon"])


def test_ishigamis_function_has_its_known_indices():
    pi4 = math.pi**4
    variance = A**2 / 8 + B * pi4 / 5 + B**2 * pi4**2 / 18 + 0.5
    alone = np.array([0.5 * (1 + B * pi4 / 5) ** 2, A**2 / 8, 0.0]) / variance
    together = B**2 * pi4**2 * (1 / 18 - 1 / 50) / variance
    total = alone + np.array([together, 0.0, together])
    calls = []
    found = cal.model_indices(
        ishigami,
        dict.fromkeys("abc", (-math.pi, math.pi)),
        samples=4096,
        resamples=100,
        progress=lambda *call: calls.append(call),
    )
    np.testing.assert_allclose(found.variance, variance, rtol=0.02)
    np.testing.assert_allclose(found.first[0], alone, atol=0.02)
    np.testing.assert_allclose(found.total[0], total, atol=0.02)
    assert np.all((found.first_low < found.first) & (found.first < found.first_high))
    assert np.all((found.total_low[0] < total) & (total < found.total_high[0]))
    # E[(∂f/∂x)²]: of b is a²/2; of a is (1 + 2Bπ⁴/5 + B²π⁸/9)/2; of c is B² 8 π⁶/7
    squares = [0.5 * (1 + 2 * B * pi4 / 5 + B**2 * pi4**2 / 9), A**2 / 2, 8 * B**2 * math.pi**6 / 7]
    bound = 4 * np.array(squares) / variance
    np.testing.assert_allclose(found.bound[0], bound, rtol=0.03)
    assert np.all(found.total[0] < found.bound[0])
    assert calls[-1][1] == calls[-1][2] == 4096 * 6


def brute_force(outer: int = 256, inner: int = 512):
    """Var E[f | θ_i]/Var f and E Var[f | all but θ_i]/Var f by two nested loops."""
    contact_of = nylon().build
    rng = np.random.default_rng(7)
    low, high = np.array(list(RANGES.values())).T

    def drawn(*shape):
        return low + (high - low) * rng.random((*shape, len(low)))

    @jax.jit
    def restitution(theta):
        values = nylon().values | dict(zip(RANGES, jnp.moveaxis(theta, -1, 0), strict=True))
        values = {k: jnp.broadcast_to(v, theta.shape[:-1]) for k, v in values.items()}
        return sj.restitution(contact_of(values), VELOCITY).coefficient

    variance = np.var(restitution(drawn(outer, inner)))
    first, total = [], []
    for i in range(len(low)):
        theta = drawn(outer, inner)
        theta[..., i] = theta[:, :1, i]
        value = np.asarray(restitution(theta))
        within = np.mean(np.var(value, axis=1, ddof=1))
        first.append(np.var(np.mean(value, axis=1), ddof=1) - within / inner)
        others = np.repeat(drawn(outer, 1), inner, axis=1)
        others[..., i] = drawn(outer, inner)[..., i]
        total.append(np.mean(np.var(np.asarray(restitution(others)), axis=1, ddof=1)))
    return np.array(first) / variance, np.array(total) / variance


def test_restitutions_indices_agree_with_a_brute_force_run():
    found = cal.sobol_indices(nylon(), RANGES, [VELOCITY], samples=2048, resamples=50)
    first, total = brute_force()
    np.testing.assert_allclose(found.first[0], first, atol=0.06)
    np.testing.assert_allclose(found.total[0], total, atol=0.06)
    assert np.all(found.total[0] < found.bound[0] + 0.01)
    assert found.names == tuple(RANGES)
    assert np.max(found.total) > 0.3


@pytest.mark.parametrize(
    ("ranges", "options", "named"),
    [
        ({"colour": (0, 1)}, {}, "ranges"),
        ({"chi": (2.0, 1.0)}, {}, "ranges"),
        ({}, {}, "ranges"),
        ({"chi": (0.0, 1.0)}, {"scale": "log"}, "ranges"),
        ({"chi": (0.1, 1.0)}, {"samples": 1000}, "samples"),
        ({"chi": (0.1, 1.0)}, {"scale": "cubic"}, "scale"),
    ],
)
def test_what_makes_no_sense_is_named(ranges, options, named):
    with pytest.raises(ValueError, match=f"`{named}`"):
        cal.sobol_indices(nylon(), ranges, [1.0], **options)
