"""Pictures: what is in them, and that they need no global state."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import softjax as sj
from calibration import plots
from calibration.plots import style
from calibration.plots.lines import NO_VALUE, PADDING, law_values
from tests.cases import fitted, pair
from tests.made_fits import (
    material_fit,
    noisy_data,
    own_fit,
    paper_fit,
    result_of,
)


@pytest.fixture(scope="module")
def paper():
    return paper_fit()


@pytest.fixture(scope="module")
def paper_figure(paper):
    lines = plots.lines_of(paper, with_paper=True)
    return plots.curves_figure(paper, lines, ratio=True, from_rest=True, title="title")


def labels_of(ax) -> set[str]:
    return set(ax.get_legend_handles_labels()[1])


def curve_of(ax, label):
    (line,) = [line for line in ax.get_lines() if line.get_label() == label]
    return np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)


def test_the_main_picture_has_three_panels_with_all_curves(paper_figure):
    panels = [ax for ax in paper_figure.axes if ax.get_title()]
    assert [ax.get_title() for ax in panels] == ["stainless steel", "chrome steel", "nylon"]
    for ax in panels:
        labels = labels_of(ax)
        assert {"data", "Eq. (17)", "this model, fitted"} <= labels
        assert sum("Thornton" in label for label in labels) == 2
        assert any("printed" in label for label in labels)
        assert any("Eq. (18)" in label for label in labels)
    (legend,) = paper_figure.legends
    shown = [text.get_text() for text in legend.get_texts()]
    assert len(shown) == len(set(shown))
    assert shown[0] == "data"


def test_every_axis_is_labelled(paper_figure):
    bottom = [ax for ax in paper_figure.axes if not ax.get_title()]
    assert all("v_\\mathrm{cr}" in ax.get_xlabel() for ax in bottom)
    assert paper_figure.axes[0].get_ylabel()


def test_curves_differ_by_style_and_not_by_colour_alone(paper_figure):
    named = [
        line
        for line in paper_figure.axes[0].get_lines()
        if not line.get_label().startswith("_") and line.get_linestyle() not in ("None", "none")
    ]
    looks = [str(line._unscaled_dash_pattern) for line in named]
    assert len(set(looks)) == len(named) >= 5
    assert len({line.get_color() for line in named}) == len(named)


def test_the_printed_model_is_drawn_only_where_it_has_a_solution(paper_figure):
    nylon = paper_figure.axes[2]
    assert nylon.get_title() == "nylon"
    label = next(name for name in labels_of(nylon) if "printed" in name)
    y, value = curve_of(nylon, label)
    ends = y[np.isfinite(value)].max()
    assert 22 < ends < 25  # there the loading force vanishes before the spheres stop
    assert np.all(np.isnan(value[y > ends]))
    x, _ = curve_of(nylon, "no solution beyond")
    assert x[0] == ends
    for ax in paper_figure.axes[:2]:
        assert "no solution beyond" not in labels_of(ax)


def test_a_law_is_drawn_where_its_status_says_that_it_has_a_value():
    law = fitted("nylon")
    velocity = np.linspace(0.0, 400.0, PADDING) * float(law.contact.critical_velocity)
    status = np.asarray(sj.restitution(law, velocity).status)
    none = status & int(NO_VALUE) != 0
    assert 0 < none.sum() < len(none)
    assert np.array_equal(np.isnan(law_values(law, velocity)), none)


def test_the_fitted_curve_is_the_law(paper):
    ax = plots.plot_curve(paper, "chrome steel", ratio=True)
    y, value = curve_of(ax, "this model, fitted")
    law = paper.material("chrome steel").law
    expected = law_values(law, y * float(law.contact.critical_velocity))
    assert np.allclose(value, expected, rtol=0, atol=1e-12)


def test_the_line_of_eq_18_is_the_same_law_with_its_chi(paper):
    (line,) = [one for one in plots.lines_of(paper)["nylon"] if "Eq. (18)" in one.label]
    law = paper.material("nylon").law
    chi = 0.03184 + 0.004554 * float(law.contact.yield_ratio)
    velocity = np.linspace(0.1, 80.0, 7) * float(law.contact.critical_velocity)
    expected = law_values(replace(law, chi=chi), velocity)
    assert np.allclose(line.value(velocity), expected, rtol=0, atol=1e-12)
    assert line.residuals


def test_own_data_have_error_bars_a_band_and_residuals():
    figure = plots.curves_figure(own_fit())
    upper, lower = figure.axes
    assert {"data", "95 % band", "$v_\\mathrm{cr}$, first yield"} <= labels_of(upper)
    assert len(upper.containers) == len(lower.containers) == 1
    assert "[m/s]" in lower.get_xlabel()
    assert upper.get_xlim() == lower.get_xlim()
    data = noisy_data()
    points = np.asarray(lower.containers[0][0].get_ydata())
    expected = data.restitution - law_values(own_fit().law, data.velocity)
    assert np.allclose(points, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("last", "scale"), [(30.0, "log"), (5.0, "linear")])
def test_a_logarithmic_axis_only_for_data_that_span_decades(last, scale):
    data = noisy_data()
    cut = data.velocity <= last
    short = type(data)(data.velocity[cut], data.restitution[cut], data.contact, name="short")
    result = result_of([material_fit(short, 0.22, 0.43, 0.54)])
    assert plots.plot_curve(result).get_xscale() == scale


@pytest.mark.parametrize(("count", "shape"), [(1, (1, 1)), (2, (1, 2)), (3, (1, 3)), (4, (2, 2))])
def test_any_number_of_materials_has_its_panels(count, shape):
    fits = [material_fit(noisy_data(f"alloy {i}"), 0.22, 0.43, 0.54) for i in range(count)]
    figure = plots.curves_figure(result_of(fits))
    assert len(figure.axes) == 2 * count
    assert style.grid_shape(count) == shape


def test_seven_materials_leave_no_empty_panel():
    assert style.grid_shape(7) == (3, 3)
    fits = [material_fit(noisy_data(f"alloy {i}"), 0.22, 0.43, 0.54) for i in range(5)]
    assert len(plots.curves_figure(result_of(fits)).axes) == 10


def test_points_with_a_flag_are_marked():
    data = noisy_data()
    status = [int(sj.Status.ENERGY_GAIN)] + [int(sj.Status.ELASTIC)] * 3 + [0] * (len(data) - 4)
    fit = material_fit(data, 0.22, 0.43, 0.54, status=tuple(status))
    x, y = curve_of(plots.plot_curve(result_of([fit])), "data where the law's status is not plain")
    assert x.tolist() == data.velocity[:1].tolist()
    assert y.tolist() == data.restitution[:1].tolist()


def test_a_fit_that_did_not_converge_is_marked_in_its_picture():
    fit = material_fit(noisy_data(), 0.22, 0.43, 0.54, converged=False)
    assert "NOT CONVERGED" in plots.curves_figure(result_of([fit])).axes[0].get_title()


def test_profiles_show_threshold_limits_and_open_ends():
    figure = plots.profiles_figure(own_fit())
    sigma, psi = figure.axes
    assert {"profile", "interval", "threshold of the interval"} <= labels_of(sigma)
    assert [text.get_text() for text in psi.texts] == ["open end"]
    assert not sigma.texts
    assert (sigma.get_xscale(), psi.get_xscale()) == ("linear", "log")


def test_no_profiles_no_picture():
    assert plots.profiles_figure(paper_fit()) is None


def test_correlations_stand_by_material_with_their_numbers(paper):
    swapped = result_of(paper.materials)
    order = [0, 3, 6, 1, 4, 7, 2, 5, 8]
    names = tuple(swapped.covariance_names[i] for i in order)
    mixed = result_of(
        paper.materials,
        covariance_names=names,
        covariance=swapped.covariance[np.ix_(order, order)],
    )
    ax = plots.correlation_figure(mixed).axes[0]
    owners = [label.get_text().rpartition(", ")[2] for label in ax.get_yticklabels()]
    assert owners == [fit.name for fit in paper.materials for _ in range(3)]
    shown = {(t.get_position()): t.get_text() for t in ax.texts}
    assert shown[(0, 0)] == "1.00"
    assert shown[(1, 0)] == "−0.60"
    assert shown[(8, 0)] == "0.00"


def test_undefined_correlations_are_a_dash():
    ax = plots.plot_correlations([[1.0, np.nan], [np.nan, 1.0]], ["chi", "psi"])
    assert [text.get_text() for text in ax.texts] == ["1.00", "–", "–", "1.00"]


def test_axes_given_are_the_axes_drawn_on():
    ax = Figure().add_subplot()
    profile = own_fit().profiles["sigma"]
    assert plots.plot_curve(own_fit(), ax=ax) is ax
    assert plots.plot_residuals(own_fit(), ax=Figure().add_subplot()).get_ylabel() == "data − fit"
    assert plots.plot_profile(profile, ax=ax) is ax
    other = Figure().add_subplot()
    assert plots.plot_correlations(np.eye(2), ["chi", "psi"], ax=other) is other


def test_equal_figures_are_equal_files(tmp_path):
    for name in ("one.png", "two.png"):
        plots.save(plots.correlation_figure(own_fit()), tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_no_pyplot_is_imported():
    script = "import calibration.plots, sys; print('matplotlib.pyplot' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


def test_thorntons_formula_is_drawn_at_both_critical_velocities(paper):
    lines = {line.label: line for line in plots.lines_of(paper, with_paper=True)["nylon"]}
    zhou, hertz = pair("nylon"), pair("nylon", area="hertz")
    for word, contact in (("paper's", zhou), ("Hertz's", hertz)):
        (line,) = [line for label, line in lines.items() if "Thornton" in label and word in label]
        critical = float(contact.critical_velocity)
        value = line.value(np.array([0.999, 1.5, 2.0, 100.0]) * critical)
        # Thornton (1997), e at V/V_y = 1.5, 2, 100
        assert np.allclose(value, [1.0, 0.9712, 0.9306, 0.3743], atol=5e-5)
