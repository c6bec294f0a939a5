"""`softjax compare`: its table, its files and its picture."""

import json
import re

import numpy as np
import pytest

from tests.shown.capture import as_recorded, legend, line
from tests.shown.conftest import MADE, MASS, VELOCITY, shown, write
from tests.shown.tables import terminal_table
from tests.shown.test_fit import best, curve


def ranking(made):
    (comparison,) = json.loads(made.text("compare.json"))["comparisons"]
    return comparison["ranking"]


def score(value):
    return "–" if value is None else f"{value:.1f}" if abs(value) < 1000 else f"{value:.0f}"


def test_every_cell_of_the_table_and_the_winner_s_scores_are_scipy_s(compared):
    """As compare.json has them; AIC, BIC and rms of two parameters; elpd about lnL less two."""
    _, *rows = terminal_table(compared.out, "law  ")
    assert compared.code == 0
    entries = ranking(compared)
    for row, entry in zip(rows, entries, strict=True):
        behind = f"{score(entry['delta_elpd'])} ± {score(entry['delta_elpd_standard_error'])}"
        assert row == [
            entry["label"],
            score(entry["elpd"]),
            (behind + " tie" * entry["tie"]) if entry["delta_elpd"] else "best",
            f"{entry['weight']:.2f}",
            f"{entry['rms_leave_one_out']:.3g}",
            f"{entry['rms']:.3g}",
            score(entry["aic"]),
            score(entry["bic"]),
            str(entry["fitted_parameters"]),
        ]
    elpd = [entry["elpd"] for entry in entries]
    assert elpd == sorted(elpd, reverse=True)
    assert all(len(line) <= 100 for line in compared.out.partition("\nWritten")[0].splitlines())
    made, (x, covariance, chi_squared) = entries[0], best()
    log_likelihood = -0.5 * chi_squared - 24 * np.log(0.01 * np.sqrt(2 * np.pi))
    assert made["law"] == "walton-braun"
    assert made["aic"] == pytest.approx(4 - 2 * log_likelihood, abs=1e-6)
    assert made["bic"] == pytest.approx(2 * np.log(24) - 2 * log_likelihood, abs=1e-6)
    assert made["rms"] == pytest.approx(np.sqrt(np.mean((curve(x) - MADE) ** 2)), rel=1e-6)
    assert made["elpd"] == pytest.approx(log_likelihood - 2, abs=2)
    growth, k1 = (made["parameters"][n] for n in ("growth", "loading_stiffness"))
    scale = np.sqrt(k1["value"] / MASS)
    assert growth["value"] == pytest.approx(x[1] * scale, rel=1e-5)
    assert growth["standard_error"] == pytest.approx(np.sqrt(covariance[1, 1]) * scale, rel=1e-3)
    assert (growth["unit"], k1["unit"], k1["free"]) == ("1/m", "N/m", False)
    fitted = f"Walton–Braun +k20 .* ± {growth['standard_error']:.2g} 1/m$"
    assert re.search(fitted, compared.out, re.M)


def test_each_law_has_its_curve_in_the_picture(compared):
    figure = compared.figures["compare.png"]
    upper, lower = figure.axes
    as_recorded("compare", compared.everything)
    size = np.ptp(MADE)
    assert lower.get_ylim() == pytest.approx((np.min(MADE) - size / 2, np.max(MADE) + size / 2))
    v, e = line(upper, "Walton–Braun")
    np.testing.assert_allclose(v[[0, -1]], VELOCITY[[0, -1]])
    np.testing.assert_allclose(e, curve(best()[0], v), atol=1e-6)
    assert np.all(line(upper, "Hertz")[1] == 1)
    mean = line(upper, "constant ε (hard spheres)")[1]
    np.testing.assert_allclose(mean, np.mean(MADE), atol=1e-6)
    (points,) = upper.containers
    np.testing.assert_allclose(points[0].get_data(), [VELOCITY, MADE])
    figure.draw_without_rendering()
    (below,) = figure.legends
    inside = below.get_window_extent()
    assert figure.bbox.x0 <= inside.x0 < inside.x1 <= figure.bbox.x1
    assert all(inside.y1 <= ax.get_tightbbox().y0 for ax in figure.axes)


def test_laws_with_one_curve_share_a_line_and_a_law_twice_has_two_looks(tmp_path):
    """A dashpot law is a constant ε by another input, exp(-2a cot a) for exp(-π cot a) of the other end."""
    path = write(tmp_path)
    laws = ("--laws", "linear,constant,thornton,thornton-fixed", "--end", "zero-force")
    made = shown(tmp_path, "compare", path, *laws)
    entries = {entry["law"]: entry for entry in ranking(made)}
    value = {n: entries[n]["parameters"]["restitution"]["value"] for n in ("linear", "constant")}
    angle = np.arctan2(np.pi, -np.log(value["linear"]))
    assert np.exp(-2 * angle / np.tan(angle)) == pytest.approx(value["constant"], rel=1e-5)
    as_recorded("one curve twice", made.everything)
    names = legend(made.figures["compare.png"])
    assert sum("\n= " in name for name in names) == 1
    assert len(names) == 4  # data, the shared line, two of Thornton's
    drawn = [x for x in made.figures["compare.png"].axes[0].get_lines() if x.get_label()[0] != "_"]
    assert len({str(picture._unscaled_dash_pattern) for picture in drawn}) == 3
    settings = json.loads(made.text("compare.json"))["settings"]
    assert settings["options"] == {"end": "zero-force"}


def test_exact_data_have_no_scores_and_a_fit_that_did_not_converge_is_named(tmp_path):
    rows = "\n".join(f"{v},{0.8}" for v in VELOCITY)
    path = write(tmp_path)
    (tmp_path / "alloy.csv").write_text(f"velocity [m/s],restitution\n{rows}\n", encoding="utf-8")
    exact = shown(tmp_path, "compare", path, "--laws", "constant,hertz", quiet=True)
    entry = ranking(exact)[0]
    assert entry["law"] == "constant"
    names = ("elpd", "delta_elpd", "tie", "weight", "aic", "bic")
    assert {entry[name] for name in names} == {None}
    assert "NaN" not in exact.text("compare.json")
    assert exact.out == ""
    laws = "walton-braun,hertz"
    made = shown(tmp_path, "compare", write(tmp_path), "--laws", laws, "--max-steps", "1")
    assert made.code == 1
    as_recorded("compared, not converged", {**made.everything, "errors": made.err})
    assert "compare: did not converge: Walton–Braun (alloy); the results" in made.err
    assert "Walton–Braun (NOT CONVERGED)" in made.out
