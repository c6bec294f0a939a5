"""Laws and reference collisions that several test modules share; no values of the library's own."""

import json
import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import softjax as sj

FORMS = ("first-order", "full")
EPS = float(np.finfo(np.float64).eps)

MATERIALS = {
    "stainless steel": sj.STAINLESS_STEEL,
    "chrome steel": sj.CHROME_STEEL,
    "nylon": sj.NYLON,
}
RADIUS = 0.0127  # m, the spheres of Table 1
FITTED = {  # χ̃ that fits the paper's curves with the consistent κ; σ and ψ of Table 1
    "stainless steel": {"chi": 1.7944, "sigma": 3.0432, "psi": 0.54},
    "chrome steel": {"chi": 0.09867, "sigma": 0.1418, "psi": 0.3114},
    "nylon": {"chi": 0.21998, "sigma": 0.4355, "psi": 0.5414},
}


def mostly_long(names: str, every, quick=None):
    """A test of all cases: of those in `quick`, or of the first one, by default, else a long one."""

    def param(k, case):
        is_quick = k == 0 if quick is None else case in quick
        values = case if isinstance(case, tuple) else (case,)
        return pytest.param(*values, marks=() if is_quick else pytest.mark.long)

    return pytest.mark.parametrize(names, [param(*one) for one in enumerate(every)])


def pair(name: str, area: str = "zhou") -> sj.Contact:
    """Two equal spheres of a material of Table 1."""
    material = MATERIALS[name]
    return sj.Contact.between_spheres(material, material, RADIUS, RADIUS, area=area)


def fitted(name: str, form: str = "first-order", **changed) -> sj.Zhou:
    """The fitted law of a material of Table 1."""
    return sj.Zhou(pair(name), **(FITTED[name] | changed), form=form)


def curve(law, velocity) -> np.ndarray:
    """ε of a law."""
    return np.asarray(sj.restitution(law, velocity).coefficient)


def law_with(d, X, form: str = "first-order", sigma=0.0, psi=1.0) -> sj.Zhou:
    """A law in SI units that reduces to the given d and X, every number of it as they are."""
    ratio = math.pi ** (4 / 3) * np.sqrt(3 / 8 / np.asarray(d))  # d = (3/8) π^{8/3} (Y/E)²
    ones = np.ones_like(ratio)
    contact = sj.Contact(ratio * 1e8, 0.01 * ones, 0.02 * ones, 1e8 * ones, 1e6 * ones)
    return sj.Zhou(contact, np.asarray(X) / ratio, sigma * ones, psi * ones, form=form)


def law_of(inputs: dict) -> sj.Zhou:
    """The law of the effective inputs of a reference collision, which may be arrays."""
    names = ("E", "R", "M", "Y", "v_lim")
    contact = sj.Contact(*(inputs[name] for name in names), area=inputs["area"])
    parameters = {name: inputs[name] for name in ("chi", "sigma", "psi", "form", "kappa")}
    return sj.Zhou(contact, **parameters)


@lru_cache
def reference() -> dict:
    """`oracles/reference.json`."""
    path = Path(__file__).parent / "oracles" / "reference.json"
    return json.loads(path.read_text(encoding="utf-8"))


def of_form(section: str, form: str) -> list[dict]:
    """The reference collisions of one form."""
    records = reference()[section]
    return [r for r in records if r.get("inputs", r)["form"] == form]


def column(records: list[dict], *keys: str) -> np.ndarray:
    """One number of each record as float64; NaN where it is undefined."""
    values = []
    for value in records:
        for key in keys:
            value = value[key]
        values.append(math.nan if value is None else float(value))
    return np.array(values)


def stacked_inputs(records: list[dict], size: int | None = None) -> dict:
    """The inputs of many collisions as arrays, repeated up to a size; texts must be the same in all."""
    first = records[0]["inputs"]
    return {
        name: value
        if isinstance(value, str)
        else np.resize(column(records, "inputs", name), size or len(records))
        for name, value in first.items()
    }


# What formulas and reference collisions tell of. A further flag, of a law's range say, is none of their matter: its
# own test looks at it, and no other test breaks.
TOLD = (
    sj.Status.ELASTIC
    | sj.Status.NO_RESIDUAL_OVERLAP
    | sj.Status.ENERGY_GAIN
    | sj.Status.NO_REBOUND
    | sj.Status.BEYOND_EXPANSION
    | sj.Status.NO_TURNING_POINT
    | sj.Status.ABOVE_LIMIT_VELOCITY
    | sj.Status.ZERO_VELOCITY
    | sj.Status.INVALID_INPUT
    | sj.Status.SOLVER_FAILED
    | sj.Status.INEXACT
    | sj.Status.NO_END
)


def same_flags(found, expected):
    """Whether the status is that of an oracle, as far as oracles tell; elementwise."""
    return ((np.asarray(found) ^ np.asarray(expected)) & int(TOLD)) == 0


def flags_of(records: list[dict]) -> np.ndarray:
    """The expected status of each record as an integer."""
    return np.array([sum(int(sj.Status[name]) for name in r["flags"]) for r in records])
