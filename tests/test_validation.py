"""Input that makes no sense: a ValueError that names the argument, its value, what is accepted."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import RADIUS, fitted, pair

STEEL = {"youngs_modulus": 1.93e11, "poisson_ratio": 0.35, "density": 8030.0, "yield_strength": 3e8}
LEAVES = {"youngs_modulus": 1e11, "radius": 0.01, "mass": 0.03, "yield_strength": 3e8}
LEAVES |= {"limit_velocity": 340.0}
NUMBERS = {"chi": 1.8, "sigma": 3.0, "psi": 0.5}

TWO, THREE = np.ones(2), np.ones(3)
RAGGED = [[1.0], [1.0, 2.0]]
NO_NUMBERS = [math.nan, math.inf, -math.inf, "1.0", None, {}, 1 + 2j, True, object, RAGGED]
NO_NUMBERS += [np.array(["a"]), jnp.array([1.0, jnp.nan])]
NOT_POSITIVE = [*NO_NUMBERS, 0, 0.0, -1.0, -1e-300, np.array([1.0, -1.0])]


def material(**changed):
    return sj.Material(**(STEEL | changed))


def contact(**changed):
    return sj.Contact(**(LEAVES | changed))


def zhou(**changed):
    return sj.Zhou(pair("nylon"), **(NUMBERS | changed))


def spheres(**changed):
    given = {"material_1": material(), "material_2": material()}
    given |= {"radius_1": RADIUS, "radius_2": RADIUS}
    return sj.Contact.between_spheres(**(given | changed))


def wall(**changed):
    given = {"material": material(), "wall": material(), "radius": RADIUS}
    return sj.Contact.with_wall(**(given | changed))


def restitution(**changed):
    return sj.restitution(**({"law": fitted("nylon"), "velocity": 1.0} | changed))


def shown(value):
    """How a message shows a value: on one line, cut to 80 characters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77]


def refuses(build, name, value, accepted):
    with pytest.raises(ValueError, match=f"`{name}`") as caught:
        build(**{name: value})
    message = str(caught.value)
    assert shown(value) in message
    assert accepted in message
    assert "\n" not in message


POSITIVE = [
    (material, "youngs_modulus", "a positive modulus in Pa"),
    (material, "density", "a positive density in kg/m³"),
    (material, "yield_strength", "a positive strength in Pa"),
    (contact, "youngs_modulus", "a positive modulus in Pa"),
    (contact, "radius", "a positive length in m"),
    (contact, "mass", "a positive mass in kg"),
    (contact, "yield_strength", "a positive strength in Pa"),
    (contact, "limit_velocity", "a positive velocity in m/s"),
    (spheres, "radius_1", "a positive length in m"),
    (spheres, "radius_2", "a positive length in m"),
    (wall, "radius", "a positive length in m"),
    (zhou, "psi", "a positive exponent"),
]


@pytest.mark.parametrize("value", NOT_POSITIVE, ids=repr)
@pytest.mark.parametrize(("build", "name", "accepted"), POSITIVE)
def test_what_must_be_positive(build, name, accepted, value):
    refuses(build, name, value, accepted)


NOT_NEGATIVE = [
    (zhou, "chi", "zero or more"),
    (zhou, "sigma", "zero or more"),
    (restitution, "velocity", "a finite impact velocity in m/s, zero or more"),
]


@pytest.mark.parametrize("value", [*NO_NUMBERS, -1.0, -1e-300, np.array([1.0, -1.0])], ids=repr)
@pytest.mark.parametrize(("build", "name", "accepted"), NOT_NEGATIVE)
def test_what_must_not_be_negative(build, name, accepted, value):
    refuses(build, name, value, accepted)


def test_zero_where_it_is_allowed():
    law = zhou(chi=0, sigma=0)
    result = sj.restitution(law, 0)
    assert result.coefficient == 1
    assert sj.restitution(law, 3.0).status & sj.Status.NO_RESIDUAL_OVERLAP


@pytest.mark.parametrize(
    "value", [*NO_NUMBERS, -1.0, -1.5, 0.500001, np.array([0.3, 0.6])], ids=repr
)
def test_poisson_ratio(value):
    refuses(material, "poisson_ratio", value, "a ratio in (-1, 0.5]")


@pytest.mark.parametrize("value", [0.5, 0.0, -0.99])
def test_poisson_ratios_that_are_possible(value):
    assert material(poisson_ratio=value).poisson_ratio == value


CHOICES = [
    (zhou, "form", "'first-order' or 'full'"),
    (zhou, "kappa", "'consistent' or 'printed'"),
    (contact, "area", "'zhou' or 'hertz'"),
    (spheres, "area", "'zhou' or 'hertz'"),
    (wall, "area", "'zhou' or 'hertz'"),
    (sj.ODE, "solver", "'dopri8' or 'dopri5' or 'tsit5' or 'bosh3'"),
]


@pytest.mark.parametrize("value", ["First-order", "", None, 1, ["full"]], ids=repr)
@pytest.mark.parametrize(("build", "name", "accepted"), CHOICES)
def test_choices(build, name, accepted, value):
    refuses(build, name, value, accepted)


OBJECTS = [
    (spheres, "material_1", "a Material"),
    (spheres, "material_2", "a Material"),
    (wall, "material", "a Material"),
    (wall, "wall", "a Material"),
    (restitution, "law", "a contact law"),
    (restitution, "route", "EnergyBalance(), ClosedForm() or ODE(...)"),
]


@pytest.mark.parametrize("value", ["steel", 1.0, sj.ODE, np.array([1.0, 2.0])], ids=repr)
@pytest.mark.parametrize(("build", "name", "accepted"), OBJECTS)
def test_objects(build, name, accepted, value):
    refuses(build, name, value, accepted)


def test_contact_of_a_law():
    with pytest.raises(ValueError, match=r"`contact` must be a Contact, but is 0\.01"):
        sj.Zhou(0.01, **NUMBERS)


ROUTE_VALUES = [
    ("rtol", [0.0, -1e-6, 1.0, 1e-15, math.nan, "1e-6", [1e-6]], "a number in [1e-14, 0.1]"),
    ("steps", [0, -1, 2.0, "2", True], "a whole number >= 1"),
    ("max_steps", [0, -1, 2.5, None, "2", True], "a whole number >= 1"),
]


@pytest.mark.parametrize(
    ("name", "value", "accepted"),
    [(name, value, accepted) for name, values, accepted in ROUTE_VALUES for value in values],
)
def test_numbers_of_a_route(name, value, accepted):
    refuses(sj.ODE, name, value, accepted)


def test_an_option_that_would_be_ignored_is_refused():
    with pytest.raises(ValueError, match="`rtol` would be ignored"):
        sj.ODE(rtol=1e-6, steps=2)


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: material(density=TWO, yield_strength=THREE), "yield_strength"),
        (lambda: contact(radius=TWO, mass=THREE), "`radius` (2,), `mass` (3,)"),
        (lambda: spheres(radius_1=TWO, radius_2=THREE), "`radius_1` (2,), `radius_2` (3,)"),
        (lambda: spheres(material_2=material(density=TWO), radius_2=THREE), "`radius_2` (3,)"),
        (lambda: wall(material=material(density=TWO), radius=THREE), "`material.density` (2,)"),
        (lambda: zhou(chi=TWO, sigma=THREE), "`chi` (2,), `sigma` (3,)"),
        (
            lambda: sj.restitution(zhou(chi=TWO), THREE),
            "`velocity` (3,), `chi` (2,)",
        ),
    ],
)
def test_shapes_that_do_not_fit(build, named):
    with pytest.raises(ValueError, match="broadcast") as caught:
        build()
    assert named in str(caught.value)


def test_tracing_asks_no_questions():
    """Under `jit` values cannot be looked at: the status says what the message would have."""

    @jax.jit
    def status(chi, velocity):
        return sj.restitution(zhou(chi=chi), velocity).status

    assert status(-1.0, 1.0) == sj.Status.INVALID_INPUT
    assert status(0.2, -1.0) == sj.Status.INVALID_INPUT
    assert status(0.2, 10.0) != sj.Status.INVALID_INPUT


def test_a_choice_is_checked_under_jit_too():
    with pytest.raises(ValueError, match="`form`"):
        jax.jit(lambda chi: zhou(chi=chi, form="both").chi)(0.2)
