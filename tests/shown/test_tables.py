"""Other tables and pictures: curves, speed, coverage, refits."""

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
from tests.shown.capture import band, labels, line
from tests.shown.conftest import shown
from tests.shown.test_fit import EPSILON, SPEED, best, curve


def test_the_picture_of_a_fits_curve(tmp_path, alloy):
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
    made = shown(tmp_path, "curve", "nylon", "--from", "0.1", "--to", "400", "--points", "16")
    (ax,) = made.figures["curve.png"].axes
    v, e = line(ax, "nylon")
    law = fitted("nylon")
    hit = sj.restitution(law, v)
    rebounds = np.asarray(hit.coefficient) > 0
    np.testing.assert_array_equal(np.isfinite(e), rebounds)
    assert 0 < rebounds.sum() < 16
    np.testing.assert_allclose(e[rebounds], np.asarray(hit.coefficient)[rebounds])
    assert line(ax, "first yield")[0][0] == pytest.approx(float(law.contact.critical_velocity))
    assert {x.get_marker() for x in ax.get_lines() if x.get_label() == "nylon"} == {"o"}


def test_what_a_fit_does_not_determine_is_grey(tmp_path, above_yield):
    few = ("--from", "0.1", "--to", "20", "--points", "30")
    made = shown(tmp_path, "curve", "--fit", above_yield[1], *few)
    (ax,) = made.figures["curve.png"].axes
    (grey,) = ax.patches
    grid = np.geomspace(0.1, 20, 30)
    first = grid[grid >= float(fitted("nylon").contact.critical_velocity)][0]
    assert (grey.get_x(), grey.get_x() + grey.get_width()) == pytest.approx((0.1, first))
    assert grey.get_label() == "not determined"
    np.testing.assert_array_equal(np.isfinite(line(ax, r"my\nnylon")[1]), grid >= first)


def test_speed_is_microseconds_a_collision(monkeypatch, tmp_path):
    """By a clock of a second or more a call; errors against exact answers; the table and picture of these rows."""
    counted = itertools.count(1)
    monkeypatch.setattr(time, "perf_counter", lambda: (lambda k: k + 1e-4 * k * k)(next(counted)))
    made = shown(tmp_path, "speed", "--quick")
    assert made.code == 0
    assert made.out.endswith(f"\n\nWritten to {made.folder}: speed.csv, speed.png\n")
    rows, families, large = list(csv.DictReader(made.text("speed.csv").splitlines())), {}, []
    ours = {r["setting"] for r in rows if (r["family"], r["batch"]) == ("ODE", "4096")}
    assert ours == {"dopri5, 2 steps"}
    for row in rows:
        batch, each, error = (float(row[n]) for n in ("batch", "microseconds", "largest_error"))
        for name in ("microseconds", "gradient_microseconds"):
            assert not row[name] or 1 <= 1e-6 * float(row[name]) * batch < 100
        cells = [row["family"], row["setting"], f"{batch:,.0f}", f"{each:.3g}", f"{error:.0e}"]
        assert re.search(r"\s+".join(map(re.escape, cells)), made.out)
        assert error < 1e-13 if row["family"] == "energy balance" else 1e-14 < error < 0.2
        families.setdefault(row["family"], []).append((max(error, 1e-17), each))
        large += [each] * (batch > 4096)
    (ax,) = made.figures["speed.png"].axes
    assert ax.get_xlabel() == r"largest error of $\varepsilon_p$ [-]"
    assert ax.get_ylabel() == "time per collision [µs]"
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    for family, points in families.items():
        np.testing.assert_allclose(np.transpose(line(ax, family)), points)
    (few,) = {r["batch"] for r in rows if r["family"] == "SciPy loop"}
    title = f"4,096 impacts at once (SciPy loop: {few}) where no number is given"
    assert ax.get_legend().get_title().get_text() == title
    notes = {text.get_text(): text.xy[1] for text in ax.texts if text.get_text()}
    assert sorted(notes.values()) == sorted(large)
    assert all(text.startswith("1,000,000 impacts") for text in notes)
    assert sum("no overlaps" in text for text in notes) == 1


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
