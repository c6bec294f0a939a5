"""Headers as people write them: what each is taken for, what is told of it, what is asked back."""

from fractions import Fraction

import pytest

from calibration.data.columns import layout_of
from calibration.data.names import AMBIGUOUS, DIMENSIONS, KNOWN, plain, read_header
from calibration.data.units import Relative, in_si, quantity, unit_of
from calibration.errors import DataError

HEADERS = [
    ("velocity", "velocity", None),
    (" Drop height [ mm ] ", "drop_height", "mm"),
    ("restitution [-]", "restitution", "-"),
    ("interval[ms]", "interval", "ms"),
    ("COR", "restitution", None),
    ("Coefficient of restitution (%)", "restitution", "%"),
    ("ε", "restitution", None),
    ("e", "restitution", None),
    ("V (cm/s)", "velocity", "cm/s"),
    ("v_in", "impact_velocity", None),
    ("v in (m s⁻¹)", "impact_velocity", "m s⁻¹"),
    ("v_{out} [m·s^{-1}]", "rebound_velocity", "m·s^{-1}"),
    ("vᵢ [m/s]", "impact_velocity", "m/s"),
    ("v′ [m/s]", "rebound_velocity", "m/s"),
    ("v_in_m_s", "impact_velocity", "m_s"),
    ("drop_height_cm", "drop_height", "cm"),
    ("drop_height_in", "drop_height", "in"),
    ("h0 / mm", "drop_height", "mm"),
    ("v / (m/s)", "velocity", "m/s"),
    ("e / 1", "restitution", "1"),
    ("v, m/s", "velocity", "m/s"),
    ("velocity in km/h", "velocity", "km/h"),
    ("Δt [ms]", "interval", "ms"),
    ("specimen", "group", None),
    ("u(e)", "uncertainty", None),
    ("u_v [m/s]", "velocity_uncertainty", "m/s"),
    ("v_err", "velocity_uncertainty", None),
    ("stdev_v_in", "impact_velocity_uncertainty", None),
    ("error of rebound height [mm]", "rebound_height_uncertainty", "mm"),
    ("h uncertainty (mm)", "height_uncertainty", "mm"),
    ("σ_t [µs]", "timing_uncertainty", "µs"),
    ("restitution uncertainty [%]", "uncertainty", "%"),
    ("±", "uncertainty", None),
    ("t_s", "t", "s"),  # what it is only a person can tell
    ("h1 (cm)", "h1", "cm"),
    ("Δv", "δv", None),
    ("temperature [°C]", None, None),
    ("interval_index", None, None),
    ("e_1", None, None),
    ("", None, None),
]


@pytest.mark.parametrize(("text", "name", "unit"), HEADERS)
def test_headers(text, name, unit):
    header = read_header(text)
    assert (header.name, header.unit) == (name, unit)


def test_no_name_is_known_and_asked_about_and_all_are_found_as_they_are_written():
    assert not set(KNOWN) & set(AMBIGUOUS)
    assert {plain(name) for name in (*KNOWN, *AMBIGUOUS)} == {*KNOWN, *AMBIGUOUS}
    assert {*KNOWN.values()} <= {*DIMENSIONS}
    assert {option for options in AMBIGUOUS.values() for option in options} <= {*DIMENSIONS}


@pytest.mark.parametrize(
    ("text", "accepted"),
    [
        ("velocty [m/s]", "did you mean 'velocity'?"),
        ("restituion", "did you mean 'restitution'?"),
        ("drop hight (cm)", "did you mean 'drop_height'?"),
        ("lauch", "did you mean 'launch'?"),
        ("velocity [m/s", "a name and one unit, as in `velocity [m/s]`"),
        ("velocity [m/s] (corrected)", "a name and one unit"),
    ],
)
def test_a_name_near_a_known_one_is_asked_about(text, accepted):
    with pytest.raises(DataError) as caught:
        read_header(text)
    assert accepted in caught.value.accepted


def taken(*headers, units=None):
    """Names by header, for those that are used; the kind; and what is told."""
    layout = layout_of(headers, units)
    return {headers[at]: name for name, at in layout.position.items()}, layout


def test_what_names_were_taken_for_is_one_line_and_what_is_not_used_another():
    names, layout = taken("COR", "v_in (cm/s)", "operator", "room temperature", "t [s]", "Err", "")
    assert names == {"COR": "restitution", "v_in (cm/s)": "velocity", "Err": "uncertainty"}
    assert layout.remarks == (
        "columns taken: 'COR' for restitution, 'v_in (cm/s)' for velocity, 'Err' for uncertainty",
        "columns not used: 'operator', 'room temperature', 't [s]' (is 't' interval or time?)",
    )
    assert taken("Velocity", "restitution [-]", "group")[1].remarks == ()
    (left,) = taken("velocity", "restitution", "drop_height", "group", "launch")[1].remarks
    assert left == "columns not used: 'drop_height', 'launch'"
    many = taken("v", "e", *(f"x{i}" for i in range(30)))[1].remarks
    assert many[1].endswith(", 'x9' and 20 more")


def test_what_a_percentage_is_of_is_told():
    alone, beside = (taken("v", e, "uncertainty [%]")[1].remarks[-1] for e in ("e", "e [%]"))
    assert alone == "uncertainty in % is taken of the value itself"
    assert beside == "uncertainty in % is taken in the percentage points of ε"


def test_units_that_are_not_told_are_told_as_they_are_taken():
    assert taken("h0", "h1 [mm]")[1].assumed.endswith("taken for SI: drop_height in m")
    assert taken("v", "e")[1].assumed.endswith(": velocity in m/s")
    assert taken("v", "e", units=["cm/s", "-"])[1].assumed == ""


@pytest.mark.parametrize(
    ("headers", "names"),
    [
        (("h0", "h1"), ("drop_height", "rebound_height")),
        (("h1", "h2"), ("drop_height", "rebound_height")),
        (("h_2 [mm]", "h_1 [mm]"), ("rebound_height", "drop_height")),
        (("drop_height", "h2"), ("drop_height", "rebound_height")),
        (("velocity", "rebound_velocity"), ("impact_velocity", "rebound_velocity")),
        (("impact_velocity", "e"), ("velocity", "restitution")),
        (("v_in", "u_v_in", "e"), ("velocity", "velocity_uncertainty", "restitution")),
    ],
)
def test_columns_that_are_told_apart_by_each_other(headers, names):
    assert taken(*headers)[0] == dict(zip(headers, names, strict=True))


@pytest.mark.parametrize(
    ("headers", "needs"),
    [
        (("e", "v", "interval", "launch"), ("velocity", "restitution")),
        (("e", "v", "v_out"), ("impact_velocity", "rebound_velocity")),
        (("time", "interval"), ("interval",)),
        (("drop_height", "rebound_height", "time"), ("drop_height", "rebound_height")),
        (("drop_height", "interval"), ("interval",)),
        (("v", "e", "time", "impact time"), ("velocity", "restitution")),  # twice, but not used
    ],
)
def test_of_several_sets_the_first_is_used(headers, needs):
    assert taken(*headers)[1].kind.needs == needs


def test_units_in_a_row_of_their_own():
    _, layout = taken("v", "e", "x", units=["[cm/s]", "-", "°C"])
    assert layout.units == {"velocity": Fraction(1, 100), "restitution": 1}
    with pytest.raises(DataError, match=r"`unit of velocity` must be told once, but is \[m/s\] in"):
        layout_of(["v [m/s]", "e"], ["cm/s", ""])
    with pytest.raises(DataError, match=r"`unit of velocity` must be in m/s, .*, but is \[kg\]"):
        layout_of(["v", "e"], ["kg", ""])


def test_percent_of_a_restitution_is_absolute_where_it_is_in_percent_itself():
    _, layout = taken("v", "e [%]", "uncertainty [%]", "u_v [%]")
    assert layout.relative == {"velocity_uncertainty"}
    assert layout.units["restitution"] == layout.units["uncertainty"] == Fraction(1, 100)
    assert taken("v", "e", "uncertainty [%]")[1].relative == {"uncertainty"}


UNITS = [  # in SI, by the definitions of the inch, the foot, the mile and the pound-force
    ("speed", "m/s", 1.0), ("speed", "cm/s", 0.01), ("speed", "mm s^-1", 0.001),
    ("speed", "mm s⁻¹", 0.001), ("speed", "m·s^-1", 1.0), ("speed", "m s-1", 1.0),
    ("speed", "ms^-1", 1.0), ("speed", "mms-1", 0.001), ("speed", "mps", 1.0),
    ("speed", "m\\,s^{-1}", 1.0), ("speed", "KM/H", 1 / 3.6), ("speed", "km h⁻¹", 1 / 3.6),
    ("speed", "ft/s", 0.3048), ("speed", "in/s", 0.0254), ("speed", "mph", 0.44704),
    ("speed", "m per s", 1.0), ("length", "in", 0.0254), ("length", "ft", 0.3048),
    ("length", "µm", 1e-6), ("length", "μm", 1e-6), ("time", "ms", 1e-3), ("time", "µs", 1e-6),
    ("time", "us", 1e-6), ("time", "min", 60.0), ("ratio", "%", 0.01),
    ("pressure", "GPa", 1e9), ("pressure", "N/mm²", 1e6), ("pressure", "psi", 6894.757293168361),
    ("density", "g/cm3", 1000.0), ("density", "g/cm³", 1000.0), ("density", "kg m^-3", 1.0),
    ("density", "g/cc", 1000.0), ("density", "t/m^3", 1000.0), ("acceleration", "m/s²", 1.0),
]  # fmt: skip


@pytest.mark.parametrize(("dimension", "text", "size"), UNITS)
def test_units(dimension, text, size):
    assert float(unit_of(text, dimension)) == pytest.approx(size, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "dimension"),
    [("mpa", "pressure"), ("s", "speed"), ("ms", "speed"), ("kg", "length"), ("", "ratio")],
)
def test_what_is_no_unit_of_the_dimension_is_refused(text, dimension):
    with pytest.raises(DataError, match="`unit` must be in "):
        unit_of(text, dimension)


def test_conversion_rounds_once():
    assert in_si(12, unit_of("cm/s", "speed")) == 0.12
    assert in_si(36, unit_of("km/h", "speed")) == 10.0
    assert in_si(1, unit_of("in", "length")) == 0.0254


def test_quantities_as_text():
    assert quantity("69 GPa", "pressure") == 69e9
    assert quantity(" 12.7mm ", "length") == 0.0127
    assert quantity("+1.5e1 g/cm³", "density") == 15000.0
    part = quantity("5 %", "speed")
    assert part == 0.05
    assert isinstance(part, Relative)
    for text in (
        "69",
        "GPa",
        "",
        "1e5",
        "8030",
        "1,5 mm",
        "1.5.2 mm",
        "nan mm",
        "1" * 99,
    ):
        with pytest.raises(DataError, match="`quantity` must be a number, or one with its unit"):
            quantity(text, "length")
