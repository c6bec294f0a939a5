"""Standard errors, intervals and bands of Zhou's law, against SciPy and iminuit on SciPy's own model."""

import io
import re

import iminuit
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats
from scipy.optimize import least_squares

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.decay import Decay, decay
from tests.fit_data import TRUTH, pair, twin
from tests.fit_oracle import own_model
from tests.golden import simulated

NAMES = ("chi", "sigma", "psi")
QUICK = {"route": sj.EnergyBalance(), "starts": 4}
SETS = {  # name of a material, and how its data are made
    "stainless, u not stated": ("stainless steel", {"noise": 0.0005, "seed": 1}),
    "chrome, u stated": ("chrome steel", {"noise": 0.001, "uncertainty": 0.002, "seed": 2}),
    "nylon, Hertz's area": ("nylon", {"noise": 0.001, "seed": 3, "area": "hertz"}),
    "nylon, u of each point": (
        "nylon",
        {"noise": 0.002, "seed": 4, "uncertainty": np.linspace(0.001, 0.004, 30)},
    ),
}
PROFILED = ("chrome, u stated", "nylon, Hertz's area")


@pytest.mark.parametrize("case", SETS)
def test_errors_and_correlations_are_scipy_s_and_profiles_minos_s(case):
    """Where u is not stated its estimate, and Student's quantile in place of the normal one."""
    name, made = SETS[case]
    data = twin(name, **made)
    result = cal.fit(data, profiles=case in PROFILED, **QUICK)
    values, covariance, off = fit_oracle.fit(
        own_model(data), TRUTH[name][1:4], data.restitution, data.uncertainty
    )
    size = np.sqrt(np.diag(covariance))
    assert result.covariance_names == NAMES
    for parameter, value, error in zip(NAMES, values, size, strict=True):
        assert result.values[parameter] == pytest.approx(value, rel=1e-5)
        if not result.estimates[parameter].skewed:
            assert result.standard_errors[parameter] == pytest.approx(error, rel=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), size, rtol=1e-5)
    np.testing.assert_allclose(result.correlations, covariance / np.outer(size, size), atol=1e-5)
    assert result.rank == 3
    stated = data.uncertainty is not None
    reduced = np.sum(off**2) / 27
    material = result.materials[0]
    assert result.degrees_of_freedom("chi") == (None if stated else pytest.approx(27))
    if stated:
        assert material.reduced_chi_squared == pytest.approx(reduced, rel=1e-6)
    else:
        assert material.reduced_chi_squared is None
        assert material.noise == pytest.approx(np.sqrt(reduced), rel=1e-6)
    if case not in PROFILED:
        return
    model, u = own_model(data), data.uncertainty
    if not stated:
        u = np.sqrt(reduced) * stats.t.ppf(0.975, 27) / stats.norm.ppf(0.975)

    def cost(*logarithms):  # profiles do not mind, and the steps stay at positive numbers
        return float(np.sum(((model(*np.exp(logarithms)) - data.restitution) / u) ** 2))

    minuit = iminuit.Minuit(cost, *np.log(values), name=NAMES)
    minuit.errordef, minuit.tol, minuit.strategy = 1.0, 1e-4, 2
    minuit.migrad()
    minuit.minos(cl=0.95)
    for parameter in NAMES:
        expected, value = minuit.merrors[parameter], minuit.values[parameter]
        assert expected.is_valid
        ends = np.exp([value + expected.lower, value + expected.upper])
        assert result.intervals[parameter] == pytest.approx(tuple(ends), rel=1e-3)
        assert result.estimates[parameter].method == "profile"


def test_a_profile_follows_a_valley_to_its_end():
    """σ and ψ that make up for each other over decades, against SciPy in ln(σ r^ψ) in place of σ."""
    data = twin("chrome steel", noise=0.01, seed=0, uncertainty=0.01)
    result = cal.fit(data, **QUICK)
    assert result.intervals["sigma"][1] is None
    assert all(end is not None for end in result.intervals["chi"])
    model, critical = own_model(data), float(data.contact.critical_velocity)
    ratio = critical / (float(data.contact.limit_velocity) - critical)

    def lowest(psi):
        def residual(q):
            chi, loss = np.exp(q)
            return (model(chi, loss / ratio**psi, psi) - data.restitution) / 0.01

        starts = ([np.log(0.06), at] for at in (-3.5, -3.0))
        return min(2 * least_squares(residual, start).cost for start in starts)

    rise = [lowest(end) - lowest(result.values["psi"]) for end in result.intervals["psi"]]
    assert rise == pytest.approx([stats.chi2.ppf(0.95, 1)] * 2, rel=1e-3)


class Logarithmic(sj.HardSphereLaw):
    k: float = sj.number_field("k", within="(0, inf)", default=1.0)

    def restitution_squared(self, velocity):
        return (0.5 + 0.01 * jnp.log(self.k) + 0 * velocity) ** 2


@pytest.mark.parametrize("powers", [11, 13])
def test_an_interval_that_reaches_beyond_e_to_the_twelfth_is_open(powers):
    u = 0.01 * powers / stats.norm.ppf(0.975) * 4**0.5
    data = cal.RestitutionData(
        np.arange(1.0, 5.0), 0.5 + 1e-3 * np.array([1, -1, -1, 1]), uncertainty=u
    )
    found = cal.fit(data, Logarithmic, starts=1).estimates["k"]
    ends = (
        (None, None) if powers > 12 else pytest.approx((np.exp(-powers), np.exp(powers)), rel=1e-3)
    )
    assert (found.low, found.high) == ends


def test_an_interval_at_a_bound_knows_as_little_of_the_noise():
    """Student's quantile, with the residuals' degrees of freedom, as that of its neighbours."""
    nylon = pair("nylon")
    velocity = np.geomspace(2.0, 40.0, 12) * nylon.critical_velocity
    law = sj.Zhou(nylon, 0.3, 1e-6, 0.5)
    above = 0.02 + 0.01 * np.random.default_rng(3).standard_normal(12)  # what Eq. (17) forbids
    data = cal.RestitutionData(velocity, sj.restitution(law, velocity).coefficient + above, nylon)
    result = cal.fit(data, starts=4)
    assert set(result.profiles) == {"chi", "eps_up"}
    assert result.values["eps_up"] == 1.0
    (warning,) = (warning for warning in result.warnings if warning.code == "at-bound")
    assert "cannot exceed 1" in str(warning)
    assert "Widen" not in str(warning)
    for profile in result.profiles.values():
        assert 4.8 < profile.threshold < 5.2  # t² at 95 %: 4.96 of 10 degrees, 3.84 of none
    # χ̃ follows ε_up, which its standard error holds at 1
    bare = cal.fit(data, starts=4, profiles=False).estimates["chi"]
    assert (bare.low, bare.high) == (None, None) != result.intervals["chi"]


def test_a_band_is_the_covariance_carried_through_the_curve():
    data = twin("nylon", noise=0.002, seed=3)
    result = cal.fit(data, profiles=False, **QUICK)
    velocity, numbers = data.velocity[::5], fit_oracle.numbers(data.contact)
    centre = [result.values[k] for k in NAMES]
    curve = lambda p: fit_oracle.curve(velocity, numbers, *p)  # noqa: E731
    steps = 1e-5 * np.diag(centre)
    slope = [(curve(centre + s) - curve(centre - s)) / (2 * np.max(s)) for s in steps]
    order = [result.covariance_names.index(k) for k in NAMES]
    covariance = result.covariance[np.ix_(order, order)]
    expected = np.sqrt(np.einsum("iv,ij,jv->v", slope, covariance, slope))
    band = result.band(velocity)
    np.testing.assert_allclose(band.coefficient, curve(centre), atol=1e-9)
    np.testing.assert_allclose(band.standard_error, expected, rtol=1e-5)
    left = len(data) - 3
    for level in (0.95, 0.5):
        one = result.band(velocity, confidence=level)
        reach = stats.t.ppf(0.5 + level / 2, left)
        np.testing.assert_allclose(one.high - one.low, 2 * reach * expected, rtol=1e-5)


class Knee(sj.HardSphereLaw):
    """ε = a - b max(v - 3, 0): below 3 m/s b acts on nothing."""

    level: float
    slope: float

    def restitution_squared(self, velocity):
        return (self.level - self.slope * jnp.maximum(velocity - 3.0, 0.0)) ** 2


def test_a_band_has_no_limits_where_what_the_data_do_not_determine_moves_the_curve(tmp_path):
    """With no variance along a null direction impacts at one velocity gave 0.004 at every other."""
    measured = 0.8 + np.array([-0.02, 0.01, 0.0, 0.02, -0.01])
    data = cal.RestitutionData([2.0] * 5, measured, uncertainty=0.01)
    v, error = np.array([1.0, 2.0, 4.0]), 0.01 / 5**0.5
    result = cal.fit(data, Decay, starts=1)
    result.save(tmp_path / "fit.json")
    for one in (result, cal.FitResult.load(tmp_path / "fit.json", law=Decay)):
        for kind, expected in (("mean", error), ("prediction", np.hypot(error, 0.01))):
            band = one.band(v, kind=kind)
            assert np.all(np.isfinite(band.coefficient))
            reach = np.array([np.nan, stats.norm.ppf(0.975) * expected, np.nan])
            np.testing.assert_allclose(band.standard_error[1], expected, rtol=1e-4)
            np.testing.assert_allclose(band.high - band.coefficient, reach, rtol=1e-4)
            np.testing.assert_allclose(band.coefficient - band.low, reach, rtol=1e-4)
    with pytest.raises(ValueError, match="determined by the data of the fit, one at least"):
        cal.optimal_velocities(result, 4, (1.0, 5.0))
    # a prior of the rate carries the curve from there
    known = cal.fit(data, Decay, {"rate": cal.Parameter(prior=(0.1, 0.02))}, starts=1).band(v)
    curve = 0.8 * np.exp(-0.1 * (v - 2))
    expected = curve * np.hypot(error / 0.8, 0.02 * (v - 2))
    np.testing.assert_allclose(known.standard_error, expected, rtol=1e-3)
    # of a parameter that acts on no point
    slow = cal.RestitutionData(np.linspace(0.5, 2.5, 5), measured, uncertainty=0.01)
    starts = {"level": cal.Parameter(0.8), "slope": cal.Parameter(0.05)}
    limits = cal.fit(slow, Knee, starts, starts=1).band([2.0, 4.0])
    np.testing.assert_allclose(limits.standard_error, [error, np.nan], rtol=1e-6)


@pytest.mark.parametrize("share", [0.001, 0.05])
def test_velocities_alone_with_an_uncertainty_make_a_band_as_wide_as_the_slope(share):
    """One more point has the estimated scatter and the slope's error at its own v; of ε nothing was stated."""
    random, exact = np.random.default_rng(0), np.linspace(0.3, 8, 40)
    restitution = decay(exact, 0.95, 0.09) + 0.004 * random.standard_normal(40)
    velocity = exact * (1 + share * random.standard_normal(40))
    data = cal.RestitutionData(velocity, restitution, velocity_uncertainty=share * velocity)
    result, v = cal.fit(data, Decay, profiles=False, starts=1), np.array([0.3, 1.0, 4.0, 8.0])
    mean, band = result.band(v), result.band(v, kind="prediction")
    u_v = result.values["rate"] * mean.coefficient * share * v
    scatter = result.material().variances["scatter"]
    expected = np.sqrt(mean.standard_error**2 + scatter + u_v**2)
    np.testing.assert_allclose(band.standard_error, expected, rtol=1e-4)
    assert not [one for one in result.warnings if one.code == "stated-uncertainty"]


def test_degrees_of_freedom_of_many_points_are_printed_whole():
    """To four digits 11 999 was 1.2e+04."""
    restitution = 0.9 + 0.01 * np.tile([-1.0, 1.0], 6000)
    data = cal.RestitutionData(np.linspace(1, 5, 12000), restitution)
    result = cal.fit(data, "constant", profiles=False, starts=1)
    assert "points 12000, dof 11999, rms 0.01," in str(result)


def test_a_set_without_free_parameters_has_the_quantile_of_its_own_noise():
    """4 points about a given curve: Student's t with 4 degrees of freedom, beside a set with many."""
    many = twin("nylon", noise=0.002, seed=3)
    exact = np.array([0.9, 0.8, 0.7, 0.6])
    velocity = np.geomspace(0.01, 0.5, 4) * float(many.contact.limit_velocity)
    few = cal.RestitutionData(velocity, exact, many.contact, name="few")
    fixed = {"chi": 0.22, "sigma": 0.44, "psi": 0.54}
    result = cal.fit([few, many], parameters=[fixed, {}], profiles=False, **QUICK)
    band = result.band(velocity, "few", kind="prediction")
    off = sj.restitution(result.law["few"], velocity).coefficient - exact
    assert band.standard_error == pytest.approx(np.sqrt(np.mean(off**2)))
    reach = (band.high - band.coefficient) / band.standard_error
    np.testing.assert_allclose(reach, stats.t.ppf(0.975, 4), rtol=1e-9)


def test_a_band_of_many_sets_has_the_degrees_of_what_it_stands_on():
    """The mean of two constants' common ε by Satterthwaite's degrees; not those of either set."""
    random, sizes = np.random.default_rng(0), (5, 40)
    sets = [
        cal.RestitutionData(np.linspace(1, 2, n), 0.8 + u * random.standard_normal(n), name=f"{n}")
        for n, u in zip(sizes, (0.004, 0.01), strict=True)
    ]
    result = cal.fit(sets, "constant", {"restitution": cal.Parameter(shared=True)}, profiles=False)
    variance = np.array([m.noise**2 for m in result.materials])
    share = np.array(sizes) / variance / np.sum(np.array(sizes) / variance)
    freedom = np.array(sizes) - share
    band = result.band(1.5, "5")
    degrees = 1 / np.sum(share**2 / freedom)
    reach = float((band.high - band.coefficient) / band.standard_error)
    assert degrees > 6
    assert reach == pytest.approx(stats.t.ppf(0.975, degrees), rel=0.06)
    assert reach < 0.9 * stats.t.ppf(0.975, 4)


V = np.linspace(0.5, 8.0, 20)
EXACT = 0.92 * np.exp(-0.09 * V)
LEVELS = 0.8 + 0.017 * np.arange(-2, 3)[:, None] + 0.03 * np.array([1, -1, 1, -1])
BOOTSTRAPPED = {  # by noise; mostly by a prior; by the other members of a pool, no farther off than their errors
    "noise": (
        cal.RestitutionData(V, EXACT + 0.004 * np.random.default_rng(5).standard_normal(20)),
        Decay,
        {},
    ),
    "prior": (
        cal.RestitutionData(V, EXACT, uncertainty=0.05),
        Decay,
        {"rate": cal.Parameter(prior=(0.09, 0.002))},
    ),
    "pool": (
        [
            cal.RestitutionData(V[:4], e, name=str(k), uncertainty=0.04)
            for k, e in enumerate(LEVELS)
        ],
        "constant",
        {"restitution": cal.Parameter(shared="pooled", transform="none")},
    ),
}


@pytest.mark.parametrize("case", BOOTSTRAPPED)
def test_a_bootstrap_s_intervals_are_as_wide_as_the_table_s(case):
    """Priors' means are drawn as the points are: held, 1000 refits would hardly move."""
    result = cal.fit(*BOOTSTRAPPED[case], profiles=False, starts=1)
    if case == "prior":
        assert result.standard_errors["rate"] == pytest.approx(0.002, rel=0.1)
    if case == "pool":
        assert 0.01 < result.values["restitution_spread"] < 0.03
    found = result.bootstrap(1000, seed=1)
    assert np.all(found.converged)
    for name in result.covariance_names:
        ends, drawn = np.array(result.intervals[name]), np.array(found.intervals[name])
        assert np.all(np.abs(drawn - ends) < 0.1 * np.ptp(ends))
    if case == "noise":  # known to 2.2 %; limits are quantiles
        errors = [*result.standard_errors.values()]
        np.testing.assert_allclose(np.std(found.values, axis=0), errors, rtol=0.08)
        off = np.mean(found.values, axis=0) - [*result.values.values()]
        assert np.all(np.abs(off) < 0.1 * np.array(errors))
        ends = np.quantile(found.values, [0.025, 0.975], axis=0)
        np.testing.assert_allclose([*found.intervals.values()], ends.T)
        one, same, other = (result.bootstrap(5, seed=k).values for k in (1, 1, 2))
        assert np.array_equal(one, same)
        assert not np.array_equal(one, other)


HEIGHTS = {f"{name}_height_uncertainty": "2 mm" for name in ("drop", "rebound")}


@pytest.fixture(scope="module")
def data():
    ball, plate = (sj.Material(*one) for one in (simulated.BRONZE, simulated.PLATE))
    contact = sj.Contact.with_wall(ball, plate, 0.006)
    table = pd.read_csv(io.StringIO(simulated.drops(0, (6.0, 3.0, 0.5), 0.0)))
    return cal.RestitutionData.from_table(table, contact, air=False, **HEIGHTS)


def deviance(data, curve):
    """-2 ln L of heights carried into ε by GUM's rule, as ε = √(h₂/h₁); without 2π."""
    v, step = data.velocity, 1e-3 * data.velocity
    drop = v**2 / (2 * simulated.GRAVITY)
    slope = (curve(v + step) - curve(v - step)) / (2 * step)
    of_rebound = 1 / (2 * data.restitution * drop)
    of_drop = -data.restitution / (2 * drop) - slope * v / (2 * drop)
    variance = 0.002**2 * (of_rebound**2 + of_drop**2)
    return np.sum((curve(v) - data.restitution) ** 2 / variance + np.log(variance))


@pytest.fixture(scope="module")
def result(data):
    return cal.fit(data)


def test_table_and_profile_have_the_interval_of_scipy(data, result, tmp_path):
    """No ± where the standard error describes no interval; χ² with ε_up refitted at its ends."""
    without = cal.fit(data, profiles=False)
    assert without.estimates["chi"].skewed is None
    judged = "not checked, without profiles: whether standard errors describe"
    without.report(tmp_path)
    assert judged in (tmp_path / "report.html").read_text()
    assert result.estimates["chi"].skewed
    assert np.isnan(result.standard_errors["chi"])
    row = next(line for line in str(result).splitlines() if " χ̃ " in line and "…" in line)
    assert "±" not in row
    codes = [warning.code for warning in result.warnings]
    assert codes.count("skewed") == codes.count("collinear") == 1
    (cause,) = (warning.cause for warning in result.warnings if warning.code == "collinear")
    middle = float(np.median(data.velocity))
    band = result.band(middle)
    known = float(cause.partition("well determined, ")[2].partition(" ±")[0])
    assert known == pytest.approx(float(band.coefficient), abs=0.1 * float(band.standard_error))
    assert band.standard_error < 0.002
    numbers = fit_oracle.numbers(data.contact)
    ratio = float(data.contact.critical_velocity) / float(data.contact.limit_velocity)

    def at(up, chi):
        sigma = -np.log(up) / (ratio / (1 - ratio)) ** 0.5
        return deviance(data, lambda v: fit_oracle.curve(v, numbers, chi, sigma, 0.5))

    def lowest(chi):
        ends = {"bounds": (0.85, 1.0), "options": {"xatol": 1e-7}}
        return optimize.minimize_scalar(at, args=(chi,), **ends).fun

    best = lowest(result.values["chi"])
    for end in result.intervals["chi"]:
        assert lowest(end) - best == pytest.approx(stats.chi2.ppf(0.95, 1), rel=0.05)


def test_bootstrap_comparison_band_and_plan_agree(data, result):
    """One more drop from the same height scatters as those measured did; none is planned from low down."""
    near = 0.1 * np.ptp(result.intervals["chi"])
    found = result.bootstrap(200, seed=1)
    assert np.median(found.values[:, 0]) == pytest.approx(result.values["chi"], abs=near)
    low, high = result.intervals["chi"]
    assert found.intervals["chi"][0] == pytest.approx(low, abs=near)
    assert found.intervals["chi"][1] == pytest.approx(high, abs=near)
    comparison = cal.compare(data, ["zhou", "constant"])
    assert comparison.ranking[0] == "Zhou"
    assert comparison["Zhou"].values["chi"] == pytest.approx(result.values["chi"], abs=1e-5)
    assert comparison["Zhou"].intervals["chi"] == pytest.approx(
        (low, high), abs=0.01 * (high - low)
    )
    low, high = np.min(data.velocity), np.max(data.velocity)
    band = result.band(np.array([low, high]), kind="prediction")
    mean = result.band(np.array([low, high]))
    added = band.standard_error**2 - mean.standard_error**2
    rebound = data.restitution**2 * data.velocity**2 / (2 * simulated.GRAVITY)
    expected = (0.002 * data.restitution / (2 * rebound)) ** 2
    assert added[0] / added[1] == pytest.approx(
        np.mean(expected[data.velocity == low]) / np.mean(expected[data.velocity == high]), rel=0.4
    )
    design = cal.optimal_velocities(result, 6, (0.3, float(high)))
    assert np.min(design.velocity) > low


def test_nothing_free_is_a_fit_of_its_noise_alone(data):
    """Errors of heights and three given numbers: ln L of the given law, nothing searched."""
    given = {"chi": 6.0, "sigma": 3.0, "psi": 0.5}
    result = cal.fit(data, parameters=given)
    assert result.converged
    assert result.values["chi"] == 6
    numbers = fit_oracle.numbers(data.contact)
    twice = deviance(data, lambda v: fit_oracle.curve(v, numbers, *given.values()))
    expected = -0.5 * (twice + len(data) * np.log(2 * np.pi))
    assert result.log_likelihood == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("dof", "text"), [(900.0, "wald, dof = 900"), (1000.0, "wald")])
def test_a_table_has_degrees_of_freedom_below_a_thousand(dof, text, monkeypatch, tmp_path):
    """Of more, Student's 97.5 % quantile is 1.962, and the normal one 1.960."""
    data = cal.RestitutionData(np.linspace(1, 2, 5), [0.8, 0.81, 0.79, 0.8, 0.82])
    result = cal.fit(data, "constant", profiles=False, starts=1)
    monkeypatch.setattr(type(result), "degrees_of_freedom", lambda *_: dof)
    result.report(tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.findall(r"<t[dh][^>]*>(wald[^<]*)<", page) == [text]
