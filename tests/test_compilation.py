"""Repeated calls with the same shapes compile once; nothing computes a NaN on the way."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from calibration.speed.own_law import own_scene
from softjax._dependence import moving
from tests.cases import fitted, pair


@pytest.fixture(scope="module", autouse=True)
def nothing_is_compiled_yet():
    """Whatever other tests did in this process before."""
    jax.clear_caches()


@pytest.fixture
def compiled():
    """The compilations since the test began, by name."""
    names = []

    def listen(event, duration, **details):
        if event == "/jax/core/compile/backend_compile_duration":
            names.append(details.get("fun_name", "?"))

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield names
    jax.monitoring.unregister_event_duration_listener(listen)


def everything(law, velocity, route):
    result = sj.restitution(law, velocity, route=route)
    return result.coefficient, result.duration, result.ok


@pytest.mark.parametrize(
    "route",
    [
        pytest.param(None, id="energy"),
        pytest.param(sj.ODE(steps=2), id="ode"),
        pytest.param(sj.ODE(), id="default ode", marks=pytest.mark.long),
    ],
)
def test_the_same_shapes_compile_once(compiled, route):
    velocity = np.linspace(1.0, 20.0, 7)
    everything(fitted("nylon"), velocity, route)
    assert compiled
    compiled.clear()
    for chi in (0.3, 0.4, 0.5):
        # other numbers, other velocities, another material: the same shapes
        everything(fitted("nylon", chi=chi), velocity + chi, route)
        everything(sj.Zhou(pair("nylon", "zhou"), chi, 0.1, 0.6), velocity[::-1], route)
        everything(fitted("stainless steel", chi=chi), velocity, route)
    # batches are filled up to a few sizes, those of up to 16 impacts to one; `ok` compares for each
    for count in (2, 5, 16):
        everything(fitted("nylon"), np.linspace(1.0, 20.0, count), route)
    assert set(compiled) <= {"jit(equal)", "jit(bitwise_or)"}
    compiled.clear()
    everything(fitted("nylon"), np.linspace(1.0, 20.0, 17), route)
    assert {"jit(restitution_parts)", "jit(_duration)"} <= set(
        compiled
    )  # so that the count is one that can count


def test_another_tolerance_is_no_other_program(compiled):
    """It acts all the same: the looser one errs more."""
    velocity = np.linspace(1.0, 20.0, 3)
    law = sj.ViscoelasticHertz(pair("nylon", "zhou"), 1e-5)
    found = {}
    for rtol in (1e-11, 1e-3, 1e-5):
        found[rtol] = everything(law, velocity, sj.ODE(rtol=rtol))
        before = len(compiled)
        compiled.clear()
        assert before > 0 if len(found) == 1 else before == 0
    exact = sj.restitution(law, velocity).coefficient
    errors = [np.max(np.abs(found[rtol][0] - exact)) for rtol in (1e-11, 1e-5, 1e-3)]
    assert errors[0] < 1e-10 < errors[1] < errors[2] < 1e-2


@pytest.mark.long
def test_histories_compile_once(compiled):
    velocity = np.array([1.0, 4.0])
    sj.collide(fitted("nylon"), velocity, samples=11).time.block_until_ready()
    compiled.clear()
    sj.collide(fitted("nylon", chi=0.4), 2 * velocity, samples=11).time.block_until_ready()
    assert compiled == []


def test_a_first_history_compiles_little_else(compiled):
    sj.collide(fitted("nylon"), np.linspace(0.1, 3.0, 5), samples=13).time.block_until_ready()
    large = [name for name in compiled if name == "jit(_collide)"]
    assert len(large) == 1
    assert len(compiled) <= 4


def test_what_acts_on_unloading_alone_moves_no_loading():
    def asked(law, y):
        return law.loading(y), law.end(), y

    law = fitted("nylon").reduced()
    leaves, structure = jax.tree.flatten((law, jnp.asarray(2.0)))
    found = moving(lambda *leaves: asked(*jax.tree.unflatten(structure, leaves)), *leaves)
    assert found == [True, False, True]  # d, X and y


def test_what_no_force_says_anything_of_is_not_differentiated():
    """Of a law in SI: its mass, yield strength and limit velocity carry no tangent through a solve."""
    law = own_scene().law_of(2e-4, 2e11, 1e-3)
    law = jax.tree.map(jnp.asarray, law)
    forces = lambda law: law.impacts(jnp.asarray(1.0)).law.law  # noqa: E731
    _, moved = jax.jvp(forces, (law,), (jax.tree.map(jnp.ones_like, law),))
    named = {"youngs_modulus": 1, "radius": 1, "mass": 0, "yield_strength": 0, "limit_velocity": 0}
    assert {name: getattr(moved.contact, name) for name in named} == named
    assert moved.length == 1


def test_derivatives_under_the_callers_jit_compile_once(compiled):
    slope = jax.jit(jax.grad(lambda law, v: sj.restitution(law, v).coefficient.sum()))
    velocity = jnp.linspace(0.0, 20.0, 7)
    faster = velocity + 1
    slope(fitted("nylon"), velocity)
    compiled.clear()
    slope(fitted("nylon", chi=0.4), faster)
    assert compiled == []


@pytest.mark.parametrize(
    ("form", "route"),
    [
        pytest.param("first-order", None, id="first-order", marks=pytest.mark.long),
        pytest.param("full", None, id="full", marks=pytest.mark.long),
        pytest.param("first-order", sj.ODE(), id="ode"),
    ],
)
def test_no_nan_is_made_and_hidden(form, route):
    """A core of everything once more while JAX looks into what each compiled function gives."""
    law = fitted("nylon", form)
    ratios = jnp.array([0.0, 1e-30, 0.5, 1.0, 1.0 + 1e-15, 1.001, 3.0, 40.0, 300.0, 2e3])
    velocity = ratios * law.contact.critical_velocity

    def total(law, velocity):
        return sj.restitution(law, velocity, route=route).coefficient.sum()

    with jax.debug_nans(True):
        result = sj.restitution(law, velocity, route=route)
        assert np.all(np.isfinite(result.coefficient))
        assert np.all(np.isfinite(result.duration))
        slopes = jax.grad(total, (0, 1))(law, velocity)
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))


def test_debugging_for_nans_would_find_one():
    with jax.debug_nans(True), pytest.raises(FloatingPointError):
        jnp.log(jnp.array(-1.0)).block_until_ready()
