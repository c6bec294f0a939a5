"""Eq. (18) for a further material: six simulated ones that scatter about a line by 8 %."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration import cli

C1, C2, SCATTER = 0.05, 0.004, 0.08
STRENGTHS = np.array([2.2e8, 3.0e8, 4.0e8, 5.5e8, 8.0e8, 1.2e9])
NAMES = [f"alloy {k}" for k in range(6)]


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
        sets.append(cal.RestitutionData(v, np.round(e, 5), contact, 0.002, name=NAMES[k]))
    result = cal.fit(sets, starts=4, profiles=False)
    return chi, up, result, result.unloading_line


def test_law_scatter_and_intervals_are_those_of_weighted_least_squares(six):
    _, _, result, line = six
    law, c1, c2 = line.law(NEXT), line.c1.value, line.c2.value
    assert float(law.chi) == pytest.approx(c1 + c2 * AT[1], rel=1e-14)
    up = np.array([result.values[f"eps_up[{name}]"] for name in NAMES])
    stated = sj.empirical_restitution(
        NEXT.critical_velocity, NEXT.limit_velocity, law.sigma, law.psi
    )
    mean = np.mean(np.log(up / (1 - up)))
    assert float(stated) == pytest.approx(1 / (1 + np.exp(-mean)), rel=1e-9)
    given = line.law(NEXT, sigma=0.7, psi=0.4)
    assert (float(given.sigma), float(given.psi)) == pytest.approx((0.7, 0.4), rel=1e-14)
    chi, error = (np.array([getattr(m, n) for m in line.materials]) for n in ("chi", "chi_error"))
    mean = c1 + c2 * RATIOS
    variance = error**2 + (line.scatter * mean) ** 2
    assert np.sum((chi - mean) ** 2 / variance) == pytest.approx(4.0, rel=1e-6)  # n - 2
    low, high = np.sqrt(4 / stats.chi2.ppf([0.999, 0.001], 4)) * SCATTER
    assert low < line.scatter < high
    # a material's deviation moves c as it moves the line of weighted least squares
    design = np.stack([np.ones(6), RATIOS], axis=1)
    influence = np.linalg.inv(design.T @ (design / error[:, None] ** 2)) @ (design.T / error**2)
    covariance = (influence * variance) @ influence.T
    for k, name in enumerate(("c1", "c2")):
        through, of_curves = line.through_chi[name], getattr(line, name).standard_error
        assert through.standard_error == pytest.approx(covariance[k, k] ** 0.5, rel=1e-6)
        ends = through.value + stats.t.ppf([0.025, 0.975], 4) * through.standard_error
        assert [through.low, through.high] == pytest.approx(ends, rel=1e-9)
        assert of_curves == pytest.approx(through.standard_error, rel=0.1)
        assert line.covariance[k][k] == pytest.approx(of_curves**2, rel=1e-9)
    found = line.unloading_factor(NEXT, confidence=0.9)
    size = np.sqrt(AT @ line.covariance @ AT + (line.scatter * found.value) ** 2)
    assert found.standard_error == pytest.approx(size, rel=1e-9)
    ends = np.log(found.value) + stats.t.ppf([0.05, 0.95], 4) * size / found.value
    assert np.log([found.low, found.high]) == pytest.approx(ends, rel=1e-9)


def test_each_material_is_predicted_by_the_others_and_a_band_is_what_each_unknown_does(six):
    chi, up, result, line = six
    left = line.left_out()
    assert all(left[name].low < chi[k] < left[name].high for k, name in enumerate(NAMES))
    # and they tell something: within a factor of two
    assert max(np.log(one.high / one.low) for one in left.values()) < 1.5
    others = np.arange(6) != 2
    expected = np.polyfit(RATIOS[others], chi[others], 1)
    assert left[NAMES[2]].value == pytest.approx(np.polyval(expected, RATIOS[2]), rel=0.1)
    data = result.material(NAMES[2]).data
    band = line.band(CONTACTS[2], data.velocity, eps_up=float(up[2]))
    truth = data.restitution
    assert np.all((band.low - 0.006 < truth) & (truth < band.high + 0.006))
    chi, law = line.unloading_factor(NEXT), line.law(NEXT, eps_up=0.97)
    known, wider = line.band(NEXT, V, eps_up=0.97), line.band(NEXT, V)

    def curve(value):
        other = sj.Zhou(NEXT, value, float(law.sigma), float(law.psi))
        return np.asarray(sj.restitution(other, V[1:]).coefficient)

    assert np.all(np.isnan([known.coefficient[0], known.low[0], known.high[0]]))
    np.testing.assert_allclose(known.coefficient[1:], curve(chi.value), rtol=1e-12)
    np.testing.assert_allclose(known.low[1:], curve(chi.high), rtol=1e-9)
    np.testing.assert_allclose(known.high[1:], np.minimum(curve(chi.low), 1), rtol=1e-9)
    assert np.all(wider.high[1:] - wider.low[1:] > known.high[1:] - known.low[1:])
    below = line.band(NEXT, V, sigma=0.7, psi=0.4).coefficient
    expected = sj.restitution(line.law(NEXT, sigma=0.7, psi=0.4), V).coefficient
    np.testing.assert_allclose(below, expected, rtol=1e-12)


def test_psi_acts_below_yield_alone_and_a_value_at_its_bound_is_left_out_of_the_mean(six):
    """σ and ψ, each with its mean, once gave a band from 0 to 1, though every material knew its ε_up."""
    line = six[3]
    psi = [0.4, 0.9, np.finfo(float).tiny]
    materials = tuple(
        replace(one, psi=value) for one, value in zip(line.materials[:3], psi, strict=True)
    )
    with_psi, without = (replace(line, materials=some) for some in (materials, line.materials[:3]))
    assert float(with_psi.law(NEXT).psi) == pytest.approx(0.6, rel=1e-12)
    both, above = with_psi.band(NEXT, V), without.band(NEXT, V)
    for name in ("coefficient", "low", "high"):
        np.testing.assert_allclose(getattr(both, name)[1:], getattr(above, name)[1:], rtol=1e-9)
    assert both.low[0] < both.coefficient[0] < both.high[0]
    assert np.isnan(replace(line, materials=materials[1:]).band(NEXT, V).coefficient[0])
    at_one = (materials[0], *(replace(material, eps_up=1 - 1e-15) for material in materials[1:]))
    with pytest.raises(ValueError, match=r"eps_up.*fewer than two"):
        replace(line, materials=at_one).law(NEXT)


def test_two_materials_leave_no_freedom_and_what_makes_no_sense_is_refused(six, tmp_path):
    sets = [fit.data for fit in six[2].materials]
    result = cal.fit(sets[::3], starts=4, profiles=False)
    line, contact = result.unloading_line, NEXT
    assert line.scatter is None
    remarks = line.remarks(contact)
    assert "scatter about the line: unknown, as two materials" in remarks[1]
    (advice,) = [text for text in remarks if "too wide to be of use" in text]
    assert advice.startswith("warning: a mean of 2 materials has few degrees of freedom")
    assert advice.endswith("(--eps-up)")
    assert not any("too wide" in text for text in line.remarks(contact, eps_up=0.97))
    nearly_sure = replace(six[3], confidence=1 - 1e-9).remarks(contact, eps_up=0.97)
    assert "is too wide to be of use: fit more materials, as 6 leave" in nearly_sure[1]
    covariance = np.array(line.covariance)
    assert covariance[0, 0] == pytest.approx(line.c1.standard_error**2, rel=1e-9)
    found = line.unloading_factor(contact)
    assert found.standard_error == pytest.approx(np.sqrt(AT @ covariance @ AT), rel=1e-9)
    hertz = sj.Contact(**contact.leaves(), area="hertz")
    for call, message in (
        (lambda: line.law(hertz), "`area` must be zhou, as of the fitted materials, but is hertz"),
        (lambda: line.law(contact, eps_up=1.2), "`eps_up` must be between 0 and 1, but is 1.2"),
        (lambda: line.law(contact, sigma=0.5), "`psi` must be given with sigma"),
        (lambda: line.law(contact, eps_up=0.9, sigma=0.5), "`eps_up` must be left out with sigma"),
        (line.left_out, "`materials` must be 3 or more, to leave one out, but is 2"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    result.report(tmp_path)
    report = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "scatter about the line" not in report
    assert "only a third material can test it." in report
    assert "less closely" not in report
    assert line.rms == pytest.approx({fit.name: fit.rms for fit in result.materials}, rel=1e-4)
    single = cal.fit(sets[0], starts=4, profiles=False)
    assert single.unloading_line is None


TOML = """
[[material]]
name = "next"
youngs_modulus = "105 GPa"
poisson_ratio = 0.33
density = 8500
yield_strength = "1.5 GPa"
radius = "10 mm"
"""


def test_the_command_draws_the_curve_of_a_material_without_data(six, tmp_path, capsys):
    result = six[2]
    result.save(tmp_path / "fit.json")
    loaded = cal.FitResult.load(tmp_path / "fit.json")
    assert loaded.unloading_line == result.unloading_line
    file = tmp_path / "next.toml"
    file.write_text(TOML, encoding="utf-8")
    out = tmp_path / "out"
    words = ["curve", str(file), "--line", str(tmp_path / "fit.json"), "--out", str(out)]
    assert cli.main(words) == 0
    printed, error = capsys.readouterr()
    assert "warning: extrapolation: E/Y = 39.28, the fitted materials have 49.1 to 267.8" in printed
    assert "eps_up 0.9" in printed
    assert "too wide to be of use" not in printed
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
        (["--chi", "1"], "`--chi` must be left out with --line"),
        (["--eps-up", "2"], "`eps_up` must be between 0 and 1"),
    ):
        assert cli.main([*words, *more]) == 2
        assert message in capsys.readouterr().err
    table = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    (tmp_path / "fit.json").write_text(json.dumps(table | {"unloading_line": None}), "utf-8")
    assert cli.main(words) == 2
    assert "has no line of Eq. (18); a fit of two or more materials" in capsys.readouterr().err
