"""An arm in space, and its motion as a film."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.ticker import MaxNLocator

from maira_qp.apps.plots.film import check_ffmpeg, write_gif, write_mp4
from maira_qp.apps.plots.style import COLORS, LIMIT_COLOR, figure, styled
from maira_qp.errors import OptionError
from maira_qp.io.atomic_write import replacing

GIF_SIZE, GIF_DPI = (4.6, 4.4), 80


@styled
def draw_chain(
    ax: Any,
    htms: np.ndarray,
    *,
    target: np.ndarray | None = None,
    trail: np.ndarray | None = None,
    label: str | None = None,
    index: int = 0,
    reach: float | None = None,
) -> None:
    """Draw an arm in three dimensions from the transforms (N + 1, 4, 4) [m] of its frames, the base first.

    `target` is a point (3,) or a pose (4, 4) [m], `trail` the way (K, 3) [m] that the tool has come, `index` picks the
    colour, `reach` [m] fixes the box shown about the base (None: fitted to what is drawn). The tool's axes x, y, z are
    short lines in vermilion, green and blue.
    """
    origins = np.asarray(htms, dtype=float)[:, :3, 3]
    size = 0.12 * (reach or max(np.ptp(origins, axis=0).max(), 1e-3))
    color = COLORS[index % len(COLORS)]
    ax.plot(*origins.T, color=color, linewidth=4, solid_capstyle="round", label=label)
    ax.plot(*origins.T, linestyle="", marker="o", color="white", markeredgecolor=color, markersize=6)
    ax.plot(*origins[:1].T, linestyle="", marker="s", color=LIMIT_COLOR, markersize=9)
    if trail is not None:
        ax.plot(*np.asarray(trail, dtype=float).T, color=color, linewidth=1)
    if target is not None:
        target = np.asarray(target, dtype=float)
        point = target[:3, 3] if target.shape == (4, 4) else target
        ax.plot(*point[:, None], linestyle="", marker="*", color=COLORS[1], markeredgecolor="black", markersize=14)
        if target.shape == (4, 4):
            _draw_axes(ax, target, size)
    _draw_axes(ax, np.asarray(htms[-1]), size)
    _frame_space(ax, reach)


def _draw_axes(ax: Any, T: np.ndarray, size: float) -> None:
    for column, color in enumerate((COLORS[1], COLORS[2], COLORS[0])):
        ends = np.stack([T[:3, 3], T[:3, 3] + size * T[:3, column]])
        ax.plot(*ends.T, color=color, linewidth=2)


def _frame_space(ax: Any, reach: float | None) -> None:
    """Equal scales on the three axes, their names, few ticks."""
    if reach is None:
        drawn = np.concatenate([line.get_data_3d() for line in ax.lines], axis=1)
        low, high = drawn.min(axis=1), drawn.max(axis=1)
        middle, half = (low + high) / 2, 0.52 * (high - low).max()
        ax.set(**{f"{axis}lim": (m - half, m + half) for axis, m in zip("xyz", middle, strict=True)})
    else:
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-0.5 * reach, 1.5 * reach))
    ax.set_box_aspect((1, 1, 1), zoom=0.92)  # room for the names of the axes
    for axis, name in zip((ax.set_xlabel, ax.set_ylabel, ax.set_zlabel), "xyz", strict=True):
        axis(f"{name} [m]", labelpad=8)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_major_locator(MaxNLocator(4))


def animate_chain(
    path: str | Path, frames: Sequence[np.ndarray], targets: Sequence[np.ndarray], *, rate: float = 15.0
) -> Path:
    """Write a film of an arm, .mp4 or else a GIF.

    Each frame is an array of transforms (N + 1, 4, 4) and has a target, (3,) or (4, 4) [m].

    `rate` is in frames a second. The tool leaves a trail since the target last changed. The box shown holds every
    frame. An MP4 needs ffmpeg. Raises `OptionError` if there are no frames, or not as many targets, or no ffmpeg.
    """
    if not len(frames) or len(frames) != len(targets):
        raise OptionError(
            f"an animation needs as many targets as frames, and at least one; got {len(targets)} and {len(frames)}"
        )
    if Path(path).suffix.lower() == ".mp4":
        check_ffmpeg()
    points = [np.asarray(h)[:, :3, 3] for h in frames] + [np.reshape(_point(t), (1, 3)) for t in targets]
    reach = 1.02 * max(_reach(p) for p in points)
    made = figure(size=GIF_SIZE, space=True)
    made.set_layout_engine("none")
    made.set_dpi(GIF_DPI)
    canvas, ax = FigureCanvasAgg(made), made.axes[0]
    ax.set_position((0.0, 0.07, 0.9, 0.96))  # the layout engine leaves no room for the names of slanted axes

    def pictures() -> Iterator[np.ndarray]:
        """Each frame (height, width, 3), drawn."""
        start = 0
        for k, (htms, target) in enumerate(zip(frames, targets, strict=True)):
            if k and not np.array_equal(target, targets[k - 1]):
                start = k
            trail = np.array([frames[i][-1][:3, 3] for i in range(start, k + 1)])
            for line in list(ax.lines):
                line.remove()
            draw_chain(ax, htms, target=target, trail=trail, reach=reach)
            canvas.draw()
            yield np.asarray(canvas.buffer_rgba())[..., :3].copy()

    path = Path(path)
    with replacing(path) as file:
        (write_mp4 if path.suffix.lower() == ".mp4" else write_gif)(file, pictures(), rate)
    return path


def _point(target: np.ndarray) -> np.ndarray:
    target = np.asarray(target, dtype=float)
    return target[:3, 3] if target.shape == (4, 4) else target


def _reach(points: np.ndarray) -> float:
    """The least `reach` of `draw_chain` whose box holds the points (K, 3)."""
    x, y, z = points.T
    return float(max(np.abs(x).max(), np.abs(y).max(), z.max() / 1.5, -z.min() / 0.5, 1e-3))
