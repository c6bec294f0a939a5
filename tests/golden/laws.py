"""Scenarios: every sort of law fitted."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.golden import simulated
from tests.golden.cases import QUICK, contact, rebounds, record_band, record_fit
from tests.golden.numbers import scenario


class Hardening(sj.RateIndependentLaw):
    """Hertz's loading; unloading is the steeper the deeper the impact went."""

    contact: sj.Contact
    length: float

    def loading_force(self, overlap):
        return self.contact.stiffness * overlap**1.5

    def unloading_force(self, overlap, peak_overlap):
        power = 1.5 + peak_overlap / self.length
        return self.loading_force(peak_overlap) * (overlap / peak_overlap) ** power


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
    for seed, (law, (velocity, curve)) in enumerate(exact.items()):
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
