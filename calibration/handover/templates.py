"""Source text with @names@ in it, kept as files beside this one."""

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files


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
