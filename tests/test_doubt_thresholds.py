"""Each doubt of a residual's or a curve's size, just on both sides of where it is raised."""

import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
from calibration.fitting import doubt
from calibration.fitting.left_out import LeaveOneOut
from calibration.fitting.profiles import Profile

SIDES = pytest.mark.parametrize(("by", "is_raised"), [(0.999, False), (1.001, True)])


@SIDES
def test_two_estimates_apart_by_two_of_their_errors(by, is_raised):
    apart = 2.0 * np.hypot(0.03, 0.04) * by
    found = doubt.disagreement("chi", (1.0, 0.03), (1.0 + apart, 0.04), "steel")
    assert (found is not None) == is_raised


@SIDES
@pytest.mark.parametrize("of_noise", [None, 7.0])
def test_a_misfit_that_noise_makes_once_in_a_hundred(by, is_raised, of_noise):
    limit = stats.chi2.ppf(0.99, 12) / 12 if of_noise is None else stats.f.ppf(0.99, 12, of_noise)
    found = doubt.misfit(by * limit, 12, of_noise, None)
    assert (found is not None) == is_raised


@SIDES
def test_a_misfit_against_scatter_is_an_f_test(by, is_raised):
    rms = 0.01 * np.sqrt(stats.f.ppf(0.99, 20, 18) * by)
    assert (doubt.misfit_against_scatter(rms, 0.01, 20, 18, None) is not None) == is_raised


def test_runs_are_wald_s_and_wolfowitz_s():
    """As few runs of ten and ten signs as chance makes in a hundred, and one more."""
    signs = {count: _with_runs(count) for count in range(2, 12)}
    mean, deviation = 11.0, np.sqrt(10 * 9 / 19)
    few = max(count for count in signs if stats.norm.cdf((count - mean) / deviation) < 0.01)
    velocity = np.arange(20.0)
    assert doubt.runs(velocity, signs[few], None) is not None
    assert doubt.runs(velocity, signs[few + 1], None) is None
    shuffled = np.random.default_rng(0).permutation(20)  # runs are along the velocity
    assert doubt.runs(velocity[shuffled], signs[few][shuffled], None) is not None
    assert doubt.runs(np.arange(9.0), np.repeat([1.0, -1.0], [5, 4]), None) is None
    assert doubt.runs(np.arange(10.0), np.repeat([1.0, -1.0], [5, 5]), None) is not None


def _with_runs(count):
    """Ten residuals of each sign in so many runs, the last ones long."""
    lengths = [[1] * ((count + 1 - k) // 2) for k in range(2)]
    for one in lengths:
        one[-1] += 10 - sum(one)
    runs = [(lengths[k % 2][k // 2], 1.0 - 2 * (k % 2)) for k in range(count)]
    return np.concatenate([np.full(n, sign) for n, sign in runs])


@pytest.mark.parametrize(("sizes", "word"), [(1, "grow"), (-1, "shrink")])
def test_which_way_the_scatter_goes_is_said(sizes, word):
    velocity = np.linspace(1, 5, 16)
    residual = velocity[::sizes] * np.where(np.arange(16) % 2, 1, -1)
    found = doubt.unequal_scatter(velocity, np.full(16, 0.8), residual, None)
    assert f"{word} with the velocity" in found.cause


def test_neighbours_are_alike_from_a_correlation_on():
    velocity = np.array([3.0, 1, 2, 5, 4, 6, 8, 7, 9, 10, 12, 11])
    critical = stats.norm.ppf(0.99) / np.sqrt(12)

    def residual(weight):
        return weight + np.where(np.arange(12) % 2, 1.0, -1.0)

    def correlation(weight):
        r = residual(weight)
        return np.sum(r[1:] * r[:-1]) / np.sum(r * r)

    level = optimize.brentq(lambda w: correlation(w) - critical, 1.0, 50.0)
    assert doubt.alike_neighbours(velocity, residual(0.99 * level), None) is None
    assert doubt.alike_neighbours(velocity, residual(1.01 * level), None) is not None
    assert doubt.alike_neighbours(np.sort(velocity), residual(2 * level), None) is None


@pytest.mark.parametrize(
    ("velocity", "count"), [(0.99, 1), (0.9995, 0), (1.0, 0), (5.0, 0), (5.004, 0), (5.01, 1)]
)
def test_extrapolation_below_and_above(velocity, count):
    data = cal.RestitutionData([1.0, 2.0, 5.0], [0.9, 0.8, 0.7])
    found = doubt.extrapolation([2.0, velocity], data)
    assert (found is not None) == bool(count)
    assert found is None or "1 velocities lie outside" in found.cause


@pytest.mark.parametrize(("factor", "wide"), [(np.exp(3.99), False), (np.exp(4.01), True)])
def test_an_interval_is_wide_from_four_standard_errors_on(factor, wide):
    assert doubt.is_wide(Profile("sigma", (), (), 0.5, 0.5 * factor, 3.84)) == wide
    assert doubt.is_wide(Profile("sigma", (), (), None, 0.5, 3.84))


@SIDES
def test_a_slope_within_its_error_is_none(by, is_raised):
    """By the t of a straight line's slope, as SciPy has it; raised where it is not told from 0."""
    velocity = np.linspace(1, 5, 9)
    noise = np.random.default_rng(2).standard_normal(9)
    noise -= np.polyval(np.polyfit(velocity, noise, 1), velocity)
    error = stats.linregress(velocity, noise + velocity).stderr
    slope = stats.t.ppf(0.975, 7) * error / by
    found = doubt.no_velocity_dependence(velocity, 0.8 + slope * velocity + noise, None, None)
    assert (found is not None) == is_raised


def test_what_is_left_out_together_scatters_together():
    """√m times the standard deviation of the folds' sums."""
    density = np.array([1.0, 2.0, 4.0, 8.0])
    zero = np.zeros(4)
    found = LeaveOneOut(zero, zero, density, np.array([0, 0, 1, 2]), True, True)
    assert found.elpd_se == pytest.approx(np.sqrt(3) * np.std([3.0, 4.0, 8.0], ddof=1), rel=1e-14)


def test_criteria_count_a_noise_that_is_estimated():
    """ln L of the mean of n numbers with the largest likelihood's variance: two numbers fitted."""
    e = 0.8 + 0.01 * np.random.default_rng(6).standard_normal(12)
    log = stats.norm.logpdf(e, np.mean(e), np.std(e)).sum()
    result = cal.fit(cal.RestitutionData(np.linspace(1, 3, 12), e), "constant", starts=1)
    assert result.log_likelihood == pytest.approx(log, rel=1e-9)
    assert result.aic == pytest.approx(4 - 2 * log, rel=1e-9)
    assert result.bic == pytest.approx(2 * np.log(12) - 2 * log, rel=1e-9)
