"""CSV files as programs save them: bytes, separators, decimals, comments, units below the header."""

import numpy as np
import pandas
import pytest
from hypothesis import strategies as st

import calibration as cal
from tests.drawn import drawn

LINES = '# saved by "a program", 5; 6\n\n"velocity [mm/s]", restitution ,\n  # a comment\n120,0.95,\n,,\n 3.0e3 ,+.7'


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_files_as_programs_save_them(read, encoding, newline):
    mark = "\ufeff" if encoding in ("utf-16-le", "utf-16-be") else ""
    data = read(mark + LINES.replace("\n", newline) + newline, encoding)
    np.testing.assert_array_equal(data.velocity, [0.12, 3.0])
    np.testing.assert_array_equal(data.restitution, [0.95, 0.7])
    assert (data.name, data.origin.line, data.origin.lines) == ("a", 3, (5, 7))


@drawn(
    80,
    points=st.lists(
        st.tuples(st.floats(0.01, 50.0), st.floats(0.05, 0.99), st.floats(1e-3, 0.1)),
        min_size=1,
        max_size=8,
    ),
    unit=st.sampled_from([("m/s", 1.0), ("mm s⁻¹", 0.001), ("km/h", 1 / 3.6)]),
    ratio=st.sampled_from([("-", 1.0), ("%", 0.01)]),
    style=st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", ","), ("\t", ".")]),
    units_below=st.booleans(),
    order=st.permutations(range(4)),
    noise=st.lists(st.sampled_from(["", "# comment, 1; 2"]), min_size=9, max_size=9),
    newline=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_no_number_and_no_line_depends_on_the_style_of_a_table(
    read, points, unit, ratio, style, units_below, order, noise, newline
):
    delimiter, mark = style
    names, units = ("velocity", "restitution", "uncertainty", "note"), (unit, ratio, ratio)
    words = [*(f"[{word}]" for word, _ in units), "[text]"]
    rows = [list(names), words]
    if not units_below:
        rows = [[" ".join(both) for both in zip(names, words, strict=True)]]
    for point in points:
        cells = zip(point, units, strict=True)
        rows.append([*(repr(x / size).replace(".", mark) for x, (_, size) in cells), "x"])
    lines, places = [], []
    for i, row in enumerate(rows):
        lines += [noise[i % 9]] * (i % 2 == 0 or noise[i % 9] != "")
        lines.append(delimiter.join(row[k] for k in order))
        places.append(len(lines))
    data = read(newline.join(lines) + newline)
    found = [data.velocity, data.restitution, data.uncertainty]
    np.testing.assert_allclose(found, np.transpose(points), rtol=1e-14)
    assert (data.origin.line, list(data.origin.lines)) == (places[0], places[-len(points) :])


# text: velocities [m/s], restitutions, lines of the rows, and words of a remark or none
READ = {
    "v [m/s]\tCOR\tErr\n0,12\t0,95\t0,004\n3\t7e-1\t,02\n": ([0.12, 3], [0.95, 0.7], (2, 3), "commas"),
    'v,e,note\n1,0.9,"a\nb"\n\n2,0.8,c\n': ([1, 2], [0.9, 0.8], (2, 5), "'note'"),
    'sep=;\r\n"v (cm/s)";"e (%)";"remark, if any"\r\n"100";"64";"first; not ""clean"""\r\n50;32;\r\n': ([1, 0.5], [0.64, 0.32], (3, 4), "'remark, if any'"),
    "velocity\trestitution\tx\n(cm/s)\t(%)\t\n12\t95\ta\n300\t70\tb\n": ([0.12, 3], [0.95, 0.7], (3, 4), "'x'"),
    "velocity [cm/s];restitution\ncm/s;%\n12,0;95\n3,0e2;70\n": ([0.12, 3], [0.95, 0.7], (3, 4), "commas"),
    "v,e\ncm/s,\n100,0.9\n": ([1], [0.9], (3,), "velocity ('v [cm/s]')"),
    "v,e,specimen\n,,A\n1,0.9,B\n": ([1], [0.9], (3,), "the first of them line 2"),
    "operator,v,e,t\nMüller,1.0,0.9,12:30\n,2.0,0.8,\n": ([1, 2], [0.9, 0.8], (2, 3), "'operator'"),
    "v,e,specimen\n1,0.9,a\n2,,a\n# pause\n3,0.7,b\n": ([1, 3], [0.9, 0.7], (2, 5), "1 row(s) without a measurement are left out, the first of them line 3"),
    "h0,h1 [mm]\n1,640\n": (None, [0.8], (2,), "assuming drop_height in m"),
    "v,e\n1,0.8\n": ([1], [0.8], (2,), "assuming velocity in m/s"),
}  # fmt: skip


@pytest.mark.parametrize("text", READ)
def test_numbers_and_lines_of_a_file(read, text):
    velocity, restitution, lines, words = READ[text]
    data = read(text)
    if velocity is not None:
        np.testing.assert_allclose(data.velocity, velocity, rtol=1e-15)
    np.testing.assert_allclose(data.restitution, restitution, rtol=1e-15)
    assert data.origin.lines == lines
    assert any(words in remark for remark in data.remarks)
    assert any("commas" in remark for remark in data.remarks) == (words == "commas")
    noted = words.startswith("assuming") or text.startswith(("v,e,", "v,e\n1", "operator"))
    assert any(" unit" in remark for remark in data.remarks) == noted


def test_labels_and_lines_of_rows_that_were_not_measured_and_what_windows_saves(read):
    """German Excel's own: Windows-1252, semicolons, decimal commas."""
    text = "v,e,specimen\n1,0.9,a\n2,,a\n# pause\n3,0.7,b\n"
    assert read(text).groups == ("a", "b")
    with pytest.raises(cal.InputError, match=r"a\.csv:6: .*velocity.*-3"):
        read(f"{text}-3,0.7,b\n")
    for missing in ("NA", "N/A", "missing", "NaN", "-", "--"):  # no row of units
        for header in ("v,e", "velocity [m/s],restitution"):
            data = read(f"{header}\n{missing},{missing}\n1,0.9\n2,0.8\n3,{missing}\n")
            np.testing.assert_array_equal(data.velocity, [1.0, 2.0])
            assert data.origin.lines == (3, 4)
    data = read("v [m/s];e;Prüfling\n0,12;0,95;µ1\n", "cp1252")
    assert (data.velocity[0], data.restitution[0]) == (0.12, 0.95)
    assert any("Windows-1252" in remark for remark in data.remarks)


def test_a_spreadsheet_is_read_as_its_csv_is(read, tmp_path):
    pytest.importorskip("openpyxl", reason="reads workbooks: the extra `excel`")
    rows = [["velocity [cm/s]", "e", "note"], [12, 0.95, "a"], [None] * 3, [300.5, 0.7, "b"]]
    pandas.DataFrame(rows).to_excel(tmp_path / "b.xlsx", header=False, index=False)
    text = "\n".join(",".join("" if c is None else str(c) for c in row) for row in rows)
    sheet, plain = cal.read_csv(tmp_path / "b.xlsx"), read(text)
    np.testing.assert_array_equal(sheet.velocity, plain.velocity)
    np.testing.assert_array_equal(sheet.restitution, plain.restitution)
    assert sheet.origin.lines == plain.origin.lines == (2, 4)


def test_a_hundred_thousand_rows_are_read_as_they_stand(read):
    rng = np.random.default_rng(3)
    v, e = rng.uniform(0.1, 5.0, 100_000), rng.uniform(0.2, 0.9, 100_000)
    pairs = enumerate(zip(v.tolist(), e.tolist(), strict=True))
    lines = [f"{a!r},{b!r},s{i % 3}" for i, (a, b) in pairs]
    lines[70_000] = '"1.5", ,s0'
    data = read("\n".join(["velocity,restitution,group", *lines]))
    np.testing.assert_array_equal(data.velocity, np.delete(v, 70_000))
    np.testing.assert_array_equal(data.restitution, np.delete(e, 70_000))
    assert data.groups == ("s0", "s1", "s2")
    assert data.origin.lines[70_000] == 70_003
