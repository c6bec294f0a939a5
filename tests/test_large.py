"""Large batches: in pieces over cores and devices, they are what small batches are."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from softjax import _pieces
from softjax._batches import SOON
from softjax._pieces import PIECE
from tests.cases import fitted

COUNT = 2 * PIECE + 12_345  # with a last piece that is not full
FIELDS = ("coefficient", "plastic_coefficient", "peak_overlap", "residual_overlap", "status")
# beyond what is compiled another, sooner way
SMALL = SOON + 904
PARTS = (slice(0, SMALL), slice(PIECE - 500, PIECE - 500 + SMALL), slice(COUNT - SMALL, COUNT))


def impacts():
    """Velocities from rest to beyond the last turning point, in no order, and χ̃ of each impact."""
    draw = np.random.default_rng(1)
    return np.append(0.0, draw.uniform(0, 400, COUNT - 1)), draw.uniform(0.1, 0.5, COUNT)


@pytest.mark.parametrize(
    "each",
    [
        pytest.param(False, id="one law", marks=pytest.mark.long),
        pytest.param(True, id="a law each"),
    ],
)
def test_pieces_are_as_small_batches(each):
    velocity, chi = impacts()
    whole = sj.restitution(fitted("nylon", chi=chi if each else 0.22), velocity)
    for part in PARTS:
        law = fitted("nylon", chi=chi[part] if each else 0.22)
        alone = sj.restitution(law, velocity[part])
        for name in FIELDS:
            assert same(getattr(whole, name)[part], getattr(alone, name)), name
    assert whole.duration.shape == (COUNT,)
    last = sj.restitution(fitted("nylon", chi=chi[-1000:] if each else 0.22), velocity[-1000:])
    assert same(whole.duration[-1000:], last.duration)


def same(some, others):
    """But for the last digits, which other compiled code rounds otherwise.

    Of the squares: ε² is a difference of numbers near one.
    """
    one, other = np.square(some), np.square(others)
    return np.max(np.abs(one - other)) <= 5e-15 * np.max(other)


def test_no_impact_depends_on_its_neighbours():
    """In another order each is with others, of which some take more steps: not a bit changes."""
    velocity, chi = impacts()
    order = np.random.default_rng(2).permutation(COUNT)
    one = sj.restitution(fitted("nylon", chi=chi), velocity)
    other = sj.restitution(fitted("nylon", chi=chi[order]), velocity[order])
    for name in FIELDS:
        assert np.array_equal(getattr(one, name)[order], getattr(other, name)), name


def test_overlaps_can_be_left_out():
    velocity, _ = impacts()
    whole = sj.restitution(fitted("nylon"), velocity)
    for some in (velocity, velocity[:100]):
        less = sj.restitution(fitted("nylon"), some, overlaps=False)
        assert less.peak_overlap is None
        assert less.residual_overlap is None
        assert same(less.coefficient, whole.coefficient[: len(some)])
        assert np.array_equal(less.status, whole.status[: len(some)])


def test_shape_and_precision_stay():
    velocity = np.float32(impacts()[0][: 4 * (COUNT // 4)].reshape(4, -1))
    law = jax.tree.map(np.float32, fitted("nylon"))
    whole = sj.restitution(law, velocity)
    assert whole.coefficient.shape == velocity.shape
    assert whole.coefficient.dtype == np.float32
    assert np.array_equal(whole.status[3, -9:], sj.restitution(law, velocity[3, -9:]).status)


def total(chi, velocity):
    return sj.restitution(fitted("nylon", chi=chi), velocity).coefficient.sum()


@pytest.mark.long
def test_derivatives_of_a_traced_batch():
    """In chunks, the last filled up: the fill must not count."""
    velocity, _ = impacts()
    slope = jax.jit(jax.grad(total, (0, 1)))
    one, each = slope(0.22, jnp.asarray(velocity))
    parts = [slope(0.22, jnp.asarray(part)) for part in np.array_split(velocity, 4)]
    assert one == pytest.approx(float(sum(part[0] for part in parts)), rel=1e-12)
    assert np.allclose(each, np.concatenate([part[1] for part in parts]), rtol=1e-12, atol=1e-15)


@pytest.mark.long
def test_derivatives_by_a_law_of_each_impact():
    velocity, chi = impacts()
    slope = jax.jit(jax.grad(total))(jnp.asarray(chi), velocity)
    assert slope.shape == chi.shape
    for part in PARTS:
        alone = jax.grad(total)(jnp.asarray(chi[part]), velocity[part])
        assert np.allclose(slope[part], alone, rtol=1e-12, atol=1e-15)
        assert np.any(alone != 0)


ON_TWO = """
import jax, numpy as np, softjax as sj
from softjax import _pieces
sj.enable_x64()
assert len(jax.local_devices()) == 2
pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
law = sj.Zhou(pair, 0.22, 0.4355, 0.5414)
velocity = np.linspace(0, 200, 2 * _pieces.PIECE + 777)
whole = sj.restitution(law, velocity).coefficient
for start in range(0, len(velocity), 100_000):
    part = slice(start, start + 100_000)
    alone = sj.restitution(law, velocity[part]).coefficient
    assert np.allclose(whole[part], alone, rtol=0, atol=1e-13)
(program,) = _pieces._programs.values()
(space,) = program.spare
assert all(len(part.sharding.device_set) == 2 for part in space.results)
"""


def test_two_devices_share_the_work():
    command = [sys.executable, "-W", "error", "-c", ON_TWO]
    flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2", "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(command, env=flags, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_pieces_have_the_precision_of_their_caller():
    """Which another thread does not know of; memory of one precision is not used for another."""
    law = sj.WaltonBraun(fitted("nylon").contact, 1e6, 2e6, 10.0)
    velocity = np.linspace(0.1, 5, COUNT)
    exact = np.sqrt(1e6 / (2e6 + 10.0 * velocity * np.sqrt(1e6 * law.contact.mass)))
    jax.config.update("jax_enable_x64", False)
    try:
        short = sj.restitution(law, velocity).coefficient
        with jax.enable_x64(True):
            full = sj.restitution(law, velocity).coefficient
    finally:
        jax.config.update("jax_enable_x64", True)
    again = sj.restitution(law, velocity).coefficient
    for found, dtype in ((short, np.float32), (full, np.float64), (again, np.float64)):
        assert found.dtype == dtype
        assert np.allclose(found, exact, rtol=4 * np.finfo(dtype).eps, atol=0)


def test_few_programs_are_kept(monkeypatch):
    made = []
    monkeypatch.setattr(_pieces, "_programs", {})
    monkeypatch.setattr(_pieces, "KEPT", 2)
    monkeypatch.setattr(_pieces, "_compile", lambda *_: made.append(object()) or made[-1])
    a, b = (_pieces._program(None, key, [], []) for key in "ab")
    assert _pieces._program(None, "a", [], []) is a
    _pieces._program(None, "c", [], [])
    assert _pieces._program(None, "a", [], []) is a
    assert _pieces._program(None, "b", [], []) is not b
    assert len(_pieces._programs) == 2
