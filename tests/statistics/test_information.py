"""Information: closed forms, a fit's own errors, planned points of each kind, and what simulations reach."""

from dataclasses import replace

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import fitted
from tests.covariance import covariance_of
from tests.decay import Decay
from tests.fit_data import twin

LAW = fitted("nylon")
CRITICAL = float(LAW.contact.critical_velocity)
BALANCE = sj.EnergyBalance()
DECAY = Decay(0.85, 0.04)
GRAVITY = 9.80665
QUICK = {"profiles": False, "starts": 1}


def curve(v):
    return 0.85 * np.exp(-0.04 * np.asarray(v))


def rows(v, level=0.85, rate=0.04):
    """Slopes of a e^{-bv} in ln a and ln b."""
    value = level * np.exp(-rate * np.asarray(v))
    return np.stack([value, -rate * np.asarray(v) * value], axis=-1)


def known(result):
    """A fit's own information on ln θ."""
    unit = np.array([result.values[name] for name in result.covariance_names])
    return np.linalg.inv(result.covariance / np.outer(unit, unit))


def test_each_impact_counts_with_its_own_uncertainty_and_a_prior_as_one_more():
    v, u = np.linspace(1.0, 9.0, 9), np.linspace(0.01, 0.05, 9)
    slopes = rows(v) / u[:, None]
    found = cal.fisher_information(DECAY, v, u)
    np.testing.assert_allclose(found.matrix, slopes.T @ slopes, rtol=1e-9)
    expected = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    np.testing.assert_allclose(list(found.relative_errors.values()), expected, rtol=1e-8)
    np.testing.assert_allclose(found.uncertainty, u)
    parameters = {"rate": cal.Parameter(free=False), "level": cal.Parameter(prior=(0.5, 0.01))}
    with_prior = cal.fisher_information(DECAY, v, u, parameters=parameters)
    assert with_prior.names == ("level",)
    expected = (np.sum(slopes[:, 0] ** 2) + (0.85 / 0.01) ** 2) ** -0.5
    assert with_prior.relative_errors["level"] == pytest.approx(expected, rel=1e-9)
    assert with_prior.standard_errors["level"] == pytest.approx(0.85 * expected, rel=1e-9)


def moved(name: str, factor: float) -> sj.Zhou:
    stem, _, leaf = name.rpartition(".")
    if not stem:
        return replace(LAW, **{leaf: getattr(LAW, leaf) * factor})
    contact = replace(LAW.contact, **{leaf: getattr(LAW.contact, leaf) * factor})
    return replace(LAW, contact=contact)


def by_differences(names, v, u):
    """J/u of ε by ln θ."""
    h, slopes = 1e-6, []
    for name in names:
        values = [sj.restitution(moved(name, 1 + s), v).coefficient for s in (h, -h)]
        slopes.append(np.asarray(values[0] - values[1]) / (2 * h) / u)
    return np.array(slopes)


def test_information_of_the_model_is_that_of_least_squares():
    """(JᵀWJ)⁻¹ with J by differences of ε, a modulus among the parameters."""
    v = np.linspace(0.2 * CRITICAL, 30 * CRITICAL, 12)
    u = np.linspace(0.001, 0.004, 12)
    names = ("chi", "sigma", "psi", "contact.youngs_modulus")
    found = cal.fisher_information(LAW, v, u, parameters={names[-1]: cal.Parameter()})
    slopes = by_differences(names, v, u)
    assert found.names == names
    np.testing.assert_allclose(found.matrix, slopes @ slopes.T, rtol=1e-5)
    expected = np.sqrt(np.diag(np.linalg.inv(found.matrix)))
    np.testing.assert_allclose(list(found.relative_errors.values()), expected, rtol=1e-5)


def test_directions_are_told_in_words_and_the_losses_above_yield_are_one_number():
    """χ̃ is as well known with σ and ψ, which are not, as with ε_up; of one velocity a e^{-bv} alone is known."""
    v = np.linspace(2.0, 80.0, 12) * CRITICAL
    by_eps_up = cal.fisher_information(LAW, v, 0.003)
    assert (by_eps_up.names, by_eps_up.symbols) == (("chi", "eps_up"), ("χ̃", "ε_up"))
    by_both = cal.fisher_information(LAW, v, 0.003, parameters={"sigma": cal.Parameter()})
    assert by_both.relative_errors["sigma"] is by_both.relative_errors["psi"] is None
    expected = by_eps_up.relative_errors["chi"]
    assert by_both.relative_errors["chi"] == pytest.approx(expected, rel=1e-6)
    v = np.concatenate([np.linspace(0.1, 0.9, 10), np.linspace(2, 80, 20)]) * CRITICAL
    words = cal.fisher_information(LAW, v, 0.01).words
    assert "σ and ψ only together" in words[-1]
    assert "will be known to" in words[0]
    better = cal.fisher_information(LAW, v, 0.0005).words
    assert all("will be known" in sentence for sentence in better)
    found = cal.fisher_information(DECAY, np.full(5, 25.0), 0.01)
    assert found.to_dict()["standard_errors"] == {"level": None, "rate": None}
    power = "a^0.71 · b^0.71"
    assert (
        found.words[-1]
        == f"a and b only together: {power} is not determined (these impacts have no information on it)"
    )


@pytest.mark.parametrize("below", [0, 4])
def test_a_product_is_known_as_its_sentence_says(below):
    """By the covariance of differences: a letter of a small exponent counts where its error is large."""
    v = np.append(np.geomspace(0.03, 0.6, below), np.geomspace(6.0, 250.0, 5)) * CRITICAL
    found = cal.fisher_information(LAW, v, 0.003)
    assert len(found.names) == (3 if below else 2)
    slopes = by_differences(found.names, v, 0.003) if below else None
    covariance = np.linalg.inv(slopes @ slopes.T) if below else found.covariance
    for sentence in (word for word in found.words if "will be known" in word):
        product, error = sentence.removesuffix(" %").split(" will be known to ")
        exponents = dict.fromkeys(found.symbols, 0.0)
        for factor in product.split(" · "):
            symbol, _, exponent = factor.partition("^")
            exponents[symbol] = float(exponent or 1)
        power = np.array(list(exponents.values()))
        known = 100 * np.sqrt(power @ covariance @ power)
        assert known == pytest.approx(float(error), rel=0.15)


def test_an_impact_without_rebound_tells_nothing():
    """Far above what a soft, lossy contact gives back: ε = 0 whatever χ̃ is."""
    law, v = fitted("nylon", chi=3.0, sigma=3.0), np.append(np.linspace(1.0, 20.0, 11), 180.0)
    coefficient = np.asarray(sj.restitution(law, v).coefficient)
    np.testing.assert_array_equal(coefficient == 0, v > 100)
    with_it = cal.fisher_information(law, v, 0.01)
    np.testing.assert_allclose(with_it.matrix, cal.fisher_information(law, v[:-1], 0.01).matrix)


class Idle(Decay):
    """A field that acts on nothing."""

    idle: float = sj.number_field("i", within="(0, inf)", default=1.0)


def decays(count: int, noise: float, **options) -> list[cal.RestitutionData]:
    """Data sets of laws of one kind, some more alike than their noise."""
    random, v = np.random.default_rng(3), np.linspace(1.0, 12.0, 12)
    rates = 0.04 * (1 + 0.05 * random.standard_normal(count))
    curves = [0.85 * np.exp(-rate * v) + noise * random.standard_normal(12) for rate in rates]
    pairs = zip("abcdefgh", curves, strict=False)
    return [cal.RestitutionData(v, e, None, noise, name, **options) for name, e in pairs]


FITS = {  # (data, law, options of the fit, a data set of it)
    "priors": (
        lambda: twin("nylon", noise=0.003, seed=1, uncertainty=0.003),
        None,
        {"parameters": {"chi": cal.Parameter(prior=(0.2, 0.01))}, "route": BALANCE},
        None,
    ),
    "pooled": (
        lambda: decays(6, 0.03),
        Decay,
        {"parameters": {"rate": cal.Parameter(shared="pooled")}},
        "b",
    ),
    "velocities with errors": (lambda: decays(1, 0.01, velocity_uncertainty=0.5), Decay, {}, None),
    "a shared parameter that is not determined": (
        lambda: decays(2, 0.01),
        Idle,
        {"parameters": {"idle": cal.Parameter(1.0, shared=True)}},
        "b",
    ),
}


@pytest.mark.parametrize("case", FITS)
def test_of_a_fit_without_further_shots_it_is_the_fits_own_covariance(case):
    """Priors, pools, shared parameters and all uncertainties are the fit's own."""
    make, law, options, material = FITS[case]
    result = cal.fit(make(), law, **QUICK | options)
    found = cal.fisher_information(result, material=material)
    errors = {name: result.standard_errors[name] for name in found.names}
    assert found.standard_errors == pytest.approx(errors, rel=1e-4)
    if law is Idle:
        assert found.names == ("level[b]", "rate[b]")
        assert found.taken_as_known[0].startswith("idle is not determined")


def specimens(seed=3, groups=6, each=5, more=()):
    """Impacts of each specimen around a velocity of its own; further ones of new specimens."""
    random = np.random.default_rng(seed)
    label = np.append(np.repeat(np.arange(groups), each), groups + np.arange(len(more)))
    v = np.append(np.linspace(1.0, 12.0, groups * each), more)
    e = curve(v) + 0.02 * random.standard_normal(groups + len(more))[label]
    e += 0.01 * random.standard_normal(len(v))
    return cal.RestitutionData(v, e, group=[f"s{k}" for k in label])


def test_further_shots_are_of_specimens_of_their_own():
    """They add to what the fit knows, with scatter and the offset of another group."""
    result, v = cal.fit(specimens(), Decay, **QUICK), np.array([3.0, 20.0, 20.0])
    before, variance = known(result), sum(result.materials[0].variances.values())
    slopes = rows(v, result.values["level"], result.values["rate"])
    found = cal.fisher_information(result, v)
    np.testing.assert_allclose(found.matrix, before + slopes.T @ slopes / variance, rtol=1e-6)
    np.testing.assert_allclose(found.uncertainty, np.sqrt(variance), rtol=1e-9)
    finer = cal.fisher_information(result, v, 0.002)
    np.testing.assert_allclose(finer.matrix, before + slopes.T @ slopes / 0.002**2, rtol=1e-6)
    np.testing.assert_allclose(finer.covariance, np.linalg.inv(finer.matrix), rtol=1e-6)


# planned points of the kind that a fit's data are


def drops(v, noise=0.0):
    """Heights to 2 mm, both."""
    drop = v**2 / (2 * GRAVITY)
    random = np.random.default_rng(1)
    heights = (h + noise * random.standard_normal(len(v)) for h in (drop, curve(v) ** 2 * drop))
    table = dict(zip(("drop_height", "rebound_height"), heights, strict=True))
    return cal.RestitutionData.from_table(table, height_uncertainty=0.002)


def pairs(v):
    """Velocities to 1 % and 2 %."""
    table = {"impact_velocity": v, "rebound_velocity": curve(v) * v}
    stated = {"impact_velocity_uncertainty": "1 %", "rebound_velocity_uncertainty": "2 %"}
    return cal.RestitutionData.from_table(table, **stated)


def bounces(v):
    """Two flights of a launch each, times to 2 ms."""
    times = np.stack([np.ones_like(v), curve(v)], axis=1) * 2 * v[:, None] / GRAVITY
    table = {"launch": np.repeat([f"l{k}" for k in range(len(v))], 2), "interval": times.ravel()}
    return cal.RestitutionData.from_table(table, interval_uncertainty=0.002)


def stated(v):
    """ε with an uncertainty of its own, at velocities with one."""
    return cal.RestitutionData(v, curve(v), None, 0.01, velocity_uncertainty=0.05)


KINDS = {"drops": drops, "pairs": pairs, "bounces": bounces, "stated": stated}


@pytest.mark.parametrize("kind", KINDS)
def test_a_planned_point_has_the_errors_of_a_measured_one(kind):
    """Planned where data of the kind were measured, it has their variances about the curve."""
    data = KINDS[kind](np.linspace(1.0, 6.0, 10))
    found = cal.fisher_information(cal.fit(data, Decay, **QUICK), data.velocity)
    expected = np.diag(covariance_of(data, -0.04 * curve(data.velocity)))
    # to first order in the error of the velocity
    np.testing.assert_allclose(found.uncertainty**2, expected, rtol=5e-3)


def test_a_drop_of_some_centimetres_is_known_worse_than_one_of_metres():
    """ε = √(h₂/h₁): u = ε/2 √((u/h₁)² + (u/h₂)²) and what the error of v adds; no plan asks for low drops."""
    result = cal.fit(drops(np.linspace(1.0, 6.0, 10), 0.002), Decay, **QUICK)
    v = np.array([0.4, 1.0, 6.0])
    found = cal.fisher_information(result, v)
    level, rate = result.values["level"], result.values["rate"]
    h, e = v**2 / (2 * GRAVITY), level * np.exp(-rate * v)
    of_drop = -e / (2 * h) + rate * e * v / (2 * h)
    expected = 0.002 * np.hypot(of_drop, 1 / (2 * h * e))
    np.testing.assert_allclose(found.uncertainty, expected, rtol=1e-5)
    both = (result.band(v, kind=kind).standard_error for kind in ("mean", "prediction"))
    curve_s, one_s = both  # one measurement model: a band of predictions has the same errors
    np.testing.assert_allclose(np.sqrt(one_s**2 - curve_s**2), expected, rtol=1e-5)
    design = cal.optimal_velocities(result, 4, (0.3, 8.0), target="level", starts=2)
    assert np.min(design.velocity) > 1.0
    assert "Velocities allowed: 0.3 to 8 m/s; planned" in str(design)
