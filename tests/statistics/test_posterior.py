"""Draws from the posterior: against grids, other samplers and refits; what is said and made of them."""

import inspect
import json
import subprocess
import sys
import textwrap
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.command import run
from tests.decay import Decay
from tests.fit_data import twin
from tests.posterior_cases import az, blackjax, check_grid, made, needed, values_of, xarray

V = np.linspace(0.5, 4.0, 16)


def level(noise=0.07, **told):
    """Restitutions about 0.93, near enough to 1 for the range to act."""
    errors = noise * np.random.default_rng(1).standard_normal(len(V))
    return cal.RestitutionData(V, 0.93 + errors, **told)


@pytest.fixture(scope="module")
def result():
    return cal.fit(level(), sj.ConstantRestitution, profiles=False)


@pytest.fixture(scope="module")
def posterior(result):
    return result.posterior(draws=1000, chains=4, seed=1, warmup=500)


def test_moments_are_those_of_the_density_on_a_grid(posterior):
    """ε uniform on [0, 1] where its likelihood reaches beyond, noise half-normal of 0.1."""
    data = level()

    def log_density(restitution, noise):
        off = data.restitution[:, None, None] - restitution
        of_noise = stats.halfnorm.logpdf(noise, 0, 0.1)
        return np.sum(stats.norm.logpdf(off, 0, noise), axis=0) + of_noise

    axes = {"restitution": np.linspace(0.7, 1.0, 601), "noise": np.linspace(0.005, 0.3, 600)}
    check_grid(posterior, log_density, **axes)


def test_stated_and_default_priors_enter_as_documented():
    """rate: ln θ ~ N(ln start, 2²) by default; level: as stated, cut at 0; few points, so that both act."""
    v, e = np.array([1.0, 2.0]), np.array([0.85, 0.9])
    data = cal.RestitutionData(v, e, uncertainty=0.1)
    said = {"level": cal.Parameter(0.9, prior=(0.9, 0.05)), "rate": cal.Parameter(0.02)}
    fit = cal.fit(data, Decay, said, profiles=False, starts=1)
    draws = fit.posterior(draws=1000, chains=4, seed=2, warmup=500)

    def log_density(level, rate):
        curve = level * np.exp(-rate * v[:, None, None])
        likelihood = np.sum(stats.norm.logpdf(e[:, None, None], curve, 0.1), axis=0)
        of_rate = stats.norm.logpdf(np.log(rate), np.log(0.02), 2.0) - np.log(rate)
        return likelihood + stats.norm.logpdf(level, 0.9, 0.05) + of_rate

    rates = np.exp(np.linspace(np.log(1e-7), np.log(2), 3000))
    uneven = lambda a, b: log_density(a, np.exp(b)) + b  # noqa: E731
    draws["posterior"]["log_rate"] = np.log(draws["posterior"]["rate"])
    check_grid(draws, uneven, level=np.linspace(0.6, 1.2, 200), log_rate=np.log(rates))


def test_members_of_a_pool_have_the_density_of_the_hierarchy():
    """Constants, normal on the logit's scale: members integrated by 601 points, the rest on a grid."""
    means = 0.7 + 0.04 * np.random.default_rng(3).standard_normal(8)
    sets = [
        cal.RestitutionData(V[:4], m + 0.01 * np.array([1, -1, 1, -1]), uncertainty=0.04, name=n)
        for m, n in zip(means, "abcdefgh", strict=True)
    ]
    said = {"restitution": cal.Parameter(0.7, shared="pooled")}
    fit = cal.fit(sets, sj.ConstantRestitution, said, profiles=False, starts=1)
    draws = fit.posterior(draws=1000, chains=2, seed=3, warmup=500)
    nodes = np.linspace(
        -6, 6, 601
    )  # 40 of Gauss' miss the narrow likelihood where the spread is wide
    weights = stats.norm.pdf(nodes)

    def log_density(restitution, restitution_spread):
        logit = np.log(restitution / (1 - restitution))
        member = 1 / (1 + np.exp(-(logit[..., None] + restitution_spread[..., None] * nodes)))
        each = [stats.norm.pdf(m, member, 0.02) @ weights for m in means]  # of means of four
        return np.sum(np.log(each), axis=0) + stats.halfnorm.logpdf(restitution_spread, 0, 0.5)

    axes = {
        "restitution": np.linspace(0.5, 0.85, 120),
        "restitution_spread": np.linspace(0.01, 1.2, 120),
    }
    check_grid(draws, log_density, **axes)


def test_every_group_is_there_with_units_and_priors(posterior):
    found = posterior["posterior"]
    assert (found.sizes["chain"], found.sizes["draw"]) == (4, 1000)
    assert found["restitution"].attrs["prior"] == "uniform, 0 to 1"
    assert found["noise"].attrs["prior"] == "half-normal, 0.1"
    assert json.loads(found.attrs["priors"])["noise"] == "half-normal, 0.1"
    observed = posterior["observed_data"]["restitution"]
    np.testing.assert_array_equal(observed, level().restitution)
    np.testing.assert_array_equal(observed["velocity"], V)
    assert observed["velocity"].attrs["unit"] == "m/s"
    draws = [np.asarray(found[name])[..., None] for name in ("restitution", "noise")]
    expected = stats.norm.logpdf(level().restitution, *draws)
    np.testing.assert_allclose(posterior["log_likelihood"]["restitution"], expected, rtol=1e-9)
    predicted = np.asarray(posterior["posterior_predictive"]["restitution"])
    scatter = (predicted - draws[0]) / draws[1]
    assert stats.kstest(scatter.ravel()[::7], "norm").pvalue > 1e-3
    assert np.std(predicted) > 1.5 * np.std(draws[0])
    statistics = posterior["sample_stats"]
    assert 0.7 < float(statistics["acceptance_rate"].mean()) < 1.0
    assert not np.any(statistics["diverging"])


def test_equal_seeds_give_equal_draws(result, posterior):
    """However the threads went; another seed, and each chain, has draws of its own."""
    same, other = (result.posterior(draws=1000, seed=seed, warmup=500) for seed in (1, 2))
    one, same, other = (np.asarray(p["posterior"]["noise"]) for p in (posterior, same, other))
    np.testing.assert_array_equal(one, same)
    for k in range(4):
        assert np.mean(one[k] == other[k]) < 0.01
        assert all(np.mean(one[k] == one[j]) < 0.01 for j in range(k))


@pytest.mark.filterwarnings("ignore:The inplace keyword")  # ArviZ 0.23 with pandas 3.1
@pytest.mark.filterwarnings("ignore:Estimated shape")  # of a point that stands out
def test_arviz_leaves_points_out_as_refits_do(posterior, result):
    """PSIS over draws, against refits without each point."""
    found = az.loo(posterior)
    elpd = float(getattr(found, "elpd_loo", getattr(found, "elpd", np.nan)))
    assert abs(elpd - result.leave_one_out().elpd) < 0.35


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


def test_what_has_no_likelihood_or_nothing_unknown_has_no_posterior():
    fixed = {"restitution": 0.9}
    stated = cal.fit(level(uncertainty=0.05), sj.ConstantRestitution, fixed, profiles=False)
    with pytest.raises(ValueError, match="`parameters` must be one that is free, or noise"):
        stated.posterior()


# other samplers, on `cal.problem`, by the examples of its module's documentation


def example(which):
    """The n-th block of code that follows a line "With …"."""
    lines = inspect.cleandoc(sys.modules[cal.problem.__module__].__doc__).splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("With ")] + [len(lines)]
    first, last = list(pairwise(starts))[which]
    block = [line for line in lines[first + 1 : last] if line.startswith("    ") or not line]
    return textwrap.dedent("\n".join(block))


@pytest.fixture(scope="module")
def nylon():
    """Impacts above yield alone: they determine χ̃, ε_up and the noise; and logarithms as fitted."""
    data = twin("nylon", y=np.geomspace(1.3, 60.0, 20), noise=0.01)
    fit = cal.fit(data, profiles=False)
    found = {n: fit.estimates[n] for n in ("chi", "eps_up")}
    expected = {n: (np.log(e.value), e.standard_error / e.value) for n, e in found.items()}
    material = fit.materials[0]
    of_noise = np.log(material.noise), (2 * material.residual_degrees) ** -0.5
    return cal.problem(data), expected | {"noise": of_noise}


def check(draws, expected):
    """Within Monte Carlo error and what priors and the normal approximation are off by."""
    for name, (mean, deviation) in expected.items():
        log = np.log(np.asarray(draws[name]))
        error = deviation / float(az.ess(log[None])) ** 0.5
        assert abs(np.mean(log) - mean) < 5 * error + 0.25 * deviation
        assert np.std(log) == pytest.approx(deviation, rel=0.3)


@pytest.mark.long
def test_numpyro_samples_it(nylon):
    numpyro, (problem, expected) = needed("numpyro"), nylon
    names = {
        "numpyro": numpyro,
        "dist": numpyro.distributions,
        "MCMC": numpyro.infer.MCMC,
        "NUTS": numpyro.infer.NUTS,
        "jax": jax,
        "problem": problem,
    }
    exec(example(0).replace("NUTS(model)", "NUTS(model), progress_bar=False"), names)
    check(names["mcmc"].get_samples(), expected)


@pytest.mark.long
def test_blackjax_samples_it(nylon):
    names = {"jax": jax, "jnp": jnp, "blackjax": blackjax, "problem": nylon[0]}
    code, draws = example(1), []
    assert "state, info = step(key, state)" in code
    exec(code + "\n    draws.append(state.position)", names | {"draws": draws})
    assert len(draws) == 500
    every = {name: np.exp([float(one[name]) for one in draws]) for name in nylon[1]}
    check(every, nylon[1])


@pytest.mark.long
def test_emcee_finds_the_same():
    """NUTS and an ensemble of walkers on Zhou's density with stated priors: means and both tails."""
    emcee = needed("emcee")
    data = twin("nylon", noise=0.01, uncertainty=0.01)
    priors = {"chi": (0.22, 0.05), "sigma": (0.4, 0.1), "psi": (0.5, 0.1)}
    said = {name: cal.Parameter(prior=prior) for name, prior in priors.items()}
    ours = cal.fit(data, None, said, profiles=False).posterior(draws=2000, seed=0)
    problem = cal.problem(data, None, said)

    @jax.jit
    @jax.vmap
    def log_density(x):
        theta = dict(zip(priors, x, strict=True))
        prior = problem.log_prior(theta)
        safe = {n: jnp.where(jnp.isfinite(prior), v, priors[n][0]) for n, v in theta.items()}
        return prior + problem.log_likelihood(safe)

    other = emcee.EnsembleSampler(32, 3, lambda x: np.asarray(log_density(x)), vectorize=True)
    random = np.random.default_rng(0)
    start = np.array([p[0] for p in priors.values()]) * np.exp(
        0.1 * random.standard_normal((32, 3))
    )
    state = other.run_mcmc(start, 1000)
    other.reset()
    other.run_mcmc(state, 4000)
    for k, name in enumerate(priors):
        pair = np.asarray(ours["posterior"][name]), other.get_chain()[..., k].T
        apart = abs(np.mean(pair[0]) - np.mean(pair[1]))
        assert apart < 5 * np.hypot(*(float(az.mcse(one)) for one in pair)), name
        for share in (0.025, 0.975):
            error = [float(az.mcse(one, method="quantile", prob=share)) for one in pair]
            apart = abs(np.quantile(pair[0], share) - np.quantile(pair[1], share))
            assert apart < 5 * np.hypot(*error), (name, share)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_the_valley_of_sigma_and_psi_is_sampled(seed):
    """10 points below yield and 20 above, noise 0.01: at most 0.5 % of the draws diverge."""
    fit = cal.fit(twin("stainless steel", noise=0.01, seed=seed), profiles=False)
    check_converged(fit.posterior(seed=seed))


def check_converged(data):
    assert np.mean(data["sample_stats"]["diverging"]) <= 0.005
    for name, draws in data["posterior"].data_vars.items():
        assert float(az.rhat(np.asarray(draws))) < 1.01, name


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_the_ridge_of_drops_far_above_yield_is_sampled(seed):
    """A bronze ball dropped on steel, heights to 2 mm: χ̃ and ε_up only together, χ̃ skewed.

    The density is that on a grid along the ridge; and the statistics have its parts.
    """
    metal = sj.Material(115e9, 0.33, 7600.0, 300e6), sj.Material(210e9, 0.3, 7850.0, 355e6)
    contact = sj.Contact.with_wall(*metal, radius=0.006)
    height, random = np.repeat(np.linspace(0.05, 1.0, 13), 2), np.random.default_rng(seed)
    v = np.sqrt(2 * 9.80665 * height)
    curve = np.asarray(sj.restitution(zhou_of(5.6, 0.93, contact), v).coefficient)
    drop, back = (h + 0.002 * random.standard_normal(26) for h in (height, curve**2 * height))
    table = {"drop_height": drop, "rebound_height": back}
    data = cal.RestitutionData.from_table(table, contact, height_uncertainty=0.002)
    fit = cal.fit(data, profiles=False)
    found = fit.posterior(seed=seed)
    check_converged(found)
    problem, draws = cal.problem(data), found["posterior"]
    along = np.linspace(-1, 1, 241)
    logit = np.log(draws["eps_up"] / (1 - draws["eps_up"])).values.ravel()
    log_chi = np.log(draws["chi"]).values.ravel()
    x = np.linspace(np.min(logit) - 0.5, np.max(logit) + 1.0, 120)
    ridge = np.polyval(np.polyfit(logit, log_chi, 7), x.clip(np.min(logit), np.max(logit)))
    y = (
        ridge[:, None]
        + 6 * np.std(log_chi - np.polyval(np.polyfit(logit, log_chi, 7), logit)) * along
    )
    theta = {"chi": np.exp(y), "eps_up": np.broadcast_to(1 / (1 + np.exp(-x[:, None])), y.shape)}
    ln = np.array(jax.jit(jax.vmap(jax.vmap(problem.log_likelihood)))(theta))
    ln += np.log(theta["eps_up"] * (1 - theta["eps_up"]))
    ln -= 0.5 * ((y - np.log(problem.start["chi"])) / 3) ** 2
    weight = np.exp(ln - np.max(ln))
    weight /= np.sum(weight)
    mean = np.sum(weight * y)
    width = np.sum(weight * (y - mean) ** 2) ** 0.5
    assert np.mean(log_chi) == pytest.approx(mean, abs=0.15 * width)
    assert np.std(log_chi) == pytest.approx(width, rel=0.12)
    statistics = found["sample_stats"]
    expected = statistics["lp"] - statistics["log_prior"] - statistics["log_jacobian"]
    at = {name: np.asarray(draws[name])[0, :50] for name in theta}
    told = np.asarray(jax.vmap(problem.log_likelihood)(at))
    np.testing.assert_allclose(np.asarray(expected)[0, :50], told, rtol=1e-9, atol=1e-9)


# simulation-based calibration: Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv:1804.06788 (2018)


def check_uniform(ranks, of):
    """χ² of ten bins and the largest distance of the distribution function, at 99 % for all together."""
    level = 1 - 0.01 / len(ranks)
    for label, found in ranks.items():
        bins = np.histogram(found, np.linspace(-0.5, of + 0.5, 11))[0]
        squares = np.sum((bins - len(found) / 10) ** 2) * 10 / len(found)
        assert squares < stats.chi2.ppf(level, 9), (label, bins)
        apart = stats.kstest((np.array(found) + 0.5) / (of + 1), "uniform").statistic
        assert apart < stats.kstwo.ppf(level, len(found)), (label, apart)


def zhou_of(chi, eps_up, contact=None):
    contact = twin("stainless steel").contact if contact is None else contact
    ratio = contact.critical_velocity / (contact.limit_velocity - contact.critical_velocity)
    return sj.Zhou(contact, chi, -np.log(eps_up) / ratio**0.5, 0.5)


CALIBRATED = {  # law, priors, velocities, noise
    "decay": (Decay, Decay, {"level": (0.9, 0.05), "rate": (0.1, 0.02)}, V, 0.02),
    "zhou": (
        zhou_of,
        "zhou",
        {"chi": (1.8, 0.3), "eps_up": (0.97, 0.01)},
        np.geomspace(1.5, 200.0, 20)
        * float(twin("stainless steel", [2.0]).contact.critical_velocity),
        0.01,
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("case", CALIBRATED)
def test_the_truth_s_rank_among_the_draws_is_uniform(case):
    """150 truths from the priors, noise stated: a width off by a fifth is noticed in 9 of 10."""
    build, law, priors, velocity, noise = CALIBRATED[case]
    random, ranks = np.random.default_rng(0), {name: [] for name in priors}
    said = {name: cal.Parameter(prior=prior) for name, prior in priors.items()}
    for k in range(150):
        truth = {name: np.exp(100.0) for name in priors}
        while truth.get("eps_up", 0.5) >= 1 or min(truth.values()) <= 0 or max(truth.values()) > 99:
            truth = {name: random.normal(*prior) for name, prior in priors.items()}
        curve = np.asarray(sj.restitution(build(**truth), velocity).coefficient)
        measured = np.abs(curve + noise * random.standard_normal(len(curve)))
        contact = getattr(build(**truth), "contact", None)
        data = cal.RestitutionData(velocity, measured, contact, uncertainty=noise)
        fit = cal.fit(data, law, said, profiles=False, starts=1)
        draws = fit.posterior(draws=1000, chains=1, seed=k, warmup=400)
        for name, value in truth.items():
            ranks[name].append(int(np.sum(values_of(draws, name)[::10] < value)))
    check_uniform(ranks, 100)


# what is made of draws that were made here, against NumPy on the same draws

VELOCITY = np.array([0.7, 1.5, 3.9])
MEASURED = np.linspace(0.5, 4.0, 12)


def drawn(**variables):
    """ArviZ data of 2 chains of 300 draws of each (mean, standard deviation)."""
    random = np.random.default_rng(0)
    dims = ("chain", "draw")
    draws = {n: (dims, m + s * random.standard_normal((2, 300))) for n, (m, s) in variables.items()}
    return made(posterior=xarray.Dataset(draws))


@pytest.fixture(scope="module")
def decay():
    errors = 0.02 * np.random.default_rng(0).standard_normal(len(MEASURED))
    data = cal.RestitutionData(MEASURED, 0.92 * np.exp(-0.3 * MEASURED) + errors)
    return cal.fit(data, Decay, profiles=False)


@pytest.fixture(scope="module")
def draws():
    return drawn(level=(0.92, 0.02), rate=(0.3, 0.04), noise=(0.05, 0.002))


def test_a_band_of_draws_is_their_quantiles(decay, draws):
    rates = values_of(draws, "rate")[:, None]
    curves = values_of(draws, "level")[:, None] * np.exp(-rates * VELOCITY)
    found = decay.band(VELOCITY, confidence=0.8, draws=draws)
    np.testing.assert_allclose(found.coefficient, np.mean(curves, axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.low, np.quantile(curves, 0.1, axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.high, np.quantile(curves, 0.9, axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.standard_error, np.std(curves, axis=0, ddof=1), rtol=1e-10)
    more = decay.band(VELOCITY, kind="prediction", draws=draws).standard_error
    np.testing.assert_allclose(more, np.hypot(found.standard_error, 0.05), rtol=0.1)
    for confidence in (95, 0):
        with pytest.raises(ValueError, match="`confidence` must be between 0 and 1"):
            decay.band(VELOCITY, confidence=confidence, draws=draws)
    with pytest.raises(ValueError, match="`draws` must be of the posterior of this fit"):
        decay.band(VELOCITY, draws=drawn(restitution=(0.9, 0.01)))


def test_a_fit_at_draws_has_their_laws(decay, draws):
    fits, which = decay.at_draws(draws, 3), [0, 300, 599]
    for name in ("rate", "level"):
        found = [getattr(f.law, name) for f in fits]
        np.testing.assert_array_equal(found, values_of(draws, name)[which])
    with pytest.raises(ValueError, match="`count` must be a whole number from 1 to 600"):
        decay.at_draws(draws, 601)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A fit of a constant and draws, as the commands read them; and the draws."""
    folder = tmp_path_factory.mktemp("draws")
    cal.fit(level(), sj.ConstantRestitution, profiles=False).save(folder / "fit.json")
    data = drawn(restitution=(0.8, 0.03), noise=(0.05, 0.002))
    data.to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    (folder / "other.nc").write_text("no netCDF")
    given = ("--fit", folder / "fit.json", "--posterior", folder / "posterior.nc")
    return folder, given, values_of(data, "restitution")


def test_the_curve_s_band_is_that_of_the_draws(files):
    folder, given, values = files
    where = (
        "--from",
        "1",
        "--to",
        "2",
        "--points",
        "3",
        "--format",
        "csv",
        "--out",
        folder / "out",
    )
    assert run("curve", *given, *where)[0] == 0
    rows = (folder / "out" / "curve.csv").read_text().splitlines()
    assert rows[0].startswith("velocity [m/s],restitution,restitution_low,restitution_high")
    _, *numbers = (float(cell) for cell in rows[1].split(",")[:4])
    expected = [np.mean(values), *np.quantile(values, [0.025, 0.975])]
    np.testing.assert_allclose(numbers, expected, rtol=1e-12)
    code, _, err = run("curve", *given[:3], folder / "other.nc", "--out", folder / "no")
    assert code == 2
    assert "other.nc: no draws can be read" in err


def test_sensitivities_and_designs_are_over_the_draws(files):
    """θ ∂ε/∂θ of a constant is ε itself."""
    folder, given, values = files
    code, out, _ = run("sensitivity", *given, "--out", folder / "local")
    assert code == 0
    table = json.loads((folder / "local" / "sensitivity.json").read_text())["local"]["limits"]
    chosen = values[np.linspace(0, 599, 200).round().astype(int)]
    low, high = np.quantile(chosen, [0.025, 0.975])
    np.testing.assert_allclose(table["restitution"], [[low] * 3, [high] * 3], rtol=1e-12)
    told = ("--study", "design", "--shots", "2", "--out", folder / "design")
    code, out, _ = run("sensitivity", *given, *told)
    assert code == 0
    assert "on average over 16 draws of the posterior: c-optimal" in out


@pytest.mark.parametrize("command", ["curve", "sensitivity"])
def test_draws_without_their_fit_are_refused(command, files):
    words = ("--posterior", files[0] / "posterior.nc", "--out", files[0] / "none")
    code, _, err = run(command, "nylon", *words)
    assert code == 2
    assert "`--posterior` must be given with --fit, whose draws they are" in err


# the command


def sampled(folder, values, draws, *words):
    """What `softjax fit --posterior` prints and writes of some restitutions."""
    rows = [f"{v},{e}" for v, e in enumerate(values, 1)]
    (folder / "a.csv").write_text("velocity [m/s],restitution\n" + "\n".join(rows))
    (folder / "a.toml").write_text(
        '[[material]]\nname = "balls"\ndata = "a.csv"\n' + "".join(words)
    )
    out = folder / f"results {draws}"
    told = ("--law", "constant", "--posterior", str(draws), "--no-profiles", "--out", out)
    code, printed, err = run("fit", folder / "a.toml", *told)
    assert (code, err) == (0, "")
    return printed, out


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    folder = tmp_path_factory.mktemp("posterior")
    return sampled(folder, 0.8 + 0.02 * np.random.default_rng(0).standard_normal(12), 100)


def test_the_command_writes_draws_picture_and_words(command):
    printed, out = command
    assert {"posterior.nc", "posterior.png"} <= {path.name for path in out.iterdir()}
    with xarray.open_dataset(out / "posterior.nc", group="posterior", engine="h5netcdf") as found:
        assert dict(found.sizes) == {"chain": 4, "draw": 100}
        draws = np.asarray(found["restitution"])
    report = (out / "report.md").read_text(encoding="utf-8")
    section = report[report.index("## Posterior") :]
    assert "4 chains of 100 draws by NUTS (blackjax" in section
    assert "![Draws from the posterior, and the fit with its intervals](posterior.png)" in report
    assert f"{np.mean(draws):.4f}"[:5] in section
    assert "Posterior:\n" in printed
    assert "posterior/prior width" in printed
    for code in ("divergences", "funnel", "mass-at-bound", "follows-prior"):
        assert code not in section


def test_the_command_says_what_is_wrong_with_the_draws(tmp_path):
    """Few draws; mass at ε = 1; a prior that says all."""
    near = 0.999 + 0.02 * np.random.default_rng(2).standard_normal(12).clip(-1, 0.04)
    report = (sampled(tmp_path, near, 100)[1] / "report.md").read_text(encoding="utf-8")
    assert "**effective-size**" in report
    assert "**mass-at-bound**" in report
    narrow = "[material.parameters]\nrestitution = { prior = [0.9, 0.0001] }\n"
    scattered = 0.9 + 0.02 * np.random.default_rng(2).standard_normal(12)
    report = (sampled(tmp_path, scattered, 100, narrow)[1] / "report.md").read_text("utf-8")
    assert "**follows-prior**" in report
    assert "**mass-at-bound**" not in report


def test_the_command_refuses_what_has_no_posterior_before_it_fits(tmp_path):
    code, out, err = run("fit", "--posterior", "--out", tmp_path / "results")
    assert (code, out) == (2, "")
    assert err.startswith("`objective` must be model for a posterior: it has a likelihood")
    assert not (tmp_path / "results").exists()


# without the packages of the extra

ABSENT = (
    "a posterior needs blackjax, which is not installed; "
    'install it with pip install -e ".[bayes]" in its folder'
)


def test_what_to_install_is_said_before_anything_is_fitted(result, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "blackjax", None)  # as where it was never installed
    with pytest.raises(ImportError) as caught:
        result.posterior()
    assert str(caught.value) == ABSENT
    words = ("--objective", "model", "--posterior", "--out", tmp_path / "results")
    assert run("fit", *words) == (2, "", ABSENT + "\n")
    assert not (tmp_path / "results").exists()


def test_nothing_else_imports_them():
    code = (
        "import sys, calibration as cal\n"
        "cal.fit(cal.RestitutionData([1.0, 2.0, 3.0], [0.9, 0.88, 0.89])).leave_one_out()\n"
        "[getattr(cal, name) for name in dir(cal)]\n"
        "print(sorted({'blackjax', 'arviz', 'xarray'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
