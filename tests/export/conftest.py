"""Exports that several tests look at, each made once."""

import pytest

import calibration as cal
from tests.commands.conftest import without_drawing  # noqa: F401
from tests.export.laws import RANGE, STEEL, compiled


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Export steel's law, or another one, over 0.1 to 5 m/s; the Export and its folder."""
    made = {}

    def export(source=STEEL, to="c", /, **options):
        key = id(source), to, repr(sorted(options.items()))  # the Export keeps the source
        if key not in made:
            folder = tmp_path_factory.mktemp("export") / "out"
            settings = {"velocity_range": RANGE} | options
            made[key] = cal.export(source, to, folder, **settings), folder
        return made[key]

    return export


@pytest.fixture(scope="session")
def header(exported):
    def text(source, /, **options):
        settings = {"law": "exact", "steps": 50, "tolerance": 0.5} | options
        made, folder = exported(source, "c", **settings)
        return (folder / made.files[0]).read_text(encoding="utf-8")

    return text


@pytest.fixture(scope="session")
def in_c(header):
    return lambda law, flags=(), **options: compiled(header(law, **options), flags)
