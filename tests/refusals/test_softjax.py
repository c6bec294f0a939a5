"""Input of `softjax` that makes no sense: one line that names the argument, its value, what is accepted.

Under tracing values cannot be looked at: there a status says the same (`derivatives/test_derivatives.py`).
"""

import math
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import RADIUS, fitted, pair
from tests.laws import LAWS

PAIR, LAW = pair("nylon"), fitted("nylon")
BODY = sj.Material(1.93e11, 0.35, 8030.0, 3e8)
TWO, THREE = np.ones(2), np.ones(3)


def call(function, **given):
    """A call that makes sense, of which one argument is changed."""
    return lambda **changed: function(**(given | changed))


MADE = {
    "Material": sj.NYLON,
    "Contact": PAIR,
    "Zhou": LAW,
    "Thornton": sj.Thornton(PAIR),
    "WaltonBraun": sj.WaltonBraun(PAIR, 1e6, 2e6),
    "Linear": sj.LinearSpringDashpot(PAIR, 1e6, 0.5),
    "HertzDashpot": sj.HertzDashpot(PAIR, 0.5),
    "Viscoelastic": sj.ViscoelasticHertz(PAIR, 1e-6),
    "Hertz": sj.Hertz(PAIR),
    "Constant": sj.ConstantRestitution(PAIR, 0.9),
    "Eq. 17": sj.EmpiricalRestitution(340.0, 1.0, 1.0),
}
SPHERES = {"material_1": BODY, "material_2": BODY, "radius_1": RADIUS, "radius_2": RADIUS}
CALLS = {name: partial(replace, example) for name, example in MADE.items()} | {
    "spheres": call(sj.Contact.between_spheres, **SPHERES),
    "wall": call(sj.Contact.with_wall, material=BODY, wall=BODY, radius=RADIUS),
    "empirical": call(sj.empirical_restitution, velocity=1.0, limit_velocity=340.0, sigma=3, psi=1),
    "thornton": call(sj.thornton_restitution, contact=PAIR, velocity=1.0, yield_factor=1.0),
    "restitution": call(sj.restitution, law=LAW, velocity=1.0),
    "signed": call(sj.signed_restitution, law=LAW, velocity=1.0),
    "collide": call(sj.collide, law=LAW, velocity=1.0),
    "ODE": sj.ODE,
    "TimeODE": sj.TimeODE,
}
NEGATIVE = [-1.0, -1e-300, np.array([1.0, -1.0])]
NOT_NUMBERS = [math.nan, math.inf, -math.inf, "1.0", None, {}, 1 + 2j, True, object]
NOT_NUMBERS += [[[1.0], [1.0, 2.0]], np.array(["a"]), jnp.array([1.0, jnp.nan])]
NOT_NUMBERS += [np.ma.array([1.0, 2.0], mask=[True, False])]
WORDS = ["", None, 1]
# what is given for something else
VALUES = {
    "number": NOT_NUMBERS,
    "positive": [0, 0.0, *NEGATIVE],
    "zero or more": NEGATIVE,
    "ratio": [-1.0, 0.500001, np.array([0.3, 0.6])],
    "share": [0.0, -1.0, 1.01],
    "restitution": [-0.1, 1.1, np.array([0.5, 2.0])],
    "one": [1.0],
    "size": [1e120, 1e-120],  # of a radius whose mass is no number
    "precision": [np.array([0.1], np.longdouble), "fast"],
    "word": [*WORDS, "First-order", ["full"]],
    "object": ["steel", 1.0, sj.ODE, np.array([1.0, 2.0])],
    "contact": [1.0, "steel"],
    "contact or none": [1.0, "steel", None],
    "law": [LAW],
    "nothing": [None],
    "area": ["zhou", None, 1],
    "end": ["zero", None, 0],
    "route": [sj.EnergyBalance(), "ode", 1],
    "samples": [2, 0, -1, 2.0, "5", None, True],
    "tolerance": [0.0, -1e-6, 1.0, 1e-15, math.nan, "1e-6", [1e-6]],
    "count": [0, -1, 2.0, 2.5, "2", True],
    "solver": [*WORDS, "First", ["dopri8"]],
}
# call and argument, what is given, what is accepted
LINES = Path(__file__).with_name("arguments.txt").read_text(encoding="utf-8").splitlines()
ROWS = [[part.strip() for part in line.split(" |")] for line in LINES]


@pytest.mark.parametrize(("place", "given", "accepted"), ROWS)
def test_what_is_refused(place, given, accepted):
    name, argument = place.rsplit(" ", 1)
    for value in [value for kind in given.split(", ") for value in VALUES[kind]]:
        with pytest.raises(ValueError, match=f"`{argument}`") as caught:
            CALLS[name](**{argument: value})
        message = str(caught.value)
        shown = " ".join(repr(value).split())
        assert (shown if len(shown) <= 80 else shown[:77]) in message, message
        assert accepted in message, message
        assert "\n" not in message


VISCOELASTIC, HARD, EQ_17 = (MADE[name] for name in ("Viscoelastic", "Constant", "Eq. 17"))
TWO_CHI = replace(LAW, chi=TWO)
UNFIT = {  # words of the line
    "broadcast|`yield_strength` (3,)": lambda: replace(BODY, density=TWO, yield_strength=THREE),
    "broadcast|`radius` (2,), `mass` (3,)": lambda: replace(PAIR, radius=TWO, mass=THREE),
    "broadcast|_1` (2,), `radius_2` (3,)": lambda: CALLS["spheres"](radius_1=TWO, radius_2=THREE),
    "broadcast|`material.density` (2,)": lambda: CALLS["wall"](
        material=replace(BODY, density=TWO), radius=THREE
    ),
    "broadcast|`chi` (2,), `sigma` (3,)": lambda: replace(TWO_CHI, sigma=THREE),
    "broadcast|`velocity` (3,), `chi` (2,)": lambda: sj.restitution(TWO_CHI, THREE),
    "`route` must be ClosedForm() or ODE(...) for Visc": lambda: sj.restitution(
        VISCOELASTIC, 1.0, sj.EnergyBalance()
    ),
    "`route` must be EnergyBalance()|, but is ODE": lambda: sj.restitution(HARD, 1.0, sj.ODE()),
    "a law with a force": lambda: sj.collide(HARD, 1.0),
    "EmpiricalRestitution is one of hard spheres": lambda: sj.collide(EQ_17, 1.0),
    "`rtol` would be ignored": lambda: sj.ODE(rtol=1e-6, steps=2),
    "`chi` must be an unloading factor|but is 'hard'": lambda: sj.restitution(
        eqx.tree_at(lambda law: law.chi, LAW, "hard"), 1.0
    ),
    "`form` must be": lambda: jax.jit(lambda chi: replace(LAW, chi=chi, form="both").chi)(0.2),
    "`velocity` must be a finite impact velocity": lambda: jax.jit(
        lambda v: sj.restitution(LAW, [[v], [v, v]]).coefficient
    )(1.0),
}


@pytest.mark.parametrize("words", UNFIT)
def test_calls_that_do_not_fit(words):
    with pytest.raises(ValueError, match=re.escape(words.split("|")[0])) as caught:
        UNFIT[words]()
    assert all(part in str(caught.value) for part in words.split("|"))
    assert "\n" not in str(caught.value)


def test_ends_of_ranges_are_accepted_and_stored_as_floats():
    assert CALLS["Material"](poisson_ratio=0.5).poisson_ratio == 0.5
    assert CALLS["Material"](poisson_ratio=-0.99).poisson_ratio == -0.99
    assert sj.restitution(CALLS["Zhou"](chi=0, sigma=0), 0).coefficient == 1
    assert [float(CALLS["Constant"](restitution=e).restitution) for e in (0, 1)] == [0, 1]
    assert CALLS["Linear"](restitution=1).restitution == 1
    assert sj.restitution(LAW, np.ma.array([0.1, 0.2], mask=False)).coefficient.shape == (2,)
    assert sj.restitution(LAW, np.longdouble(0.1)).coefficient.dtype == np.float64
    material = sj.Material(2, [0.1, 0.2], np.float32(3), (4, 5))
    assert isinstance(material.youngs_modulus, float)
    assert np.array_equal(material.poisson_ratio, [0.1, 0.2])
    assert material.yield_strength.dtype.kind == "f"
    assert list(LAWS["zhou"].law.contact.leaves())[:2] == ["youngs_modulus", "radius"]


@pytest.mark.parametrize(
    ("name", "argument"),
    [("empirical", "velocity"), ("empirical", "sigma"), ("thornton", "velocity")],
)
def test_formulas_give_zero_under_jit(name, argument):
    some = jnp.array([1.0, -1.0, jnp.nan, jnp.inf])
    formula = jax.vmap(jax.value_and_grad(lambda x: CALLS[name](**{argument: x})))
    found, slopes = jax.jit(formula)(some)
    assert found[0] > 0
    assert np.all(np.isfinite(slopes))
    assert np.all(np.array([found, slopes])[:, 1:] == 0)


# what a law's fields declare


def law_of(*words, within):
    class Law(sj.HardSphereLaw):
        value: float = sj.number_field(*words, within=within)

        def restitution_squared(self, velocity):
            return 0 * velocity

    return Law


@pytest.mark.parametrize(
    ("within", "inside", "outside", "accepted"),
    [
        ("(0, inf)", [1e-300, 5.0], [0.0, -1.0], "a positive length in m"),
        ("[0, inf)", [0.0, 5.0], [-1e-300], "a length in m of zero or more"),
        ("(-1, 0.5]", [-0.999, 0.5], [-1.0, 0.500001], "a length in m in (-1, 0.5]"),
        ("(-inf, inf)", [-1e300, 0.0], [np.nan, np.inf], "a finite length in m"),
    ],
)
def test_ranges_that_fields_declare(within, inside, outside, accepted):
    law = law_of("x", "m", "length", within=within)
    status = jax.jit(lambda v: sj.restitution(law(v), 1.0).status)
    for value in inside:
        assert law(value).is_valid()
        assert status(value) != sj.Status.INVALID_INPUT
    for value in outside:
        with pytest.raises(ValueError, match="`value` must be " + re.escape(accepted)):
            law(value)
        assert status(value) == sj.Status.INVALID_INPUT


def test_a_pure_number_is_refused_without_a_unit_and_so_is_a_range_that_is_none():
    for unit in ("-", "1", ""):
        with pytest.raises(ValueError, match=r"^`value` must be a positive share, but is -1"):
            law_of("q", unit, "share", within="(0, inf)")(-1.0)
    for within in ("0..1", "[a, b]", "(0)", ""):
        with pytest.raises(ValueError, match="`within` must be a range such as"):
            sj.number_field("x", within=within)


class Declared(sj.HardSphereLaw):
    """One field of each kind."""

    share: float = sj.number_field("q", "-", "share", within="[0, 1)")
    time: float = sj.number_field("τ", "s", "time", within="(0, inf)", default=1.0)
    knots: jax.Array = sj.array_field(default=None)
    end: str = sj.choice_field("near", "far")

    def restitution_squared(self, velocity):
        return self.share + 0 * velocity


def test_what_is_shared_by_all_impacts_must_be_finite_and_keeps_its_whole_numbers():
    given = np.array([1, 0])
    law = Declared(np.full(3, 0.5), knots={"w": jnp.ones((7, 2)), "n": 3, "at": given, "of": "any"})
    given[:] = 7
    assert np.all(law.is_valid())
    assert type(law.knots["n"]) is int
    assert list(law.knots["at"]) == [1, 0]
    assert law.knots["at"].dtype == given.dtype
    for numbers in (3, [1, 2], np.array([1, 2])):  # where no name says that they are counts
        leaves = jax.tree.leaves(Declared(0.5, knots=numbers).knots)
        assert all(np.issubdtype(np.result_type(leaf), np.floating) for leaf in leaves)
    bad = jnp.array([1.0, np.nan])
    with pytest.raises(ValueError, match="`knots` must be finite numbers, but is Array"):
        Declared(0.5, knots=bad)
    found = jax.jit(lambda k: sj.restitution(Declared(0.5, knots=k), 1.0).status)(bad)
    assert found == sj.Status.INVALID_INPUT
    with pytest.raises(ValueError, match=r"`share` \(3,\), `time` \(2,\)"):
        Declared(np.full(3, 0.5), np.ones(2))
    with pytest.raises(ValueError, match="`end` must be 'near' or 'far'"):
        Declared(0.5, end="beside")
