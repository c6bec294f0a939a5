"""Speed against error: the routes of this library and their baselines.

Every method computes ε_p of the same collisions: each route of the law, `scipy.integrate.solve_ivp` in a
Python loop. Exact values come from 40-digit arithmetic,
rounded to 20 digits by tests/oracles/write.py, so that no method is compared with itself.
"""

import json
import os
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj

TITLE = "stainless steel, v from 1.5 to 250 critical velocities"
BATCH, LARGE, FEW = 4096, 1_000_000, 16  # impacts; the last for the slow loops in Python
EXACT = "exact", "exact, no overlaps"  # the second: ε, ε_p and status alone
REPEATS, SHORTEST, LONGEST = 9, 0.2, 0.5  # timings; least and largest total time [s]
LEAST = 1e-30  # smallest overlap under a root
ENDS = 20.0  # longer than any contact, in reduced units
SCIPY, DIFFRAX = "SciPy loop", "diffrax, events"
FAMILIES = ("energy balance", "ODE", DIFFRAX, SCIPY)
COLUMNS = {  # of a row: its column of the table
    "family": ("method", "{}"),
    "setting": ("setting", "{}"),
    "batch": ("batch", "{:,}"),
    "microseconds": ("µs", "{:.3g}"),
    "largest_error": ("error", "{:.0e}"),
    "compile_seconds": ("compile s", "{:.1f}"),
    "gradient_microseconds": ("µs+grad", "{:.3g}"),
    "gradient_error": ("grad error", "{:.0e}"),
}
Row = dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """Impacts of Zhou's law at velocities [m/s], with exact ε_p and θ ∂ε_p/∂θ for θ = χ̃, E, Y.

    These three move all three numbers of the reduced collision: y = v/v_cr, d and X = χ̃ E/Y.
    """

    inputs: dict[str, Any]
    velocity: np.ndarray
    exact: np.ndarray
    slopes: np.ndarray

    @property
    def theta(self) -> tuple[float, ...]:
        return tuple(float(self.inputs[name]) for name in ("chi", "E", "Y"))

    def law_of(self, chi, youngs_modulus, yield_strength) -> sj.Zhou:
        x = self.inputs
        leaves = youngs_modulus, x["R"], x["M"], yield_strength, x["v_lim"]
        contact = sj.Contact(*leaves, area=x["area"])
        return sj.Zhou(contact, chi, x["sigma"], x["psi"], form=x["form"], kappa=x["kappa"])

    def reduced(self, theta, velocity) -> tuple[Any, Any, Any]:
        law = self.law_of(*theta)
        y = velocity / law.contact.critical_velocity
        return y, law.plasticity(), law.chi * law.contact.yield_ratio


@dataclass(frozen=True)
class Method:
    """One method to compute ε_p, and its batch: one row of the table.

    `gradient(velocity)` returns Σ ε_p and θ ∂(Σ ε_p)/∂θ for the three parameters.
    """

    family: str
    setting: str
    batch: int
    value: Callable[[np.ndarray], Any]
    gradient: Callable | None = None


def stainless_steel() -> Scene:
    """Two spheres of Table 1's stainless steel, v from 1.5 to 250 critical velocities."""
    path = Path(__file__).with_name("speed.json")
    stored = json.loads(path.read_text(encoding="utf-8"))["zhou"]
    velocity, exact, *slopes = np.array(stored["rows"], float).T
    return Scene(stored["inputs"], velocity, exact, np.array(slopes))


def methods(scene: Scene, quick: bool) -> Iterator[Callable[[], Method]]:
    """Functions that build the methods to measure, the largest batches last.

    Some machines give all their cores only after seconds of work.
    """
    for rtol in (1e-6,) if quick else (1e-4, 1e-6, 1e-8):
        yield partial(scipy_loop, scene, rtol)
        with_gradient = rtol == 1e-6 and not quick
        yield partial(by_route, scene, sj.TimeODE(rtol=rtol), BATCH, gradient=with_gradient)
    steps = (sj.ODE(solver=solver, steps=n) for solver, n in (("dopri5", 1), ("dopri8", 2)))
    more = () if quick else (sj.ODE(rtol=1e-8), *steps, sj.ODE(rtol=1e-12))
    for route in (sj.ODE(solver="dopri5", steps=2), sj.EnergyBalance(), *more):
        with_gradient = not quick or isinstance(route, sj.EnergyBalance)
        yield partial(by_route, scene, route, BATCH, gradient=with_gradient)
    if not quick:
        yield partial(by_route, scene, sj.EnergyBalance(), LARGE, gradient=True)
    yield partial(by_route, scene, sj.EnergyBalance(), LARGE, overlaps=False)


def by_route(
    scene: Scene, route: Any, batch: int, gradient: bool = False, overlaps: bool = True
) -> Method:
    """A route as a user calls it without `jit`: all fields of the result, not only ε_p."""
    law, family, setting = scene.law_of(*scene.theta), route.name, EXACT[not overlaps]
    if isinstance(route, sj.TimeODE):
        family, setting = DIFFRAX, f"tsit5, rtol {route.tolerance:.0e}"
    if isinstance(route, sj.ODE):
        steps = f"{route.steps} step{'s' * (route.steps > 1)}" if route.steps else ""
        family = "ODE"
        setting = f"{route.solver}, {steps or f'rtol {route.tolerance:.0e}'}"

    def coefficient(theta, velocity):
        return sj.restitution(scene.law_of(*theta), velocity, route).plastic_coefficient

    def value(velocity):
        return sj.restitution(law, velocity, route, overlaps=overlaps).plastic_coefficient

    slopes = _with_gradient(scene, coefficient) if gradient else None
    return Method(family, setting, batch, value, slopes)


def _phases(d: float, steepness: float) -> Any:
    """Loading, which ends with its velocity, and unloading, which ends with its force; in reduced units.

    Of either the derivative of the state y (overlap, velocity), and what falls through 0 at its end, both
    as functions of time, state and the largest overlap.
    """

    def loading(x, peak):  # Eq. (8) in units of first yield
        q = max(x, 1.0)
        return 1.25 * (x * max(x, LEAST) ** 0.5 + d * (q * q - 1) * (1 - q**0.5))

    def unloading(x, peak):  # Eq. (12)
        hertz = (1 - d * peak) * x + d
        line = 1 - steepness * (1 - x / peak)
        return 1.25 * (hertz * max(x, LEAST) ** 0.5 + d * (peak * peak - 1) * line)

    def phase(force, end):
        def field(t, y, peak):
            return y[1], -force(y[0], peak)

        def ended(t, y, peak):
            return end(y[1], force(y[0], peak))

        ended.terminal, ended.direction = True, -1  # type: ignore[attr-defined]  # for SciPy
        return field, ended

    return phase(loading, lambda u, p: u), phase(unloading, lambda u, p: p)


def scipy_loop(scene: Scene, rtol: float) -> Method:
    """`solve_ivp` by DOP853 in a Python loop, with events."""
    from scipy.integrate import solve_ivp

    def rebound(y: float, phases: Any) -> float:
        state = (0.0, y)
        how: Any = {"method": "DOP853", "rtol": rtol, "atol": rtol * np.array([y**0.8, y])}
        for field, ended in phases:
            found = solve_ivp(field, (0.0, ENDS), state, events=ended, args=(state[0],), **how)
            state = found.y_events[0][0]
        return -state[1] / y

    def value(velocity):
        y, d, steepness = map(np.asarray, scene.reduced(scene.theta, velocity))
        phases = _phases(float(d), float(steepness))
        return np.array([rebound(each, phases) for each in y.tolist()])

    return Method(SCIPY, f"DOP853, rtol {rtol:.0e}", FEW, value)


def _with_gradient(scene: Scene, coefficient: Callable) -> Callable:
    """Σ ε_p of `coefficient(theta, velocity)` and its gradient in ln θ, by reverse mode."""

    @jax.jit
    def value_and_gradient(theta, velocity):
        total = lambda theta: jnp.sum(coefficient(theta, velocity))  # noqa: E731
        value, slopes = jax.value_and_grad(total)(theta)
        return value, jnp.stack(theta) * jnp.stack(slopes)

    return lambda velocity: value_and_gradient(scene.theta, velocity)


def measure(method: Method, scene: Scene) -> Row:
    """Time a method on the velocities of a scene, repeated to fill its batch; compare with exact values.

    Microseconds are the median after a warm-up; `compile_seconds` the first call less a later one;
    `gradient_error` is of θ ∂ε_p/∂θ in the mean of the batch.
    """
    velocity, exact = (np.resize(x, method.batch) for x in (scene.velocity, scene.exact))
    value, each, compiling = _timed(method.value, velocity)
    row: Row = {name: getattr(method, name) for name in ("family", "setting", "batch")}
    row |= {"microseconds": each, "largest_error": float(np.max(np.abs(np.asarray(value) - exact)))}
    row |= {"compile_seconds": compiling, "gradient_microseconds": None, "gradient_error": None}
    if method.gradient is not None:
        (_, slopes), row["gradient_microseconds"], _ = _timed(method.gradient, velocity)
        expected = [np.mean(np.resize(slope, method.batch)) for slope in scene.slopes]
        row["gradient_error"] = float(np.max(np.abs(np.asarray(slopes) / method.batch - expected)))
    return row


def _timed(function: Callable, velocity: np.ndarray) -> tuple[Any, float, float]:
    """Result of a function, the median of its µs a velocity, and how many s longer its first call took."""
    seconds: list[float] = []
    while sum(seconds[1:]) < (LONGEST if len(seconds) <= REPEATS else SHORTEST):
        start = time.perf_counter()
        result = jax.block_until_ready(function(velocity))
        seconds.append(time.perf_counter() - start)
    later = statistics.median(seconds[1:])
    return result, 1e6 * later / len(velocity), max(seconds[0] - later, 0.0)


def as_text(rows: list[Row]) -> str:
    """The table, sorted by family."""
    import pandas as pd

    from calibration.report.layout import table_text

    cells = [
        {head: "" if row[n] is None else form.format(row[n]) for n, (head, form) in COLUMNS.items()}
        for row in sorted(rows, key=lambda row: FAMILIES.index(row["family"]))
    ]
    head = f"{os.cpu_count()} cores; time per collision, largest error of ε_p against exact values"
    return "\n".join([head, "", table_text(pd.DataFrame(cells))])


def draw(rows: list[Row], ax: Any = None) -> Any:
    """Plot time per collision against the largest error, both logarithmic; one marker for each setting.

    Large batches have a label: the number of impacts, and what is omitted.
    """
    from calibration.plots import style

    ax = style.axes_or_new(ax, 5.5)
    # a colour and a marker each: distinct without colour too
    colours = (style.GREEN, style.BLUE, style.SKY, style.VERMILION)
    for family, colour, marker in zip(FAMILIES, colours, "*os^", strict=True):
        some = [row for row in rows if row["family"] == family]
        points = [(max(row["largest_error"], 1e-17), row["microseconds"]) for row in some]
        if some:
            ax.plot(*np.transpose(points), marker, color=colour, markersize=8, label=family)
        for row, point in zip(some, points, strict=True):
            omitted = row["setting"].removeprefix(EXACT[0]) if row["setting"] in EXACT else ""
            note = f"{row['batch']:,} impacts{omitted}" if row["batch"] > BATCH else ""
            offset = (8, -9 if omitted else 0)  # times with and without may be close
            ax.annotate(note, point, offset, textcoords="offset points", fontsize="small")
    ax.set(xscale="log", yscale="log", title=f"Speed against error\n{TITLE}")
    ax.set_xlabel(r"largest error of $\varepsilon_p$ [-]")
    ax.set_ylabel("time per collision [µs]")
    ax.grid(which="major", alpha=0.3)
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14), "frameon": False, "ncols": 4}
    head = f"{BATCH:,} impacts at once ({SCIPY}: {FEW}) where no number is given"
    ax.legend(title=head, **place)
    return ax
