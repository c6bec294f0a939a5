"""Draws from the posterior: against grids, other samplers and refits; what is said and made of them."""

import importlib
import inspect
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
from tests.shown.capture import as_recorded, line
from tests.shown.tables import Tags


def needed(name):
    """A package of the extra; where it has to be there its absence fails, else it skips."""
    try:
        return importlib.import_module(name)
    except FileNotFoundError:  # ArviZ notes the day in a file, which two workers replace at once
        return importlib.import_module(name)
    except ModuleNotFoundError:
        if "SOFTJAX_TEST_EXTRAS" in os.environ:
            raise
        pytest.skip("pip install softjax-contact[test-bayes]")


blackjax = az = xarray = None


@pytest.fixture(scope="module", autouse=True)
def samplers():
    """Imported by the worker that has these tests, not by every one that collects them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # ArviZ 0.23 announces 1.0
        globals().update(blackjax=needed("blackjax"), az=needed("arviz"), xarray=needed("xarray"))


def made(**groups):
    """Groups of xarray data sets as what this ArviZ works on."""
    if az.__version__.startswith("0."):
        return az.InferenceData(**groups)
    return xarray.DataTree.from_dict(groups)


def values_of(data, name):
    """All draws of one variable, chain after chain."""
    return np.ravel(np.asarray(data["posterior"][name]))


V = np.linspace(0.5, 4.0, 16)


class Ridge(sj.HardSphereLaw):
    """ε = c^{b (1 + v/10)}, c and b only together, b^{ln c} that is; positive both."""

    base: float = sj.number_field("c", within="(0, 1)", default=0.9)
    power: float = sj.number_field("b", within="(0, inf)", default=1.0)

    def restitution_squared(self, velocity):
        return jnp.exp(2 * self.power * jnp.log(self.base) * (1 + 0.1 * velocity))


def check_converged(data):
    assert np.mean(data["sample_stats"]["diverging"]) <= 0.005
    for name, draws in data["posterior"].data_vars.items():
        assert float(az.rhat(np.asarray(draws))) < 1.01, name


def test_a_ridge_is_sampled_and_every_group_has_units_and_priors():
    """Draws converge, hardly any diverges; moments are a grid's within 5 Monte Carlo errors, known to 7 %."""
    measured = np.exp(-0.3 * (1 + 0.1 * V)) + 0.01 * np.random.default_rng(1).standard_normal(16)
    parameters = {"base": cal.Parameter(0.8), "power": cal.Parameter(1.3)}
    data = cal.RestitutionData(V, measured)
    result = cal.fit(data, Ridge, parameters, profiles=False, starts=1)
    posterior = result.posterior(seed=1, draws=1000, chains=2, warmup=500)
    check_converged(posterior)
    found = posterior["posterior"]
    assert (found.sizes["chain"], found.sizes["draw"]) == (2, 1000)
    base, power, noise = draws = [np.asarray(found[name]) for name in ("base", "power", "noise")]
    assert np.mean(noise[0] == noise[1]) < 0.01
    axes = np.linspace(-12, 12, 101), np.linspace(-8, 8, 1601), np.linspace(0.004, 0.04, 17)
    x, y, s = grid = np.meshgrid(*axes, indexing="ij", sparse=True)
    curves = np.exp(-np.exp(y) * np.log1p(np.exp(-x)) * (1 + 0.1 * V[:, None, None, None]))
    squares = np.sum((curves - measured[:, None, None, None]) ** 2, axis=0)
    # uniform in the base, log-normal in the power, half-normal in the noise
    density = -x - 2 * np.log1p(np.exp(-x)) + stats.norm.logpdf(y, np.log(1.3), 2.0)
    density = density + stats.halfnorm.logpdf(s, 0, 0.1) - 16 * np.log(s) - 0.5 * squares / s**2
    weight = np.exp(density - np.max(density))
    weight /= np.sum(weight)
    for values, at in zip((np.log(base / (1 - base)), np.log(power), noise), grid, strict=True):
        expected = np.sum(weight * at)
        width = np.sum(weight * (at - expected) ** 2) ** 0.5
        spread, deviation = (values - np.mean(values)) ** 2, np.std(values)
        error = deviation / float(az.ess(values)) ** 0.5
        assert error < 0.07 * width
        assert abs(np.mean(values) - expected) < 5 * error
        its_error = np.std(spread) / (2 * deviation) / float(az.ess(spread)) ** 0.5
        assert abs(deviation - width) < 5 * its_error
    assert found["base"].attrs["prior"] == "uniform, 0 to 1"
    assert found["noise"].attrs["prior"] == "half-normal, 0.1"
    assert json.loads(found.attrs["priors"])["noise"] == "half-normal, 0.1"
    velocity = posterior["observed_data"]["restitution"]["velocity"]
    np.testing.assert_array_equal(velocity, V)
    assert velocity.attrs["unit"] == "m/s"
    base, power, noise = (one[..., None] for one in draws)
    exact = base ** (power * (1 + 0.1 * V))
    predicted = np.asarray(posterior["posterior_predictive"]["restitution"])
    scatter = (predicted - exact) / noise
    assert stats.kstest(scatter.ravel()[::7], "norm").pvalue > 1e-3
    assert np.std(predicted[..., 0]) > 1.5 * np.std(exact[..., 0])
    assert 0.7 < float(posterior["sample_stats"]["acceptance_rate"].mean()) < 1.0


def test_priors_pools_and_what_else_was_measured_enter_as_documented():
    """ln p of the priors in z = ln θ and the like, at draws, up to a constant; and of each point."""

    def spring(contact, level, stiffness, tilt, turn):
        return sj.LinearSpringDashpot(contact, stiffness, level * jnp.exp(tilt + turn))

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
        "turn": cal.Parameter(0.0, bounds=(-np.inf, 0.5), shared=True),
    }
    fit = cal.fit(sets, spring, parameters, profiles=False, starts=1)
    draws = fit.posterior(draws=40, chains=1, seed=3, warmup=60)
    value = {name: values_of(draws, name)[:, None] for name in draws["posterior"].data_vars}
    mean, spread = value["stiffness"], value["stiffness_spread"]
    expected = stats.norm.logpdf(value["level"], 0.85, 0.05) + np.log(value["level"])
    expected += stats.norm.logpdf(np.log(mean), np.log(3e6), 2.0)
    expected += stats.norm.logpdf(value["tilt"], 0, 10.0)
    expected += stats.norm.logpdf(np.log(0.5 - value["turn"]), np.log(0.5), 2.0)
    noises = [value[name] for name in value if "noise" in name]
    assert len(noises) == 4
    for noise, of in ((spread, 0.5), *((one, 0.1) for one in noises)):
        expected += stats.halfnorm.logpdf(noise, 0, of) + np.log(noise)
    by_point, measured = [], []
    for data in sets:
        own, turned = value[f"stiffness[{data.name}]"], value["tilt"] + value["turn"]
        e = value["level"] * np.exp(turned)
        expected += stats.norm.logpdf((np.log(own) - np.log(mean)) / spread)  # is standard normal
        times, noise = data.observed[0], value[f"contact_time_noise[{data.name}]"]
        by_point.append(stats.norm.logpdf(data.restitution, e, value[f"noise[{data.name}]"]))
        by_point.append(stats.norm.logpdf(times.value, duration(own, e), noise * times.scale))
        measured += [*data.restitution, *times.value]
    statistics = draws["sample_stats"]
    found, by_point = np.ravel(statistics["log_prior"]), np.concatenate(by_point, axis=1)
    np.testing.assert_allclose(found - found[0], np.ravel(expected - expected[0]), atol=1e-8)
    found = np.asarray(draws["log_likelihood"]["restitution"]).reshape(40, -1)
    np.testing.assert_allclose(found, by_point, rtol=1e-8)
    found = np.ravel(statistics["lp"] - statistics["log_prior"] - statistics["log_jacobian"])
    np.testing.assert_allclose(found, np.sum(by_point, axis=1), rtol=1e-9)
    same, other = (
        fit.posterior(draws=40, chains=1, seed=k, warmup=60)["posterior"]["level"] for k in (3, 4)
    )
    np.testing.assert_array_equal(same, draws["posterior"]["level"])
    assert np.mean(np.asarray(same == other)) < 0.01
    observed = draws["observed_data"]["restitution"]
    np.testing.assert_allclose(observed, measured, rtol=1e-14)
    of_set = ["restitution"] * 8 + ["contact_time"] * 8
    assert list(observed["observable"].values) == 2 * of_set
    about = {name: draws["posterior"][name].attrs for name in value}
    priors = {name: attributes["prior"] for name, attributes in about.items()}
    assert about["tilt"]["prior_share"] == pytest.approx(np.std(value["tilt"]) / 10)
    share = np.std(value["level"]) / 0.05
    assert about["level"]["prior_share"] == pytest.approx(share, rel=0.1)
    assert (about["level"]["lower"], about["level"]["upper"]) == (0, np.inf)
    assert priors["turn"] == "log-normal, median 0, with 68 % from -3.2 to 0.43"  # 1/2 - e^±2/2
    assert priors["stiffness[a]"] == "around stiffness, with stiffness_spread"
    assert priors["stiffness"] == "log-normal, median 3e+06, with 68 % from 410000 to 2.2e+07"


def test_an_error_of_heights_has_their_unit_and_a_prior_of_a_tenth_in_restitution():
    """∂ε/∂x₁ = -ε/2x₁ and ∂ε/∂x₂ = ε/2x₂ of ε = √(x₂/x₁); it was called one of times, in seconds."""
    heights = 0.5 * 0.64 ** np.arange(6) * (1 + 0.01 * np.array([0, 1, -1, 0, 1, -1]))
    table = {"launch": [1] * 6, "height": heights, "bounce": range(6)}
    fit = cal.fit(cal.RestitutionData.from_table(table, air=False), "constant", profiles=False)
    draws = fit.posterior(draws=10, chains=1, warmup=50, seed=1)
    e = np.sqrt(heights[1:] / heights[:-1])
    per_metre = np.sqrt(np.mean((e / 2) ** 2 * (heights[1:] ** -2 + heights[:-1] ** -2)))
    about = draws["posterior"]["timing"].attrs
    assert (about["unit"], about["prior"]) == ("m", f"half-normal, {0.1 / per_metre:.1g} m")
    assert "error of heights [m]" in {ax.get_xlabel() for ax in posterior_figure(draws, fit).axes}


@pytest.mark.long
@pytest.mark.parametrize("sampler", ["numpyro", "blackjax"])
def test_another_sampler_samples_the_problem_as_the_reference_shows(sampler):
    """Impacts above yield alone: within Monte Carlo error and what the normal approximation is off by."""
    page = Path(__file__).parents[2] / "notebooks" / "reference" / "how_to.md"
    by_numpyro, by_blackjax = re.findall(
        r"```py\n(.*?)```", page.read_text(encoding="utf-8"), re.S
    )[:2]
    data = twin("nylon", y=np.geomspace(1.3, 60.0, 20), noise=0.01)
    names = {"jax": jax, "jnp": jnp, "cal": cal, "data": data, "problem": cal.problem(data)}
    if sampler == "numpyro":
        numpyro = needed("numpyro")
        names |= {"numpyro": numpyro, "dist": numpyro.distributions}
        names |= {"MCMC": numpyro.infer.MCMC, "NUTS": numpyro.infer.NUTS}
        exec(by_numpyro.replace("NUTS(model)", "NUTS(model), progress_bar=False"), names)
        found = {n: np.log(x) for n, x in names["mcmc"].get_samples().items()}
    else:
        draws = []
        assert "state, info = step(key, state)" in by_blackjax
        code = by_blackjax + "\n    draws.append(state.position)"
        exec(code, names | {"blackjax": blackjax, "draws": draws})
        assert len(draws) == 500
        found = {n: np.array([float(draw[n]) for draw in draws]) for n in draws[0]}
    fit = cal.fit(data, profiles=False)
    expected = {n: (fit.values[n], fit.standard_errors[n]) for n in ("chi", "eps_up")}
    material = fit.materials[0]
    of_noise = material.noise * (2 * material.residual_degrees) ** -0.5
    for name, (value, size) in (expected | {"noise": (material.noise, of_noise)}).items():
        deviation = size / value
        error = deviation / float(az.ess(found[name][None])) ** 0.5
        assert abs(np.mean(found[name]) - np.log(value)) < 5 * error + 0.25 * deviation
        assert np.std(found[name]) == pytest.approx(deviation, rel=0.3)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["drops", "losses"])
def test_the_ridge_of_drops_and_the_valley_of_losses_are_sampled(kind):
    """χ̃ and ε_up only together, far above yield; σ and ψ, of 10 points below yield and 20 above."""
    data = (
        drops(np.random.default_rng(0)) if kind == "drops" else twin("stainless steel", noise=0.01)
    )
    check_converged(cal.fit(data, profiles=False).posterior(seed=0))


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


def test_a_band_of_draws_is_of_the_draws(decay, draws):
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
    as_recorded("posterior", {"posterior.png": figure})


def test_pictures_of_many_parameters_are_no_wider_than_others_and_no_names_overlap(decay):
    names = [f"p{k}" for k in range(16)]
    (alone,) = posterior_figure(drawn(p0=(3e8, 1e6))).axes
    assert alone.get_xlabel() == "p0"
    for count, turned in ((4, 0), (5, 90)):
        last = posterior_figure(drawn(**dict.fromkeys(names[:count], (3e8, 1e6)))).axes[-1]
        assert last.get_xticklabels()[0].get_rotation() == turned
    last = posterior_figure(drawn(**dict.fromkeys(names, (3e8, 1e6)))).axes[-1]
    assert last.xaxis.get_major_formatter()(3.05e8, None) == "3.05e+08"
    assert last.get_xlabel() == "p7"  # no letter of a formula
    labels = dict(zip(names, names, strict=True))
    material = SimpleNamespace(name="a", labels=labels, model=decay.materials[0].model)
    result = SimpleNamespace(materials=[material], estimates={})
    for count, numbers in ((16, 0), (10, 100)):  # in squares with room for them
        result.covariance_names = names[:count]
        result.correlations = np.full((count, count), 0.5)
        figure = correlation_figure(result)
        assert figure.get_figwidth() <= 6.4
        assert figure.axes[0].images[0].get_array().shape == (count, count)
        assert len(figure.axes[0].texts) == numbers
    flat = cal.RestitutionData(MEASURED, 0.9 + 0 * MEASURED, uncertainty=0.01)
    other = cal.fit(flat, "constant", profiles=False).materials[0].model
    result.materials.append(SimpleNamespace(name="b", model=other))
    figure = posterior_figure(drawn(**{"level[a]": (1, 1), "restitution[b]": (1, 1)}), result)
    labels = [ax.get_xlabel() for ax in figure.axes if ax.get_xlabel()]
    assert labels == ["$a$\na", "$\\varepsilon$\nb"]  # each by its own law
    owners = ("aluminium alloy 7075", "chrome steel 316")
    names = [f"p{k}[{owner}]" for owner in owners for k in range(4)]
    figure = posterior_figure(drawn(**dict.fromkeys(names, (0.3, 0.1))))
    figure.canvas.draw()
    axes = [(ax.xaxis.label, ax.yaxis.label) for ax in figure.axes]
    assert axes[-1][0].get_text().splitlines() == ["p3", "chrome", "steel 316"]
    for which in zip(*axes, strict=True):
        boxes = [label.get_window_extent() for label in which if label.get_text()]
        assert len(boxes) >= 7
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
        assert all(figure.bbox.contains(*end) for box in boxes for end in (box.p0, box.p1))


def test_one_more_measurement_has_the_tails_of_its_noise():
    """The middle half and 90 % of Student's t about a curve that draws hardly move."""
    errors = 0.02 * np.random.default_rng(0).standard_t(3, len(MEASURED))
    data = cal.RestitutionData(MEASURED, 0.92 * np.exp(-0.3 * MEASURED) + errors)
    fit = cal.fit(data, Decay, profiles=False, noise="student-t", noise_dof=3)
    known = {"level": 0.92, "rate": 0.3, "noise": 0.05}
    draws = drawn(**{n: (x, 1e-9) for n, x in known.items()})
    for confidence in (0.5, 0.9):
        band = fit.band(VELOCITY, kind="prediction", confidence=confidence, draws=draws)
        reach = 0.05 * stats.t.ppf(0.5 + confidence / 2, 3)
        assert np.mean(band.high - band.low) / 2 == pytest.approx(reach, rel=0.1)


@pytest.mark.parametrize("is_stated", [True, False])
def test_one_more_measurement_has_the_error_of_its_velocity(is_stated):
    """Stated errors as the points next to it have them; of times those that ε of such a bounce has."""
    known = {"level": 0.92, "rate": 0.05}
    if is_stated:
        e = 0.92 * np.exp(-0.05 * MEASURED) + 0.01 * np.sin(np.arange(12))
        data = cal.RestitutionData(MEASURED, e, uncertainty=np.linspace(0.002, 0.03, 12))
        expected = np.interp(VELOCITY, MEASURED, np.linspace(0.002, 0.03, 12))
    else:  # ε of two flights t and ε t has the standard deviation u √(1 + ε²)/t
        flights = [np.linspace(0.2, 0.8, 6)]
        for _ in range(4):
            flights.append(flights[-1] * 0.92 * np.exp(-0.05 * 9.80665 / 2 * flights[-1]))
        times = np.transpose(flights) + 1e-3 * np.random.default_rng(0).standard_normal((6, 5))
        table = {"launch": np.repeat([*"abcdef"], 5), "interval": times.ravel()}
        data = cal.RestitutionData.from_table(table)
        known |= {"timing": 5e-3}
        e = 0.92 * np.exp(-0.05 * VELOCITY)
        # v moves with its time, too
        to_first = e * (1 - 0.05 * VELOCITY)
        expected = 5e-3 * np.hypot(1, to_first) * 9.80665 / (2 * VELOCITY)
    fit = cal.fit(data, Decay, profiles=False)
    draws = drawn(**{name: (value, 1e-9) for name, value in known.items()})
    found = fit.band(VELOCITY, kind="prediction", draws=draws).standard_error
    np.testing.assert_allclose(found, expected, rtol=0.1)


def test_curves_are_over_the_draws(tmp_path):
    """The mean and the quantiles of a constant are those of the draws."""
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


SAMPLER = {"inference_library": "blackjax", "inference_library_version": "1.2"}


def of_two_sets(size, bad=False):
    """Draws of two sets' ε and noise: mass at ε = 1, and a prior that says all; chains apart if bad."""
    random, dims = np.random.default_rng(1), ("chain", "draw")
    normal = random.standard_normal((4, 4, size))
    apart = 0.02 * np.arange(4)[:, None] * bad
    shares = {"prior_share": 0.5713, "lower": 0.0, "upper": 1.0, "prior": "uniform, 0 to 1"}
    draws = {
        "restitution[balls 0]": (dims, 1 - 0.02 * np.abs(normal[0]), shares),
        "restitution[balls 1]": (dims, 0.9 + 0.007 * normal[1], {"prior_share": 0.7082}),
        "noise[balls 0]": (dims, 0.02 + 0.001 * normal[2] + apart, {"prior_share": 0.6934}),
    }
    energy = np.cumsum(normal[3], axis=1) if bad else normal[3]
    about = SAMPLER | {"warmup": size, "seed": 3}
    diverging = (dims, np.arange(4 * size).reshape(4, size) < bad)
    return made(
        posterior=xarray.Dataset(draws, attrs=about),
        sample_stats=xarray.Dataset({"diverging": diverging, "energy": (dims, energy)}),
    )


def test_the_command_writes_draws_picture_and_words_and_says_what_is_wrong(tmp_path, monkeypatch):
    text = ""
    for k, noise in enumerate(0.02 * np.random.default_rng(2).standard_normal((2, 12))):
        rows = [f"{v},{0.9 + e}" for v, e in enumerate(noise, 1)]
        (tmp_path / f"{k}.csv").write_text("velocity [m/s],restitution\n" + "\n".join(rows))
        text += f'[[material]]\nname = "balls {k}"\ndata = "{k}.csv"\n'
    (tmp_path / "a.toml").write_text(text)
    out, signature, given = tmp_path / "results", inspect.signature(cal.FitResult.posterior), {}

    def sampled(draws, *count):
        def posterior(*a, **k):
            given.update(signature.bind(*a, **k).arguments)
            return draws

        monkeypatch.setattr(cal.FitResult, "posterior", posterior)
        options = ("--law", "constant", "--seed", 3, "--no-profiles", "--out", out)
        code, printed, err = run("fit", tmp_path / "a.toml", "--posterior", *count, *options)
        assert (code, err) == (0, "")
        page = Tags((out / "report.html").read_text(encoding="utf-8"))
        section = page.paragraphs[page.paragraphs.index("## Posterior") :]
        listed = [x for x in page.paragraphs if x.startswith("- ")]
        entries = {x.split()[1].rstrip(":"): x for x in listed}
        (table,) = (table for table in page.tables if table[0][1] == "mean ± std. deviation")
        return printed, "\n\n".join(section), entries, table

    draws = of_two_sets(1000)
    printed, section, warned, table = sampled(draws)
    assert [given[name] for name in ("draws", "seed", "warmup")] == [1000, 3, 1000]
    assert {"posterior.nc", "posterior.png"} <= {path.name for path in out.iterdir()}
    expected = np.asarray(draws["posterior"]["restitution[balls 1]"])
    with xarray.open_dataset(out / "posterior.nc", group="posterior", engine="h5netcdf") as found:
        np.testing.assert_array_equal(found["restitution[balls 1]"], expected)
    (_, _, ends, *_), *table = table
    assert ends == "95 % interval"
    _, row, _ = table
    assert float(row[1].split(" ± ")[0]) == pytest.approx(np.mean(expected), abs=1e-3)
    low, high = (float(end) for end in row[2].split(" … "))
    assert [low, high] == pytest.approx(np.quantile(expected, [0.025, 0.975]), abs=1e-3)
    of_draws = {code for code, line in warned.items() if "(posterior)" in line}
    assert of_draws == {"mass-at-bound", "follows-prior"}
    as_recorded("posterior in words", {"printed": printed, "section": section})
    _, section, warned, _ = sampled(of_two_sets(100, bad=True), 100)
    as_recorded("a bad posterior", {"section": section})
    assert [given[name] for name in ("draws", "warmup")] == [100, 100]
    assert {"r-hat", "effective-size", "divergences", "funnel"} <= set(warned)


# without the packages of the extra

ABSENT = (
    "a posterior needs blackjax, which is not installed; "
    'install it with pip install -e ".[bayes]" in its folder'
)


def test_what_to_install_is_said_before_anything_is_fitted(decay, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "blackjax", None)  # as where it was never installed
    with pytest.raises(ImportError) as caught:
        decay.posterior()
    assert str(caught.value) == ABSENT
    words = ("--objective", "model", "--posterior", "--out", tmp_path / "results")
    assert run("fit", *words) == (2, "", ABSENT + "\n")
    assert not (tmp_path / "results").exists()
