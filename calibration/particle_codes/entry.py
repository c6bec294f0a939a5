"""Export a contact law to a particle code."""

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax

import softjax as sj
from calibration.data.json_file import dumps
from calibration.errors import DataError, listed
from calibration.fitting.material import MaterialFit
from calibration.fitting.result import FitResult
from calibration.output import check_writable, files_into, write_text
from calibration.particle_codes import lammps, liggghts, yade
from calibration.particle_codes.c_header import header_of
from calibration.particle_codes.choice import EXACT, HEADER, Backend, ExportOptions, choose
from calibration.particle_codes.report import Export
from calibration.particle_codes.target import target_of
from calibration.plots import style

# a code of the user: the C header alone, of any law
C_CODE = SimpleNamespace(
    BACKENDS={
        key: Backend(
            HEADER, fewest=20 if key in ("linear", "hertz-dashpot", "viscoelastic") else 10
        )
        for key in ("linear", "hertz-dashpot", "viscoelastic", "walton-braun", EXACT)
    },
    REFUSED={},
    PREFIXED=True,
    file_names=lambda prefix: (f"{prefix}_law.h",),
    files=lambda export, header: {f"{export.options.prefix}_law.h": header},
)
CODES: dict[str, Any] = {"c": C_CODE, "lammps": lammps, "liggghts": liggghts, "yade": yade}


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
    prefix: str = "softjax",
    types: tuple[int, int] | None = None,
    below: str = "none",
    sizes: tuple[float, ...] | None = None,
) -> Export:
    """Write a law for a particle code, the cheapest one that keeps a tolerance of ε.

    Args:
        result_or_law: a fit, or a contact law with single numbers for its fields.
        to: "c" (a header for your own code), "lammps", "liggghts" or "yade".
        out: the folder for input lines or source, export.json and export.png.
        material: which data set of a fit of several; a name for a law.
        velocity_range: lowest and highest impact velocity of the scene [m/s]; that of the data
            where left out.
        tolerance: the largest error of ε over the range, that of the time step included.
        law: "auto", the first of linear, hertz-dashpot, viscoelastic and walton-braun that keeps
            it, as far as the code has them, else the law itself; or one of these by name, "exact"
            among them.
        steps: time steps in the shortest contact; as many as the tolerance needs where left out.
        overlap: the largest overlap over the radius that the scene bears: springs are made softer
            until it is reached, at the same ε. As stiff as the law is where left out.
        radius: the radius [m] that overlaps are compared with; where left out that of the smaller sphere
            if a fit knows the bodies, else the effective one.
        on_wall: whether the law is of a ball on a flat wall, whose lines are then the active ones, or
            of two balls; where left out as a fit knows.
        losses: whether the losses of Eq. (17), which enter ε, are taken off the unloading force.
        prefix: of all names in C, and of the law in LAMMPS. Exports with several prefixes into one folder
            make one plugin with several laws.
        types: the two types of atoms in LAMMPS between which the law acts; all where left out.
        below: the law of impacts slower than the range: "none", the law as it is, which may lose next to nothing
            there; or "hold", the ε of the lowest velocity, by a dashpot inside the largest overlap.
        sizes: radii [m] of the types of atoms 1, 2, … of the scene, all of this material: the tolerance
            holds for all their pairs, and damping that depends on the mass is written for each.

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
    code = _code(to, tolerance, steps, prefix, types, below, sizes)
    check_writable(out)
    options = ExportOptions(tolerance, law, steps, overlap, losses, prefix, types, below, sizes)
    with jax.enable_x64(True):
        target = target_of(result_or_law, material, velocity_range, losses, radius, on_wall, sizes)
        made = Export(to, target, *choose(target, code, options), options)
        choice, source = made.choice, ""
        if choice.backend.name == HEADER:
            source = header_of(
                choice.law,
                made.notes,
                target.range,
                made.time_step,
                choice.table,
                softening_factor=choice.softening_factor,
                losses=losses,
                prefix=prefix,
                hold=choice.hold,
            )
    files = code.files(made, source)
    report, picture = _reports(prefix)
    made = dataclasses.replace(made, files=(*files, report, picture))
    every = {name for one in CODES.values() for name in one.file_names(prefix)}
    with files_into(out, sorted(every | {report, picture})) as folder:
        for name, text in files.items():
            write_text(folder / name, text)
        write_text(folder / report, dumps(made.to_dict(), indent=2))
        style.save(made.draw(), folder / picture)
    return made


def _reports(prefix: str) -> tuple[str, str]:
    """Names of the report and the picture: several laws may go into one folder."""
    name = "export" if prefix == "softjax" else f"export_{prefix}"
    return f"{name}.json", f"{name}.png"


def _code(
    to: str, tolerance: float, steps: int | None, prefix: str, types: Any, below: str, sizes: Any
) -> Any:
    if to not in CODES:
        raise DataError("to", to, listed(CODES))
    if not 0 < tolerance < 1:
        raise DataError("tolerance", tolerance, "a number in (0, 1)")
    if steps is not None and (isinstance(steps, bool) or not isinstance(steps, int) or steps < 2):
        raise DataError("steps", steps, "a whole number of 2 or more")
    if prefix != "softjax" and not CODES[to].PREFIXED:
        raise DataError("prefix", prefix, f"left out with {to}, whose files go by softjax")
    if not re.fullmatch("[a-z][a-z0-9_]*", prefix):
        raise DataError("prefix", prefix, "a name in C, of small letters")
    if below not in ("none", "hold"):
        raise DataError("below", below, "none or hold")
    if sizes is not None and types is not None:
        raise DataError("types", types, "left out with sizes, which are those of types 1, 2, …")
    if types is not None and to != "lammps":
        raise DataError("types", types, f"left out with {to}")
    if types is not None and (
        len(types) != 2 or not all(isinstance(t, int) and t > 0 for t in types)
    ):
        raise DataError("types", types, "two types of atoms, such as 1 2")
    return CODES[to]
