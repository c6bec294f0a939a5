"""Local sensitivities against high-precision differences; global indices against SciPy's own."""

import os
import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.cases import FITTED, MATERIALS, RADIUS, column, fitted, law_of, of_form
from tests.decay import Decay
from tests.fit_data import twin
from tests.fit_oracle import thornton

PROPERTIES = {  # the oracle's names
    "youngs_modulus": "E",
    "poisson_ratio": "nu",
    "density": "rho",
    "yield_strength": "Y",
    "radius": "R",
    "chi": "chi",
    "sigma": "sigma",
    "psi": "psi",
    "velocity": "v",
}
LEAVES = {name: PROPERTIES[name] for name in PROPERTIES if name not in ("poisson_ratio", "density")}
LEAVES |= {"mass": "M", "limit_velocity": "v_lim"}
VELOCITY = np.array([0.002, 0.05, 0.7, 2.0])
DIMENSIONS = {  # exponents of kilogram, metre and second: ε is the same in any units
    **{"-": (0, 0, 0), "Pa": (1, -1, -2), "N/m": (1, 0, -2), "kg": (1, 0, 0), "m": (0, 1, 0)},
    **{"1/m": (0, -1, 0), "m/s": (0, 1, -1), "s": (0, 0, 1)},
}


def check_slopes(found, names, expected):
    assert set(found.names) == set(names)
    for ours, theirs in names.items():
        slope = column(expected, "log_sensitivities", theirs, "eps")
        np.testing.assert_allclose(found.of(ours), slope, rtol=0, atol=1e-8)
    assert np.max(np.abs(found.of("chi"))) > 1e-3  # zeros would pass without derivatives


def records(section, name):
    every = of_form(section, "first-order")
    return [record for record in every if record["material"] == name]


def test_properties_of_materials_agree_with_differences_in_40_digits():
    """Through the function that builds the contact of the material."""
    expected = records("materials", "nylon")
    inputs = cal.of_spheres(MATERIALS["nylon"], RADIUS, **FITTED["nylon"])
    found = cal.sensitivity(inputs, column(expected, "inputs", "v"))
    check_slopes(found, PROPERTIES, expected)
    # kg, m and s: three identities between nine sensitivities, and two that follow from them
    names = ("youngs_modulus", "density", "yield_strength", "radius", "velocity")
    E, rho, Y, R, v = (found.of(name) for name in names)
    sums = np.stack([E + Y + rho, R + v - E - Y - 3 * rho, -2 * E - 2 * Y - v], axis=-1)
    np.testing.assert_allclose(sums, 0, atol=1e-13)
    np.testing.assert_allclose(R, 0, atol=1e-13)
    np.testing.assert_allclose(v, 2 * rho, atol=1e-13)
    assert np.max(np.abs(v)) > 1e-3


def test_fields_of_a_law_agree_with_differences_in_40_digits():
    """Stored leaves held independent, v below, near and far above yield."""
    expected = records("curves", "chrome steel")
    found = cal.sensitivity(law_of(expected[0]["inputs"]), column(expected, "inputs", "v"))
    check_slopes(found, LEAVES, expected)


def test_other_laws_depend_on_dimensionless_groups_and_nothing_is_nan_but_the_logarithm_of_zero():
    contact = fitted("nylon").contact
    for law in (sj.WaltonBraun(contact, 3e6, 4e6, 60.0), sj.ViscoelasticHertz(contact, 1e-5)):
        others = cal.sensitivity(law, VELOCITY)  # of kg, N/m, 1/m and s
        powers = [DIMENSIONS[declared.unit] for declared in others.declared.values()]
        np.testing.assert_allclose(others.absolute @ powers, 0, atol=1e-12)
        assert np.all(np.max(np.abs(others.absolute), axis=0)[[-2, -1]] > 1e-3)
    lossy = cal.sensitivity(fitted("stainless steel", chi=1e3, sigma=50.0), [1e-3, 2.0])
    assert lossy.coefficient[1] == 0
    np.testing.assert_array_equal(lossy.absolute[1], 0)
    assert np.all(np.isnan(lossy.logarithmic[1]))
    np.testing.assert_array_equal(lossy.logarithmic[0], lossy.absolute[0] / lossy.coefficient[0])
    none = cal.sensitivity(fitted("stainless steel", sigma=0.0), [1e-3, 2.0])
    np.testing.assert_array_equal(none.of("sigma"), 0)
    assert np.all(np.isfinite(none.absolute))
    ranked = none.ranked(2.1)
    sizes = [abs(value) for _, value in ranked]
    assert sizes == sorted(sizes, reverse=True)
    assert dict(ranked)["chi"] == none.of("chi")[-1]


def test_another_laws_sensitivities_follow_from_its_formula():
    """ε of Thornton's law is one of V_y/v, V_y ∝ p_y^{5/2} ρ^{-1/2}."""
    inputs = cal.of_spheres(sj.NYLON, RADIUS, sj.Thornton, area="hertz", yield_factor=1.6)
    yields = float(inputs.law().elastic_velocity())
    found = cal.sensitivity(inputs, [5.0, 50.0])
    h, v = 1e-5, found.velocity
    high, middle, low = (thornton(v * (1 + k * h), yields) for k in (1, 0, -1))
    in_v = (high - low) / (2 * h)
    np.testing.assert_allclose(found.coefficient, middle, rtol=1e-10)
    powers = {"velocity": 1, "yield_factor": -2.5, "yield_strength": -2.5, "density": 0.5}
    for name, power in (powers | {"radius": 0}).items():
        np.testing.assert_allclose(found.of(name), power * in_v, atol=1e-7, err_msg=name)


class Sized(sj.HardSphereLaw):
    """Two numbers called radius, and some numbers that are whole."""

    contact: sj.Contact
    radius: float
    weights: np.ndarray = sj.array_field()

    def restitution_squared(self, velocity):
        return self.radius**2 * jnp.exp(-velocity * jnp.mean(self.weights))


def test_inputs_of_a_law_are_its_single_numbers_by_names_of_their_own():
    weights = np.array([0.1, 0.2, 0.3])
    inputs = cal.of_law(Sized(fitted("nylon").contact, 0.5, weights))
    assert {"radius", "contact.radius"} <= set(inputs.values)
    assert "weights" not in inputs.values
    assert inputs.values["radius"] == 0.5
    assert inputs.values["contact.radius"] == pytest.approx(RADIUS / 2)
    moved = inputs.law(radius=0.6)
    assert (moved.radius, moved.contact.radius) == (0.6, inputs.values["contact.radius"])
    np.testing.assert_array_equal(moved.weights, weights)
    declared = cal.Inputs({}, lambda values: fitted("nylon")).declared
    names = ("density_2", "poisson_ratio_wall", "chi", "velocity")
    expected = [("ρ 2", "kg/m³"), ("ν wall", "-"), ("χ̃", "-"), ("v", "m/s")]
    assert [declared(name)[:2] for name in names] == expected


def test_of_a_fit_above_yield_the_loss_is_one_input():
    """σ and ψ act through ε_up alone: ε_up ∂ε/∂ε_up = -σ ∂ε/∂σ / (-ln ε_up)."""
    data = twin("nylon", y=np.geomspace(1.3, 80, 20), noise=0.003, seed=1)
    result = cal.fit(data, profiles=False, starts=4)
    v = np.array([5.0, 40.0])
    found, law = cal.sensitivity(result, v, material="nylon"), cal.sensitivity(result.law, v)
    assert {"chi", "eps_up"} <= set(found.names)
    assert not {"sigma", "psi"} & set(found.names)
    assert found.declared["eps_up"].symbol == "ε_up"
    np.testing.assert_allclose(found.coefficient, law.coefficient, rtol=1e-12)
    np.testing.assert_allclose(found.of("chi"), law.of("chi"), rtol=1e-9)
    loss = -np.log(result.values["eps_up"])
    np.testing.assert_allclose(found.of("eps_up"), -law.of("sigma") / loss, rtol=1e-9)


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
