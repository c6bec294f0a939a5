"""What is timed: impact velocities, a law, and what is exact about them.

Of stainless steel of Table 1, y = v/v_cr from 1.5 to 250, the exact answers are 40-digit arithmetic
rounded to 20 digits (tests/oracles/speed_reference.py made them), so that no way is ever compared
with itself.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np

import softjax as sj


@dataclass(frozen=True)
class Scene:
    """Impact velocities, the law, and what is exact about them.

    Attributes:
        law_of: builds the law from the three numbers of which gradients are taken.
        theta: these numbers.
        velocity: [m/s], shape (n,).
        exact: ε_p, shape (n,).
        slopes: θ ∂ε_p/∂θ, shape (3, n).
        damping: the number of each impact in a motion without units, where one is enough.
    """

    law_of: Callable[..., Any]
    theta: tuple[float, ...]
    velocity: np.ndarray
    exact: np.ndarray
    slopes: np.ndarray
    damping: Callable[[np.ndarray], np.ndarray] | None = None

    @property
    def law(self) -> Any:
        return self.law_of(*self.theta)

    @property
    def contact(self) -> sj.Contact:
        return self.law.contact

    def reduced(self) -> tuple[float, float, np.ndarray]:
        """d, X and y of Zhou's law: what the other ways integrate."""
        law, contact = self.law, self.contact
        velocity = self.velocity / contact.critical_velocity
        return law.plasticity(), law.chi * contact.yield_ratio, velocity


def stored(name: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Inputs and exact answers of a file beside this one."""
    text = resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
    found = json.loads(text)
    return found["inputs"], found["rows"]


@lru_cache
def stainless() -> Scene:
    """Gradients by χ̃, E and Y: all three numbers of the reduced collision move with these."""
    x, rows = stored("exact.json")

    def law_of(chi, youngs_modulus, yield_strength) -> sj.Zhou:
        contact = sj.Contact(
            youngs_modulus, x["R"], x["M"], yield_strength, x["v_lim"], area=x["area"]
        )
        return sj.Zhou(contact, chi, x["sigma"], x["psi"], form=x["form"], kappa=x["kappa"])

    names = ("chi", "E", "Y")
    return Scene(
        law_of,
        tuple(float(x[name]) for name in names),
        velocity=np.array([row["velocity"] for row in rows]),
        exact=np.array([float(row["eps_p"]) for row in rows]),
        slopes=np.array([[float(row["slopes"][n]) for row in rows] for n in names]),
    )
