"""The largest contact force: formulas of the laws that have them, forces along histories of the others."""

import diffrax
import jax
import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, pair

STEEL = pair("stainless steel", area="hertz")
VELOCITY = np.array([1e-3, 0.1, 3.0])
MASS, STIFFNESS = STEEL.mass, STEEL.stiffness


def thornton():
    law = sj.Thornton(STEEL, 1.6)
    start, pace = (float(x) for x in law.scales())
    y = VELOCITY / pace
    beyond = y * np.sqrt(np.maximum(1.2 - 0.2 / y**2, 0.0))
    return STIFFNESS * start**1.5 * np.where(y > 1, beyond, y**1.2)


FORMULAS = {
    "hertz": (sj.Hertz(STEEL), STIFFNESS * (1.25 * MASS * VELOCITY**2 / STIFFNESS) ** 0.6),
    "walton-braun": (sj.WaltonBraun(STEEL, 1e6, 3e6, 100.0), VELOCITY * np.sqrt(1e6 * MASS)),
    "thornton": (sj.Thornton(STEEL, 1.6), thornton()),
}


@pytest.mark.parametrize("route", [None, sj.ODE()], ids=["energy", "ode"])
@pytest.mark.parametrize("name", FORMULAS)
def test_of_laws_without_damping(name, route):
    law, exact = FORMULAS[name]
    found = sj.restitution(law, VELOCITY, route).peak_force
    assert np.allclose(found, exact, rtol=1e-12 if route is None else 1e-7, atol=0)


def test_where_the_force_falls_before_the_bodies_stop():
    """Zhou's first-order force has its largest value within loading; just below it is that of the peak."""
    law = fitted("nylon")
    velocity = np.array([3.0, 290.0]) * float(law.contact.critical_velocity)
    hit = sj.restitution(law, velocity)
    grid = np.linspace(0, 1, 200_001)[:, None] * np.asarray(hit.peak_overlap)
    along = np.asarray(law.loading_force(grid)).max(0)
    assert along[1] > 1.01 * law.loading_force(hit.peak_overlap[1])
    assert np.allclose(hit.peak_force, along, rtol=1e-9, atol=0)


@pytest.mark.parametrize("end", ["zero-overlap", "zero-force"])
def test_of_the_linear_dashpot(end):
    """k x + c x' of a damped oscillator; of strong damping it is largest at touch, 2ξ √(K M) v."""
    restitution = np.array([0.9, 0.5, 0.05])
    xi = -np.log(restitution) / np.sqrt(np.pi**2 + np.log(restitution) ** 2)
    w, t = np.sqrt(1 - xi**2), np.linspace(0, 2, 400_001)[:, None]
    pull = np.exp(-xi * t) * ((1 - 2 * xi**2) * np.sin(w * t) / w + 2 * xi * np.cos(w * t))
    exact = 2.0 * np.sqrt(1e6 * MASS) * pull.max(0)
    law = sj.LinearSpringDashpot(STEEL, 1e6, restitution, end)
    for route, error in ((None, 1e-8), (sj.ODE(), 1e-6)):
        found = sj.restitution(law, 2.0, route).peak_force
        assert np.allclose(found, exact, rtol=error, atol=0)


@pytest.mark.parametrize(
    "law", [sj.HertzDashpot(STEEL, 0.6), sj.ViscoelasticHertz(STEEL, 2e-6)], ids=["hertz", "visco"]
)
def test_of_damped_hertzian_contacts(law):
    """The largest of many forces along the way; and its derivative."""
    velocity = VELOCITY[1:]
    history = np.asarray(sj.collide(law, velocity, 2001, sj.ODE(rtol=1e-10)).force).max(-1)
    force = lambda v: sj.restitution(law, v).peak_force  # noqa: E731
    assert np.allclose(force(velocity), history, rtol=3e-6, atol=0)
    step = 1e-3
    slope = (force(velocity * (1 + step)) - force(velocity * (1 - step))) / (2 * step)
    found = jax.jvp(force, (velocity,), (velocity,))[1]
    assert np.allclose(found, slope, rtol=1e-5, atol=0)


def test_without_a_contact_there_is_none():
    assert sj.restitution(sj.Hertz(STEEL), 0.0).peak_force == 0
    assert sj.restitution(sj.ViscoelasticHertz(STEEL, 1e-6), 0.0).peak_force == 0
    assert sj.restitution(sj.ConstantRestitution(None, 0.9), 1.0).peak_force == 0


@pytest.mark.parametrize("solver", [diffrax.Tsit5(), diffrax.Bosh3()], ids=["tsit5", "bosh3"])
def test_a_solver_of_diffrax_is_what_its_name_is(solver):
    law, name = fitted("nylon"), type(solver).__name__.lower()
    found = sj.restitution(law, 2.0, sj.ODE(rtol=1e-6, solver=solver)).coefficient
    named = sj.restitution(law, 2.0, sj.ODE(rtol=1e-6, solver=name)).coefficient
    assert found == pytest.approx(float(named), rel=1e-14)


def test_solvers_that_are_refused():
    with pytest.raises(ValueError, match=r"`solver` must have an error estimate unless"):
        sj.ODE(solver=diffrax.Euler())
    with pytest.raises(ValueError, match=r"`solver` must be an explicit solver of diffrax"):
        sj.ODE(solver=diffrax.Kvaerno5())
    assert sj.ODE(solver=diffrax.Midpoint(), steps=4).steps == 4
