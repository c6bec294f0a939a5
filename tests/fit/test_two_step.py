"""The paper's procedure, Eq. (17) and then χ̃; Eq. (18)'s line through materials, and a further one by it."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import special, stats

import calibration as cal
import softjax as sj
from calibration import cli, plots
from tests import fit_oracle
from tests.command import run
from tests.fit_data import TRUTH, eq_17_data, pair
from tests.fit_oracle import own_model
from tests.shown.capture import as_recorded, band, bars, drawn, labels, line
from tests.shown.tables import Tags

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
    assert (fit.n, fit.data.remarks) == (40, (cal.PAPER_NOTE,))
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
        assert line.chi[name] == pytest.approx(on_line, rel=1e-12)
        found = alone.values["c1"] + alone.values["c2"] * float(pair(name).yield_ratio)
        assert alone.values[f"chi[{name}]"] == pytest.approx(found, rel=1e-9)
        assert float(np.asarray(alone.law[name].chi)) == pytest.approx(found, rel=1e-9)
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


@pytest.mark.parametrize("noise", [{"extra_scatter": True}, {"noise": "student-t"}])
def test_eq_17_has_the_noise_of_the_fit_that_it_is_compared_with(noise):
    """As fitted by itself; without that noise the least uncertain points decide otherwise."""
    u = np.geomspace(0.001, 0.03, 20)
    data = replace(eq_17_data("nylon", points=20, noise=0.01, seed=3), errors=None, uncertainty=u)
    zhou, alone, plain = (
        cal.fit(data, law, profiles=False, starts=4, **options)
        for law, options in (("zhou", noise), ("eq-17", noise), ("eq-17", {}))
    )
    assert zhou.rms_empirical == pytest.approx(alone.rms, rel=1e-6)
    assert abs(alone.rms / plain.rms - 1) > 0.01


def test_values_alone_with_noise_too_and_one_sentence_says_where_intervals_are(tmp_path):
    """χ̃ by SciPy's two fits in turn; no error, interval, covariance or band; refusals are in `test_refused`."""
    data = eq_17_data("stainless steel", noise=0.02, seed=6)
    result = cal.fit(data, **QUICK | {"profiles": True})
    model, limit = own_model(data), float(data.limit_velocity)
    eq_17 = lambda sigma, psi: fit_oracle.eq_17(data.velocity, limit, sigma, psi)  # noqa: E731
    losses = fit_oracle.fit(eq_17, TRUTH["stainless steel"][2:4], data.restitution)[0]
    (chi,), *_ = fit_oracle.fit(lambda c: model(c, *losses), [1.8], data.restitution)
    values = [result.values[name] for name in ("chi", "sigma", "psi")]
    assert values == pytest.approx([chi, *losses], rel=1e-5)
    errors = result.standard_errors
    assert np.all(np.isnan([errors.pop(name) for name in ("chi", "sigma", "psi")]))
    assert {*errors.values()} == {None}
    assert {*result.intervals.values()} == {(None, None)}
    assert np.all(np.isnan(result.covariance))
    assert (result.profiles, result.log_likelihood) == ({}, None)
    for kind in ("mean", "prediction"):
        curve = result.band(data.velocity, kind=kind)
        exact = sj.restitution(result.law, data.velocity).coefficient
        np.testing.assert_allclose(curve.coefficient, exact, rtol=1e-12)
        assert np.all(np.isnan([curve.low, curve.high, curve.standard_error]))
    sentence = "Intervals come from `model`: `two-step` gives values alone."
    assert sentence in str(result)
    result.report(tmp_path)
    shown = re.sub(r"`([^`]*)`", r"<code>\1</code>", sentence)
    assert shown in (tmp_path / "report.html").read_text("utf-8")
    table = json.loads((tmp_path / "fit.json").read_text("utf-8"))
    assert {x for row in table["covariance"]["matrix"] for x in row} == {None}
    assert cal.FitResult.load(tmp_path / "fit.json") == result
    other = cal.fit(data, **QUICK | {"objective": "model"})
    assert sentence not in str(other)


def three(names=NAMES):
    """The paper's materials with noise."""
    return [eq_17_data(name, noise=0.01, seed=len(name)) for name in names]


def test_the_line_weighs_what_is_fitted_on_any_scale(tmp_path):
    """NumPy's weighted line through the fitted χ̃ and their standard errors, and these with the scatter."""
    sets = three()
    options = QUICK | {"objective": "model"}
    result = cal.fit(sets, parameters={"chi": Free(bounds=(0.01, 2.5))}, **options)
    ratio = [float(pair(name).yield_ratio) for name in NAMES]
    places = [result.covariance_names.index(f"chi[{name}]") for name in NAMES]
    errors = np.sqrt(np.diag(result.covariance)[places])
    chi = [result.values[f"chi[{name}]"] for name in NAMES]
    line = np.polyfit(ratio, chi, 1, w=1 / errors)
    influence = np.stack([np.polyfit(ratio, one, 1, w=1 / errors) for one in np.eye(3)], axis=1)
    scatter = result.unloading_line.scatter
    c1, c2 = (getattr(result.unloading_line, name).value for name in ("c1", "c2"))
    size = np.hypot(errors, scatter * (c1 + c2 * np.array(ratio)))
    expected = np.sqrt(influence**2 @ size**2)
    for name, value, error in zip(("c2", "c1"), line, expected, strict=True):
        found = result.unloading_line.through_chi[name]
        assert found.value == pytest.approx(value, rel=1e-9)
        assert found.standard_error == pytest.approx(error, rel=1e-6)
    result.report(tmp_path)
    report = Tags((tmp_path / "report.html").read_text(encoding="utf-8")).words
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


C1, C2, SCATTER = 0.05, 0.004, 0.08
STRENGTHS = np.array([2.2e8, 3.0e8, 4.0e8, 5.5e8, 8.0e8, 1.2e9])
ALLOYS = [f"alloy {k}" for k in range(6)]


def contact_of(strength):
    alloy = sj.Material(1.05e11, 0.33, 8500.0, float(strength))
    return sj.Contact.between_spheres(alloy, alloy, 0.01, 0.01)


CONTACTS = [contact_of(strength) for strength in STRENGTHS]
NEXT = contact_of(6.5e8)
AT = np.array([1.0, float(NEXT.yield_ratio)])
V = float(NEXT.critical_velocity) * np.array([0.5, 2.0, 20.0])
RATIOS = np.array([float(contact.yield_ratio) for contact in CONTACTS])


@pytest.fixture(scope="module")
def six():
    """χ̃ and ε_up of each material, the fit of its rebounds above yield, noise 0.002, and its line."""
    random = np.random.default_rng(4)
    chi = (C1 + C2 * RATIOS) * (1 + SCATTER * random.standard_normal(6))
    up = 1 / (1 + np.exp(-(3.5 + 0.3 * random.standard_normal(6))))
    sets = []
    for k, contact in enumerate(CONTACTS):
        critical = float(contact.critical_velocity)
        ratio = critical / (float(contact.limit_velocity) - critical)
        law = sj.Zhou(contact, float(chi[k]), float(-np.log(up[k]) / ratio**0.5), 0.5)
        v = np.round(critical * np.geomspace(1.5, 60, 14), 4)
        e = np.asarray(sj.restitution(law, v).coefficient) + 0.002 * random.standard_normal(14)
        sets.append(cal.RestitutionData(v, np.round(e, 5), contact, 0.002, name=ALLOYS[k]))
    result = cal.fit(sets, starts=4, profiles=False)
    return chi, up, result, result.unloading_line


def test_law_scatter_and_intervals_are_those_of_weighted_least_squares(six):
    _, _, result, line = six
    law, c1, c2 = line.law(NEXT), line.c1.value, line.c2.value
    assert float(law.chi) == pytest.approx(c1 + c2 * AT[1], rel=1e-14)
    up = np.array([result.values[f"eps_up[{name}]"] for name in ALLOYS])
    stated = sj.empirical_restitution(
        NEXT.critical_velocity, NEXT.limit_velocity, law.sigma, law.psi
    )
    mean = np.mean(np.log(up / (1 - up)))
    assert float(stated) == pytest.approx(1 / (1 + np.exp(-mean)), rel=1e-9)
    chi, error = (np.array([getattr(m, n) for m in line.materials]) for n in ("chi", "chi_error"))
    mean = c1 + c2 * RATIOS
    variance = error**2 + (line.scatter * mean) ** 2
    assert np.sum((chi - mean) ** 2 / variance) == pytest.approx(4.0, rel=1e-6)  # n - 2
    exact = replace(line.materials[0], chi_error=None)
    assert line.has_noise
    assert not replace(line, materials=(exact, *line.materials[1:])).has_noise
    low, high = np.sqrt(4 / stats.chi2.ppf([0.999, 0.001], 4)) * SCATTER
    assert low < line.scatter < high
    # a material's deviation moves c as it moves the line of weighted least squares
    design = np.stack([np.ones(6), RATIOS], axis=1)
    influence = np.linalg.inv(design.T @ (design / error[:, None] ** 2)) @ (design.T / error**2)
    covariance = (influence * variance) @ influence.T
    for k, name in enumerate(("c1", "c2")):
        coefficient = getattr(line, name)
        error, exact = coefficient.standard_error, covariance[k, k] ** 0.5
        assert error == pytest.approx(exact, rel=0.1)
        assert line.through_chi[name].standard_error == pytest.approx(exact, rel=1e-6)
        ends = coefficient.value + stats.t.ppf([0.025, 0.975], 4) * error
        assert [coefficient.low, coefficient.high] == pytest.approx(ends, rel=1e-9)
        assert line.covariance[k][k] == pytest.approx(error**2, rel=1e-9)
    found = line.unloading_factor(NEXT, confidence=0.9)
    size = np.sqrt(AT @ line.covariance @ AT + (line.scatter * found.value) ** 2)
    assert found.standard_error == pytest.approx(size, rel=1e-9)
    ends = np.log(found.value) + stats.t.ppf([0.05, 0.95], 4) * size / found.value
    assert np.log([found.low, found.high]) == pytest.approx(ends, rel=1e-9)


def test_a_band_is_what_each_unknown_does(six):
    """χ̃ and ε_up at the ends of their intervals, by hand; NaN below yield."""
    line = six[3]
    chi, band = line.unloading_factor(NEXT), line.band(NEXT, V)
    logits = np.array([special.logit(one.eps_up) for one in line.materials])
    mean, reach = np.mean(logits), stats.t.ppf(0.975, 5) * np.std(logits, ddof=1) * np.sqrt(7 / 6)
    ratio = float(NEXT.critical_velocity / (NEXT.limit_velocity - NEXT.critical_velocity))

    def curve(chi, logit):
        law = sj.Zhou(NEXT, chi, -np.log(special.expit(logit)) / np.sqrt(ratio), 0.5)
        return np.asarray(sj.restitution(law, V[1:]).coefficient)

    value = curve(chi.value, mean)
    down = np.hypot(value - curve(chi.high, mean), value - curve(chi.value, mean - reach))
    up = np.hypot(curve(chi.low, mean) - value, curve(chi.value, mean + reach) - value)
    assert np.all(np.isnan([band.coefficient[0], band.low[0], band.high[0]]))
    np.testing.assert_allclose(band.coefficient[1:], value, rtol=1e-12)
    np.testing.assert_allclose(band.low[1:], value - down, rtol=1e-9)
    np.testing.assert_allclose(band.high[1:], np.minimum(value + up, 1), rtol=1e-9)


def test_without_two_known_losses_the_curve_is_the_plastic_part_alone_and_a_sentence_says_so(six):
    """A material at its bound is left out of the mean; χ̃ alone moves the curve then."""
    line = six[3]
    at_one = [
        replace(one, eps_up=up)
        for one, up in zip(line.materials, (1.0, 1 - 1e-15, 1.0, 1.0, 1.0), strict=False)
    ]
    alone = replace(line, materials=(line.materials[-1], *at_one))
    two = replace(line, materials=(*line.materials[-2:], *at_one[:-1]))
    logits = [special.logit(one.eps_up) for one in line.materials[-2:]]
    ratio = NEXT.critical_velocity / (NEXT.limit_velocity - NEXT.critical_velocity)
    sigma = -np.log(special.expit(np.mean(logits))) / np.sqrt(float(ratio))
    assert float(two.law(NEXT).sigma) == pytest.approx(sigma, rel=1e-9)
    band, law = alone.band(NEXT, V), alone.law(NEXT)
    plastic = sj.restitution(line.law(NEXT), V).plastic_coefficient
    for curve in (band.coefficient, sj.restitution(law, V).coefficient):
        np.testing.assert_allclose(curve[1:], plastic[1:], rtol=1e-12)
    ends = (
        sj.restitution(sj.Zhou(NEXT, chi, 0.0, 0.5), V[1:]).coefficient
        for chi in (alone.unloading_factor(NEXT).high, alone.unloading_factor(NEXT).low)
    )
    np.testing.assert_allclose([band.low[1:], band.high[1:]], [*ends], rtol=1e-9)
    assert alone.remarks(NEXT)[2].startswith(
        "the curve is the plastic part ε_p alone, above first yield"
    )
    assert two.remarks(NEXT)[2].startswith("the curve is ε, above first yield, with ε_up 0.9")


def test_two_materials_leave_no_freedom_and_what_makes_no_sense_is_refused(six, tmp_path):
    sets = [fit.data for fit in six[2].materials]
    result = cal.fit(sets[::3], starts=4, profiles=False)
    line, contact = result.unloading_line, NEXT
    assert line.scatter is None
    remarks = line.remarks(contact)
    assert "scatter about the line: unknown, as two materials" in remarks[1]
    assert remarks[2].startswith("the curve is ε, above first yield, with ε_up 0.9")
    covariance = np.array(line.covariance)
    assert covariance[0, 0] == pytest.approx(line.c1.standard_error**2, rel=1e-9)
    found = line.unloading_factor(contact)
    assert found.standard_error == pytest.approx(np.sqrt(AT @ covariance @ AT), rel=1e-9)
    hertz = sj.Contact(**contact.leaves(), area="hertz")
    for call, message in (
        (lambda: line.law(hertz), "`area` must be zhou, as of the fitted materials, but is hertz"),
        (
            lambda: line.law(six[2].law["alloy 0"]),
            "`contact` must be a softjax.Contact of single numbers",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    result.report(tmp_path)
    report = Tags((tmp_path / "report.html").read_text(encoding="utf-8")).words
    assert "scatter about the line" not in report
    assert "only a third material can test it." in report
    assert "less closely" not in report
    assert line.rms == pytest.approx({fit.name: fit.rms for fit in result.materials}, rel=1e-4)
    single = cal.fit(sets[0], starts=4, profiles=False)
    assert single.unloading_line is None
    one, kinds = sets[0], ("small", "large")
    same = [cal.RestitutionData(one.velocity, one.restitution, one.contact, name=k) for k in kinds]
    assert cal.fit(same, starts=4, profiles=False).unloading_line is None  # of one E/Y


TOML = """
[[material]]
name = "next"
youngs_modulus = "105 GPa"
poisson_ratio = 0.33
density = 8500
yield_strength = "1.5 GPa"
radius = "10 mm"
"""


def line_is_drawn(figure, result):
    """The materials with their errors, the further one beside its band, the line dashed where it goes on."""
    (ax,) = figure.axes
    *fitted, further = ax.containers
    for container, fit in zip(fitted, result.materials, strict=True):
        chi, ratio = fit.parameters["chi"], float(fit.contact.yield_ratio)
        assert container[0].get_data() == ([ratio], [chi.value])
        ends = chi.value + stats.norm.ppf([0.025, 0.975]) * chi.standard_error
        np.testing.assert_allclose(bars(container)[0, :, 1], ends)
    c1, c2 = result.unloading_line.c1.value, result.unloading_line.c2.value
    ((x,), (y,)), (ends,) = further[0].get_data(), bars(further)[:, :, 1]
    assert (x, y) == pytest.approx((39.28, c1 + c2 * x), rel=1e-4)
    for label, dashes in (("Eq. (18)", "-"), ("extrapolated", "--")):
        at, height = line(ax, label)
        within = (at >= 49.1) & (at <= 267.9)
        np.testing.assert_array_equal(np.isfinite(height), within == (dashes == "-"))
        np.testing.assert_allclose(height, np.where(np.isfinite(height), c1 + c2 * at, np.nan))
    at, low, high = band(ax, "95 %, of a further material\n(wider than the picture)")
    np.testing.assert_allclose([np.interp(x, at, low), np.interp(x, at, high)], ends, rtol=1e-2)


def test_names_of_materials_lie_over_no_material(result, tmp_path):
    """Nylon and chrome steel are neighbours on the line."""
    result.save(tmp_path / "fit.json")
    (tmp_path / "next.toml").write_text(TOML, encoding="utf-8")
    words = ["--line", tmp_path / "fit.json", "--points", 5]
    with drawn() as figures:
        assert run("curve", tmp_path / "next.toml", *words, "--out", tmp_path)[0] == 0
    (ax,) = figures["line.png"].axes
    places = ax.transData.transform([np.ravel(one[0].get_data()) for one in ax.containers])
    boxes = {text.get_text(): text.get_window_extent() for text in ax.texts}
    assert set(boxes) == {"stainless steel", "chrome steel", "nylon"}
    assert not any(box.contains(*place) for box in boxes.values() for place in places)


def test_the_command_draws_the_curve_of_a_material_without_data(six, tmp_path, capsys):
    result = six[2]
    result.save(tmp_path / "fit.json")
    loaded = cal.FitResult.load(tmp_path / "fit.json")
    assert loaded.unloading_line == result.unloading_line
    file = tmp_path / "next.toml"
    file.write_text(TOML, encoding="utf-8")
    out = tmp_path / "out"
    words = ["curve", str(file), "--line", str(tmp_path / "fit.json"), "--out", str(out)]
    with drawn() as figures:
        assert cli.main(words) == 0
    line_is_drawn(figures["line.png"], result)
    as_recorded("without data", figures)
    low = -1.2 * result.unloading_line.c2.value * RATIOS[-1]  # no χ̃ at the lowest E/Y
    falls = replace(result.unloading_line, c1=replace(result.unloading_line.c1, value=low))
    (ax,) = plots.unloading_line_figure(falls).axes
    assert any(label.startswith("95 %, of a further material") for label in labels(ax))
    exact = replace(falls, covariance=None, materials=falls.materials[-2:])
    (ax,) = plots.unloading_line_figure(exact).axes
    assert {*labels(ax)} == {"fitted, 95 % intervals", "Eq. (18)", "extrapolated"}
    printed, error = capsys.readouterr()
    assert "warning: extrapolation: E/Y = 39.28, the fitted materials have 49.1 to 267.8" in printed
    (remark,) = re.findall(
        r"the curve is ε, above first yield, with ε_up (0[.0-9]+), .*?: the mean of logit ε_up",
        " ".join(printed.split()),
    )
    logits = [special.logit(m.eps_up) for m in result.unloading_line.materials]
    assert float(remark) == pytest.approx(special.expit(np.mean(logits)), abs=5e-5)
    measured = np.concatenate([fit.data.velocity for fit in result.materials])
    ends = f"{measured.min():.4g} to {measured.max():.4g} m/s"
    assert f"the data of the fitted materials from {ends}" in error
    assert cli.main([*words, "--from", str(measured.min()), "--to", str(measured.max())]) == 0
    assert "data of the fitted materials" not in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == ["curve.csv", "curve.png", "line.png"]
    rows = np.genfromtxt(out / "curve.csv", delimiter=",", skip_header=1, usecols=range(4))
    band = result.unloading_line.band(contact_of(1.5e9), rows[:, 0])
    np.testing.assert_allclose(rows[:, 1:4].T, [band.coefficient, band.low, band.high], rtol=1e-12)
    for more, message in (
        (["--set", "chi=1"], "`--set` must be left out with --line"),
        (["--eps-up", "0.9"], "`--eps-up` must be left out with --line"),
    ):
        assert cli.main([*words, *more]) == 2
        assert message in capsys.readouterr().err
    table = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    (tmp_path / "fit.json").write_text(json.dumps(table | {"unloading_line": None}), "utf-8")
    assert cli.main(words) == 2
    assert "has no line of Eq. (18); a fit of two or more materials" in capsys.readouterr().err
