"""Subclasses of the library's rate-independent laws, with forces of their own."""

import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, pair

STEEL = pair("stainless steel")


class HalfSpring(sj.WaltonBraun):
    """Back along half of the force."""

    def unloading_force(self, overlap, peak_overlap):
        return 0.5 * super().unloading_force(overlap, peak_overlap)


class HalfHertz(sj.Hertz):
    def unloading_force(self, overlap, peak_overlap):
        return 0.5 * self.loading_force(overlap)


class Elastic(sj.Zhou):
    """Back along the loading force: what is lost is sound and heat."""

    def unloading_force(self, overlap, peak_overlap):
        return self.loading_force(overlap)


class SpringAgain(HalfSpring):
    """Given reduced again, as its parent's parent."""

    def reduced(self):
        return sj.WaltonBraun.reduced(self)


@pytest.mark.parametrize(
    "route",
    [sj.EnergyBalance(), pytest.param(sj.ODE(rtol=1e-10), marks=pytest.mark.long)],
    ids=["energy", "ode"],
)
def test_half_of_a_force_gives_back_half(route):
    """ε² = k1/(2 k2), δ* as with the whole force; ε² = 1/2 of Hertz's, by hand."""
    velocity = np.array([0.0, 0.1, 3.0])
    found = sj.restitution(HalfSpring(STEEL, 1e6, 2e6), velocity, route)
    peak = velocity * np.sqrt(STEEL.mass / 1e6)
    assert np.allclose(found.coefficient, [1.0, 0.5, 0.5], rtol=1e-9, atol=0)
    assert np.allclose(found.peak_overlap, peak, rtol=1e-9, atol=0)
    assert np.allclose(found.residual_overlap, [0.0, *peak[1:] / 2], rtol=1e-8, atol=0)
    found = sj.restitution(HalfHertz(STEEL), velocity, route)
    assert np.allclose(found.coefficient[1:], np.sqrt(0.5), rtol=1e-9, atol=0)
    assert np.all(found.status[1:] == sj.Status.NO_RESIDUAL_OVERLAP)


def test_a_law_that_is_given_reduced_again_goes_by_that():
    found = sj.restitution(SpringAgain(STEEL, 1e6, 2e6), 1.0)
    assert found.coefficient == pytest.approx(np.sqrt(0.5), rel=1e-14)


@pytest.mark.long
def test_losses_beside_the_force_act_as_ever():
    """ε is that of Eq. (17), at v up to yield and at v_cr beyond; the kink there is known."""
    zhou = fitted("stainless steel")
    law = Elastic(zhou.contact, zhou.chi, zhou.sigma, zhou.psi)
    critical = float(zhou.contact.critical_velocity)
    assert law.elastic_velocity() == 0
    velocity = critical * np.array([0.3, 20.0])
    found = sj.restitution(law, velocity)
    at = np.minimum(velocity, critical)
    expected = sj.empirical_restitution(at, zhou.contact.limit_velocity, zhou.sigma, zhou.psi)
    assert np.allclose(found.coefficient, expected, rtol=1e-10, atol=0)
    assert np.all(found.status == sj.Status.NO_RESIDUAL_OVERLAP)


def test_an_elastic_stage_of_its_own():
    """Hertz's up to the overlap that it tells, half of the force beyond."""

    class Staged(HalfHertz):
        def elastic_overlap(self):
            return 1e-6

        def unloading_force(self, overlap, peak_overlap):
            given = self.loading_force(overlap)
            return jnp.where(peak_overlap > 1e-6, 0.5 * given, given)

    law = Staged(STEEL)
    limit = np.sqrt(0.8 * STEEL.stiffness * 1e-6**2.5 / STEEL.mass)
    assert law.elastic_velocity() == pytest.approx(limit, rel=1e-13)
    found = sj.restitution(law, limit * np.array([0.5, 2.0]))
    assert np.allclose(found.coefficient, [1.0, np.sqrt(0.5)], rtol=1e-9, atol=0)
    assert list(found.status) == [sj.Status.ELASTIC, sj.Status.NO_RESIDUAL_OVERLAP]
    assert found.peak_overlap[0] == pytest.approx(1e-6 * 0.5**0.8, rel=1e-12)


def test_elastic_by_its_own_word():
    class Again(HalfHertz):
        never_yields = True

        def unloading_force(self, overlap, peak_overlap):
            return self.loading_force(overlap)

    assert sj.restitution(Again(STEEL), 1.0).status == sj.Status.ELASTIC
