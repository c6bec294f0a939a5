"""What each impact tells, and the covariance that a set of impacts gives, for either objective.

In relative terms: θ ∂ε/∂θ, so that a covariance is that of ln χ̃, ln σ, ln ψ.

`model`: least squares of the whole model, with u_i the standard uncertainty of ε_i,

    C = (Σ b_i b_iᵀ/u_i²)⁻¹,    b_i = ∂m(v_i)/∂ ln(χ̃, σ, ψ)

Where all impacts are above yield, σ and ψ act through ε_up = ε_17(v_cr) alone (Eq. 16), and the
parameters are χ̃ and ε_up.

`two-step`: Eq. (17) fitted for σ and ψ, then the model for χ̃ with the ε_up that they give. The
same noise enters both, so the two sets of estimating equations are stacked. With
a_i = ∂ε_17(v_i)/∂ ln(σ, ψ),

    C = A⁻¹ (Σ g_i g_iᵀ/u_i²) A⁻ᵀ,    g_i = (a_i, b_i,χ̃)

    A = Σ 1/u_i² [ a_i a_iᵀ          0      ]
                 [ b_i,χ̃ b_i,σψᵀ    b_i,χ̃² ]

Expected values: at the estimate the residuals' mean is taken as zero, so that no curvature enters.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import softjax as sj
from calibration.sensitivities.inputs import padded

OBJECTIVES = ("two-step", "model")
THREE = ("chi", "sigma", "psi")
ABOVE_YIELD = ("chi", "eps_up")
ALMOST_NOTHING = 1e-6  # prior information on each ln θ: known to a factor e^1000 beforehand


class Rows(NamedTuple):
    """Slopes of each of n impacts, per relative change of a parameter."""

    model: Float[Array, "n 3"]  # of the model in χ̃, σ, ψ
    empirical: Float[Array, "n 2"]  # of Eq. (17) in σ, ψ
    eps_up: Float[Array, " n"]  # of the model in ε_up


def slopes(law: sj.Zhou, velocity: Float[np.ndarray, " n"], route=None) -> Rows:
    """What moves ε at each velocity."""
    velocity = np.asarray(velocity, float)
    rows = padded_slopes(law, padded(velocity), route)
    return jax.tree.map(lambda row: np.asarray(row)[: len(velocity)], rows)


def slopes_and_change(law: sj.Zhou, velocity: Float[np.ndarray, " n"]) -> tuple[Rows, Rows]:
    """The same, and its derivative in each impact's velocity."""
    velocity = np.asarray(velocity, float)
    both = _with_change(law, padded(velocity))
    return jax.tree.map(lambda row: np.asarray(row)[: len(velocity)], both)


@jax.jit
def _with_change(law, velocity):
    # each impact's slopes depend on its own velocity alone
    along = jnp.ones_like(velocity)
    return jax.jvp(lambda v: padded_slopes(law, v), (velocity,), (along,))


@partial(jax.jit, static_argnames="route")
def padded_slopes(law: sj.Zhou, velocity: Float[Array, " n"], route=None) -> Rows:
    """`slopes` as JAX traces it; differentiable once more in the velocity."""

    def curves(s):
        moved = _moved(law, s)
        hit = sj.restitution(moved, velocity, route=route)
        limit = law.contact.limit_velocity
        own = sj.empirical_restitution(velocity, limit, moved.sigma, moved.psi)
        return (hit.coefficient, own), hit.coefficient

    (model, empirical), coefficient = jax.jacfwd(curves, has_aux=True)(jnp.zeros(3))
    answered = coefficient > 0
    # Eq. (16): ε dε = ε_up dε_up
    up = jnp.where(answered, eps_up(law) ** 2 / jnp.where(answered, coefficient, 1.0), 0.0)
    above = velocity > law.contact.critical_velocity
    return Rows(model, empirical[:, 1:], jnp.where(above, up, 0.0))


def eps_up(law: sj.Zhou):
    """What sound and heat leave at v_cr, Eq. (17)."""
    contact = law.contact
    return sj.empirical_restitution(
        contact.critical_velocity, contact.limit_velocity, law.sigma, law.psi
    )


def parameters_of(objective: str, law: sj.Zhou, lowest_velocity: float) -> tuple[str, ...]:
    """What the objective fits to impacts of which this is the slowest."""
    above = lowest_velocity > float(law.contact.critical_velocity)
    return ABOVE_YIELD if objective == "model" and above else THREE


def summed(rows: Rows, weight, parameters: tuple[str, ...], objective: str) -> tuple[Array, Array]:
    """A and the middle matrix of the objective, in the order of `parameters`."""
    if objective == "model":
        b = rows.model if parameters == THREE else jnp.stack([rows.model[:, 0], rows.eps_up], -1)
        information = (b * weight[:, None]).T @ b
        return information, information
    g = jnp.concatenate([rows.model[:, :1], rows.empirical], axis=-1)
    middle = (g * weight[:, None]).T @ g
    second_step = (rows.model[:, :1] * weight[:, None]).T @ rows.model
    first_step = jnp.concatenate([jnp.zeros((2, 1)), middle[1:, 1:]], axis=1)
    return jnp.concatenate([second_step, first_step]), middle


def covariance(slope, middle, ridge: float = ALMOST_NOTHING) -> Array:
    """A⁻¹ (middle) A⁻ᵀ, kept finite by next to no prior information where the data tell nothing."""
    prior = ridge * jnp.eye(slope.shape[0])
    half = jnp.linalg.solve(slope + prior, middle + prior)
    return jnp.linalg.solve(slope + prior, half.T)


def _moved(law: sj.Zhou, s) -> sj.Zhou:
    """χ̃ (1 + s₀), σ (1 + s₁), ψ (1 + s₂)."""
    own = (law.chi, law.sigma, law.psi)
    moved = [value * (1 + step) for value, step in zip(own, s, strict=True)]
    return sj.Zhou(law.contact, *moved, form=law.form, kappa=law.kappa)
