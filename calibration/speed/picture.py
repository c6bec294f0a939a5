"""Time a collision against the largest error, both logarithmic."""

from matplotlib.axes import Axes

from calibration.plots import style
from calibration.speed.measure import Row

# a colour and a marker each: told apart without colour too
STYLES = {
    "energy balance": (style.GREEN, "*"),
    "closed form": (style.GREEN, "*"),
    "ODE": (style.BLUE, "o"),
    "diffrax, two events": (style.SKY, "s"),
    "diffrax, an event": (style.SKY, "s"),
    "SciPy loop": (style.VERMILION, "^"),
    "Verlet, JAX": (style.PURPLE, "v"),
    "Verlet, numba": (style.ORANGE, "D"),
    "energy balance, numba": (style.BLACK, "P"),
}

SCENES = {
    None: "stainless steel, v from 1.5 to 250 critical velocities",
    "own": "a law of one's own in SI, v from 0.01 to 10 m/s",
}


def draw_speed(rows: list[Row], ax: Axes | None = None, law: str | None = None) -> Axes:
    """One marker a setting; filled for float64, hollow for float32. `law`: None is Zhou's."""
    ax = style.axes_or_new(ax, 9.0, 5.5)
    for family, (colour, marker) in STYLES.items():
        _draw_family(ax, [r for r in rows if r.family == family], family, colour, marker)
    ax.set(xscale="log", yscale="log")
    ax.set_xlabel("largest error of the plastic coefficient of restitution [-]")
    ax.set_ylabel("time a collision [µs]")
    ax.set_title(f"Speed against error: {SCENES.get(law, law)}")
    ax.grid(which="major", alpha=0.3)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return ax


def _draw_family(ax, rows, family, colour, marker):
    large = [r for r in rows if r.batch >= 16]
    for precision, face in (("float64", colour), ("float32", "none")):
        some = [r for r in large if r.precision == precision]
        if not some:
            continue
        label = family if precision == "float64" else f"{family}, float32"
        ax.plot(
            [max(r.largest_error, 1e-17) for r in some],
            [r.microseconds for r in some],
            linestyle="none",
            marker=marker,
            markersize=8,
            color=colour,
            markerfacecolor=face,
            label=label,
        )
