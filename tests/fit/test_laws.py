"""Every law is fitted as SciPy fits its formula: values, errors, bands, profiles, links over materials."""

from dataclasses import replace

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize, stats

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.decay import Decay, decay
from tests.fit_data import TRUTH, eq_17_data, pair

Free = cal.Parameter
QUICK = {"profiles": False, "starts": 4}
NOISE = 0.005
PAIR = pair("nylon")
CRITICAL, LIMIT = float(PAIR.critical_velocity), float(PAIR.limit_velocity)
HERTZ_CRITICAL = CRITICAL / np.pi ** (5 / 3)  # of a contact area smaller by π^(2/3)
VELOCITY = np.geomspace(1.3, 40, 30) * CRITICAL
SPRING = float(PAIR.stiffness) * float(PAIR.radius) ** 0.5
PER_VELOCITY = np.sqrt(SPRING / float(PAIR.mass))  # s of Walton and Braun over dε⁻²/dv


def thornton(v, factor, critical=HERTZ_CRITICAL):
    return fit_oracle.thornton(v, critical, factor)


def walton_braun(v, unloading, growth):
    return 1 / np.sqrt(unloading / SPRING + growth * v / PER_VELOCITY)


def eq_17(v, sigma, psi):
    return fit_oracle.eq_17(v, LIMIT, sigma, psi)


def constant(v, e):
    return e + 0 * v


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


def measured(curve, truth, **options):
    noise = NOISE * np.random.default_rng(0).standard_normal(len(VELOCITY))
    return cal.RestitutionData(VELOCITY, curve(VELOCITY, *truth) + noise, PAIR, **options)


@pytest.mark.parametrize(
    ("name", "stated"), [*((name, False) for name in LAWS), ("eq-17", True), ("decay", True)]
)
def test_values_errors_and_bands_are_scipy_s(name, stated):
    """u as stated is absolute, else the residuals' s with Student's t; wald limits on the log scale."""
    curve, truth = LAWS[name]
    data = measured(curve, truth, **({"uncertainty": NOISE} if stated else {}))
    law, parameters = OWN.get(name, (name, None))
    result = cal.fit(data, law, parameters, **QUICK)
    model = lambda *values: curve(VELOCITY, *values)  # noqa: E731
    values, covariance, off = fit_oracle.fit(model, truth, data.restitution, data.uncertainty)
    assert result.converged
    labels = result.covariance_names
    assert len(labels) == len(truth) == result.rank
    np.testing.assert_allclose([result.values[n] for n in labels], values, rtol=1e-6)
    np.testing.assert_allclose(result.covariance, covariance, rtol=1e-4)
    degrees = np.inf if stated else len(data) - len(truth)
    t = stats.t.ppf(0.975, degrees)
    band = result.band(VELOCITY)
    np.testing.assert_allclose(band.coefficient, model(*values), rtol=1e-8)
    np.testing.assert_allclose(band.high - band.coefficient, t * band.standard_error, rtol=1e-6)
    size = NOISE if stated else np.sqrt(np.sum(off**2) / degrees)
    one = result.band(VELOCITY, kind="prediction")
    np.testing.assert_allclose(one.standard_error, np.hypot(band.standard_error, size), rtol=1e-5)
    if name == "decay":
        for label, value, error in zip(labels, values, np.sqrt(np.diag(covariance)), strict=True):
            ends = value * np.exp(np.array([-t, t]) * error / value)
            np.testing.assert_allclose(result.intervals[label], ends, rtol=1e-5)


def test_a_sphere_on_a_wall_and_many_radii_in_one_set():
    """Each impact has its own reduced mass and critical velocity."""
    material, chi, sigma, psi, _ = TRUTH["nylon"]
    radius = np.repeat([0.005, 0.01], 12)
    wall = sj.Contact.with_wall(material, material, radius)
    velocity = np.tile(np.geomspace(0.3, 30, 12), 2)
    expected = [
        fit_oracle.curve(velocity[half], fit_oracle.numbers(one), chi, sigma, psi)
        for half, r in ((slice(0, 12), 0.005), (slice(12, 24), 0.01))
        for one in [sj.Contact.with_wall(material, material, r)]
    ]
    data = cal.RestitutionData(velocity, np.concatenate(expected), wall)
    assert cal.fit(data, **QUICK).values["chi"] == pytest.approx(chi, rel=1e-6)


def test_without_elastic_properties_eq_17_or_a_constant_is_fitted():
    data = eq_17_data("nylon", noise=0.002)
    result = cal.fit(replace(data, contact=None, limit_velocity=data.limit_velocity))
    assert result.settings["law"] == "eq-17"
    assert isinstance(result.law, sj.EmpiricalRestitution)
    assert result.covariance_names == ("sigma", "psi")
    flat = cal.RestitutionData(np.linspace(1, 3, 12), 0.9 + 0.01 * (-1.0) ** np.arange(12))
    alike = cal.RestitutionData(np.full(12, 2.0), flat.restitution, velocity_uncertainty=0.1)
    for data in (flat, alike):
        constant = cal.fit(data)
        assert constant.settings["law"] == "constant"
        assert constant.values["restitution"] == pytest.approx(0.9, abs=1e-9)
        expected = np.std(data.restitution, ddof=1) / np.sqrt(12)
        assert constant.standard_errors["restitution"] == pytest.approx(expected, rel=1e-6)


def test_a_parameter_may_have_a_unit_which_tables_and_files_keep(tmp_path):
    def spring(contact, stiffness, loss):
        return sj.LinearSpringDashpot(contact, stiffness, restitution=1 / (1 + loss))

    contact = pair("nylon")
    data = cal.RestitutionData([0.5, 1.0, 2.0, 4.0], [0.81, 0.79, 0.80, 0.80], contact)
    parameters = {"stiffness": Free(1e6, free=False, unit="N/m"), "loss": Free(unit="J")}
    result = cal.fit(data, spring, parameters, profiles=False)
    assert "loss [J]" in str(result)
    result.save(tmp_path / "fit.json")
    again = cal.FitResult.load(tmp_path / "fit.json", law=spring)
    assert again == result
    assert list(again.to_frame()["unit"]) == ["N/m", "J"]


@pytest.mark.parametrize("size", [0.005, 5e-5])
def test_outliers_lose_their_pull_under_student_s_t(size):
    """Against SciPy's largest density; its curvature; those that stick out are named with their weight."""
    noise = size * np.random.default_rng(7).standard_normal(60)
    noise[::9] -= 14 * size  # the limit of one of 60 is 9.03 scales
    v = np.linspace(1, 40, 60)
    data = cal.RestitutionData(v, decay(v, 0.9, 0.01) + noise)
    result = cal.fit(data, Decay, OWN["decay"][1], noise="student-t", **QUICK)
    scale = result.materials[0].noise

    def cost(x):
        return -np.sum(stats.t.logpdf((decay(v, *x) - data.restitution) / scale, 4))

    values = np.array([result.values[n] for n in ("level", "rate")])
    options = {"method": "Nelder-Mead", "options": {"xatol": 1e-10}}
    np.testing.assert_allclose(values, optimize.minimize(cost, values, **options).x, rtol=1e-6)
    errors = np.sqrt(np.diag(result.covariance))
    covariance = np.linalg.inv(fit_oracle.hessian(cost, values, 0.02 * errors))
    np.testing.assert_allclose(result.covariance, covariance, rtol=1e-3)
    pulled = 0.9 - cal.fit(data, Decay, **QUICK).values["level"]
    assert abs(values[0] - 0.9) < 0.8 * size < pulled
    named = {outlier.row - 1: outlier for outlier in result.outliers}
    assert set(named) == set(range(0, 60, 9))
    standard = (data.restitution - decay(v, *values)) / scale
    slopes = np.stack([np.exp(-values[1] * v), -v * decay(v, *values)], axis=1)
    rows = slopes * np.sqrt(5 / (4 + standard**2))[:, None]  # the weights of maximum likelihood
    leverage = np.sum(rows @ np.linalg.inv(rows.T @ rows) * rows, axis=1)
    for row, outlier in named.items():
        off = standard[row]
        assert outlier.residual == pytest.approx(off / np.sqrt(1 - leverage[row]), rel=1e-5)
        assert outlier.weight == pytest.approx(4 / (4 + off**2), rel=1e-4)
        assert (outlier.velocity, outlier.line) == (v[row], None)


class Springs(sj.AbstractRoute):
    """Walton and Braun's collision by its formulas, as a user would write it."""

    name = "springs"

    def refusal(self, law):
        return None if isinstance(law, sj.WaltonBraun) else "another for this law, but is Springs()"

    def collide(self, law, velocity, *, clock=False, force=False):
        peak_force = velocity * jnp.sqrt(law.loading_stiffness * law.contact.mass)
        peak = peak_force / law.loading_stiffness
        stiffness = law.unloading_stiffness + law.growth * peak_force
        flags = jnp.zeros_like(velocity, dtype=jnp.int32)
        energy, residual = law.loading_stiffness / stiffness, peak - peak_force / stiffness
        return sj.Collision(energy, peak, residual, flags, force=peak_force if force else None)


class Known(sj.EnergyBalance):
    """A route of the user's that has the name of one of the library's, and a number of its own."""

    nodes: int = 32


@pytest.mark.parametrize(
    ("route", "kept"),
    [
        (sj.EnergyBalance(), "energy balance"),
        ("closed-form", "closed form"),
        (Known(5), Known(5)),
        (sj.TimeODE(rtol=1e-6), sj.TimeODE(rtol=1e-6)),
        (sj.ODE(), sj.ODE()),
    ],
)
def test_a_route_with_settings_keeps_them(route, kept):
    """`Known(5)` became "energy balance", with its usual nodes."""
    assert cal.FitOptions.of(route=route).route == kept


class Nameless(sj.AbstractRoute):
    def refusal(self, law):
        return None

    def collide(self, law, velocity, *, clock=False, force=False):
        return sj.EnergyBalance().collide(law, velocity, clock=clock, force=force)


class Alike:
    """It has the methods of a route, and is none."""

    name, refusal, collide = "alike", Springs.refusal, Springs.collide


@pytest.mark.parametrize(
    ("route", "accepted"),
    [
        (Nameless(), "one with a name"),
        (Alike(), r"your own, or a name: ode, "),
        (sj.ODE, r"your own, or a name: ode, "),
        (Known(jnp.ones(3)), "one of numbers and words, without arrays"),
    ],
)
def test_a_route_that_no_fit_can_take_is_refused(route, accepted):
    with pytest.raises(ValueError, match=f"^`route` must be .*{accepted}") as caught:
        cal.FitOptions.of(route=route)
    assert "\n" not in str(caught.value)


def test_a_fit_takes_a_route_of_the_users_own_and_is_loaded_without_it(tmp_path):
    law = sj.WaltonBraun(PAIR, SPRING, 1.4 * SPRING, 500.0)
    noise = 0.002 * np.random.default_rng(1).standard_normal(20)
    v = np.geomspace(0.1, 5, 20)
    data = cal.RestitutionData(v, sj.restitution(law, v).coefficient + noise, PAIR, 0.002)
    usual, own = (
        cal.fit(data, "walton-braun", route=route, profiles=False, starts=1)
        for route in (None, Springs())
    )
    for name in ("unloading_stiffness", "growth"):
        assert own.values[name] == pytest.approx(usual.values[name], rel=1e-9)
        assert own.standard_errors[name] == pytest.approx(usual.standard_errors[name], rel=1e-6)
    known = cal.fit(data, "walton-braun", route=Known(5), profiles=False, starts=1).settings
    assert (known["route"], known["nodes"]) == ("energy balance", 5)
    given = sj.ODE(solver=diffrax.Tsit5(), rtol=1e-8)
    by_time = cal.fit(data, "walton-braun", route=given, profiles=False, starts=1)
    assert by_time.settings["solver"] == "Tsit5"
    assert by_time.values["growth"] == pytest.approx(usual.values["growth"], rel=1e-4)
    by_time.save(tmp_path / "by_time.json")
    assert cal.FitResult.load(tmp_path / "by_time.json").values == by_time.values
    own.save(tmp_path / "fit.json")
    loaded = cal.FitResult.load(tmp_path / "fit.json")
    assert loaded.values == own.values
    assert "springs" in (tmp_path / "fit.json").read_text(encoding="utf-8")
    with pytest.raises(ValueError, match=r"`route` must be .*your own, or a name.*but is springs"):
        cal.fit(data, "walton-braun", route="springs")
    with pytest.raises(ValueError, match=r"`route` must be another for this law"):
        cal.fit(data, "constant", route=Springs())
