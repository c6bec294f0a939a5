"""Points that share errors (groups, bounce sequences, repeats, drag), scatter and scale: dense matrices and closed forms."""

import json

import jax
import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests.data.test_air import flight
from tests.decay import Decay
from tests.fit_data import ON_STEEL
from tests.fit_oracle import hessian

TIMING = 3e-4
Free = cal.Parameter
QUICK = {"starts": 1}
FEW = {"profiles": False, "starts": 4}


def restricted(matrix, e):
    """-2 ln L_R of a mean with this covariance, by dense matrices."""
    weight = np.linalg.solve(matrix, np.ones(len(e)))
    off = e - weight @ e / np.sum(weight)
    squares = off @ np.linalg.solve(matrix, off)
    return np.linalg.slogdet(matrix)[1] + np.log(np.sum(weight)) + squares


@pytest.mark.parametrize("stated", [True, False])
def test_variances_of_trains_are_those_of_the_largest_restricted_likelihood(stated, tmp_path):
    """Six launches of a ball whose ε is 0.9; estimate by least squares; the file keeps all of it."""
    random = np.random.default_rng(6)
    times = random.uniform(0.5, 0.7, 6)[:, None] * 0.9 ** np.arange(7)
    times = times + TIMING * random.standard_normal((6, 7))
    table = {"launch": np.repeat([f"l{k}" for k in range(6)], 7), "interval": times.ravel()}
    options = {"timing_uncertainty": TIMING} if stated else {}
    data = cal.RestitutionData.from_table(table, **options)
    result = cal.fit(data, "constant", **QUICK)
    result.save(tmp_path / "fit.json")
    (entry,) = json.loads((tmp_path / "fit.json").read_text())["fits"]
    assert {"restitution_alone", "velocity_alone"} <= {*entry["data"]["errors"]}
    again = cal.FitResult.load(tmp_path / "fit.json")
    assert again == result
    ends = [one.band([2.0, 2.5], kind="prediction").high for one in (again, result)]
    np.testing.assert_allclose(*ends, rtol=1e-12)
    material, e = again.materials[0], data.restitution
    names = ("group",) if stated else ("timing", "scatter", "group")
    # δε = (δtₙ₊₁ - ε δtₙ)/tₙ, a column for each time
    before, of_times = 2 * data.velocity / 9.80665, np.zeros((36, 42))
    place = np.arange(36) + data.group_index
    of_times[np.arange(36), place] = -e / before
    of_times[np.arange(36), place + 1] = 1 / before
    together = data.group_index[:, None] == data.group_index

    def matrix(variances):
        v = {"timing": TIMING**2, "scatter": 0.0} | dict(zip(names, variances, strict=True))
        return (
            v["timing"] * of_times @ of_times.T + v["scatter"] * np.eye(36) + v["group"] * together
        )

    def cost(logs):
        return restricted(matrix(np.exp(logs)), e)

    options = {"maxiter": 4000, "xatol": 1e-9, "fatol": 1e-12}
    starts = ([1e-7, 1e-7, 1e-7], [1e-8, 1e-8, 1e-6])
    best = min(
        optimize.minimize(cost, np.log(s[-len(names) :]), method="Nelder-Mead", options=options).fun
        for s in starts
    )
    found = material.variances | {"timing": (material.timing or 0) ** 2}
    found = np.maximum([found[name] for name in names], 1e-30)
    assert np.max(found) > 1e-10  # something is to be found
    assert cost(np.log(found)) <= best + 1e-5
    if not stated:
        assert material.timing == pytest.approx(TIMING, rel=0.3)
    weight = np.linalg.solve(matrix(found), np.ones(36))
    assert result.values["restitution"] == pytest.approx(weight @ e / np.sum(weight), rel=1e-8)
    known = np.sum(weight) ** -0.5
    assert known <= result.standard_errors["restitution"] * (1 + 1e-6) < 1.3 * known
    apart = 1 / np.sqrt(np.sum(1 / np.diag(matrix(found))))  # as if consecutive ε shared nothing
    assert apart > 1.3 * known


def test_a_mean_of_groups_is_that_of_their_means_and_another_one_s_band_has_their_spread():
    """One-way analysis of variance: closed forms for groups of equal size."""
    random = np.random.default_rng(2)
    e = 0.8 + 0.003 * random.standard_normal((6, 1)) + 0.0015 * random.standard_normal((6, 5))
    label = np.repeat([f"s{k}" for k in range(6)], 5)
    data = cal.RestitutionData(random.uniform(1, 5, 30), e.ravel(), group=[*label])
    means = e.mean(1)
    within = np.sum((e - means[:, None]) ** 2) / 24
    result = cal.fit(data, "constant", **QUICK)
    material, error = result.materials[0], np.std(means, ddof=1) / np.sqrt(6)
    assert result.values["restitution"] == pytest.approx(np.mean(means), rel=1e-9)
    assert result.standard_errors["restitution"] == pytest.approx(error, rel=1e-6)
    assert material.noise == pytest.approx(np.sqrt(within), rel=1e-6)
    between = np.sqrt(np.var(means, ddof=1) - within / 5)
    assert material.group_deviation == pytest.approx(between, rel=1e-6)
    kept = between**2 / (between**2 + within / 5)
    expected = {f"s{k}": kept * (mean - np.mean(means)) for k, mean in enumerate(means)}
    offsets = {label: offset for label, (offset, _) in material.group_offsets.items()}
    assert offsets == pytest.approx(expected, rel=1e-6)
    assert list(offsets) == sorted(offsets, key=lambda label: -abs(offsets[label]))
    # Henderson's equations of the mean and six offsets, by NumPy: the curve is an estimate too
    design = np.column_stack([np.ones(30), np.repeat(np.eye(6), 5, axis=0)])
    equations = design.T @ design / within + np.diag([0, *[between**-2] * 6])
    predicted = np.sqrt(np.diag(np.linalg.inv(equations))[1:])
    errors = [error for _, error in material.group_offsets.values()]
    np.testing.assert_allclose(errors, predicted, rtol=1e-6)
    assert np.all(
        np.array(errors) > 1.2 * between * np.sqrt(1 - kept)
    )  # about a curve that is known
    low, high = result.intervals["restitution"]
    reach = stats.t.ppf(0.975, 5) * error
    assert low == pytest.approx(np.mean(means) - reach, rel=1e-4)
    assert high == pytest.approx(np.mean(means) + reach, rel=1e-4)
    mean, one = (result.band(2.0, kind=kind) for kind in ("mean", "prediction"))
    expected = np.sqrt(mean.standard_error**2 + material.noise**2 + material.group_deviation**2)
    assert one.standard_error == pytest.approx(expected, rel=1e-9)
    degrees = 25  # not those of 6 specimens alone, not of 30 points
    reach = float((one.high - one.low) / 2 / one.standard_error)
    assert stats.t.ppf(0.975, degrees) < reach < stats.t.ppf(0.975, 5)


@pytest.mark.parametrize("kind", ["specimens", "launches"])
def test_groups_that_scatter_nowhere_inside_are_their_means(kind):
    """Three values, each without scatter: their mean, and their standard deviation over √3."""
    e, label = np.array([0.8, 0.85, 0.83]), np.repeat([*"abc"], 6)
    data = cal.RestitutionData(np.tile(np.geomspace(0.1, 2, 6), 3), np.repeat(e, 6), group=label)
    if kind == "launches":
        times = 0.5 * e[:, None] ** np.arange(6)
        table = {"interval": times.ravel(), "launch": label}
        data = cal.RestitutionData.from_table(table, air=False)
    result = cal.fit(data, "constant", **FEW)
    assert result.values["restitution"] == pytest.approx(np.mean(e), rel=1e-9)
    error = np.std(e, ddof=1) / 3**0.5
    assert result.standard_errors["restitution"] == pytest.approx(error, rel=1e-5)


def test_the_error_of_unequal_groups_has_what_their_variances_add():
    """Kenward and Roger's of a mean, written down: V = s² 1 + g² (same group)."""
    random, counts = np.random.default_rng(1), np.array([1, 1, 1, 2, 2, 2, 14])
    label = np.repeat(np.arange(7), counts)
    e = 0.8 + 0.003 * random.standard_normal(7)[label] + 0.004 * random.standard_normal(23)
    data = cal.RestitutionData(np.linspace(1, 5, 23), e, group=[f"s{k}" for k in label])
    result = cal.fit(data, "constant", **QUICK)
    material = result.materials[0]
    parts = [np.eye(23), 1.0 * (label[:, None] == label[None, :])]
    at = np.log([material.noise**2, material.group_deviation**2])

    def minus_log(logs):
        v = sum(np.exp(x) * part for x, part in zip(logs, parts, strict=True))
        return 0.5 * restricted(v, e)

    relative = np.linalg.inv(hessian(minus_log, at, np.full(2, 1e-3)))
    v = [np.exp(x) * part for x, part in zip(at, parts, strict=True)]
    inverse = np.linalg.inv(sum(v))
    x = inverse @ np.ones(23)
    known = 1 / np.sum(x)
    curved = [[x @ a @ inverse @ b @ x - (x @ a @ x) * known * (x @ b @ x) for b in v] for a in v]
    added = np.sum(relative * curved)
    expected = np.sqrt(known + 2 * known * added * known)
    assert expected > 1.05 * np.sqrt(known)
    assert result.standard_errors["restitution"] == pytest.approx(expected, rel=2e-3)


def test_one_more_measurement_is_no_surer_than_the_mean():
    """Two specimens leave the mean one degree of freedom; large stated errors, which are known, leave more."""
    v = np.tile(np.geomspace(1, 10, 8), 2)
    u = 0.02 / v**2
    off = np.repeat([0.006, -0.006], 8)
    e = 0.8 + off + u * np.tile([0.5, -0.5], 8)
    group = np.repeat(["a", "b"], 8)
    result = cal.fit(cal.RestitutionData(v, e, uncertainty=u, group=group), "constant", **QUICK)
    mean, one = (result.band(np.array([1.0, 10.0]), kind=kind) for kind in ("mean", "prediction"))
    assert np.all(one.low <= mean.low)
    assert np.all(one.high >= mean.high)
    by_its_own = stats.t.ppf(0.975, 10) * one.standard_error[0]
    assert by_its_own < float(mean.high[0] - mean.low[0]) / 2


def test_scatter_beside_stated_uncertainties_is_of_the_largest_restricted_likelihood():
    random = np.random.default_rng(11)
    u = random.uniform(0.001, 0.004, 25)
    e = 0.7 + np.hypot(u, 0.004) * random.standard_normal(25)
    data = cal.RestitutionData(np.linspace(1, 3, 25), e, uncertainty=u)

    def cost(log):
        w = 1 / (u**2 + np.exp(log))
        off = e - np.sum(w * e) / np.sum(w)
        return np.sum(w * off**2 - np.log(w)) + np.log(np.sum(w))

    s = np.exp(optimize.minimize_scalar(cost, bounds=(-16, -8), options={"xatol": 1e-9}).x)
    w = 1 / (u**2 + s)
    result = cal.fit(data, "constant", extra_scatter=True, **QUICK)
    assert result.values["restitution"] == pytest.approx(np.sum(w * e) / np.sum(w), rel=1e-8)
    assert result.materials[0].variances["scatter"] == pytest.approx(s, rel=1e-4)
    # more than that of known variances: these are estimated, as Kenward and Roger allow for
    error = result.standard_errors["restitution"] / np.sum(w) ** -0.5
    assert 1.0 < error < 1.02
    assert result.materials[0].reduced_chi_squared is None
    assert "model-misfit" in {one.code for one in cal.fit(data, "constant", **QUICK).warnings}
    assert "model-misfit" not in {warning.code for warning in result.warnings}


def test_scaled_uncertainties_are_scipy_s_relative_ones():
    random = np.random.default_rng(12)
    velocity, u = np.linspace(0.5, 5, 20), random.uniform(0.001, 0.003, 20)
    curve = lambda v, sigma, psi: np.exp(-sigma * (v / (20 - v)) ** psi)  # noqa: E731
    e = curve(velocity, 0.6, 0.5) + 2.5 * u * random.standard_normal(20)
    data = cal.RestitutionData(velocity, e, uncertainty=u, limit_velocity=20.0)
    result = cal.fit(data, "eq-17", scale_uncertainty=True)
    values, covariance = optimize.curve_fit(curve, velocity, e, [0.6, 0.5], u, absolute_sigma=False)
    assert result.values["psi"] == pytest.approx(values[1], rel=1e-6)
    assert result.standard_errors["psi"] == pytest.approx(covariance[1, 1] ** 0.5, rel=0.01)
    plain = cal.fit(data, "eq-17")
    ratio = result.standard_errors["psi"] / plain.standard_errors["psi"]
    assert ratio == pytest.approx(plain.materials[0].reduced_chi_squared ** 0.5, rel=1e-6)


def test_means_of_repeats_carry_their_degrees_of_freedom():
    """Pooled: the scatter of all repeats, Student's t of all of them."""
    random = np.random.default_rng(13)
    velocity = np.repeat([1.0, 2.0, 3.0], 3)
    data = cal.RestitutionData(velocity, 0.8 + 0.01 * random.standard_normal(9))
    sets = data.restitution.reshape(3, 3)
    s = np.sqrt(np.sum((sets - sets.mean(1)[:, None]) ** 2) / 6)
    result = cal.fit(data.averaged(), "constant", **QUICK)
    assert result.standard_errors["restitution"] == pytest.approx(s / 3, rel=1e-9)
    low, high = result.intervals["restitution"]
    assert high - low == pytest.approx(2 * stats.t.ppf(0.975, 6) * s / 3, rel=1e-6)


def test_scatter_next_to_another_set_at_its_bound_is_as_if_that_was_given():
    """ε_up of one set ends at 1 and follows no point; the other's scatter has one parameter less to pay for."""
    velocity, random = np.geomspace(1.0, 6.0, 15), np.random.default_rng(2)
    law = sj.Zhou(ON_STEEL, chi=1.5, sigma=0.01, psi=0.5)
    exact = np.asarray(sj.restitution(law, velocity).coefficient)
    sets = []
    for name in "ab":
        measured = exact + 0.004 * random.standard_normal(15)
        sets.append(cal.RestitutionData(velocity, measured, contact=ON_STEEL, name=name))
    both = {"chi": cal.Parameter(shared=True)}
    free = cal.fit(sets, parameters=both, profiles=False)
    assert [fit.parameters["eps_up"].at_bound for fit in free.materials] == [True, False]
    given = [both | {"eps_up": 1.0}, both]
    fixed = cal.fit(sets, parameters=given, profiles=False)
    for one, other in zip(free.materials, fixed.materials, strict=True):
        assert one.variances["scatter"] == pytest.approx(other.variances["scatter"], rel=1e-5)


U, N = 0.004, 40
BALL = {"diameter": 6e-3, "density": 1140.0}


def test_the_error_of_the_drag_is_shared_by_all_points_and_absent_in_a_vacuum():
    """Generalised least squares with V = u² + 0.1² w wᵀ, and the likelihood with c as it is."""
    # drops of a 6 mm nylon ball from 5 cm to 2 m, ε 0.85 with a scatter of 0.004
    drop = np.geomspace(0.05, 2.0, N)
    table = {"drop_height": drop, "rebound_height": 0.7 * drop}
    exact = cal.RestitutionData.from_table(table, **BALL)
    random = np.random.default_rng(5)
    noise = U * random.standard_normal(N)
    # rebounds with which the corrected ε is 0.85 and its noise, to first order
    off = (0.85 + noise - exact.restitution) / exact.restitution
    table["rebound_height"] = 0.7 * drop * (1 + off) ** 2
    data = cal.RestitutionData.from_table(table, uncertainty=U, **BALL)
    result = cal.fit(data, "constant", **FEW)
    by_eps, by_v = data.errors.by_drag.T
    e, slower = data.restitution, by_v / data.velocity
    curve = np.polyfit(np.log(data.velocity), np.log(e), 2)
    smooth = np.exp(np.polyval(curve, np.log(data.velocity)))
    power = np.clip(np.polyval(np.polyder(curve), np.log(data.velocity)), -1, 0)
    # the part of the rebound goes with ε³, that of the fall with ε: of a curve without the noise
    w = (by_eps + e * slower) * (smooth / e) ** 3 - smooth * slower - power * smooth * slower
    design = np.stack([np.ones(N), -w], axis=1)  # ε = e + c w
    normal = design.T @ design / U**2 + np.diag([0.0, 100.0])
    covariance = np.linalg.inv(normal)
    expected = covariance @ (design.T @ data.restitution / U**2)
    assert result.values["restitution"] == pytest.approx(expected[0], abs=1e-7)
    assert result.values["air_drag"] == pytest.approx(expected[1], abs=1e-6)
    errors = np.sqrt(np.diag(covariance))
    assert result.standard_errors["restitution"] == pytest.approx(errors[0], rel=1e-4)
    assert result.standard_errors["air_drag"] == pytest.approx(errors[1], rel=1e-4)
    assert errors[0] > 1.4 * U / np.sqrt(N)
    problem = cal.problem(data, "constant")
    theta = {"restitution": 0.84, "air_drag": 0.05}
    density = stats.norm.logpdf(data.restitution, 0.84 - 0.05 * w, U).sum()
    found = jax.jit(lambda x: (problem.log_likelihood(x), problem.log_prior(x)))(theta)
    assert found[0] == pytest.approx(density, rel=1e-9)
    assert found[1] == pytest.approx(stats.norm.logpdf(0.05, 0, 0.1))
    bare = cal.RestitutionData.from_table(
        {"drop_height": [0.5, 0.8, 1.2], "rebound_height": [0.3, 0.5, 0.7]}, air=False, **BALL
    )
    assert "air_drag" not in cal.fit(bare, "constant", **FEW).values


def test_drag_moves_the_velocity_that_other_observables_are_compared_at():
    """Falls of a 3 mm ball with 5 % more and less drag, integrated: Hertz's times go with v^-1/5, forces rise with v."""
    drop, radius = np.geomspace(0.2, 2.0, 12), 1.5e-3
    contact = sj.Contact.with_wall(sj.NYLON, sj.STAINLESS_STEEL, radius)
    ball = 2 * radius, BALL["density"]
    slow, plain, fast = (
        np.array([flight(*ball, height=h, factor=1 + c)[1] for h in drop])
        for c in (0.05, 0.0, -0.05)
    )
    slower, hit, faster = (sj.restitution(sj.Hertz(contact), v) for v in (slow, plain, fast))
    assert np.max(np.abs(slow / fast - 1)) > 4e-3
    for name in ("duration", "peak_force"):
        column = {"duration": "contact_time"}.get(name, name)
        value = np.asarray(getattr(hit, name))
        table = {"drop_height": drop, column: value, f"{column}_uncertainty": 0.01 * value}
        data = cal.RestitutionData.from_table(table, contact, **BALL | {"diameter": 2 * radius})
        problem = cal.problem(data, "hertz", {"contact.youngs_modulus": cal.Parameter()})
        modulus = {"contact.youngs_modulus": float(contact.youngs_modulus)}
        more, less = (
            0.01 * np.asarray(problem.residuals(modulus | {"air_drag": c}))[:12]
            for c in (0.05, -0.05)
        )
        expected = (np.asarray(getattr(slower, name)) - np.asarray(getattr(faster, name))) / value
        np.testing.assert_allclose(more - less, expected, rtol=0.03)


@pytest.mark.parametrize(("factor", "is_raised"), [(1.5, True), (1.2, False)])
def test_a_drag_far_from_the_one_that_is_known_is_a_warning(factor, is_raised):
    """c within ± 0.1 is known of spheres: that of a 6 mm ball with more drag is found from its drops."""
    ball, drop = tuple(BALL.values()), np.geomspace(0.05, 4.0, 12)
    fall = [flight(*ball, height=h, factor=factor)[1] for h in drop]
    rise = [flight(*ball, speed=0.85 * v, factor=factor)[1] for v in fall]
    table = {"drop_height": drop, "rebound_height": rise}
    data = cal.RestitutionData.from_table(table, uncertainty=5e-4, **BALL)
    result = cal.fit(data, "constant", **FEW)
    assert result.values["air_drag"] == pytest.approx(factor - 1, abs=0.06)
    causes = [warning.cause for warning in result.warnings if warning.code == "prior-conflict"]
    assert ["air_drag" in cause for cause in causes] == [True] * is_raised


def launches(level, rate, seed=3, offset=0.004):
    """ε = level e^(-rate v) of five launches with offsets of their own, to 0.001."""
    random, v = np.random.default_rng(seed), np.tile(np.linspace(1.0, 3.0, 4), 5)
    launch = np.repeat(np.arange(5), 4)
    e = level * np.exp(-rate * v) + offset * random.standard_normal(5)[launch]
    e += 0.001 * random.standard_normal(20)
    return cal.RestitutionData(v, e, uncertainty=0.001, group=[*map(str, launch)])


def test_offsets_of_groups_do_not_carry_a_level_that_the_law_misses(tmp_path):
    """ε = e^(-b v) is 1 at rest; the groups are 0.2 lower, all of them: no scatter, and no interval."""
    missed, right = (
        cal.fit(launches(level, 0.05), Decay, {"level": 1.0, "rate": Free(0.03)}, starts=1)
        for level in (0.8, 1.0)
    )
    (warning,) = (one for one in missed.warnings if one.code == "level")
    mean = np.mean([offset for offset, _ in missed.materials[0].group_offsets.values()])
    assert -0.25 < mean < -0.1
    said = f"the law misses the level of the groups by {mean:+.2g}"
    assert warning.cause == f"{said}: as a whole they are below the curve"
    assert missed.warnings[0] == warning
    missed.report(tmp_path)
    page = (tmp_path / "report.html").read_text()
    for text in (str(missed), page[page.index("<strong>") + 8 :]):
        assert " ".join(text.split()).startswith(f"No interval holds: {said}")
    assert missed.intervals["rate"] == (None, None)
    assert np.isnan(missed.standard_errors["rate"])
    assert np.all(np.isnan([missed.covariance, missed.covariance]))
    assert np.isnan(missed.band(2.0).low)
    assert {error for _, error in missed.materials[0].group_offsets.values()} == {None}
    missed.save(tmp_path / "fit.json")
    assert cal.FitResult.load(tmp_path / "fit.json", law=Decay) == missed
    assert "level" not in {one.code for one in right.warnings}
    low, high = right.intervals["rate"]
    assert low < 0.05 < high


def test_few_groups_have_the_degrees_of_freedom_of_known_variances():
    """Kenward and Roger's, by dense matrices, of one parameter that three groups share: 7.5 in place of 13.6 of a band.

    ε = 0.93 e^{-bv} to first order of ln b: the interval, the band and the number that the table prints.
    """
    random = np.random.default_rng((55, 2, 3, 3, 5))
    v = np.tile(np.linspace(0.5, 5, 6), 3) * np.repeat(np.exp(0.05 * random.standard_normal(3)), 6)
    group = np.repeat(np.arange(3), 6)
    off = 0.003 * random.standard_normal(3)[group] + 0.01 * random.standard_normal(18)
    data = cal.RestitutionData(v, 0.93 * np.exp(-0.03 * v) + off, group=[*map(str, group)])
    result = cal.fit(data, Decay, {"level": 0.93, "rate": Free(0.03)}, profiles=False, **QUICK)
    rate, s = result.values["rate"], result.materials[0].variances
    x = -rate * v * 0.93 * np.exp(-rate * v)
    left = data.restitution - 0.93 * np.exp(-rate * v)

    def information(logs):
        sizes = np.exp(logs) * [s["scatter"], s["group"]]
        matrix = sizes[0] * np.eye(18) + sizes[1] * (group[:, None] == group)
        return matrix, x @ np.linalg.solve(matrix, x)

    def cost(logs):
        matrix, known = information(logs)
        r = left - x * (x @ np.linalg.solve(matrix, left)) / known
        return np.linalg.slogdet(matrix)[1] + np.log(known) + r @ np.linalg.solve(matrix, r)

    zero = np.zeros(2)
    values, vectors = np.linalg.eigh(0.5 * hessian(cost, zero, [1e-2, 1e-2]))
    # at least what one degree of freedom shows
    relative = vectors / np.maximum(values, 0.5) @ vectors.T
    share = optimize.approx_fprime(zero, lambda y: np.log(information(y)[1]), 1e-6)
    degrees = 2 / (share @ relative @ share)
    assert degrees < 9
    assert result.degrees_of_freedom("rate") == pytest.approx(degrees, rel=2e-3)
    band = result.band(3.0)
    for low, high, error in (
        (*np.log(result.intervals["rate"]), result.standard_errors["rate"] / rate),
        (band.low, band.high, band.standard_error),
    ):
        assert (high - low) / 2 / error == pytest.approx(stats.t.ppf(0.975, degrees), rel=1e-3)


def test_a_search_far_from_the_points_does_not_end_with_offsets_in_place_of_the_level():
    """Points without offsets: ε at rest was 0.25 here, with four offsets of 0.68."""
    random = np.random.default_rng((4, 0, 2))
    v = np.tile(np.linspace(0.5, 5, 6), 4) * np.repeat(np.exp(0.05 * random.standard_normal(4)), 6)
    group = np.repeat(np.arange(4), 6)
    random.standard_normal(4)
    e = 0.93 * np.exp(-0.03 * v) + 0.01 * random.standard_normal(24)
    result = cal.fit(
        cal.RestitutionData(v, e, group=[*map(str, group)]), Decay, starts=1, profiles=False
    )
    alone = optimize.least_squares(lambda x: x[0] * np.exp(-x[1] * v) - e, [0.9, 0.03]).x
    assert result.values["level"] == pytest.approx(alone[0], abs=0.01)
    low, high = result.intervals["level"]
    assert low < 0.93 < high


def test_a_free_parameter_without_a_printed_error_has_none_in_results_either():
    """χ̃ follows ε_up, which is at 1: the error that the curvature has is of no interval."""
    contact = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
    velocity = np.geomspace(2.0, 40.0, 12) * contact.critical_velocity
    above = 0.02 + 0.01 * np.random.default_rng(3).standard_normal(12)
    law = sj.Zhou(contact, 0.3, 1e-6, 0.5)
    data = cal.RestitutionData(velocity, sj.restitution(law, velocity).coefficient + above, contact)
    result = cal.fit(data, None, {"eps_up": Free()}, starts=2)
    table, frame = json.loads(result.to_json())["fits"][0]["parameters"], result.to_frame()
    assert result.estimates["eps_up"].at_bound
    assert result.estimates["chi"].skewed
    for name in ("chi", "eps_up"):
        assert np.isnan(result.standard_errors[name])
        assert table[name]["standard_error"] is None
        assert np.isnan(frame.set_index("parameter").standard_error[name])
    place = result.covariance_names.index("chi")
    assert result.covariance[place, place] > 0
    fixed = cal.fit(data, None, {"chi": 0.3, "eps_up": Free()}, starts=2, profiles=False)
    assert fixed.standard_errors["chi"] is None
