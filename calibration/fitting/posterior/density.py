"""The density that is sampled: likelihood and priors, with the Jacobian of the map to parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from calibration.fitting.component_fit import ComponentFit
from calibration.fitting.posterior.coordinates import Scaling, Straight, scaling_of, straight_of
from calibration.fitting.posterior.priors import Priors, priors_of
from calibration.fitting.traceable import Traceable


@dataclass(frozen=True, eq=False)
class Density:
    """Of the parameters and noises of a problem."""

    problem: Traceable
    priors: Priors
    straight: Straight

    @property
    def labels(self) -> list[str]:
        """Of all unknowns, in the order of z."""
        return [one.label for one in self.priors.each]

    def z(self, u: Array, scaling: Scaling) -> tuple[Array, Array]:
        """Unconstrained unknowns of what is sampled, and ln |dz/du| up to a constant."""
        return self.straight.z(scaling.centre + scaling.root @ u, scaling.loss)

    def theta(self, z: Array) -> dict[str, Array]:
        """By name, in physical units."""
        return dict(zip(self.labels, self.priors.transform.physical(z, jnp), strict=True))

    def log_density(self, u: Array, scaling: Scaling, measured: Array) -> Any:
        """ln p(data | θ) p(θ) |dθ/du| up to a constant."""
        z, log_slope = self.z(u, scaling)
        log_likelihood = self.problem.log_likelihood(self.theta(z), measured)
        return self.priors.log_density(z) + log_slope + log_likelihood


def density_of(
    problem: Traceable, fits: Sequence[ComponentFit], priors: Priors | None = None
) -> tuple[Density, Scaling]:
    """The density, and how it is scaled by where a fit ended."""
    priors = priors_of(problem) if priors is None else priors
    straight = straight_of(fits, problem, priors)
    return Density(problem, priors, straight), scaling_of(fits, problem, priors, straight)
