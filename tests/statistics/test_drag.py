"""One drag coefficient of all flights in air, (1 + c) C_d with c ~ N(0, 0.1), against dense algebra."""

import jax
import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from tests.data.test_air import flight

U, N = 0.004, 40
BALL = {"diameter": 6e-3, "density": 1140.0}
QUICK = {"profiles": False, "starts": 4}


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
    result = cal.fit(data, "constant", **QUICK)
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
    assert "air_drag" not in cal.fit(bare, "constant", **QUICK).values


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
    result = cal.fit(data, "constant", **QUICK)
    assert result.values["air_drag"] == pytest.approx(factor - 1, abs=0.06)
    causes = [warning.cause for warning in result.warnings if warning.code == "prior-conflict"]
    assert ["air_drag" in cause for cause in causes] == [True] * is_raised
