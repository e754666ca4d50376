"""Reach poses with an S-R-S arm in closed form: what goes before the search, and mostly makes it needless."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.kinematics.serial_chain import carve_kinematics
from maira_qp.kernels.layout import Outcome, Setting
from maira_qp.kernels.search.levenberg_marquardt import is_reached, pose_cost, squares
from maira_qp.kernels.srs.feasible_configuration import start
from maira_qp.kernels.srs.swivel_intervals import carve_intervals
from maira_qp.kernels.srs.unreachability import POSSIBLE, verdict

TURN = 2.0 * np.pi / 2.0**32


@kernel
def reach_in_closed_form(
    chain, settings, arm, targets, streams, shuffled, floats, integers, pieces, kinematics, q, outcome
):
    """Configurations q (N, 7) that reach `targets` (N, 12), and their outcomes (N, 9) as of `search`.

    What has none is `PROVED` to be out of reach, or left open: then its outcome is no success, and its cost infinite.
    The swivel angles are tried from the same one on, or, if `shuffled`, from one that `streams` (N,) tell. Memory:
    floats and integers of `INTERVALS`, pieces of `verdict`, and that of `KINEMATICS`.
    """
    work = carve_intervals(floats, integers)
    for k in range(len(targets)):
        offset = TURN * np.float64(streams[k] >> np.uint64(32)) if shuffled else 0.0
        outcome[k, Outcome.SUCCESS], outcome[k, Outcome.FINAL_COST], outcome[k, Outcome.LEFT] = 0.0, np.inf, 0.0
        if start(arm, targets[k], offset, work, q[k]):
            confirm(chain, settings, targets[k], kinematics, q[k], outcome[k])
        if outcome[k, Outcome.SUCCESS] == 0.0:
            position, orientation = settings[Setting.POSITION_TOLERANCE], settings[Setting.ORIENTATION_TOLERANCE]
            if verdict(arm, targets[k], position, orientation, work, pieces) != POSSIBLE:
                outcome[k, Outcome.SUCCESS] = Outcome.PROVED


@kernel
def confirm(chain, settings, target, kinematics, q, outcome):
    """Make the outcome (7,) a success if q (7,) reaches the target (12,), else leave it as it is."""
    axes, origins, tool, e = carve_kinematics(len(q), kinematics)
    cost = pose_cost(chain, settings, target, q, axes, origins, tool, e)
    if is_reached(settings, e):
        position, orientation = squares(e)
        outcome[Outcome.SUCCESS], outcome[Outcome.ATTEMPT], outcome[Outcome.SPENT] = 1.0, 0.0, 0.0
        outcome[Outcome.MOVED] = 0.0
        outcome[Outcome.FINAL_COST] = cost
        outcome[Outcome.POSITION_ERROR], outcome[Outcome.ORIENTATION_ERROR] = np.sqrt(position), np.sqrt(orientation)
