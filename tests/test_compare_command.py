"""`softjax compare`: its options, its files, its table, its exit codes, and what it draws."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex

import calibration as cal
from calibration import cli
from calibration.commands import compare as command
from calibration.fitting import refits
from calibration.fitting.doubt import Doubt
from calibration.plots import linear_spring, style
from calibration.plots.comparison import comparison_figure, plot_comparison
from calibration.report.comparison import comparison_json, comparison_text
from tests.cases import pair
from tests.command import BODIES

TOML = f"""
[fit]
seed = 3

{BODIES}data = "alloy.csv"

[material.parameters]
psi = 0.5
"""
VELOCITY = np.geomspace(1.5, 60.0, 30)
MADE = 1 / np.sqrt(1.08 + 0.01 * VELOCITY) + 0.003 * np.random.default_rng(1).normal(size=30)
CHEAP = "walton-braun,eq-17,thornton,thornton-fixed,constant,hertz"


def write(folder, points=30, toml=TOML):
    rows = [f"{v},{e},0.003" for v, e in zip(VELOCITY[:points], MADE[:points], strict=True)]
    text = "\n".join(["velocity [m/s],restitution,uncertainty", *rows])
    (folder / "alloy.csv").write_text(text + "\n", encoding="utf-8")
    (folder / "alloy.toml").write_text(toml, encoding="utf-8")
    return str(folder / "alloy.toml")


def run(folder, *options, toml=TOML):
    """Exit code, and compare.json as it was written."""
    out = folder / "out"
    code = cli.main(["compare", write(folder, toml=toml), *options, "--out", str(out)])
    return code, json.loads((out / "compare.json").read_text(encoding="utf-8"))


def data(name="alloy", velocity=VELOCITY, restitution=MADE):
    return cal.RestitutionData(velocity, restitution, pair("nylon"), 0.003, name=name)


@pytest.fixture(scope="module")
def comparison():
    return cal.compare(data(), CHEAP.split(","))


def test_the_names_of_laws_are_those_of_the_library():
    assert set(command.NAMES) == {*cal.LAWS, "thornton-fixed"}


def test_a_file_is_compared_and_told(tmp_path, capsys):
    code, found = run(tmp_path, "--laws", CHEAP)
    assert code == 0
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written == ["compare.json", "compare.png"]
    (one,) = found["comparisons"]
    assert (one["material"], one["n"], len(one["ranking"])) == ("alloy", 30, 6)
    assert one["ranking"][0]["law"] == "walton-braun"
    growth = one["ranking"][0]["parameters"]["growth"]
    assert growth["unit"] == "1/m"
    assert found["settings"]["laws"] == CHEAP.split(",")
    text, _ = capsys.readouterr()
    assert "acts in `softjax fit` only: seed, psi" in text
    assert text.index("Walton–Braun") < text.index("Hertz  ")
    assert all(len(line) <= 100 for line in text.partition("\nWritten")[0].splitlines())


def test_laws_are_chosen_by_either_option(tmp_path):
    _, found = run(tmp_path, "--laws", "constant, hertz", "--law", "eq-17", "--law", "hertz")
    laws = {entry["law"] for entry in found["comparisons"][0]["ranking"]}
    assert laws == {"constant", "hertz", "eq-17"}


def test_the_variant_of_zhous_law_acts(tmp_path):
    """From the command line, which wins over the file."""
    toml = TOML.replace("seed = 3", 'form = "full"\nkappa = "consistent"')
    _, found = run(tmp_path, "--law", "zhou", "--kappa", "printed", toml=toml)
    (zhou,) = found["comparisons"][0]["ranking"]
    assert zhou["options"] == {"form": "full", "kappa": "printed"}
    assert found["settings"]["options"] == zhou["options"]
    alloy = cal.read_toml(tmp_path / "alloy.toml")[0]
    options = {"form": "full", "kappa": "printed"}
    expected = cal.fit(alloy, "zhou", options, profiles=False, unloading_line=None)
    assert zhou["rms"] == pytest.approx(expected.rms, rel=1e-9)
    assert expected.law.kappa == "printed"


@pytest.mark.long
def test_the_end_of_a_dashpots_contact_acts(tmp_path):
    """exp(-2a cot a) at zero force for an input of exp(-π cot a): the same curve by another input."""
    _, found = run(tmp_path, "--law", "linear", "--law", "constant", "--end", "zero-force")
    by_law = {entry["law"]: entry for entry in found["comparisons"][0]["ranking"]}
    value = {law: e["parameters"]["restitution"]["value"] for law, e in by_law.items()}
    angle = np.arctan2(np.pi, -np.log(value["linear"]))
    assert np.exp(-2 * angle / np.tan(angle)) == pytest.approx(value["constant"], rel=1e-5)
    assert value["linear"] < value["constant"] - 1e-4


def test_json_has_every_number_or_null(comparison):
    exact = cal.compare(cal.paper_materials()[2], ["eq-17", "constant"])
    text = comparison_json([comparison, exact], {"laws": None})
    assert "NaN" not in text
    first, second = json.loads(text)["comparisons"]
    for entry, shown in zip(comparison.entries, first["ranking"], strict=True):
        assert shown["elpd"] == entry.leave_one_out.elpd
        assert shown["rms_leave_one_out"] == entry.leave_one_out.rms
        assert (shown["behind"], shown["behind_standard_error"]) == entry.behind
        assert (shown["aic"], shown["bic"]) == (entry.result.aic, entry.result.bic)
        assert shown["fitted_parameters"] == entry.fitted
        assert [d["code"] for d in shown["doubts"]] == [d.code for d in entry.doubts]
        assert all(d["remedy"] for d in shown["doubts"])
    made = second["ranking"][0]
    assert made["law"] == "eq-17"
    assert [made[name] for name in ("elpd", "behind", "tie", "weight", "aic", "bic")] == [None] * 6


def rows_below(text, header):
    """Cells of a table's lines, from its header to the next empty line."""
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(header)) + 2
    last = next(i for i in range(first, len(lines)) if not lines[i])
    return lines[first:last]


def test_the_table_has_every_law_with_its_scores(comparison):
    text = comparison_text([comparison])
    for entry, line in zip(comparison.entries, rows_below(text, "law  "), strict=True):
        assert line.startswith(entry.label)
        for number in (entry.leave_one_out.elpd, entry.result.bic):
            assert f" {number:.{int(abs(number) < 1000)}f} " in line
        if entry.behind.value:
            places = [int(abs(number) < 1000) for number in entry.behind]
            told = [f"{x:.{n}f}" for x, n in zip(entry.behind, places, strict=True)]
            assert " ± ".join(told) in line
    growth = comparison["walton-braun"].standard_errors["growth"]
    fitted = next(line for line in text.splitlines() if "k20" in line)
    assert fitted.startswith("Walton–Braun")
    assert fitted.endswith(f"± {growth:.2g} 1/m")
    assert "NOT CONVERGED" not in text


def test_doubts_say_where_their_causes_are_and_advise_no_second_comparison(comparison):
    worst = comparison.entries[-1]
    misfit = Doubt("model-misfit", "rms 1"), Doubt("residual-runs", "2 runs")
    doubted = replace(worst, result=replace(worst.result, warnings=misfit))
    found = replace(comparison, entries=(*comparison.entries[:-1], doubted))
    assert "causes are in comparison.entry(law).doubts)" in str(found)
    told = comparison_text([found], causes="compare.json")
    assert "causes are in compare.json)" in told
    assert misfit == found.entry(worst.label).doubts[:2]
    flat = " ".join(told.split())
    assert "intervals omit that. ! residual-runs" in flat
    assert "The law misses a trend, or points belong together" in flat
    for text in (told, comparison_json([found], {})):
        assert "softjax compare" not in text


def test_what_a_material_is_called_breaks_no_line():
    text = comparison_text([cal.compare(data("al\nloy"), ["constant"])])
    assert "\nloy" not in text


def line_of(ax, label):
    return next(line for line in ax.get_lines() if line.get_label() == label)


def test_the_picture_has_each_different_curve_once(comparison):
    figure = comparison_figure([comparison])
    upper, lower = figure.axes
    labels = [line.get_label() for line in upper.get_lines() if line.get_label()[0] != "_"]
    assert sorted(labels) == sorted(comparison.ranking)
    assert np.all(line_of(upper, "Hertz").get_ydata() == 1)
    law = comparison["walton-braun"].law
    ratio = law.unloading_stiffness / law.loading_stiffness
    growth = law.growth * np.sqrt(float(law.contact.mass) / law.loading_stiffness)
    x, y = line_of(upper, "Walton–Braun").get_data()
    assert np.allclose(y, 1 / np.sqrt(ratio + growth * x), rtol=1e-9, atol=0)
    assert (x[0], x[-1]) == pytest.approx((VELOCITY[0], VELOCITY[-1]))
    low, high = lower.get_ylim()
    size = np.ptp(MADE)
    assert (low, high) == pytest.approx((np.min(MADE) - size / 2, np.max(MADE) + size / 2))
    assert upper.get_ylim()[0] == 0
    assert figure.legends


def test_laws_are_told_apart_by_colour_and_dashes(comparison):
    lines = [one for one in plot_comparison(comparison).get_lines() if one.get_label()[0] != "_"]
    assert len({to_hex(line.get_color()) for line in lines}) == len(lines)
    assert len({str(line._unscaled_dash_pattern) for line in lines}) == len(lines)


def test_a_law_that_stands_twice_has_two_looks():
    laws = {"free": "thornton", "soft": "thornton"}
    both = cal.compare(data(), laws, parameters={"soft": {"yield_factor": 1.5}})
    free, soft = (line_of(plot_comparison(both), label) for label in ("free", "soft"))
    assert to_hex(free.get_color()) != to_hex(soft.get_color())
    assert free._unscaled_dash_pattern != soft._unscaled_dash_pattern


def test_laws_with_one_curve_share_a_line():
    def hard(restitution):
        return cal.LAWS["constant"](None, restitution)

    said = {"hard": {"restitution": cal.Parameter(0.8, bounds=(0.01, 1))}}
    both = cal.compare(data(), ["constant", hard], parameters=said)
    labels = plot_comparison(both).get_legend_handles_labels()[1]
    assert labels == ["constant ε (hard spheres)\n= hard", "data"]
    falling = cal.compare(data(), ["constant", "hertz"])
    labels = plot_comparison(falling).get_legend_handles_labels()[1]
    assert set(labels) == {*falling.ranking, "data"}


@pytest.mark.parametrize("name", ["$5 alloy$", "a_b^", "_alloy", r"$\alloy"])
def test_what_a_material_is_called_breaks_no_picture(name, comparison, tmp_path):

    named = replace(comparison, data=data(name))
    figure = comparison_figure([named])
    style.save(figure, tmp_path / "a.png")
    assert figure.axes[0].get_title().replace("\\$", "$").strip("\u200b") == name


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_legend_is_whole_and_below_all_axes(comparison, count):
    figure = comparison_figure([comparison] * count)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    inside = legend.get_window_extent()
    assert figure.bbox.x0 <= inside.x0 < inside.x1 <= figure.bbox.x1
    assert figure.bbox.y0 <= inside.y0
    assert all(inside.y1 <= ax.get_tightbbox().y0 for ax in figure.axes)


@pytest.mark.parametrize(("length", "columns"), [(3, 3), (40, 2), (200, 1)])
def test_a_legend_has_as_many_columns_as_fit(length, columns):
    figure = style.new_figure(9.0, 4.0)
    ax = figure.add_subplot()
    for letter in "abc":
        ax.plot([0, 1], [0, 1], label=letter * length)
    style.legend_below(figure, [ax], 3)
    assert [legend._ncols for legend in figure.legends] == [columns]


def test_a_fit_that_did_not_converge_is_told_by_the_exit_code(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(refits, "STEPS", 0)
    code, found = run(tmp_path, "--law", "walton-braun")
    assert code == 1
    out, err = capsys.readouterr()
    assert "Walton–Braun (NOT CONVERGED)" in out
    assert len(err.splitlines()) == 1
    assert found["comparisons"][0]["converged"] is False


@pytest.mark.parametrize(
    ("options", "points", "blamed"),
    [
        (["--figure2"], 30, "--figure2"),
        (["--linear-spring"], 30, "--linear-spring"),
        ([], 5, "6 or more"),
        (["--laws", "zhuo"], 30, "did you mean 'zhou'"),
        (["--laws", ","], 30, "--laws"),
        (["--law", "hertz", "--form", "full"], 30, "zhou among the laws"),
        (["--law", "zhou", "--end", "zero-force"], 30, "hertz-dashpot or linear"),
        (["--free", "yield_factor"], 30, "--free"),
    ],
)
def test_unusable_input_is_refused_and_nothing_is_written(
    options, points, blamed, tmp_path, capsys
):
    out = tmp_path / "out"
    try:
        code = cli.main(["compare", write(tmp_path, points), *options, "--out", str(out)])
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    line = capsys.readouterr().err
    assert blamed in line
    assert len(line.splitlines()) == 1
    assert not out.exists()


def test_a_picture_alone_takes_no_laws(tmp_path, capsys):
    assert cli.main(["compare", "--figure2", "--law", "zhou", "--out", str(tmp_path / "o")]) == 2
    assert "--law" in capsys.readouterr().err


def test_the_case_against_the_linear_spring_is_drawn_alone(tmp_path, monkeypatch):
    """Integration is tested with the law; here the closed form stands in for it."""
    monkeypatch.setattr(linear_spring, "integrated_duration", linear_spring.duration)
    assert cli.main(["compare", "--linear-spring", "--quiet", "--out", str(tmp_path)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["linear_spring.png"]


def test_the_options_are_those_of_the_documentation():
    for word in ("compare.json", "figure2.png", "linear_spring.png", "--figure2", "--laws"):
        assert word in command.__doc__
