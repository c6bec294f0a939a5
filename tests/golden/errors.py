"""Scenarios: what is known of parameters before, and every sort of measurement error."""

import numpy as np

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.golden import simulated
from tests.golden.cases import QUICK, contact, plain_fit, rebounds, record_band, record_fit
from tests.golden.numbers import scenario

AT = np.array([0.005, 0.05, 0.3, 2.0, 20.0])  # m/s


def two_materials(uncertainty=0.003):
    hard = rebounds(uncertainty, "harder", simulated.HARDER, chi=0.9, seed=2)
    return [rebounds(uncertainty), hard]


@scenario
def priors_and_bounds(numbers, folder):
    stated = {
        "prior": {"chi": cal.Parameter(prior=(1.0, 0.05))},
        "bound": {"chi": cal.Parameter(1.0, bounds=(0.2, 1.1))},
        "fixed": {"psi": 0.5},
        "modulus": {"contact.youngs_modulus": cal.Parameter(prior=(4.0e10, 1e9)), "psi": 0.5},
    }
    for name, parameters in stated.items():
        record_fit(numbers, cal.fit(rebounds(), parameters=parameters, **QUICK), f"{name}: ")


@scenario
def shared_and_pooled(numbers, folder):
    shared = {"psi": cal.Parameter(shared=True), "sigma": cal.Parameter(shared="both")}
    record_fit(numbers, cal.fit(two_materials(), parameters=shared, **QUICK), "shared: ")
    velocity = np.geomspace(0.1, 5.0, 8).round(4)
    sets = [
        rebounds(0.01, f"set {k}", measured=(velocity, simulated.noisy(e + 0 * velocity, 0.01, k)))
        for k, e in enumerate((0.86, 0.9, 0.88, 0.93, 0.84))
    ]
    pooled = {"restitution": cal.Parameter(shared="pooled", transform="none")}
    result = cal.fit(sets, sj.ConstantRestitution, pooled, profiles=False)
    record_fit(numbers, result, "pooled: ", weighted=True)


@scenario
def noise(numbers, folder):
    """Stated, unknown, extra and scaled: with profiles, bands, predictions and leave-one-out."""
    cases = {
        "stated": (0.003, {}),
        "unknown": (None, {}),
        "extra": (0.001, {"extra_scatter": True}),
        "none extra": (0.006, {"extra_scatter": True}),
        "scaled": (0.001, {"scale_uncertainty": True}),
    }
    for name, (uncertainty, options) in cases.items():
        weighted = "extra" in name
        result = cal.fit(rebounds(uncertainty), starts=8, **options)
        record_fit(numbers, result, f"{name}: ", weighted=weighted)
        record_band(numbers, result.band(AT), f"{name}: band", weighted=weighted)
        prediction = result.band(AT, kind="prediction", confidence=0.8)
        record_band(numbers, prediction, f"{name}: prediction", weighted=weighted)
        left = result.leave_one_out()
        record_left_out(numbers, left, f"{name}: left out", weighted)
        for label, profile in sorted(result.profiles.items()):
            # to 1e-7: extra scatter's degrees of freedom differ by 1e-8 from one processor to the next
            numbers.error(f"{name}: threshold of {label}", profile.threshold, 1e-4)


def record_left_out(numbers, left, name, weighted=False):
    """Predictions without each point, their rms, elpd and its standard error."""
    estimate = numbers.error if weighted else numbers.estimate
    estimate(name, left.predicted, 0.1 * left.rms)
    estimate(f"{name}, rms", left.rms, 0.1 * left.rms)
    numbers.error(f"{name}, elpd and its error", [left.elpd, left.elpd_se], 0.1 * left.elpd_se)


@scenario
def groups(numbers, folder):
    velocity, restitution = simulated.rebounds(noise=0.002)
    group = np.arange(simulated.POINTS) % 4
    offset = np.array([0.004, -0.006, 0.003, 0.001])[group]
    for name, uncertainty in (("stated", 0.002), ("unknown", None)):
        data = cal.RestitutionData(
            velocity, restitution + offset, contact(), uncertainty, group=group
        )
        result = cal.fit(data, **QUICK)
        record_fit(numbers, result, f"{name}: ", weighted=True)
        record_band(numbers, result.band(AT), f"{name}: band", weighted=True)
        record_left_out(numbers, result.leave_one_out(), f"{name}: left out", weighted=True)


@scenario
def bounce_trains(numbers, folder):
    """Times of bounces, with their error unknown and stated."""
    times, launch = simulated.bounces()
    ball = sj.Material(*simulated.ALLOY)
    wall = sj.Contact.with_wall(ball, sj.Material(*simulated.PLATE), simulated.RADIUS, area="hertz")
    table = {"time [s]": times, "launch": launch}
    for name, options in (("unknown", {}), ("stated", {"time_uncertainty": 1e-4})):
        data = cal.RestitutionData.from_table(table, wall, air=False, **options)
        numbers.physics(f"{name}: velocity", data.velocity)
        numbers.physics(f"{name}: restitution", data.restitution)
        result = cal.fit(data, "viscoelastic", **QUICK)
        record_fit(numbers, result, f"{name}: ", weighted=True)
        record_band(numbers, result.band([2.0, 3.0]), f"{name}: band", weighted=True)


@scenario
def flights_in_air(numbers, folder):
    """A 6 mm nylon ball in air of two densities, by heights and by flight times."""
    tables = {
        "heights": {"drop_height": [0.5, 0.8, 1.2], "rebound_height": [0.3, 0.5, 0.7]},
        "intervals": {"interval": [0.62, 0.55, 0.49]},
    }
    for name, table in tables.items():
        for air in (1.2, 1.0):
            options = {"diameter": 6e-3, "density": 1140.0}
            data = cal.RestitutionData.from_table(table, air=air, **options)
            numbers.physics(f"{name}, {air} kg/m³: velocity", data.velocity)
            numbers.physics(f"{name}, {air} kg/m³: restitution", data.restitution)
            numbers.physics(f"{name}, {air} kg/m³: by drag", data.errors.by_drag)


@scenario
def repeats(numbers, folder):
    velocity = np.repeat(simulated.around_yield()[::3], 3)
    pair = simulated.equal_spheres(simulated.ALLOY)
    exact = fit_oracle.curve(velocity, pair, 1.2, 0.9, 0.5)
    data = rebounds(None, measured=(velocity, simulated.noisy(exact, 0.004, 31))).averaged()
    numbers.physics("restitution", data.restitution)
    numbers.physics("uncertainty", data.uncertainty)
    record_fit(numbers, cal.fit(data, **QUICK), weighted=True)


@scenario
def velocity_errors(numbers, folder):
    """Each velocity to 3 %, by impact and rebound velocity and alone."""
    velocity, restitution = simulated.rebounds()
    measured = np.round(velocity * (1 + 0.03 * simulated.noisy(0 * velocity, 1.0, 41)), 5)
    data = cal.RestitutionData(
        measured, restitution, contact(), 0.003, velocity_uncertainty=0.03 * measured
    )
    record_fit(numbers, cal.fit(data, **QUICK), "alone: ", weighted=True)
    back = np.round(measured * restitution, 5)
    table = {"impact_velocity": measured, "rebound_velocity": back}
    both = cal.RestitutionData.from_table(table, contact(), velocity_uncertainty="2 %")
    numbers.physics("both: restitution", both.restitution)
    numbers.physics("both: uncertainty", both.uncertainty)
    record_fit(numbers, cal.fit(both, **QUICK), "both: ", weighted=True)


@scenario
def two_step(numbers, folder):
    """The paper's procedure on scattered data of two materials, and the line through them."""
    result = cal.fit(two_materials(), objective="two-step", starts=8)
    record_fit(numbers, result)
    record_band(numbers, result.band(AT, "alloy"), "band")
    line = result.unloading_line
    for name in ("c1", "c2"):
        found = getattr(line, name)
        numbers.estimate(f"line: {name}", found.value, found.standard_error)
        numbers.error(f"line: {name} error", found.standard_error, found.standard_error)


@scenario
def likelihood(numbers, folder):
    """ln L, ln prior and residuals at given parameters, with stated errors."""
    problem = cal.problem(rebounds(), None, {"chi": cal.Parameter(prior=(1.0, 0.3))})
    at = {"chi": 1.1, "sigma": 0.8, "psi": 0.45}
    numbers.physics("stated: ln L", problem.log_likelihood(at))
    numbers.physics("stated: residuals", problem.residuals(at))
    numbers.physics("stated: ln prior", problem.log_prior(at))


@scenario
def refits(numbers, folder):
    found = plain_fit().bootstrap(40, seed=5)
    for name, (low, high) in found.intervals.items():
        numbers.error(f"limits of {name}", [low, high], (high - low) / 4)
