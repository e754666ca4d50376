"""When a path counts as followed, by the walk over the URDF, which shares no code with the solvers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maira_qp.evaluation.judge import Judge
from paths.motions import Path

TIMES_THE_MOTION = 3.0
"""A step of a joint may be so many times the largest one of the motion that the path was made from."""


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """What is asked of configurations for the poses of a path; no joint may be outside its limits."""

    position: float = 1e-4
    """Largest position error at a pose [m]."""
    orientation: float = 1e-3
    """Largest orientation error at a pose [rad]."""
    step: float = 0.5
    """Largest step of a joint from pose to pose [rad]; a larger one is a reconfiguration."""
    reconfigurations: int = 0
    """So many reconfigurations are allowed."""

    def of(self, path: Path) -> Criterion:
        """This one, with steps in proportion to those of the motion that a path was made from."""
        if path.motion is None:
            return self
        return replace(self, step=min(self.step, TIMES_THE_MOTION * largest_step(path.motion)))


@dataclass(frozen=True)
class Verdict:
    """What is true of a run along a path."""

    reached: int
    """Poses that are reached within the limits."""
    reconfigurations: int
    """Steps that are too large."""
    whole: bool
    """Whether the path is followed from its first pose to its last."""


def largest_step(q: np.ndarray) -> float:
    """Of any joint from one of the configurations (N, n) to the next [rad]."""
    return float(np.abs(np.diff(q, axis=0)).max(initial=0.0))


def verdict(
    judge: Judge,
    path: Path,
    q: np.ndarray | None,
    criterion: Criterion,
    start: np.ndarray | None = None,
    slack: float = 0.0,
) -> Verdict:
    """Of configurations q (m, n) [rad] for the first m of a path's poses; None: there are none.

    The way from a start (n,) to the first of them is a step too. A joint may be `slack` [rad] outside its limits.
    """
    if q is None or not len(q):
        return Verdict(0, 0, False)
    allowed = criterion.of(path)
    found = judge.verdict(q, path.poses[: len(q)])
    reached = int(np.sum(found.within(allowed.position, allowed.orientation, slack)))
    run = q if start is None else np.vstack([start, q])
    too_large = int((~(np.abs(np.diff(run, axis=0)) <= allowed.step)).any(axis=1).sum())  # NaN is too large
    return Verdict(reached, too_large, reached == len(path.poses) and too_large <= allowed.reconfigurations)
