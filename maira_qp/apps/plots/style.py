"""One style for all pictures: to be read in print, in grey, and by the colour-blind.

Colours are the eight of Okabe and Ito; lines also differ in their dashes and points in their markers, so that a grey
print can be read. The style is on only inside `style()`, and in the functions of this package.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib
from cycler import cycler
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from maira_qp.io.atomic_write import replacing

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8A8A00")
"""Okabe and Ito, "Color universal design", 2008; their yellow darkened, to be seen on white."""
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)), (0, (3, 3)))
MARKERS = "osD^vPXd"
LIMIT_COLOR = "#555555"
"""Of limits and tolerances, which are drawn beside the data."""
DPI = 150

_SETTINGS: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.labelsize": 10,
    "axes.prop_cycle": cycler(color=COLORS, linestyle=DASHES),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "lines.linewidth": 1.8,
    "hatch.linewidth": 0.8,
    "pdf.fonttype": 42,
}


def style() -> AbstractContextManager[None]:
    """The style, for axes and artists that are made inside the block, or in a function that this decorates."""
    return matplotlib.rc_context(_SETTINGS)


styled: Any = style()
"""Decorates a function that draws: its artists have the style."""


@styled
def figure(
    rows: int = 1,
    columns: int = 1,
    *,
    size: tuple[float, float] | None = None,
    space: bool = False,
    heights: tuple[float, ...] | None = None,
) -> Figure:
    """A figure of rows x columns empty axes (`figure.axes`), each about 5 x 3.6 inches unless `size` says otherwise.

    With `space` the axes are three-dimensional, for `draw_chain`. `heights` are the shares of the rows.
    """
    made = Figure(figsize=size or (5.0 * columns, (4.6 if space else 3.6) * rows), layout="constrained")
    FigureCanvasAgg(made)
    made.subplots(rows, columns, subplot_kw={"projection": "3d"} if space else {}, height_ratios=heights)
    return made


@styled
def save(made: Figure, path: str | Path, *, dpi: float = DPI) -> Path:
    """Write a figure to a file, whole or not at all; its kind follows from the name (.png, .svg, .pdf).

    Missing folders are made. `dpi` is dots per inch. Raises `OSError`.
    """
    path = Path(path)
    with replacing(path) as file:
        made.savefig(file, format=path.suffix.lower().removeprefix(".") or None, dpi=dpi)
    return path


def line(i: int) -> dict[str, Any]:
    """Colour and dashes of line i; after eight the colours come again with other dashes."""
    return {"color": COLORS[i % len(COLORS)], "linestyle": DASHES[(i + i // len(COLORS)) % len(DASHES)]}


def finish(ax: Axes, handles: Sequence[Artist] | None = None) -> None:
    """What all flat pictures share, on axes from anywhere: a light grid behind the data, no box, a legend beside it.

    `handles` are the entries of the legend; None: what has a label.
    """
    ax.grid(True, color=_SETTINGS["grid.color"], linewidth=_SETTINGS["grid.linewidth"])
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0))
