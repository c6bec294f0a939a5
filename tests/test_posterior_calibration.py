"""Simulation-based calibration: the truth's rank among the draws is uniform, prior draw after prior draw.

Source: Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv:1804.06788 (2018).
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration.fitting.posterior.coordinates import Scaling
from calibration.fitting.posterior.density import density_of
from calibration.fitting.posterior.nuts import Sampler
from calibration.fitting.posterior.priors import Prior, priors_of
from calibration.fitting.traceable import traceable
from tests.decay import Decay
from tests.fit_data import pair, twin
from tests.posterior_cases import V

DRAWS, THIN, WARMUP, BINS = 1000, 10, 400, 10


def truths(priors, count, random):
    """θ drawn from the priors, {label: (count,)}; members of pools around their mean."""
    drawn = {
        one.label: _of_prior(one, k, priors, count, random) for k, one in enumerate(priors.each)
    }
    for pool in priors.pools:
        mean, spread = (drawn[priors.each[k].label] for k in (pool.mean, pool.spread))
        for member in pool.members:
            factor = np.exp(spread * random.standard_normal(count))
            drawn[priors.each[member].label] = mean * factor
    return drawn


def _of_prior(one, k, priors, count, random):
    low, high = priors.transform.lower[k], priors.transform.upper[k]
    if np.isinf(one.spread):  # a member of a pool, or uniform
        return random.uniform(low, high, count) if np.isfinite(high) else np.ones(count)
    if one.in_z:
        return low + np.exp(one.centre + one.spread * random.standard_normal(count))
    ends = (low - one.centre) / one.spread, (high - one.centre) / one.spread
    return stats.truncnorm.rvs(*ends, one.centre, one.spread, size=count, random_state=random)


def ranks(sets, law, said, count, seed=0, told=()):
    """How many of 100 draws lie below the truth, {label: (count,)}; one program for all data sets.

    Args:
        told: priors in place of the default ones.
    """
    result = cal.fit(sets, law, said, profiles=False)
    problem = traceable(result.request)
    priors = priors_of(problem)
    by_label = {one.label: one for one in told}
    priors = replace(priors, each=tuple(by_label.get(one.label, one) for one in priors.each))
    density, scaling = density_of(problem, result.fits, priors)
    scaling = Scaling(*map(jnp.asarray, scaling))
    random = np.random.default_rng(seed)
    drawn = truths(priors, count, random)
    points = sum(len(one.data) for one in problem.sets)
    simulated = jax.jit(problem.simulated)
    theta_of = jax.jit(jax.vmap(lambda u: density.theta(density.z(u, scaling)[0])))
    sampler = Sampler(density.log_density)
    below = {label: [] for label in drawn}
    for k in range(count):
        theta = {label: values[k] for label, values in drawn.items()}
        measured = simulated(theta, random.standard_normal(points))
        start = random.standard_normal((1, len(drawn)))
        (chain,) = sampler.run(start, (scaling, measured), DRAWS, WARMUP, seed * count + k)
        kept = theta_of(chain.draws[::THIN])
        for label in below:
            below[label].append(int(np.sum(np.asarray(kept[label]) < theta[label])))
    return {label: np.array(found) for label, found in below.items()}


def check_uniform(found):
    """χ² of ten bins and the largest distance of the distribution function, both at 99 % for all together."""
    level = 1 - 0.01 / len(found)
    for label, rank in found.items():
        count, most = len(rank), DRAWS // THIN
        bins = np.histogram(rank, np.linspace(-0.5, most + 0.5, BINS + 1))[0]
        squares = np.sum((bins - count / BINS) ** 2) * BINS / count
        assert squares < stats.chi2.ppf(level, BINS - 1), (label, bins)
        apart = stats.kstest((rank + 0.5) / (most + 1), "uniform").statistic
        assert apart < stats.kstwo.ppf(level, count), (label, apart)


def decaying(name="data", count=16):
    v = V[:count]
    errors = 0.02 * np.cos(5 * np.arange(count))
    return cal.RestitutionData(v, 0.9 * np.exp(-0.1 * v) + errors, name=name)


def test_ranks_are_uniform_quickly():
    """A law in closed form with all kinds of priors: normal, log-normal, half-normal."""
    said = {"level": cal.Parameter(prior=(0.9, 0.05))}
    told = [Prior("rate", "", True, np.log(0.1), 0.7)]
    check_uniform(ranks(decaying(), Decay, said, 60, told=told))


@pytest.mark.long
def test_ranks_of_zhou_s_law_are_uniform():
    data = twin("stainless steel", y=np.geomspace(1.5, 200.0, 20), noise=0.01)
    said = {"chi": cal.Parameter(prior=(1.8, 0.3)), "eps_up": cal.Parameter(prior=(0.97, 0.02))}
    found = ranks(data, None, said, 200)
    assert set(found) == {"chi", "eps_up", "noise"}
    check_uniform(found)


@pytest.mark.long
def test_ranks_of_a_viscoelastic_contact_are_uniform():
    velocity = np.geomspace(0.05, 2.0, 12)
    law = sj.ViscoelasticHertz(pair("nylon"), dissipation_time=4e-6)
    curve = np.asarray(sj.restitution(law, velocity).coefficient)
    data = cal.RestitutionData(velocity, curve + 0.01 * np.cos(np.arange(12)), pair("nylon"))
    said = {"dissipation_time": cal.Parameter(prior=(4e-6, 8e-7))}
    check_uniform(ranks(data, sj.ViscoelasticHertz, said, 200))


@pytest.mark.long
def test_ranks_of_five_pooled_specimens_are_uniform():
    sets = [
        cal.RestitutionData(
            one.velocity, one.restitution + 0.01 * k, name=one.name, uncertainty=0.02
        )
        for k, one in enumerate(decaying(name, 8) for name in "abcde")
    ]
    said = {"rate": cal.Parameter(shared="pooled"), "level": cal.Parameter(prior=(0.9, 0.03))}
    told = [
        Prior("rate", "", True, np.log(0.1), 0.3),
        Prior("rate_spread", "", False, 0.0, 0.3),
    ]
    found = ranks(sets, Decay, said, 200, told=told)
    assert {"rate", "rate_spread", "rate[a]"} <= set(found)
    check_uniform(found)
