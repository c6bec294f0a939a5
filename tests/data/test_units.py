"""Units as laboratories spell them: the size of each by definition, in headers and in material files."""

import math

import numpy as np
import pytest

import calibration as cal

# size in SI, by the definitions of the inch, foot, mile and pound-force: spellings
SPEEDS = {
    1.0: "m/s | m / s | m per s | m s^-1 | m s-1 | m s⁻¹ | m·s^-1 | m⋅s⁻¹ | m*s⁻¹ | m\\,s^{-1} | "
    "$m s^{-1}$ | ms^-1 | ms-1 | m_s | mps | M/S | m/sec | m s−1 | mm/ms | mm ms^-1 | um/us",
    0.01: "cm/s | cm s⁻¹ | cms-1 | cm_s | Cm/s",
    0.001: "mm/s | mm s^-1 | mms-1 | mm_s",
    1e-6: "um/s | µm/s | μm s⁻¹",
    1000.0: "km/s | m/ms | m ms⁻¹",
    1 / 3.6: "km/h | KM/H | km h⁻¹ | km h-1 | kmh-1 | km_h | kmh | kph | km per h",
    1 / 60: "m/min",
    0.3048: "ft/s | ft s^-1 | fps | ft_s",
    0.0254: "in/s | in s⁻¹",
    0.44704: "mph",
}
LENGTHS = {1.0: "m", 0.01: "cm | CM", 0.001: "mm", 1e-6: "um | µm | μm", 1000.0: "km"}
LENGTHS |= {0.0254: "in", 0.3048: "ft"}
TIMES = {1.0: "s | sec | S", 0.001: "ms", 1e-6: "us | µs | μs", 60.0: "min", 3600.0: "h"}
PRESSURES = {
    1.0: "Pa | N/m^2 | N/m² | N/m2 | N m^-2 | N m-2 | N m⁻² | N·m⁻² | Nm^-2 | N_m2",
    1e3: "kPa",
    1e6: "MPa | N/mm² | N/mm^2 | N/mm2 | N mm⁻²",
    1e9: "GPa",
    1e12: "TPa",
    6894.757293168361: "psi",
    6894757.293168361: "ksi",
}
DENSITIES = {
    1.0: "kg/m³ | kg/m^3 | kg/m3 | kg m^-3 | kg m-3 | kg m⁻³ | kg·m⁻³ | kgm^-3 | kg_m3 | g/dm³ | g/dm3",
    1000.0: "g/cm³ | g/cm^3 | g/cm3 | g cm⁻³ | kg/dm³ | kg/dm^3 | kg dm⁻³ | t/m³ | t m^-3 | g/cc | "
    "g/ml | kg/l",
    0.001: "g/m³",
    1e6: "kg/cm³ | t/dm³",
    1e9: "t/cm³",
}
ACCELERATIONS = {1.0: "m/s² | m/s^2 | m/s2 | m s^-2 | m s⁻² | ms^-2 | m_s2", 0.01: "cm/s² | cm s-2"}


def spelled(sizes):
    return [(unit, size) for size, units in sizes.items() for unit in units.split(" | ")]


@pytest.mark.parametrize(("unit", "size"), spelled(SPEEDS))
def test_speeds(unit, size):
    """In a header, as an uncertainty's own unit, and as text."""
    for header in (f"velocity [{unit}]", f"velocity ({unit})"):
        table = {header: [3 / size], "e": [0.9], f"u_v [{unit}]": [0.05 / size]}
        data = cal.RestitutionData.from_table(table)
        assert data.velocity[0] == pytest.approx(3.0, rel=1e-14)
        assert data.velocity_uncertainty[0] == pytest.approx(0.05, rel=1e-14)
    table = {"velocity": [3.0], "e": [0.9]}
    data = cal.RestitutionData.from_table(table, velocity_uncertainty=f"{0.05 / size!r} {unit}")
    assert data.velocity_uncertainty[0] == pytest.approx(0.05, rel=1e-14)


@pytest.mark.parametrize(("unit", "size"), spelled(LENGTHS))
def test_lengths(unit, size):
    heights = {f"drop_height [{unit}]": [0.5 / size], "rebound_height": [0.32]}
    data = cal.RestitutionData.from_table(heights, height_uncertainty=f"{0.01 / size!r} {unit}")
    assert data.restitution[0] == pytest.approx(0.8, rel=1e-14)
    # ε/2 √((10 mm/320 mm)² + (10 mm/500 mm)²)
    assert data.uncertainty[0] == pytest.approx(0.4 * math.hypot(0.03125, 0.02), rel=1e-12)


@pytest.mark.parametrize(("unit", "size"), spelled(TIMES))
def test_times(unit, size):
    for name, values in (("interval", [0.5, 0.4]), ("time", [0.5, 1.0, 1.4])):
        table = {f"{name} [{unit}]": np.array(values) / size}
        data = cal.RestitutionData.from_table(table, timing_uncertainty=f"{0.01 / size!r} {unit}")
        assert data.velocity[0] == pytest.approx(9.80665 * 0.25, rel=1e-12)
        factor = {"interval": 1.0, "time": math.sqrt(2)}[name]  # both ends of t are timed
        assert data.velocity_uncertainty[0] == pytest.approx(factor * 9.80665 * 0.005, rel=1e-12)


@pytest.mark.parametrize("unit", ["%", "-", "1"])
def test_ratios(unit):
    size = {"%": 0.01}.get(unit, 1.0)
    table = {"v": [1.0], f"e [{unit}]": [0.9 / size], f"u(e) ({unit})": [0.02 / size]}
    data = cal.RestitutionData.from_table(table)
    np.testing.assert_allclose([data.restitution, data.uncertainty], [[0.9], [0.02]], rtol=1e-14)


def test_properties_of_the_bodies(read_toml):
    template = (
        '[[material]]\nname = "{}"\nyoungs_modulus = 2e11\npoisson_ratio = 0.3\ndensity = "{} {}"\n'
        'yield_strength = "{} {}"\nradius = "{} {}"\nlimit_velocity = "{} {}"\ndata = "m.csv"\n'
        "[material.wall]\nmaterial = 'stainless steel'\n"
    )
    lists = [
        (spelled(DENSITIES), 5000.0),
        (spelled(PRESSURES), 2e8),
        (spelled(LENGTHS), 0.02),
        (spelled(SPEEDS), 150.0),
    ]
    count = max(len(units) for units, _ in lists)
    entries = []
    for i in range(count):
        chosen = [(units[i % len(units)], value) for units, value in lists]
        words = [word for (unit, size), value in chosen for word in (repr(value / size), unit)]
        entries.append(template.format(i, *words).replace("\\", "\\\\"))
    for entry in read_toml("".join(entries)):
        contact = entry.contact
        found = [contact.mass, contact.yield_strength, contact.radius, entry.limit_velocity]
        expected = [4 / 3 * math.pi * 5000 * 0.02**3, 2e8, 0.02, 150.0]
        np.testing.assert_allclose(found, expected, rtol=1e-13, err_msg=entries[int(entry.name)])


@pytest.mark.parametrize(("unit", "size"), spelled(ACCELERATIONS))
def test_gravity(unit, size, read_toml):
    text = f'[[material]]\ngravity = "{1.62 / size!r} {unit}"\ndata = "m.csv"\n'
    (data,) = read_toml(text, "drop_height,rebound_height\n0.5,0.32\n")
    assert data.velocity[0] == pytest.approx(1.272792206, rel=1e-9)  # √1.62


def test_numbers_with_their_unit_as_text_and_the_double_nearest_to_a_decimal(read_toml):
    """So repeats stated in cm/s and in m/s are repeats."""
    text = '[[material]]\ndata = "m.csv"\nvelocity_uncertainty = "{}"\n'
    for quantity, expected in (("5 %", 0.1), ("+1.5e1 mm/s", 0.015), (" 25mm/s ", 0.025)):
        (data,) = read_toml(text.format(quantity))
        assert data.velocity_uncertainty[1] == pytest.approx(expected, rel=1e-14)
    values = [12, 29, 57, 36]
    table = {"velocity [cm/s]": values, "e": [0.9] * 4, "u_v [mm/s]": [1, 2, 3, 7]}
    data = cal.RestitutionData.from_table(table)
    np.testing.assert_array_equal(data.velocity, [0.12, 0.29, 0.57, 0.36])
    np.testing.assert_array_equal(data.velocity_uncertainty, [0.001, 0.002, 0.003, 0.007])
