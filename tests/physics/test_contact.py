"""Two bodies reduced to one: effective quantities, first yield, and Table 1."""

import math

import jax
import pytest

import softjax as sj
from calibration import paper
from tests.cases import FITTED, MATERIALS, pair
from tests.oracles import zhou_mp

LEAVES = ("youngs_modulus", "radius", "mass", "yield_strength", "limit_velocity")
SOFT, HARD = sj.Material(2.5e9, 0.30, 1140.0, 4.0e7), sj.Material(2.03e11, 0.28, 7830.0, 2.03e9)
DENSE = sj.Material(2.5e9, 0.30, 2000.0, 4.0e7)  # as strong as the soft one, and slower
SYMBOLS = dict(zip(LEAVES, ("E", "R", "M", "Y", "v_lim"), strict=True))
SYMBOLS |= {"stiffness": "k", "critical_overlap": "delta_cr", "critical_velocity": "v_cr"}
ENTRIES = {entry.name: entry for entry in paper.TABLE_1}
# Table 1: E [Pa], Poisson's ratio, density [kg/m³], yield strength [Pa]; v_cr, v_lim [m/s], σ, ψ,
# E/Y, χ̃, radii [m] as printed
TABLE_1 = {
    "stainless steel": (
        (1.93e11, 0.35, 8030.0, 3.10e8),
        (0.0082, 340, 3.0432, 0.5400, 354.75, 0.1368, 0.0127),
    ),
    "chrome steel": (
        (2.03e11, 0.28, 7830.0, 2.03e9),
        (0.9090, 882, 0.1418, 0.3114, 54.25, 0.0239, 0.0127),
    ),
    "nylon": (
        (2.5e9, 0.30, 1140.0, 4.0e7),
        (0.8352, 324, 0.4355, 0.5414, 34.34, 0.0160, 0.00635, 0.0127, 0.0254),
    ),
}


@pytest.mark.parametrize("name", TABLE_1)
def test_table_1_and_what_the_library_makes_of_it(name):
    """Chrome's v_cr is printed as 0.9090, its own equations give 0.9096; Eq. (18) all χ̃ but nylon's."""
    properties, printed = TABLE_1[name]
    entry, contact = ENTRIES[name], pair(name)
    assert tuple(jax.tree.leaves(MATERIALS[name])) == properties
    found = (entry.critical_velocity, entry.limit_velocity, entry.sigma, entry.psi)
    assert (*found, entry.yield_ratio, entry.chi, *entry.radii) == printed
    assert (entry.sigma, entry.psi) == (FITTED[name]["sigma"], FITTED[name]["psi"])
    critical = 0.9096 if name == "chrome steel" else printed[0]
    assert contact.critical_velocity == pytest.approx(critical, abs=5e-5)
    assert contact.limit_velocity == pytest.approx(printed[1], abs=0.5)
    assert contact.yield_ratio == pytest.approx(printed[4], abs=0.01)
    c1, c2 = paper.UNLOADING_LINE
    off = c1 + c2 * entry.yield_ratio - entry.chi
    assert (abs(off) < 5e-5) == (name != "nylon")


@pytest.mark.parametrize("name", TABLE_1)
def test_kappa(name):
    """36 (π/2)^{8/3} (Y/E)² as printed, (9/16) π^{8/3} (Y/E)² as the forces have it; by Hertz's area 5.55."""
    power = math.pi ** (8 / 3)
    factors = {"printed": 36 * power / 2 ** (8 / 3), "consistent": 9 / 16 * power}
    contact = pair(name)
    for kappa, factor in factors.items():
        law = sj.Zhou(contact, 0.1, 0.1, 0.5, kappa=kappa)
        assert 1.5 * law.plasticity() * contact.yield_ratio**2 == pytest.approx(factor, rel=1e-8)
    hertz = sj.Zhou(pair(name, "hertz"), 0.1, 0.1, 0.5)
    of_hertz = 1.5 * hertz.plasticity() * contact.yield_ratio**2
    assert of_hertz == pytest.approx(9 / 16 * math.pi**2, rel=1e-8)


@pytest.mark.parametrize("area", ["zhou", "hertz"])
@pytest.mark.parametrize("bodies", [(SOFT, HARD), (HARD, SOFT), (SOFT, DENSE), (DENSE, SOFT)])
@pytest.mark.parametrize("radius_2", [0.02, None])
def test_against_high_precision(bodies, radius_2, area):
    """Spheres, and a sphere on a wall; of equal strength the denser body sets v_lim."""
    one, two = bodies
    if radius_2 is None:
        contact = sj.Contact.with_wall(one, wall=two, radius=0.0127, area=area)
    else:
        contact = sj.Contact.between_spheres(one, two, 0.0127, radius_2, area=area)
    leaves = [jax.tree.leaves(body) for body in bodies]
    expected = zhou_mp.contact(*leaves[0], 0.0127, *leaves[1], radius_2, area=area)
    for name, symbol in SYMBOLS.items():
        assert getattr(contact, name) == pytest.approx(float(expected[symbol]), rel=1e-14), name
    ratio = float(expected["E"]) / float(expected["Y"])
    assert contact.yield_ratio == pytest.approx(ratio, rel=1e-14)
    assert list(contact.leaves()) == list(LEAVES)
