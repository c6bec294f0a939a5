"""Bytes, tables and structures drawn at random: a set of data, or one line; never anything else."""

import json

import numpy as np
from hypothesis import strategies as st

import calibration as cal
from tests.covariance import covariance_of
from tests.drawn import some_and_many
from tests.refusals.table import changed, genuine


def accepted_or_one_line(read, argument, folder=None):
    """What is read is sound; what is not is refused in one line, which names the file if there is one."""
    try:
        found = read(argument)
    except (cal.InputError, cal.DataError) as error:
        for fault in str(error).split("\n"):  # of a material file all are listed
            check_line(fault)
            # a file of data may be named by where it lies, wherever that is
            assert folder is None or fault.startswith((str(folder), "/dev/"))
        return
    assert found
    for data in found if isinstance(found, list) else [found]:
        check_sound(data)


def check_line(line):
    assert line.isprintable()
    assert 0 < len(line) < 2000


def check_sound(data):
    n = len(data)
    assert np.all((data.velocity > 0) & np.isfinite(data.velocity))
    stated = 0.0 if data.uncertainty is None else 4.001 * data.uncertainty
    assert np.all((data.restitution >= 0) & (data.restitution <= 1 + np.maximum(0.5, stated)))
    for column in (data.uncertainty, data.velocity_uncertainty, data.group):
        assert column is None or column.shape == (n,)
    assert all(note.isprintable() for note in data.notes)
    assert repr(data).isprintable()
    assert covariance_of(data, -0.1, size=0.001, added=1e-6).shape == (n, n)
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


PUNCTUATION = st.text(alphabet="v,e;\t\n\r\"'#[]{}=.1 -\ufeff\x1b", max_size=60).map(str.encode)


@some_and_many(60, st.binary(max_size=200) | PUNCTUATION | csv_texts())
def test_any_bytes(tmp_path, raw):
    for name, read in (("a.csv", cal.read_csv), ("a.toml", cal.read_toml)):
        (tmp_path / name).write_bytes(raw)
        accepted_or_one_line(read, tmp_path / name, tmp_path)


EVERY_KEY = (
    "name data material youngs_modulus poisson_ratio density yield_strength radius radius_1 radius_2 "
    "diameter diameter_1 wall second area limit_velocity uncertainty velocity_uncertainty gravity "
    "interval_uncertainty average_repeats parameters fit x"
)
KEYS = st.sampled_from(EVERY_KEY.split())
WORDS_OF_FILES = ["a.csv", "nylon", "zhou", "pooled", "69 GPa", "12 mm", "2 %", "/dev/zero", ".."]


def nested(keys, *leaves):
    """Truth values, numbers and words, and lists and tables of them."""
    some = st.one_of(st.booleans(), st.integers(), st.text(max_size=8), *leaves)
    parts = lambda some: st.lists(some, max_size=3) | st.dictionaries(keys, some, max_size=4)  # noqa: E731
    return st.recursive(some, parts, max_leaves=8)


FINITE = st.floats(allow_nan=False, allow_infinity=False)
WORDS = st.sampled_from(WORDS_OF_FILES)
VALUES = nested(KEYS, st.integers(1, 10), FINITE, st.floats(1e-3, 10.0), WORDS)


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


@some_and_many(50, st.lists(st.dictionaries(KEYS, VALUES, max_size=6), min_size=1, max_size=2))
def test_any_material_file(tmp_path, materials):
    (tmp_path / "a.csv").write_text("velocity,restitution\n1.0,0.9\n1.0,0.8\n2.0,0.7\n")
    lines = []
    for i, entry in enumerate(materials):
        table = {"name": f"m{i}"} | (GOOD | entry if i else entry)
        lines += ["[[material]]", *(f"{key} = {as_toml(value)}" for key, value in table.items())]
    (tmp_path / "m.toml").write_text("\n".join(lines), encoding="utf-8")
    accepted_or_one_line(cal.read_toml, tmp_path / "m.toml", tmp_path)


CELLS = st.floats() | st.floats(0.1, 1.0)
COLUMNS = st.dictionaries(HEADERS, st.lists(CELLS, max_size=5), max_size=4)


@some_and_many(50, st.tuples(SETS, COLUMNS, st.lists(CELLS, min_size=4, max_size=4)))
def test_any_table(tmp_path, table):
    names, others, values = table
    accepted_or_one_line(cal.RestitutionData.from_table, others | dict.fromkeys(names, values))


WORDS = st.sampled_from(["zhou", "hertz", "constant", "model", "my alloy", "restitution", "1"])
NUMBERS_OF_RESULTS = (st.integers(-2, 9), st.floats(allow_nan=False), st.floats(0, 1 - 2**-53))
ENTRIES = nested(st.text(max_size=4), st.none(), *NUMBERS_OF_RESULTS, WORDS)


def places(table, way=()):
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in items:
        yield (*way, key)
        if isinstance(value, dict | list):
            yield from places(value, (*way, key))


ENTRY = st.tuples(st.integers(0, 10_000), ENTRIES, st.sampled_from([False, False, False, True]))
CUT = st.tuples(st.integers(0, 100_000), st.binary(max_size=3))


@some_and_many(100, st.lists(ENTRY, min_size=1, max_size=2) | st.lists(CUT, min_size=1, max_size=4))
def test_any_result(tmp_path, changes):
    table, raw = genuine(), json.dumps(genuine()).encode()
    for place, new, *out in changes:
        every = list(places(table))
        if out and every:
            table = changed(table, every[place % len(every)], ... if out[0] else new)
            raw = json.dumps(table).encode()
        elif not out:
            at = place % len(raw)
            raw = raw[:at] + new + raw[at + len(new) :]
    (tmp_path / "fit.json").write_bytes(raw)
    try:
        result = cal.FitResult.load(tmp_path / "fit.json")
        band = result.band(np.array([0.5, 2.0, 1e-3]), result.materials[0].name)
        assert str(result)
        result.to_json()
    except (cal.InputError, cal.DataError) as error:
        check_line(str(error))
    else:
        determined = np.isfinite(band.low)
        assert np.all(band.low[determined] <= band.high[determined])
