"""Arrays with more than numbers in them: masks are missing entries, units are converted or refused."""

import numpy as np
import pint
import pytest

import calibration as cal
import softjax as sj

UNITS = pint.UnitRegistry()
VELOCITY = np.array([1.0, 1.5, 2.0, 2.5, 3.0])
MASKED = np.ma.array([0.84, 0.835, 0.0, 0.837, 0.826], mask=[0, 0, 1, 0, 0])
SPHERES = sj.ConstantRestitution(None, 0.9)


class Quantity(np.ndarray):
    """As astropy's: `.unit`, whose powers have no sign between, and `.value`; masked ones have `_mask`."""

    def __new__(cls, numbers, unit, mask=None):
        made = np.asarray(numbers, float).view(cls)
        made.unit, made.value = unit, np.asarray(numbers, float).view(Bare)
        if mask is not None:
            made.value._mask = np.array(mask)
        return made


class Bare(np.ndarray):
    pass


def test_masked_entries_are_left_out_of_every_column():
    data = cal.RestitutionData(VELOCITY, MASKED, group=list("aabbb"), uncertainty=0.01 * VELOCITY)
    assert data.restitution.tolist() == [0.84, 0.835, 0.837, 0.826]
    assert data.velocity.tolist() == [1.0, 1.5, 2.5, 3.0]
    assert data.group.tolist() == ["a", "a", "b", "b"]
    assert data.uncertainty.tolist() == [0.01, 0.015, 0.025, 0.03]
    result = cal.fit(cal.RestitutionData(VELOCITY, MASKED), "constant", profiles=False)
    assert result.values["restitution"] == pytest.approx(np.mean([0.84, 0.835, 0.837, 0.826]))
    table = {"velocity": np.ma.array(VELOCITY), "restitution": MASKED}
    assert len(cal.RestitutionData.from_table(table)) == 4


def test_units_are_converted_or_refused():
    data = cal.RestitutionData(
        VELOCITY * 100 * UNITS("cm/s"),
        85 * np.ones(5) * UNITS.percent,
        contact_time=VELOCITY * UNITS.ms,
    )
    np.testing.assert_allclose(data.velocity, VELOCITY, rtol=1e-15)
    np.testing.assert_allclose(data.restitution, 0.85, rtol=1e-15)
    np.testing.assert_allclose(data.contact_time, 1e-3 * VELOCITY, rtol=1e-15)
    with pytest.raises(ValueError, match=r"`velocity` must be .*kilogram"):
        cal.RestitutionData(VELOCITY * UNITS.kg, 0.9 * np.ones(5))
    hit = sj.restitution(SPHERES, 100 * UNITS("cm/s"))
    assert hit.velocity == 1.0
    steel = sj.Material(193 * UNITS.GPa, 0.3, 8.03 * UNITS("g/cm^3"), 310 * UNITS.MPa)
    np.testing.assert_allclose([steel.youngs_modulus, steel.density], [1.93e11, 8030], rtol=1e-15)
    for wrong in (1.0 * UNITS.kg, MASKED):
        with pytest.raises(ValueError, match="`velocity` must be a finite impact velocity"):
            sj.restitution(SPHERES, wrong)


def test_quantities_whose_unit_is_an_attribute_of_that_name_are_converted_or_refused():
    data = cal.RestitutionData(
        Quantity(100 * VELOCITY, "cm / s"),
        Quantity(85 * np.ones(5), "%"),
        contact_time=Quantity(VELOCITY, "ms"),
    )
    np.testing.assert_allclose(data.velocity, VELOCITY, rtol=1e-15)
    np.testing.assert_allclose(data.restitution, 0.85, rtol=1e-15)
    np.testing.assert_allclose(data.contact_time, 1e-3 * VELOCITY, rtol=1e-15)
    masked = Quantity(100 * VELOCITY, "cm / s", [0, 0, 1, 0, 0])
    found = cal.RestitutionData(masked, 0.8 + 0.01 * VELOCITY)
    np.testing.assert_allclose(found.velocity, [1.0, 1.5, 2.5, 3.0], rtol=1e-15)
    np.testing.assert_allclose(found.restitution, [0.81, 0.815, 0.825, 0.83], rtol=1e-15)
    density, slow = Quantity(8.03, "g / cm3"), Quantity(100.0, "cm s-1")
    assert sj.Material(193e9, 0.3, density, 310e6).density == pytest.approx(8030, rel=1e-15)
    assert sj.restitution(SPHERES, slow).velocity == 1.0
    for unit in ("kg", "furlongs of"):
        with pytest.raises(ValueError, match="`velocity` must be a finite impact velocity"):
            sj.restitution(SPHERES, Quantity(1.0, unit))
        with pytest.raises(ValueError, match=r"`velocity` must be .*without a unit of their own"):
            cal.RestitutionData(Quantity(np.ones(5), unit), 0.9 * np.ones(5))
