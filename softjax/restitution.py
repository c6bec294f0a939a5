"""The coefficient of restitution over impact velocities; `engine.impact` begins with the way of one call."""

from dataclasses import fields
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from softjax.checks import ArgumentError, is_traced, standard_promotion
from softjax.compiling import batched
from softjax.engine.impact import (
    Impact,
    check_law,
    collisions,
    common_precision,
    restitution_and_status,
    results,
)
from softjax.engine.outcome import Collision, Requested
from softjax.fields import Flags, Numbers, checked, is_array, shared_leaves
from softjax.laws.base import ContactLaw
from softjax.routes import ROUTES, AbstractRoute
from softjax.status import Status

SHOWN = 16  # impacts whose numbers a printed result has


class Restitution(eqx.Module):
    """ε over impact velocities, with what happened in each collision.

    Attributes (arrays of the shape of `velocity`, broadcast against the law's fields):
        coefficient: ε [-].
        plastic_coefficient: ε_p [-], what the contact force alone gives back.
        peak_overlap, residual_overlap: δ_max and δ* [m]; None where not requested.
        status: `Status` flags, one integer per velocity.
        law, velocity, route: copies of the inputs. Under `jit`, `vmap` or `grad` the numbers of the
            law and of the route have the shape of `velocity` too.
        each: whether what impacts share in the law is there for each impact, as under `vmap`.
    """

    law: ContactLaw
    velocity: Numbers
    coefficient: Numbers
    plastic_coefficient: Numbers
    peak_overlap: Numbers | None
    residual_overlap: Numbers | None
    status: Int[Array, "..."]
    route: AbstractRoute
    each: bool = eqx.field(static=True, default=False)

    @property
    def duration(self) -> Numbers:
        """Contact duration [s], computed when used.

        0 where there is no contact that ends: at v = 0, without a turning point, on invalid input,
        and where the solver gave up.
        """
        return self._computed(Requested(duration=True))

    @property
    def peak_force(self) -> Numbers:
        """The largest contact force [N], that of dashpots included, computed when used.

        0 where there is no contact with a peak: at v = 0, without a turning point, on invalid input,
        where the solver gave up, and for hard spheres.
        """
        return self._computed(Requested(force=True))

    @standard_promotion
    def _computed(self, requested: Requested) -> Numbers:
        law, velocity = common_precision(self.law, self.velocity)

        def computed(law, route, velocity):
            parameters = law, route.as_argument()
            return batched(collisions, parameters, velocity, _observable, requested)

        # impacts that each have a law of their own
        if self.each and any(shared_leaves((law, self.route))):
            for _ in velocity.shape:
                computed = jax.vmap(computed)
        return computed(law, self.route, velocity)

    @property
    def ok(self) -> Flags:
        """True where the status is plain or elastic and nothing else."""
        return Status.is_ok(self.status)

    def __repr__(self) -> str:
        """The numbers of a few impacts; of many, or of traced ones, what there is."""
        arrays = self.coefficient, self.status
        known = [isinstance(x, jax.Array | np.ndarray) and not is_traced(x) for x in arrays]
        here = (getattr(x, "is_fully_addressable", True) for x in arrays)  # or in other processes
        if not (all(known) and all(here) and 0 < self.coefficient.size <= SHOWN):
            return eqx.tree_pformat(self)
        values = " ".join(np.array2string(np.asarray(self.coefficient), precision=4).split())
        # each kind of status once, with how many impacts have it
        kinds, counts = np.unique(self.status, return_counts=True)
        names = [Status(int(kind)).name or "PLAIN" for kind in kinds]
        status = ", ".join(f"{name} {n}" for name, n in zip(names, counts, strict=True))
        status = "ok" if np.all(self.ok) else names[0] if len(names) == 1 else f"({status})"
        return f"Restitution({type(self.law).__name__}: eps={values}, {status=!s})"


@standard_promotion
def restitution(
    law: ContactLaw,
    velocity: Float[ArrayLike, "..."],
    route: AbstractRoute | None = None,
    *,
    overlaps: bool = True,
) -> Restitution:
    """Coefficient of restitution of head-on impacts at `velocity`.

    For Zhou's law below yield ε = ε_17(v) (Eq. 17), above it ε² = ε_p² + ε_17(v_cr)² - 1
    (Eq. 16), where ε_p² is the part of the impact energy that the contact force gives back.

    Args:
        law: a contact law, e.g. `Zhou`. Its fields, and those of its contact, are numbers or
            arrays that broadcast against `velocity`: another material, radius or unloading factor
            for each impact.
        velocity: relative impact velocity v >= 0 [m/s], a number or an array of any shape.
        route: `EnergyBalance()` (rate-independent laws; exact), `ClosedForm()` (laws that know
            their collisions, such as `ViscoelasticHertz`; exact), `ODE(...)` (any law with a
            force; the equation of motion integrated by diffrax) or `TimeODE(...)` (the same over
            time with events, for cross-checks). The default is the first that the law can take.
        overlaps: False leaves the overlaps out, where ε of millions of impacts is all that counts:
            a tenth to a third of the time and almost half of the memory.

    Returns:
        A `Restitution`: `coefficient`, `plastic_coefficient`, `peak_overlap`,
        `residual_overlap` [m], `duration` [s], `peak_force` [N], `status` and `ok`.

    Everything is differentiable, forward and reverse, in the law's fields and the velocity, and
    works under `jax.jit` and `jax.vmap`. Second derivatives: by the energy balance, forward and
    reverse, and by the closed forms; by the ODE, forward over either.

    Precision is that of the arguments (float64 only after `softjax.enable_x64()`).

    Example:
        >>> import softjax as sj
        >>> sj.enable_x64()
        >>> steel = sj.STAINLESS_STEEL
        >>> pair = sj.Contact.between_spheres(steel, steel, 0.0127, 0.0127)
        >>> law = sj.Zhou(pair, chi=1.7944, sigma=3.0432, psi=0.54)
        >>> print(sj.restitution(law, [0.1, 1.0]).coefficient)
        [0.93654476 0.8738557 ]

    Raises:
        ValueError: where concrete arguments make no sense, or the law cannot take the route. Under
            `jit` nothing is raised; the status says `INVALID_INPUT`.
    """
    check_law(law)
    route = _chosen(law, route)
    law, velocity = common_precision(law, checked(law, velocity))
    parameters = law, route.as_argument()
    parts = batched(collisions, parameters, velocity, results, Requested(overlaps=overlaps))
    (law, velocity, route), each = _kept((law, velocity, route))
    return Restitution(law, velocity, *parts, route, each)


def _kept(impacts):
    """Law, velocity and route as a result keeps them, and whether what they share is repeated.

    Where they are traced, `vmap` may stack them along an axis that a result of another shape would
    take for another one: there every number is repeated for each impact.
    """
    leaves, structure = jax.tree.flatten(impacts)
    if not any(is_traced(leaf) for leaf in leaves):
        return impacts, False
    shared = shared_leaves(impacts)
    shapes = [np.shape(leaf) for leaf, common in zip(leaves, shared, strict=True) if not common]
    shape = np.broadcast_shapes(*shapes)

    def repeated(leaf, common):
        if not is_array(leaf) and not isinstance(leaf, float):
            return leaf
        return jnp.broadcast_to(leaf, shape + np.shape(leaf) if common else shape)

    kept = [repeated(leaf, common) for leaf, common in zip(leaves, shared, strict=True)]
    return jax.tree.unflatten(structure, kept), True


class SignedRestitution(NamedTuple):
    """ε² with its sign, for searches; arrays of the broadcast shape.

    Attributes:
        squared: rebound energy over impact energy [-]; below 0 where the losses exceed the impact
            energy (`NO_REBOUND`), and differentiable there; 0 where there is no answer.
        status: `Status` flags, one integer per velocity.
    """

    squared: Numbers
    status: Int[Array, "..."]


@standard_promotion
def signed_restitution(
    law: ContactLaw,
    velocity: Float[ArrayLike, "..."],
    route: AbstractRoute | None = None,
) -> SignedRestitution:
    """ε² of head-on impacts, signed where nothing rebounds, so that a search finds its way back.

    Args:
        law, velocity, route: as for `restitution`.

    Raises:
        ValueError: as `restitution`.
    """
    check_law(law)
    route = _chosen(law, route)
    law, velocity = common_precision(law, checked(law, velocity))
    return batched(collisions, (law, route.as_argument()), velocity, _signed, Requested())


def _signed(impact: Impact, collision: Collision, _):
    squared, status = restitution_and_status(impact, collision)
    return SignedRestitution(jnp.where(impact.valid & collision.answered, squared, 0.0), status)


def _chosen(law: ContactLaw, route: AbstractRoute | None) -> AbstractRoute:
    """The requested route, or the law's default; a ValueError where the law cannot take it."""
    route = law.default_route() if route is None else route
    if not isinstance(route, AbstractRoute):
        *some, last = (f"{cls.__name__}({'...' * bool(fields(cls))})" for cls in ROUTES)
        kinds = f"{', '.join(some)} or {last}"
        raise ArgumentError(f"`route` must be {kinds}, but is {route!r}")
    accepted = route.refusal(law)
    if accepted is not None:
        raise ArgumentError(f"`route` must be {accepted}")
    return route


def _observable(impact: Impact, collision: Collision, requested: Requested):
    """Duration or largest force, 0 without a contact that ends."""
    acts = impact.valid & (impact.velocity > 0)
    value = collision.duration if requested.duration else collision.force
    return jnp.where(acts, value, 0.0)
