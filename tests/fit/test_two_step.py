"""The paper's procedure, Eq. (17) and then χ̃, with its errors; and Eq. (18)'s line through materials."""

import json
from dataclasses import replace

import lmfit
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.fit_data import TRUTH, eq_17_data, pair
from tests.fit_oracle import own_model

# found independently by least squares on the energy balance
CHI = {"stainless steel": 1.7944, "chrome steel": 0.09867, "nylon": 0.21998}
RMS = {"stainless steel": 0.01502, "chrome steel": 0.000965, "nylon": 0.00935}
LINE_RMS = {"stainless steel": 0.0167, "chrome steel": 0.0345, "nylon": 0.0162}
NAMES = tuple(CHI)
QUICK = {"objective": "two-step", "optimiser": "levenberg-marquardt", "starts": 1}
QUICK |= {"route": sj.EnergyBalance(), "profiles": False}
Free = cal.Parameter


@pytest.fixture(scope="module")
def result():
    return cal.fit(cal.paper_materials(), objective="two-step")


@pytest.mark.parametrize("name", CHI)
def test_values_are_those_of_table_1_and_of_independent_least_squares(result, name):
    fit = result.material(name)
    assert fit.n == 40
    assert fit.converged
    assert result.values[f"sigma[{name}]"] == pytest.approx(TRUTH[name][2], abs=5e-5)
    assert result.values[f"psi[{name}]"] == pytest.approx(TRUTH[name][3], abs=5e-5)
    assert result.values[f"chi[{name}]"] == pytest.approx(CHI[name], rel=1e-4)
    assert result.rms[name] == pytest.approx(RMS[name], rel=1e-3)
    assert result.rms_empirical[name] < 1e-12


def test_the_line_of_eq_18_has_larger_residuals_and_is_found_by_levenberg_and_marquardt_too(result):
    """Through all curves, not through the χ̃; and with c1 and c2 as parameters."""
    line = result.unloading_line
    alone = cal.fit(cal.paper_materials(), None, {"c1": Free(), "c2": Free()}, **QUICK)
    for c1, c2 in ((line.c1.value, line.c2.value), (alone.values["c1"], alone.values["c2"])):
        assert c1 == pytest.approx(0.03184, abs=6e-6)
        assert c2 == pytest.approx(0.004554, abs=6e-7)
    for name, rms in LINE_RMS.items():
        assert line.rms[name] == pytest.approx(rms, abs=6e-5)
        on_line = line.c1.value + line.c2.value * float(pair(name).yield_ratio)
        assert line.chi[name].value == pytest.approx(on_line, rel=1e-12)
        found = alone.values["c1"] + alone.values["c2"] * float(pair(name).yield_ratio)
        assert alone.values[f"chi[{name}]"] == pytest.approx(found, rel=1e-9)
        assert float(np.asarray(alone.law[name].chi)) == pytest.approx(found, rel=1e-9)
    assert line.through_chi["c2"].value != pytest.approx(line.c2.value, rel=1e-2)
    other = cal.fit(cal.paper_materials(), **QUICK)
    for name, value in result.values.items():
        assert other.values[name] == pytest.approx(value, rel=1e-7)
    line = other.unloading_line
    assert line.c2.value == pytest.approx(result.unloading_line.c2.value, rel=1e-6)
    stage = {report.stage: report for report in result.optimiser_report}["model"]
    assert (stage.route, stage.optimiser) == ("ode", "optax L-BFGS")
    assert 3 < stage.evaluations < 300
    assert stage.gradient_norm < 1e-6


def test_the_file_has_the_layout_of_the_interface_and_loads_back_equal(result, tmp_path):
    table = json.loads(result.to_json())
    assert {"fits", "unloading_line", "settings", "versions"} <= set(table)
    first = table["fits"][0]
    expected = {"material", "n", "rms", "rms_empirical", "converged", "warnings", "parameters"}
    assert expected <= set(first)
    assert set(first["parameters"]) == {"chi", "sigma", "psi"}
    line = table["unloading_line"]
    for one in (*first["parameters"].values(), line["c1"], line["c2"]):  # of data without noise
        assert [one["standard_error"], one["low"], one["high"]] == [None] * 3
    keys = {
        "objective": "two-step", "route": "ode", "area": "zhou", "form": "first-order",
        "kappa": "consistent", "x64": True,
    }  # fmt: skip
    assert keys.items() <= table["settings"].items()
    assert {"softjax-contact", "jax", "diffrax"} <= set(table["versions"])
    result.save(tmp_path / "fit.json")
    again = cal.FitResult.load(tmp_path / "fit.json")
    assert again == result
    assert again.to_json() == result.to_json()
    velocity = again.data["nylon"].velocity
    off = sj.restitution(again.law["nylon"], velocity).coefficient - again.data["nylon"].restitution
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(RMS["nylon"], rel=1e-3)
    bands = [one.band(velocity, "nylon", kind="prediction") for one in (result, again)]
    np.testing.assert_allclose(bands[1].high, bands[0].high, rtol=1e-12)


def own_eq_17(data):
    limit = float(data.limit_velocity)
    return lambda sigma, psi: fit_oracle.eq_17(data.velocity, limit, sigma, psi)


def grouped(groups, each, seed=0):
    """Eq. (17)'s impacts of several specimens in turn, each with an offset of its own."""
    data = eq_17_data("stainless steel", points=groups * each, noise=0.006, seed=seed)
    of = np.arange(groups * each) % groups
    off = 0.01 * np.random.default_rng(seed + 100).standard_normal(groups)[of]
    names = [f"specimen {k}" for k in of]
    return replace(data, restitution=data.restitution + off, group=names), of


@pytest.mark.parametrize("kind", ["plain", "groups"])
def test_the_error_of_chi_is_what_noise_in_each_point_does(kind):
    """Both steps refitted by SciPy with every point moved: dχ̃/dε_i, and V of the points."""
    name = "stainless steel" if kind == "groups" else "nylon"
    data, of = grouped(4, 3) if kind == "groups" else (None, None)
    data = data or eq_17_data(name, points=12, noise=0.006, seed=2)
    result = cal.fit(data, **QUICK)
    model, eq_17 = own_model(data), own_eq_17(data)
    _, chi, sigma, psi, _ = TRUTH[name]
    if kind == "groups":
        found = result.materials[0].variances
        covariance = found["scatter"] * np.eye(12) + found["group"] * (of[:, None] == of)
    else:
        off = fit_oracle.fit(eq_17, [sigma, psi], data.restitution)[2]
        covariance = np.eye(12) * np.sum(off**2) / 10
    lower = np.linalg.cholesky(covariance)
    white = lambda x: np.linalg.solve(lower, eq_17(*x) - data.restitution)  # noqa: E731
    losses = least_squares(white, [sigma, psi], x_scale=[sigma, psi], xtol=1e-14, ftol=1e-14).x
    moves = 1e-6 * np.diag(losses)
    slope = [(eq_17(*(losses + m)) - eq_17(*(losses - m))) / (2 * np.max(m)) for m in moves]
    solved = np.linalg.solve(covariance, np.transpose(slope))
    influence = np.linalg.solve(np.stack(slope) @ solved, solved.T)

    def chi_with(i, step):
        moved, expected = data.restitution + step * np.eye(12)[i], losses + step * influence[:, i]
        return fit_oracle.fit(lambda c: model(c, *expected), [chi], moved)[0][0]

    step = 5e-4
    slopes = [(chi_with(i, step) - chi_with(i, -step)) / (2 * step) for i in range(12)]
    np.testing.assert_allclose([result.values["sigma"], result.values["psi"]], losses, rtol=1e-5)
    value, error = chi_with(0, 0.0), np.sqrt(slopes @ covariance @ slopes)
    assert result.values["chi"] == pytest.approx(value, rel=1e-5)
    assert result.standard_errors["chi"] == pytest.approx(error, rel=2e-4)
    if kind != "groups":
        reach = stats.t.ppf(0.975, 10)
        high = result.intervals["chi"][1]
        assert np.log(high / value) == pytest.approx(reach * error / value, rel=1e-3)


def test_profiles_of_eq_17_are_lmfit_s_and_eps_up_has_the_error_of_its_losses():
    data = eq_17_data("stainless steel", noise=0.02, seed=6)
    result = cal.fit(data, **QUICK | {"profiles": True})
    eq_17 = own_eq_17(data)
    start = lmfit.Parameters()
    start.add_many(("sigma", result.values["sigma"]), ("psi", result.values["psi"]))
    mini = lmfit.Minimizer(lambda p: eq_17(p["sigma"], p["psi"]) - data.restitution, start)
    found = mini.minimize(method="least_squares", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    limits = lmfit.conf_interval(mini, found, sigmas=[0.95])
    for parameter in ("sigma", "psi"):
        (_, low), (_, _), (_, high) = limits[parameter]
        assert result.intervals[parameter] == pytest.approx((low, high), rel=1e-3)
    assert result.estimates["chi"].method == "sandwich"
    assert set(result.profiles) == {"sigma", "psi"}
    assert result.log_likelihood is None
    ratio = float(data.contact.critical_velocity)
    ratio /= float(data.contact.limit_velocity) - ratio
    values, covariance, _ = fit_oracle.fit(eq_17, TRUTH["stainless steel"][2:4], data.restitution)
    loss = values[0] * ratio ** values[1]
    slope = -np.exp(-loss) * loss * np.array([1 / values[0], np.log(ratio)])
    derived = result.estimates["eps_up"]
    assert derived.value == pytest.approx(np.exp(-loss), rel=1e-6)
    assert derived.standard_error == pytest.approx(np.sqrt(slope @ covariance @ slope), rel=0.01)


def three(names=NAMES):
    """The paper's materials with noise."""
    return [eq_17_data(name, noise=0.01, seed=len(name)) for name in names]


def test_the_line_weighs_what_is_fitted_on_any_scale(tmp_path):
    """NumPy's weighted line through the fitted χ̃ and their standard errors, and these with the scatter."""
    sets = three()
    result, again = (
        cal.fit(sets, parameters={"chi": Free(bounds=(0.01, 2.5))}, unloading_line=line, **QUICK)
        for line in ("curves", "weighted")
    )
    ratio = [float(pair(name).yield_ratio) for name in NAMES]
    chi = [result.values[f"chi[{name}]"] for name in NAMES]
    errors = np.array([result.standard_errors[f"chi[{name}]"] for name in NAMES])
    line = np.polyfit(ratio, chi, 1, w=1 / errors)
    influence = np.stack([np.polyfit(ratio, one, 1, w=1 / errors) for one in np.eye(3)], axis=1)
    for fit in (result, again):
        scatter = fit.unloading_line.scatter
        c1, c2 = (getattr(fit.unloading_line, name).value for name in ("c1", "c2"))
        size = np.hypot(errors, scatter * (c1 + c2 * np.array(ratio)))
        expected = np.sqrt(influence**2 @ size**2)
        found = fit.unloading_line.through_chi
        for name, value, error in zip(("c2", "c1"), line, expected, strict=True):
            assert found[name].value == pytest.approx(value, rel=1e-9)
            assert found[name].standard_error == pytest.approx(error, rel=1e-6)
    assert again.unloading_line.c1 == found["c1"]
    again.report(tmp_path)
    report = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert f"c2 include the scatter about the line, {100 * scatter:.2g} %." in report
    assert cal.fit(sets, unloading_line=None, **QUICK).unloading_line is None


def test_the_line_is_of_each_set_s_own_parameters():
    """Sets that share a parameter are one fit; the line through all does not depend on their order."""
    parameters = {f"psi[{name}]": Free(shared="both") for name in ("stainless steel", "nylon")}
    parameters |= {"psi[chrome steel]": 0.3114}
    first, second = (
        cal.fit(three(names), parameters=parameters, **QUICK).unloading_line
        for names in (NAMES, ("stainless steel", "nylon", "chrome steel"))
    )
    assert first.c1.value == pytest.approx(second.c1.value, rel=1e-6)
    assert first.c2.value == pytest.approx(second.c2.value, rel=1e-6)

    def squared(contact, chi):
        return sj.Zhou(contact, chi=chi**2, sigma=0.4, psi=0.5)

    alone = cal.fit(three()[::2], squared, **QUICK | {"objective": "model"})
    assert alone.unloading_line is None  # its `chi` is what its function makes of it
