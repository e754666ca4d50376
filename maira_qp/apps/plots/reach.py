"""Where a tool can be: on a plane, of one orientation or of a map of many; and the surfaces of a map."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, LightSource, ListedColormap
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from maira_qp.apps.plots.style import COLORS, finish, styled
from maira_qp.results.status import Status

REACHED, UNREACHABLE, OPEN = 0, 1, 2
FILLS = (COLORS[0], "#E3E3E3", COLORS[4])
"""Dark, light and between: told apart in grey too."""
NAMES = ("reached", "proved unreachable", "open: neither")


@styled
def reach_slice(ax: Axes, x: np.ndarray, y: np.ndarray, status: np.ndarray, *, axes: str = "xz") -> None:
    """The plane of positions x (K,) by y (L,) [m], a cell a target, by the status (L, K) that the solver gave it.

    Reached, proved unreachable, or open: a nearest point or a spent budget proves nothing. `status` is as in
    `solve_batch`, `axes` the names of the plane's two axes.
    """
    verdict = verdicts(status)
    ax.pcolormesh(
        x, y, verdict, cmap=ListedColormap(FILLS), norm=BoundaryNorm([-0.5, 0.5, 1.5, 2.5], 3), rasterized=True
    )
    ax.set_aspect("equal")
    ax.set(xlabel=f"{axes[0]} [m]", ylabel=f"{axes[1]} [m]")
    shares = [float(np.mean(verdict == kind)) for kind in range(3)]
    handles = [
        Patch(facecolor=fill, edgecolor="#888888", label=f"{name} ({100 * share:.1f} %)")
        for fill, name, share in zip(FILLS, NAMES, shares, strict=True)
    ]
    finish(ax, handles)
    ax.grid(False)


@styled
def map_slice(
    ax: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, *, axes: str = "xz", label: str = "reachable"
) -> None:
    """The plane of cells x (K,) by y (L,) [m] of a map by a quantity (L, K), with a scale; cells with NaN are white.

    `map_slice(ax, cut.x, cut.y, cut.values)` draws what `ReachMap.slice` gives. `axes` are the names of the plane's two
    axes, `label` what the scale says.
    """
    drawn = ax.pcolormesh(x, y, np.ma.masked_invalid(values), cmap="cividis", rasterized=True)
    ax.set_aspect("equal")
    ax.set(xlabel=f"{axes[0]} [m]", ylabel=f"{axes[1]} [m]")
    ax.figure.colorbar(drawn, ax=ax, label=label.replace("_", " "))
    ax.grid(False)


@styled
def map_surface(ax: Any, vertices: np.ndarray, faces: np.ndarray) -> None:
    """A surface of triangles, vertices (V, 3) [m] and faces (F, 3), in axes of three dimensions.

    `map_surface(figure(space=True).axes[0], *reach.surface("reachable", 0.5))` draws what `ReachMap.surface` gives.
    """
    drawn = Poly3DCollection(
        vertices[faces], facecolors=COLORS[0], shade=True, lightsource=LightSource(azdeg=165, altdeg=45)
    )
    ax.add_collection3d(drawn)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    ax.set_box_aspect(np.maximum(high - low, 1e-9))


def verdicts(status: np.ndarray) -> np.ndarray:
    """REACHED, UNREACHABLE or OPEN for each status (...)."""
    kinds = np.full(max(Status) + 1, OPEN)
    kinds[Status.CONVERGED], kinds[Status.UNREACHABLE] = REACHED, UNREACHABLE
    return kinds[np.asarray(status)]
