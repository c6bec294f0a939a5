"""Zhou's law: first and second derivatives against differences in high-precision arithmetic.

All as θ ∂q/∂θ, in absolute terms: some are exactly zero.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import FORMS, RADIUS, column, compiled_soon, fitted, of_form, stacked_inputs
from tests.laws import LAWS, SYMBOLS, graded, of_records, repeated

PROPERTIES = ("E", "nu", "rho", "Y", "R", "chi", "sigma", "psi", "v")  # of two equal spheres
PAIRED = ("chi", "sigma", "psi", "E", "Y", "v")
ODE = sj.ODE(rtol=1e-10)


@pytest.mark.parametrize(
    ("form", "route", "bound"),
    [
        pytest.param("first-order", sj.EnergyBalance(), 1e-9, id="first-order-energy"),
        pytest.param("full", sj.EnergyBalance(), 1e-9, id="full-energy"),
        pytest.param("first-order", ODE, 1e-6, id="first-order-ode"),
        pytest.param("full", ODE, 1e-6, id="full-ode", marks=pytest.mark.long),
    ],
)
def test_first_derivatives_over_the_curves(form, route, bound):
    """ε and both overlaps in all nine inputs, forward and reverse; at 75 velocities of three materials."""
    records = of_form("curves", form)
    values = of_records(records)
    *_, forward, reverse = graded(fitted("nylon", form), values, route)
    peak = column(records, "peak_overlap")
    below = np.array(["ELASTIC" in record["flags"] for record in records])
    assert 0 < np.sum(below) < len(below)
    for slopes in (forward, reverse):
        for name, slope in zip(values, np.asarray(slopes), strict=True):
            exact = [column(records, "log_sensitivities", SYMBOLS[name], q) for q in QUANTITIES]
            assert np.max(np.abs(slope[0] - exact[0])) <= bound, name
            assert np.all(np.abs(slope[0][exact[0] == 0]) <= 1e-13), name
            assert np.max(np.abs(slope[1] - exact[1]) / peak) <= 100 * bound, name
            assert np.max(np.abs(slope[2] - exact[2]) / peak) <= 100 * bound, name
            if name not in ("limit_velocity", "sigma", "psi", "velocity"):
                assert np.all(slope[0][below] == 0), name


QUANTITIES = ("eps", "peak_overlap", "residual_overlap")


def equal_spheres(theta, choices):
    """The law of two equal spheres and the velocity, from the vector of `PROPERTIES`."""
    E, nu, rho, Y, R, chi, sigma, psi, v = theta
    material = sj.Material(E, nu, rho, Y)
    contact = sj.Contact.between_spheres(material, material, R, R, area=choices["area"])
    return sj.Zhou(contact, chi, sigma, psi, form=choices["form"], kappa=choices["kappa"]), v


def material_inputs(form):
    records = of_form("materials", form)
    inputs = stacked_inputs(records)
    theta = jnp.stack([jnp.asarray(inputs[name]) for name in PROPERTIES], -1)
    return records, inputs, theta


MODES = [
    pytest.param("first-order", jax.jacrev),
    *(pytest.param("full", mode, marks=pytest.mark.long) for mode in (jax.jacfwd, jax.jacrev)),
    pytest.param("first-order", jax.jacfwd, marks=pytest.mark.long),
]


@pytest.mark.parametrize(("form", "derivative"), MODES)
def test_in_properties_of_a_material(form, derivative):
    """Through the contact of two equal spheres, whose radius does not matter to ε."""
    records, choices, theta = material_inputs(form)

    def outputs(theta):
        law, v = equal_spheres(theta, choices)
        hit = sj.restitution(law, v)
        return jnp.stack([hit.coefficient, hit.peak_overlap, hit.residual_overlap])

    found = compiled_soon(jax.vmap(derivative(outputs)))(theta)
    scale = column(records, "peak_overlap")
    for i, name in enumerate(PROPERTIES):
        scaled = np.asarray(found[:, :, i] * theta[:, i : i + 1])
        exact = [column(records, "log_sensitivities", name, q) for q in QUANTITIES]
        assert np.max(np.abs(scaled[:, 0] - exact[0])) <= 1e-9, name
        for k in (1, 2):
            assert np.max(np.abs(scaled[:, k] - exact[k]) / scale) <= 1e-7, (name, k)
        if name == "R":
            assert np.all(np.abs(scaled[:, 0]) <= 1e-13)
    assert np.all(theta[:, PROPERTIES.index("R")] == RADIUS)


SECOND = {
    "forward over forward": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "forward over reverse": lambda f: jax.jacfwd(jax.jacrev(f)),
    "reverse over forward": lambda f: jax.jacrev(jax.jacfwd(f)),
    "reverse over reverse": lambda f: jax.jacrev(jax.jacrev(f)),
}
QUICK = [("first-order", "forward over reverse")]


@pytest.mark.parametrize(
    ("form", "order"),
    [
        pytest.param(form, order, marks=() if (form, order) in QUICK else pytest.mark.long)
        for form in FORMS
        for order in SECOND
    ],
)
def test_second_derivatives(form, order):
    """One Newton step on a frozen root would give first derivatives right and these wrong."""
    records, choices, theta = material_inputs(form)

    def f(part, theta):
        law, v = equal_spheres(theta.at[jnp.asarray(index)].set(part), choices)
        result = sj.restitution(law, v)
        return jnp.stack([result.coefficient, result.residual_overlap])

    index = [PROPERTIES.index(name) for name in PAIRED]
    part = theta[:, jnp.asarray(index)]
    # without fusion these compile four times faster; the sums are the same
    compiled = partial(jax.jit, compiler_options={"xla_disable_hlo_passes": "fusion"})
    found = compiled(jax.vmap(SECOND[order](f)))(part, theta)
    scale = column(records, "peak_overlap")
    for pair in records[0]["second"]:
        i, j = (PAIRED.index(name) for name in pair.split(","))
        scaled = found[:, :, i, j] * (part[:, i] * part[:, j])[:, None]
        exact = [column(records, "second", pair, q) for q in ("eps", "residual_overlap")]
        assert np.max(np.abs(scaled[:, 0] - exact[0])) <= 1e-7, pair
        assert np.max(np.abs(scaled[:, 1] - exact[1]) / scale) <= 1e-7, pair


@pytest.mark.parametrize(
    "mode", ["forward over forward", pytest.param("reverse over reverse", marks=pytest.mark.long)]
)
def test_second_derivatives_by_the_equation_of_motion(mode):
    """Of a spring that unloads the more steeply the deeper: ε = √(k1/(k2 + s v √(k1 M)))."""
    law, v = LAWS["walton-braun"].law, 1.0

    def coefficient(v):
        return sj.restitution(law, v, sj.ODE(steps=4, solver="dopri5")).coefficient

    found = compiled_soon(SECOND[mode](coefficient))(v)
    steep = law.growth * np.sqrt(law.loading_stiffness * law.contact.mass)
    exact = (
        0.75 * law.loading_stiffness**0.5 * steep**2 / (law.unloading_stiffness + steep * v) ** 2.5
    )
    assert found == pytest.approx(exact, rel=1e-2)


def test_overlaps_do_not_move_without_a_turning_point():
    """δ_max is where the law ends then: a number to look at, and no answer."""
    law = fitted("nylon")
    velocity = np.array([2e3, 20.0]) * law.contact.critical_velocity
    *_, forward, reverse = graded(law, repeated(law, velocity))
    for slopes in (forward, reverse):
        assert np.all(slopes[:, 1:3, 0] == 0)
        assert np.sum(np.any(slopes[:, 1:3, 1] != 0, axis=1)) >= 5
