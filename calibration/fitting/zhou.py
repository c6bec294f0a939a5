"""Zhou's law by other parameters: Eq. (18)'s line for χ̃, and ε_up in place of σ and ψ.

Above yield σ and ψ act only through ε_up = ε_17(v_cr). Where the data have no points below, ε_up is
what is fitted; ψ is held at a guess, and σ such that Eq. (17) gives ε_up at v_cr.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

import softjax as sj
from calibration.fitting.law_model import LawModel, model_of_class
from softjax.fields import Declared, declarations

LINE = ("c1", "c2")  # χ̃ = c1 + c2 E/Y, Eq. (18)
LEAST_CHI = 1e-9  # a line that dips below zero on the way has no collision to offer there
EXTRA = {
    "c1": Declared("c1"),
    "c2": Declared("c2"),
    "eps_up": Declared("ε_up", "-", "coefficient of restitution", 0.0, 1.0, True, True),
}
ALIKE = 0.01  # of v_cr/(v_lim - v_cr): pairs that differ by less have one ε_up to 1e-3 at most
NOT_GIVEN = -1.0  # ε_up of data sets that have σ, beside others that have ε_up


@dataclass(frozen=True)
class ByOthers:
    """build(contact, **parameters) of Zhou's law by c1 and c2, or by ε_up."""

    options: tuple[tuple[str, str], ...] = ()

    def __call__(self, contact: sj.Contact, **values: Any) -> sj.ContactLaw:
        chi = values["chi"] if "chi" in values else chi_on_line(contact, values)
        psi = values["psi"]
        sigma = values.get("sigma")
        if "eps_up" in values:
            given = jnp.asarray(values["eps_up"]) != NOT_GIVEN
            of_eps_up = sigma_of(contact, jnp.where(given, values["eps_up"], 0.5), psi)
            sigma = of_eps_up if sigma is None else jnp.where(given, of_eps_up, sigma)
        return sj.Zhou(contact, chi=chi, sigma=sigma, psi=psi, **dict(self.options))


def zhou_model(names: Iterable[str], options: Mapping[str, str]) -> LawModel:
    """Zhou's law by the parameters that are named: c1 and c2 for χ̃, ε_up for σ."""
    names = tuple(names)
    plain = model_of_class(sj.Zhou, "zhou", options)
    by_line, by_eps_up = any(name in LINE for name in names), "eps_up" in names
    if not (by_line or by_eps_up):
        return plain
    losses = [name for name in ("eps_up", "sigma") if name in names] or ["sigma"]
    chosen = [*(LINE if by_line else ("chi",)), *losses, "psi"]
    known = declarations(sj.Zhou) | EXTRA
    return LawModel(
        "zhou",
        ByOthers(tuple(plain.options.items())),
        sj.Zhou,
        {name: known[name] for name in chosen},
        options=plain.options,
        direct=False,
    )


def chi_on_line(contact: sj.Contact, values: Mapping[str, Any]) -> Any:
    """c1 + c2 E/Y, Eq. (18), kept from vanishing."""
    return jnp.maximum(values["c1"] + values["c2"] * contact.yield_ratio, LEAST_CHI)


def sigma_of(contact: sj.Contact, eps_up: Any, psi: Any) -> Any:
    """σ with which Eq. (17) is ε_up at the critical velocity."""
    critical, limit = contact.critical_velocity, contact.limit_velocity
    below = critical < limit
    ratio = jnp.where(below, critical / jnp.where(below, limit - critical, 1.0), 1.0)
    return -jnp.log(jnp.maximum(eps_up, 1e-300)) / ratio**psi


def several_yields(contact: sj.Contact | None) -> bool:
    """Whether impacts are of pairs whose ε_up = ε_17(v_cr) differ."""
    if contact is None:
        return False
    critical = np.asarray(contact.critical_velocity)
    ratio = critical / np.maximum(np.asarray(contact.limit_velocity) - critical, 1e-300)
    return bool(np.max(ratio) > (1 + ALIKE) * np.min(ratio))


def eps_up_of(law: sj.Zhou) -> Any:
    """ε_up = ε_17(v_cr), Eq. (16)."""
    contact = law.contact
    return sj.empirical_restitution(
        contact.critical_velocity, contact.limit_velocity, law.sigma, law.psi
    )
