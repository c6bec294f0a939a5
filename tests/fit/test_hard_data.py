"""Data on which a fit, or its errors, once ended elsewhere: minima, bounds and variances."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.coverage.runner import Case
from tests.coverage.test_coverage import CASES
from tests.fit_data import ON_STEEL, pair, twin
from tests.fit_oracle import own_model
from tests.golden import simulated
from tests.shown.capture import as_recorded


@pytest.mark.long  # half a minute
def test_a_loss_that_went_to_nothing_while_scatters_were_large_comes_back():
    """With E free the first scatters let σ go to 0 and ε_up to 1, where χ̃ is off by ten errors."""
    case = CASES["sensors, zhou, contact times and dents"]
    data = Case(**case).data(np.random.default_rng((7, 0, 21)))
    free = {"contact.youngs_modulus": cal.Parameter()}
    result = cal.fit(data, None, free, profiles=False, starts=8)
    assert [warning.code for warning in result.warnings] == ["sigma-psi-not-separate"]
    assert result.values["chi"] == pytest.approx(0.22, abs=0.03)
    psi = result.values["psi"]
    near = {"chi": cal.Parameter(0.22), "sigma": cal.Parameter(0.24)}
    near |= {"psi": cal.Parameter(psi, prior=(psi, 1e-6))}
    fixed = cal.fit(data, None, free | near, profiles=False, starts=1)
    assert result.log_likelihood == pytest.approx(fixed.log_likelihood, abs=1e-5)
    one, other = (fit.material().derived["eps_up"] for fit in (result, fixed))
    assert 0.97 < one.value < 0.995
    assert one.standard_error == pytest.approx(other.standard_error, rel=1e-3)
    for end in ("value", "low", "high"):
        nearly = pytest.approx(getattr(other, end), abs=1e-3 * other.standard_error)
        assert getattr(one, end) == nearly


def test_the_lower_of_two_minima_is_found():
    """Drops without noise that χ̃ = 6.71 made: the likelihood has another minimum at 4.45."""
    ball, plate = (sj.Material(*one) for one in (simulated.BRONZE, simulated.PLATE))
    contact = sj.Contact.with_wall(ball, plate, 0.006)
    drop = np.repeat([0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0], 3)
    ratio = float(contact.critical_velocity / contact.limit_velocity)
    sigma = -np.log(0.9868) / (ratio / (1 - ratio)) ** 0.5
    v = np.sqrt(2 * simulated.GRAVITY * drop)
    e = fit_oracle.curve(v, fit_oracle.numbers(contact), 6.71, sigma, 0.5)
    table = {"drop_height": drop, "rebound_height": e**2 * drop}
    made = cal.RestitutionData.from_table(
        table, contact, air=False, drop_height_uncertainty="2 mm", rebound_height_uncertainty="2 mm"
    )
    result = cal.fit(made, profiles=False)
    assert result.values["chi"] == pytest.approx(6.71, abs=0.05)


def test_losses_that_go_to_nothing_end_at_their_bound_and_free_chi():
    """ε_up at 1 stays a parameter: profiles of χ̃ lower it again, or they cover the truth in 3 of 4 sets."""
    height = np.array([0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 1.6]).repeat(3)
    law = sj.Zhou(ON_STEEL, chi=1.5, sigma=0.8, psi=0.5)
    exact = np.asarray(sj.restitution(law, np.sqrt(2 * 9.80665 * height)).coefficient)
    random = np.random.default_rng(1004)
    dropped = height + 0.001 * random.standard_normal(24)
    rebound = height * (exact + 0.004 * random.standard_normal(24)) ** 2
    table = {"drop_height": dropped, "rebound_height": rebound + 0.001 * random.standard_normal(24)}
    stated = {"height_uncertainty": 0.001, "air": False}
    data = cal.RestitutionData.from_table(table, contact=ON_STEEL, **stated)
    fit = cal.fit(data, extra_scatter=True).materials[0]
    assert fit.parameters["eps_up"].at_bound
    assert fit.values["eps_up"] == 1
    chi = fit.parameters["chi"]
    assert chi.low < 1.5 < chi.high
    fixed = cal.fit(data, extra_scatter=True, parameters={"chi": chi.low}).materials[0]
    assert 0.98 < fixed.values["eps_up"] < 0.99


def test_parameters_at_their_bounds_follow_no_point():
    """ε that rises: χ̃ and ψ end at 0, where σ alone acts, as a mean does on its residuals."""
    velocity = np.geomspace(0.05, 5, 25)  # the slowest alone is below first yield
    rising = np.linspace(0.87, 0.99, 25)
    data = cal.RestitutionData(velocity, rising, ON_STEEL, uncertainty=0.01)
    fit = cal.fit(data, profiles=False).materials[0]
    assert (fit.values["chi"], fit.values["psi"]) == (0, 0)
    off = (np.asarray(sj.restitution(fit.law, velocity).coefficient) - rising) / 0.01
    assert fit.residual_degrees == pytest.approx(24)
    assert fit.standardised == pytest.approx(off / np.sqrt(1 - 1 / 25), abs=1e-3)
    assert fit.reduced_chi_squared == pytest.approx(np.sum(off**2) / 24, rel=1e-4)


def test_losses_just_below_yield_have_the_exponent_of_the_largest_likelihood():
    """Loss 0.02 (v/v_cr)^6 below yield: σ is of the order of 1e14, and the cost rises to both sides of ψ."""
    contact = pair("nylon")
    critical, limit = float(contact.critical_velocity), float(contact.limit_velocity)
    v = np.append(np.linspace(0.5, 0.99, 8), np.geomspace(1.02, 20, 20)) * critical
    above = sj.restitution(sj.Zhou(contact, 0.3, 0.4, 0.5), v).coefficient
    e = np.where(v < critical, 1 - 0.02 * (v / critical) ** 6, above)
    e += 0.003 * np.random.default_rng(1).standard_normal(28)
    data = cal.RestitutionData(v, e, contact, 0.003, limit_velocity=limit)
    law, ratio = cal.fit(data, starts=4, profiles=False).law, np.log(limit / critical - 1)

    def cost(change):
        """With another ψ and the same ε_up."""
        moved = sj.Zhou(law.contact, law.chi, law.sigma * np.exp(change * ratio), law.psi + change)
        off = np.asarray(sj.restitution(moved, v).coefficient) - e
        return np.sum(off**2) / (2 * 0.003**2)

    assert 3 < law.psi < 20
    assert cost(0.0) < min(cost(-0.5), cost(0.5))


def test_a_refit_that_is_sent_astray_ends_no_profile():
    """Where σ and ψ hardly show, their first guess at the next χ̃ is far off: SciPy finds the way."""
    data = twin("stainless steel", noise=0.01, seed=2)
    result = cal.fit(data, starts=8)
    low, high = result.intervals["chi"]
    model = own_model(data)

    def cost(chi):
        residual = lambda x: model(chi, *np.exp(x)) - data.restitution  # noqa: E731
        return min(2 * least_squares(residual, x).cost for x in ([-5.0, -5.0], [0, -0.6]))

    best = result.values["chi"]
    variance = cost(best) / (len(data) - 3)
    inside = best - 0.8 * (best - low)
    assert cost(inside) - cost(best) < stats.t.ppf(0.975, len(data) - 3) ** 2 * variance
    assert best - low == pytest.approx(high - best, rel=0.35)


def test_variances_end_where_the_likelihood_is_largest_though_it_bends_the_other_way():
    """On the way of this seed a step shortened element by element went uphill, and the fit took turns."""
    ball = sj.Material(youngs_modulus=3e9, poisson_ratio=0.4, density=1400, yield_strength=60e6)
    contact = sj.Contact.with_wall(ball, sj.STAINLESS_STEEL, 0.01)
    law, times = sj.ViscoelasticHertz(contact, dissipation_time=2e-6), []
    for first in (3.0, 3.15, 3.3):
        velocity, time = first, 0.0
        for _ in range(9):
            times.append(time)
            velocity *= float(sj.restitution(law, velocity).coefficient)
            time += 2 * velocity / 9.80665
    noise = np.random.default_rng(124).standard_normal(54)[27:]
    table = {"launch": np.repeat(["a", "b", "c"], 9), "time": times + 2e-4 * noise}
    data = cal.RestitutionData.from_table(table, contact=contact, air=False)
    result = cal.fit(data, "viscoelastic", profiles=False, starts=1)
    assert result.materials[0].timing == pytest.approx(2e-4, rel=0.3)
    as_recorded("times of bounces", {"printed": str(result)})


def test_variances_of_specimens_count_no_direction_that_the_points_cannot_move():
    """At a second minimum σ acts on next to nothing: with its slope the likelihood had no bound below."""
    velocity, specimen = np.geomspace(0.01, 6, 30), np.arange(30) % 5
    exact = sj.restitution(sj.Zhou(ON_STEEL, chi=1.5, sigma=0.8, psi=0.5), velocity).coefficient
    random = np.random.default_rng(1005)
    noise, offset = 0.002 * random.standard_normal(30), 0.004 * random.standard_normal(5)
    measured, labels = np.asarray(exact) + noise + offset[specimen], list(map(str, specimen))
    data = cal.RestitutionData(velocity, measured, contact=ON_STEEL, group=labels)
    result = cal.fit(data, profiles=False)
    assert result.converged
    assert result.materials[0].variances["scatter"] == pytest.approx(0.002**2, rel=0.5)


def test_a_fit_converges_although_one_interval_was_read_six_per_cent_long():
    """All noise is then of times, and costs are rounded where the gradient of the slopes is not zero."""
    ball = sj.Material(71e9, 0.33, 2700.0, 280e6)
    contact = sj.Contact.with_wall(ball, sj.STAINLESS_STEEL, 0.0125)
    law, random = sj.Zhou(contact, chi=1.2, sigma=3.0, psi=0.5), np.random.default_rng(11)
    times, labels = [], []
    for launch in range(3):
        v = 4.43
        for bounce in range(8):
            e = float(sj.restitution(law, v).coefficient) + 0.005 * random.standard_normal()
            v *= e
            long = 1.06 if (launch, bounce) == (1, 3) else 1.0
            times.append(2 * v / 9.81 * long)
            labels.append(f"l{launch}")
    table = {"launch": labels, "interval": times}
    data = cal.RestitutionData.from_table(table, contact, air=False)
    assert cal.fit(data, profiles=False, starts=4).converged
