"""What a fit knows of a law, whoever wrote it: how it is built, and what of it is a parameter.

A law is a class, the name of a built-in one, or any function that builds one:

    parameters -> build(contact, **parameters) -> a contact law

A class's parameters are its numeric fields beside `contact`, a function's its arguments beside
`contact`. Range, symbol and unit of each are what the law's field of that name declares.
"""

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

import softjax as sj
from calibration.errors import DataError, did_you_mean, listed
from softjax.fields import Declared, declarations, options_of, whole_fields

CONTACT_LEAVES = declarations(sj.Contact)
OF_CONTACT = "contact."
MOVE_YIELD = ("yield_strength", "youngs_modulus", "radius", "mass")  # what v_cr depends on


@dataclass(frozen=True)
class LawModel:
    """A law as a fit sees it.

    Attributes:
        key: its name in files: that of `LAWS`, else the class's or function's own.
        build: build(contact, **parameters), or build(**parameters) where it takes no contact;
            equal for equal models, so that what is compiled with it is compiled once.
        law_type: the class of what it builds.
        parameters: what is known of each parameter, by name.
        defaults: of fields or arguments that have one.
        options: its options in words, with their values.
        whole: parameters that are arrays or pytrees, whole for all impacts.
        takes_contact, direct: whether it needs a contact; whether a parameter is the field itself.
    """

    key: str
    build: Callable[..., sj.ContactLaw]
    law_type: type
    parameters: Mapping[str, Declared]
    defaults: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, str] = field(default_factory=dict)
    whole: tuple[str, ...] = ()
    takes_contact: bool = True
    direct: bool = True

    @property
    def needs_contact(self) -> bool:
        """Whether it cannot do without: laws without a force can."""
        return self.takes_contact and not issubclass(self.law_type, sj.HardSphereLaw)

    def law(self, contact: sj.Contact | None, values: Mapping[str, Any]) -> sj.ContactLaw:
        """The law with these parameters, those of the contact ("contact.radius") among them."""
        of_contact = {k: v for k, v in values.items() if k.startswith(OF_CONTACT)}
        others = {k: v for k, v in values.items() if k not in of_contact}
        if not self.takes_contact:
            return self.build(**others)
        if of_contact and contact is not None:
            leaves = {k.removeprefix(OF_CONTACT): v for k, v in of_contact.items()}
            contact = dataclasses.replace(contact, **leaves)
        return self.build(contact, **others)

    def inside(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The same numbers; for an end that its range leaves out, where a fit may end, the number beside it."""
        return {name: self._inside(name, value) for name, value in values.items()}

    def _inside(self, name: str, value: Any) -> Any:
        if "[" in name or np.ndim(value):
            return value
        declared = self.declared(name)
        if value == declared.lower and not declared.with_lower:
            return np.nextafter(value, np.inf) if value else float(np.finfo(float).tiny)
        at_top = value == declared.upper and not declared.with_upper
        return np.nextafter(value, -np.inf) if at_top else value

    def declared(self, name: str) -> Declared:
        """What is known of a parameter."""
        if name.startswith(OF_CONTACT):
            return CONTACT_LEAVES[name.removeprefix(OF_CONTACT)]
        return self.parameters[name]

    def accepts(self, name: str) -> bool:
        leaf = name.removeprefix(OF_CONTACT)
        of_contact = name.startswith(OF_CONTACT) and leaf in CONTACT_LEAVES
        return name in self.parameters or (of_contact and self.takes_contact)

    def canonical(self, name: str) -> str:
        """The parameter's full name: that of a contact's leaf may be given without "contact.".

        Raises:
            ValueError: for a name the law does not have.
        """
        for full in (name, OF_CONTACT + name):
            if self.accepts(full):
                return full
        known = [*self.parameters, *(CONTACT_LEAVES if self.takes_contact else ())]
        accepted = f"of {self.key}: {listed(known)}{did_you_mean(name, known)}"
        raise DataError("parameter", name, accepted)


@dataclass(frozen=True)
class With:
    """A class or function with its options: build(contact, **parameters)."""

    build: Callable[..., Any]
    options: tuple[tuple[str, Any], ...] = ()

    def __call__(self, *contact: sj.Contact | None, **values: Any) -> sj.ContactLaw:
        named = {"contact": contact[0]} if contact else {}
        return self.build(**named, **values, **dict(self.options))


def model_of_class(law: type, key: str, options: Mapping[str, str]) -> LawModel:
    """A law class; its fields beside `contact` are its parameters."""
    chosen = _options(law, key, options)
    fields = {f.name: f for f in dataclasses.fields(law)}
    has_contact = "contact" in fields
    whole = whole_fields(law)
    parameters = dict(declarations(law)) | {name: Declared(name) for name in whole}
    defaults = {n: f.default for n, f in fields.items() if f.default is not dataclasses.MISSING}
    return LawModel(
        key,
        With(law, tuple(chosen.items())),
        law,
        parameters,
        {name: value for name, value in defaults.items() if name in parameters},
        chosen,
        whole,
        has_contact,
    )


def model_of_function(
    build: Callable[..., Any], key: str, contact: sj.Contact | None, options: Mapping[str, Any]
) -> LawModel:
    """A function that builds a law; its arguments beside `contact` are its parameters.

    What type of law it builds is found by building one abstractly.
    """
    arguments = inspect.signature(build).parameters
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    odd = [name for name, one in arguments.items() if one.kind not in kinds]
    if odd:
        raise DataError("law", f"{key} with the argument {odd[0]}", "a function of named arguments")
    defaults = {n: a.default for n, a in arguments.items() if a.default is not a.empty}
    words = {n: v for n, v in defaults.items() if isinstance(v, str | bool)} | dict(options)
    names = [name for name in arguments if name != "contact" and name not in words]
    takes_contact = "contact" in arguments

    with_options = With(build, tuple(options.items()))
    ones = {name: defaults.get(name, 1.0) for name in names}
    law = _built(with_options, contact if takes_contact else None, takes_contact, ones, key)
    fields = declarations(type(law))
    whole = tuple(n for n in names if not np.isscalar(ones[n]) and np.ndim(ones[n]) != 0)
    return LawModel(
        key,
        with_options,
        type(law),
        {name: fields.get(name, Declared(name)) for name in names},
        {name: value for name, value in defaults.items() if name in names},
        words,
        whole,
        takes_contact,
        direct=False,
    )


def _built(build, contact, takes_contact: bool, ones, key: str) -> sj.ContactLaw:
    before = (contact,) if takes_contact else ()
    with jax.enable_x64(True):
        law = jax.eval_shape(lambda values: build(*before, **values), ones)
    if not isinstance(law, sj.ContactLaw):
        raise DataError("law", f"{key}, which builds {law!r}", "a function that builds a law")
    return law


def _options(law: type, key: str, options: Mapping[str, str]) -> dict[str, str]:
    """All options of a class with their values; raises for one it does not have."""
    choices = options_of(law)
    for name, value in options.items():
        if name not in choices:
            accepted = f"an option of {key}: {listed(choices) or 'it has none'}"
            raise DataError("option", name, accepted)
        if value not in choices[name]:
            raise DataError(name, repr(value), " or ".join(map(repr, choices[name])))
    return {name: options.get(name, values[0]) for name, values in choices.items()}
