"""Routes of the user's that cannot be called, or that return something else than collisions."""

import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import pair

LAW = sj.WaltonBraun(pair("nylon"), 1e6, 2e6)


def collision(velocity, **parts):
    zero = jnp.zeros_like(velocity)
    usual = {"energy": zero + 0.5, "peak": zero + 1e-6, "residual": zero}
    return sj.Collision(**usual | {"flags": zero.astype(jnp.int32)} | parts)


class Own(sj.AbstractRoute):
    name = "own"

    def refusal(self, law):
        return None

    def collide(self, law, velocity, *, clock=False, force=False):
        return collision(velocity)


def refused(answer, output="coefficient"):
    route = type("Own", (Own,), {"collide": lambda self, law, v, *, clock, force: answer(v)})()
    with pytest.raises(ValueError, match=r"^`Own.collide` must return ") as caught:
        getattr(sj.restitution(LAW, [1.0, 2.0], route), output)
    line = str(caught.value)
    assert "\n" not in line
    return line.removeprefix("`Own.collide` must return ").split(", but returns ")


def test_a_route_without_the_keywords_of_requests():
    """It was "unexpected keyword argument 'clock'" of the middle of the package."""
    route = type("Own", (Own,), {"collide": lambda self, law, velocity: collision(velocity)})()
    with pytest.raises(
        ValueError, match=r"^`Own.collide` must take \(self, law, velocity, \*, clo"
    ):
        sj.restitution(LAW, 1.0, route)
    takes_all = type("Own", (Own,), {"collide": lambda self, law, v, **requested: collision(v)})()
    assert float(sj.restitution(LAW, 1.0, takes_all).coefficient) == pytest.approx(0.5**0.5)


@pytest.mark.parametrize(
    ("answer", "found"),
    [(lambda v: None, "None"), (lambda v: v, "an array of shape (16,)"), (tuple, "(an array")],
)
def test_no_collision(answer, found):
    accepted, described = refused(answer)
    assert (accepted, described[: len(found)]) == ("an sj.Collision", found)


@pytest.mark.parametrize("part", ["energy", "peak", "residual"])
@pytest.mark.parametrize(
    ("value", "found"),
    [(None, "None"), ("1", "a str"), (jnp.ones(7), "(7,)"), (1j * np.ones(16), "complex")],
)
def test_parts_that_are_no_numbers(part, value, found):
    """Of complex energies ε was complex, with a status of 0."""
    accepted, described = refused(lambda v: collision(v, **{part: value}))
    assert accepted == f"a number for each impact as `{part}`"
    assert found in described


@pytest.mark.parametrize(("output", "part"), [("duration", "duration"), ("peak_force", "force")])
def test_an_output_that_was_requested_and_is_not_there(output, part):
    assert refused(collision, output) == [f"a number for each impact as `{part}`", "None"]


def test_flags_with_a_point():
    accepted, described = refused(lambda v: collision(v, flags=0.0 * v))
    assert (accepted, described[:8]) == ("whole numbers as `flags`", "an array")


def test_where_a_route_found_no_number_its_solver_failed():
    """ε was 0, the status 0."""

    class Lost(Own):
        def collide(self, law, velocity, *, clock=False, force=False):
            return collision(velocity, energy=jnp.where(velocity > 1, jnp.nan, 0.25))

    hit = sj.restitution(LAW, [1.0, 2.0], Lost())
    np.testing.assert_array_equal(hit.status, [0, int(sj.Status.SOLVER_FAILED)])
    np.testing.assert_allclose(hit.coefficient, [0.5, 0.0], rtol=1e-15)
    assert list(np.asarray(hit.ok)) == [True, False]
