"""Curves as text and numbers: digits, velocities in, rows out."""

import io
import itertools
import sys
from contextlib import closing

import numpy as np
import pytest

import softjax as sj
from calibration.curve.digits import text_of
from calibration.curve.source import Source
from calibration.curve.stream import Rows, Span, Thinned, curve_rows, evaluator, in_one_size
from calibration.curve.table import TableWriter, with_knots
from calibration.curve.velocities import Column, Grid
from calibration.curve.writers import CsvWriter, NpyWriter, status_names
from calibration.errors import InputError
from tests.cases import fitted, law_with, pair

NYLON = Source("nylon", fitted("nylon"), (0.1, 60.0))
HARD_NUMBERS = [
    *(
        0.0,
        1.0,
        10.0,
        1e15,
        9.9999999999999995e22,
        1e-5,
        1e-6,
        5e-324,
        1e-300,
        1.7976931348623157e308,
    ),
    *(0.1, 0.3, 1 / 3, 2 / 3, 0.99999999999999989, 9.9999999999999982, 123456789.123456789),
    *np.nextafter([1e-5, 1e-3, 1e-1, 1.0, 1e2, 1e5, 1e15, 1e16], 0).tolist(),
    *np.nextafter([1e-5, 1e-3, 1e-1, 1.0, 1e2, 1e5, 1e15, 1e16], np.inf).tolist(),
    *(-0.1, -1e-300, np.inf, np.nan),
]


def lines_of(text) -> list[str]:
    return [row[row != 0].tobytes().decode() for row in text]


def test_hard_numbers_are_written_as_python_writes_them():
    assert lines_of(text_of(HARD_NUMBERS)) == [f"{x:.16e}" for x in HARD_NUMBERS]


def test_a_hundred_thousand_numbers_are_written_as_python_writes_them():
    rng = np.random.default_rng(3)
    numbers = np.exp(rng.uniform(np.log(1e-6), np.log(1e17), 100_000))
    assert lines_of(text_of(numbers)) == [f"{x:.16e}" for x in numbers]


@pytest.mark.parametrize("spacing", ["lin", "log"])
@pytest.mark.parametrize("size", [3, 7, 100])
def test_a_grid_is_the_same_in_blocks(spacing, size):
    grid = Grid(0.01, 3.0, 10, spacing)
    blocks = list(grid.blocks(size))
    assert max(map(len, blocks)) <= size
    whole = np.concatenate(blocks)
    expected = np.linspace(0.01, 3, 10) if spacing == "lin" else np.geomspace(0.01, 3, 10)
    np.testing.assert_allclose(whole, expected, rtol=1e-14)
    assert (whole[0], whole[-1]) == (0.01, 3.0)


@pytest.mark.parametrize("ends", [(1e-300, 1e10), (1e-300, 1e300), (5e-324, 1e308)])
def test_a_grid_reaches_over_more_than_all_powers_of_ten(ends):
    (velocity,) = Grid(*ends, 5, "log").blocks()
    expected = np.linspace(*np.log10(ends), 5)
    np.testing.assert_allclose(np.log10(velocity), expected, atol=1e-3)
    assert (velocity[0], velocity[-1]) == ends


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((1.0, 0.5, 10), "--to"),
        ((-1.0, 0.5, 10), "--from"),
        ((0.0, 0.5, 10, "log"), "--from"),
        ((0.1, 0.5, 0), "--points"),
        ((0.1, np.inf, 5), "--to"),
    ],
)
def test_a_grid_that_makes_no_sense_is_refused(arguments, named):
    with pytest.raises(ValueError, match=f"`{named}`"):
        Grid(*arguments)


@pytest.mark.parametrize(
    "text",
    [
        "0.5\n# a comment\n\n1.5\n2.5\n",
        "restitution,velocity [cm/s]\n0.9,50\n0.8,150\n0.7,250\n",
        "velocity;restitution\n0.5;0.9\n1.5;0.8\n2.5;0.7\n",
        "\ufeffvelocity [mm/s]\r\n500\r\n1500\r\n2500\r\n",
        "velocity [m/s];restitution\n0,5;0,9\n1,5;0,8\n2,5;0,7\n",
        'specimen,velocity\n"1,5",0.5\n"2,5",1.5\n"3,5",2.5\n',
        "restitution\tvelocity\n\t0.5\n\t1.5\n0.7\t2.5\n",
        "velocity,\n0.5,\n1.5,\n2.5,\n",
    ],
)
def test_velocities_are_read_from_files_and_standard_input(text, tmp_path, monkeypatch):
    path = tmp_path / "v.csv"
    path.write_bytes(text.encode())
    stream = io.TextIOWrapper(io.BytesIO(text.encode()))
    monkeypatch.setattr(sys, "stdin", stream)
    for source in (str(path), "-"):
        blocks = list(Column(source).blocks(2))
        assert [len(block) for block in blocks] == [2, 1]
        np.testing.assert_array_equal(np.concatenate(blocks), [0.5, 1.5, 2.5])
    assert not stream.closed


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("0.5\nfast\n", 2, "velocity is 'fast'; it must be a finite number"),
        ("0.5\n\n-1\n", 3, "'-1' holds no velocity"),
        ("velocity\n1\nnan\n", 3, "velocity is 'nan'; it must be a finite number"),
        ("restitution,velocity\n0.5,1\n0.5,\n", 3, "'0.5,' holds no velocity"),
        ("restitution,velocity\n0.5,1\n0.5\n", 3, "1 cells; 2 are needed"),
        ("velocity [m/s]\n0,5\n1,5\n", 2, "2 cells; 1 are needed"),
        ("0.5\n1,5\n", 2, "2 cells; 1 are needed"),
        ("velocity;e\n0,5;1\n1.500;1\n", 3, "with a comma or with a point in the whole file"),
        ("colour\n1\n", 1, "no column named velocity"),
        ("velocity [kg]\n1\n", 1, "unit is [kg]; it must be in m/s"),
        ("velocity\n", 1, "no velocities"),
        ("", None, "no velocities"),
    ],
)
def test_what_is_no_velocity_is_refused_with_its_line(text, line, said, tmp_path):
    path = tmp_path / "v.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        list(Column(str(path)).blocks())
    assert refusal.value.file == str(path)
    assert refusal.value.line == line
    assert said in str(refusal.value)


def test_blocks_give_the_curve_of_the_whole():
    seen = Span()
    velocity = np.geomspace(0.1, 60.0, 50)
    blocks = [velocity[i : i + 16] for i in range(0, 50, 16)]
    rows = list(curve_rows(NYLON, blocks))
    for part in rows:
        seen.add(part)
    whole = sj.restitution(NYLON.law, velocity)
    assert [len(part.velocity) for part in rows] == [16, 16, 16, 2]
    joined = [np.concatenate(column) for column in list(zip(*rows, strict=True))[:3]]
    np.testing.assert_array_equal(joined[0], velocity)
    np.testing.assert_allclose(joined[1], np.asarray(whole.coefficient), rtol=1e-14)
    np.testing.assert_array_equal(joined[2], np.asarray(whole.status))
    assert (seen.ends, seen.rows) == ((velocity[0], velocity[-1]), 50)


def rows_of(count: int, first: float = 0.5) -> Rows:
    velocity = first + np.arange(count) / 7
    status = np.resize([0, int(sj.Status.ELASTIC), 6], count)
    return Rows(velocity, np.exp(-velocity), status)


def test_csv_reads_back_as_the_same_float64(tmp_path):
    path = tmp_path / "c.csv"
    writer = CsvWriter(path)
    blocks = rows_of(5), rows_of(4, 2.0)
    for rows in blocks:
        writer.write(rows)
    writer.close()
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "velocity [m/s],restitution,status"
    cells = [line.split(",") for line in lines[1:]]
    for i, name in enumerate(("velocity", "coefficient")):
        expected = np.concatenate([getattr(rows, name) for rows in blocks])
        np.testing.assert_array_equal([float(row[i]) for row in cells], expected)
    names = ["PLAIN", "ELASTIC", "NO_RESIDUAL_OVERLAP|ENERGY_GAIN"]
    assert [row[2] for row in cells] == [*names, *names[:2], *names, names[0]]


def test_npy_reads_back_by_numpy_whatever_its_length(tmp_path):
    path = tmp_path / "c.npy"
    writer = NpyWriter(path)
    blocks = [rows_of(3000, first) for first in (0.1, 500.0, 1000.0, 1500.0)]
    for rows in blocks:
        writer.write(rows)
    writer.close()
    found = np.load(path)
    assert found.dtype.names == ("velocity", "restitution", "status")
    for name, column in (("velocity", 0), ("restitution", 1), ("status", 2)):
        expected = np.concatenate([rows[column] for rows in blocks])
        np.testing.assert_array_equal(found[name], expected)


def table_of(source, blocks, path):
    """The table's header and numbers, through the stream as the command makes it."""
    with closing(TableWriter(path, source)) as writer:
        for rows in curve_rows(source, blocks):
            writer.write(rows)
    header = [line for line in path.read_text("utf-8").splitlines() if line.startswith("#")]
    return header, np.loadtxt(path, ndmin=2)


@pytest.mark.long
def test_a_table_tells_how_far_interpolation_is_from_the_law(tmp_path):
    """Its header against exact values between its rows, 50 between every two of them."""
    grid = Grid(0.1, 60.0, 80, "log")
    blocks = with_knots(NYLON, grid.blocks(32), (0.1, 60.0))
    header, found = table_of(NYLON, blocks, tmp_path / "c.txt")
    (told,) = [float(line.split(" by ")[1].split()[0]) for line in header if "errs by" in line]
    velocity = found[:, 0]
    between = np.concatenate(
        [np.linspace(*ends, 52)[1:-1] for ends in itertools.pairwise(velocity)]
    )
    at = float(NYLON.law.contact.critical_velocity)
    between = between[np.abs(between / at - 1) > 1e-9]
    exact = np.asarray(sj.restitution(NYLON.law, between).coefficient)
    error = np.max(np.abs(np.interp(between, *found[:, :2].T) - exact))
    assert 0.9 * told < error <= told < 2e-4


def test_a_table_has_two_rows_where_restitution_jumps(tmp_path):
    """At first yield ε² rises by 2d/3: below it is Eq. (17)'s, above there is a gain of energy."""
    law, at = NYLON.law, float(NYLON.law.contact.critical_velocity)
    blocks = with_knots(NYLON, Grid(0.5, 2.0, 10).blocks(4), (0.5, 2.0))
    _, found = table_of(NYLON, blocks, tmp_path / "c.txt")
    assert len(found) == 12
    assert np.all(np.diff(found[:, 0]) > 0)
    below, above = found[np.abs(found[:, 0] / at - 1) < 1e-9]
    assert below[0] < at < above[0]
    up = float(sj.empirical_restitution(at, law.contact.limit_velocity, law.sigma, law.psi))
    d = 1.5 * float(law.contact.critical_overlap) / (np.pi ** (2 / 3) * float(law.contact.radius))
    assert below[1] == pytest.approx(up, rel=1e-9)
    assert above[1] ** 2 - below[1] ** 2 == pytest.approx(2 * d / 3, rel=1e-4)
    assert above[2] ** 2 == pytest.approx(1 + 2 * d / 3, rel=1e-9)
    outside = np.concatenate(list(with_knots(NYLON, Grid(1.0, 2.0, 5).blocks(), (1.0, 2.0))))
    assert len(outside) == 5


def test_a_table_tells_what_happens_in_a_collision(tmp_path):
    """An elastic impact (Hertz's duration and force), and one computed in 40 digits."""
    d, X = 2.7e-3, 5.36
    law = law_with(d, X)
    contact = law.contact
    critical, depth = float(contact.critical_velocity), float(contact.critical_overlap)
    velocity = np.array([0.5, 25.0]) * critical
    _, found = table_of(Source("x", law, (0.1, 1.0)), [velocity], tmp_path / "c.txt")
    elastic, plastic = found
    force = float(contact.stiffness) * depth**1.5
    assert elastic[2] == 1
    assert elastic[4] == pytest.approx(0.5**0.8 * depth, rel=1e-12)
    assert elastic[3] == pytest.approx(2.9432751843 * elastic[4] / velocity[0], rel=1e-9)
    assert elastic[5] == pytest.approx(force * 0.5**1.2, rel=1e-12)
    x = 13.2236523303197
    assert plastic[2] == pytest.approx(0.973077876160826, rel=1e-12)
    assert plastic[4] == pytest.approx(x * depth, rel=1e-12)
    assert plastic[5] == pytest.approx(force * (x**1.5 + d * (x**2 - 1) * (1 - x**0.5)), rel=1e-12)


@pytest.mark.long
def test_the_peak_force_of_a_damped_law_is_that_of_its_motion(tmp_path):
    from scipy.integrate import solve_ivp

    law = sj.LinearSpringDashpot(pair("nylon"), 1e6, 0.3)
    _, found = table_of(Source("x", law, (0.1, 1.0)), [np.array([0.5, 2.0])], tmp_path / "c.txt")
    mass = float(law.contact.mass)
    loss = -np.log(0.3)
    damping = 2 * loss / np.hypot(np.pi, loss) * np.sqrt(1e6 * mass)

    def force(x, v):
        return 1e6 * x + damping * v

    for v, row in zip((0.5, 2.0), found, strict=True):
        path = solve_ivp(
            lambda t, y: [y[1], -force(*y) / mass], (0, row[3]), [0, v], rtol=1e-9, max_step=1e-6
        )
        assert row[5] == pytest.approx(np.max(force(*path.y)), rel=1e-3)


def test_a_law_without_a_force_has_two_columns(tmp_path):
    law = sj.ConstantRestitution(None, 0.75)
    header, found = table_of(Source("x", law, (1, 2)), [np.array([1.0, 2.0])], tmp_path / "c.txt")
    assert header[-1] == "# velocity[m/s] restitution"
    np.testing.assert_array_equal(found, [[1.0, 0.75], [2.0, 0.75]])


@pytest.mark.parametrize("name", ["ny\nlon 1 2", "ny\rlon", "ny\u2028lon", "ny\x85lon", "0.5 0.9"])
def test_what_a_material_is_called_makes_no_row_of_a_table(name, tmp_path):
    source = Source(name, sj.ConstantRestitution(None, 0.75), (1, 2))
    header, found = table_of(source, [np.array([1.0, 2.0])], tmp_path / "c.txt")
    lines = (tmp_path / "c.txt").read_text("utf-8").splitlines()
    assert len(lines) == len(header) + 2
    assert found.shape == (2, 2)


def test_a_table_takes_each_velocity_once_ascending(tmp_path):
    source = Source("x", sj.ConstantRestitution(None, 0.75), (1, 2))
    for blocks in ([[1.0, 1.0]], [[2.0, 1.0]], [[1.0, 2.0], [2.0, 3.0]]):
        with pytest.raises(InputError, match="ascend"):
            table_of(source, map(np.array, blocks), tmp_path / "c.txt")


def test_what_is_not_known_is_left_empty_and_out(tmp_path):
    rows = rows_of(4)._replace(coefficient=np.array([np.nan, np.nan, 0.9, 0.8]))
    rows = rows._replace(low=rows.coefficient - 0.1, high=rows.coefficient + 0.1)
    for name, kind in (("c.csv", CsvWriter), ("c.npy", NpyWriter)):
        writer = kind(tmp_path / name)
        writer.write(rows)
        writer.close()
    cells = [line.split(",") for line in (tmp_path / "c.csv").read_text("utf-8").splitlines()]
    assert [row[1:] for row in cells[1:3]] == [["", "", "", "NOT_KNOWN"]] * 2
    assert [float(row[1]) for row in cells[3:]] == [0.9, 0.8]
    assert [row[4] for row in cells[3:]] == ["NO_RESIDUAL_OVERLAP|ENERGY_GAIN", "PLAIN"]
    found = np.load(tmp_path / "c.npy")
    np.testing.assert_array_equal(np.isnan(found["restitution"]), [True, True, False, False])
    writer = TableWriter(tmp_path / "c.txt", Source("x", sj.ConstantRestitution(None, 0.9), (1, 2)))
    writer.write(rows)
    writer.close()
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "c.txt")[:, 0], rows.velocity[2:])
    seen = Span()
    seen.add(rows)
    assert (seen.rows, seen.known) == (4, 2)


def test_the_route_asked_for_is_taken():
    """One step of dopri5 a branch errs in the fifth digit, the energy balance in none."""
    velocity = np.array([2.0, 20.0])
    exact = evaluator(NYLON)(velocity).coefficient
    rough = evaluator(NYLON, sj.ODE(steps=1, solver="dopri5"))(velocity).coefficient
    assert 1e-9 < np.max(np.abs(rough - exact)) < 1e-3


def test_shorter_blocks_are_filled_up_to_the_longest():
    seen = []

    def evaluate(block):
        seen.append(len(block))
        return Rows(block, 2 * block, np.zeros(len(block), int))

    filled = in_one_size(evaluate)
    for count in (5, 256, 257, 3):
        rows = filled(np.arange(float(count)))
        np.testing.assert_array_equal(rows.coefficient, 2 * np.arange(count))
        assert rows.low is None
    assert seen == [256, 256, 512, 512]


def test_every_flag_has_its_name():
    assert status_names(0) == "PLAIN"
    assert status_names(int(sj.Status.NO_REBOUND | sj.Status.BEYOND_EXPANSION)) == (
        "NO_REBOUND|BEYOND_EXPANSION"
    )


def test_a_picture_takes_rows_from_all_of_a_long_curve():
    thinned = Thinned(most=100)
    for first in (0.0, 1000.0, 2000.0):
        thinned.add(rows_of(5000, first))
    kept = thinned.rows().velocity
    assert 40 <= len(kept) <= 100
    assert kept[0] == 0.0
    assert kept[-1] > 2600
    assert np.ptp(np.diff(np.sort(kept % 1000)[:20])) < 30
