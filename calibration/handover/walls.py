"""Which lines of an input file are of two balls, which of a ball on a wall, and which were wanted."""

from typing import NamedTuple

WANTED, OTHER = ", as wanted", ", which needs numbers of its own"
SAME = " of the same material"
PLACE = "  # its place is your scene's to tell"


class Walled(NamedTuple):
    """What a template tells of the two.

    Attributes:
        of_balls, of_wall: words behind the headings of their lines.
        line: the wall's.
    """

    of_balls: str
    of_wall: str
    line: str


def walled(command: str, on_wall: bool | None) -> Walled:
    """The wall's line, which acts where a ball on a wall was wanted; else a scene may have none.

    Args:
        command: the line behind the fix's name and group.
        on_wall: None where nobody knows.
    """
    if on_wall:
        return Walled(OTHER, WANTED, f"fix softjax_wall all {command}{PLACE}")
    balls, wall = ("", SAME) if on_wall is None else (WANTED, SAME + OTHER)
    return Walled(balls, wall, f"# fix ID group {command}")
