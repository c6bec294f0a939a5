"""A law that has learned its unloading: a network's weights fitted as one whole parameter."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj


class Learned(sj.RateIndependentLaw):
    """Hertz's force in loading, F_m (δ/δ_m)^p in unloading, with p of ln δ_m by a network."""

    contact: sj.Contact
    network: eqx.nn.MLP = sj.array_field()

    def loading_force(self, overlap):
        return self.contact.stiffness * overlap**1.5

    def unloading_force(self, overlap, peak_overlap):
        size = jnp.log(peak_overlap / self.contact.critical_overlap)
        power = 1.5 + jax.nn.softplus(self.network(jnp.stack([size]))[0])
        return self.loading_force(peak_overlap) * (overlap / peak_overlap) ** power


def network():
    found = eqx.nn.MLP(1, 1, 6, 1, activation=jnp.tanh, key=jax.random.key(0))
    return jax.tree.map(lambda leaf: leaf.astype(float) if eqx.is_array(leaf) else leaf, found)


@pytest.fixture(scope="module")
def result():
    data = cal.paper_materials()[0]
    options = {"profiles": False, "starts": 1, "max_steps": 60}
    return cal.fit(data, Learned, {"network": cal.Parameter(network())}, **options)


def test_the_curve_is_followed_ten_times_as_closely_as_by_zhou_s_law(result):
    """Zhou's law has an rms of 0.015; ε² = 2.5/(p + 1) is told by hand from the fitted weights."""
    assert result.rms < 0.002
    law = result.law
    hit = sj.restitution(law, result.data.velocity)
    size = np.log(np.asarray(hit.peak_overlap) / float(law.contact.critical_overlap))
    (first, second) = law.network.layers
    hidden = np.tanh(np.outer(size, np.asarray(first.weight)[:, 0]) + np.asarray(first.bias))
    power = 1.5 + np.logaddexp(0, hidden @ np.asarray(second.weight)[0] + np.asarray(second.bias))
    np.testing.assert_allclose(np.asarray(hit.coefficient) ** 2, 2.5 / (power + 1), rtol=1e-9)
    misfit = np.asarray(hit.coefficient) - result.data.restitution
    assert np.sqrt(np.mean(misfit**2)) == pytest.approx(result.rms, rel=1e-9)


def test_predictions_have_errors_and_weights_have_none(result):
    assert "19 numbers of network" in str(result)
    assert not result.standard_errors
    band = result.band(result.data.velocity)
    assert np.all(np.isfinite(band.standard_error))
    assert np.all(band.standard_error > 0)
    assert np.max(band.standard_error) < 5 * result.materials[0].noise
