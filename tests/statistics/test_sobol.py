"""Global indices: a model with known answers, SciPy's own, and ε against a brute-force run."""

import math
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.cases import FITTED, MATERIALS, RADIUS
from tests.decay import Decay

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
    np.testing.assert_allclose(found.mean, A / 2, rtol=0.01)
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
    assert calls[-1] == ("Sobol indices", 4096 * 5, 4096 * 5)


@pytest.mark.parametrize("scale", ["uniform", "log"])
def test_indices_are_those_that_scipy_finds_on_the_same_samples(scale):
    """Saltelli's estimates of SciPy, which draws its samples from the same Sobol sequence."""
    ranges = {"a": (0.5, 2.0), "b": (0.1, 3.0)}
    model = lambda x: x["a"] ** 2 * jnp.stack([x["b"], jnp.exp(-x["b"])])  # noqa: E731
    found = cal.model_indices(model, ranges, samples=512, scale=scale, seed=3, resamples=10)
    spread = stats.uniform if scale == "uniform" else stats.loguniform
    dists = [
        spread(low, high - low) if scale == "uniform" else spread(low, high)
        for low, high in ranges.values()
    ]
    expected = stats.sobol_indices(
        func=lambda x: np.array(model(dict(zip("ab", x, strict=True)))),
        n=512,
        dists=dists,
        rng=np.random.default_rng(3),
    )
    np.testing.assert_allclose(found.first, expected.first_order, rtol=1e-9)
    np.testing.assert_allclose(found.total, expected.total_order, rtol=1e-9)


def test_limits_are_percentiles_of_resampled_indices():
    """By SciPy's bootstrap of its own estimates on the same samples, up to the scatter of 2000."""
    ranges = {"a": (0.5, 2.0), "b": (0.1, 3.0)}
    model = lambda x: x["a"] ** 2 * x["b"]  # noqa: E731
    told = {"samples": 256, "seed": 3, "resamples": 2000}
    found, half = (cal.model_indices(model, ranges, confidence=c, **told) for c in (0.95, 0.5))
    expected = stats.sobol_indices(
        func=lambda x: (x[0] ** 2 * x[1])[None],
        n=256,
        dists=[stats.uniform(low, high - low) for low, high in ranges.values()],
        rng=np.random.default_rng(3),
    ).bootstrap(n_resamples=2000)
    for which, limits in (("first", expected.first_order), ("total", expected.total_order)):
        low, high = limits.confidence_interval
        width = np.max(high - low)
        np.testing.assert_allclose(
            getattr(found, f"{which}_low")[0], np.ravel(low), atol=0.15 * width
        )
        np.testing.assert_allclose(
            getattr(found, f"{which}_high")[0], np.ravel(high), atol=0.15 * width
        )
        wide, narrow = (
            getattr(one, f"{which}_high") - getattr(one, f"{which}_low") for one in (found, half)
        )
        np.testing.assert_allclose(narrow, 0.344 * wide, rtol=0.2)  # of normal quantiles


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


@pytest.mark.long
def test_restitutions_indices_agree_with_a_brute_force_run():
    found = cal.sobol_indices(nylon(), RANGES, [VELOCITY], samples=2048, resamples=50)
    first, total = brute_force()
    np.testing.assert_allclose(found.first[0], first, atol=0.06)
    np.testing.assert_allclose(found.total[0], total, atol=0.06)
    assert np.all(found.total[0] < found.bound[0] + 0.01)
    assert found.names == tuple(RANGES)
    assert found.symbols == ("Y", "χ̃", "σ")
    assert np.max(found.total) > 0.3


def test_a_single_range_explains_everything():
    found = cal.sobol_indices(Decay(0.9, 0.05), {"rate": (0.02, 0.08)}, [5.0], samples=256)
    assert found.first.shape == found.total_high.shape == (1, 1)
    np.testing.assert_allclose([found.first, found.total], 1.0, atol=0.02)


def test_an_output_that_does_not_vary_has_no_indices():
    law = Decay(0.9, 0.05)
    found = cal.sobol_indices(law, {"rate": (0.02, 0.08)}, [0.0, 5.0], samples=256)
    assert np.all(np.isnan(found.first[0]))
    assert found.to_dict()["first"][0] == [None]
    assert found.to_dict()["first"][1] == [pytest.approx(1.0, abs=0.02)]
    assert found.to_dict()["velocity"] == [0.0, 5.0]


def test_where_nothing_rebounds_there_is_nothing_to_share_out():
    with pytest.raises(ValueError, match="0 everywhere") as caught:
        cal.sobol_indices(Decay(0.9, 500.0), {"rate": (400.0, 600.0)}, [5.0], samples=256)
    assert "\n" not in str(caught.value)


def test_samples_without_an_answer_are_no_zeros():
    """A restitution above 1 is no input, whatever is built of it: Poisson's ratio beyond 0.5."""
    law = sj.ConstantRestitution(None, 0.9)
    with pytest.raises(
        ValueError, match=r"restitution in \[0, 1\], but is restitution = 0.8 … 1.2"
    ):
        cal.sobol_indices(law, {"restitution": (0.8, 1.2)}, 1.0)
    with pytest.raises(ValueError, match=r"a ratio in \(-1, 0.5\]"):
        cal.sobol_indices(nylon(), {"poisson_ratio": (0.3, 0.6)}, 1.0)
    # what only the status tells: 1.1 in the middle, 0.6 at both ends
    inside = cal.Inputs({"a": 0.4}, lambda x: sj.ConstantRestitution(None, 1.1 - 2 * x["a"] ** 2))
    with pytest.raises(ValueError, match="every sample has a finite output"):
        cal.sobol_indices(inside, {"a": (-0.5, 0.5)}, 1.0)
    both = cal.Inputs({"a": 0.9, "b": 0.9}, lambda x: sj.ConstantRestitution(None, x["a"] * x["b"]))
    with pytest.raises(ValueError, match="such that there is a law everywhere") as caught:
        cal.sobol_indices(both, {"a": (0.8, 1.2), "b": (0.8, 1.2)}, 1.0)
    assert "\n" not in str(caught.value)
    whole = cal.sobol_indices(both, {"a": (0.8, 1.0), "b": (0.8, 1.0)}, 1.0, samples=256)
    np.testing.assert_allclose(whole.mean, 0.81, rtol=1e-3)
    np.testing.assert_array_equal(whole.zeros, 0.0)


def test_a_model_without_a_value_is_refused():
    model = lambda x: jnp.sqrt(x["a"])  # noqa: E731
    with pytest.raises(ValueError, match=r"finite output, but is such that \d+ of 96 have none"):
        cal.model_indices(model, {"a": (-1.0, 1.0)}, samples=32)
    found = cal.model_indices(model, {"a": (0.5, 1.0)}, samples=32)
    assert found.to_dict()["zeros"] == [0.0]


def test_a_law_that_two_inputs_make_together_is_looked_at_over_their_ranges():
    """Walton and Braun's unloading is the stiffer one; the law's own check sees no traced numbers."""
    law = sj.WaltonBraun(sj.Contact(1.4e9, 0.006, 0.005, 4e7, 320.0), 1e6, 1.2e6)
    ranges = {"loading_stiffness": (0.9e6, 1.1e6), "unloading_stiffness": (1.05e6, 1.3e6)}
    with pytest.raises(ValueError, match="at least `loading_stiffness`"):
        cal.sobol_indices(law, ranges, 1.0)
    ranges["unloading_stiffness"] = (1.1e6, 1.3e6)
    found = cal.sobol_indices(law, ranges, 1.0, samples=64)
    # ε² = k1/k20 with both uniform: E[ε] = E[√k1] E[1/√k20]
    root = lambda a, b, power: (b**power - a**power) / (power * (b - a))  # noqa: E731
    mean = root(0.9, 1.1, 1.5) * root(1.1, 1.3, 0.5)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-3)


# `ru_maxrss` would begin with what the process had that started this one
MEMORY = """
import calibration as cal, softjax as sj
law = sj.Zhou(sj.Contact(1.4e9, 0.00635, 0.0049, 4e7, 320.0), 0.22, 0.44, 0.54)
ranges = {name: (0.9 * x, 1.1 * x) for name, x in cal.of_law(law).values.items()}
found = cal.sobol_indices(law, ranges, [0.5, 2.0, 20.0], samples=1 << 17)
status = open("/proc/self/status").read()
print(int(status.split("VmHWM:")[1].split()[0]) / 2**20)
"""


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="tells the peak of memory")
def test_a_hundred_thousand_samples_stay_within_a_gibibyte():
    run = [sys.executable, "-c", MEMORY]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1.0


@pytest.mark.parametrize(
    ("ranges", "options", "named"),
    [
        ({"colour": (0, 1)}, {}, "ranges"),
        ({"chi": (2.0, 1.0)}, {}, "ranges"),
        ({}, {}, "ranges"),
        ({"chi": (0.0, 1.0)}, {"scale": "log"}, "ranges"),
        ({"chi": (0.1, 1.0)}, {"samples": 1000}, "samples"),
        ({"chi": (0.1, 0.2, 0.3)}, {}, "ranges"),
        ({"chi": (0.1, 1.0)}, {"confidence": 95}, "confidence"),
        ({"chi": (0.1, 1.0)}, {"resamples": 0}, "resamples"),
        ({"chi": (0.1, 1.0)}, {"scale": "cubic"}, "scale"),
        ({"chi": (0.1, 1.0)}, {"seed": -1}, "seed"),
    ],
)
def test_what_makes_no_sense_is_named(ranges, options, named):
    with pytest.raises(ValueError, match=f"`{named}"):
        cal.sobol_indices(nylon(), ranges, [1.0], **options)
