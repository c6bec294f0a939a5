"""Hand a law over to a particle code: `export` is the door to everything here."""

import re
from pathlib import Path
from typing import Any

import jax

import softjax as sj
from calibration.data.json_file import dumps
from calibration.errors import DataError, listed
from calibration.fitting.material import MaterialFit
from calibration.fitting.result import FitResult
from calibration.handover import c, lammps, liggghts, yade
from calibration.handover.c_header import PREFIX, Header, header_of
from calibration.handover.choice import HEADER, Order, choose
from calibration.handover.exported import Draft, Export, notes_of
from calibration.handover.picture import draw_export
from calibration.handover.wanted import wanted_of
from calibration.output import check_writable, files_into, write_text
from calibration.plots import style

CODES: dict[str, Any] = {"c": c, "lammps": lammps, "liggghts": liggghts, "yade": yade}
REPORT, PICTURE = "export.json", "export.png"


def export(
    result_or_law: FitResult | MaterialFit | sj.ContactLaw,
    to: str = "c",
    out: str | Path = "export",
    *,
    material: str | None = None,
    velocity_range: tuple[float, float] | None = None,
    tolerance: float = 0.01,
    law: str = "auto",
    steps: int | None = None,
    overlap: float | None = None,
    radius: float | None = None,
    on_wall: bool | None = None,
    losses: bool = True,
    version: int | None = None,
    prefix: str = PREFIX,
) -> Export:
    """Write a law for a particle code, the cheapest one that keeps a tolerance of ε.

    Args:
        result_or_law: a fit, or a contact law with single numbers for its fields.
        to: "c" (a header for one's own code), "lammps", "liggghts" or "yade".
        out: the folder for input lines or source, export.json and export.png.
        material: which data set of a fit of several; a name for a law.
        velocity_range: lowest and highest impact velocity of the scene [m/s]; that of the data
            where left out.
        tolerance: the largest error of ε over the range, that of the time step included.
        law: "auto", the first of linear, hertz-dashpot, viscoelastic and walton-braun that keeps
            it, as far as the code has them, else the law itself; or one of these by name, "itself"
            among them.
        steps: time steps in the shortest contact; as many as the tolerance needs where left out.
        overlap: the largest overlap over the radius that the scene bears: springs are made softer
            until it is reached, at the same ε. As stiff as the law is where left out.
        radius: what overlaps are told over [m]; where left out that of the smaller sphere if a fit
            knows the bodies, else the effective one.
        on_wall: whether the law is of a ball on a flat wall, whose lines are then the active ones, or
            of two balls; where left out as a fit knows.
        losses: whether what is in ε and in no force, Eq. (17), is taken off the unloading force.
        version: of LAMMPS, such as 20250722: how its input is to be read depends on it.
        prefix: of all names in a C header.

    Returns:
        An `Export`; it prints itself.

    Raises:
        ValueError: naming the argument, its value and what is accepted; where no law that the code
            has keeps the tolerance, the best one and its error.

    Example:
        >>> import calibration as cal
        >>> result = cal.fit(cal.paper_materials()[0])
        >>> print(cal.export(result, to="lammps", velocity_range=(0.5, 2.0)))  # doctest: +SKIP
    """
    _check(to, tolerance, steps, version, prefix)
    check_writable(out)
    order = Order(tolerance, law, steps, overlap, losses, version)
    with jax.enable_x64(True):
        wanted = wanted_of(result_or_law, material, velocity_range, losses, radius, on_wall)
        choice, tried = choose(wanted, CODES[to], order)
        notes = notes_of(wanted, choice, order)
        header = Header("", 0.0)
        if choice.carrier.name == HEADER:
            header = header_of(
                choice.law,
                notes[0],
                notes[1:],
                stretch=choice.stretch,
                losses=losses,
                prefix=prefix,
                fastest=wanted.range[1],
            )
    files = CODES[to].files(Draft(wanted, choice, notes, header.source, version))
    made = Export(
        to, wanted, choice, tried, order, header.interpolation_error, (*files, REPORT, PICTURE)
    )
    _write(Path(out), files, made)
    return made


def _check(to: str, tolerance: float, steps: int | None, version: int | None, prefix: str) -> None:
    if to not in CODES:
        raise DataError("to", to, listed(CODES))
    if not 0 < tolerance < 1:
        raise DataError("tolerance", tolerance, "a number in (0, 1)")
    if steps is not None and (isinstance(steps, bool) or not isinstance(steps, int) or steps < 2):
        raise DataError("steps", steps, "a whole number of 2 or more")
    if version is not None and to != "lammps":
        raise DataError("version", version, f"left out with {to}")
    if prefix != PREFIX and to != "c":
        raise DataError("prefix", prefix, f"left out with {to}, whose files go by {PREFIX}")
    if not re.fullmatch("[a-z][a-z0-9_]*", prefix):
        raise DataError("prefix", prefix, "a name in C, of small letters")


def _write(out: Path, files: dict[str, str], made: Export) -> None:
    """All files at once."""
    every = (*(name for code in CODES.values() for name in code.FILES), REPORT, PICTURE)
    with files_into(out, dict.fromkeys(every)) as folder:
        for name, text in files.items():
            write_text(folder / name, text)
        write_text(folder / REPORT, dumps(made.to_dict(), indent=2))
        style.save(draw_export(made), folder / PICTURE)
