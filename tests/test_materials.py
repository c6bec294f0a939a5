"""Materials: the published three, and that they are trees of numbers."""

import jax
import numpy as np
import pytest

import softjax as sj

# Table 1: E [Pa], Poisson's ratio, density [kg/m³], yield strength [Pa]
TABLE_1 = {
    "STAINLESS_STEEL": (1.93e11, 0.35, 8030.0, 3.10e8),
    "CHROME_STEEL": (2.03e11, 0.28, 7830.0, 2.03e9),
    "NYLON": (2.5e9, 0.30, 1140.0, 4.0e7),
}


@pytest.mark.parametrize("name", TABLE_1)
def test_table_1(name):
    assert tuple(jax.tree.leaves(getattr(sj, name))) == TABLE_1[name]


def test_a_material_is_a_tree_of_its_four_properties():
    assert len(jax.tree.leaves(sj.NYLON)) == 4
    doubled = jax.tree.map(lambda leaf: 2 * leaf, sj.NYLON)
    assert doubled.density == 2 * sj.NYLON.density


def test_what_is_given_is_stored():
    material = sj.Material(2, [0.1, 0.2], np.float32(3), (4, 5))
    assert material.youngs_modulus == 2.0
    assert isinstance(material.youngs_modulus, float)
    assert np.array_equal(material.poisson_ratio, [0.1, 0.2])
    assert material.density == 3.0
    assert np.array_equal(material.yield_strength, [4.0, 5.0])
    assert material.yield_strength.dtype.kind == "f"
