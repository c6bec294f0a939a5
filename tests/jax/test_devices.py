"""Arrays spread over devices stay where they are; spawned processes, threads, a thousand calls.

Devices are counted when JAX starts: what needs four of them runs in a pytest of its own, of this file.
"""

import os
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

import softjax as sj
from tests.cases import fitted, pair

ROOT = Path(__file__).parents[2]
DEVICES = 4
SPREAD = os.environ.get("SOFTJAX_TEST_DEVICES") == str(DEVICES)
with_devices = pytest.mark.skipif(not SPREAD, reason="where there are four devices")
PAIR = pair("nylon")
LAW = sj.WaltonBraun(PAIR, 1e6, 2e6, 60.0)


def run(*words):
    here = {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu", "SOFTJAX_TEST_DEVICES": str(DEVICES)}
    here["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={DEVICES}"
    command = [sys.executable, "-W", "error", *words]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | here, cwd=ROOT, check=False
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    return done.stdout


@pytest.mark.skipif(SPREAD, reason="runs the others")
def test_with_four_devices():
    words = ["-n", "0", "-p", "no:cacheprovider", "-k", "test_devices_"]
    out = run("-m", "pytest", __file__, *words)
    assert "6 passed" in out, out


if SPREAD:
    jax.config.update("jax_disable_most_optimizations", True)  # where arrays are is all that counts


def spread(values, *shape):
    shape = shape or (DEVICES,)
    names = ("row", "column")[: len(shape)]
    mesh = jax.make_mesh(shape, names, axis_types=(AxisType.Auto,) * len(shape))
    return jax.device_put(values, NamedSharding(mesh, PartitionSpec(*mesh.axis_names)))


def stays(leaf, like):
    assert leaf.sharding.is_equivalent_to(like.sharding, like.ndim), (leaf.shape, leaf.sharding)


def compiled(f, *args, summed=True):
    """What a program gives that moves nothing between devices, but for sums where they are meant."""
    program = jax.jit(f).lower(*args).compile()
    moves = ["all-gather", "all-to-all", "collective-permute", "all-reduce"][: 4 - summed]
    assert not [word for word in moves if word in program.as_text()]
    return program(*args)


def everything(velocity):
    hit = sj.restitution(LAW, velocity)
    return hit, hit.duration


@with_devices
def test_devices_keep_values_and_slopes_of_their_impacts():
    """Traced and not; also what the result keeps of law and velocity; the law's slope is one sum."""
    alone = np.append(0.0, np.geomspace(0.01, 400.0, 255))
    velocity = spread(alone)
    root = np.sqrt(1e6 * PAIR.mass)
    stiffness = 2e6 + 60.0 * alone * root
    exact = np.append(1.0, np.sqrt(1e6 / stiffness[1:]))
    exact_time = 0.5 * np.pi * np.sqrt(PAIR.mass) * (1e-3 + stiffness**-0.5) * (alone > 0)
    for hit, time in (everything(velocity), compiled(everything, velocity)):
        parts = ("velocity", "coefficient", "plastic_coefficient", "peak_overlap")
        parts += ("residual_overlap", "status", "ok")
        for leaf in (*(getattr(hit, name) for name in parts), time):
            stays(leaf, velocity)
        assert np.allclose(hit.coefficient, exact, rtol=1e-13, atol=1e-15)
        rest = int(sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY)
        assert np.array_equal(hit.status, np.where(alone > 0, 0, rest))
        assert np.allclose(time, exact_time, rtol=1e-12, atol=0)
    both = jax.grad(lambda law, v: sj.restitution(law, v).coefficient.sum(), (0, 1))
    by_stiffness = -0.5 * exact / stiffness * (alone > 0)
    for found, slopes in (both(LAW, velocity), compiled(both, LAW, velocity)):
        stays(slopes, velocity)
        assert np.allclose(slopes, by_stiffness * 60.0 * root, rtol=1e-9, atol=1e-13)
        assert np.isclose(found.unloading_stiffness, by_stiffness.sum(), rtol=1e-10)


@with_devices
def test_devices_take_a_number_for_each_impact():
    """Where its velocity is or on one device; one wrong one is refused."""
    alone, growth = np.geomspace(0.01, 400.0, 256), np.linspace(10.0, 90.0, 256)
    velocity = spread(alone)
    each = np.sqrt(1e6 / (2e6 + growth * alone * np.sqrt(1e6 * PAIR.mass)))
    for some in (growth, spread(growth)):
        found = sj.restitution(sj.WaltonBraun(PAIR, 1e6, 2e6, some), velocity).coefficient
        stays(found, velocity)
        assert np.allclose(found, each, rtol=1e-13)
    alone[-1] = -1.0
    with pytest.raises(ValueError, match="velocity"):
        sj.restitution(LAW, spread(alone))


@with_devices
def test_devices_gather_no_large_batches():
    """The derivative of half a million spread impacts moves nothing from one device to another."""
    alone = np.linspace(0.0, 200.0, 4 * 131_075)
    velocity = spread(alone)

    def slope(velocity):
        value, pull = jax.vjp(lambda v: sj.restitution(LAW, v).coefficient, velocity)
        return pull(jnp.ones_like(value))[0]

    result = compiled(slope, velocity)
    stays(result, velocity)
    force = alone * np.sqrt(1e6 * PAIR.mass)
    exact = -0.5 * np.sqrt(1e6) * 60.0 * np.sqrt(1e6 * PAIR.mass) / (2e6 + 60.0 * force) ** 1.5
    assert np.allclose(result[1:], exact[1:], rtol=1e-10, atol=1e-12)


@with_devices
def test_devices_share_a_batch_smaller_than_one_piece_of_all():
    """300 000 impacts that nobody has spread."""
    velocity = np.geomspace(0.01, 400.0, 300_000)
    stiffness = 2e6 + 60.0 * velocity * np.sqrt(1e6 * PAIR.mass)
    found = sj.restitution(LAW, velocity).coefficient
    assert np.allclose(found, np.sqrt(1e6 / stiffness), rtol=1e-12)


class Own(sj.RateIndependentLaw):
    contact: sj.Contact

    def loading_force(self, overlap):
        return 1e9 * overlap**1.5

    def unloading_force(self, overlap, peak):
        return 1e9 * overlap**2 / peak**0.5


@with_devices
def test_devices_hold_tables_by_rows_and_columns():
    """Of a law by its forces, and histories, whose samples are a further axis."""
    velocity = spread(np.linspace(1.0, 80.0, DEVICES * 64).reshape(DEVICES, 64), 2, 2)
    result = compiled(lambda v: sj.restitution(Own(PAIR), v), velocity)
    for name in ("coefficient", "peak_overlap", "residual_overlap", "status"):
        stays(getattr(result, name), velocity)
    assert np.allclose(result.coefficient, np.sqrt(5 / 6), rtol=1e-11)
    hertz = compiled(lambda v: sj.collide(sj.Hertz(PAIR), v, 5).velocity, velocity)
    assert np.allclose(hertz[..., -1], -velocity, rtol=1e-12)
    stays(hertz[..., 0], velocity)


@with_devices
def test_devices_under_shard_map_and_one_that_is_chosen():
    """Results stay where their input was put; `shard_map` follows the energy balance, not diffrax."""
    law, velocity = LAW, np.array([0.1, 0.2, 1.0, 2.0])
    second = jax.devices()[1]
    result = sj.restitution(law, jax.device_put(velocity, second))
    for leaf in (result.coefficient, result.status, result.duration):
        assert leaf.device == second
    alone = sj.restitution(law, velocity).coefficient
    assert np.array_equal(result.coefficient, alone)
    mesh, each = Mesh(np.array(jax.devices()[:2]), ("impacts",)), PartitionSpec("impacts")

    def mapped(of, **more):
        return jax.jit(jax.shard_map(of, mesh=mesh, in_specs=each, out_specs=each, **more))(
            velocity
        )

    found = mapped(lambda v: sj.restitution(law, v).coefficient)
    assert np.allclose(found, alone, rtol=1e-14)
    damped = sj.HertzDashpot(PAIR, 0.9)
    by_time = lambda v: sj.restitution(damped, v, sj.ODE(steps=2)).coefficient  # noqa: E731
    with pytest.raises(ValueError, match="check_vma=False"):
        mapped(by_time)
    assert np.allclose(mapped(by_time, check_vma=False), by_time(velocity), rtol=1e-12)


@pytest.mark.long
def test_threads_and_a_thousand_calls():
    """The same from eight threads at once; and memory does not grow with calls of many sizes."""
    law, velocity = fitted("nylon"), np.array([0.1, 0.2, 1.0, 2.0])
    of = lambda _: np.asarray(sj.restitution(law, velocity).coefficient)  # noqa: E731
    alone = of(0)
    with ThreadPoolExecutor(8) as pool:
        assert all(np.array_equal(one, alone) for one in pool.map(of, range(64)))

    def calls(sizes):
        for n in sizes:
            sj.restitution(law, np.linspace(0.01, 2.0, n)).coefficient.block_until_ready()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * resource.getpagesize() / 2**20

    before = calls(range(1, 257, 3))
    assert calls(np.random.default_rng(0).integers(1, 256, 1000)) - before < 20  # MB


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
    (tmp_path / "spawned.py").write_text(SPAWNED, encoding="utf-8")
    run(str(tmp_path / "spawned.py"))
