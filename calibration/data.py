"""Measured restitutions of one pair of bodies, checked once when they are taken in."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import softjax as sj
from calibration.errors import DataError, InputError, Origin
from calibration.repeats import average
from calibration.table import (
    Column,
    allowance,
    as_number,
    as_numbers,
    check_lengths,
    points_of,
    require,
    si_columns,
)


@dataclass(frozen=True, eq=False, repr=False)
class RestitutionData:
    """n impacts: at which velocity, with which coefficient of restitution, how well known.

    Arrays may be anything that `np.asarray` takes (a frame's columns too); they are held as
    read-only float64 arrays. Two sets are equal when all that is below but `origin` is.

    Attributes:
        velocity: v [m/s], shape (n,), relative impact speed, positive and below the limit velocity.
        restitution: ε [-], shape (n,), as measured, zero or more. Above 1 by at most 3 of its
            uncertainties (by 0.05 where none is given) it is noise, used as it is and noted.
        contact: the two bodies; None where their elastic properties are not known. Then Eq. (17)
            (with a limit velocity) or a constant ε can be fitted.
        uncertainty: standard uncertainty of ε [-], one number or (n,), positive; None: unknown.
        name: what results and pictures call this set.
        velocity_uncertainty: standard uncertainty of v [m/s], one number or (n,), 0 or more.
        limit_velocity: v_lim [m/s] of Eq. (17); the contact's where left out, put into the contact
            where both are given, so that the two never differ.
        remarks: what a reader noticed about the source.
        origin: file and lines the points came from, for messages.

    Raises:
        ValueError: naming the argument, its value and what is accepted; an `InputError` with file
            and line where the data has an `origin`.
    """

    velocity: Column
    restitution: Column
    contact: sj.Contact | None = None
    uncertainty: Column | None = None
    name: str = "data"
    velocity_uncertainty: Column | None = None
    limit_velocity: Any = None
    remarks: tuple[str, ...] = ()
    origin: Origin | None = field(default=None, kw_only=True)

    def __post_init__(self):
        try:
            self._take_in()
        except DataError as error:
            raise self._placed(error) from None

    @classmethod
    def from_table(
        cls,
        table: Mapping[str, Any],
        contact: sj.Contact | None = None,
        *,
        uncertainty: Any = None,
        name: str = "data",
        velocity_uncertainty: Any = None,
        limit_velocity: Any = None,
        gravity: float | None = None,
        origin: Origin | None = None,
    ) -> "RestitutionData":
        """Data from named columns: a mapping or a frame, headers as in a file, `"velocity [cm/s]"`.

        Args:
            table: accepted together are velocity and restitution; drop_height and rebound_height;
                interval, and launch; each with uncertainty and velocity_uncertainty
                (see `calibration.table`). Units in brackets, SI without.
            gravity: g [m/s²] for heights and intervals, 9.80665 where left out.
            origin: file and line of each row of the table.

        The other arguments are those of `RestitutionData`.

        Raises:
            ValueError: naming the column or argument, its value and what is accepted.
        """
        try:
            if gravity is not None:
                as_number("gravity", gravity, lambda g: g > 0, "a positive acceleration in m/s²")
            points = points_of(si_columns(table), gravity)
            u_eps = _given_once("uncertainty", points.uncertainty, uncertainty)
            u_v = _given_once(
                "velocity_uncertainty", points.velocity_uncertainty, velocity_uncertainty
            )
        except DataError as error:
            raise (error if origin is None else origin.error(error)) from None
        return cls(
            points.velocity,
            points.restitution,
            contact,
            u_eps,
            name,
            u_v,
            limit_velocity,
            points.remarks,
            origin=None if origin is None else origin.select(points.rows),
        )

    def averaged(self, pooled: bool = False) -> "RestitutionData":
        """One point for each velocity, the mean of its repeats; in the order of velocity.

        Repeats are those at exactly equal velocities.

        Without uncertainties the mean's is its standard error, s/√n with s the scatter of that
        velocity's own repeats. A velocity measured once, or whose readings are all alike, takes
        the scatter of all repeats pooled; with `pooled` every velocity does, which is the better
        estimate when there are fewer than about five repeats each. With stated uncertainties
        points are weighted by 1/u², and the mean's is 1/√Σ(1/u²).

        Raises:
            ValueError: where the contact has other properties at each impact.
        """
        if self.contact is not None and any(map(np.ndim, self.contact.leaves().values())):
            raise ValueError("`contact` must be of single numbers for repeats to be averaged")
        mean = average(
            self.velocity, self.restitution, self.uncertainty, self.velocity_uncertainty, pooled
        )
        return replace(
            self,
            velocity=mean.velocity,
            restitution=mean.restitution,
            uncertainty=mean.uncertainty,
            velocity_uncertainty=mean.velocity_uncertainty,
            origin=None if self.origin is None else self.origin.select(mean.rows),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the fit should know: the remarks, and how many ε are above 1."""
        above = self.restitution > 1
        if not np.any(above):
            return self.remarks
        most = float(np.max(self.restitution)) - 1
        note = (
            f"{np.sum(above)} of {len(self)} restitutions are above 1, by {most:.2g} at most: "
            "taken for noise and used as measured"
        )
        return (*self.remarks, note)

    def refusal(self, problem: str, accepted: str, index: int | None = None) -> InputError:
        """The error to raise for these data, with file and line (of point `index`) if known."""
        if self.origin is None:
            return InputError(None, None, f"{self.name}: {problem}", accepted)
        return InputError(self.origin.file, self.origin.line_of(index), problem, accepted)

    def __len__(self) -> int:
        return len(self.velocity)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RestitutionData):
            return NotImplemented
        arrays = ("velocity", "restitution", "uncertainty", "velocity_uncertainty")
        return (
            (self.name, self.remarks) == (other.name, other.remarks)
            and all(_same(getattr(self, one), getattr(other, one)) for one in arrays)
            and _same(self.limit_velocity, other.limit_velocity)
            and bool(self.contact == other.contact)
        )

    __hash__ = None  # type: ignore[assignment]  # arrays inside

    def __repr__(self) -> str:
        known = "stated" if self.uncertainty is not None else "not stated"
        low, high = np.min(self.velocity), np.max(self.velocity)
        return (
            f"RestitutionData({self.name!r}: {len(self)} points, v {low:.4g} to {high:.4g} m/s, "
            f"ε {np.min(self.restitution):.4g} to {np.max(self.restitution):.4g}, "
            f"uncertainty {known}, {'no contact' if self.contact is None else 'with contact'})"
        )

    def _take_in(self) -> None:
        """Convert and check every field."""
        if not (isinstance(self.name, str) and self.name.strip()):
            raise DataError("name", repr(self.name), "a text that is not empty")
        columns = {
            "velocity": as_numbers("velocity", self.velocity),
            "restitution": as_numbers("restitution", self.restitution),
        }
        for name in ("uncertainty", "velocity_uncertainty"):
            if getattr(self, name) is not None:
                columns[name] = _per_point(name, getattr(self, name), len(columns["velocity"]))
        check_lengths(columns)
        for name, column in columns.items():
            column.setflags(write=False)
            object.__setattr__(self, name, column)
        object.__setattr__(self, "remarks", tuple(self.remarks))
        self._take_in_contact()
        self._check_points()

    def _take_in_contact(self) -> None:
        """One limit velocity, in the contact and beside it."""
        if self.contact is not None and not isinstance(self.contact, sj.Contact):
            raise DataError("contact", self.contact, "a softjax.Contact or None")
        if self.limit_velocity is not None:
            limit = _per_impact("limit_velocity", self.limit_velocity, len(self))
            object.__setattr__(self, "limit_velocity", limit)
            if self.contact is not None:
                contact = replace(self.contact, limit_velocity=limit)
                object.__setattr__(self, "contact", contact)
        elif self.contact is not None:
            limit = _per_impact("contact", self.contact.limit_velocity, len(self))
            object.__setattr__(self, "limit_velocity", limit)
        if self.contact is not None:
            for leaf in self.contact.leaves().values():
                _per_impact("contact", leaf, len(self))

    def _check_points(self) -> None:
        """The rules that a measured point obeys."""
        require("velocity", self.velocity, lambda v: v > 0, "a positive speed in m/s")
        limit = self.limit_velocity
        if limit is not None:
            accepted = f"below the limit velocity, {np.min(limit):.6g} m/s"
            require("velocity", self.velocity, lambda v: v < limit, accepted)
        require("restitution", self.restitution, lambda e: e >= 0, "a number of 0 or more")
        if self.uncertainty is not None:
            require("uncertainty", self.uncertainty, lambda u: u > 0, "a positive number")
        if self.velocity_uncertainty is not None:
            u_v = self.velocity_uncertainty
            require("velocity_uncertainty", u_v, lambda u: u >= 0, "a speed of 0 m/s or more")
        noise = allowance(self.uncertainty)
        known = "0.05" if self.uncertainty is None else "3 of its uncertainties"
        accepted = f"at most 1, or above it by no more than {known}"
        require("restitution", self.restitution, lambda e: e - 1 <= noise, accepted)

    def _placed(self, error: DataError) -> ValueError:
        return error if self.origin is None else self.origin.error(error)


def _given_once(name: str, column: Any, value: Any) -> Any:
    if column is not None and value is not None:
        raise DataError(name, "both a column and a number for the set", "given once")
    return value if column is None else column


def _per_point(name: str, value: Any, count: int) -> Column:
    """One number for all points, or one for each, as (count,)."""
    if np.ndim(value) == 0:
        number = as_number(name, value, lambda _: True, "a number, or one for each point")
        return np.repeat(number, count)
    return as_numbers(name, value)


def _per_impact(name: str, value: Any, count: int) -> float | Column:
    """A positive number, or one for each of `count` impacts."""
    if np.ndim(value) == 0:
        return as_number(name, value, lambda x: x > 0, "a positive number")
    numbers = as_numbers(name, value)
    if numbers.shape != (count,):
        accepted = f"of single numbers or {count} long like `velocity`"
        raise DataError(name, f"{len(numbers)} long", accepted)
    require(name, numbers, lambda x: x > 0, "a positive number")
    return numbers


def _same(one: Any, other: Any) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)
