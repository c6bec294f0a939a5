"""`softjax fit` from end to end: the main job once for all tests, and a file of one's own."""

import contextlib
import io
import json
import struct

import numpy as np
import pytest

import softjax as sj
from calibration import cli
from calibration.fitting import fit
from calibration.result import FitResult
from tests.made_fits import noisy_data

CHI = {"stainless steel": 1.7944, "chrome steel": 0.09867, "nylon": 0.21998}  # least squares, SciPy
RMS = {"stainless steel": 0.01502, "chrome steel": 0.000965, "nylon": 0.00935}
LINE_RMS = {"stainless steel": 0.0167, "chrome steel": 0.0345, "nylon": 0.0162}
TABLE_1 = {  # σ, ψ
    "stainless steel": (3.0432, 0.5400),
    "chrome steel": (0.1418, 0.3114),
    "nylon": (0.4355, 0.5414),
}
ALLOY = """
[fit]
{settings}
[[material]]
name = "my alloy"
youngs_modulus = 2.5e9
poisson_ratio = 0.30
density = 1140
yield_strength = 4.0e7
radius = 0.0127
data = "my_alloy.csv"
"""


def run(*argv) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of one command line."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.main([str(word) for word in argv])
    return code, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def main_job(tmp_path_factory):
    """`softjax fit`: its exit code, its output and its directory."""
    out = tmp_path_factory.mktemp("main") / "results"
    return *run("fit", "--out", out), out


@pytest.fixture(scope="module")
def fits(main_job) -> dict:
    table = json.loads((main_job[3] / "fit.json").read_text(encoding="utf-8"))
    return table | {"by_name": {fit["material"]: fit for fit in table["fits"]}}


@pytest.fixture(scope="module")
def alloy(tmp_path_factory):
    """A directory with a data file; `write(settings)` makes the material file."""
    directory = tmp_path_factory.mktemp("own")
    data = noisy_data()
    points = zip(data.velocity.tolist(), data.restitution.tolist(), strict=True)
    lines = ["velocity [m/s],restitution,uncertainty", *(f"{v!r},{e!r},0.01" for v, e in points)]
    (directory / "my_alloy.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")

    def write(settings: str):
        path = directory / "alloy.toml"
        path.write_text(ALLOY.format(settings=settings), encoding="utf-8")
        return path

    return write


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
    assert {path.name for path in directory.iterdir()} >= {"fit.json", "curves.png", "report.md"}
    assert size_of(directory / "curves.png")[0] > 1500


@pytest.mark.parametrize("name", CHI)
def test_the_main_job_finds_what_least_squares_found(fits, name):
    fit = fits["by_name"][name]
    assert fit["n"] == 40
    assert fit["converged"] is True
    chi, sigma, psi = (fit["parameters"][key]["value"] for key in ("chi", "sigma", "psi"))
    assert chi == pytest.approx(CHI[name], rel=1e-3)
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
    for printed in ("0.1368", "0.0239", "3.0432", "0.3114", "0.8352", "54.25"):
        assert printed in told
    assert "Levenberg–Marquardt through the energy balance" in told
    assert fits["beside"]["largest_difference"] < 1e-6
    assert fits["times"]["beside"] > 0


def test_fit_json_says_how_it_was_made_and_loads_back(fits, main_job):
    settings = fits["settings"]
    expected = {"objective": "two-step", "route": "ode", "form": "first-order", "x64": True}
    assert expected.items() <= settings.items()
    assert {"softjax-contact", "jax", "diffrax"} <= fits["versions"].keys()
    assert "NaN" not in (main_job[3] / "fit.json").read_text(encoding="utf-8")
    loaded = FitResult.load(main_job[3] / "fit.json")
    assert loaded.values["chi[nylon]"] == fits["by_name"]["nylon"]["parameters"]["chi"]["value"]


def test_the_report_names_the_pictures_that_are_there(main_job):
    directory = main_job[3]
    report = (directory / "report.md").read_text(encoding="utf-8")
    for picture in ("curves.png", "profiles.png", "correlation.png"):
        assert (f"]({picture})" in report) == (directory / picture).exists()
    assert "published fit of measurements" in report


def test_an_own_file_gives_the_same_as_its_data_in_python(alloy, tmp_path):
    file = alloy('route = "energy balance"\nstarts = 2')
    code, out, err = run("fit", file, "--quiet", "--out", tmp_path / "results", "--seed", "3")
    assert (code, out, err) == (0, "", "")
    result = FitResult.load(tmp_path / "results" / "fit.json")
    assert (result.settings["route"], result.settings["seed"]) == ("energy balance", 3)
    same = fit(noisy_data(), route=sj.EnergyBalance(), starts=2, seed=3)
    assert result.values == pytest.approx(same.values, rel=1e-12)
    names = {path.name for path in (tmp_path / "results").iterdir()}
    assert names == {"fit.json", "curves.png", "report.md", "profiles.png", "correlation.png"}
    assert "--seed 3" in (tmp_path / "results" / "report.md").read_text(encoding="utf-8")


def test_the_settings_of_a_file_act_and_the_same_seed_gives_the_same_bytes(alloy, tmp_path):
    settings = ['route = "energy balance"', "starts = 2", 'loss = "huber"', "loss_scale = 2.0"]
    file = alloy("\n".join([*settings, "confidence = 0.9", "max_steps = 150"]))
    tables = []
    for name in ("one", "two"):
        assert run("fit", file, "--quiet", "--out", tmp_path / name)[0] == 0
        tables.append((tmp_path / name / "fit.json").read_text(encoding="utf-8"))
    one, two = (text[: text.index('"times"')] for text in tables)  # the last entry
    assert one == two
    table = json.loads(tables[0])
    assert table["confidence"] == 0.9
    assert (table["settings"]["loss_scale"], table["settings"]["max_steps"]) == (2.0, 150)
    narrow = table["fits"][0]["parameters"]["chi"]["interval"]
    wide = fit(noisy_data(), route=sj.EnergyBalance(), starts=2, loss="huber", loss_scale=2.0)
    assert wide.intervals["chi"][0] < narrow[0] < narrow[1] < wide.intervals["chi"][1]


@pytest.mark.parametrize(("asked", "method"), [("weighted", "weighted"), ("none", None)])
def test_the_file_says_how_eq_18_is_fitted(asked, method, alloy, tmp_path):
    file = alloy(f'route = "energy balance"\nstarts = 1\nunloading_line = "{asked}"')
    second = ALLOY.format(settings="").replace("[fit]", "").replace("my alloy", "another")
    file.write_text(file.read_text(encoding="utf-8") + second.replace("4.0e7", "6.0e7"), "utf-8")
    assert run("fit", file, "--quiet", "--out", tmp_path)[0] == 0
    line = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))["unloading_line"]
    assert (line and line["method"]) == method


def test_what_the_fit_refuses_is_one_line_and_exit_code_2(alloy, tmp_path):
    file = alloy("")
    file.write_text(file.read_text(encoding="utf-8") + "[material.parameters]\nrestitution = 0.5\n")
    code, out, err = run("fit", file, "--out", tmp_path / "results")
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert err.startswith(f"{file}: 'restitution' does not act under 'two-step'")
    assert not (tmp_path / "results").exists()


def test_a_fit_that_does_not_converge_is_written_marked_and_ends_with_1(alloy, tmp_path):
    file = alloy('route = "energy balance"\nstarts = 1\nmax_steps = 1')
    out = tmp_path / "results"
    code, told, err = run("fit", file, "--out", out)
    assert code == 1
    assert len(err.splitlines()) == 1
    assert "NOT CONVERGED" in told
    table = json.loads((out / "fit.json").read_text(encoding="utf-8"))
    assert table["fits"][0]["converged"] is False
    assert "did not converge" in (out / "report.md").read_text(encoding="utf-8")


def test_too_few_points_are_refused_and_nothing_is_written(tmp_path):
    file = tmp_path / "few.toml"
    file.write_text(ALLOY.format(settings=""), encoding="utf-8")
    rows = [f"{v},{0.9}" for v in np.linspace(1.0, 2.0, 3)]
    csv = "\n".join(["velocity,restitution", *rows])
    (tmp_path / "my_alloy.csv").write_text(csv + "\n", encoding="utf-8")
    code, told, err = run("fit", file, "--out", tmp_path / "results")
    assert (code, told) == (2, "")
    assert len(err.splitlines()) == 1
    assert "my_alloy.csv" in err
    assert not (tmp_path / "results").exists()
