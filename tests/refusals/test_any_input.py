"""Bytes, tables and structures drawn at random: a set of data, or one line; never anything else."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import calibration as cal

MORE = 20_000


def drawn(strategy, few=150):
    """A test of each of some hundred examples; in its long form of many more."""

    def decorate(check):
        def of(count):
            return settings(
                max_examples=count,
                deadline=None,
                derandomize=True,
                # each example writes its file anew
                suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
            )

        @of(few)
        @given(strategy)
        def test(tmp_path, example):
            check(tmp_path, example)

        @pytest.mark.long
        @of(MORE)
        @given(strategy)
        def many(tmp_path, example):
            check(tmp_path, example)

        return test, many

    return decorate


def outcome(read, argument):
    """The data sets, or the refusal."""
    try:
        found = read(argument)
    except (cal.InputError, cal.DataError) as error:
        return [], str(error)
    return found if isinstance(found, list) else [found], ""


def accepted_or_one_line(read, argument, folder=None):
    """What is read is sound; what is not is refused in one line, which names the file if there is one."""
    found, line = outcome(read, argument)
    assert line.isprintable()
    assert len(line) < 2000
    assert bool(line) != bool(found)
    # a file of data may be named by where it lies, wherever that is
    assert not line or folder is None or line.startswith((str(folder), "/dev/"))
    for data in found:
        check_sound(data)


def check_sound(data):
    n = len(data)
    assert np.all((data.velocity > 0) & np.isfinite(data.velocity))
    stated = 0.0 if data.uncertainty is None else 4.001 * data.uncertainty
    assert np.all((data.restitution >= 0) & (data.restitution <= 1 + np.maximum(0.5, stated)))
    for column in (data.uncertainty, data.velocity_uncertainty, data.group):
        assert column is None or column.shape == (n,)
    assert all(note.isprintable() for note in data.notes)
    assert repr(data).isprintable()
    size = 0.001 if data.errors.size_is_unknown else None
    assert data.covariance_of(-0.1, size=size, added=1e-6).diagonal.shape == (n,)
    cal.plausibility(data)


NUMBERS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.floats(0.01, 3.0).map(lambda x: f"{x:.3f}"),
    st.floats(0.01, 3.0).map(lambda x: f"{x:.3f}".replace(".", ",")),
    st.sampled_from(
        ["", " ", "NA", "1_0", "1 000", "1.234,5", "0x1", "85%", "٣", "1e999", "-0", "+.5e-3"]
    ),
)
NAMES = (
    "e ε COR v speed v_in v_out h0 hf dt time launch group specimen uncertainty ± u_v u(v) σ_t u "
    "height_uncertainty timing_uncertainty t h h1 h2 v1 note velocty EU vu #"
)
UNITS = "m/s cm/s mm_s km/h m mm in µm s ms us % - °C Pa [ )"
FORMS = "{0}|{0}|{0} [{1}]|{0} ({1})|{0} / {1}|{0}_{1}|{0} [{1}"
HEADERS = st.builds(
    lambda word, form, unit: form.format(word, unit),
    st.sampled_from(NAMES.split()) | st.text(max_size=12),
    st.sampled_from(FORMS.split("|")),
    st.sampled_from([*UNITS.split(), ""]),
)
SETS = st.sampled_from(
    [["velocity", "restitution"], ["v_in", "v_out"], ["h0", "h1"], ["interval"], ["time"]]
)


@st.composite
def csv_texts(draw):
    """A header of columns that may go together, and rows of cells that may be numbers."""
    headers = [*draw(SETS), *draw(st.lists(HEADERS, max_size=4))]
    cells, width = NUMBERS | st.text(max_size=5), len(headers)
    rows = draw(st.lists(st.lists(cells, min_size=width, max_size=width + 1), max_size=6))
    if draw(st.booleans()):  # mostly sound, so that more than the reader is met
        rows = [[f"{draw(st.floats(0.3, 0.9)):.4f}" for _ in headers] for _ in range(6)]
    lines = [draw(st.sampled_from(",;\t")).join(row) for row in [headers, *rows]]
    text = draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines)
    return text.encode(
        draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"])), "replace"
    )


@drawn(st.binary(max_size=200) | csv_texts(), 250)
def _csv(tmp_path, raw):
    (tmp_path / "a.csv").write_bytes(raw)
    accepted_or_one_line(cal.read_csv, tmp_path / "a.csv", tmp_path)


test_any_csv, test_any_csv_many = _csv

EVERY_KEY = (
    "name data material youngs_modulus poisson_ratio density yield_strength radius radius_1 radius_2 "
    "diameter diameter_1 wall second area limit_velocity uncertainty velocity_uncertainty gravity "
    "interval_uncertainty average_repeats parameters fit x"
)
KEYS = st.sampled_from(EVERY_KEY.split())
WORDS_OF_FILES = ["a.csv", "nylon", "zhou", "pooled", "69 GPa", "12 mm", "2 %", "/dev/zero", ".."]
VALUES = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(),
        st.integers(1, 10),
        st.floats(allow_nan=False, allow_infinity=False),
        st.floats(1e-3, 10.0),
        st.text(max_size=8),
        st.sampled_from(WORDS_OF_FILES),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=8,
)


def as_toml(value):
    """A value as TOML; JSON's texts are TOML's but for DEL, which is taken out."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {as_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, float):
        return f"{value:.17e}"
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
    accepted_or_one_line(cal.read_toml, tmp_path / "m.toml", tmp_path)


test_any_material_file, test_any_material_file_many = _toml

CELLS = st.floats() | st.floats(0.1, 1.0)
COLUMNS = st.dictionaries(HEADERS, st.lists(CELLS, max_size=5), max_size=4)


@drawn(st.tuples(SETS, COLUMNS, st.lists(CELLS, min_size=4, max_size=4)))
def _table(tmp_path, told):
    names, others, values = told
    accepted_or_one_line(cal.RestitutionData.from_table, others | dict.fromkeys(names, values))


test_any_table, test_any_table_many = _table


@example("\ufeffv;e\r\n")
@example('"""')
@example("[[material]]\ndata = '\x1b[31m'")
@given(st.text(alphabet="v,e;\t\n\r\"'#[]{}=.1 -\ufeff\x1b", max_size=60))
@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_any_punctuation(tmp_path, text):
    for name, read in (("a.csv", cal.read_csv), ("a.toml", cal.read_toml)):
        (tmp_path / name).write_bytes(text.encode())
        accepted_or_one_line(read, tmp_path / name, tmp_path)
