"""Source text and input lines of particle codes, by the templates in `templates`."""

from functools import cache
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).with_name("templates")


def rendered(name: str, /, **values: Any) -> str:
    """A template with its values; numbers keep all their digits."""
    return _environment().get_template(name).render(values)


@cache
def _environment() -> Any:
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER),
        finalize=lambda value: repr(value) if isinstance(value, float) else value,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
