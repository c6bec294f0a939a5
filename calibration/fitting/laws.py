"""Laws in a fit: how one is built, what its parameters are, and where a search starts.

A law is a class, the name of a built-in one, or any function that builds one:

    parameters -> build(contact, **parameters) -> a contact law

A class's parameters are its numeric fields except `contact`, a function's its arguments except
`contact`. Range, symbol and unit of each are what the law's field of that name declares.

What ε does not determine of a built-in law is fixed at a value of the right size: Walton and Braun's loading
stiffness and that of a linear spring at k √R, unless forces, times or overlaps were measured. Eq. (17)
takes its limit velocity from the data. Zhou's law may have c1 and c2 in place of χ̃, and ε_up in place
of σ and ψ, which above yield act only through ε_up = ε_17(v_cr): ψ is then fixed at a guess, and σ such
that Eq. (17) gives ε_up at v_cr."""

import dataclasses
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.data import RestitutionData
from calibration.errors import DataError, did_you_mean, listed
from calibration.options import LAWS as NAMES
from softjax.fields import NO_UNIT, Declared, declarations, options_of, shared_fields

CONTACT_LEAVES = declarations(sj.Contact)
OF_CONTACT = "contact."
SPRINGS = ("loading_stiffness", "unloading_stiffness")  # of Walton and Braun: k20 >= k1
# what v_cr depends on, and the power of each in it
AFFECTS_YIELD = {"yield_strength": 2.5, "youngs_modulus": -2.0, "radius": 1.5, "mass": -0.5}


class Tree(NamedTuple):
    """Structure of a parameter that is a pytree; hashable."""

    name: str  # of the parameter
    structure: Any  # of its pytree
    # the shape of each leaf of numbers; what is no number, an activation function, itself
    leaves: tuple[Any, ...]

    @classmethod
    def of(cls, name: str, value: Any) -> "Tree":
        leaves, structure = jax.tree.flatten(value)
        shapes = (np.shape(leaf) if eqx.is_array_like(leaf) else leaf for leaf in leaves)
        return cls(name, structure, tuple(shapes))

    @property
    def size(self) -> int:
        shapes = (leaf for leaf in self.leaves if isinstance(leaf, tuple))
        return sum(int(np.prod(shape, dtype=int)) for shape in shapes)

    @property
    def entries(self) -> list[str]:
        return [f"{self.name}[{k}]" for k in range(self.size)]

    def assembled(self, numbers: Sequence[Any]) -> Any:
        """The pytree of its numbers in a row."""
        leaves, first = [], 0
        for leaf in self.leaves:
            if isinstance(leaf, tuple):
                size = int(np.prod(leaf, dtype=int))
                some = jnp.stack(list(numbers[first : first + size]))
                leaf, first = some.reshape(leaf), first + size
            leaves.append(leaf)
        return jax.tree.unflatten(self.structure, leaves)


def numbers_in(value: Any) -> np.ndarray:
    """All numbers of a pytree in a row."""
    leaves = filter(eqx.is_array_like, jax.tree.leaves(value))
    return np.concatenate([np.ravel(np.asarray(leaf, float)) for leaf in leaves])


@dataclass(frozen=True, eq=False)
class LawModel:
    """A law as a fit sees it; equal where the same is built, so that it is compiled once."""

    key: str  # its name in files: that of `LAWS`, else the class's or function's own
    # build(contact=…, **parameters, **options), without the contact where it takes none
    build: Callable[..., sj.ContactLaw]
    law_type: type[sj.ContactLaw]  # the class of what it builds
    parameters: Mapping[str, Declared]  # what is known of each parameter, by name
    defaults: Mapping[str, Any]  # of fields or arguments that have one
    options: Mapping[str, Any]  # its options in words, with their values
    arrays: tuple[str, ...] = ()  # parameters that are arrays or pytrees, one for all impacts
    takes_contact: bool = True
    direct: bool = True  # whether a parameter is the law's field itself
    trees: tuple[Tree, ...] = ()  # how the numbers of arrays make up pytrees

    @property
    def _identity(self) -> tuple[Any, ...]:
        return self.build, self.takes_contact, self.trees, *sorted(self.options.items())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LawModel) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def label(self) -> str:
        """Name of the law in tables and pictures."""
        return KNOWN[self.key].label if self.key in KNOWN else self.key

    def law(self, contact: sj.Contact | None, values: Mapping[str, Any]) -> sj.ContactLaw:
        """The law with these parameters, of NumPy or of JAX.

        Those of the contact ("contact.radius") are among them, and each number of an array.
        """
        arguments = dict(values)
        for tree in self.trees:
            arguments[tree.name] = tree.assembled([arguments.pop(entry) for entry in tree.entries])
        moved = {name: arguments.pop(name) for name in values if name.startswith(OF_CONTACT)}
        if moved and contact is not None:
            leaves = {name.removeprefix(OF_CONTACT): value for name, value in moved.items()}
            contact = dataclasses.replace(contact, **leaves)
        bodies = {"contact": contact} if self.takes_contact else {}
        return self.build(**bodies, **arguments, **self.options)

    def inside(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The parameters, with a value at an excluded end of its range moved to the nearest number inside."""
        moved = dict(values)
        for name, value in values.items():
            if "[" in name or np.ndim(value):
                continue
            declared = self.declared(name)
            if value == declared.lower and not declared.with_lower:
                moved[name] = np.nextafter(value, np.inf) if value else np.finfo(float).tiny
            elif value == declared.upper and not declared.with_upper:
                moved[name] = np.nextafter(value, -np.inf)
        # the search goes on below k1
        if self.law_type is sj.WaltonBraun and {*SPRINGS} <= {*moved}:
            moved[SPRINGS[1]] = max(moved[name] for name in SPRINGS)
        return moved

    def declared(self, name: str) -> Declared:
        """Declaration of a parameter: symbol, unit and range."""
        if name.startswith(OF_CONTACT):
            return CONTACT_LEAVES[name.removeprefix(OF_CONTACT)]
        return self.parameters[name]

    def with_units(self, units: Mapping[str, str]) -> "LawModel":
        """The law with units of parameters for which its fields declare none.

        Raises:
            DataError: for another one than is declared.
        """
        known = dict(self.parameters)
        for name, unit in units.items():
            declared = self.declared(name)
            if declared.unit not in (*NO_UNIT, unit):
                raise DataError(f"unit of {name}", unit, f"{declared.unit}, as declared")
            known[name] = declared._replace(symbol=declared.symbol or name, unit=unit)
        return replace(self, parameters=known)

    def canonical(self, name: str) -> str:
        """The parameter's name; those of the pair of bodies begin with "contact.".

        Raises:
            ValueError: for a name the law does not have, and for one of the pair without "contact.",
                which may be meant of a body.
        """
        leaves = [OF_CONTACT + leaf for leaf in CONTACT_LEAVES] if self.takes_contact else []
        if name in self.parameters or name in leaves:
            return name
        if OF_CONTACT + name in leaves:
            accepted = (
                f"{OF_CONTACT}{name}, of the pair of bodies, or {name} of a body, stated with it"
            )
            raise DataError("parameter", name, accepted)
        known = [*self.parameters, *leaves]
        known += [extra for extra in EXTRA if self.key == "zhou" and extra not in known]
        accepted = f"of {self.key}: {listed(known)}{did_you_mean(name, known)}"
        raise DataError("parameter", name, accepted)


def model_of(
    build: Callable[..., Any], key: str, contact: sj.Contact | None, given: Mapping[str, Any]
) -> LawModel:
    """A class of laws, whose fields except `contact` are its parameters, or a function that builds one.

    A function's are its arguments; what type of law it builds is found by building one abstractly.

    Args:
        given: the options that are stated.
    """
    arguments = inspect.signature(build).parameters
    defaults = {n: a.default for n, a in arguments.items() if a.default is not a.empty}
    options: dict[str, Any]
    if isinstance(build, type):
        options, law_type, arrays = _options(build, key, given), build, shared_fields(build)
        names = [*declarations(build), *arrays]
    else:
        odd = [
            n
            for n, a in arguments.items()
            if a.kind not in (a.POSITIONAL_OR_KEYWORD, a.KEYWORD_ONLY)
        ]
        if odd:
            argument = f"{key} with the argument {odd[0]}"
            raise DataError("law", argument, "a function of named arguments")
        options = {n: v for n, v in defaults.items() if isinstance(v, str | bool)} | dict(given)
        names = [name for name in arguments if name != "contact" and name not in options]
        ones = {name: defaults.get(name, 1.0) for name in names}
        arrays = tuple(name for name, value in ones.items() if np.ndim(value))
        bodies = {"contact": contact} if "contact" in arguments else {}
        with jax.enable_x64(True):
            law = jax.eval_shape(lambda some: build(**some, **options), bodies | ones)
        if not isinstance(law, sj.ContactLaw):
            raise DataError("law", f"{key}, which builds {law!r}", "a function that builds a law")
        law_type = type(law)
    declared = declarations(law_type)
    return LawModel(
        key,
        build,
        law_type,
        {name: declared.get(name, Declared(name)) for name in names},
        {name: defaults[name] for name in names if name in defaults},
        options,
        arrays,
        takes_contact="contact" in arguments,
        direct=isinstance(build, type),
    )


def _options(law: type, key: str, given: Mapping[str, str]) -> dict[str, str]:
    """All options of a class with their values; raises for one it does not have."""
    choices = options_of(law)
    for name, value in given.items():
        if name not in choices:
            accepted = f"left out with {key} (its options: {listed(choices) or 'none'})"
            raise DataError(name, value, accepted)
        if value not in choices[name]:
            raise DataError(name, repr(value), " or ".join(map(repr, choices[name])))
    return {name: given.get(name, values[0]) for name, values in choices.items()}


class Start(NamedTuple):
    """Start of a search of a built-in law, from the data: numbers by parameter."""

    guess: Mapping[str, Any] = {}
    fixed: Mapping[str, Any] = {}  # what ε does not determine, with the value it is fixed at
    ranges: Mapping[str, tuple[float, float]] = {}  # ends of a parameter's range
    ends: Mapping[str, float] = {}  # where a search upwards ends if no bound is stated
    reach: Mapping[str, float] = {}  # how far up from its start one may go, in log units


@dataclass(frozen=True)
class Known:
    """A built-in law: its label in tables and pictures, start, and what a reader of a comparison should know."""

    law: type
    label: str
    start: Callable[[RestitutionData], Start] = lambda _: Start()
    remark: str = ""


def _measured(data: RestitutionData, *more: Any) -> tuple[np.ndarray, ...]:
    """v, ε and more of the impacts with an ε; of one of a half where there is none."""
    rows = np.flatnonzero(np.isfinite(data.restitution))
    rows = rows if len(rows) else np.array([0])
    each = (np.broadcast_to(np.asarray(column, float), len(data))[rows] for column in more)
    return data.velocity[rows], np.nan_to_num(data.restitution[rows], nan=0.5), *each


def _bodies(data: RestitutionData) -> dict[str, float]:
    """Means of the contact's numbers, and k √R [N/m], a linear spring that is as stiff as Hertz's contact."""
    contact = data.contact
    assert contact is not None
    names = ("yield_ratio", "stiffness", "radius", "mass")
    means = {name: float(np.mean(np.asarray(getattr(contact, name)))) for name in names}
    return means | {"spring": means["stiffness"] * means["radius"] ** 0.5}


def _losses(data: RestitutionData) -> dict[str, float]:
    """σ and ψ from the straight line ln(-ln ε) = ln σ + ψ ln[v/(v_lim - v)]."""
    velocity, restitution, limit = _measured(data, data.limit_velocity)
    inside = (restitution > 0) & (restitution < 1) & np.isfinite(limit)
    if np.sum(inside) < 2:
        return {"sigma": 0.5, "psi": 0.5}
    x = np.log((velocity / (limit - velocity))[inside])
    loss = -np.log(restitution[inside])
    centred = x - np.average(x, weights=loss)
    spread = np.sum(loss * centred**2)
    slope = np.sum(loss * centred * np.log(loss)) / spread if spread > 0 else 0.5
    psi = float(np.clip(slope, 0.05, 3.0))
    level = np.average(np.log(loss) - psi * x, weights=loss)
    return {"sigma": float(np.exp(np.clip(level, -20, 20))), "psi": psi}


# with ε kept at yield σ grows as [(v_lim - v_cr)/v_cr]^ψ, e^(11 ψ) of stainless steel
LARGEST_PSI = 20.0  # a loss that is e times less 5 % more slowly: no measurement tells more
OF_LOSSES: dict[str, Any] = {"ends": {"psi": LARGEST_PSI}, "reach": {"sigma": 400.0}}


def _of_zhou(data: RestitutionData) -> Start:
    """χ̃ of X = 10, in the middle of what materials have, and Eq. (17)'s coefficients."""
    ratio = _bodies(data)["yield_ratio"]
    up = float(np.clip(np.max(_measured(data)[1]), 0.1, 0.999))
    guess = {"chi": 10 / ratio, "eps_up": up, "c1": 0.0, "c2": 10 / ratio**2, **_losses(data)}
    return Start(guess, ranges={OF_CONTACT + "limit_velocity": _beyond_fastest(data)}, **OF_LOSSES)


def _of_thornton(data: RestitutionData) -> Start:
    """ε ≈ 1.185 (V_y/v)^{1/4} far above yield, and V_y ∝ p_y^{5/2}."""
    at_one = float(np.mean(np.asarray(sj.Thornton(data.contact).elastic_velocity())))
    velocity, restitution = _measured(data)
    yields = np.median(velocity * (np.clip(restitution, 0.05, 0.99) / 1.185) ** 4)
    return Start({"yield_factor": float(np.clip((yields / at_one) ** 0.4, 1e-3, 1e3))})


def _of_walton_braun(data: RestitutionData) -> Start:
    """1/ε² = k20/k1 + s v √(M/k1), a straight line."""
    bodies, (velocity, restitution) = _bodies(data), _measured(data)
    inverse, loading = np.clip(restitution, 0.05, 1.0) ** -2, bodies["spring"]
    slope, level = np.polyfit(velocity, inverse, 1) if np.ptp(velocity) else (0, 1.5)
    growth = max(slope, 0.01 * float(np.mean(inverse)) / float(np.max(velocity)))
    guess = {"loading_stiffness": loading, "unloading_stiffness": max(level, 1.01) * loading}
    guess["growth"] = growth * (loading / bodies["mass"]) ** 0.5
    if data.observed:
        return Start(guess)
    ranges = {"unloading_stiffness": (loading, np.inf)}
    return Start(guess, {"loading_stiffness": loading}, ranges)


def _of_viscoelastic(data: RestitutionData) -> Start:
    """1 - ε ≈ 1.15345 · 3/2 A (k/M)^{2/5} v^{1/5} of slow impacts."""
    assert data.contact is not None
    stiffness = np.asarray(data.contact.stiffness / data.contact.mass)
    velocity, restitution, stiffness = _measured(data, stiffness)
    lost, rate = np.clip(1 - restitution, 1e-3, 0.9), stiffness**0.4 * velocity**0.2
    return Start({"dissipation_time": float(np.median(lost / (1.5 * 1.15345 * rate)))})


def _of_mean(data: RestitutionData) -> Start:
    return Start({"restitution": float(np.clip(np.mean(_measured(data)[1]), 1e-3, 0.999))})


def _of_linear(data: RestitutionData) -> Start:
    stiffness = {"stiffness": _bodies(data)["spring"]}
    return Start({**_of_mean(data).guess, **stiffness}, {} if data.observed else stiffness)


def _of_eq_17(data: RestitutionData) -> Start:
    limit = {} if data.limit_velocity is None else {"limit_velocity": data.limit_velocity}
    return Start(_losses(data), limit, {"limit_velocity": _beyond_fastest(data)}, **OF_LOSSES)


def _beyond_fastest(data: RestitutionData) -> tuple[float, float]:
    return float(np.max(data.velocity)), np.inf


BUILT_IN = (
    Known(sj.Zhou, "Zhou", _of_zhou),
    Known(
        sj.Thornton,
        "Thornton, yield pressure free",
        _of_thornton,
        "Hertz's contact area; the literature's p_y/Y are 1.6 to 2.8.",
    ),
    Known(
        sj.WaltonBraun,
        "Walton–Braun",
        _of_walton_braun,
        "ε does not determine k1, which is fixed at k √R; k20 and s are in proportion to it.",
    ),
    Known(sj.ViscoelasticHertz, "viscoelastic Hertz", _of_viscoelastic),
    Known(sj.Hertz, "Hertz", remark="Nothing to fit: ε = 1."),
    Known(
        sj.HertzDashpot,
        "Hertz with dashpot",
        _of_mean,
        "ε is an input of the law, the same at all velocities.",
    ),
    Known(
        sj.LinearSpringDashpot,
        "linear spring–dashpot",
        _of_linear,
        "ε is an input of the law, the same at all velocities; it does not determine K.",
    ),
    Known(
        sj.ConstantRestitution,
        "constant ε (hard spheres)",
        _of_mean,
        "ε is an input of the law; fitted is its mean.",
    ),
    Known(
        sj.EmpiricalRestitution,
        "Eq. (17), empirical",
        _of_eq_17,
        "A formula without a collision, as a baseline.",
    ),
)
# by the names that `calibration.options` gives them
KNOWN: dict[str, Known] = {
    name: known
    for name, class_name in NAMES.items()
    for known in BUILT_IN
    if known.law.__name__ == class_name
}
LAWS: dict[str, type] = {name: known.law for name, known in KNOWN.items()}
"""The built-in contact laws by the names that `fit`, `compare` and the commands take."""
WITHOUT_CONTACT = ("constant", "eq-17")  # laws that need no elastic properties


def law_name(law: Any) -> str | None:
    """The name by which files call a law."""
    if law is None or isinstance(law, str):
        return law
    built_in = next((key for key, known in LAWS.items() if known is law), None)
    return built_in or getattr(law, "__name__", type(law).__name__)


LINE = ("c1", "c2")  # χ̃ = c1 + c2 E/Y, Eq. (18)
LEAST_CHI = 1e-9  # a line that dips below zero on the way has no collision to offer there
EXTRA = {
    "c1": Declared("c1"),
    "c2": Declared("c2"),
    "eps_up": Declared("ε_up", "-", "coefficient of restitution", 0.0, 1.0, True, True),
}
ALIKE = 0.01  # of v_cr/(v_lim - v_cr): pairs that differ by less have one ε_up to 1e-3 at most
NOT_GIVEN = np.nan


def zhou_by_others(
    contact: sj.Contact,
    *,
    psi: Any,
    chi: Any = NOT_GIVEN,
    c1: Any = NOT_GIVEN,
    c2: Any = NOT_GIVEN,
    sigma: Any = NOT_GIVEN,
    eps_up: Any = NOT_GIVEN,
    **options: str,
) -> sj.ContactLaw:
    """Zhou's law, by c1 and c2 where χ̃ is not given, by ε_up where σ is not; NaN is not given."""
    xp = _numpy_for(contact, psi, chi, c1, c2, sigma, eps_up)
    given = lambda value, otherwise: xp.where(xp.isnan(value), otherwise, value)  # noqa: E731
    line = given(c1, 0.0) + given(c2, 0.0) * contact.yield_ratio
    chi = given(chi, xp.maximum(line, LEAST_CHI))
    sigma = given(sigma, sigma_of(contact, given(eps_up, 0.5), psi))
    return sj.Zhou(contact, chi=chi, sigma=sigma, psi=psi, **options)


def _numpy_for(*values: Any) -> Any:
    """NumPy where nothing is JAX's: a few numbers are not worth compiling for."""
    leaves = jax.tree.leaves(values)
    return jnp if any(isinstance(leaf, jax.Array) for leaf in leaves) else np


def zhou_model(names: Iterable[str], options: Mapping[str, str]) -> LawModel:
    """Zhou's law by the parameters that are named: c1 and c2 for χ̃, ε_up for σ."""
    names, plain = tuple(names), model_of(sj.Zhou, "zhou", None, options)
    by_line, by_eps_up = any(name in LINE for name in names), "eps_up" in names
    if not (by_line or by_eps_up):
        return plain
    known = {**plain.parameters, **EXTRA}
    chosen = [*(LINE if by_line else ("chi",)), "eps_up" if by_eps_up else "sigma", "psi"]
    parameters = {name: known[name] for name in chosen}
    return replace(plain, build=zhou_by_others, parameters=parameters, direct=False)


def sigma_of(contact: sj.Contact, eps_up: Any, psi: Any) -> Any:
    """σ with which Eq. (17) is ε_up at the critical velocity."""
    critical, limit = contact.critical_velocity, contact.limit_velocity
    xp, below = _numpy_for(contact, eps_up, psi), critical < limit
    ratio = xp.where(below, critical / xp.where(below, limit - critical, 1.0), 1.0)
    with np.errstate(over="ignore", divide="ignore"):
        return -xp.log(xp.maximum(eps_up, 1e-300)) / ratio**psi


def several_yields(contact: sj.Contact | None) -> bool:
    """Whether impacts are of pairs whose ε_up = ε_17(v_cr) differ."""
    if contact is None:
        return False
    critical = np.asarray(contact.critical_velocity)
    ratio = critical / np.maximum(np.asarray(contact.limit_velocity) - critical, 1e-300)
    return bool(np.max(ratio) > (1 + ALIKE) * np.min(ratio))


def eq_17(velocity: Any, limit_velocity: Any, sigma: Any, psi: Any) -> Any:
    """ε by Eq. (17), of NumPy or JAX; 0 from the limit velocity on."""
    xp, below = _numpy_for(velocity, limit_velocity, sigma, psi), velocity < limit_velocity
    ratio = velocity / xp.where(below, limit_velocity - velocity, 1.0)
    return xp.where(below, xp.exp(-sigma * ratio**psi), 0.0)


def eps_up_of(law: sj.Zhou) -> Any:
    """ε_up = ε_17(v_cr), Eq. (16); of bodies that differ from impact to impact the mean."""
    at = law.contact.critical_velocity, law.contact.limit_velocity
    return _numpy_for(law).mean(eq_17(*at, law.sigma, law.psi))
