"""Success rates with their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from maira_qp.apps.plots.style import COLORS, figure, finish, save, styled
from maira_qp.evaluation.settings import NO_BACKEND, OUT_OF_REACH
from maira_qp.evaluation.statistics import Summary, wilson_interval

HATCHES = ("", "//", "\\\\", "..", "xx", "--", "++", "oo", "||")
"""One more than there are colours: no two of many bars look the same."""


@styled
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
        color, hatch = COLORS[i % len(COLORS)], HATCHES[i % len(HATCHES)]
        ax.barh(y, rates, 0.9 * height, color=color, hatch=hatch, edgecolor="white", linewidth=0.0, label=method)
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
    finish(ax)
    ax.grid(False, axis="y")


def success_picture(summaries: Sequence[Summary], path: str | Path) -> None:
    """Strict success rates with their intervals: a block a stratum and a bar a method, or, where backends are compared,
    a block a stratum and method and a bar a backend. What is out of reach is left out if there is anything else."""
    shown = [s for s in summaries if s.stratum != OUT_OF_REACH] or summaries
    several = len({s.backend for s in shown} - {NO_BACKEND}) > 1
    counts: dict[str, dict[str, tuple[int, int]]] = {}
    for s in shown:
        block, bar = (f"{s.stratum}\n{s.method}", s.backend) if several else (s.stratum, s.method)
        counts.setdefault(block, {})[bar] = (s.strict, s.count)
    made = figure(size=(8.0, 1.2 + 0.22 * len(shown)))
    success_bars(made.axes[0], counts)
    save(made, path)
