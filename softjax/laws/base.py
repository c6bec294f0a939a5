"""What a contact law gives, and so which route to the restitution it can take.

    ContactLaw
    ├── RateIndependentLaw    force depends on the overlap and its peak: energy balance or ODE
    ├── RateDependentLaw      force depends on the velocity as well: ODE, or the law's closed form
    └── HardSphereLaw         no force, only ε(v): nothing to integrate, no history, no contact

A law of one's own gives its forces in newtons over overlaps in metres and needs no more. Those of
this library give a reduced form (`laws.reduced`) instead, which is faster and loses fewer digits.

Numbers, options and whole fields of a law are declared (`softjax.fields`): their checks, validity
under tracing, and what a fit knows of them follow from that.
"""

import math
from abc import abstractmethod
from collections.abc import Iterable
from itertools import takewhile
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from softjax._checks import ArgumentError, check_choice, check_type
from softjax._numerics import quotient
from softjax.contact import Contact
from softjax.fields import are_valid, check_fields
from softjax.laws.forces import KnownCollision, asked, reduced_by_forces
from softjax.laws.reduced import (
    ENDS,
    Reduced,
    ReducedClosedForm,
    ReducedRateDependent,
    ReducedRateIndependent,
    lifted,
)
from softjax.laws.units import Scales, hertz_scales
from softjax.routes import ODE, ClosedForm, EnergyBalance, Route

__all__ = [
    "ContactLaw",
    "ForceLaw",
    "HardSphereLaw",
    "KnownCollision",
    "RateDependentLaw",
    "RateIndependentLaw",
    "Reduced",
    "ReducedClosedForm",
    "ReducedRateDependent",
    "ReducedRateIndependent",
    "Scales",
]


class ContactLaw(eqx.Module):
    """A contact law of two bodies, in SI units.

    Subclass `RateIndependentLaw`, `RateDependentLaw` or `HardSphereLaw`, not this. Whatever numbers
    and options a law has are dataclass fields, best declared (`softjax.fields`).

    Raises:
        ValueError: naming the field, its value and what is accepted.
    """

    def __check_init__(self):
        check_fields(self)

    def is_valid(self) -> Array:
        """Whether all fields are numbers the law accepts (where tracing kept them unchecked)."""
        return are_valid(self)

    def total_restitution(self, plastic_squared, velocity, elastic) -> tuple[Array, Array]:
        """ε² from ε_p², and whether a loss outside the force law is at its limit.

        A law that knows of no losses but those of its force gives back what it was given.
        """
        return plastic_squared, jnp.zeros_like(elastic)

    @classmethod
    def default_route(cls) -> Route:
        """The route that suits the law: the cheapest that it can take."""
        return EnergyBalance()


class ForceLaw(ContactLaw):
    """A law with a force: what both kinds of it have."""

    contact: eqx.AbstractVar[Contact]

    def __check_init__(self):
        check_type("contact", self.contact, Contact, "a Contact")

    def scales(self) -> Scales:
        """The overlap [m] and velocity [m/s] in which the reduced law is written: Hertz's."""
        return hertz_scales(self.contact)

    @abstractmethod
    def reduced(self) -> Any:
        """The law in the units of `scales`."""

    @abstractmethod
    def reduced_at(self, velocity: Array) -> Reduced:
        """Impacts at v > 0 [m/s] of a law that is given reduced."""

    def impacts(self, velocity: Array) -> Reduced:
        """Impacts at v > 0 [m/s] as the routes take them."""
        si = self._speaks_si()
        return reduced_by_forces(self, velocity) if si else self.reduced_at(velocity)

    def force_scale(self, scales: Scales | None = None):
        """(5/4) M V²/L [N]."""
        scales = self.scales() if scales is None else scales
        return 1.25 * self.contact.mass * scales.velocity * quotient(*reversed(scales))

    @classmethod
    @abstractmethod
    def _speaks_si(cls) -> bool:
        """Whether the law is given by its forces in newtons, and not reduced."""


class RateIndependentLaw(ForceLaw):
    """A law whose force depends on the overlap and its largest value: either route.

    To bring one's own, give both forces [N]; they are asked for one overlap [m] at a time.

        class Cone(sj.RateIndependentLaw):
            contact: sj.Contact
            hardness: float  # [N/m²]

            def loading_force(self, overlap):
                return self.hardness * overlap**2

            def unloading_force(self, overlap, peak_overlap):
                return self.hardness * peak_overlap * jnp.maximum(2 * overlap - peak_overlap, 0)

    The contact ends at the last zero of the unloading force below its peak, or at zero overlap.
    Optional, and honoured by both routes: `breakpoints`, `elastic_overlap`, `residual_overlap`.
    A subclass of a law that is given reduced, with another force, goes by its forces: it has no
    elastic stage but the one that it tells.

    `jumps_at_yield` says whether ε jumps where an impact leaves the elastic stage. A search that
    moves what yield depends on then holds every impact on its branch during a step. `never_yields`
    says that every impact is elastic.
    """

    jumps_at_yield: ClassVar[bool] = False
    never_yields: ClassVar[bool] = False

    def __check_init__(self):
        forces = ("loading_force", "unloading_force")
        missing = [n for n in forces if getattr(type(self), n) is getattr(RateIndependentLaw, n)]
        if not self._is_reduced() and missing:
            raise ArgumentError(f"`{type(self).__name__}` must define {' and '.join(missing)}")

    def loading_force(self, overlap) -> Array:
        """Contact force [N] on loading at `overlap` [m]."""
        x = jnp.asarray(overlap) / self.scales().overlap
        return self.force_scale() * self.reduced().loading(x)

    def unloading_force(self, overlap, peak_overlap) -> Array:
        """Contact force [N] on unloading at `overlap` [m] after the largest overlap [m].

        After an elastic impact, with its peak below first yield, that is the loading force.
        """
        law, length = self.reduced(), self.scales().overlap
        x, peak = jnp.asarray(overlap) / length, jnp.asarray(peak_overlap) / length
        elastic = peak <= law.elastic_limit
        yielded = jnp.where(elastic, jnp.maximum(peak, 1.0), peak)  # the branch not taken: a number
        force = jnp.where(elastic, law.loading(x), law.unloading(x, yielded))
        return self.force_scale() * force

    def breakpoints(self) -> Iterable:
        """Overlaps [m] at which a force has a kink; each is one value, or one an impact."""
        if not self._is_reduced():
            return ()
        # forces beside a reduced law are mostly made of its own
        law, length = self.reduced(), self.scales().overlap
        limit = law.elastic_limit
        never_or_always = isinstance(limit, float | int) and limit in (0, math.inf)
        kinks = law.breakpoints() if never_or_always else (limit, *law.breakpoints())
        return tuple(length * x for x in kinks)

    def elastic_overlap(self) -> Array | float:
        """The overlap [m] up to which loading and unloading are Hertz's; infinite: always."""
        return 0.0

    def residual_overlap(self, peak_overlap) -> Array | None:
        """The last zero [m] of the unloading force below its peak, where it is known.

        None leaves it to a search, which finds it to rounding, and its derivative to 1e-9.
        """
        return None

    def reduced(self) -> ReducedRateIndependent:
        """The law in the units of `scales`; a law in SI is reduced impact by impact."""
        name = type(self).__name__
        raise ArgumentError(f"`{name}` is given by its forces: it has no reduced form of its own")

    def reduced_at(self, velocity: Array) -> Reduced:
        return lifted(self.reduced(), self.scales(), velocity)

    def elastic_velocity(self):
        """The impact velocity [m/s] up to which nothing yields; infinite or 0 for laws without."""
        scales, exponent = self.elastic_scales()
        if self._speaks_si():
            limit = jnp.asarray(asked(self, "elastic_overlap")) / scales.overlap
        else:
            limit = self.reduced().elastic_limit
        return scales.velocity * limit ** (exponent / 2)

    def elastic_scales(self) -> tuple[Scales, float]:
        """Units in which elastic impacts follow a power law with work (2/5) x^k, and k."""
        if self._speaks_si():
            return hertz_scales(self.contact), 2.5
        return self.scales(), self.reduced().work_exponent

    @classmethod
    def is_elastic(cls) -> bool:
        """Whether it `never_yields`; what a reduced law says of itself is of its own forces."""
        if not cls._speaks_si():
            return cls.never_yields
        forces = takewhile(lambda kind: "reduced" not in vars(kind), cls.__mro__)
        return next((vars(k)["never_yields"] for k in forces if "never_yields" in vars(k)), False)

    @classmethod
    def _speaks_si(cls) -> bool:
        told = {"reduced", "loading_force", "unloading_force"}
        latest = next(kind for kind in cls.__mro__ if told & vars(kind).keys())
        return latest in _ABSTRACT or "reduced" not in vars(latest)

    @classmethod
    def _is_reduced(cls) -> bool:
        return cls.reduced is not RateIndependentLaw.reduced


class RateDependentLaw(ForceLaw):
    """A law whose force depends on the velocity too: no energy balance, but the ODE.

    To bring one's own, give the force [N] and say where the contact ends; it is asked for one
    overlap [m] and its rate [m/s] at a time.

        class HuntCrossley(sj.RateDependentLaw):
            contact: sj.Contact
            dissipation: float  # [s/m]
            end = "zero-force"

            def force(self, overlap, velocity):
                elastic = self.contact.stiffness * overlap**1.5
                return elastic * (1 + self.dissipation * velocity)

    `end`: "zero-overlap", or "zero-force", where damping cancels the elastic force (or the overlap
    vanishes first). The force at rest is what the bodies store, the rest is what they lose.

    Where all of a collision is known, `closed_form` tells it, and is the default then. It belongs to
    the force beside which it is defined: a subclass with another force is integrated, unless it
    tells another closed form too.
    """

    def __check_init__(self):
        if self._speaks_si():
            name = type(self).__name__
            if type(self).force is RateDependentLaw.force:
                raise ArgumentError(f"`{name}` must define force")
            check_choice("end", getattr(self, "end", None), ENDS)

    def force(self, overlap, velocity) -> Array:
        """Contact force [N] at `overlap` [m] and its rate `velocity` [m/s]."""
        scales = self.scales()
        x, u = jnp.asarray(overlap) / scales.overlap, jnp.asarray(velocity) / scales.velocity
        return self.force_scale() * self.reduced().force(x, u)

    def reduced(self) -> ReducedRateDependent:
        """The law in the units of `scales`; a law in SI is reduced impact by impact."""
        name = type(self).__name__
        raise ArgumentError(f"`{name}` is given by its force: it has no reduced form of its own")

    def reduced_at(self, velocity: Array) -> Reduced:
        return lifted(self.reduced(), self.scales(), velocity)

    def closed_form(self, velocity: Array) -> KnownCollision:
        """The collisions at v > 0 [m/s], where the law knows them."""
        raise NotImplementedError

    @classmethod
    def has_closed_form(cls) -> bool:
        """Whether the law knows its collisions, and none of its subclasses has changed the force."""
        defined = {"closed_form", "force", "reduced", "reduced_at"}
        latest = next(kind for kind in cls.__mro__ if defined & vars(kind).keys())
        return latest not in _ABSTRACT and "closed_form" in vars(latest)

    @classmethod
    def _speaks_si(cls) -> bool:
        latest = next(kind for kind in cls.__mro__ if {"force", "reduced"} & vars(kind).keys())
        return latest in _ABSTRACT or "force" in vars(latest)

    @classmethod
    def default_route(cls) -> Route:
        return ClosedForm() if cls.has_closed_form() else ODE()


_ABSTRACT = (ContactLaw, ForceLaw, RateIndependentLaw, RateDependentLaw)


class HardSphereLaw(ContactLaw):
    """A law that gives ε without a force: instantaneous, without overlap, without a history."""

    @abstractmethod
    def restitution_squared(self, velocity: Array) -> Array:
        """ε² at the impact velocity v > 0 [m/s]."""

    def limit(self) -> Array:
        """The velocity [m/s] from which on the law has no value but 0; infinite without one."""
        return jnp.asarray(jnp.inf)

    def total_restitution(self, plastic_squared, velocity, elastic) -> tuple[Array, Array]:
        return plastic_squared, velocity >= self.limit()
