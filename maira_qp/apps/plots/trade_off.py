"""What the pose gives up for the posture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from maira_qp.apps.plots.style import COLORS, LIMIT_COLOR, MARKERS, finish, styled

LEAST = 1e-16
"""Errors below this are drawn here."""


@styled
def trade_off(
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
    residuals = np.maximum(np.asarray(pose_residuals, dtype=float), LEAST)
    ax.plot(residuals, posture_costs, color=COLORS[0], marker="o", label="Weighted, by weight")
    for weight, x, y in zip(weights, residuals, posture_costs, strict=True):
        label = np.format_float_scientific(weight, precision=1, trim="-", exp_digits=1)
        ax.annotate(label, (x, y), xytext=(0, 6), textcoords="offset points", fontsize=8, rotation=60)
    if strict is not None:
        x, y = max(strict[0], LEAST), strict[1]
        ax.plot([x], [y], color=COLORS[1], linestyle="", marker="*", markersize=14, label="Strict")
    ax.set_xscale("log")
    ax.margins(x=0.08, y=0.16)
    ax.set(xlabel="pose residual, [m] and [rad] together", ylabel="posture cost [rad²]")
    finish(ax)


@styled
def error_against_cost(
    ax: Axes, points: Mapping[str, tuple[Sequence[float], Sequence[float]]], *, tolerance: float
) -> None:
    """Position errors (N,) [m] against posture costs (N,) [rad^2] of many answers, a colour and marker a method.

    `tolerance` [m] is drawn as a dashed line.
    """
    for i, (name, (errors, costs)) in enumerate(points.items()):
        ax.plot(
            np.maximum(errors, LEAST),
            costs,
            linestyle="",
            marker=MARKERS[i % len(MARKERS)],
            markersize=4,
            alpha=0.6,
            color=COLORS[i % len(COLORS)],
            label=name,
        )
    ax.axvline(tolerance, color=LIMIT_COLOR, linewidth=1, linestyle="--")
    ax.set_xscale("log")
    ax.set(xlabel="position error [m] (dashed: the tolerance)", ylabel="posture cost [rad²]")
    finish(ax)
