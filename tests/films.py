"""Films of bouncing balls by an integrator of their own: flight in air, a contact that lasts, shutter, noise, pixels.

A flight is integrated by Runge and Kutta's steps of fourth order with Brown and Lawler's drag coefficient at each
speed, buoyancy and added mass. A contact is half a sine of the depth, with the speed of arrival in its first half
and that of departure in its second.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

GRAVITY, RHO, VISCOSITY = 9.80665, 1.2, 1.81e-5
STEP = 4e-4  # of an integration [s]
SHUTTER = 8  # instants of an exposure


@dataclass(frozen=True)
class Ball:
    """A ball [m, kg/m³], ε by its impact velocity, a contact of `contact` v^-`power` [s], a factor on its drag."""

    diameter: float
    density: float
    restitution: Callable[[float], float]
    contact: float = 0.0
    power: float = 0.0
    drag: float = 1.0

    def rate(self, v: float) -> float:
        """z'' at a velocity."""
        reynolds = max(RHO * abs(v) * self.diameter / VISCOSITY, 1e-6)
        drag = 24 / reynolds * (1 + 0.150 * reynolds**0.681) + 0.407 / (1 + 8710 / reynolds)
        volume, area = np.pi / 6 * self.diameter**3, np.pi / 4 * self.diameter**2
        push = (
            self.density - RHO
        ) * volume * GRAVITY + 0.5 * RHO * self.drag * drag * area * v * abs(v)
        return -push / ((self.density + 0.5 * RHO) * volume)


class Path(NamedTuple):
    """Heights at close times, and the time, v and ε of each impact."""

    time: np.ndarray
    height: np.ndarray
    impacts: np.ndarray


@dataclass(frozen=True)
class Film:
    """How a ball is let go, and filmed.

    Attributes:
        start: height [m] and velocity [m/s] at which it begins.
        bounces: after which the path ends, at the next touch, or `ends` seconds after the last.
        rate: frames a second.
        exposure: of a frame [s]; noise, pixel: of a height [m].
    """

    ball: Ball
    start: tuple[float, float]
    bounces: int
    rate: float
    exposure: float = 0.0
    noise: float = 0.0
    pixel: float = 0.0
    ends: float = np.inf

    @cached_property
    def path(self) -> Path:
        times, heights, impacts = [0.0], [self.start[0]], []
        t, (z, v), rate, h = 0.0, self.start, self.ball.rate, STEP
        while not impacts or t < impacts[-1][0] + self.ends:
            a1 = rate(v)
            a2 = rate(v + 0.5 * h * a1)
            a3 = rate(v + 0.5 * h * a2)
            a4 = rate(v + h * a3)
            further = z + h * v + h * h / 6 * (a1 + a2 + a3)
            faster = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            if further > 0 or faster > 0:
                t, z, v = t + h, further, faster
                times.append(t)
                heights.append(z)
                continue
            # touches within this step, in which the acceleration hardly changes
            a = (a1 + a4) / 2
            s = (-v - np.sqrt(v * v - 2 * a * z)) / a
            t, arrival = t + s, -(v + a * s)
            if len(impacts) == self.bounces:
                break
            restitution = float(self.ball.restitution(arrival))
            impacts.append((t, arrival, restitution))
            lasts = self.ball.contact * arrival**-self.ball.power
            if lasts > 0:
                x = np.linspace(0, np.pi, 41)[1:]
                speed = np.where(x < np.pi / 2, arrival, restitution * arrival)
                times.extend(t + lasts * x / np.pi)
                heights.extend(-speed * lasts / np.pi * np.sin(x))
                t += lasts
            z, v = 0.0, restitution * arrival
            times.append(t + 1e-9)
            heights.append(0.0)
        return Path(np.array(times), np.array(heights), np.array(impacts))

    def frames(self, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Times and heights of the frames of one film, which begins anywhere between two of them."""
        path = self.path
        begin = random.uniform(0, 1 / self.rate)
        t = np.arange(begin, path.time[-1] - self.exposure, 1 / self.rate)
        at = t[:, None] + self.exposure * (np.arange(SHUTTER) + 0.5) / SHUTTER
        z = np.interp(at, path.time, path.height).mean(axis=1)
        z += self.noise * random.standard_normal(len(t))
        if self.pixel:
            z = self.pixel * np.round(z / self.pixel + random.uniform())
        return t, z

    def nearest(self, velocity: np.ndarray) -> np.ndarray:
        """(v, ε) of the impacts that are nearest to these velocities."""
        return self.path.impacts[
            np.abs(np.subtract.outer(velocity, self.path.impacts[:, 1])).argmin(axis=1), 1:
        ]
