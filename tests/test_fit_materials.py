"""The main job: the paper's three materials with the default settings."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

import calibration as cal
import softjax as sj

# found independently by least squares on the energy balance
CHI = {"stainless steel": 1.7944, "chrome steel": 0.09867, "nylon": 0.21998}
RMS = {"stainless steel": 0.01502, "chrome steel": 0.000965, "nylon": 0.00935}
LINE_RMS = {"stainless steel": 0.0167, "chrome steel": 0.0345, "nylon": 0.0162}
TABLE_1 = {  # printed σ and ψ
    "stainless steel": (3.0432, 0.5400),
    "chrome steel": (0.1418, 0.3114),
    "nylon": (0.4355, 0.5414),
}


@pytest.fixture(scope="module")
def result():
    return cal.fit(cal.paper_materials(), objective="two-step", beside=True)


@pytest.mark.parametrize("name", CHI)
def test_values_are_those_of_table_1_and_of_independent_least_squares(result, name):
    fit = result.material(name)
    assert fit.n == 40
    sigma, psi = TABLE_1[name]
    assert result.values[f"sigma[{name}]"] == pytest.approx(sigma, abs=5e-5)
    assert result.values[f"psi[{name}]"] == pytest.approx(psi, abs=5e-5)
    assert result.values[f"chi[{name}]"] == pytest.approx(CHI[name], rel=1e-3)
    assert result.rms[name] == pytest.approx(RMS[name], rel=1e-3)
    assert result.rms_empirical[name] < 1e-12
    assert fit.converged


def test_line_of_eq_18_and_its_larger_residuals(result):
    line = result.unloading_line
    assert line.c1.value == pytest.approx(0.03184, abs=6e-6)
    assert line.c2.value == pytest.approx(0.004554, abs=6e-7)
    for name, rms in LINE_RMS.items():
        assert line.rms[name] == pytest.approx(rms, abs=6e-5)
        assert line.rms[name] > result.rms[name]
    ratio = float(cal.paper_materials()[1].contact.yield_ratio)
    on_line = line.c1.value + line.c2.value * ratio
    assert line.chi["chrome steel"].value == pytest.approx(on_line, rel=1e-12)
    assert line.through_chi["c2"].value != pytest.approx(line.c2.value, rel=1e-2)


def test_levenberg_marquardt_through_the_energy_balance_agrees(result):
    assert result.beside["converged"]
    assert result.beside["largest_difference"] < 1e-7
    assert result.beside["values"]["c2"] == pytest.approx(result.unloading_line.c2.value, rel=1e-6)
    stages = {stage.stage: stage for stage in result.optimiser_report}
    assert stages["model"].route == "ode"
    assert stages["model"].optimiser == "optax L-BFGS"
    assert 3 < stages["model"].evaluations < 300
    assert stages["model"].gradient_norm < 1e-6


def test_settings_and_layout_are_the_interface_s(result):
    table = json.loads(result.to_json())
    assert {"fits", "unloading_line", "settings", "versions"} <= set(table)
    first = table["fits"][0]
    expected = {"material", "n", "rms", "rms_empirical", "converged", "warnings", "parameters"}
    assert expected <= set(first)
    assert {"value", "standard_error"} <= set(first["parameters"]["chi"])
    assert set(first["parameters"]) == {"chi", "sigma", "psi"}
    wanted = {
        "objective": "two-step", "route": "ode", "area": "zhou", "form": "first-order",
        "kappa": "consistent", "x64": True,
    }  # fmt: skip
    assert wanted.items() <= table["settings"].items()
    assert {"softjax-contact", "jax", "diffrax"} <= set(table["versions"])


def test_it_loads_back_equal_and_the_same_seed_gives_the_same_bytes(result, tmp_path):
    result.save(tmp_path / "fit.json")
    again = cal.FitResult.load(tmp_path / "fit.json")
    assert again == result
    assert again.to_json() == result.to_json()
    assert again.values == result.values
    data = cal.paper_materials()[1]
    velocity = np.asarray(data.velocity)
    law = again.law["chrome steel"]
    fitted = np.asarray(sj.restitution(law, velocity).coefficient) - data.restitution
    assert np.sqrt(np.mean(fitted**2)) == pytest.approx(result.rms["chrome steel"], rel=1e-6)
    one, two = (cal.fit(data, objective="two-step").to_json(times=False) for _ in range(2))
    assert one == two
    assert cal.fit(data, objective="two-step", seed=3).values["chi"] == pytest.approx(
        CHI["chrome steel"], rel=1e-3
    )


def test_a_file_that_is_no_result_is_refused(tmp_path):
    (tmp_path / "other.json").write_text('{"fits": 1}')
    with pytest.raises(ValueError, match=r"fit\.json is accepted"):
        cal.FitResult.load(tmp_path / "other.json")


def test_misfit_is_told_and_the_text_says_what_matters(result):
    codes = {(doubt.code, doubt.material) for doubt in result.warnings}
    assert ("model-misfit", "stainless steel") in codes
    text = str(result)
    for part in ("stainless steel", "chi", "1.79", "Eq. (18)", "converged", "model-misfit"):
        assert part in text


def test_a_second_fit_of_the_same_shapes_compiles_nothing(result):
    data = cal.paper_materials(points=39)  # another number of points, padded to the same shape
    cal.fit(data[0])
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, *_, **__: compiled.append(name) if "backend_compile" in name else None
    )
    try:
        cal.fit(data[1])
    finally:
        jax.monitoring.clear_event_listeners()
    assert compiled == []


def test_x64_is_used_whatever_jax_is_set_to_and_left_as_it_was():
    with jax.enable_x64(False):
        result = cal.fit(cal.paper_materials()[2], objective="two-step", route=sj.EnergyBalance())
        assert not jax.config.jax_enable_x64
    assert result.values["chi"] == pytest.approx(CHI["nylon"], rel=1e-3)
    assert result.rms_empirical < 1e-12


@pytest.mark.parametrize("without", [0, 1, 2])
def test_data_with_bodies_and_without_share_a_constant(without):
    """Weighted means, each set's scatter about the common one: found by hand."""
    sets = list(cal.paper_materials(10))
    sets[without] = replace(sets[without], contact=None)
    result = cal.fit(sets, "constant", {"restitution": cal.Parameter(shared=True)}, profiles=False)
    weight = np.ones(3)
    for _ in range(300):
        mean = np.average([d.restitution.mean() for d in sets], weights=weight)
        left = 10 - weight / np.sum(weight)
        weight = left / [np.sum((d.restitution - mean) ** 2) for d in sets]
    assert result.values["restitution"] == pytest.approx(mean, rel=1e-6)


@pytest.mark.parametrize("order", [1, -1])
def test_what_is_said_of_one_set_s_bodies_is_of_that_set_alone(order):
    """Beside another that it shares a parameter with: as if its bodies had it of themselves."""
    steel, _, nylon = cal.paper_materials(10)
    options = {"objective": "two-step", "profiles": False, "starts": 1}
    options |= {"route": sj.EnergyBalance(), "unloading_line": None}
    psi = {"psi": cal.Parameter(shared=True)}
    said = cal.fit([steel, nylon][::order], None, psi | {"limit_velocity[nylon]": 400.0}, **options)
    bodies = replace(nylon.contact, limit_velocity=400.0)
    own = cal.RestitutionData(nylon.velocity, nylon.restitution, bodies, name="nylon")
    alone = cal.fit([steel, own][::order], None, psi, **options)
    for name in ("chi[stainless steel]", "chi[nylon]", "sigma[nylon]", "psi"):
        assert said.values[name] == pytest.approx(alone.values[name], rel=1e-6), name
