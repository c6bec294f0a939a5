"""`softjax fit`: the data of its pictures and the cells of its tables, against SciPy's own fit."""

import datetime
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from calibration import plots
from tests.cases import pair
from tests.decay import Decay
from tests.fit_oracle import eq_17, thornton
from tests.shown.capture import (
    as_recorded,
    band,
    bars,
    drawn,
    labels,
    legend,
    line,
    looks,
    panels,
)
from tests.shown.conftest import MADE, MASS, NOISE, VELOCITY, reported, shown, write
from tests.shown.tables import Tags, cells

NAMES = ["stainless steel", "chrome steel", "nylon"]
TRUTH = dict(zip(NAMES, ((3.0432, 0.54), (0.1418, 0.3114), (0.4355, 0.5414)), strict=True))


def curve(x, v=VELOCITY):
    return 1 / np.sqrt(x[0] + x[1] * v)


@cache
def best():
    """a and b of 1/ε² = a + b v by SciPy, their covariance by second derivatives, and Σ r²/u²."""
    found = optimize.least_squares(lambda x: (curve(x) - MADE) / 0.01, [1.1, 0.02], xtol=1e-15)
    powers = np.stack([VELOCITY**0, VELOCITY])
    epsilon = curve(found.x)
    size = 0.25 * epsilon**6 + (epsilon - MADE) * 0.75 * epsilon**5
    information = (powers * size) @ powers.T / 0.01**2
    return found.x, np.linalg.inv(information), 2 * found.cost


def spring(alloy):
    """k1, and k20 and s with their errors, as SciPy's a and b are."""
    k1 = cal.FitResult.load(alloy.folder / "fit.json").law.loading_stiffness
    x, covariance, _ = best()
    scale = np.array([k1, np.sqrt(k1 / MASS)])
    return k1, x * scale, np.sqrt(np.diag(covariance)) * scale


def rise(k, value):
    """Δχ² with one of a, b at a value, the other one sought."""

    def squares(y):
        return np.sum(((curve([value, y] if k == 0 else [y, value]) - MADE) / 0.01) ** 2)

    near = (best()[0][1 - k] * 0.99, best()[0][1 - k] * 1.01)
    return optimize.minimize_scalar(squares, near, options={"xtol": 1e-12}).fun - best()[2]


def test_pictures_tables_and_sentences_are_as_recorded(alloy, main_job):
    as_recorded("alloy", alloy.everything)
    as_recorded("main", main_job.everything)


def test_the_fitted_curve_its_bands_and_residuals(alloy):
    upper, lower = alloy.figures["curves.png"].axes
    x, covariance, _ = best()
    v, fit = line(upper, "Walton–Braun, fitted")
    np.testing.assert_allclose(v[[0, -1]], VELOCITY[[0, -1]])
    np.testing.assert_allclose(fit, curve(x, v), atol=2e-7)
    slopes = -0.5 * np.stack([np.ones_like(v), v], axis=1) * curve(x, v)[:, None] ** 3
    error = np.sqrt(np.einsum("ki,ij,kj->k", slopes, covariance, slopes))
    for label, half in (("of the mean", error), ("one more measurement", np.hypot(error, 0.01))):
        at, low, high = band(upper, f"95 %, {label}")
        np.testing.assert_allclose(at, v)
        np.testing.assert_allclose(high - low, 2 * 1.959964 * half, rtol=2e-2)
        np.testing.assert_allclose(0.5 * (low + high), fit, atol=1e-4)
    (points,), (left,) = upper.containers, lower.containers
    np.testing.assert_allclose(points[0].get_data(), [VELOCITY, MADE])
    np.testing.assert_allclose(left[0].get_data(), [VELOCITY, MADE - curve(x)], atol=2e-7)
    for container, middle in ((points, MADE), (left, MADE - curve(x))):
        ends = bars(container)[:, :, 1]
        np.testing.assert_allclose(ends, middle[:, None] + [-0.01, 0.01], atol=2e-7)


def test_profiles_are_drawn_through_the_minimised_cost(alloy):
    """SciPy minimises over the other parameter; the interval ends where that crosses 3.84."""
    _, values, errors = spring(alloy)
    scale = values / best()[0]
    threshold = stats.chi2.ppf(0.95, 1)
    figure = alloy.figures["profiles.png"]
    for k, ax in enumerate(figure.axes):
        smooth, points = ax.get_lines()[:2]
        at, height = points.get_data()
        expected = [rise(k, value / scale[k]) for value in at]
        np.testing.assert_allclose(height, expected, rtol=1e-4, atol=1e-4)
        assert np.ptp(height) > threshold
        middle = 0.5 * (at[1:] + at[:-1])
        exact = [rise(k, value / scale[k]) for value in middle]
        drawn = np.interp(middle, *smooth.get_data())
        np.testing.assert_allclose(drawn, exact, rtol=0.02, atol=0.02)
        np.testing.assert_allclose(line(ax, "threshold of the interval")[1], threshold)
        fine, parabola = line(ax, "from the standard error")
        exact = ((fine - values[k]) / errors[k]) ** 2
        np.testing.assert_allclose(parabola, exact, rtol=2e-3, atol=1e-3)
        ends = [line.get_xdata()[0] for line in ax.get_lines() if line.get_label() == "interval"]
        np.testing.assert_allclose([rise(k, end / scale[k]) for end in ends], threshold, rtol=1e-2)
        assert ends[0] < values[k] < ends[1]
        assert ax.get_ylim() == pytest.approx((0, 1.6 * threshold))


def of_nine(main_job):
    """The nine parameters of the paper's materials with some covariance, and its picture."""
    fit = cal.FitResult.load(main_job.folder / "fit.json")
    rows = np.random.default_rng(1).standard_normal((9, 12))
    fit = replace(fit, covariance=rows @ rows.T)
    return fit, plots.correlation_figure(fit)


def test_correlations_are_a_matrix_with_its_numbers(alloy, main_job):
    ax, _ = alloy.figures["correlation.png"].axes
    _, covariance, _ = best()
    expected = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    image = ax.images[0]
    np.testing.assert_allclose(image.get_array(), [[1, expected], [expected, 1]], atol=1e-3)
    fit = cal.FitResult.load(alloy.folder / "fit.json")
    for r, written in ((-0.004, "0.00"), (0.254, "0.25"), (-0.994, "−0.99"), (0.9951, "0.9951")):
        ones = np.array([[1, r], [r, 1]]) * np.sqrt(np.outer(*[np.diag(fit.covariance)] * 2))
        (shown_ax, _) = plots.correlation_figure(replace(fit, covariance=ones)).axes
        texts = {text.get_position(): text.get_text() for text in shown_ax.texts}
        assert texts == {(0, 0): "1.00", (1, 1): "1.00", (0, 1): written, (1, 0): written}
    red, _, blue, _ = image.to_rgba(np.array([[expected]]))[0, 0]
    assert (blue > red) == (expected > 0)
    assert "correlation.png" not in main_job.figures
    fit, figure = of_nine(main_job)
    ax = figure.axes[0]
    np.testing.assert_array_equal(ax.images[0].get_array(), fit.correlations)
    order = [label.get_text() for label in ax.get_xticklabels()]
    i, j = (order.index(f"{symbol}\nnylon") for symbol in (r"$\tilde\chi$", r"$\sigma$"))
    names = list(fit.covariance_names)
    assert (names[i], names[j]) == ("chi[nylon]", "sigma[nylon]")


def test_the_main_job_says_what_it_found(main_job):
    assert (main_job.code, main_job.err) == (0, "")
    assert max(map(len, main_job.out.partition("\nWritten to")[0].splitlines())) <= 100
    header, *rows = main_job.page().tables[2]
    *warnings, large = cal.FitResult.load(main_job.folder / "fit.json").warnings
    assert (large.code, large.material) == ("overlap", "nylon")
    for row, warning in zip(rows, warnings, strict=True):  # no intervals to be too narrow
        of = dict(zip(header, row, strict=True))
        assert (of["rms of Eq. (17)"], of["scatter"]) == ("0", "0")
        assert warning.cause == f"rms {of['rms']} where the data follow Eq. (17) exactly"
        assert (warning.material, "interval" in warning.advice) == (of["material"], False)
    assert "\\u" not in main_job.text("fit.json")  # names as they are written
    assert main_job.text("report.html").count("data:image/png;base64,") == 1


def test_the_main_picture_has_each_curve_that_its_legend_names(main_job):
    """Over v/v_cr; Eq. (17) and Table 1 by the paper's numbers, Thornton's formula by hand."""
    figure, fit = main_job.figures["curves.png"], cal.FitResult.load(main_job.folder / "fit.json")
    printed = r"Zhou, printed $\kappa$ and Table 1's $\tilde\chi$"
    by_line = r"Zhou, $\tilde\chi$ by Eq. (18) fitted to all"
    paper, hertz = (
        rf"Thornton, yield at {s}" for s in (r"the paper's $v_\mathrm{cr}$", "Hertz's $V_y$")
    )
    expected = ["data", "Zhou, fitted", "Eq. (17)", printed, paper, hertz]
    assert [x for x in legend(figure) if x != "no solution beyond"] == [*expected, by_line]
    assert legend(fit.plot()[0, 0].figure) == [*expected[:3], by_line]
    slope = fit.unloading_line
    places = panels(figure)
    for (ax, below), name in zip(places, NAMES, strict=True):
        contact, data = pair(name), fit.data[name]
        critical, limit = float(contact.critical_velocity), float(contact.limit_velocity)
        y, shown_17 = line(ax, "Eq. (17)")
        v = y * critical
        np.testing.assert_allclose(y[[0, -1]] * critical, [0, np.max(data.velocity)])
        np.testing.assert_allclose(shown_17, eq_17(v, limit, *TRUTH[name]), rtol=1e-6)
        law = sj.Zhou(contact, fit.values[f"chi[{name}]"], *TRUTH[name])
        model = line(ax, "Zhou, fitted")[1]
        np.testing.assert_allclose(model, sj.restitution(law, v).coefficient, atol=1e-7)
        chi = slope.c1.value + slope.c2.value * float(contact.yield_ratio)
        moved = sj.restitution(sj.Zhou(contact, chi, *TRUTH[name]), v).coefficient
        np.testing.assert_allclose(line(ax, by_line)[1][1:], moved[1:], atol=1e-7)
        for label, area in ((paper, "zhou"), (hertz, "hertz")):
            first = float(pair(name, area).critical_velocity)
            np.testing.assert_allclose(line(ax, label)[1][1:], thornton(v[1:], first), atol=1e-9)
        (points,), (left,) = ax.containers, below.containers
        measured = [data.velocity / critical, data.restitution]
        np.testing.assert_allclose(points[0].get_data(), measured)
        at = np.asarray(sj.restitution(law, data.velocity).coefficient)
        np.testing.assert_allclose(left[0].get_ydata(), data.restitution - at, atol=1e-7)
        assert ("no solution beyond" in labels(ax)) == (name == "nylon")
    end, last = line(places[2][0], "no solution beyond")
    y, value = line(places[2][0], printed)
    assert 22 < end[0] < 25  # there the loading force vanishes before the spheres stop
    assert np.all(np.isnan(value[y > end[0]]))
    assert last[0] == value[y == end[0]]
    inside = y <= end[0]
    law = sj.Zhou(pair("nylon"), 0.0160, *TRUTH["nylon"], kappa="printed")
    v = y[inside] * float(pair("nylon").critical_velocity)
    np.testing.assert_allclose(value[inside], sj.restitution(law, v).coefficient, atol=1e-9)


def test_the_tables_of_a_report_have_the_fits_numbers(alloy):
    (k1, values, errors), chi_squared = spring(alloy), best()[2]
    fit = cal.FitResult.load(alloy.folder / "fit.json")
    bodies, parameters, quality = alloy.page().tables[:3]
    rows = {row[1]: row[2:] for row in parameters[1:]}
    assert list(rows) == ["k1 [N/m]", "k20 [N/m]", "s [1/m]"]
    fixed, *found = rows.values()
    assert float(fixed[0].removesuffix(" (fixed)")) == pytest.approx(k1, rel=1e-4)
    names = ("unloading_stiffness", "growth")
    for row, value, error, name in zip(found, values, errors, names, strict=True):
        read = [float(x) for x in plus_minus(row[0])]
        assert read == pytest.approx([value, error], rel=0.03)
        ends = [float(x) for x in row[1].split(" … ")]
        assert ends == pytest.approx(fit.intervals[name], abs=0.06 * error)
        assert row[2] == "profile"
    rms, p_value = np.sqrt(np.mean((curve(best()[0]) - MADE) ** 2)), stats.chi2.sf(chi_squared, 22)
    assert quality == [
        ["material", "points", "dof", "rms", "χ²/dof", "P", "converged"],
        ["alloy", "24", "22", f"{rms:.4g}", f"{chi_squared / 22:.3g}", f"{p_value:.3g}", "yes"],
    ]
    lines = alloy.out.splitlines()
    for row in parameters[1:]:  # without the material's name and where intervals come from
        assert cells(next(x for x in lines if x.startswith(row[1]))) == row[1:4]
    pairs = zip(quality[0][1:-1], quality[1][1:-1], strict=True)
    assert ", ".join(f"{name} {cell}" for name, cell in pairs) in lines
    mass = f"{4 / 3 * np.pi * 0.0127**3 * 1140:.4g}"
    assert bodies[1] == [
        *("alloy", "two equal spheres", "0.0127", mass, "2.5e+09", "0.3", "1140", "4e+07")
    ]  # fmt: skip


def test_a_result_shows_itself(alloy, tmp_path, monkeypatch):
    """Its frame has the estimates' numbers; `report` writes what the command does, the page alike."""
    fit = cal.FitResult.load(alloy.folder / "fit.json")
    text = str(fit)
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert str(fit) == text
    frame = fit.to_frame().set_index("parameter")
    for name, estimate in fit.estimates.items():
        row, ends = frame.loc[name], (estimate.standard_error, estimate.low, estimate.high)
        found = [row[key] for key in ("value", "standard_error", "low", "high")]
        expected = [estimate.value, *(ends if estimate.free else [np.nan] * 3)]
        assert found == pytest.approx(expected, nan_ok=True)
        assert (row["method"], row["free"]) == (estimate.method, estimate.free)
    assert list(frame["unit"]) == ["N/m", "N/m", "1/m"]
    with drawn() as figures:
        names = fit.report(tmp_path / "mine")
    assert {*names} == {path.name for path in alloy.folder.iterdir()}
    assert looks(figures["curves.png"]) == looks(fit.plot()[0].figure)
    own = re.compile("softjax fit .*|, from [^;]*alloy.csv")
    pages = alloy.page(), Tags((tmp_path / "mine/report.html").read_text(encoding="utf-8"))
    assert not {"`", "<code>"} & {*pages[0].words.replace("<code>", "`")}
    assert len(pages[0].named("code")) == 2  # `model`, and the command
    given, default = ([own.sub("", text) for text in page.paragraphs] for page in pages)
    assert default == [text for text in given if text]
    page = Tags(fit._repr_html_())
    assert page.open == page.named("img") == []
    for cell in pages[0].tables[1][2][:-1]:
        assert cell in page.words


class Grown(Decay):
    """With a number that a built-in law has under the same name."""

    growth: float = sj.number_field("g", "1/s", "pace of nothing", default=1.0)


def test_a_report_of_ones_own_law_needs_one_call(tmp_path):
    """Its parameters with the units that it declares; and the page opens with the result, date and data."""
    data = cal.RestitutionData(VELOCITY, MADE, uncertainty=0.01, name="mine")
    fit = cal.fit(data, Grown, {"growth": 1.0}, profiles=False, starts=4)
    names = fit.report(tmp_path)
    assert {*names} >= {"fit.json", "curves.png", "report.html"}
    assert list(fit.to_frame()["unit"]) == ["", "s/m", "1/s"]
    page = Tags((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "g: pace of nothing" in page.words
    body = page.words[page.words.index("fitted to") :]
    for word in ("24 impacts", "rms", datetime.date.today().isoformat(), "jax", "mine: 24 impacts"):
        body = body[body.index(word) :]


def plus_minus(cell: str) -> tuple[str, str]:
    found = re.fullmatch(r"\(?(\S+) ± (\S+?)\)?(e\S+)?", cell)
    return tuple(number + (found[3] or "") for number in found.group(1, 2))


def test_numbers_are_rounded_to_their_errors_and_never_to_more_digits_than_are_known():
    """0.0996 is 0.10, an end far below the error is not 0, and an error of rounding is none."""
    text = Path(__file__).with_name("rounded.txt").read_text(encoding="utf-8")
    values, intervals = (
        [[cell.strip() for cell in row.split(";")] for row in block.splitlines()[1:]]
        for block in text.split("\n\n")
    )
    number = lambda cell: None if cell == "none" else float(cell)  # noqa: E731
    for value, error, printed in values:
        assert str(cal.Estimate(number(value), number(error))) == printed
    level = cal.RestitutionData(VELOCITY, 0.85 + NOISE, None, 0.01)  # that a constant explains
    fit = cal.fit(level, "constant", profiles=False)
    for *row, printed in intervals:
        of = dict(zip(("low", "high", "standard_error"), map(number, row), strict=True))
        estimate = replace(fit.estimates["restitution"], **of)
        material = replace(fit.material(), parameters={"restitution": estimate})
        words = " ".join(str(replace(fit, materials=(material,))).split())
        found = re.search(r"\(95 % interval (.*?)\), rms", words)
        assert (found[1] if found else "") == printed, row


def test_very_many_materials_are_drawn_as_far_as_anybody_reads(tmp_path):
    """24 panels and 24 of 50 parameters; a name of 20 letters in whole, of 21 cut."""
    body = write(tmp_path).read_text(encoding="utf-8").partition("[[material]]")[2]
    names = ["a name of 20 letters", "a name of 21 letters.", *(f"m{k}" for k in range(23))]
    each = ["[[material]]" + body.replace('"alloy"', f'"{name}"', 1) for name in names]
    write(tmp_path, toml="[fit]\nstarts = 1\n" + "".join(each))
    made = shown(tmp_path, "fit", tmp_path / "alloy.toml", "--law", "eq-17", "--no-profiles")
    figure = made.figures.pop("curves.png")
    assert len(figure.axes) == 48
    assert figure.get_suptitle() == "the first 24 of 25 data sets: all are in fit.json"
    as_recorded("very many", {**made.figures, "printed": made.out})


def test_first_yield_velocity_errors_and_a_linear_axis(tmp_path):
    """Thornton's V_y; less than 1.5 decades are linear; bars across are the velocities' errors."""
    first = 1.6**2.5 * float(pair("nylon", area="hertz").critical_velocity)
    v = first * np.linspace(0.5, 12, 16)
    rows = "\n".join(f"{x},{e},0.01,0.05" for x, e in zip(v, thornton(v, first), strict=True))
    head = "velocity [m/s],restitution,uncertainty,velocity_uncertainty [m/s]\n"
    path = write(tmp_path)
    (tmp_path / "alloy.csv").write_text(head + rows + "\n", encoding="utf-8")
    made = shown(tmp_path, "fit", path, "--law", "thornton", "--no-profiles")
    assert made.code == 0
    as_recorded("first yield", made.everything)
    ax = made.figures["curves.png"].axes[0]
    assert ax.get_xscale() == "linear"
    law = cal.FitResult.load(made.folder / "fit.json").law
    assert line(ax, "first yield")[0][0] == pytest.approx(float(law.elastic_velocity()), rel=1e-9)
    assert line(ax, "first yield")[0][0] == pytest.approx(first, rel=0.02)
    across = bars(ax.containers[0], 0)[:, :, 0]
    np.testing.assert_allclose(across[:, 1] - across[:, 0], 0.1)


# how the line of an outlier tells its weight, of noise families that have one
WEIGHTS = {"normal": "", "student-t": r", weight [\d.e-]+"}


def test_outliers_of_drops_have_the_heights_of_the_file_and_a_weight_only_under_heavy_tails():
    drop = np.array([50, 100, 200, 300, 400, 500, 600, 700.0])
    table = {"drop_height [cm]": drop / 10, "rebound_height [mm]": np.round(0.8 * drop)}
    table["rebound_height [mm]"][5] = 363.0
    make = cal.RestitutionData.from_table
    data = make(table, pair("nylon"), height_uncertainty="1 mm", air=False)
    line = r"row 6, v = 3.132 m/s, ε = 0.8521: [-+]\d+\.?\d* standard deviations{}"
    line += r" \(drop 50 cm, rebound 36.3 cm\)"
    for noise, weight in WEIGHTS.items():
        text = " ".join(str(cal.fit(data, "constant", profiles=False, noise=noise)).split())
        assert re.search(line.replace("{}", weight), text), text


def test_an_outlier_of_another_observable_has_the_drop_height_alone():
    """Contact times of a spring; ε of the same row is a number of its own."""
    drop = np.linspace(50, 700, 14)
    table = {"drop_height [mm]": drop, "rebound_height [mm]": 0.64 * drop}
    noise = 1 + 0.01 * np.where(np.arange(14) == 5, 12, (-1) ** np.arange(14))
    table["contact_time [us]"], table["u_contact_time [us]"] = 40 * noise, [0.4] * 14
    make = cal.RestitutionData.from_table
    data = make(table, pair("nylon"), height_uncertainty="1 mm", air=False)
    text = " ".join(str(cal.fit(data, "linear", profiles=False)).split())
    assert re.search(r"row 6, [^()]*standard deviations \(drop 300 mm\)", text), text


def test_a_fit_that_did_not_converge_is_marked_everywhere(tmp_path):
    few = ("--law", "walton-braun", "--max-steps", "1", "--no-profiles")
    made = shown(tmp_path, "fit", write(tmp_path), *few)
    result = cal.FitResult.load(made.folder / "fit.json")
    assert (made.code, result.converged, result.optimiser_report[0].iterations) == (1, False, 1)
    assert "not-converged" in {warning.code for warning in result.warnings}
    assert made.err.splitlines()[-1].startswith("softjax fit: did not converge")
    followed = shown(tmp_path, "curve", "--fit", made.folder / "fit.json", "--points", "3")
    as_recorded("not converged", {**made.everything, "curve of it": followed.out})
    assert made.figures["curves.png"].axes[0].get_title() == "alloy (NOT CONVERGED)"
    for text in (made.page().words, made.out):
        assert "NOT CONVERGED: do not use these values." in text
    assert made.page().tables[2][1][-1] == "NO"
    assert "fit.json (NOT CONVERGED) 3 velocities," in " ".join(followed.out.split())


def test_priors_bounds_groups_and_scatter_are_stated(tmp_path):
    group = np.repeat(list("abcd"), 6)
    offsets = np.repeat([0.02, -0.01, -0.03, 0.02], 6)
    rows = [f"{v},{e + o},{g}" for v, e, o, g in zip(VELOCITY, MADE, offsets, group, strict=True)]
    path = write(tmp_path, settings='law = "walton-braun"')
    text = "\n".join(["velocity [m/s],restitution,group", *rows])
    (tmp_path / "alloy.csv").write_text(text + "\n", encoding="utf-8")
    more = "[material.parameters]\ngrowth = { prior = [0.5, 1e3], bounds = [0, 1e5] }\n"
    path.write_text(path.read_text(encoding="utf-8") + more, encoding="utf-8")
    made = shown(tmp_path, "fit", path, "--no-profiles")
    fit = cal.FitResult.load(made.folder / "fit.json").material()
    as_recorded("stated", made.everything)
    assert fit.noise == pytest.approx(0.01, rel=0.4)
    assert fit.group_deviation == pytest.approx(np.std(offsets, ddof=1), rel=0.6)


STEEL = sj.STAINLESS_STEEL
SMALL, LARGE = 0.004, 0.012345  # radii [m]


def test_residuals_have_the_colour_of_their_size_and_a_unit_stands_at_value_and_interval(tmp_path):
    radius = np.repeat([SMALL, LARGE], 6)
    contact = sj.Contact.between_spheres(STEEL, STEEL, radius, radius)
    v = np.tile(np.geomspace(0.1, 1.0, 6), 2)
    law = sj.ViscoelasticHertz(contact, 1e-6)
    noise = 0.002 * np.tile([1.0, -1.0], 6)
    data = cal.RestitutionData(v, np.asarray(sj.restitution(law, v).coefficient) + noise, contact)
    two_sizes = cal.fit(data, sj.ViscoelasticHertz, profiles=False)
    made = reported(two_sizes, tmp_path)
    as_recorded("two sizes", made.everything)
    upper, lower = made.figures["curves.png"].axes
    curves = [line for line in upper.get_lines() if str(line.get_label()).startswith("R = ")]
    assert [curve.get_label() for curve in curves] == ["R = 2 mm", "R = 6.17 mm"]  # effective: half
    data = two_sizes.material().data
    for bars_of, curve_of, rows in zip(
        lower.containers, curves, (slice(0, 6), slice(6, 12)), strict=True
    ):
        assert bars_of[0].get_color() == curve_of.get_color()
        np.testing.assert_allclose(bars_of[0].get_xdata(), data.velocity[rows])
    sentence = " ".join(str(two_sizes).split())
    values, interval = sentence.split(" (95 % interval ")[:2]
    assert values.endswith(" s")
    assert interval.split(")")[0].endswith(" s")


def test_residuals_of_groups_have_colours_and_markers(tmp_path):
    contact = sj.Contact.between_spheres(STEEL, STEEL, SMALL, SMALL)
    v, group = np.geomspace(0.5, 5.0, 9), list("BABABABAB")
    e = np.asarray(sj.restitution(sj.ViscoelasticHertz(contact, 1e-6), v).coefficient)
    e = e + np.where(np.array(group) == "A", 0.004, -0.004) + 0.001 * np.sin(9 * v)
    data = cal.RestitutionData(v, e, contact, group=group)
    made = reported(cal.fit(data, sj.ViscoelasticHertz, profiles=False), tmp_path)
    as_recorded("groups", made.everything)
    parts = {ax.get_label(): ax[0] for ax in made.figures["curves.png"].axes[1].containers}
    np.testing.assert_allclose(parts["group A"].get_xdata(), v[1::2])
    two = cal.fit([data, replace(data, name="b")], sj.ViscoelasticHertz, profiles=False)
    figures = reported(two, tmp_path).figures
    assert legend(figures["curves.png"])[-1] == "one marker for each group"


def test_long_lists_are_cut_and_say_how_much_is_left_out():
    """One group and one outlier more than are listed."""
    group, random = np.repeat(np.arange(21), 6), np.random.default_rng(1)
    e = 0.8 + 0.02 * random.standard_normal(21)[group] + 0.001 * random.standard_normal(126)
    e[:60:6] += np.linspace(0.006, 0.009, 10)
    data = cal.RestitutionData(np.linspace(1, 9, 126), e, None, 0.001, group=[*map(str, group)])
    as_recorded("long lists", {"printed": str(cal.fit(data, "constant", profiles=False))})


def test_an_outlier_is_marked_and_flattens_nothing_and_all_axes_are_of_one_kind(tmp_path):
    """0.01 off: a ring; much more, below (by decades) or above: an arrow at the edge of both panels."""
    v = np.geomspace(0.5, 5.0, 12)
    e = 0.9 + 0.001 * (-1.0) ** np.arange(12)
    e[[3, 7]] = 0.91, 0.01
    data = [cal.RestitutionData(v, e, uncertainty=0.001, name="a")]
    data.append(
        cal.RestitutionData(20 * v**2, abs(e - 0.2 - 0.6 * (e < 0.5)), None, 0.001, name="b")
    )
    result = cal.fit(data, "constant", noise="student-t", profiles=False)
    made = reported(result, tmp_path)
    as_recorded("outliers", made.everything)
    axes = made.figures["curves.png"].axes
    for ax in axes[:4]:
        assert np.ptp(ax.get_ylim()) < 0.1
        rings = [x for x in ax.get_lines() if (x.get_marker(), x.get_markersize()) == ("o", 8)]
        (arrow,) = (x for x in ax.get_lines() if "beyond" in x.get_label())
        assert [len(x.get_xdata()) for x in (*rings, arrow)] == [1, 1]
        edge = ax.get_ylim()["v^".index(arrow.get_marker())]
        assert 0 < abs(arrow.get_ydata()[0] - edge) < 0.2 * np.ptp(ax.get_ylim())


@pytest.mark.parametrize("noise", [0.1, 0.0005])
def test_a_band_much_wider_than_its_curve_is_cut_and_the_picture_says_so(noise, tmp_path):
    """At half the curve's height below and above it."""
    contact = sj.Contact.between_spheres(STEEL, STEEL, SMALL, SMALL)
    v = np.geomspace(0.5, 5.0, 6)
    e = np.asarray(sj.restitution(sj.ViscoelasticHertz(contact, 2e-6), v).coefficient)
    e = e + noise * np.array([1, -1, -1, 1, 1, -1])
    fit = cal.fit(cal.RestitutionData(v, e, contact), sj.ViscoelasticHertz, profiles=False)
    fit.save(tmp_path / "fit.json")
    words = ("--from", 0.5, "--to", 5, "--format", "png")
    made = shown(tmp_path, "curve", "--fit", tmp_path / "fit.json", *words)
    assert made.code == 0, made.err
    as_recorded(f"a band of {noise}", made.everything)
    ((ax,),) = (figure.axes for figure in made.figures.values())
    (name,) = [label for label in labels(ax) if label.startswith("95 %, of the mean")]
    (curve,) = [line.get_ydata() for line in ax.get_lines() if len(line.get_ydata()) > 100]
    half = (np.nanmax(curve) - np.nanmin(curve)) / 2
    _, below, above = band(ax, name)
    room = np.nanmin(curve) - half, np.nanmax(curve) + half
    is_wider = np.min(below) < room[0] or np.max(above) > room[1]
    assert (noise == 0.1) == is_wider == ("wider than the picture" in name)
    if is_wider:
        ends = max(np.min(below), room[0]), min(np.max(above), room[1])
        assert ax.get_ylim() == pytest.approx(ends, abs=1e-9)
    else:
        assert ax.get_ylim()[0] < np.min(below)


def test_the_profile_of_a_parameter_at_its_bound_is_drawn_over_a_linear_axis(tmp_path):
    """Its first points come within 1e-8 of the bound; it crosses the threshold where the interval ends."""
    contact = sj.Contact.with_wall(sj.NYLON, sj.STAINLESS_STEEL, 0.0127)
    v = float(contact.critical_velocity) * np.geomspace(2.0, 40.0, 12)
    e = 0.88 + 1e-3 * np.log(v) + 0.001 * np.tile([1.0, -1.0, -1.0, 1.0], 3)
    result = cal.fit(cal.RestitutionData(v, e, contact), starts=1)
    assert result.estimates["chi"].at_bound
    made = reported(result, tmp_path)
    as_recorded("at a bound", made.everything)
    (ax,) = [ax for ax in made.figures["profiles.png"].axes if "chi" in ax.get_xlabel()]
    assert ax.get_xscale() == "linear"
    profile = result.profiles["chi"]
    x, y = ax.get_lines()[0].get_data()
    assert np.interp(profile.high, x, y) == pytest.approx(profile.threshold, rel=0.01)


def test_names_of_correlations_are_inside_the_picture(main_job, tmp_path):
    _, figure = of_nine(main_job)
    plots.save(figure, tmp_path / "correlation.png")
    picture = imread(tmp_path / "correlation.png")[:, :, :3]
    assert picture.shape[1] == round(150 * figure.get_figwidth())
    for edge in (picture[:5], picture[-5:], picture[:, :5], picture[:, -5:]):
        assert np.all(edge == 1.0)  # nothing is cut
