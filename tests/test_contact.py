"""Two bodies reduced to one: effective quantities, the scales of first yield, Table 1."""

import numpy as np
import pytest

import softjax as sj
from tests.cases import MATERIALS, pair
from tests.oracles import zhou_mp

LEAVES = ("youngs_modulus", "radius", "mass", "yield_strength", "limit_velocity")
SOFT = sj.Material(2.5e9, 0.30, 1140.0, 4.0e7)
HARD = sj.Material(2.03e11, 0.28, 7830.0, 2.03e9)
SYMBOLS = {
    "youngs_modulus": "E",
    "radius": "R",
    "mass": "M",
    "yield_strength": "Y",
    "limit_velocity": "v_lim",
    "stiffness": "k",
    "critical_overlap": "delta_cr",
    "critical_velocity": "v_cr",
}


def numbers(material):
    return (
        material.youngs_modulus,
        material.poisson_ratio,
        material.density,
        material.yield_strength,
    )


# Table 1 as printed; chrome's v_cr is printed as 0.9090, its own equations give 0.9096
@pytest.mark.parametrize(
    ("name", "critical", "limit"),
    [("stainless steel", 0.0082, 340), ("chrome steel", 0.9096, 882), ("nylon", 0.8352, 324)],
)
def test_table_1(name, critical, limit):
    contact = pair(name)
    assert contact.critical_velocity == pytest.approx(critical, abs=5e-5)
    assert contact.limit_velocity == pytest.approx(limit, abs=0.5)


@pytest.mark.parametrize("area", ["zhou", "hertz"])
@pytest.mark.parametrize("bodies", [(SOFT, HARD), (HARD, SOFT), (HARD, HARD)])
@pytest.mark.parametrize("radius_2", [0.02, None])
def test_against_high_precision(bodies, radius_2, area):
    one, two = bodies
    if radius_2 is None:
        contact = sj.Contact.with_wall(one, wall=two, radius=0.0127, area=area)
    else:
        contact = sj.Contact.between_spheres(one, two, 0.0127, radius_2, area=area)
    expected = zhou_mp.contact(*numbers(one), 0.0127, *numbers(two), radius_2, area=area)
    for name, symbol in SYMBOLS.items():
        assert getattr(contact, name) == pytest.approx(float(expected[symbol]), rel=1e-14), name
    ratio = float(expected["E"]) / float(expected["Y"])
    assert contact.yield_ratio == pytest.approx(ratio, rel=1e-14)


def test_swapping_the_bodies_changes_nothing():
    one = sj.Contact.between_spheres(SOFT, HARD, 0.003, 0.02)
    other = sj.Contact.between_spheres(HARD, SOFT, 0.02, 0.003)
    for name in LEAVES:
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-15), name


def test_wall_is_the_limit_of_a_large_second_sphere():
    wall = sj.Contact.with_wall(SOFT, wall=HARD, radius=0.003)
    for factor in (1e3, 1e6, 1e9):
        sphere = sj.Contact.between_spheres(SOFT, HARD, 0.003, 0.003 * factor)
        for name in (*LEAVES, "critical_overlap", "critical_velocity"):
            assert getattr(sphere, name) == pytest.approx(getattr(wall, name), rel=2 / factor), name
            # the radius is the slowest to get there, and it has not arrived at once
        assert sphere.radius != wall.radius or factor == 1e9


def test_the_body_that_yields_sets_the_limit_velocity():
    weak = sj.Contact.between_spheres(SOFT, HARD, 0.01, 0.01)
    assert weak.yield_strength == SOFT.yield_strength
    assert weak.limit_velocity == pytest.approx((3 * 4.0e7 / 1140.0) ** 0.5, rel=1e-15)
    dense = sj.Material(2.5e9, 0.30, 2000.0, 4.0e7)  # equal strength: the denser one
    for bodies in ((SOFT, dense), (dense, SOFT)):
        contact = sj.Contact.between_spheres(*bodies, 0.01, 0.01)
        assert contact.limit_velocity == pytest.approx((3 * 4.0e7 / 2000.0) ** 0.5, rel=1e-15)


def test_radius_cancels_from_the_critical_velocity_of_equal_spheres():
    speeds = [
        sj.Contact.between_spheres(HARD, HARD, radius, radius).critical_velocity
        for radius in (1e-9, 1e-3, 1e3)
    ]
    assert np.allclose(speeds, speeds[1], rtol=1e-13, atol=0)


@pytest.mark.parametrize("name", MATERIALS)
def test_areas_differ_as_the_papers_b_from_hertz(name):
    """δ_cr goes with A², v_cr with A^{5/2}: π^{4/3} and π^{5/3} between the two."""
    zhou, hertz = pair(name, "zhou"), pair(name, "hertz")
    overlap = zhou.critical_overlap / hertz.critical_overlap
    velocity = zhou.critical_velocity / hertz.critical_velocity
    assert overlap == pytest.approx(np.pi ** (4 / 3), rel=1e-14)
    assert velocity == pytest.approx(np.pi ** (5 / 3), rel=1e-14)


def test_fields_may_be_arrays():
    radii = np.array([0.001, 0.002, 0.005])
    many = sj.Contact.between_spheres(SOFT, HARD, radii, 0.01)
    for i, radius in enumerate(radii):
        one = sj.Contact.between_spheres(SOFT, HARD, float(radius), 0.01)
        assert many.mass[i] == pytest.approx(one.mass, rel=1e-15)
        assert many.critical_velocity[i] == pytest.approx(one.critical_velocity, rel=1e-14)


def test_no_intermediate_leaves_float32():
    """From 1 nm to 1 km spheres every scale is a finite positive float32."""
    for radius in (1e-9, 1e3):
        contact = sj.Contact.between_spheres(HARD, SOFT, np.float32(radius), np.float32(radius))
        leaves = [np.asarray(getattr(contact, name), np.float32) for name in LEAVES]
        short = sj.Contact(*leaves)
        exact = sj.Contact.between_spheres(HARD, SOFT, radius, radius)
        for name in ("critical_overlap", "critical_velocity", "stiffness"):
            value = getattr(short, name)
            assert value.dtype == np.float32
            assert value == pytest.approx(getattr(exact, name), rel=2e-6), name


@pytest.mark.parametrize("radius", [1e103, 1e-120])
def test_radii_whose_masses_are_no_numbers(radius):
    with pytest.raises(ValueError, match="`radius_2` must be a length in m of a sphere whose mass"):
        sj.Contact.between_spheres(SOFT, HARD, 0.01, radius)
    with pytest.raises(ValueError, match="`radius` must be a length in m of a sphere whose mass"):
        sj.Contact.with_wall(SOFT, HARD, radius)
