"""Pictures, a module each: functions that draw plain arrays or answers into an `Axes`, with units on every axis.

All share one style (`style`), which changes nothing outside of them; `figure` makes axes that have it. No function
needs a display. This package alone imports matplotlib: `pip install maira-qp[plot]`.
"""

from maira_qp.apps.plots.chain import animate_chain, draw_chain
from maira_qp.apps.plots.condition import condition_numbers
from maira_qp.apps.plots.convergence import convergence
from maira_qp.apps.plots.joint_paths import joint_paths
from maira_qp.apps.plots.path import joint_rates, path_picture, pose_errors, swivel_arcs
from maira_qp.apps.plots.placement import placements
from maira_qp.apps.plots.reach import map_slice, map_surface, reach_slice
from maira_qp.apps.plots.self_motion import arc_bars, self_motion
from maira_qp.apps.plots.style import COLORS, DASHES, LIMIT_COLOR, MARKERS, figure, finish, line, save, style
from maira_qp.apps.plots.success import success_bars, success_picture
from maira_qp.apps.plots.trade_off import error_against_cost, trade_off

__all__ = [
    "COLORS",
    "DASHES",
    "LIMIT_COLOR",
    "MARKERS",
    "animate_chain",
    "arc_bars",
    "condition_numbers",
    "convergence",
    "draw_chain",
    "error_against_cost",
    "figure",
    "finish",
    "joint_paths",
    "joint_rates",
    "line",
    "map_slice",
    "map_surface",
    "path_picture",
    "placements",
    "pose_errors",
    "reach_slice",
    "save",
    "self_motion",
    "style",
    "success_bars",
    "success_picture",
    "swivel_arcs",
    "trade_off",
]
