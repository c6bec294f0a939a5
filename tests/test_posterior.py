"""Draws from the posterior: against integrals on a grid, and what ArviZ makes of them."""

import json

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration.fitting.posterior.inference_data import dataset_of, read, write
from tests.posterior_cases import V, az, level, moments, on_grid

SURE = 5.0  # Monte Carlo standard errors


@pytest.fixture(scope="module")
def result():
    return cal.fit(level(), sj.ConstantRestitution, profiles=False)


@pytest.fixture(scope="module")
def posterior(result):
    return result.posterior(draws=1000, chains=4, seed=1, warmup=500)


def test_moments_are_those_of_the_density_on_a_grid(posterior):
    """ε uniform on [0, 1] where its likelihood reaches beyond, noise half-normal of 0.1.

    Without the Jacobian of either transform a mean is off by more than 10 of these errors.
    """
    data = level()

    def log_density(restitution, noise):
        off = data.restitution[:, None, None] - restitution
        return np.sum(stats.norm.logpdf(off, 0, noise), axis=0) + stats.halfnorm.logpdf(
            noise, 0, 0.1
        )

    axes = np.linspace(0.7, 1.0, 601), np.linspace(0.005, 0.3, 600)
    found = dataset_of(posterior, "posterior")
    for name, expected in zip(("restitution", "noise"), on_grid(log_density, *axes), strict=True):
        mean, error, deviation, its_error = moments(found[name])
        assert abs(mean - expected[0]) < SURE * error
        assert abs(deviation - expected[1]) < SURE * its_error
        assert error < 0.05 * expected[1]


def test_every_group_is_there_with_units_and_priors(posterior):
    found = dataset_of(posterior, "posterior")
    assert dict(found.sizes) == {"chain": 4, "draw": 1000}
    assert found["restitution"].attrs["prior"] == "uniform, 0 to 1"
    assert found["noise"].attrs["prior"] == "half-normal, 0.1"
    assert json.loads(found.attrs["priors"])["noise"] == "half-normal, 0.1"
    observed = dataset_of(posterior, "observed_data")["restitution"]
    np.testing.assert_array_equal(observed, level().restitution)
    np.testing.assert_array_equal(observed["velocity"], V)
    assert observed["velocity"].attrs["unit"] == "m/s"
    draws = np.asarray(found["restitution"])[..., None], np.asarray(found["noise"])[..., None]
    expected = stats.norm.logpdf(level().restitution, *draws)
    of_points = dataset_of(posterior, "log_likelihood")["restitution"]
    np.testing.assert_allclose(of_points, expected, rtol=1e-9)
    predicted = np.asarray(dataset_of(posterior, "posterior_predictive")["restitution"])
    scatter = (predicted - draws[0]) / draws[1]
    assert stats.kstest(scatter.ravel()[::7], "norm").pvalue > 1e-3
    statistics = dataset_of(posterior, "sample_stats")
    assert 0.7 < float(statistics["acceptance_rate"].mean()) < 1.0
    assert not np.any(statistics["diverging"])


def test_equal_seeds_give_equal_draws(result, posterior):
    """However the threads went; another seed, and each chain, has draws of its own."""
    seeds = [result.posterior(draws=1000, seed=seed, warmup=500) for seed in (1, 2)]
    one, same, other = (
        np.asarray(dataset_of(p, "posterior")["noise"]) for p in (posterior, *seeds)
    )
    np.testing.assert_array_equal(one, same)
    assert np.all(one[:, -1] != other[:, -1])
    assert np.all(one[0] != one[1])


@pytest.mark.filterwarnings("ignore:The inplace keyword")  # ArviZ 0.23 with pandas 3.1
def test_arviz_leaves_points_out_as_refits_do(posterior, result):
    """PSIS over draws, against refits without each point: elpd, and differences of laws."""
    refits = result.leave_one_out()
    found = az.loo(posterior)
    elpd = float(getattr(found, "elpd_loo", getattr(found, "elpd", np.nan)))
    assert abs(elpd - refits.elpd) < 0.35
    compared = az.compare({"constant": posterior, "again": posterior})
    assert len(compared) == 2


def test_a_file_holds_it_all(posterior, tmp_path):
    write(posterior, tmp_path / "posterior.nc")
    again = read(tmp_path / "posterior.nc")
    for group in ("posterior", "log_likelihood", "posterior_predictive", "observed_data"):
        for name, values in dataset_of(posterior, group).data_vars.items():
            np.testing.assert_array_equal(dataset_of(again, group)[name], values)
    assert dataset_of(again, "posterior")["noise"].attrs["prior"] == "half-normal, 0.1"
    (tmp_path / "other.nc").write_text("no netCDF")
    with pytest.raises(cal.InputError, match=r"other.nc: no draws can be read.*posterior.nc that"):
        read(tmp_path / "other.nc")


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"draws": 0}, "`draws` must be a whole number >= 4"),
        ({"chains": 1.5}, "`chains` must be a whole number >= 1"),
        ({"warmup": 3}, "`warmup` must be a whole number >= 50"),
    ],
)
def test_counts_that_make_no_sense_are_refused(result, told, message):
    with pytest.raises(ValueError, match=message):
        result.posterior(**told)


def test_what_was_no_likelihood_has_no_posterior():
    robust = cal.fit(level(), sj.ConstantRestitution, loss="huber", profiles=False)
    with pytest.raises(ValueError, match="`loss` must be squared for a posterior, but is huber"):
        robust.posterior()


def test_nothing_unknown_has_no_posterior():
    fixed = {"restitution": 0.9}
    stated = cal.fit(level(uncertainty=0.05), sj.ConstantRestitution, fixed, profiles=False)
    with pytest.raises(ValueError, match="`parameters` must be one that is free, or noise"):
        stated.posterior()
