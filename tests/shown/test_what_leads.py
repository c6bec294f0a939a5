"""What a report begins with, which outliers it names, its points, and what it writes where a picture fails."""

from dataclasses import replace

import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import calibration as cal
import softjax as sj
from calibration import plots
from tests.cases import pair
from tests.command import run, write_alloy
from tests.shown.capture import labels
from tests.shown.conftest import NOISE, VELOCITY

SLIP, LOW = 7, 15  # rows


def drops(slips=()):
    """24 impacts about Thornton's law, with a scatter of 0.01 of which 0.002 is stated, and rows that are off."""
    law = sj.Thornton(pair("stainless steel", area="hertz"), 1.6)
    noise = 0.01 * np.random.default_rng(3).standard_normal(24)
    e = np.asarray(sj.restitution(law, 0.1 * VELOCITY).coefficient) + noise
    for row, off in slips:
        e[row] += off
    return cal.RestitutionData(0.1 * VELOCITY, e, law.contact, 0.002, name="steel")


@pytest.fixture(scope="module")
def misfit():
    return cal.fit(drops([(SLIP, 0.3), (LOW, -0.055)]), "thornton", profiles=False)


def test_where_no_interval_holds_the_first_sentence_says_so_and_gives_none(misfit):
    text = str(misfit)
    first, second, *_ = text.split("\n\n")
    first = " ".join(first.split())
    assert first.startswith("No interval holds: the law misses the points by more than their noise")
    assert not {"±", "…"} & {*first}
    assert f"p_y/Y = {misfit.values['yield_factor']:.3g}, rms" in first
    assert second.splitlines()[1].startswith("  ! model-misfit: ")
    assert text.index("Warnings:") < text.index("parameter ")
    page = misfit._repr_html_()
    assert page.index("No interval holds") < page.index("model-misfit") < page.index("<table")
    stated = cal.RestitutionData(VELOCITY, 0.85 + NOISE, None, 0.01, name="level")
    holds = " ".join(str(cal.fit(stated, "constant", profiles=False)).split("\n\n")[0].split())
    assert "95 % interval" in holds


def test_of_many_points_beyond_the_noise_those_that_a_robust_fit_leaves_are_named(misfit):
    """Around a curve that one slip pulls away others lie beyond their noise, too. The smaller slip is 5.5 times the noise."""
    outliers = misfit.outliers
    assert len(outliers) > 4
    assert [o.row - 1 for o in outliers if o.robust] == [SLIP, LOW]
    assert [o.robust for o in outliers] == sorted((o.robust for o in outliers), reverse=True)
    lines = str(misfit).splitlines()
    head = next(k for k, line in enumerate(lines) if "points lie beyond the noise" in line)
    assert lines[head].startswith(f"{len(outliers)} of 24 points lie beyond the noise (points.csv)")
    assert [line.split(",")[0].strip() for line in lines[head + 1 :]] == ["row 8", "row 16"]
    heavy = cal.fit(drops([(SLIP, 0.3)]), "thornton", noise="student-t", profiles=False)
    assert {outlier.robust for outlier in heavy.outliers} == {None}


def test_what_hides_in_the_scatter_that_a_slip_makes_is_named_with_its_size_by_a_robust_fit():
    """An error of 0.3 makes the estimated scatter 0.06. The other is 5.5 times the noise of all but these."""
    both = drops([(SLIP, 0.3), (LOW, -0.055)])
    result = cal.fit(both, "thornton", extra_scatter=True, profiles=False)
    assert [(o.row - 1, o.robust) for o in result.outliers] == [(SLIP, True), (LOW, True)]
    hidden = result.outliers[1]
    assert abs(hidden.residual) < 2
    # about the curve without the slips; they widen the scale of heavy tails a little
    keep = [k for k in range(24) if k not in (SLIP, LOW)]
    alone = cal.fit(
        replace(
            both,
            **{n: getattr(both, n)[keep] for n in ("velocity", "restitution", "uncertainty")},
            errors=None,
        ),
        "thornton",
        extra_scatter=True,
        profiles=False,
    )
    off = both.restitution[LOW] - alone.band(both.velocity[LOW]).coefficient
    assert hidden.robust_residual == pytest.approx(
        off / np.hypot(0.002, alone.material().noise), rel=0.25
    )
    (line,) = [line for line in str(result).splitlines() if "row 16" in line]
    assert f"{hidden.robust_residual:+.3g} by a robust fit" in line
    without = cal.fit(drops([(SLIP, 0.3)]), "thornton", extra_scatter=True, profiles=False)
    assert [o.row - 1 for o in without.outliers] == [SLIP]


def test_points_are_in_a_table_beside_the_report(misfit, tmp_path):
    misfit.report(tmp_path)
    table, data = pd.read_csv(tmp_path / "points.csv"), misfit.data
    np.testing.assert_allclose(table["restitution"], data.restitution, rtol=1e-12)
    np.testing.assert_allclose(table["velocity [m/s]"], data.velocity, rtol=1e-12)
    at = np.asarray(sj.restitution(misfit.law, data.velocity).coefficient)
    np.testing.assert_allclose(table["residual"], data.restitution - at, atol=1e-9)
    np.testing.assert_allclose(table["uncertainty"], 0.002, rtol=1e-9)
    assert [*table["row"]] == [*range(1, 25)]
    loaded = cal.FitResult.load(tmp_path / "fit.json")
    assert (loaded.outliers, loaded.material().deviations) == (
        misfit.outliers,
        misfit.material().deviations,
    )


def test_a_picture_that_fails_loses_nothing_else(tmp_path, monkeypatch):
    """Nor do the user's settings reach a file of results: without LaTeX usetex would end in an error."""
    file = write_alloy(tmp_path, 'law = "constant"\nprofiles = false')
    with matplotlib.rc_context({"text.usetex": True}):
        code, _, error = run("fit", file, "--out", tmp_path / "tex")
    assert (code, error, (tmp_path / "tex/curves.png").exists()) == (0, "", True)

    def fails(*_, **__):
        raise RuntimeError("no font\nat all")

    monkeypatch.setattr(plots, "curves_figure", fails)
    code, out, error = run("fit", file, "--out", tmp_path / "out")
    assert (code, "parameter" in out) == (3, True)
    line = "softjax fit: curves.png could not be drawn (RuntimeError: no font at all)"
    assert error.startswith(line)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"fit.json", "points.csv", "report.html"}
    result = cal.FitResult.load(tmp_path / "out/fit.json")
    with pytest.warns(UserWarning, match="curves.png could not be drawn"):
        result.report(tmp_path / "mine")


def test_a_picture_for_a_paper_has_its_legend_whole_and_both_axes_logarithmic(misfit):
    """85 mm wide, and into axes of the user's own."""
    further = cal.RestitutionData([0.5], [0.5], name="check")
    laws = {"Hertz": sj.Hertz(misfit.law.contact)}
    upper, lower = misfit.plot(figsize=(3.35, 3.8), log=True, laws=laws, points=further)
    assert (upper.get_xscale(), lower.get_xscale()) == ("log", "log")
    assert {"Hertz", "check", "data"} <= {*labels(upper)}
    figure = upper.figure
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box, whole = legend.get_window_extent(), figure.bbox
    assert whole.x0 <= box.x0 < box.x1 <= whole.x1
    assert whole.y0 <= box.y0 < box.y1 <= whole.y1
    low, high = upper.get_ylim()
    assert low < np.min(misfit.data.restitution) < np.max(misfit.data.restitution) < high
    assert high - low < 1.5 * np.ptp(misfit.data.restitution)  # the axis is the data's
    mine = Figure().add_subplot()
    assert misfit.plot(mine, points=False) is mine
    assert "data" not in labels(mine)
    assert mine.get_xlabel() == "impact velocity $v$ [m/s]"
    mine = Figure().add_subplot()
    misfit.plot(mine)
    (measured,) = mine.containers
    np.testing.assert_array_equal(measured[0].get_xdata(), misfit.data.velocity)


def test_a_result_is_a_table_in_markdown_and_latex(misfit):
    (estimate,) = misfit.estimates.values()
    shown = f"{estimate.value:.4f} ± {estimate.standard_error:.4f}"
    assert f"| p_y/Y | {shown} |" in misfit.to_markdown()
    latex = misfit.to_latex()
    assert f"$p_y/Y$ & ${shown.replace('±', chr(92) + 'pm')}$ & " in latex
    assert r"95 \% interval" in latex
    assert f"${estimate.low:.4f} \\ldots {estimate.high:.4f}$" in latex
    assert latex.startswith("\\begin{tabular}{lll}\n\\toprule\n")
