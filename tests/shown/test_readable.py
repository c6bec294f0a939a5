"""Pictures and sentences that a reader takes in without the text around them."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex

import calibration as cal
import softjax as sj
from calibration import plots
from calibration.curves import Rows
from calibration.fitting.material import Estimate
from calibration.plots.curves import plot_restitution
from calibration.report.fit import result_sentence
from tests.shown.capture import labels, line

STEEL = sj.STAINLESS_STEEL
SMALL, LARGE = 0.004, 0.012  # radii [m]


@pytest.fixture(scope="module")
def two_sizes():
    """Viscoelastic spheres of two sizes: ε differs."""
    radius = np.repeat([SMALL, LARGE], 6)
    contact = sj.Contact.between_spheres(STEEL, STEEL, radius, radius)
    v = np.tile(np.geomspace(0.1, 1.0, 6), 2)
    law = sj.ViscoelasticHertz(contact, 1e-6)
    noise = 0.002 * np.tile([1.0, -1.0], 6)
    data = cal.RestitutionData(v, np.asarray(sj.restitution(law, v).coefficient) + noise, contact)
    return cal.fit(data, sj.ViscoelasticHertz, profiles=False)


def test_residuals_have_the_colour_of_their_size(two_sizes):
    upper, lower = plots.curves_figure(two_sizes).axes
    curves = [one for one in upper.get_lines() if str(one.get_label()).startswith("R = ")]
    colours = [to_hex(one.get_color()) for one in curves]
    assert [one.get_label() for one in curves] == ["R = 2 mm", "R = 6 mm"]  # effective: half
    assert len(set(colours)) == 2
    drawn = [one[0] for one in lower.containers]
    assert [to_hex(one.get_color()) for one in drawn] == colours
    data = two_sizes.material().data
    for points, rows in zip(drawn, (slice(0, 6), slice(6, 12)), strict=True):
        np.testing.assert_allclose(points.get_xdata(), data.velocity[rows])
    assert "95 %, of the mean" in labels(upper)


def test_a_unit_stands_at_the_value_and_at_the_interval(two_sizes):
    values, interval = result_sentence(two_sizes).split(" (95 % interval ")
    assert values.endswith(" s")
    assert interval.split(")")[0].endswith(" s")


def rows(low, high):
    v = np.linspace(1.0, 2.0, 5)
    curve = np.linspace(0.95, 0.85, 5)
    return Rows(v, curve, np.zeros(5, int), curve - low, curve + high)


def test_a_band_much_wider_than_its_curve_is_cut_and_the_picture_says_so():
    """The curve spans 0.10, and has half of that above and below it."""
    ax = plot_restitution(rows(0.3, 0.01), "alloy", confidence=0.95)
    assert ax.get_ylim() == pytest.approx((0.80, 0.96))
    assert "95 %, of the mean\n(wider than the picture: 0.55 to 0.96)" in labels(ax)
    ax = plot_restitution(rows(0.02, 0.01), "alloy", confidence=0.95)
    assert "95 %, of the mean" in labels(ax)
    assert ax.get_ylim()[0] < 0.83


def test_the_profile_of_a_parameter_at_its_bound_is_drawn_over_a_linear_axis():
    """Its points come within 1e-10 of the bound, the interval ends at 0.03."""
    values = np.array([1e-10, 1e-6, 1e-3, 0.01, 0.03, 0.04])
    found = SimpleNamespace(
        parameter="chi",
        values=values,
        delta_chi_squared=values / 0.03 * 3.84,
        threshold=3.84,
        low=None,
        high=0.03,
    )
    ax = plots.plot_profile(found, Estimate(0.0, at_bound=True))
    assert ax.get_xscale() == "linear"
    x, y = ax.get_lines()[0].get_data()
    assert np.interp(0.03, x, y) == pytest.approx(3.84, rel=1e-3)
    assert line(ax, "interval")[0][0] == 0.03


def test_the_colours_of_correlations_are_explained_in_the_picture(alloy):
    figure = alloy.figures["correlation.png"]
    assert figure.get_supxlabel() == "blue: positive; orange: negative"


def test_one_point_and_one_parameter_are_no_plural():
    contact = sj.Contact.between_spheres(STEEL, STEEL, 0.01, 0.01)
    data = cal.RestitutionData([1.0], [0.9], contact, name="alloy")
    with pytest.raises(ValueError, match=r"1 point for 1 free parameter \("):
        cal.fit(data, sj.ViscoelasticHertz)
