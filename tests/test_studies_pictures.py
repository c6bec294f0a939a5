"""What the pictures of studies show: the data of their artists."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import colors

import calibration as cal
from calibration.plots import style
from calibration.plots.studies import (
    plot_design,
    plot_sensitivities,
    plot_sobol,
    plot_tornado,
    sobol_figure,
    tornado_figure,
)
from calibration.studies.local import Sensitivities
from calibration.studies.sobol import SobolIndices
from softjax.fields import Declared
from tests.decay import Decay

DECLARED = {
    "chi": Declared("χ̃"),
    "radius_wall": Declared("R wall", "m"),
    "velocity": Declared("v", "m/s"),
}


def sensitivities() -> Sensitivities:
    """χ̃ acts downwards, the radius not at all, the velocity upwards, from 0.1 to 10 m/s."""
    v = np.geomspace(0.1, 10.0, 5)
    columns = np.stack([-v, 0 * v, 0.5 * v], axis=1)
    return Sensitivities(DECLARED, np.ones(2), v, np.full(5, 0.9), columns, np.zeros(5, int))


def sobol(**changed) -> SobolIndices:
    first, total = np.array([[0.2, 0.7], [0.1, 0.4]]), np.array([[0.3, 0.8], [0.5, 0.6]])
    given = {
        "names": ("chi", "radius_wall"),
        "ranges": {"chi": (0, 1), "radius_wall": (0, 1)},
        "scale": "uniform",
        "first": first,
        "total": total,
        "first_low": first - 0.05,
        "first_high": first + 0.1,
        "total_low": total - 0.02,
        "total_high": total + 0.04,
        "bound": np.array([[0.4, 1.7], [0.6, 0.9]]),
        "mean": np.ones(2),
        "variance": np.ones(2),
        "samples": 64,
        "confidence": 0.95,
        "velocity": np.array([1.0, 20.0]),
        "symbols": ("χ̃", "R wall"),
    }
    return SobolIndices(**given | changed)


def line(ax, label: str):
    (found,) = [one for one in ax.get_lines() if one.get_label() == label]
    return found


def legend(ax) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_each_input_that_acts_has_its_curve():
    found = sensitivities()
    ax = plot_sensitivities(found)
    np.testing.assert_array_equal(line(ax, r"$\tilde\chi$").get_xdata(), found.velocity)
    np.testing.assert_array_equal(line(ax, r"$\tilde\chi$").get_ydata(), -found.velocity)
    np.testing.assert_array_equal(line(ax, "$v$").get_ydata(), 0.5 * found.velocity)
    assert legend(ax) == [r"$\tilde\chi$", "$v$", "none: $R$ wall"]
    assert ax.get_xscale() == "log"
    assert ax.get_xlabel() == "impact velocity $v$ [m/s]"


def test_curves_are_parted_at_yield():
    ax = plot_sensitivities(sensitivities(), critical_velocity=0.5)
    curve = line(ax, r"$\tilde\chi$")
    gap = np.isnan(curve.get_ydata())
    np.testing.assert_array_equal(curve.get_xdata()[gap], [0.5])
    assert line(ax, r"yield, $v_\mathrm{cr}$").get_xdata() == [0.5, 0.5]
    outside = plot_sensitivities(sensitivities(), critical_velocity=50.0)
    assert not np.any(np.isnan(line(outside, "$v$").get_ydata()))
    assert legend(outside)[-1] == "none: $R$ wall"


def test_a_tornado_ranks_and_shows_signs():
    ax = plot_tornado(sensitivities(), 9.0)
    labels = [text.get_text() for text in ax.get_yticklabels()]
    assert labels == ["$R$ wall", "$v$", r"$\tilde\chi$"]  # the strongest on top
    np.testing.assert_allclose([bar.get_width() for bar in ax.patches], [0.0, 0.05, -0.1])
    shown = [colors.to_hex(bar.get_facecolor()).upper() for bar in ax.patches]
    assert shown == [style.BLUE, style.BLUE, style.VERMILION]
    assert ax.get_title() == "$v$ = 10 m/s"
    figure = tornado_figure(sensitivities().rows(slice(0, 2)))
    assert [one.get_title() for one in figure.axes] == ["$v$ = 0.1 m/s", "$v$ = 0.316 m/s"]


@pytest.mark.parametrize("output", [0, 1])
def test_indices_stand_side_by_side_with_their_limits(output):
    found = sobol()
    ax = plot_sobol(found, output)
    first, total = ax.containers[:2] if len(ax.containers) == 2 else ax.containers[1::2]
    np.testing.assert_allclose([bar.get_height() for bar in first], found.first[output])
    np.testing.assert_allclose([bar.get_height() for bar in total], found.total[output])
    segments = first.errorbar.lines[2][0].get_segments()
    expected = np.stack([found.first_low[output], found.first_high[output]], axis=1)
    np.testing.assert_allclose([segment[:, 1] for segment in segments], expected)
    marks = line(ax, "bound of total").get_ydata()
    bound = found.bound[output]
    np.testing.assert_array_equal(marks, np.where(bound <= 1, bound, np.nan))
    assert [text.get_text() for text in ax.get_xticklabels()] == [r"$\tilde\chi$", "$R$\nwall"]
    assert ax.get_title() == f"$v$ = {found.velocity[output]:.3g} m/s"


def test_all_panels_of_indices_have_one_scale_and_one_legend():
    figure = sobol_figure(sobol())
    one, two = figure.axes
    assert one.get_ylim() == two.get_ylim()
    assert one.get_ylim()[0] == 0
    assert one.get_ylim()[1] < 1.0  # no room kept for a legend
    assert one.get_legend() is two.get_legend() is None
    (shared,) = figure.legends
    words = [text.get_text() for text in shared.get_texts()]
    assert words == ["first order", "total", "bound of total"]
    assert not two.get_ylabel()
    many = sobol_figure(sobol(symbols=("χ̃", "R wall"), velocity=None))
    assert many.axes[0].get_title() == ""


def test_every_panel_shows_all_bars_with_their_limits():
    first = np.array([[0.2, 0.3], [0.1, 0.68], [-0.02, 0.4]])
    found = sobol(
        first=first,
        first_low=first - 0.05,
        first_high=first + 0.1,
        total=first + 0.1,
        total_low=first,
        total_high=first + 0.2,
        bound=np.full((3, 2), 2.0),
        velocity=np.array([1.0, 5.0, 20.0]),
    )
    figure = sobol_figure(found, "each within ±10 %")
    figure.draw_without_rendering()
    for ax in figure.axes:
        low, high = ax.get_ylim()
        assert low < -0.07
        assert high > 0.88
    assert figure.get_suptitle() == "each within ±10 %"


def design():
    return cal.optimal_velocities(Decay(0.95, 0.05), 8, (1.0, 60.0), criterion="D")


def test_a_design_shows_where_the_shots_are():
    found = design()
    ax = plot_design(found)
    shots = line(ax, "shots")
    np.testing.assert_allclose(shots.get_xdata(), [1.0, 21.0], rtol=1e-4)
    assert [text.get_text() for text in ax.texts] == ["4", "4"]
    even = line(ax, "equally spaced")
    np.testing.assert_allclose(even.get_xdata(), np.linspace(1.0, 60.0, 8))
    effect = line(ax, r"$\theta\,\partial\varepsilon/\partial\theta$, $\theta$ = $b$")
    v = effect.get_xdata()
    np.testing.assert_allclose(effect.get_ydata(), -0.05 * v * 0.95 * np.exp(-0.05 * v), rtol=1e-6)
    low = float(np.min(found.slopes))
    assert max(even.get_ydata()) < min(shots.get_ydata()) < low
    assert ax.get_ylim()[0] < min(even.get_ydata())


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, "D-optimal, model:\ncriterion as a standard error is 50 %"),
        ({"criterion": "c", "target": "rate"}, "c-optimal, model:\nstandard error of $b$ is 50 %"),
        ({"criterion": "I"}, "I-optimal, model:\nmean standard error of the curve is 50 %"),
    ],
)
def test_the_title_says_what_is_gained(changed, said):
    found = replace(design(), gain=2.0, **changed)
    assert plot_design(found).get_title() == f"{said} of that with equal spacing"
