"""Scenarios: laws compared, and what measurements can tell before they are made."""

import numpy as np

import calibration as cal
import softjax as sj
from tests.golden.cases import contact, plain_fit, rebounds
from tests.golden.numbers import scenario

LAW = (1.2, 0.9, 0.5)
SHOTS = [0.02, 0.06, 0.1, 0.3, 1.0, 5.0]


@scenario
def comparison(numbers, folder):
    laws = ["zhou", "thornton", "viscoelastic", "constant"]
    found = cal.compare(rebounds(), laws)
    numbers.text("error", "ranking", ", ".join(found.ranking))
    for label in found.ranking:
        result = found[label]
        left = result.leave_one_out()
        numbers.estimate(f"{label}: rms", result.rms, 0.1 * result.rms)
        numbers.estimate(f"{label}: ln L, AIC", [result.log_likelihood, result.aic], 0.1)
        numbers.error(f"{label}: elpd", [left.elpd, left.elpd_se], 0.1 * left.elpd_se)


@scenario
def information(numbers, folder):
    """Of a law, of a law with a prior, and of further shots of a fit."""
    law = sj.Zhou(contact(), *LAW)
    found = cal.fisher_information(law, SHOTS, uncertainty=0.003)
    numbers.error("law: matrix", found.matrix, 1e-4 * np.abs(found.matrix))
    modulus = float(contact().youngs_modulus)
    prior = cal.Parameter(prior=(modulus, 0.03 * modulus))
    parameters = {"psi": 0.5, "contact.youngs_modulus": prior}
    plans = {
        "law": found,
        "prior": cal.fisher_information(law, SHOTS, uncertainty=0.003, parameters=parameters),
        "fit": cal.fisher_information(plain_fit(), [0.05, 3.0]),
    }
    for name, plan in plans.items():
        for parameter, error in plan.standard_errors.items():
            numbers.error(f"{name}: {parameter}", error, error)


@scenario
def designs(numbers, folder):
    law = sj.Zhou(contact(), *LAW)
    for criterion in ("c", "D", "I"):
        found = cal.optimal_velocities(law, 8, (0.01, 8.0), criterion=criterion, uncertainty=0.003)
        # the criterion is flat where it is least
        numbers.error(f"{criterion}: velocity", found.velocity, 3 * found.velocity)
        for name, error in found.relative_errors.items():
            numbers.error(f"{criterion}: {name}", error, error)
        numbers.error(f"{criterion}: gain", found.gain, 1.0)


@scenario(long=True)
def sensitivities(numbers, folder):
    """θ ∂ε/∂θ of the inputs of two spheres and of a law's own fields."""
    metal = sj.Material(71e9, 0.33, 2700.0, 280e6)
    spheres = cal.of_spheres(metal, 0.0125, chi=1.2, sigma=0.9, psi=0.5)
    for name, inputs in (("spheres", spheres), ("law", sj.ViscoelasticHertz(contact(), 2e-6))):
        found = cal.sensitivity(inputs, [0.02, 0.3, 4.0])
        for column in found.names:
            numbers.physics(f"{name}: {column}", found.of(column), least=1e-12)


@scenario(long=True)
def sobol_indices(numbers, folder):
    """First and total indices by their seed."""
    ranges = {"chi": (0.9, 1.5), "sigma": (0.7, 1.1), "psi": (0.45, 0.55)}
    law = sj.Zhou(contact(), *LAW)
    found = cal.sobol_indices(law, ranges, [0.02, 4.0], samples=256, seed=3, resamples=9)
    numbers.physics("first", found.first)
    numbers.physics("total", found.total)
    numbers.physics("mean, variance", [found.mean, found.variance])
