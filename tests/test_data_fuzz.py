"""Bytes, tables and structures drawn at random: a set of data, or one line; never anything else."""

import json
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from calibration.data import RestitutionData, plausibility, read_csv, read_toml
from calibration.data.names import DIMENSIONS, KNOWN
from calibration.data.units import UNITS
from calibration.errors import DataError, InputError

MORE = 20_000
SHARED_FOLDER = [HealthCheck.function_scoped_fixture]  # each example writes its file anew


def drawn(strategy):
    """A test of each of some hundred examples; in its long form of many more."""

    def decorate(check):
        @settings(max_examples=150, deadline=None, suppress_health_check=SHARED_FOLDER)
        @given(strategy)
        def test(tmp_path, example):
            check(tmp_path, example)

        @pytest.mark.long
        @settings(max_examples=MORE, deadline=None, suppress_health_check=SHARED_FOLDER)
        @given(strategy)
        def many(tmp_path, example):
            check(tmp_path, example)

        return test, many

    return decorate


def accepted_or_one_line(read, path):
    """What is read is sound; what is not is refused in one line that names the file."""
    found, line = outcome(read, path)
    assert line.isprintable()
    assert len(line) < 2000
    # a file of data may be named by where it lies, wherever that is
    assert line.startswith((str(path.parent), "/dev/")) == (found is None)
    for data in found or []:
        check_sound(data)


def outcome(read, argument):
    """The data sets, or the refusal."""
    try:
        found = read(argument)
    except (InputError, DataError) as error:
        return None, str(error)
    return found if isinstance(found, list) else [found], ""


def check_sound(data):
    n = len(data)
    assert np.all((data.velocity > 0) & np.isfinite(data.velocity))
    stated = 0.0 if data.uncertainty is None else 4.001 * data.uncertainty
    assert np.all((data.restitution >= 0) & (data.restitution <= 1 + np.maximum(0.5, stated)))
    for column in (data.uncertainty, data.velocity_uncertainty, data.group):
        assert column is None or column.shape == (n,)
    assert len(data.errors) == n
    assert all(note.isprintable() for note in data.notes)
    assert repr(data).isprintable()
    size = 0.001 if data.errors.size_is_unknown else None
    assert data.covariance_of(-0.1, size=size, added=1e-6).diagonal.shape == (n,)
    plausibility(data)


NUMBERS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.floats(0.01, 3.0).map(lambda x: f"{x:.3f}"),
    st.floats(0.01, 3.0).map(lambda x: f"{x:.3f}".replace(".", ",")),
    st.sampled_from(
        ["", " ", "1_0", "1 000", "1.234,5", "0x1", "85%", "٣", "1e999", "-0", "+.5e-3"]
    ),
)
WORDS = st.one_of(
    st.sampled_from(sorted({*KNOWN, *DIMENSIONS})),
    st.sampled_from(["t", "h", "h1", "h2", "v1", "note", "velocty", "u(v)", "σ_t", "", "#"]),
    st.text(max_size=12),
)
SIZES = st.sampled_from(sorted({unit for units in UNITS.values() for unit in units} | {"°C", ""}))
HEADERS = st.builds(
    lambda word, form, unit: form.format(word, unit),
    WORDS,
    st.sampled_from(["{0}", "{0}", "{0} [{1}]", "{0} ({1})", "{0} / {1}", "{0}_{1}", "{0} [{1}"]),
    SIZES,
)
SETS = st.sampled_from(
    [["velocity", "restitution"], ["v_in", "v_out"], ["h0", "h1"], ["interval"], ["time"]]
)


@st.composite
def csv_texts(draw):
    """A header of columns that may go together, and rows of cells that may be numbers."""
    headers = [*draw(SETS), *draw(st.lists(HEADERS, max_size=4))]
    delimiter = draw(st.sampled_from([",", ";", "\t"]))
    rows = draw(
        st.lists(
            st.lists(
                NUMBERS | st.text(max_size=5), min_size=len(headers), max_size=len(headers) + 1
            ),
            max_size=6,
        )
    )
    if draw(st.booleans()):  # mostly sound, so that more than the reader is met
        rows = [[f"{draw(st.floats(0.3, 0.9)):.4f}" for _ in headers] for _ in range(6)]
    lines = [delimiter.join(row) for row in [headers, *rows]]
    return draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines)


@drawn(st.binary(max_size=200))
def _bytes(tmp_path, raw):
    for name, read in (("a.csv", read_csv), ("a.toml", read_toml)):
        (tmp_path / name).write_bytes(raw)
        accepted_or_one_line(read, tmp_path / name)


test_any_bytes, test_any_bytes_many = _bytes


@drawn(st.tuples(csv_texts(), st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"])))
def _csv(tmp_path, told):
    text, encoding = told
    (tmp_path / "a.csv").write_bytes(text.encode(encoding, "replace"))
    accepted_or_one_line(read_csv, tmp_path / "a.csv")


test_any_csv, test_any_csv_many = _csv

KEYS = st.sampled_from(
    [
        "name",
        "data",
        "material",
        "youngs_modulus",
        "poisson_ratio",
        "density",
        "yield_strength",
        "radius",
        "radius_1",
        "radius_2",
        "diameter",
        "diameter_1",
        "wall",
        "second",
        "area",
        "limit_velocity",
        "uncertainty",
        "velocity_uncertainty",
        "gravity",
        "interval_uncertainty",
        "average_repeats",
        "parameters",
        "fit",
        "x",
    ]
)
VALUES = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(),
        st.integers(1, 10),
        st.floats(allow_nan=False, allow_infinity=False),
        st.floats(1e-3, 10.0),
        st.text(max_size=8),
        st.sampled_from(
            ["a.csv", "nylon", "zhou", "pooled", "69 GPa", "12 mm", "2 %", "/dev/zero", ".."]
        ),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=8,
)


def as_toml(value):
    """A value as TOML; JSON's texts are TOML's but for halves of characters, which text() has none of."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {as_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, float):
        return f"{value:.17e}" if math.isfinite(value) else "nan"
    return json.dumps(value).replace("\\u007f", "").replace("\x7f", "")


GOOD = {"material": "nylon", "radius": 0.01, "data": "a.csv"}


@drawn(st.lists(st.dictionaries(KEYS, VALUES, max_size=6), min_size=1, max_size=2))
def _toml(tmp_path, materials):
    (tmp_path / "a.csv").write_text("velocity,restitution\n1.0,0.9\n1.0,0.8\n2.0,0.7\n")
    lines = []
    for i, entry in enumerate(materials):
        told = {"name": f"m{i}"} | (GOOD | entry if i else entry)
        lines += ["[[material]]", *(f"{key} = {as_toml(value)}" for key, value in told.items())]
    (tmp_path / "m.toml").write_text("\n".join(lines), encoding="utf-8")
    accepted_or_one_line(read_toml, tmp_path / "m.toml")


test_any_material_file, test_any_material_file_many = _toml

COLUMNS = st.dictionaries(
    HEADERS, st.lists(st.floats() | st.floats(0.1, 1.0), max_size=5), max_size=4
)


@drawn(
    st.tuples(SETS, COLUMNS, st.lists(st.floats(0.1, 1.0) | st.floats(), min_size=4, max_size=4))
)
def _table(tmp_path, told):
    names, others, values = told
    table = others | dict.fromkeys(names, values)
    found, line = outcome(RestitutionData.from_table, table)
    assert len(line) < 2000
    for data in found or []:
        check_sound(data)


test_any_table, test_any_table_many = _table


@example("\ufeffv;e\r\n")
@example('"""')
@example("[[material]]\ndata = '\x1b[31m'")
@given(st.text(alphabet="v,e;\t\n\r\"'#[]{}=.1 -\ufeff\x1b", max_size=60))
@settings(max_examples=150, deadline=None, suppress_health_check=SHARED_FOLDER)
def test_any_punctuation(tmp_path, text):
    for name, read in (("a.csv", read_csv), ("a.toml", read_toml)):
        (tmp_path / name).write_bytes(text.encode())
        accepted_or_one_line(read, tmp_path / name)
