"""`fit.json` from anybody: what `softjax fit` cannot have written is refused in one line."""

import copy
import json
import os
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import calibration as cal
from calibration.errors import DataError, InputError
from tests.cases import pair

SECONDS = 10.0
MORE = 20_000
BELOW_1 = 1 - 2**-53


@pytest.fixture(scope="module")
def genuine():
    """A result with a group, as a table: all kinds of entries, little to compute."""
    velocity = np.geomspace(0.5, 5.0, 8)
    rng = np.random.default_rng(2)
    data = cal.RestitutionData(
        velocity,
        0.8 + 0.01 * rng.standard_normal(8),
        pair("nylon"),
        name="my alloy",
        group=["a", "a", "a", "b", "b", "b", "c", "c"],
    )
    return json.loads(cal.fit(data, "constant").to_json())


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
    """The one line, and that within the time."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        cal.FitResult.load(path)
    assert time.process_time() - begun < SECONDS
    line = str(caught.value)
    assert line.startswith(str(path))
    assert line.isprintable()
    assert len(line) < 1000
    return line


def test_what_was_saved_loads_back(genuine, tmp_path):
    (tmp_path / "fit.json").write_text(json.dumps(genuine), encoding="utf-8")
    assert json.loads(cal.FitResult.load(tmp_path / "fit.json").to_json()) == genuine


FIT = ("fits", 0)
CRAFTED = {
    "data: null": ((*FIT, "data"), None, "fits[0].data is None; it must be a table of names"),
    "columns: {}": ((*FIT, "data", "velocity"), {}, "fits[0].data.velocity is {}"),
    "a text for a number": ((*FIT, "rms"), "1.0", "fits[0].rms is 1.0; it must be a finite"),
    "a list for a table": (FIT, [], "fits[0] is []; it must be a table of names"),
    "nothing": (("fits",), [], "fits is of 0"),
    "beyond float": ((*FIT, "rms"), 10**400, "fits[0].rms is a whole number of more than 100"),
    "confidence 5": (("confidence",), 5, "confidence is 5; it must be a number between 0 and 1"),
    "the request's too": (("request", "confidence"), 5, "request.confidence is 5"),
    "two confidences": (("confidence",), 0.5, "confidence is 0.5; it must be 0.95"),
    "negative degrees": ((*FIT, "residual_degrees"), -1, "fits[0].residual_degrees is -1"),
    "degrees of points": ((*FIT, "data", "degrees"), -3.0, "fits[0].data.degrees is -3"),
    "of a variance": (("freedom", 0, "relative", 0, 0), -1e-3, "freedom[0].relative is with a"),
    "variance": (("covariance", "matrix", 0, 0), -1.0, "covariance.matrix is with a variance of"),
    "of predictions": (("covariance_of_predictions", 0, 0), -1e-9, "covariance_of_predictions is"),
    "of scatter": ((*FIT, "variances", "group"), -1e-4, "fits[0].variances.group is -0.0001"),
    "no square": (("covariance", "matrix", 0), [1, 2], "covariance.matrix is rows of [2]"),
    "other lengths": ((*FIT, "leverage"), [0.1], "fits[0].leverage is of 1; it must be 8"),
    "n": ((*FIT, "n"), 3, "fits[0].data.velocity is of 8; it must be 3"),
    "a label of nothing": ((*FIT, "labels"), {"x": "y"}, "fits[0].labels is x: y"),
    "an unknown law": ((*FIT, "law"), "os.system", "os.system"),
    "no pair": ((*FIT, "known"), [1], "fits[0].known is of 1"),
    "negative ε": ((*FIT, "data", "restitution", 2), -0.5, "fits[0].data.restitution[2] is -0.5"),
    "a long name": ((*FIT, "material"), "x" * 10_000, "fits[0].material is xxx"),
    "an optimiser": (("request", "options", "optimiser"), "rm", "optimiser is rm"),
    "a route": (
        ("request", "route"),
        {"name": "rk4"},
        "request.route.name is rk4; it must be one of",
    ),
    "an option of another route": (
        ("request", "route"),
        {"name": "energy balance", "rtol": 1e-3},
        "rtol",
    ),
    "something missing": (("covariance",), ..., "covariance is missing"),
    "a doubt": (("warnings",), [{"code": "x"}], "warnings[0].code is x; it must be one of"),
}


@pytest.mark.parametrize("name", CRAFTED)
def test_a_crafted_entry_is_named(name, genuine, tmp_path):
    place, value, told = CRAFTED[name]
    path = tmp_path / "fit.json"
    if name == "an unknown law":  # which may be one's own: it is asked for, and never imported
        path.write_text(json.dumps(changed(genuine, place, value)), encoding="utf-8")
        with pytest.raises(DataError, match=r"`law` must be given: load\(path, law=…\), but is os"):
            cal.FitResult.load(path)
        return
    line = refusal(path, json.dumps(changed(genuine, place, value)))
    assert told in line
    assert "fit.json is accepted" in line


HUGE = {
    "deep": ("[" * 100_000, "nested too deeply"),
    "deep tables": ('{"a":' * 100_000, "nested too deeply"),
    "no JSON": ("{'fits': 1}", "fit.json:1: no valid JSON"),
    "NaN": ('{"fits": NaN}', "no valid JSON: NaN is no number"),
    "5000 digits": ('{"fits": 1' + "0" * 5000 + "}", "no valid JSON: Exceeds the limit"),
    "1e999": ('{"fits": 1e999}', "fits is inf; it must be a list"),
    "a half character": ('{"fits": "\\ud800"}', "fits is \\ud800; it must be a list"),
    "no UTF-8": (b'{"fits": "\xfc"}', "is not UTF-8 text"),
    "26 MB": (b" " * 26_000_000, "is larger than 24 MiB"),
    "6 MB of lists": ('{"fits": [' + "[]," * 2_000_000 + "[]]}", "fits[0] is []"),
    "many keys": (json.dumps({f"k{i}": i for i in range(200_000)}), "fits is missing"),
}


@pytest.mark.parametrize("name", HUGE)
def test_a_file_that_would_exhaust_a_parser(name, tmp_path):
    text, told = HUGE[name]
    assert told in refusal(tmp_path / "fit.json", text)


def test_what_is_no_regular_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, told in ((tmp_path / "pipe", "is a device or a pipe"), (tmp_path, "is a directory")):
        with pytest.raises(InputError, match=told):
            cal.FitResult.load(path)


VALUES = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.integers(-2, 9),
        st.floats(allow_nan=False),
        st.floats(0, BELOW_1),
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


def loaded_or_one_line(path):
    """A result that works, or one line that names the file (or a law that is not given)."""
    begun = time.process_time()
    band, line = outcome(path)
    assert time.process_time() - begun < SECONDS
    assert line.isprintable()
    assert len(line) < 2000
    if band is not None:
        known = np.isfinite(band.low)
        assert np.all(band.low[known] <= band.high[known])


def outcome(path):
    """The band of a result that loads and works, or the refusal."""
    try:
        result = cal.FitResult.load(path)
        band = result.band(np.array([0.5, 2.0, 1e-3]), result.materials[0].name)
        str(result)
        result.to_json()
    except (InputError, DataError) as error:
        return None, str(error)
    return band, ""


def written(path, genuine, changes):
    table = genuine
    for pick, value, out in changes:
        every = list(places(table))
        if every:
            table = changed(table, every[pick % len(every)], ... if out else value)
    path.write_text(json.dumps(table), encoding="utf-8")


CHANGES = st.lists(
    st.tuples(st.integers(0, 10_000), VALUES, st.sampled_from([False, False, False, True])),
    min_size=1,
    max_size=2,
)
CUTS = st.lists(st.tuples(st.integers(0, 100_000), st.binary(max_size=3)), max_size=4)


def at_most(count):
    return settings(
        max_examples=count,
        deadline=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )


@pytest.mark.parametrize(
    "count", [700, pytest.param(MORE, marks=pytest.mark.long)], ids=["some", "many"]
)
def test_any_entry_changed(count, genuine, tmp_path):
    @at_most(count)
    @given(CHANGES)
    def check(changes):
        written(tmp_path / "fit.json", genuine, changes)
        loaded_or_one_line(tmp_path / "fit.json")

    check()


@pytest.mark.parametrize(
    "count", [400, pytest.param(MORE, marks=pytest.mark.long)], ids=["some", "many"]
)
def test_any_bytes_changed(count, genuine, tmp_path):
    whole = json.dumps(genuine).encode()

    @at_most(count)
    @given(CUTS)
    def check(cuts):
        raw = whole
        for place, new in cuts:
            at = place % len(raw)
            raw = raw[:at] + new + raw[at + len(new) :]
        (tmp_path / "fit.json").write_bytes(raw)
        loaded_or_one_line(tmp_path / "fit.json")

    check()
