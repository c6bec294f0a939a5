"""The hard places of the model, one row each: value, flags and finite derivatives, by both routes.

The inputs are rounded to the precision under test first; what is expected belongs to those.
"""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import FITTED, compiled_soon, fitted, law_of, pair, status
from tests.oracles import zhou_mp

NAMES = ("E", "R", "M", "Y", "v_lim", "chi", "sigma", "psi", "v")
ROUTES = {"energy": sj.EnergyBalance(), "ode": sj.ODE(rtol=1e-10)}
# |Δε²| beyond the rounding of the inputs
FLOOR = {("energy", "float64"): 1e-12, ("ode", "float32"): 2e-5, ("energy", "float32"): 2e-6}

# what it is, material, y = v/v_cr, changed fields, flags in both forms
ROWS = [
    ("elastic", "nylon", 0.5, {}, "ELASTIC"),
    ("at first yield", "nylon", 1.0, {}, "ELASTIC"),
    ("at rest", "nylon", 0.0, {}, "ELASTIC ZERO_VELOCITY"),
    ("nearly at rest", "nylon", 1e-30, {}, "ELASTIC"),
    ("plain", "stainless steel", 20.0, {}, ""),
    ("X < 1", "nylon", 40.0, {"chi": 0.0160}, "NO_RESIDUAL_OVERLAP"),
    ("X < 1 and gains", "nylon", 3.0, {"chi": 0.0160}, "NO_RESIDUAL_OVERLAP ENERGY_GAIN"),
    ("no plastic unloading", "nylon", 3.0, {"chi": 0.0}, "NO_RESIDUAL_OVERLAP ENERGY_GAIN"),
    ("just above yield", "nylon", 1.02, {}, "ENERGY_GAIN"),
    ("losses too large", "stainless steel", 50.0, {"sigma": 2000.0}, "NO_REBOUND"),
    ("no turning point", "nylon", 2e3, {"v_lim": 2e4}, "NO_TURNING_POINT BEYOND_EXPANSION"),
    ("v_lim < v", "nylon", 5.0, {"v_lim": 2.0}, "ABOVE_LIMIT_VELOCITY"),
    ("v_lim < v_cr < v", "nylon", 5.0, {"v_lim": 0.5}, "ABOVE_LIMIT_VELOCITY NO_REBOUND"),
    ("v_lim < v < v_cr", "nylon", 0.9, {"v_lim": 0.5}, "ELASTIC ABOVE_LIMIT_VELOCITY"),
    ("nearly plastic", "stainless steel", 20.0, {"chi": 1e6, "sigma": 0.0}, ""),
    ("no other losses", "chrome steel", 10.0, {"sigma": 0.0}, ""),
]
# the first-order form alone: its unloading turns around, and then loading has no end
FIRST_ORDER = [
    ("beyond the expansion", "nylon", 310.0, {"sigma": 0.01}, "BEYOND_EXPANSION"),
]
INVALID = [
    ({"v": np.nan}, "velocity not a number"),
    ({"v": -1.0}, "negative velocity"),
    ({"v": np.inf}, "infinite velocity"),
    ({"E": np.nan}, "modulus not a number"),
    ({"M": 0.0}, "no mass"),
    ({"chi": -0.1}, "negative chi"),
    ({"psi": 0.0}, "psi zero"),
    ({"sigma": np.inf}, "infinite sigma"),
]


@lru_cache
def table(form: str, dtype: str):
    """The rows as arrays of inputs in this precision, flags, and what is exact for those inputs."""
    rows = ROWS + (FIRST_ORDER if form == "first-order" else [])
    choices = {"area": "zhou", "kappa": "consistent", "form": form}
    inputs, flags, answers, sensitivity = [], [], [], []
    for _, material, y, changed, names in rows:
        contact = pair(material)
        numbers = {"E": contact.youngs_modulus, "R": contact.radius, "M": contact.mass}
        numbers |= {"Y": contact.yield_strength, "v_lim": contact.limit_velocity}
        numbers |= FITTED[material] | changed
        numbers = {name: np.asarray(value, dtype) for name, value in numbers.items()}
        v_cr = law_of(numbers | {"v": 0.0} | choices).contact.critical_velocity
        numbers["v"] = np.asarray(v_cr * np.asarray(y, dtype), dtype)
        exact = {name: float(value) for name, value in numbers.items()} | choices
        if y == 1:  # the critical velocity as a rounded number may lie above the exact one
            lengths = [exact[name] for name in ("E", "R", "M", "Y")]
            exact["v"] = min(exact["v"], zhou_mp.scales(*lengths, "zhou")["v_cr"])
        inputs.append(numbers)
        flags.append(int(status(names.split())))
        answers.append(zhou_mp.coefficient(exact, duration=False))
        moves = zhou_mp.log_sensitivities(exact) if y > 1 else {}
        sensitivity.append(sum(abs(float(s["eps_squared"])) for s in moves.values()))
    stacked = {name: jnp.asarray([row[name] for row in inputs]) for name in NAMES}
    return stacked, choices, np.array(flags), answers, np.array(sensitivity)


def solve(numbers, choices, route):
    law = law_of(numbers | choices)
    return sj.restitution(law, numbers["v"], route=route)


@lru_cache
def compiled(form: str, route: str):
    """Value, gradient of Σε in reverse, and along all inputs at once forward."""
    choices = {"area": "zhou", "kappa": "consistent", "form": form}

    def total(numbers):
        result = solve(numbers, choices, ROUTES[route])
        return result.coefficient.sum(), result

    def everything(numbers):
        (_, result), reverse = jax.value_and_grad(total, has_aux=True)(numbers)
        forward = jax.jvp(lambda n: total(n)[1].coefficient, (numbers,), (numbers,))[1]
        return result, reverse, forward

    return compiled_soon(everything)


# every choice once; the table of hard impacts takes all their combinations
@pytest.fixture(
    params=[
        pytest.param(("first-order", "ode", "float32"), marks=pytest.mark.long),
        pytest.param(("first-order", "energy", "float32"), marks=pytest.mark.long),
        ("full", "energy", "float64"),
    ],
    ids="-".join,
)
def how(request):
    return request.param


@pytest.fixture
def form(how):
    return how[0]


@pytest.fixture
def route(how):
    return how[1]


@pytest.fixture
def dtype(how):
    return how[2]


def test_flags_and_values(form, dtype, route):
    numbers, _, flags, answers, sensitivity = table(form, dtype)
    result, _, _ = compiled(form, route)(numbers)
    assert result.coefficient.dtype == dtype
    names = [row[0] for row in ROWS + (FIRST_ORDER if form == "first-order" else [])]
    for i, name in enumerate(names):
        assert sj.Status(int(result.status[i])) == sj.Status(int(flags[i])), name
        assert {str(f.name) for f in sj.Status(int(flags[i]))} == answers[i]["flags"], name
    squared = np.array([max(float(a["eps_squared"]), 0.0) for a in answers])
    rounding = 8 * np.finfo(dtype).eps * sensitivity
    error = np.abs(np.square(np.asarray(result.coefficient, float)) - squared)
    assert np.all(error <= FLOOR[route, dtype] + rounding), dict(zip(names, error, strict=True))


def test_overlaps(form, dtype, route):
    numbers, _, _, answers, _ = table(form, dtype)
    result, _, _ = compiled(form, route)(numbers)
    peak = np.array([float(a["peak_overlap"]) for a in answers])
    residual = np.array([float(a["residual_overlap"]) for a in answers])
    bound = 1e-8 if dtype == "float64" else 2e-4
    assert np.allclose(result.peak_overlap, peak, rtol=bound, atol=0)
    assert np.all(np.abs(result.residual_overlap - residual) <= bound * peak)


def test_derivatives_are_finite_and_zero_where_the_value_stands_for_nothing(form, dtype, route):
    numbers, _, flags, _, _ = table(form, dtype)
    result, reverse, forward = compiled(form, route)(numbers)
    still = flags & int(sj.Status.NO_REBOUND | sj.Status.NO_TURNING_POINT | sj.Status.ZERO_VELOCITY)
    assert np.all(np.isfinite(forward))
    assert np.all(forward[still > 0] == 0)
    total = 0.0
    for name in NAMES:
        assert np.all(np.isfinite(reverse[name])), name
        assert np.all(reverse[name][still > 0] == 0), name
        total = total + np.asarray(reverse[name] * numbers[name], float)
    loose = 1e-9 if dtype == "float64" else 1e-3
    assert np.allclose(total, forward, rtol=loose, atol=loose)
    assert np.count_nonzero(np.asarray(result.coefficient)) > 10


def test_overlaps_do_not_move_without_a_turning_point(form, route):
    """δ_max is where the law ends then: a number to look at, and no answer."""
    law = fitted("nylon", form)

    def overlaps(law, v):
        result = sj.restitution(law, v, ROUTES[route])
        return result.peak_overlap + result.residual_overlap

    slopes = compiled_soon(jax.grad(overlaps, (0, 1)))
    far, near = (slopes(law, y * law.contact.critical_velocity) for y in (2e3, 20.0))
    assert all(leaf == 0 for leaf in jax.tree.leaves(far))
    assert sum(leaf != 0 for leaf in jax.tree.leaves(near)) >= 5


def neighbours(form, dtype):
    """As many plain impacts as the table has rows, and the same with the last ones bad."""
    numbers, *_ = table(form, dtype)
    count = len(numbers["v"])
    plain = {name: jnp.repeat(value[4:5], count) for name, value in numbers.items()}
    plain["v"] = plain["v"] * jnp.asarray(1.0 + 0.1 * np.arange(count), dtype)
    bad = {name: np.array(value) for name, value in plain.items()}
    for i, (changed, _) in enumerate(INVALID):
        for name, value in changed.items():
            bad[name][i - len(INVALID)] = value
    return plain, {name: jnp.asarray(value) for name, value in bad.items()}


def test_bad_impacts_leave_their_neighbours_alone(form, dtype, route):
    """Bit for bit, values and derivatives; the bad ones are zero without a derivative."""
    plain, bad = neighbours(form, dtype)
    good, hurt = slice(0, -len(INVALID)), slice(-len(INVALID), None)
    compute = compiled(form, route)
    with_good, reverse, forward = compute(plain)
    with_bad, bad_reverse, bad_forward = compute(bad)
    fields = ("coefficient", "plastic_coefficient", "peak_overlap", "residual_overlap", "status")
    for name in fields:
        one, two = getattr(with_good, name), getattr(with_bad, name)
        assert np.array_equal(one[good], two[good]), name
        assert len(one[good]) > 5
        assert np.all(two[hurt] == (int(sj.Status.INVALID_INPUT) if name == "status" else 0)), name
    assert not np.any(with_bad.ok[hurt])
    assert np.array_equal(forward[good], bad_forward[good])
    assert np.all(bad_forward[hurt] == 0)
    for name in NAMES:
        assert np.array_equal(reverse[name][good], bad_reverse[name][good]), name
        assert np.all(bad_reverse[name][hurt] == 0), name


PAIR = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
WITHOUT_TIME_STEPS = (
    sj.Hertz(PAIR),
    sj.ConstantRestitution(PAIR, 0.9),
    sj.WaltonBraun(PAIR, 1e6, 2e6),
    sj.Thornton(PAIR),
)


@pytest.mark.parametrize("law", WITHOUT_TIME_STEPS, ids=lambda law: type(law).__name__)
def test_velocities_that_no_law_takes_are_told_under_jit(law):
    """Even where nothing of the law depends on the velocity."""
    result = jax.jit(lambda v: sj.restitution(law, v))(jnp.array([np.nan, -1.0, np.inf]))
    assert np.all(result.status == int(sj.Status.INVALID_INPUT))
    assert np.all(result.coefficient == 0)
    assert np.all(result.peak_overlap == 0)
    assert np.all(result.duration == 0)


def test_ok_is_plain_or_elastic_alone():
    numbers, choices, flags, *_ = table("first-order", "float64")
    ok = solve(numbers, choices, None).ok
    assert np.array_equal(ok, (flags == 0) | (flags == int(sj.Status.ELASTIC)))
    assert 0 < np.sum(ok) < len(ok)


def test_each_flag_but_plain_and_elastic_has_a_remedy():
    for flag in sj.Status:
        expected = flag in (sj.Status.ELASTIC, sj.Status.ZERO_VELOCITY)
        assert (flag.remedy == "") == expected, flag
    both = sj.Status.ENERGY_GAIN | sj.Status.NO_RESIDUAL_OVERLAP
    assert sj.Status.ENERGY_GAIN.remedy in both.remedy
    assert sj.Status.NO_RESIDUAL_OVERLAP.remedy in both.remedy
    assert sj.Status.PLAIN.remedy == ""


def test_a_printed_result_tells_the_numbers_of_a_few_impacts():
    law = fitted("nylon")
    critical = float(law.contact.critical_velocity)
    many = sj.restitution(law, np.linspace(0.5, 5, 40) * critical)
    few = sj.restitution(law, np.array([0.5, 5.0]) * critical)
    numbers = " ".join(f"{one:.4f}".rstrip("0") for one in few.coefficient)
    assert repr(few) == f"Restitution(Zhou: eps=[{numbers}], status=ok)"
    beyond = sj.restitution(law, [critical, 1e4])
    told = repr(beyond).partition("status=")[2]
    assert told == "(ELASTIC 1, BEYOND_EXPANSION|NO_TURNING_POINT|ABOVE_LIMIT_VELOCITY 1))"
    assert "coefficient=f64[40]" in repr(many)
    shown = []
    jax.make_jaxpr(lambda v: shown.append(repr(sj.restitution(law, v))))(few.velocity)
    assert "coefficient=f64[2]" in shown[0]


class Formula(sj.HardSphereLaw):
    """ε² = a ln(2 - v)."""

    a: float

    def restitution_squared(self, velocity):
        return self.a * jnp.log(2 - velocity)


class Told(sj.RateDependentLaw):
    """An elastic spring whose coefficient is as told."""

    contact: sj.Contact
    coefficient: float
    end = "zero-overlap"

    def force(self, overlap, velocity):
        return 1e6 * overlap

    def closed_form(self, velocity):
        return sj.KnownCollision(velocity * self.coefficient, velocity, velocity, velocity)


def test_a_formula_that_gives_no_number_or_too_much():
    velocity = np.array([0.5, 3.0])
    found = sj.restitution(Formula(10.0), velocity)
    assert found.coefficient[0] == pytest.approx(np.sqrt(10 * np.log(1.5)), rel=1e-15)
    assert list(found.status) == [sj.Status.ENERGY_GAIN, sj.Status.SOLVER_FAILED]
    assert found.coefficient[1] == 0
    told = sj.restitution(Told(pair("nylon"), np.array([1.0, 1.0 + 1e-9])), 1.0)
    assert list(told.status) == [sj.Status.PLAIN, sj.Status.ENERGY_GAIN]
    overflow = sj.restitution(Told(pair("nylon"), 1e200), 1e200)
    assert (overflow.coefficient, overflow.status) == (0, sj.Status.SOLVER_FAILED)


class Driven(sj.RateDependentLaw):
    """A force of any power with a part that grows with the rate, or falls."""

    contact: sj.Contact
    power: float
    rate: float
    end = "zero-overlap"

    def force(self, overlap, velocity):
        return 100 * (overlap / 1e-5) ** self.power * (1 + self.rate * velocity)


@pytest.mark.parametrize(
    "route", [sj.ODE(rtol=1e-5), sj.ODE(steps=8, solver="dopri5")], ids=["adaptive", "fixed"]
)
def test_gains_of_damped_laws_are_told_and_rounding_is_none(route):
    power, rate = np.array([0.5, 1.0, 1.5, 2.0, 1.5]), np.array([0.0, 0.0, 0.0, 0.0, -0.1])
    found = sj.restitution(Driven(pair("stainless steel"), power, rate), 1.0, route)
    assert np.allclose(found.coefficient[:4], 1.0, atol=1e-3)
    assert found.coefficient[4] > 1.05
    assert list(found.status) == [0, 0, 0, 0, sj.Status.ENERGY_GAIN]


def test_the_slowest_impact_is_at_rest_alone_and_among_others():
    """Compiled code takes for zero what is below the smallest normal number."""
    law = sj.WaltonBraun(pair("stainless steel"), 1e6, 2e6)
    at_rest = sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY
    for velocity in ([1e-310], [1e-310, 1.0], [1e-310, 0.0]):
        found = sj.restitution(law, velocity)
        assert (found.coefficient[0], found.status[0]) == (1, at_rest)
