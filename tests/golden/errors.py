"""Scenarios: every sort of measurement error and of law, and what is known of parameters before."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.golden import simulated
from tests.golden.cases import QUICK, contact, plain_fit, rebounds, record_band, record_fit
from tests.golden.numbers import scenario
from tests.physics.own_laws import Hardening

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
    extra, scaled = {"extra_scatter": True}, {"scale_uncertainty": True}
    cases = [("stated", 0.003, {}), ("unknown", None, {}), ("extra", 0.001, extra)]
    cases += [("none extra", 0.006, extra), ("scaled", 0.001, scaled)]
    for name, uncertainty, options in cases:
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
        arrays = (velocity, restitution + offset, contact(), uncertainty)
        data = cal.RestitutionData(*arrays, group=group)
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
    for label, value in result.values.items():
        numbers.estimate(label, value, 0.02 * value)
    numbers.estimate("curve", result.band(AT, "alloy").coefficient, 0.001)
    for key, size in result.rms.items():
        numbers.estimate(f"rms {key}", size, 0.01 * size)
    line = result.unloading_line
    for name in ("c1", "c2"):
        numbers.estimate(f"line: {name}", getattr(line, name).value, 0.005)


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


class Rubbing(sj.RateDependentLaw):
    """Hertz's spring and a dashpot that grows with the overlap."""

    end = "zero-overlap"
    contact: sj.Contact
    viscosity: float

    def force(self, overlap, velocity):
        return self.contact.stiffness * overlap**1.5 + self.viscosity * overlap * velocity


class Learned(sj.RateIndependentLaw):
    """Hertz's loading; the power of unloading is a network's function of the largest overlap."""

    contact: sj.Contact
    network: eqx.nn.MLP = sj.array_field()

    def loading_force(self, overlap):
        return self.contact.stiffness * overlap**1.5

    def unloading_force(self, overlap, peak_overlap):
        size = jnp.log(peak_overlap / self.contact.critical_overlap)
        power = 1.5 + jax.nn.softplus(self.network(jnp.stack([size]))[0])
        return self.loading_force(peak_overlap) * (overlap / peak_overlap) ** power


def network():
    """Three tanh in one layer; its ten numbers by a formula, so that no generator decides."""
    made = eqx.nn.MLP(1, 1, 3, 1, activation=jnp.tanh, key=jax.random.key(0))
    place = iter(range(4))

    def filled(leaf):
        if not eqx.is_array(leaf):
            return leaf
        return jnp.asarray(0.5 * np.cos(1 + next(place) + np.arange(leaf.size))).reshape(leaf.shape)

    return jax.tree.map(filled, made)


def on_a_line(contact, c1, c2, sigma, psi):
    """Zhou's law with Eq. (18) for its factor."""
    return sj.Zhou(contact, c1 + c2 * contact.yield_ratio, sigma, psi)


@scenario
def built_in_laws(numbers, folder):
    """Each built-in law fitted to data of its own kind."""
    pair = simulated.equal_spheres(simulated.ALLOY)
    above = np.geomspace(0.15, 8.0, simulated.POINTS).round(4)
    spring = float(contact().stiffness) * np.sqrt(float(contact().radius))
    growth = 300.0 * above / np.sqrt(spring / pair["M"])
    power = above**0.2
    exact = {
        "zhou": (None, None),
        "thornton": (above, fit_oracle.thornton(above, 0.7)),
        "walton-braun": (above, 1 / np.sqrt(1.2 + growth)),
        "viscoelastic": (above, 1 - 0.06 * power + 0.0022 * power**2),
        "hertz": (above, 0.995 + 0 * above),
        "hertz-dashpot": (above, 0.83 + 0 * above),
        "linear": (above, 0.62 + 0 * above),
        "constant": (above, 0.9 + 0 * above),
        "eq-17": (above, fit_oracle.eq_17(above, pair["v_lim"], 0.9, 0.5)),
    }
    for seed, law in enumerate(cal.LAWS):
        velocity, curve = exact[law]
        measured = None if velocity is None else (velocity, simulated.noisy(curve, 0.004, seed))
        data = rebounds(0.004, law, measured=measured)
        record_fit(numbers, cal.fit(data, law, starts=8), f"{law}: ")


@scenario(long=True)
def variants_of_zhou(numbers, folder):
    """The full form, κ as printed, Hertz's area, and levels of confidence."""
    for options in ({"form": "full"}, {"kappa": "printed"}):
        result = cal.fit(rebounds(), parameters=options, **QUICK)
        record_fit(numbers, result, f"{options}: ")
    velocity, restitution = simulated.rebounds()
    hertz = cal.RestitutionData(velocity, restitution, contact(area="hertz"), 0.003)
    record_fit(numbers, cal.fit(hertz, confidence=0.68, starts=8), "area hertz, 68 %: ")


def falling():
    """Restitutions that fall as a power of the velocity."""
    velocity = np.geomspace(0.05, 5.0, simulated.POINTS).round(4)
    exact = 1 - 0.08 * velocity**0.4
    return rebounds(0.004, measured=(velocity, simulated.noisy(exact, 0.004, 21)))


@scenario(long=True)
def damped_own_law(numbers, folder):
    """A force that depends on the velocity, by time integration."""
    viscosity = {"viscosity": cal.Parameter(1e7)}
    record_fit(numbers, cal.fit(falling(), Rubbing, viscosity, **QUICK))


@scenario(long=True)
def own_laws(numbers, folder):
    """A law by two forces, and one with a parameter of the contact."""
    start = {"length": cal.Parameter(1e-3, bounds=(1e-6, 1.0))}
    result = cal.fit(falling(), Hardening, start, starts=8)
    record_fit(numbers, result, "own: ")
    record_band(numbers, result.band([0.02, 0.5, 9.0]), "own: band")
    strength = {"contact.yield_strength": cal.Parameter(2.8e8, bounds=(1e8, 8e8))}
    chi = {"chi": 1.2, "sigma": 0.9, "psi": 0.5}
    record_fit(numbers, cal.fit(rebounds(), parameters=chi | strength, **QUICK), "yield: ")


@scenario(long=True)
def learned_law(numbers, folder):
    """A small network: its curve and band are determined, its weights are not."""
    data = rebounds()
    parameters = {"network": cal.Parameter(network())}
    result = cal.fit(data, Learned, parameters, profiles=False, starts=1, max_steps=500)
    numbers.estimate("rms", result.rms, 0.1 * result.rms)
    record_band(numbers, result.band([0.02, 0.3, 4.0]), "band")


@scenario
def link_over_materials(numbers, folder):
    """Eq. (18) as a function law on two sets with shared coefficients."""
    hard = rebounds(name="harder", material=simulated.HARDER, chi=0.9, seed=2)
    shared = {
        "c1": cal.Parameter(0.0, bounds=None, shared=True),
        "c2": cal.Parameter(0.005, shared=True),
        "sigma": cal.Parameter(0.9),
        "psi": cal.Parameter(0.5),
    }
    record_fit(numbers, cal.fit([rebounds(), hard], on_a_line, shared, **QUICK))
