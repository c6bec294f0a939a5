"""`softjax sensitivity` from the command line to its files: every option acts, or is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration.cli import main
from tests.command import BODIES
from tests.fit_data import twin

DESIGN = ("nylon", "--study", "design", "--from", "2", "--to", "60", "--shots", "6")


def saved(*options: str) -> dict:
    assert main(["sensitivity", *options]) == 0
    return json.loads(Path("results/sensitivity.json").read_text(encoding="utf-8"))


UNLIKE = (
    BODIES.replace("radius = 0.0127", "radius_1 = 0.006\nradius_2 = 0.004\ndata = 'd.csv'")
    + """
[material.second]
youngs_modulus = 5e9
poisson_ratio = 0.35
density = 2700
yield_strength = 9e7
"""
)


def test_unlike_spheres_have_properties_of_their_own(at):
    """ε has no unit of length, nor of mass: both radii, and both densities with all pressures, cancel."""
    (at / "unlike.toml").write_text(UNLIKE, encoding="utf-8")
    (at / "d.csv").write_text("velocity,restitution\n0.1,0.8\n5,0.7\n", encoding="utf-8")
    few = ("--study", "local", "--at", "5", "--points", "9")
    slopes = saved("unlike.toml", "--law", "thornton", *few)["local"]
    slopes = {name: slope[0] for name, slope in slopes["theta_d_epsilon_d_theta"].items()}
    of = lambda *names: sum(slopes[f"{who}{n}"] for n in names for who in ("", "second."))  # noqa: E731
    assert slopes["radius_1"] == pytest.approx(-slopes["radius_2"], rel=1e-6)
    assert abs(slopes["radius_1"]) > 1e-4
    assert of("youngs_modulus", "yield_strength", "density") == pytest.approx(0.0, abs=1e-9)
    assert slopes["second.yield_strength"] == 0.0


@pytest.mark.parametrize(("ends", "bars"), [("1 4", [1, 2, 4]), ("1 100", [2, 20, 100])])
def test_bars_stand_at_three_velocities(ends, bars, at):
    """A fifth of the highest, or the geometric mean where that is higher."""
    low, high = ends.split()
    law = ("--law", "constant", "--set", "restitution=0.8")  # soon compiled
    found = saved("nylon", *law, "--from", low, "--to", high)["local"]["velocity"]
    assert found == pytest.approx(bars)
    written = np.loadtxt("results/sensitivity.csv", delimiter=",", skiprows=1, usecols=0)
    np.testing.assert_allclose(written, np.geomspace(float(low), float(high), 200))


def test_parameters_are_freed_and_fixed_as_requested(at):
    options = ("nylon", "--study", "information", "--from", "0.2")
    known = saved(*options, "--free", "contact.yield_strength=4e5", "--fix", "psi")["information"]
    assert set(known["standard_errors"]) == {"chi", "sigma", "contact.yield_strength"}
    assert known["standard_errors"]["contact.yield_strength"] < 4e5
    np.testing.assert_allclose(np.diff(known["velocity"], 2), 0, atol=1e-12)
    assert (known["velocity"][0], len(known["velocity"])) == (0.2, 30)
    open_ = saved(*options, "--free", "contact.yield_strength", "--fix", "psi")["information"]
    assert open_["standard_errors"]["contact.yield_strength"] > 4e5


def test_the_design_follows_its_options(at):
    plain = saved(*DESIGN)["design"]
    assert sum(place["shots"] for place in plain["support"]) == 6
    assert plain["gain"] > 1
    assert plain["bounds"] == [2.0, 60.0]
    assert plain["uncertainty"] == [0.01] * 6
    assert (plain["criterion"], plain["target"]) == ("c", "chi")
    assert saved(*DESIGN, "--criterion", "D")["design"]["criterion"] == "D"
    law = ("--law", "thornton", "--set", "yield_factor=1.6")
    assert saved(*DESIGN, *law)["design"]["target"] == "yield_factor"
    errors = plain["relative_errors"]
    losses = saved(*DESIGN, "--target", "eps_up")["design"]["relative_errors"]
    assert losses["eps_up"] < errors["eps_up"]
    fine = saved(*DESIGN, "--uncertainty", "0.001")["design"]["relative_errors"]
    assert fine["chi"] == pytest.approx(0.1 * errors["chi"])
    few = saved(*DESIGN[:-2], "--precision", "3%", "--target", "eps@20")["design"]
    assert few["target"] == "eps@20"
    assert few["relative_errors"]["eps@20"] <= 0.03
    assert saved(*DESIGN[:-2], "--precision", "0.03", "--target", "eps@20")["design"] == few


def test_plans_of_drops_are_in_their_unit_and_air_and_say_what_is_known_now(at, capsys):
    """The planned height of a measured drop's velocity is that drop's."""
    drop = [5.0, 10.0, 20.0, 40.0, 80.0, 150.0]
    rows = zip(drop, [4.4, 8.5, 16.4, 32.6, 63.0, 115.1], strict=True)
    text = "\n".join(["drop_height [cm],rebound_height [cm]", *(f"{a},{b}" for a, b in rows)])
    Path("drops.csv").write_text(text, encoding="utf-8")
    file = BODIES.replace("radius = 0.0127", 'radius = 0.0127\nheight_uncertainty = "1 mm"')
    Path("drops.toml").write_text(file.rstrip() + '\ndata = "drops.csv"\n', encoding="utf-8")
    law = ("--law", "viscoelastic", "--quiet", "--starts", "1", "--no-profiles")
    assert main(["fit", "drops.toml", "--out", "fitted", *law]) == 0
    data = cal.FitResult.load("fitted/fit.json").materials[0].data
    np.testing.assert_allclose(data.fall.height(data.velocity), drop, rtol=1e-9)
    assert data.fall.diameter == pytest.approx(2 * 0.0127)
    plan = ("--fit", "fitted/fit.json", "--shots", "2")
    saved(*plan, "--study", "design")
    header, *lines = Path("results/design.csv").read_text(encoding="utf-8").splitlines()
    assert header == "velocity [m/s],shots,drop height [cm]"
    out = " ".join(capsys.readouterr().out.split())
    for line in lines:
        v, shots, height = map(float, line.split(","))
        assert height == pytest.approx(np.interp(v, data.velocity, drop), rel=0.05)
        assert f"{shots:g} from {height:g} cm" in out
    assert " now," in out
    assert "Nothing is planned below" not in out
    known = saved(*plan, "--study", "information")["information"]
    result = cal.FitResult.load("fitted/fit.json")
    error = result.standard_errors["dissipation_time"] / result.values["dissipation_time"]
    assert known["before"]["dissipation_time"] == pytest.approx(error, rel=1e-3)


def test_a_drop_of_its_own_error_is_planned_where_that_is_asked_for(at, capsys):
    """3 mm with ± 1 mm: the lowest drop is 1 cm, or what --from says."""
    height = np.array([0.3, 2.0, 10.0, 30.0, 90.0])
    rows = zip(height, 0.81 * height, strict=True)
    text = "\n".join(["drop_height [cm],rebound_height [cm]", *(f"{a},{b:.4g}" for a, b in rows)])
    Path("drops.csv").write_text(text, encoding="utf-8")
    file = BODIES.replace(
        "radius = 0.0127", 'radius = 0.0127\nair = false\nheight_uncertainty = "1 mm"'
    )
    Path("drops.toml").write_text(file.rstrip() + '\ndata = "drops.csv"\n', encoding="utf-8")
    law = ("--law", "constant", "--quiet", "--starts", "1", "--no-profiles")
    assert main(["fit", "drops.toml", "--out", "fitted", *law]) == 0
    plan = ("--fit", "fitted/fit.json", "--shots", "2", "--study", "design")
    lowest = (2 * 9.80665 * 0.01) ** 0.5
    assert saved(*plan)["design"]["bounds"][0] == pytest.approx(lowest, rel=1e-4)
    said = f"Nothing is planned below {lowest:.4g} m/s, where the stated error is 10 % of the reading; --from allows it."
    assert said in " ".join(capsys.readouterr().out.split())
    assert saved(*plan, "--from", "0.3")["design"]["bounds"][0] == 0.3


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    data = twin("nylon", noise=0.003, seed=1, uncertainty=0.003)
    return cal.fit(data, route=sj.EnergyBalance(), profiles=False, starts=4)


def test_a_fit_is_planned_with_its_own_points(at, fit):
    result = fit
    fit.save("fit.json")
    measured = saved("--fit", "fit.json", "--study", "information")["information"]
    for name, error in measured["standard_errors"].items():
        assert error == pytest.approx(result.standard_errors[name], rel=1e-4)
    none = saved("--fit", "fit.json", "--study", "information", "--shots", "0")["information"]
    assert none["standard_errors"] == pytest.approx(measured["standard_errors"])
    more = saved("--fit", "fit.json", "--study", "information", "--shots", "50")["information"]
    assert more["standard_errors"]["chi"] < 0.8 * measured["standard_errors"]["chi"]
    design = saved("--fit", "fit.json", "--study", "design", "--shots", "5")["design"]
    assert design["before"] == pytest.approx(measured["relative_standard_errors"])
    assert design["uncertainty"] == pytest.approx([0.003] * 5)
    losses = saved("--fit", "fit.json", "--study", "design", "--target", "eps_up")["design"]
    found = result.material().derived["eps_up"]
    relative = found.standard_error / found.value
    assert losses["before"]["eps_up"] == pytest.approx(relative, rel=1e-3)
    assert losses["relative_errors"]["eps_up"] < design["relative_errors"]["sigma"]


def test_a_plan_repeats_warnings_and_bounds_of_its_fit_and_names_the_way_out(at, capsys, fit):
    warning = cal.FitWarning("residual-runs", "2 runs where 6 are expected", fit.material().name)
    replace(fit, warnings=(warning, replace(warning, material="another"))).save("doubted.json")
    planned = saved("--fit", "doubted.json", "--study", "information")
    assert planned["warnings"] == [str(warning)]
    out = " ".join(capsys.readouterr().out.split())
    assert "The plan relies on this fit, which has these warnings: ! residual-runs" in out
    at_its_bound(fit, "psi", 0.7).save("bound.json")
    found = saved("--fit", "bound.json", "--study", "information")["information"]
    (entry,) = found["taken_as_known"]
    assert entry == "psi is at its bound 0.7 and is taken as known: errors may be larger"
    assert entry in " ".join(capsys.readouterr().out.split())
    part = replace(fit.material(), known_from=0.8352)
    replace(fit, materials=(part,)).save("part.json")
    command = ["sensitivity", "--fit", "part.json", "--study", "design", "--from", "0.1"]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "but is 0.1" in error  # the lowest velocity, which is outside
    assert "0.8352 m/s or more, where this fit knows the law" in error
    assert "`softjax sensitivity FILE.toml --set chi=… sigma=… psi=… --study design" in error
    assert "inf" not in error


def at_its_bound(fit: cal.FitResult, name: str, value: float) -> cal.FitResult:
    """The same fit with one parameter that stopped at a bound."""
    k = fit.covariance_names.index(name)
    covariance = fit.covariance.copy()
    covariance[k] = covariance[:, k] = np.nan
    material = fit.material()
    stopped = cal.Estimate(value, None, None, None, "profile", True, True)
    parameters = {**material.parameters, name: stopped}
    values = {**material.values, name: value}
    material = replace(material, parameters=parameters, values=values)
    return replace(fit, materials=(material,), covariance=covariance)
