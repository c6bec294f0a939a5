"""The table of hard impacts: both routes, both precisions, value, status and both gradients."""

import json
from functools import lru_cache, partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests import cases
from tests.hard_cases import TABLE
from tests.hard_inputs import PRECISIONS
from tests.oracles import zhou_mp as z
from tests.oracles.write_hard_cases import solved

ODE_TOLERANCE = {"float64": 1e-11, "float32": 1e-6}
BY_NAME = {case.name: case for case in TABLE}
# every choice once by either route, and the other combinations among the long tests
OTHERS = [("float64", "full"), ("float32", "first-order")]
LONG = [(route, *other) for route in ("energy balance", "ode") for other in OTHERS]
GROUPS = [
    pytest.param(*group, marks=[pytest.mark.long] if group in LONG else [])
    for route in ("energy balance", "ode")
    for precision in PRECISIONS
    for form in cases.FORMS
    for group in [(route, precision, form)]
]
over_groups = pytest.mark.parametrize(("route", "precision", "form"), GROUPS)


@lru_cache
def records(precision: str | None = None, form: str | None = None) -> list[dict]:
    path = Path(__file__).parent / "oracles" / "hard_cases.json"
    return [
        record
        for record in json.loads(path.read_text(encoding="utf-8"))
        if precision in (None, record["precision"]) and form in (None, record["inputs"]["form"])
    ]


def route_of(name: str, precision: str):
    return sj.EnergyBalance() if name == "energy balance" else sj.ODE(ODE_TOLERANCE[precision])


def inputs_of(rows: list[dict], precision: str) -> tuple:
    """The nine inputs as arrays, in the order of `z.NUMBERS`."""
    dtype = PRECISIONS[precision]
    return tuple(jnp.asarray(cases.column(rows, "inputs", name), dtype) for name in z.NUMBERS)


def law_and_velocity(inputs, form):
    E, R, M, Y, v_lim, chi, sigma, psi, v = inputs
    return sj.Zhou(sj.Contact(E, R, M, Y, v_lim), chi, sigma, psi, form=form), v


def squared(inputs, form, route):
    """ε², which is what can be compared near ε = 0, with ε_p² and the status."""
    law, v = law_and_velocity(inputs, form)
    result = sj.restitution(law, v, route)
    return result.coefficient**2, (result.plastic_coefficient**2, result.status)


@partial(cases.compiled_soon, static_argnums=(1, 2))
def everything(inputs, form, route):
    """ε², ε_p², status, and θ ∂ε²/∂θ forward and in reverse."""

    def push(i):
        change = tuple(jnp.where(i == j, x, 0 * x) for j, x in enumerate(inputs))
        return jax.jvp(lambda x: squared(x, form, route)[0], (inputs,), (change,))[1]

    value, pull, (plastic, status) = jax.vjp(
        lambda x: squared(x, form, route), inputs, has_aux=True
    )
    (slopes,) = pull(jnp.ones_like(value))
    pulled = jnp.stack([x * s for x, s in zip(inputs, slopes, strict=True)])
    return value, plastic, status, jax.lax.map(push, jnp.arange(len(inputs))), pulled


@lru_cache
def computed(route: str, precision: str, form: str):
    """The same of all rows in one batch."""
    inputs = inputs_of(records(precision, form), precision)
    return [np.asarray(a) for a in everything(inputs, form, route_of(route, precision))]


def bounds(route: str, precision: str, rows: list[dict]):
    """What ε² may be off: 1e-12 + 8 eps Σ|∂ε²/∂ln θ|; its slopes: likewise; the ODE's tolerance.

    In float32 the 1e-12 becomes 8 eps, since ε² itself rounds at eps/2.
    """
    eps = float(np.finfo(PRECISIONS[precision]).eps)
    tolerance = ODE_TOLERANCE[precision] if route == "ode" else 0.0
    value = max(1e-12, 8 * eps) + (8 * eps + tolerance) * cases.column(rows, "sensitivity")
    curvatures = np.array([cases.column(rows, "curvatures", name) for name in z.NUMBERS])
    spread = np.abs(slopes_of(rows)) + curvatures
    more = np.array([BY_NAME[row["name"]].ode for row in rows])
    added = tolerance * (20 * (1 + curvatures) + more)
    return value + tolerance, max(1e-12, 32 * eps) + 8 * eps * spread + added


def slopes_of(rows: list[dict]) -> np.ndarray:
    """θ ∂ε²/∂θ, 0 where ε is clipped to 0."""
    alive = cases.column(rows, "eps_squared") > 0
    return np.where(alive, [cases.column(rows, "slopes", name) for name in z.NUMBERS], 0.0)


def names(rows: list[dict], holds) -> list[str]:
    return [row["name"] for row, good in zip(rows, holds, strict=True) if not good]


@over_groups
def test_value(route, precision, form):
    rows = records(precision, form)
    value, plastic, *_ = computed(route, precision, form)
    allowed, _ = bounds(route, precision, rows)
    expected = np.maximum(cases.column(rows, "eps_squared"), 0)
    assert names(rows, np.abs(value - expected) <= allowed) == []
    expected = cases.column(rows, "eps_p_squared")
    assert names(rows, np.abs(plastic - expected) <= allowed) == []


@over_groups
def test_status(route, precision, form):
    rows = records(precision, form)
    status, expected = computed(route, precision, form)[2], cases.flags_of(rows)
    if route == "ode":  # it cannot tell a gain within its tolerance from rounding
        gained = cases.column(rows, "eps_p_squared") - 1
        unknown = (gained > 0) & (gained < 3 * ODE_TOLERANCE[precision])
        assert np.sum(unknown) <= 2
        mask = np.where(unknown, ~int(sj.Status.ENERGY_GAIN), -1)
        status, expected = status & mask, expected & mask
    assert names(rows, status == expected) == []


@over_groups
@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_gradient(route, precision, form, mode):
    rows = records(precision, form)
    slopes = computed(route, precision, form)[3 if mode == "forward" else 4]
    _, allowed = bounds(route, precision, rows)
    good = np.all(np.abs(slopes - slopes_of(rows)) <= allowed, axis=0)
    assert names(rows, good) == []


def test_the_table_is_what_was_solved():
    """Names, inputs and flags; a row is left out of float32 with a reason and not otherwise."""
    solved_rows = {(r["name"], r["precision"]): r for r in records()}
    wanted = {(case.name, "float64") for case in TABLE}
    wanted |= {(case.name, "float32") for case in TABLE if case.float32 is None}
    assert set(solved_rows) == wanted
    assert len(BY_NAME) == len(TABLE)
    for (name, precision), row in solved_rows.items():
        case = BY_NAME[name]
        assert case.reason
        assert row["inputs"] == case.rounded(precision), name
        assert row["flags"] == sorted(case.flags), name


LIVE = ("v one ulp above v_cr", "X = 1 and an ulp", "ε² = 1e-13", "closest below y_max, full")


@pytest.mark.parametrize("name", LIVE)
def test_rows_solved_again(name):
    (row,) = (r for r in records("float64") if r["name"] == name)
    assert solved(BY_NAME[name], "float64") == row


def test_rows_alone_are_as_in_the_batch():
    """A mixed batch, one compilation for all: neighbours do not touch each other."""
    rows = records("float64", "first-order")
    batch = computed("energy balance", "float64", "first-order")
    for k in range(0, len(rows), 7):
        inputs = tuple(x[k : k + 1] for x in inputs_of(rows, "float64"))
        value, (_, status) = squared(inputs, "first-order", None)
        assert value[0] == pytest.approx(batch[0][k], rel=1e-14, abs=1e-15), rows[k]["name"]
        assert status[0] == batch[2][k], rows[k]["name"]


INVALID = {
    "velocity": (np.nan, -1.0, np.inf, -np.inf),
    "contact": (np.nan, -1.0, 0.0, np.inf),
}


@pytest.mark.parametrize("route", [sj.EnergyBalance(), sj.ODE(steps=4)], ids=lambda r: r.name)
def test_invalid_input_touches_no_neighbour(route):
    """Each of the nine inputs bad in one place of a batch, under jit."""
    good = cases.fitted("nylon")
    leaves, structure = jax.tree.flatten((good, 5 * good.contact.critical_velocity))
    size = 4 * len(leaves) + 1
    batch = np.tile(np.array(leaves)[:, None], size)
    for k in range(len(leaves)):
        kind = "velocity" if k == len(leaves) - 1 else "contact"
        batch[k, 4 * k : 4 * k + 4] = INVALID[kind]
    # χ̃ = 0 and σ = 0 are no mistakes
    batch[batch == 0] = np.nan

    @cases.compiled_soon
    def value_and_gradient(batch):
        def total(batch):
            law, v = jax.tree.unflatten(structure, list(batch))
            result = sj.restitution(law, v, route)
            return result.coefficient.sum(), result

        (_, result), slopes = jax.value_and_grad(total, has_aux=True)(batch)
        return result, slopes

    result, slopes = value_and_gradient(jnp.asarray(batch))
    assert np.all(result.status[:-1] == sj.Status.INVALID_INPUT)
    assert np.all(result.coefficient[:-1] == 0)
    assert np.all(np.asarray(slopes)[:, :-1] == 0)
    alone, slopes_alone = value_and_gradient(jnp.asarray(np.tile(batch[:, -1:], size)))
    assert result.coefficient[-1] == alone.coefficient[-1] > 0
    assert np.array_equal(slopes[:, -1], slopes_alone[:, -1])


@pytest.mark.parametrize("shape", [(0,), (3, 0)])
@pytest.mark.parametrize("route", [sj.EnergyBalance(), sj.ODE(steps=4)], ids=lambda r: r.name)
def test_empty_batches(shape, route):
    result = sj.restitution(cases.fitted("nylon"), np.zeros(shape), route)
    fields = (result.coefficient, result.plastic_coefficient, result.peak_overlap, result.status)
    assert all(field.shape == shape for field in fields)
    assert result.duration.shape == result.residual_overlap.shape == result.ok.shape == shape
    slopes = jax.grad(lambda v: sj.restitution(cases.fitted("nylon"), v, route).coefficient.sum())
    assert slopes(np.zeros(shape)).shape == shape


@pytest.mark.parametrize(
    "velocity", [2, 2.0, np.int32(2), np.float64(2.0), np.array(2), jnp.array(2), jnp.array(2.0)]
)
def test_kinds_of_numbers(velocity):
    """Integers and floats of Python, NumPy and JAX mean the same, traced ones in float64 too."""
    law = cases.fitted("nylon")
    expected = float(sj.restitution(law, np.array([2.0])).coefficient[0])
    for value in (
        sj.restitution(law, velocity).coefficient,
        jax.jit(lambda v: sj.restitution(law, v).coefficient)(velocity),
    ):
        assert value.dtype == np.float64
        assert value.shape == ()
        assert float(value) == pytest.approx(expected, rel=1e-15)
    assert sj.restitution(law, [velocity, 2]).coefficient.shape == (2,)
