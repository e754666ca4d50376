"""ssik's own ways to follow a path: branches of the closed form, carried on from pose to pose."""

from __future__ import annotations

from typing import Any

import numpy as np
from peers.arms import Arm

from maira_qp.evaluation.contestant import Contestant


def solve_path(arm: Arm) -> Contestant:
    """All branches along the whole path, of which a user takes one that keeps to the limits with the smallest steps.

    It refuses an arm without a chart of its self-motion.
    """
    manipulator = _manipulator(arm)
    q = arm.configurations(1, np.random.default_rng(0))
    manipulator.solve_path(arm.judge.forward(q), q0=q)  # or it refuses
    middle = 0.5 * (arm.lower + arm.upper)

    def follow(poses: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
        found = manipulator.solve_path(poses, q0=start)
        ranked = []
        for label in found.tracks:
            q = np.unwrap(found.q(label), axis=0)
            if start is None:  # any turn will do, such as the one about mid-range
                q += 2.0 * np.pi * np.round((middle - 0.5 * (q.min(axis=0) + q.max(axis=0))) / (2.0 * np.pi))
            outside = np.maximum(arm.lower - q, q - arm.upper).max()
            largest = np.abs(np.diff(q, axis=0)).max(initial=0.0)
            if len(q) == len(poses) and np.isfinite(q).all():
                ranked.append((outside > 0.0, largest, q))
        return min(ranked, key=lambda each: each[:2])[2] if ranked else None

    return _contestant(manipulator, "ssik solve_path", "all branches, the smoothest inside", follow)


def tracker(arm: Arm) -> Contestant:
    """Its stream of poses: the branch that it is on, or else the solution nearest to where it is.

    Arms whose solve locks a joint take seconds a pose without the built module, which has no stream.
    """
    manipulator = _manipulator(arm)
    if manipulator.solver_name.startswith("jointlock"):
        raise NotImplementedError("its solver locks a joint, and only the built module does so in good time")

    def follow(poses: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
        if start is None:
            answers = manipulator.solve(poses[0], max_solutions=1)
            if not answers:
                return None
            start = answers[0].q
        stream = manipulator.tracker(start)
        return np.array([stream.update(T).q for T in poses])

    return _contestant(manipulator, "ssik tracker", "no jumps, from its first solution", follow)


def _manipulator(arm: Arm) -> Any:
    from ssik import Manipulator

    return Manipulator.from_urdf(arm.path, base=arm.robot.base, ee=arm.robot.tip)


def _contestant(manipulator: Any, name: str, settings: str, follow: Any) -> Contestant:
    return Contestant(name=name, settings=settings, forward=manipulator.fk, follow=follow)
