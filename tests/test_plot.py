"""Pictures: what is in them, and that they need no global state."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

import calibration as cal
import softjax as sj
from calibration import cli, plots
from calibration.curve.stream import Rows
from calibration.fitting.profiles import Profile
from calibration.plots import figure_2, figures, linear_spring, style
from calibration.plots.lines import NO_VALUE, PADDING, law_values
from calibration.plots.restitution import plot_restitution
from tests.cases import fitted, pair

NAMES = ["stainless steel", "chrome steel", "nylon"]


@pytest.fixture(scope="module")
def paper():
    route = sj.EnergyBalance()
    return cal.fit(cal.paper_materials(), objective="two-step", route=route, profiles=False)


@pytest.fixture(scope="module")
def paper_figure(paper):
    lines = plots.lines_of(paper, with_paper=True)
    return plots.curves_figure(paper, lines, ratio=True, from_rest=True, title="title")


def noisy_data(name="my alloy", growth=0.02, last=30.0):
    """24 impacts over two decades with error bars: Walton and Braun's 1/ε² = 1.1 + growth v."""
    velocity = np.geomspace(0.2, 30.0, 24)
    noise = 0.01 * np.random.default_rng(5).standard_normal(24)
    measured = 1 / np.sqrt(1.1 + growth * velocity) + noise
    kept = velocity <= last
    return cal.RestitutionData(velocity[kept], measured[kept], pair("nylon"), 0.01, name)


def own_fit(data, **options):
    return cal.fit(data, "walton-braun", **{"profiles": False} | options)


@pytest.fixture(scope="module")
def own():
    return own_fit(noisy_data(), profiles=True)


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


def test_each_curve_is_the_one_that_its_label_says(paper_figure, paper):
    """Over y = v/v_cr; Eq. (17) and Table 1 by the paper's numbers."""
    ax = paper_figure.axes[2]
    contact = pair("nylon")
    critical, limit = float(contact.critical_velocity), float(contact.limit_velocity)
    x, eq_17 = curve_of(ax, "Eq. (17)")
    v = x * critical
    assert np.allclose(eq_17, np.exp(-0.4355 * (v / (limit - v)) ** 0.5414), rtol=1e-9)
    _, model = curve_of(ax, "this model, fitted")
    law = sj.Zhou(contact, paper.values["chi[nylon]"], 0.4355, 0.5414)
    expected = np.asarray(sj.restitution(law, v).coefficient)
    assert np.allclose(model, expected, rtol=0, atol=1e-9)
    label = next(name for name in labels_of(ax) if "printed" in name)
    printed = sj.restitution(sj.Zhou(contact, 0.016, 0.4355, 0.5414, kappa="printed"), v)
    shown = np.isfinite(curve_of(ax, label)[1])
    assert np.allclose(curve_of(ax, label)[1][shown], np.asarray(printed.coefficient)[shown])
    (points,) = ax.containers
    assert np.allclose(points[0].get_xdata() * critical, paper.data["nylon"].velocity)
    assert np.allclose(points[0].get_ydata(), paper.data["nylon"].restitution)
    left = paper_figure.axes[5].containers[0][0].get_ydata()  # below: measured less fitted
    at_points = np.asarray(sj.restitution(law, paper.data["nylon"].velocity).coefficient)
    assert np.allclose(left, paper.data["nylon"].restitution - at_points, rtol=0, atol=1e-9)


def test_errors_of_velocities_are_bars_too():
    data = noisy_data()
    told = cal.RestitutionData(
        data.velocity, data.restitution, data.contact, 0.01, "v", velocity_uncertainty=0.05
    )
    ax = Figure().add_subplot()
    plots.curves.plot_data(ax, told, scale=2.0)
    across = ax.containers[0][2][0].get_segments()
    widths = [segment[1, 0] - segment[0, 0] for segment in across]
    assert np.allclose(widths, 2 * 0.05 / 2.0)


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
    both = paper.unloading_line
    chi = both.c1.value + both.c2.value * float(law.contact.yield_ratio)
    velocity = np.linspace(0.1, 80.0, 7) * float(law.contact.critical_velocity)
    expected = law_values(replace(law, chi=chi), velocity)
    assert np.allclose(line.value(velocity), expected, rtol=0, atol=1e-12)
    assert line.residuals


def band_of(ax, label):
    """Velocities and both edges of a filled band."""
    (area,) = [one for one in ax.collections if one.get_label() == label]
    x, y = area.get_paths()[0].vertices.T
    fine = np.unique(x)
    edges = [np.sort(y[x == one])[[0, -1]] for one in fine]
    return fine, *np.transpose(edges)


def test_own_data_have_error_bars_two_bands_and_residuals(own):
    figure = plots.curves_figure(own)
    upper, lower = figure.axes
    assert {"data", "Walton–Braun, fitted"} <= labels_of(upper)
    assert len(upper.containers) == len(lower.containers) == 1
    assert "[m/s]" in lower.get_xlabel()
    assert upper.get_xlim() == lower.get_xlim()
    data = noisy_data()
    points = np.asarray(lower.containers[0][0].get_ydata())
    expected = data.restitution - law_values(own.law, data.velocity)
    assert np.allclose(points, expected, rtol=0, atol=1e-12)
    curve, low, high = band_of(upper, "95 %, of the mean")
    found = own.band(curve)
    assert np.allclose([low, high], [found.low, found.high], rtol=0, atol=1e-12)
    curve, low, high = band_of(upper, "95 %, one more measurement")
    half = 1.959964 * np.hypot(own.band(curve).standard_error, 0.01)
    assert np.allclose(high - low, 2 * half, rtol=1e-6)


def test_the_bars_of_the_data_are_their_uncertainties(own):
    (bars,) = plots.plot_curve(own).containers
    ends = np.array([segment[:, 1] for segment in bars[2][0].get_segments()])
    data = noisy_data()
    expected = data.restitution[:, None] + np.array([-0.01, 0.01])
    assert np.allclose(np.sort(ends), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("last", "scale"), [(30.0, "log"), (5.0, "linear")])
def test_a_logarithmic_axis_only_for_data_that_span_decades(last, scale):
    assert plots.plot_curve(own_fit(noisy_data(last=last))).get_xscale() == scale


@pytest.mark.parametrize(("count", "shape"), [(1, (1, 1)), (2, (1, 2)), (3, (1, 3)), (4, (2, 2))])
def test_any_number_of_materials_has_its_panels(count, shape):
    figure = plots.curves_figure(own_fit([noisy_data(f"alloy {i}") for i in range(count)]))
    assert len(figure.axes) == 2 * count
    assert style.grid_shape(count) == shape


def test_seven_materials_leave_no_empty_panel():
    assert style.grid_shape(7) == (3, 3)
    figure = plots.curves_figure(own_fit([noisy_data(f"alloy {i}") for i in range(5)]))
    assert len(figure.axes) == 10


def test_a_picture_of_very_many_shows_the_first_and_says_so(monkeypatch):
    monkeypatch.setattr(figures, "MOST", 2)
    result = cal.fit([noisy_data(f"alloy {i}") for i in range(3)], starts=4)
    for made, each in (
        (plots.curves_figure(result), 2),
        (plots.profiles_figure(result), 1),
        (plots.correlation_figure(result), 1),
    ):
        assert len(made.axes) == 2 * each
        assert made.get_suptitle().startswith("the first 2 of ")
    monkeypatch.setattr(figures, "MOST", 24)
    assert plots.curves_figure(result).get_suptitle() == ""


def test_a_point_far_beyond_the_threshold_stretches_no_profile():
    far = Profile(
        "chi", (0.2, 0.96, 0.97, 0.98, 0.99, 1.0), (900, 4.0, 2.0, 1.0, 0.2, 0.0), 0.96, None, 3.84
    )
    low, _ = plots.plot_profile(far).get_xlim()
    assert 0.9 < low < 0.96
    near = replace(
        far, values=(0.94, *far.values[1:]), delta_chi_squared=(9.0, *far.delta_chi_squared[1:])
    )
    assert plots.plot_profile(near).get_xlim()[0] < 0.94


def test_first_yield_is_marked_where_the_law_yields():
    """Thornton's V_y, not the critical velocity of the contact; Walton and Braun's law has none."""
    contact = pair("nylon")
    velocity = np.geomspace(0.2, 30.0, 24)
    made = sj.restitution(sj.Thornton(contact, 2.5), velocity).coefficient
    data = cal.RestitutionData(velocity, np.asarray(made), contact, 0.01, "made")
    ax = plots.plot_curve(cal.fit(data, "thornton", profiles=False))
    x, _ = curve_of(ax, "first yield")
    critical = 2.5**2.5 * float(pair("nylon", area="hertz").critical_velocity)
    assert x[0] == pytest.approx(critical, rel=1e-6)
    assert "first yield" not in labels_of(plots.plot_curve(own_fit(noisy_data())))


def changed(result, **fields):
    """A result with another look at its only material."""
    return replace(result, materials=(replace(result.material(), **fields),))


def test_curves_of_bodies_that_differ_are_drawn_at_their_impacts():
    """A damping that acts on small bodies more; impacts in no order, each with a radius of its own."""
    random = np.random.default_rng(2)
    velocity, radius = random.uniform(1.0, 9.0, 12), random.uniform(0.005, 0.02, 12)
    contact = sj.Contact.with_wall(sj.NYLON, sj.STAINLESS_STEEL, radius)
    measured = np.asarray(sj.restitution(sj.ViscoelasticHertz(contact, 3e-6), velocity).coefficient)
    measured = measured + 0.005 * random.standard_normal(12)
    fit = cal.fit(cal.RestitutionData(velocity, measured, contact, 0.005), "viscoelastic")
    order = np.argsort(velocity)
    law = sj.restitution(sj.ViscoelasticHertz(contact, fit.values["dissipation_time"]), velocity)
    ax = plots.plot_curve(fit)
    x, y = curve_of(ax, "viscoelastic Hertz, fitted")
    np.testing.assert_allclose(x, velocity[order])
    np.testing.assert_allclose(y, np.asarray(law.coefficient)[order], rtol=1e-9)
    _, low, high = band_of(ax, "95 %, of the mean")
    assert np.all((low < y) & (y < high))
    x, _ = curve_of(plots.plot_curve(fit, ratio=True), "viscoelastic Hertz, fitted")
    np.testing.assert_allclose(x, np.sort(velocity / np.asarray(contact.critical_velocity)))
    assert len(plots.curves_figure(fit).axes) == 2


def test_no_ratio_to_a_critical_velocity_without_a_contact():
    data = cal.RestitutionData([1.0, 2.0, 3.0], [0.9, 0.91, 0.9], name="balls")
    with pytest.raises(ValueError, match="`ratio` must be False where there is no contact"):
        plots.plot_curve(cal.fit(data), ratio=True)


def test_points_with_a_flag_are_marked(own):
    data = own.material().data
    status = (int(sj.Status.ENERGY_GAIN), *[int(sj.Status.ELASTIC)] * 3, *[0] * (len(data) - 4))
    ax = plots.plot_curve(changed(own, status=status))
    x, y = curve_of(ax, "data where the law's status is not plain")
    assert x.tolist() == data.velocity[:1].tolist()
    assert y.tolist() == data.restitution[:1].tolist()


def test_a_fit_that_did_not_converge_is_marked_in_its_picture(own):
    figure = plots.curves_figure(changed(own, converged=False))
    assert "NOT CONVERGED" in figure.axes[0].get_title()


@pytest.mark.parametrize("name", ["$5 alloy$", r"a\b^", "_alloy", "al\nloy"])
def test_what_data_are_called_breaks_no_picture(name, tmp_path):
    result = own_fit([noisy_data(name), noisy_data("other")])
    shared = {"unloading_stiffness": cal.Parameter(shared=True)}
    together = cal.fit([noisy_data(name), noisy_data("other")], "walton-braun", shared)
    for figure in (
        plots.curves_figure(result),
        plots.correlation_figure(result),
        plots.correlation_figure(together),
        plots.profiles_figure(together),
    ):
        style.save(figure, tmp_path / "a.png")
        assert not any("\n" in ax.get_title() + ax.get_xlabel() for ax in figure.axes)


def test_a_profile_is_drawn_through_its_points_with_its_limits(own):
    figure = plots.profiles_figure(own)
    assert [ax.get_xlabel() for ax in figure.axes] == ["$k_{20}$ [N/m]", "$s$ [1/m]"]
    profile = own.profiles["growth"]
    ax = figure.axes[1]
    smooth, points = ax.get_lines()[:2]
    x, rise = points.get_data()
    assert np.allclose(x, profile.values, rtol=1e-12)
    assert np.allclose(np.interp(x, *smooth.get_data()), rise, rtol=0, atol=1e-9)
    between = 0.5 * (x[3] + x[4])
    value, error = own.values["growth"], own.standard_errors["growth"]
    drawn = np.interp(between, *smooth.get_data())
    assert drawn == pytest.approx(((between - value) / error) ** 2, rel=0.2, abs=0.05)
    ends = [line.get_xdata()[0] for line in ax.get_lines() if line.get_label() == "interval"]
    assert ends == [profile.low, profile.high]
    level = curve_of(ax, "threshold of the interval")[1][0]
    assert level == profile.threshold
    x, y = curve_of(ax, "from the standard error")
    assert np.allclose(y, ((x - value) / error) ** 2, rtol=1e-9, atol=1e-12)


def test_an_open_end_of_a_profile_is_told_and_decades_are_logarithmic():
    z = np.linspace(-1.3, 1.3, 19)
    rise = np.where(z > 0, 1.7 * (1 - np.exp(-2 * z)), 4 * z**2)
    profile = Profile("psi", tuple(0.54 * np.exp(2 * z)), tuple(rise), 0.075, None, 3.84)
    ax = plots.plot_profile(profile)
    assert [text.get_text() for text in ax.texts] == ["open end"]
    assert ax.texts[0].get_position()[0] > 0.5
    assert ax.get_xscale() == "log"


def test_a_profile_that_never_leaves_a_bound_has_no_panel(own):
    """ε_up at 1, say: σ runs on, and ε_up stays."""
    (label, moves), *_ = own.profiles.items()
    stays = replace(moves, parameter="k", values=(1.0,) * len(moves.values))
    assert plots.profiles_figure(replace(own, profiles={"k": stays})) is None
    figure = plots.profiles_figure(replace(own, profiles={"k": stays, label: moves}))
    assert len(figure.axes) == 1
    twice = replace(moves, values=moves.values[:1] + moves.values[:-1])
    assert plots.profiles_figure(replace(own, profiles={label: twice})) is not None


def test_no_profiles_no_picture(paper):
    assert plots.profiles_figure(paper) is None


def ellipses_of(ax):
    """Correlation that each ellipse shows, by its (column, row from above)."""
    count = len(ax.get_xticks())
    found = {}
    for patch in ax.patches:
        assert isinstance(patch, Ellipse)
        column, place = patch.center
        a, b = patch.width**2, patch.height**2
        found[(column, count - 1 - place)] = (a - b) / (a + b) * np.sign(patch.angle)
    return found


def test_correlations_are_ellipses_with_their_numbers():
    matrix = np.array([[1.0, -0.6, 0.2], [-0.6, 1.0, 0.0], [0.2, 0.0, 1.0]])
    ax = plots.plot_correlations(matrix, ["a", "b", "c"], told=["1 ± 2", "3 ± 4", "5 ± 6"])
    found = ellipses_of(ax)
    assert found == pytest.approx({(0, 1): -0.6, (0, 2): 0.2, (1, 2): 0.0}, abs=1e-9)
    assert {patch.angle for patch in ax.patches} == {45, -45}
    # leaning right for a positive one as it is seen: up is up
    assert not ax.yaxis_inverted()
    assert [label.get_text() for label in ax.get_yticklabels()] == ["c", "b", "a"]
    shown = {text.get_position(): text.get_text() for text in ax.texts}
    assert shown[(1, 2)] == "−0.60"
    assert shown[(2, 1)] == "0.00"
    assert shown[(0, 2)] == "1\n± 2"


def test_undefined_correlations_are_a_dash():
    ax = plots.plot_correlations([[1.0, np.nan], [np.nan, 1.0]], ["chi", "psi"])
    assert [text.get_text() for text in ax.texts] == ["–", "–"]
    assert not ax.patches


def test_each_material_has_its_correlations_in_a_panel(paper):
    figure = plots.correlation_figure(paper)
    assert [ax.get_title() for ax in figure.axes] == NAMES
    for ax, fit in zip(figure.axes, paper.materials, strict=True):
        names = list(paper.covariance_names)
        rows = [names.index(f"{name}[{fit.name}]") for name in ("chi", "sigma")]
        expected = paper.correlations[rows[0], rows[1]]
        order = [label.get_text() for label in ax.get_xticklabels()]
        assert sorted(order) == sorted([r"$\tilde\chi$", r"$\sigma$", r"$\psi$"])
        at = sorted(order.index(name) for name in (r"$\tilde\chi$", r"$\sigma$"))
        assert ellipses_of(ax)[tuple(at)] == pytest.approx(expected, abs=0.01)


def test_data_sets_that_share_a_parameter_have_one_panel():
    shared = {"unloading_stiffness": cal.Parameter(shared=True)}
    together = cal.fit([noisy_data("one"), noisy_data("two", 0.04)], "walton-braun", shared)
    (ax,) = plots.correlation_figure(together).axes
    labels = [label.get_text() for label in ax.get_xticklabels()]
    assert sorted(labels) == ["$k_{20}$", "$s$, one", "$s$, two"]


def test_long_names_leave_room_for_what_they_name():
    shared = {"unloading_stiffness": cal.Parameter(shared=True)}
    data = [noisy_data("one"), noisy_data("an alloy with a very long name indeed", 0.04)]
    together = cal.fit(data, "walton-braun", shared)
    figure = plots.correlation_figure(together)
    figure.draw_without_rendering()
    (ax,) = figure.axes
    assert ax.get_window_extent().width / figure.dpi > 0.9 * 3
    assert "$s$, an alloy with a ver…" in [label.get_text() for label in ax.get_xticklabels()]
    titles = {ax.get_title(): ax.get_xlabel() for ax in plots.profiles_figure(together).axes}
    assert titles == {"": "$k_{20}$ [N/m]", "one": "$s$ [1/m]", data[1].name: "$s$ [1/m]"}


def test_one_parameter_has_no_correlations():
    assert plots.correlation_figure(cal.fit(noisy_data(), "constant", profiles=False)) is None


def test_a_parameter_at_its_bound_leaves_no_picture_of_the_other_alone(own):
    covariance = own.covariance.copy()
    covariance[1] = covariance[:, 1] = np.nan
    assert plots.correlation_figure(own) is not None
    assert plots.correlation_figure(replace(own, covariance=covariance)) is None


def test_axes_given_are_the_axes_drawn_on(own):
    ax = Figure().add_subplot()
    assert plots.plot_curve(own, ax=ax) is ax
    assert plots.plot_residuals(own, ax=Figure().add_subplot()).get_ylabel() == "data − fit"
    assert plots.plot_profile(own.profiles["growth"], ax=ax) is ax
    other = Figure().add_subplot()
    assert plots.plot_correlations(np.eye(2), ["chi", "psi"], ax=other) is other


def test_equal_figures_are_equal_files(own, tmp_path):
    for name in ("one.png", "two.png"):
        plots.save(plots.correlation_figure(own), tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_a_curve_has_gaps_where_there_is_nothing_to_show(own):
    velocity = np.geomspace(0.1, 10.0, 40)
    status = np.where(velocity > 5, int(sj.Status.NO_REBOUND), 0)
    value = np.where(velocity < 0.2, np.nan, 0.9)
    rows = Rows(velocity, value, status, value - 0.1, value + 0.1)
    ax = plot_restitution(rows, "_my $law$", yields_at=1.0, result=(own.material(), 0.9))
    (line,) = [line for line in ax.get_lines() if "law" in str(line.get_label())]
    drawn = np.isfinite(line.get_ydata())
    np.testing.assert_array_equal(drawn, (velocity >= 0.2) & (velocity <= 5))
    assert curve_of(ax, "first yield")[0][0] == 1.0
    assert {"90 %, of the mean", "data", "not known"} <= labels_of(ax)
    assert any("my \\$law\\$" in label for label in labels_of(ax))
    (grey,) = ax.patches
    assert (grey.get_x(), grey.get_x() + grey.get_width()) == pytest.approx((0.1, velocity[6]))
    _, low, high = band_of(ax, "90 %, of the mean")
    assert np.allclose(high - low, 0.2)


def oracle_duration(restitution, end):
    """ω0 T by the textbook's formula."""
    loss = np.abs(np.log(restitution))
    xi = loss / np.hypot(np.pi, loss)
    w = np.sqrt(1 - xi**2)
    return (np.pi if end == "zero-overlap" else np.arctan2(2 * xi * w, 2 * xi**2 - 1)) / w


def test_both_ends_of_the_linear_springs_contact_are_drawn(monkeypatch):
    monkeypatch.setattr(linear_spring, "integrated_duration", oracle_duration)
    ax = linear_spring.plot_duration()
    for end, word in (("zero-overlap", r"\delta = 0"), ("zero-force", "zero force")):
        (line,) = [one for one in ax.get_lines() if word in one.get_label()]
        x, y = line.get_data()
        assert np.allclose(y, oracle_duration(x, end) / np.pi, rtol=1e-12, atol=0)
    assert "T" in ax.get_ylabel()
    hertz, spring = (line.get_xydata() for line in linear_spring.plot_forces().get_lines())
    assert np.allclose(hertz[:, 1], hertz[:, 0] ** 1.5, rtol=1e-12, atol=1e-15)
    # ½ K δ² = (2/5) k δ^{5/2}
    assert np.allclose(spring[:, 1], 0.8 * spring[:, 0], rtol=1e-12, atol=1e-15)


@pytest.mark.long
@pytest.mark.parametrize("end", linear_spring.LOOKS)
def test_the_linear_spring_integrated_lasts_as_long(end):
    x = linear_spring.INTEGRATED
    found = linear_spring.integrated_duration(x, end)
    assert np.allclose(found, oracle_duration(x, end), rtol=1e-8, atol=0)


def test_figure_2_has_the_curves_that_the_paper_compares(paper, tmp_path, monkeypatch):
    alone = replace(paper, unloading_line=None)
    panels = [ax for ax in figure_2.figure_2(alone).axes if ax.get_title()]
    assert [ax.get_title() for ax in panels] == NAMES
    for ax in panels:
        labels = labels_of(ax)
        for wanted in ("this model, fitted", "Eq. (17)", "printed", "paper's", "Hertz's", "data"):
            assert any(wanted in label for label in labels), wanted
        assert ("no solution beyond" in labels) == (ax.get_title() == "nylon")
    monkeypatch.setattr(figure_2, "fit_materials", lambda progress: alone)
    assert cli.main(["compare", "--figure2", "--quiet", "--out", str(tmp_path)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["figure2.png"]


def test_figure_2_is_of_the_papers_own_procedure(paper):
    found = figure_2.fit_materials()
    assert {fit.objective for fit in found.materials} == {"two-step"}
    assert found.values["chi[nylon]"] == pytest.approx(paper.values["chi[nylon]"], rel=1e-8)
    assert found.values["chi[nylon]"] == pytest.approx(0.21998, abs=1e-5)


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
