"""One experiment stated in many ways is one set of data: from Python, CSV and TOML, in any unit and order."""

import numpy as np
import pytest
from hypothesis import strategies as st

import calibration as cal
from tests.drawn import drawn

G = 9.80665
# two bounce sequences, of which every way to tell it holds the same
TIMES = [np.array([0.1, 0.9, 1.66, 2.36, 3.0]), np.array([0.2, 0.8, 1.37, 1.91])]
INTERVALS = [np.diff(times) for times in TIMES]
VELOCITY = np.concatenate([G * t[:-1] / 2 for t in INTERVALS])
RESTITUTION = np.concatenate([t[1:] / t[:-1] for t in INTERVALS])
AFTER = VELOCITY * RESTITUTION
LAUNCH = ["A", "A", "A", "B", "B"]


def labels(parts):
    return [name for name, part in zip("AB", parts, strict=True) for _ in part]


def csv(table):
    rows = [",".join(str(cell) for cell in row) for row in zip(*table.values(), strict=True)]
    return "\n".join([",".join(table), *rows]) + "\n"


WAYS = {
    "velocity": {"v": VELOCITY, "e": RESTITUTION, "group": LAUNCH},
    "percent": {"v (km/h)": 3.6 * VELOCITY, "COR [%]": 100 * RESTITUTION, "specimen": LAUNCH},
    "velocities": {"v_in": VELOCITY, "v_out": AFTER, "launch": LAUNCH},
    "heights": {
        "drop height / mm": 1000 * VELOCITY**2 / (2 * G),
        "rebound height / in": AFTER**2 / (2 * G) / 0.0254,
        "group": LAUNCH,
    },
    "intervals": {"launch": labels(INTERVALS), "dt [ms]": 1000 * np.concatenate(INTERVALS)},
    "times": {"time [µs]": 1e6 * np.concatenate(TIMES), "launch": labels(TIMES)},
}
MATERIAL = '[[material]]\nname = "a"\ndata = "m.csv"\n'


@pytest.mark.parametrize("way", WAYS)
def test_one_experiment_in_all_ways_and_by_every_reader(way, read, read_toml):
    text = csv(WAYS[way])
    found = [
        read(text),
        cal.RestitutionData.from_table(WAYS[way], name="a"),
        *read_toml(MATERIAL, text),
    ]
    for data in found:
        np.testing.assert_allclose(data.velocity, VELOCITY, rtol=1e-12)
        np.testing.assert_allclose(data.restitution, RESTITUTION, rtol=1e-12)
        assert list(data.group) == LAUNCH
    assert found[0].remarks == found[2].remarks


def decimal(comma):
    return lambda x: repr(x).replace(".", ",") if comma else repr(x)


@drawn(
    120,
    points=st.lists(
        st.tuples(st.floats(0.01, 50.0), st.floats(0.05, 0.99), st.floats(1e-3, 0.1)),
        min_size=1,
        max_size=8,
    ),
    unit=st.sampled_from(
        [("m/s", 1.0), ("cm/s", 0.01), ("mm s⁻¹", 0.001), ("km/h", 1 / 3.6), ("ft/s", 0.3048)]
    ),
    ratio=st.sampled_from([("-", 1.0), ("%", 0.01)]),
    style=st.sampled_from([(",", False), (";", False), (";", True), ("\t", True), ("\t", False)]),
    units_below=st.booleans(),
    order=st.permutations(range(4)),
    noise=st.lists(st.sampled_from(["", "# comment, 1; 2"]), min_size=9, max_size=9),
    newline=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_a_table_in_any_unit_style_and_order_is_read_alike(
    read, points, unit, ratio, style, units_below, order, noise, newline
):
    """Units, decimals, separators, columns, comments and line ends: no number and no line depends on it."""
    delimiter, comma = style
    number = decimal(comma)
    v, e, u = (np.array(column) for column in zip(*points, strict=True))
    names = [
        ("velocity", unit),
        ("restitution", ratio),
        ("uncertainty", ratio),
        ("note", ("text", None)),
    ]
    columns = [
        *((v / unit[1]).tolist(), (e / ratio[1]).tolist(), (u / ratio[1]).tolist()),
        ["x"] * len(v),
    ]
    cells = [[number(x) if isinstance(x, float) else x for x in column] for column in columns]
    header = [name if units_below else f"{name} [{size[0]}]" for name, size in names]
    rows = [header, *([[f"[{size[0]}]" for _, size in names]] if units_below else [])]
    rows += [list(row) for row in zip(*cells, strict=True)]
    lines, places = [], []
    for i, row in enumerate(rows):
        lines += [one for one in [noise[i % 9]] if i % 2 == 0 or one]
        lines.append(delimiter.join(row[k] for k in order))
        places.append(len(lines))
    data = read(newline.join(lines) + newline)
    np.testing.assert_allclose(
        [data.velocity, data.restitution, data.uncertainty], [v, e, u], rtol=1e-14
    )
    assert data.origin.line == places[0]
    assert list(data.origin.lines) == places[-len(v) :]


@drawn(
    60,
    points=st.lists(
        st.tuples(
            st.sampled_from([0.5, 1.0, 2.0]),
            st.floats(0.3, 0.9),
            st.floats(0.01, 0.1),
            st.sampled_from("abc"),
        ),
        min_size=2,
        max_size=9,
    ),
    seed=st.integers(0, 99),
    labels=st.permutations(["steel 7", "ü", "0"]),
)
def test_order_and_labels_do_not_matter_and_a_point_given_twice_counts_once(points, seed, labels):
    """A point of u is two of u √2: its mean, with 1/√Σ(1/u²); relabelled groups are the same groups."""
    v, e, u, group = (list(column) for column in zip(*points, strict=True))
    mean = cal.RestitutionData(v, e, uncertainty=u, group=group).averaged()
    order = np.random.default_rng(seed).permutation(len(v))
    name = dict(zip("abc", labels, strict=True))
    shuffled = cal.RestitutionData(
        np.repeat(np.array(v)[order], 2),
        np.repeat(np.array(e)[order], 2),
        uncertainty=np.sqrt(2) * np.repeat(np.array(u)[order], 2),
        group=np.repeat([name[group[i]] for i in order], 2),
    ).averaged()
    numbers = [
        {
            (x.velocity[i], renamed(x.group[i])): (x.restitution[i], x.uncertainty[i])
            for i in range(len(x))
        }
        for x, renamed in ((mean, name.get), (shuffled, str))
    ]
    assert numbers[0].keys() == numbers[1].keys()
    for key, pair in numbers[0].items():
        assert numbers[1][key] == pytest.approx(pair, rel=1e-12)
