"""Source text with @names@ in it, kept as files beside this one."""

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

WANTED, OTHER = ", as wanted", ", which needs numbers of its own"
SAME = " of the same material"
PLACE = "  # its place is your scene's to tell"


@cache
def template(name: str) -> str:
    """The text of a template."""
    return (files("calibration.handover") / "templates" / name).read_text(encoding="utf-8")


def filled(name: str, values: Mapping[str, object]) -> str:
    """A template with its @names@ replaced; numbers keep all their digits."""
    return re.sub(r"@(\w+)@", lambda found: _text(values[found[1]]), template(name))


def _text(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def commented(notes: tuple[str, ...]) -> str:
    """Lines behind #."""
    return "\n".join(f"# {line}".rstrip() for line in notes)


def walled(command: str, on_wall: bool | None) -> dict[str, str]:
    """The wall's line, which acts where a ball on a wall was wanted; else a scene may have none.

    Args:
        command: the line behind the fix's name and group.
        on_wall: None where nobody knows.

    Returns:
        The line, and words behind the headings of balls and of a wall: which were wanted.
    """
    if on_wall:
        line = f"fix softjax_wall all {command}{PLACE}"
        return {"of_balls": OTHER, "of_wall": WANTED, "line": line}
    balls, wall = ("", SAME) if on_wall is None else (WANTED, SAME + OTHER)
    return {"of_balls": balls, "of_wall": wall, "line": f"# fix ID group {command}"}
