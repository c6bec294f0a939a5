"""Forces in newtons, integrated by SciPy, give the collision that the library computes from them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import law_with
from tests.laws import LAWS, PAIR, WITH_FORCE
from tests.oracles.by_scipy import by_motion, by_works
from tests.oracles.zhou_mp import loading, loading_end, unloading
from tests.physics.own_laws import Borrowed

ZHOU = {form: sj.Zhou(PAIR, 1.7944, 3.0432, 0.54, form=form) for form in ("first-order", "full")}
DAMPED = [name for name in WITH_FORCE if isinstance(LAWS[name].law, sj.RateDependentLaw)]
BY_WORKS = {name: LAWS[name].law for name in WITH_FORCE if name not in DAMPED}
BY_WORKS["printed"] = sj.Zhou(PAIR, 1.7944, 3.0432, 0.54, form="full", kappa="printed")
loading_of = jax.jit(lambda law, x: law.loading_force(x))
unloading_of = jax.jit(lambda law, x, top: law.unloading_force(x, top))
RATIOS = np.array([0.02, 0.7, 0.999, 1.5, 20.0])  # velocity over that of first yield


@pytest.mark.parametrize("name", BY_WORKS)
def test_works_of_the_forces(name):
    """Unloading that is not Hertz's below first yield, or a force in other units, shows here."""
    law = BY_WORKS[name]
    velocity = RATIOS * float(law.contact.critical_velocity)
    found = sj.restitution(law, velocity)
    for k, v in enumerate(velocity):
        exact = by_works(Borrowed(law.contact, law), float(v))
        assert exact.squared == pytest.approx(float(found.plastic_coefficient[k]) ** 2, rel=1e-12)
        assert exact.peak == pytest.approx(float(found.peak_overlap[k]), rel=1e-12)
        rest = float(found.residual_overlap[k])
        assert exact.residual == pytest.approx(rest, rel=1e-8, abs=1e-6 * exact.peak)


@pytest.mark.parametrize("name", DAMPED)
def test_motion_by_damped_forces(name):
    """A damping force off by a factor, or the other end of the contact, shows here."""
    law = LAWS[name].law
    found, exact = sj.restitution(law, 0.3), by_motion(law, 0.3)
    assert exact.squared == pytest.approx(float(found.coefficient) ** 2, rel=2e-7)
    assert exact.peak == pytest.approx(float(found.peak_overlap), rel=1e-7)
    rest = float(found.residual_overlap)
    assert exact.residual == pytest.approx(rest, rel=1e-5, abs=1e-9 * exact.peak)
    assert exact.duration == pytest.approx(float(found.duration), rel=1e-6)


@pytest.mark.parametrize("form", ZHOU)
@pytest.mark.parametrize("d", [1e-5, 6.7e-3, 0.3])
def test_zhous_forces_in_forty_digits(form, d):
    """Both branches over k δ_cr^{3/2}; Hertz's below yield, and both meet at the peak."""
    law = law_with(d, 7.6, form)
    length = float(law.contact.critical_overlap)
    unit = float(law.contact.stiffness) * length**1.5
    end = min(float(loading_end(form, d)), 80.0)
    peak = 0.7 * end + 0.3
    x = np.array([0.0, 0.3, 0.999, 1.001, *np.linspace(1.2, 0.99 * end, 12), peak])
    exact = [float(loading(form, d, float(value))) for value in x]
    loaded = np.asarray(loading_of(law, x * length)) / unit
    assert np.allclose(loaded, exact, rtol=1e-11, atol=1e-12)
    back = np.linspace(0.4, 1.0, 7) * peak
    exact = [float(unloading(form, d, 7.6, peak, float(at))) for at in back]
    found = unloading_of(law, back * length, peak * length) / unit
    assert np.allclose(found, exact, rtol=0, atol=1e-11 * max(exact))
    assert found[-1] == pytest.approx(loaded[-1], rel=1e-12)


@pytest.mark.parametrize("form", ZHOU)
def test_an_elastic_unloading_force_has_hertzs_slopes(form):
    """k δ^{3/2} below first yield: no slope in the peak nor in χ̃, (3/2) k √δ in the overlap."""
    peak = 0.5 * float(PAIR.critical_overlap)
    at = ZHOU[form], 0.3 * peak, jnp.asarray(peak)
    law, x, top = jax.jit(jax.grad(unloading_of, (0, 1, 2)))(*at)
    assert float(x) == pytest.approx(1.5 * float(PAIR.stiffness) * np.sqrt(at[1]), rel=1e-12)
    assert (float(top), float(law.chi)) == (0, 0)
