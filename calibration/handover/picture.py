"""An export drawn: ε wanted and given, and their difference within the tolerance."""

from matplotlib.figure import Figure

from calibration.handover.exported import Export
from calibration.plots import style


def draw_export(made: Export) -> Figure:
    """ε over v above, what is too much of it below."""
    figure = style.new_figure(6.0, 5.5)
    curve, errors = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    velocity, wanted = made.wanted.velocity, made.wanted.restitution
    given, step = made.choice.impacts.coefficient, made.choice.steps
    label = f"{made.to}: {made.choice.label}"
    curve.plot(
        velocity, wanted, color=style.BLACK, label=f"wanted, {style.plain(made.wanted.name)}"
    )
    curve.plot(velocity, given, color=style.BLUE, linestyle="--", label=label)
    curve.set(ylabel=r"restitution $\varepsilon$")
    band = {"color": style.BLUE, "alpha": 0.25, "linewidth": 0, "label": "time step"}
    off = given - wanted
    errors.fill_between(velocity, off - step.error, off + step.error, **band)
    errors.plot(velocity, off, color=style.BLUE, linestyle="--")
    for sign in (-1, 1):
        tolerance = {
            "color": style.GREY,
            "linestyle": ":",
            "label": "tolerance" if sign > 0 else None,
        }
        errors.axhline(sign * made.order.tolerance, **tolerance)
    errors.set(xlabel="impact velocity $v$ [m/s]", ylabel=r"given $-$ wanted")
    if style.spans_decades(velocity):
        style.logarithmic_x(errors)
    style.legend_below(figure, [curve, errors], 2)  # inside it would lie on a line
    return figure
