"""Columns that are not used: which are harmless, which divide the rows, which make them another experiment.

What is not used decides whether the rows are of one kind:

    harmless      an index, a note, a constant, a mean of other columns, a quantity that no law here has
    dividing      text or whole numbers in blocks: of bounces the launch, of repeated drops harmless, of
                  materials refused
    another       an angle of incidence that is not 0 throughout: refused

Words that are known decide first (`calibration.data.words`). Unknown text, or unknown whole numbers without a unit,
divides the rows if it forms two blocks of two rows or more.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from calibration.data.checks import Column
from calibration.data.words import (
    ANGLES,
    COUNTED,
    MATERIALS,
    REMARKS,
    REPETITIONS,
    SPECIMENS,
    is_angle,
    is_statistic_heading,
    tokens,
    unit_in,
)
from calibration.errors import DataError, listed, printable

EXACT = 1e15  # up to which whole numbers are written without an exponent
SHOWN = 3  # values that a message names
MATERIALS_ARE = (
    "of one material: one file and one [[material]] for each; or name the column `group` if these are "
    "specimens of one material"
)
DIVIDED = "one that is named for what it is: `group` for specimens or days, `launch` for bounces, `note` if it means nothing"
NORMAL = "normal: leave out the rows that are not, or give the normal components of the velocities without the angle"


class Unused(NamedTuple):
    """A column that is not used: its heading and its cells as text, "" where empty."""

    heading: str
    cells: Sequence[str]

    @property
    def words(self) -> set[str]:
        return {*tokens(self.heading)}

    @property
    def values(self) -> list[str]:
        """Different values, in the order in which they appear."""
        return list({cell.casefold(): cell for cell in reversed(self.cells) if cell}.values())[::-1]

    @property
    def numbers(self) -> Column | None:
        """Cells as numbers, NaN where empty; None where one is text."""
        try:
            return np.array(
                [float(cell.replace(",", ".")) if cell else np.nan for cell in self.cells]
            )
        except ValueError:
            return None

    @property
    def counts(self) -> bool:
        """Whether its numbers, or those that its labels end with, go up one by one."""
        ends = [cell[len(cell.rstrip("0123456789")) :] for cell in self.cells]
        heads = {cell[: len(cell) - len(end)] for cell, end in zip(self.cells, ends, strict=True)}
        if len(heads) == 1 and all(ends):
            numbers = np.array([float(end) for end in ends])
        elif all(len(cell) == 1 for cell in self.cells):  # A, B, C
            numbers = np.array([float(ord(cell)) for cell in self.cells])
        else:
            return False
        return bool(np.all(np.diff(numbers) == 1))

    @property
    def is_whole(self) -> bool:
        """Whether its cells are whole numbers of no unit."""
        numbers = self.numbers
        return numbers is not None and not unit_in(self.heading) and bool(np.all(numbers % 1 == 0))

    @property
    def forms_blocks(self) -> bool:
        """Whether two blocks of two rows or more have values of their own."""
        blocks = [(value, len([*rows])) for value, rows in groupby(self.cells)]
        long = [value for value, count in blocks if count > 1 and value]
        return len(long) > 1 and len({*long}) > 1

    @property
    def is_empty(self) -> bool:
        return 2 * sum(map(bool, self.cells)) <= len(self.cells)

    def shown(self) -> str:
        more = ", ..." if len(self.values) > SHOWN else ""
        some = listed(repr(printable(value[:20])) for value in self.values[:SHOWN])
        return f"{printable(self.heading[:40])!r} with {len(self.values)} values, {some}{more}"


def check_unused(
    columns: Sequence[Unused], settings: Mapping[str, Column], has_group: bool
) -> None:
    """Refuse columns that make the rows of several materials, or of oblique impacts.

    Args:
        settings: readings that an experimenter sets, such as drop heights: what goes with them divides nothing.
        has_group: whether the rows are grouped already.

    Raises:
        DataError: with what to do.
    """
    for column in columns:
        if is_angle(column.heading):
            _refuse_oblique(column)
        elif len(column.values) > 1 and _is_of_materials(column, has_group):
            raise DataError("column", column.shown(), MATERIALS_ARE)
        elif not has_group and _divides_unsaid(column) and not _goes_with(column, settings):
            raise DataError("column", column.shown(), DIVIDED)


def check_numbered(columns: Sequence[Unused]) -> None:
    """Refuse numbers of bounces that do not count them one by one, from the start for each launch."""
    for column in columns:
        numbers = column.numbers
        if numbers is None or not (len(numbers) == 1 or column.counts or _starts(numbers)):
            accepted = "one for each row, that counts 0, 1, 2, ... and begins again for each launch"
            raise DataError("column", f"{column.heading[:40]!r}, no number of a bounce", accepted)


def launches_of(columns: Sequence[Unused]) -> tuple[list[str], list[str]] | None:
    """The headings of the columns that separate launches of bounces, and a label for each row."""
    found = [*_launches(columns)]
    # an unknown word divides where no known one does
    used = [one for one in found if one[0]] or found[:1]
    if not used:
        return None
    changes = [np.array(labels[1:]) != np.array(labels[:-1]) for *_, labels in used]
    # one column may have all the changes
    sufficient = [
        one for one, own in zip(used, changes, strict=True) if np.all(own | ~np.any(changes, 0))
    ]
    used = sufficient[:1] or used
    rows = zip(*(labels for *_, labels in used), strict=True)
    return [heading for _, heading, _ in used], [" ".join(row) for row in rows]


def _launches(columns: Sequence[Unused]) -> Iterator[tuple[bool, str, list[str]]]:
    for column in columns:
        numbers = column.numbers
        is_known = bool(column.words & REPETITIONS)
        if is_angle(column.heading) or len(column.values) < 2 or not all(column.cells):
            continue
        starts = _starts(numbers) if numbers is not None and column.is_whole else None
        if starts is not None and starts > 1 and (is_known or column.words & COUNTED):
            assert numbers is not None
            launch = np.cumsum(np.append(True, np.diff(numbers) <= 0))
            yield True, column.heading, [str(k) for k in launch]
        elif is_known or (column.words & COUNTED and column.forms_blocks):
            yield True, column.heading, list(column.cells)
        elif _divides_unsaid(column):
            yield False, column.heading, list(column.cells)


def _starts(numbers: Column) -> int | None:
    """How often numbers count up one by one, each time from the first number; None where they do not."""
    steps = np.diff(numbers)
    back = numbers[1:][steps != 1]
    runs = len(back) + 1
    is_count = np.all(back == numbers[0]) and np.any(steps == 1) and runs * 2 <= len(numbers)
    return runs if is_count else None


def _refuse_oblique(column: Unused) -> None:
    """Refuse an angle that is not 0 in each row."""
    numbers = column.numbers
    for row, cell in enumerate(column.cells):
        if cell and (numbers is None or numbers[row] != 0):
            raise DataError(f"column {printable(column.heading[:40])!r}", cell[:40], NORMAL, row)


def _is_of_materials(column: Unused, has_group: bool) -> bool:
    """Whether it names materials, or specimens that are not numbered one by one."""
    words = column.words - REMARKS
    numbers = column.numbers
    if unit_in(column.heading) or (numbers is not None and not column.is_whole):
        return False  # the floor's temperature
    if words & MATERIALS:
        return not column.counts or numbers is None
    # where there is a group it says which balls are the same
    return bool(words & SPECIMENS) and not column.counts and not has_group


def _divides_unsaid(column: Unused) -> bool:
    """Whether it forms blocks, and no known word says what of."""
    known = REMARKS | REPETITIONS | COUNTED | ANGLES | MATERIALS | SPECIMENS
    if column.words & known or is_statistic_heading(column.heading) or column.is_empty:
        return False
    is_text = column.numbers is None
    return (is_text or column.is_whole) and column.forms_blocks and not column.counts


def _goes_with(column: Unused, settings: Mapping[str, Column]) -> bool:
    """Whether it has one value for each value of a setting, and the other way round."""
    for values in settings.values():
        pairs = {*zip(column.cells, values.tolist(), strict=True)}
        if len(pairs) == len(column.values) == len({*values.tolist()}):
            return True
    return False


def as_cells(values: Any) -> list[str]:
    """Cells of a column as text, "" where one is empty; whole numbers without a decimal point."""
    array = np.asarray(values)
    if array.dtype.kind == "f":
        return [
            "" if np.isnan(x) else str(int(x)) if x % 1 == 0 and abs(x) < EXACT else repr(float(x))
            for x in array
        ]
    missing = (None, "nan", "NaT", "<NA>", "")
    return ["" if x is None or str(x) in missing else str(x).strip() for x in array.tolist()]
