"""Pictures that commands save, caught as Matplotlib's figures, and how they look."""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from tests.golden.numbers import same_print
from tests.records import differences, settle

RECORDED = Path(__file__).with_name("recorded.json")
COUNT = re.compile(r"(?<![\d.])(?<!e[-+])\d{1,2}(?![\d.e])")
WIDEST = 6.5  # inches: on a telephone, 420 pixels, letters of 10 points are 9 pixels high
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
    """Its size and title, and lines for each of its axes: place, words, ticks, and all that is drawn."""
    assert figure.get_figwidth() <= WIDEST
    rounded = lambda *numbers: " ".join(f"{x:.4g}" for x in np.hstack([*numbers, []]) + 0.0)  # noqa: E731
    rows = [rounded(figure.get_size_inches()) + f" {figure.get_suptitle()}"]
    for x in (*figure.legends, *(ax.get_legend() for ax in figure.axes)):
        if x:
            (left, up), (width, height) = x.parent.bbox.min, x.parent.bbox.size
            place = x.get_bbox_to_anchor().min - (left, up)
            texts = [text.get_text() for text in x.get_texts()]
            rows.append(f"legend in {x._ncols} at {rounded(place / (width, height))}: {texts}")
    for ax in figure.axes:
        parts = [rounded(ax.get_subplotspec().get_geometry()[:3]), ax.get_title()]
        for axis in (ax.xaxis, ax.yaxis):
            ticks, ends = axis.get_ticklocs(), sorted(axis.get_view_interval())
            words = f"{axis.get_label_text()} {axis.get_scale()} {rounded(ends)} at"
            ticks = ticks[(ticks >= ends[0]) & (ticks <= ends[1])]
            small = axis.get_minor_formatter().format_ticks(axis.get_minorticklocs())
            texts = [*axis.get_major_formatter().format_ticks(ticks), *small]
            if isinstance(axis.get_major_locator(), FixedLocator):  # names, some of equal bars
                texts.sort()
            parts.append(f"{words} {rounded(ticks)} as {' '.join(' '.join(texts).split())}")
        parts.append(rounded([x.get_rotation() for x in ax.get_xticklabels()[:1]]))
        for x in ax.get_lines():
            dashes = rounded(x._unscaled_dash_pattern[0], x._unscaled_dash_pattern[1] or ())
            label = f"{x.get_label()} " * (str(x.get_label())[0] != "_")
            marker = f"{x.get_marker()} {x.get_markersize():g} {to_hex(x.get_markerfacecolor())}"
            look = f"{marker} {to_hex(x.get_color())} {x.get_linewidth():g} {dashes}"
            parts.append(f"{label}{look} through {rounded(*map(ends_and_mean, x.get_data()))}")
        for x in ax.texts:
            place = f"{rounded(x.get_position(), x.get_rotation())} {x.get_ha()} {x.get_va()}"
            parts.append(f"{x.get_text()} {to_hex(x.get_color())} at {place}")
        parts += [rounded(ends_and_mean(x.get_array().ravel()), x.get_clim()) for x in ax.images]
        for x in ax.patches:
            bounds = np.round(x.get_extents().bounds, 6)  # pixels
            parts.append(f"{to_hex(x.get_facecolor())} {rounded(bounds)}")
        for x in ax.collections:
            outline = np.concatenate([path.vertices for path in x.get_paths()] or [[[np.nan] * 2]])
            colours = sorted({to_hex(c) for c in (*x.get_facecolor(), *x.get_edgecolor())})
            parts.append(f"{colours} {rounded(*map(ends_and_mean, outline.T))}")
        rows += [f"{part} |" for part in parts]
    return rows


def ends_and_mean(values) -> np.ndarray:
    """To a thousandth of the largest: what should be 0 is."""
    known = np.ma.masked_invalid(np.asarray(values, float)).compressed()
    if not known.size:
        return known
    largest = np.max(np.abs(known)) or 1.0
    return np.round([*known[[0, -1]], known.mean()], 3 - int(np.log10(largest)))


def words(text: str) -> list[str]:
    """Its paragraphs, but for what differs from run to run: places, dates, versions, seconds."""
    text = re.sub(r"/\S*/", "…/", text.partition("\nWritten to")[0])
    text = re.sub(r"\S+\s+evaluations?,\s+\S+\s+s", "@", text)
    blocks = [" ".join(block.split()) for block in text.split("\n\n")]
    return [block for block in blocks if block and not re.match(r"\d{4}-\d\d-\d\d; ", block)]


def same(old: str, new: str) -> bool:
    """Whether texts agree to one unit of the last digit of each number, and in their counts."""
    counts = COUNT.findall(old), COUNT.findall(new)
    return same_print(old, new) and (counts[0] == counts[1] or len(counts[0]) != len(counts[1]))


def as_recorded(name: str, shown: Mapping[str, Figure | str], exactly: bool = False) -> None:
    """Pictures and texts by the names of their files as `recorded.json` has them, but for the last digits
    of numbers, unless `exactly`."""
    __tracebackhide__ = True
    found = {file: words(x) if isinstance(x, str) else looks(x) for file, x in shown.items()}
    kept = json.loads(RECORDED.read_text(encoding="utf-8")).get(name, {})
    lines = []
    for file in {**kept, **found}:
        old, new = (x.get(file, []) for x in (kept, found))
        differ = differences(old, new, str.__eq__ if exactly else same)
        lines += [f"{file}:", *differ] if differ or (file in kept) != (file in found) else []

    def update(text: str) -> str:
        table = json.loads(text) | {name: found}
        return json.dumps(table, indent=1, sort_keys=True, ensure_ascii=False) + "\n"

    settle(RECORDED, name, lines, update)
