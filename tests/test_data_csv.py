"""CSV files as people and programs save them; and one experiment told in all the ways there are."""

import numpy as np
import pytest

from calibration.data import RestitutionData, read_csv
from calibration.errors import InputError

G = 9.80665


@pytest.fixture
def read(tmp_path):
    """Write a file, read it."""

    def write_and_read(text, encoding="utf-8", **options):
        path = tmp_path / "a.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return read_csv(path, **options)

    return write_and_read


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_files_as_programs_save_them(read, delimiter, encoding, newline):
    rows = [
        '# saved by "a program", 5; 6',
        "",
        '"velocity [mm/s]", restitution ,',
        "  # a comment",
        "120,0.95,",
        ",,",
        " 3.0e3 ,+.7",
    ]
    text = newline.join(rows).replace(",", delimiter) + newline
    mark = "\ufeff" if encoding in ("utf-16-le", "utf-16-be") else ""
    data = read(mark + text, encoding)
    np.testing.assert_array_equal(data.velocity, [0.12, 3.0])
    np.testing.assert_array_equal(data.restitution, [0.95, 0.7])
    assert (data.name, data.origin.line, data.origin.lines) == ("a", 3, (5, 7))


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas(read, delimiter):
    text = "v [m/s];COR;Err\n0,12;0,95;0,004\n3;7e-1;0,02\n".replace(";", delimiter)
    data = read(text)
    np.testing.assert_array_equal(data.velocity, [0.12, 3.0])
    np.testing.assert_array_equal(data.restitution, [0.95, 0.7])
    np.testing.assert_array_equal(data.uncertainty, [0.004, 0.02])
    assert data.remarks[-1] == "commas in numbers are taken for decimal points"


def test_the_separator_line_of_a_spreadsheet_and_quoted_cells(read):
    text = 'sep=;\r\n"drop height (cm)";"rebound height (cm)";"remark, if any"\r\n'
    data = read(text + '"100";"64";"first; not clean"\r\n50;32;\r\n')
    np.testing.assert_allclose(data.restitution, [0.8, 0.8], rtol=1e-14)
    fallen = "velocities are those of free falls"
    assert data.remarks == ("columns not used: 'remark, if any'", fallen)


def test_units_in_a_row_of_their_own(read):
    plain = read("velocity [cm/s],restitution [%],note\n12,95,a\n300,70,b\n")
    below = read("velocity,restitution,note\ncm/s,%,\n12,95,a\n300,70,b\n")
    brackets = read("velocity;restitution;note\n[cm/s];[%];[text]\n12;95;a\n300;70;b\n")
    assert plain == below == brackets
    np.testing.assert_allclose(plain.restitution, [0.95, 0.7], rtol=1e-15)
    assert below.origin.lines == (3, 4)


def test_a_columns_text_may_be_anything_where_it_is_not_used(read):
    data = read("operator,v,e,t\nMüller,1.0,0.9,12:30\n,2.0,0.8,\n")
    assert len(data) == 2
    assert data.remarks[1] == "columns not used: 'operator', 't' (is 't' interval or time?)"


def test_rows_that_were_not_measured_keep_the_lines_of_the_others(read):
    data = read("v,e,specimen\n1,0.9,a\n2,,a\n# pause\n3,0.7,b\n")
    assert (data.origin.lines, data.groups) == ((2, 5), ("a", "b"))
    with pytest.raises(InputError, match=r"a\.csv:6: velocity is -3; it must be a positive"):
        read("v,e,specimen\n1,0.9,a\n2,,a\n# pause\n3,0.7,b\n-3,0.7,b\n")


def test_a_first_row_without_a_measurement_is_no_row_of_units(read):
    data = read("v,e,specimen\n,,A\n1,0.9,B\n")
    assert (len(data), data.groups) == (1, ("B",))


def test_uncertainties_in_percent_are_parts_of_the_quantity(read):
    data = read("v,e,uncertainty [%],u_v [%]\n2.0,0.5,2,5\n4.0,0.25,2,5\n")
    np.testing.assert_allclose(data.uncertainty, [0.01, 0.005], rtol=1e-14)
    np.testing.assert_allclose(data.velocity_uncertainty, [0.1, 0.2], rtol=1e-14)
    points = read("v,e [%],uncertainty [%]\n2.0,50,2\n4.0,25,2\n")
    np.testing.assert_allclose(points.uncertainty, [0.02, 0.02], rtol=1e-14)


def test_bounces_of_a_ball(read):
    """Two launches from one height, labelled, times in milliseconds; the lines are the tₙ's."""
    data = read(
        "# a ball on a plate\nlaunch,interval [ms],uncertainty\nA,720,0.01\nA,648,0.01\nA,583.2,\n"
        "\nB,730,0.01\nB,664.3,\n"
    )
    np.testing.assert_allclose(data.restitution, [0.9, 0.9, 0.91], rtol=1e-14)
    # 9.80665/2 · (0.72, 0.648, 0.73)
    np.testing.assert_allclose(data.velocity, [3.530394, 3.1773546, 3.57942725], rtol=1e-14)
    np.testing.assert_array_equal(data.uncertainty, [0.01, 0.01, 0.01])
    assert data.origin.lines == (3, 4, 7)
    assert list(data.group) == ["A", "A", "B"]


def test_times_of_an_acoustic_stopwatch(read):
    """Units after an underscore, and a column that is not used."""
    data = read("drop_height_cm,launch,event_time_ms\n80,1,250\n80,1,1050\n80,1,1770\n80,1,2418\n")
    np.testing.assert_allclose(data.restitution, [0.9, 0.9], rtol=1e-12)
    assert data.origin.lines == (3, 4)
    assert data.remarks == (
        "columns taken: 'event_time_ms' for time",
        "columns not used: 'drop_height_cm'",
        "velocities are those of free falls",
    )


# One experiment: two trains of bounces, of which every way to tell it holds the same
TIMES = [np.array([0.1, 0.9, 1.66, 2.36, 3.0]), np.array([0.2, 0.8, 1.37, 1.91])]
INTERVALS = [np.diff(times) for times in TIMES]
VELOCITY = np.concatenate([G * t[:-1] / 2 for t in INTERVALS])
RESTITUTION = np.concatenate([t[1:] / t[:-1] for t in INTERVALS])
LAUNCH = ["A", "A", "A", "B", "B"]


def csv(header, *columns):
    rows = [",".join(str(cell) for cell in row) for row in zip(*columns, strict=True)]
    return "\n".join([header, *rows]) + "\n"


def labels(parts):
    return [name for name, part in zip("AB", parts, strict=True) for _ in part]


WAYS = {
    "velocity": csv("v,e,group", VELOCITY, RESTITUTION, LAUNCH),
    "percent and km/h": csv("v (km/h),COR [%],specimen", 3.6 * VELOCITY, 100 * RESTITUTION, LAUNCH),
    "two velocities": csv("v_in,v_out,launch", VELOCITY, VELOCITY * RESTITUTION, LAUNCH),
    "two heights": csv(
        "drop height / mm,rebound height / in,group",
        1000 * VELOCITY**2 / (2 * G),
        (VELOCITY * RESTITUTION) ** 2 / (2 * G) / 0.0254,
        LAUNCH,
    ),
    "intervals": csv("launch,dt [ms]", labels(INTERVALS), 1000 * np.concatenate(INTERVALS)),
    "times": csv("time [µs],launch", 1e6 * np.concatenate(TIMES), labels(TIMES)),
}


@pytest.mark.parametrize("way", WAYS)
def test_one_experiment_told_in_all_ways(read, way):
    data = read(WAYS[way])
    np.testing.assert_allclose(data.velocity, VELOCITY, rtol=1e-12)
    np.testing.assert_allclose(data.restitution, RESTITUTION, rtol=1e-12)
    assert list(data.group) == LAUNCH


def test_one_experiment_has_one_covariance(read):
    """Stopped times shared by neighbours, by a file, by Python, and as intervals they make."""
    told = {"time_uncertainty": "0.4 ms"}
    file = read(WAYS["times"], **told)
    table = {"time": np.concatenate(TIMES), "launch": labels(TIMES)}
    python = RestitutionData.from_table(table, time_uncertainty=4e-4)
    column = read(
        WAYS["times"]
        .replace("launch\n", "launch,u_t [ms]\n", 1)
        .replace(",A\n", ",A,0.4\n")
        .replace(",B\n", ",B,0.4\n")
    )
    for other in (python, column):
        np.testing.assert_allclose(
            file.covariance_of(-0.1).dense(), other.covariance_of(-0.1).dense(), rtol=1e-9
        )
    # ε = (T₃ - T₂)/(T₂ - T₁): the bounce in the middle makes one interval longer, one shorter
    t, e = np.concatenate([part[:-1] for part in INTERVALS]), RESTITUTION
    np.testing.assert_allclose(file.uncertainty, 4e-4 * np.sqrt(1 + (1 + e) ** 2 + e**2) / t)


def test_heights_and_velocities_have_the_same_covariance_where_they_tell_the_same(read):
    """u(h) = v u(v)/g: what a height is off by is a velocity's error told otherwise."""
    u = 0.02
    speeds = read(WAYS["two velocities"], velocity_uncertainty=u)
    after = VELOCITY * RESTITUTION
    columns = (VELOCITY**2 / (2 * G), after**2 / (2 * G), VELOCITY * u / G, after * u / G)
    header = "h0,h_rebound,u_h0,u_h_rebound"
    heights = read(csv(header, *columns))
    for slope in (0.0, -0.2):
        np.testing.assert_allclose(
            heights.covariance_of(slope).dense(), speeds.covariance_of(slope).dense(), rtol=1e-9
        )


def test_a_hundred_thousand_rows_are_read_as_they_stand(tmp_path):
    rng = np.random.default_rng(3)
    v, e = rng.uniform(0.1, 5.0, 100_000), rng.uniform(0.2, 0.9, 100_000)
    lines = [
        f"{a!r},{b!r},s{i % 3}" for i, (a, b) in enumerate(zip(v.tolist(), e.tolist(), strict=True))
    ]
    lines[70_000] = '"1.5", ,s0'
    (tmp_path / "long.csv").write_text("\n".join(["velocity,restitution,group", *lines]))
    data = read_csv(tmp_path / "long.csv")
    np.testing.assert_array_equal(data.velocity, np.delete(v, 70_000))
    np.testing.assert_array_equal(data.restitution, np.delete(e, 70_000))
    assert data.groups == ("s0", "s1", "s2")
    assert data.origin.lines[70_000] == 70_003
