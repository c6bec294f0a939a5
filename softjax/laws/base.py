"""What a contact law gives, and so which route to the restitution it can take.

    ContactLaw
    ├── RateIndependentLaw    force depends on the overlap and its peak: energy balance or ODE
    ├── RateDependentLaw      force depends on the velocity as well: ODE, or the law's closed form
    └── HardSphereLaw         no force, only ε(v): nothing to integrate, no history, no contact

Your own law gives its forces in newtons over overlaps in metres and needs no more. Those of
this library give a reduced form (`laws.reduced`) instead, which is faster and loses fewer digits.

Numbers, options and whole fields of a law are declared (`softjax.fields`): their checks, validity
under tracing, and what a fit knows of them follow from that.
"""

from abc import abstractmethod
from collections.abc import Iterable
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from softjax.checks import ArgumentError, check_choice, check_type
from softjax.contact import Contact
from softjax.fields import Flags, Numbers, are_valid, check_fields
from softjax.laws.forces import KnownCollision, answer, reduced_by_forces
from softjax.laws.reduced import ENDS, Reduced, Scales, hertz_scales, rescaled_slow
from softjax.numerics.powers import quotient

FORCES = ("loading_force", "unloading_force")


class ContactLaw(eqx.Module):
    """A contact law of two bodies, in SI units.

    Subclass `RateIndependentLaw`, `RateDependentLaw` or `HardSphereLaw`, not this. Whatever numbers
    and options a law has are dataclass fields, best declared (`softjax.fields`). The library's own
    laws are final (`class Law(RateIndependentLaw, final=True)`): a subclass with another force
    would inherit formulas that hold for the first one alone.

    `jax.grad` differentiates every number; `equinox.filter_grad` takes arrays alone, so that fields that
    are Python numbers have the derivative None there: give them as arrays, `jnp.asarray(0.9)`.

    Raises:
        ValueError: naming the field, its value and what is accepted; or a final law that is
            subclassed.
    """

    _final: ClassVar[bool] = False

    def __init_subclass__(cls, final: bool = False, **options):
        super().__init_subclass__(**options)
        for parent in cls.__bases__:
            if getattr(parent, "_final", False):
                base = next(k for k in parent.__mro__ if not getattr(k, "_final", False))
                raise ArgumentError(
                    f"`{cls.__name__}` must derive from {base.__name__}, but derives from "
                    f"{parent.__name__}, which is final"
                )
        cls._final = final

    def __check_init__(self):
        check_fields(self)

    def is_valid(self) -> Flags:
        """Whether all fields are numbers the law accepts (where tracing kept them unchecked)."""
        return are_valid(self)

    def total_restitution(self, plastic_squared, velocity, elastic) -> tuple[Numbers, Flags]:
        """ε² from ε_p², and whether a loss outside the force law is at its limit.

        A law that knows of no losses but those of its force gives back what it was given.
        """
        return plastic_squared, jnp.zeros_like(elastic)

    @classmethod
    def default_route(cls) -> Any:
        """The route that suits the law: the cheapest that it can take."""
        import softjax  # routes are built on laws

        return softjax.EnergyBalance()


class ForceLaw(ContactLaw):
    """A law with a force: what both kinds of it have."""

    contact: eqx.AbstractVar[Contact]

    def __check_init__(self):
        check_type("contact", self.contact, Contact, "a Contact")

    def scales(self) -> Scales:
        """The overlap [m] and velocity [m/s] in which the reduced law is written: Hertz's."""
        return hertz_scales(self.contact)

    def reduced(self) -> Any:
        """The law in the units of `scales`; a law given by its forces is reduced impact by impact."""
        name = type(self).__name__
        raise ArgumentError(f"`{name}` is given by its forces: it has no reduced form of its own")

    def reduced_at(self, velocity: Numbers) -> Reduced:
        """Impacts at v > 0 [m/s] as the routes take them."""
        if not self.is_reduced():
            return reduced_by_forces(self, velocity)
        return rescaled_slow(self.reduced(), self.scales(), velocity)

    def force_scale(self, scales: Scales | None = None):
        """(5/4) M V²/L [N]."""
        scales = self.scales() if scales is None else scales
        return 1.25 * self.contact.mass * scales.velocity * quotient(*reversed(scales))

    @classmethod
    def is_reduced(cls) -> bool:
        """Whether the law is given in reduced form, and not by its forces in newtons."""
        return cls.reduced is not ForceLaw.reduced

    @classmethod
    def _check_given_once(cls, base: type, *forces: str) -> None:
        """Raise where a class gives both its reduced form and a force."""
        given = [name for name in forces if getattr(cls, name) is not getattr(base, name)]
        if cls.is_reduced() and given:
            raise ArgumentError(
                f"`{cls.__name__}` must define either reduced or its forces, but defines reduced "
                f"and {' and '.join(given)}"
            )


class RateIndependentLaw(ForceLaw):
    """A law whose force depends on the overlap and its largest value: either route.

    To write your own, give both forces [N]; they are called with one overlap [m] at a time.

        class Cone(sj.RateIndependentLaw):
            contact: sj.Contact
            hardness: float  # [N/m²]

            def loading_force(self, overlap):
                return self.hardness * overlap**2

            def unloading_force(self, overlap, peak_overlap):
                return self.hardness * peak_overlap * jnp.maximum(2 * overlap - peak_overlap, 0)

    The contact ends at the last zero of the unloading force below its peak, or at zero overlap.
    Optional, and honoured by both routes: `breakpoints`, `elastic_overlap`, `residual_overlap`.

    `jumps_at_yield` says whether ε jumps where an impact leaves the elastic stage: a fit that moves
    what yield depends on then expects jumps of its cost. `never_yields` says that every impact is elastic.
    """

    jumps_at_yield: ClassVar[bool] = False
    never_yields: ClassVar[bool] = False

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        cls._check_given_once(RateIndependentLaw, *FORCES)

    def __check_init__(self):
        missing = [n for n in FORCES if getattr(type(self), n) is getattr(RateIndependentLaw, n)]
        if not self.is_reduced() and missing:
            raise ArgumentError(f"`{type(self).__name__}` must define {' and '.join(missing)}")

    def loading_force(self, overlap) -> Numbers:
        """Contact force [N] on loading at `overlap` [m]."""
        x = jnp.asarray(overlap) / self.scales().overlap
        return self.force_scale() * self.reduced().loading(x)

    def unloading_force(self, overlap, peak_overlap) -> Numbers:
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
        return ()

    def elastic_overlap(self) -> Numbers | float:
        """The overlap [m] up to which loading and unloading are Hertz's; infinite: always."""
        return 0.0

    def residual_overlap(self, peak_overlap) -> Numbers | None:
        """The last zero [m] of the unloading force below its peak, where it is known.

        None leaves it to a search, which finds it to rounding, and its derivative to 1e-9.
        """
        return None

    def elastic_velocity(self):
        """The impact velocity [m/s] up to which nothing yields; infinite or 0 for laws without."""
        scales, exponent = self.elastic_scales()
        if self.is_reduced():
            limit = self.reduced().elastic_limit
        else:
            limit = jnp.asarray(answer(self, "elastic_overlap")) / scales.overlap
        return scales.velocity * limit ** (exponent / 2)

    def elastic_scales(self) -> tuple[Scales, float]:
        """Units in which elastic impacts follow a power law with work (2/5) x^k, and k."""
        if self.is_reduced():
            return self.scales(), self.reduced().work_exponent
        return hertz_scales(self.contact), 2.5


class RateDependentLaw(ForceLaw):
    """A law whose force depends on the velocity too: no energy balance, but the ODE.

    To write your own, give the force [N] and say where the contact ends; it is called with one
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

    Where all of a collision is known, `closed_form` gives it, and is the default then. It belongs to
    the force with which it is defined: a subclass with another force is integrated, unless it
    gives another closed form too.
    """

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        cls._check_given_once(RateDependentLaw, "force")
        defined = vars(cls).keys()
        if "closed_form" not in defined and {"force", "reduced", "reduced_at"} & defined:
            cls.closed_form = RateDependentLaw.closed_form

    def __check_init__(self):
        if not self.is_reduced():
            name = type(self).__name__
            if type(self).force is RateDependentLaw.force:
                raise ArgumentError(f"`{name}` must define force")
            check_choice("end", getattr(self, "end", None), ENDS)

    def force(self, overlap, velocity) -> Numbers:
        """Contact force [N] at `overlap` [m] and its rate `velocity` [m/s]."""
        scales = self.scales()
        x, u = jnp.asarray(overlap) / scales.overlap, jnp.asarray(velocity) / scales.velocity
        return self.force_scale() * self.reduced().force(x, u)

    def closed_form(self, velocity: Numbers) -> KnownCollision:
        """The collisions at v > 0 [m/s], where the law knows them."""
        raise NotImplementedError

    @classmethod
    def has_closed_form(cls) -> bool:
        """Whether the law knows its collisions."""
        return cls.closed_form is not RateDependentLaw.closed_form

    @classmethod
    def default_route(cls) -> Any:
        import softjax

        return softjax.ClosedForm() if cls.has_closed_form() else softjax.ODE()


class HardSphereLaw(ContactLaw):
    """A law that gives ε without a force: instantaneous, without overlap, without a history."""

    @abstractmethod
    def restitution_squared(self, velocity: Numbers) -> Numbers:
        """ε² at the impact velocity v > 0 [m/s]."""
