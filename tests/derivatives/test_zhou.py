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
from tests.laws import graded

# of the contact and the law, and as the records call them
NAMES = {
    "youngs_modulus": "E",
    "radius": "R",
    "mass": "M",
    "yield_strength": "Y",
    "limit_velocity": "v_lim",
    "chi": "chi",
    "sigma": "sigma",
    "psi": "psi",
    "velocity": "v",
}
PROPERTIES = ("E", "nu", "rho", "Y", "R", "chi", "sigma", "psi", "v")  # of two equal spheres
PAIRED = ("chi", "sigma", "psi", "E", "Y", "v")
ODE = sj.ODE(rtol=1e-10)


@pytest.mark.parametrize(
    ("form", "route", "bound"),
    [
        pytest.param(
            "first-order", sj.EnergyBalance(), 1e-9, id="first-order-energy", marks=pytest.mark.long
        ),
        pytest.param("full", sj.EnergyBalance(), 1e-9, id="full-energy", marks=pytest.mark.long),
        pytest.param("first-order", ODE, 1e-6, id="first-order-ode"),
        pytest.param("full", ODE, 1e-6, id="full-ode", marks=pytest.mark.long),
    ],
)
def test_first_derivatives_over_the_curves(form, route, bound):
    """ε and both overlaps in all nine inputs, forward and reverse; at 75 velocities of three materials."""
    records = of_form("curves", form)
    values = {
        name: jnp.asarray(column(records, "inputs", symbol)) for name, symbol in NAMES.items()
    }
    values = dict(sorted(values.items()))
    *_, forward, reverse = graded(fitted("nylon", form), values, route)
    peak = column(records, "peak_overlap")
    below = np.array(["ELASTIC" in record["flags"] for record in records])
    assert 0 < np.sum(below) < len(below)
    for slopes in (forward, reverse):
        for name, slope in zip(values, np.asarray(slopes), strict=True):
            exact = [column(records, "log_sensitivities", NAMES[name], q) for q in QUANTITIES]
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
    pytest.param("full", jax.jacfwd),
    pytest.param("first-order", jax.jacfwd, marks=pytest.mark.long),
    pytest.param("full", jax.jacrev, marks=pytest.mark.long),
]


@pytest.mark.parametrize(("form", "derivative"), MODES)
def test_in_properties_of_a_material(form, derivative):
    """Through the contact of two equal spheres, whose radius does not matter to ε; nor by a wall."""
    records, choices, theta = material_inputs(form)

    def outputs(theta):
        law, v = equal_spheres(theta, choices)
        hit = sj.restitution(law, v)
        E, nu, rho, Y, R, chi, sigma, psi, v = theta
        body = sj.Material(E, nu, rho, Y)
        wall = sj.Contact.with_wall(body, wall=body, radius=R)
        beside = sj.restitution(sj.Zhou(wall, chi, sigma, psi, form=form), v)
        parts = (hit.coefficient, hit.peak_overlap, hit.residual_overlap, beside.coefficient)
        return jnp.stack(parts)

    found = compiled_soon(jax.vmap(derivative(outputs)))(theta)
    scale = column(records, "peak_overlap")
    for i, name in enumerate(PROPERTIES):
        scaled = np.asarray(found[:, :, i] * theta[:, i : i + 1])
        exact = [column(records, "log_sensitivities", name, q) for q in QUANTITIES]
        assert np.max(np.abs(scaled[:, 0] - exact[0])) <= 1e-9, name
        for k in (1, 2):
            assert np.max(np.abs(scaled[:, k] - exact[k]) / scale) <= 1e-7, (name, k)
        if name == "R":
            assert np.all(np.abs(scaled[:, [0, 3]]) <= 1e-13)
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


def test_second_derivatives_by_the_equation_of_motion():
    """Forward over forward at four fixed steps, to what they leave over."""
    law = fitted("stainless steel")

    def coefficient(v, route=None):
        return sj.restitution(law, v, route).coefficient

    def twice(f):
        slope = lambda v: jax.jvp(f, (v,), (1.0,))[1]  # noqa: E731
        return compiled_soon(lambda v: jax.jvp(slope, (v,), (1.0,))[1])(1.0)

    by_time = partial(coefficient, route=sj.ODE(steps=4, solver="dopri5"))
    assert twice(by_time) == pytest.approx(float(twice(coefficient)), rel=1e-2)


@pytest.mark.long
def test_reverse_over_reverse_by_the_equation_of_motion():
    law = fitted("stainless steel")
    twice = jax.grad(jax.grad(lambda v: sj.restitution(law, v, sj.ODE(steps=2)).coefficient))
    exact = jax.grad(jax.grad(lambda v: sj.restitution(law, v).coefficient))(1.0)
    assert twice(1.0) == pytest.approx(float(exact), rel=1e-2)


def test_overlaps_do_not_move_without_a_turning_point():
    """δ_max is where the law ends then: a number to look at, and no answer."""
    law = fitted("nylon")

    def overlaps(law, v):
        result = sj.restitution(law, v)
        return result.peak_overlap + result.residual_overlap

    slopes = compiled_soon(jax.grad(overlaps, (0, 1)))
    far, near = (slopes(law, y * law.contact.critical_velocity) for y in (2e3, 20.0))
    assert all(leaf == 0 for leaf in jax.tree.leaves(far))
    assert sum(leaf != 0 for leaf in jax.tree.leaves(near)) >= 5
