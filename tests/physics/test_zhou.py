"""Zhou's law against 40 and more digits: 150 drawn collisions a form, up to y_max."""

import json
from itertools import product

import jax
import numpy as np
import pytest

import softjax as sj
from tests import cases
from tests.cases import (
    EPS,
    FORMS,
    column,
    fitted,
    flags_of,
    law_with,
    mostly_long,
    of_form,
    same_flags,
)
from tests.laws import QUANTITIES, in_small_batches
from tests.oracles import write

BY_TIME = sj.ODE(rtol=1e-11)
BOXES = list(product(FORMS, (sj.EnergyBalance(), BY_TIME)))


@mostly_long("form, route", BOXES, BOXES[:3])
def test_over_the_boxes(form, route):
    """E/Y 20…1000, X 0.3…3000, y 0…300: ε_p² to 1e-12 and the rounding of the inputs, and all else."""
    records = of_form("boxes", form)
    d, X, y = (column(records, name) for name in ("d", "X", "y"))
    law = law_with(d, X, form)
    velocity = y * law.contact.critical_velocity
    if route == BY_TIME:
        of = lambda d, X, v: sj.restitution(law_with(d, X, form), v, route)  # noqa: E731
        names = ("plastic_coefficient", "status", *QUANTITIES)
        result = in_small_batches(names, of, d, X, velocity)
    else:
        result = sj.restitution(law, velocity, route)
    error = np.abs(np.square(result.plastic_coefficient) - column(records, "eps_p_squared"))
    if route == BY_TIME:
        assert np.max(error) <= 1e-11
        assert np.quantile(error, 0.95) <= 1e-12
    else:
        assert np.all(error <= 1e-12 + 8 * EPS * column(records, "log_sensitivity_sum"))
    assert np.all(same_flags(result.status, flags_of(records)))
    scale, peak = law.contact.critical_overlap, column(records, "x_m")
    tolerance = 1e-8 if route == BY_TIME else 1e-12
    assert np.allclose(result.peak_overlap / scale, peak, rtol=tolerance, atol=0)
    off = np.abs(result.residual_overlap / scale - column(records, "x_star"))
    assert np.all(off <= 20 * tolerance * peak)
    expected = column(records, "duration")
    ends = np.isfinite(expected)  # at rest and without a turning point no contact does
    lasts = result.duration * law.contact.critical_velocity / scale
    assert np.allclose(lasts[ends], expected[ends], rtol=1e-8, atol=0)
    assert np.all(result.duration[~ends] == 0)
    assert not np.all(ends)


class ByNumbers(sj.RateIndependentLaw):
    """Zhou's reduced law of given d and X, without the rounding of SI units between."""

    contact: sj.Contact
    d: float
    X: float

    def scales(self):
        return sj.Scales(1.0, 1.0)

    def reduced(self):
        kind = type(fitted("nylon").reduced())
        return kind(jax.numpy.asarray(self.d), jax.numpy.asarray(self.X))


def by_numbers(d, X, y):
    contact = cases.pair("nylon")
    contact = jax.tree.map(lambda leaf: np.asarray(leaf, np.asarray(d).dtype), contact)
    return sj.restitution(ByNumbers(contact, d, X), y)


TURNING = json.loads((write.HERE / "turning_point.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_up_to_the_last_turning_point(kind):
    """Where loading has nearly a double root, 1 - y/y_max down to 3e-16, all in one batch."""
    d, X, y, distance, squared, peak, sensitivity = np.array(TURNING[kind.__name__]).T
    result = by_numbers(*(a.astype(kind) for a in (d, X, y)))
    eps = float(np.finfo(kind).eps)
    allowed = max(1e-12, 8 * eps) + 8 * eps * sensitivity
    turns = np.asarray(result.status & int(sj.Status.NO_TURNING_POINT)) == 0
    assert np.all(turns | (distance < 32 * eps))  # else within rounding of the last one
    error = np.abs(np.asarray(result.plastic_coefficient, float) ** 2 - squared)
    assert np.flatnonzero(turns & ~(error <= allowed)).tolist() == []
    # the root moves with the square root of the distance
    near = 8 * eps / np.sqrt(np.maximum(distance, 8 * eps))
    off = np.abs(np.asarray(result.peak_overlap, float) / peak - 1)
    assert np.flatnonzero(turns & ~(off <= near)).tolist() == []
    assert np.all(result.residual_overlap <= result.peak_overlap * (1 + 4 * eps))
    assert turns.sum() > 120


@mostly_long("form, dtype", product(FORMS, (np.float64, np.float32)))
def test_critical_velocity_is_elastic_and_the_next_number_is_not(form, dtype):
    """Whether the law's numbers are arguments of the compiled function or constants in it."""
    ratio, radius = np.meshgrid(np.geomspace(2, 1e6, 9), np.geomspace(1e-9, 1e3, 9))
    modulus = np.geomspace(1e8, 1e12, 81).reshape(9, 9)
    values = (modulus, radius, 3e4 * radius**3, modulus / ratio, 1e9)
    contact = sj.Contact(*(np.asarray(value, dtype) for value in values))
    half = np.asarray(0.5, dtype)
    law = sj.Zhou(contact, half, half, half, form=form)
    at = contact.critical_velocity
    assert at.dtype == dtype
    around = np.stack([np.nextafter(at, dtype(0)), at, np.nextafter(at, dtype(1e9))])
    status = lambda v: sj.restitution(law, v).status  # noqa: E731
    for compute in (status, jax.jit(status)):
        elastic = np.asarray(compute(around)) & int(sj.Status.ELASTIC) > 0
        assert np.array_equal(np.all(elastic, axis=(1, 2)), [True, True, False])
        assert not np.any(elastic[2])


def test_no_scale_leaves_float32():
    """From 1 nm to 1 km spheres every scale is a finite positive float32."""
    for radius in (1e-9, 1e3):
        exact = sj.Contact.between_spheres(sj.CHROME_STEEL, sj.NYLON, radius, radius)
        short = sj.Contact(*(np.asarray(x, np.float32) for x in exact.leaves().values()))
        for name in ("critical_overlap", "critical_velocity", "stiffness"):
            value = getattr(short, name)
            assert value.dtype == np.float32
            assert value == pytest.approx(getattr(exact, name), rel=2e-6), name


# ε² with its sign, and its jump at yield


def test_signed_restitution():
    """ε_p² + ε_up² - 1 of 40-digit ε_p², below zero too, where it has the slope of its loss."""
    records = [r for r in of_form("boxes", "first-order") if r["y"] > 1][:40]
    d, X, y = (column(records, name) for name in ("d", "X", "y"))
    law = law_with(d, X, sigma=np.full(40, 5.0), psi=np.full(40, 0.01))
    velocity = y * law.contact.critical_velocity

    def found(sigma):
        signed = sj.signed_restitution(law_with(d, X, sigma=sigma, psi=law.psi), velocity)
        return signed.squared, signed.status

    square, slope, status = jax.jit(
        lambda sigma: jax.jvp(found, (sigma,), (np.ones(40),), has_aux=True)
    )(law.sigma)
    ratio = (1 / (law.contact.limit_velocity / law.contact.critical_velocity - 1)) ** 0.01
    up = np.exp(-2 * 5.0 * ratio)
    exact = column(records, "eps_p_squared") + up - 1
    bound = 1e-12 + 8 * EPS * column(records, "log_sensitivity_sum")
    turned = (status & int(sj.Status.NO_TURNING_POINT)) == 0
    assert np.all(np.abs(square - exact)[turned] <= bound[turned])
    lost = turned & (exact < 0)
    assert np.sum(lost) > 20
    assert np.all(status[lost] & int(sj.Status.NO_REBOUND))
    assert np.allclose(slope[lost], (-2 * ratio * up)[lost], rtol=1e-9, atol=1e-12)


def test_which_laws_jump_at_yield_and_where():
    """ε² just above v_cr less that at it is 2d/3 of Zhou's law (Eqs. 8 and 12), and nothing of others."""
    law = fitted("chrome steel")
    pair, critical = law.contact, float(law.elastic_velocity())
    assert critical == pytest.approx(float(pair.critical_velocity), rel=1e-15)
    at = critical * np.array([1 - 1e-9, 1 + 1e-9])
    squared, status = sj.signed_restitution(law, at)
    d = 1.5 * float(pair.critical_overlap) / (np.pi ** (2 / 3) * float(pair.radius))
    assert squared[1] - squared[0] == pytest.approx(2 * d / 3, rel=1e-5)
    assert same_flags(status[0], sj.Status.ELASTIC)
    spring, hertz = sj.WaltonBraun(pair, 1e6, 2e6), sj.Hertz(pair)
    found = sj.signed_restitution(hertz, 1.0)
    assert found.squared == 1
    assert same_flags(found.status, sj.Status.ELASTIC)
    found = jax.jit(lambda v: sj.signed_restitution(spring, v))(np.array([1.0, np.nan]))
    assert found.squared == pytest.approx([0.5, 0.0], rel=1e-14)
    assert np.all(same_flags(found.status, [0, sj.Status.INVALID_INPUT]))
    assert sj.Zhou.jumps_at_yield
    assert not sj.Thornton(pair).jumps_at_yield
    assert np.isinf(hertz.elastic_velocity())
    assert spring.elastic_velocity() == 0
