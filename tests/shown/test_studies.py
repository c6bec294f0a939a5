"""`softjax sensitivity`, `curve` and `speed`: the data of their pictures and the cells of their tables; refits."""

import csv
import itertools
import json
import math
import re
import time

import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import RADIUS, fitted
from tests.command import BODIES, run
from tests.shown.capture import as_recorded, band, labels, legend, line
from tests.shown.conftest import shown
from tests.shown.tables import cells
from tests.shown.test_fit import best, curve

EFFECT = r"$\theta\,\partial\varepsilon/\partial\theta$"
LETTERS = {
    "youngs_modulus": "$E$",
    "poisson_ratio": r"$\nu$",
    "density": r"$\rho$",
    "yield_strength": "$Y$",
    "radius": "$R$",
    "chi": r"$\tilde\chi$",
    "sigma": r"$\sigma$",
    "psi": r"$\psi$",
    "velocity": "$v$",
}


def restitution(v, **changed):
    nylon = sj.NYLON
    of = {n: float(getattr(nylon, n)) * changed.get(n, 1.0) for n in list(LETTERS)[:4]}
    body, radius = sj.Material(**of), RADIUS * changed.get("radius", 1.0)
    contact = sj.Contact.between_spheres(body, body, radius, radius, area="zhou")
    law = fitted("nylon")
    values = {n: getattr(law, n) * changed.get(n, 1.0) for n in ("chi", "sigma", "psi")}
    at = np.asarray(v) * changed.get("velocity", 1.0)
    return np.asarray(sj.restitution(sj.Zhou(contact, **values), at).coefficient)


def effect(name, v, h=1e-5):
    """θ ∂ε/∂θ by differences."""
    return (restitution(v, **{name: 1 + h}) - restitution(v, **{name: 1 - h})) / (2 * h)


def test_sensitivities_over_velocity(studied):
    """Curves, table, JSON and CSV by differences; inputs that act on nothing are named; parted at yield."""
    (ax,) = studied.figures["sensitivity.png"].axes
    as_recorded("sensitivity", studied.everything)
    yields = float(fitted("nylon").contact.critical_velocity)
    assert line(ax, r"yield, $v_\mathrm{cr}$")[0].tolist() == [yields, yields]
    rows = list(csv.DictReader(studied.text("sensitivity.csv").splitlines()))
    velocity = np.array([float(row["velocity [m/s]"]) for row in rows])
    np.testing.assert_allclose(velocity, np.geomspace(0.1, 60, 9))
    curve = restitution(velocity)
    np.testing.assert_allclose([float(row["restitution"]) for row in rows], curve, atol=1e-9)
    head = "θ ∂ε/∂θ at v [m/s]"
    lines = studied.out[studied.out.index(head) :].splitlines()
    assert cells(lines[0]) == [head, "1", "10"]
    table = {row[0]: [float(x) for x in row[1:]] for row in map(cells, lines[2:11])}
    study = json.loads(studied.text("sensitivity.json"))["local"]
    assert study["velocity"] == [1.0, 10.0]
    symbols = ("E", "ν", "ρ", "Y", "R", "χ̃", "σ", "ψ", "v")
    for (name, letter), symbol in zip(LETTERS.items(), symbols, strict=True):
        slope = effect(name, velocity)
        in_csv = [float(row[f"{name} d(eps)/d({name})"]) for row in rows]
        np.testing.assert_allclose(in_csv, slope, atol=1e-7)
        in_csv = [float(row[f"dln(eps)/dln({name})"]) for row in rows]
        np.testing.assert_allclose(in_csv, slope / curve, atol=1e-7)
        at_bars = effect(name, [1.0, 10.0])
        assert table[symbol] == pytest.approx(at_bars, abs=6e-6)
        np.testing.assert_allclose(study["theta_d_epsilon_d_theta"][name], at_bars, atol=1e-7)
        if letter == "$R$":
            continue
        x, y = line(ax, letter)
        gap = np.isnan(y)
        np.testing.assert_array_equal(x[gap], [yields])
        np.testing.assert_array_equal(x[~gap], velocity)
        np.testing.assert_allclose(y[~gap], slope, atol=1e-7)


def test_an_effect_too_small_to_see_is_named_in_the_legend(tmp_path):
    """A rubber ball's compliance is 7e4 times the steel wall's, whose line would lie on zero."""
    body = 'poisson_ratio = {}\ndensity = {}\nyield_strength = "10 MPa"\nyoungs_modulus = "{}"\n'
    ball, wall = body.format(0.49, 1100, "3 MPa"), body.format(0.3, 7850, "210 GPa")
    text = f'[[material]]\nname = "rubber"\nradius = 0.01\n{ball}[material.wall]\n{wall}'
    (tmp_path / "rubber.toml").write_text(text, encoding="utf-8")
    law = ("--law", "viscoelastic", "--set", "dissipation_time=1e-4")
    where = ("--from", "1", "--to", "9", "--points", "5", "--at", "2")
    made = shown(tmp_path, "sensitivity", tmp_path / "rubber.toml", *law, *where)
    as_recorded("too small", made.everything)
    numbers = made.figures["tornado.png"].axes[0].texts  # of the lowest bars, too short to see
    places = [number.get_position() for number in numbers]
    assert places == [(0, row) for row in range(len(places))] != []
    names = legend(made.figures["sensitivity.png"].axes[0])
    (below,) = [name for name in names if name.startswith("below")]
    assert "wall" in below
    rows = list(csv.DictReader(made.text("sensitivity.csv").splitlines()))
    slopes = {n: max(abs(float(r[n])) for r in rows) for n in rows[0] if " d(eps)/d(" in n}
    of = lambda name: slopes[f"{name} d(eps)/d({name})"]  # noqa: E731
    assert of("youngs_modulus") > 1e4 * of("wall.youngs_modulus") > 0
    limit = 2e-3 * max(slopes.values())
    assert below.startswith(f"below {limit:.0e}: ")
    assert below.count(",") + 1 == sum(1e-12 <= size < limit for size in slopes.values()) > 0


def test_a_tornado_shows_what_one_percent_does(studied):
    for ax, v in zip(studied.figures["tornado.png"].axes, (1.0, 10.0), strict=True):
        largest = max(abs(bar.get_width()) for bar in ax.patches)
        power = math.floor(math.log10(largest))
        assert ax.get_xlabel() == rf"change of $\varepsilon$ for +1 % [$10^{{{power}}}$]"
        assert ax.xaxis.get_major_formatter()(largest) == f"{largest / 10**power:.6g}"
        letters = (label.get_text() for label in ax.get_yticklabels())
        width = {a: bar.get_width() for a, bar in zip(letters, ax.patches, strict=True)}
        for name, letter in LETTERS.items():
            assert width[letter] == pytest.approx(float(effect(name, [v])[0]) / 100, abs=1e-8)
            change = float(restitution([v], **{name: 1.01})[0] - restitution([v])[0])
            assert width[letter] == pytest.approx(change, rel=0.05, abs=1e-6)
        assert np.all(np.diff(np.abs(list(width.values()))) >= -1e-15)


def test_a_design_shows_where_the_shots_are(studied):
    (ax,) = studied.figures["design.png"].axes
    design = json.loads(studied.text("sensitivity.json"))["design"]
    expected = cal.optimal_velocities(fitted("nylon"), 6, (0.1, 60.0), seed=2)
    at, counts = zip(*expected.support, strict=True)
    found = [(p["velocity"], p["shots"]) for p in design["support"]]
    np.testing.assert_allclose(found, expected.support, rtol=1e-6)
    np.testing.assert_allclose(line(ax, "shots")[0], at, rtol=1e-6)
    assert [text.get_text() for text in ax.texts] == [str(n) for n in counts]
    assert sum(counts) == 6
    np.testing.assert_allclose(line(ax, "equally spaced")[0], np.linspace(0.1, 60, 6))
    for name in ("chi", "sigma", "psi"):
        v, slope = line(ax, rf"{EFFECT}, $\theta$ = {LETTERS[name]}")
        some = np.linspace(1, len(v) - 1, 7).astype(int)
        np.testing.assert_allclose(slope[some], effect(name, v[some]), atol=1e-6)
    header, *rows = studied.text("design.csv").splitlines()
    assert header == "velocity [m/s],shots,drop height without air [m]"
    for row, (v, n) in zip(rows, expected.support, strict=True):
        speed, shots, drop = row.split(",")
        assert (float(speed), int(shots)) == (pytest.approx(v, rel=1e-5), n)
        assert drop == f"{v**2 / (2 * 9.80665):.4g}"


def test_a_wall_and_another_law(tmp_path):
    """Letters of either body; nothing is parted where no yield lies inside."""
    (tmp_path / "a.toml").write_text(f'{BODIES}[material.wall]\nmaterial = "nylon"\n', "utf-8")
    law = ("--law", "viscoelastic", "--set", "dissipation_time=1e-5")
    few = ("--points", "5", "--from", "5", "--to", "60", "--at", "30")
    made = shown(tmp_path, "sensitivity", tmp_path / "a.toml", *law, *few)
    assert made.code == 0
    (ax,) = made.figures["sensitivity.png"].axes
    as_recorded("a wall", made.everything)
    assert not np.any(np.isnan(line(ax, "$A$")[1]))
    # ε depends on w² ∝ A v^{1/5}: five times as much by A as by v
    np.testing.assert_allclose(line(ax, "$A$")[1], 5 * line(ax, "$v$")[1], rtol=1e-6)


def test_the_information_of_planned_shots(studied):
    """Errors and parameters of sensitivity.json are those of Python; the text has them."""
    found = json.loads(studied.text("sensitivity.json"))["information"]
    expected = cal.fisher_information(fitted("nylon"), np.linspace(0.1, 60, 6))
    assert found["parameters"] == {"chi": 0.21998, "sigma": 0.4355, "psi": 0.5414}
    np.testing.assert_allclose(found["information"], expected.matrix, rtol=1e-9)
    errors = dict(zip(["χ̃", "σ", "ψ"], expected.standard_errors.values(), strict=True))
    for symbol, error in errors.items():
        assert f"expected standard error of {symbol}: {error:.3g} (" in studied.out


def test_the_picture_of_a_fits_curve(tmp_path, alloy):
    few = ("--points", "40", "--from", "0.1", "--to", "50")
    made = shown(tmp_path, "curve", "--fit", alloy.folder / "fit.json", *few)
    as_recorded("curve of a fit", made.everything)
    (ax,) = made.figures["curve.png"].axes
    assert ax.get_xlabel() == "impact velocity $v$ [m/s]"
    assert (ax.get_ylabel(), ax.get_xscale()) == (r"restitution $\varepsilon$", "log")
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
    as_recorded("gaps", made.everything)
    assert {x.get_marker() for x in ax.get_lines() if x.get_label() == "nylon"} == {"o"}


def test_what_a_fit_does_not_determine_is_grey(tmp_path, above_yield):
    few = ("--from", "0.1", "--to", "20", "--points", "30")
    made = shown(tmp_path, "curve", "--fit", above_yield[1], *few)
    (ax,) = made.figures["curve.png"].axes
    (grey,) = ax.patches
    grid = np.geomspace(0.1, 20, 30)
    first = grid[grid >= float(fitted("nylon").contact.critical_velocity)][0]
    assert (grey.get_x(), grey.get_x() + grey.get_width()) == pytest.approx((0.1, first))
    as_recorded("grey", made.everything)
    assert grey.get_label() == "not determined"
    np.testing.assert_array_equal(np.isfinite(line(ax, r"my\nnylon")[1]), grid >= first)


def test_speed_is_microseconds_a_collision(monkeypatch, tmp_path):
    """By a clock of nearly a second a call; errors against exact answers; the table and picture of these rows."""
    counted = itertools.count(1)
    monkeypatch.setattr(time, "perf_counter", lambda: (lambda k: k - 1e-4 * k * k)(next(counted)))
    made = shown(tmp_path, "speed", "--quick")
    assert made.code == 0
    assert made.out.endswith(f"\n\nWritten to {made.folder}: speed.csv, speed.png\n")
    rows, families, large = list(csv.DictReader(made.text("speed.csv").splitlines())), {}, []
    ours = {r["setting"] for r in rows if (r["family"], r["batch"]) == ("ODE", "4096")}
    assert ours == {"dopri5, 2 steps"}
    for row in rows:
        batch, each, error = (float(row[n]) for n in ("batch", "microseconds", "largest_error"))
        assert 0 < float(row["compile_seconds"]) < 0.01
        cells = [row["family"], row["setting"], f"{batch:,.0f}", f"{each:.3g}", f"{error:.0e}"]
        assert 0.9 < 1e-6 * each * batch < 1
        assert bool(row["gradient_error"]) == (row["setting"] == "exact")
        if row["gradient_error"]:
            slopes, off = float(row["gradient_microseconds"]), float(row["gradient_error"])
            assert 0.9 < 1e-6 * slopes * batch < 1
            assert off < 1e-13
            cells += ["0.0", f"{slopes:.3g}", f"{off:.0e}"]
        assert re.search(r"\s+".join(map(re.escape, cells)), made.out)
        assert error < 1e-13 if row["family"] == "energy balance" else 1e-7 < error < 1e-5
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
