"""Columns of a table that are tracks: which is the time, which the height, of which run and object.

Read are, with any unit of length or time, or `px`,

    time, height                          also t, h, y, z, position, altitude; frame or slice in place of the time
    mass_A above t, x, y                  Tracker, one block of columns an object
    Run 1: Time (s), Run 1: Position (m)  Logger Pro, also `Latest:` and `Data Set:`
    Time (s) Run #1, Position (m) Run #1  Capstone
    Frame, X1, Y1, Flag1, X2, Y2, Flag2   ImageJ, of several objects
    Track, Slice, X, Y;  TRACK_ID, POSITION_Y, FRAME     ImageJ, of several objects below each other

Of x, y and z the height is z, unless that does not change, else y; the others are not used. What depends on the track
(velocity, acceleration, intensity) is not used either.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from calibration.data.columns import TRACK_COLUMNS, plain
from calibration.data.units import is_unit

TIME, FRAME, HEIGHT = "time", "frame", "height"
SPELLINGS = {
    TIME: "t time zeit temps tiempo tempo tijd position_t elapsed_time",
    FRAME: "frame slice frame_number frame_no frame_nr slice_n slice_n° slice_no bild image",
    HEIGHT: " ".join(
        ["distance displacement y_pos z_pos", *(f"{c.name} {c.spellings}" for c in TRACK_COLUMNS)]
    ),
}
MEANINGS = {word: meaning for meaning, words in SPELLINGS.items() for word in words.split()}
OF_RUNS = {
    "run",
    "trial",
    "launch",
    "drop",
    "series",
    "set",
    "data_set",
    "film",
    "video",
    "messung",
    "versuch",
}
OF_OBJECTS = {
    "object",
    "ball",
    "track",
    "track_id",
    "track_n",
    "track_n°",
    "particle",
    "mass",
    "point",
}
RUN = re.compile(
    r"[\s,]*\b((?:run|trial|data set|dataset|latest|messung|série|serie)\s*#?\s*\d*)\b[\s,:]*", re.I
)
IN_PIXELS = {"px", "pixel", "pixels", "pxl"}
UNITS = {TIME: "s", HEIGHT: "m"}


class TrackHeader(NamedTuple):
    """A heading: what it is, its words, unit, run and object; `meaning` None of any other column."""

    text: str
    meaning: str | None
    words: str
    unit: str | None
    run: str
    object: str


class TrackColumns(NamedTuple):
    """The columns of one track, by their places: time or frame, and height; `others` may be heights too."""

    time: int
    height: int
    others: tuple[int, ...]
    has_frames: bool
    unit_of_time: str | None
    unit_of_height: str | None
    run: str
    object: str

    @property
    def places(self) -> tuple[int, ...]:
        """All its columns."""
        return (self.time, self.height, *self.others)

    @property
    def in_pixels(self) -> bool:
        """Whether heights are pixels: as the unit says, or next to numbers of frames."""
        unit = self.unit_of_height
        return self.has_frames if unit is None else unit.casefold() in IN_PIXELS

    @property
    def name(self) -> str:
        return " ".join(filter(None, [self.object, self.run]))


def read_track_header(text: str) -> TrackHeader:
    """Read one heading of a table of tracks."""
    rest, run = str(text).strip(), ""
    if ":" in rest:  # Logger Pro: the data set, then the quantity
        run, _, rest = (part.strip() for part in rest.rpartition(":"))
    elif found := RUN.search(rest):
        run, rest = found[1].strip(), (rest[: found.start()] + " " + rest[found.end() :]).strip()
    words, unit = _parted(rest)
    name = plain(words)
    if name in MEANINGS:
        return TrackHeader(text, MEANINGS[name], name, unit, run, "")
    numbered = re.fullmatch(r"(.+?)_?(\d+)", name)  # X1, Y1 of the first object
    if numbered and numbered[1] in MEANINGS and numbered[1] != "h":
        return TrackHeader(text, MEANINGS[numbered[1]], numbered[1], unit, run, numbered[2])
    return TrackHeader(text, None, name, unit, run, "")


def _parted(text: str) -> tuple[str, str | None]:
    """The name and the unit of a heading."""
    if bracket := re.fullmatch(r"(.+?)\s*[\[(]([^\[\]()]*)[\])]", text):
        return bracket[1], bracket[2].strip() or None
    for mark in ("/", ",", " in ", "_"):
        name, found, unit = text.rpartition(mark)
        unit = unit.strip()
        is_one = unit.casefold() in IN_PIXELS or any(is_unit(unit, si) for si in UNITS.values())
        if found and unit and is_one and plain(name) in MEANINGS:
            return name, unit
    return text, None


def tracks_of(headers: Sequence[str], titles: Sequence[str] = ()) -> list[TrackColumns]:
    """The tracks of a table; none where there is no time with a height.

    Args:
        titles: what stands above the headings, in a row of its own: the object of a block of columns.
    """
    read = [read_track_header(text) for text in headers]
    read = [
        h._replace(object=h.object or name)
        for h, name in zip(read, _spread(titles, read), strict=True)
    ]
    clocks = [k for k, header in enumerate(read) if header.meaning in (TIME, FRAME)]
    blocks: dict[tuple[str, str, int], list[int]] = {}
    for k, header in enumerate(read):
        if header.meaning == HEIGHT and clocks:
            clock = _clock_of(k, read, clocks)
            blocks.setdefault((header.run, header.object, clock), []).append(k)
    found = []
    for (run, name, clock), places in blocks.items():
        height, *others = sorted(places, key=lambda k: _rank(read[k].words), reverse=True)
        time = read[clock]
        units = time.unit, read[height].unit
        is_frame = time.meaning == FRAME
        found.append(
            TrackColumns(clock, height, tuple(others), is_frame, *units, run or time.run, name)
        )
    return found


def _rank(words: str) -> int:
    """How likely a position is the height: z before y, these before one without a direction, x last."""
    letters = set(words.split("_"))
    return 3 if "z" in letters else 2 if "y" in letters else 0 if "x" in letters else 1


def _spread(titles: Sequence[str], read: Sequence[TrackHeader]) -> list[str]:
    """A title over each column: its own, or that to the left of it."""
    last, spread = "", []
    for k in range(len(read)):
        last = (titles[k].strip() if k < len(titles) else "") or last
        spread.append(last)
    return spread


def _clock_of(height: int, read: Sequence[TrackHeader], clocks: Sequence[int]) -> int:
    """The time, else the frames, of a height: of its run and block, the nearest to the left of it."""
    mine = read[height]

    def distance(k: int) -> tuple[bool, bool, bool, bool, int]:
        other = read[k]
        far = height - k if k < height else len(read) + k - height
        return (
            other.run != mine.run,
            other.object not in ("", mine.object),
            other.meaning == FRAME,
            k > height,
            far,
        )

    return min(clocks, key=distance)


def label_columns(headers: Iterable[str]) -> Mapping[str, str]:
    """Columns whose labels divide a table of one time and one height: "run" or "object" by heading."""
    kinds = {}
    for text in headers:
        name = plain(str(text).split("[")[0].split("(")[0])
        if name in OF_RUNS or name in OF_OBJECTS:
            kinds[text] = "run" if name in OF_RUNS else "object"
    return kinds
