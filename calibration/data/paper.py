"""The data of the main job: Eq. (17) with Table 1's coefficients, over the ranges of Fig. 2.

A published fit of measurements, not the measurements themselves: Zhou, Theor. Appl. Mech. Lett. 3,
021003 (2013) gives the rebounds measured by others only as Eq. (17) with σ and ψ.
"""

from typing import NamedTuple

import numpy as np

import softjax as sj
from calibration.data.measurements import RestitutionData

PAPER_NOTE = (
    "Eq. (17) with Table 1's coefficients of Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013): "
    "a published fit of measurements, not the measurements"
)
"""What the embedded data are, as every result fitted to them says."""
RADIUS = 0.0127  # m, of both spheres; the critical velocity of equal spheres does not depend on it


class PaperCurve(NamedTuple):
    """One panel of Fig. 2."""

    name: str
    material: sj.Material
    sigma: float  # Table 1
    psi: float  # Table 1
    y_end: float  # where the panel ends, in critical velocities


CURVES = (
    PaperCurve("stainless steel", sj.STAINLESS_STEEL, 3.0432, 0.5400, 250.0),
    PaperCurve("chrome steel", sj.CHROME_STEEL, 0.1418, 0.3114, 25.0),
    PaperCurve("nylon", sj.NYLON, 0.4355, 0.5414, 80.0),
)


def eq_17(velocity, limit_velocity, sigma: float, psi: float) -> np.ndarray:
    """ε_17 = exp{-σ [v/(v_lim - v)]^ψ} in double precision, whatever JAX is set to."""
    return np.exp(-sigma * (velocity / (limit_velocity - velocity)) ** psi)


def paper_materials(points: int = 40, area: str = "zhou") -> list[RestitutionData]:
    """The three data sets: y_i = 1 + i (y_end - 1)/points, i = 1 … points, in critical velocities."""
    return [paper_data(curve, points, area) for curve in CURVES]


def paper_data(curve: PaperCurve, points: int = 40, area: str = "zhou") -> RestitutionData:
    """One of them; `CURVES` has all three."""
    contact = sj.Contact.between_spheres(curve.material, curve.material, RADIUS, RADIUS, area)
    steps = np.arange(1, points + 1) * (curve.y_end - 1) / points
    velocity = (1 + steps) * float(contact.critical_velocity)
    return RestitutionData(
        velocity,
        eq_17(velocity, float(contact.limit_velocity), curve.sigma, curve.psi),
        contact,
        name=curve.name,
        remarks=(PAPER_NOTE,),
    )
