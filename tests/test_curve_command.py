"""`softjax curve` from the command line to its files."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration.cli import main
from tests.cases import FITTED, fitted, pair
from tests.command import BODIES


@pytest.fixture(scope="module")
def above_yield(tmp_path_factory):
    """A fit that knows nothing below first yield, in a file."""
    law = fitted("nylon")
    velocity = np.geomspace(1.5, 60.0, 24)
    noise = 0.003 * np.random.default_rng(4).normal(size=24)
    measured = np.asarray(sj.restitution(law, velocity).coefficient) + noise
    data = cal.RestitutionData(velocity, measured, law.contact, 0.003, name="my\nnylon")
    result = cal.fit(data, profiles=False)
    path = tmp_path_factory.mktemp("fit") / "fit.json"
    result.save(path)
    return result, str(path)


def curve(*options: str) -> int:
    return main(["curve", *options])


def column(path, position: int) -> np.ndarray:
    rows = path.read_text(encoding="utf-8").splitlines()[1:]
    return np.array([float(row.split(",")[position] or "nan") for row in rows])


def test_a_named_material_gives_its_curve_in_every_format(at, capsys):
    options = ["nylon", "--from", "0.5", "--to", "20", "--points", "30", "--spacing", "log"]
    assert curve(*options, "--format", "csv", "npy", "png") == 0
    told = capsys.readouterr()
    assert "χ̃ = 0.21998" in told.out
    assert told.err == ""
    out = at / "results"
    velocity = column(out / "curve.csv", 0)
    np.testing.assert_allclose(velocity, np.geomspace(0.5, 20, 30), rtol=1e-14)
    expected = np.asarray(sj.restitution(fitted("nylon"), velocity).coefficient)
    np.testing.assert_allclose(column(out / "curve.csv", 1), expected, rtol=1e-14)
    np.testing.assert_array_equal(np.load(out / "curve.npy")["velocity"], velocity)
    assert (out / "curve.png").read_bytes()[:4] == b"\x89PNG"


def test_a_table_has_the_same_curve_and_two_rows_more(at):
    options = ["nylon", "--from", "0.5", "--to", "20", "--points", "30", "--spacing", "lin"]
    assert curve(*options, "--table") == 0
    assert [path.name for path in (at / "results").iterdir()] == ["curve.txt"]
    found = np.loadtxt(at / "results" / "curve.txt")
    assert found.shape == (32, 6)
    critical = float(pair("nylon").critical_velocity)
    at_yield = np.isclose(found[:, 0], critical, rtol=1e-11, atol=0)
    assert np.sum(at_yield) == 2
    np.testing.assert_allclose(found[~at_yield, 0], np.linspace(0.5, 20, 30), rtol=1e-14)


@pytest.mark.parametrize(
    ("options", "law"),
    [
        (["--chi", "0.3"], {"chi": 0.3}),
        (["--set", "chi=0.3"], {"chi": 0.3}),
        (["--sigma", "0.1"], {"sigma": 0.1}),
        (["--psi", "0.9"], {"psi": 0.9}),
        (["--form", "full"], {"form": "full"}),
        (["--kappa", "printed"], {"kappa": "printed", "chi": 0.016}),
        (["--kappa", "printed", "--chi", "0.21998"], {"kappa": "printed"}),
    ],
)
def test_each_option_of_zhous_law_acts(at, options, law):
    range_ = ["--from", "3", "--to", "10", "--points", "4", "--format", "csv"]
    assert curve("nylon", *options, *range_) == 0
    found = column(at / "results" / "curve.csv", 1)
    velocity = column(at / "results" / "curve.csv", 0)
    plain = sj.Zhou(pair("nylon"), **FITTED["nylon"])
    asked = sj.Zhou(pair("nylon"), **(FITTED["nylon"] | law))
    expected = np.asarray(sj.restitution(asked, velocity).coefficient)
    np.testing.assert_allclose(found, expected, rtol=1e-13)
    assert np.max(np.abs(found - sj.restitution(plain, velocity).coefficient)) > 1e-5


def test_the_contact_area_acts(at):
    options = ["--chi", "0.3", "--from", "3", "--to", "9", "--points", "3", "--format", "csv"]
    assert curve("nylon", "--area", "hertz", *options) == 0
    velocity = column(at / "results" / "curve.csv", 0)
    law = sj.Zhou(pair("nylon", area="hertz"), 0.3, 0.4355, 0.5414)
    expected = np.asarray(sj.restitution(law, velocity).coefficient)
    np.testing.assert_allclose(column(at / "results" / "curve.csv", 1), expected, rtol=1e-13)


@pytest.mark.parametrize(
    ("options", "law"),
    [
        ("constant restitution=0.75", lambda c: sj.ConstantRestitution(c, 0.75)),
        ("hertz", sj.Hertz),
        ("thornton yield_factor=2.5 area=contact", lambda c: sj.Thornton(c, 2.5, "contact")),
        (
            "walton-braun loading_stiffness=1e6 unloading-stiffness=2e6 growth=3",
            lambda c: sj.WaltonBraun(c, 1e6, 2e6, 3.0),
        ),
        ("eq-17 sigma=0.3", lambda c: sj.EmpiricalRestitution(c.limit_velocity, 0.3, 0.5414)),
    ],
)
def test_any_law_is_asked_for_by_name(at, options, law):
    name, *fields = options.split()
    told = [word for field in fields for word in ("--set", field)]
    told += [] if name != "eq-17" else ["--psi", "0.5414"]
    assert curve("nylon", "--law", name, *told, "--points", "5", "--format", "csv") == 0
    velocity = column(at / "results" / "curve.csv", 0)
    expected = np.asarray(sj.restitution(law(pair("nylon")), velocity).coefficient)
    np.testing.assert_allclose(column(at / "results" / "curve.csv", 1), expected, rtol=1e-13)


def test_a_material_file_needs_the_coefficients_it_does_not_hold(at, capsys):
    (at / "alloy.toml").write_text(BODIES, encoding="utf-8")
    assert curve("alloy.toml") == 2
    assert "--chi" in capsys.readouterr().err
    assert not (at / "results").exists()
    given = ["--chi", "0.21998", "--sigma", "0.4355", "--psi", "0.5414"]
    assert curve("alloy.toml", *given, "--points", "30", "--from", "0.5", "--format", "csv") == 0
    velocity = column(at / "results" / "curve.csv", 0)
    expected = sj.restitution(fitted("nylon"), velocity).coefficient
    np.testing.assert_allclose(column(at / "results" / "curve.csv", 1), expected, rtol=1e-14)


def test_what_a_file_says_of_its_law_acts_and_options_win(at):
    text = BODIES + "[material.parameters]\nyield_factor = 2.5\n[fit]\nlaw = 'thornton'\n"
    (at / "alloy.toml").write_text(text, encoding="utf-8")
    contact = pair("nylon")
    for options, law in (
        ([], sj.Thornton(contact, 2.5)),
        (["--set", "yield_factor=2"], sj.Thornton(contact, 2.0)),
        (["--law", "hertz"], sj.Hertz(contact)),
    ):
        assert curve("alloy.toml", *options, "--points", "5", "--format", "csv") == 0
        velocity = column(at / "results" / "curve.csv", 0)
        expected = np.asarray(sj.restitution(law, velocity).coefficient)
        np.testing.assert_allclose(column(at / "results" / "curve.csv", 1), expected, rtol=1e-13)


def test_a_fit_gives_its_band_and_says_where_its_data_end(at, capsys, above_yield):
    result, path = above_yield
    inside = ["--from", "1.5", "--to", "60", "--points", "20", "--format", "csv", "png"]
    assert curve("--fit", path, *inside) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert r"my\nnylon" in told.out
    found = at / "results" / "curve.csv"
    assert found.read_text(encoding="utf-8").startswith(
        "velocity [m/s],restitution,restitution_low,restitution_high,status\n"
    )
    velocity, value, low, high = (column(found, i) for i in range(4))
    band = result.band(velocity)
    np.testing.assert_allclose(value, band.coefficient, rtol=1e-12)
    np.testing.assert_allclose(low, band.low, rtol=1e-12)
    np.testing.assert_allclose(high, band.high, rtol=1e-12)
    expected = np.asarray(sj.restitution(result.law, velocity).coefficient)
    np.testing.assert_allclose(value, expected, rtol=1e-12)
    assert curve("--fit", path, "--from", "1", "--to", "200", "--quiet") == 0
    told = capsys.readouterr()
    assert told.out == ""
    assert "extrapolation: the curve goes from 1 to 200 m/s" in told.err
    assert told.err.count("\n") == 1


def test_a_table_says_in_its_head_whether_it_goes_beyond_the_data(at, capsys, above_yield):
    _, path = above_yield

    def head(*options: str) -> str:
        assert curve("--fit", path, "--table", *options) == 0
        lines = (at / "results" / "curve.txt").read_text(encoding="utf-8").splitlines()
        assert len(np.loadtxt(at / "results" / "curve.txt")) >= 12
        return " ".join(line for line in lines if line.startswith("#"))

    beyond = "the curve goes from 1.5 to 200 m/s, the data of my\\nnylon from 1.5 to 60 m/s"
    assert f"# extrapolation: {beyond}" in head("--from", "1.5", "--to", "200", "--points", "12")
    assert beyond in capsys.readouterr().err
    inside = head(
        "--from", "1.4999", "--to", "60.01", "--points", "12"
    )  # to four digits the data's
    assert "extrapolation" not in inside
    assert "# all rows lie between the fit's data" in inside
    assert capsys.readouterr().err == ""


def test_curve_band_and_table_agree_on_what_is_not_known(at, capsys, above_yield):
    result, path = above_yield
    grid = ["--from", "0.2", "--to", "20", "--points", "12"]
    assert curve("--fit", path, *grid, "--format", "csv", "npy", "table", "png") == 0
    assert "not-known: of 14 velocities" in capsys.readouterr().err
    out = at / "results"
    velocity = column(out / "curve.csv", 0)
    known = result.known(velocity)
    assert 0 < np.sum(known) < 14
    np.testing.assert_array_equal(np.isfinite(column(out / "curve.csv", 1)), known)
    np.testing.assert_array_equal(np.isfinite(result.band(velocity).low), known)
    np.testing.assert_array_equal(np.isfinite(np.load(out / "curve.npy")["low"]), known)
    lines = (out / "curve.csv").read_text(encoding="utf-8").splitlines()[1:]
    np.testing.assert_array_equal([line.endswith(",NOT_KNOWN") for line in lines], ~known)
    np.testing.assert_array_equal(np.loadtxt(out / "curve.txt")[:, 0], velocity[known])
    header = (out / "curve.txt").read_text(encoding="utf-8")
    assert f"nothing is known below {result.material().known_from:.6g} m/s" in header
    assert curve("--fit", path, "--from", "0.1", "--to", "0.2", "--out", "none") == 2
    assert "nothing is known" in capsys.readouterr().err
    assert not (at / "none").exists()


def test_a_file_that_is_no_fit_is_refused(at, capsys):
    (at / "fit.json").write_text("{}", encoding="utf-8")
    assert curve("--fit", "fit.json") == 2
    assert capsys.readouterr().err.startswith("fit.json: is no result of a fit: ")


def test_a_fit_of_a_law_of_ones_own_is_refused_with_the_reason(at, capsys):
    def mine(restitution):
        return sj.ConstantRestitution(None, restitution)

    data = cal.RestitutionData(np.arange(1.0, 9), 0.8 + 0.01 * np.sin(np.arange(8.0)))
    start = {"restitution": cal.Parameter(0.8, bounds=(0.01, 1))}
    cal.fit(data, mine, start, profiles=False).save(at / "fit.json")
    assert curve("--fit", "fit.json") == 2
    told = capsys.readouterr().err
    assert "mine, which is none of" in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--chi", "0"], "--chi"),
        (["--sigma", "0"], "--sigma"),
        (["--psi", "0"], "--psi"),
        (["--set", "chi=0.1"], "--set"),
        (["chrome-steel", "--material", "nylon"], "`MATERIAL` must be left out with --fit and"),
        (["--material", ""], "--material"),
    ],
)
def test_options_beside_a_fit_that_would_not_act_are_refused(
    at, capsys, above_yield, options, said
):
    assert curve("--fit", above_yield[1], *options) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert list(at.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["brass"], "nylon"),
        (["nylon", "--from", "2", "--to", "1"], "--to"),
        (["nylon", "--velocities", "none.csv"], "none.csv: no such file"),
        (["nylon", "--velocities", "-", "--points", "3"], "--velocities"),
        (["nylon", "--area", "hertz"], "--chi"),
        (["nylon", "--rtol", "1e-9"], "--rtol"),
        (["nylon", "--chi", "-1"], "chi"),
        (["nylon", "--set", "chii=1"], "did you mean 'chi'"),
        (["nylon", "--set", "contact=1"], "--set"),
        (["nylon", "--law", "hertz", "--chi", "1"], "--chi"),
        (["nylon", "--law", "hertz", "--set", "sigma=1"], "--set"),
        (["nylon", "--law", "constant"], "restitution=…"),
        (["nylon", "--law", "constant", "--set", "restitution"], "name=value"),
        (["--fit", "none.json"], "none.json: no such file"),
        (["--fit", "none.json", "--law", "zhou"], "--law"),
        (["nylon", "--material", "x"], "--material"),
        (["", "--points", "3"], "MATERIAL"),
        (["nylon", "--law", "constant", "--set", "restitution=2"], "in [0, 1], but is 2"),
    ],
)
def test_unusable_options_are_told_in_one_line_and_write_nothing(at, capsys, options, said):
    assert curve(*options) == 2
    told = capsys.readouterr()
    assert said in told.err
    assert told.err.count("\n") == 1
    assert list(at.iterdir()) == []


def test_a_bad_line_far_down_leaves_no_file(at, capsys):
    lines = ["velocity", *["1.5"] * 70_000, "slow"]
    (at / "v.csv").write_text("\n".join(lines), encoding="utf-8")
    assert curve("nylon", "--velocities", "v.csv", "--format", "csv", "npy") == 2
    assert "v.csv:70002: velocity is 'slow'" in capsys.readouterr().err
    assert [path.name for path in at.iterdir()] == ["v.csv"]
