"""Several devices, threads, other processes, a thousand calls: in processes of their own."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import equinox as eqx
import jax
import pytest

import softjax as sj
from softjax._pieces import FOR_ONE_THREAD
from softjax.compiler import QUICK, accepted
from tests.cases import pair

ROOT = Path(__file__).parents[1]
START = """
import os
os.environ["XLA_FLAGS"] = "--xla_force_host_platform_device_count=2"
import jax, jax.numpy as jnp, numpy as np
import softjax as sj
sj.enable_x64()
steel = sj.STAINLESS_STEEL
pair = sj.Contact.between_spheres(steel, steel, 0.0127, 0.0127)
law = sj.Zhou(pair, 1.7944, 3.0432, 0.54)
velocity = np.array([0.1, 0.2, 1.0, 2.0])
"""


def run(code):
    whole = START + textwrap.dedent(code)
    command = [sys.executable, "-W", "error", "-c", whole]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_two_devices():
    """Results stay where their input was put; `shard_map` follows the energy balance, not diffrax."""
    run("""
    first, second = jax.devices()
    here = jax.device_put(velocity, second)
    result = sj.restitution(law, here)
    for leaf in (result.coefficient, result.status, result.duration):
        assert leaf.device == second, leaf.device
    alone = sj.restitution(law, velocity).coefficient
    assert np.array_equal(np.asarray(result.coefficient), np.asarray(alone))
    from jax.sharding import Mesh, NamedSharding, PartitionSpec
    mesh, each = Mesh(np.array([first, second]), ("impacts",)), PartitionSpec("impacts")
    spread = jax.device_put(velocity, NamedSharding(mesh, each))
    assert np.allclose(sj.restitution(law, spread).coefficient, alone, rtol=1e-14)
    def of(velocity): return sj.restitution(law, velocity).coefficient
    mapped = jax.jit(jax.shard_map(of, mesh=mesh, in_specs=each, out_specs=each))
    assert np.allclose(mapped(jnp.asarray(velocity)), alone, rtol=1e-14)
    damped = sj.HertzDashpot(pair, 0.9)
    def by_time(velocity): return sj.restitution(damped, velocity, sj.ODE(steps=2)).coefficient
    told = False
    try:
        jax.jit(jax.shard_map(by_time, mesh=mesh, in_specs=each, out_specs=each))(velocity)
    except ValueError as error:
        told = "check_vma=False" in str(error)
    assert told
    unchecked = jax.shard_map(by_time, mesh=mesh, in_specs=each, out_specs=each, check_vma=False)
    assert np.allclose(jax.jit(unchecked)(velocity), by_time(velocity), rtol=1e-12)
    """)


@pytest.mark.long
def test_threads_and_a_thousand_calls():
    """The same from eight threads at once; and memory does not grow with calls of many sizes."""
    run("""
    from concurrent.futures import ThreadPoolExecutor
    import resource
    alone = np.asarray(sj.restitution(law, velocity).coefficient)
    with ThreadPoolExecutor(8) as pool:
        many = list(pool.map(lambda _: np.asarray(sj.restitution(law, velocity).coefficient), range(64)))
    assert all(np.array_equal(one, alone) for one in many)

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
    command = [sys.executable, str(script)]
    known = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=known)
    assert done.returncode == 0, done.stderr[-2000:]


def test_compiler_options_that_are_refused():
    """They are XLA's own: a compiler that knows them no more is asked without."""
    assert accepted((("xla_no_such_option", "1"),)) == {}
    assert accepted(FOR_ONE_THREAD) == dict(FOR_ONE_THREAD)
    if jax.__version_info__ < (0, 11):  # later ones may have no older way to make code
        assert accepted(QUICK) == dict(QUICK)


@pytest.mark.long
def test_reverse_over_reverse_by_the_ode():
    law = sj.Zhou(pair("stainless steel"), 1.7944, 3.0432, 0.54)
    twice = jax.grad(jax.grad(lambda v: sj.restitution(law, v, sj.ODE(steps=2)).coefficient))
    exact = jax.grad(jax.grad(lambda v: sj.restitution(law, v).coefficient))(1.0)
    assert twice(1.0) == pytest.approx(float(exact), rel=1e-2)


def test_a_text_in_the_place_of_a_number():
    law = sj.Zhou(pair("stainless steel"), 1.7944, 3.0432, 0.54)
    broken = eqx.tree_at(lambda law: law.chi, law, "hard")
    with pytest.raises(ValueError, match=r"`chi` must be an unloading factor .* but is 'hard'"):
        sj.restitution(broken, 1.0)
