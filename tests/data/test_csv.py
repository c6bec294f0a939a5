"""CSV files as programs save them: bytes, separators, decimals, comments, units below the header."""

import numpy as np
import pandas
import pytest

import calibration as cal

LINES = [
    '# saved by "a program", 5; 6',
    "",
    '"velocity [mm/s]", restitution ,',
    "  # a comment",
    "120,0.95,",
    ",,",
    " 3.0e3 ,+.7",
]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_files_as_programs_save_them(read, delimiter, encoding, newline):
    text = newline.join(LINES).replace(",", delimiter) + newline
    mark = "\ufeff" if encoding in ("utf-16-le", "utf-16-be") else ""
    data = read(mark + text, encoding)
    np.testing.assert_array_equal(data.velocity, [0.12, 3.0])
    np.testing.assert_array_equal(data.restitution, [0.95, 0.7])
    assert (data.name, data.origin.line, data.origin.lines) == ("a", 3, (5, 7))


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas(read, delimiter):
    data = read("v [m/s];COR;Err\n0,12;0,95;0,004\n3;7e-1;,02\n".replace(";", delimiter))
    np.testing.assert_array_equal(data.velocity, [0.12, 3.0])
    np.testing.assert_array_equal(data.restitution, [0.95, 0.7])
    np.testing.assert_array_equal(data.uncertainty, [0.004, 0.02])
    assert "commas" in data.remarks[-1]
    assert not any("commas" in one for one in read("v;e\n0.12;0.95\n").remarks)


def test_what_windows_saves_is_read_and_told(read):
    """German Excel's own: Windows-1252, semicolons, decimal commas."""
    data = read("v [m/s];e;Prüfling\n0,12;0,95;µ1\n", "cp1252")
    assert (data.velocity[0], data.restitution[0]) == (0.12, 0.95)
    assert any("Windows-1252" in one for one in data.remarks)


def test_a_cell_may_go_over_two_lines(read):
    data = read('v,e,note\n1,0.9,"a\nb"\n\n2,0.8,c\n')
    assert data.origin.lines == (2, 5)


def test_a_spreadsheet_is_read_as_its_csv_is(read, tmp_path):
    pytest.importorskip("openpyxl", reason="reads workbooks: the extra `excel`")
    rows = [
        ["velocity [cm/s]", "e", "note"],
        [12, 0.95, "a"],
        [None, None, None],
        [300.5, 0.7, "b"],
    ]
    pandas.DataFrame(rows).to_excel(tmp_path / "b.xlsx", header=False, index=False)
    text = "\n".join(",".join("" if c is None else str(c) for c in row) for row in rows)
    sheet, plain = cal.read_csv(tmp_path / "b.xlsx"), read(text)
    np.testing.assert_array_equal(sheet.velocity, plain.velocity)
    np.testing.assert_array_equal(sheet.restitution, plain.restitution)
    assert sheet.origin.lines == plain.origin.lines == (2, 4)


def test_the_separator_line_of_a_spreadsheet_and_quoted_cells(read):
    text = 'sep=;\r\n"drop height (cm)";"rebound height (cm)";"remark, if any"\r\n'
    data = read(text + '"100";"64";"first; not ""clean"""\r\n50;32;\r\n')
    np.testing.assert_allclose(data.restitution, [0.8, 0.8], rtol=1e-14)
    assert data.origin.lines == (3, 4)
    assert "'remark, if any'" in data.remarks[0]


@pytest.mark.parametrize(
    "text",
    [
        "velocity,restitution,note\ncm/s,%,\n12,95,a\n300,70,b\n",
        "velocity;restitution;note\n[cm/s];[%];[text]\n12;95;a\n300;70;b\n",
        "velocity\trestitution\tnote\n(cm/s)\t(%)\t\n12\t95\ta\n300\t70\tb\n",
        "velocity [cm/s];restitution;note\ncm/s;%;\n12,0;95;a\n3,0e2;70;b\n",
    ],
)
def test_units_in_a_row_of_their_own(read, text):
    plain, below = read("velocity [cm/s],restitution [%],note\n12,95,a\n300,70,b\n"), read(text)
    np.testing.assert_array_equal(plain.velocity, below.velocity)
    np.testing.assert_array_equal(plain.restitution, below.restitution)
    np.testing.assert_allclose(plain.restitution, [0.95, 0.7], rtol=1e-15)
    assert below.origin.lines == (3, 4)


def test_a_first_row_without_a_measurement_is_no_row_of_units(read):
    data = read("v,e,specimen\n,,A\n1,0.9,B\n")
    assert (len(data), data.groups, data.origin.lines) == (1, ("B",), (3,))


def test_cells_of_columns_that_are_not_used_may_hold_anything(read):
    data = read("operator,v,e,t\nMüller,1.0,0.9,12:30\n,2.0,0.8,\n")
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0])
    assert "'operator'" in data.remarks[1]


def test_rows_that_were_not_measured_are_left_out_and_the_others_keep_their_lines(read):
    data = read("v,e,specimen\n1,0.9,a\n2,,a\n# pause\n3,0.7,b\n")
    assert (data.origin.lines, data.groups) == ((2, 5), ("a", "b"))
    assert any("1 row(s)" in one and "row 2" in one for one in data.remarks)
    with pytest.raises(cal.InputError, match=r"a\.csv:6: .*velocity.*-3"):
        read("v,e,specimen\n1,0.9,a\n2,,a\n# pause\n3,0.7,b\n-3,0.7,b\n")


def test_units_that_are_not_told_are_told_as_they_are_taken(read):
    told = {"h0,h1 [mm]\n1,640\n": "drop_height in m", "v,e\n1,0.8\n": "velocity in m/s"}
    for text, words in told.items():
        assert any(words in one and "unit" in one for one in read(text).remarks)
    assert not any(" unit" in one for one in read("v [m/s],e\n1,0.8\n").remarks)
    assert not any(" unit" in one for one in read("v,e\ncm/s,-\n1,0.8\n").remarks)


def test_a_hundred_thousand_rows_are_read_as_they_stand(read):
    """In blocks; a row in the midst that needs to be looked at cell by cell changes no other."""
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


@pytest.mark.long
def test_a_million_rows(read):
    v = 0.5 + np.arange(1_000_000) % 1000 / 1000
    data = read("v,e,u\n".replace("u", "uncertainty") + "".join(f"{x},0.8,0.01\n" for x in v))
    np.testing.assert_array_equal(data.velocity, v)
    assert data.origin.lines[-1] == 1_000_001
