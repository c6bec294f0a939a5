"""Local sensitivities against high-precision differences."""

import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import FITTED, MATERIALS, RADIUS, column, fitted, law_of, of_form
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
PAIR = ("youngs_modulus", "yield_strength", "radius", "mass", "limit_velocity")
LEAVES = {"contact." * (name in PAIR) + name: letter for name, letter in LEAVES.items()}
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
    names = (
        "density",
        "wall.poisson_ratio",
        "second.density",
        "radius_2",
        "contact.mass",
        "chi",
        "velocity",
    )
    expected = [
        *(("ρ", "kg/m³"), ("ν wall", "-"), ("ρ second", "kg/m³"), ("R 2", "m"), ("M", "kg")),
        *(("χ̃", "-"), ("v", "m/s")),
    ]
    assert [declared(name)[:2] for name in names] == expected


def test_names_are_those_of_a_budget_and_others_are_refused():
    """A misspelt name would move nothing, and names of former releases had endings."""
    inputs = cal.of_spheres(sj.NYLON, RADIUS, **FITTED["nylon"])
    assert inputs.law(density=900.0).contact.mass < inputs.law().contact.mass
    for name in ("density_wall", "wall.density", "contact.mass"):
        with pytest.raises(ValueError, match=rf"one of youngs_modulus, .*psi.* '{name}'"):
            inputs.law(**{name: 900.0})
        with pytest.raises(ValueError, match="one of youngs_modulus"):
            inputs[name]
    of_law = cal.of_law(fitted("nylon"))
    with pytest.raises(ValueError, match=r"did you mean 'contact\.youngs_modulus'"):
        of_law.law(youngs_modulus=1e9)
    with pytest.raises(ValueError, match=r"one of youngs_modulus.*'density_2'"):
        inputs.build({**inputs.values, "density_2": 900.0})
    with pytest.raises(ValueError, match=r"all of youngs_modulus.*without 'density'"):
        inputs.build({name: x for name, x in inputs.values.items() if name != "density"})


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
