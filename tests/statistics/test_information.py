"""Information: closed forms, a fit's own errors, planned points of each kind; designs by brute force."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests.cases import fitted
from tests.covariance import covariance_of
from tests.coverage.test_coverage import drops as skewed_drops
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


class Line(sj.HardSphereLaw):
    """ε = a + b v."""

    level: float
    slope: float

    def restitution_squared(self, velocity):
        return (self.level + self.slope * velocity) ** 2


def rows(v, level=0.85, rate=0.04):
    """Slopes of a e^{-bv} in ln a and ln b."""
    value = level * np.exp(-rate * np.asarray(v))
    return np.stack([value, -rate * np.asarray(v) * value], axis=-1)


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
    of_zero = cal.fisher_information(Line(0.85, 0.0), v, u)  # a slope of 0 has no logarithm
    slopes = np.stack([np.ones(9), v], axis=1) / u[:, None]
    expected = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    np.testing.assert_allclose(list(of_zero.standard_errors.values()), expected, rtol=1e-8)
    assert of_zero.relative_errors["slope"] == pytest.approx(expected[1], rel=1e-8)


def by_differences(names, v, u):
    """J/u of ε by ln θ."""
    h, slopes = 1e-6, []

    def coefficient(name, factor):
        owner = LAW.contact if name.startswith("contact.") else LAW
        leaf = name.removeprefix("contact.")
        one = replace(owner, **{leaf: getattr(owner, leaf) * factor})
        return sj.restitution(one if owner is LAW else replace(LAW, contact=one), v).coefficient

    for name in names:
        slopes.append(np.subtract(*(coefficient(name, 1 + s) for s in (h, -h))) / (2 * h) / u)
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


def test_the_losses_above_yield_are_one_number_and_what_nothing_tells_is_not_determined():
    """χ̃ is as well known with σ and ψ, which are not, as with ε_up; of one velocity neither a nor b is known."""
    v = np.linspace(2.0, 80.0, 12) * CRITICAL
    by_eps_up = cal.fisher_information(LAW, v, 0.003)
    assert (by_eps_up.names, by_eps_up.symbols) == (("chi", "eps_up"), ("χ̃", "ε_up"))
    by_both = cal.fisher_information(LAW, v, 0.003, parameters={"sigma": cal.Parameter()})
    assert by_both.relative_errors["sigma"] is by_both.relative_errors["psi"] is None
    expected = by_eps_up.relative_errors["chi"]
    assert by_both.relative_errors["chi"] == pytest.approx(expected, rel=1e-6)
    text = f"expected standard error of χ̃: {LAW.chi * expected:.3g} ({100 * expected:.2g} %)"
    assert f"{text}\nexpected standard error of σ: not determined\n" in str(by_both)
    found = cal.fisher_information(DECAY, np.full(5, 25.0), 0.01)
    assert found.to_dict()["standard_errors"] == {"level": None, "rate": None}
    idle = cal.fisher_information(Idle(0.9, 0.05, 1.0), np.linspace(1.0, 25.0, 5), 0.01)
    assert idle.relative_errors["idle"] is None
    assert idle.relative_errors["rate"] is not None


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
    assert found.before == found.relative_errors
    if law is Idle:
        assert found.names == ("level[b]", "rate[b]")
        assert found.taken_as_known[0].startswith("idle is not determined")


def test_further_shots_are_of_specimens_of_their_own():
    """They add to what the fit knows, with scatter and the offset of another group."""
    random, label = np.random.default_rng(3), np.repeat(np.arange(6), 5)
    at = np.linspace(1.0, 12.0, 30)
    e = curve(at) + 0.02 * random.standard_normal(6)[label] + 0.01 * random.standard_normal(30)
    data = cal.RestitutionData(at, e, group=[f"s{k}" for k in label])
    result, v = cal.fit(data, Decay, **QUICK), np.array([3.0, 20.0, 20.0])
    unit = np.array([result.values[name] for name in result.covariance_names])
    before = np.linalg.inv(result.covariance / np.outer(unit, unit))
    variance = sum(result.materials[0].variances.values())
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


@pytest.mark.parametrize("air", [True, False])
def test_a_plan_says_that_it_takes_the_drag_as_known(air):
    """100 more drops of this light ball would leave ln b to 1.8 %, for the drag, where 0.87 % are promised."""
    v = np.linspace(1.0, 6.0, 12)
    drop = v**2 / (2 * GRAVITY)
    table = {"drop_height": drop, "rebound_height": curve(v) ** 2 * drop}
    ball = {"diameter": 0.02, "density": 1200.0, "air": air}
    data = cal.RestitutionData.from_table(table, height_uncertainty=0.001, **ball)
    found = cal.fisher_information(cal.fit(data, Decay, **QUICK), v)
    assert ["air_drag" in line for line in found.taken_as_known] == [True] * air
    assert ("air_drag" in str(found)) == air


def test_a_plan_says_that_errors_of_a_skewed_likelihood_are_of_its_curvature():
    """Where the fit's table prints no ± the plan does not have its number without a word."""
    result = cal.fit(skewed_drops(np.random.default_rng(0)), starts=1)
    names = [name for name in ("chi", "eps_up") if result.estimates[name].standard_error is None]
    assert names
    text = f"the likelihood is skewed in {' and '.join(names)}: "
    assert text in str(cal.fisher_information(result, [2.0]))
    design = cal.optimal_velocities(result, 2, (1.0, 4.0), starts=1)
    assert text in str(design)
    plain = cal.fit(drops(np.linspace(1.0, 6.0, 12), 0.001), Decay, starts=1)
    assert not any(e.skewed for e in plain.estimates.values())
    assert "skewed" not in str(cal.fisher_information(plain, [2.0]))


def test_a_planned_point_with_heavy_tails_counts_as_fisher_says():
    """E[(∂ln p/∂ε)²] of Student's t with 5 degrees of freedom, by quadrature; of an own uncertainty normal."""
    v, scale, shots = np.linspace(1.0, 6.0, 10), 0.01, np.array([2.0, 2.0, 5.0])
    data = cal.RestitutionData(v, curve(v), None, scale)
    result = cal.fit(data, Decay, noise="student-t", noise_dof=5, **QUICK)
    each = stats.t(5).expect(lambda x: (6 * x / (5 + x**2)) ** 2) / scale**2
    slopes = rows(shots, *(result.values[name] for name in ("level", "rate")))
    before = cal.fisher_information(result, shots, uncertainty=1e6).matrix
    for options, one in (({}, each), ({"uncertainty": scale}, scale**-2)):
        found = cal.fisher_information(result, shots, **options).matrix - before
        np.testing.assert_allclose(found, one * slopes.T @ slopes, rtol=1e-4)


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


# designs

BOUNDS = (1.0, 60.0)


def covariance(v, noise=0.01, **law):
    slopes = rows(v, **law) / noise
    return np.linalg.inv(slopes.T @ slopes)


VARIANCES = {
    "c": lambda c: c[1, 1],
    "D": lambda c: math.sqrt(np.linalg.det(c)),
}


def brute_force(criterion: str, count: int) -> float:
    """The least variance of designs at two velocities, which two parameters need, however split."""
    found = []
    for first in range(1, count):

        def variance(pair, first=first):
            v = np.repeat(pair, [first, count - first])
            return math.log(VARIANCES[criterion](covariance(v)))

        spread = np.linspace(*BOUNDS, 13)
        pairs = [(a, b) for a in spread for b in spread if b > a]
        start = min(pairs, key=variance)
        inside = {"method": "Nelder-Mead", "bounds": [BOUNDS] * 2, "options": {"xatol": 1e-8}}
        found.append(optimize.minimize(variance, start, **inside).fun)
    return min(found)


@pytest.mark.parametrize("criterion", VARIANCES)
def test_each_criterion_is_as_small_as_a_brute_force_search_makes_it(criterion):
    """And no random design is better."""
    aim, variance = {"target": "rate"} if criterion == "c" else {}, VARIANCES[criterion]
    found = cal.optimal_velocities(DECAY, 5, BOUNDS, criterion=criterion, starts=4, **aim)
    reached = math.log(variance(covariance(found.velocity)))
    assert reached == pytest.approx(brute_force(criterion, 5), abs=1e-5)
    even = math.log(variance(covariance(np.linspace(*BOUNDS, 5))))
    assert found.gain == pytest.approx(math.exp(0.5 * (even - reached)), rel=5e-3)
    assert found.gain > 1.05
    here, now, spaced = found.minimised
    assert now is None
    assert (here, spaced) == pytest.approx(np.exp([0.5 * reached, 0.5 * even]), rel=0.02)
    assert f"(criterion {criterion}) will be {here:.3g}; it would be {spaced:.3g}" in str(found)
    errors = np.sqrt(np.diag(covariance(found.velocity)))
    np.testing.assert_allclose(list(found.relative_errors.values()), errors, rtol=1e-6)
    random = np.random.default_rng(4)
    others = [math.log(variance(covariance(random.uniform(*BOUNDS, 5)))) for _ in range(200)]
    assert min(others) > reached - 1e-6


def test_the_best_place_for_two_parameters_of_a_decay_is_known():
    """Box and Lucas, Biometrika 46, 77 (1959): half at the lowest velocity, half 1/b above it."""
    calls = []
    options = {"criterion": "D", "starts": 3, "progress": lambda *call: calls.append(call)}
    found = cal.optimal_velocities(DECAY, 8, BOUNDS, **options)
    assert found.support == [(1.0, 4), (pytest.approx(26.0, rel=1e-4), 4)]
    assert calls == [("velocities", k, 3) for k in (1, 2, 3)]
    first, second, *_ = str(found).splitlines()
    assert first == "Best shots: 4 at 1 m/s (ε = 0.817 ± 0.01), 4 at 26 m/s (ε = 0.300 ± 0.01)."
    start = "The geometric mean of the standard errors of ln θ, correlations included (criterion D) will be "
    assert second.startswith(f"{start}{found.minimised[0]:.3g}; it would be ")
    assert second.endswith(" with shots equally spaced.")
    text = "Velocities allowed: 1 to 60 m/s; planned 1 to 26 m/s, standard uncertainty of ε 0.01."
    assert text in str(found)
    assert "cannot test the law" not in str(found)
    table = found.to_dict()
    assert table["support"][0] == {"velocity": 1.0, "shots": 4}
    assert table["relative_errors"] == found.relative_errors
    odd = cal.optimal_velocities(DECAY, 7, BOUNDS, criterion="D", starts=3, seed=7)
    assert sorted(count for _, count in odd.support) == [3, 4]
    again = cal.optimal_velocities(DECAY, 7, BOUNDS, criterion="D", starts=3, seed=7)
    np.testing.assert_array_equal(odd.velocity, again.velocity)


def test_of_one_parameter_all_shots_are_where_it_acts_most():
    """|∂ε/∂ln b| = a b v e^{-bv} is largest at v = 1/b; one velocity cannot test the law."""
    fixed = {"level": cal.Parameter(free=False)}
    found = cal.optimal_velocities(DECAY, 5, BOUNDS, parameters=fixed, uncertainty=0.02)
    assert found.target == "rate"
    assert found.support == [(pytest.approx(25.0, rel=1e-4), 5)]
    error = 0.02 / (0.85 * math.exp(-1) * math.sqrt(5))
    assert found.relative_errors["rate"] == pytest.approx(error, rel=1e-6)
    assert found.uncertainty == pytest.approx(np.full(5, 0.02))
    assert "Shots at one velocity cannot test the law" in str(found)


def test_what_follows_from_the_parameters_is_a_target():
    """ε_up is measured at v_cr, from where on nothing else tells it."""
    found = cal.optimal_velocities(LAW, 6, (0.1, 60.0), target="eps_up", starts=1)
    assert found.support == [(pytest.approx(CRITICAL, rel=1e-3), 6)]
    eps_up = float(sj.restitution(LAW, CRITICAL).coefficient)
    expected = found.uncertainty[0] / math.sqrt(6) / eps_up
    assert found.relative_errors["eps_up"] == pytest.approx(expected, rel=1e-3)
    assert found.relative_errors["sigma"] is None


def test_what_is_measured_already_counts():
    old = np.linspace(1.0, 20.0, 10)
    options = {"measured": old, "measured_uncertainty": 0.002, "uncertainty": 0.01}
    found = cal.optimal_velocities(DECAY, 3, BOUNDS, target="rate", **options)
    before = np.linalg.inv(covariance(old, 0.002))
    new = rows(found.velocity) / 0.01
    after = np.linalg.inv(before + new.T @ new)
    assert found.relative_errors["rate"] == pytest.approx(math.sqrt(after[1, 1]), rel=1e-6)
    expected = math.sqrt(np.linalg.inv(before)[1, 1])
    assert found.before["rate"] == pytest.approx(expected, rel=1e-6)
    assert found.minimised[1] == pytest.approx(expected, rel=1e-6)
    assert f"it is {expected:.3g} now, and would be" in str(found)
    # what was measured has the uncertainty of the new ones where no other is stated, or the usual one
    for stated, u in (({"uncertainty": 0.02}, 0.02), ({}, 0.01)):
        found = cal.optimal_velocities(DECAY, 3, BOUNDS, target="rate", measured=old, **stated)
        expected = math.sqrt(covariance(old, u)[1, 1])
        assert found.before["rate"] == pytest.approx(expected, rel=1e-6)


def test_as_few_shots_as_reach_a_precision_and_else_the_best_there_is():
    """n shots at a restitution of 0.8 to 0.01 leave 1.25 %/√n; a decay's ε at a velocity by (JᵀJ)⁻¹."""
    law, options = sj.ConstantRestitution(None, 0.8), {"starts": 2}
    for precision, count in ((0.013, 1), (0.003, 18), (0.00125, 100)):
        found = cal.optimal_velocities(law, None, BOUNDS, precision=precision, **options)
        assert len(found.velocity) == count
        assert found.minimised[0] == pytest.approx(0.0125 / count**0.5, rel=1e-4)
    message = r"`precision` must be 0.04 % or more, the best that 1000 shots from 1 to 60 m/s bring, but is 0.01 %"
    with pytest.raises(ValueError, match=message):
        cal.optimal_velocities(law, None, BOUNDS, precision=1e-4, **options)
    known = {"measured": np.full(25, 2.0), "measured_uncertainty": 0.01}
    with pytest.raises(
        ValueError, match=r"must be below 0.25 %, which is known already, but is 1 %"
    ):
        cal.optimal_velocities(law, None, BOUNDS, precision=0.01, **known)
    options = {"target": "eps@40", "precision": 0.01, "starts": 4}
    found = cal.optimal_velocities(DECAY, None, BOUNDS, **options)
    at = rows([40.0])[0] / curve(40.0)
    reached = math.sqrt(at @ covariance(found.velocity) @ at)
    assert found.relative_errors["eps@40"] == pytest.approx(reached, rel=1e-5)
    assert reached <= 0.01
    assert f"The standard error of ln ε(40 m/s) (criterion c) will be {reached:.3g}" in str(found)
    fewer = len(found.velocity) - 1
    random = np.random.default_rng(0)
    pairs = [np.repeat([a, 40.0], [n, fewer - n]) for n in range(1, fewer) for a in (1.0, 60.0)]
    pairs += [np.full(fewer, 40.0) * random.uniform(0.9, 1.1, fewer) for _ in range(200)]
    assert all(at @ covariance(v) @ at > 0.01**2 for v in pairs)


def test_shots_at_a_data_set_are_aimed_at_its_own_parameter():
    """A shared rate joins two data sets; of the other one's level these shots tell little."""
    shared = {"rate": cal.Parameter(shared=True)}
    result = cal.fit(decays(2, 0.01), Decay, shared, **QUICK)
    options = {"material": "b", "starts": 1}
    found = cal.optimal_velocities(result, 4, (1.0, 20.0), **options)
    assert found.target == "level[b]"
    assert found.support == [(1.0, 4)]  # where ε depends on the rate least
    named = cal.optimal_velocities(result, 4, (1.0, 20.0), target="rate", **options)
    assert named.support[0][0] > 10.0
