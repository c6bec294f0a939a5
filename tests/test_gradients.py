"""First and second derivatives against differences in high-precision arithmetic.

All as θ ∂ε/∂θ, in absolute terms: some are exactly zero.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import FORMS, RADIUS, column, compiled_soon, law_of, of_form, stacked_inputs

NAMES = ("E", "R", "M", "Y", "v_lim", "chi", "sigma", "psi", "v")
# of a material, which two equal spheres are made of
PROPERTIES = ("E", "nu", "rho", "Y", "R", "chi", "sigma", "psi", "v")
PAIRED = ("chi", "sigma", "psi", "E", "Y", "v")
ROUTES = [(sj.EnergyBalance(), 1e-9), (sj.ODE(rtol=1e-10), 1e-6)]


def curve_inputs(form):
    records = of_form("curves", form)
    inputs = stacked_inputs(records)
    numbers = {name: jnp.asarray(inputs.pop(name)) for name in NAMES}
    return records, inputs, numbers


def relative_jacobian(f, numbers, mode):
    """θ ∂f/∂θ by name, of an elementwise f of arrays by name."""
    if mode == "reverse":
        slopes = compiled_soon(jax.grad(lambda n: f(n).sum()))(numbers)
        return {name: slopes[name] * numbers[name] for name in numbers}
    push = compiled_soon(lambda n, t: jax.jvp(f, (n,), (t,))[1])
    rest = jax.tree.map(jnp.zeros_like, numbers)
    return {name: push(numbers, rest | {name: value}) for name, value in numbers.items()}


@pytest.mark.parametrize("mode", ["forward", "reverse"])
@pytest.mark.parametrize(
    ("form", "route", "bound"),
    [
        ("first-order", *ROUTES[0]),
        ("first-order", *ROUTES[1]),
        ("full", *ROUTES[0]),
        pytest.param("full", *ROUTES[1], marks=pytest.mark.long),
    ],
    ids=["first-order-energy", "first-order-ode", "full-energy", "full-ode"],
)
def test_first_derivatives(form, route, bound, mode):
    records, choices, numbers = curve_inputs(form)

    def coefficient(numbers):
        inputs = choices | numbers
        return sj.restitution(law_of(inputs), inputs["v"], route=route).coefficient

    found = relative_jacobian(coefficient, numbers, mode)
    for name in NAMES:
        expected = column(records, "log_sensitivities", name, "eps")
        assert np.max(np.abs(found[name] - expected)) <= bound, name
        zero = expected == 0
        assert np.all(np.abs(found[name][zero]) <= 1e-13), name
    below = numbers["v"] < law_of(choices | numbers).contact.critical_velocity
    assert np.any(below)
    for name in ("chi", "E", "R", "M", "Y"):
        assert np.all(found[name][below] == 0), name


def equal_spheres(theta, choices):
    """The law of two equal spheres and the velocity, from the vector of `PROPERTIES`."""
    E, nu, rho, Y, R, chi, sigma, psi, v = theta
    material = sj.Material(E, nu, rho, Y)
    contact = sj.Contact.between_spheres(material, material, R, R, area=choices["area"])
    return sj.Zhou(contact, chi, sigma, psi, form=choices["form"], kappa=choices["kappa"]), v


def outputs(theta, choices, route=None):
    """ε, δ* and δ_max of one impact."""
    law, v = equal_spheres(theta, choices)
    result = sj.restitution(law, v, route=route)
    overlaps = jnp.stack([result.residual_overlap, result.peak_overlap])
    return jnp.concatenate([result.coefficient[None], overlaps])


def material_inputs(form):
    records = of_form("materials", form)
    inputs = stacked_inputs(records)
    theta = jnp.stack([jnp.asarray(inputs[name]) for name in PROPERTIES], -1)
    return records, inputs, theta


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_radius_of_equal_spheres_does_not_matter(derivative):
    """∂ε/∂R = 0 for two equal spheres, and for a wall."""
    _, choices, theta = material_inputs("first-order")

    def coefficients(radius, theta):
        E, nu, rho, Y, _, chi, sigma, psi, v = theta
        material = sj.Material(E, nu, rho, Y)
        wall = sj.Contact.with_wall(material, wall=material, radius=radius)
        law, v = equal_spheres(theta.at[4].set(radius), choices)
        laws = (sj.Zhou(wall, chi, sigma, psi), law)
        return jnp.stack([sj.restitution(law, v).coefficient for law in laws])

    radii = jnp.full(len(theta), RADIUS)
    slopes = compiled_soon(jax.vmap(derivative(coefficients)))(radii, theta)
    assert slopes.shape == (len(theta), 2)
    assert np.all(np.abs(slopes * RADIUS) <= 1e-13)


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
@pytest.mark.parametrize("form", FORMS)
def test_derivatives_of_the_overlaps(form, derivative):
    """∂ε, ∂δ* and ∂δ_max with respect to properties of the material."""
    records, choices, theta = material_inputs(form)
    found = compiled_soon(jax.vmap(derivative(lambda t: outputs(t, choices))))(theta)
    scale = column(records, "peak_overlap")
    for i, name in enumerate(PROPERTIES):
        scaled = found[:, :, i] * theta[:, i : i + 1]
        coefficient = column(records, "log_sensitivities", name, "eps")
        assert np.max(np.abs(scaled[:, 0] - coefficient)) <= 1e-9, name
        for k, quantity in ((1, "residual_overlap"), (2, "peak_overlap")):
            expected = column(records, "log_sensitivities", name, quantity)
            assert np.max(np.abs(scaled[:, k] - expected) / scale) <= 1e-7, (name, quantity)


SECOND = {
    "forward over forward": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "forward over reverse": lambda f: jax.jacfwd(jax.jacrev(f)),
    "reverse over forward": lambda f: jax.jacrev(jax.jacfwd(f)),
    "reverse over reverse": lambda f: jax.jacrev(jax.jacrev(f)),
}


@pytest.mark.parametrize(
    ("form", "order"),
    [
        ("first-order", "forward over reverse"),
        ("first-order", "reverse over forward"),
        ("full", "forward over reverse"),
        pytest.param("first-order", "forward over forward", marks=pytest.mark.long),
        pytest.param("first-order", "reverse over reverse", marks=pytest.mark.long),
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
    unfused = {"xla_disable_hlo_passes": "fusion"}
    found = jax.jit(jax.vmap(SECOND[order](f)), compiler_options=unfused)(part, theta)
    scale = column(records, "peak_overlap")
    for pair in records[0]["second"]:
        i, j = (PAIRED.index(name) for name in pair.split(","))
        scaled = found[:, :, i, j] * (part[:, i] * part[:, j])[:, None]
        coefficient = column(records, "second", pair, "eps")
        assert np.max(np.abs(scaled[:, 0] - coefficient)) <= 1e-7, pair
        residual = column(records, "second", pair, "residual_overlap")
        assert np.max(np.abs(scaled[:, 1] - residual) / scale) <= 1e-7, pair


def test_the_trap_of_a_frozen_root():
    """y² ∂²ε_p²/∂y² for nylon at y = 40 is 0.036, and 1.49 by one step on a frozen root."""
    law = sj.Zhou(_nylon_pair(), chi=0.21998, sigma=0.4355, psi=0.5414)

    def squared(y):
        velocity = y * law.contact.critical_velocity
        return sj.restitution(law, velocity).plastic_coefficient ** 2

    second = jax.jit(jax.grad(jax.grad(squared)))
    assert 40**2 * float(second(40.0)) == pytest.approx(0.036, abs=5e-4)


def _nylon_pair():
    return sj.Contact.between_spheres(sj.NYLON, sj.NYLON, RADIUS, RADIUS)
