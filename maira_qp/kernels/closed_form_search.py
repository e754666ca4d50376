"""Reach poses with an S-R-S arm in closed form: what goes before the search, and mostly makes it needless."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.blocked import make_work
from maira_qp.kernels.closed_form import start
from maira_qp.kernels.compilation import bare_kernel
from maira_qp.kernels.descent import (
    ORIENTATION_TOLERANCE,
    POSITION_TOLERANCE,
    is_reached,
    pose_cost,
    squares,
)
from maira_qp.kernels.search import (
    ATTEMPT,
    FINAL_COST,
    MOVED,
    ORIENTATION_ERROR,
    POSITION_ERROR,
    PROVED,
    SPENT,
    SUCCESS,
)
from maira_qp.kernels.swivel import CENTRE, ELBOW, LEVER
from maira_qp.kernels.verdict import POSSIBLE, SWIVEL_BLOCKED, verdict

TURN = 2.0 * np.pi / 2.0**32


@bare_kernel
def reach_in_closed_form(
    chain, settings, arm, span, targets, streams, shuffled, floats, integers, pieces, kinematics, q, outcome
):
    """Configurations q (N, 7) that reach `targets` (N, 12), and their outcomes (N, 7) as of `search`.

    What has none is `PROVED` to be out of reach, or left open: then its outcome is no success. A target whose wrist is
    too far from the shoulder or too near is moved to the nearest distance within the `span` (2,) [m] that the elbow's
    limits allow: a q that reaches it there is a good start toward a nearest point, and its cost is finite. The swivel
    angles are tried from the same one on, or, if `shuffled`, from one that `streams` (N,) tell. Memory: floats and
    integers of `make_work`, pieces of `verdict`, kinematics (n + n + 10, 3).
    """
    n, work = q.shape[1], make_work(floats, integers)
    axes, origins, rest = kinematics[:n], kinematics[n : 2 * n], kinematics[2 * n :].reshape(30)
    tool, e, moved = rest[:12], rest[12:18], rest[18:]
    for k in range(len(targets)):
        offset = TURN * np.float64(streams[k] >> np.uint64(32)) if shuffled else 0.0
        outcome[k, SUCCESS], outcome[k, FINAL_COST] = 0.0, np.inf
        if start(arm, targets[k], offset, work, q[k]):
            cost = pose_cost(chain, settings, targets[k], q[k], axes, origins, tool, e)
            if is_reached(settings, e):
                position, orientation = squares(e)
                outcome[k, SUCCESS], outcome[k, ATTEMPT], outcome[k, SPENT], outcome[k, MOVED] = 1.0, 0.0, 0.0, 0.0
                outcome[k, FINAL_COST] = cost
                outcome[k, POSITION_ERROR], outcome[k, ORIENTATION_ERROR] = np.sqrt(position), np.sqrt(orientation)
        if outcome[k, SUCCESS] == 0.0:
            position, orientation = settings[POSITION_TOLERANCE], settings[ORIENTATION_TOLERANCE]
            why = verdict(arm, targets[k], position, orientation, work, pieces)
            if why != POSSIBLE:
                outcome[k, SUCCESS] = PROVED
            if POSSIBLE < why < SWIVEL_BLOCKED:
                _move_within(arm, span, targets[k], moved)
                if start(arm, moved, offset, work, q[k]):
                    outcome[k, FINAL_COST] = pose_cost(chain, settings, targets[k], q[k], axes, origins, tool, e)


@bare_kernel
def _move_within(arm, span, target, moved):
    """A target (12,) moved along the line from the shoulder to its wrist, to a distance within the span (2,) [m]."""
    x, y, z = arm[ELBOW, LEVER], arm[ELBOW, LEVER + 1], arm[ELBOW, LEVER + 2]
    square = 0.0
    for i in range(3):
        moved[i] = (
            target[3 * i] * x + target[3 * i + 1] * y + target[3 * i + 2] * z + target[9 + i] - arm[ELBOW, CENTRE + i]
        )
        square += moved[i] * moved[i]
    distance = np.sqrt(square)
    share = min(max(distance, span[0]), span[1]) / distance - 1.0 if distance > 0.0 else 0.0
    for i in range(3):
        moved[9 + i] = target[9 + i] + share * moved[i]
    for i in range(9):
        moved[i] = target[i]
