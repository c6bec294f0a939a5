"""Global indices: SciPy's own, and laws in closed form."""

import os
import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.decay import Decay

RATE = {"rate": (0.02, 0.08)}


class Two(sj.HardSphereLaw):
    """ε = a² b/15 of slow impacts and a² e^{-b}/15 of fast ones."""

    a: float
    b: float

    def restitution_squared(self, velocity):
        return (self.a**2 * jnp.where(velocity < 2, self.b, jnp.exp(-self.b)) / 15) ** 2


@pytest.mark.parametrize("scale", ["uniform", "log"])
def test_indices_and_limits_are_those_that_scipy_finds_on_the_same_samples(scale):
    """Saltelli's estimates and their bootstrap, up to the scatter of 2000 resamples."""
    ranges = {"a": (0.5, 2.0), "b": (0.1, 3.0)}
    options, calls = {"samples": 256, "scale": scale, "seed": 3, "resamples": 2000}, []
    options["progress"] = lambda *call: calls.append(call)
    found, half = (
        cal.sobol_indices(Two(1.0, 1.0), ranges, [1.0, 3.0], confidence=c, **options)
        for c in (0.95, 0.5)
    )
    of = {"uniform": lambda a, b: stats.uniform(a, b - a), "log": stats.loguniform}[scale]
    dists = [of(*ends) for ends in ranges.values()]
    expected = stats.sobol_indices(
        func=lambda x: x[0] ** 2 * np.stack([x[1], np.exp(-x[1])]) / 15,
        n=256,
        dists=dists,
        rng=np.random.default_rng(3),
    )
    np.testing.assert_allclose(found.first, expected.first_order, rtol=1e-9)
    np.testing.assert_allclose(found.total, expected.total_order, rtol=1e-9)
    a, b = (one.ppf((np.arange(2000) + 0.5) / 2000) for one in dists)
    mean, square = (
        np.mean(a ** (2 * k)) * np.mean([b**k, np.exp(-k * b)], axis=1) / 15**k for k in (1, 2)
    )
    np.testing.assert_allclose(found.mean, mean, rtol=0.01)
    np.testing.assert_allclose(found.variance, square - mean**2, rtol=0.03)
    assert calls[-1] == ("Sobol indices", 256 * 4, 256 * 4)
    resampled = expected.bootstrap(n_resamples=2000)  # its own limits are corrected for bias
    for which, of in (("first", resampled.first_order), ("total", resampled.total_order)):
        drawn = of.bootstrap_distribution
        ends = np.percentile(drawn, [2.5, 97.5], axis=-1)
        width = np.max(ends[1] - ends[0])
        for end, theirs in zip(("low", "high"), ends, strict=True):
            np.testing.assert_allclose(getattr(found, f"{which}_{end}"), theirs, atol=0.1 * width)
        wide, narrow = (
            getattr(x, f"{which}_high") - getattr(x, f"{which}_low") for x in (found, half)
        )
        np.testing.assert_allclose(narrow, 0.344 * wide, rtol=0.2)  # normal quantiles


def test_an_output_that_does_not_vary_has_no_indices_and_a_single_input_explains_the_rest():
    found = cal.sobol_indices(Decay(0.9, 0.05), RATE, [0.0, 5.0], samples=256)
    assert np.all(np.isnan(found.first[0]))
    np.testing.assert_allclose([found.first[1], found.total[1]], 1.0, atol=0.02)
    table = found.to_dict()
    assert table["first"] == [[None], [pytest.approx(1.0, abs=0.02)]]
    assert table["velocity"] == [0.0, 5.0]
    assert (found.names, found.symbols) == (("rate",), ("b",))


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
    np.testing.assert_array_equal(found.zeros, 0.0)


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="tells the peak of memory")
def test_a_hundred_thousand_samples_stay_within_a_gibibyte():
    run = [sys.executable, "-c", MEMORY]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1.0


# `ru_maxrss` would begin with what the process had that started this one
MEMORY = """
import calibration as cal, softjax as sj
law = sj.Zhou(sj.Contact(1.4e9, 0.00635, 0.0049, 4e7, 320.0), 0.22, 0.44, 0.54)
ranges = {name: (0.9 * x, 1.1 * x) for name, x in cal.of_law(law).values.items()}
found = cal.sobol_indices(law, ranges, [0.5, 2.0, 20.0], samples=1 << 17)
status = open("/proc/self/status").read()
print(int(status.split("VmHWM:")[1].split()[0]) / 2**20)
"""
