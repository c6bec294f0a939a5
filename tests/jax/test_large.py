"""Large batches are what small ones are: in pieces, over devices, in any order and precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted

COUNT = 150_001  # with a last piece that is not full, whatever a piece is
FIELDS = ("coefficient", "plastic_coefficient", "peak_overlap", "residual_overlap", "status")
SMALL = 5000
PARTS = (slice(0, SMALL), slice(65_000, 65_000 + SMALL), slice(COUNT - SMALL, COUNT))


def impacts():
    """Velocities from rest to beyond the last turning point, in no order, and χ̃ of each impact."""
    draw = np.random.default_rng(1)
    return np.append(0.0, draw.uniform(0, 400, COUNT - 1)), draw.uniform(0.1, 0.5, COUNT)


def alike(some, others):
    """But for the last digits of ε², a difference of numbers near one, which other code rounds otherwise."""
    one, other = np.square(some), np.square(others)
    return np.max(np.abs(one - other)) <= 5e-15 * np.max(other)


def test_pieces_are_as_small_batches_in_any_order():
    """Beginning, middle and end; in another order each is with others, and not a bit changes."""
    velocity, chi = impacts()
    law = lambda some: fitted("nylon", chi=some)  # noqa: E731
    whole = sj.restitution(law(chi), velocity)
    for part in PARTS:
        alone = sj.restitution(law(chi[part]), velocity[part])
        for name in FIELDS:
            assert alike(getattr(whole, name)[part], getattr(alone, name)), name
    order = np.random.default_rng(2).permutation(COUNT)
    other = sj.restitution(law(chi[order]), velocity[order])
    for name in FIELDS:
        assert np.array_equal(getattr(whole, name)[order], getattr(other, name)), name


def test_overlaps_can_be_left_out():
    velocity, _ = impacts()
    law = sj.WaltonBraun(fitted("nylon").contact, 1e6, 2e6, 10.0)
    for some in (velocity, velocity[:100]):
        whole, less = sj.restitution(law, some), sj.restitution(law, some, overlaps=False)
        assert less.peak_overlap is None
        assert less.residual_overlap is None
        assert alike(less.coefficient, whole.coefficient)
        assert np.array_equal(less.status, whole.status)


@pytest.mark.parametrize("of", [lambda f: f, lambda f: lambda v: jax.grad(lambda v: f(v).sum())(v)])
def test_vmap_is_cut_as_an_array_is(of):
    """Impacts of a `vmap` were computed in one pass each operation: five times the time at 10⁶."""
    law = fitted("nylon")
    velocity = np.linspace(1.0, 50.0, 2**18)

    def one(v):
        return sj.restitution(law, v).coefficient

    def loops(f, velocity):
        return str(jax.make_jaxpr(of(f))(velocity)).count("scan[")

    assert loops(one, velocity) == loops(jax.vmap(one), velocity) > 0
    square = velocity.reshape(512, 512)
    assert loops(one, square) == loops(jax.vmap(jax.vmap(one)), square)


def exact(law, velocity):
    """Walton and Braun's ε by hand."""
    force = velocity * np.sqrt(law.loading_stiffness * law.contact.mass)
    stiffer = law.unloading_stiffness + law.growth * force
    return np.sqrt(law.loading_stiffness / stiffer)


def test_shape_and_precision_are_those_of_the_caller():
    """float32 and back within one process, 64 bits switched off and on again."""
    law = sj.WaltonBraun(fitted("nylon").contact, 1e6, 2e6, 10.0)
    velocity = np.linspace(0.1, 5, 4 * (COUNT // 4)).reshape(4, -1)
    with jax.enable_x64(False):
        short = sj.restitution(law, velocity).coefficient
        with jax.enable_x64(True):
            full = sj.restitution(law, velocity).coefficient
    again = sj.restitution(law, velocity).coefficient
    low = sj.restitution(jax.tree.map(np.float32, law), np.float32(velocity)).coefficient
    for found, dtype in ((short, np.float32), (full, float), (again, float), (low, np.float32)):
        assert found.dtype == dtype
        assert found.shape == velocity.shape
        assert np.allclose(found, exact(law, velocity), rtol=4 * np.finfo(dtype).eps, atol=0)


def test_derivatives_of_a_traced_batch():
    """In chunks, the last filled up: the fill must not count. By hand, of each impact's own number too."""
    law = sj.WaltonBraun(fitted("nylon").contact, 1e6, 2e6, 10.0)
    velocity = np.linspace(0.1, 5, COUNT)

    def total(growth, velocity):
        moved = sj.WaltonBraun(law.contact, 1e6, 2e6, growth)
        return sj.restitution(moved, velocity).coefficient.sum()

    force = velocity * np.sqrt(1e6 * law.contact.mass)
    steep = -0.5 * exact(law, velocity) * force / (2e6 + 10.0 * force)
    one, along = jax.jit(jax.grad(total, (0, 1)))(10.0, jnp.asarray(velocity))
    assert one == pytest.approx(np.sum(steep), rel=1e-11)
    assert np.allclose(along * velocity, steep * 10.0, rtol=1e-11, atol=0)
    each = jax.jit(jax.grad(total))(jnp.full(COUNT, 10.0), velocity)
    assert np.allclose(each, steep, rtol=1e-11, atol=0)


class Spring(sj.HardSphereLaw):
    """ε² = a b: two numbers, as many as a law and a route."""

    a: float
    b: float

    def restitution_squared(self, velocity):
        return self.a * self.b + 0 * velocity


def test_a_large_traced_batch_of_a_law_of_two_numbers():
    """In chunks: what is the law's was once taken for a pair of others."""
    velocity = jnp.linspace(0.1, 5, 300_000)
    of = jax.jit(lambda law, v: sj.restitution(law, v).coefficient)
    assert np.allclose(of(Spring(0.5, 0.5), velocity), 0.5, rtol=1e-15)
    each = of(Spring(np.full(300_000, 0.5), 0.5), velocity)
    assert np.allclose(each, 0.5, rtol=1e-15)
