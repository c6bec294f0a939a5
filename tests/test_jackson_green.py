"""Jackson and Green's law as a user writes it, against SciPy and against its authors' fit."""

import jax
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import softjax as sj
from tests.jackson_green import JacksonGreen, published_fit

STEEL = sj.Material(1.93e11, 0.32, 8030.0, 3.1e8)
RIGID = sj.Material(1e16, 0.3, 1e4, 1e12)
LAW = JacksonGreen(sj.Contact.with_wall(STEEL, RIGID, 0.0127, area="hertz"), 0.32)
MASS = float(LAW.contact.mass)
YIELD = float(np.sqrt(0.8 * LAW.critical_force() * LAW.critical_overlap() / MASS))
RATIOS = np.array([1.5, 3.0, 10.0, 40.0, 80.0, 400.0, 900.0])


CRITICAL, FORCE = float(LAW.critical_overlap()), float(LAW.critical_force())
STARTS = 1.9 + 1e-14  # the force jumps by a hair there
loading = jax.jit(LAW.loading_force)


def excess(w, energy):
    """The work of loading up to δ/δ_c = w beyond an energy, both over F_c δ_c."""
    beyond = quad(lambda x: float(loading(x * CRITICAL)) / FORCE, STARTS, w, epsrel=1e-12)[0]
    return 0.4 * 1.9**2.5 + beyond - energy


@pytest.mark.parametrize("route", [None, sj.ODE(rtol=1e-10)], ids=["energy", "ode"])
def test_both_routes_against_scipy(route):
    result = sj.restitution(LAW, RATIOS * YIELD, route)
    assert list(result.status) == [sj.Status.ELASTIC] + [sj.Status.PLAIN] * (len(RATIOS) - 1)
    for k, ratio in list(enumerate(RATIOS))[1:]:
        energy = 0.4 * ratio**2
        peak = CRITICAL * brentq(excess, STARTS, 1e4, args=(energy,), xtol=1e-13, rtol=1e-14)
        rest = float(LAW.residual_overlap(peak))
        back = 0.4 * float(LAW.loading_force(peak)) * (peak - rest)  # Hertz's work
        assert np.isclose(result.peak_overlap[k], peak, rtol=1e-8)
        assert np.isclose(result.residual_overlap[k], rest, rtol=1e-8)
        assert np.isclose(result.coefficient[k] ** 2, back / (energy * FORCE * CRITICAL), rtol=1e-8)


def test_against_its_published_fit():
    """Within what the fit leaves over: 0.02 beyond the elastic stage."""
    found = sj.restitution(LAW, RATIOS * YIELD).coefficient
    strain = LAW.contact.yield_strength / LAW.contact.youngs_modulus
    assert np.max(np.abs(found - published_fit(RATIOS, strain))) < 0.02
    assert np.ptp(found) > 0.6
