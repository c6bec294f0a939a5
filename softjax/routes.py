"""The routes from a contact law to its restitution. Importing them imports no solver."""

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from softjax._checks import ArgumentError, check_choice
from softjax.fields import array_field

SOLVERS = ("dopri8", "dopri5", "tsit5", "bosh3")


@dataclass(frozen=True)
class EnergyBalance:
    """Works and roots in closed form or by quadrature, no time integration: exact, the default.

    For rate-independent laws.
    """

    name = "energy balance"


@dataclass(frozen=True)
class ClosedForm:
    """What a law knows of its own collisions: formulas, and series of functions of one number.

    The default for `LinearSpringDashpot`, `HertzDashpot`, `ViscoelasticHertz`, and for any law of
    one's own that tells its `closed_form`; error <= 1e-12. Hard spheres are formulas anyway.
    """

    name = "closed form"


@dataclass(frozen=True)
class ODE:
    """The equation of motion integrated by diffrax, for any contact law.

    Args:
        rtol: relative tolerance of the adaptive steps, in [1e-14, 0.1]. The absolute one is the
            same, since the variables are scaled to one.
        solver: explicit Runge–Kutta method: "dopri8", "dopri5", "tsit5" or "bosh3".
        steps: a fixed number of equal steps for loading and as many for unloading, instead of the
            adaptive ones (then `rtol` acts no more): fastest, and without any loop over rejected
            steps.
        max_steps: where the adaptive steps give up, per branch.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """

    rtol: float | None = None
    solver: str = "dopri8"
    steps: int | None = None
    max_steps: int = 4096

    name = "ode"

    def __post_init__(self):
        check_choice("solver", self.solver, SOLVERS)
        if self.rtol is not None and self.steps is not None:
            raise ArgumentError("`rtol` would be ignored: fixed `steps` have no tolerance")
        if self.rtol is not None and not _is_number_in(self.rtol, 1e-14, 0.1):
            raise ArgumentError(f"`rtol` must be a number in [1e-14, 0.1], but is {self.rtol!r}")
        for name in ("steps", "max_steps"):
            value = getattr(self, name)
            if not (value is None and name == "steps") and not is_count(value):
                raise ArgumentError(f"`{name}` must be a whole number >= 1, but is {value!r}")

    @property
    def tolerance(self) -> float:
        """The tolerance in force, 1e-8 unless told."""
        return 1e-8 if self.rtol is None else float(self.rtol)


class Stepping(eqx.Module):
    """`ODE` as compiled programs take it: of a tolerance they need the place, not the number."""

    tolerance: Any = array_field()  # None where the steps are fixed
    solver: str = eqx.field(static=True)
    steps: int | None = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)

    @classmethod
    def of(cls, route: ODE, tolerance: Any) -> "Stepping":
        return cls(tolerance, route.solver, route.steps, route.max_steps)

    def error(self, unknown: float, dtype) -> Array:
        """What a step may be off: the tolerance, but for rounding; `unknown` if the steps are fixed."""
        tolerance = unknown if self.steps is not None else self.tolerance
        return jnp.maximum(jnp.asarray(tolerance, dtype), 4 * float(jnp.finfo(dtype).eps))


Route = EnergyBalance | ClosedForm | ODE


def program_of(route: Route) -> tuple[Route, np.ndarray | None]:
    """What a program is compiled for, and the tolerance, which it takes as a number."""
    if not isinstance(route, ODE) or route.steps is not None:
        return route, None
    return replace(route, rtol=None), np.asarray(route.tolerance)


def taken(route: Route, tolerance: Any) -> EnergyBalance | ClosedForm | Stepping:
    """The route within a program."""
    return Stepping.of(route, tolerance) if isinstance(route, ODE) else route


def check_route(route) -> Route:
    if not isinstance(route, Route):
        raise ArgumentError(
            f"`route` must be EnergyBalance(), ClosedForm() or ODE(...), but is {route!r}"
        )
    return route


def _is_number_in(value, low: float, high: float) -> bool:
    return isinstance(value, int | float | np.number) and bool(low <= float(value) <= high)


def is_count(value) -> bool:
    """Whether it is a whole number of one or more."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(value >= 1)
