"""Numbers of the paper: Table 1, Eq. (18), and constants that do not follow from its equations.

Y. H. Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013), as far as a scan of it can be read.
"""

from typing import NamedTuple

import numpy as np

from calibration.data.measurements import RestitutionData
from softjax import CHROME_STEEL, NYLON, STAINLESS_STEEL, Contact, Material

UNLOADING_LINE = (3.518e-3, 3.757e-4)
"""c1, c2 of Eq. (18), χ̃ = c1 + c2 E/Y; the exponent of c1 as Table 1's χ̃ need it (printed: 10³)."""

RADIUS = 0.0127
"""Of both spheres [m]; the critical velocity of equal spheres does not depend on it."""


class TableEntry(NamedTuple):
    """One column of Table 1, as printed. Both bodies are equal."""

    name: str
    material: Material
    radii: tuple[float, ...]  # [m]
    critical_velocity: float  # [m/s]
    limit_velocity: float  # [m/s]
    sigma: float  # of Eq. (17) [-]
    psi: float  # of Eq. (17) [-]
    yield_ratio: float  # E/Y [-]
    chi: float  # unloading factor [-]
    largest_ratio: float  # the end of Fig. 2's axis, y = v/v_cr [-]


TABLE_1 = (
    TableEntry(
        *("stainless steel", STAINLESS_STEEL, (0.0127,)),
        *(0.0082, 340.0, 3.0432, 0.5400, 354.75, 0.1368, 250.0),
    ),
    TableEntry(
        *("chrome steel", CHROME_STEEL, (0.0127,)),
        *(0.9090, 882.0, 0.1418, 0.3114, 54.25, 0.0239, 25.0),
    ),
    TableEntry(
        *("nylon", NYLON, (0.00635, 0.0127, 0.0254)),
        *(0.8352, 324.0, 0.4355, 0.5414, 34.34, 0.0160, 80.0),
    ),
)
"""Table 1, a `TableEntry` a material."""

PAPER_NOTE = (
    "Eq. (17) with Table 1's coefficients of Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013): "
    "a published fit of measurements, not the measurements"
)
"""What the embedded data are, as every result fitted to them says."""


def paper_materials(points: int = 40, area: str = "zhou") -> list[RestitutionData]:
    """The three data sets: y_i = 1 + i (y_end - 1)/points, i = 1 … points, in critical velocities."""
    datasets = []
    for entry in TABLE_1:
        contact = Contact.between_spheres(entry.material, entry.material, RADIUS, RADIUS, area)
        steps = np.arange(1, points + 1) * (entry.largest_ratio - 1) / points
        velocity = (1 + steps) * float(contact.critical_velocity)
        ratio = velocity / (float(contact.limit_velocity) - velocity)
        eps = np.exp(-entry.sigma * ratio**entry.psi)  # Eq. (17)
        datasets.append(
            RestitutionData(velocity, eps, contact, name=entry.name, remarks=(PAPER_NOTE,))
        )
    return datasets
