"""The linear spring–dashpot in closed form, and the paper's argument against it."""

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad

import softjax as sj
from calibration.compare import linear
from calibration.compare.linear_picture import (
    INTEGRATED,
    equal_work_stiffness,
    integrated_duration,
    plot_duration,
    plot_forces,
)
from tests.cases import pair

VALUES = (0.01, 0.05, 0.2, 0.5, 0.8, 0.9, 0.99)


def oracle(restitution, end):
    """ω0 T and ε by the textbook's formulas, in 30 digits."""
    with mp.workdps(30):
        loss = -mp.log(mp.mpf(restitution))
        xi = loss / mp.sqrt(mp.pi**2 + loss**2)
        w = mp.sqrt(1 - xi**2)
        angle = mp.pi if end == "zero-overlap" else mp.atan2(2 * xi * w, 2 * xi**2 - 1)
        return float(angle / w), float(mp.exp(-xi / w * angle))


@pytest.mark.parametrize("end", linear.ENDS)
def test_duration_and_rebound_are_the_textbooks(end):
    expected = np.array([oracle(e, end) for e in VALUES]).T
    assert np.allclose(linear.duration(VALUES, end), expected[0], rtol=1e-14, atol=0)
    assert np.allclose(linear.rebound(VALUES, end), expected[1], rtol=1e-13, atol=0)


def test_rebounds_of_the_zero_force_end():
    """Digits found independently, for the Hertzian dashpot too."""
    found = linear.rebound([0.05, 0.2, 0.5, 0.8, 0.9], "zero-force")
    published = [0.213700, 0.324863, 0.550283, 0.808099, 0.902026]
    assert np.allclose(found, published, rtol=0, atol=6e-7)


def test_the_duration_diverges_for_the_zero_overlap_end_alone():
    """T → ∞ as ε → 0 belongs to δ = 0: T ω0 nears -ln ε there, and 2 with the other end."""
    restitution = np.array([1e-3, 1e-30, 1e-300])
    losses = -np.log(restitution)
    to_zero_overlap = linear.duration(restitution, "zero-overlap")
    to_zero_force = linear.duration(restitution, "zero-force")
    assert np.all(np.diff(to_zero_overlap) > 0)
    assert to_zero_overlap[-1] > 200 * np.pi
    assert np.allclose(to_zero_overlap[1:], losses[1:], rtol=0.01)
    assert np.all(np.diff(to_zero_force) < 0)
    assert abs(to_zero_force[-1] - 2) < 1e-4  # by a²/3
    assert np.allclose(to_zero_force - 2, (np.pi / losses) ** 2 / 3, rtol=0.15)


@pytest.mark.parametrize("end", linear.ENDS)
def test_the_force_law_integrated_lasts_as_long(end):
    found = integrated_duration(INTEGRATED, end)
    assert np.allclose(found, [oracle(e, end)[0] for e in INTEGRATED], rtol=1e-8, atol=0)


def test_an_input_is_found_for_a_wanted_rebound():
    for wanted in (0.136, 0.3, 0.7, 0.999):
        given = linear.restitution_that_gives(wanted, "zero-force")
        assert 0 < given < wanted
        assert oracle(given, "zero-force")[1] == pytest.approx(wanted, rel=1e-12)
        assert linear.restitution_that_gives(wanted, "zero-overlap") == wanted
    assert linear.restitution_that_gives(1.0, "zero-force") == 1.0
    for unreachable in (0.0, 0.1, np.exp(-2.0)):
        assert linear.restitution_that_gives(unreachable, "zero-force") is None


def test_unknown_ends_are_refused():
    with pytest.raises(ValueError, match="`end` must be one of"):
        linear.duration(0.5, "zero")


def test_the_spring_beside_hertz_stores_the_same_work():
    contact, depth = pair("nylon"), 3e-5
    work = quad(lambda x: float(sj.Hertz(contact).loading_force(x)), 0, depth, epsrel=1e-10)[0]
    stiffness = equal_work_stiffness(contact, depth)
    assert 0.5 * stiffness * depth**2 == pytest.approx(work, rel=1e-8)


def test_both_panels_are_drawn():
    ax = plot_duration()
    by_label = {line.get_label(): line for line in ax.get_lines()}
    ends = [by_label[label].get_ydata()[0] for label in by_label if label.startswith("contact")]
    assert max(ends) == pytest.approx(oracle(1e-3, "zero-overlap")[0] / np.pi)
    assert min(ends) == pytest.approx(oracle(1e-3, "zero-force")[0] / np.pi)
    assert "T" in ax.get_ylabel()
    hertz, spring = (line.get_xydata() for line in plot_forces().get_lines())
    assert np.allclose(hertz[:, 1], hertz[:, 0] ** 1.5, rtol=1e-12, atol=1e-15)
    assert np.allclose(spring[:, 1], 0.8 * spring[:, 0], rtol=1e-12, atol=1e-15)
