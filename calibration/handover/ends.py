"""Where contacts with damping end."""

from typing import Any


def end_of(law: Any) -> str:
    """`"zero-overlap" or "zero-force"`."""
    return getattr(law, "end", None) or law.reduced().ends_at
