"""Curves as text and numbers: digits, velocities in, rows out."""

import io
import sys

import numpy as np
import pytest

import softjax as sj
from calibration.curve.digits import text_of
from calibration.curve.picture import Thinned
from calibration.curve.source import Source
from calibration.curve.stream import Rows, Span, curve_rows
from calibration.curve.velocities import Column, Grid
from calibration.curve.writers import CsvWriter, NpyWriter, TableWriter, status_names
from calibration.errors import InputError
from tests.cases import fitted

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
        ("0.5\nfast\n", 2, "'fast' holds no velocity"),
        ("0.5\n\n-1\n", 3, "'-1' holds no velocity"),
        ("velocity\n1\nnan\n", 3, "'nan' holds no velocity"),
        ("restitution,velocity\n0.5,1\n0.5\n", 3, "'0.5' holds no velocity"),
        ("speed\n1\n", 1, "no column named velocity"),
        ("velocity [km/h]\n1\n", 1, "unit of velocity"),
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
    rows = list(curve_rows(NYLON, blocks, seen=seen))
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


def test_a_look_up_table_is_two_ascending_columns(tmp_path):
    path = tmp_path / "c.txt"
    writer = TableWriter(path, "nylon")
    rows = rows_of(6)
    writer.write(rows)
    with pytest.raises(InputError, match="ascend"):
        writer.write(rows)
    writer.close()
    found = np.loadtxt(path)
    np.testing.assert_array_equal(found, np.stack(rows[:2], axis=1))


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
