"""The race as a picture, a row an arm: how much is solved within which time, and how the times are spread."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, PercentFormatter

from maira_qp.apps import plots
from peers.results import Outcome, Row

SPAN = (1e-6, 0.2)
"""Times shown [s]."""
BINS = np.geomspace(*SPAN, 107)
OURS = {"maira_qp solve": "-", "maira_qp strict": (0, (4, 1.5)), "maira_qp batch": "-", "maira_qp batch x2": "-"}
"""Our rows and their dashes; all are of the first colour, and their lines are thick."""


@plots.style()
def draw(outcomes: Sequence[Outcome], path: str | Path) -> Path:
    """Draw all arms into a file."""
    made = plots.figure(len(outcomes), 2, size=(11.0, 0.5 + 3.5 * len(outcomes)))
    styles = _styles([row for outcome in outcomes for row in outcome.anywhere])
    for k, outcome in enumerate(outcomes):
        rows = sorted(outcome.anywhere, key=lambda row: row.mean)
        left, right = made.axes[2 * k : 2 * k + 2]
        _budget(left, rows, styles)
        _spread(right, rows, styles)
        left.set_title(f"{outcome.arm}: solved within a time budget")
        right.set_title(f"{outcome.arm}: time of a solve")
    return plots.save(made, path)


def _styles(rows: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """A colour and dashes for each solver, the same for all arms."""
    peers = list(dict.fromkeys(row.name for row in rows if row.name not in OURS))
    styles: dict[str, dict[str, Any]] = {
        name: {"color": plots.COLORS[0], "linestyle": dashes, "linewidth": 2.6} for name, dashes in OURS.items()
    }
    colors = plots.COLORS[1:]
    for i, name in enumerate(peers):
        dashes = plots.DASHES[(i + 4 * (i // len(colors))) % len(plots.DASHES)]  # a colour comes again with others
        styles[name] = {"color": colors[i % len(colors)], "linestyle": dashes, "linewidth": 1.4}
    return styles


def _budget(ax: Axes, rows: Sequence[Row], styles: dict[str, dict[str, Any]]) -> None:
    """The share of targets that are solved, rightly, within t."""
    for row in rows:
        if row.individual:
            times = np.sort(row.seconds[row.solved])
            share = np.arange(1, len(times) + 1) / len(row.seconds)
            ends = np.append(share, share[-1:])  # what is solved stays solved
            order = 10 if row.name in OURS else 2
            ax.step(
                [*times, SPAN[1]][: len(ends)], ends, where="post", zorder=order, label=row.name, **styles[row.name]
            )
    ax.set_ylim(0.0, 1.03)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.set_ylabel("targets solved within that time [%]")
    _finish(ax)


def _spread(ax: Axes, rows: Sequence[Row], styles: dict[str, dict[str, Any]]) -> None:
    """A histogram a solver, the fastest on top, each as high as its row; a diamond marks the mean.

    Beside each name is the line that stands for it in the other picture.
    """
    beside = ax.get_yaxis_transform()
    for y, row in enumerate(reversed(rows)):
        color = styles[row.name]["color"]
        ax.axhline(y, color="#BBBBBB", linewidth=0.6, zorder=0)
        if row.individual:
            counts, _ = np.histogram(np.clip(row.seconds, *SPAN), BINS)
            heights = np.where(counts, y + 0.8 * counts / counts.max(), np.nan)
            ax.stairs(heights, BINS, baseline=y, fill=True, color=color, alpha=0.4)
            ax.stairs(heights, BINS, baseline=y, color=color, linewidth=0.8)
            ax.plot([-0.08, -0.02], [y + 0.25] * 2, transform=beside, clip_on=False, **styles[row.name])
        ax.plot([row.mean], [y + 0.16], marker="D", markersize=5, color=color, markeredgecolor="black")
        ax.text(1.02, y + 0.25, _duration(row.mean), transform=beside, va="center", fontsize=8)
    ax.text(1.02, len(rows) + 0.1, "mean", transform=beside, fontsize=8)
    ax.set_yticks(np.arange(len(rows)) + 0.25, [row.name for row in reversed(rows)], fontsize=8)
    ax.tick_params(axis="y", length=0, pad=30)
    for label in ax.get_yticklabels():
        label.set_fontweight("bold" if label.get_text() in OURS else "normal")
    ax.set_ylim(-0.1, len(rows))
    _finish(ax)
    ax.grid(False, axis="y")


def _finish(ax: Axes) -> None:
    """What both kinds share: a logarithmic axis of times with units."""
    ax.set_xscale("log")
    ax.set_xlim(*SPAN)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: _duration(seconds).replace(".0 ", " ")))
    ax.set_xlabel("time of a solve (logarithmic)")


def _duration(seconds: float) -> str:
    """Two digits or more, in µs, ms or s."""
    unit, scale = next((pair for pair in (("s", 1.0), ("ms", 1e-3)) if seconds >= 0.9995 * pair[1]), ("µs", 1e-6))
    value = seconds / scale
    return f"{value:.0f} {unit}" if value >= 9.95 else f"{value:.1f} {unit}"
