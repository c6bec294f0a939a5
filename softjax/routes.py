"""The routes from a contact law to its collisions. Importing them imports no solver.

Your own route is a class with two methods, `refusal` and `collide` (`AbstractRoute`).
"""

import dataclasses
from abc import abstractmethod
from functools import partial
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from softjax.checks import ArgumentError, check_choice, is_traced
from softjax.engine import energy
from softjax.engine.outcome import Collision, Units, stated
from softjax.fields import Numbers
from softjax.laws.base import ForceLaw, HardSphereLaw, RateDependentLaw
from softjax.laws.forces import answer
from softjax.laws.reduced import Reduced, ReducedClosedForm
from softjax.mapping import over_impacts

TOLERANCES = 1e-14, 0.1
SOLVERS = ("dopri8", "dopri5", "tsit5", "bosh3")


class AbstractRoute(eqx.Module):
    """A way to compute collisions. Numbers of a route are fields, as those of a law are.

    Attributes:
        name: in words.
        by_time: whether impacts are integrated over time: slow, and no faster in large blocks.
    """

    name: ClassVar[str]
    by_time: ClassVar[bool] = False

    @property
    def settings(self) -> dict[str, Any]:
        """What a report tells of it, besides its name."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    def as_argument(self) -> "AbstractRoute":
        """The route as compiled programs take it: one object for all that run the same program."""
        return self

    @abstractmethod
    def refusal(self, law) -> str | None:
        """None where the route can compute this law, else what `route` must be instead."""

    @abstractmethod
    def collide(self, law, velocity: Numbers, *, clock=False, force=False) -> Collision:
        """Impacts at v > 0 [m/s] beyond the law's elastic stage, in SI units.

        Args:
            law: as `restitution` was given it, its numbers valid.
            velocity: an array, against which the law's numbers broadcast; JAX may trace both.
            clock, force: whether the duration and the largest force are requested.

        Returns:
            Numbers for each impact. Where ε_p² is not finite the status is SOLVER_FAILED; other flags,
            such as ENERGY_GAIN, are the route's to raise.
        """


def si_units(law, impacts: Reduced) -> Units:
    """Of impacts as a law gives them: its scales."""
    scales = impacts.scales
    return Units(scales.time, scales.overlap, scales.velocity, law.force_scale(scales))


class EnergyBalance(AbstractRoute):
    """Works and roots in closed form or by quadrature, no time integration: exact, the default.

    For rate-independent laws.
    """

    name = "energy balance"

    def refusal(self, law) -> str | None:
        if not isinstance(law, RateDependentLaw):
            return None
        either = "ClosedForm() or ODE(...)" if law.has_closed_form() else "ODE(...)"
        return (
            f"{either} for {type(law).__name__}, whose force depends on the velocity, "
            "but is EnergyBalance()"
        )

    def collide(self, law, velocity: Numbers, *, clock=False, force=False) -> Collision:
        impacts = law.reduced_at(velocity)
        batch = impacts.law, impacts.y, impacts.speed_ratio
        if isinstance(impacts.law, ReducedClosedForm):
            collision = energy.in_closed_form(*batch, clock=clock, force=force)
        else:
            single = partial(energy.by_quadrature, clock=clock, force=force)
            collision = over_impacts(single, batch, forward=False)
        return collision.scaled(si_units(law, impacts))


class ClosedForm(AbstractRoute):
    """What a law knows of its own collisions: formulas, and series of functions of one number.

    The default for `LinearSpringDashpot`, `HertzDashpot`, `ViscoelasticHertz`, and for any law of
    your own that gives its `closed_form`; error <= 1e-12. Hard spheres are formulas anyway. The
    largest force is that of `ODE(rtol=1e-10)`.
    """

    name = "closed form"

    def refusal(self, law) -> str | None:
        known = isinstance(law, RateDependentLaw) and law.has_closed_form()
        if known or isinstance(law, HardSphereLaw):
            return None
        return (
            f"another than ClosedForm() for {type(law).__name__}: it is for laws with a "
            "`closed_form`, such as LinearSpringDashpot, HertzDashpot and ViscoelasticHertz"
        )

    def collide(self, law, velocity: Numbers, *, clock=False, force=False) -> Collision:
        known = answer(law, "closed_form", velocity)
        largest = ODE(rtol=1e-10).collide(law, velocity, force=True).force if force else None
        overlaps = known.peak_overlap, known.residual_overlap
        energy = jnp.broadcast_to(jnp.square(known.coefficient), velocity.shape)
        return stated(energy, *overlaps, known.duration if clock else None, largest)


def _plain(number):
    """A single number of NumPy's or JAX's as Python's own: results keep their route as it is."""
    concrete = isinstance(number, np.generic | np.ndarray | jax.Array) and not is_traced(number)
    return number.item() if concrete and number.ndim == 0 else number


def _check_rtol(value) -> None:
    is_number = isinstance(value, int | float | np.number)
    in_range = is_number and TOLERANCES[0] <= float(value) <= TOLERANCES[1]
    if not is_traced(value) and not in_range:
        raise ArgumentError(f"`rtol` must be a number in [1e-14, 0.1], but is {value!r}")


def _check_counts(**values) -> None:
    for name, value in values.items():
        if not is_count(value):
            raise ArgumentError(f"`{name}` must be a whole number >= 1, but is {value!r}")


def _in_force(rtol) -> Any:
    """A tolerance; of a traced one the nearest that is accepted."""
    if not is_traced(rtol):
        return rtol
    return jax.lax.stop_gradient(jnp.clip(rtol, *TOLERANCES))


def _needs_force(law, route) -> str:
    name = type(law).__name__
    return f"EnergyBalance() for {name}, which has no force to integrate, but is {route!r}"


class ODE(AbstractRoute):
    """The equation of motion integrated by diffrax, for any contact law.

    Args:
        rtol: relative tolerance of the adaptive steps, in [1e-14, 0.1]; 1e-8 unless given. The
            absolute one is the same, since the variables are scaled to one. JAX may trace it; no
            derivative is taken of it.
        solver: explicit Runge–Kutta method: "dopri8", "dopri5", "tsit5" or "bosh3"; or any explicit
            solver of diffrax, one without an error estimate for fixed `steps` alone.
        steps: a fixed number of equal steps for loading and as many for unloading, instead of the
            adaptive ones (then `rtol` acts no more): fastest, and without any loop over rejected
            steps.
        max_steps: where the adaptive steps give up, per branch.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """

    rtol: Any = eqx.field(default=None, converter=_plain, metadata={"shared": True})
    solver: Any = eqx.field(static=True, default="dopri8")
    steps: int | None = eqx.field(static=True, default=None)
    max_steps: int = eqx.field(static=True, default=4096)

    name = "ode"
    by_time = True
    by_reverse: ClassVar[bool] = False

    def __check_init__(self):
        if isinstance(self.solver, eqx.Module):
            from softjax.engine import bridge  # who has a solver of diffrax has imported it

            bridge.check_solver(self.solver, adaptive=self.steps is None)
        else:
            check_choice("solver", self.solver, SOLVERS)
        if self.rtol is not None and self.steps is not None:
            raise ArgumentError("`rtol` would be ignored: fixed `steps` have no tolerance")
        if self.rtol is not None:
            _check_rtol(self.rtol)
        steps = {} if self.steps is None else {"steps": self.steps}
        _check_counts(**steps, max_steps=self.max_steps)

    @property
    def tolerance(self) -> Any:
        """The tolerance in force, 1e-8 unless given; of a traced one the nearest that is accepted."""
        return _in_force(1e-8 if self.rtol is None else self.rtol)

    @property
    def settings(self) -> dict[str, Any]:
        how = {"rtol": self.tolerance} if self.steps is None else {"steps": self.steps}
        is_named = isinstance(self.solver, str)
        return {"solver": self.solver if is_named else type(self.solver).__name__, **how}

    def as_argument(self) -> "ODE":
        return self if self.steps is not None else _with_array(self)

    def error(self, unknown: float, dtype) -> Numbers:
        """What a step may be off: the tolerance, but for rounding; `unknown` if the steps are fixed."""
        tolerance = unknown if self.steps is not None else self.tolerance
        return jnp.maximum(jnp.asarray(tolerance, dtype), 4 * float(jnp.finfo(dtype).eps))

    def refusal(self, law) -> str | None:
        return None if isinstance(law, ForceLaw) else _needs_force(law, self)

    def collide(self, law, velocity: Numbers, *, clock=False, force=False) -> Collision:
        # diffrax is imported when it is used
        from softjax.engine.motion import rate_dependent, rate_independent

        impacts = law.reduced_at(velocity)
        integrate = rate_dependent if isinstance(law, RateDependentLaw) else rate_independent
        single = partial(integrate, clock=clock, force=force)
        batch = impacts.law, impacts.y, impacts.speed_ratio, self

        def reversible(law, y, speed_ratio, route: ODE) -> Collision:
            settings = route.rtol, route.solver, route.steps, route.max_steps
            return single(law, y, speed_ratio, _Reversible(*settings))

        collision = over_impacts(single, batch, forward=True, reversible=reversible)
        return collision.scaled(si_units(law, impacts))


class TimeODE(AbstractRoute):
    """M δ'' = -P(δ, δ') in time by `diffrax.diffeqsolve` with events: the textbook's way, for cross-checks.

    For any law with a force. It shares with the other routes the law alone: no variable whose end is known, no
    search for where a branch ends. Steps of tsit5; each branch ends by an event that is found by bisection. Value
    and derivatives, forward and reverse, cost two to ten times those of `ODE`, and err by more. Of the built-in laws
    |Δε²| <= 150 rtol. Derivatives are those of the steps taken, whose errors are controlled in the motion alone: of ε,
    of overlaps and of the duration over themselves, θ ∂q/∂θ errs by up to 3e-5 at the rtol of 1e-8, by 1e-6 at 1e-10;
    most by Thornton's law, whose force has a kink at yield, by 1e-6 (at 1e-8) where the force is smooth.

    Args:
        rtol: relative tolerance of the steps, in [1e-14, 0.1], and the absolute one of overlap and velocity over
            those of an elastic collision. JAX may trace it; no derivative is taken of it.
        max_steps: where they give up, per branch.

    Raises:
        ValueError: naming the argument, its value and what is accepted.
    """

    rtol: Any = eqx.field(default=1e-8, converter=_plain, metadata={"shared": True})
    max_steps: int = eqx.field(static=True, default=4096)

    name = "in time, by events"
    by_time = True

    def __check_init__(self):
        _check_rtol(self.rtol)
        _check_counts(max_steps=self.max_steps)

    @property
    def tolerance(self) -> Any:
        """The tolerance in force; of a traced one the nearest that is accepted."""
        return _in_force(self.rtol)

    @property
    def settings(self) -> dict[str, Any]:
        return {"rtol": self.tolerance}

    def as_argument(self) -> "TimeODE":
        return _with_array(self)

    def error(self, dtype) -> Numbers:
        """What a step may be off: the tolerance, but for rounding."""
        return jnp.maximum(jnp.asarray(self.tolerance, dtype), 4 * float(jnp.finfo(dtype).eps))

    def refusal(self, law) -> str | None:
        return None if isinstance(law, ForceLaw) else _needs_force(law, self)

    def collide(self, law, velocity: Numbers, *, clock=False, force=False) -> Collision:
        # diffrax is imported when it is used
        from softjax.engine.in_time import rate_dependent, rate_independent

        impacts = law.reduced_at(velocity)
        integrate = rate_dependent if isinstance(law, RateDependentLaw) else rate_independent
        batch = impacts.law, impacts.y, impacts.speed_ratio, self
        single = partial(integrate, clock=clock, force=force)
        return over_impacts(single, batch, forward=True).scaled(si_units(law, impacts))


class _Reversible(ODE):
    """Its solves are differentiable in reverse, as a law of many numbers needs it."""

    by_reverse = True


ROUTES = EnergyBalance, ClosedForm, ODE, TimeODE  # of the library


def _with_array(route: Any) -> Any:
    """With its tolerance as an array: of that a compiled program needs the place, not the number."""
    if is_traced(route.rtol):
        return route
    tolerance = np.asarray(route.tolerance)
    return eqx.tree_at(lambda r: r.rtol, route, tolerance, is_leaf=lambda leaf: leaf is None)


def is_count(value) -> bool:
    """Whether it is a whole number of one or more."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(value >= 1)
