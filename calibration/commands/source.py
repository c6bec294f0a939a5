"""The law of a command: of a material of the paper, of a file, or of a fit."""

import argparse
import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import softjax as sj
from calibration.commands.source_options import read_material_file
from calibration.console import print_first
from calibration.curves import Source
from calibration.data.checks import as_number
from calibration.errors import DataError, InputError, Origin, did_you_mean, listed, printable
from calibration.fit_result import FitResult
from calibration.fitting.laws import LAWS, law_name, sigma_of
from calibration.fitting.request import model_of_class
from calibration.options import LAW_OPTIONS, route_named
from calibration.paper import RADIUS, TABLE_1
from calibration.parameters import Parameter
from calibration.report.tables import warning_items

# What `softjax fit` finds for the paper's materials with its default settings. They go with
# `area="zhou"` and `kappa="consistent"`.
FITTED_CHI = {"stainless steel": 1.7944, "chrome steel": 0.09867, "nylon": 0.21998}
DECADES_BELOW_YIELD = 0.1  # default start of a grid, in critical velocities
FAR_ABOVE_YIELD = 100.0  # and its end without data
OF_LAW = ("law", "area")


def read_source(arguments: argparse.Namespace) -> Source:
    """The law that the options state; raises InputError or DataError."""
    _take_material(arguments)
    is_file = bool(Path(arguments.source or "").suffix)
    left_out: tuple[str, ...]
    if arguments.line is not None:
        left_out = ("fit", "posterior", "eps_up", "set", "restitution", "at", *OF_LAW)
        why = "with --line, whose law is Zhou's as it was fitted"
    elif arguments.fit is not None:
        is_own = callable(arguments.law)  # which no file contains
        left_out = ("eps_up", "set", "restitution", "at", "area", *["law"] * (not is_own))
        why = "with --fit, whose law is the fitted one"
    else:
        left_out = ("posterior", *["material"] * (not is_file))
        why = "without --fit or --line" + " or a file" * (not is_file)
    if not hasattr(arguments, "restitution"):  # other commands have another --at
        left_out = tuple(name for name in left_out if name != "at")
    for name in left_out:
        if getattr(arguments, name, None) not in (None, []):
            raise DataError(f"--{name.replace('_', '-')}", "given", f"left out {why}")
    if arguments.line is not None and not is_file:
        source = arguments.source or "missing"
        raise DataError("MATERIAL", source, "a material file FILE.toml with --line")
    if arguments.fit is not None:
        return _of_fit(arguments)
    return _of_file(arguments) if is_file else _of_paper(arguments)


def _take_material(arguments: argparse.Namespace) -> None:
    """Take the word without "=" after `--set` as the material, where none is named elsewhere."""
    words = [word for word in arguments.set if "=" not in word]
    if words and (len(words) > 1 or arguments.source is not None):
        raise DataError("--set", words[-1], "NAME=VALUE")
    arguments.source = words[0] if words else arguments.source
    arguments.set = [word for word in arguments.set if "=" in word]


def route_of(arguments: argparse.Namespace) -> sj.AbstractRoute | None:
    """The route that the options state; None without one."""
    if arguments.rtol is not None and arguments.route != "ode":
        raise DataError("--rtol", arguments.rtol, "given with --route ode only")
    if arguments.route is None:
        return None
    options = {"rtol": arguments.rtol} if arguments.route == "ode" else {}
    return route_named(arguments.route, **options)


def _of_paper(arguments: argparse.Namespace) -> Source:
    text = "stainless-steel" if arguments.source is None else arguments.source
    entries = {entry.name: entry for entry in TABLE_1}
    entry = entries.get(text.lower().replace("-", " ").replace("_", " "))
    if entry is None:
        names = listed(name.replace(" ", "-") for name in entries)
        near = did_you_mean(text, names.split(", "))
        raise DataError("MATERIAL", text, f"{names}, or a material file FILE.toml{near}")
    material, area = entry.material, arguments.area or "zhou"
    contact = sj.Contact.between_spheres(material, material, RADIUS, RADIUS, area=area)
    known, origin = {"sigma": entry.sigma, "psi": entry.psi}, ""
    name, stated = arguments.law or "zhou", _stated(arguments)
    if name == "zhou" and "chi" not in stated:  # χ̃ goes with the law's variant
        if stated.get("kappa") == "printed":
            known["chi"], origin = entry.chi, f", Table 1's χ̃ = {entry.chi:g}"
        elif area == "zhou":
            known["chi"] = FITTED_CHI[entry.name]
            origin = f", χ̃ = {known['chi']:g} as softjax fit finds it"
    critical = float(contact.critical_velocity)
    properties = {name: float(leaf) for name, leaf in material.leaves().items()}
    return Source(
        entry.name,
        _law(arguments, name, contact, known),
        (DECADES_BELOW_YIELD * critical, entry.largest_ratio * critical),
        properties | {"radius": RADIUS},
        remark=f"{entry.name}: two spheres of Table 1{origin}",
    )


def _of_file(arguments: argparse.Namespace) -> Source:
    file = read_material_file(arguments.source, needs_data=False)
    names = [entry.name for entry in file.materials]
    entry = file.materials[names.index(_chosen(arguments.material, names, arguments.source))]
    contact, data, where = entry.contact, entry.data, (entry.origin.file, entry.origin.line)
    if contact is None:
        accepted = "a law needs youngs_modulus and the others"
        raise InputError(*where, f"{entry.name!r} has no elastic properties", accepted)
    if any(map(np.ndim, contact.leaves().values())):
        accepted = "a curve is of one: give radius, and leave out data"
        raise InputError(*where, f"{entry.name!r} has bodies of several sizes", accepted)
    print_first(entry.implausible, arguments.quiet)
    if arguments.area is not None:
        contact = sj.Contact(**contact.leaves(), area=arguments.area)
    critical = float(np.asarray(contact.critical_velocity))
    last = FAR_ABOVE_YIELD * critical
    if data is not None:
        last = max(float(np.max(data.velocity)), 2 * critical)
    last = min(last, 0.99 * float(contact.limit_velocity))
    bodies, numbers = _bodies(entry.bodies)
    properties = None if entry.table.limit_velocity is not None else numbers
    remark = f"{printable(entry.name)}: {arguments.source}"
    if arguments.line is not None:
        line, measured, warnings = _line(arguments.line)
        lines = [f"{remark}, by {arguments.line}", *line.remarks(contact)]
        first, law, remark = critical, line.law(contact), "\n".join(lines)
        more: dict[str, Any] = {"line": line, "measured": measured, "warnings": warnings}
    else:
        known = {name: p.value for name, p in entry.stated.items() if not p.free}
        known |= {name: file.settings[name] for name in LAW_OPTIONS if name in file.settings}
        free = {name: parameter for name, parameter in entry.stated.items() if parameter.free}
        name = arguments.law or file.settings.get("law", "zhou")
        first, law = DECADES_BELOW_YIELD * critical, _law(arguments, name, contact, known, free)
        more = {"fall": None if data is None else data.fall}
    more |= {"gravity": entry.table.gravity}
    return Source(entry.name, law, (first, last), properties, bodies, remark=remark, **more)


def _line(path: Path) -> tuple[Any, tuple[float, float], list[str]]:
    """Eq. (18) of a fit's materials, the range of their velocities [m/s], and the fit's warnings."""
    result = FitResult.load(path)
    line = result.unloading_line
    if line is None or len(line.materials) < 2:
        problem = "has no line of Eq. (18)"
        accepted = "a fit of two or more materials, each with an unloading factor, is needed"
        raise InputError(path, None, problem, accepted)
    names = {material.name for material in line.materials}
    velocities = [fit.data.velocity for fit in result.materials if fit.name in names]
    return line, _ends(np.concatenate(velocities)), _words(result.warnings, result)


def _ends(velocity: np.ndarray) -> tuple[float, float]:
    return float(np.min(velocity)), float(np.max(velocity))


def _of_fit(arguments: argparse.Namespace) -> Source:
    if None not in (arguments.source, arguments.material):
        raise DataError("MATERIAL", arguments.source, "left out with --fit and --material")
    try:
        result = FitResult.load(arguments.fit, arguments.law)
    except DataError as error:  # a user's law, which no file contains
        problem = f"is a fit of {str(error.value).partition(',')[0]}, which is no built-in law"
        accepted = "give --law FILE.py:NAME, where that law is"
        raise InputError(arguments.fit, None, problem, accepted) from None
    if callable(arguments.law) and all(fit.model.key in LAWS for fit in result.materials):
        raise DataError("--law", law_name(arguments.law), "left out with a fit of a built-in law")
    names = [material.name for material in result.materials]
    name = arguments.source if arguments.material is None else arguments.material
    plain = name if name is None or name in names else name.replace("-", " ")
    fit = result.material(_chosen(plain, names, "the fit"))
    if fit.contact is not None and any(map(np.ndim, fit.contact.leaves().values())):
        stated = " ".join(f"{n}={e.value:.6g}" for n, e in fit.parameters.items() if e.value)
        accepted = (
            f"use a material file of one size: FILE.toml --law {fit.model.key} --set {stated}"
        )
        raise InputError(arguments.fit, None, f"{fit.name!r} has bodies of several sizes", accepted)
    low, high = _ends(fit.data.velocity)
    span = (0.5 * low, 2 * low) if low == high else (low, high)
    remark = f"{printable(fit.name)}: {arguments.fit}" + " (NOT CONVERGED)" * (not fit.converged)
    draws = None
    if getattr(arguments, "posterior", None) is not None:
        from calibration.fitting.posterior.draws import read

        draws = read(arguments.posterior)
    bodies, properties = _bodies(fit.data.bodies)
    parts = fit.name, fit.law, span, properties, bodies, result, draws
    more: dict[str, Any] = {"fall": fit.data.fall, "measured": (low, high)}
    return Source(*parts, remark=remark, warnings=_words(fit.warnings, result), **more)


def _words(warnings: Iterable[Any], result: FitResult) -> list[str]:
    """Warnings of a fit as its report has them."""
    return ["".join(item[:2]) for item in warning_items(warnings, result)]


def _chosen(name: str | None, names: list[str], where: str) -> str:
    """A material of a file or a fit, which need not be named where it is the only one."""
    if name is None and len(names) == 1:
        return names[0]
    if name not in names:
        value = "missing" if name is None else name
        raise DataError("--material", value, f"one of {where}'s: {listed(names)}")
    return str(name)


def _bodies(pair: Sequence[Any]) -> tuple[str, dict[str, float] | None]:
    """Description of two bodies, and their properties by name; none if unknown, or of each row."""
    if not pair or any(np.ndim(body.radius) for body in pair):
        return "spheres", None

    def numbers(body: Any, owner: str = "") -> dict[str, float]:
        return {f"{owner}{name}": float(x) for name, x in body.material.leaves().items()}

    first, second = pair
    if second.radius is None:
        return "wall", numbers(first) | {"radius": first.radius} | numbers(second, "wall.")
    radii = {"radius_1": first.radius, "radius_2": second.radius}
    if first.material.leaves() != second.material.leaves():
        return "unlike spheres", numbers(first) | numbers(second, "second.") | radii
    radii = {"radius": first.radius} if first.radius == second.radius else radii
    return "spheres", numbers(first) | radii


def _law(
    arguments: argparse.Namespace,
    name: Any,
    contact: sj.Contact,
    known: Mapping[str, Any],
    free: Mapping[str, Parameter] = MappingProxyType({}),
) -> sj.ContactLaw:
    """A law of a contact: its fields as the options state, else as `known` of the material.

    Parameters that a file leaves `free` are refused: neither a start nor a default is their value.
    """
    available = {"contact": contact, "limit_velocity": contact.limit_velocity} | dict(known)
    if callable(name):
        return _own_law(arguments, name, contact, available, free)
    fields = {field.name: field for field in dataclasses.fields(LAWS[name])}
    values = {field: value for field, value in available.items() if field in fields}
    stated = _stated(arguments)
    _check_names(stated, [field for field in fields if field != "contact"], f"a field of {name}")
    values |= stated
    _refuse_free({n: p for n, p in free.items() if n in fields and n not in stated})
    measured: tuple[Any, Any] = (None, None)
    if hasattr(arguments, "restitution"):  # other commands have another --at
        measured = arguments.restitution, arguments.at
    if measured != (None, None):
        if name != "viscoelastic" or "dissipation_time" in stated:
            accepted = "left out with dissipation_time, and with other laws than viscoelastic"
            raise DataError("--restitution", measured[0], accepted)
        values["dissipation_time"] = _dissipation_time(contact, *measured)
    eps_up = known.get("eps_up") if arguments.eps_up is None else arguments.eps_up
    if arguments.eps_up is not None and (name != "zhou" or "sigma" in stated):
        raise DataError("--eps-up", eps_up, "left out with sigma, and with other laws than zhou")
    by_eps_up = name == "zhou" and eps_up is not None and "sigma" not in stated
    if by_eps_up:
        as_number("--eps-up", eps_up, lambda restitution: 0 < restitution < 1, "between 0 and 1")
        values["sigma"] = 1.0  # until ψ is checked
    needed = [n for n, f in fields.items() if f.default is dataclasses.MISSING and n not in values]
    if needed:
        accepted = f"given with --set {' '.join(f'{field}=…' for field in needed)}"
        if by_eps_up and needed == ["psi"]:
            accepted += " (0.5, say; it acts below first yield only)"
        raise DataError("--law", name, f"{accepted}, or fitted first and read by --fit")
    law = LAWS[name](**values)
    if not by_eps_up:
        return law
    return dataclasses.replace(law, sigma=float(sigma_of(contact, eps_up, law.psi)))


def _refuse_free(parameters: Mapping[str, Parameter]) -> None:
    for name, parameter in parameters.items():
        problem = f"{name} is free" + ", and its value a start" * (parameter.value is not None)
        accepted = f"give --set {name}=X, fix it by a plain number, or read its fit by --fit"
        place = parameter.origin or Origin("")  # a file's parameters have one
        raise InputError(place.file, place.line, problem, accepted)


def _own_law(
    arguments: argparse.Namespace,
    law: Any,
    contact: sj.Contact,
    available: Mapping[str, Any],
    free: Mapping[str, Parameter],
) -> sj.ContactLaw:
    """A law of the user's own, its parameters as of `_law`."""
    for option in ("restitution", "eps_up"):
        if getattr(arguments, option, None) is not None:
            raise DataError(f"--{option.replace('_', '-')}", "given", "left out with your own law")
    stated = _stated(arguments)
    options = {name: value for name, value in stated.items() if isinstance(value, str)}
    model = model_of_class(law, contact, options)
    names = [*model.parameters]
    _check_names(stated, [*names, *model.options], f"a parameter of {model.key}")
    _refuse_free({n: p for n, p in free.items() if n in names and n not in stated})
    values = {name: available[name] for name in names if name in available} | stated
    values = {name: values[name] for name in names if name in values}
    needed = [name for name in names if name not in values and name not in model.defaults]
    if needed:
        accepted = f"given with --set {' '.join(f'{name}=…' for name in needed)}"
        raise DataError("--law", model.key, f"{accepted}, or fitted first and read by --fit")
    return model.law(contact, values)


def _dissipation_time(contact: sj.Contact, restitution: Any, velocity: Any) -> float:
    """A of one ε at one velocity."""
    if restitution is None or velocity is None:
        raise DataError("--restitution", restitution, "given with --at V, where it was measured")
    as_number("--restitution", restitution, lambda e: 0 < e <= 1, "above 0, and 1 at most")
    as_number("--at", velocity, lambda v: v > 0, "a positive velocity in m/s")
    law = sj.ViscoelasticHertz.from_restitution(contact, restitution, velocity)
    return float(law.dissipation_time)


def _stated(arguments: argparse.Namespace) -> dict[str, float | str]:
    """Read the values of `--set`, {name: value}."""
    stated: dict[str, float | str] = {}
    for assignment in arguments.set:
        name, _, text = (part.strip() for part in assignment.partition("="))
        name = name.replace("-", "_")
        stated[name] = text
        with suppress(ValueError):
            stated[name] = float(text)
    return stated


def _check_names(stated: Iterable[str], names: Iterable[str], what: str) -> None:
    names = [*names]
    for name in stated:
        if name not in names:
            accepted = f"{what}: {listed(names) or 'none'}{did_you_mean(name, names)}"
            raise DataError("--set", name, accepted)
