"""Measured restitutions of one pair of bodies, checked once on construction."""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, wraps
from types import MappingProxyType
from typing import Any

import jax
import numpy as np
from jaxtyping import Int

import softjax as sj
from calibration.data.air import CORRECTED, Fall
from calibration.data.bodies import Body
from calibration.data.checks import (
    Column,
    as_labels,
    as_number,
    as_numbers,
    check_lengths,
    codes_of,
    require,
    require_size,
)
from calibration.data.columns import OBSERVED
from calibration.data.contact_time import stated_contact
from calibration.data.inputs import INSTRUMENTS, Input, OfArrays, Source, standard_uncertainty
from calibration.data.layout import NO_UNIT
from calibration.data.point_errors import PointErrors
from calibration.data.points import observed_of, points_of, rows_blamed
from calibration.data.repeats import average
from calibration.data.rows import Pair, headers_of, read_rows
from calibration.data.track_table import TrackOptions, read_tracks, tracks_in
from calibration.errors import DataError, InputError, Origin, listed, printable
from calibration.observables import Observed, scale_of
from softjax.units import in_unit

DENTS = {"largest": "dent_diameter", "residual": "residual_dent_diameter"}
LARGEST = 1.5  # restitution: further above 1 no noise brings it
NOT_ROWS = (
    "self",
    "name",
    "remarks",
    "bodies",
    "measured",
    "dent",
    "fall",
    "tracks",
    "origin",
    "source",
    "errors",
)
FAR_ABOVE = 10.0  # from here on no slip of a digit brings it
PERCENT = 10.0  # from here on 85 for 0.85 is the likeliest slip
LONGEST_NAME = 200  # which pictures and tables can show
# stated of all rows, not in the table
OF_ROWS = {"gravity", "air", "bounce_contact_time", *TrackOptions._fields, *INSTRUMENTS}
NOT_COMPARED = {"bodies", "fall", "origin", "source", "errors", "observed", "measured", "tracks"}
BESIDE = tuple(name for observed in OBSERVED for name in (observed, f"{observed}_uncertainty"))


@dataclass(frozen=True, eq=False, repr=False)
class RestitutionData:
    """n impacts: at which velocity, with which coefficient of restitution, how well known.

    With ε, or in its place, what else an impact shows, `contact_time=` and the others of `measured`.

    Arrays may be anything that `np.asarray` takes (a frame's columns too); they are stored as
    read-only float64 arrays. Rows that `numpy.ma` masks are left out; what has a unit (pint's, astropy's) is converted.
    Two sets are equal when all that is below is but `bodies`, `fall`, `tracks` and `origin`.

    Attributes:
        velocity: v [m/s], shape (n,), relative impact speed, positive and below the limit velocity.
        restitution: ε [-], shape (n,), as measured, from 0 to 1.5. What is above 1 is used as it
            is and noted. NaN, or None for all, where something else was measured in its place.
        contact: the two bodies; None where their elastic properties are not known. Then Eq. (17)
            (with a limit velocity) or a constant ε can be fitted.
        uncertainty: standard uncertainty of ε [-], one number or (n,), positive; None: unknown.
            That of all that `errors` has, where these are given.
        name: what results and pictures call this set; control characters by their codes.
        velocity_uncertainty: standard uncertainty of v [m/s], one number or (n,), 0 or more; as
            `uncertainty`.
        limit_velocity: v_lim [m/s] of Eq. (17); the contact's where left out, put into the contact
            where both are given, so that the two never differ.
        remarks: what a reader noticed about the source.
        group: a label for each point, (n,) texts; points of one label (a specimen, a launch, a day)
            have an error in common whose size is not known. None: no groups.
        errors: how the errors of what was measured enter ε and v, and what points share of them;
            made of the two uncertainties where left out.
        bodies: the bodies of the contact (`calibration.data.bodies.Body`) where a file has them;
            for `plausibility`, and not compared.
        degrees: degrees of freedom behind `uncertainty`: a number where one scatter is behind all,
            (n,) where each point has its own; None where they are stated, or unknown.
        measured: observables other than ε by their names in `calibration.data.columns.OBSERVED`, in SI,
            (n,), positive, NaN where one was not measured; with `<name>_uncertainty` its standard
            uncertainty, without one a relative scatter is estimated. Each may be given as an argument
            of its own name too, one number or (n,), and is an attribute: `data.contact_time`.
        dent: "largest": dents are as wide as the contact was at most, 2√(A δ_max), as indentations
            hardly recover in diameter; "residual": 2√(2R δ*), of the overlap that stays.
        fall: how drop heights became velocities; not compared.
        tracks: the tracks z(t) that the points are from (`calibration.data.tracks.BounceTrack`); not compared.
        origin: file and lines the points came from, for messages.
        source: what reads the data again with other inputs; None: they were given as arrays.

    Raises:
        ValueError: naming the argument, its value and what is accepted; an `InputError` with file
            and line where the data has an `origin`.
    """

    velocity: Column
    restitution: Column = None  # type: ignore[assignment]  # NaN then
    contact: sj.Contact | None = None
    uncertainty: Column | None = None
    name: str = "data"
    velocity_uncertainty: Column | None = None
    limit_velocity: Any = None
    remarks: tuple[str, ...] = ()
    _: KW_ONLY
    group: Any = None
    errors: PointErrors = None  # type: ignore[assignment]  # filled in
    degrees: Any = None
    bodies: tuple[Any, ...] = ()
    measured: Mapping[str, Column] = field(default_factory=dict)
    dent: str = "largest"
    fall: Fall | None = None
    tracks: tuple[Any, ...] = ()
    origin: Origin | None = None
    source: Source | None = None

    def __post_init__(self):
        try:
            self._take_in()
        except DataError as error:
            raise _located(error, self.remarks, self.origin) from None

    def __getattr__(self, name: str) -> Any:
        """An observable or its uncertainty, None where it was not measured."""
        if name in BESIDE:
            return self.measured.get(name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @classmethod
    def from_table(
        cls,
        table: Mapping[str, Any],
        contact: sj.Contact | Callable[[Column], sj.Contact] | None = None,
        *,
        name: str = "data",
        limit_velocity: Any = None,
        gravity: float | None = None,
        air: bool | float | str | None = None,
        diameter: float | None = None,
        mass: float | None = None,
        density: float | None = None,
        group: Sequence[Any] | None = None,
        dent: str = "largest",
        height_offset: float | None = None,
        height_scale: float | None = None,
        velocity_scale: float | None = None,
        time_scale: float | None = None,
        one_size: bool = False,
        remarks: Sequence[str] = (),
        bodies: Sequence[Body] | Callable[[Column], Sequence[Body]] = (),
        frame_rate: float | None = None,
        scale: float | str | None = None,
        down: bool | None = None,
        exposure: float | str | None = None,
        object: str | None = None,
        bounce_contact_time: float | str | None = None,
        origin: Origin | None = None,
        **uncertainties: Any,
    ) -> "RestitutionData":
        """Data from named columns: a mapping or a frame, headers as in a file, `"velocity [cm/s]"`.

        Args:
            table: the sets of columns and the names of `calibration.data.columns`. SI
                without a unit; NaN for what was not measured.
            contact: the two bodies; where the table has the `diameter`, `radius` or `mass` of the sphere
                in each row, a function that gives the contact of an array of radii [m].
            dent: as of `RestitutionData`.
            one_size: whether sizes in the rows are refused.
            gravity: g [m/s²] for heights, intervals and times, 9.80665 where left out.
            air: whether heights, intervals and times are those of flights in air: True (as where
                left out: 1.2 kg/m³), False, or the density, as a number in kg/m³ or text. See
                `calibration.data.air`.
            bodies: as of `RestitutionData`, or a function that gives them of the radii in the rows.
            diameter, mass, density: of the ball that flies [m, kg, kg/m³], the density in place of
                the mass; where left out, those of the first of `bodies`, else of a sphere that
                meets a wall with the radius and mass of `contact`.
            group: a label for each row, in place of a column.
            frame_rate, scale, down, exposure, object: of a track, see `calibration.data.track_table.TrackOptions`.
            bounce_contact_time: how long a bounce lasts [s], or text ("4 ms"), taken off the intervals between
                bounces, or out of a track; where left out Hertz's duration of the bodies, if these are known.
            height_offset, height_scale, velocity_scale, time_scale: what all readings are corrected by:
                a height is scale · reading + offset [m].
            origin: file and line of each row of the table.
            uncertainties: `uncertainty`, `velocity_uncertainty`, `interval_uncertainty` and so on,
                for all rows, in place of a column: a number in SI, or text with its unit, "0.5 mm"
                or "2 %"; None: not stated.

        The other arguments are those of `RestitutionData`.

        Raises:
            ValueError: naming the column or argument, its value and what is accepted.
        """
        if not hasattr(table, "keys"):
            raise DataError("table", table, "named columns; `read_csv` reads a file")
        stated = {key: value for key, value in uncertainties.items() if value is not None}
        ball = _ball(diameter, mass, density, bodies, contact)
        scales = (height_offset, height_scale, velocity_scale, time_scale)
        pairs = zip(INSTRUMENTS, scales, strict=True)
        instruments = {name: value for name, value in pairs if value is not None}
        try:
            pair = Pair(ball, contact, bodies, one_size)
            of_track = TrackOptions(frame_rate, scale, down, exposure, object)
            lasts = stated_contact(bounce_contact_time)
            headers = list(map(str, headers_of(table)))
            if tracks_in(headers, getattr(table, "titles", ())):
                if stated or group is not None:
                    accepted = "left out with a track, whose frames show its noise"
                    raise DataError(next(iter(stated), "group"), "given", accepted)
                rows, points = read_tracks(
                    table, headers, pair, gravity, air, of_track, lasts, origin, instruments
                )
                remarks = (*remarks, *rows.remarks)
            else:
                of_track.check_unused()
                rows = read_rows(
                    table, pair, stated, gravity, group, air, origin, lasts, instruments
                )
                remarks = (*remarks, *rows.remarks)
                points = points_of(rows)
            measured = observed_of(rows, points)
        except DataError as error:
            if error.argument in {*stated, *OF_ROWS} and error.index is None:
                raise
            raise _located(error, remarks, origin) from None
        of_points = rows.take(points.rows)
        with rows_blamed(points.rows):
            return cls(
                points.velocity,
                points.restitution,
                of_points.contact,
                name=name,
                dent=dent,
                measured=measured,
                limit_velocity=limit_velocity,
                remarks=tuple(dict.fromkeys((*remarks, *points.remarks))),
                group=of_points.columns.get("group", points.group),
                errors=points.errors,
                degrees=points.degrees,
                bodies=of_points.bodies,
                fall=rows.fall,
                tracks=points.tracks,
                origin=None if origin is None else origin.select(points.rows),
            )

    def averaged(self) -> "RestitutionData":
        """One point for each velocity, the mean of its repeats; in the order of velocity.

        Repeats are those at exactly equal velocities, of one group where there are groups.

        Without uncertainties the mean's is s/√n, with s the scatter of all repeats about their
        means, pooled; `degrees` is then the number of readings less that of velocities. With stated
        uncertainties points are weighted by 1/u², and the mean's is 1/√Σ(1/u²).

        Raises:
            ValueError: where the contact has other properties at each impact, or points share
                intervals.
        """
        if self.observed:
            accepted = f"left out with {listed(observed.name for observed in self.observed)}"
            raise DataError("average of repeats", "requested", accepted)
        if self.contact is not None and any(map(np.ndim, self.contact.leaves().values())):
            accepted = "of single numbers for repeats to be averaged"
            raise DataError("contact", "one of arrays", accepted)
        with np.errstate(all="ignore"):
            restitution, errors, degrees, rows = average(
                self.velocity, self.restitution, self.errors, self.group
            )
        remark = f"{len(self)} readings averaged to {len(rows)} points, one for each velocity"
        return replace(
            self,
            remarks=(*self.remarks, remark + (" and group" if self.group is not None else "")),
            velocity=self.velocity[rows],
            restitution=restitution,
            uncertainty=None,
            velocity_uncertainty=None,
            group=None if self.group is None else self.group[rows],
            errors=errors,
            degrees=degrees,
            origin=None if self.origin is None else self.origin.select(rows),
            source=None,
        )

    @cached_property
    def observed(self) -> tuple[Observed, ...]:
        """Measured observables other than ε, in the order of `calibration.observables`."""
        every_observed = []
        radius = None if self.contact is None else self.contact.radius
        for name in (name for name in OBSERVED if name in self.measured):
            values, uncertainty = self.measured[name], self.measured.get(f"{name}_uncertainty")
            rows = np.flatnonzero(np.isfinite(values))
            if len(rows):
                known = name if name != "dent_diameter" else DENTS[self.dent]
                of_rows = None if uncertainty is None else uncertainty[rows]
                radii = radius[rows] if np.ndim(radius) else None  # type: ignore[index]
                scale = scale_of(values[rows], self.velocity[rows], radii)
                every_observed.append(Observed(known, rows, values[rows], of_rows, scale))
        return tuple(every_observed)

    def of_restitution(self) -> "RestitutionData":
        """The impacts with an ε, without what else was measured and without the bodies."""
        rows = np.flatnonzero(np.isfinite(self.restitution))
        columns = {name: getattr(self, name) for name in ("limit_velocity", "group", "degrees")}
        columns = {name: x[rows] if np.ndim(x) else x for name, x in columns.items()}
        errors = self.errors.select(rows)
        return RestitutionData(
            self.velocity[rows], self.restitution[rows], errors=errors, **columns
        )

    @property
    def inputs(self) -> Source:
        """The inputs that all rows have in common, and the data with some of them moved."""
        return OfArrays(self.contact, self.name) if self.source is None else self.source

    def uncertain_inputs(self, stated: Mapping[str, Any]) -> list[Input]:
        """Inputs with a standard uncertainty: of the source, and of `stated`, which wins."""
        source = self.inputs
        known = {entry.name: entry for entry in source.stated}
        for name, size in stated.items():
            value = source.value(name)
            known[name] = Input(name, value, standard_uncertainty(name, size, value))
        return list(known.values())

    def moved(self, changes: Mapping[str, float]) -> "RestitutionData":
        """The data with these changes of inputs [SI], read again where they came from a file."""
        return self.inputs.moved(self, changes)

    @property
    def groups(self) -> tuple[str, ...]:
        """The labels of `group`, each once, in the order in which they appear."""
        return () if self.group is None else tuple(dict.fromkeys(self.group))

    @property
    def group_index(self) -> Int[np.ndarray, " n"] | None:
        """The place of each point's label in `groups`."""
        return None if self.group is None else codes_of(self.group)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the reader of a fit, and the number of ε above 1."""
        above = self.restitution > 1
        if not np.any(above):
            return self.remarks
        excess = float(np.nanmax(self.restitution)) - 1
        note = (
            f"{np.sum(above)} of {len(self)} restitutions are above 1, by {excess:.2g} at most, "
            "and used as measured"
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
        mine, theirs = (
            {name: value for name, value in vars(data).items() if name not in NOT_COMPARED}
            | dict(data.measured)
            | vars(data.errors)
            for data in (self, other)
        )
        return mine.keys() == theirs.keys() and all(
            _same(value, theirs[name]) for name, value in mine.items()
        )

    __hash__ = None  # type: ignore[assignment]  # arrays inside

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"measured": dict(self.measured)}  # a view of a dict has no copy

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._set(**state | {"measured": MappingProxyType(state["measured"])})

    def __repr__(self) -> str:
        known = "stated" if self.uncertainty is not None else "not stated"
        low, high = np.min(self.velocity), np.max(self.velocity)
        ends = "not measured"
        if not np.all(np.isnan(self.restitution)):
            ends = f"{np.nanmin(self.restitution):.4g} to {np.nanmax(self.restitution):.4g}"
        groups = "".join(f"{len(observed)} of {observed.name}, " for observed in self.observed)
        groups += f"{len(self.groups)} groups, " if self.group is not None else ""
        return (
            f"RestitutionData({self.name!r}: {len(self)} points, v {low:.4g} to {high:.4g} m/s, "
            f"ε {ends}, {groups}"
            f"uncertainty {known}, {'no contact' if self.contact is None else 'with contact'})"
        )

    # ---------------------------------------------------------------- conversion and checks

    def _take_in(self) -> None:
        """Convert and check every field."""
        if not (isinstance(self.name, str) and 0 < len(self.name.strip()) <= LONGEST_NAME):
            accepted = f"a text that is not empty, of {LONGEST_NAME} characters at most"
            raise DataError("name", repr(self.name), accepted)
        self._set(name=printable(self.name), remarks=tuple(map(printable, self.remarks)))
        self._set(velocity=as_numbers("velocity", self.velocity))
        if self.restitution is None:
            self._set(restitution=np.full(len(self), np.nan))
        for name in ("restitution", "uncertainty", "velocity_uncertainty"):
            self._set(**{name: self._per_point(name, getattr(self, name))})
        given = {name: self._per_point(name, value) for name, value in self.measured.items()}
        self._set(measured=MappingProxyType({n: x for n, x in given.items() if x is not None}))
        if self.group is not None:
            self._set(group=as_labels("group", self.group))
            check_lengths({"velocity": self.velocity, "group": self.group})
        self._check_observed()
        self._take_in_errors()
        self._take_in_contact()
        self._check_points()

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def _per_point(self, name: str, value: Any) -> Column | None:
        """A field as (n,); a single number is that of all points."""
        if value is None:
            return None
        if np.ndim(value) == 0:
            number = as_number(name, value, lambda _: True, "a number, or one for each point")
            value = np.full(len(self), number)
        numbers = as_numbers(name, value)
        check_lengths({"velocity": self.velocity, name: numbers})
        return numbers

    def _per_impact(self, name: str, value: Any) -> float | Column:
        """A positive number, or one for each impact."""
        if np.ndim(value) == 0:
            return as_number(name, value, lambda x: x > 0, "a positive number")
        numbers = as_numbers(name, value)
        check_lengths({"velocity": self.velocity, name: numbers})
        require(name, numbers, lambda x: x > 0, "a positive number")
        return numbers

    def _check_observed(self) -> None:
        """The observables other than ε, and which rows lack ε."""
        if self.dent not in DENTS:
            raise DataError("dent", self.dent, " or ".join(map(repr, DENTS)))
        if unknown := self.measured.keys() - {*BESIDE}:
            raise DataError("measured", min(unknown), f"of {listed(BESIDE)}")
        missing = np.isnan(self.restitution)
        measured = [name for name in OBSERVED if name in self.measured]
        for name, size in ((n, self.measured.get(f"{n}_uncertainty")) for n in OBSERVED):
            if name not in self.measured:
                if size is not None:
                    raise DataError(f"{name}_uncertainty", "given", f"left out without {name}")
                continue
            present, unit = ~np.isnan(self.measured[name]), OBSERVED[name]
            missing = missing & ~present
            require_size(name, np.where(present, self.measured[name], 1.0), unit)
            if size is not None:
                require_size(f"{name}_uncertainty", np.where(present, size, 1.0), unit)
        if np.any(missing):
            accepted = f"a number, or measured by {listed(measured)}"
            accepted = accepted if measured else "a number of 0 or more"
            raise DataError("restitution", math.nan, accepted, int(np.argmax(missing)))

    def _take_in_errors(self) -> None:
        """The errors of the two uncertainties, or the two uncertainties of the errors."""
        of_eps, of_v = self.uncertainty, self.velocity_uncertainty
        if self.errors is None:
            if of_eps is not None:
                of_eps = np.where(np.isnan(self.restitution), 1.0, of_eps)
            self._set(errors=PointErrors.independent(len(self), of_eps, of_v))
        elif len(self.errors) != len(self):
            accepted = f"of as many points as `velocity`, {len(self)}"
            raise DataError("errors", f"of {len(self.errors)}", accepted)
        elif self.group is not None:
            self._check_launches()
        stated = {"uncertainty": of_eps, "velocity_uncertainty": of_v}
        for name, size in stated.items():
            value = getattr(self.errors, name)
            if size is not None and not _same(size, value):
                raise DataError(name, "given with other `errors`", "left out, or errors=None")
            self._set(**{name: value})
        if self.degrees is not None:
            self._set(degrees=self._per_impact("degrees", self.degrees))

    def _check_launches(self) -> None:
        """Points that share an input error, as those of a launch do, are of one group."""
        assert self.errors is not None
        index, codes = self.errors.index, np.asarray(self.group_index)
        ends = np.full((2, int(np.max(index, initial=0)) + 1), [[len(codes)], [-1]])
        every = np.broadcast_to(codes[:, None], index.shape)[index >= 0]
        np.minimum.at(ends[0], index[index >= 0], every)
        np.maximum.at(ends[1], index[index >= 0], every)
        for k in np.flatnonzero(ends[0] < ends[1]):
            both = " and ".join(repr(self.groups[code]) for code in ends[:, k])
            raise DataError(
                "group", f"{both} of points that share an error", "one for all of these"
            )

    def _take_in_contact(self) -> None:
        """One limit velocity, in the contact and in the data."""
        contact, limit = self.contact, self.limit_velocity
        if limit is not None:
            limit = self._per_impact("limit_velocity", limit)
        if contact is not None and not isinstance(contact, sj.Contact):
            raise DataError("contact", contact, "a softjax.Contact or None")
        if contact is not None:
            for leaf in contact.leaves().values():
                self._per_impact("contact", leaf)
            if limit is None:
                limit = self._per_impact("contact", contact.limit_velocity)
            else:
                contact = replace(contact, limit_velocity=limit)
        self._set(contact=contact, limit_velocity=limit)

    def _check_points(self) -> None:
        """The rules that a measured point obeys."""
        require("velocity", self.velocity, lambda v: v > 0, "a positive speed in m/s")
        if (limit := self.limit_velocity) is not None:
            accepted = (
                f"below the limit velocity, {np.min(limit):.6g} m/s (√(3 Y/ρ) unless stated): "
                "check the units of velocity and yield strength, or give limit_velocity"
            )
            require("velocity", self.velocity, lambda v: v < limit, accepted)
        measured = np.where(np.isnan(self.restitution), 0.5, self.restitution)
        require("restitution", measured, lambda e: e >= 0, "a number of 0 or more")
        accepted = f"at most {LARGEST}; above 1 it is noise or an input error"
        if np.max(measured) > PERCENT and self.errors.by_drag is None:
            accepted += " (is it in percent? then the unit is [%])"
        require("restitution", measured, lambda e: e <= LARGEST, accepted)


def _located(error: DataError, remarks: Sequence[str], origin: Origin | None) -> ValueError:
    """A refusal with its file and line, with the units assumed where the header has none, and the air."""
    note = next((remark for remark in remarks if remark.startswith(NO_UNIT)), None)
    # a restitution that was given is of no unit
    about = note is not None and (error.argument in note or "height" in note or "_velocity" in note)
    if error.argument == "restitution":
        by_air = next((remark for remark in remarks if remark.startswith(CORRECTED)), "")
        air = f"{by_air}: are the ball's size and density right?"
        if by_air and float(error.value) > FAR_ABOVE:
            air = f"check the unit of times or heights (ms? mm?), then the ball's size and density; {by_air}"
        note, about = f"{note}; {air}" if about else air, bool(by_air)
    if about and error.index is not None:
        accepted = f"{error.accepted}; {note}"
        error = DataError(error.argument, error.value, accepted, error.index)
    return error if origin is None else origin.error(error)


def _same(value: Any, other: Any) -> bool:
    """Whether two arrays, numbers or None are equal; NaN is equal to NaN."""
    if value is None or other is None:
        return value is other
    if not isinstance(value, np.ndarray | float):
        return bool(value == other)
    return np.array_equal(value, other, equal_nan=np.asarray(value).dtype.kind == "f")


def _ball(diameter: Any, mass: Any, density: Any, bodies: Any, contact: Any) -> Body:
    """The sphere that flies: as stated, or the first body, or that of the contact, as far as it is known."""
    if (diameter, mass, density) == (None, None, None):
        if bodies and not callable(bodies):
            return bodies[0]
        if isinstance(contact, sj.Contact) and not np.ndim(contact.radius + contact.mass):
            return Body.sphere(2 * np.asarray(contact.radius), np.asarray(contact.mass))
    return Body.sphere(diameter, mass, density)


def _in_si(name: str, value: Any) -> Any:
    """An argument in SI, where it has a unit of its own that pint can convert."""
    if name == "measured":
        return {name: _in_si(name, column) for name, column in value.items()}
    if name in NOT_ROWS:  # `fall` names the unit of its heights, and is no quantity
        return value
    quantity = name.removesuffix("_uncertainty")
    unit = OBSERVED.get(quantity, "m/s" if "velocity" in quantity else "")
    return in_unit(value, unit)


def _without_masked(given: dict[str, Any]) -> dict[str, Any]:
    """The arguments without the rows of which the velocity, or all that was measured, is masked."""
    measured = given.get("measured", {})
    columns = [given.get("restitution"), *(measured.get(name) for name in OBSERVED)]
    columns = [column for column in columns if column is not None]
    velocity = given.get("velocity")
    if not any(np.ma.is_masked(column) for column in (velocity, *columns)):
        return given
    lost = [np.ma.getmaskarray(column) for column in columns]
    kept = ~np.ma.getmaskarray(velocity) & ~np.all(np.broadcast_arrays(*lost), axis=0)

    def rows(value: Any) -> Any:
        if isinstance(value, sj.Contact):
            return jax.tree.map(rows, value)
        per_row = np.ndim(value) == 1 and len(value) == len(kept) and not isinstance(value, str)
        return np.ma.asarray(value)[kept] if per_row else value

    if given.get("errors") is not None:
        raise DataError("errors", "given with masked entries", "left out, or rows without them")
    fields = {name: rows(value) for name, value in given.items() if name not in NOT_ROWS}
    return given | fields | {"measured": {name: rows(column) for name, column in measured.items()}}


def _with_observables(data: type) -> None:
    """Let a set take observables as arguments of their own names."""
    made = data.__init__  # type: ignore[misc]
    signature = inspect.signature(made)

    @wraps(made)
    def __init__(self: Any, *arguments: Any, **keywords: Any) -> None:
        beside = {name: keywords.pop(name) for name in BESIDE if name in keywords}
        measured = {**keywords.pop("measured", {}), **beside}
        given = signature.bind_partial(self, *arguments, measured=measured, **keywords).arguments
        made(**_without_masked({name: _in_si(name, value) for name, value in given.items()}))

    more = [inspect.Parameter(n, inspect.Parameter.KEYWORD_ONLY, default=None) for n in BESIDE]
    parameters = [*signature.parameters.values(), *more]
    __init__.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    data.__init__ = __init__  # type: ignore[misc]


_with_observables(RestitutionData)
