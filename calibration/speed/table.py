"""The table on the terminal and in speed.csv."""

import csv
import io
import os
from dataclasses import astuple, fields

import pandas as pd

from calibration.report.render import table_text
from calibration.speed.measure import Row, along_power_law, at_error
from calibration.speed.ways import NO_OVERLAPS

RIVALS = (
    "SciPy loop",
    "diffrax, two events",
    "diffrax, an event",
    "Verlet, JAX",
    "Verlet, numba",
)
HEADINGS = ("way", "setting", "precision", "batch", "µs", "error", "compile s", "MiB", "µs+grad")


def as_csv(rows: list[Row]) -> str:
    """All columns, undefined ones empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(Row)])
    writer.writerows(["" if x is None else x for x in astuple(row)] for row in rows)
    return text.getvalue()


def as_text(rows: list[Row]) -> str:
    table = pd.DataFrame(map(_cells, sorted(rows, key=_place)), columns=HEADINGS)
    return "\n".join([_machine(), "", table_text(table), "", *ratios(rows)])


def _place(row: Row):
    """Each family together, this library's first; the settings as they were measured."""
    energy = row.family in ("energy balance", "closed form")
    return not energy, row.family != "ODE", energy and (row.precision != "float64", row.batch)


def _cells(row: Row) -> tuple[str, ...]:
    def number(x, form):
        return "" if x is None else format(x, form)

    return (
        row.family,
        row.setting,
        row.precision,
        f"{row.batch:,}",
        number(row.microseconds, ".3g"),
        number(row.largest_error, ".0e"),
        number(row.compile_seconds, ".1f"),
        number(row.memory_mib, ".0f"),
        number(row.gradient_microseconds, ".3g"),
    )


def _machine() -> str:
    return f"{os.cpu_count()} cores; time a collision, largest error of ε_p against exact answers"


def ratios(rows: list[Row]) -> list[str]:
    """What the times mean, as ratios within this run."""
    lines = []
    for error in (1e-3, 1e-6):
        own = at_error([r for r in rows if r.batch == 4096], "ODE", error)
        for rival in RIVALS:
            theirs = along_power_law(rows, rival, error)
            if own is not None and theirs is not None:
                lines.append(
                    f"ODE at error {error:.0e}: {theirs / own:.3g} times faster than {rival}"
                )
    lines += _gradient_ratios(rows)
    if any(row.family == "diffrax, two events" for row in rows):
        lines.append("other laws: softjax speed --law viscoelastic, hertz-dashpot, linear or own")
    return lines + _energy_ratio(rows)


def _gradient_ratios(rows: list[Row]) -> list[str]:
    return [
        f"{row.family}, {row.setting}, batch {row.batch:,}: value and gradient (3 parameters) "
        f"{row.gradient_microseconds / row.microseconds:.2g} times the value, "
        f"mean error of the gradient {row.gradient_error:.0e}"
        for row in rows
        if row.gradient_microseconds is not None
    ]


def _energy_ratio(rows: list[Row]) -> list[str]:
    def time_of(family, setting=None):
        same = [r for r in rows if r.family == family and r.batch == 1_000_000]
        return [r.microseconds for r in same if setting in (None, r.setting)]

    theirs = time_of("energy balance, numba")
    return [
        f"energy balance at 1,000,000 velocities, {setting}: {1e3 * own:.3g} ns, "
        f"{theirs[0] / own:.3g} times faster than the same formulas in numba on all cores"
        for setting in ("exact", NO_OVERLAPS)
        for own in time_of("energy balance", setting)
        if theirs
    ]
