"""Methods of the user's law that return no numbers, or that JAX cannot trace: one line with what is accepted."""

import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from calibration import LAWS
from tests.cases import fitted, pair

PAIR = pair("nylon")


class Line(sj.RateIndependentLaw):
    contact: sj.Contact

    def loading_force(self, overlap):
        return 1e6 * overlap

    def unloading_force(self, overlap, peak_overlap):
        return 0.8e6 * overlap


class Damped(sj.RateDependentLaw):
    contact: sj.Contact
    end = "zero-force"

    def force(self, overlap, velocity):
        return 1e6 * overlap + velocity


class Hard(sj.HardSphereLaw):
    def restitution_squared(self, velocity):
        return 0.5


BASES = {
    "loading_force": Line,
    "unloading_force": Line,
    "breakpoints": Line,
    "elastic_overlap": Line,
    "residual_overlap": Line,
    "force": Damped,
    "closed_form": Damped,
    "restitution_squared": Hard,
}
FORCES = ("loading_force", "unloading_force", "force", "restitution_squared")
NUMBER, OVERLAPS = "a number for each impact", "a tuple of numbers for each impact"
KNOWN = "a KnownCollision of numbers for each impact"
ANSWERS = {  # what is returned in place of numbers, and how the line describes it
    "list": (lambda x: [x], "a list"),
    "tuple": (lambda x: (x,), "("),
    "None": (lambda x: None, "None"),
    "text": (lambda x: "1", "a str"),
    "vector": (lambda x: jnp.ones((3, *x.shape)), "an array of shape (3"),
    "complex": (lambda x: 1j * x, "complex"),
    "truth value": (lambda x: x > 0, "bool"),
}
UNTRACEABLE = {
    "math.exp": lambda x: math.exp(x),
    "if": lambda x: x if x > 0 else 0 * x,
    "range": lambda x: sum(x for _ in range(x)),
    "mask": lambda x: x[x > 0],
}
OTHERS = {
    "breakpoints of a number": ("breakpoints", lambda: 1e-6, OVERLAPS, "a float"),
    "breakpoints of an array": ("breakpoints", lambda: jnp.asarray(1.0), OVERLAPS, "shape ()"),
    "breakpoints of None": ("breakpoints", lambda: None, OVERLAPS, "None"),
    "breakpoints of text": ("breakpoints", lambda: ["a"], OVERLAPS, "(a str)"),
    "elastic None": ("elastic_overlap", lambda: None, NUMBER, "None"),
    "residual list": ("residual_overlap", lambda peak: [peak], NUMBER, "a list"),
    "closed None": ("closed_form", lambda v: None, KNOWN, "None"),
    "closed tuple": ("closed_form", lambda v: (v, v, v, v), KNOWN, "(an array"),
    "closed part": ("closed_form", lambda v: sj.KnownCollision(v, None, v, v), KNOWN, ", None"),
}


def refused(method, function, velocity, route=None):
    base = BASES[method]
    changed = type("Own", (base,), {method: lambda self, *values: function(*values)})
    law = changed() if base is Hard else changed(PAIR)
    with pytest.raises(ValueError, match=rf"^`Own.{method}` must") as caught:
        sj.restitution(law, velocity, route)
    line = str(caught.value)
    assert "\n" not in line
    return line


@pytest.mark.parametrize("method", FORCES)
@pytest.mark.parametrize("answer", ANSWERS)
def test_a_force_that_is_no_number(method, answer):
    """A list was a shape of JAX's, None "not a valid value for jnp.array", complex numbers an answer."""
    function, described = ANSWERS[answer]
    line = refused(method, lambda x, *_: function(x), 1.0)
    expected, found = line.split(", but returns ")
    assert expected == f"`Own.{method}` must return {NUMBER}"
    assert described in found


@pytest.mark.parametrize("method", FORCES)
@pytest.mark.parametrize("what", UNTRACEABLE)
def test_a_force_that_cannot_be_traced(method, what):
    """`if` in a law of hard spheres was "the truth value of an array is ambiguous"."""
    velocity = (1.0, 2.0) if method == "restitution_squared" else 1.0
    line = refused(method, lambda x, *_: UNTRACEABLE[what](x), velocity)
    assert line.startswith(f"`Own.{method}` must be written with jax.numpy")
    assert "jnp.exp in place of math.exp" in line
    assert "jnp.where in place of `if`" in line


@pytest.mark.parametrize("method", ["elastic_overlap", "breakpoints", "closed_form"])
def test_a_number_of_the_law_that_decides_cannot_be_traced(method):
    def chosen(law, *velocity):
        return (1e-7,) if law.contact.radius > 1 else ()

    law = type("Own", (BASES[method],), {method: chosen})(PAIR)
    with pytest.raises(ValueError, match=rf"^`Own.{method}` must be written with jax.n") as caught:
        jax.jit(sj.restitution)(law, 1.0)
    assert isinstance(caught.value.__cause__, TypeError)  # JAX's own, which knows the line


@pytest.mark.parametrize("what", OTHERS)
def test_what_else_a_law_states(what):
    method, function, accepted, described = OTHERS[what]
    expected, found = refused(method, function, 1.0).split(", but returns ")
    assert expected == f"`Own.{method}` must return {accepted}"
    assert described in found


def unanswered(*_):
    raise ZeroDivisionError


@pytest.mark.parametrize("route", [sj.EnergyBalance(), sj.ODE()], ids=["energy", "time"])
def test_a_laws_formula_is_ten_frames_away(route, monkeypatch):
    """Whoever follows an error in a force passes ten functions of softjax: the built-in law is one, and one sets
    how precisions go together."""
    zhou = fitted("nylon")
    monkeypatch.setattr(type(zhou.reduced()), "peak", unanswered)
    laws = [type("Own", (Line,), {f: unanswered})(PAIR) for f in FORCES[:2]]
    laws += [type("Own", (Damped,), {"force": unanswered})(PAIR)] if route == sj.ODE() else [zhou]
    for law in laws:
        with pytest.raises(ZeroDivisionError) as caught:
            sj.restitution(law, [1.0] * 3300, route)  # as many as no other test has compiled
        inside = [e for e in caught.traceback if Path(sj.__file__).parent in Path(e.path).parents]
        assert len(inside) + (law is zhou) <= 10


def test_the_same_by_time():
    refused("unloading_force", lambda *_: None, 1.0, sj.ODE())
    assert "jnp.where" in refused("force", lambda x, u: math.exp(x), 1.0, sj.ODE())


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_librarys_laws_are_final(law):
    """Their formulas hold for their own forces alone."""
    base = law.__base__.__name__
    line = f"`Own` must derive from {base}, but derives from {law.__name__}, which is final"
    with pytest.raises(ValueError, match=line):
        type("Own", (law,), {})
    assert type("Other", (getattr(sj, base),), {}).__name__ == "Other"


@pytest.mark.parametrize("force", ["loading_force", "unloading_force", "force"])
def test_a_law_is_given_once(force):
    """By a reduced form or by forces: of two one would be left out in silence."""
    base = sj.RateDependentLaw if force == "force" else sj.RateIndependentLaw
    reduced = type("Reduced", (base,), {"reduced": lambda self: None})
    with pytest.raises(ValueError, match=f"`Own` must define either reduced or .* and {force}"):
        type("Own", (reduced,), {force: lambda self, *values: 0.0})


def test_kinks_may_be_any_collection_of_overlaps():
    """A spring k up to c = 50 µm, 9k beyond, where k c²/2 + k c s + 9k s²/2 = M v²/2; an array is traced alone."""

    def loading(law, overlap):
        return 1e6 * (overlap + 8 * jnp.maximum(overlap - 5e-5, 0.0))

    forces = {"loading_force": loading, "unloading_force": lambda law, x, _: 0.8 * loading(law, x)}
    kinks = (lambda law: jnp.asarray([5e-5]), lambda law: (x for x in [5e-5]))
    array, generator = (type("Own", (Line,), forces | {"breakpoints": k})(PAIR) for k in kinks)
    assert jax.eval_shape(sj.restitution, array, 1.0).coefficient.shape == ()
    found = sj.restitution(generator, 1.0)
    energy = float(PAIR.mass) / 2 - 1e6 * 5e-5**2 / 2
    beyond = (-50 + math.sqrt(50**2 + 2 * 9e6 * energy)) / 9e6
    assert float(found.peak_overlap) == pytest.approx(5e-5 + beyond, rel=1e-12)
    assert float(found.coefficient) == pytest.approx(math.sqrt(0.8), rel=1e-12)


class Bumper(Line):
    radius: float


def test_a_field_named_like_one_of_the_contact_hides_no_shape():
    """(2,) radii of the contact against three velocities; it was an error of NumPy's."""
    spheres = sj.Contact(1e9, np.array([0.01, 0.02]), 0.03, 4e7, 300.0)
    with pytest.raises(ValueError, match=r"^shapes must broadcast .*`contact.radius` \(2,\)"):
        sj.restitution(Bumper(spheres, 0.1), [0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match=r"^shapes must broadcast .*`contact.radius` \(2,\)"):
        Bumper(spheres, np.ones(3))
    traced = jax.eval_shape(lambda v: sj.restitution(Bumper(spheres, 0.1), v), np.ones(2))
    assert traced.coefficient.shape == (2,)


def test_the_force_that_is_to_be_rewritten_is_named_though_another_one_calls_it():
    forces = {
        "loading_force": lambda law, overlap: 1e6 * math.sqrt(overlap),
        "unloading_force": lambda law, overlap, peak: (
            law.loading_force(peak) - 2e6 * (peak - overlap)
        ),
    }
    line = r"^`Rooted\.loading_force` must be written with jax.numpy"
    with pytest.raises(ValueError, match=line):
        sj.restitution(type("Rooted", (Line,), forces)(PAIR), 1.0)
