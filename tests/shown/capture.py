"""Pictures that commands save, caught as Matplotlib's figures, and how they look."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

RECORDED = Path(__file__).with_name("looks.json")
PNG = b"\x89PNG\r\n\x1a\n"


@contextmanager
def drawn() -> Iterator[dict[str, Figure]]:
    """{file name: figure} of all pictures saved meanwhile; the files are empty pictures."""
    figures: dict[str, Figure] = {}

    def save(figure, path, **_):
        figures[Path(path).name] = figure
        Path(path).write_bytes(PNG)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save)
        # laid out where a test asks
        patch.setattr(Figure, "get_layout_engine", lambda figure: None)
        yield figures


def line(ax, label: str) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the only line of this label."""
    (match,) = [candidate for candidate in ax.get_lines() if candidate.get_label() == label]
    return np.asarray(match.get_xdata(), float), np.asarray(match.get_ydata(), float)


def panels(figure, deep: int = 2) -> list[list]:
    """Axes of a grid by panel, each of `deep` rows, in the order in which they are read."""
    of: dict[tuple[int, int], list] = {}
    for ax in figure.axes:
        place = ax.get_subplotspec()
        of.setdefault((place.rowspan.start // deep, place.colspan.start), []).append(ax)
    return [of[place] for place in sorted(of)]


def labels(ax) -> list[str]:
    return ax.get_legend_handles_labels()[1]


def legend(figure_or_ax) -> list[str]:
    """Texts of the only legend."""
    of = getattr(figure_or_ax, "legends", None) or [figure_or_ax.get_legend()]
    (drawn_legend,) = of
    return [text.get_text() for text in drawn_legend.get_texts()]


def band(ax, label: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities and both edges of a filled band."""
    (area,) = [candidate for candidate in ax.collections if candidate.get_label() == label]
    x, y = area.get_paths()[0].vertices.T
    fine = np.unique(x)
    edges = [np.sort(y[x == place])[[0, -1]] for place in fine]
    return fine, *np.transpose(edges)


def bars(container, which: int = 0) -> np.ndarray:
    """Ends of error bars: across (0) or up (-1)."""
    return np.array(container[2][which].get_segments())


def looks(figure: Figure) -> list[str]:
    """Its size, and a line for each of its axes: place, ticks, lines, and where texts stand."""
    rounded = lambda *numbers: " ".join(f"{x:.4g}" for x in np.hstack(numbers))  # noqa: E731
    rows = [rounded(figure.get_size_inches())]
    for ax in figure.axes:
        parts = [rounded(ax.get_subplotspec().get_geometry()[:3])]
        for axis in (ax.xaxis, ax.yaxis):
            ticks, ends = axis.get_ticklocs(), sorted(axis.get_view_interval())
            parts.append(rounded(ticks[(ticks >= ends[0]) & (ticks <= ends[1])]))
        for x in ax.get_lines():
            dashes = rounded(x._unscaled_dash_pattern[1] or ())
            parts.append(f"{x.get_marker()} {to_hex(x.get_color())} {x.get_linewidth():g} {dashes}")
        parts += [f"{rounded(x.get_position(), x.get_rotation())} {x.get_ha()}" for x in ax.texts]
        parts.append(rounded([x.get_rotation() for x in ax.get_xticklabels()[:1]]))
        parts.append(rounded([x.get_alpha() or 1 for x in ax.collections]))
        rows.append(" | ".join(parts))
    return rows


def looks_as_recorded(name: str, figures: dict[str, Figure]) -> None:
    """As `looks.json` has it; SOFTJAX_LOOKS=1 records it."""
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))
    found = {file: looks(figure) for file, figure in figures.items()}
    if "SOFTJAX_LOOKS" in os.environ:
        text = json.dumps(recorded | {name: found}, indent=1, sort_keys=True)
        RECORDED.write_text(f"{text}\n", encoding="utf-8")
    else:
        assert found == recorded[name]
