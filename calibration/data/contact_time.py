"""The duration of an impact, where flights are timed: t_c = c v^-p.

A ball that flies for T, touches the ground for t_c and flies again needs T + t_c from one bounce to the next, and
its two flights, extended into the contact, meet below the ground (`calibration.data.tracks`). Of two elastic
bodies that touch as Hertz's do, by their mass M and stiffness k = 4/3 E √R,

    t_c = τ (5 M/4k)^{2/5} v^{-1/5},    τ = 4√π Γ(2/5)/(5 Γ(9/10)) = 2.943275

25 mm of steel (E* 112.6 GPa, M 0.0638 kg) on a steel wall at 4 m/s: 65.9 µs.

Source: K. L. Johnson, Contact Mechanics (1985), section 11.4.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from calibration.data.checks import as_number
from calibration.data.units import quantity
from calibration.errors import DataError

OF_HERTZ = 0.2  # p of two solid spheres
HERTZ_IS_OFF = 0.2  # relative standard uncertainty of Hertz's duration: E of soft bodies, and yield
TAU = 4 * math.sqrt(math.pi) * math.gamma(0.4) / (5 * math.gamma(0.9))


class ContactTime(NamedTuple):
    """t_c = `factor` v^-`power` [s, m/s], its relative standard uncertainty, and where it is from.

    `factor` is one number, or one for each row of a table.
    """

    factor: Any
    power: float
    uncertainty: float
    source: str

    def take(self, count: int) -> "ContactTime":
        """That of the first rows of a table."""
        return self._replace(factor=self.factor[:count]) if np.ndim(self.factor) else self

    def at(self, velocity: Any) -> Any:
        """t_c [s] of impacts at these velocities [m/s]."""
        return self.factor * np.asarray(velocity, float) ** -self.power


def stated_contact(duration: Any) -> ContactTime | None:
    """One duration of all impacts, a number in s or text with its unit; None where it is not stated; raises DataError."""
    if duration is None:
        return None
    accepted = 'a time of 0 or more in s, or text with its unit ("4 ms")'
    try:
        value = quantity(duration, "s") if isinstance(duration, str) else duration
        number = as_number("bounce_contact_time", value, lambda t: t >= 0, accepted)
    except DataError:
        raise DataError("bounce_contact_time", duration, accepted) from None
    return ContactTime(number, 0.0, 0.0, "as stated")


def of_bodies(contact: Any) -> ContactTime | None:
    """Hertz's duration of two bodies; None without."""
    if contact is None:
        return None
    factor = TAU * np.asarray(1.25 * contact.mass / contact.stiffness) ** 0.4
    return ContactTime(factor[()], OF_HERTZ, HERTZ_IS_OFF, "Hertz's duration of the bodies")
