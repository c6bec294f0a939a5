"""The energy balance against 40-digit arithmetic."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from softjax import assembly
from softjax.laws.zhou import FirstOrder, Full
from tests.cases import (
    EPS,
    FORMS,
    collide,
    column,
    fitted,
    flags_of,
    law_of,
    law_with,
    of_form,
    stacked_inputs,
)
from tests.oracles import zhou_mp

NUMBERS = ("E", "R", "M", "Y", "v_lim", "chi", "sigma", "psi", "v")
REDUCED = {"first-order": FirstOrder, "full": Full}


def boxes(form):
    """d, X, y and the records: E/Y 20…1000, X 0.3…3000, y 0…300."""
    records = of_form("boxes", form)
    return *(column(records, name) for name in ("d", "X", "y")), records


def bound(records):
    """What rounding of the inputs alone may cost: 1e-12 + 8 eps Σ|∂ε_p²/∂ln θ|."""
    return 1e-12 + 8 * EPS * column(records, "log_sensitivity_sum")


@pytest.mark.parametrize("form", FORMS)
def test_plastic_restitution_over_the_box(form):
    d, X, y, records = boxes(form)
    law = law_with(d, X, form)
    result = sj.restitution(law, y * law.contact.critical_velocity)
    error = np.square(result.plastic_coefficient) - column(records, "eps_p_squared")
    assert np.all(np.abs(error) <= bound(records))
    assert len(records) == 150


@pytest.mark.parametrize("form", FORMS)
def test_status_over_the_box(form):
    d, X, y, records = boxes(form)
    law = law_with(d, X, form)
    result = sj.restitution(law, y * law.contact.critical_velocity)
    assert np.array_equal(result.status, flags_of(records))


@pytest.mark.parametrize("form", FORMS)
def test_reduced_collisions_over_the_box(form):
    """The same without SI units between: overlaps to their own conditioning, ε_p² to 1e-13."""
    d, X, y, records = boxes(form)
    yields = y > 1
    law = REDUCED[form](jnp.asarray(d[yields]), jnp.asarray(X[yields]))
    outcome = collide(law, jnp.asarray(y[yields]))
    sensitivity = column(records, "log_sensitivity_sum")[yields]
    error = outcome.plastic_squared - column(records, "eps_p_squared")[yields]
    assert np.all(np.abs(error) <= 1e-13 + 8 * EPS * sensitivity)
    assert np.allclose(outcome.peak, column(records, "x_m")[yields], rtol=1e-13, atol=0)
    assert np.allclose(outcome.residual, column(records, "x_star")[yields], rtol=1e-11, atol=0)


@pytest.mark.parametrize("form", FORMS)
def test_duration_over_the_box(form):
    d, X, y, records = boxes(form)
    law = law_with(d, X, form)
    result = sj.restitution(law, y * law.contact.critical_velocity)
    expected = column(records, "duration")
    ends = np.isfinite(expected)
    scaled = result.duration / law.scales().time
    assert np.allclose(scaled[ends], expected[ends], rtol=1e-8, atol=0)
    # at rest and without a turning point there is no contact that ends
    assert np.all(result.duration[~ends] == 0)
    assert not np.all(ends)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("material", ["stainless steel", "chrome steel", "nylon"])
def test_curves_of_the_materials(form, material):
    records = [r for r in of_form("curves", form) if r["material"] == material]
    inputs = stacked_inputs(records)
    result = sj.restitution(law_of(inputs), inputs["v"])
    assert np.allclose(result.coefficient, column(records, "eps"), rtol=0, atol=1e-13)
    assert np.allclose(result.plastic_coefficient, column(records, "eps_p"), rtol=0, atol=1e-13)
    assert np.allclose(result.peak_overlap, column(records, "peak_overlap"), rtol=1e-12, atol=0)
    error = np.abs(result.residual_overlap - column(records, "residual_overlap"))
    # just above yield x* moves much with y, and so with the rounding of the inputs
    slopes = [column(records, "log_sensitivities", name, "residual_overlap") for name in NUMBERS]
    assert np.all(error <= 1e-13 * result.peak_overlap + 8 * EPS * np.sum(np.abs(slopes), 0))
    assert np.allclose(result.duration, column(records, "duration"), rtol=1e-8, atol=0)
    assert np.array_equal(result.status, flags_of(records))


# form, d, X, y: x_m, x*, ε_p from other code in 40-digit arithmetic
ORIENTATION = [
    ("first-order", 6.3e-5, 640, 1.5, 1.38316264536192, 0.104851623761796, 0.98707820496367),
    ("first-order", 6.3e-5, 640, 250, 82.9694609992926, 31.1455251233123, 0.856206183529395),
    ("full", 6.3e-5, 640, 250, 82.9693766512144, 31.1454180489435, 0.856207589426904),
    ("first-order", 2.7e-3, 5.36, 25, 13.2236523303197, 1.49310978562765, 0.973077876160826),
    ("full", 2.7e-3, 5.36, 25, 13.2230226169831, 1.49283613455876, 0.9731302040906),
    ("first-order", 6.73e-3, 7.6, 80, 35.3103668464788, 12.3395408865264, 0.841650713075325),
    ("full", 6.73e-3, 7.6, 80, 35.2174790268749, 12.2244525276861, 0.84545462322109),
    ("first-order", 6.73e-3, 0.55, 40, 19.6850448643677, 0.0, 0.995388270881036),
]


@pytest.mark.parametrize("form", FORMS)
def test_orientation_values(form):
    numbers = np.array([case[1:] for case in ORIENTATION if case[0] == form])
    d, X, y, *expected = jnp.asarray(numbers).T
    outcome = collide(REDUCED[form](d, X), y)
    found = (outcome.peak, outcome.residual, jnp.sqrt(outcome.plastic_squared))
    assert np.allclose(found, expected, rtol=1e-13, atol=0)


def test_elastic_duration():
    """T v/δ_max = 2.9432751843, Hertz's."""
    law = fitted("nylon")
    velocity = law.contact.critical_velocity * np.array([1e-6, 0.3, 1.0])
    result = sj.restitution(law, velocity)
    assert np.allclose(
        result.duration * velocity / result.peak_overlap, 2.9432751843, rtol=5e-11, atol=0
    )


@pytest.mark.parametrize("form", FORMS)
def test_duration_just_above_yield(form):
    """Loading beyond yield is then short, and the works of both its ends are nearly the same."""
    y = 1 + np.array([EPS, 1e-14, 1e-12, 1e-10, 1e-8, 1e-5, 1e-3, 0.03, 0.06, 0.1])
    d, X = 0.0067, 7.6
    law = REDUCED[form](jnp.asarray(d), jnp.asarray(X))
    lasts = jax.jit(lambda y: assembly.duration(sj.Reduced(law, None, y), sj.EnergyBalance())[0])
    found = lasts(jnp.asarray(y))
    expected = np.array([float(zhou_mp.duration(form, d, X, value)) for value in y])
    # the yielded branch of a collision one number above yield is as long as √eps
    assert found[0] == pytest.approx(expected[0], rel=1e-8)
    assert np.allclose(found[1:], expected[1:], rtol=1e-10, atol=0)


@pytest.mark.parametrize("form", ["first-order", pytest.param("full", marks=pytest.mark.long)])
@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.long)])
def test_critical_velocity_is_elastic_and_the_next_number_is_not(form, dtype):
    """Whether the law's numbers are arguments of the compiled function or constants in it."""
    ratio, radius = np.meshgrid(np.geomspace(2, 1e6, 20), np.geomspace(1e-9, 1e3, 20))
    modulus = np.geomspace(1e8, 1e12, 400).reshape(20, 20)
    mass = 3e4 * radius**3
    fields = (modulus, radius, mass, modulus / ratio, 1e9)
    contact = sj.Contact(*(np.asarray(field, dtype) for field in fields))
    half = np.asarray(0.5, dtype)
    law = sj.Zhou(contact, half, half, half, form=form)
    at = contact.critical_velocity
    assert at.dtype == dtype
    around = np.stack([np.nextafter(at, dtype(0)), at, np.nextafter(at, dtype(1e9))])
    for compute in (lambda v: sj.restitution(law, v), jax.jit(lambda v: sj.restitution(law, v))):
        elastic = np.asarray(compute(around).status) & int(sj.Status.ELASTIC) > 0
        assert np.array_equal(np.all(elastic, axis=(1, 2)), [True, True, False])
        assert not np.any(elastic[2])


@pytest.mark.parametrize("form", FORMS)
def test_an_elastic_batch_and_a_mixed_one_agree(form):
    """A scene known to be elastic throughout takes another path to the same numbers."""
    law = fitted("chrome steel", form)
    low = law.contact.critical_velocity * np.array([0.0, 0.2, 0.9])
    mixed = sj.restitution(law, np.append(low, 3 * law.contact.critical_velocity))
    alone = sj.restitution(law, low)
    for name in ("coefficient", "peak_overlap", "residual_overlap", "status", "duration"):
        assert np.allclose(getattr(alone, name), getattr(mixed, name)[:3], rtol=1e-15, atol=0), name
