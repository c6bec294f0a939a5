"""Malformed input files: each is refused in one line that names the file, the line and the cure.

A `Case` holds what differs from the good pair of files, `TOML` and `CSV`.
"""

from pathlib import Path
from typing import NamedTuple

import pytest

from calibration.errors import InputError

TOML = """\
[[material]]
name = "my alloy"
youngs_modulus = 1.93e11
poisson_ratio = 0.35
density = 8030
yield_strength = 3.10e8
radius = 0.0127
data = "m.csv"
"""
CSV = """\
velocity [m/s],restitution,uncertainty
0.12,0.95,0.004
0.5,0.9,0.004
2.0,0.8,0.004
"""


class Case(NamedTuple):
    """A malformed pair of files: the line to be told starts so and holds these words."""

    start: str  # file:line: problem
    says: str  # somewhere behind: what is accepted
    toml: str | bytes = TOML
    csv: str | bytes | None = CSV


def written(case: Case, directory: Path) -> Path:
    """Put the case's files into a directory; the path of the TOML file."""
    for name, content in {"m.toml": case.toml, "m.csv": case.csv}.items():
        if content is not None:
            raw = content if isinstance(content, bytes) else content.encode()
            (directory / name).write_bytes(raw)
    return directory / "m.toml"


def check_refused(case: Case, directory: Path, read) -> None:
    """`read` refuses the case's files in the one line that it says."""
    with pytest.raises(InputError) as caught:
        read(written(case, directory))
    message = str(caught.value)
    assert message.startswith((f"{directory}/{case.start}", f"{directory}{case.start}")), message
    told, _, accepted = message.removeprefix(f"{directory}/").partition("; ")
    assert case.says in accepted, message
    assert message.isprintable()
    assert len(told) + len(accepted) < 350
