"""What fields declare of themselves, and what follows from it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from softjax import fields
from tests.cases import pair


class Declared(sj.HardSphereLaw):
    """One field of each kind."""

    share: float = sj.number_field("q", "-", "share", within="[0, 1)")
    time: float = sj.number_field("τ", "s", "time", within="(0, inf)", default=1.0)
    offset: float = 0.0
    knots: jax.Array = sj.array_field(default=None)
    end: str = sj.choice_field("near", "far")

    def restitution_squared(self, velocity):
        return self.share + 0 * velocity


@pytest.mark.parametrize(
    ("within", "inside", "outside", "accepted"),
    [
        ("(0, inf)", [1e-300, 5.0], [0.0, -1.0], "a positive length in m"),
        ("[0, inf)", [0.0, 5.0], [-1e-300], "a length in m of zero or more"),
        ("(-1, 0.5]", [-0.999, 0.5], [-1.0, 0.500001], "a length in m in (-1, 0.5]"),
        ("(-inf, inf)", [-1e300, 0.0], [np.nan, np.inf], "a finite length in m"),
    ],
)
def test_ranges(within, inside, outside, accepted):
    class Law(sj.HardSphereLaw):
        value: float = sj.number_field("x", "m", "length", within=within)

        def restitution_squared(self, velocity):
            return 0 * velocity

    for value in inside:
        assert Law(value).is_valid()
    for value in outside:
        with pytest.raises(ValueError, match="`value` must be") as caught:
            Law(value)
        assert accepted in str(caught.value)
        assert not jax.jit(lambda v: Law(v).is_valid())(value)


def test_declarations_are_read_off_the_class():
    found = fields.declarations(Declared)
    assert list(found) == ["share", "time", "offset"]
    assert (found["time"].symbol, found["time"].unit, found["time"].lower) == ("τ", "s", 0)
    assert found["offset"].symbol == "offset"
    assert fields.options_of(Declared) == {"end": ("near", "far")}
    assert fields.whole_fields(Declared) == ("knots",)
    assert list(fields.declarations(sj.Zhou)) == ["chi", "sigma", "psi"]
    assert next(iter(fields.declarations(sj.Contact))) == "youngs_modulus"


def test_what_is_whole_need_not_broadcast_but_must_be_finite():
    law = Declared(np.full(3, 0.5), knots={"w": jnp.ones((7, 2)), "name": "any"})
    assert np.all(law.is_valid())
    bad = jnp.array([1.0, np.nan])
    with pytest.raises(ValueError, match="`knots` must be finite numbers, but is Array"):
        Declared(np.full(3, 0.5), knots=bad)
    assert not jax.jit(lambda k: Declared(0.5, knots=k).is_valid())(bad)
    with pytest.raises(ValueError, match=r"`share` \(3,\), `time` \(2,\)"):
        Declared(np.full(3, 0.5), np.ones(2))


def test_below_a_name_whole_numbers_stay_such():
    """Counts and indices; what has none becomes floating point, as ever."""
    given = np.array([1, 0])
    law = Declared(0.5, knots={"n": 3, "at": given, "w": 2.0, "of": "any"})
    given[:] = 7
    assert type(law.knots["n"]) is int
    assert list(law.knots["at"]) == [1, 0]
    assert law.knots["at"].dtype == given.dtype
    for numbers in (3, [1, 2], np.array([1, 2]), [[1, 2], [3, 4]]):
        leaves = jax.tree.leaves(Declared(0.5, knots=numbers).knots)
        assert all(np.issubdtype(np.result_type(leaf), np.floating) for leaf in leaves)


@pytest.mark.parametrize("within", ["0..1", "[a, b]", "(0)", ""])
def test_a_range_that_is_none(within):
    with pytest.raises(ValueError, match="`within` must be a range such as"):
        sj.number_field("x", within=within)


def test_an_article_suits_its_noun():
    with pytest.raises(ValueError, match="`chi` must be an unloading factor of zero or more"):
        sj.Zhou(pair("nylon"), -1.0, 1.0, 1.0)
