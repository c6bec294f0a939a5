"""Pictures and sentences that a reader takes in without the text around them."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.image import imread

import calibration as cal
import softjax as sj
from tests.shown.capture import band, drawn, labels, legend
from tests.shown.conftest import shown

STEEL = sj.STAINLESS_STEEL
SMALL, LARGE = 0.004, 0.012  # radii [m]


def test_residuals_have_the_colour_of_their_size_and_a_unit_stands_at_value_and_interval(tmp_path):
    radius = np.repeat([SMALL, LARGE], 6)
    contact = sj.Contact.between_spheres(STEEL, STEEL, radius, radius)
    v = np.tile(np.geomspace(0.1, 1.0, 6), 2)
    law = sj.ViscoelasticHertz(contact, 1e-6)
    noise = 0.002 * np.tile([1.0, -1.0], 6)
    data = cal.RestitutionData(v, np.asarray(sj.restitution(law, v).coefficient) + noise, contact)
    two_sizes = cal.fit(data, sj.ViscoelasticHertz, profiles=False)
    with drawn() as figures:
        two_sizes.report(tmp_path / "out")
    upper, lower = figures["curves.png"].axes
    curves = [line for line in upper.get_lines() if str(line.get_label()).startswith("R = ")]
    colours = [to_hex(curve.get_color()) for curve in curves]
    assert [curve.get_label() for curve in curves] == ["R = 2 mm", "R = 6 mm"]  # effective: half
    assert len(set(colours)) == 2
    of_size = [bars[0] for bars in lower.containers]
    assert [to_hex(bars.get_color()) for bars in of_size] == colours
    data = two_sizes.material().data
    for points, rows in zip(of_size, (slice(0, 6), slice(6, 12)), strict=True):
        np.testing.assert_allclose(points.get_xdata(), data.velocity[rows])
    assert "95 %, of the mean" in labels(upper)
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
    with drawn() as figures:
        cal.fit(data, sj.ViscoelasticHertz, profiles=False).report(tmp_path / "out")
    figure = figures["curves.png"]
    parts = {ax.get_label(): ax[0] for ax in figure.axes[1].containers}
    assert list(parts) == ["group B", "group A"]
    assert legend(figure)[-2:] == ["group B", "group A"]
    assert len({(to_hex(part.get_color()), part.get_marker()) for part in parts.values()}) == 2
    np.testing.assert_allclose(parts["group A"].get_xdata(), v[1::2])
    with drawn() as figures:
        two = cal.fit([data, replace(data, name="b")], sj.ViscoelasticHertz, profiles=False)
        two.report(tmp_path / "out")
    assert legend(figures["curves.png"])[-1] == "one marker for each group"


def test_pictures_are_narrow_enough_for_a_telephone(alloy, main_job, compared, studied):
    """Scaled from 6.4 inches to 420 pixels, letters of 10 points are 9 pixels high."""
    for job in (alloy, main_job, compared, studied):
        assert job.figures
        assert all(figure.get_figwidth() <= 6.5 for figure in job.figures.values())


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
    with drawn() as figures:
        result.report(tmp_path / "out")
    (ax,) = [ax for ax in figures["profiles.png"].axes if "chi" in ax.get_xlabel()]
    assert ax.get_xscale() == "linear"
    profile = result.profiles["chi"]
    x, y = ax.get_lines()[0].get_data()
    assert np.interp(profile.high, x, y) == pytest.approx(profile.threshold, rel=0.01)
    ends = [line.get_xdata()[0] for line in ax.get_lines() if line.get_label() == "interval"]
    assert ends[-1] == pytest.approx(profile.high)


def test_titles_of_correlations_are_inside_the_picture(main_job, tmp_path):
    figure = main_job.figures["correlation.png"]
    assert "blue: positive, orange: negative" in figure.get_supxlabel()
    cal.FitResult.load(main_job.folder / "fit.json").report(tmp_path)
    edge = imread(tmp_path / "correlation.png")[:5, :, :3]
    assert np.all(edge == 1.0)  # nothing is cut at the upper edge
