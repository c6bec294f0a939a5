"""Headers as people write them, and units as laboratories spell them: the same data as by the names and sizes of the format."""

import math

import numpy as np
import pytest

import calibration as cal
from tests.covariance import covariance_of
from tests.shown.capture import as_recorded

READ = cal.RestitutionData.from_table
# tables that need the name, in the format's own names and SI
SPEEDS = {"impact_velocity": [2.0, 4.0], "rebound_velocity": [1.8, 3.2]}
HEIGHTS = {"drop_height": [1.0, 0.5], "rebound_height": [0.81, 0.32]}
TABLES = {
    "velocity": {"velocity": [2.0, 4.0], "restitution": [0.9, 0.8], "group": ["a", "b"]}
    | {"uncertainty": [0.01, 0.02], "velocity_uncertainty": [0.1, 0.2]},
    "speeds": SPEEDS | {f"{name}_uncertainty": [0.1, 0.2] for name in SPEEDS},
    "heights": HEIGHTS | {f"{name}_uncertainty": [0.01, 0.02] for name in HEIGHTS},
    "both heights": HEIGHTS | {"height_uncertainty": [0.01, 0.02]},
    "intervals": {"interval": [0.8, 0.72, 0.5, 0.4], "launch": ["a", "a", "b", "b"]}
    | {"interval_uncertainty": [0.01, 0.02, 0.03, 0.04]},
    "times": {"time": [0.0, 0.8, 1.52, 2.0], "time_uncertainty": [0.01, 0.02, 0.03, 0.04]},
    "timing": {"time": [0.0, 0.8, 1.52, 2.0], "timing_uncertainty": [0.01, 0.02, 0.03, 0.04]},
}
# name, the table that it is in: its spellings
SPELLINGS = {
    "restitution velocity": "e; E; ε; eps; epsilon; COR; e_n; Restitution; restitution [-]; e / 1; "
    "restitution coefficient; Coefficient of restitution (-); coeff. of restitution; "
    "coef_of_restitution; normal restitution",
    "velocity velocity": "v; V; speed; Velocity [m/s]; velocity[m/s]; v (m/s); v / (m/s); v, m/s; "
    "velocity in m/s; velocity_m_s; v_in; Impact velocity [m s⁻¹]; impact speed; v_impact; v_imp; "
    "vin; v_i; vi; v_inc; v_0; v0; v_before; v_initial; incident velocity; incident speed; "
    "incoming velocity; incoming speed; velocity in; velocity before; initial velocity; "
    "approach velocity; collision velocity; v_{in} [m·s^{-1}]; vᵢ [m/s]; $v_i$ (m/s); v-in; v.in",
    "rebound_velocity speeds": "v_out; v_rebound; v_reb; vout; v_r; vr; v_f; vf; v_after; v_final; "
    "v'; v′ [m/s]; rebound speed; outgoing velocity; outgoing speed; velocity out; velocity after; "
    "final velocity; separation velocity; v_{out} [m·s^{-1}]",
    "impact_velocity speeds": "v; velocity; v_in; v_imp; speed",
    "drop_height heights": " Drop height [ m ] ; h0; h_0; h_drop; h_i; hi; h_initial; initial height; "
    "release height; fall height; falling height; height before; h0 / m; drop_height_m; h1; h_1 [m]",
    "rebound_height heights": "h_rebound; h_reb; h_bounce; h_f; hf; h_r; hr; h_final; h'; h2; h_2; h1; "
    "bounce height; final height; height after; Rebound height (m); rebound height, m",
    "interval intervals": "dt; Δt [s]; δt; delta_t; flight time; time of flight; tof; time interval; "
    "bounce interval; interval time; time between bounces; interval_s; interval in s",
    "launch intervals": "Launch; train",
    "time times": "bounce time; impact_time [s]; event_time_s; time of bounce; Time / s",
    "group velocity": "specimen; Group; Specimen",
    "uncertainty velocity": "u(e); u_e; σ_e; e_err; e error; err; Err; error; unc; stdev; std; sd; ±; "
    "restitution uncertainty; u_restitution; error of restitution [-]; standard deviation; "
    "standard uncertainty; standard error; sigma_e; cor_std; e ±; ±e; std of COR; restitution sd",
    "velocity_uncertainty velocity": "u_v [m/s]; v_err; σ_v; stdev_v; u(v); v uncertainty; sd of v; "
    "velocity error; velocity_std; error in velocity (m/s); u(v_in); v_in ±; error of velocity (m/s)",
    "impact_velocity_uncertainty speeds": "u_v_in; stdev_v_in; v_in_err; u(v_in) [m/s]",
    "rebound_velocity_uncertainty speeds": "u_v_out; u(v') [m/s]; error of rebound velocity",
    "drop_height_uncertainty heights": "u_h0; σ_h0; h0 error [m]; drop height uncertainty (m)",
    "rebound_height_uncertainty heights": "error of rebound height [m]; u_h_rebound; σ_hf",
    "height_uncertainty both heights": "u_h; h uncertainty (m); σ_h; h_err",
    "interval_uncertainty intervals": "u_dt; σ_Δt [s]; interval error; u(interval)",
    "time_uncertainty times": "u_time; time_err; impact time uncertainty [s]",
    "timing_uncertainty timing": "σ_t [s]; u_t; t_err; timing error (s); u(t) [s]",
}
EVERY = [
    (*place.split(" ", 1), word) for place, words in SPELLINGS.items() for word in words.split("; ")
]


def numbers(data):
    group = None if data.group is None else list(data.group)
    covariance = covariance_of(data, -0.1, added=1e-9)
    return group, np.stack([data.velocity, data.restitution, *covariance])


def renamed(table, **names):
    return {names.get(key, key): values for key, values in table.items()}


@pytest.mark.parametrize(("name", "table", "spelling"), EVERY)
def test_a_spelling_is_its_name(name, table, spelling):
    spelled = renamed(TABLES[table], **{name: spelling})
    if spelling.strip(" [m]").startswith(("h1", "h_1")) and name == "drop_height":
        spelled = renamed(spelled, rebound_height="h2")  # which tell each other apart
    group, found = numbers(READ(spelled))
    expected_group, expected = numbers(READ(TABLES[table]))
    assert group == expected_group
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_cells_are_in_the_unit_behind_a_name():
    """Brackets, a slash, a comma, `in` and an underscore are followed by a unit; `_in` may be inches."""
    for header in ("h0 [mm]", "h0 (mm)", "h0 / mm", "h0, mm", "h0 in mm", "drop_height_mm"):
        data = READ({header: [500.0], "h1": [0.32]})
        assert data.restitution[0] == pytest.approx(0.8, rel=1e-14), header
    data = READ({"drop_height_in": [10.0], "rebound height [cm]": [25.4 * 0.64]})
    assert data.restitution[0] == pytest.approx(0.8, rel=1e-14)
    data = READ({"v_in_cm_s": [200.0], "e (%)": [90.0]})
    assert (data.velocity[0], data.restitution[0]) == (2.0, 0.9)


OTHERS = (
    "temperature [°C]; interval_index; e_1; operator; ; t_s; t; h; δv; delta_v; v1; bounce; u_h1; "
    + "x" * 300
)
OTHERS += "; EU; TU; vu; ut; ue; e_u; Su; sdv; estd"  # letters together spell no uncertainty


@pytest.mark.parametrize("header", OTHERS.split("; "))
def test_another_column_is_not_used_and_named(header):
    """`t` might be an interval or a time, `v1` before or after, `bounce` a number; EU is a region."""
    data = READ({"velocity": [1.0], "restitution": [0.9], header: [0.5]})
    assert (len(data), data.uncertainty, data.velocity_uncertainty) == (1, None, None)
    left = [remark for remark in data.remarks if "not used" in remark]
    assert [header[:40] in one for one in left] == ([True] if header else [])


def test_only_names_taken_for_others_are_told():
    table = {"v_in (cm/s)": [100.0], "COR": [0.9], "Err": [0.01]}
    (taken,) = READ(table).remarks
    for words in ("restitution ('COR')", "velocity ('v_in (cm/s)')", "uncertainty ('Err')"):
        assert words in taken
    assert READ({"Velocity": [1.0], "restitution [-]": [0.9]}).remarks == ()
    many = READ({"v": [1.0], "e": [0.9]} | {f"x{i}": [0.0] for i in range(30)}).remarks[-1]
    assert "x9" in many
    assert "x10" not in many
    assert "20 more" in many


def test_the_remarks_on_each_set_of_columns_are_those_that_are_recorded():
    """Of no ball, of a huge one, and of a plain one with the error of the first column alone."""
    remarks, huge = {}, {"diameter": 1.0, "mass": 600.0}
    for name, table in TABLES.items():
        errors = [column for column in table if column.endswith("uncertainty")]
        balls = {0: {}, len(errors): huge, 1: {"diameter": 0.01, "density": 1140.0}}
        for count, ball in balls.items():
            some = {
                column: cells for column, cells in table.items() if column not in errors[count:]
            }
            remarks[f"{name}, {count}"] = "\n\n".join(READ(some, **ball).remarks)
    as_recorded("remarks", remarks, exactly=True)


TIMED = {"interval": [1.0, 0.5, 0.25], "time": [0.0, 1.0, 1.8], "launch": ["x"] * 3}
SINGLE = {"e": [0.45] * 3, "v": [3.0] * 3, "drop_height": [2.0] * 3, "rebound_height": [0.5] * 3}


@pytest.mark.parametrize(
    ("columns", "velocity", "restitution"),
    [
        (("e", "v", "interval", "launch"), 3.0, 0.45),
        (("e", "v", "drop_height", "interval"), 3.0, 0.45),
        (("drop_height", "rebound_height", "time"), 2 * np.sqrt(9.80665), 0.5),
        (("drop_height", "interval", "time"), 9.80665 / 2, 0.5),
    ],
)
def test_of_several_complete_sets_of_columns_the_first_is_used(columns, velocity, restitution):
    data = READ({name: (TIMED | SINGLE)[name] for name in columns})
    found = [data.velocity[0], data.restitution[0]]
    np.testing.assert_allclose(found, [velocity, restitution], rtol=1e-14)


@pytest.mark.parametrize(
    ("columns", "uncertainty", "velocity_uncertainty"),
    [
        ({"e": 0.5, "uncertainty [%]": 2.0, "u_v [%]": 5.0}, 0.01, 0.1),  # of the value itself
        ({"e [%]": 50.0, "uncertainty [%]": 2.0, "u_v [%]": 5.0}, 0.02, 0.1),  # points of ε
        ({"e [%]": 50.0, "uncertainty [-]": 0.02}, 0.02, None),
    ],
)
def test_what_a_percentage_is_of(columns, uncertainty, velocity_uncertainty):
    data = READ({"v": [2.0]} | {name: [cell] for name, cell in columns.items()})
    assert data.uncertainty[0] == pytest.approx(uncertainty, rel=1e-14)
    if velocity_uncertainty is None:
        assert data.velocity_uncertainty is None
        return
    assert data.velocity_uncertainty[0] == pytest.approx(velocity_uncertainty, rel=1e-14)
    for stated in ("2 %", "0.02 -"):
        for_all = READ({"v": [2.0], "e [%]": [50.0]}, uncertainty=stated)
        assert for_all.uncertainty[0] == pytest.approx(0.02, rel=1e-14)
    words = "percentage points" if "e [%]" in columns else "relative to its quantity"
    assert any("uncertainty in %" in remark and words in remark for remark in data.remarks)


def test_a_restitution_beside_what_it_follows_from_is_not_used():
    """Whoever divided the heights has ε²."""
    heights = {"drop_height": [1.0, 1.0], "rebound_height": [0.81, 0.64]}
    for table in (heights, heights | {"v": [1.0, 2.0]}, SPEEDS):
        data = READ(table | {"e": [0.81, 0.64]})
        np.testing.assert_allclose(data.restitution, [0.9, 0.8])
        assert "columns not used: " in "".join(data.remarks)
        assert "'e'" in "".join(data.remarks)


@pytest.mark.parametrize("signs", [(1, -1), (-1, 1)])
def test_velocities_of_opposite_sign_are_speeds(signs):
    speeds = {"v_in": np.array([0.5, 4.0]), "v_out": np.array([0.45, 3.2])}
    data = READ({k: sign * v for sign, (k, v) in zip(signs, speeds.items(), strict=True)})
    np.testing.assert_allclose(data.velocity, [0.5, 4.0], rtol=1e-15)
    np.testing.assert_allclose(data.restitution, [0.9, 0.8], rtol=1e-15)
    assert any("signs of velocities" in remark for remark in data.remarks)
    assert not any("signs of velocities" in remark for remark in READ(speeds).remarks)


def test_groups_go_with_every_set_of_columns():
    pairs = ({"velocity": [1.0, 2.0], "restitution": [0.9, 0.8]}, SPEEDS, HEIGHTS)
    for table in pairs:
        for name in ("group", "specimen", "launch"):
            assert READ(table | {name: ["x", "y"]}).groups == ("x", "y")
        assert READ(table, group=[1, 2]).groups == ("1", "2")
        assert READ(table | {"group": ["x", "x"], "launch": ["a", "b"]}).groups == ("x",)


# size in SI, by the definitions of the inch, foot, mile and pound-force: spellings
SPEED_UNITS = {
    1.0: "m/s | m / s | m per s | m s^-1 | m s-1 | m s⁻¹ | m·s^-1 | m⋅s⁻¹ | m*s⁻¹ | m\\,s^{-1} | "
    "$m s^{-1}$ | m.s-1 | ms^-1 | ms-1 | m_s | mps | M/S | m/sec | m s−1 | mm/ms | mm ms^-1 | um/us",
    0.01: "cm/s | cm s⁻¹ | cms-1 | cm_s | Cm/s",
    0.001: "mm/s | mm s^-1 | mms-1 | mm_s",
    1e-6: "um/s | µm/s | μm s⁻¹",
    1000.0: "km/s | m/ms | m ms⁻¹",
    1 / 3.6: "km/h | KM/H | km h⁻¹ | km h-1 | kmh-1 | km_h | kmh | kmph | kph | km per h",
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


@pytest.mark.parametrize(("unit", "size"), spelled(SPEED_UNITS))
def test_speeds(unit, size):
    """In a header, as an uncertainty's own unit, and as text."""
    for header in (f"velocity [{unit}]", f"velocity ({unit})"):
        table = {header: [3 / size], "e": [0.9], f"u_v [{unit}]": [0.05 / size]}
        data = READ(table)
        assert data.velocity[0] == pytest.approx(3.0, rel=1e-14)
        assert data.velocity_uncertainty[0] == pytest.approx(0.05, rel=1e-14)
    table = {"velocity": [3.0], "e": [0.9]}
    data = READ(table, velocity_uncertainty=f"{0.05 / size!r} {unit}")
    assert data.velocity_uncertainty[0] == pytest.approx(0.05, rel=1e-14)


@pytest.mark.parametrize(("unit", "size"), spelled(LENGTHS))
def test_lengths(unit, size):
    heights = {f"drop_height [{unit}]": [0.5 / size], "rebound_height": [0.32]}
    data = READ(heights, height_uncertainty=f"{0.01 / size!r} {unit}")
    assert data.restitution[0] == pytest.approx(0.8, rel=1e-14)
    # ε/2 √((10 mm/320 mm)² + (10 mm/500 mm)²)
    assert data.uncertainty[0] == pytest.approx(0.4 * math.hypot(0.03125, 0.02), rel=1e-12)


@pytest.mark.parametrize(("unit", "size"), spelled(TIMES))
def test_times(unit, size):
    for name, values in (("interval", [0.5, 0.4]), ("time", [0.5, 1.0, 1.4])):
        table = {f"{name} [{unit}]": np.array(values) / size}
        data = READ(table, timing_uncertainty=f"{0.01 / size!r} {unit}")
        assert data.velocity[0] == pytest.approx(9.80665 * 0.25, rel=1e-12)
        factor = {"interval": 1.0, "time": math.sqrt(2)}[name]  # both ends of t are timed
        assert data.velocity_uncertainty[0] == pytest.approx(factor * 9.80665 * 0.005, rel=1e-12)


@pytest.mark.parametrize("unit", ["%", "-", "1"])
def test_ratios(unit):
    size = {"%": 0.01}.get(unit, 1.0)
    table = {"v": [1.0], f"e [{unit}]": [0.9 / size], f"u(e) ({unit})": [0.02 / size]}
    data = READ(table)
    np.testing.assert_allclose([data.restitution, data.uncertainty], [[0.9], [0.02]], rtol=1e-14)


def test_properties_of_the_bodies(read_toml):
    template = (
        '[[material]]\nname = "{}"\nyoungs_modulus = 2e11\npoisson_ratio = 0.3\ndensity = "{} {}"\n'
        'yield_strength = "{} {}"\nradius = "{} {}"\nlimit_velocity = "{} {}"\ndata = "m.csv"\n'
        "[material.wall]\nmaterial = 'stainless steel'\n"
    )
    units = map(spelled, (DENSITIES, PRESSURES, LENGTHS, SPEED_UNITS))
    lists = list(zip(units, (5000.0, 2e8, 0.02, 150.0), strict=True))
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
    data = READ(table)
    np.testing.assert_array_equal(data.velocity, [0.12, 0.29, 0.57, 0.36])
    np.testing.assert_array_equal(data.velocity_uncertainty, [0.001, 0.002, 0.003, 0.007])
