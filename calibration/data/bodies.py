"""Bodies that collide: the sphere that flies, a second sphere, a wall."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.data.checks import require

POSITIVE = "a positive number"


@dataclass(frozen=True)
class Body:
    """One body of an impact; what is not known of it is None.

    Attributes:
        name: "sphere", "second sphere" or "wall".
        material: its elastic properties.
        radius: R [m] of a sphere, one number or (n,), one for each row of a table; None of a wall.
        stated_mass: m [kg], one number or (n,), where it is stated instead of a density.
        stated_density: ρ [kg/m³], where it is known without the elastic properties.
    """

    name: str
    material: sj.Material | None
    radius: Any
    stated_mass: Any = None
    stated_density: Any = None

    @classmethod
    def sphere(cls, diameter: Any = None, mass: Any = None, density: Any = None) -> "Body":
        """The sphere that flies, by its size and mass [m, kg, kg/m³]; raises DataError."""
        for name, value in (("diameter", diameter), ("mass", mass), ("density", density)):
            if value is not None:
                require(name, np.atleast_1d(value), lambda x: x > 0, POSITIVE)
        radius = None if diameter is None else np.asarray(diameter) / 2
        return cls("sphere", None, radius, mass, density)

    @property
    def diameter(self) -> Any:
        """2R [m]."""
        return None if self.radius is None else 2 * np.asarray(self.radius)

    @property
    def density(self) -> Any:
        """ρ [kg/m³], as stated or of the material."""
        if self.stated_density is None and self.material is not None:
            return self.material.density
        return self.stated_density

    @property
    def mass(self) -> Any:
        """m [kg], as stated or 4/3 π R³ ρ."""
        if self.stated_mass is not None:
            return self.stated_mass
        if self.radius is None or self.density is None:
            return None
        return np.pi / 6 * np.asarray(self.diameter) ** 3 * self.density

    @property
    def is_ball(self) -> bool:
        """Whether its size and its mass are known, which its drag in air depends on."""
        return self.radius is not None and self.mass is not None

    def of_rows(self, diameter: Any = None, radius: Any = None, mass: Any = None) -> "Body":
        """This sphere with a size or a mass [m, m, kg] from columns of a table, (n,)."""
        radius = radius if diameter is None else diameter / 2
        if radius is None and mass is not None and self.density is not None:
            radius = (3 * mass / (4 * np.pi * self.density)) ** (1 / 3)
        changed = {} if radius is None else {"radius": radius}
        return replace(self, **changed | ({} if mass is None else {"stated_mass": mass}))

    def take(self, rows: Any) -> "Body":
        """The sphere of some rows."""
        each = {name: getattr(self, name) for name in ("radius", "stated_mass")}
        return replace(self, **{name: x[rows] for name, x in each.items() if np.ndim(x)})


def yielding(bodies: Sequence[Body]) -> Body | None:
    """The body of the lower yield strength; None where both have one, or it is not known of two."""
    known = [body.material.yield_strength for body in bodies if body.material is not None]
    if len(known) != 2 or known[0] == known[1]:
        return None
    return bodies[int(known[1] < known[0])]
