"""Proofs that an S-R-S arm cannot reach a pose, as data that can be checked without the code that found them.

The proof of `kernels.srs.unreachability`: shoulder and wrist are too far apart or too near to each other; or on each of
the eight branches, intervals of the swivel angle cover the circle, and in each of them one joint is outside its limits
wherever the branch has a solution. To check that, take psi from an interval, and look at the joint in
`SRS.evaluate(elbow, psi)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
import pinocchio as pin

from maira_qp.analytic.srs.arrays import srs_array
from maira_qp.analytic.srs.geometry import BRANCHES, SRS, Branch, checked_pose
from maira_qp.kernels.layout import Arc
from maira_qp.kernels.srs import swivel_intervals as blocked
from maira_qp.kernels.srs import unreachability as verdict
from maira_qp.wording import Quantity, Wording, joined

Limit = Literal["lower", "upper", "no solution"]
_LIMITS: tuple[Limit, ...] = ("lower", "upper", "no solution")


class Reason(IntEnum):
    """Why a pose cannot be reached."""

    TOO_FAR = verdict.TOO_FAR
    """The wrist would be farther from the shoulder than the stretched arm reaches."""
    TOO_NEAR = verdict.TOO_NEAR
    """The wrist would be nearer to the shoulder than the folded arm reaches."""
    ELBOW = verdict.ELBOW_OUTSIDE
    """Both elbow angles that have the wrist at its distance are outside the limits."""
    SWIVEL = verdict.SWIVEL_BLOCKED
    """At every swivel angle and on every branch, some joint is outside its limits or its axes cannot make the turn."""


@dataclass(frozen=True)
class Blocked:
    """Swivel angles at which one joint rules out a branch."""

    lower: float
    """[rad]"""
    upper: float
    """[rad]"""
    joint: int
    """Its place in the chain, from 0; the middle one of shoulder or wrist where the axes have no solution"""
    limit: Limit
    """The limit that it is nearer to in the middle of the interval; "no solution": holes of axes not at right angles"""


@dataclass(frozen=True)
class BlockedBranch:
    """One branch, and what rules it out."""

    branch: Branch
    q4: float
    """Angle of the elbow [rad], up to whole turns"""
    intervals: tuple[Blocked, ...]
    """They cover [-pi, pi], each from the end of the one before; an elbow outside its limits is one interval"""


@dataclass(frozen=True, eq=False)
class SwivelProof:
    """That neither a pose nor any other within the tolerances of it can be reached."""

    reason: Reason
    shoulder: np.ndarray
    """Centre of the shoulder (3,) [m]"""
    wrist: np.ndarray
    """Where the pose has the centre of the wrist (3,) [m]"""
    distance: float
    """of these two [m]"""
    reach: tuple[float, float]
    """The smallest and largest such distance [m] for any angle of the elbow"""
    branches: tuple[BlockedBranch, ...]
    """All eight, in the order of `BRANCHES`; none where the pose is too far or too near"""
    joint_names: tuple[str, ...]

    @property
    def words(self) -> Wording:
        """For people."""
        near, far = self.reach
        if self.reason in (Reason.TOO_FAR, Reason.TOO_NEAR):
            side, bound = ("at most", far) if self.reason is Reason.TOO_FAR else ("at least", near)
            away, most = (Quantity(value, "m", f"{value:.4g} m") for value in (self.distance, bound))
            return Wording("the wrist would be ", away, " from the shoulder, where the arm spans ", side, " ", most)
        if self.reason is Reason.ELBOW:
            angles = sorted({float(branch.q4) for branch in self.branches})
            degrees = [f"{np.degrees(q4):.4g}{' degrees' * (q4 == angles[-1])}" for q4 in angles]
            bends = joined(" or ", [Quantity(q4, "rad", text) for q4, text in zip(angles, degrees, strict=True)])
            return Wording(f"the elbow, {self.joint_names[3]}, would have to be at ", bends, ", outside its limits")
        names = [f"{self.joint_names[joint]} {limit}" for joint, limit in self.limits]
        return Wording(f"wherever the elbow swivels to, a joint is beyond its limits: {', '.join(names)}")

    @property
    def limits(self) -> tuple[tuple[int, Limit], ...]:
        """The joints and limits that stand in the way, each once, in the order of the joints."""
        return tuple(sorted({(each.joint, each.limit) for one in self.branches for each in one.intervals}))


def swivel_proof(
    srs: SRS, T: np.ndarray | pin.SE3, *, position_tolerance: float, orientation_tolerance: float
) -> SwivelProof | None:
    """The proof that no pose within the tolerances [m, rad] of T (4, 4) can be reached; None where there is none.

    Raises `PoseError`.
    """
    T = checked_pose(T)
    row = np.concatenate([T[:3, :3].ravel(), T[:3, 3]])[None]
    pieces, codes = np.empty((len(BRANCHES), blocked.PIECES, 3)), np.empty(1, np.int64)
    memory = blocked.INTERVALS.empty()
    verdict.verdicts(srs_array(srs), row, position_tolerance, orientation_tolerance, *memory, pieces, codes)
    code = int(codes[0])
    if code == verdict.POSSIBLE:
        return None
    wrist, branches = srs.wrist_centre(T), ()
    if code in (Reason.ELBOW, Reason.SWIVEL):
        angles = {elbow.sign: elbow.q4 for elbow in srs.elbow_branches(T)}
        branches = tuple(
            BlockedBranch(branch, angles[branch.elbow], tuple(_intervals(rows)))
            for branch, rows in zip(BRANCHES, pieces, strict=True)
        )
    distance = float(np.linalg.norm(wrist - srs.shoulder))
    return SwivelProof(Reason(code), srs.shoulder, wrist, distance, srs.reach, branches, srs.robot.joint_names)


def _intervals(rows: np.ndarray) -> list[Blocked]:
    """The intervals of one branch from what the kernel wrote, of which the first to end at pi or beyond is the last."""
    last = int(np.argmax(rows[:, Arc.UPPER] >= np.pi))
    return [
        Blocked(float(lower), min(float(upper), np.pi), int(reason) // 3, _LIMITS[int(reason) % 3])
        for lower, upper, reason in rows[: last + 1]
    ]
