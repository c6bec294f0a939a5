"""Products keep their whole precision on every device, and numbers shorter than float32 are computed in it."""

import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import ml_dtypes
import numpy as np
import pytest

import softjax as sj
from tests.cases import pair
from tests.hard.test_float32 import equations

PAIR = pair("nylon")
HIGHEST = jax.lax.Precision.HIGHEST


class Cone(sj.RateIndependentLaw):
    contact: sj.Contact
    hardness: float

    def loading_force(self, overlap):
        return self.hardness * overlap**2

    def unloading_force(self, overlap, peak_overlap):
        return self.hardness * peak_overlap * jnp.maximum(2 * overlap - peak_overlap, 0)


ZHOU = sj.Zhou(PAIR, 1.8, 3.0, 0.5)
VISCOUS = sj.ViscoelasticHertz(PAIR, 1e-6)
CALLS = {
    "duration": lambda law, v: sj.restitution(law, v).duration,
    "restitution": lambda law, v: sj.restitution(law, v).coefficient,
    "by time": lambda law, v: sj.restitution(law, v, sj.ODE()).coefficient,
    "history": lambda law, v: sj.collide(law, v, samples=5).force,
}
LAWS = {"first-order": ZHOU, "viscous": VISCOUS, "own": Cone(PAIR, 1e11)}
IN_TIME = [("by time", "own"), ("history", "viscous")]


def trace():
    """By default GPUs round the factors of a product of float32 to ten bits (TF32)."""
    values = [(call, law) for call in ("duration", "restitution") for law in ("first-order", "own")]
    for call, law in values + IN_TIME:
        of = CALLS[call]
        along = lambda law, v: jax.jvp(lambda law: of(law, v), (law,), (law,))  # noqa: B023, E731
        slopes = along if (call, law) in values else of  # traced for ten seconds
        program = jax.make_jaxpr(slopes)(LAWS[law], jnp.asarray([0.1, 1.0]))
        every = equations(program.jaxpr)
        found = [e.params["precision"] for e in every if e.primitive.name == "dot_general"]
        assert set(found) <= {(HIGHEST, HIGHEST), HIGHEST}, (call, law)
        assert found or (call, law) != ("duration", "first-order")  # what is looked for is there


# The physics behind the public names, where every annotation is meant literally. The names that
# users call say what they accept themselves, with a ValueError (refusals).
CHECKED = """
from jaxtyping import install_import_hook
inside = {
    "engine": ("outcome", "motion", "encke", "energy", "falls", "phase"),
    "laws": ("_first_order", "_full"),
    "numerics": ("powers", "roots", "quadrature"),
}
modules = [f"softjax.{part}.{name}" for part, names in inside.items() for name in names]
with install_import_hook(modules, "beartype.beartype"):
    import softjax.engine.motion  # loaded late otherwise, past the hook
softjax.enable_x64()
from tests.jax.test_precision import trace
trace()
"""


def test_products_have_no_shortened_factors_and_arrays_the_types_of_their_signatures():
    """In a process of its own: what checks the types of all calls makes tracing a fifth dearer."""
    here = Path(__file__).parents[2]
    command = [sys.executable, "-c", CHECKED]
    done = subprocess.run(command, capture_output=True, text=True, cwd=here, check=False)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.parametrize("kind", [ml_dtypes.bfloat16, ml_dtypes.float8_e4m3fn, np.float16])
def test_short_floats_are_computed_in_float32(kind):
    """bfloat16 was called no finite number. χ̃ = 1.75 and the velocities are exact in all of them."""
    speeds = np.array([0.5, 2.0])
    single = jax.tree.map(lambda leaf: np.float32(leaf), PAIR)
    law = sj.Zhou(single, np.float32(1.75), np.float32(3.0), np.float32(0.5))
    expected = sj.restitution(law, np.float32([0.5, 2.0]))
    for given in (speeds.astype(kind), jnp.asarray(speeds.astype(kind))):
        found = sj.restitution(law, given)
        assert found.coefficient.dtype == np.float32
        assert np.array_equal(found.coefficient, expected.coefficient)
    of_short = sj.Zhou(single, kind(1.75), np.array(3.0, kind), jnp.asarray(0.5, kind))
    found = sj.restitution(of_short, np.float32([0.5, 2.0]))
    assert np.allclose(found.coefficient, expected.coefficient, rtol=1e-6)
    with pytest.raises(ValueError, match=r"^`velocity` must be a finite impact velocity"):
        sj.restitution(law, np.array([np.nan, 1.0], ml_dtypes.bfloat16))


def test_short_weights_of_a_network_are_float32():
    class Net(sj.HardSphereLaw):
        weights: jax.Array = sj.array_field()

        def restitution_squared(self, velocity):
            return self.weights[0] * jnp.exp(-self.weights[1] * velocity)

    law = Net(jnp.asarray([0.5, 0.25], jnp.bfloat16))
    found = sj.restitution(law, np.float32([1.0])).coefficient
    assert found.dtype == np.float32
    assert found == pytest.approx([np.sqrt(0.5 * np.exp(-0.25))], rel=1e-6)
    with pytest.raises(ValueError, match=r"^`weights` must be finite numbers"):
        Net(jnp.asarray([0.5, np.inf], jnp.bfloat16))


def test_strict_promotion_of_types_and_short_scalars():
    """Numbers of several precisions under a setting that refuses to mix them; scalars keep theirs."""
    short = sj.ConstantRestitution(None, np.float16(0.5))
    assert sj.restitution(short, np.float16(1.0)).coefficient.dtype == np.float32
    law = sj.Zhou(PAIR, np.float32(1.8), 3.0, 0.5)
    expected = sj.restitution(ZHOU, np.array([1.0])).coefficient
    with jax.numpy_dtype_promotion("strict"):
        found = jax.jit(lambda law, v: sj.restitution(law, v).coefficient)(law, np.array([1.0]))
        slope = jax.grad(lambda law: sj.restitution(law, np.array([1.0])).coefficient.sum())(law)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert np.isfinite(slope.chi)
