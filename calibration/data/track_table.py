"""A table of tracks as impacts: its columns, the runs and objects in it, and the errors that impacts share.

Each run of the ball is a track of its own (`calibration.data.tracks`), and a group; of several objects the one that
bounces is read, or that which is named. The errors of m impacts of a track are linear in 2m independent errors of
size 1, the rows of the factor L of their covariance (`calibration.data.crossings`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from calibration.data.checks import Column, as_number, as_numbers, check_lengths
from calibration.data.contact_time import ContactTime, of_bodies
from calibration.data.kinds import TRACKS
from calibration.data.layout import has_impacts
from calibration.data.point_errors import PointErrors
from calibration.data.points import Points
from calibration.data.rows import Pair, Rows, air_of, checked_gravity
from calibration.data.track_columns import TrackColumns, label_columns, tracks_of
from calibration.data.tracks import NO_DRAG, BounceTrack, Setting, read_track
from calibration.data.units import in_si, quantity, unit_of
from calibration.errors import DataError, Origin, listed

MOST_NAMED = 10  # columns, or objects, that a remark names
SCALES = ("height_scale", "time_scale")
NO_DRAG_SEEN = (
    25.0  # of χ², five standard deviations: frames that exclude the drag of a ball in air
)
IN_METRES = "no unit of the heights, assuming metres"


class TrackOptions(NamedTuple):
    """Options of tracks outside the table; None: not stated.

    Attributes:
        frame_rate: frames a second, in place of the times.
        scale: metres in a unit of the heights, or text ("0.42 mm").
        down: whether heights increase downwards.
        exposure: of a frame [s], or text.
        object: the name of the object that is read.
    """

    frame_rate: float | None = None
    scale: float | str | None = None
    down: bool | None = None
    exposure: float | str | None = None
    object: str | None = None

    def check_unused(self) -> None:
        """Refuse what only a track has."""
        for name, value in self._asdict().items():
            if value is not None:
                raise DataError(name, "given", "left out where the table is no track z(t)")


class _Film(NamedTuple):
    """One run of one object: rows of the table and its columns."""

    run: str
    object: str
    columns: TrackColumns
    rows: Int[np.ndarray, " k"]

    @property
    def name(self) -> str:
        name = f"object {self.object}" if self.object.isdigit() else self.object
        return " ".join(filter(None, [name, self.run])) or "track"


def tracks_in(headers: Sequence[str], titles: Sequence[str] = ()) -> list[TrackColumns]:
    """The columns of the tracks of a table; none where its rows are impacts.

    Args:
        titles: what stands above the headings in a row of its own.
    """
    return [] if has_impacts(headers) else tracks_of(headers, titles)


def read_tracks(
    table: Any,
    headers: Sequence[str],
    pair: Pair,
    gravity: float | None,
    air: Any,
    options: TrackOptions,
    contact: ContactTime | None,
    origin: Origin | None,
    instruments: Mapping[str, float],
) -> tuple[Rows, Points]:
    """The rows of a table of tracks, and their impacts (see `RestitutionData.from_table`).

    Args:
        instruments: the scales of heights and times.
        contact: what is stated of the contact's duration; None: Hertz's of the bodies, if these are known.

    Raises:
        DataError: with the row to blame where there is one.
    """
    for name in {*instruments} - {*SCALES}:
        raise DataError(name, "given", f"left out with a track, which has {listed(SCALES)}")
    of_pair, bodies = pair.of_rows({})
    g = checked_gravity(gravity)
    around, not_corrected = air_of(air, pair.ball, TRACKS, g)
    stated = _stated(options)
    duration = of_bodies(of_pair) if contact is None else contact
    setting = Setting(g, around, float(stated.exposure or 0.0), duration, options.down)
    columns = tracks_of(headers, getattr(table, "titles", ()))
    films = list(_films(table, headers, columns))
    films, remarks = _one_object(films, options.object)
    read, left_out = _all_read(table, headers, films, stated, setting, instruments)
    of_air: list[str] = []
    if air is None and around is not None:
        in_vacuum = setting._replace(air=None)
        try:
            bare, others = _all_read(table, headers, films, stated, in_vacuum, instruments)
        except DataError:  # flights in air do not fall with g
            bare, others = [], []
        if (gain := _gain(read, bare)) > NO_DRAG_SEEN:
            read, left_out, around = bare, others, None
            of_air = [
                f"flights are read as in vacuum: their frames show no drag (χ² {gain:.0f} lower than with that of the "
                "stated ball; air = true corrects them all the same)"
            ]
    several = len(read) > 1
    remarks = [
        *_of_columns(headers, read[0][0].columns, options, columns),
        *remarks,
        *left_out,
        *([NO_DRAG] if not_corrected else []),
        *of_air,
        *(
            f"{film.name}: {text}" if several else text
            for film, track in read
            for text in (*_summary(track), *track.remarks)
        ),
    ]
    rows = Rows(
        TRACKS, {}, frozenset(), g, of_pair, bodies, around, None, tuple(remarks), origin, ""
    )
    return rows, _together(read)


def _gain(in_air: list[tuple[_Film, BounceTrack]], bare: list[tuple[_Film, BounceTrack]]) -> float:
    """Gain of χ² of all frames without air; 0 where other impacts are read then."""
    pairs = [(a, b) for (_, a), (_, b) in zip(in_air, bare, strict=False)]
    if [len(a) for _, a in in_air] != [len(b) for _, b in bare]:
        return 0.0
    return sum(a.degrees * ((a.noise / b.noise) ** 2 - 1) for a, b in pairs if b.noise > 0)


def _all_read(
    table: Any,
    headers: Sequence[str],
    films: Sequence[_Film],
    options: TrackOptions,
    setting: Setting,
    instruments: Mapping[str, float],
) -> tuple[list[tuple[_Film, BounceTrack]], list[str]]:
    """The tracks that have impacts, and sentences on the others; refused where none, or several objects, do."""
    read: list[tuple[_Film, BounceTrack]] = []
    refused: list[tuple[_Film, DataError]] = []
    for film in films:
        film = _with_height(table, headers, film)
        try:
            read.append((film, _read(table, headers, film, options, setting, instruments)))
        except DataError as error:
            refused.append((film, error))
    objects = dict.fromkeys(film.object for film, _ in read)
    if not read:
        raise _refusal(refused)
    if len(objects) > 1:
        names = listed(map(repr, [*objects][:MOST_NAMED]))
        raise DataError("object", f"not stated, and {names} bounce", "the name of one of these")
    return read, [
        f"{film.name} is not used: {error.argument} {error.value}" for film, error in refused
    ]


def _stated(options: TrackOptions) -> TrackOptions:
    """The options as numbers in SI; raises DataError."""
    positive = lambda x: x > 0  # noqa: E731
    numbers: dict[str, Any] = {}
    for name, unit, accepted in (
        ("frame_rate", None, "a positive number of frames a second"),
        (
            "scale",
            "m",
            'a positive length, the metres in a unit of the heights, or text ("0.42 mm")',
        ),
        ("exposure", "s", 'a time of 0 or more in s, or text ("1 ms")'),
    ):
        value = getattr(options, name)
        if value is not None:
            number = quantity(value, unit) if isinstance(value, str) and unit else value
            holds = (lambda x: x >= 0) if name == "exposure" else positive
            numbers[name] = as_number(name, number, holds, accepted)
    if options.down is not None and not isinstance(options.down, bool):
        raise DataError("down", options.down, "true or false")
    return options._replace(**numbers)


def _films(table: Any, headers: Sequence[str], columns: Sequence[TrackColumns]) -> Iterator[_Film]:
    """The tracks side by side, or below each other by their labels."""
    count = len(_column(table, headers, columns[0].height))
    labels = label_columns(headers) if len(columns) == 1 else {}
    texts = {kind: _texts(table, header) for header, kind in labels.items()}
    for each in columns:
        if not texts:
            yield _Film(each.run, each.object, each, np.arange(count))
            continue
        keys = list(
            zip(*(texts.get(kind, [""] * count) for kind in ("run", "object")), strict=True)
        )
        for run, name in dict.fromkeys(keys):
            rows = np.array([k for k, key in enumerate(keys) if key == (run, name)])
            yield _Film(run, name or each.object, each, rows)


def _with_height(table: Any, headers: Sequence[str], film: _Film) -> _Film:
    """The track with the first of its heights that changes: z is 0 throughout in a plane."""
    columns = film.columns
    for place in (columns.height, *columns.others):
        height = as_numbers("height", _column(table, headers, place))[film.rows]
        if np.nanmin(height, initial=np.inf) < np.nanmax(height, initial=-np.inf):
            return film._replace(columns=columns._replace(height=place))
    return film


def _column(table: Any, headers: Sequence[str], place: int) -> Any:
    """A column by its place: in a file headings may be there twice."""
    by_place = getattr(type(table), "numbers_at", None)
    heading = headers[place]
    return table[heading] if by_place is None else by_place(table, place, str(heading))


def _texts(table: Any, header: str) -> list[str]:
    """A column of labels as text."""
    text_of = getattr(type(table), "text_of", None)
    return list(map(str, table[header] if text_of is None else text_of(table, header)))


def _one_object(films: Sequence[_Film], chosen: str | None) -> tuple[list[_Film], list[str]]:
    """The tracks of the object that is chosen, and a remark on the others; raises DataError."""
    names = dict.fromkeys(film.object for film in films)
    if chosen is None:
        return list(films), []
    if chosen not in names:
        accepted = (
            f"one of {listed(map(repr, names))}" if any(names) else "left out for a single object"
        )
        raise DataError("object", repr(chosen), accepted)
    others = listed(name for name in names if name != chosen)
    return [film for film in films if film.object == chosen], [
        f"objects not used: {others}"
    ] if others else []


def _read(
    table: Any,
    headers: Sequence[str],
    film: _Film,
    options: TrackOptions,
    setting: Setting,
    instruments: Mapping[str, float],
) -> BounceTrack:
    """One track in SI, or pixels."""
    columns = film.columns
    time = as_numbers("time", _column(table, headers, columns.time))[film.rows]
    height = as_numbers("height", _column(table, headers, columns.height))[film.rows]
    check_lengths({"time": time, "height": height})
    if options.frame_rate is not None:
        time = _frames(time, columns.has_frames) / float(options.frame_rate)
    elif columns.has_frames:
        accepted = "stated with numbers of frames, in frames a second (frame_rate = 240)"
        raise DataError("frame_rate", "missing", accepted)
    elif columns.unit_of_time is not None:
        time = in_si(time, unit_of(columns.unit_of_time, "s"))
    in_pixels = columns.in_pixels and options.scale is None
    if options.scale is not None:
        height = height * float(options.scale)
    elif not in_pixels and columns.unit_of_height is not None:
        height = in_si(height, unit_of(columns.unit_of_height, "m"))
    height, time = (
        x * instruments.get(name, 1.0) for x, name in zip((height, time), SCALES, strict=True)
    )
    try:
        return read_track(time, height, setting._replace(in_pixels=in_pixels))
    except DataError as error:
        index = None if error.index is None else int(film.rows[error.index])
        raise DataError(error.argument, error.value, error.accepted, index) from None


def _frames(time: Column, are_frames: bool) -> Column:
    """Numbers of frames, counted from the times where these are given."""
    if are_frames:
        return time
    steps = np.diff(time[np.isfinite(time)])
    step = float(np.median(steps)) if len(steps) else 1.0
    return np.round((time - time[0]) / step) if step > 0 else np.arange(len(time)) * 1.0


def _refusal(refused: Sequence[tuple[_Film, DataError]]) -> DataError:
    """Why no track is read: of several that of the first, with its name."""
    film, error = refused[0]
    if len({str(other) for _, other in refused}) == 1:
        return error
    argument = f"{error.argument} of {film.name}, the first of {len(refused)} tracks"
    return DataError(argument, error.value, error.accepted, error.index)


def _of_columns(
    headers: Sequence[str],
    columns: TrackColumns,
    options: TrackOptions,
    every: Sequence[TrackColumns],
) -> list[str]:
    """How the columns were read."""
    labels = label_columns(headers) if len(every) == 1 else {}
    used = {k for each in (*every[1:], columns) for k in (each.time, each.height)}
    left = [
        repr(str(h)[:40]) for k, h in enumerate(headers) if k not in used and h and h not in labels
    ]
    time, height = headers[columns.time], headers[columns.height]
    remarks = [f"read as a track: time {time!r}, height {height!r}"]
    if columns.unit_of_height is None and not columns.in_pixels and options.scale is None:
        remarks.append(IN_METRES)
    if columns.in_pixels and columns.unit_of_height is None and options.scale is None:
        remarks.append("no unit of the heights next to frames, assuming pixels")
    if left:
        more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
        remarks.append(f"columns not used: {listed(left[:MOST_NAMED])}{more}")
    return remarks


def _summary(track: BounceTrack) -> list[str]:
    frames, noise = len(track.track.time), 1000 * track.noise * track.metre
    return [
        f"{frames} frames, {len(track.flights)} flights, {len(track)} impact{'s' * (len(track) > 1)}; "
        f"noise of a frame {noise:.2g} mm"
    ]


def _together(read: Sequence[tuple[_Film, BounceTrack]]) -> Points:
    """The impacts of all tracks, whose errors are independent of each other's."""
    counts = [len(track) for _, track in read]
    n, width = sum(counts), 2 * max(counts)
    index, rows = np.full((n, width), -1), np.zeros(n, int)
    to_restitution, to_velocity = np.zeros((n, width)), np.zeros((n, width))
    first = 0
    for film, track in read:
        m = len(track)
        at, own = slice(first, first + m), slice(0, 2 * m)
        index[at, own] = 2 * first + np.arange(2 * m)
        to_restitution[at, own], to_velocity[at, own] = track.root[:m], track.root[m:]
        rows[at] = film.rows[track.frames]
        first += m
    tracks = [track for _, track in read]
    by_drag = [track.by_drag for track in tracks if track.by_drag is not None]
    every_drag = np.concatenate(by_drag) if by_drag else None
    errors = PointErrors(
        index, to_restitution, to_velocity, np.ones(2 * n), TRACKS.name, by_drag=every_drag
    )
    return Points(
        np.concatenate([track.velocity for track in tracks]),
        np.concatenate([track.restitution for track in tracks]),
        errors,
        rows,
        (),
        np.repeat([float(track.degrees) for track in tracks], counts),
        tuple(replace(track, name=film.name) for film, track in read),
        np.repeat(np.array([film.name for film, _ in read], object), counts)
        if len(read) > 1
        else None,
    )
