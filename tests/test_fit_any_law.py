"""Every law is fitted, with every sort of parameter, as SciPy fits its formula."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.decay import Decay
from tests.fit_data import TRUTH, pair, twin

Free = cal.Parameter
QUICK = {"profiles": False, "starts": 8}
NOISE = 0.005
PAIR = pair("nylon")
CRITICAL, LIMIT = float(PAIR.critical_velocity), float(PAIR.limit_velocity)
HERTZ_CRITICAL = float(np.asarray(sj.Thornton(PAIR).elastic_velocity()))
VELOCITY = np.geomspace(1.3, 40, 30) * CRITICAL
SPRING = float(PAIR.stiffness) * float(PAIR.radius) ** 0.5
PER_VELOCITY = np.sqrt(SPRING / float(PAIR.mass))  # s of Walton and Braun over dε⁻²/dv


def thornton(v, factor):
    """Thornton's closed form; V_y goes with the power 5/2 of p_y."""
    r = np.minimum(HERTZ_CRITICAL * factor**2.5 / v, 1.0)
    inner = r / (r + 2 * np.sqrt(1.2 - r**2 / 5))
    return np.where(r < 1, (1.2 * 3**0.5) ** 0.5 * np.sqrt(1 - r**2 / 6) * inner**0.25, 1.0)


def walton_braun(v, unloading, growth):
    return 1 / np.sqrt(unloading / SPRING + growth * v / PER_VELOCITY)


def eq_17(v, sigma, psi):
    return fit_oracle.eq_17(v, LIMIT, sigma, psi)


def constant(v, e):
    return e + 0 * v


def decay(v, level, rate):
    return level * np.exp(-rate * v)


LAWS = {
    "thornton": (thornton, (1.6,)),
    "walton-braun": (walton_braun, (1.2 * SPRING, 60.0)),
    "eq-17": (eq_17, (0.4355, 0.5414)),
    "constant": (constant, (0.8,)),
    "hertz-dashpot": (constant, (0.8,)),
    "linear": (constant, (0.8,)),
    "decay": (decay, (0.9, 0.004)),
}
OWN = {"decay": (Decay, {"level": Free(0.8), "rate": Free(0.01)})}


def measured(curve, truth, seed=0, **told):
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(VELOCITY))
    return cal.RestitutionData(VELOCITY, curve(VELOCITY, *truth) + noise, PAIR, **told)


def scipy_fit(curve, data, truth):
    found = fit_oracle.fit(
        lambda *values: curve(data.velocity, *values), truth, data.restitution, data.uncertainty
    )
    return found[:2]


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("name", LAWS)
def test_values_errors_and_intervals_are_scipy_s(name, stated):
    curve, truth = LAWS[name]
    data = measured(curve, truth, **({"uncertainty": NOISE} if stated else {}))
    law, parameters = OWN.get(name, (name, None))
    result = cal.fit(data, law, parameters, **QUICK)
    values, covariance = scipy_fit(curve, data, truth)
    assert result.converged
    labels = result.covariance_names
    assert len(labels) == len(truth)
    np.testing.assert_allclose([result.values[n] for n in labels], values, rtol=1e-6)
    np.testing.assert_allclose(result.covariance, covariance, rtol=2e-5)
    band = result.band(VELOCITY)
    np.testing.assert_allclose(band.coefficient, curve(VELOCITY, *values), rtol=1e-8)
    degrees = np.inf if stated else len(data) - len(truth)
    reach = band.high - band.coefficient
    np.testing.assert_allclose(reach, stats.t.ppf(0.975, degrees) * band.standard_error, rtol=1e-6)


def test_profiles_of_another_law_are_where_the_cost_has_risen():
    data = measured(walton_braun, LAWS["walton-braun"][1], uncertainty=NOISE)
    result = cal.fit(data, "walton-braun", starts=8)
    names = ("unloading_stiffness", "growth")
    best = np.array([result.values[name] for name in names])

    def cost(values):
        return np.sum(((walton_braun(VELOCITY, *values) - data.restitution) / NOISE) ** 2)

    for k, name in enumerate(names):
        assert result.materials[0].parameters[name].method == "profile"
        for end in result.intervals[name]:
            other = best[1 - k]

            def at(x, end=end, k=k, other=other):
                values = np.array([end, end])
                values[1 - k] = other * x
                return cost(values)

            lowest = optimize.minimize_scalar(
                at, bounds=(0.2, 5), method="bounded", options={"xatol": 1e-10}
            ).fun
            assert lowest - cost(best) == pytest.approx(stats.chi2.ppf(0.95, 1), rel=2e-3)


def test_a_link_of_ones_own_runs_through_three_materials():
    """p_y/Y = a + b ln(E/Y) of Thornton's law, shared; each material's other numbers its own."""
    pairs = {name: pair(name) for name in TRUTH}
    ratios = {name: float(np.asarray(p.yield_ratio)) for name, p in pairs.items()}
    slowest = {n: float(np.asarray(sj.Thornton(p).elastic_velocity())) for n, p in pairs.items()}
    y = np.geomspace(5, 500, 12)

    def curve(name, a, b):
        factor = a + b * np.log(ratios[name])
        return thornton(y * slowest[name] * HERTZ_CRITICAL / slowest[name], factor)

    random = np.random.default_rng(1)
    sets = [
        cal.RestitutionData(
            y * slowest[n], curve(n, 0.5, 0.3) + 0.003 * random.standard_normal(12), p, 0.003, n
        )
        for n, p in pairs.items()
    ]

    def linked(contact, a, b):
        return sj.Thornton(contact, a + b * jnp.log(contact.yield_ratio))

    shared = {"a": Free(0.8, shared=True), "b": Free(0.1, shared=True)}
    result = cal.fit(sets, linked, shared, **QUICK)

    def residual(values):
        return [(curve(d.name, *values) - d.restitution) / 0.003 for d in sets]

    found = optimize.least_squares(lambda x: np.concatenate(residual(x)), [0.8, 0.1], xtol=1e-14)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    assert len(result.covariance_names) == 2
    for k, name in enumerate("ab"):
        assert result.values[f"{name}[nylon]"] == pytest.approx(found.x[k], rel=1e-6)
    np.testing.assert_allclose(result.covariance, covariance, rtol=1e-4)
    assert result.unloading_line is None


def test_independent_sets_together_are_what_each_is_alone():
    """Under `model`, where stainless steel's ε_up ends at its bound, which is a fit that arrived."""
    sets = cal.paper_materials()
    together = cal.fit(sets, **QUICK)
    assert together.converged
    for data, chi in zip(sets, (2.0220, 0.11535, 0.27019), strict=True):
        alone = cal.fit(data, **QUICK)
        name = f"chi[{data.name}]"
        assert alone.values["chi"] == pytest.approx(chi, abs=6e-5)
        assert together.values[name] == pytest.approx(alone.values["chi"], rel=1e-9)
        error = alone.standard_errors["chi"]
        assert together.standard_errors[name] == pytest.approx(error, rel=1e-6)
    steel = together.materials[0].parameters["eps_up"]
    assert steel.at_bound
    assert steel.value == 1.0


def test_a_prior_beside_noise_that_nobody_stated():
    """The noise is what the points scatter by, and not one: 200 points and a prior that is off."""
    velocity = np.linspace(1, 40, 200)
    noise = 0.005 * np.random.default_rng(5).standard_normal(200)
    data = cal.RestitutionData(velocity, decay(velocity, 0.9, 0.01) + noise)
    prior = {"level": Free(0.8), "rate": Free(0.02, prior=(0.0105, 0.0001))}
    result = cal.fit(data, Decay, prior, **QUICK)
    size = 1.0
    for _ in range(40):  # the noise and the fit, one after the other

        def residual(x, size=size):
            off = (decay(velocity, *x) - data.restitution) / size
            return np.append(off, (x[1] - 0.0105) / 0.0001)

        found = optimize.least_squares(residual, [0.9, 0.01], x_scale=[1, 0.01], xtol=1e-15)
        covariance = np.linalg.inv(found.jac.T @ found.jac)
        paid = np.sum((found.jac[:200] @ covariance) * found.jac[:200])
        size = np.sqrt(np.sum((found.fun[:200] * size) ** 2) / (200 - paid))
    np.testing.assert_allclose([result.values[n] for n in ("level", "rate")], found.x, rtol=1e-6)
    errors = [result.standard_errors[n] for n in ("level", "rate")]
    np.testing.assert_allclose(errors, np.sqrt(np.diag(covariance)), rtol=1e-4)
    assert result.materials[0].noise == pytest.approx(size, rel=1e-5)


@pytest.mark.parametrize("loss", ["huber", "soft-l1"])
@pytest.mark.parametrize("loss_scale", [1.0, 2.0])
def test_robust_losses_are_reweighted_least_squares(loss, loss_scale):
    """Value, scale and error of an independent iteration with the scale of the median deviation."""
    velocity = np.linspace(1, 40, 60)
    noise = 0.005 * np.random.default_rng(7).standard_normal(60)
    noise[::9] -= 0.04
    data = cal.RestitutionData(velocity, decay(velocity, 0.9, 0.01) + noise)
    parameters = {"level": Free(0.8), "rate": Free(0.02)}
    result = cal.fit(data, Decay, parameters, loss=loss, loss_scale=loss_scale, **QUICK)
    weight_of = {
        "huber": lambda t: 1 / np.maximum(t, 1),
        "soft-l1": lambda t: 1 / np.sqrt(1 + t**2),
    }[loss]
    slope_of = {
        "huber": lambda t: (t <= 1).astype(float),
        "soft-l1": lambda t: (1 + t**2) ** -1.5,
    }[loss]
    x = np.array([0.9, 0.01])
    for _ in range(300):
        e = np.exp(-x[1] * velocity)
        jacobian = np.stack([e, -x[0] * velocity * e], axis=1)
        off = data.restitution - x[0] * e
        size = loss_scale * 1.482602218505602 * np.median(np.abs(off))
        w = weight_of(np.abs(off) / size)
        x = x + np.linalg.solve(jacobian.T @ (w[:, None] * jacobian), jacobian.T @ (w * off))
    np.testing.assert_allclose([result.values[n] for n in parameters], x, rtol=1e-6)
    spread = np.sum((w * off) ** 2) / (60 - 2)
    bent = -off * (x[0] * velocity**2 * e)  # second derivatives of the curve, times ψ
    slope = slope_of(np.abs(off) / size)
    bread = jacobian.T @ (slope[:, None] * jacobian)
    mixed = np.sum(w * off * velocity * e)
    bread += np.array([[0.0, mixed], [mixed, np.sum(w * bent)]])
    inverse = np.linalg.inv(bread)
    covariance = inverse @ (spread * jacobian.T @ jacobian) @ inverse
    errors = [result.standard_errors[n] for n in parameters]
    np.testing.assert_allclose(errors, np.sqrt(np.diag(covariance)), rtol=2e-4)


def test_what_the_fit_does_not_know_is_known_to_be_unknown():
    """Zhou's law without points below v_cr knows nothing there; with points below alone, no χ̃."""
    above = twin("nylon", np.geomspace(1.3, 40, 20), 0.002)
    result = cal.fit(above, **QUICK)
    v = np.array([0.5, 0.99, 1.01, 10.0]) * CRITICAL
    np.testing.assert_array_equal(result.known(v), [False, False, True, True])
    band = result.band(v)
    np.testing.assert_array_equal(np.isnan(band.coefficient), [True, True, False, False])
    below = cal.fit(twin("nylon", np.linspace(0.1, 0.95, 20), 0.0005), **QUICK)
    np.testing.assert_array_equal(below.known(v), [True, True, False, False])
    assert below.values["chi"] is None
    both = cal.fit(twin("nylon", noise=0.002), **QUICK)
    assert np.all(both.known(v))


def zhou_of_my_own(name):
    def law(contact, chi):
        return sj.Zhou(contact, chi=chi, sigma=0.4, psi=0.5)

    law.__name__ = name
    return law


def test_a_law_of_one_s_own_is_no_built_in_one():
    """Neither by its name, nor in the paper's procedure, which is of σ and ψ."""
    data = cal.paper_materials(10)[2]
    with pytest.raises(ValueError, match="`law` must be named otherwise than the built-in laws"):
        cal.fit(data, zhou_of_my_own("zhou"))
    with pytest.raises(ValueError, match='`objective` must be Zhou\'s law, or "model"'):
        cal.fit(data, zhou_of_my_own("mine"), objective="two-step")
