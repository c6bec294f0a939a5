"""Zhou's law with few points below yield: the valley of σ and ψ, and another sampler on the same density."""

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
from calibration.fitting.posterior.coordinates import Scaling
from calibration.fitting.posterior.density import density_of
from calibration.fitting.posterior.diagnostics import summaries
from calibration.fitting.posterior.inference_data import dataset_of
from calibration.fitting.posterior.nuts import Sampler
from calibration.fitting.traceable import traceable
from calibration.report.posterior import known
from tests.fit_data import twin
from tests.posterior_cases import az, needed

SURE = 5.0  # Monte Carlo standard errors
WALKERS, STEPS = 32, 8000


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_the_valley_is_sampled_and_told(seed):
    """10 points below yield and 20 above, noise 0.01: σ and ψ are not told, what they make is."""
    result = cal.fit(twin("stainless steel", noise=0.01, seed=seed), profiles=False)
    data = result.posterior(seed=seed)
    assert np.sum(dataset_of(data, "sample_stats")["diverging"]) <= 4  # 1 in 1000 draws
    words = " ".join(known(summaries(data)))
    assert "The data tell χ̃ = " in words
    assert "The data do not tell σ (" in words or "The data narrow σ (" in words
    assert "at the critical velocity it is ε_up, which is told" in words


@pytest.fixture(scope="module")
def density():
    """Of nylon's twin: scaled, and with its measurements."""
    data = twin("nylon", noise=0.01)
    result = cal.fit(data, profiles=False)
    found, scaling = density_of(traceable(result.request), result.fits)
    return found, (Scaling(*map(jnp.asarray, scaling)), jnp.asarray(data.restitution))


def physical(density, arrays, u):
    """ln θ of draws u (chains, draws, p), by name."""
    theta = jax.jit(jax.vmap(lambda u: density.theta(density.z(u, arrays[0])[0])))
    found = theta(u.reshape(-1, u.shape[-1]))
    return {name: np.log(np.asarray(v)).reshape(u.shape[:2]) for name, v in found.items()}


@pytest.mark.long
def test_emcee_finds_the_same_and_takes_longer(density):
    """Both on one compiled density; effective samples a second of processor time, warm-up aside."""
    emcee = needed("emcee")
    density, arrays = density
    count, random = len(density.labels), np.random.default_rng(0)
    sampler = Sampler(density.log_density, 0.8)
    starts = random.standard_normal((4, count))
    sampler.run(starts, arrays, 100, 1000, 0)
    times = []
    for draws in (100, 4100):
        begun = time.process_time()
        chains = sampler.run(starts, arrays, draws, 1000, 0)
        times.append(time.process_time() - begun)
    ours = physical(density, arrays, np.stack([chain.draws[-4000:] for chain in chains]))
    log_density = jax.jit(jax.vmap(lambda u: density.log_density(u, *arrays)))
    other = emcee.EnsembleSampler(
        WALKERS, count, lambda x: np.asarray(log_density(x)), vectorize=True
    )
    state = other.run_mcmc(random.standard_normal((WALKERS, count)), 1000)
    other.reset()
    begun = time.process_time()
    other.run_mcmc(state, STEPS)
    its_time = time.process_time() - begun
    its = physical(density, arrays, other.get_chain().transpose(1, 0, 2))
    rates = []
    for draws, spent in ((ours, times[1] - times[0]), (its, its_time)):
        rates.append(min(float(az.ess(v)) for v in draws.values()) / spent)
    for name in ours:
        quantities = (
            ("mean", lambda v: np.mean(v), lambda v: float(az.mcse(v))),
            (0.025, lambda v: np.quantile(v, 0.025), lambda v: quantile_error(v, 0.025)),
            (0.975, lambda v: np.quantile(v, 0.975), lambda v: quantile_error(v, 0.975)),
        )
        for what, of, error in quantities:
            apart = abs(of(ours[name]) - of(its[name]))
            sure = SURE * np.hypot(error(ours[name]), error(its[name]))
            assert apart < sure, (name, what)
    print(f"effective samples a second: NUTS {rates[0]:.0f}, emcee {rates[1]:.0f}")
    assert rates[0] > 5 * rates[1]  # 13 and more, measured on a machine with other work


def quantile_error(values, probability):
    return float(az.mcse(values, method="quantile", prob=probability))
