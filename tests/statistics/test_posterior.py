"""Draws from the posterior: against grids, other samplers and refits; what is said and made of them."""

import importlib
import json
import os
import re
import sys
import warnings
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration.plots import correlation_figure, posterior_figure
from tests.command import run
from tests.coverage.test_coverage import drops
from tests.decay import Decay
from tests.fit_data import twin
from tests.shown.capture import legend, line
from tests.shown.tables import markdown_tables


def needed(name):
    """A package of the extra; where it has to be there its absence fails, else it skips."""
    try:
        return importlib.import_module(name)
    except FileNotFoundError:  # ArviZ notes the day in a file, which two workers replace at once
        return importlib.import_module(name)
    except ModuleNotFoundError:
        if "SOFTJAX_TEST_EXTRAS" in os.environ:
            raise
        pytest.skip("pip install softjax-contact[test-bayes]", allow_module_level=True)


with warnings.catch_warnings():
    warnings.simplefilter("ignore", FutureWarning)  # ArviZ 0.23 announces 1.0
    blackjax, az, xarray = needed("blackjax"), needed("arviz"), needed("xarray")


def made(**groups):
    """Groups of xarray data sets as what this ArviZ works on."""
    if az.__version__.startswith("0."):
        return az.InferenceData(**groups)
    return xarray.DataTree.from_dict(groups)


def values_of(data, name):
    """All draws of one variable, chain after chain."""
    return np.ravel(np.asarray(data["posterior"][name]))


def moments(draws):
    """Mean and standard deviation of draws (chains, draws), with the Monte Carlo errors of both."""
    draws = np.asarray(draws)
    spread = (draws - np.mean(draws)) ** 2
    deviation = np.std(draws)
    error = np.std(spread) / (2 * deviation) / float(az.ess(spread)) ** 0.5
    return np.mean(draws), deviation / float(az.ess(draws)) ** 0.5, deviation, error


def check_grid(draws, log_density, **axes):
    """Draws' moments are those of the density on a grid, within 5 Monte Carlo errors, known to 7 %."""
    grid = np.meshgrid(*axes.values(), indexing="ij")
    density = log_density(*grid)
    weight = np.exp(density - np.max(density))
    weight /= np.sum(weight)
    for name, values in zip(axes, grid, strict=True):
        expected = np.sum(weight * values)
        width = np.sum(weight * (values - expected) ** 2) ** 0.5
        mean, error, deviation, its_error = moments(draws[name])
        assert error < 0.07 * width, name
        assert abs(mean - expected) < 5 * error, name
        assert abs(deviation - width) < 5 * its_error, name


V = np.linspace(0.5, 4.0, 16)
THREE = ("logit", "log_power", "noise")


class Ridge(sj.HardSphereLaw):
    """ε = c^{b (1 + v/10)}, c and b only together, b^{ln c} that is; positive both."""

    base: float = sj.number_field("c", within="(0, 1)", default=0.9)
    power: float = sj.number_field("b", within="(0, inf)", default=1.0)

    def restitution_squared(self, velocity):
        return jnp.exp(2 * self.power * jnp.log(self.base) * (1 + 0.1 * velocity))


def ridge():
    """Along -b ln c = 0.3."""
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(V))
    return cal.RestitutionData(V, np.exp(-0.3 * (1 + 0.1 * V)) + noise)


@pytest.fixture(scope="module")
def result():
    parameters = {"base": cal.Parameter(0.8), "power": cal.Parameter(1.3)}
    return cal.fit(ridge(), Ridge, parameters, profiles=False, starts=1)


TOLD = {"draws": 1000, "chains": 2, "warmup": 500}


@pytest.fixture(scope="module")
def posterior(result):
    return result.posterior(seed=1, **TOLD)


def check_converged(data):
    assert np.mean(data["sample_stats"]["diverging"]) <= 0.005
    for name, draws in data["posterior"].data_vars.items():
        assert float(az.rhat(np.asarray(draws))) < 1.01, name


def test_a_ridge_is_sampled_and_every_group_has_units_and_priors(posterior):
    """Draws converge, hardly any diverges, and their moments are those of the density on a grid."""
    check_converged(posterior)

    def log_density(logit, log_power, noise):
        """Uniform in the base, log-normal in the power, half-normal in the noise."""
        x, y = logit[..., :1], log_power[..., :1]
        off = np.exp(-np.exp(y) * np.log1p(np.exp(-x)) * (1 + 0.1 * V)) - ridge().restitution
        squares = np.sum(off**2, axis=-1)[..., None]
        of_laws = -logit - 2 * np.log1p(np.exp(-logit))
        of_laws += stats.norm.logpdf(log_power, np.log(1.3), 2.0)
        of_noise = stats.halfnorm.logpdf(noise, 0, 0.1) - len(V) * np.log(noise)
        return of_laws + of_noise - 0.5 * squares / noise**2

    draws = {name: np.asarray(posterior["posterior"][name]) for name in ("base", "power", "noise")}
    base = draws["base"]
    found = np.log(base / (1 - base)), np.log(draws["power"]), draws["noise"]
    axes = np.linspace(-12, 12, 151), np.linspace(-8, 8, 1601), np.linspace(0.004, 0.04, 25)
    check_grid(
        dict(zip(THREE, found, strict=True)), log_density, **dict(zip(THREE, axes, strict=True))
    )
    found = posterior["posterior"]
    assert (found.sizes["chain"], found.sizes["draw"]) == (2, 1000)
    assert found["base"].attrs["prior"] == "uniform, 0 to 1"
    assert found["noise"].attrs["prior"] == "half-normal, 0.1"
    assert json.loads(found.attrs["priors"])["noise"] == "half-normal, 0.1"
    observed = posterior["observed_data"]["restitution"]
    np.testing.assert_array_equal(observed, ridge().restitution)
    np.testing.assert_array_equal(observed["velocity"], V)
    assert observed["velocity"].attrs["unit"] == "m/s"
    base, power, noise = (np.asarray(found[n])[..., None] for n in ("base", "power", "noise"))
    exact = base ** (power * (1 + 0.1 * V))
    expected = stats.norm.logpdf(ridge().restitution, exact, noise)
    np.testing.assert_allclose(posterior["log_likelihood"]["restitution"], expected, rtol=1e-9)
    predicted = np.asarray(posterior["posterior_predictive"]["restitution"])
    scatter = (predicted - exact) / noise
    assert stats.kstest(scatter.ravel()[::7], "norm").pvalue > 1e-3
    assert np.std(predicted[..., 0]) > 1.5 * np.std(exact[..., 0])
    assert 0.7 < float(posterior["sample_stats"]["acceptance_rate"].mean()) < 1.0


def test_priors_pools_and_what_else_was_measured_enter_as_documented():
    """ln p of the priors in z = ln θ and the like, at draws, up to a constant; and of each point."""

    def spring(contact, level, stiffness, tilt):
        return sj.LinearSpringDashpot(contact, stiffness, level * jnp.exp(tilt))

    random, velocity = np.random.default_rng(3), V[::2]
    contact = cal.paper_materials()[2].contact

    def duration(stiffness, restitution):
        loss = np.log(restitution) / np.hypot(np.pi, np.log(restitution))
        return np.pi * np.sqrt(float(contact.mass) / stiffness / (1 - loss**2))

    sets = []
    for name in "ab":
        e, times = 0.8 + 0.02 * random.standard_normal(8), duration(3e6, 0.8)
        times = times * (1 + 0.02 * random.standard_normal(8))
        sets.append(cal.RestitutionData(velocity, e, contact, name=name, contact_time=times))
    parameters = {
        "level": cal.Parameter(0.85, prior=(0.85, 0.05), bounds=(0, np.inf), shared=True),
        "stiffness": cal.Parameter(3e6, shared="pooled"),
        "tilt": cal.Parameter(0.0, shared=True),
    }
    fit = cal.fit(sets, spring, parameters, profiles=False, starts=1)
    draws = fit.posterior(draws=40, chains=1, seed=3, warmup=60)
    value = {name: values_of(draws, name)[:, None] for name in draws["posterior"].data_vars}
    mean, spread = value["stiffness"], value["stiffness_spread"]
    expected = stats.norm.logpdf(value["level"], 0.85, 0.05) + np.log(value["level"])
    expected += stats.norm.logpdf(np.log(mean), np.log(3e6), 2.0)
    expected += stats.norm.logpdf(value["tilt"], 0, 10.0)
    noises = [value[name] for name in value if "noise" in name]
    assert len(noises) == 4
    for noise, of in ((spread, 0.5), *((one, 0.1) for one in noises)):
        expected += stats.halfnorm.logpdf(noise, 0, of) + np.log(noise)
    by_point, measured = [], []
    for data in sets:
        own, e = value[f"stiffness[{data.name}]"], value["level"] * np.exp(value["tilt"])
        expected += stats.norm.logpdf((np.log(own) - np.log(mean)) / spread)  # is standard normal
        times, noise = data.observed[0], value[f"contact_time_noise[{data.name}]"]
        by_point.append(stats.norm.logpdf(data.restitution, e, value[f"noise[{data.name}]"]))
        by_point.append(stats.norm.logpdf(times.value, duration(own, e), noise * times.scale))
        measured += [*data.restitution, *times.value]
    found = np.ravel(draws["sample_stats"]["log_prior"])
    np.testing.assert_allclose(found - found[0], np.ravel(expected - expected[0]), atol=1e-8)
    found = np.asarray(draws["log_likelihood"]["restitution"]).reshape(40, -1)
    np.testing.assert_allclose(found, np.concatenate(by_point, axis=1), rtol=1e-8)
    observed = draws["observed_data"]["restitution"]
    np.testing.assert_allclose(observed, measured, rtol=1e-14)
    of_set = ["restitution"] * 8 + ["contact_time"] * 8
    assert list(observed["observable"].values) == 2 * of_set
    priors = {name: draws["posterior"][name].attrs["prior"] for name in value}
    assert priors["stiffness[a]"] == "around stiffness, with stiffness_spread"
    assert priors["stiffness"] == "log-normal, median 3e+06, with 68 % from 4.1e+05 to 2.2e+07"


def test_equal_seeds_give_equal_draws(result, posterior):
    """However the threads went; another seed, and each chain, has draws of its own."""
    same, other = (result.posterior(seed=k, **TOLD)["posterior"]["noise"] for k in (1, 2))
    one, same, other = map(np.asarray, (posterior["posterior"]["noise"], same, other))
    np.testing.assert_array_equal(one, same)
    assert np.mean(one == other) < 0.01
    assert np.mean(one[0] == one[1]) < 0.01


@pytest.mark.filterwarnings("ignore:The inplace keyword")  # ArviZ 0.23 with pandas 3.1
@pytest.mark.filterwarnings("ignore:Estimated shape")  # of a point that stands out
def test_arviz_leaves_points_out_as_refits_do(posterior, result):
    """PSIS over draws, against refits without each point."""
    found = az.loo(posterior)
    elpd = float(getattr(found, "elpd_loo", getattr(found, "elpd", np.nan)))
    assert abs(elpd - result.leave_one_out().elpd) < 0.35


# other samplers, on `cal.problem`, by the examples of the reference


def example(which):
    """The n-th block of code that is run here alone."""
    page = Path(__file__).parents[2] / "notebooks" / "reference" / "how_to.md"
    return re.findall(r"```py\n(.*?)```", page.read_text(encoding="utf-8"), re.S)[which]


@pytest.fixture(scope="module")
def nylon():
    """Impacts above yield alone: they determine χ̃, ε_up and the noise; and logarithms as fitted."""
    data = twin("nylon", y=np.geomspace(1.3, 60.0, 20), noise=0.01)
    fit = cal.fit(data, profiles=False)
    found = {n: fit.estimates[n] for n in ("chi", "eps_up")}
    expected = {n: (np.log(e.value), e.standard_error / e.value) for n, e in found.items()}
    material = fit.materials[0]
    of_noise = np.log(material.noise), (2 * material.residual_degrees) ** -0.5
    return data, expected | {"noise": of_noise}


def check(draws, expected):
    """Within Monte Carlo error and what priors and the normal approximation are off by."""
    for name, (mean, deviation) in expected.items():
        log = np.log(np.asarray(draws[name]))
        error = deviation / float(az.ess(log[None])) ** 0.5
        assert abs(np.mean(log) - mean) < 5 * error + 0.25 * deviation
        assert np.std(log) == pytest.approx(deviation, rel=0.3)


@pytest.mark.long
@pytest.mark.parametrize("sampler", ["numpyro", "blackjax"])
def test_another_sampler_samples_it(sampler, nylon):
    (data, expected), draws = nylon, []
    names = {"jax": jax, "jnp": jnp, "cal": cal, "data": data, "problem": cal.problem(data)}
    if sampler == "numpyro":
        numpyro = needed("numpyro")
        names |= {"numpyro": numpyro, "dist": numpyro.distributions}
        names |= {"MCMC": numpyro.infer.MCMC, "NUTS": numpyro.infer.NUTS}
        exec(example(0).replace("NUTS(model)", "NUTS(model), progress_bar=False"), names)
        return check(names["mcmc"].get_samples(), expected)
    code = example(1)
    assert "state, info = step(key, state)" in code
    exec(
        code + "\n    draws.append(state.position)", names | {"blackjax": blackjax, "draws": draws}
    )
    assert len(draws) == 500
    check({n: np.exp([float(draw[n]) for draw in draws]) for n in expected}, expected)


@pytest.mark.long
def test_the_valley_of_sigma_and_psi_is_sampled():
    """10 points below yield and 20 above, noise 0.01: at most 0.5 % of the draws diverge."""
    check_converged(cal.fit(twin("stainless steel", noise=0.01), profiles=False).posterior(seed=0))


@pytest.mark.long
def test_the_ridge_of_drops_far_above_yield_is_sampled():
    """χ̃ and ε_up only together: moments of a grid along the ridge; the statistics have the density's parts."""
    data = drops(np.random.default_rng(0))
    found = cal.fit(data, profiles=False).posterior(seed=0)
    check_converged(found)
    problem = cal.problem(data)
    logit, log_chi = np.log(values_of(found, "eps_up")), np.log(values_of(found, "chi"))
    logit = logit - np.log1p(-np.exp(logit))
    x = np.linspace(np.min(logit) - 0.5, np.max(logit) + 1.0, 60)
    ridge = np.polynomial.Polynomial.fit(logit, log_chi, 7)
    off = 6 * np.std(log_chi - ridge(logit)) * np.linspace(-1, 1, 81)
    y = ridge(x.clip(np.min(logit), np.max(logit)))[:, None] + off
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
    at = {name: np.asarray(found["posterior"][name])[0, :50] for name in theta}
    likelihood = np.asarray(jax.vmap(problem.log_likelihood)(at))
    np.testing.assert_allclose(np.asarray(expected)[0, :50], likelihood, rtol=1e-9, atol=1e-9)


# what is made of draws that were made here, against NumPy on the same draws

VELOCITY = np.array([0.7, 1.5, 3.9])
MEASURED = np.linspace(0.5, 4.0, 12)


def drawn(**variables):
    """ArviZ data of 2 chains of 300 draws of each (mean, standard deviation); 6 diverged."""
    random = np.random.default_rng(0)
    dims = ("chain", "draw")
    draws = {n: (dims, m + s * random.standard_normal((2, 300))) for n, (m, s) in variables.items()}
    diverging = {"diverging": (dims, np.arange(600).reshape(2, 300) % 100 == 7)}
    return made(posterior=xarray.Dataset(draws), sample_stats=xarray.Dataset(diverging))


@pytest.fixture(scope="module")
def decay():
    errors = 0.02 * np.random.default_rng(0).standard_normal(len(MEASURED))
    data = cal.RestitutionData(MEASURED, 0.92 * np.exp(-0.3 * MEASURED) + errors)
    return cal.fit(data, Decay, profiles=False)


@pytest.fixture(scope="module")
def draws():
    return drawn(level=(0.92, 0.02), rate=(0.3, 0.04), noise=(0.05, 0.002))


def test_a_band_and_fits_at_draws_are_of_the_draws(decay, draws):
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
    fits, which = decay.at_draws(draws, 3), [0, 300, 599]
    for name in ("rate", "level"):
        found = [getattr(f.law, name) for f in fits]
        np.testing.assert_array_equal(found, values_of(draws, name)[which])
    with pytest.raises(ValueError, match="`count` must be a whole number from 1 to 600"):
        decay.at_draws(draws, 601)


def test_the_picture_of_draws_and_of_a_fit_with_a_fixed_level(draws):
    """Histograms, and pairs below them; a fixed value has no interval."""
    data = cal.RestitutionData(MEASURED, 0.92 * np.exp(-0.3 * MEASURED), uncertainty=0.02)
    fit = cal.fit(data, Decay, {"level": cal.Parameter(0.92, free=False)}, profiles=False)
    figure = posterior_figure(draws, fit)
    every = iter(figure.axes)
    names, axis = ("level", "rate", "noise"), ("$a$", "$b$ [s/m]", "scatter")
    ends = {"level": [], "rate": list(fit.intervals["rate"]), "noise": []}
    for row, name in enumerate(names):
        values = values_of(draws, name)
        for below in names[:row]:
            ax, other = next(every), values_of(draws, below)
            np.testing.assert_array_equal(ax.get_lines()[0].get_xydata().T, [other, values])
            np.testing.assert_array_equal(line(ax, "diverged"), [other[7::100], values[7::100]])
            if name == "rate":
                assert np.ravel(line(ax, "fit")).tolist() == [0.92, fit.values["rate"]]
            assert (ax.get_xlabel() or axis[names.index(below)]) == axis[names.index(below)]
        ax = next(every)
        edges = [bar.get_x() for bar in ax.patches] + [np.quantile(values, 0.998)]
        assert [bar.get_height() for bar in ax.patches] == np.histogram(values, edges)[0].tolist()
        assert ax.get_xlim() == pytest.approx(np.quantile(values, [0.002, 0.998]))
        shown = [line.get_xdata()[0] for line in ax.get_lines() if "interval" in line.get_label()]
        assert shown == ends[name]
    assert legend(figure) == ["draws", "fit", "diverged", "the fit's interval"]


def test_pictures_of_many_parameters_are_no_wider_than_others_and_no_names_overlap(decay):
    names = [f"p{k}" for k in range(16)]
    figure = posterior_figure(drawn(**dict.fromkeys(names[:8], (3e8, 1e6))))
    assert figure.get_figwidth() <= 6.4
    last = figure.axes[-1]
    assert last.get_xlabel() == "p7 [$10^{8}$]"
    assert last.xaxis.get_major_formatter()(3.05e8, None) == "3.05"
    labels = dict(zip(names, names, strict=True))
    material = SimpleNamespace(name="a", labels=labels, model=decay.materials[0].model)
    result = SimpleNamespace(materials=[material], estimates={})
    result.covariance_names, result.correlations = names, np.full((16, 16), 0.5)
    figure = correlation_figure(result)
    assert figure.get_figwidth() <= 6.4
    assert len(figure.axes[0].patches) == 16 * 15
    owners = ("aluminium alloy 7075", "stainless steel 316")
    names = [f"p{k}[{owner}]" for owner in owners for k in range(4)]
    figure = posterior_figure(drawn(**dict.fromkeys(names, (0.3, 0.1))))
    figure.canvas.draw()
    axes = [(ax.xaxis.label, ax.yaxis.label) for ax in figure.axes]
    for which in zip(*axes, strict=True):
        boxes = [label.get_window_extent() for label in which if label.get_text()]
        assert len(boxes) >= 7
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
        assert all(figure.bbox.contains(*end) for box in boxes for end in (box.p0, box.p1))


@pytest.mark.parametrize("dof", [4, "estimate"])
def test_one_more_measurement_has_the_tails_of_its_noise(dof):
    """The middle half and 90 % of Student's t about a curve that draws hardly move."""
    errors = 0.02 * np.random.default_rng(0).standard_t(3, len(MEASURED))
    data = cal.RestitutionData(MEASURED, 0.92 * np.exp(-0.3 * MEASURED) + errors)
    options = {"noise": "student-t", "noise_dof": dof}
    fit = cal.fit(data, Decay, profiles=False, **options)
    known = {"level": 0.92, "rate": 0.3, "noise": 0.05, "dof": 3.0}
    draws = drawn(**{n: (x, 1e-9) for n, x in known.items() if n != "dof" or dof == "estimate"})
    for confidence in (0.5, 0.9):
        band = fit.band(VELOCITY, kind="prediction", confidence=confidence, draws=draws)
        reach = 0.05 * stats.t.ppf(0.5 + confidence / 2, 4 if dof == 4 else 3)
        assert np.mean(band.high - band.low) / 2 == pytest.approx(reach, rel=0.1)


def test_curves_sensitivities_and_designs_are_over_the_draws(tmp_path):
    """θ ∂ε/∂θ of a constant is ε itself."""
    folder = tmp_path
    data = cal.RestitutionData(V, 0.9 + 0.05 * np.cos(V))
    cal.fit(data, "constant", profiles=False).save(folder / "fit.json")
    data = drawn(restitution=(0.8, 0.03), noise=(0.05, 0.002))
    data.to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    (folder / "other.nc").write_text("no netCDF")
    given = ("--fit", folder / "fit.json", "--posterior", folder / "posterior.nc")
    values = values_of(data, "restitution")
    places = ("--from", "1", "--to", "2", "--points", "3")
    where = (*places, "--format", "csv", "--out", folder / "out")
    assert run("curve", *given, *where)[0] == 0
    rows = (folder / "out" / "curve.csv").read_text().splitlines()
    assert rows[0].startswith("velocity [m/s],restitution,restitution_low,restitution_high")
    _, *numbers = (float(cell) for cell in rows[1].split(",")[:4])
    expected = [np.mean(values), *np.quantile(values, [0.025, 0.975])]
    np.testing.assert_allclose(numbers, expected, rtol=1e-12)
    code, _, err = run("curve", *given[:3], folder / "other.nc", "--out", folder / "no")
    assert code == 2
    assert "other.nc: no draws can be read" in err
    options = ("--study", "design", "--shots", "2", "--out", folder / "design")
    code, out, _ = run("sensitivity", *given, *options)
    assert code == 0
    assert "on average over 16 draws of the posterior: Best shots: " in out


# the command


def test_the_command_writes_draws_picture_and_words_and_says_what_is_wrong(tmp_path, monkeypatch):
    """Means of 12 to 0.0069: mass at ε = 1, and priors that say all and a part. Then few draws."""
    noise = 0.02 * np.random.default_rng(2).standard_normal(12)
    narrow, wide = (
        f"[material.parameters]\nrestitution = {{ prior = [0.9, {u}] }}\n" for u in (1e-4, 0.01)
    )
    near_one, text = 0.999 + noise.clip(-1, 0.0008), ""
    materials = (near_one, ""), (0.9 + noise, narrow), (0.9 + noise, wide)
    for k, (values, more) in enumerate(materials):
        rows = [f"{v},{e}" for v, e in enumerate(values, 1)]
        (tmp_path / f"{k}.csv").write_text("velocity [m/s],restitution\n" + "\n".join(rows))
        text += f'[[material]]\nname = "balls {k}"\ndata = "{k}.csv"\n{more}'
    (tmp_path / "a.toml").write_text(text)
    out, posterior, every = tmp_path / "results", cal.FitResult.posterior, []

    def sampled(function):
        monkeypatch.setattr(cal.FitResult, "posterior", function)
        options = ("--law", "constant", "--posterior", "--no-profiles", "--out", out)
        code, printed, err = run("fit", tmp_path / "a.toml", *options)
        assert (code, err) == (0, "")
        report = (out / "report.md").read_text(encoding="utf-8")
        section = report[report.index("## Posterior") :]
        return printed, section, {x.split("**")[1]: x for x in section.splitlines() if "**" in x}

    printed, section, warned = sampled(lambda *a, **k: every.append(posterior(*a, **k)) or every[0])
    assert {"posterior.nc", "posterior.png"} <= {path.name for path in out.iterdir()}
    with xarray.open_dataset(out / "posterior.nc", group="posterior", engine="h5netcdf") as found:
        assert dict(found.sizes) == {"chain": 4, "draw": 1000}
        draws = np.asarray(found["restitution[balls 2]"])
    assert "4 chains of 1000 draws by NUTS (blackjax" in section
    assert "Posterior:\n" in printed
    assert "posterior/prior width" in printed
    (_, _, ends, *_), *table = markdown_tables(section)[0]
    assert ends == "95 % interval"
    rows = {row[0]: row for row in table}
    _, stated, narrowed, *_ = rows
    assert float(rows[narrowed][1].split(" ± ")[0]) == pytest.approx(np.mean(draws), abs=1e-4)
    low, high = (float(end) for end in rows[narrowed][2].split(" … "))
    assert [low, high] == pytest.approx(np.quantile(draws, [0.025, 0.975]), abs=1e-3)
    for name, share in ((narrowed, 0.57), (stated, 1.0)):
        assert float(rows[name][5]) == pytest.approx(share, rel=0.1)  # 1/√(1 + (0.01/0.0069)²)
    of_draws = {code for code, line in warned.items() if "(posterior)" in line}
    assert of_draws == {"mass-at-bound", "follows-prior"}
    assert printed.count("Warnings:") == section.count("## Warnings") == 1
    assert "; its posterior has 2 warnings." in printed
    for code, what in (
        ("mass-at-bound", "restitution[balls 0] at 1"),
        ("follows-prior", "restitution[balls 1] ("),
    ):
        assert what in warned[code]
        assert warned[code].count("restitution[") == 1
    few = every[0].isel(draw=slice(8))
    _, section, warned = sampled(lambda *_, **__: few)
    assert {"r-hat", "effective-size"} <= set(warned)
    assert "conclude nothing from these draws" in section


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
