"""`fit.json` from anybody: what `softjax fit` cannot have written is refused in one line."""

import copy
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import calibration as cal

MORE = 20_000


@pytest.fixture(scope="module")
def genuine(tmp_path_factory):
    """A result with bodies and groups, as a table: all kinds of entries, little to compute."""
    folder = tmp_path_factory.mktemp("genuine")
    noise = 0.01 * np.random.default_rng(2).standard_normal(8)
    rows = zip(np.geomspace(0.5, 5.0, 8), 0.8 + noise, "aaabbbcc", strict=True)
    (folder / "a.csv").write_text("v,e,group\n" + "".join(f"{v},{e},{g}\n" for v, e, g in rows))
    text = 'name = "my alloy"\nmaterial = "nylon"\nradius = 0.0127\ndata = "a.csv"\n'
    wall = '[material.wall]\nmaterial = "stainless steel"\n'
    (folder / "m.toml").write_text("[[material]]\n" + text + wall)
    return json.loads(cal.fit(cal.read_toml(folder / "m.toml"), "constant").to_json())


def changed(table, place, value):
    """A copy with one entry set, or taken out where the value is `...`."""
    table = copy.deepcopy(table)
    *way, last = place
    inner = table
    for key in way:
        inner = inner[key]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return table


def refusal(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        cal.FitResult.load(path)
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) < 1000
    return line


def test_what_was_saved_loads_back(genuine, tmp_path):
    (tmp_path / "fit.json").write_text(json.dumps(genuine), encoding="utf-8")
    result = cal.FitResult.load(tmp_path / "fit.json")
    assert json.loads(result.to_json()) == genuine
    assert [body.radius for body in result.materials[0].data.bodies] == [0.0127, None]


FIT, DATA = "fits.0.", "fits.0.data."
# the place, what is put there, and what the line names
CRAFTED = [
    ("fits", [], "fits"),
    ("fits.0", [], "fits[0]|[]"),
    (DATA[:-1], None, "fits[0].data"),
    (DATA + "velocity", {}, "fits[0].data.velocity|{}"),
    (DATA + "restitution.2", -0.5, "fits[0].data.restitution|-0.5"),
    (DATA + "degrees", -3.0, "fits[0].data.degrees|-3"),
    (FIT + "rms", "1.0", "fits[0].rms|1.0|number"),
    (FIT + "rms", 10**400, "fits[0].rms|digits"),
    (FIT + "rms", True, "fits[0].rms|number"),
    (FIT + "residual_degrees", -1, "fits[0].residual_degrees|-1"),
    (FIT + "variances.group", -1e-4, "fits[0].variances.group|-0.0001"),
    (FIT + "leverage", [0.1], "fits[0].leverage|1|8"),
    (FIT + "n", 3, "8|3"),
    (FIT + "labels", {"x": "y"}, "fits[0].labels|x"),
    (FIT + "law", "os.system", "os.system|law"),
    (FIT + "known", [1], "fits[0].known|1"),
    (FIT + "material", "x" * 10_000, "fits[0].material|xxx"),
    ("confidence", 5, "confidence|5|0 and 1"),
    ("confidence", 0.5, "confidence|0.5|0.95"),
    ("request.confidence", 5, "request.confidence|5"),
    ("request.options.optimiser", "rm", "optimiser|rm"),
    ("request.route", {"name": "rk4"}, "request.route.name|rk4|one of"),
    ("request.route", {"name": "energy balance", "rtol": 1e-3}, "rtol"),
    ("freedom.0.relative.0.0", -1e-3, "freedom[0].relative|variance"),
    ("covariance.matrix.0.0", -1.0, "covariance.matrix|variance"),
    ("covariance.matrix.0", [1, 2], "covariance.matrix|[2]"),
    ("covariance_of_predictions.0.0", -1e-9, "covariance_of_predictions"),
    ("covariance", ..., "covariance|missing"),
    (FIT + "n", 2.5, "fits[0].n|2.5|whole"),
    ("warnings", [{"code": "x"}], "warnings[0].code|x|one of"),
]


@pytest.mark.parametrize(("place", "value", "words"), CRAFTED)
def test_a_crafted_entry_is_named(place, value, words, genuine, tmp_path):
    way = [int(part) if part.isdigit() else part for part in place.split(".")]
    line = refusal(tmp_path / "fit.json", json.dumps(changed(genuine, way, value)))
    assert line.startswith(str(tmp_path)) or place.endswith("law")  # one's own law is asked for
    for word in words.split("|"):
        assert word in line, line


BYTES = {
    "[" * 100_000: "deep",
    "{'fits': 1}": "fit.json:1: ",
    '{\n"fits": [}': "fit.json:2: ",
    '{"fits": NaN}': "NaN",
    '{"fits": 1' + "0" * 5000 + "}": "limit",
    '{"fits": 1e999}': "fits",
    '{"fits": "\\ud800"}': r"\ud800",
    b'{"fits": "\xfc"}': "UTF-8",
    b" " * 26_000_000: "24 MiB",
    '{"fits": [' + "[]," * 100_000 + "[]]}": "fits[0]",
}


@pytest.mark.parametrize("text", BYTES, ids=range(len(BYTES)))
def test_what_is_no_json_of_a_fit(text, tmp_path):
    assert BYTES[text] in refusal(tmp_path / "fit.json", text)


VALUES = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.integers(-2, 9),
        st.floats(allow_nan=False),
        st.floats(0, 1 - 2**-53),
        st.text(max_size=8),
        st.sampled_from(["zhou", "hertz", "constant", "model", "my alloy", "restitution", "1"]),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=5,
)


def places(table, way=()):
    """All entries, by the way to them."""
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in items:
        yield (*way, key)
        if isinstance(value, dict | list):
            yield from places(value, (*way, key))


def outcome(path):
    """The band of a result that loads and works, or the refusal."""
    try:
        result = cal.FitResult.load(path)
        band = result.band(np.array([0.5, 2.0, 1e-3]), result.materials[0].name)
        str(result)
        result.to_json()
    except (cal.InputError, cal.DataError) as error:
        return None, str(error)
    return band, ""


def loaded_or_one_line(path):
    band, line = outcome(path)
    assert line.isprintable()
    assert len(line) < 2000
    if band is not None:
        determined = np.isfinite(band.low)
        assert np.all(band.low[determined] <= band.high[determined])


CHANGES = st.lists(
    st.tuples(st.integers(0, 10_000), VALUES, st.sampled_from([False, False, False, True])),
    min_size=1,
    max_size=2,
)
CUTS = st.lists(st.tuples(st.integers(0, 100_000), st.binary(max_size=3)), min_size=1, max_size=4)


@pytest.mark.parametrize("count", [400, pytest.param(MORE, marks=pytest.mark.long)])
def test_any_entry_or_byte_changed(count, genuine, tmp_path):
    path, whole = tmp_path / "fit.json", json.dumps(genuine).encode()

    @settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )
    @given(CHANGES | CUTS)
    def check(changes):
        table, raw = genuine, whole
        for place, new, *out in changes:
            every = list(places(table))
            if out and every:
                table = changed(table, every[place % len(every)], ... if out[0] else new)
                raw = json.dumps(table).encode()
            elif not out:
                at = place % len(raw)
                raw = raw[:at] + new + raw[at + len(new) :]
        path.write_bytes(raw)
        loaded_or_one_line(path)

    check()
