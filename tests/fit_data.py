"""Data sets with known parameters, for the tests of fits."""

import numpy as np

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.cases import pair

ALUMINIUM = sj.Material(70e9, 0.33, 2700.0, 250e6)
ON_STEEL = sj.Contact.with_wall(ALUMINIUM, sj.STAINLESS_STEEL, 0.01)
TRUTH = {
    "stainless steel": (sj.STAINLESS_STEEL, 1.7944, 3.0432, 0.5400, 250.0),
    "chrome steel": (sj.CHROME_STEEL, 0.09867, 0.1418, 0.3114, 25.0),
    "nylon": (sj.NYLON, 0.21998, 0.4355, 0.5414, 80.0),
}


def y_values(name, below=10, above=20):
    """Multiples of the critical velocity on both sides of it."""
    low = np.linspace(0.1, 0.95, below) if below else np.zeros(0)
    return np.concatenate([low, np.geomspace(1.3, TRUTH[name][4], above)])


def twin(name, y=None, noise=0.0, seed=0, area="zhou", **options):
    """The model's own curve, made by SciPy, with its known parameters."""
    _, chi, sigma, psi, _ = TRUTH[name]
    contact = pair(name, area)
    velocity = (y_values(name) if y is None else np.asarray(y)) * float(contact.critical_velocity)
    exact = fit_oracle.curve(velocity, fit_oracle.numbers(contact), chi, sigma, psi)
    noisy = exact + noise * np.random.default_rng(seed).standard_normal(len(velocity))
    return cal.RestitutionData(velocity, noisy, contact, name=name, **options)


def eq_17_data(name, points=30, noise=0.0, seed=0, y=None, **options):
    """Eq. (17) with Table 1's coefficients."""
    _, _, sigma, psi, y_end = TRUTH[name]
    contact = pair(name)
    y = 1 + np.arange(1, points + 1) / points * (y_end - 1) if y is None else np.asarray(y)
    velocity = y * float(contact.critical_velocity)
    exact = fit_oracle.eq_17(velocity, float(contact.limit_velocity), sigma, psi)
    noisy = exact + noise * np.random.default_rng(seed).standard_normal(len(velocity))
    return cal.RestitutionData(velocity, noisy, contact, name=name, **options)
