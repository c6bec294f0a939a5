"""What is sampled in place of z: straightened along the valley of σ and ψ, and scaled by the fit.

Points tell σ and ψ together, as the loss at some velocity: λ = -ln ε_17(v*) = σ [v*/(v_lim - v*)]^ψ, at
the critical velocity v* of Zhou's law (it is -ln ε_up), at the middle of the data's velocities of
Eq. (17). In place of ln σ is sampled q with

    λ = s ln(1 + e^q),     ln |∂z/∂q| = ln |∂ ln λ/∂q|

s the error of a loss: where the loss shows, the likelihood is nearly normal in λ, and q ≈ λ/s; where it
does not, all is level down to λ = 0, and q = ln λ/s. Then q = centre + L u with L Lᵀ the covariance
that the fit and the priors give, so that u is nearly standard normal.

Source: Betancourt and Girolami, Hamiltonian Monte Carlo for Hierarchical Models (2013), of why.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

import softjax as sj
from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.pooling import Seen, seen_by_pool
from calibration.fitting.posterior.priors import Around, Priors
from calibration.fitting.problem import Pool
from calibration.fitting.traceable import Traceable
from calibration.fitting.transform import LOG, Transform

MOST = 3.0  # standard deviations of the prior that a chain starts from its centre at most
CENTRED = 2.0  # spread over the error of a member, from which on members are sampled themselves
SHOWS = 5.0  # errors of a loss, from which on it is no question whether there is one
UNSEEN = -30.0  # q below which ln(1 + e^q) is e^q


class Scaling(NamedTuple):
    """q = centre + root u; `loss`: s of each valley."""

    centre: Float[np.ndarray, "p"]
    root: Float[np.ndarray, "p p"]
    loss: Float[np.ndarray, "k"]


@dataclass(frozen=True)
class Straight:
    """The map from what is sampled to z: of the valleys, then of pools without a centre.

    A member of a pool that its data tell less than the pool does is sampled as (z_g - μ)/τ.
    """

    valleys: "Valleys"
    pools: tuple[Around, ...] = ()

    def has_corners(self, centre: Float[np.ndarray, "p"]) -> bool:
        """Whether a loss may be none, or a spread: there the density turns from steep to level."""
        return bool(self.pools) or bool(np.any(centre[self.valleys.sigma] < SHOWS))

    def z(self, q: Any, loss: Any) -> tuple[Any, Any]:
        """With ln |∂z/∂q|; in JAX."""
        log_slope = 0.0
        for pool in self.pools:
            of_spread = q[pool.spread]
            members = q[pool.mean] + jnp.exp(of_spread) * q[pool.members]
            q = q.at[pool.members].set(members)
            log_slope += len(pool.members) * of_spread
        z, of_valleys = self.valleys.z(q, loss)
        return z, log_slope + of_valleys

    def q(self, z: Any, loss: Any) -> Any:
        """The inverse."""
        q = self.valleys.q(z, loss)
        for pool in self.pools:
            members = (q[pool.members] - q[pool.mean]) * jnp.exp(-q[pool.spread])
            q = q.at[pool.members].set(members)
        return q


@dataclass(frozen=True)
class Valleys:
    """Where ln σ is sampled as the loss at a velocity.

    Attributes:
        sigma, psi: their places in z.
        level: ln[v*/(v_lim - v*)] of each.
        sets: the data set that each is looked at for.
    """

    sigma: Int[np.ndarray, "k"]
    psi: Int[np.ndarray, "k"]
    level: Float[np.ndarray, "k"]
    sets: tuple[int, ...]
    transform: Transform

    def z(self, q: Any, loss: Any) -> tuple[Any, Any]:
        """From what is sampled, with ln |∂z/∂q|; in JAX."""
        psi = self.transform.physical(q, jnp)[self.psi]
        at = q[self.sigma]
        seen = jax.nn.softplus(jnp.maximum(at, UNSEEN))
        log_loss = jnp.where(at > UNSEEN, jnp.log(seen), at)
        slope = jnp.where(at > UNSEEN, jnp.log(jax.nn.sigmoid(jnp.maximum(at, UNSEEN)) / seen), 0.0)
        log_sigma = log_loss + jnp.log(loss) - psi * self.level
        return q.at[self.sigma].set(log_sigma), jnp.sum(slope)

    def q(self, z: Any, loss: Any) -> Any:
        """The inverse."""
        psi = self.transform.physical(z, jnp)[self.psi]
        ratio = jnp.exp(jnp.clip(z[self.sigma] + psi * self.level - jnp.log(loss), -690.0, 690.0))
        return z.at[self.sigma].set(ratio + jnp.log(-jnp.expm1(-ratio)))


def valleys_of(problem: Traceable, transform: Transform) -> Valleys:
    """Of each pair of σ and ψ that are free together."""
    found: dict[int, tuple[int, float, int]] = {}
    for component in problem.components:
        for g, spec in zip(component.sets, component.specs, strict=True):
            own = [e for e in component.elements if g in e.sets and not e.parameter.pooled]
            labels = {e.name: e.label for e in own}
            if not {"sigma", "psi"} <= set(labels):
                continue
            level = _level(problem.law(problem.start, g), spec.data.velocity)
            sigma, psi = (problem.names.index(labels[name]) for name in ("sigma", "psi"))
            if level is not None and transform.kind[sigma] == LOG and transform.lower[sigma] == 0:
                found.setdefault(sigma, (psi, level, g))
    every = list(found.values())
    return Valleys(
        np.array(list(found), int),
        np.array([psi for psi, _, _ in every], int),
        np.array([level for _, level, _ in every]),
        tuple(g for _, _, g in every),
        transform,
    )


def _level(law: sj.ContactLaw, velocity: np.ndarray) -> float | None:
    """ln[v*/(v_lim - v*)]; None for a law without Eq. (17)."""
    if isinstance(law, sj.Zhou):
        limit, at = law.contact.limit_velocity, law.contact.critical_velocity
    elif isinstance(law, sj.EmpiricalRestitution):
        limit, at = law.limit_velocity, np.exp(np.mean(np.log(velocity)))
    else:
        return None
    limit, at = float(np.mean(limit)), float(np.mean(at))
    return float(np.log(at / (limit - at))) if 0 < at < limit else None


def straight_of(fits: Sequence[ComponentFit], problem: Traceable, priors: Priors) -> Straight:
    """With the pools whose members are better sampled as how far they are from the mean."""
    found = [
        around
        for around, (_, seen) in zip(priors.pools, _pools(fits, problem), strict=True)
        if _spread(seen) < CENTRED * seen.error
    ]
    return Straight(valleys_of(problem, priors.transform), tuple(found))


def scaling_of(
    fits: Sequence[ComponentFit], problem: Traceable, priors: Priors, straight: Straight
) -> Scaling:
    """Where the fit ended, and the covariance that its Jacobian and the priors give."""
    z, precision = _of_fits(fits, problem, priors)
    loss = np.array([_error_of_loss(fits, g) for g in straight.valleys.sets])
    with jax.enable_x64(True):
        centre = np.asarray(straight.q(jnp.asarray(z), loss))
        slopes = np.asarray(jax.jacfwd(lambda q: straight.z(q, loss)[0])(jnp.asarray(centre)))
    covariance = np.linalg.inv(slopes.T @ precision @ slopes)
    root = np.linalg.cholesky(0.5 * (covariance + covariance.T))
    return Scaling(centre, root, loss)


def _error_of_loss(fits: Sequence[ComponentFit], g: int) -> float:
    """Of the mean of all points of a data set."""
    for fit in fits:
        if g in fit.component.sets:
            points = fit.final.problem.points.set == fit.component.sets.index(g)
            deviation = fit.uncertainty.noise.deviation[0, points]
            return max(float(np.sum(deviation**-2.0) ** -0.5), 1e-9)
    raise AssertionError("every data set belongs to a component")


def _of_fits(fits, problem: Traceable, priors: Priors):
    """z of the fit within the priors' reach, and JᵀJ with what the priors add."""
    places = {one.label: k for k, one in enumerate(priors.each)}
    theta = np.array([_centre(one, priors.transform, k) for k, one in enumerate(priors.each)])
    every = []
    for fit in fits:
        own = [places[e.label] for e in fit.component.elements]
        theta[own] = fit.theta
        every.append((own, fit))
    for label, value, _ in _noises(fits, problem):
        theta[places[label]] = value
    z = priors.transform.unconstrained(theta)
    pools = list(zip(priors.pools, _pools(fits, problem), strict=True))
    for around, (_, seen) in pools:
        spread = _spread(seen)
        z[around.mean], z[around.spread] = seen.mean(spread)[0], np.log(spread)
    z = _within(priors, z)
    precision = np.diag(priors.spread_in_z(z) ** -2.0)
    for around, _ in pools:
        _add_pool(precision, around, np.exp(z[around.spread]))
    slope = priors.transform.slope(z)
    for own, fit in every:
        jacobian = _of_theta(fit) * slope[own]
        precision[np.ix_(own, own)] += jacobian.T @ jacobian
    for label, _, count in _noises(fits, problem):
        precision[places[label], places[label]] += 2.0 * count
    return z, precision


def _add_pool(precision: np.ndarray, around: Around, spread: float) -> None:
    """What a pool tells of its members, their mean and its spread."""
    members, count = around.members, len(around.members)
    precision[members, members] += spread**-2.0
    precision[members, around.mean] -= spread**-2.0
    precision[around.mean, members] -= spread**-2.0
    precision[around.mean, around.mean] += count * spread**-2.0
    precision[around.spread, around.spread] += count


def _pools(fits: Sequence[ComponentFit], problem: Traceable) -> list[tuple[Pool, Seen]]:
    """What the data tell of each pool of the fit, in the problem's order."""
    found = {
        pool.name: (pool, seen_by_pool(fit.final.problem, fit.z, pool))
        for fit in fits
        for pool in fit.final.problem.pools
    }
    return [found[pool.name] for pool in problem.pools]


def _spread(seen: Seen) -> float:
    """That of the restricted likelihood, or where that is none what would hardly show."""
    return max(seen.spread, 0.3 * seen.error)


def _centre(prior, transform: Transform, k: int) -> float:
    """In physical units: where a noise that the fit does not tell starts."""
    if prior.in_z:
        return float(transform.part(np.array([k])).physical(np.array([prior.centre]))[0])
    return prior.centre or (0.3 * prior.spread if np.isfinite(prior.spread) else 0.5)


def _within(priors: Priors, z: np.ndarray) -> np.ndarray:
    """Drawn in to where the priors have weight: a fit may end at an end of a range."""
    centre = priors.transform.unconstrained(
        np.array([_centre(one, priors.transform, k) for k, one in enumerate(priors.each)])
    )
    reach = MOST * priors.spread_in_z(centre)
    held = np.array([one.in_z and np.isfinite(one.spread) for one in priors.each])
    reach = np.where(np.isfinite(reach), reach, np.inf)
    reach = np.where(held, reach, np.maximum(reach, 20.0))
    return np.clip(z, centre - reach, centre + reach)


def _of_theta(fit: ComponentFit) -> Float[np.ndarray, "points p"]:
    """Slopes of the residuals, in units of the noise, in physical parameters; 0 where there are none."""
    problem = fit.final.problem
    slopes = problem.linearise(fit.z[None]).jacobian[0, : problem.count]
    if problem.shared is None:
        weight = np.broadcast_to(problem.points.weight, (problem.count,))
        deviation = np.maximum(fit.uncertainty.noise.deviation[0], 1e-9)
        slopes = slopes / (weight * deviation)[:, None]
    per_z = problem.transform.slope(fit.z)
    return np.where(per_z > 0, slopes / np.where(per_z > 0, per_z, 1.0), 0.0)


def _noises(fits, problem: Traceable):
    """What the fit found of unknown variances: label, square root, and from how many numbers."""
    for fit in fits:
        final = fit.final.problem
        for k, g in enumerate(fit.component.sets):
            errors, count = problem.sets[g], len(problem.sets[g].data)
            if final.shared is None:
                points = final.points.set == k
                plain = fit.uncertainty.noise.deviation[0, points]
                found = {"scatter": float(np.mean(plain))}
                if "scale" in errors.labels:
                    found = {"scale": float(np.mean(plain / errors.data.uncertainty))}
            else:
                found = {n: v**0.5 for n, v in final.shared[k].variance.items()}
            for kind, label in errors.labels.items():
                numbers = len(errors.data.groups) if kind == "group" else count
                yield label, max(found.get(kind, 0.0), 1e-5), numbers
