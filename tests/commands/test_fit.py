"""`softjax fit`: one matrix of settings, each acting in the file and on the command line as in Python.

What a setting does to the numbers of a fit is tested with the fits; here, that it arrives.
"""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.command import noisy, run, write_alloy
from tests.decay import Decay

WB = {"law": "walton-braun", "starts": 2, "profiles": False}
ZHOU = {"law": "zhou", "route": "energy balance", "starts": 2, "profiles": False}
TWO_STEP = ZHOU | {"objective": "two-step"}
EB = sj.EnergyBalance()
OPTIONS = {"profiles": "--no-profiles"}


def toml(settings: dict[str, Any]) -> str:
    return "\n".join(f"{name} = {json.dumps(value)}" for name, value in settings.items())


def words(settings: dict[str, Any]) -> list[str]:
    found = []
    for name, value in settings.items():
        found += [OPTIONS.get(name, f"--{name.replace('_', '-')}")]
        found += [] if isinstance(value, bool) else [str(value).replace(" ", "-")]
    return found


def fitted(folder, options=(), settings=None, **entries) -> cal.FitResult:
    """What `softjax fit FILE` saves, by a file with these settings."""
    file = write_alloy(folder, toml(settings or {}), **entries)
    code, _, err = run("fit", file, *options, "--quiet", "--out", folder / "out")
    result = cal.FitResult.load(folder / "out" / "fit.json")
    assert code == (not result.converged), err
    return result


def in_python(settings: dict[str, Any], parameters=None, second=False):
    data = [noisy(), noisy(0.01, "another", 6.0e7)] if second else noisy()
    settings = settings | ({"route": EB} if "route" in settings else {})
    return cal.fit(data, parameters=parameters, **settings)


@cache
def of_others(settings: str, second: bool):
    return in_python(json.loads(settings), second=second)


class Case(NamedTuple):
    """A setting, what of a fit shows that it acts, and what else is set."""

    setting: dict[str, Any]
    seen: Any
    others: dict[str, Any] = WB
    second: bool = False


def search(name):
    return lambda fit: getattr(fit.optimiser_report[0], name)


def value(name):
    return lambda fit: round(fit.values[name], 9)


def curve(fit):
    return np.asarray(sj.restitution(fit.law, np.array([3.0, 20.0])).coefficient).round(5).tolist()


CASES = {
    "law": Case({"law": "constant"}, lambda fit: set(fit.values)),
    "objective": Case({"objective": "two-step"}, value("sigma"), ZHOU),
    "optimiser": Case({"optimiser": "levenberg-marquardt"}, search("optimiser")),
    "noise": Case({"noise": "student-t"}, value("growth")),
    "noise_dof": Case({"noise_dof": 30.0}, value("growth"), WB | {"noise": "student-t"}),
    "form and kappa": Case({"form": "full", "kappa": "printed"}, curve, ZHOU),
    "starts": Case({"starts": 3}, search("starts")),
    "max_steps": Case({"max_steps": 1}, search("iterations"), WB | {"starts": 1}),
    "confidence": Case({"confidence": 0.8}, lambda fit: fit.intervals["growth"]),
    "profiles": Case({"profiles": False}, lambda fit: len(fit.profiles), {"law": "walton-braun"}),
    "extra_scatter": Case({"extra_scatter": True}, lambda fit: set(fit.material().variances)),
    "scale_uncertainty": Case(
        {"scale_uncertainty": True}, lambda fit: fit.standard_errors["growth"]
    ),
    "unloading_line": Case(
        {"unloading_line": "none"}, lambda fit: fit.unloading_line, TWO_STEP, second=True
    ),
}
# further below, and `area`, which is of the bodies and read with them
BY_THEMSELVES = {"route", "seed", "end", "rtol", "area"}
OF_THE_COMMAND = {"out", "quiet", "no-cache", "help", "posterior", "json", "verbose", "air"}


def test_every_setting_has_a_case_here():
    listed = set(re.findall(r"^  --([a-z-]+)", run("fit", "--help")[1], re.M)) - OF_THE_COMMAND
    names = {name for case in CASES.values() for name in case.setting} | BY_THEMSELVES - {"area"}
    assert listed == {OPTIONS.get(name, f"--{name.replace('_', '-')}")[2:] for name in names}


@pytest.mark.parametrize("name", CASES)
def test_a_setting_acts_in_the_file_and_on_the_command_line(name, tmp_path):
    case = CASES[name]
    together = case.others | case.setting
    by_words = fitted(tmp_path, words(case.setting), case.others, second=case.second)
    assert by_words == in_python(together, second=case.second)
    of_file = cal.read_problem(write_alloy(tmp_path, toml(together))).settings
    assert cal.FitOptions.of(**of_file) == cal.FitOptions.of(**together)
    base = of_others(json.dumps(case.others), case.second)
    assert case.seen(by_words) != case.seen(base)


def test_another_seed_gives_other_starts(tmp_path):
    """Seen where one step is all that a search from a bad start may make."""
    settings, below = WB | {"starts": 4, "max_steps": 1}, "growth = { value = 1e5 }"
    ends = []
    for seed in (0, 11):
        by_words = fitted(tmp_path, ["--seed", str(seed)], settings, below=below)
        parameters = {"growth": cal.Parameter(1e5)}
        assert by_words == in_python(settings | {"seed": seed}, parameters)
        assert not by_words.converged
        ends.append(by_words.values["growth"])
    assert ends[0] != pytest.approx(ends[1], rel=1e-3)


def test_the_route_and_its_tolerance_are_those_that_are_set(tmp_path):
    base = {"law": "viscoelastic", "profiles": False, "starts": 1}
    closed = fitted(tmp_path, settings=base)
    coarse = cal.fit(noisy(), "viscoelastic", profiles=False, starts=1, route=sj.ODE(rtol=1e-2))
    for options, settings, route, expected in (
        (["--route", "ode"], {"rtol": 1e-2}, "ode", coarse),
        (["--route", "closed-form"], {"route": "ode", "rtol": 1e-2}, "closed form", closed),
    ):
        found = fitted(tmp_path, options, base | settings)
        assert found.optimiser_report[-1].route == route, (options, settings)
        assert found.values == expected.values
    apart = abs(coarse.values["dissipation_time"] / closed.values["dissipation_time"] - 1)
    assert 1e-9 < apart < 1e-2


def test_the_command_line_wins_over_the_file_and_a_law_takes_its_own_options(tmp_path):
    result = fitted(tmp_path, ["--seed", "4"], WB | {"seed": 3})
    assert result.settings["seed"] == 4
    of_another = fitted(tmp_path, ["--law", "constant"], {"law": "zhou", "form": "full"})
    assert "form" not in of_another.settings
    dashpot = fitted(tmp_path, ["--end", "zero-force"], {"law": "linear", "profiles": False})
    assert dashpot.law.end == "zero-force"


SAID = {
    "growth = 400": cal.Parameter(400.0, free=False),
    "growth = { free = false, value = 400 }": cal.Parameter(400.0, free=False),
    "growth = { bounds = [700, 2e3] }": cal.Parameter(bounds=(700.0, 2e3)),
    "growth = { prior = [600, 1.0] }": cal.Parameter(prior=(600.0, 1.0)),
    'growth = { transform = "none" }': cal.Parameter(transform="none"),
    "growth = { value = 30, bounds = [1, 1e4] }": cal.Parameter(30.0, bounds=(1.0, 1e4)),
}


def test_what_the_file_says_of_a_parameter_acts_and_what_materials_share_is_one(tmp_path):
    plain = in_python(WB).estimates["growth"]
    assert plain.value < 550
    for line, parameter in SAID.items():
        result = fitted(tmp_path, settings=WB, below=line)
        assert result == in_python(WB, {"growth": parameter}), line
        found = result.estimates["growth"]
        if "400" in line:
            assert (found.value, found.free) == (400, False)
        if "bounds = [700" in line:
            assert (found.value, found.at_bound) == (700, True)
        if "prior" in line:
            assert abs(found.value - 600) < 1
        if "transform" in line:  # a symmetric interval
            middle = 0.5 * (found.low + found.high)
            assert middle == pytest.approx(found.value, rel=1e-9)
            assert 0.5 * (plain.low + plain.high) > 1.0001 * plain.value
    result = fitted(tmp_path, settings=WB, below="growth = { shared = true }", second=True)
    assert result.values["growth[my alloy]"] == result.values["growth[another]"]
    assert len(result.covariance_names) == 3


@pytest.mark.parametrize("command", ["fit", "compare"])
def test_json_on_standard_output_is_the_file(command, tmp_path):
    file = write_alloy(tmp_path, 'law = "constant"')
    few = ["--laws", "constant"] if command == "compare" else []
    code, out, err = run(command, file, *few, "--json", "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    assert out == (tmp_path / "out" / f"{command}.json").read_text(encoding="utf-8")
    assert json.loads(out)["versions"]


def test_a_path_is_fitted_as_the_command_does_and_reading_it_says_what_is_left_out(tmp_path):
    by_command = fitted(tmp_path, settings=WB, below="growth = { prior = [600, 1.0] }")
    assert cal.fit(tmp_path / "alloy.toml") == by_command
    constant = cal.fit(str(tmp_path / "alloy.toml"), "constant", {}, profiles=False)
    assert set(constant.values) == {"restitution"}
    with pytest.warns(
        UserWarning, match=r"states .*law.*growth.* for a fit, which read_toml leaves out"
    ):
        (data,) = cal.read_toml(tmp_path / "alloy.toml")
    assert data == noisy()


def test_a_law_of_ones_own_is_fitted_where_the_command_line_names_its_file(tmp_path):
    law = Path(__file__).parents[1] / "decay.py"
    file = write_alloy(
        tmp_path, "profiles = false", "level = { value = 0.9 }\nrate = { value = 0.01 }"
    )
    words = ("--out", tmp_path / "out")
    code, out, error = run("fit", file, "--law", f"{law}:Decay", *words)
    assert (code, error) == (0, "")
    found = cal.FitResult.load(tmp_path / "out/fit.json", law=Decay)
    by_python = cal.fit(noisy(), Decay, {"level": cal.Parameter(0.9), "rate": cal.Parameter(0.01)})
    assert found.values == pytest.approx(by_python.values, rel=1e-6)
    assert "Decay fitted to" in out
    for text, blamed in (("Deca", "no 'Deca'"), ("np", "no 'np'")):
        code, _, error = run("fit", file, "--law", f"{law}:{text}", *words)
        assert (code, blamed in error) == (2, True), error
    file = write_alloy(tmp_path, f'law = "{law}:Decay"')  # a file makes no code run
    assert run("fit", file, *words)[0] == 2


OWN = f"{Path(__file__).parents[1] / 'decay.py'}:Decay"
FEW = ("--from", 1, "--to", 4, "--points", 4)


def local(folder):
    table = json.loads((folder / "sensitivity.json").read_text("utf-8"))["local"]
    return table["theta_d_epsilon_d_theta"]


def test_a_law_of_ones_own_is_taken_by_the_other_commands(at):
    """ε = a e^{-bv} by NumPy; a fit of it, which a file does not contain, with the law that is named again."""
    both = ("level=0.9", "rate=0.05")
    v = np.linspace(1, 4, 4)
    assert run("curve", "nylon", "--law", OWN, "--set", *both, *FEW, "--spacing", "lin")[0] == 0
    written = np.loadtxt("results/curve.csv", delimiter=",", skiprows=1, usecols=(0, 1))
    np.testing.assert_allclose(written, np.stack([v, 0.9 * np.exp(-0.05 * v)], 1), rtol=1e-12)
    file = write_alloy(at, "profiles = false", "level = 0.9\nrate = { value = 0.05 }")
    command = ("sensitivity", file, "--law", OWN, "--at", 2, *FEW)
    code, _, error = run(*command)
    assert (code, "rate is free" in error) == (2, True)
    assert run(*command, "--set", "rate=0.05")[0] == 0
    of = local(at / "results")
    e = 0.9 * np.exp(-0.1)
    found = [of[name][0] for name in ("level", "rate", "velocity")]
    np.testing.assert_allclose(found, [e, -0.1 * e, -0.1 * e], rtol=1e-9)
    assert run("fit", file, "--law", OWN)[0] == 0
    fit, again = cal.FitResult.load("results/fit.json", law=Decay), ("--fit", "results/fit.json")
    code, _, error = run("curve", *again, *FEW)
    assert (code, "is a fit of Decay, which is no built-in law; give --law" in error) == (2, True)
    assert run("curve", *again, "--law", OWN, *FEW, "--spacing", "lin")[0] == 0
    written = np.loadtxt("results/curve.csv", delimiter=",", skiprows=1, usecols=(1, 2))
    band = fit.band(v)
    np.testing.assert_allclose(written, np.stack([band.coefficient, band.low], 1), rtol=1e-9)
    assert run("sensitivity", *again, "--law", OWN, "--at", 2, *FEW)[0] == 0
    slope = -2 * fit.values["rate"] * fit.band(np.array([2.0])).coefficient[0]
    assert local(at / "results")["rate"][0] == pytest.approx(slope, rel=1e-9)
    code, out, _ = run("compare", file, "--laws", f"constant,{OWN}", "--json")
    laws = {entry["law"]: entry for entry in json.loads(out)["comparisons"][0]["ranking"]}
    assert (code, {*laws}) == (0, {"constant", "Decay"})
    assert laws["Decay"]["parameters"]["level"]["value"] == 0.9  # which the file fixes


SOFT = """
import softjax as sj

def soft(contact, softness):
    return sj.HertzDashpot(contact, 1 - softness)

class Plastic(sj.RateIndependentLaw):
    contact: sj.Contact
    force: float

    def loading_force(self, overlap):
        return self.force * overlap

    def unloading_force(self, overlap, peak_overlap):
        return self.force * (2 * overlap - peak_overlap)
"""


def test_a_law_of_ones_own_is_exported_as_far_as_a_code_can_express_it(at):
    """ε = √½ of springs of k and 2 k; a code without source of the user's takes the nearest law of its own."""
    (at / "soft.py").write_text(SOFT, "utf-8")
    export = ("export", "nylon", "--law", "soft.py:Plastic", "--set", "force=1e5", "--range", "1:2")
    code, _, error = run(*export, "--to", "liggghts", "--export-law", "exact")
    assert (code, "must be auto, linear, hertz-dashpot, " in error) == (2, True)
    for to, chosen in (("c", "exact"), ("liggghts", "linear")):
        assert run(*export, "--to", to, "--export-law", chosen, "--tolerance", 0.05)[0] == 0
        written = json.loads((at / "results/export.json").read_text("utf-8"))
        assert {"law": "Plastic", "force": 1e5}.items() <= written["requested"].items()
        assert written["law"] == chosen
    assert written["error_of_law"] < 1e-9  # a constant ε
    np.testing.assert_allclose(written["curve"]["requested"], 0.5**0.5, rtol=1e-9)
    few = ("--set", "softness=0.2", *FEW)
    assert run("curve", "nylon", "--law", "soft.py:soft", *few)[0] == 0
    written = np.loadtxt("results/curve.csv", delimiter=",", skiprows=1, usecols=1)
    np.testing.assert_allclose(written, 0.8, rtol=1e-9)


def test_where_a_law_of_ones_own_is_of_no_use_a_line_says_so(at, above_yield):
    refused = {
        ("curve", "nylon", "--law", OWN): "--set level=… rate=…",
        ("curve", "nylon", "--law", OWN, "--set", "level=1", "rat=2"): "did you mean 'rate'?",
        ("curve", "nylon", "--law", OWN, "--eps-up", 0.9): "left out with your own law",
        ("curve", "--fit", above_yield[1], "--law", OWN): "left out with a fit of a built-in law",
        ("compare", "--laws", f"hertz,{OWN}r"): "no 'Decayr'; one of Decay, decay",
        ("export", "nylon", "--to", "c", "--law", "none.py:Decay"): "none.py: no such file",
        (
            "export",
            "nylon",
            "--to",
            "c",
            "--law",
            OWN,
            "--set",
            "level=1",
            "rate=2",
        ): "`--law` must be a law with",
    }
    for words, blamed in refused.items():
        code, out, error = run(*words)
        assert (code, out, error.count("\n"), blamed in error) == (2, "", 1, True), error
