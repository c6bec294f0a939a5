"""Every law against one data set: what is predicted without each point, scored, weighed, ranked."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests.fit_data import pair
from tests.fit_oracle import thornton

CONTACT = pair("nylon")
LIMIT = float(CONTACT.limit_velocity)
VELOCITY = np.geomspace(1.5, 60.0, 30)
NOISE = np.random.default_rng(3).normal(size=30)
UNEQUAL = np.linspace(0.002, 0.01, 30)
CHEAP = ["walton-braun", "eq-17", "constant", "hertz"]


def walton_braun(velocity, ratio, growth):
    return 1 / np.sqrt(ratio + growth * velocity)


def data_of(restitution, uncertainty=None, velocity=VELOCITY, contact=CONTACT, group=None):
    return cal.RestitutionData(
        velocity, restitution, contact, uncertainty, name="made", group=group
    )


def growing(uncertainty=None, noise=0.005, **options):
    made = walton_braun(VELOCITY, 1.1, 0.02)
    return data_of(
        made + (noise if uncertainty is None else uncertainty) * NOISE, uncertainty, **options
    )


class Line(sj.HardSphereLaw):
    """ε = a - b v: linear in its parameters, so that everything is known in closed form."""

    level: float
    slope: float

    def restitution_squared(self, velocity):
        return (self.level - self.slope * velocity) ** 2


LINE = {"level": cal.Parameter(0.9), "slope": cal.Parameter(0.002)}
PRIOR = {"slope": cal.Parameter(0.002, prior=(0.004, 0.0002))}


@pytest.mark.parametrize("days", [False, True])
@pytest.mark.parametrize("case", ["stated", "unknown", "prior"])
def test_a_linear_law_predicts_what_the_regression_without_points_or_days_predicts(case, days):
    """Middle and density by generalised least squares: normal, or Student's t."""
    stated, fold = case != "unknown", np.arange(30) % (5 if days else 30)
    offset = 0.01 * np.array([1.0, -1.2, 0.3, 0.8, -0.9])[np.arange(30) % 5] * days
    data = growing(UNEQUAL if stated else None)
    group = [f"day {k}" for k in fold] if days else None
    data = replace(data, restitution=data.restitution + offset, group=group)
    parameters = {"line": LINE | (PRIOR if case == "prior" else {})}
    comparison = cal.compare(data, {"line": Line}, parameters=parameters)
    entry = comparison.entries[0]
    found, material = entry.leave_one_out, entry.result.materials[0]
    scatter = material.variances["scatter"] if days and not stated else 1.0
    both = np.diag(UNEQUAL**2 if stated else np.full(30, scatter))
    if days:
        both += material.group_deviation**2 * (fold[:, None] == fold)
    design = np.stack([np.ones(30), -VELOCITY], axis=1)
    known = np.diag([0, (case == "prior") * 0.0002**-2.0])  # one more row, left out with no point
    expected = []
    for k in np.unique(fold):
        out, kept = fold == k, fold != k
        pull = np.linalg.solve(both[np.ix_(kept, kept)], design[kept]).T
        inverse = np.linalg.inv(pull @ design[kept] + known)
        theta = inverse @ (pull @ data.restitution[kept] + known @ [0, 0.004])
        middle = design[out] @ theta
        spread = both[np.ix_(out, out)] + design[out] @ inverse @ design[out].T
        law = stats.multivariate_normal(middle, spread)
        if not (stated or days):
            noise = np.sum((design @ theta - data.restitution)[kept] ** 2) / 27
            law = stats.t(27, middle[0], np.sqrt(noise * spread[0, 0]))
        np.testing.assert_allclose(found.predicted[out], middle, rtol=0, atol=1e-6)
        expected.append(law.logpdf(data.restitution[out]).item())
        assert np.sum(found.log_density[out]) == pytest.approx(expected[-1], abs=1e-5)
        assert len(set(found.fold[out])) == 1
    assert found.elpd == pytest.approx(np.sum(expected), abs=1e-4 if days else 1e-6)
    if not days:
        np.testing.assert_allclose(found.log_density, expected, rtol=0, atol=1e-6)
        assert found.elpd_se == pytest.approx(np.std(expected, ddof=1) * 30**0.5, rel=1e-6)
        left = found.predicted - data.restitution
        assert found.rms == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)
    assert found.in_folds is None
    assert not any("drawn at random" in note for note in comparison.notes)
    assert entry.warnings == entry.result.warnings


def test_a_parameter_at_its_bound_counts_for_none():
    """A line that may not rise, on data that do: the mean of the others, and Student's t."""
    data = data_of(0.7 + 0.003 * VELOCITY + 0.01 * NOISE)
    ends = {
        "level": cal.Parameter(0.9, bounds=(0, 2)),
        "slope": cal.Parameter(0.002, bounds=(0, 1)),
    }
    parameters = {"line": ends}
    entry = cal.compare(data, {"line": Line}, parameters=parameters).entries[0]
    assert entry.result.values["slope"] == 0
    for k in (0, 29):
        others = np.delete(data.restitution, k)
        scale = np.std(others, ddof=1) * np.sqrt(1 + 1 / 29)
        expected = stats.t(28, np.mean(others), scale).logpdf(data.restitution[k])
        assert entry.leave_one_out.log_density[k] == pytest.approx(expected, abs=1e-4)


def test_weights_make_the_mixture_predict_best_and_ties_are_below_4_or_two_standard_errors():
    """By SciPy on the densities of the laws; each law's elpd behind the best with its error."""
    comparison = cal.compare(growing(noise=0.04), CHEAP)
    scores = [entry.leave_one_out.elpd for entry in comparison.entries]
    assert scores == sorted(scores, reverse=True)
    density = np.stack([entry.leave_one_out.log_density for entry in comparison.entries])
    for entry, apart in zip(comparison.entries, density - density[0], strict=True):
        expected = np.sum(apart), stats.sem(apart) * 30
        assert entry.delta_elpd == pytest.approx(expected, rel=1e-12)

    def score(weights):
        return -np.sum(np.log(weights @ np.exp(density)))

    whole = {"type": "eq", "fun": lambda w: np.sum(w) - 1}
    start, bounds = np.full(4, 0.25), [(0, 1)] * 4
    best = optimize.minimize(score, start, bounds=bounds, constraints=[whole], tol=1e-14)
    found = np.array([entry.weight for entry in comparison.entries])
    np.testing.assert_allclose(found, best.x, atol=1e-4)
    assert np.sum(found) == pytest.approx(1, abs=1e-12)
    assert score(found) <= best.fun + 1e-8
    assert np.max(found) < 1  # a mixture, else any rule would do
    of = type(comparison.entries[0].delta_elpd)
    cases = (-1.5, 0.42), (-4.1, 3.1), (0.0, 0.5), (-3.9, 0.1), (-4.1, 2.0), (-8.1, 4.1)
    assert [of(*case).is_tie for case in cases] == [True, True, True, True, False, True]
    (why,) = (note for note in comparison.notes if note.startswith("The data do not decide"))
    for entry in comparison.entries[1:]:
        assert (entry.label in why) == entry.delta_elpd.is_tie


@pytest.mark.parametrize(
    ("options", "noise"),
    [
        ({"extra_scatter": True}, "uncertainties as stated and scatter, normal errors; scatter estimated for each law"),
        ({"noise": "student-t"}, "uncertainties as stated, Student's t of 4 degrees of freedom"),
    ],
)  # fmt: skip
def test_laws_are_compared_under_the_noise_of_the_fit_and_it_is_said(options, noise):
    data = growing(UNEQUAL, noise=0.01)
    comparison = cal.compare(data, CHEAP, **options)
    for key in CHEAP:
        alone = cal.fit(data, key, profiles=False, **options)
        entry = comparison.entry(key)
        assert entry.result.values == pytest.approx(alone.values, rel=1e-6)
        assert entry.leave_one_out.elpd == pytest.approx(alone.leave_one_out().elpd, rel=1e-9)
    assert f"Noise of every fit: {noise}." in comparison.notes
    best, second = comparison.entries[:2]
    apart = best.leave_one_out.log_density - second.leave_one_out.log_density
    (why,) = (note for note in comparison.notes if "is best: ahead of" in note)
    by = f"by {np.sum(apart):.2g} ± {second.delta_elpd.standard_error:.2g} in elpd"
    assert why.startswith(f"{best.label} is best: ahead of {second.label} {by}")
    assert f"it predicts {np.sum(apart > 0)} of 30 points better, most at " in why
    fitted = best.result.likelihood.fitted
    assert fitted == best.fitted == 2 + (options == {"extra_scatter": True})  # the k of AIC
    assert why in " ".join(str(comparison).split())


@pytest.mark.parametrize(
    ("decisive", "at", "words"),
    [
        ([1], 0.915, "The data do not decide between high and low (5 ± 5 in elpd behind)."),
        ([0, 1, 2, 3, 5], 0.915, "high is best: ahead of low by 25 ± 5 in elpd; it predicts 5"),
        (range(6), 0.1, "low is best: ahead of high by 9.5e+02 ± 0"),  # of densities of 1e-1400
    ],
)
def test_a_lead_of_less_than_two_standard_errors_is_not_called_best(decisive, at, words):
    """Points at 0.89 ± 0.01 do not decide between 0.90 and 0.88; at 0.915 ln p differs by (3.5² - 1.5²)/2."""
    measured = np.full(6, 0.89)
    measured[decisive] = at
    data = data_of(measured, 0.01, velocity=VELOCITY[:6])
    parameters = {"high": {"level": 0.90, "slope": 0.0}, "low": {"level": 0.88, "slope": 0.0}}
    comparison = cal.compare(data, {"high": Line, "low": Line}, parameters=parameters)
    assert words in " ".join(comparison.notes)
    assert sum(entry.weight for entry in comparison.entries) == pytest.approx(1)


def test_thornton_stands_with_its_factor_free_and_fixed():
    """A setting of a law acts on it alone: yield at the contact's own critical velocity."""
    critical = float(pair("nylon", area="hertz").critical_velocity)
    data = data_of(thornton(VELOCITY, critical, 2.2) + 0.003 * NOISE, 0.003)
    parameters = {"thornton-fixed": {"area": "contact"}}
    laws = ["thornton-fixed", "thornton", "constant"]
    comparison = cal.compare(data, laws, parameters=parameters)
    assert comparison.ranking[0] == "Thornton, yield pressure free"
    free, fixed = comparison.entry("thornton"), comparison.entry("Thornton, yield pressure Y")
    error = free.result.standard_errors["yield_factor"]
    assert abs(free.result.values["yield_factor"] - 2.2) < 4 * error
    expected = thornton(VELOCITY, float(CONTACT.critical_velocity))
    assert np.allclose(fixed.leave_one_out.predicted, expected, rtol=0, atol=1e-9)
    assert (free.fitted, fixed.fitted) == (1, 0)
    assert free.result.law.area == "hertz"


def test_laws_of_ones_own_join_by_class_function_and_label():
    def doubled(contact, growth):
        return sj.WaltonBraun(contact, 1e6, 1.1e6, growth)

    data = growing()
    parameters = {"Line": LINE, "doubled": {"growth": cal.Parameter(1.0, bounds=(0, 1e6))}}
    comparison = cal.compare(data, [Line, doubled, sj.ConstantRestitution], parameters=parameters)
    assert set(comparison) == {"Line", "doubled", "constant ε (hard spheres)"}
    assert isinstance(comparison["Line"].law, Line)
    named = cal.compare(data, {"mine": Line, "spheres": "constant"}, parameters={"mine": LINE})
    assert set(named.ranking) == {"mine", "spheres"}
    assert named["mine"].values == comparison["Line"].values
    assert named.entry("constant").label == "spheres"


def test_laws_with_one_curve_are_told_and_share_a_weight():
    def hard(restitution):
        return sj.ConstantRestitution(None, restitution)

    start = {"hard": {"restitution": cal.Parameter(0.8, bounds=(0.01, 1))}}
    comparison = cal.compare(growing(), ["constant", hard, "hertz"], parameters=start)
    constant, same, hertz = comparison.entries
    assert (constant.same_as, same.same_as, hertz.same_as) == (None, constant.label, None)
    assert constant.weight == pytest.approx(same.weight, rel=1e-6)
    assert same.delta_elpd.is_tie
    assert not hertz.delta_elpd.is_tie


def test_a_law_that_made_the_data_is_set_apart_and_the_others_are_ranked():
    """The embedded data are Eq. (17) without noise; found independently: ε_up is at 1 and the rms 0.00588."""
    nylon = cal.compare(cal.paper_materials()[2], ["zhou", "thornton", *CHEAP])
    first, best, *_ = nylon.entries
    assert (first.key, first.delta_elpd, first.weight) == ("eq-17", None, None)
    assert first.result.rms < 1e-12
    assert first.result.aic is None
    assert (best.key, best.delta_elpd) == ("walton-braun", (0, 0))
    assert sum(entry.weight for entry in nylon.entries[1:]) == pytest.approx(1, abs=1e-9)
    assert any(note.startswith("Eq. (17), empirical follows") for note in nylon.notes)
    zhou = nylon.entry("zhou")
    assert zhou.result.rms == pytest.approx(0.00588, abs=5e-6)
    assert zhou.result.values["eps_up"] == pytest.approx(1.0, abs=1e-6)
    assert zhou.result.values["chi"] == pytest.approx(0.27019, abs=2e-5)
    assert {"eps-up-only", "at-bound"} <= {warning.code for warning in zhou.warnings}
    off = np.sqrt(np.mean((1 - nylon.data.restitution) ** 2))
    assert nylon["hertz"].rms == pytest.approx(off, rel=1e-12)
    assert nylon.converged
    order = ["eq-17", "walton-braun", "zhou", "thornton", "constant", "hertz"]
    assert [entry.key for entry in nylon.entries] == order


def test_without_elastic_properties_only_formulas_are_left():
    made = 0.8 + 0.01 * NOISE
    falling = made - 0.002 * VELOCITY
    comparison = cal.compare(cal.RestitutionData(VELOCITY, falling, limit_velocity=300.0))
    assert {entry.key for entry in comparison.entries} == {"constant", "eq-17"}
    assert len(comparison.left_out) == 1
    comparison = cal.compare(cal.RestitutionData(VELOCITY, made))
    assert [entry.key for entry in comparison.entries] == ["constant"]
    assert len(comparison.left_out) == 2


def test_bodies_may_differ_from_impact_to_impact():
    radius = np.linspace(0.005, 0.02, 30)
    contact = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, 0.0127)
    # k1 is held at k √R, of the mean bodies
    stiffness = float(np.mean(contact.stiffness) * np.mean(contact.radius) ** 0.5)
    made = walton_braun(VELOCITY, 1.1, 500 * np.sqrt(np.asarray(contact.mass) / stiffness))
    data = data_of(made + 0.001 * NOISE, contact=contact)
    found = cal.compare(data, ["walton-braun"])["walton-braun"]
    for name, value in (("growth", 500), ("unloading_stiffness", 1.1 * stiffness)):
        assert abs(found.values[name] - value) < 4 * found.standard_errors[name]


def test_all_built_in_laws_are_candidates():
    velocity = np.geomspace(1.5, 60.0, 12)
    noise = 0.005 * np.random.default_rng(1).normal(size=12)
    comparison = cal.compare(data_of(walton_braun(velocity, 1.08, 0.01) + noise, 0.005, velocity))
    assert {entry.key for entry in comparison.entries} == {*cal.LAWS, "thornton-fixed"}
