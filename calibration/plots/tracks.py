"""Tracks z(t): which frames were taken for which flight, and where impacts were found."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calibration.plots import style

FINE = 120  # points of a flight
HEIGHT = 2.6  # inches of a panel
FEW = 200  # frames that are drawn as circles
ROOM = 0.2  # below the floor, for ε, in heights of the rest


def track_figure(tracks: Sequence[Any], names: Sequence[str]) -> Figure | None:
    """Heights of the frames with the fitted flights, the impacts with their ε, and what is not used.

    Args:
        tracks: `calibration.data.tracks.BounceTrack`s.
        names: one for each.

    Returns:
        One panel a track; None without any.
    """
    if not tracks:
        return None
    figure, panels = style.panels(len(tracks), HEIGHT, "tracks")
    for (ax,), track, name in zip(panels, tracks, names, strict=False):
        _draw(ax, track)
        ax.set_title(style.plain(style.shortened(name)), fontsize="small")
        ax.set_xlabel("time $t$ [s]")
        ax.set_ylabel("height $z$ [m]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize="small")
    return figure


def _draw(ax: Any, track: Any) -> None:
    """One track."""
    time, metre = track.track.time, track.metre
    is_few = len(time) <= FEW
    look: dict[str, Any] = {"ms": 2.5 if is_few else 1.5, "mew": 0.5 if is_few else 0.0}
    used = np.zeros(len(time), bool)
    used[np.concatenate([flight.rows for flight in track.flights])] = True
    heights = metre * track.track.height
    for rows, color, label in (
        (used, style.BLACK, "frames of flights"),
        (~used, style.ORANGE, "frames not used"),
    ):
        if np.any(rows):
            marker = {"marker": "o", "mfc": "white" if is_few else color}
            ax.plot(time[rows], heights[rows], ls="", color=color, label=label, **marker, **look)
    ends = {c.flight: c.time for c in track.crossings}
    for k, flight in enumerate(track.flights):
        first, last = time[flight.rows[[0, -1]]]
        t = np.linspace(min(first, ends.get(k - 1, first)), max(last, ends.get(k, last)), FINE)
        ax.plot(
            t,
            metre * flight.state(t)[0],
            color=style.BLUE,
            lw=0.9,
            zorder=3,
            label="fitted flights" if k == 0 else None,
        )
    times = [crossing.time for crossing in track.crossings]
    floor = [metre * crossing.height for crossing in track.crossings]
    ax.plot(times, floor, "^", ms=5, color=style.VERMILION, zorder=4, label="impacts, with ε")
    for t, z, restitution in zip(times, floor, track.restitution, strict=True):
        ax.annotate(
            f"{restitution:.3f}",
            (t, z),
            (0, -6),
            textcoords="offset points",
            ha="center",
            va="top",
            rotation=90,
            fontsize="x-small",
            color=style.VERMILION,
        )
    for begin, end, _ in track.without:
        ax.axvspan(begin, end, color=style.GREY, alpha=0.15, lw=0)
    low, high = ax.get_ylim()
    ax.set_ylim(low - ROOM * (high - low), high)
