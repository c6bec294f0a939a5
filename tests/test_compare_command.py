"""`softjax compare`: its files, its table, its exit codes, and what it draws."""

import json

import numpy as np
import pytest

import calibration as cal
from calibration import cli
from calibration.commands import compare
from calibration.compare import figure_2
from calibration.compare.pictures import comparison_figure
from calibration.compare.ranking import rank
from calibration.compare.telling import comparison_json, comparison_text
from calibration.plots import style
from tests.made_fits import CHI, material_fit, result_of

TOML = """
[fit]
seed = 3

[[material]]
name = "alloy"
youngs_modulus = 2.5e9
poisson_ratio = 0.3
density = 1140
yield_strength = 4.0e7
radius = 0.0127
data = "alloy.csv"

[material.parameters]
psi = 0.5
"""
VELOCITY = np.geomspace(1.5, 60.0, 30)
MADE = 1 / np.sqrt(1.08 + 0.01 * VELOCITY) + 0.003 * np.random.default_rng(1).normal(size=30)


def write(folder, points=30):
    rows = [f"{v},{e},0.003" for v, e in zip(VELOCITY[:points], MADE[:points], strict=True)]
    text = "\n".join(["velocity [m/s],restitution,uncertainty", *rows])
    (folder / "alloy.csv").write_text(text + "\n", encoding="utf-8")
    (folder / "alloy.toml").write_text(TOML, encoding="utf-8")
    return str(folder / "alloy.toml")


@pytest.fixture(scope="module")
def ranking():
    return rank(cal.paper_materials()[2], free=("yield_factor",))


def test_a_file_is_compared_and_told(tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["compare", write(tmp_path), "--free", "yield_factor", "--out", str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == ["compare.json", "compare.png"]
    found = json.loads((out / "compare.json").read_text(encoding="utf-8"))
    (one,) = found["comparisons"]
    assert (one["material"], one["n"], len(one["ranking"])) == ("alloy", 30, 11)
    best = one["ranking"][0]
    assert best["law"] in ("walton-braun-growing", "eq-17")
    growing = next(e for e in one["ranking"] if e["law"] == "walton-braun-growing")
    growth = growing["parameters"]["growth_per_velocity"]
    assert growth["unit"] == "s/m"
    assert abs(growth["value"] - 0.01) < 4 * growth["standard_error"]
    assert found["settings"]["free"] == ["yield_factor"]
    text, _ = capsys.readouterr()
    assert "acts in `softjax fit` only: seed, psi" in text
    assert text.index("Walton–Braun, k2 growing") < text.index("Hertz with dashpot")
    assert all(len(line) <= 120 for line in text.splitlines())


def test_the_ranking_of_nylon(ranking):
    """Found independently: the two-step χ̃ gives 0.00935, and a free ε_up cannot do worse."""
    zhou = ranking.entry("zhou")
    assert list(zhou.parameters) == ["chi", "eps_up"]
    assert 0.001 < zhou.rms < 0.00935
    assert zhou.parameters["eps_up"].value == pytest.approx(1.0, abs=1e-6)
    assert {"eps-up-only", "at-bound"} <= {doubt.code for doubt in zhou.doubts}
    assert ranking.entry("hertz").rms == pytest.approx(
        np.sqrt(np.mean((1 - ranking.data.restitution) ** 2)), rel=1e-12
    )
    assert ranking.entry("eq-17").rms < 1e-12
    assert ranking.entry("eq-17").aicc is None
    assert any("itself" in note for note in ranking.notes)
    assert ranking.converged


def test_json_has_every_number_or_null(ranking):
    text = comparison_json([ranking], {"free": []})
    found = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    entries = found["comparisons"][0]["ranking"]
    for entry, shown in zip(ranking.entries, entries, strict=True):
        assert shown["rms_leave_one_out"] == entry.rms_leave_one_out
        assert shown["fitted_parameters"] == entry.fitted
        assert [d["code"] for d in shown["doubts"]] == [d.code for d in entry.doubts]
        assert all(d["remedy"] for d in shown["doubts"])
    assert next(e for e in entries if e["law"] == "eq-17")["aicc"] is None


def test_the_table_names_every_law_once(ranking):
    text = comparison_text([ranking])
    table = text.splitlines()
    first = next(i for i, line in enumerate(table) if line.startswith("law  ")) + 2
    lines = table[first : first + len(ranking.entries)]
    for entry, line in zip(ranking.entries, lines, strict=True):
        assert line.startswith(entry.candidate.label)
    assert "NOT CONVERGED" not in text


def test_the_picture_has_each_different_curve_once(ranking):
    figure = comparison_figure([ranking])
    upper, lower = figure.axes
    labels = [line.get_label() for line in upper.get_lines() if line.get_label()[0] != "_"]
    assert len(labels) == len(set(labels))
    assert len(labels) == 8  # eleven laws, of which four share a line
    hertz = next(line for line in upper.get_lines() if line.get_label() == "Hertz")
    assert np.all(hertz.get_ydata() == 1)
    data = ranking.data.restitution
    low, high = lower.get_ylim()
    assert low < np.min(data) < np.max(data) < high < upper.get_ylim()[1] + 0.2
    assert figure.legends


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_legend_is_whole_and_below_all_axes(ranking, count):
    figure = comparison_figure([ranking] * count)
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


def test_a_fit_that_did_not_converge_is_told_by_the_exit_code(
    tmp_path, capsys, monkeypatch, ranking
):
    from dataclasses import replace

    broken = tuple(replace(entry, converged=False) for entry in ranking.entries)
    monkeypatch.setattr(
        "calibration.compare.ranking.rank", lambda *a, **k: replace(ranking, entries=broken)
    )
    assert cli.main(["compare", write(tmp_path), "--out", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert "NOT CONVERGED" in out
    assert len(err.splitlines()) == 1
    found = json.loads((tmp_path / "compare.json").read_text(encoding="utf-8"))
    assert found["comparisons"][0]["converged"] is False


@pytest.mark.parametrize(
    ("options", "points", "blamed"),
    [
        (["--figure2"], 30, "--figure2"),
        (["--linear-spring"], 30, "--linear-spring"),
        ([], 5, "6 or more"),
        (["--free", "chi"], 30, "yield_factor"),
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


def test_figure_2_has_the_curves_that_the_paper_compares(tmp_path, monkeypatch):
    """From a fit put together by hand; that fits are right is tested elsewhere."""
    entries = zip(
        cal.paper_materials(), ((3.0432, 0.54), (0.1418, 0.3114), (0.4355, 0.5414)), strict=True
    )
    made = result_of([material_fit(d, CHI[d.name], *losses) for d, losses in entries])
    figure = figure_2.figure_2(made)
    panels = [ax for ax in figure.axes if ax.get_title()]
    assert [ax.get_title() for ax in panels] == list(CHI)
    for ax in panels:
        labels = ax.get_legend_handles_labels()[1]
        for wanted in ("this model, fitted", "Eq. (17)", "printed", "paper's", "Hertz's", "data"):
            assert any(wanted in label for label in labels), wanted
        assert ("no solution beyond" in labels) == (ax.get_title() == "nylon")
    monkeypatch.setattr(figure_2, "fit_materials", lambda progress: made)
    assert cli.main(["compare", "--figure2", "--quiet", "--out", str(tmp_path)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["figure2.png"]


def test_the_options_are_those_of_the_documentation():
    for word in ("compare.json", "figure2.png", "linear_spring.png", "--figure2", "--free"):
        assert word in compare.__doc__
