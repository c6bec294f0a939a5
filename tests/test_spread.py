"""Batches that their owner has spread over devices stay there; nothing is gathered to compute them."""

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
START = """
import os
os.environ["XLA_FLAGS"] = "--xla_force_host_platform_device_count=4"
os.environ["JAX_PLATFORMS"] = "cpu"
import jax, jax.numpy as jnp, numpy as np
import softjax as sj
from jax.sharding import AxisType, NamedSharding, PartitionSpec
sj.enable_x64()
jax.config.update("jax_disable_most_optimizations", True)
pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
law = sj.WaltonBraun(pair, 1e6, 2e6, 60.0)

def mesh_of(shape, kind="Auto"):
    names = ("row", "column")[:len(shape)]
    return jax.make_mesh(shape, names, axis_types=(getattr(AxisType, kind),) * len(shape))

def spread(values, mesh):
    return jax.device_put(values, NamedSharding(mesh, PartitionSpec(*mesh.axis_names)))

def stays(leaf, like):
    assert leaf.sharding.is_equivalent_to(like.sharding, like.ndim), (leaf.shape, leaf.sharding)

def compiled(f, *args, summed=True):
    program = jax.jit(f).lower(*args).compile()
    moves = ["all-gather", "all-to-all", "collective-permute", "all-reduce"][: 4 - summed]
    assert not [word for word in moves if word in program.as_text()]
    return program(*args)

def everything(velocity):
    hit = sj.restitution(law, velocity)
    return hit, hit.duration
"""


def run(code, limit=300):
    command = [sys.executable, "-W", "error", "-c", START + textwrap.dedent(code)]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, check=False, timeout=limit
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_values_and_slopes_stay_where_their_impacts_are():
    """Traced and not; also what the result keeps of law and velocity; the law's slope is one sum."""
    run("""
    alone = np.append(0.0, np.geomspace(0.01, 400.0, 255))
    velocity = spread(alone, mesh_of((4,)))
    expected, expected_time = everything(alone)
    for hit, time in (everything(velocity), compiled(everything, velocity)):
        for leaf in (hit.velocity, hit.coefficient, hit.plastic_coefficient, hit.peak_overlap,
                     hit.residual_overlap, hit.status, hit.ok, time):
            stays(leaf, velocity)
        assert np.allclose(hit.coefficient, expected.coefficient, rtol=1e-13, atol=1e-15)
        assert np.array_equal(hit.status, expected.status)
        assert np.allclose(time, expected_time, rtol=1e-12, atol=0)
    for leaf in jax.tree.leaves(hit.law):  # of the traced one, where every number is repeated
        stays(leaf, velocity)

    total = lambda law, velocity: sj.restitution(law, velocity).coefficient.sum()
    by_law, slope = jax.jit(jax.grad(total, (0, 1)))(law, alone)
    both = jax.grad(total, (0, 1))
    for found, slopes in (both(law, velocity), compiled(both, law, velocity, summed=True)):
        stays(slopes, velocity)
        assert np.allclose(slopes, slope, rtol=1e-9, atol=1e-13)
        assert np.isclose(found.unloading_stiffness, by_law.unloading_stiffness, rtol=1e-10)
    """)


def test_large_batches_are_cut_where_their_devices_meet():
    """A traced batch in chunks: a loop over all of it would have each device fetch every part."""
    run("""
    from softjax import _batches
    _batches.PIECE, _batches.SHARED_CHUNK = 512, 512
    alone = np.linspace(0.0, 200.0, 4 * 5 * 512 + 4 * 3)  # with a last chunk that is not full
    velocity = spread(alone, mesh_of((4,)))
    value_and_slope = lambda velocity: jax.vjp(
        lambda v: sj.restitution(law, v).coefficient, velocity)[1](jnp.ones_like(velocity))
    assert "stablehlo.while" in jax.jit(value_and_slope).lower(velocity).as_text()
    result = compiled(value_and_slope, velocity)
    stays(result[0], velocity)
    few = value_and_slope(jnp.asarray(alone[-512:]))
    assert np.allclose(result[0][-512:], few[0], rtol=1e-10, atol=1e-12)
    """)


OVER_TWO_AXES = """
    mesh = mesh_of((2, 2), "{kind}")
    alone = np.linspace(1.0, 80.0, 4 * 256).reshape(4, 256)
    velocity = spread(alone, mesh)
    class Own(sj.RateIndependentLaw):
        contact: sj.Contact
        def loading_force(self, overlap):
            return 1e9 * overlap**1.5
        def unloading_force(self, overlap, peak):
            return 1e9 * overlap**2 / peak**0.5
    damped = sj.ViscoelasticHertz(pair, 1e-6)
    for one, route in {ways}:
        of = lambda velocity: sj.restitution(one, velocity, route)
        result = compiled(of, velocity, summed={summed})
        for leaf in jax.tree.leaves(result):
            stays(leaf, velocity)
        assert np.allclose(result.coefficient, of(alone).coefficient, rtol=1e-11)
        stays(of(velocity).coefficient, velocity)
"""


def test_tables_over_two_axes():
    """Rows on some devices and columns on others: where types tell, no device waits for another."""
    ways = "[(Own(pair), None)]"
    run(OVER_TWO_AXES.format(kind="Explicit", ways=ways, summed=False))


@pytest.mark.long
def test_tables_over_two_axes_by_the_ode_and_where_nothing_tells():
    """Histories too, whose samples are a further axis."""
    ways = "[(Own(pair), None), (damped, sj.ODE(steps=2))]"
    histories = """
    force = compiled(lambda v: sj.collide(damped, v, 5, sj.ODE(steps=2)).force, velocity)
    assert np.allclose(
        force, sj.collide(damped, alone, 5, sj.ODE(steps=2)).force, rtol=1e-7, atol=1e-9)
    stays(force[..., 0], velocity)
    """
    for kind, summed in (("Auto", True), ("Explicit", False)):
        run(OVER_TWO_AXES.format(kind=kind, ways=ways, summed=summed) + histories)


def test_a_law_for_each_impact_and_refusals():
    """χ̃ that lies as the velocities, or on one device; one wrong number among those here is told."""
    run("""
    growth, alone = np.linspace(10.0, 90.0, 64), np.linspace(0.0, 80.0, 64)
    of = lambda growth, velocity: sj.restitution(
        sj.WaltonBraun(pair, 1e6, 2e6, growth), velocity).coefficient
    mesh = mesh_of((4,))
    velocity, expected = spread(alone, mesh), of(growth, alone)
    for each in (growth, spread(growth, mesh)):
        stays(of(each, velocity), velocity)
        assert np.allclose(of(each, velocity), expected, rtol=1e-13)
    apart = jax.device_put(growth[:, None], NamedSharding(mesh, PartitionSpec("row")))
    table = of(apart, velocity)  # two axes that would lie along the same devices
    assert np.allclose(np.diagonal(table), expected, rtol=1e-13)
    alone[-1] = -1.0
    try:
        sj.restitution(law, spread(alone, mesh))
    except ValueError as error:
        assert "velocity" in str(error)
    else:
        raise AssertionError("a negative velocity was taken")
    """)


def test_a_batch_smaller_than_one_piece_of_all_devices():
    """300 000 impacts on four devices, whose pieces have 524 288, were an error of NumPy's."""
    run("""
    velocity = np.geomspace(0.01, 400.0, 300_000)
    found = sj.restitution(law, velocity).coefficient
    some = [0, 150_000, 299_999]
    stiffness = 2e6 + 60.0 * velocity[some] * np.sqrt(1e6 * pair.mass)
    assert np.allclose(np.asarray(found)[some], np.sqrt(1e6 / stiffness), rtol=1e-12)
    """)
