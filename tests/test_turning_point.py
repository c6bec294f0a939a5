"""Collisions beside y_max, the last with a turning point, against 120-digit arithmetic."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softjax.laws.zhou import FirstOrder
from tests.cases import collide
from tests.hard_inputs import PRECISIONS

ROWS = json.loads(Path(__file__).with_name("oracles").joinpath("turning_point.json").read_text())


@pytest.mark.parametrize("precision", PRECISIONS)
def test_on_the_rising_side_to_rounding_error(precision):
    """All in one batch: those who need more steps beside those who do not."""
    kind = PRECISIONS[precision]
    d, X, y, distance, squared, peak, sensitivity = np.array(ROWS[precision]).T
    found = collide(FirstOrder(jnp.asarray(d, kind), jnp.asarray(X, kind)), jnp.asarray(y, kind))
    eps = float(np.finfo(kind).eps)
    allowed = max(1e-12, 8 * eps) + 8 * eps * sensitivity
    turns = np.asarray(found.turns)
    assert np.all(turns | (distance < 32 * eps))  # else within rounding of the last one
    error = np.abs(np.asarray(found.plastic_squared, float) - squared)
    assert np.flatnonzero(turns & ~(error <= allowed)).tolist() == []
    # the root moves with the square root of the distance
    near = 8 * eps / np.sqrt(np.maximum(distance, 8 * eps))
    off = np.abs(np.asarray(found.peak, float) / peak - 1)
    assert np.flatnonzero(turns & ~(off <= near)).tolist() == []
    assert np.all(found.residual <= found.peak * (1 + 4 * eps))
    assert turns.sum() > 120
