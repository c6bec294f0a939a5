"""Derivatives of every law, forward and reverse, and the table of hard impacts by Zhou's.

Against central differences in 40 and more digits; all as θ ∂q/∂θ. One program for each law, route and
precision serves the whole file: plain, hard and invalid impacts in batches of one size.
"""

import itertools
import json
from functools import lru_cache
from pathlib import Path

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from tests import cases, laws
from tests.cases import (
    EPS,
    FORMS,
    RADIUS,
    column,
    fitted,
    flags_of,
    mostly_long,
    of_form,
    same_flags,
)
from tests.laws import LAWS, PRECISE, SYMBOLS, graded, numbers, of_records, with_numbers

LONG = pytest.mark.long
ENERGY, IN_TIME = sj.EnergyBalance(), sj.TimeODE()

# laws

HARD = np.array([0.0, 1e-100, 1e-6, 1.0, 1e5])  # dT/dv itself overflows at 1e-300
INVALID = np.array([np.nan, -1.0, np.inf, 0.5])  # the last one by a number of the law
BY_TIME = ("viscoelastic", PRECISE)
UNTIMED = [BY_TIME, ("zhou", ENERGY), ("zhou full", ENERGY)]  # the duration is dear
OTHER_END = ("linear dashpot to zero-force", "hertz dashpot to zero-overlap")  # of each law one
CASES = [
    pytest.param(
        name,
        route,
        lasting,
        id=f"{name}-{route.name}" + "-lasting" * lasting,
        marks=[LONG]
        * (
            lasting
            if (name, route) in UNTIMED
            else route in (PRECISE, IN_TIME) or name in OTHER_END
        ),
    )
    for name, law in LAWS.items()
    for route in (*law.routes, *(IN_TIME,) * (name in laws.WITH_FORCE))
    for lasting in ((False, True) if (name, route) in UNTIMED else (True,))
]


@lru_cache
def solved(name, route, lasting):
    """What `graded` gives of the whole batch; the slopes by number: (4, impacts)."""
    case = LAWS[name]
    field, wrong = case.invalid
    values = laws.repeated(case.law, np.concatenate([case.velocity, HARD, INVALID]))
    values[field][-1] = wrong
    found, result, modes = graded(case.law, values, route, lasting=lasting)
    return found, result, [dict(zip(values, slopes, strict=True)) for slopes in modes]


@pytest.mark.parametrize(
    ("name", "route", "lasting"), [c for c in CASES if c.values[2] or "zhou" not in c.values[0]]
)
def test_first_derivatives_of_laws(name, route, lasting):
    """Of ε, both overlaps and the duration, over the size of q; Eq. (17) at v_lim, ε = 1e-29, over 1.

    In time, by events, to what its docstring states.
    """
    exact, expected = laws.expected(name)[:, :4], laws.expected_slopes(name)
    count = len(exact)
    size = np.where(exact > 0, np.abs(exact), 1.0).T
    size[0] = 1.0
    size[2] = np.maximum(size[1], 1e-300)  # an overlap left is known to rounding of the peak
    untimed = (name, route) in UNTIMED
    tolerance = 1e-9 if route == PRECISE else 1e-11 if untimed and lasting else 2e-12
    if route == IN_TIME:
        tolerance = 3e3 * route.tolerance
    values, _, modes = solved(name, route, lasting)
    each = len(values)
    assert np.all(np.abs(values[:, :count] - exact.T[:each]) <= tolerance * size[:each])
    for slopes in modes:
        assert set(slopes) == set(expected)
        for key, exact_slope in expected.items():
            found = slopes[key][:, :count]
            error = np.abs(found - exact_slope.T[:each]) / size[:each]
            assert np.all(error <= tolerance), (key, error)
            zero = np.all(exact_slope == 0, axis=0)[:each]
            assert np.all(np.abs(found[zero] / size[:each][zero]) <= 1e-13), key


@pytest.mark.parametrize(("name", "route", "lasting"), CASES)
def test_hard_and_invalid_impacts_of_laws(name, route, lasting):
    """From rest to 1e5 m/s numbers with finite slopes; at rest ε = 1; invalid ones are 0 and flagged."""
    count = len(LAWS[name].velocity)
    found, result, modes = solved(name, route, lasting)
    status = np.asarray(result.status)
    assert np.all(np.isfinite(found))
    hard = slice(count, count + len(HARD))
    gains = status[hard] & int(sj.Status.ENERGY_GAIN) > 0
    assert np.all((found[0, hard] >= 0) & ((found[0, hard] <= 1 + 2 * EPS) | gains))
    assert found[0, count] == 1
    assert same_flags(status[count], sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY)
    assert not np.any(status[hard][1:] & int(sj.Status.ZERO_VELOCITY))
    assert np.all(status[-4:] == sj.Status.INVALID_INPUT)
    assert np.all(found[:, -4:] == 0)
    lost = status & int(sj.Status.NO_TURNING_POINT) > 0
    assert np.any(lost) == ("zhou" in name)
    for slopes in modes:
        for key, slope in slopes.items():
            assert np.all(slope[1:3, lost] == 0), key  # where the law ends: a number, and no answer
            known = slope[:, :-4] if key != LAWS[name].invalid[0] else slope[:, :-5]
            assert np.all(np.isfinite(known)), key
            # times the number itself, which is no number where it is invalid
            assert np.all((slope[:, -4:] == 0) | np.isnan(slope[:, -4:])), key


BAD = dict.fromkeys(numbers(fitted("nylon")), (np.nan, -1.0, np.inf, 0.0))
BAD |= {"velocity": (np.nan, -1.0, np.inf, -np.inf), "chi": (np.nan, -1.0, np.inf, -1e-300)}
BAD["sigma"] = BAD["chi"]


def test_bad_impacts_leave_their_neighbours_alone():
    """Each of the nine numbers bad in its places of a batch: 0 without a slope; the others bit for bit."""
    law = fitted("nylon")
    count = 4 * len(BAD)
    y = np.linspace(1.5, 40, 2 * count)
    plain = laws.repeated(law, y * law.contact.critical_velocity)
    bad = {name: np.array(value) for name, value in plain.items()}
    for k, (name, values) in enumerate(BAD.items()):
        bad[name][4 * k : 4 * k + 4] = values
    with_good, with_bad = (graded(law, values) for values in (plain, bad))
    for one, two in zip(with_good[2], with_bad[2], strict=True):
        assert np.array_equal(one[..., count:], two[..., count:])
        slopes = two[..., :count]  # times the number itself, which may be none
        assert np.all((slopes == 0) | np.isnan(slopes))
        assert np.mean(slopes == 0) > 0.9
    assert np.array_equal(with_good[0][:, count:], with_bad[0][:, count:])
    assert np.all(with_bad[0][:, :count] == 0)
    result = with_bad[1]
    assert np.all(result.status[:count] == sj.Status.INVALID_INPUT)
    assert np.all(result.status[count:] == with_good[1].status[count:])
    assert not np.any(result.ok[:count])


def forward(f, has_aux=False):
    """`jax.jacfwd` by one number, without an axis for it: a program shorter by a quarter."""

    def slope(t, *others):
        _, *found = jax.jvp(lambda t: f(t, *others), (t,), (jnp.ones_like(t),), has_aux=has_aux)
        return found if has_aux else found[0]

    return slope


def _along(name):
    """A direction in the logarithms of all numbers and the velocity."""
    names = list(numbers(LAWS[name].law, 1.0))
    return dict(zip(names, np.cos(1.0 + np.arange(len(names))), strict=True))


@mostly_long("name", LAWS, ("thornton", "hertz dashpot to zero-force", "eq. 17"))
def test_second_derivatives_along_a_direction(name):
    """d²q/dt² with every number times e^{a t}: by forward over reverse, against differences."""
    case, along = LAWS[name], _along(name)

    def moved(t, v):
        at = numbers(case.law, v)
        at = {key: value * jnp.exp(along[key] * t) for key, value in at.items()}
        hit = sj.restitution(with_numbers(case.law, at), at["velocity"])
        return jnp.stack([hit.coefficient, hit.peak_overlap])

    second = jax.jit(jax.vmap(forward(jax.jacrev(moved)), (None, 0)))
    found = np.asarray(second(0.0, jnp.asarray(case.velocity)))
    with mp.workdps(60):
        step = mp.mpf("1e-12")
        for i, v in enumerate(case.velocity):
            at = {key: mp.mpf(float(x)) for key, x in numbers(case.law, float(v)).items()}
            up, here, down = (
                case.exact({k: x * mp.exp(along[k] * s) for k, x in at.items()})
                for s in (step, 0, -step)
            )
            exact = [(a - 2 * b + c) / step**2 for a, b, c in zip(up, here, down, strict=True)][:2]
            size = np.array([1.0, float(here.peak) or 1.0])
            assert np.allclose(found[i] / size, np.array(exact, float) / size, atol=1e-8), (v, i)


def test_second_derivative_where_damping_begins():
    """ε = 1 - 1.15345 w² + 0.79826 w⁴ + …: a series of w², whose root has no second derivative."""
    pair = laws.PAIR
    unit = 1.5 * (pair.stiffness / pair.mass) ** 0.4

    def restitution(b):
        return sj.restitution(sj.ViscoelasticHertz(pair, b / unit), 1.0).coefficient

    first, second = jax.jit(lambda b: jax.jvp(forward(restitution), (b,), (1.0,)))(0.0)
    assert first == pytest.approx(-1.153449, abs=1e-6)
    assert second == pytest.approx(2 * 0.798267, abs=2e-6)


# Zhou's law over the curves of three materials

OVERLAPS = ("eps", "peak_overlap", "residual_overlap")
CURVES = [(form, *by) for form in FORMS for by in ((ENERGY, 2e-12), (PRECISE, 1e-6))]


@mostly_long("form, route, bound", CURVES, CURVES[:3])
def test_first_derivatives_over_the_curves(form, route, bound):
    """ε, ε_p and both overlaps, in all nine inputs, forward and reverse; at 75 velocities of three materials."""
    records = of_form("curves", form)
    values = of_records(records)
    found, result, modes = graded(fitted("nylon", form), values, route)
    peak = column(records, "peak_overlap")
    below = np.array(["ELASTIC" in record["flags"] for record in records])
    assert 0 < np.sum(below) < len(below)
    exact = [column(records, name) for name in (*OVERLAPS, "eps_p")]
    size = np.where(np.arange(4)[:, None] % 3, peak, 1.0)
    values_off = np.abs([*found, result.plastic_coefficient] - np.array(exact)) / size
    assert np.max(values_off) <= max(2e-12, 1e-3 * bound)
    assert np.all(same_flags(result.status, flags_of(records)))
    for slopes in modes:
        for name, slope in zip(values, slopes, strict=True):
            exact = [column(records, "log_sensitivities", SYMBOLS[name], q) for q in OVERLAPS]
            assert np.max(np.abs(slope[0] - exact[0])) <= bound, name
            assert np.all(np.abs(slope[0][exact[0] == 0]) <= 1e-13), name
            assert np.max(np.abs(slope[1] - exact[1]) / peak) <= 100 * bound, name
            assert np.max(np.abs(slope[2] - exact[2]) / peak) <= 100 * bound, name
            if name not in ("limit_velocity", "sigma", "psi", "velocity"):
                assert np.all(slope[0][below] == 0), name


PROPERTIES = ("E", "nu", "rho", "Y", "R", "chi", "sigma", "psi", "v")  # of two equal spheres
PAIRED = ("chi", "sigma", "psi", "E", "Y", "v")  # with second derivatives
MODES = list(itertools.product((forward, jax.jacrev), repeat=2))


SIZES = {"coefficient": ("eps", None), "residual_overlap": ("residual_overlap", "peak_overlap")}
THROUGH = [(FORMS[0], MODES[0], ["coefficient"])]
THROUGH += itertools.product(FORMS, MODES, [list(SIZES)])


@mostly_long("form, modes, parts", THROUGH)
def test_in_properties_of_a_material(form, modes, parts):
    """First derivatives through the contact of two equal spheres; second ones along directions.

    One Newton step on a frozen root would give first derivatives right and second ones wrong.
    """
    outer, inner = modes
    records = of_form("materials", form)
    choices = cases.stacked_inputs(records)
    values = np.stack([choices[name] for name in PROPERTIES])
    directions = np.concatenate([np.eye(9), np.zeros((21, 9))])  # as many as pairs
    places = [PROPERTIES.index(name) for name in PAIRED]
    directions[9:, places] = np.random.default_rng(0).normal(size=(21, 6))

    def along(direction):
        def moved(t):
            E, nu, rho, Y, R, chi, sigma, psi, v = values * jnp.exp(direction * t)[:, None]
            material = sj.Material(E, nu, rho, Y)
            contact = sj.Contact.between_spheres(material, material, R, R, area=choices["area"])
            law = sj.Zhou(contact, chi, sigma, psi, form=form, kappa=choices["kappa"])
            hit = sj.restitution(law, v)
            return jnp.stack([getattr(hit, part) for part in parts])

        return outer(lambda t: (inner(moved)(t),) * 2, has_aux=True)(0.0)

    second, first = jax.jit(lambda each: jax.lax.map(along, each))(directions)
    for k, (name, scale) in enumerate(map(SIZES.get, parts)):
        size = column(records, scale) if scale else 1.0
        slopes = np.array([column(records, "log_sensitivities", p, name) for p in PROPERTIES])
        off = np.abs(first[:, k] - directions @ slopes) / size
        assert np.all(off[:9] <= [1e-9, 1e-7][k])
        curved = directions**2 @ slopes
        for pair in records[0]["second"]:
            i, j = (PROPERTIES.index(one) for one in pair.split(","))
            both = directions[:, i] * directions[:, j] * (1 + (i != j))
            curved += both[:, None] * column(records, "second", pair, name)
        assert np.all(np.abs(second[:, k] - curved)[9:] / size <= 1e-6)
    assert np.all(np.abs(first[PROPERTIES.index("R"), 0]) <= 1e-13)  # ε does not depend on it
    assert np.all(choices["R"] == RADIUS)


# the table of hard impacts

KINDS = {"float64": np.float64, "float32": np.float32}
TOLERANCE = {"float64": PRECISE.tolerance, "float32": 1e-6}
GROUPS = list(itertools.product(("energy", "ode"), KINDS, FORMS))


@lru_cache
def hard_rows(precision: str, form: str) -> list[dict]:
    path = Path(__file__).parents[1] / "oracles" / "hard_cases.json"
    rows = json.loads(path.read_text(encoding="utf-8"))
    return [r for r in rows if (r["precision"], r["inputs"]["form"]) == (precision, form)]


def squares(values, form, route, dtype):
    """ε², which is what can be compared near ε = 0, ε_p², the status, and both slopes of ε²."""
    law = jax.tree.map(dtype, fitted("nylon", form))
    by = ENERGY if route == "energy" else sj.ODE(TOLERANCE[np.dtype(dtype).name])
    found, result, modes = graded(law, values, by)
    coefficient = np.asarray(found[0], float)
    slopes = [2 * coefficient * np.asarray(s, float)[:, 0] for s in modes]
    plastic = np.asarray(result.plastic_coefficient, float) ** 2
    return coefficient**2, plastic, np.asarray(result.status), slopes


def bounds(route: str, precision: str, rows: list[dict], exact_slopes):
    """What ε² may be off: 1e-12 + 8 eps Σ|∂ε²/∂ln θ|; its slopes: likewise; the ODE's tolerance.

    In float32 the 1e-12 becomes 8 eps, since ε² itself rounds at eps/2. `ode` of a row is by how many
    tolerances more its gradient may be off: where √x* has just left 0 it moves up to 1e7 times faster
    than θ.
    """
    eps = float(np.finfo(KINDS[precision]).eps)
    tolerance = TOLERANCE[precision] if route == "ode" else 0.0
    value = max(1e-12, 8 * eps) + (8 * eps + tolerance) * column(rows, "sensitivity")
    curvatures = np.array([column(rows, "curvatures", SYMBOLS[name]) for name in SYMBOLS])
    more = np.array([row.get("ode", 0.0) for row in rows])
    added = tolerance * (20 * (1 + curvatures) + more)
    spread = np.abs(exact_slopes) + curvatures
    return value + tolerance, max(1e-12, 32 * eps) + 8 * eps * spread + added


def failing(rows: list[dict], holds) -> list[str]:
    return [row["name"] for row, good in zip(rows, holds, strict=True) if not good]


@mostly_long("route, precision, form", GROUPS, GROUPS[::4])
def test_hard_impacts(route, precision, form):
    """All rows in one batch: neighbours of every kind, none of which touches another."""
    rows, dtype = hard_rows(precision, form), KINDS[precision]
    value, plastic, status, gradients = squares(of_records(rows, dtype), form, route, dtype)
    signed = column(rows, "eps_squared")
    alive = signed > 0  # ε² is clipped at 0
    least = TOLERANCE[precision] if route == "ode" else 0.0
    sure = (signed == 0) | (np.abs(signed) > least)  # its sign
    exact = np.where(alive, [column(rows, "slopes", SYMBOLS[name]) for name in SYMBOLS], 0.0)
    allowed, allowed_slope = bounds(route, precision, rows, exact)
    expected = np.maximum(signed, 0)
    assert failing(rows, np.abs(value - expected) <= allowed) == []
    expected = column(rows, "eps_p_squared")
    assert failing(rows, np.abs(plastic - expected) <= allowed) == []
    known = np.full(len(rows), -1)
    if route == "ode":  # it cannot tell a gain within its tolerance from rounding
        unknown = (expected > 1) & (expected - 1 < 3 * TOLERANCE[precision])
        assert np.sum(unknown) <= 2
        assert np.sum(~sure) <= 2
        known = np.where(unknown, ~int(sj.Status.ENERGY_GAIN), -1)
        known = np.where(sure, known, ~int(sj.Status.NO_REBOUND))
    assert failing(rows, same_flags(status & known, flags_of(rows) & known)) == []
    for slopes in gradients:
        assert failing(rows, ~sure | np.all(np.abs(slopes - exact) <= allowed_slope, axis=0)) == []


@pytest.mark.parametrize("form", FORMS)
def test_hard_impacts_in_float32(form):
    """Values and statuses."""
    rows = hard_rows("float32", form)
    values = of_records(rows, np.float32)
    law = with_numbers(jax.tree.map(np.float32, fitted("nylon", form)), values)
    result = sj.restitution(law, values["velocity"])
    allowed, _ = bounds("energy", "float32", rows, 0.0)
    for found, name in (("coefficient", "eps_squared"), ("plastic_coefficient", "eps_p_squared")):
        error = np.asarray(getattr(result, found), float) ** 2 - np.maximum(column(rows, name), 0)
        assert failing(rows, np.abs(error) <= allowed) == []
    assert failing(rows, same_flags(result.status, flags_of(rows))) == []
