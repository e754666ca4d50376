"""maira_qp as a user calls it: a whole path at once, and the two local methods beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from peers.arms import Arm
from peers.ours import one_at_a_time

import maira_qp as mq
from maira_qp.evaluation.contestant import Contestant
from paths.judging import Criterion
from paths.local import greedy, stepwise

TRACK = "maira_qp track"
"""The name of the row that all others are compared with."""


def followers(arm: Arm, criterion: Criterion) -> list[Contestant]:
    """`Solver.track`; `Solver.solve` from pose to pose; `Solver.step` from pose to pose."""
    solver, single = mq.Solver(arm.robot), one_at_a_time(arm)[0]
    rules = {"max_step": criterion.step, "max_reconfigurations": criterion.reconfigurations}

    def follow(poses: np.ndarray, start: np.ndarray | None) -> np.ndarray:
        return solver.track(poses, start, **rules).q

    track = replace(single, name=TRACK, settings="default options", follow=follow)
    return [track, greedy(single), stepwise(single, arm)]
