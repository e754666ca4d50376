"""Where an arm may stand: the share of tool poses that it reaches from each place of the floor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from maira_qp.apps.plots.style import COLORS, styled

if TYPE_CHECKING:
    from maira_qp.scale.placement.placements import Placements


@styled
def placements(ax: Axes, found: Placements) -> None:
    """Draw the floor by the largest share expected at each x and y, the tool poses, and the ranked bases.

    `found` is what `mq.scale.place` returns. An arrow points along the x axis of its base; a star is the best one.
    """
    x, y = found.axes[0], found.axes[1]
    step = min((float(np.diff(axis).min()) for axis in (x, y) if len(axis) > 1), default=0.1)
    edges = [np.append(axis - step / 2, axis[-1] + step / 2) for axis in (x, y)]
    drawn = ax.pcolormesh(*edges, found.floor.T, cmap="cividis", vmin=0.0, vmax=1.0, rasterized=True)
    ax.figure.colorbar(drawn, ax=ax, label="share of the poses expected to be reached")
    ax.plot(*found.poses[:, :2, 3].T, linestyle="", marker="x", color=COLORS[1], label="tool poses")
    values = np.array([each.values for each in found])
    c, s = np.cos(values[:, 3]), np.sin(values[:, 3])
    ax.quiver(values[:, 0], values[:, 1], c, s, color="white", edgecolor="black", linewidth=0.6, zorder=3)
    ax.plot(
        *values[0, :2], linestyle="", marker="*", color="white", markeredgecolor="black", markersize=14, label="best"
    )
    ax.set_aspect("equal")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    ax.grid(False)
