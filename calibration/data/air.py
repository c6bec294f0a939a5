"""Flights of a ball in air: heights and times as velocities.

With quadratic drag, buoyancy, and the added mass of the air that moves along,

    g' = g (1 - ρ_a/ρ)/(1 + ρ_a/2ρ),    v_t² = 2 (1 - ρ_a/ρ) m g/(ρ_a C_d A)
    fall from h      v₁ = v_t √(1 - e^{-2 g' h/v_t²})
    rise to h        v₀ = v_t √(e^{2 g' h/v_t²} - 1)
    flight of T      T = (v_t/g') [arctan(v₀/v_t) + arsinh(v₀/v_t)],    v₁ = v₀/√(1 + v₀²/v_t²)

which is exact for a constant C_d. That of a smooth sphere depends on Re = ρ_a v D/μ,

    C_d = 24/Re (1 + 0.150 Re^0.681) + 0.407/(1 + 8710/Re),    Re < 2·10⁵

and affects heights, times and velocities in the same way, to first order, by its mean over the flight with the
weight v³ (about C_d at 0.77 of the largest speed).

Source: Brown and Lawler, J. Environ. Eng. 129, 222 (2003), Eq. 19, of C_d; Timmerman and van der
Weele, Am. J. Phys. 67, 538 (1999), of flights with quadratic drag.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.data.bodies import Body
from calibration.data.checks import Column, as_number
from calibration.data.units import quantity, unit_of
from calibration.errors import DataError

DENSITY = 1.2  # kg/m³, dry air of 20 °C and 1013 hPa
VISCOSITY = 1.81e-5  # Pa s, at 20 °C; nearly independent of the pressure
FASTEST = 2e5  # Reynolds number up to which C_d was correlated
UNCERTAIN = 0.1  # standard uncertainty of C_d as a part of it, of one ball and day
ROUNDS = 20  # for C_d and speed to settle at most, each a factor of 4 or more closer
SETTLED = 2e-15  # of a speed: less is rounding
STEP = 1e-4  # of differences, in parts
CORRECTED = "corrected for air"  # how a remark begins
ACCEPTED = 'true, false, or a density of air such as "1.2 kg/m³", of 1e-4 to 20 kg/m³'
NODES, SHARES = np.polynomial.legendre.leggauss(5)
NODES = 0.5 * (NODES + 1)
SHARES = 2 * SHARES * NODES**3  # of ∫ 4 s³ C_d(s v) ds
OF_POWERS = [float(SHARES @ NODES**power) for power in (-1.0, 0.681 - 1)]


def mean_drag_coefficient(fastest: Any) -> Any:
    """∫₀¹ 4 s³ C_d(s Re) ds of a smooth sphere, by its largest Re; see above."""
    slow = 24 * OF_POWERS[0] / fastest + 24 * 0.150 * OF_POWERS[1] * fastest ** (0.681 - 1)
    return slow + sum(
        0.407 * share * node * fastest / (node * fastest + 8710)
        for node, share in zip(NODES, SHARES, strict=True)
    )


@dataclass(frozen=True)
class Fall:
    """Conversion from velocities to drop heights, in the unit and the air of a data set.

    Attributes:
        unit: of the file's heights.
        gravity: g [m/s²].
        density: of the air [kg/m³]; None: no correction.
        diameter, mass: of the ball [m, kg]; None where they are not known.
        has_rebounds: whether ε comes from rebound heights.
    """

    unit: str = "m"
    gravity: float = 9.80665
    density: float | None = None
    diameter: float | None = None
    mass: float | None = None
    has_rebounds: bool = False

    def height(self, velocity: Column, which: str = "height") -> Column:
        """Drop heights, in `unit`, of impacts at `velocity` [m/s]."""
        height = velocity * (velocity / (2 * self.gravity))
        if self.density is not None:
            ball = Body.sphere(self.diameter, self.mass)
            air = Air(ball, self.gravity, self.density)
            height = getattr(air, which)(velocity)
        return height / float(unit_of(self.unit, "m"))

    def rebound_height(self, velocity: Column) -> Column:
        """Heights, in `unit`, of rebounds that start at `velocity` [m/s]."""
        return self.height(velocity, "rebound_height")


@dataclass(frozen=True)
class Air:
    """A ball, and the air that it flies in.

    Attributes:
        ball: a sphere of known size and mass, one or one for each row.
        gravity: g [m/s²].
        density: ρ_a [kg/m³].
        drag: factor on C_d.
    """

    ball: Body
    gravity: float
    density: float = DENSITY
    drag: float = 1.0

    def take(self, rows) -> "Air":
        """That of some rows."""
        return replace(self, ball=self.ball.take(rows))

    def fall(self, height: Column) -> Column:
        """Speed at the end of a fall from `height` [m], (n,) [m/s]."""
        return self._settled(height, _fall)

    def rise(self, height: Column) -> Column:
        """Speed with which a ball that rises to `height` [m] starts, (n,) [m/s]."""
        return self._settled(height, _rise)

    def take_off(self, time: Column) -> Column:
        """Speed with which a flight of `time` [s] to the same height starts, (n,) [m/s]."""
        return self._settled(time, _take_off)

    def landing(self, time: Column) -> Column:
        """Speed at the end of a flight of `time` [s] to the same height, (n,) [m/s]."""
        start = self.take_off(time)
        return start / np.sqrt(1 + start**2 / self._terminal(start) ** 2)

    def slope(self, speed: str, x: Column) -> Column:
        """Derivative of one of the speeds above, by its name, in the height or time."""
        of = getattr(self, speed)
        return (of(x * (1 + STEP)) - of(x * (1 - STEP))) / np.where(x > 0, 2 * STEP * x, 1.0)

    def by_drag(self, speed: str, x: Column) -> Column:
        """Derivative of one of the speeds in c, with a drag coefficient of (1 + c) C_d."""
        more, less = (replace(self, drag=self.drag * (1 + s * STEP)) for s in (1, -1))
        return (getattr(more, speed)(x) - getattr(less, speed)(x)) / (2 * STEP)

    def height(self, speed: Column) -> Column:
        """The height [m] from which a ball falls to reach `speed` [m/s], (n,); infinite from v_t on."""
        square = self._terminal(speed) ** 2
        share = np.minimum(speed**2 / square, 1.0)
        with np.errstate(divide="ignore"):
            return -square / (2 * self._pull) * np.log1p(-share)

    def rebound_height(self, speed: Column) -> Column:
        """The height [m] to which a ball rises that starts at `speed`, (n,)."""
        square = self._terminal(speed) ** 2
        return square / (2 * self._pull) * np.log1p(speed**2 / square)

    def flight(self, fastest: float) -> tuple[float, float]:
        """g' [m/s²] and k = g'/v_t² [1/m] of a flight by its largest speed: z'' = -g' - k z'|z'|."""
        return float(self._pull), float(self._pull / self._terminal(np.asarray(fastest)) ** 2)

    def reynolds(self, speed: Column) -> Column:
        """Re at a speed."""
        return self.density * speed * self.ball.diameter / VISCOSITY

    def remarks(self, velocity: Column, restitution: Column, before: Any) -> tuple[str, ...]:
        """Sentences about the largest correction of v and ε; `before`: the values without air."""
        both = restitution - before[1], velocity / before[0] - 1
        of_restitution, of_velocity = (float(by[np.nanargmax(np.abs(by))]) for by in both)
        remarks = [
            f"{CORRECTED} of {self.density:g} kg/m³ (drag, buoyancy, added mass): "
            f"ε by {of_restitution:+.2g} and v by {100 * of_velocity:+.2g} % at most"
        ]
        fastest = float(np.max(self.reynolds(velocity)))
        if fastest > FASTEST:
            remarks.append(
                f"Reynolds numbers of up to {fastest:.2g} lie beyond those of the drag "
                f"coefficient, {FASTEST:.0e}: drag is uncertain there"
            )
        return tuple(remarks)

    @property
    def lightness(self) -> Any:
        """ρ_a/ρ."""
        return self.density * np.pi / 6 * self.ball.diameter**3 / self.ball.mass

    @property
    def _pull(self) -> Any:
        """g'."""
        return self.gravity * (1 - self.lightness) / (1 + 0.5 * self.lightness)

    def _terminal(self, fastest: Column) -> Column:
        """v_t of a flight by its largest speed."""
        drag = self.drag * mean_drag_coefficient(np.maximum(self.reynolds(fastest), 1e-12))
        area = np.pi / 4 * self.ball.diameter**2
        weight = self.ball.mass * self.gravity * (1 - self.lightness)
        return np.sqrt(2 * weight / (self.density * drag * area))

    def _settled(self, x: Column, formula: Any) -> Column:
        """The speed of a formula with the C_d that belongs to it."""
        x = np.asarray(x, float)
        speed = 0.5 * self._pull * x if formula is _take_off else np.sqrt(2 * self._pull * x)
        for _ in range(ROUNDS):
            before, speed = speed, formula(x, self._pull, self._terminal(speed), speed)
            if np.all(np.abs(speed - before) <= SETTLED * speed):
                break
        return speed


def _fall(height: Column, pull: Any, terminal: Column, _: Column) -> Column:
    return terminal * np.sqrt(-np.expm1(-2 * pull * height / terminal**2))


def _rise(height: Column, pull: Any, terminal: Column, _: Column) -> Column:
    return terminal * np.sqrt(np.expm1(2 * pull * height / terminal**2))


def _take_off(time: Column, pull: Any, terminal: Column, speed: Column) -> Column:
    """Go one of Newton's steps: the time is a concave function of the speed, which starts from below."""
    x = speed / terminal
    took = terminal * (np.arctan(x) + np.arcsinh(x))
    return speed + (pull * time - took) / (1 / (1 + x**2) + 1 / np.sqrt(1 + x**2))


def checked_air(air: Any) -> float | None:
    """The density of the air [kg/m³] that `air` states; None for False; raises DataError."""
    if air is None or isinstance(air, bool):
        return None if air is False else DENSITY
    try:
        value = quantity(air, "kg/m^3") if isinstance(air, str) else air
        return as_number("air", value, lambda rho: 1e-4 <= rho <= 20, ACCEPTED)
    except DataError:
        raise DataError("air", f'"{air}"' if isinstance(air, str) else air, ACCEPTED) from None
