"""Measurements as laboratories have them: specimens that differ, bounce trains, repeats, velocities
that are uncertain. Each is drawn anew for every fit."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Float

import softjax as sj
from calibration.coverage.cases import nylon_pair
from calibration.data import RestitutionData
from calibration.data.points import STANDARD_GRAVITY
from calibration.fitting.derived import eps_up_of

OFFSET, SCATTER = 0.003, 0.0015  # standard deviations of ε: between specimens, and of one impact
NOISE = 0.005  # of a single ε elsewhere

Column = Float[np.ndarray, " n"]
Draw = Callable[[np.random.Generator], RestitutionData]


@dataclass(frozen=True)
class Experiment:
    """One kind of measurement of a law's curve.

    Attributes:
        name: what tables call it.
        truth: the law that is measured, and fitted.
        draw: measurements from a random generator.
        scatter: standard deviation of one more measurement, where it is the same for all.
    """

    name: str
    truth: sj.ContactLaw
    draw: Draw
    scatter: float | None = None

    @property
    def true_values(self) -> dict[str, float]:
        """What a fit's parameters should be."""
        law = self.truth
        if isinstance(law, sj.Zhou):
            return {"chi": float(law.chi), "eps_up": eps_up_of(law)}
        assert isinstance(law, sj.Thornton)
        return {"yield_factor": float(law.yield_factor)}


def experiments() -> list[Experiment]:
    """For Zhou's law and Thornton's."""
    pair = nylon_pair()
    laws = (sj.Zhou(pair, 0.22, 0.4355, 0.5414), sj.Thornton(pair, 1.6))
    return [one for law in laws for one in experiments_of(law)]


def experiments_of(law: sj.ContactLaw) -> list[Experiment]:
    """Every kind of measurement of one law's curve."""
    bench = _Bench(law)
    both = float(np.hypot(OFFSET, SCATTER))
    found: list[tuple[str, Draw, float | None]] = [("independent", bench.plain, NOISE)]
    for told, stated in (("", False), (", stated", True)):
        for where, blocks in (("blocks", True), ("across", False)):
            draw = partial(bench.specimens, blocks=blocks, stated=stated)
            found.append((f"specimens {where}{told}", draw, both))
        for timing in (1e-4, 7e-4):
            draw = partial(bench.trains, timing=timing, stated=stated)
            found.append((f"trains {1e3 * timing:g} ms{told}", draw, None))
        for percent in (5, 10):
            draw = partial(bench.uncertain, relative=0.01 * percent, stated=stated)
            found.append((f"velocities {percent} %{told}", draw, None))
    for count in (2, 3, 5, 10):
        found.append((f"{count} repeats", partial(bench.repeats, count=count), None))
    name = type(law).__name__
    return [Experiment(f"{name}, {told}", law, draw, scatter) for told, draw, scatter in found]


class _Bench:
    """What measures one law's curve."""

    def __init__(self, law: sj.ContactLaw):
        self._law, self._pair = law, law.contact
        self._critical = float(law.contact.critical_velocity)
        self._table = np.geomspace(1.0001, 90, 4000) * self._critical

    @cached_property
    def _curve(self) -> Column:
        return self.at(self._table)

    def at(self, velocity: Column) -> Column:
        """ε without errors."""
        return np.asarray(sj.restitution(self._law, velocity).coefficient)

    def plain(self, random: np.random.Generator) -> RestitutionData:
        """30 impacts with independent errors of one unknown size."""
        velocity = np.geomspace(1.3, 80, 30) * self._critical
        noise = NOISE * random.standard_normal(30)
        return RestitutionData(velocity, self.at(velocity) + noise, self._pair)

    def specimens(self, random, blocks: bool, stated: bool) -> RestitutionData:
        """Six of five impacts each: each over a part of the velocities, or over all."""
        member = np.repeat(np.arange(6), 5)
        wide = np.geomspace(1.3, 40, 30)
        across = np.geomspace(1.3, 40, 5) * (1 + 0.05 * np.arange(6)[:, None])
        velocity = (wide if blocks else across.ravel()) * self._critical
        offset = OFFSET * random.standard_normal(6)[member]
        restitution = self.at(velocity) + offset + SCATTER * random.standard_normal(30)
        group = [f"specimen {k}" for k in member]
        told = np.asarray(SCATTER) if stated else None
        return RestitutionData(velocity, restitution, self._pair, told, group=group)

    def trains(self, random, timing: float, stated: bool) -> RestitutionData:
        """Ten of eight bounces: each interval is timed, and gives the velocities at both its ends."""
        velocity = random.uniform(4.5, 12, 10) * self._critical
        intervals = []
        for _ in range(9):
            intervals.append(2 * velocity / STANDARD_GRAVITY)
            velocity = velocity * np.interp(velocity, self._table, self._curve)
        timed = np.stack(intervals, axis=1).ravel() + timing * random.standard_normal(90)
        launch = np.repeat(np.arange(10), 9).astype(str)
        table: dict[str, Any] = {"launch": launch, "interval": timed}
        return RestitutionData.from_table(
            table, self._pair, timing_uncertainty=timing if stated else None
        )

    def repeats(self, random, count: int) -> RestitutionData:
        """Twelve velocities with repeats, averaged."""
        velocity = np.repeat(np.geomspace(1.3, 60, 12) * self._critical, count)
        noise = NOISE * random.standard_normal(len(velocity))
        return RestitutionData(velocity, self.at(velocity) + noise, self._pair).averaged()

    def uncertain(self, random, relative: float, stated: bool) -> RestitutionData:
        """30 velocities read with a relative error."""
        true = np.geomspace(1.3, 80, 30) * self._critical
        read = true * (1 + relative * random.standard_normal(30))
        restitution = self.at(true) + NOISE * random.standard_normal(30)
        told = np.asarray(NOISE) if stated else None
        errors = relative * read
        return RestitutionData(read, restitution, self._pair, told, velocity_uncertainty=errors)
