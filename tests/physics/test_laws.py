"""Every law by every route: ε, overlaps and durations against formulas in high precision."""

import jax
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, mostly_long, same_flags
from tests.laws import (
    KNOWN,
    LAWS,
    PAIR,
    PRECISE,
    QUANTITIES,
    WITH_FORCE,
    expected,
    numbers,
    repeated,
    with_numbers,
)
from tests.oracles import closed_forms, laws_mp

# a law's own numbers and velocities beside the plain ones, where its formula changes or a root vanishes
RATE = 1.5 * (PAIR.stiffness / PAIR.mass) ** 0.4
RANGES = {
    "thornton": {"velocity": 0.01 * 10.0 ** np.array([-8, 0, 0.3, 1, 4, 30, 120, 150])},
    "walton-braun": {"growth": [0.0, 1e-3, 1e4, 1e20], "velocity": [0.7, 0.7, 1e-300, 0.7]},
    "hertz": {"velocity": 10.0 ** np.array([-300, -100, 0, 6])},
    "viscoelastic": {"dissipation_time": np.array([1e-9, 40.0, 1e6, 1e13]) / RATE},
} | {
    f"{kind} dashpot to {end}": {
        "restitution": 10.0 ** np.append(-np.array(powers), [-1e-7, -0.05, -0.3, -0.7]),
        "velocity": 0.7,
    }
    for kind, powers in (("linear", [300.0, 64.0, 6.0]), ("hertz", [40.0, 6.0]))
    for end in ("zero-overlap", "zero-force")
}


def assert_solved(case, tolerance, route=None, ranges=None):
    """All quantities and the status, of the plain impacts and of those over a range."""
    plain, ranges = len(case.velocity), ranges or {}
    more = max(map(np.size, ranges.values()), default=0)
    values = repeated(case.law, np.append(case.velocity, np.ones(more)))
    for name, x in ranges.items():
        values[name][plain:] = x
    result = sj.restitution(with_numbers(case.law, values), values["velocity"], route)
    rows = [dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)]
    alone = {"alone": True} if case.exact is laws_mp.viscoelastic else {}
    with mp.workdps(54):  # 14 are left of viscoelastic spheres at w² = 1e13
        exact = [case.exact({n: mp.mpf(float(x)) for n, x in row.items()}, **alone) for row in rows]
        exact = np.array([[float(x) for x in row] for row in exact])
    for k, name in enumerate((*QUANTITIES, "peak_force")):
        size = np.abs(exact[:, k])
        if name == "coefficient":
            size[:plain] = np.max(size[:plain])
        if "overlap" in name:
            size = np.maximum(size, exact[:, 1])
        # the largest force is known where the bodies stop, else it is found by integration
        found_late = route or isinstance(case.law, sj.RateDependentLaw)
        near = max(tolerance, 1e-8) if name == "peak_force" and found_late else tolerance
        error = np.abs(np.asarray(getattr(result, name)) - exact[:, k])
        assert np.all(np.isnan(exact[:, k]) | (error <= near * size + 1e-300)), (name, error / size)
    assert np.all(same_flags(result.status[:plain], case.status))
    assert np.array_equal(result.ok, sj.Status.is_ok(result.status))


def test_viscoelastic_spheres_by_one_restitution_at_one_velocity():
    """The closed form turned around: ε of that A by the motion's Taylor series in mpmath."""
    law = sj.ViscoelasticHertz.from_restitution(PAIR, np.array([0.8, 0.01]), 1.5)
    for k, stated in enumerate((0.8, 0.01)):
        values = numbers(law, 1.5) | {"dissipation_time": law.dissipation_time[k]}
        with mp.workdps(30):
            exact = laws_mp.viscoelastic(
                {n: mp.mpf(float(x)) for n, x in values.items()}, alone=True
            )
        assert float(exact[0]) == pytest.approx(stated, rel=1e-11)
    for wrong in ({"restitution": 1.5}, {"velocity": 0.0}):
        with pytest.raises(ValueError, match=f"`{next(iter(wrong))}` must be"):
            sj.ViscoelasticHertz.from_restitution(
                **{"contact": PAIR, "restitution": 0.8, "velocity": 1.0} | wrong
            )


@mostly_long("name", WITH_FORCE, ["hertz dashpot to zero-force"])
def test_in_time_by_events(name):
    """Shares the law alone with the other routes; looser tolerances would pass with an event that is missed."""
    assert_solved(LAWS[name], 1e-8, sj.TimeODE(rtol=1e-11))


@pytest.mark.parametrize("name", LAWS)
def test_by_its_default_route(name):
    case = LAWS[name]
    assert case.law.default_route() == case.route
    assert_solved(case, 2e-12, ranges=RANGES.get(name))


@mostly_long("name", WITH_FORCE, ("thornton", "linear dashpot to zero-overlap"))
def test_by_the_equation_of_motion(name):
    assert_solved(LAWS[name], 1e-10, PRECISE)


@mostly_long("name", ["falling", *closed_forms.WANTED])
def test_the_stored_series_are_what_the_script_gives(name):
    stored = closed_forms.stored()["series"][name]
    found = closed_forms.coefficients(name)
    assert (stored["low"], stored["high"]) == closed_forms.WANTED[name][1:]
    assert np.allclose(found, stored["coefficients"], rtol=0, atol=1e-15 * max(map(abs, found)))


def test_published_digits():
    """Thornton (1997), Schwager and Pöschel's zero-force end, Müller and Pöschel's Padé."""
    law = sj.Thornton(PAIR)
    ratios = np.array([1.5, 2, 5, 10, 50, 100, 1000])
    published = np.array([0.9712, 0.9306, 0.7733, 0.6586, 0.4446, 0.3743, 0.2107])
    for kind, pace in (
        (law, law.elastic_velocity()),
        (sj.Thornton(PAIR, 1.6), 1.6**2.5 * law.elastic_velocity()),
        (sj.Thornton(PAIR, area="contact"), PAIR.critical_velocity),
    ):
        found = sj.restitution(kind, ratios * pace).coefficient
        assert np.allclose(found, published, rtol=0, atol=5e-5)
        r = 1 / ratios
        root = np.sqrt(6 / 5 - r * r / 5)
        formula = 3**0.25 * root * (r / (r + 2 * root)) ** 0.25
        assert np.allclose(found, formula, rtol=1e-14, atol=0)
        alone = sj.thornton_restitution(PAIR, ratios * pace, kind.yield_factor, kind.area)
        assert np.allclose(alone, formula, rtol=1e-14, atol=0)
    assert sj.thornton_restitution(PAIR, 0.9 * law.elastic_velocity()) == 1
    given = np.array([0.05, 0.2, 0.5, 0.8, 0.9])
    zero_force = [0.213700, 0.324863, 0.550283, 0.808099, 0.902026]
    for dashpot in (
        sj.HertzDashpot(PAIR, given, "zero-force"),
        sj.LinearSpringDashpot(PAIR, 1e6, given, "zero-force"),
    ):
        assert np.allclose(sj.restitution(dashpot, 0.7).coefficient, zero_force, atol=1e-6)
    w = np.sqrt([0.01, 0.1, 0.3, 1.0])
    time = w**2 / (1.5 * (PAIR.stiffness / PAIR.mass) ** 0.4)
    found = np.asarray(sj.restitution(sj.ViscoelasticHertz(PAIR, time), 1.0).coefficient)
    assert np.allclose(found, [0.98855, 0.89286, 0.72209, 0.39393], rtol=0, atol=5.5e-6)
    above = 1 + 0.501086 * w
    pade = above / (above + 1.15345 * w**2 + 0.577977 * w**3 + 0.532178 * w**4)
    assert np.allclose(pade - found, [6e-8, 5e-5, 7e-4, 5e-3], rtol=0.09, atol=0)


def test_without_damping_and_with_none_left():
    """A = 0 is Hertz's collision; far beyond the series what is left is 0, and still a number."""
    law = sj.ViscoelasticHertz(PAIR, np.array([0.0, 1e-6, 1e290]))
    result = sj.restitution(law, np.array([1.0, 0.0, 1e3]))
    exact = laws_mp.hertz({k: mp.mpf(float(x)) for k, x in numbers(sj.Hertz(PAIR), 1.0).items()})
    assert result.coefficient[0] == 1
    assert result.peak_overlap[0] == pytest.approx(float(exact.peak), rel=1e-15)
    assert result.duration[0] == pytest.approx(float(exact.duration), rel=1e-14)
    rest = sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY
    assert np.all(same_flags(result.status, [sj.Status.PLAIN, rest, sj.Status.PLAIN]))
    assert (result.coefficient[1], result.peak_overlap[1], result.duration[1]) == (1, 0, 0)
    assert result.coefficient[2] == 0
    assert np.all(np.isfinite(result.duration))


def test_where_tracing_hides_a_softer_unloading_it_is_as_stiff_as_the_loading():
    soft = jax.jit(lambda k2: sj.restitution(sj.WaltonBraun(PAIR, 1e6, k2), 1.0))(0.5e6)
    assert (soft.coefficient, soft.residual_overlap) == (1, 0)
    assert same_flags(soft.status, sj.Status.NO_RESIDUAL_OVERLAP)


def test_hard_spheres():
    """Both ends, an array, no contact, and Eq. (17) as a function; no overlap and no time."""
    given = np.array([0.0, 0.2, 1.0])
    result = sj.restitution(sj.ConstantRestitution(None, given), 1.0)
    assert np.allclose(result.coefficient, given, rtol=2e-16, atol=0)
    assert np.array_equal(result.duration, np.zeros(3))
    assert jax.grad(lambda e: sj.restitution(sj.ConstantRestitution(None, e), 1.0).coefficient)(
        0.9
    ) == pytest.approx(1.0)
    law, v = LAWS["eq. 17"].law, LAWS["eq. 17"].velocity
    function = sj.empirical_restitution(v, law.limit_velocity, law.sigma, law.psi)
    assert np.allclose(function, expected("eq. 17")[:, 0], rtol=1e-13, atol=0)
    at = sj.restitution(law, [0.0, 340.0, 500.0])
    limit = sj.Status.ABOVE_LIMIT_VELOCITY
    assert list(at.coefficient) == [1, 0, 0]
    assert np.all(
        same_flags(at.status, [sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY, limit, limit])
    )


class Resting(sj.RateDependentLaw):
    """Of which the collisions are known."""

    contact: sj.Contact
    end = "zero-overlap"

    def force(self, overlap, velocity):
        return 1e6 * overlap

    def closed_form(self, velocity):
        return sj.KnownCollision(1.0 + 0 * velocity, 1e-5, 0.0, 1e-3)


class Renamed(Resting):
    title: str = "at rest"


class Stiffer(Resting):
    def force(self, overlap, velocity):
        return 2e6 * overlap


class StifferAndKnown(Stiffer):
    closed_form = Resting.closed_form


def test_a_closed_form_is_of_the_force_that_it_is_defined_with():
    known = {cls: cls.has_closed_form() for cls in (Resting, Renamed, Stiffer, StifferAndKnown)}
    assert known == {Resting: True, Renamed: True, Stiffer: False, StifferAndKnown: True}
    routes = {cls: type(cls.default_route()) for cls in known}
    assert routes == {cls: sj.ClosedForm if is_known else sj.ODE for cls, is_known in known.items()}


def test_the_closed_form_is_refused_where_there_is_none():
    for law in (sj.Hertz(PAIR), sj.Thornton(PAIR)):
        with pytest.raises(ValueError, match="`closed_form`, such as LinearSpringDashpot"):
            sj.restitution(law, 1.0, KNOWN)
    assert sj.restitution(sj.ConstantRestitution(None, 0.7), 1.0, KNOWN).coefficient == 0.7


# the largest force, where the table does not tell


def test_where_the_force_falls_before_the_bodies_stop():
    """Zhou's first-order force has its largest value within loading; just below it is that of the peak."""
    law = fitted("nylon")
    velocity = np.array([3.0, 290.0]) * float(law.contact.critical_velocity)
    hit = sj.restitution(law, velocity)
    grid = np.linspace(0, 1, 200_001)[:, None] * np.asarray(hit.peak_overlap)
    along = np.asarray(law.loading_force(grid)).max(0)
    assert along[1] > 1.01 * law.loading_force(hit.peak_overlap[1])
    assert np.allclose(hit.peak_force, along, rtol=1e-9, atol=0)


@mostly_long("law", [sj.HertzDashpot(PAIR, 0.6), sj.ViscoelasticHertz(PAIR, 2e-6)])
def test_the_largest_force_of_damped_contacts(law):
    """The largest of many along the way; and its derivative."""
    velocity = np.array([0.0, 0.1, 3.0])
    history = np.asarray(sj.collide(law, velocity, 2001, sj.ODE(rtol=1e-10)).force).max(-1)
    force = jax.jit(lambda v: jax.jvp(lambda v: sj.restitution(law, v).peak_force, (v,), (v,)))
    step = 1e-3
    (found, slope), (low, _), (high, _) = (force(velocity * by) for by in (1, 1 - step, 1 + step))
    assert np.allclose(found, history, rtol=3e-6, atol=0)
    assert np.allclose(slope, (high - low) / (2 * step), rtol=1e-5, atol=0)
    assert found[0] == 0
