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
from tests.hard.table import PRECISIONS, TABLE
from tests.oracles import zhou_mp as z
from tests.oracles.write_hard_cases import solved

ODE_TOLERANCE = {"float64": 1e-11, "float32": 1e-6}
BY_NAME = {case.name: case for case in TABLE}
# each form, precision and route once; the other combinations are long
QUICK = {("energy balance", "float64", "first-order"), ("ode", "float32", "full")}
QUICK |= {("energy balance", "float32", "full")}
GROUPS = [
    pytest.param(*group, marks=() if group in QUICK else pytest.mark.long)
    for route in ("energy balance", "ode")
    for precision in PRECISIONS
    for form in cases.FORMS
    for group in [(route, precision, form)]
]
over_groups = pytest.mark.parametrize(("route", "precision", "form"), GROUPS)


@lru_cache
def records(precision: str | None = None, form: str | None = None) -> list[dict]:
    path = Path(__file__).parents[1] / "oracles" / "hard_cases.json"
    return [
        record
        for record in json.loads(path.read_text(encoding="utf-8"))
        if precision in (None, record["precision"]) and form in (None, record["inputs"]["form"])
    ]


def inputs_of(rows: list[dict], precision: str) -> tuple:
    """The nine inputs as arrays, in the order of `z.NUMBERS`."""
    dtype = PRECISIONS[precision]
    return tuple(jnp.asarray(cases.column(rows, "inputs", name), dtype) for name in z.NUMBERS)


def squared(inputs, form, route):
    """ε², which is what can be compared near ε = 0, with ε_p² and the status."""
    E, R, M, Y, v_lim, chi, sigma, psi, v = inputs
    law = sj.Zhou(sj.Contact(E, R, M, Y, v_lim), chi, sigma, psi, form=form)
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
    by = sj.EnergyBalance() if route == "energy balance" else sj.ODE(ODE_TOLERANCE[precision])
    return [np.asarray(a) for a in everything(inputs, form, by)]


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
def test_value_status_and_both_gradients(route, precision, form):
    """All rows in one batch: neighbours of every kind, none of which touches another."""
    rows = records(precision, form)
    value, plastic, status, *gradients = computed(route, precision, form)
    allowed, allowed_slope = bounds(route, precision, rows)
    expected = np.maximum(cases.column(rows, "eps_squared"), 0)
    assert names(rows, np.abs(value - expected) <= allowed) == []
    expected = cases.column(rows, "eps_p_squared")
    assert names(rows, np.abs(plastic - expected) <= allowed) == []
    known = np.full(len(rows), -1)
    if route == "ode":  # it cannot tell a gain within its tolerance from rounding
        unknown = (expected > 1) & (expected - 1 < 3 * ODE_TOLERANCE[precision])
        assert np.sum(unknown) <= 2
        known = np.where(unknown, ~int(sj.Status.ENERGY_GAIN), -1)
    assert names(rows, status & known == cases.flags_of(rows) & known) == []
    for slopes in gradients:
        good = np.all(np.abs(slopes - slopes_of(rows)) <= allowed_slope, axis=0)
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


@pytest.mark.parametrize(
    "name",
    ["X = 1 and an ulp", pytest.param("closest below y_max, full", marks=pytest.mark.long)],
)
def test_rows_solved_again(name):
    (row,) = (r for r in records("float64") if r["name"] == name)
    assert solved(BY_NAME[name], "float64") == row


def test_rows_alone_are_as_in_the_batch():
    """Neighbours do not touch each other: of a batch that is one row again and again."""
    rows = records("float64", "first-order")
    batch = computed("energy balance", "float64", "first-order")
    inputs = inputs_of(rows, "float64")
    for k in range(0, len(rows), 7):
        same = tuple(jnp.full_like(x, x[k]) for x in inputs)
        value, _, status, _, slopes = everything(same, "first-order", sj.EnergyBalance())
        assert value[0] == pytest.approx(batch[0][k], rel=1e-14, abs=1e-15), rows[k]["name"]
        assert status[0] == batch[2][k], rows[k]["name"]
        assert np.allclose(slopes[:, 0], batch[4][:, k], rtol=1e-12, atol=1e-15), rows[k]["name"]
