"""The numbers that ε depends on, by name, and the law they make.

A property of a material acts through the contact that is built of it, so derivatives are taken
through what builds it.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain, combinations, product
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.errors import DataError, listed
from calibration.fitting.laws import eps_up_of
from calibration.fitting.material import MaterialFit
from calibration.fitting.result import FitResult
from softjax.fields import Declared, declarations, whole_leaves

VELOCITY = "velocity"
# which endings the names of the two bodies' properties have
BODIES = {"spheres": ("", ""), "unlike spheres": ("_1", "_2"), "wall": ("", "_wall")}
RADII = ("radius_1", "radius_2")
OF_BODIES = declarations(sj.Material) | declarations(sj.Contact)
OF_BODIES |= {VELOCITY: Declared("v", "m/s", "velocity")}
OF_BODIES |= {"eps_up": Declared("ε_up", "-", "restitution", 0.0, 1.0)}


@dataclass(frozen=True)
class Inputs:
    """Named numbers, and how a law is made of them.

    Attributes:
        values: name -> value, SI. A name may end in `_1`, `_2`, `_wall`: of which body.
        build: makes the law of such a mapping; traceable by JAX.
    """

    values: Mapping[str, float]
    build: Callable[[Mapping[str, Any]], sj.ContactLaw]

    def law(self, **moved: float) -> sj.ContactLaw:
        """The law of the values themselves, but of those that are moved.

        Raises:
            ValueError: where they make no law.
        """
        law = self.build({**self.values, **moved})
        for kind in type(law).__mro__:  # a pytree that was put together was not looked at
            if "__check_init__" in vars(kind):
                kind.__check_init__(law)  # type: ignore[attr-defined]
        return law

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def declared(self, name: str) -> Declared:
        """Symbol and unit of one of them, or of the velocity."""
        stem, body = _split(name.rpartition(".")[2])
        known = (OF_BODIES | declarations(type(self.law()))).get(stem, Declared(stem))
        return known._replace(symbol=f"{known.symbol or stem} {body}".strip())


@dataclass(frozen=True)
class OfBodies:
    """Builds a law of two bodies.

    Attributes:
        bodies: "spheres" of one material, with one radius or two; "unlike spheres" of two materials;
            "wall": a sphere and a flat wall.
        law: its class.
        area: of the contact.
        options: of the law, in words.
    """

    bodies: str = "spheres"
    law: Callable[..., sj.ContactLaw] = sj.Zhou
    area: str = "zhou"
    options: tuple[tuple[str, str], ...] = ()

    def __call__(self, values: Mapping[str, Any]) -> sj.ContactLaw:
        ends, names = BODIES[self.bodies], declarations(sj.Material)
        one, two = (sj.Material(*(values[name + end] for name in names)) for end in ends)
        if self.bodies == "wall":
            contact = sj.Contact.with_wall(one, two, values["radius"], area=self.area)
        else:
            radius_1, radius_2 = (values.get(n, values.get("radius")) for n in RADII)
            contact = sj.Contact.between_spheres(one, two, radius_1, radius_2, area=self.area)
        fields = {name: values[name] for name in declarations(self.law)}  # type: ignore[arg-type]
        return self.law(contact=contact, **fields, **dict(self.options))


class OfLaw(eqx.Module):
    """Build a law from its fields and those of its contact, as independent inputs.

    Attributes:
        law: a law of the same structure; its shared fields are not changed.
        names: names of its leaves, None for a shared leaf.
    """

    law: sj.ContactLaw
    names: tuple[str | None, ...] = eqx.field(static=True)

    def __call__(self, values: Mapping[str, Any]) -> sj.ContactLaw:
        leaves, structure = jax.tree.flatten(self.law)
        pairs = zip(self.names, leaves, strict=True)
        chosen = [leaf if name is None else values[name] for name, leaf in pairs]
        return jax.tree.unflatten(structure, chosen)


class OfLoss(eqx.Module):
    """Build Zhou's law from ε_up = ε_17(v_cr) instead of σ and ψ, which act only through it above yield.

    Attributes:
        build: the law of σ and ψ.
        psi: ψ; the value does not matter.
    """

    build: Any
    psi: float

    def __call__(self, values: Mapping[str, Any]) -> sj.ContactLaw:
        values = dict(values)
        loss = -jnp.log(values.pop("eps_up"))
        contact = self.build({**values, "sigma": 1.0, "psi": self.psi}).contact
        ratio = contact.critical_velocity / (contact.limit_velocity - contact.critical_velocity)
        return self.build({**values, "sigma": loss / ratio**self.psi, "psi": self.psi})


def as_fitted(inputs: Inputs, material: MaterialFit) -> Inputs:
    """The inputs with ε_up instead of σ and ψ, if the fit determines only ε_up."""
    if "eps_up" not in material.parameters or not {"sigma", "psi"} <= set(inputs.values):
        return inputs
    values = {n: x for n, x in inputs.values.items() if n not in ("sigma", "psi")}
    values["eps_up"] = float(eps_up_of(inputs.law()))  # type: ignore[arg-type]
    return Inputs(values, OfLoss(inputs.build, inputs["psi"]))


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
    paths, structure = jax.tree_util.tree_flatten_with_path(law)
    short = [path[-1].name if hasattr(path[-1], "name") else None for path, _ in paths]
    twice = {name for name, count in Counter(short).items() if count > 1}
    names: list[str | None] = []
    for name, is_shared, (path, leaf) in zip(short, whole_leaves(law), paths, strict=True):
        if np.ndim(leaf) and not is_shared:
            raise DataError(str(name), f"of shape {np.shape(leaf)}", "a single number")
        full = jax.tree_util.keystr(path).lstrip(".")
        names.append(None if is_shared else (full if name in twice else name))
    leaves = [np.asarray(leaf, float) for _, leaf in paths]
    values = {n: float(leaf) for n, leaf in zip(names, leaves, strict=True) if n is not None}
    return Inputs(values, OfLaw(jax.tree.unflatten(structure, leaves), tuple(names)))


def as_inputs(inputs: Inputs | sj.ContactLaw | FitResult, material: str | None = None) -> Inputs:
    """Inputs as they are, or those of a law, or of the law of one of a fit's materials.

    Raises:
        ValueError: for anything else.
    """
    if isinstance(inputs, FitResult):
        one = inputs.material(material)
        return as_fitted(of_law(one.law), one)
    if material is not None:
        raise DataError("material", material, "left out, or given with a FitResult")
    if isinstance(inputs, sj.ContactLaw):
        return of_law(inputs)
    if isinstance(inputs, Inputs):
        return inputs
    raise DataError("inputs", inputs, "Inputs, a contact law or a FitResult")


def check_velocity(velocity: Any) -> np.ndarray:
    """Velocities as a flat array.

    Raises:
        ValueError: for what is no finite velocity of 0 or more.
    """
    values = np.asarray(velocity, float).ravel()
    if not (values.size and np.all(np.isfinite(values) & (values >= 0))):
        raise DataError("velocity", velocity, "one finite velocity [m/s] or more, each 0 or above")
    return values


def both_ends(argument: str, value: Any) -> tuple[float, float]:
    """Two numbers.

    Raises:
        ValueError: naming the argument and what it is.
    """
    try:
        low, high = map(float, value)
    except (TypeError, ValueError):
        raise DataError(argument, value, "two numbers, (low, high)") from None
    return low, high


def check_ranges(
    inputs: Inputs, ranges: Mapping[str, tuple[float, float]], argument: str = "ranges"
) -> None:
    """Check that ranges lie inside the declared ones and that laws exist at their ends.

    Raises:
        ValueError: naming the argument, what is outside and what is accepted.
    """
    corners: dict[str, list[float]] = {}
    for name, both in ranges.items():
        if name not in inputs.values:
            raise DataError(argument, name, f"of {listed(inputs.values)}")
        low, high = both_ends(argument, both)
        declared = inputs.declared(name)
        if not (declared.lower <= low < high <= declared.upper):
            accepted = f"ascending, within the range of {declared.accepted}"
            raise DataError(argument, f"{name} = {low:g} … {high:g}", accepted)
        # an end that is not accepted itself is never drawn
        among = [(low, high), (high, low)]
        corners[name] = [x if declared.holds(x) else math.nextafter(x, y) for x, y in among]
    for names in chain(combinations(ranges, 1), combinations(ranges, 2)):
        for ends in product(*(corners[name] for name in names)):
            moved = dict(zip(names, ends, strict=True))
            try:
                inputs.law(**moved)
            except ValueError as error:
                point = listed(f"{name} = {x:g}" for name, x in moved.items())
                accepted = f"such that the law exists everywhere ({error})"
                raise DataError(argument, point, accepted) from None


def _split(name: str) -> tuple[str, str]:
    """`youngs_modulus_wall` is youngs_modulus of the wall."""
    for body in ("1", "2", "wall"):
        if name.endswith(f"_{body}"):
            return name.removesuffix(f"_{body}"), body
    return name, ""
