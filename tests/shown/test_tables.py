"""Other tables and pictures: curves, look-up tables, speed, coverage, the self-check."""

import csv
import itertools
import re
import time

import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import fitted
from tests.command import run
from tests.decay import Decay
from tests.shown.capture import band, labels, line
from tests.shown.conftest import shown
from tests.shown.test_fit import EPSILON, SPEED, best, curve

SLOPPY = sj.ODE(rtol=1e-3)


def test_the_route_of_a_look_up_table_acts(tmp_path):
    """By the ODE at a coarse tolerance ε, duration and overlap differ from the energy balance's."""
    grid = ("--from", "2", "--to", "9", "--points", "4", "--table")
    made = shown(tmp_path, "curve", "nylon", *grid, "--route", "ode", "--rtol", "1e-3")
    (name,) = (p.name for p in made.folder.iterdir())
    rows = [x for x in made.text(name).splitlines() if x[0].isdigit()]
    v, *columns = np.array([re.split(r"[\s,]+", x)[:5] for x in rows], float).T
    by_ode, exact = (sj.restitution(fitted("nylon"), v, r) for r in (SLOPPY, None))
    for value, column in (
        ("coefficient", 0),
        ("plastic_coefficient", 1),
        ("duration", 2),
        ("peak_overlap", 3),
    ):
        np.testing.assert_allclose(columns[column], getattr(by_ode, value), rtol=1e-8)
    for value in ("coefficient", "duration"):
        assert np.max(np.abs(getattr(by_ode, value) / getattr(exact, value) - 1)) > 1e-7


def test_the_picture_of_a_fits_curve(tmp_path, alloy):
    """The curve, its band and the data."""
    few = ("--points", "40", "--from", "0.1", "--to", "50")
    made = shown(tmp_path, "curve", "--fit", alloy.folder / "fit.json", *few)
    (ax,) = made.figures["curve.png"].axes
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_xscale()) == (SPEED, EPSILON, "log")
    (name,) = (x for x in labels(ax) if x.startswith("alloy"))
    v, e = line(ax, name)
    np.testing.assert_allclose(v, np.geomspace(0.1, 50, 40))
    np.testing.assert_allclose(e, curve(best()[0], v), atol=1e-6)
    fit = cal.FitResult.load(alloy.folder / "fit.json")
    _, low, high = band(ax, "95 %, of the mean")
    np.testing.assert_allclose([low, high], [fit.band(v).low, fit.band(v).high])
    (points,) = [c for c in ax.containers if c.get_label() == "data"]
    np.testing.assert_allclose(points[0].get_data(), [fit.data.velocity, fit.data.restitution])


def test_a_curve_has_gaps_where_nothing_rebounds(tmp_path):
    """Beyond v_lim, 320 m/s, and points where they are few; first yield is marked inside."""
    made = shown(tmp_path, "curve", "nylon", "--from", "0.1", "--to", "400", "--points", "20")
    (ax,) = made.figures["curve.png"].axes
    v, e = line(ax, "nylon")
    law = fitted("nylon")
    hit = sj.restitution(law, v)
    rebounds = np.asarray(hit.coefficient) > 0
    np.testing.assert_array_equal(np.isfinite(e), rebounds)
    assert 0 < rebounds.sum() < 20
    np.testing.assert_allclose(e[rebounds], np.asarray(hit.coefficient)[rebounds])
    assert line(ax, "first yield")[0][0] == pytest.approx(float(law.contact.critical_velocity))
    (drawn,) = [one for one in ax.get_lines() if one.get_label() == "nylon"]
    assert drawn.get_marker() == "o"


def test_what_a_fit_does_not_determine_is_grey(tmp_path):
    v, law = np.geomspace(1.5, 20, 12), fitted("nylon")
    exact = np.asarray(sj.restitution(law, v).coefficient)
    noise = 0.003 * np.random.default_rng(1).standard_normal(12)
    data = cal.RestitutionData(v, exact + noise, law.contact, 0.003, name="nylon")
    cal.fit(data, profiles=False).save(tmp_path / "fit.json")
    few = ("--from", "0.1", "--to", "20", "--points", "30")
    made = shown(tmp_path, "curve", "--fit", tmp_path / "fit.json", *few)
    (ax,) = made.figures["curve.png"].axes
    (grey,) = ax.patches
    grid = np.geomspace(0.1, 20, 30)
    first = grid[grid >= float(law.contact.critical_velocity)][0]
    assert (grey.get_x(), grey.get_x() + grey.get_width()) == pytest.approx((0.1, first))
    assert grey.get_label() == "not known"
    shown_line = line(ax, "nylon")[1]
    np.testing.assert_array_equal(np.isfinite(shown_line), grid >= first)


@pytest.fixture
def ticking(monkeypatch):
    """A clock by which everything takes a second or more, each time a little longer."""
    counted = itertools.count(1)
    monkeypatch.setattr(time, "perf_counter", lambda: (lambda k: k + 1e-4 * k * k)(next(counted)))


def power_law(rows, family, error):
    """Microseconds of a method where it errs so, between its settings by a straight line in logarithms."""
    points = sorted(
        (float(r["largest_error"]), float(r["microseconds"])) for r in rows if r["family"] == family
    )
    below, above = ([p for p in points if (p[0] > 1.1 * error) == side] for side in (False, True))
    if not below:
        return None
    if not above:
        return min(t for _, t in below) if below[-1][0] > error / 3 else None
    (e1, t1), (e2, t2) = below[-1], above[0]
    return min(t1, np.exp(np.interp(np.log(error), np.log([e1, e2]), np.log([t1, t2]))))


@pytest.mark.parametrize(
    "law",
    [
        None,
        *(
            pytest.param(n, marks=pytest.mark.long)
            for n in ("own", "linear", "viscoelastic", "hertz-dashpot")
        ),
    ],
)
def test_speed_is_microseconds_a_collision(law, ticking, tmp_path):
    """By a clock of a second a call; errors against exact answers; ratios and picture of these rows."""
    made = shown(tmp_path, "speed", "--quick", *(() if law is None else ("--law", law)))
    assert made.code == 0
    assert "\r" not in made.text("speed.csv")
    rows = list(csv.DictReader(made.text("speed.csv").splitlines()))
    for row in rows:
        seconds = 1e-6 * float(row["microseconds"]) * int(row["batch"])
        assert 1 <= seconds < 100
        told = (
            re.escape(f"{int(row['batch']):,}")
            + r"\s+"
            + re.escape(f"{float(row['microseconds']):.3g}")
        )
        setting = re.escape(row["family"]) + r"\s+" + re.escape(row["setting"])
        error = re.escape(f"{float(row['largest_error']):.0e}")
        assert re.search(rf"{setting}\s+{told}\s+{error}", made.out)
        if row["gradient_microseconds"]:
            seconds = 1e-6 * float(row["gradient_microseconds"]) * int(row["batch"])
            assert 1 <= seconds < 100
            ratio = float(row["gradient_microseconds"]) / float(row["microseconds"])
            head = f"{row['family']}, {row['setting']}, batch {int(row['batch']):,}: value and gradient"
            assert f"{head} (3 parameters) {ratio:.2g} times the value" in made.out
            assert float(row["gradient_error"]) < 1e-4
    exact = {"energy balance", "closed form"}
    for row in rows:
        error = float(row["largest_error"])
        if row["family"] in exact:
            assert error < 1e-13
        else:
            assert 1e-14 < error < 0.2
    ours = [r for r in rows if r["family"] == "ODE" and r["batch"] == "4096"]
    seen = 0
    for error in (1e-3, 1e-6):
        good = [float(r["microseconds"]) for r in ours if float(r["largest_error"]) <= error]
        for rival in dict.fromkeys(r["family"] for r in rows):
            theirs = power_law(rows, rival, error)
            told = f"ODE at error {error:.0e}: "
            if rival not in exact | {"ODE"} and good and theirs is not None:
                assert (
                    f"{told}{theirs / min(good):.3g} times faster than {rival}\n" in made.out + "\n"
                )
                seen += 1
            else:
                assert not re.search(re.escape(told) + rf".* {re.escape(rival)}$", made.out, re.M)
    assert seen or law
    assert made.out.count("times faster than") == seen
    (ax,) = made.figures["speed.png"].axes
    assert ax.get_xlabel() == "largest error of the plastic coefficient of restitution [-]"
    assert ax.get_ylabel() == "time a collision [µs]"
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    for family in dict.fromkeys(r["family"] for r in rows):
        own = [r for r in rows if r["family"] == family]
        points = [(max(float(r["largest_error"]), 1e-17), float(r["microseconds"])) for r in own]
        np.testing.assert_allclose(np.transpose(line(ax, family)), points)


def test_coverage_compares_errors_with_the_spread_of_estimates():
    """Fisher's errors by hand, scatter of the estimates, and their ratio that way round."""
    v = np.linspace(1.0, 12.0, 12)
    case = cal.CoverageCase("decay", Decay(0.9, 0.05), v, noise=0.01, stated=True)
    (found,) = cal.coverage_study([case], 100, 3)
    curve = 0.9 * np.exp(-0.05 * v)
    slopes = np.stack([curve, -0.05 * v * curve], axis=1) / 0.01
    expected = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    for name, error in zip(("level", "rate"), expected, strict=True):
        assert found.error[name] == pytest.approx(error, rel=0.05)
        spread = np.std(found.estimates[name])
        assert found.spread[name] == pytest.approx(spread)
        rms = np.sqrt(np.mean(found.errors[name] ** 2))
        assert found.ratio[name] == pytest.approx(rms / spread, rel=1e-9)
        assert abs(found.ratio[name] - 1) > 0.01  # or its inverse would do
        inside = np.mean(
            np.abs(found.estimates[name] - np.log({"level": 0.9, "rate": 0.05}[name]))
            <= 1.96 * found.errors[name]
        )
        assert found.by_error[name] == pytest.approx(inside, abs=0.011)
        assert found.covered[name] == pytest.approx(inside, abs=0.03)
    assert found.converged == 1


class Kinked(sj.HardSphereLaw):
    """ε = 0.8 - 0.05 |ln k|: data above 0.8 have their best fit at the kink, where no slope is zero."""

    k: float = sj.number_field("k", "-", "a number", within="(0, inf)")

    def restitution_squared(self, velocity):
        return (0.8 - 0.05 * jnp.abs(jnp.log(self.k)) + 0 * velocity) ** 2


def test_refits_that_did_not_converge_are_left_out_of_percentiles():
    v = np.linspace(1.0, 9.0, 8)
    noise = 0.01 * np.random.default_rng(2).standard_normal(8)
    data = cal.RestitutionData(v, 0.794 + noise - np.mean(noise), None, 0.01, name="kinked")
    fit = cal.fit(data, Kinked, {"k": cal.Parameter(1.2)}, profiles=False, starts=1)
    found = fit.bootstrap(60, seed=1)
    assert 0 < np.sum(found.converged) < 60
    kept = found.values[found.converged]
    for name, column in zip(found.names, kept.T, strict=True):
        assert found.intervals[name] == pytest.approx(tuple(np.percentile(column, [2.5, 97.5])))
    every = np.percentile(found.values, [2.5, 97.5], axis=0)
    assert not np.allclose(np.ravel(every), np.ravel(list(found.intervals.values())))


def test_equal_pictures_are_equal_files(tmp_path):
    """Nothing in them says when; and no picture needs pyplot."""
    grid = ("--from", "2", "--to", "9", "--points", "9", "--format", "png", "--quiet")
    for name in ("one", "two"):
        assert run("curve", "nylon", *grid, "--out", tmp_path / name)[0] == 0
    one, two = ((tmp_path / name / "curve.png").read_bytes() for name in ("one", "two"))
    assert one == two
    assert one.startswith(b"\x89PNG")
