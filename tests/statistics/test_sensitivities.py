"""Local sensitivities against high-precision differences, and what dimensions say of them."""

import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from softjax.fields import array_field  # a field that is whole
from tests.cases import FITTED, FORMS, MATERIALS, RADIUS, column, fitted, law_of, reference
from tests.decay import Decay
from tests.fit_data import twin

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
LEAVES = {
    "youngs_modulus": "E",
    "radius": "R",
    "mass": "M",
    "yield_strength": "Y",
    "limit_velocity": "v_lim",
    "chi": "chi",
    "sigma": "sigma",
    "psi": "psi",
    "velocity": "v",
}
# unlike bodies, the second with the larger yield strength: only one of them yields
UNLIKE = dict(
    zip(
        ("youngs_modulus", "poisson_ratio", "density", "yield_strength"),
        ((1.9e11, 2.1e11), (0.3, -0.2), (7800.0, 8100.0), (3e8, 9e8)),
        strict=True,
    )
)
VELOCITY = np.array([0.002, 0.05, 0.7, 2.0])


def spheres(name: str, form: str = "first-order") -> cal.Inputs:
    return cal.of_spheres(MATERIALS[name], RADIUS, form=form, **FITTED[name])


def records(section: str, name: str, form: str) -> list[dict]:
    every = reference()[section]
    return [r for r in every if (r["material"], r["inputs"]["form"]) == (name, form)]


@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("nylon", "first-order"),
        ("stainless steel", "full"),
        *(
            pytest.param(name, form, marks=pytest.mark.long)
            for name in MATERIALS
            for form in FORMS
            if (name, form) not in (("nylon", "first-order"), ("stainless steel", "full"))
        ),
    ],
)
def test_properties_of_materials_agree_with_differences_in_40_digits(name, form):
    """Through the function that builds the contact of the material."""
    expected = records("materials", name, form)
    found = cal.sensitivity(spheres(name, form), column(expected, "inputs", "v"))
    assert set(found.names) == set(PROPERTIES)
    for ours, theirs in PROPERTIES.items():
        slope = column(expected, "log_sensitivities", theirs, "eps")
        np.testing.assert_allclose(found.of(ours), slope, rtol=0, atol=1e-8)
    # a test of zeros would pass without derivatives
    assert np.max(np.abs(found.of("chi"))) > 1e-3


@pytest.mark.parametrize(
    "name",
    [
        "chrome steel",
        *(pytest.param(n, marks=pytest.mark.long) for n in ("nylon", "stainless steel")),
    ],
)
def test_fields_of_a_law_agree_with_differences_in_40_digits(name):
    """Stored leaves held independent, v below, near and far above yield."""
    expected = records("curves", name, "first-order")
    law = law_of(expected[0]["inputs"])
    found = cal.sensitivity(law, column(expected, "inputs", "v"))
    assert set(found.names) == set(LEAVES)
    for ours, theirs in LEAVES.items():
        slope = column(expected, "log_sensitivities", theirs, "eps")
        np.testing.assert_allclose(found.of(ours), slope, rtol=0, atol=1e-8)


@pytest.mark.long
def test_the_ode_gives_the_same_sensitivities():
    expected = records("materials", "nylon", "first-order")
    v = column(expected, "inputs", "v")
    found = cal.sensitivity(spheres("nylon"), v, sj.ODE(rtol=1e-11))
    for ours, theirs in PROPERTIES.items():
        slope = column(expected, "log_sensitivities", theirs, "eps")
        np.testing.assert_allclose(found.of(ours), slope, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    "name",
    [
        "chrome steel",
        *(pytest.param(n, marks=pytest.mark.long) for n in ("nylon", "stainless steel")),
    ],
)
def test_restitution_of_two_spheres_depends_on_dimensionless_groups_alone(name):
    """kg, m and s: three identities between nine sensitivities, and two that follow from them."""
    found = cal.sensitivity(spheres(name), VELOCITY)
    E, rho, Y, R, v = (
        found.of(n) for n in ("youngs_modulus", "density", "yield_strength", "radius", "velocity")
    )
    sums = np.stack([E + Y + rho, R + v - E - Y - 3 * rho, -2 * E - 2 * Y - v], axis=-1)
    np.testing.assert_allclose(sums, 0, atol=1e-13)
    np.testing.assert_allclose(found.dimensional_sums(), sums, atol=1e-15)
    np.testing.assert_allclose(R, 0, atol=1e-13)
    np.testing.assert_allclose(v, 2 * rho, atol=1e-13)
    assert np.max(np.abs(v)) > 1e-3


def test_modulus_and_poissons_ratio_act_through_one_number():
    """E/(1 - ν²) of like bodies: S_ν = 2ν²/(1 - ν²) S_E."""
    found = cal.sensitivity(spheres("nylon"), VELOCITY)
    nu = MATERIALS["nylon"].poisson_ratio
    expected = 2 * nu**2 / (1 - nu**2) * found.of("youngs_modulus")
    np.testing.assert_allclose(found.of("poisson_ratio"), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("kind", "bodies", "radii"),
    [
        ("unlike spheres", ("_1", "_2"), {"radius_1": 0.01, "radius_2": 0.03}),
        pytest.param("wall", ("", "_wall"), {"radius": 0.01}, marks=pytest.mark.long),
    ],
)
def test_identities_hold_for_unlike_bodies_and_a_wall(kind, bodies, radii):
    properties = {
        name + body: value
        for name, values in UNLIKE.items()
        for body, value in zip(bodies, values, strict=True)
    }

    def build(values):
        one, two = (sj.Material(*(values[name + body] for name in UNLIKE)) for body in bodies)
        sizes = [values[name] for name in radii]
        join = sj.Contact.with_wall if len(sizes) == 1 else sj.Contact.between_spheres
        contact = join(one, two, *sizes, area="zhou")
        return sj.Zhou(contact, values["chi"], values["sigma"], values["psi"])

    told = properties | radii | {"chi": 0.5, "sigma": 0.4, "psi": 0.5}
    found = cal.sensitivity(cal.Inputs(told, build), VELOCITY)
    np.testing.assert_allclose(found.dimensional_sums(), 0, atol=1e-13)
    # the stronger body's yield strength plays no part, its modulus does
    np.testing.assert_array_equal(found.of("yield_strength" + bodies[1]), 0)
    assert np.max(np.abs(found.of("youngs_modulus" + bodies[1]))) > 1e-4
    if bodies[1] == "_2":
        scaled = found.of("radius_1") + found.of("radius_2")
        np.testing.assert_allclose(scaled, 0, atol=1e-13)


def test_logarithmic_sensitivity_is_undefined_without_rebound():
    law = fitted("stainless steel", chi=1e3, sigma=50.0)
    found = cal.sensitivity(law, [1e-3, 2.0])
    assert found.coefficient[1] == 0
    np.testing.assert_array_equal(found.absolute[1], 0)
    assert np.all(np.isnan(found.logarithmic[1]))
    expected = found.absolute[0] / found.coefficient[0]
    np.testing.assert_array_equal(found.logarithmic[0], expected)


def test_an_input_of_zero_moves_nothing_and_gives_no_nan():
    found = cal.sensitivity(fitted("nylon", sigma=0.0), [0.5, 5.0])
    np.testing.assert_array_equal(found.of("sigma"), 0)
    assert np.all(np.isfinite(found.absolute))


def test_ranking_names_the_strongest_first():
    found = cal.sensitivity(spheres("nylon"), VELOCITY)
    ranked = found.ranked(2.1)
    sizes = [abs(value) for _, value in ranked]
    assert sizes == sorted(sizes, reverse=True)
    assert dict(ranked)["chi"] == found.of("chi")[-1]


def test_symbols_and_units_are_those_that_the_fields_declare():
    inputs = cal.Inputs({}, lambda values: fitted("nylon"))
    assert inputs.declared("density_2")[:2] == ("ρ 2", "kg/m³")
    assert inputs.declared("poisson_ratio_wall")[:2] == ("μ wall", "-")
    assert inputs.declared("chi")[:2] == ("χ̃", "-")
    assert inputs.declared("velocity")[:2] == ("v", "m/s")


def test_another_laws_sensitivities_follow_from_its_closed_form():
    """Thornton: ε = √(6√3/5) √(1 - r²/6) [r/(r + 2 √(6/5 - r²/5))]^{1/4}, r = V_y/v.

    So ε depends on v/V_y alone, and V_y ∝ p_y^{5/2} E*^{-2} ρ^{-1/2}.
    """
    nylon = MATERIALS["nylon"]
    inputs = cal.of_spheres(nylon, RADIUS, sj.Thornton, area="hertz", yield_factor=1.6)
    yields = float(inputs.law().elastic_velocity())
    found = cal.sensitivity(inputs, [5.0, 50.0])

    def restitution(v):
        r = yields / v
        inner = r / (r + 2 * np.sqrt(1.2 - 0.2 * r**2))
        return np.sqrt(6 * np.sqrt(3) / 5) * np.sqrt(1 - r**2 / 6) * inner**0.25

    h = 1e-5
    v = found.velocity
    in_v = (restitution(v * (1 + h)) - restitution(v * (1 - h))) / (2 * h)
    np.testing.assert_allclose(found.coefficient, restitution(v), rtol=1e-10)
    np.testing.assert_allclose(found.of("velocity"), in_v, atol=1e-8)
    np.testing.assert_allclose(found.of("yield_factor"), -2.5 * in_v, atol=1e-7)
    np.testing.assert_allclose(found.of("yield_strength"), -2.5 * in_v, atol=1e-7)
    np.testing.assert_allclose(found.of("density"), 0.5 * in_v, atol=1e-7)
    np.testing.assert_allclose(found.of("radius"), 0, atol=1e-12)
    np.testing.assert_allclose(found.dimensional_sums(), 0, atol=1e-12)


class Table(sj.HardSphereLaw):
    """One number, and some that are whole."""

    level: float
    weights: np.ndarray = array_field()

    def restitution_squared(self, velocity):
        return self.level**2 * jnp.exp(-velocity * jnp.mean(self.weights))


def test_what_is_whole_is_held_and_no_input():
    inputs = cal.of_law(Table(0.9, np.array([0.1, 0.2, 0.3])))
    assert dict(inputs.values) == {"level": 0.9}
    moved = inputs.build({"level": 0.5})
    assert moved.level == 0.5
    np.testing.assert_array_equal(moved.weights, [0.1, 0.2, 0.3])


def test_names_that_two_of_a_laws_parts_share_are_told_apart():
    class Sized(sj.HardSphereLaw):
        contact: sj.Contact
        radius: float

        def restitution_squared(self, velocity):
            return self.radius * jnp.exp(-velocity)

    names = cal.of_law(Sized(fitted("nylon").contact, 0.5)).values
    assert {"radius", "contact.radius"} <= set(names)
    assert names["radius"] == 0.5
    assert names["contact.radius"] == pytest.approx(RADIUS / 2)


def test_an_unknown_unit_is_named():
    class Far(Decay):
        rate: float = sj.number_field("b", "1/mile", "rate", within="(0, inf)", default=0.1)

    with pytest.raises(ValueError, match="unit of"):
        cal.sensitivity(Far(0.9), 2.0).dimensional_sums()


def test_a_fits_inputs_are_those_of_its_law():
    v = np.linspace(1.0, 9.0, 9)
    data = cal.RestitutionData(v, 0.9 * np.exp(-0.05 * v), name="balls")
    result = cal.fit(data, Decay, profiles=False)
    found = cal.sensitivity(result, [2.0], material="balls")
    np.testing.assert_allclose(found.of("rate"), -0.1 * 0.9 * np.exp(-0.1), rtol=1e-6)


def test_of_a_fit_above_yield_the_loss_is_one_input():
    """σ and ψ act through ε_up alone: ε_up ∂ε/∂ε_up = -σ ∂ε/∂σ / (-ln ε_up)."""
    data = twin("nylon", y=np.geomspace(1.3, 80, 20), noise=0.003, seed=1)
    result = cal.fit(data, profiles=False)
    v = np.array([5.0, 40.0])
    found, law = cal.sensitivity(result, v), cal.sensitivity(result.law, v)
    assert {"chi", "eps_up"} <= set(found.names)
    assert not {"sigma", "psi"} & set(found.names)
    assert found.declared["eps_up"].symbol == "ε_up"
    np.testing.assert_allclose(found.coefficient, law.coefficient, rtol=1e-12)
    np.testing.assert_allclose(found.of("chi"), law.of("chi"), rtol=1e-9)
    loss = -np.log(result.values["eps_up"])
    np.testing.assert_allclose(found.of("eps_up"), -law.of("sigma") / loss, rtol=1e-9)


@pytest.mark.parametrize(
    ("inputs", "velocity", "named"),
    [
        ("steel", 1.0, "inputs"),
        (fitted("nylon", chi=np.array([1.0, 2.0])), 1.0, "chi"),
        (fitted("nylon"), -1.0, "velocity"),
        (fitted("nylon"), np.nan, "velocity"),
    ],
)
def test_what_makes_no_sense_is_named(inputs, velocity, named):
    with pytest.raises(ValueError, match=f"`{named}`"):
        cal.sensitivity(inputs, velocity)
