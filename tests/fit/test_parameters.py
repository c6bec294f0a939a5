"""Parameters that are fixed, bounded, shared, pooled or have a prior; what changes nothing."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.decay import Decay, decay
from tests.fit_data import TRUTH, pair, twin

QUICK = {"profiles": False, "starts": 4}
Free = cal.Parameter
V = np.linspace(1, 40, 24)


def decays(count=24, seed=5, noise=0.005, truth=(0.9, 0.01), **options):
    velocity = np.linspace(1, 40, count)
    errors = noise * np.random.default_rng(seed).standard_normal(count)
    return cal.RestitutionData(velocity, decay(velocity, *truth) + errors, **options)


def test_a_number_fixes_and_a_bound_is_kept():
    """The rate that SciPy finds with the level at its number, or at its bound; then one-sided."""
    data = decays(uncertainty=0.005)
    for parameters in ({"level": 0.88}, {"level": Free(bounds=(0.5, 0.88))}):
        result = cal.fit(data, Decay, parameters, starts=4)
        assert result.values["level"] == pytest.approx(0.88, rel=1e-6)
        rate, covariance, _ = fit_oracle.fit(
            lambda b: decay(V, 0.88, b), [0.01], data.restitution, data.uncertainty
        )
        assert result.values["rate"] == pytest.approx(rate[0], rel=1e-5)
        error = result.standard_errors["rate"]
        assert error == pytest.approx(covariance[0, 0] ** 0.5, rel=1e-4)
        free = isinstance(parameters["level"], cal.Parameter)
        assert result.estimates["level"].at_bound == result.estimates["level"].free == free
        none = result.standard_errors["level"]
        assert np.isnan(none) if free else none is None
        assert ("at-bound" in {warning.code for warning in result.warnings}) == free
        assert ("level" in result.covariance_names) == free


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_an_interval_from_an_end_of_the_range_is_closed(end):
    """Of n points at the bound itself: Δχ² = n (ε - bound)²/u² reaches the quantile."""
    data = cal.RestitutionData([1.0, 2.0, 3.0], np.full(3, end), uncertainty=0.01)
    low, high = cal.fit(data, "constant", starts=4).intervals["restitution"]
    limit = abs(end - 0.01 * np.sqrt(stats.chi2.ppf(0.95, 1) / 3))
    assert (low, high) == pytest.approx(sorted((end, limit)), rel=1e-3)


@pytest.mark.parametrize("scale", ["logit", "none"])
def test_limits_without_profiles_are_symmetric_on_the_scale_that_is_searched(scale):
    data = decays(uncertainty=0.005)
    spec = {"logit": Free(bounds=(0.5, 1.0)), "none": Free(transform="none")}
    result = cal.fit(data, Decay, {"level": spec[scale]}, **QUICK)
    to = {"logit": lambda x: np.log((x - 0.5) / (1 - x)), "none": lambda x: x}[scale]
    value, error = result.values["level"], result.standard_errors["level"]
    slope = {"logit": 1 / (value - 0.5) + 1 / (1 - value), "none": 1.0}[scale]
    reach = stats.norm.ppf(0.975) * error * slope
    low, high = (to(end) - to(value) for end in result.intervals["level"])
    np.testing.assert_allclose([-low, high], reach, rtol=1e-6)


def test_a_prior_is_one_more_measurement():
    """By SciPy's least squares with one more row; an unknown noise and the fit take turns."""
    data = decays(200)
    parameters = {"level": Free(0.8), "rate": Free(0.02, prior=(0.0105, 0.0001))}
    result, v = cal.fit(data, Decay, parameters, **QUICK), data.velocity
    size = 0.005
    for _ in range(30):

        def residual(x, size=size):
            return np.append((decay(v, *x) - data.restitution) / size, (x[1] - 0.0105) / 0.0001)

        found = optimize.least_squares(
            residual, [0.9, 0.01], "3-point", x_scale=[1, 0.01], xtol=1e-15
        )
        expected = np.linalg.inv(found.jac.T @ found.jac)
        covariance = np.linalg.inv(fit_oracle.curvature(residual, found.x, found.jac))
        paid = np.sum((found.jac[:200] @ expected) * found.jac[:200])
        size = np.sqrt(np.sum((found.fun[:200] * size) ** 2) / (200 - paid))
    np.testing.assert_allclose([result.values[n] for n in ("level", "rate")], found.x, rtol=1e-6)
    errors = [result.standard_errors[n] for n in ("level", "rate")]
    # an unknown noise makes them larger by what Kenward and Roger allow for
    np.testing.assert_allclose(errors, np.sqrt(np.diag(covariance)), rtol=2e-3)
    assert result.materials[0].noise == pytest.approx(size, rel=1e-5)
    profiled = cal.fit(data, Decay, parameters, starts=4).intervals["rate"]
    reach = stats.t.ppf(0.975, 200 - paid) * np.sqrt(covariance[1, 1])
    assert profiled == pytest.approx((found.x[1] - reach, found.x[1] + reach), abs=0.02 * reach)


def test_what_is_shared_is_one_parameter():
    """Of two sets of three, in a group: SciPy's joint fit; the third is as alone."""
    a, b, c = (decays(12, seed, uncertainty=0.005, name=n) for seed, n in enumerate("abc"))
    parameters = {f"rate[{name}]": Free(shared="both") for name in "ab"}
    result = cal.fit([a, b, c], Decay, parameters, **QUICK)
    assert result.values["rate[a]"] == result.values["rate[b]"] == result.values["rate[both]"]
    assert set(result.covariance_names) == {f"level[{n}]" for n in "abc"} | {
        "rate[both]",
        "rate[c]",
    }
    v = a.velocity
    values, covariance, _ = fit_oracle.fit(
        lambda one, two, rate: np.append(decay(v, one, rate), decay(v, two, rate)),
        [0.9, 0.9, 0.01],
        np.append(a.restitution, b.restitution),
        np.full(24, 0.005),
    )
    labels = ("level[a]", "level[b]", "rate[both]")
    np.testing.assert_allclose([result.values[n] for n in labels], values, rtol=1e-6)
    order = [result.covariance_names.index(n) for n in labels]
    np.testing.assert_allclose(result.covariance[np.ix_(order, order)], covariance, rtol=1e-4)
    alone = cal.fit(c, Decay, **QUICK)
    assert result.values["rate[c]"] == pytest.approx(alone.values["rate"], rel=1e-8)
    error = result.standard_errors["rate[c]"]
    assert error == pytest.approx(alone.standard_errors["rate"], rel=1e-6)


def test_a_spread_of_none_is_the_fit_of_a_shared_parameter():
    """χ̃ of four sets alike, whose σ hardly shows: ln L, every χ̃ and their mean are those of one that is shared."""
    y = np.concatenate([np.linspace(0.2, 0.9, 5), np.geomspace(1.3, 40, 10)])
    sets = [twin("chrome steel", y, 0.01, 100 + k, uncertainty=0.01) for k in range(4)]
    sets = [replace(data, name=f"set {k}") for k, data in enumerate(sets)]
    pooled, shared = (
        cal.fit(sets, None, {"chi": Free(shared=how)}, profiles=False) for how in ("pooled", True)
    )
    assert pooled.values["chi_spread"] == 0
    assert pooled.values["chi"] == pytest.approx(shared.values["chi"], rel=1e-6)
    for data in sets:
        assert pooled.values[f"chi[{data.name}]"] == pytest.approx(shared.values["chi"], rel=1e-6)
    squares = [sum(m.rms**2 for m in result.materials) for result in (pooled, shared)]
    assert squares[0] == pytest.approx(squares[1], rel=1e-6)


def test_what_is_said_of_one_set_s_bodies_is_of_that_set_alone():
    """Beside another that it shares a parameter with: as if its bodies had it of themselves."""
    steel, _, nylon = cal.paper_materials(10)
    options = QUICK | {"objective": "two-step", "unloading_line": None, "starts": 1}
    options |= {"route": sj.EnergyBalance()}
    psi = {"psi": Free(shared=True)}
    by_parameter = cal.fit(
        [steel, nylon], None, psi | {"contact.limit_velocity[nylon]": 400.0}, **options
    )
    bodies = replace(nylon.contact, limit_velocity=400.0)
    by_data = cal.RestitutionData(nylon.velocity, nylon.restitution, bodies, name="nylon")
    alone = cal.fit([steel, by_data], None, psi, **options)
    for name in ("chi[stainless steel]", "chi[nylon]", "sigma[nylon]", "psi"):
        assert by_parameter.values[name] == pytest.approx(alone.values[name], rel=1e-6), name


@pytest.mark.parametrize("lowest", [0.2, 1.3])
def test_a_yield_strength_that_is_free_is_found(lowest):
    """With one point below yield or none, where the search begins with several."""
    data = twin("nylon", y=np.linspace(lowest, 30, 12))
    strength = float(data.contact.yield_strength)
    wrong = replace(data, contact=replace(data.contact, yield_strength=1.7 * strength))
    specs = {"contact.yield_strength": Free(), "sigma": TRUTH["nylon"][2], "psi": TRUTH["nylon"][3]}
    for one in (wrong, data):
        result = cal.fit(one, None, specs, **QUICK)
        assert result.values["contact.yield_strength"] == pytest.approx(strength, rel=1e-4)
        assert result.values["chi"] == pytest.approx(TRUTH["nylon"][1], rel=1e-3)
        assert float(result.law.contact.yield_strength) == pytest.approx(strength, rel=1e-4)


def test_strengths_of_two_sets_are_on_the_branches_that_their_noises_make_best():
    """SciPy's largest ln L over χ̃, both strengths and noises, from every choice of elastic points."""
    best = (1.214024437, {"nylon": 1.01555943, "stainless steel": 0.84375325})
    sets = []
    for name, noise, seed in (("nylon", 0.004, 9), ("stainless steel", 0.02, 19)):
        contact, y = pair(name), np.geomspace(0.3, 10, 10)
        v = y * float(contact.critical_velocity)
        exact = fit_oracle.curve(v, fit_oracle.numbers(contact), 1.2, 0.43, 0.54)
        eps = exact + noise * np.random.default_rng(seed).standard_normal(10)
        sets.append(cal.RestitutionData(v, eps, contact, name=name))
    specs = {"contact.yield_strength": Free(), "chi": Free(shared=True), "sigma": 0.43, "psi": 0.54}
    result = cal.fit(sets, None, specs, profiles=False, starts=1)

    def log_likelihood(chi, factors):
        total = 0.0
        for data in sets:
            numbers = fit_oracle.numbers(data.contact)
            numbers["Y"] *= factors[data.name]
            curve = fit_oracle.curve(data.velocity, numbers, chi, 0.43, 0.54)
            off = curve - data.restitution
            total += np.sum(stats.norm.logpdf(off, scale=np.sqrt(np.mean(off**2))))
        return total

    assert result.log_likelihood == pytest.approx(log_likelihood(*best), abs=1e-5)
    assert result.values["chi"] == pytest.approx(best[0], rel=1e-4)
    for data in sets:
        strength = best[1][data.name] * float(data.contact.yield_strength)
        of_set = result.values[f"contact.yield_strength[{data.name}]"]
        assert of_set == pytest.approx(strength, rel=1e-4)


def compared(one, other, names=("level", "rate"), less=0.0):
    """Estimates, errors and ln L of two fits are the same, the last but for a known constant."""
    for name in names:
        assert other.values[name] == pytest.approx(one.values[name], rel=1e-7)
        assert other.standard_errors[name] == pytest.approx(one.standard_errors[name], rel=1e-5)
    assert other.log_likelihood == pytest.approx(one.log_likelihood - less, rel=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_the_same_measurements_stated_otherwise_are_the_same_fit(seed):
    """In another order, with points given twice with u√2, in two sets of any name, and these turned round."""
    random, u = np.random.default_rng(seed), np.linspace(0.003, 0.008, 24)
    data = decays(uncertainty=u)
    one = cal.fit(data, Decay, **QUICK)
    left = one.leave_one_out()

    def of(rows, u=u, **options):
        options |= {"uncertainty": u[rows]}
        return cal.RestitutionData(V[rows], data.restitution[rows], **options)

    order = random.permutation(24)
    other = cal.fit(of(order), Decay, **QUICK)
    compared(one, other)
    densities = other.leave_one_out().log_density
    np.testing.assert_allclose(densities, left.log_density[order], atol=1e-6)
    twice = random.choice(24, 3, replace=False)
    wide = np.where(np.isin(np.arange(24), twice), np.sqrt(2) * u, u)
    known = np.sum(np.log(2 * np.sqrt(2 * np.pi) * u[twice]))  # of √2 u twice, in place of u
    doubled = of(np.append(np.arange(24), twice), wide)
    compared(one, cal.fit(doubled, Decay, **QUICK), less=known)
    cut, name = random.integers(6, 18), (" µ-9", "level[b]")[seed]
    parts = [of(slice(0, cut), name=name), of(slice(cut, 24), name=f"{name} 2")]
    shared = {n: Free(shared=True) for n in ("level", "rate")}
    split, turned = (cal.fit(sets, Decay, shared, **QUICK) for sets in (parts, parts[::-1]))
    compared(one, split)
    compared(split, turned)
    assert split.leave_one_out().elpd == pytest.approx(left.elpd, abs=1e-5)


def test_many_points_are_fitted_as_all_of_them():
    """20 000 points, beyond which neighbours are taken together on the way: SciPy's own fit of all."""
    data = decays(20_000)
    result = cal.fit(data, Decay, {"level": Free(0.9), "rate": Free(0.02)}, starts=1)
    model = lambda *x: decay(data.velocity, *x)  # noqa: E731
    values, covariance, _ = fit_oracle.fit(model, (0.9, 0.01), data.restitution)
    for k, (name, value) in enumerate(zip(("level", "rate"), values, strict=True)):
        error = covariance[k, k] ** 0.5
        assert result.values[name] == pytest.approx(value, abs=1e-4 * error)
        assert result.standard_errors[name] == pytest.approx(error, rel=1e-5)
        low, high = result.intervals[name]
        ends = stats.t.ppf([0.025, 0.975], 19_998) * error
        np.testing.assert_allclose([low - value, high - value], ends, rtol=0.01)


def test_progress_goes_from_start_to_end():
    calls = []
    cal.fit(decays(), Decay, progress=lambda *args: calls.append(args), starts=2)
    for stage in ("fit", "profiles"):
        of_stage = [(done, total) for name, done, total in calls if name == stage]
        assert of_stage[0][0] == 0
        assert of_stage[-1][0] == of_stage[-1][1] > 0


def test_sets_with_sigma_and_sets_with_eps_up_are_one_fit_whose_file_is_read(tmp_path):
    """Above yield alone a set has ε_up; χ̃ may be shared with one that has σ and ψ."""
    full, above = twin("nylon"), twin("nylon", np.geomspace(1.2, 80, 30))
    sets = [replace(full, name="full"), replace(above, name="above")]
    result = cal.fit(sets, parameters={"chi": Free(shared=True)}, **QUICK)
    _, chi, sigma, psi, _ = TRUTH["nylon"]
    assert result.values["chi"] == pytest.approx(chi, rel=1e-6)
    assert result.values["sigma[full]"] == pytest.approx(sigma, rel=1e-6)
    assert result.values["psi[full]"] == pytest.approx(psi, rel=1e-6)
    up = result.material("full").derived["eps_up"].value
    assert result.values["eps_up[above]"] == pytest.approx(up, rel=1e-6)
    assert not {"sigma[above]", "psi[above]"} & set(result.values)
    result.save(tmp_path / "fit.json")
    assert cal.FitResult.load(tmp_path / "fit.json") == result


def test_sets_on_a_line_share_with_one_that_has_its_own_chi():
    names = ("stainless steel", "chrome steel", "nylon")
    sets = [twin(name) for name in names]
    line, single = {"c1": Free(), "c2": Free()}, {"chi": Free()}
    parameters = [{**one, "psi": Free(shared="all")} for one in (line, line, single)]
    result = cal.fit(sets, parameters=parameters, **QUICK)
    for name in names[:2]:
        ratio = float(result.material(name).contact.yield_ratio)
        on_line = result.values["c1"] + result.values["c2"] * ratio
        assert result.values[f"chi[{name}]"] == pytest.approx(on_line, rel=1e-9)
    assert result.material("nylon").free["chi"] == "chi[nylon]"


AT = np.linspace(1.0, 5.0, 6)
NAMES = ("a", "b", "c", "d", "e")
POOLED = {"restitution": cal.Parameter(shared="pooled", transform="none")}


def test_the_normal_model_in_closed_form(tmp_path):
    """And the members' errors given τ: (1/τ² + n/s²)⁻¹ about the mean, and the mean's own share."""
    random = np.random.default_rng(0)
    e = 0.8 + 0.03 * random.standard_normal((5, 1)) + 0.02 * random.standard_normal((5, 6))
    sets = [
        cal.RestitutionData(AT, row, name=name, uncertainty=0.02)
        for name, row in zip(NAMES, e, strict=True)
    ]
    result = cal.fit(sets, sj.ConstantRestitution, POOLED, profiles=False)
    # equal groups: μ, τ by the analysis of variance; members by shrinking their means
    means, variance = np.mean(e, axis=1), 0.02**2 / len(AT)
    mean, tau = np.mean(means), np.sqrt(np.var(means, ddof=1) - variance)
    members = mean + tau**2 / (tau**2 + variance) * (means - mean)
    assert tau > 0.01
    assert result.values["restitution_spread"] == pytest.approx(tau, rel=1e-4)
    assert result.values["restitution"] == pytest.approx(mean, rel=1e-6)
    found = [result.values[f"restitution[{name}]"] for name in NAMES]
    np.testing.assert_allclose(found, members, rtol=1e-5)
    error = np.sqrt((tau**2 + 0.02**2 / len(AT)) / len(NAMES))  # of the mean of equal specimens
    pool = result.pooled["restitution"]
    assert pool.standard_error == pytest.approx(error, rel=1e-4)
    reach = stats.t.ppf(0.975, len(NAMES) - 1) * error
    assert (pool.low, pool.high) == pytest.approx((mean - reach, mean + reach), rel=1e-4)
    precision = (len(AT) / 0.02**2) * np.eye(len(NAMES))
    precision += (np.eye(len(NAMES)) - 1 / len(NAMES)) / tau**2  # the mean integrated over
    errors = [result.standard_errors[f"restitution[{name}]"] for name in NAMES]
    np.testing.assert_allclose(errors, np.sqrt(np.diag(np.linalg.inv(precision))), rtol=1e-4)
    assert result.converged
    assert result.log_likelihood is None
    result.save(tmp_path / "fit.json")
    assert cal.FitResult.load(tmp_path / "fit.json") == result


def test_specimens_that_are_alike_have_no_spread():
    """Fewer differences than the noise makes: τ = 0, as if the parameter were shared."""
    sets = [
        cal.RestitutionData(AT, 0.8 + 0.02 * np.cos(3 * AT + k), name=n, uncertainty=0.05)
        for k, n in enumerate(NAMES)
    ]
    pooled = cal.fit(sets, sj.ConstantRestitution, POOLED, profiles=False)
    shared = {"restitution": cal.Parameter(shared=True)}
    together = cal.fit(sets, sj.ConstantRestitution, shared, profiles=False)
    assert pooled.values["restitution_spread"] == 0.0
    assert pooled.pooled["restitution_spread"].low == 0.0
    assert 0 < pooled.pooled["restitution_spread"].high < 0.1
    for name in NAMES:
        value = pooled.values[f"restitution[{name}]"]
        assert value == pytest.approx(together.values["restitution"], abs=1e-6)


def test_a_set_that_says_nothing_of_a_pooled_parameter_leaves_the_pool_as_it_is():
    """Impacts of nearly no speed tell no rate: their set's own is the mean of the others."""
    sets = [
        cal.RestitutionData(AT, 0.9 * np.exp(-rate * AT), name=n, uncertainty=0.01)
        for n, rate in zip("abc", (0.08, 0.1, 0.13), strict=True)
    ]
    rest = cal.RestitutionData(np.full(3, 1e-200), np.full(3, 0.9), name="rest", uncertainty=0.01)
    rates = {"rate": cal.Parameter(shared="pooled")}
    few, more = (cal.fit(x, Decay, rates, profiles=False) for x in (sets, [*sets, rest]))
    for name in ("rate", "rate_spread", "rate[a]", "rate[b]", "rate[c]"):
        assert more.values[name] == pytest.approx(few.values[name], rel=1e-6), name
    assert more.values["rate[rest]"] == pytest.approx(more.values["rate"], rel=1e-6)


def test_likelihood_functions_know_the_pool():
    """Members' density about the mean, on the scale that is searched: a log-normal one."""
    sets = [
        cal.RestitutionData(AT, 0.9 * np.exp(-0.1 * AT), name=n, uncertainty=0.01) for n in "ab"
    ]
    problem = cal.problem(sets, Decay, {"rate": cal.Parameter(shared="pooled")})
    expected = ("level[a]", "rate[a]", "level[b]", "rate[b]", "rate", "rate_spread")
    assert problem.names == expected
    theta = dict(zip(problem.names, (0.9, 0.12, 0.9, 0.08, 0.1, 0.3), strict=True))
    density = sum(stats.lognorm.logpdf(rate, 0.3, scale=0.1) for rate in (0.12, 0.08))
    prior = jax.jit(problem.log_prior)
    assert float(prior(theta)) == pytest.approx(density, rel=1e-10)
    rows = np.asarray(jax.jit(problem.residuals)(theta))[-2:]
    np.testing.assert_allclose(rows, np.log([1.2, 0.8]) / 0.3, rtol=1e-10)
    assert float(prior(theta | {"rate_spread": -1.0})) == -np.inf
