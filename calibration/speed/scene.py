"""The scene that is timed: stainless steel of Table 1, y = v/v_cr from 1.5 to 250.

The exact answers are 40-digit arithmetic rounded to 20 digits (tests/oracles/speed_reference.py
made them), so that no way is ever compared with itself.
"""

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np

import softjax as sj

GRADIENT_OF = ("chi", "E", "Y")  # all three numbers of the reduced collision move with these


@dataclass(frozen=True)
class Scene:
    """Impact velocities, the law, and what is exact about them."""

    inputs: dict
    velocity: np.ndarray  # [m/s], shape (n,)
    exact: np.ndarray  # ε_p, shape (n,)
    slopes: np.ndarray  # θ ∂ε_p/∂θ for `GRADIENT_OF`, shape (3, n)

    @property
    def contact(self) -> sj.Contact:
        x = self.inputs
        return sj.Contact(x["E"], x["R"], x["M"], x["Y"], x["v_lim"], area=x["area"])

    @property
    def law(self) -> sj.Zhou:
        return self.law_of(self.inputs["chi"], self.inputs["E"], self.inputs["Y"])

    def law_of(self, chi, youngs_modulus, yield_strength) -> sj.Zhou:
        """The law with other values of what the gradient is taken with respect to."""
        x = self.inputs
        contact = sj.Contact(
            youngs_modulus, x["R"], x["M"], yield_strength, x["v_lim"], area=x["area"]
        )
        return sj.Zhou(contact, chi, x["sigma"], x["psi"], form=x["form"], kappa=x["kappa"])

    @property
    def theta(self) -> tuple[float, ...]:
        return tuple(float(self.inputs[name]) for name in GRADIENT_OF)

    def reduced(self) -> tuple[float, float, np.ndarray]:
        """d, X and y: what the other ways integrate."""
        contact = self.contact
        steepness = self.inputs["chi"] * contact.yield_ratio
        return self.law.plasticity(), steepness, self.velocity / contact.critical_velocity

    def repeated(self, count: int) -> np.ndarray:
        """`count` velocities, the exact ones over and over."""
        return np.resize(self.velocity, count)


@lru_cache
def stainless() -> Scene:
    text = resources.files(__package__).joinpath("exact.json").read_text(encoding="utf-8")
    stored = json.loads(text)
    rows = stored["rows"]
    return Scene(
        inputs=stored["inputs"],
        velocity=np.array([row["velocity"] for row in rows]),
        exact=np.array([float(row["eps_p"]) for row in rows]),
        slopes=np.array([[float(row["slopes"][n]) for row in rows] for n in GRADIENT_OF]),
    )
