"""Arrays spread over devices stay where they are; threads, spawned processes, a thousand calls."""

import os
import subprocess
import sys
import textwrap

import pytest

from tests.jax.processes import ROOT, run

SPREAD = """
from jax.sharding import AxisType, NamedSharding, PartitionSpec
jax.config.update("jax_disable_most_optimizations", True)
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


def spread(code):
    return run(SPREAD + textwrap.dedent(code), devices=4)


def test_values_and_slopes_stay_where_their_impacts_are():
    """Traced and not; also what the result keeps of law and velocity; the law's slope is one sum."""
    spread("""
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

    total = lambda law, velocity: sj.restitution(law, velocity).coefficient.sum()
    by_law, slope = jax.jit(jax.grad(total, (0, 1)))(law, alone)
    both = jax.grad(total, (0, 1))
    for found, slopes in (both(law, velocity), compiled(both, law, velocity, summed=True)):
        stays(slopes, velocity)
        assert np.allclose(slopes, slope, rtol=1e-9, atol=1e-13)
        assert np.isclose(found.unloading_stiffness, by_law.unloading_stiffness, rtol=1e-10)

    # a number for each impact, where its velocity is or on one device; one wrong one is refused
    growth = np.linspace(10.0, 90.0, 256)
    of = lambda growth: sj.restitution(sj.WaltonBraun(pair, 1e6, 2e6, growth), velocity).coefficient
    each = sj.restitution(sj.WaltonBraun(pair, 1e6, 2e6, growth), alone).coefficient
    for some in (growth, spread(growth, mesh_of((4,)))):
        stays(of(some), velocity)
        assert np.allclose(of(some), each, rtol=1e-13)
    alone[-1] = -1.0
    try:
        sj.restitution(law, spread(alone, mesh_of((4,))))
    except ValueError as error:
        assert "velocity" in str(error)
    else:
        raise AssertionError("a negative velocity was taken")
    """)


def test_large_batches_are_not_gathered():
    """The derivative of half a million spread impacts moves nothing from one device to another."""
    spread("""
    alone = np.linspace(0.0, 200.0, 4 * 131_075)
    velocity = spread(alone, mesh_of((4,)))
    value_and_slope = lambda velocity: jax.vjp(
        lambda v: sj.restitution(law, v).coefficient, velocity)[1](jnp.ones_like(velocity))
    (result,) = compiled(value_and_slope, velocity)
    stays(result, velocity)
    (few,) = value_and_slope(jnp.asarray(alone[-512:]))
    assert np.allclose(result[-512:], few, rtol=1e-10, atol=1e-12)
    """)


def test_a_batch_smaller_than_one_piece_of_all_devices():
    """300 000 impacts that nobody has spread, on four devices."""
    spread("""
    velocity = np.geomspace(0.01, 400.0, 300_000)
    found = sj.restitution(law, velocity).coefficient
    some = [0, 150_000, 299_999]
    stiffness = 2e6 + 60.0 * velocity[some] * np.sqrt(1e6 * pair.mass)
    assert np.allclose(np.asarray(found)[some], np.sqrt(1e6 / stiffness), rtol=1e-12)
    """)


TABLES = """
class Own(sj.RateIndependentLaw):
    contact: sj.Contact
    def loading_force(self, overlap):
        return 1e9 * overlap**1.5
    def unloading_force(self, overlap, peak):
        return 1e9 * overlap**2 / peak**0.5

alone = np.linspace(1.0, 80.0, 4 * 256).reshape(4, 256)
damped = sj.ViscoelasticHertz(pair, 1e-6)
for kind, summed in {kinds}:
    velocity = spread(alone, mesh_of((2, 2), kind))
    for one, route in {ways}:
        of = lambda velocity: sj.restitution(one, velocity, route)
        result = compiled(of, velocity, summed=summed)
        for leaf in (result.coefficient, result.peak_overlap, result.residual_overlap, result.status):
            stays(leaf, velocity)
        assert np.allclose(result.coefficient, of(alone).coefficient, rtol=1e-11)
        stays(of(velocity).coefficient, velocity)
"""


def test_tables_over_two_axes():
    """Rows on some devices and columns on others."""
    spread(TABLES.format(kinds="[('Auto', True)]", ways="[(Own(pair), None)]"))


@pytest.mark.long
def test_tables_over_two_axes_by_the_ode():
    """Histories too, whose samples are a further axis."""
    kinds = "[('Auto', True)]"
    ways = "[(Own(pair), None), (damped, sj.ODE(steps=2))]"
    histories = """
    force = compiled(lambda v: sj.collide(damped, v, 5, sj.ODE(steps=2)).force, velocity)
    expected = sj.collide(damped, alone, 5, sj.ODE(steps=2)).force
    assert np.allclose(force, expected, rtol=1e-7, atol=1e-9)
    stays(force[..., 0], velocity)
"""
    run(SPREAD + TABLES.format(kinds=kinds, ways=ways) + histories, devices=4)


def test_shard_map_and_a_device_that_is_chosen():
    """Results stay where their input was put; `shard_map` follows the energy balance, not diffrax."""
    run("""
    law = sj.Zhou(pair, 0.22, 0.4355, 0.5414)
    first, second = jax.devices()
    result = sj.restitution(law, jax.device_put(velocity, second))
    for leaf in (result.coefficient, result.status, result.duration):
        assert leaf.device == second, leaf.device
    alone = sj.restitution(law, velocity).coefficient
    assert np.array_equal(np.asarray(result.coefficient), np.asarray(alone))
    from jax.sharding import Mesh, NamedSharding, PartitionSpec
    mesh, each = Mesh(np.array([first, second]), ("impacts",)), PartitionSpec("impacts")
    def of(velocity): return sj.restitution(law, velocity).coefficient
    mapped = jax.jit(jax.shard_map(of, mesh=mesh, in_specs=each, out_specs=each))
    assert np.allclose(mapped(jnp.asarray(velocity)), alone, rtol=1e-14)
    damped = sj.HertzDashpot(pair, 0.9)
    def by_time(velocity): return sj.restitution(damped, velocity, sj.ODE(steps=2)).coefficient
    refused = False
    try:
        jax.jit(jax.shard_map(by_time, mesh=mesh, in_specs=each, out_specs=each))(velocity)
    except ValueError as error:
        refused = "check_vma=False" in str(error)
    assert refused
    unchecked = jax.shard_map(by_time, mesh=mesh, in_specs=each, out_specs=each, check_vma=False)
    assert np.allclose(jax.jit(unchecked)(velocity), by_time(velocity), rtol=1e-12)
    """)


@pytest.mark.long
def test_threads_and_a_thousand_calls():
    """The same from eight threads at once; and memory does not grow with calls of many sizes."""
    run("""
    from concurrent.futures import ThreadPoolExecutor
    import resource
    law = sj.Zhou(pair, 0.22, 0.4355, 0.5414)
    alone = np.asarray(sj.restitution(law, velocity).coefficient)
    of = lambda _: np.asarray(sj.restitution(law, velocity).coefficient)
    with ThreadPoolExecutor(8) as pool:
        assert all(np.array_equal(one, alone) for one in pool.map(of, range(64)))

    def calls(sizes):
        for n in sizes:
            sj.restitution(law, np.linspace(0.01, 2.0, n)).coefficient.block_until_ready()

    def memory():
        return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() / 2**20

    rng = np.random.default_rng(0)
    calls(range(1, 257, 3))
    before = memory()
    calls(rng.integers(1, 256, 1000))
    assert memory() - before < 20, memory() - before  # MB; programs are shared between sizes
    """)


SPAWNED = """
import multiprocessing
import softjax as sj

def rebound(velocity):
    sj.enable_x64()
    steel = sj.STAINLESS_STEEL
    pair = sj.Contact.between_spheres(steel, steel, 0.0127, 0.0127)
    return float(sj.restitution(sj.Hertz(pair), velocity).peak_overlap)

if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(rebound, [1.0])[0] == rebound(1.0)
"""


def test_spawned_processes(tmp_path):
    """A process forked after JAX was used is not supported by JAX itself."""
    script = tmp_path / "spawned.py"
    script.write_text(SPAWNED, encoding="utf-8")
    known = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(script)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=known)
    assert done.returncode == 0, done.stderr[-2000:]
