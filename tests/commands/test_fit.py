"""`softjax fit` from end to end: the main job once for all tests, and files of one's own."""

import json
import struct

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.command import ALLOY, noisy, run, write_alloy

CHI = {"stainless steel": 1.7944, "chrome steel": 0.09867, "nylon": 0.21998}  # least squares, SciPy
RMS = {"stainless steel": 0.01502, "chrome steel": 0.000965, "nylon": 0.00935}
LINE_RMS = {"stainless steel": 0.0167, "chrome steel": 0.0345, "nylon": 0.0162}
TABLE_1 = {  # σ, ψ
    "stainless steel": (3.0432, 0.5400),
    "chrome steel": (0.1418, 0.3114),
    "nylon": (0.4355, 0.5414),
}


@pytest.fixture(scope="module")
def main_job(tmp_path_factory):
    """`softjax fit`: its exit code, its output and its directory."""
    out = tmp_path_factory.mktemp("main") / "results"
    return *run("fit", "--out", out), out


@pytest.fixture(scope="module")
def fits(main_job) -> dict:
    table = json.loads((main_job[3] / "fit.json").read_text(encoding="utf-8"))
    return table | {"by_name": {fit["material"]: fit for fit in table["fits"]}}


def size_of(png) -> tuple[int, int]:
    """Width and height from a PNG's header."""
    head = png.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:])


def test_the_main_job_is_done_without_a_bar_in_a_pipe(main_job):
    code, out, err, directory = main_job
    assert code == 0
    assert err == ""
    assert out.startswith("These data are a published fit of measurements, not measurements")
    files = {"fit.json", "report.md", "report.html", "curves.png", "correlation.png"}
    assert {path.name for path in directory.iterdir()} == files
    assert "outlier" not in out  # of data without scatter none is one
    assert size_of(directory / "curves.png")[0] > 1500


@pytest.mark.parametrize("name", CHI)
def test_the_main_job_finds_what_least_squares_found(fits, name):
    fit = fits["by_name"][name]
    assert fit["n"] == 40
    assert fit["converged"] is True
    chi, sigma, psi = (fit["parameters"][key]["value"] for key in ("chi", "sigma", "psi"))
    assert chi == pytest.approx(CHI[name], rel=1e-4)
    assert f"{sigma:.4f}" == f"{TABLE_1[name][0]:.4f}"
    assert f"{psi:.4f}" == f"{TABLE_1[name][1]:.4f}"
    assert fit["rms"] == pytest.approx(RMS[name], rel=5e-3)
    assert fit["rms_empirical"] < 1e-9


def test_the_line_of_eq_18_is_told_with_its_larger_residuals(fits, main_job):
    line = fits["unloading_line"]
    assert line["c1"]["value"] == pytest.approx(0.03184, rel=1e-3)
    assert line["c2"]["value"] == pytest.approx(0.004554, rel=1e-3)
    for name, rms in LINE_RMS.items():
        assert line["rms"][name] == pytest.approx(rms, abs=6e-5)
        assert f"{line['rms'][name]:.4g}" in main_job[1]


def test_the_table_stands_against_table_1_and_the_second_route(fits, main_job):
    told = main_job[1]
    for printed in ("0.1368", "0.0239", "3.0432", "0.3114", "0.8352", "54.25", "χ̃: unloading"):
        assert printed in told
    tables = told.partition("\nWritten to")[0]  # a folder of any length
    assert max(map(len, tables.splitlines())) <= 100


def test_fit_json_says_how_it_was_made_and_loads_back(fits, main_job):
    expected = {"objective": "two-step", "law": "zhou", "route": "ode", "form": "first-order"}
    assert expected.items() <= fits["settings"].items()
    assert {"softjax-contact", "jax", "diffrax"} <= fits["versions"].keys()
    assert {stage["materials"][0] for stage in fits["optimiser_report"]} == set(CHI)
    loaded = cal.FitResult.load(main_job[3] / "fit.json")
    law = loaded.law["nylon"]
    found = sj.restitution(law, loaded.data["nylon"].velocity).coefficient
    rms = np.sqrt(np.mean((np.asarray(found) - loaded.data["nylon"].restitution) ** 2))
    assert rms == pytest.approx(RMS["nylon"], rel=5e-3)


def test_the_report_names_the_pictures_that_are_there(main_job):
    directory = main_job[3]
    report = (directory / "report.md").read_text(encoding="utf-8")
    for picture in ("curves.png", "profiles.png", "correlation.png"):
        assert (f"]({picture})" in report) == (directory / picture).exists()
    assert "published fit of measurements" in report
    assert "- σ: size of the acoustic and thermal losses" in report
    page = (directory / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == report.count(".png)")
    assert "published fit of measurements" in page


def test_an_own_file_gives_the_same_as_its_data_in_python(tmp_path):
    file = write_alloy(tmp_path, "starts = 2")
    out = tmp_path / "results"
    code, told, err = run("fit", file, "--quiet", "--out", out, "--seed", "3")
    assert (code, told, err) == (0, "", "")
    result = cal.FitResult.load(out / "fit.json")
    assert (result.settings["objective"], result.settings["seed"]) == ("model", 3)
    assert result == cal.fit(noisy(), starts=2, seed=3)
    names = {path.name for path in out.iterdir()}
    assert names == {
        "fit.json",
        "curves.png",
        "report.md",
        "report.html",
        "profiles.png",
        "correlation.png",
    }
    report = (out / "report.md").read_text(encoding="utf-8")
    assert f"`softjax fit {file} --seed 3 --out {out}`" in report


def test_a_fit_that_ends_where_the_range_leaves_its_end_out_has_a_law_and_a_curve():
    """ψ = 0, which no law accepts: a constant ε below yield."""
    result = cal.fit(noisy(), starts=2, profiles=False)
    assert result.values["psi"] == 0
    velocity = np.array([0.2, 0.5, 5.0, 20.0])
    curve = result.band(velocity).coefficient
    assert curve[:2] == pytest.approx(np.exp(-result.values["sigma"]), rel=1e-12)
    law = sj.Zhou(noisy().contact, result.values["chi"], result.values["sigma"], 1e-300)
    assert curve == pytest.approx(np.asarray(sj.restitution(law, velocity).coefficient), rel=1e-9)
    assert result.law.psi > 0


def test_another_law_has_its_parameters_by_name_and_no_eq_17(tmp_path):
    """The same files and tables as Zhou's law."""
    file = write_alloy(tmp_path)
    code, told, _ = run("fit", file, "--law", "viscoelastic", "--out", tmp_path / "out")
    assert code == 0
    table = json.loads((tmp_path / "out" / "fit.json").read_text(encoding="utf-8"))
    (fit,) = table["fits"]
    assert set(fit["parameters"]) == {"dissipation_time"}
    assert fit["rms_empirical"] is None
    assert table["unloading_line"] is None
    assert table["settings"]["law"] == "viscoelastic"
    assert "A [s]" in told
    assert "Eq. (17)" not in told
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"fit.json", "curves.png", "report.md", "report.html", "profiles.png"}


@pytest.mark.parametrize("uncertainty", [0.01, None])
def test_residuals_and_what_each_point_pays_for_are_written(uncertainty, tmp_path):
    """Of a mean of n points each pays for 1/n of a parameter."""
    file = write_alloy(tmp_path, 'law = "constant"', uncertainty=uncertainty)
    run("fit", file, "--quiet", "--out", tmp_path)
    (fit,) = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))["fits"]
    off = np.mean(noisy().restitution) - noisy().restitution
    deviation = np.std(off, ddof=1) if uncertainty is None else uncertainty
    assert fit["leverage"] == pytest.approx(np.full(24, 1 / 24), rel=1e-6)
    assert fit["residual_degrees"] == 23
    np.testing.assert_allclose(
        fit["standardised"], off / deviation / np.sqrt(1 - 1 / 24), rtol=1e-5
    )
    goodness = fit["reduced_chi_squared"], fit["chi_squared_probability"]
    if uncertainty is None:
        assert goodness == (None, None)
        return
    chi_squared = float(np.sum(off**2)) / uncertainty**2
    assert goodness == pytest.approx((chi_squared / 23, stats.chi2.sf(chi_squared, 23)), rel=1e-6)


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    file = write_alloy(tmp_path, 'law = "walton-braun"\nnoise = "student-t"\nnoise_dof = 3.0')
    tables = []
    for name in ("one", "two"):
        assert run("fit", file, "--quiet", "--out", tmp_path / name)[0] == 0
        tables.append((tmp_path / name / "fit.json").read_text(encoding="utf-8"))
    one, two = (text[: text.index('"times"')] for text in tables)  # the last entry
    assert one == two


def test_a_fit_that_does_not_converge_is_written_marked_and_ends_with_1(tmp_path):
    out = tmp_path / "results"
    file = write_alloy(tmp_path, 'law = "walton-braun"\nstarts = 1\nmax_steps = 1')
    code, told, err = run("fit", file, "--out", out)
    assert code == 1
    assert len(err.splitlines()) == 1
    assert "NOT CONVERGED" in told
    table = json.loads((out / "fit.json").read_text(encoding="utf-8"))
    assert table["fits"][0]["converged"] is False
    assert "did not converge" in (out / "report.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("settings", "options", "below", "blamed"),
    [
        (
            "",
            [],
            "restitution = 0.5",
            "alloy.toml:13: parameter is restitution; it must be of zhou",
        ),
        ("", ["--law", "thornton", "--objective", "two-step"], "", "two-step with thornton"),
        ('law = "hertz"\nobjective = "two-step"', [], "", "alloy.toml:4: objective is"),
        ("", ["--rtol", "1e-6", "--route", "energy-balance"], "", "`--rtol` must be left out"),
        ("", ["--noise-dof", "5"], "", "`--noise-dof` must be left out"),
        ("", ["--law", "hertz", "--form", "full"], "", "form"),
        ("", ["--extra-scatter", "--scale-uncertainty"], "", "scale_uncertainty"),
    ],
)
def test_what_the_fit_refuses_is_one_line_and_exit_code_2(
    settings, options, below, blamed, tmp_path
):
    file = write_alloy(tmp_path, settings, below=below)
    code, out, err = run("fit", file, *options, "--out", tmp_path / "results")
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert blamed in err
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("command", ["fit", "compare"])
def test_json_on_standard_output_is_the_file(command, tmp_path):
    """And nothing else is there, so that it can be piped on."""
    file = write_alloy(tmp_path, 'law = "constant"')
    words = ["--laws", "constant"] if command == "compare" else []
    code, out, err = run(command, file, *words, "--json", "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    assert out == (tmp_path / "out" / f"{command}.json").read_text(encoding="utf-8")
    assert json.loads(out)["versions"]


def test_too_few_points_are_refused_and_nothing_is_written(tmp_path):
    file = tmp_path / "few.toml"
    file.write_text(ALLOY.format(settings="", below=""), encoding="utf-8")
    rows = [f"{v},{0.9}" for v in np.linspace(1.0, 2.0, 2)]
    csv = "\n".join(["velocity,restitution", *rows])
    (tmp_path / "my_alloy.csv").write_text(csv + "\n", encoding="utf-8")
    code, told, err = run("fit", file, "--out", tmp_path / "results")
    assert (code, told) == (2, "")
    assert len(err.splitlines()) == 1
    assert "my_alloy.csv" in err
    assert not (tmp_path / "results").exists()
