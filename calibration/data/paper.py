"""The data of the main job: Eq. (17) with Table 1's coefficients, over the ranges of Fig. 2.

A published fit of measurements, not the measurements themselves: Zhou, Theor. Appl. Mech. Lett. 3,
021003 (2013) gives the rebounds measured by others only as Eq. (17) with σ and ψ.
"""

import numpy as np

import softjax as sj
from calibration.data.measurements import RestitutionData
from calibration.paper import RADIUS, TABLE_1

PAPER_NOTE = (
    "Eq. (17) with Table 1's coefficients of Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013): "
    "a published fit of measurements, not the measurements"
)
"""What the embedded data are, as every result fitted to them says."""


def paper_materials(points: int = 40, area: str = "zhou") -> list[RestitutionData]:
    """The three data sets: y_i = 1 + i (y_end - 1)/points, i = 1 … points, in critical velocities."""
    found = []
    for entry in TABLE_1:
        contact = sj.Contact.between_spheres(entry.material, entry.material, RADIUS, RADIUS, area)
        steps = np.arange(1, points + 1) * (entry.largest_ratio - 1) / points
        velocity = (1 + steps) * float(contact.critical_velocity)
        ratio = velocity / (float(contact.limit_velocity) - velocity)
        eps = np.exp(-entry.sigma * ratio**entry.psi)  # Eq. (17)
        found.append(
            RestitutionData(velocity, eps, contact, name=entry.name, remarks=(PAPER_NOTE,))
        )
    return found
