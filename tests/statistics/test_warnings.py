"""Each warning is raised by data that must raise it, and not by their neighbours; thresholds from both sides."""

import re
from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests.fit_data import TRUTH, eq_17_data, pair, twin
from tests.shown.capture import as_recorded

QUICK = {"route": sj.EnergyBalance(), "profiles": False, "starts": 4}
TWO_STEP = QUICK | {"objective": "two-step"}
Free = cal.Parameter


def codes(result):
    return {one.code for one in result.warnings}


class Falling(sj.HardSphereLaw):
    """ε = 1 - a v - b v (1 + c (v - 1)), by two parameters that act almost alike."""

    one: Array = sj.number_field("a", "s/m", "one slope")
    other: Array = sj.number_field("b", "s/m", "other slope")
    curve: float = 1e-3

    def restitution_squared(self, velocity):
        bent = 1 + self.curve * (velocity - 1)
        return (1 - (self.one + self.other * bent) * velocity) ** 2


def falling(data, curve=-1.0):
    def line(contact, one, other):
        return Falling(one, other, curve)

    return cal.fit(data, line, {"one": Free(0.03), "other": Free(0.03)}, **QUICK)


def straight(noise, contact=None, count=60, stop=4.0):
    """1 - v/20 with noise of its own size at each velocity."""
    velocity = np.linspace(0.5, stop, count)
    random = 0.003 * np.random.default_rng(4).standard_normal(count)
    e = 1 - 0.05 * velocity + noise(velocity) * random
    return cal.RestitutionData(velocity, e, contact)


def collinear(curve):
    velocity = np.linspace(0.1, 1.9, 30)
    noise = 1e-9 * np.random.default_rng(3).standard_normal(30)
    return falling(cal.RestitutionData(velocity, 1 - 0.1 * velocity + noise), curve)


def misfit(name):
    return cal.fit(eq_17_data(name, 40, noise=0.003), **TWO_STEP)


def scattered(high):
    """One ε above 1, among others that scatter as widely."""
    e = 0.95 + 0.03 * (-1.0) ** np.arange(12) + np.where(np.arange(12) == 3, high, 0.0)
    return cal.fit(cal.RestitutionData(np.linspace(1, 2, 12), e))


class Ellipse(sj.HardSphereLaw):
    """ε = 1/2 + cos(a)/10 x + sin(a)/20 with x the velocity in units of its scatter."""

    a: float

    def restitution_squared(self, velocity):
        x = (velocity - 15.5) / np.std(np.arange(1.0, 31.0))
        return (0.5 + 0.1 * jnp.cos(self.a) * x + 0.05 * jnp.sin(self.a)) ** 2


def ellipse(rise, u=0.01, profiles=False):
    """ε is 1/2 + d on average: the ellipse is nearest at a = ±π/2, where χ² differs by 2 n d/(10 u²).

    Between them it is higher by n (0.0075 + d/10)/u².
    """
    velocity = np.arange(1.0, 31.0)
    off = 10 * rise * u**2 / (2 * 30)
    noise = np.random.default_rng(5).normal(size=30)
    noise -= np.polyval(np.polyfit(velocity, noise, 1), velocity)
    data = cal.RestitutionData(velocity, 0.5 + off + 0.01 * noise, uncertainty=u)
    result = cal.fit(data, Ellipse, {"a": Free(0.3, bounds=(-3.5, 3.5))}, profiles=profiles)
    assert result.values["a"] == pytest.approx(np.pi / 2, abs=1e-5)
    return result


class Levelling(sj.HardSphereLaw):
    """ε = 0.9 - 0.1 x/(1 + x) with x = c v."""

    c: float = sj.number_field("c", "s/m", "rate", within="(0, inf)")

    def restitution_squared(self, velocity):
        x = self.size(velocity)
        return (0.9 - 0.1 * x / (1 + x)) ** 2

    def size(self, velocity):
        return self.c * velocity


class SlowlyLevelling(Levelling):
    """The same with x = ln(1 + c v): at c = e^25 it is still on its way."""

    def size(self, velocity):
        return jnp.log1p(self.c * velocity)


def levelling(law, level):
    """ε ends at 0.8: points just below want c as large as can be, points at 0.85 x of about 1."""
    e = level - 0.0005 + 0.001 * (-1.0) ** np.arange(20)
    data = cal.RestitutionData(np.linspace(1, 2, 20), e, uncertainty=0.001)
    return cal.fit(data, law, {"c": cal.Parameter(1.0)}, **QUICK)


def balls(radius):
    pair = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, radius, radius)
    return falling(straight(np.ones_like, pair, 20))


def imprecise(part=None, near=None):
    """Velocities with errors of a part of them, far from yield; or one so many errors from it."""
    y = np.append(np.linspace(0.1, 0.7, 8), np.geomspace(1.5, TRUTH["nylon"][4], 20))
    one = twin("nylon", y if near is None else None, noise=0.002, uncertainty=0.002)
    far = np.abs(one.velocity - float(one.contact.critical_velocity))
    nearest = far == np.min(far)
    u = part * one.velocity if near is None else np.where(nearest, far / near, 1e-3 * one.velocity)
    return cal.fit(replace(one, errors=None, uncertainty=0.002, velocity_uncertainty=u), **QUICK)


def peaks(restitution, lowest=0.0):
    """Peak forces of a sphere with a dashpot: damping lowers them at first, and raises them when it is strong."""
    law = sj.HertzDashpot(pair("nylon"), restitution)
    velocity = np.geomspace(0.1, 3, 20)
    noise = 0.01 * np.random.default_rng(0).standard_normal(20)
    force = np.asarray(sj.restitution(law, velocity).peak_force) * (1 + noise)
    u = 0.01 * force
    data = cal.RestitutionData(
        velocity, None, law.contact, peak_force=force, peak_force_uncertainty=u
    )
    return cal.fit(data, "hertz-dashpot", {"restitution": Free(bounds=(lowest, 1))})


def test_two_minima_of_one_cost_are_listed_with_their_values():
    """The restitution that is named has the peak forces of the estimate, as those of a dashpot have."""
    result = peaks(0.45)
    (warning,) = [w for w in result.warnings if w.code == "several-minima"]
    assert "-2 ln L is the same" in warning.cause
    other = float(re.search(r"restitution = ([\d.]+);", warning.cause)[1])
    assert other < 0.3 < result.values["restitution"]
    assert "intervals are of restitution = 0.4" in warning.cause
    force = [
        float(sj.restitution(sj.HertzDashpot(pair("nylon"), value), 1.0).peak_force)
        for value in (other, result.values["restitution"])
    ]
    assert force[0] == pytest.approx(force[1], rel=1e-3)


def beside_yield(y):
    """A yield strength that is free, and a point at y times the critical velocity of it."""
    data = twin(
        "nylon",
        np.append(np.geomspace(0.2, 0.8, 8), [y, *np.geomspace(1.6, 20, 12)]),
        0.0003,
        uncertainty=0.0003,
    )
    known = dict(zip(("chi", "sigma", "psi"), TRUTH["nylon"][1:4], strict=True))
    return cal.fit(data, None, known | {"contact.yield_strength": Free()}, **QUICK)


def zhou(name, y=None, noise=0.0, seed=0, **options):
    """Of the model's own curve."""
    stated = {"uncertainty": noise} if options.pop("stated", False) else {}
    return cal.fit(twin(name, y, noise, seed, **stated), **QUICK | options)


STEEL, CHROME = "stainless steel", "chrome steel"
BELOW = {"noise": 0.001}
# raised, and not by the neighbour
CASES = {
    "velocity-errors": lambda: (imprecise(0.151), imprecise(0.149)),
    "velocity-errors, near yield": lambda: (imprecise(near=1.99), imprecise(near=2.01)),
    "yield-jump": lambda: (beside_yield(1.0), beside_yield(1.3)),
    # with noise as large as this the losses below yield say nothing of ψ
    "at-bound, at zero": lambda: [zhou("nylon", None, u, 2, stated=True) for u in (0.03, 0.0005)],
    # the point just below yield alone shows a loss there
    "at-bound, at the end of ψ": lambda: [zhou(STEEL, None, u, 18, stated=True) for u in (0.01, 0.0003)],
    "at-bound, at infinity": lambda: [levelling(Levelling, e) for e in (0.8, 0.85)],
    "at-bound, at infinity, slowly": lambda: [levelling(SlowlyLevelling, e) for e in (0.8, 0.85)],
    "eps-up-only": lambda: (zhou("nylon", np.geomspace(1.2, 80, 30), 0.002), zhou("nylon", None, 0.002)),
    "sigma-psi-not-separate": lambda: [zhou(CHROME, None, u, 1) for u in (0.02, 0.0005)],
    # two slopes that differ by a slight bend; and by one that shows
    "collinear": lambda: (collinear(1e-1), collinear(1.0)),
    "model-misfit": lambda: (misfit(STEEL), misfit(CHROME)),
    # just above yield the law gains energy; farther up it does not
    "status": lambda: [zhou(CHROME, np.linspace(low, 25, 30)) for low in (1.005, 1.3)],
    "all-below-yield": lambda: [cal.fit(eq_17_data("nylon", y=np.linspace(0.1, y, 20), **BELOW), **QUICK) for y in (0.9, 5.0)],
    "overlap": lambda: [zhou("nylon", np.geomspace(0.2, y, 30), 0.002) for y in (24.0, 16.0)],  # v_cr: 0.835 m/s
    "data": lambda: (scattered(0.1), scattered(0.0)),
    "several-minima": lambda: (ellipse(3.8), ellipse(4.2)),
    "several-minima, as low": lambda: (peaks(0.45), peaks(0.45, 0.35)),
    "several-minima, within an interval": lambda: [ellipse(0.5, 0.27, profiles) for profiles in (False, True)],
    "unequal-scatter": lambda: (falling(straight(lambda v: v**1.5)), falling(straight(lambda v: 2.0))),
    "plausibility": lambda: (balls(12.7), balls(0.0127)),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_raised_by_one_and_not_by_its_neighbour(case):
    code = case.split(",")[0]
    raised, quiet = CASES[case]()
    if case == "at-bound, at zero":
        assert raised.values["psi"] == 0.0
        assert raised.estimates["psi"].at_bound
    if "at infinity" in case:
        assert raised.values["c"] is None
        (bound,) = [w.cause for w in raised.warnings if w.code == "at-bound"]
        assert "c grows without bound" in bound
        assert ("still falls" in bound) == ("slowly" in case)
        assert np.all(np.isfinite(raised.band(raised.data.velocity).high))
    if case == "at-bound, at the end of ψ":
        assert raised.values["psi"] == 20.0
        assert np.all(np.isfinite(raised.band(raised.data.velocity).high))
    assert code in codes(raised)
    assert code not in codes(quiet)
    said = [f"{x.code}: {x.cause}; {x.advice}" for x in (*raised.warnings, *quiet.warnings)]
    as_recorded(f"warnings, {case}", {"raised and quiet": "\n\n".join(said)})
    assert f"! {code}: " in str(raised)
    assert code in raised.to_json()


# thresholds, by constants fitted to residuals that are made to measure


def constant(residual, velocity=None, uncertainty=None, group=None, parameters=None):
    """A constant ε about residuals of mean zero, or a given one."""
    velocity = np.arange(1.0, len(residual) + 1) if velocity is None else velocity
    e = 0.8 + 0.01 * residual
    data = cal.RestitutionData(velocity, e, uncertainty=uncertainty, group=group)
    return cal.fit(data, "constant", parameters, profiles=False, starts=1)


def alternating(n):
    return np.where(np.arange(n) % 2, 1.0, -1.0)


def chi_squared(by):
    """Of 13 points and one parameter."""
    residual = np.append(alternating(12), 0.0)
    u = 0.01 * np.sqrt(np.sum(residual**2) / (by * stats.chi2.ppf(0.99, 12)))
    return constant(residual, uncertainty=u)


def f_test(by):
    """Means of four repeats each, whose pooled scatter has 3 degrees a velocity."""
    means, repeats = np.tile([1.0, -1.0], 3), np.tile([1.0, -1.0, 1.0, -1.0], 6)
    size = np.sqrt(np.sum(means**2) / 5 / (by * stats.f.ppf(0.99, 5, 18)) * 4)  # of one repeat
    size *= np.sqrt(18 / 24)  # their pooled variance is 24/18 of its square
    velocity = np.repeat(np.arange(1.0, 7), 4)
    e = 0.8 + 0.001 * (np.repeat(means, 4) + size * repeats)
    return cal.fit(cal.RestitutionData(velocity, e).averaged(), "constant", starts=1)


def prior(by):
    data = cal.RestitutionData(np.arange(1.0, 13), 0.8 + 1e-4 * alternating(12), uncertainty=1e-4)
    parameters = {"restitution": Free(0.8, prior=(0.8 - 0.03 * by, 0.01))}
    return cal.fit(data, "constant", parameters, profiles=False, starts=1)


def neighbours(by):
    """√n times the first autocorrelation at the normal distribution's 99 %; not where rows are in order."""
    velocity = np.array([5.0, 1, 9, 3, 11, 7, 6, 12, 2, 10, 4, 8])  # many runs along it
    slow, fast = np.repeat([1.0, -1.0], 6), alternating(12)

    def excess(weight):
        r = weight * slow + fast
        return np.sum(r[1:] * r[:-1]) / np.sum(r * r) - stats.norm.ppf(0.99) / np.sqrt(12)

    residual = optimize.brentq(excess, 1.0, 50.0) * by * slow + fast
    assert "groups" not in codes(constant(residual))
    return constant(residual, velocity)


def grubbs(by, given=None):
    """Groups of six alike points, whose own errors are small: the means' test by SciPy's t.

    Of a given ε all groups may be off: it is from the others that one is far.
    """
    means = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    limit = stats.t.ppf(1 - 0.005 / 6, 4)
    means = np.append(means, by * limit * np.std(means, ddof=1) * np.sqrt(1 + 1 / 5))
    residual = 0.1 * np.repeat(means, 6) + 1e-3 * alternating(36)
    group = [*np.repeat([*"abcdef"], 6)]
    return constant(residual, np.linspace(1, 5, 36), group=group, parameters=given)


def off_as_a_whole(by, stated=False):
    """ε is shared with a set that decides it; what lies above would count as scatter."""
    noise = 0.005 * np.sqrt(11 / 12) * alternating(12)
    error = np.std(noise, ddof=1) / np.sqrt(12)
    off, velocity = by * stats.t.ppf(0.995, 11) * error, np.linspace(1, 5, 12)
    u = (1e-7, 0.001) if stated else (None, None)
    sets = [
        cal.RestitutionData(velocity, 0.8 + 1e-6 * alternating(12), name="a", uncertainty=u[0]),
        cal.RestitutionData(velocity, 0.8 + off + noise, name="b", uncertainty=u[1]),
    ]
    parameters = {"restitution": Free(shared=True)}
    return cal.fit(sets, "constant", parameters, extra_scatter=stated, profiles=False, starts=1)


def slope(by, u=None):
    """Of nine points as SciPy has it; raised where it is not distinguished from 0."""
    velocity = np.linspace(1, 5, 9)
    noise = np.random.default_rng(2).standard_normal(9)
    noise -= np.polyval(np.polyfit(velocity, noise, 1), velocity)
    reach = stats.t.ppf(0.975, 7) * stats.linregress(velocity, noise + velocity).stderr
    if u is not None:
        reach = stats.norm.ppf(0.975) / np.sqrt(15)
    return constant(reach / by * (velocity - 3) + noise, velocity, u)


SIDED = {  # and words of the cause
    "model-misfit": (chi_squared, ""),
    "model-misfit, of repeats": (f_test, ""),
    "prior-conflict": (prior, "restitution is 0.8, 3"),
    "groups": (neighbours, ""),
    "offset, of a group": (grubbs, "group f is of"),
    "offset, of a given curve": (partial(grubbs, given={"restitution": 0.806}), "group f is of"),
    "offset, of a set": (off_as_a_whole, "above the curve"),
    "offset, beside stated errors": (partial(off_as_a_whole, stated=True), "above the curve"),
    "no-velocity-dependence": (slope, ""),
    "no-velocity-dependence, stated": (partial(slope, u=0.01), ""),
}


def test_a_misfit_about_eq_17_has_the_numbers_of_the_table():
    fit = misfit(STEEL)
    (cause,) = (w.cause for w in fit.warnings if w.code == "model-misfit")
    assert cause == f"rms {fit.rms:.4g} where that of Eq. (17) is {fit.rms_empirical:.3g}"


@pytest.mark.parametrize("case", SIDED)
def test_raised_beyond_a_quantile_and_not_before(case):
    made, words = SIDED[case]
    for by in (0.995, 1.005):
        found = [one for one in made(by).warnings if one.code == case.split(",")[0]]
        assert [words in one.cause for one in found] == [True] * (by > 1)
        assert all(one.material == "b" for one in found if words == "above the curve")


def test_runs_are_wald_s_and_wolfowitz_s():
    """As few runs of ten and ten signs as chance makes in a hundred, and one more; along the velocity."""
    mean, deviation = 11.0, np.sqrt(10 * 9 / 19)
    few = max(n for n in range(2, 12) if stats.norm.cdf((n - mean) / deviation) < 0.01)
    for group in (None, ["a", "b"] * 10):
        found = constant(with_runs(few), group=group).warnings
        (one,) = (warning for warning in found if warning.code == "residual-runs")
        assert ("column" in one.advice) == (group is None)
        assert "compare" in one.advice
    assert "residual-runs" not in codes(constant(with_runs(few + 1)))
    order = np.random.default_rng(0).permutation(20)
    shuffled = constant(with_runs(few)[order], np.arange(1.0, 21)[order])
    assert "residual-runs" in codes(shuffled)
    for count, raised in ((4, False), (5, True)):  # of each sign; nine points are too few
        residual = np.append(np.full(5, 1.0), np.full(count, -5 / count))
        assert ("residual-runs" in codes(constant(residual))) == raised
    for count in (9, 10):  # all of one sign
        data = cal.RestitutionData(
            np.arange(1.0, count + 1), np.full(count, 0.81), uncertainty=0.01
        )
        fixed = cal.fit(data, "constant", {"restitution": 0.8}, starts=1)
        assert ("residual-runs" in codes(fixed)) == (count == 10)


def with_runs(count):
    """Ten residuals of each sign in so many runs, the last ones long."""
    lengths = [[1] * ((count + 1 - k) // 2) for k in range(2)]
    for one in lengths:
        one[-1] += 10 - sum(one)
    runs = [(lengths[k % 2][k // 2], 1.0 - 2 * (k % 2)) for k in range(count)]
    return np.concatenate([np.full(n, sign) for n, sign in runs])


@pytest.mark.parametrize("order", [(7, 5, 8, 2, 4, 6, 3, 1), (8, 7, 6, 4, 1, 3, 2, 5)])
def test_which_way_the_scatter_goes_is_said_and_one_velocity_shows_no_slope(order):
    """Spearman's correlation of sizes in pairs, as SciPy has it; raised below P = 0.005."""
    size = np.repeat(np.array(order, float), 2)
    result = constant(size * alternating(16))
    expected = stats.spearmanr(np.arange(16), size)
    told = [w.cause for w in result.warnings if w.code == "unequal-scatter"]
    assert bool(told) == (expected.pvalue < 0.005)
    for cause in told:
        assert f"shrink with the velocity (rank correlation {expected.statistic:.2f})" in cause
    result = constant(np.array([1.0, -1.0, 0.5, 0.0]), np.full(4, 2.0))
    (warning,) = (one for one in result.warnings if one.code == "no-velocity-dependence")
    assert warning.cause == "all points have one velocity, 2 m/s"
    result = cal.fit(cal.RestitutionData([1.0, 3.0], [0.8, 0.75]), "constant")
    (warning,) = (one for one in result.warnings if one.code == "no-velocity-dependence")
    assert "is -0.025 per m/s, and two points do not tell its error" in warning.cause
    result = cal.fit(cal.RestitutionData([1.0, 3.0], [0.8, 0.7], uncertainty=1e-9), "constant")
    assert "< 1e-300" in str(result)  # P of a χ² that has none


def test_a_slope_s_error_has_the_scatter_that_is_estimated_in_addition():
    """Stated errors far below the scatter make no line of noise significant."""
    velocity = np.linspace(1, 5, 12)
    noise = 0.02 * np.random.default_rng(1).standard_normal(12)
    line = stats.linregress(velocity, 0.8 + noise)
    assert 1e-4 / np.sqrt(np.sum((velocity - 3) ** 2)) < 0.1 * abs(line.slope) < line.stderr
    data = cal.RestitutionData(velocity, 0.8 + noise, uncertainty=1e-4)
    result = cal.fit(data, "constant", extra_scatter=True, profiles=False, starts=4)
    (warning,) = (one for one in result.warnings if one.code == "no-velocity-dependence")
    assert f"{line.slope:.2g} ± {line.stderr:.2g} per m/s" in warning.cause


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("slope", [0.0, 0.01])
def test_a_slope_has_the_weights_of_heavy_tails(slope, stated):
    """One of 20 points is far off: at the end of a level line, or of one whose scatter it would make large."""
    velocity = np.linspace(1, 5, 20)
    noise = 0.01 * np.random.default_rng(1).standard_normal(20)
    noise[-1 if stated else 9] = 0.15
    data = cal.RestitutionData(
        velocity, 0.8 - slope * velocity + noise, uncertainty=0.01 if stated else None
    )
    result = cal.fit(data, "constant", noise="student-t", profiles=False, starts=1)
    causes = [one.cause for one in result.warnings if one.code == "no-velocity-dependence"]
    assert bool(causes) == (slope == 0)
    if stated and causes:  # as by the likelihood itself

        def deviance(line):
            off = data.restitution - np.polyval(line, velocity)
            return -2 * np.sum(stats.t.logpdf(off, 4, 0, 0.01))

        best = optimize.minimize(deviance, [0.0, 0.8], method="Nelder-Mead", tol=1e-9)
        error = 0.01 * np.sqrt(7 / 5 / np.sum((velocity - 3) ** 2))
        assert f"is {best.x[0]:.2g} ± {error:.2g} per m/s" in causes[0]


def thirty_with(off, noise):
    """ε = 0.8 known to 0.01, two of 30 points off by so many u, to either side, so that the fit stays."""
    e = 0.8 + 0.003 * (-1.0) ** np.arange(30)
    e[[11, 12]] = 0.8 + 0.01 * off, 0.8 - 0.01 * off
    data = cal.RestitutionData(np.linspace(1, 5, 30), e, uncertainty=0.01)
    return cal.fit(data, "constant", noise=noise, profiles=False, starts=1)


@pytest.mark.parametrize(("noise", "of"), [("normal", stats.norm), ("student-t", stats.t(4))])
def test_an_outlier_is_what_one_data_set_in_twenty_has_by_its_family(noise, of):
    """The farthest of 30 residuals: 3.14 of normal errors, 7.09 of Student's t with four degrees of freedom."""
    limit = of.ppf(1 - 0.05 / (2 * 30))
    near, far = (thirty_with(factor * limit, noise) for factor in (0.97, 1.01))
    assert near.outliers == ()
    assert {one.row for one in far.outliers} == {12, 13}
    sizes = [abs(one.residual) for one in far.outliers]
    np.testing.assert_allclose(sizes, 1.01 * limit, rtol=0.03)  # over √(1 - leverage)


def test_points_that_heavy_tails_do_not_explain_are_a_warning_and_one_of_a_few_is_none():
    """Rarities by SciPy: five of 27 points by 15 u are no tails of Student's t, one by 150 u is."""
    five, one = 0.3 * (-1.0) ** np.arange(27), 0.3 * (-1.0) ** np.arange(27)
    five[4:24:4], one[4] = 15 * np.array([1, -1, 1, -1, 1]), -150
    data = [
        cal.RestitutionData(np.linspace(1, 5, 27), 0.8 + 0.004 * off, uncertainty=0.004)
        for off in (five, one)
    ]
    heavy = [cal.fit(d, "constant", noise="student-t", profiles=False, starts=1) for d in data]
    assert [len(result.outliers) for result in heavy] == [5, 1]
    assert ["model-misfit" in codes(result) for result in heavy] == [True, False]
    said = [" ".join(str(result).split()) for result in heavy]
    assert said[0].startswith("No interval holds: the law misses the points by more than")
    (cause,) = (w.cause for w in heavy[0].warnings if w.code == "model-misfit")
    rare = stats.t.sf(np.abs(heavy[0].materials[0].standardised), 4)
    rare = stats.norm.isf(
        np.maximum(rare, 0.05 / (2 * 27))
    )  # from the limit of outliers on all are alike
    expected = stats.chi2.sf(np.mean(rare**2) * heavy[0].materials[0].residual_degrees, 26)
    assert float(cause.split()[-1]) == pytest.approx(expected, rel=0.3)


@pytest.mark.parametrize(("velocity", "count"), [(0.99, 1), (0.9995, 0), (5.004, 0), (5.01, 1)])
def test_extrapolation_below_and_above(velocity, count):
    result = constant(np.array([1.0, -1.0, 0.0]), np.array([1.0, 2.0, 5.0]))
    found = result.extrapolation([2.0, velocity])
    assert (found is not None) == bool(count)
    assert found is None or found.code == "extrapolation"
    assert found is None or "1 velocities lie outside" in found.cause


@pytest.mark.parametrize(
    ("factor", "is_raised"), [(10, True), (2, False), (0.5, False), (0.1, True)]
)
@pytest.mark.parametrize(
    "options",
    [
        {"extra_scatter": True},
        {"scale_uncertainty": True},
        {"noise": "student-t"},
        {"noise": "student-t", "scale_uncertainty": True},
    ],
)
def test_scatter_far_from_what_was_stated_is_named_also_where_it_is_estimated(
    options, factor, is_raised
):
    """100 points of normal noise, u stated as a tenth to ten times it; a far too narrow t has a mode of its own."""
    noise, velocity = np.random.default_rng(3).standard_normal(100), np.linspace(1, 5, 100)
    data = cal.RestitutionData(velocity, 0.8 + 0.005 * noise, uncertainty=0.005 / factor)
    result = cal.fit(data, "constant", profiles=False, starts=1, **options)
    causes = [one.cause for one in result.warnings if one.code == "stated-uncertainty"]
    assert len(causes) == is_raised
    if is_raised:
        ratio = float(causes[0].removeprefix("the points scatter by ").split()[0])
        assert 0.5 < ratio / factor < 2


def test_a_set_has_its_own_warnings_and_those_of_what_it_shares_and_the_result_each_once():
    sets = [replace(straight(np.ones_like, stop=stop), name=f"to {stop}") for stop in (2.0, 4.0)]
    shared = {"restitution": Free(0.5, bounds=(0.3, 0.6), shared=True)}
    result = cal.fit(sets, "constant", shared, **QUICK)
    everything = [(w.code, w.material) for w in result.warnings]
    assert len(everything) == len(set(everything))
    own = [("residual-runs", "to 2.0"), ("residual-runs", "to 4.0")]
    assert [one for one in everything if one[0] in ("residual-runs", "at-bound")] == [
        *own,
        ("at-bound", None),
    ]
    for material, mine in zip(result.materials, own, strict=True):
        codes = [(w.code, w.material) for w in material.warnings]
        assert [one for one in codes if one in (*own, ("at-bound", None))] == [
            mine,
            ("at-bound", None),
        ]
