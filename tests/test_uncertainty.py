"""Standard errors, intervals and bands, against SciPy, iminuit and lmfit on SciPy's own model."""

from dataclasses import replace

import iminuit
import lmfit
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares

import calibration as cal
import softjax as sj
from calibration.fitting import freedom, uncertainty
from tests import fit_oracle
from tests.cases import pair
from tests.fit_data import TRUTH, eq_17_data, twin

NAMES = ("chi", "sigma", "psi")
QUICK = {"route": sj.EnergyBalance(), "starts": 8}
SETS = {  # name of a material, and how its data are made
    "stainless, u stated": ("stainless steel", {"noise": 0.0005, "uncertainty": 0.0005}),
    "stainless, u not stated": ("stainless steel", {"noise": 0.0005, "seed": 1}),
    "chrome, u stated": ("chrome steel", {"noise": 0.001, "uncertainty": 0.002, "seed": 2}),
    "nylon, Hertz's area": ("nylon", {"noise": 0.001, "seed": 3, "area": "hertz"}),
    "nylon, u of each point": (
        "nylon",
        {"noise": 0.002, "seed": 4, "uncertainty": np.linspace(0.001, 0.004, 30)},
    ),
}


def own_model(data):
    numbers = fit_oracle.numbers(data.contact)
    return lambda chi, sigma, psi: fit_oracle.curve(data.velocity, numbers, chi, sigma, psi)


def own_eq_17(data):
    limit = float(data.limit_velocity)
    return lambda sigma, psi: fit_oracle.eq_17(data.velocity, limit, sigma, psi)


@pytest.mark.parametrize("case", SETS)
def test_model_s_errors_are_scipy_s(case):
    name, made = SETS[case]
    data = twin(name, **made)
    result = cal.fit(data, profiles=False, **QUICK)
    values, covariance, _ = fit_oracle.fit(
        own_model(data), TRUTH[name][1:4], data.restitution, data.uncertainty
    )
    for i, parameter in enumerate(NAMES):
        assert result.values[parameter] == pytest.approx(values[i], rel=1e-5)
        error = np.sqrt(covariance[i, i])
        assert result.standard_errors[parameter] == pytest.approx(error, rel=1e-5)
    assert result.covariance_names == NAMES
    size = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(result.correlations, covariance / np.outer(size, size), atol=1e-5)
    assert result.rank == 3


@pytest.mark.parametrize("case", SETS)
def test_eq_17_s_errors_are_scipy_s(case):
    name, made = SETS[case]
    made = {k: v for k, v in made.items() if k != "area"}
    data = eq_17_data(name, **made)
    result = cal.fit(data, "eq-17", profiles=False)
    values, covariance, residual = fit_oracle.fit(
        own_eq_17(data), TRUTH[name][2:4], data.restitution, data.uncertainty
    )
    for i, parameter in enumerate(("sigma", "psi")):
        assert result.values[parameter] == pytest.approx(values[i], rel=1e-5)
        error = np.sqrt(covariance[i, i])
        assert result.standard_errors[parameter] == pytest.approx(error, rel=1e-5)
    if data.uncertainty is not None:
        reduced = np.sum(residual**2) / (len(data) - 2)
        assert result.materials[0].reduced_chi_squared == pytest.approx(reduced, rel=1e-6)
    else:
        assert result.materials[0].reduced_chi_squared is None


@pytest.mark.parametrize("told", [None, pytest.param(0.006, marks=pytest.mark.long)])
def test_two_step_s_error_of_chi_is_what_noise_in_each_point_does(told):
    """Both steps refitted by SciPy with every point moved: dχ̃/dε_i, and so its variance."""
    name = "nylon"
    data = eq_17_data(name, points=12, noise=0.006, seed=2, uncertainty=told)
    model, eq_17 = own_model(data), own_eq_17(data)
    _, chi, sigma, psi, _ = TRUTH[name]

    losses, covariance, residual = fit_oracle.fit(eq_17, [sigma, psi], data.restitution)
    variance = np.sum(residual**2) / (len(data) - 2)
    moves = 1e-6 * np.diag(losses)
    slope = [(eq_17(*(losses + m)) - eq_17(*(losses - m))) / (2 * np.max(m)) for m in moves]
    influence = covariance / variance @ np.stack(slope)  # (JᵀJ)⁻¹ Jᵀ: what ε_i does to σ and ψ

    def chi_with(i, step, linear):
        moved = data.restitution + step * np.eye(len(data))[i]
        own = losses + step * influence[:, i]
        if not linear:
            own = fit_oracle.fit(eq_17, losses, moved)[0]
        return fit_oracle.fit(lambda c: model(c, *own), [chi], moved)[0][0]

    def error(linear):
        slopes = []
        for i in range(len(data)):
            at = {k: chi_with(i, k * 2e-3, linear) for k in (-2, -1, 1, 2)}
            slopes.append((8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * 2e-3))
        return np.sqrt(np.sum(np.square(slopes)) * (variance if told is None else told**2))

    value, expected = chi_with(0, 0.0, True), error(linear=True)
    result = cal.fit(data, objective="two-step", profiles=False, **QUICK)
    assert result.values["chi"] == pytest.approx(value, rel=1e-6)
    assert result.standard_errors["chi"] == pytest.approx(expected, rel=1e-4)
    # Eq. (17)'s own curvature is left out, as in every covariance (JᵀJ)⁻¹
    assert result.standard_errors["chi"] == pytest.approx(error(linear=False), rel=0.02)
    estimate = result.materials[0].parameters["chi"]
    assert estimate.method == "sandwich"
    reach = uncertainty.quantile(0.95, 10 if told is None else None)
    assert np.log(estimate.high / value) == pytest.approx(reach * expected / value, rel=1e-3)


def grouped_eq_17(groups, each, seed=0):
    """Eq. (17)'s impacts of several specimens in turn, each with an offset of its own."""
    data = eq_17_data("stainless steel", points=groups * each, noise=0.006, seed=seed)
    of = np.arange(groups * each) % groups
    off = 0.01 * np.random.default_rng(seed + 100).standard_normal(groups)[of]
    names = [f"specimen {k}" for k in of]
    return replace(data, restitution=data.restitution + off, group=names), of


def test_two_step_s_errors_carry_what_points_share():
    """By SciPy: both steps' slopes in each ε_i, and the covariance of the points written down."""
    data, of = grouped_eq_17(4, 3)
    result = cal.fit(data, objective="two-step", profiles=False, **QUICK)
    found = result.materials[0].variances
    covariance = found["scatter"] * np.eye(12) + found["group"] * (of[:, None] == of)
    lower = np.linalg.cholesky(covariance)
    model, eq_17 = own_model(data), own_eq_17(data)
    _, chi, sigma, psi, _ = TRUTH["stainless steel"]

    def white(x):
        return np.linalg.solve(lower, eq_17(*x) - data.restitution)

    losses = least_squares(white, [sigma, psi], x_scale=[sigma, psi], xtol=1e-14, ftol=1e-14).x
    moves = 1e-6 * np.diag(losses)
    slope = [(eq_17(*(losses + m)) - eq_17(*(losses - m))) / (2 * np.max(m)) for m in moves]
    solved = np.linalg.solve(covariance, np.transpose(slope))
    influence = np.linalg.solve(np.stack(slope) @ solved, solved.T)

    def chi_with(i, step):
        moved = data.restitution + step * np.eye(12)[i]
        own = losses + step * influence[:, i]
        return fit_oracle.fit(lambda c: model(c, *own), [chi], moved)[0][0]

    slopes = []
    for i in range(12):
        at = {k: chi_with(i, k * 2e-3) for k in (-2, -1, 1, 2)}
        slopes.append((8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * 2e-3))
    np.testing.assert_allclose([result.values["sigma"], result.values["psi"]], losses, rtol=1e-5)
    assert result.values["chi"] == pytest.approx(chi_with(0, 0.0), rel=1e-5)
    expected = np.sqrt(slopes @ covariance @ slopes)
    assert result.standard_errors["chi"] == pytest.approx(expected, rel=2e-4)


@pytest.mark.long
def test_two_step_s_errors_of_groups_are_those_of_simulated_sets():
    """All that is estimated anew in each, the covariance of the points included."""
    sets = 200
    options = QUICK | {"starts": 1, "optimiser": "levenberg-marquardt", "profiles": False}
    values, errors = np.empty((2, sets))
    for seed in range(sets):
        result = cal.fit(grouped_eq_17(6, 5, seed)[0], objective="two-step", **options)
        values[seed], errors[seed] = result.values["chi"], result.standard_errors["chi"]
    error, scatter = np.sqrt(np.mean(errors**2)), np.std(values)
    assert error / scatter == pytest.approx(1, abs=3 / np.sqrt(2 * sets))


@pytest.mark.parametrize("case", SETS)
def test_profiles_are_minos_s(case):
    """Where u is not stated its estimate, and Student's quantile in place of the normal one."""
    name, made = SETS[case]
    data = twin(name, **made)
    result = cal.fit(data, **QUICK)
    model, values = own_model(data), [result.values[k] for k in NAMES]
    u = data.uncertainty
    if u is None:
        left = len(data) - 3
        u = np.sqrt(np.sum((model(*values) - data.restitution) ** 2) / left)
        u *= stats.t.ppf(0.975, left) / stats.norm.ppf(0.975)

    def cost(*logarithms):  # profiles do not mind, and the steps stay at positive numbers
        return float(np.sum(((model(*np.exp(logarithms)) - data.restitution) / u) ** 2))

    minuit = iminuit.Minuit(cost, *np.log(values), name=NAMES)
    minuit.errordef = 1.0
    minuit.tol = 1e-4
    minuit.strategy = 2
    minuit.migrad()
    minuit.minos(cl=0.95)
    for parameter in NAMES:
        low, high = result.intervals[parameter]
        expected = minuit.merrors[parameter]
        assert expected.is_valid
        value = minuit.values[parameter]
        assert low == pytest.approx(np.exp(value + expected.lower), rel=1e-3)
        assert high == pytest.approx(np.exp(value + expected.upper), rel=1e-3)
        assert result.materials[0].parameters[parameter].method == "profile"


def test_a_profile_follows_a_valley_to_its_end():
    """σ and ψ that make up for each other over decades, against SciPy in ln(σ r^ψ) in place of σ."""
    data = twin("chrome steel", noise=0.01, seed=0, uncertainty=0.01)
    result = cal.fit(data, **QUICK)
    assert result.intervals["sigma"][1] is None
    model, contact = own_model(data), data.contact
    critical = float(contact.critical_velocity)
    ratio = critical / (float(contact.limit_velocity) - critical)

    def lowest(psi):
        def residual(q):
            chi, loss = np.exp(q)
            return (model(chi, loss / ratio**psi, psi) - data.restitution) / 0.01

        starts = ([np.log(0.06), at] for at in (-3.5, -3.0))
        return min(2 * least_squares(residual, start).cost for start in starts)

    rise = [lowest(end) - lowest(result.values["psi"]) for end in result.intervals["psi"]]
    assert rise == pytest.approx([stats.chi2.ppf(0.95, 1)] * 2, rel=1e-3)


def test_profiles_are_lmfit_s_where_it_is_not():
    data = eq_17_data("stainless steel", noise=0.02, seed=6)
    result = cal.fit(data, objective="two-step", **QUICK)
    eq_17 = own_eq_17(data)
    start = lmfit.Parameters()
    start.add_many(("sigma", result.values["sigma"]), ("psi", result.values["psi"]))
    mini = lmfit.Minimizer(lambda p: eq_17(p["sigma"], p["psi"]) - data.restitution, start)
    found = mini.minimize(method="least_squares", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    limits = lmfit.conf_interval(mini, found, sigmas=[0.95])
    for parameter in ("sigma", "psi"):
        (_, low), (_, _), (_, high) = limits[parameter]
        own = result.intervals[parameter]
        assert own[0] == pytest.approx(low, rel=1e-3)
        assert own[1] == pytest.approx(high, rel=1e-3)
    assert result.materials[0].parameters["chi"].method == "sandwich"
    assert set(result.profiles) == {"sigma", "psi"}
    curve = result.profiles["sigma"]
    assert min(curve.delta_chi_squared) == pytest.approx(0.0, abs=1e-6)
    assert max(curve.delta_chi_squared) > curve.threshold


def test_an_interval_that_the_data_leave_open_is_open():
    data = twin("stainless steel", noise=0.01, seed=1)
    result = cal.fit(data, **QUICK)
    low, high = result.intervals["sigma"]
    assert low is None or high is None
    assert all(end is not None for end in result.intervals["chi"])
    exact = cal.fit(twin("stainless steel", noise=0.0003, seed=1), **QUICK)
    assert all(end is not None for end in exact.intervals["sigma"])


@pytest.mark.parametrize("objective", ["model", "two-step"])
def test_band_is_the_covariance_carried_through_the_curve(objective):
    name = "nylon"
    data = twin(name, noise=0.002, seed=3)
    result = cal.fit(data, objective=objective, profiles=False, **QUICK)
    velocity = data.velocity[::5]
    numbers = fit_oracle.numbers(data.contact)
    centre = [result.values[k] for k in NAMES]
    curve = lambda p: fit_oracle.curve(velocity, numbers, *p)  # noqa: E731
    slope = []
    for i in range(3):
        step = 1e-5 * centre[i] * np.eye(3)[i]
        slope.append((curve(centre + step) - curve(centre - step)) / (2e-5 * centre[i]))
    order = [result.covariance_names.index(k) for k in NAMES]
    covariance = result.covariance[np.ix_(order, order)]
    expected = np.sqrt(np.einsum("iv,ij,jv->v", slope, covariance, slope))
    band = result.band(velocity)
    np.testing.assert_allclose(band.coefficient, curve(centre), atol=1e-9)
    np.testing.assert_allclose(band.standard_error, expected, rtol=1e-5)
    left = len(data) - (2 if objective == "two-step" else 3)
    reach = stats.t.ppf(0.975, left)
    np.testing.assert_allclose(band.high - band.low, 2 * reach * expected, rtol=1e-5)
    assert np.all(result.band(velocity, confidence=0.5).high < band.high)


@pytest.mark.parametrize("order", [1, -1], ids=["told last", "told first"])
def test_a_set_without_free_parameters_has_the_quantile_of_its_own_noise(order):
    """4 points about a given curve: Student's t with 4 degrees of freedom, beside a set with many."""
    many = twin("nylon", noise=0.002, seed=3)
    exact = np.array([0.9, 0.8, 0.7, 0.6])
    velocity = np.geomspace(0.01, 0.5, 4) * float(many.contact.limit_velocity)
    few = cal.RestitutionData(velocity, exact, many.contact, name="few")
    held = {"chi": 0.22, "sigma": 0.44, "psi": 0.54}
    result = cal.fit([many, few][::order], parameters=[{}, held][::order], profiles=False, **QUICK)
    band = result.band(velocity, "few", kind="prediction")
    off = sj.restitution(result.law["few"], velocity).coefficient - exact
    assert band.standard_error == pytest.approx(np.sqrt(np.mean(off**2)))
    reach = (band.high - band.coefficient) / band.standard_error
    np.testing.assert_allclose(reach, stats.t.ppf(0.975, 4), rtol=1e-9)


def test_one_more_measurement_is_as_uncertain_where_the_parts_are_too_many_to_keep(monkeypatch):
    """Then all variances count as found from the fewest degrees of freedom, those of any set."""
    monkeypatch.setattr(freedom, "MOST", 0)
    random, velocity = np.random.default_rng(0), np.linspace(1.0, 2.0, 6)
    sets = [
        cal.RestitutionData(velocity, 0.8 + 0.01 * random.standard_normal(6), name=name)
        for name in ("first", "second")
    ]
    shared = {"restitution": cal.Parameter(shared=True)}
    result = cal.fit(sets, "constant", shared, profiles=False, starts=1)
    reach = stats.t.ppf(0.975, result.degrees_of_freedom("restitution"))
    for name in ("first", "second"):
        band = result.band(1.5, name, kind="prediction")
        assert band.high - band.coefficient == pytest.approx(reach * band.standard_error)


@pytest.mark.parametrize("level", [95, 0, 1.0, -0.5, np.nan, True, "0.95"])
def test_a_band_s_confidence_is_a_part(level):
    result = cal.fit(
        eq_17_data("nylon", noise=0.004), objective="two-step", profiles=False, **QUICK
    )
    for band in (result.band, result.empirical_band):
        with pytest.raises(ValueError, match="`confidence` must be between 0 and 1") as caught:
            band(1.0, confidence=level)
        assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"count": 0}, "`count` must be a whole number >= 1"),
        ({"count": 2.5}, "`count` must be a whole number >= 1"),
        ({"count": True}, "`count` must be a whole number >= 1"),
        ({"seed": -1}, "`seed` must be a whole number >= 0"),
        ({"seed": 1.5}, "`seed` must be a whole number >= 0"),
    ],
)
def test_a_bootstrap_of_no_number_is_refused(asked, message):
    result = cal.fit(eq_17_data("nylon", noise=0.004), "eq-17", profiles=False, **QUICK)
    with pytest.raises(ValueError, match=message):
        result.bootstrap(**{"count": 3, **asked})
    assert result.bootstrap(np.int64(3), seed=np.int64(1)).values.shape == (3, 2)


def test_eps_up_has_the_error_of_its_losses():
    data = eq_17_data("nylon", noise=0.004, seed=7)
    result = cal.fit(data, objective="two-step", profiles=False, **QUICK)
    ratio = float(data.contact.critical_velocity)
    ratio /= float(data.contact.limit_velocity) - ratio
    values, covariance, _ = fit_oracle.fit(own_eq_17(data), TRUTH["nylon"][2:4], data.restitution)
    loss = values[0] * ratio ** values[1]
    slope = -np.exp(-loss) * loss * np.array([1 / values[0], np.log(ratio)])
    expected = np.sqrt(slope @ covariance @ slope)
    derived = result.materials[0].derived["eps_up"]
    assert derived.value == pytest.approx(np.exp(-loss), rel=1e-6)
    assert derived.standard_error == pytest.approx(expected, rel=1e-4)


def test_the_line_s_errors_carry_all_data_sets():
    """c1 and c2 by SciPy with the same noise in both steps, through the sets' own influence."""
    sets = [
        eq_17_data(n, points=10, noise=0.004, seed=i)
        for i, n in enumerate(("nylon", "chrome steel"))
    ]
    result = cal.fit(sets, objective="two-step", profiles=False, **QUICK)
    line = result.unloading_line
    # two materials lie on the line exactly: its errors are those of the two χ̃ carried through
    ratios = np.array([float(d.contact.yield_ratio) for d in sets])
    chi = np.array([result.values[f"chi[{d.name}]"] for d in sets])
    errors = np.array([result.standard_errors[f"chi[{d.name}]"] for d in sets])
    inverse = np.linalg.inv(np.stack([np.ones(2), ratios], axis=1))
    c = inverse @ chi
    expected = np.sqrt(np.diag(inverse @ np.diag(errors**2) @ inverse.T))
    assert line.c1.value == pytest.approx(c[0], rel=1e-5)
    assert line.c2.value == pytest.approx(c[1], rel=1e-5)
    assert line.c1.standard_error == pytest.approx(expected[0], rel=1e-4)
    assert line.c2.standard_error == pytest.approx(expected[1], rel=1e-4)
    assert line.through_chi["c1"].standard_error == pytest.approx(expected[0], rel=1e-4)


def test_a_refit_that_is_sent_astray_ends_no_profile():
    """Where σ and ψ hardly show, their first guess at the next χ̃ is far off: SciPy finds the way."""
    data = twin("stainless steel", noise=0.01, seed=2)
    result = cal.fit(data, starts=8)
    low, high = result.intervals["chi"]
    numbers = fit_oracle.numbers(data.contact)

    def cost(chi):
        def residual(x):
            return fit_oracle.curve(data.velocity, numbers, chi, *np.exp(x)) - data.restitution

        return min(2 * least_squares(residual, x).cost for x in ([-5.0, -5.0], [0, -0.6]))

    best = result.values["chi"]
    variance = cost(best) / (len(data) - 3)
    inside = best - 0.8 * (best - low)
    assert cost(inside) - cost(best) < stats.t.ppf(0.975, len(data) - 3) ** 2 * variance
    assert best - low == pytest.approx(high - best, rel=0.35)


def test_an_interval_at_a_bound_knows_as_little_of_the_noise():
    """Student's quantile, with the residuals' degrees of freedom, as that of its neighbours."""
    nylon = pair("nylon")
    velocity = np.geomspace(2.0, 40.0, 12) * nylon.critical_velocity
    law = sj.Zhou(nylon, 0.3, 1e-6, 0.5)
    noise = (
        0.01 * np.random.default_rng(3).standard_normal(12) + 0.02
    )  # beyond what Eq. (17) allows
    data = cal.RestitutionData(velocity, sj.restitution(law, velocity).coefficient + noise, nylon)
    result = cal.fit(data, starts=4)
    assert set(result.profiles) == {"chi", "eps_up"}
    assert result.materials[0].parameters["eps_up"].value == 1.0
    for profile in result.profiles.values():
        assert 4.8 < profile.threshold < 5.2  # t² at 95 %: 4.96 of 10 degrees, 3.84 of none
