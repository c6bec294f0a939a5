"""Export a contact law to a particle code."""

import dataclasses
import math
import re
from pathlib import Path

import jax

import softjax as sj
from calibration.data.json_file import dumps
from calibration.errors import DataError, listed
from calibration.fit_result import FitResult
from calibration.fitting.material import MaterialFit
from calibration.output import check_writable, files_into, write_text
from calibration.particle_codes.choice import choose
from calibration.particle_codes.codes import BACKENDS, HEADER, PLUGINS
from calibration.particle_codes.files import INPUTS, LIBRARY, PLUGIN, files_of
from calibration.particle_codes.report import Export
from calibration.particle_codes.target import ExportOptions, target_of
from calibration.plots import style


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
    gravity: float | None = None,
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
        types: the two types of atoms in LAMMPS or LIGGGHTS between which the law acts; all where left out.
            A wall of LIGGGHTS has the second one.
        below: the law of impacts slower than the range: "none", the law as it is, which may lose next to nothing
            there; or "hold", the ε of the lowest velocity, by a dashpot inside the largest overlap.
        sizes: radii [m] of the types of atoms 1, 2, … of the scene, all of this material: the tolerance
            holds for all their pairs, and damping that depends on the mass is written for each.
        gravity: g [m/s²] of the scene, whose weight is within the stated error; 0: there is none. That of measured
            heights, else 9.80665, where left out.

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
    options = ExportOptions(
        *(material, velocity_range, tolerance, law, steps, overlap, radius, on_wall),
        *(losses, prefix, types, below, sizes, gravity),
    )
    _check(to, options)
    check_writable(out)
    with jax.enable_x64(True):
        target = target_of(result_or_law, options)
        made = Export(to, target, *choose(target, to))
        if made.choice.backend.name == HEADER and to in PLUGINS:
            made = dataclasses.replace(made, stale=(Path(out) / LIBRARY).exists())
        files = files_of(made)
    name = "export" if prefix == "softjax" else f"export_{prefix}"  # several laws in one folder
    report, picture = f"{name}.json", f"{name}.png"
    made = dataclasses.replace(made, files=(*files, report, picture))
    inputs = [file.format(prefix) for _, file in INPUTS.values()]
    possible = {*inputs, f"{prefix}_law.h", *PLUGIN, report, picture}  # of whatever code
    with files_into(out, sorted(possible)) as folder:
        for file, text in files.items():
            write_text(folder / file, text)
        write_text(folder / report, dumps(made.to_dict()))
        style.draw(made.draw, folder / picture)
    return made


def _check(to: str, options: ExportOptions) -> None:
    """Refuse the first option that makes no sense."""
    if to not in BACKENDS:
        raise DataError("to", to, listed(BACKENDS))
    steps, prefix, types, radius = options.steps, options.prefix, options.types, options.radius
    gravity = options.gravity
    two = types is None or (len(types) == 2 and all(isinstance(t, int) and t > 0 for t in types))
    is_whole = steps is None or (type(steps) is int and steps >= 2)
    named = prefix == "softjax" or to != "yade"
    for argument, good, accepted in (
        ("tolerance", 0 < options.tolerance < 1, "a number in (0, 1)"),
        ("steps", is_whole, "a whole number of 2 or more"),
        ("prefix", named, f"left out with {to}, whose files go by softjax"),
        ("prefix", re.fullmatch("[a-z][a-z0-9_]*", prefix), "a name in C, of small letters"),
        ("below", options.below in ("none", "hold"), "none or hold"),
        ("types", not (types and options.sizes), "left out with sizes, of types 1, 2, …"),
        ("types", types is None or to in ("lammps", "liggghts"), f"left out with {to}"),
        ("types", two, "two types of atoms, such as 1 2"),
        ("gravity", gravity is None or 0 <= gravity < math.inf, "an acceleration in m/s², or 0"),
        ("radius", radius is None or 0 < radius < math.inf, "a positive length in m"),
    ):
        if not good:
            raise DataError(argument, getattr(options, argument), accepted)
