"""`softjax curve` from the command line to its files."""

import io
import re
import sys

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import FITTED, fitted, pair
from tests.command import BODIES, run

CONSTANT = ["nylon", "--law", "constant", "--set", "restitution=0.75"]


def curve(*options, error=None) -> str:
    """What the command prints; with `error` what it must say in one line while it refuses."""
    code, out, err = run("curve", *options)
    if error is None:
        assert (code, err) == (0, ""), err
        return out
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert all(part in err for part in error.split("|")), err
    return err


def rows_of(path) -> list[list[str]]:
    return [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]


def column(folder, position: int) -> np.ndarray:
    rows = rows_of(folder / "results" / "curve.csv")[1:]
    return np.array([float(row[position] or "nan") for row in rows])


def table(folder):
    path = folder / "results" / "curve.txt"
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("#")], np.loadtxt(path, ndmin=2)


def agrees(folder, law, rtol=1e-13):
    expected = np.asarray(sj.restitution(law, column(folder, 0)).coefficient)
    np.testing.assert_allclose(column(folder, 1), expected, rtol=rtol)


@pytest.mark.parametrize(
    ("spacing", "ends", "expected"),
    [
        ("log", (0.5, 20), np.geomspace(0.5, 20, 30)),
        ("lin", (0.5, 20), np.linspace(0.5, 20, 30)),
        (None, (0.5, 20), np.geomspace(0.5, 20, 30)),
        (None, (0, 20), np.linspace(0, 20, 30)),
        ("log", (1e-300, 1e10), 10 ** np.linspace(-300, 10, 30)),
    ],
)
def test_a_grid_is_spaced_as_stated_and_has_both_ends(spacing, ends, expected, at):
    words = [] if spacing is None else ["--spacing", spacing]
    grid = ["--from", ends[0], "--to", ends[1], "--points", 30, *words]
    curve(*CONSTANT, *grid, "--format", "csv")
    velocity = column(at, 0)
    np.testing.assert_allclose(velocity, expected, rtol=1e-12)
    assert (velocity[0], velocity[-1]) == ends


def test_every_format_has_the_same_float64_and_statuses_are_written_by_name(at):
    """Nylon with the printed χ̃ gains energy and keeps no overlap; below yield it is elastic."""
    words = ["nylon", "--from", 0.5, "--to", 20, "--points", 12, "--spacing", "log"]
    for name in (*FITTED, "nylon"):
        said = curve(name.replace(" ", "-"), *words[1:], "--format", "csv", "png")
        assert f"χ̃ = {FITTED[name]['chi']:g} as softjax fit finds it\n12 velocities" in said
    out = at / "results"
    assert rows_of(out / "curve.csv")[0] == ["velocity [m/s]", "restitution", "status"]
    agrees(at, fitted("nylon"), rtol=1e-14)
    words = ["--from", 0.5, "--to", 3, "--points", 2, "--format", "csv", "png"]
    curve("--set", "chi=0.016", "nylon", *words)  # a word without "=" is the material
    (*_, first), (*_, last) = rows_of(at / "results" / "curve.csv")[1:]
    assert (first, last) == ("ELASTIC", "NO_RESIDUAL_OVERLAP|ENERGY_GAIN")


def zhou(area="zhou", **changed):
    return sj.Zhou(pair("nylon", area=area), **(FITTED["nylon"] | changed))


AT_YIELD = pair("nylon").limit_velocity / pair("nylon").critical_velocity - 1  # of Eq. (17)
LAWS = {
    "--eps-up 0.9": zhou(sigma=-np.log(0.9) * AT_YIELD**0.5414),
    "--set chi=0.3": zhou(chi=0.3),
    "--set sigma=0.1 --set psi=0.9": zhou(sigma=0.1, psi=0.9),
    "--set kappa=printed": zhou(kappa="printed", chi=0.016),
    "--set kappa=printed chi=0.21998": zhou(kappa="printed"),
    "--area hertz --set form=full chi=0.3": zhou("hertz", chi=0.3, form="full"),
    "--law constant --set restitution=0.75": sj.ConstantRestitution(None, 0.75),
    "--law hertz": sj.Hertz(pair("nylon")),
    "--law thornton --set yield_factor=2.5 --set area=contact": sj.Thornton(
        pair("nylon"), 2.5, "contact"
    ),
    "--law walton-braun --set loading_stiffness=1e6 unloading-stiffness=2e6 growth=3": (
        sj.WaltonBraun(pair("nylon"), 1e6, 2e6, 3.0)
    ),
    "--law eq-17 --set sigma=0.3 psi=0.5414": sj.EmpiricalRestitution(
        pair("nylon").limit_velocity, 0.3, 0.5414
    ),
}


@pytest.mark.parametrize("options", LAWS)
def test_each_option_of_a_law_acts(at, options):
    grid = ["--from", "3", "--to", "10", "--points", "4", "--format", "csv"]
    said = curve("nylon", *options.split(), *grid)
    assert "χ̃" not in said or f"χ̃ = {LAWS[options].chi:g}" in said
    agrees(at, LAWS[options])
    plain = sj.restitution(fitted("nylon"), column(at, 0)).coefficient
    assert np.max(np.abs(column(at, 1) - plain)) > 1e-5


def test_viscoelastic_spheres_by_one_restitution_at_one_velocity(at):
    """ε of w²(v) = w² (v/1)^{1/5} by SciPy's integration is 0.8 at 1 m/s: Schwager and Poeschel's contact."""
    words = ["nylon", "--law", "viscoelastic", "--restitution", "0.8"]
    curve(*words, "--at", "1", "--from", "1", "--to", "8", "--points", "2", "--spacing", "lin")
    assert column(at, 1)[0] == pytest.approx(0.8, abs=1e-12)
    law = sj.ViscoelasticHertz.from_restitution(pair("nylon"), 0.8, 1.0)
    agrees(at, law)
    curve(*words, error="--restitution|--at V")
    words[2] = "hertz"
    curve(*words, "--at", "1", error="--restitution|left out with|viscoelastic")


def test_a_file_may_fix_the_restitution_at_first_yield(at):
    text = f"{BODIES}[material.parameters]\nchi = 2.0\neps_up = 0.9\n"
    (at / "a.toml").write_text(text, encoding="utf-8")
    grid = ["--points", 3, "--format", "csv"]
    curve("a.toml", *grid, error="`--law` must be given with --set psi=… (0.5, say")
    curve("a.toml", "--set", "psi=0.5", *grid, "--to", 1)
    whole = column(at, 1)
    curve("a.toml", "--set", "psi=0.5", "--eps-up", 0.9, *grid, "--to", 1)
    np.testing.assert_array_equal(column(at, 1), whole)
    curve("a.toml", "--set", "psi=0.5", "sigma=1", "--eps-up", 0.9, error="left out with sigma")
    curve("a.toml", "--set", "psi=0.5", "--eps-up", 1, error="between 0 and 1, but is 1")


def test_the_route_acts_in_curves_and_tables(at):
    law = ["--law", "linear", "--set", "stiffness=1e6", "--set", "restitution=0.6"]  # soon compiled
    grid = ["nylon", *law, "--from", 30, "--to", 60, "--points", 2, "--spacing", "lin"]
    exact = sj.restitution(sj.LinearSpringDashpot(ALLOY, 1e6, 0.6), np.array([30.0, 60.0]))
    coarse = ["--route", "ode", "--rtol", "1e-3"]
    for words, low, high in (([], 0, 1e-13), (coarse, 1e-12, 1e-2)):
        curve(*grid, "--format", "csv", "table", *words)
        rows = table(at)[1]
        ratios = rows[:, 1] / exact.coefficient, rows[:, 3] / exact.duration
        for ratio in (column(at, 1) / exact.coefficient, *ratios):
            assert low <= np.max(np.abs(ratio - 1)) <= high, words


VELOCITY_FILES = {
    "a column with comments and blank lines": "0.5\n# a comment\n\n1.5\n2.5\n",
    "a header with a unit": "restitution,velocity [cm/s]\n0.9,50\n0.8,150\n0.7,250\n",
    "a byte-order mark and Windows' line ends": "\ufeffvelocity [mm/s]\r\n500\r\n1500\r\n2500\r\n",
    "tabs and empty cells": "restitution\tvelocity\n\t0.5\n\t1.5\n0.7\t2.5\n",
}


@pytest.mark.parametrize("name", VELOCITY_FILES)
def test_velocities_are_read_from_files_and_standard_input(name, at, monkeypatch):
    text = VELOCITY_FILES[name].encode()
    (at / "v.csv").write_bytes(text)
    stream = io.TextIOWrapper(io.BytesIO(text))
    monkeypatch.setattr(sys, "stdin", stream)
    for source in ("v.csv", "-"):
        curve(*CONSTANT, "--velocities", source, "--format", "csv", "--out", "results")
        np.testing.assert_array_equal(column(at, 0), [0.5, 1.5, 2.5])
    assert not stream.closed


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("0.5\nfast\n", 2, "'fast'|finite number"),
        ("0.5\n\n-1\n", 3, "-1|0 m/s or more"),
        ("restitution,velocity\n0.5,1\n0.5,\n", 3, "velocity is nan|0 m/s or more"),
        ("0.5\n1,5\n", 2, "cells: 2|: 1"),
        ("colour\n1\n", 1, "velocity|header"),
        ("velocity [kg]\n1\n", 1, "[kg]|m/s"),
        ("velocity\n", 1, "no rows"),
        ("", 1, "nothing in the file"),
        ("\n".join(["velocity", *["1.5"] * 70_000, "slow"]), 70_002, "'slow'"),
    ],
)
def test_what_is_no_velocity_is_refused_with_its_line(text, line, words, at):
    (at / "v.csv").write_text(text, encoding="utf-8")
    found = curve("nylon", "--velocities", "v.csv", "--format", "csv", error="v.csv|" + words)
    assert re.match(r"v\.csv(:\d+)?: ", found)[1] == (line and f":{line}")
    assert [path.name for path in at.iterdir()] == ["v.csv"]


def test_a_table_has_two_rows_where_restitution_jumps(at):
    """At first yield ε² rises by 2d/3: below it is Eq. (17)'s, above ε_p² is 1 + 2d/3."""
    law, critical = fitted("nylon"), float(pair("nylon").critical_velocity)
    grid = ["--points", 11, "--spacing", "lin"]  # of tables below: they share what is compiled
    curve("nylon", "--from", 0.5, "--to", 2, *grid, "--table")
    assert [path.name for path in (at / "results").iterdir()] == ["curve.txt"]
    _, found = table(at)
    at_yield = np.abs(found[:, 0] / critical - 1) < 1e-9
    np.testing.assert_allclose(found[~at_yield, 0], np.linspace(0.5, 2, 11), rtol=1e-14)
    below, above = found[at_yield]
    assert below[0] < critical < above[0]
    y = critical / (float(law.contact.limit_velocity) - critical)
    eps_up = np.exp(-0.4355 * y**0.5414)
    d = 1.5 * float(law.contact.critical_overlap) / (np.pi ** (2 / 3) * float(law.contact.radius))
    assert below[1] == pytest.approx(eps_up, rel=1e-9)
    assert above[1] ** 2 - below[1] ** 2 == pytest.approx(2 * d / 3, rel=1e-4)
    assert above[2] ** 2 == pytest.approx(1 + 2 * d / 3, rel=1e-9)


def test_a_table_has_durations_overlaps_and_forces_where_there_is_a_force(at):
    """Elastic impacts by Hertz's formulas; the duration's factor is published."""
    contact = pair("nylon")
    critical, depth = float(contact.critical_velocity), float(contact.critical_overlap)
    low, high = 0.25 * critical, 0.5 * critical
    curve("nylon", "--from", low, "--to", high, "--points", 2, "--table")
    header, found = table(at)
    assert header[-1].split()[1:3] == ["velocity[m/s]", "restitution"]
    stiffness = 4 / 3 * float(contact.youngs_modulus) * float(contact.radius) ** 0.5
    for velocity, _, plastic, duration, overlap, force in found:
        deepest = (1.25 * float(contact.mass) * velocity**2 / stiffness) ** 0.4
        assert plastic == 1
        assert overlap == pytest.approx(deepest, rel=1e-12)
        assert duration == pytest.approx(2.9432751843 * deepest / velocity, rel=1e-9)
        assert force == pytest.approx(stiffness * deepest**1.5, rel=1e-12)
    assert found[1, 4] == pytest.approx(0.5**0.8 * depth, rel=1e-12)
    words = ["--from", 1, "--to", 2, "--points", 2, "--spacing", "lin", "--table"]
    assert "\n2 velocities, 1 to 2 m/s\n" in curve(*CONSTANT, *words)
    header, found = table(at)
    assert header[-1] == "# velocity[m/s] restitution"
    np.testing.assert_array_equal(found, [[1.0, 0.75], [2.0, 0.75]])
    for text in ("1\n1\n", "2\n1\n", "1\n2\n2\n3\n"):
        (at / "v.csv").write_text(text, encoding="utf-8")
        curve(*CONSTANT, "--velocities", "v.csv", "--table", error="ascend")
    assert "1 velocity, 2 to 2 m/s" in curve(
        *CONSTANT, "--from", 2, "--to", 2, "--points", 1, "--out", "one"
    )


def test_a_fit_gives_its_band_and_says_where_its_data_end(at, above_yield):
    result, path = above_yield
    inside = ["--from", "1.5", "--to", "60", "--points", "12", "--format", "csv", "png"]
    code, out, error = run("curve", "--fit", path, *inside)
    assert code == 0
    codes = [line.split(": ")[1] for line in error.splitlines()]
    assert codes == [warning.code for warning in result.warnings]
    assert "warning: eps-up-only: no points below the critical velocity" in error
    said = " ".join(out.split())
    assert said.startswith(rf"my\nnylon: {path} 12 velocities, 1.5 to 60 m/s ")
    header = "velocity [m/s],restitution,restitution_low,restitution_high,status"
    assert rows_of(at / "results" / "curve.csv")[0] == header.split(",")
    velocity, value, low, high = (column(at, i) for i in range(4))
    band = result.band(velocity)
    expected = [band.coefficient, band.low, band.high]
    np.testing.assert_allclose([value, low, high], expected, rtol=1e-12)
    agrees(at, result.law, rtol=1e-12)
    beyond = ["--from", 1, "--to", 200, "--points", 12, "--quiet"]
    code, out, error = run("curve", "--fit", path, *beyond)
    assert (code, out) == (0, "")
    (line,) = [line for line in error.splitlines() if "extrapolation" in line]
    assert "from 1 to 200 m/s" in line


def test_a_table_says_where_the_data_end(at, quick):
    """All of 0.2 to 30 m/s, to four digits."""
    assert run("fit", quick, "--out", "fitted", "--quiet")[0] == 0
    for ends, said in (
        (("0.19998", "30.001"), "all rows lie within the velocities of the fit's data"),
        (
            ("0.2", "200"),
            "# extrapolation: the curve goes from 0.2 to 200 m/s, the data of my alloy from 0.2 to 30 m/s",
        ),
    ):
        grid = ("--from", ends[0], "--to", ends[1], "--points", 12, "--table")
        code, _, error = run("curve", "--fit", "fitted/fit.json", *grid)
        assert (code, "extrapolation" in error) == (0, "extrapolation" in said)
        assert said in " ".join(table(at)[0])


def test_curve_band_and_table_agree_on_what_the_data_do_not_determine(at, above_yield):
    result, path = above_yield
    grid = ["--from", "0.2", "--to", "20", "--points", "12"]
    code, _, error = run("curve", "--fit", path, *grid, "--format", "csv", "table", "png")
    assert code == 0
    assert "not-determined: of 14 velocities" in error
    out, velocity = at / "results", column(at, 0)
    known = velocity >= float(result.law.contact.critical_velocity)
    assert 0 < np.sum(known) < 14
    np.testing.assert_array_equal(np.isfinite(column(at, 1)), known)
    np.testing.assert_array_equal(np.isfinite(result.band(velocity).low), known)
    written = rows_of(out / "curve.csv")[1:]
    np.testing.assert_array_equal([row[-1] == "NOT_DETERMINED" for row in written], ~known)
    assert {tuple(row[1:4]) for row, k in zip(written, known, strict=True) if not k} == {("",) * 3}
    np.testing.assert_array_equal(table(at)[1][:, 0], velocity[known])
    critical, header = float(result.law.contact.critical_velocity), " ".join(table(at)[0])
    assert f"restitution below {critical:.6g} m/s: no rows" in header
    beyond = ["--from", "1.5", "--to", "200", "--points", "12", "--table"]
    assert run("curve", "--fit", path, *beyond)[0] == 0
    header = table(at)[0]  # in which a name of two lines ends no comment
    assert any(r"the data of my\nnylon from 1.5 to 60 m/s" in line for line in header)


def test_limits_are_empty_where_one_velocity_determines_nothing_and_a_line_says_so(at):
    """Eight impacts at 3 m/s, by which any χ̃ is as good; all were limited to ± 0.004 at 1 m/s."""
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.01, 0.01)
    restitution = 0.94 + 0.01 * np.array([-1, 1, 0, 0, 1, -1, 0, 0])
    data = cal.RestitutionData([3.0] * 8, restitution, pair, uncertainty=0.01)
    cal.fit(data, starts=4).save(at / "fit.json")
    (at / "v.csv").write_text("1\n3\n9\n", encoding="utf-8")
    for velocities, empty in (("v.csv", "2 of 3"), (None, "4 of 4")):
        grid = (
            ["--velocities", velocities] if velocities else ["--from", 1, "--to", 9, "--points", 4]
        )
        code, _, error = run("curve", "--fit", "fit.json", *grid, "--format", "csv", "png")
        assert code == 0
        assert f"warning: rank-deficient: the interval of ε is left empty at {empty} vel" in error
        assert np.all(np.isfinite(column(at, 1)))
        np.testing.assert_array_equal(np.isfinite(column(at, 2)), column(at, 0) == 3)


def test_a_fit_of_an_own_law_is_refused_with_the_reason(at):
    def mine(restitution):
        return sj.ConstantRestitution(None, restitution)

    data = cal.RestitutionData(np.arange(1.0, 9), 0.8 + 0.01 * np.sin(np.arange(8.0)))
    start = {"restitution": cal.Parameter(0.8, bounds=(0.01, 1))}
    cal.fit(data, mine, start, profiles=False).save(at / "fit.json")
    curve("--fit", "fit.json", error="mine")
    (at / "fit.json").write_text("{}", encoding="utf-8")
    assert curve("--fit", "fit.json", error="no result of a fit").startswith("fit.json: ")


def test_a_fit_of_two_sizes_is_refused_with_a_law_for_one_size(at):
    """By each command; what the line says gives the curve of that size."""
    radius = np.repeat([0.005, 0.01], 3)
    contact = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, radius)
    measured = [0.8, 0.78, 0.76, 0.9, 0.89, 0.88]
    data = cal.RestitutionData(np.tile([0.5, 1.0, 2.0], 2), measured, contact, 0.01)
    cal.fit(data, "viscoelastic", profiles=False, starts=1).save(at / "fit.json")
    for words in (("export", "--to", "c"), ("sensitivity",), ("curve",)):
        code, out, error = run(*words, "--fit", "fit.json")
        assert (code, out, error.count("\n")) == (2, "", 1)
        assert "bodies of several sizes" in error
    (at / "one.toml").write_text(BODIES.replace("0.0127", "0.005"), encoding="utf-8")
    curve("one.toml", *error.partition("FILE.toml ")[2].split(), "--points", "9")
    (at / "m.csv").write_text("diameter [mm],velocity,restitution\n10,1,0.9\n20,1,0.8\n")
    rows = '[[material]]\nmaterial = "nylon"\ndata = "m.csv"\n'
    (at / "m.toml").write_text(rows, encoding="utf-8")
    error = curve("m.toml", "--set", "chi=0.2", error="'m' has bodies of several sizes")
    assert error.startswith("m.toml:1: ")


ALLOY = pair("nylon")
# options, the law, and velocities [m/s]: the lowest and the highest, or each
TABLES = {
    "a step at yield": ("", fitted("nylon"), [0.1, 60]),
    "an end of ε": ("--set sigma=3 chi=0.22 psi=0.54", sj.Zhou(ALLOY, 0.22, 3.0, 0.54), [0.1, 300]),
    "a larger χ̃": ("--set chi=6 sigma=0.4 psi=0.54", sj.Zhou(ALLOY, 6.0, 0.4, 0.54), [0.5, 300]),
    "from rest to the limit velocity": (
        "--law eq-17 --set sigma=0.4 psi=0.54",
        sj.EmpiricalRestitution(ALLOY.limit_velocity, 0.4, 0.54),
        [0, 400],
    ),
    "a kink": ("--law thornton", sj.Thornton(ALLOY), [0.1, 60]),
}
for seed in (4, 6):  # a step, or the end of ε, lies anywhere between two of the user's own
    random = np.random.default_rng(seed)
    velocity = np.unique([0.1, 300.0, *random.uniform(0.1, 300, 10)])
    chi, sigma = random.uniform(0.1, 3), random.uniform(0.3, 3)
    words = f"--set chi={chi} sigma={sigma} psi=0.54"
    TABLES[f"own {seed}"] = (words, sj.Zhou(ALLOY, chi, sigma, 0.54), velocity)


def largest_error(law, velocity, coefficient):
    """Over 8192 random velocities, by the program of the table; those within a step's two rows are in both."""
    random = np.random.default_rng(3)
    some = random.uniform(velocity[0], velocity[-1], (64, 128))
    gap = random.integers(len(velocity) - 1, size=(32, 128))
    some[32:] = velocity[gap] + random.uniform(0, 1, gap.shape) * np.diff(velocity)[gap]
    law_says = [sj.restitution(law, each).coefficient for each in some]
    return np.max(np.abs(np.interp(some, velocity, coefficient) - law_says))


@pytest.mark.parametrize("name", TABLES)
def test_no_velocity_errs_by_more(name, at):
    """Fails where the law is compared at three places between two rows: by up to a third, of two digits."""
    options, law, given = TABLES[name]
    words = ["--from", given[0], "--to", given[-1], "--points", 11, "--spacing", "lin"]
    if len(given) > 2:
        np.savetxt(at / "v.csv", given)
        words = ["--velocities", "v.csv"]
    code, _, error = run("curve", "nylon", *options.split(), *words, "--table")
    assert code == 0, error
    path = at / "results" / "curve.txt"
    promised = re.search(
        r"differs from the curve by about (\S+) at most", path.read_text(encoding="utf-8")
    )[1]
    velocity, coefficient = np.loadtxt(path)[:, :2].T
    assert np.all(np.diff(velocity) > 0)
    assert len(given) == 2 or np.array_equal(velocity, given)
    found = largest_error(law, velocity, coefficient)
    assert found / 1.1 <= float(promised) <= 1.06 * found + 1e-12
