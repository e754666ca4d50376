"""Pictures: an arm in space, its motion as a GIF, and the figures that compare methods.

Every function draws plain arrays into an `Axes` (or onto disk), with units on every axis. Colours are the eight of
Okabe and Ito, told apart by colour-blind readers; lines also differ in their dashes, so that a grey print can be read.
No function needs a display. This module alone imports matplotlib: `pip install maira-qp[plot]`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter
from PIL import Image

from maira_qp.apps.benchmark.statistics import wilson_interval
from maira_qp.errors import OptionError

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8A8A00")
"""Okabe and Ito, "Color universal design", 2008; their yellow darkened, to be seen on white."""
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)), (0, (3, 3)))
LIMIT_COLOR = "#555555"
GIF_SIZE, GIF_DPI = (4.6, 4.4), 80


def figure(rows: int = 1, columns: int = 1, *, size: tuple[float, float] | None = None, space: bool = False) -> Figure:
    """A figure of rows x columns empty axes (`figure.axes`), each about 5 x 3.6 inches unless `size` says otherwise.

    With `space` the axes are three-dimensional, for `draw_chain`.
    """
    made = Figure(figsize=size or (5.0 * columns, (4.6 if space else 3.6) * rows), layout="constrained")
    FigureCanvasAgg(made)
    made.subplots(rows, columns, subplot_kw={"projection": "3d"} if space else {})
    return made


def save(made: Figure, path: str | Path) -> Path:
    """Write a figure to a file; its kind follows from the name (.png, .svg, .pdf). Missing folders are made."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    made.savefig(path, dpi=150)
    return path


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
    """Write a GIF of an arm: one transforms array (N + 1, 4, 4) and one target, (3,) or (4, 4) [m], a frame.

    `rate` is in frames a second. The tool leaves a trail since the target last changed. The box shown holds every
    frame. Raises `OptionError` if there are no frames, or not as many targets.
    """
    if not len(frames) or len(frames) != len(targets):
        raise OptionError(
            f"an animation needs as many targets as frames, and at least one; got {len(targets)} and {len(frames)}"
        )
    points = [np.asarray(h)[:, :3, 3] for h in frames] + [np.reshape(_point(t), (1, 3)) for t in targets]
    reach = 1.02 * max(_reach(p) for p in points)
    made = figure(size=GIF_SIZE, space=True)
    made.set_layout_engine("none")
    made.set_dpi(GIF_DPI)
    canvas, ax, palette = FigureCanvasAgg(made), made.axes[0], _palette()
    ax.set_position((0.0, 0.07, 0.9, 0.96))  # the layout engine leaves no room for the names of slanted axes
    images, start = [], 0
    for k, (htms, target) in enumerate(zip(frames, targets, strict=True)):
        if k and not np.array_equal(target, targets[k - 1]):
            start = k
        trail = np.array([frames[i][-1][:3, 3] for i in range(start, k + 1)])
        for line in list(ax.lines):
            line.remove()
        draw_chain(ax, htms, target=target, trail=trail, reach=reach)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
        images.append(picture.quantize(palette=palette, dither=Image.Dither.NONE))
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    images[0].save(path, save_all=True, append_images=images[1:], duration=round(1000 / rate), loop=0, optimize=True)
    return path


def _point(target: np.ndarray) -> np.ndarray:
    target = np.asarray(target, dtype=float)
    return target[:3, 3] if target.shape == (4, 4) else target


def _reach(points: np.ndarray) -> float:
    """The least `reach` of `draw_chain` whose box holds the points (K, 3)."""
    x, y, z = points.T
    return float(max(np.abs(x).max(), np.abs(y).max(), z.max() / 1.5, -z.min() / 0.5, 1e-3))


def _palette() -> Image.Image:
    """The few colours of the film, each in steps towards white: a GIF stores them small, and all frames alike."""
    steps = dict.fromkeys(COLORS[:3], 8) | {"black": 40}  # fine greys: no wall may take on a tint
    shades = [np.linspace(to_rgb(color), (1.0, 1.0, 1.0), count) for color, count in steps.items()]
    palette = Image.new("P", (1, 1))
    palette.putpalette((255 * np.concatenate(shades)).round().astype(np.uint8).tobytes())
    return palette


def tradeoff_curve(
    ax: Axes,
    weights: Sequence[float],
    pose_residuals: Sequence[float],
    posture_costs: Sequence[float],
    *,
    strict: tuple[float, float] | None = None,
) -> None:
    """Pose residual (K,) against posture cost (K,) of the weighted method over its weights (K,), both axes as given.

    `strict` is the (residual, cost) of the strict hierarchy, a single point. Residuals of zero are drawn at the left
    edge, 1e-16.
    """
    residuals = np.maximum(np.asarray(pose_residuals, dtype=float), 1e-16)
    ax.plot(residuals, posture_costs, color=COLORS[0], marker="o", label="Weighted, by weight")
    for weight, x, y in zip(weights, residuals, posture_costs, strict=True):
        label = np.format_float_scientific(weight, precision=1, trim="-", exp_digits=1)
        ax.annotate(label, (x, y), xytext=(0, 6), textcoords="offset points", fontsize=7, rotation=60)
    if strict is not None:
        x, y = max(strict[0], 1e-16), strict[1]
        ax.plot([x], [y], color=COLORS[1], linestyle="", marker="*", markersize=14, label="Strict")
    ax.set_xscale("log")
    ax.margins(x=0.08, y=0.14)
    ax.set(xlabel="pose residual [m and rad together]", ylabel="posture cost [rad²]")
    _finish(ax)


def joint_paths(
    ax: Axes, paths: np.ndarray, lower: np.ndarray, upper: np.ndarray, names: Sequence[str], *, step: str = "iteration"
) -> None:
    """Joints (K, n) [rad or m] over the steps of a solve, each in per cent of its range: 0 and 100 % are its limits.

    A joint without limits has the range -pi to pi. `step` names what the horizontal axis counts, with its unit.
    """
    lower = np.where(np.isfinite(lower), lower, -np.pi)
    upper = np.where(np.isfinite(upper), upper, np.pi)
    share = (np.asarray(paths, dtype=float) - lower) / np.where(upper > lower, upper - lower, 1.0)
    for i, name in enumerate(names):
        ax.plot(share[:, i], **_line(i), label=name)
    for limit in (0.0, 1.0):
        ax.axhline(limit, color=LIMIT_COLOR, linewidth=2.5, alpha=0.5, zorder=0)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.set(xlabel=step, ylabel="joint, in its range [%]")
    _finish(ax)


def condition_numbers(ax: Axes, series: Mapping[str, Sequence[float]], *, step: str = "iteration") -> None:
    """Condition number of the Jacobian over the steps of a solve, a line a method; infinite values leave a gap."""
    for i, (name, values) in enumerate(series.items()):
        values = np.asarray(values, dtype=float)
        finite = np.where(np.isfinite(values), values, np.nan)
        ax.plot(finite, **_line(i), label=name)
    ax.set_yscale("log")
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.set(xlabel=step, ylabel="condition number [-]")
    _finish(ax)


def success_bars(ax: Axes, counts: Mapping[str, Mapping[str, tuple[int, int]]]) -> None:
    """Success rates with Wilson's 95 % intervals: `counts[group][method]` is (successes, trials).

    A group is a set of targets, and a block of bars; a method is a colour. A method may be missing from a group.
    """
    methods = list(dict.fromkeys(method for group in counts.values() for method in group))
    height = 0.8 / max(len(methods), 1)
    for i, method in enumerate(methods):
        rows = [row for row, group in enumerate(counts.values()) if method in group]
        y = np.array(rows) + (i - (len(methods) - 1) / 2) * height
        pairs = [group[method] for group in counts.values() if method in group]
        rates = np.array([successes / trials if trials else 0.0 for successes, trials in pairs])
        low, high = np.array([wilson_interval(*pair) for pair in pairs]).T
        hatch = "//" if i >= len(COLORS) else None
        ax.barh(y, rates, 0.9 * height, color=COLORS[i % len(COLORS)], hatch=hatch, label=method)
        ax.errorbar(rates, y, xerr=[rates - low, high - rates], color="black", linestyle="", capsize=3, linewidth=1)
        for place in zip(np.maximum(high, rates), y, rates, strict=True):
            text = f"{100 * place[2]:.4g} %"
            ax.annotate(text, place[:2], (4, 0), textcoords="offset points", va="center", fontsize=8)
    ax.set_yticks(range(len(counts)), list(counts))
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.18)
    ax.set_xticks(np.linspace(0, 1, 6))
    ax.xaxis.set_major_formatter(PercentFormatter(1.0))
    ax.set_xlabel("targets solved, with the 95 % interval [%]")
    _finish(ax)
    ax.grid(False, axis="y")


def _line(i: int) -> dict[str, Any]:
    """Colour and dashes of line i; after eight the colours come again with other dashes."""
    return {"color": COLORS[i % len(COLORS)], "linestyle": DASHES[(i + i // len(COLORS)) % len(DASHES)]}


def _finish(ax: Axes) -> None:
    """What all flat pictures share: a light grid behind the data, no box, a legend beside them."""
    ax.grid(True, color="#DDDDDD", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8)
