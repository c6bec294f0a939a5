"""Tables as laboratories keep them: read right, or refused with the way in. Right values are arithmetic."""

import numpy as np
import pandas
import pytest

import calibration as cal
from tests.command import run

READ = cal.RestitutionData.from_table
G = 9.80665
FIT = '[fit]\nlaw = "constant"\n[[material]]\nname = "ball"\ndata = "m.csv"\n'


def drops(*pairs):
    drop, rebound = np.transpose(pairs)
    return np.sqrt(2 * G * drop), np.sqrt(rebound / drop)


def bounces(*launches):
    """v and ε of each launch's intervals [s]."""
    parts = [np.array(launch, float) for launch in launches]
    speeds = [G * t[:-1] / 2 for t in parts]
    return np.concatenate(speeds), np.concatenate([t[1:] / t[:-1] for t in parts])


TWO = bounces([0.84, 0.75], [0.72, 0.64, 0.58])
# text of a file: v and ε of its impacts, words of its remarks
RIGHT = {
    # launches by whatever column divides the rows
    "Throw,Interval (s)\n1,0.84\n1,0.75\n2,0.72\n2,0.64\n2,0.58\n": (TWO, "'Throw' is read as the launch: 2"),
    "Wurf;Δt (ms)\n1;840,0\n1;750,0\n2;720,0\n2;640,0\n2;580,0\n": (TWO, "'Wurf' is read"),
    "batch,dt (s)\nx,0.84\nx,0.75\ny,0.72\ny,0.64\ny,0.58\n": (TWO, "'batch' is read"),
    "Series,Run,dt (s)\n1,2,0.84\n1,2,0.75\n2,2,0.72\n2,2,0.64\n2,1,0.5\n2,1,0.4\n": (bounces([0.84, 0.75], [0.72, 0.64], [0.5, 0.4]), "'Series', 'Run' is read as the launch: 3"),
    "Drop,Bounce,dt (s)\n1,1,0.84\n1,2,0.75\n2,1,0.72\n2,2,0.64\n2,3,0.58\n": (TWO, "'Drop' is read as the launch: 2"),
    "#,dt (s)\n1,0.84\n2,0.75\n1,0.72\n2,0.64\n3,0.58\n": (TWO, "'#' is read"),
    "dt (s)\n0.84\n0.75\ndt (s)\n0.72\n0.64\n0.58\n": (TWO, "the header is repeated in line(s) 4"),
    "n,dt (s)\n1,0.84\n2,0.75\n3,0.64\n": (bounces([0.84, 0.75, 0.64]), "columns not used: 'n'"),
    # a time beside a complete set is a stamp
    "time (s),v (m/s),COR\n0,1,0.9\n30,2,0.8\n60,3,0.7\n": (([1, 2, 3], [0.9, 0.8, 0.7]), "not used: 'time (s)'"),
    "Bounce,t (s),h (cm)\n0,0,100\n1,0.8,64\n2,1.5,36\n": (drops((1, 0.64), (0.64, 0.36)), "'t (s)'"),
    # rows that are no measurement
    "Run,h0 (cm),h1 (cm)\n1,100,81\n2,100,64\nAverage,100,72\nStd. Dev.,,8\n": (drops((1, 0.81), (1, 0.64)), "line 4 ('Average'), line 5 ('Std. Dev.')"),
    "h0 (cm);h1 (cm);Notiz\n100;81,0;\n100;72,5;Mittelwert\n100;64,0;\n": (drops((1, 0.81), (1, 0.64)), "line 3 ('Mittelwert')"),
    # another dimension is another quantity; a symbol is no unit
    "v (m/s),e,V [mV],E [J]\n1,0.9,200,2\n2,0.8,300,3\n": (([1, 2], [0.9, 0.8]), "not used: 'V [mV]', 'E [J]'"),
    '"Impact speed, v (ft/s)",Coefficient of Restitution (e)\n10,0.9\n20,0.8\n': (([3.048, 6.096], [0.9, 0.8]), ""),
    'Drop height (h),"Rebound height, h\' (cm)"\n1,81\n2,128\n': (drops((1, 0.81), (2, 1.28)), ""),
    # how cells are separated, and what is empty
    "velocity m/s;material;e\n1;steel;0,9\n2;Steel;0,8\n": (([1, 2], [0.9, 0.8]), "'material'"),
    "velocity (m/s)   e\n  1.0   0.9\n  2.0   0.8\n": (([1, 2], [0.9, 0.8]), ""),
    "# run of today\n# v [cm/s] e\n1.0e+02 9.0e-01\n2.0e+02 8.0e-01\n": (([1, 2], [0.9, 0.8]), ""),
    "% v [cm/s],e\n100 0.9\n200 0.8\n": (([1, 2], [0.9, 0.8]), ""),
    "#v;e\n1,0;0,9\n2,0;0,8\n": (([1, 2], [0.9, 0.8]), "decimal points"),
    "v e\n1,0 0,9\n2,0 0,8\n": (([1, 2], [0.9, 0.8]), "decimal points"),
    "v (m/s),e\n1,0.9\n2,0.8\n3,NaN\n4,-\n5,n/a\n": (([1, 2], [0.9, 0.8]), "3 row(s) without a measurement"),
    "Event (s),Interval (s)\n0,0.84\n0.84,0.75\n1.59,0\n": (bounces([0.84, 0.75]), "1 interval(s) at the end of a launch, 0,"),
    # repeats beside each other, and heights of bounces
    "Drop height (m);Versuch 1 (cm);Versuch 2 (cm);Mittelwert;SD\n1;81;64;72,5;12\n0,5;32;;32;\n": (drops((1, 0.81), (1, 0.64), (0.5, 0.32)), "'Mittelwert', 'SD'"),
    "Drop height (cm),1,2,avg\n100,81,64,72.5\n": (drops((1, 0.81), (1, 0.64)), "repeats of rebound_height"),
    "Drop height (cm),1st trial,2nd trial\n100,81,64\n": (drops((1, 0.81), (1, 0.64)), "repeats of rebound_height"),
    "Drop height / cm;1. Versuch;2. Versuch\n100;81;64\n": (drops((1, 0.81), (1, 0.64)), "repeats of rebound_height"),
    "Drop height (cm),Trial A,Trial B\n100,81,64\n": (drops((1, 0.81), (1, 0.64)), "repeats of rebound_height"),
    "v_in (m/s),COR 1,COR 2\n1,0.9,0.8\n2,0.7,0.6\n": (([1, 1, 2, 2], [0.9, 0.8, 0.7, 0.6]), "repeats of restitution"),
    "Drop height (cm),Average rebound height (cm)\n100,81\n50,32\n": (drops((1, 0.81), (0.5, 0.32)), ""),
    "Bounce,Peak height (cm)\n0,100\n1,64\n2,36\n0,50\n1,32\n": (drops((1, 0.64), (0.64, 0.36), (0.5, 0.32)), "'Bounce' is read as the launch"),
    "Height 0 (cm),Height 1 (cm),Height 2 (cm)\n100,64,36\n": (drops((1, 0.64), (0.64, 0.36)), "heights between bounces"),
    # settings that go with a reading, and numbers of specimens, divide nothing
    "level,h0 (cm),h1 (cm)\nlow,50,32\nlow,50,32\nhigh,100,81\nhigh,100,81\n": (drops((0.5, 0.32), (0.5, 0.32), (1, 0.81), (1, 0.81)), "'level'"),
    "sample,angle [°],v (m/s),e\n1,0,1,0.9\n2,0,2,0.8\n": (([1, 2], [0.9, 0.8]), "'sample', 'angle [°]'"),
}  # fmt: skip


@pytest.mark.parametrize("text", RIGHT)
def test_a_table_is_read_as_its_writer_meant_it(read, text):
    (velocity, restitution), words = RIGHT[text]
    data = read(text)
    np.testing.assert_allclose(data.velocity, velocity, rtol=1e-12)
    np.testing.assert_allclose(data.restitution, restitution, rtol=1e-12)
    assert words in "\n".join(data.remarks)


# text of a file: words of its refusal
REFUSED = {
    "dt (s)\n0.84\n0.75\n0.80\n0.7\n": "a.csv:4: interval is 0.8|launch",  # by 6.7 %
    "time (s)\n0\n0.84\n1.59\n2.39\n": "a.csv:5: time is 2.39|launch",
    "Bounce,h (m)\n1,0.64\n2,0.36\n3,0.41\n": "a.csv:4: height is 0.41|launch",
    "Drop,dt (s)\n1,0.84\n2,0.75\n3,0.66\n": "launch is of 1 row",
    "time (s)\n0\n30\n60\n90\n": "equally spaced|track",
    "time (s)\n0.033\n0.067\n0.100\n0.133\n": "equally spaced|track",
    "t (s),z (m)\n0,1\n0.1,0.95\n0.2,0.8\n": "track is of 3 frames|two flights",
    "time (s),velocity (m/s)\n0,1\n0.1,2\n": "time, velocity|stamp",
    "e,v (m/s),SD\n0.9,1,0.1\n0.8,2,0.1\n": "'SD', of 'v (m/s)' or of ε|`u_v`",
    "v (m/s),e,mass of mug (g),±\n1,0.9,3,1\n2,0.8,4,1\n": "'±', behind 'mass of mug (g)'|`u_e`",
    "Oberfläche;v;e\nHolz;1,0;0,9\nHolz;2,0;0,8\nGlas;1,0;0,9\n": "'Oberfläche' with 2 values, 'Holz', 'Glas'|[[material]]|`group`",
    "sample,v,e\nA,1,0.9\nA,2,0.8\nB,1,0.4\n": "'sample'|[[material]]|`group`",
    "ball,dt (s)\nred,0.84\nred,0.75\nblue,0.72\nblue,0.64\n": "'ball'|[[material]]",
    "Charge,v,e\nx,1,0.9\nx,2,0.8\ny,1,0.9\ny,2,0.8\n": "'Charge'|`group`|`note`",
    "θ [deg],v,e\n0,1,0.9\n12,2,0.8\n": "a.csv:3: column 'θ [deg]' is 12|normal",
    "Einfallswinkel;v;e\n90;1,0;0,9\n90;2,0;0,8\n": "'Einfallswinkel' is 90|normal",
    "Height (ft),Bounce (ft)\n6,4\n5,3.3\n": "height; not known: 'Bounce (ft)'|drop_height with rebound_height",
    "bounce,height\n1,0.8\n2,0.5\n4,0.2\n": "'bounce', no number of a bounce|0, 1, 2",
    "v_c,e\n1,0.9\n": "not known: 'v_c'",
    "v/c,e\n1,0.9\n": "not known: 'v/c'",
    '"v, c",e\n1,0.9\n': "not known: 'v, c'",
    "v [c],e\n1,0.9\n": "unit of velocity is [c]|m/s",
    "dt_min\n1\n0.9\n": "not known: 'dt_min'",
    "v [J],e\n1,0.9\n": "unit of velocity is [J]|m/s",
    "h0,h1,h2\n1,0.64,0.36\n0.9,0.6,0.3\n": "'h0', 'h1', 'h2'|repeats = true|repeats = false",
    "drop height,bounce 1,bounce 2\n1,0.64,0.36\n": "'bounce 1', 'bounce 2'|repeats = false",
    "v (m/s),Trial 1,Trial 2\n1,0.9,0.91\n": "'Trial 1', 'Trial 2'|`COR 1`",
    "v,e,,v,e\n1,0.9,,1,0.4\n2,0.8,,2,0.3\n": "restitution, velocity on both sides of empty column 3|[[material]]|launch",
    "v,e,v.1,e.1\n1,0.9,1,0.4\n": "'v' and 'v.1'|[[material]]",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_table_of_two_readings_is_refused_with_the_way_in(read, text):
    with pytest.raises(cal.InputError) as caught:
        read(text)
    for word in REFUSED[text].split("|"):
        assert word in str(caught.value)


def test_bounces_may_grow_by_four_standard_errors_of_their_difference(read):
    """√2 u for intervals, √6 u for times; 0.05 s above the last interval."""
    intervals, times = "dt (s)\n0.84\n0.75\n0.80\n0.7\n", "time (s)\n0\n0.84\n1.59\n2.39\n"
    for text, factor in ((intervals, 2**0.5), (times, 6**0.5)):
        least = 0.05 / 4 / factor
        data = read(text, timing_uncertainty=f"{1.01 * least} s")
        assert data.restitution[1] > 1
        with pytest.raises(cal.InputError, match="launch"):
            read(text, timing_uncertainty=f"{0.99 * least} s")
    assert len(read(intervals, uncertainty=0.017)) == 3  # of ε: 1 + 4 · 0.017 > 0.8/0.75
    with pytest.raises(cal.InputError, match="launch"):
        read(intervals, uncertainty=0.016)


def test_a_bare_deviation_is_of_the_column_before_it(read):
    """ε² = h₁/h₀, so that u(ε) = ε u(h₁)/(2 h₁)."""
    data = read("h0 (cm),h1 (cm),SD\n100,64,2\n50,32,2\n")
    np.testing.assert_allclose(data.uncertainty, [0.8 * 2 / 128, 0.8 * 2 / 64], rtol=1e-12)
    data = read("v (cm/s),±,COR,std\n100,2,0.9,0.01\n200,3,0.8,0.02\n")
    np.testing.assert_allclose(data.velocity_uncertainty, [0.02, 0.03], rtol=1e-12)
    np.testing.assert_allclose(data.uncertainty, [0.01, 0.02], rtol=1e-12)


def test_heights_of_bounces_share_their_errors():
    """cov(ε₁, ε₂) = ∂ε₁/∂h₂ ∂ε₂/∂h₂ u², of ε₁ = √(h₂/h₁) and ε₂ = √(h₃/h₂)."""
    data = READ({"bounce": [0, 1, 2], "height": [1.0, 0.64, 0.36]}, height_uncertainty=0.01)
    u = 0.01 * np.array([0.4, 0.5 * 0.8 / 0.64])  # ε/2 (1/h₁, 1/h₂)
    np.testing.assert_allclose(data.uncertainty[0], np.hypot(*u), rtol=1e-12)
    errors = data.errors
    shared = np.zeros((2, 3))
    np.put_along_axis(shared, errors.index[:, :2], errors.to_restitution[:, :2] * 0.01, axis=1)
    assert (shared @ shared.T)[0, 1] == pytest.approx(-u[1] * 0.01 * 0.375 / 0.64, rel=1e-12)


@pytest.mark.parametrize("repeats", [True, False])
def test_numbered_heights_are_what_the_file_says(read_toml, repeats):
    csv = "h0 [cm],h1 [cm],h2 [cm]\n100,64,36\n50,32,18\n"
    (data,) = read_toml(f"[[material]]\ndata = 'm.csv'\nrepeats = {str(repeats).lower()}\n", csv)
    expected = drops((1, 0.64), (1, 0.36), (0.5, 0.32), (0.5, 0.18))
    if not repeats:
        expected = drops((1, 0.64), (0.64, 0.36), (0.5, 0.32), (0.32, 0.18))
        assert data.groups == ("1", "2")
    np.testing.assert_allclose([data.velocity, data.restitution], expected, rtol=1e-12)
    with pytest.raises(ValueError, match=r"m\.csv:1: repeats is given; it must be left out"):
        read_toml("[[material]]\ndata = 'm.csv'\nrepeats = true\n")


def test_a_frame_is_read_as_its_file_is(read):
    """Exact numbers, missing cells, wide trials and rows of means; a refusal has its row."""
    table = {
        "Drop height (cm)": [100.0, 50, 70],
        "Trial 1": [64.1, 32, 1],
        "Trial 2": [63, np.nan, 1],
    }
    frame = pandas.DataFrame(table | {"who": ["a", "b", "mean"]})
    data, same = cal.read_frame(frame, name="a"), read(frame.to_csv(index=False))
    assert len(data) == 3
    np.testing.assert_array_equal(data.velocity, same.velocity)
    np.testing.assert_array_equal(data.restitution, same.restitution)
    with pytest.raises(cal.InputError, match=r"DataFrame:2: .*velocity is -2"):
        cal.read_frame(pandas.DataFrame({"v": [1.0, -2.0], "e": [0.9, 0.8]}))
    with pytest.raises(cal.DataError, match="a DataFrame; `read_csv` reads a file"):
        cal.read_frame({"v": [1.0]})


def test_the_sheet_whose_columns_are_known_is_read_else_it_is_named(tmp_path, read_toml):
    pytest.importorskip("openpyxl", reason="reads workbooks: the extra `excel`")
    note, first = [["system", "value"], ["x", 1]], [["v (m/s)", "COR"], [1, 0.9], [2, 0.8]]
    second = [["dt (s)"], [0.8], [0.72], [0.64]]

    def book(**sheets):
        with pandas.ExcelWriter(tmp_path / "b.xlsx") as writer:
            for name, rows in sheets.items():
                pandas.DataFrame(rows).to_excel(writer, sheet_name=name, header=False, index=False)

    toml = "[[material]]\ndata = 'b.xlsx'\n"
    book(Device=note, Raw=first)
    (data,) = read_toml(toml)
    np.testing.assert_array_equal(data.velocity, [1.0, 2.0])
    assert any("sheet 'Raw' of 2 is read" in remark for remark in data.remarks)
    book(Device=note, Raw=first, All=second)
    with pytest.raises(cal.InputError) as caught:
        read_toml(toml)
    for word in ('sheet = "Raw"', "'Device' (system, value)", "'All' (dt (s))"):
        assert word in str(caught.value)
    (data,) = read_toml(f'{toml}sheet = "All"\n')
    np.testing.assert_allclose(data.restitution, [0.9, 0.64 / 0.72], rtol=1e-12)
    with pytest.raises(cal.InputError, match=r"no sheet 'all'; its sheets: 'Device'"):
        read_toml(f'{toml}sheet = "all"\n')
    with pytest.raises(ValueError, match=r"m\.toml:3: sheet is \"All\".*left out"):
        read_toml("[[material]]\ndata = 'm.csv'\nsheet = 'All'\n")


@pytest.mark.parametrize(("raw", "words"), [(b"\x89PNG\r\n\x1a\n\0\0", "a PNG picture"), (b"%PDF-1.7\n\0", "a PDF"), (b"\xd0\xcf\x11\xe0", "save it as .xlsx")])  # fmt: skip
def test_what_is_no_table_is_named(tmp_path, raw, words):
    (tmp_path / "a.csv").write_bytes(raw)
    with pytest.raises(cal.InputError, match=words):
        cal.read_csv(tmp_path / "a.csv")


def test_words_of_means_and_deviations_are_known_in_several_languages(read):
    known = "Mean; average:; Avg.; Mittelwert; Standardabweichung; moyenne; écart type; Media (n=5); Mean of 5; SD; Σ; x̄; Summe"
    others = "meaning; maximum of the day; sdb; e; max height; 12:30; averaged by hand"
    words = [*others.split("; "), *known.split("; ")]
    data = read("v,e,note\n" + "".join(f"1,0.9,{word}\n" for word in words))
    assert data.origin.lines == tuple(range(2, 2 + len(others.split("; "))))


def test_the_command_refuses_with_the_line_and_writes_nothing(tmp_path):
    (tmp_path / "m.toml").write_text(FIT, encoding="utf-8")
    (tmp_path / "m.csv").write_text("v,angle,e\n1,30,0.9\n2,30,0.8\n", encoding="utf-8")
    code, out, error = run("fit", tmp_path / "m.toml", "--out", tmp_path / "out")
    assert (code, out) == (2, "")
    assert "m.csv:2: column 'angle' is 30" in error
    assert not (tmp_path / "out").exists()
