"""The numbers that ε depends on, by name, and the law they make.

A property of a material acts through the contact that is built of it, so derivatives are taken
through what builds it. Names are those of an uncertainty budget: `youngs_modulus` of the first body (or
of both, where they are equal), `wall.youngs_modulus` or `second.youngs_modulus` of the other one,
`contact.youngs_modulus` of the pair.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

import softjax as sj
from calibration.errors import DataError, did_you_mean, listed
from calibration.fitting.estimates import FitEstimates
from calibration.fitting.laws import OF_CONTACT, eps_up_of, sigma_of
from calibration.fitting.material import MaterialFit
from softjax.fields import Declared, declarations, numbers_of, options_of, shared_fields

VELOCITY = "velocity"
# whose property stands before a name, of the first and of the other body
BODIES = {"spheres": ("", ""), "unlike spheres": ("", "second."), "wall": ("", "wall.")}
SIZE = re.compile(r"(radius)_([12])")  # of spheres of two sizes
OF_BODIES = declarations(sj.Material) | declarations(sj.Contact)
OF_BODIES |= {VELOCITY: Declared("v", "m/s", "velocity")}
OF_BODIES |= {"eps_up": Declared("ε_up", "-", "restitution", 0.0, 1.0)}


@dataclass(frozen=True)
class Inputs:
    """Named numbers, and how a law is made of them.

    Attributes:
        values: name -> value, SI: "density", "wall.density", "radius_1", "contact.radius", "chi".
        build: makes the law of such a mapping; traceable by JAX.
    """

    values: Mapping[str, float]
    build: Callable[[Mapping[str, Any]], sj.ContactLaw]

    def law(self, **moved: float) -> sj.ContactLaw:
        """The law of the values themselves, but of those that are moved: law(**{"wall.density": 7800.0}).

        Raises:
            ValueError: where they make no law, and naming one that is no input.
        """
        for name in moved:
            self[name]
        law = self.build({**self.values, **moved})
        for kind in type(law).__mro__:  # a pytree built by hand was not validated
            if "__check_init__" in vars(kind):
                kind.__check_init__(law)  # type: ignore[attr-defined]
        return law

    def __getitem__(self, name: str) -> float:
        if name not in self.values:
            raise _unknown(name, self.values)
        return self.values[name]

    def declared(self, name: str) -> Declared:
        """Symbol and unit of one of them, or of the velocity."""
        owner, _, key = name.rpartition(".")
        known, of = OF_BODIES | declarations(type(self.law())), owner.removesuffix("contact")
        if key not in known and (size := SIZE.fullmatch(key)):
            key, of = size.groups()
        declared = known.get(key, Declared(key))
        return declared._replace(symbol=f"{declared.symbol or key} {of}".strip())


def _unknown(name: str, known: Iterable[str]) -> DataError:
    return DataError("inputs", repr(name), f"one of {listed(known)}{did_you_mean(name, known)}")


@dataclass(frozen=True)
class OfBodies:
    """Builds a law of two bodies: "spheres" of one material, "unlike spheres" of two, or a "wall"."""

    bodies: str = "spheres"
    law: Callable[..., sj.ContactLaw] = sj.Zhou
    area: str = "zhou"
    options: tuple[tuple[str, str], ...] = ()  # of the law, in words

    def __call__(self, values: Mapping[str, Any]) -> sj.ContactLaw:
        owners, names = BODIES[self.bodies], declarations(sj.Material)
        stated = [owner + name for owner in dict.fromkeys(owners) for name in names]
        stated += ["radius_1", "radius_2"] if "radius_1" in values else ["radius"]
        stated += [n for n in declarations(self.law) if n not in stated]  # type: ignore[arg-type]
        for name in values:
            if name not in stated:
                raise _unknown(name, stated)
        for name in stated:
            if name not in values:
                raise DataError("inputs", f"without {name!r}", f"all of {listed(stated)}")
        first, second = (sj.Material(*(values[who + name] for name in names)) for who in owners)
        if self.bodies == "wall":
            contact = sj.Contact.with_wall(first, second, values["radius"], area=self.area)
        else:
            radius_1, radius_2 = (values.get(f"radius_{k}", values.get("radius")) for k in (1, 2))
            contact = sj.Contact.between_spheres(first, second, radius_1, radius_2, area=self.area)
        fields = {name: values[name] for name in declarations(self.law)}  # type: ignore[arg-type]
        return self.law(contact=contact, **fields, **dict(self.options))


class OfLaw(eqx.Module):
    """Builds a law of the same structure from its numbers by name."""

    law: sj.ContactLaw

    def __call__(self, values: Mapping[str, Any]) -> sj.ContactLaw:
        moved = [values[name] for name in _named(self.law)]
        return eqx.tree_at(lambda law: [*numbers_of(law).values()], self.law, moved)


def _named(law: sj.ContactLaw) -> dict[str, Any]:
    """`numbers_of` a law, with those of the contact as of the pair."""
    numbers, contact = numbers_of(law), getattr(law, "contact", None)
    of_pair = {*numbers_of(contact)} if isinstance(contact, sj.Contact) else set()
    of_pair -= {
        *declarations(type(law)),
        *(n.removeprefix(OF_CONTACT) for n in numbers if "." in n),
    }
    return {OF_CONTACT + n if n in of_pair else n: x for n, x in numbers.items()}


class OfLoss(eqx.Module):
    """Builds Zhou's law from ε_up = ε_17(v_cr), through which alone σ and any ψ act above yield."""

    build: Any
    psi: float

    def __call__(self, values: Mapping[str, Any]) -> sj.ContactLaw:
        values = {**values, "sigma": 1.0, "psi": self.psi}
        eps_up, contact = values.pop("eps_up"), self.build(values).contact
        return self.build({**values, "sigma": sigma_of(contact, eps_up, self.psi)})


def of_spheres(
    material: sj.Material,
    radius: float,
    law: type[sj.ContactLaw] = sj.Zhou,
    *,
    area: str = "zhou",
    **fields: Any,
) -> Inputs:
    """Two equal spheres: E, ν, ρ, Y and R of both moved together, and the fields of a law.

    Args:
        material, radius: of both; R [m].
        law: its class.
        area: of the contact.
        fields: of the law: chi=…, sigma=…, psi=… of Zhou's; texts are options, form="full".
    """
    bodies = {name: float(leaf) for name, leaf in material.leaves().items()}  # type: ignore[arg-type]
    options = {name: value for name, value in fields.items() if isinstance(value, str)}
    numbers = {name: value for name, value in fields.items() if name not in options}
    build = OfBodies("spheres", law, area, tuple(options.items()))
    return Inputs(bodies | {"radius": float(radius)} | numbers, build)


def of_law(law: sj.ContactLaw) -> Inputs:
    """Inputs of any law: its fields and the stored leaves of the contact, single numbers; shared fields are fixed.

    Raises:
        ValueError: where another field is an array.
    """
    numbers, own = _named(law), declarations(type(law))
    for name, value in numbers.items():
        if np.ndim(value):
            raise DataError(name, f"of shape {np.shape(value)}", "a single number")
    values = {name: float(numbers[name]) for name in sorted(numbers, key=lambda name: name in own)}
    return Inputs(values, OfLaw(jax.tree.map(lambda leaf: np.asarray(leaf, float), law)))


def as_inputs(inputs: Inputs | sj.ContactLaw | FitEstimates, material: str | None = None) -> Inputs:
    """Inputs as they are, or those of a law, or of the law of one of a fit's materials."""
    if isinstance(inputs, FitEstimates):
        fit = inputs.material(material)
        return _as_fitted(of_law(fit.law), fit)
    if material is not None:
        raise DataError("material", material, "left out, or given with a FitResult")
    if isinstance(inputs, sj.ContactLaw):
        return of_law(inputs)
    if isinstance(inputs, Inputs):
        return inputs
    raise DataError("inputs", inputs, "Inputs, a contact law or a FitResult")


def inputs_of(source: Any) -> Inputs:
    """Inputs of a command: the bodies' properties if they make the contact, else the law's fields."""
    law, contact = source.law, getattr(source.law, "contact", None)
    inputs = of_law(law)
    if not (source.properties is None or contact is None or shared_fields(type(law))):
        options = tuple((name, getattr(law, name)) for name in options_of(type(law)))
        fields = {name: float(getattr(law, name)) for name in declarations(type(law))}
        build = OfBodies(source.bodies, type(law), contact.area, options)
        by_bodies = Inputs(source.properties | fields, build)
        made = by_bodies.law().contact  # type: ignore[attr-defined]
        of_contact, of_bodies = (list(each.leaves().values()) for each in (contact, made))
        # a fit may have changed the bodies' properties
        inputs = by_bodies if np.allclose(of_contact, of_bodies, rtol=1e-9, atol=0) else inputs
    fit = source.result
    return inputs if fit is None else _as_fitted(inputs, fit.material(source.name))


def _as_fitted(inputs: Inputs, material: MaterialFit) -> Inputs:
    """The inputs with ε_up instead of σ and ψ, if the fit determines only ε_up."""
    if "eps_up" not in material.parameters or not {"sigma", "psi"} <= set(inputs.values):
        return inputs
    values = {n: x for n, x in inputs.values.items() if n not in ("sigma", "psi")}
    values["eps_up"] = float(eps_up_of(inputs.law()))  # type: ignore[arg-type]
    return Inputs(values, OfLoss(inputs.build, inputs["psi"]))


def check_velocity(velocity: Any) -> np.ndarray:
    """Velocities as a flat array."""
    values = np.asarray(velocity, float).ravel()
    if not (values.size and np.all(np.isfinite(values) & (values >= 0))):
        raise DataError("velocity", velocity, "one finite velocity [m/s] or more, each 0 or above")
    return values


def both_ends(argument: str, value: Any) -> tuple[float, float]:
    """Two numbers, the lower one first; of a text LOW:HIGH."""
    with suppress(TypeError, ValueError):
        low, high = map(float, value.split(":") if isinstance(value, str) else value)
        if low <= high:
            return low, high
    form = "LOW:HIGH" if isinstance(value, str) else "two numbers, (low, high)"
    raise DataError(argument, value, f"{form}, the lower one first")
