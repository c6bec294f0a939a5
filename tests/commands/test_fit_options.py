"""One matrix of settings: each acts in the file and on the command line, as in Python.

Each case says besides what the setting must do to the fit: a number by SciPy or by hand.
"""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from calibration import cli
from tests.command import noisy, run, write_alloy

WB = {"law": "walton-braun"}
ZHOU = {"law": "zhou", "route": "energy balance", "starts": 4, "profiles": False}
EB = sj.EnergyBalance()
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(autouse=True)
def without_pictures(monkeypatch):
    """Matplotlib neither lays out nor draws them: that takes longer than these fits."""

    def tiny(figure, path, **options):
        Path(path).write_bytes(PNG)

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", tiny)
    monkeypatch.setattr("matplotlib.figure.Figure.get_layout_engine", lambda figure: None)


def toml(settings: dict[str, Any]) -> str:
    return "\n".join(f"{name} = {json.dumps(value)}" for name, value in settings.items())


OPTIONS = {"profiles": "--no-profiles"}


def words(settings: dict[str, Any]) -> list[str]:
    """The same on the command line."""
    found = []
    for name, value in settings.items():
        flag = isinstance(value, bool)
        found += [OPTIONS.get(name, f"--{name.replace('_', '-')}")]
        found += [] if flag else [str(value).replace(" ", "-")]
    return found


def fitted(folder, options=(), settings=None, **told) -> cal.FitResult:
    """What `softjax fit FILE` saves, by a file with these settings."""
    file = write_alloy(folder, toml(settings or {}), **told)
    code, _, err = run("fit", file, *options, "--quiet", "--out", folder / "out")
    result = cal.FitResult.load(folder / "out" / "fit.json")
    assert code == (not result.converged), err
    return result


def in_python(settings: dict[str, Any], uncertainty=0.01, said=None, second=False):
    """The same fit by `cal.fit`."""
    data = [noisy(uncertainty), noisy(uncertainty, "another", 6.0e7)]
    of = data if second else data[0]
    keys = settings | ({"route": EB} if "route" in settings else {})
    return cal.fit(of, parameters=said, **keys)


def chi_squared(result, uncertainty):
    left = np.asarray(sj.restitution(result.law, result.data.velocity).coefficient)
    return float(np.sum((left - result.data.restitution) ** 2)) / uncertainty**2


def by_quantile(base, changed):
    """Intervals on the scale that was searched, logarithms, shrink by the quantiles' ratio."""
    ratio = stats.norm.ppf(0.9) / stats.norm.ppf(0.975)
    for name in ("unloading_stiffness", "growth"):
        value = base.values[name]
        k1 = base.law.loading_stiffness if name == "unloading_stiffness" else 0.0  # its bound
        wide, narrow = (
            np.log((one.intervals[name][1] - k1) / (value - k1)) for one in (base, changed)
        )
        assert narrow == pytest.approx(ratio * wide, rel=1e-9)


def another_law(base, changed):
    weighted = np.mean(noisy().restitution)  # of equal uncertainties
    assert changed.values["restitution"] == pytest.approx(weighted, rel=1e-7)
    assert set(base.values).isdisjoint(changed.values)


def eq_17_first(base, changed):
    """σ and ψ of `two-step` are those of Eq. (17) by SciPy."""
    data = noisy()
    y = data.velocity / (float(data.limit_velocity) - data.velocity)
    found, _ = optimize.curve_fit(
        lambda y, a, b: np.exp(-a * y**b), y, data.restitution, [0.4, 0.5]
    )
    assert [changed.values[n] for n in ("sigma", "psi")] == pytest.approx(found, rel=1e-6)
    assert base.values["sigma"] < 0.5 * changed.values["sigma"]


def by_another_optimiser(base, changed):
    assert base.optimiser_report[0].optimiser == "optax L-BFGS"
    assert changed.optimiser_report[0].optimiser == "optimistix Levenberg–Marquardt"
    assert changed.values["growth"] == pytest.approx(base.values["growth"], rel=1e-6)


def weighs_outliers_less(base, changed):
    """Student's estimating equations, Σ (ν + 1) r/(ν + r²) ∂ε/∂θ = 0 in units of the scale."""
    data, law = noisy(), changed.law
    scale, nu = changed.materials[0].noise or 0.01, changed.materials[0].noise_dof

    def residual(growth):
        moved = replace(law, growth=growth)
        return np.asarray(sj.restitution(moved, data.velocity).coefficient) - data.restitution

    left = residual(law.growth)
    slope = (residual(law.growth * 1.001) - residual(law.growth * 0.999)) / 0.002
    pull = left / (nu + (left / scale) ** 2)
    assert abs(pull @ slope) < 1e-5 * np.abs(pull) @ np.abs(slope)
    assert abs(left @ slope) > 1e-3 * np.abs(left) @ np.abs(slope)
    assert changed.values["growth"] != pytest.approx(base.values["growth"], rel=1e-4)


def nearly_normal(base, changed):
    """ν = 30 pulls less at outliers than 4."""
    assert (base.materials[0].noise_dof, changed.materials[0].noise_dof) == (4.0, 30.0)
    plain = in_python(WB | {"profiles": False})
    ends = [abs(one.values["growth"] - plain.values["growth"]) for one in (changed, base)]
    assert ends[0] < 0.5 * ends[1]


def without_profiles(base, changed):
    assert set(base.profiles) == {"unloading_stiffness", "growth"}
    assert changed.profiles == {}
    assert changed.estimates["growth"].method == "wald"


def scaled_errors(base, changed):
    """By √(χ²/ν), where all uncertainties are equal."""
    factor = np.sqrt(chi_squared(base, 0.004) / 22)
    assert factor > 2
    assert changed.values["growth"] == pytest.approx(base.values["growth"], rel=1e-6)
    ratio = changed.standard_errors["growth"] / base.standard_errors["growth"]
    assert ratio == pytest.approx(factor, rel=1e-5)


def scatter_beside(base, changed):
    """The whole variance of ε is the residuals' (REML); what is not stated is found."""
    scaled_errors(base, changed)
    whole = chi_squared(base, 0.004) / 22 * 0.004**2
    found = changed.material().variances
    assert found["stated"] == pytest.approx(0.004**2)
    assert found["scatter"] == pytest.approx(whole - 0.004**2, rel=1e-4)


def ends_at_zero_force(base, changed):
    """exp(-2a cot a) at zero force for an input of exp(-π cot a), a ∈ (0, π/2)."""
    value = changed.values["restitution"]
    angle = np.arctan2(np.pi, -np.log(value))
    found = np.exp(-2 * angle / np.tan(angle))
    assert found == pytest.approx(base.values["restitution"], rel=1e-6)


def of_variant(base, changed):
    """The law that is loaded has the curve of one that is built by hand, and no other's."""
    option = {"form": "full"} if changed.law.form == "full" else {"kappa": "printed"}
    told = dict(changed.material().values)
    told["psi"] = max(told["psi"], 1e-300)
    velocity = np.array([0.5, 3.0, 20.0])
    by_hand = sj.Zhou(changed.data.contact, **told, **option)
    expected = np.asarray(sj.restitution(by_hand, velocity).coefficient)
    assert np.asarray(sj.restitution(changed.law, velocity).coefficient) == pytest.approx(expected)
    plain = sj.restitution(sj.Zhou(changed.data.contact, **told), velocity).coefficient
    assert np.max(np.abs(np.asarray(plain) - expected)) > 1e-5


def line_through_chi(base, changed):
    """A line through two materials goes through both their χ̃."""
    line, estimates = changed.unloading_line, changed.estimates
    assert base.unloading_line.method == "curves"
    for fit in changed.materials:
        on_line = line.c1.value + line.c2.value * float(fit.contact.yield_ratio)
        assert on_line == pytest.approx(estimates[f"chi[{fit.name}]"].value, rel=1e-6)


def without_line(base, changed):
    assert base.unloading_line is not None
    assert changed.unloading_line is None


def of_more_starts(base, changed):
    assert (base.optimiser_report[0].starts, changed.optimiser_report[0].starts) == (32, 3)


def stops(base, changed):
    assert base.converged
    assert not changed.converged
    assert changed.optimiser_report[0].iterations == 1


class Case(NamedTuple):
    """A setting, what is set beside it, and what it does to the fit."""

    setting: dict[str, Any]
    acts: Any
    beside: dict[str, Any] = WB
    uncertainty: float = 0.01
    second: bool = False


TWO_STEP = ZHOU | {"objective": "two-step"}
CASES = {
    "law": Case({"law": "constant"}, another_law),
    "objective": Case({"objective": "two-step"}, eq_17_first, ZHOU),
    "optimiser": Case({"optimiser": "levenberg-marquardt"}, by_another_optimiser),
    "noise": Case({"noise": "student-t"}, weighs_outliers_less),
    "noise_dof": Case({"noise_dof": 30.0}, nearly_normal, WB | {"noise": "student-t"}),
    "form": Case({"form": "full"}, of_variant, ZHOU),
    "kappa": Case({"kappa": "printed"}, of_variant, ZHOU),
    "starts": Case({"starts": 3}, of_more_starts),
    "max_steps": Case({"max_steps": 1}, stops, WB | {"starts": 1}),
    "confidence": Case({"confidence": 0.8}, by_quantile, WB | {"profiles": False}),
    "profiles": Case({"profiles": False}, without_profiles),
    "extra_scatter": Case({"extra_scatter": True}, scatter_beside, uncertainty=0.004),
    "scale_uncertainty": Case({"scale_uncertainty": True}, scaled_errors, uncertainty=0.004),
    "unloading_line": Case({"unloading_line": "weighted"}, line_through_chi, TWO_STEP, second=True),
    "no line": Case({"unloading_line": "none"}, without_line, TWO_STEP, second=True),
}
# further below, and `area`, which is of the bodies and read with them
BY_THEMSELVES = {"route", "seed", "end", "rtol", "area"}


OTHERS = {
    "out",
    "quiet",
    "no-cache",
    "help",
    "posterior",
    "json",
}  # of the command, not of the fit


def test_every_setting_has_a_case_here(capsys):
    """The options that the command's help lists."""
    with pytest.raises(SystemExit):
        cli.main(["fit", "--help"])
    listed = set(re.findall(r"^  --([a-z-]+)", capsys.readouterr().out, re.M)) - OTHERS
    names = {name for case in CASES.values() for name in case.setting} | BY_THEMSELVES
    shown = {OPTIONS.get(name, f"--{name.replace('_', '-')}")[2:] for name in names}
    assert listed == shown - {"area"}


@pytest.mark.parametrize("name", CASES)
def test_a_setting_acts_in_the_file_and_on_the_command_line(name, tmp_path):
    case = CASES[name]
    kind = {"uncertainty": case.uncertainty, "second": case.second}
    together = case.beside | case.setting
    by_file = fitted(tmp_path, settings=together, **kind)
    by_words = fitted(tmp_path, words(case.setting), case.beside, **kind)
    assert by_file == by_words == in_python(together, **kind)
    case.acts(in_python(case.beside, **kind), by_file)


def test_another_seed_gives_other_starts(tmp_path):
    """Seen where one step is all that a search from a bad start may make."""
    settings, below = WB | {"starts": 4, "max_steps": 1}, "growth = { value = 1e5 }"
    ends = []
    for seed in (0, 11):
        by_file = fitted(tmp_path, settings=settings | {"seed": seed}, below=below)
        by_words = fitted(tmp_path, ["--seed", str(seed)], settings, below=below)
        said = {"growth": cal.Parameter(1e5)}
        assert by_file == by_words == in_python(settings | {"seed": seed}, said=said)
        assert not by_file.converged
        ends.append(by_file.values["growth"])
    assert ends[0] != pytest.approx(ends[1], rel=1e-3)


@pytest.mark.long
def test_the_end_of_a_dashpots_contact_acts(tmp_path):
    base = {"law": "linear", "profiles": False, "starts": 2}
    ends = [fitted(tmp_path, ["--end", end], base) for end in ("zero-overlap", "zero-force")]
    ends_at_zero_force(*ends)


def test_the_route_and_its_tolerance_are_those_that_are_set(tmp_path):
    """In the file and on the command line; a coarse tolerance errs as it does in Python."""
    base = {"law": "viscoelastic", "profiles": False, "starts": 1}
    closed = fitted(tmp_path, settings=base)
    coarse = cal.fit(noisy(), "viscoelastic", profiles=False, starts=1, route=sj.ODE(rtol=1e-2))
    for options, settings, route, expected in (
        ([], {}, "closed form", closed),
        (["--route", "ode", "--rtol", "1e-2"], {}, "ode", coarse),
        ([], {"route": "ode", "rtol": 1e-2}, "ode", coarse),
        (["--route", "closed-form"], {"route": "ode", "rtol": 1e-2}, "closed form", closed),
    ):
        found = fitted(tmp_path, options, base | settings)
        assert found.optimiser_report[-1].route == route, (options, settings)
        assert found.values == expected.values
    apart = abs(coarse.values["dissipation_time"] / closed.values["dissipation_time"] - 1)
    assert 1e-9 < apart < 1e-2


def test_the_command_line_wins_over_the_file_and_a_law_takes_its_own_options(tmp_path):
    result = fitted(tmp_path, ["--seed", "4"], WB | {"seed": 3, "starts": 2})
    assert result.settings["seed"] == 4
    of_another = fitted(tmp_path, ["--law", "constant"], {"law": "zhou", "form": "full"})
    assert "form" not in of_another.settings


SAID = {
    "a number": ("growth = 400", cal.Parameter(400.0, free=False)),
    "value": ("growth = { free = false, value = 400 }", cal.Parameter(400.0, free=False)),
    "bounds": ("growth = { bounds = [700, 2e3] }", cal.Parameter(bounds=(700.0, 2e3))),
    "prior": ("growth = { prior = [600, 1.0] }", cal.Parameter(prior=(600.0, 1.0))),
    "transform": ('growth = { transform = "none" }', cal.Parameter(transform="none")),
}


@pytest.mark.parametrize("name", SAID)
def test_what_the_file_says_of_a_parameter_acts(name, tmp_path):
    line, parameter = SAID[name]
    settings = WB | {"profiles": False}
    result = fitted(tmp_path, settings=settings, below=line)
    assert result == in_python(settings, said={"growth": parameter})
    found, plain = result.estimates["growth"], in_python(settings).estimates["growth"]
    reach = stats.norm.ppf(0.975) * plain.standard_error
    held = found.value == 400 and not found.free
    expected = {
        "a number": held,
        "value": held,
        "bounds": found.at_bound and found.value == 700,
        "prior": abs(found.value - 600) < 1 and found.standard_error < 1,
        "transform": found.value == pytest.approx(plain.value, rel=1e-6)
        and np.allclose([found.low, found.high], found.value + reach * np.array([-1, 1])),
    }
    assert expected[name]
    assert plain.value < 550
    assert plain.high - plain.value > 1.01 * reach


def test_a_start_that_the_file_gives_is_where_the_search_begins(tmp_path):
    settings = WB | {"starts": 1, "max_steps": 1}
    near, far = (
        fitted(tmp_path, settings=settings, below=f"growth = {{ value = {x} }}") for x in (1, 30)
    )
    assert near.values["growth"] < 0.5 * far.values["growth"]


def test_what_materials_share_is_one_parameter(tmp_path):
    line = "growth = { shared = true }"
    result = fitted(tmp_path, settings=WB, below=line, second=True)
    assert result.values["growth[my alloy]"] == result.values["growth[another]"]
    apart = fitted(tmp_path, settings=WB, second=True)
    assert len(apart.covariance_names) == len(result.covariance_names) + 1
