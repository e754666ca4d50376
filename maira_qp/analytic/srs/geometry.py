"""Arms with a spherical shoulder, a revolute elbow and a spherical wrist (S-R-S), in closed form.

All vectors are taken at q = 0, in base axes: unit axes a_1 .. a_7, the shoulder S where axes 1-3 meet, the wrist W
where axes 5-7 meet, the tip's pose M. With R_i = exp(q_i a_i) the target T (D = R_T R_M^T, w = T M^-1 W) asks for

    A R_4 B = D,   A = R_1 R_2 R_3,   B = R_5 R_6 R_7        (orientation)
    A v(q_4) = w - S,   v(q_4) = E - S + R_4 (W - E)         (wrist centre; E the point of axis 4 nearest to S)

1. Elbow: |v|^2 = k + rho cos(q_4 - phi) = |w - S|^2 has two solutions, q_4 = phi + sigma theta, sigma = +1 and -1.
2. Swivel: A takes v onto w - S and is free to turn about that line by psi. Psi is 0 where the elbow stands on the side
   of the reference direction: then -sigma a_4 x v, which on a planar elbow points from the line to the elbow, lies
   along the reference's part across the line. On a planar elbow it is the angle of `SwivelTask`; elsewhere it is still
   the angle of the elbow's axis. A = A_0 + A_c cos psi + A_s sin psi, and so B = R_4^T A^T D.
3. Shoulder and wrist: three rotations about axes a, b, c that make R. The angle gamma between a and R c gives the
   middle one by the half-angle formula of spherical trigonometry, which is exact at both ends,

       tan^2(theta/2) = sin((gamma + delta)/2) sin((gamma - delta)/2) / (sin((sum + gamma)/2) sin((sum - gamma)/2)),

   delta and sum being the difference and the sum of the angles between a and b and between b and c; q_b = phi + tau
   theta, tau = +1 and -1. The first follows from a, the last from what is left of R. Perpendicular axes reach every
   rotation; others leave holes, where a branch has no solution.

Sources: Shimizu et al., "Analytical inverse kinematic computation for 7-DOF redundant manipulators with joint limits",
2008; Davenport, "Rotations about nonorthogonal axes", 1973; Paden, "Kinematics and control of robot manipulators",
1986.

Not covered: a wrist centre in the shoulder itself (only an arm of two equal links folds so far), where A may be any
rotation and psi tells apart one circle of them; and exact singularities of shoulder or wrist (R c along a), where the
first and the last joint turn against each other at a single psi: one pair of their angles is given for the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from maira_qp.analytic.joint_axes import screws
from maira_qp.analytic.lines import MEETS_WITHIN, meeting
from maira_qp.orientation import rigid, skew
from maira_qp.robots.model.robot import Robot

PARALLEL_WITHIN = 1e-3
"""Adjacent axes of a spherical joint at a smaller angle [rad] count as parallel."""
REACHED_WITHIN = 1e-13
"""Distances beyond the annulus by at most this, in lengths of the arm, and angles into a hole by at most this [rad] are
rounding: the pose is still reached to that."""
_SMALL = 1e-9
NEARLY_SINGULAR = 1e-6
"""A shoulder or wrist nearer to its singularity [rad] counts as singular: its first and last joint turn so fast that
joint limits cannot be told apart."""


class Branch(NamedTuple):
    """Which of the two solutions each part of the arm takes, +1 or -1."""

    elbow: int
    shoulder: int
    wrist: int


BRANCHES = tuple(Branch(s, t, w) for s in (1, -1) for t in (1, -1) for w in (1, -1))
"""All branches, in the order of every array that has an axis for them."""


def rotations(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) about a unit axis (3,) by angles (...) [rad] (Rodrigues)."""
    K = skew(axis)
    angle = np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(angle) * K + 2 * np.sin(0.5 * angle) ** 2 * (K @ K)


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle (...) [rad] between vectors (3,) and (..., 3), exact at 0 and pi."""
    return np.arctan2(np.linalg.norm(_cross(a, b), axis=-1), b @ a)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b (..., 3) for a (3,) and b (..., 3): in a fraction of the time that `np.cross` takes."""
    return b @ skew(a).T


def _across(axis: np.ndarray) -> np.ndarray:
    """A unit vector (3,) at right angles to a unit axis (3,)."""
    across = skew(axis)[:, np.abs(axis).argmin()]
    return across / np.linalg.norm(across)


@dataclass(frozen=True, eq=False)
class SphericalJoint:
    """Three rotations about the axes a, b, c (3,), adjacent ones not parallel: R = R_a R_b R_c."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray

    @property
    def constant(self) -> float:
        """k_0 of `a . R_b c = k_0 + rho cos(q_b - phi)`."""
        return float((self.a @ self.b) * (self.b @ self.c))

    @property
    def amplitude(self) -> float:
        """rho > 0 of the same."""
        return float(np.linalg.norm(_cross(self.a, self.b)) * np.linalg.norm(_cross(self.b, self.c)))

    @property
    def phase(self) -> float:
        """phi of the same [rad]."""
        return float(np.arctan2(self.a @ _cross(self.b, self.c), self.a @ self.c - self.constant))

    @property
    def angles(self) -> tuple[float, float]:
        """Difference and sum of the angles between a and b and between b and c [rad]."""
        first, last = float(_angle(self.a, self.b)), float(_angle(self.b, self.c))
        return first - last, first + last

    def nearness(self, R: np.ndarray) -> np.ndarray:
        """How far (...) [rad] rotations (..., 3, 3) are from the singularities, where R c is along a."""
        gamma = _angle(self.a, R @ self.c)
        return np.minimum(gamma, np.pi - gamma)

    def decompose(self, R: np.ndarray) -> np.ndarray:
        """Both triples (..., 2, 3) of angles that make the rotations R (..., 3, 3); NaN where axes cannot.

        In (-pi, pi] but the middle one, which is not wrapped. Row 0 has tau = +1.
        """
        from maira_qp.kernels.srs.davenport import davenport_angles  # heavy: Numba comes with it

        q = np.empty((R.size // 9, 2, 3))
        davenport_angles(self._row, np.ascontiguousarray(R).reshape(-1, 3, 3), REACHED_WITHIN, q)
        return q.reshape(*R.shape[:-2], 2, 3)

    @cached_property
    def _row(self) -> np.ndarray:
        """The joint (15,) of `kernels.srs.davenport`."""
        return np.concatenate([self.a, self.b, self.c, _across(self.c), [self.phase, *self.angles]])


@dataclass(frozen=True, eq=False)
class Circle:
    """A rotation that depends on psi, `constant + cosine cos(psi) + sine sin(psi)`, each (3, 3)."""

    constant: np.ndarray
    cosine: np.ndarray
    sine: np.ndarray

    def at(self, psi: np.ndarray) -> np.ndarray:
        """The rotations (..., 3, 3) at psi (...) [rad]."""
        psi = np.asarray(psi)[..., None, None]
        return self.constant + self.cosine * np.cos(psi) + self.sine * np.sin(psi)


@dataclass(frozen=True, eq=False)
class ElbowBranch:
    """What one elbow angle leaves open for a target: the rotations of shoulder and wrist as functions of psi."""

    sign: int
    q4: float
    """[rad]"""
    shoulder: Circle
    """A = R_1 R_2 R_3"""
    wrist: Circle
    """B = R_5 R_6 R_7"""
    target: np.ndarray
    """T (4, 4)"""


@dataclass(frozen=True, eq=False)
class SRS:
    """The geometry of an S-R-S arm, made by `SRS.of`. All vectors in base axes at q = 0."""

    robot: Robot
    axes: np.ndarray
    """Unit axes (7, 3)"""
    shoulder: np.ndarray
    """S (3,) [m]"""
    elbow: np.ndarray
    """The point (3,) [m] of axis 4 that is nearest to the shoulder"""
    wrist: np.ndarray
    """W (3,) [m]"""
    tip: np.ndarray
    """M (4, 4)"""
    reference: np.ndarray
    """Direction (3,) in the base that psi counts from"""
    lower: np.ndarray
    """Lower limits (7,) [rad], -inf for a continuous joint: the robot's, or tighter ones, see `limited`"""
    upper: np.ndarray
    """Upper limits (7,) [rad], inf for a continuous joint"""

    @staticmethod
    def of(robot: Robot, reference: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> SRS | None:
        """The geometry of a robot that is S-R-S to `MEETS_WITHIN`; None for any other, see `SRS.refusal`."""
        found = _geometry(robot, reference)
        return found if isinstance(found, SRS) else None

    @staticmethod
    def refusal(robot: Robot) -> str | None:
        """Why a robot is not S-R-S; None if it is."""
        found = _geometry(robot, (0.0, 0.0, 1.0))
        return found if isinstance(found, str) else None

    def limited(self, lower: np.ndarray, upper: np.ndarray) -> SRS:
        """The same arm with limits (7,) and (7,) [rad] within those of the robot."""
        return replace(self, lower=lower, upper=upper)

    def of_boxed(self, robot: Robot) -> SRS:
        """That of the same arm with tighter limits."""
        return replace(self, robot=robot, lower=robot.lower, upper=robot.upper)

    @cached_property
    def joints(self) -> tuple[SphericalJoint, SphericalJoint]:
        """Shoulder and wrist."""
        return SphericalJoint(*self.axes[:3]), SphericalJoint(*self.axes[4:])

    @property
    def reach(self) -> tuple[float, float]:
        """Smallest and largest distance [m] of shoulder and wrist that the elbow's geometry allows, limits aside."""
        ends = self.phase + np.pi, self.phase
        smallest, largest = (float(np.linalg.norm(self.from_shoulder(q4))) for q4 in ends)
        return smallest, largest

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest distance [m] of shoulder and wrist within the limits of the elbow."""
        low, high = self.robot.drawn_range[0][3], self.robot.drawn_range[1][3]
        if high - low >= 2 * np.pi:
            return self.reach
        turns = np.arange(-8, 9) * np.pi  # to where the arm is stretched or folded
        inner = self.phase + turns
        angles = np.concatenate([[low, high], inner[(inner > low) & (inner < high)]])
        distances = [float(np.linalg.norm(self.from_shoulder(q4))) for q4 in angles]
        return min(distances), max(distances)

    @property
    def phase(self) -> float:
        """phi [rad] of `|v(q_4)|^2 = k + rho cos(q_4 - phi)`: the elbow angle that stretches the arm."""
        u, g = self.elbow - self.shoulder, self.wrist - self.elbow  # u is at right angles to the axis
        return float(np.arctan2(u @ np.cross(self.axes[3], g), u @ g))

    def from_shoulder(self, q4: float) -> np.ndarray:
        """v(q_4): the wrist (3,) [m] from the shoulder, while the shoulder is at zero."""
        return self.elbow - self.shoulder + rotations(self.axes[3], np.array(q4)) @ (self.wrist - self.elbow)

    def wrist_centre(self, T: np.ndarray) -> np.ndarray:
        """Where the wrist (3,) [m] is when the tip is at T (4, 4)."""
        return T[:3, :3] @ (self.tip[:3, :3].T @ (self.wrist - self.tip[:3, 3])) + T[:3, 3]

    def elbow_branches(self, T: np.ndarray) -> list[ElbowBranch]:
        """The branches of the elbow for a pose T (4, 4): two, one where the arm is stretched or folded, or none."""
        line = self.wrist_centre(T) - self.shoulder
        distance = float(np.linalg.norm(line))
        smallest, largest = self.reach
        slack = REACHED_WITHIN * self.robot.length
        if not smallest - slack <= distance <= largest + slack:
            return []
        # tan^2(theta/2) has the distances from the two ends as numerator and denominator
        short = max((largest - distance) * (largest + distance), 0.0)
        long = max((distance - smallest) * (distance + smallest), 0.0)
        theta = float(2 * np.arctan2(np.sqrt(short), np.sqrt(long)))
        signs = (1,) if theta in (0.0, float(2 * np.arctan2(1.0, 0.0))) else (1, -1)
        return [self._elbow_branch(sign, self.phase + sign * theta, line, T) for sign in signs]

    def is_singular(self, T: np.ndarray) -> bool:
        """Whether some solution for a pose T (4, 4), limits aside, is one of those that are not covered, see above."""
        if np.linalg.norm(self.wrist_centre(T) - self.shoulder) < _SMALL * self.robot.length:
            return True
        for elbow in self.elbow_branches(T):
            for joint, circle in zip(self.joints, (elbow.shoulder, elbow.wrist), strict=True):
                apex = np.arctan2(joint.a @ circle.sine @ joint.c, joint.a @ circle.cosine @ joint.c)
                if joint.nearness(circle.at(np.array([apex, apex + np.pi]))).min() < NEARLY_SINGULAR:
                    return True
        return False

    def _elbow_branch(self, sign: int, q4: float, line: np.ndarray, T: np.ndarray) -> ElbowBranch:
        """The branch with this elbow angle for a pose T (4, 4), whose wrist is at `line` (3,) [m] from the shoulder."""
        D = T[:3, :3] @ self.tip[:3, :3].T
        R_4 = rotations(self.axes[3], np.array(q4))
        v = self.from_shoulder(q4)
        body = _frame(v, -sign * np.cross(self.axes[3], v))
        base = _frame(line, self.reference)
        turning = [
            np.outer(base[:, 0], body[:, 0]),
            np.outer(base[:, 1], body[:, 1]) + np.outer(base[:, 2], body[:, 2]),
            np.outer(base[:, 2], body[:, 1]) - np.outer(base[:, 1], body[:, 2]),
        ]
        return ElbowBranch(sign, q4, Circle(*turning), Circle(*(R_4.T @ part.T @ D for part in turning)), T)

    def evaluate(self, branch: ElbowBranch, psi: np.ndarray) -> np.ndarray:
        """Joint angles (N, 4, 7) [rad] at psi (N,), NaN where there are none; the 4 as in `BRANCHES`, limits aside."""
        shoulder, wrist = self.joints
        q = np.empty((len(psi), 2, 2, 7))
        q[..., :3] = shoulder.decompose(branch.shoulder.at(psi))[:, :, None]
        q[..., 3] = branch.q4
        q[..., 4:] = wrist.decompose(branch.wrist.at(psi))[:, None]
        q[np.isnan(q).any(axis=-1)] = np.nan
        return q.reshape(len(psi), 4, 7)

    def configurations(self, T: np.ndarray | pin.SE3, psi: float) -> np.ndarray:
        """All configurations (k, 7) [rad] in (-pi, pi], k <= 8, that put the tip at T (4, 4) with the swivel psi [rad].

        Limits are not looked at. Raises `PoseError`.
        """
        T = checked_pose(T)
        parts = [self.evaluate(branch, np.array([psi]))[0] for branch in self.elbow_branches(T)]
        q = np.concatenate([np.empty((0, 7)), *parts])
        return wrapped(q[~np.isnan(q).any(axis=1)])


def checked_pose(T: np.ndarray | pin.SE3) -> np.ndarray:
    """A pose (4, 4) from a caller. Raises `PoseError`."""
    return rigid(T.homogeneous if isinstance(T, pin.SE3) else T, "target")


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles in (-pi, pi]; those that are there already stay exactly as they are."""
    turned = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    return np.where((angle > -np.pi) & (angle <= np.pi), angle, turned)


def _frame(along: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """A right-handed frame (3, 3): its first column along one vector, its second nearest to `towards`."""
    length = float(np.linalg.norm(along))
    x = along / length if length > 0 else np.array([1.0, 0.0, 0.0])
    y = towards - (x @ towards) * x
    if np.linalg.norm(y) < _SMALL:
        y = _across(x)
    y = y / np.linalg.norm(y)
    y = y - (x @ y) * x  # once more: the first difference may have cancelled
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


@lru_cache(maxsize=16)
def _geometry(robot: Robot, reference: tuple[float, float, float]) -> SRS | str:
    """The geometry of an S-R-S arm, or why it is not one."""
    if robot.n != 7 or not robot.is_chain:
        return "not a chain of 7 joints"
    points, axes = screws(robot)
    if np.isnan(axes).any():
        return "not all joints are revolute"
    for name, first in (("shoulder", 0), ("wrist", 4)):
        sines = np.linalg.norm(np.cross(axes[first : first + 2], axes[first + 1 : first + 3]), axis=1)
        if (sines < PARALLEL_WITHIN).any():
            return f"two adjacent axes of the {name} are parallel"
    (shoulder, off_shoulder), (wrist, off_wrist) = meeting(points[:3], axes[:3]), meeting(points[4:], axes[4:])
    for name, off in (("shoulder, 1 to 3,", off_shoulder), ("wrist, 5 to 7,", off_wrist)):
        if off > MEETS_WITHIN * robot.length:
            return f"the axes of the {name} do not meet: they pass the nearest point at up to {off:.3g} m"
    offsets = [p - points[3] for p in (shoulder, wrist)]
    if min(np.linalg.norm(np.cross(axes[3], offset)) for offset in offsets) < PARALLEL_WITHIN * robot.length:
        return "shoulder or wrist is on the axis of the elbow"
    up = np.array(reference) / np.linalg.norm(reference)
    elbow = points[3] + (axes[3] @ offsets[0]) * axes[3]
    tip = robot.forward(np.zeros(7)).homogeneous
    return SRS(robot, axes, shoulder, elbow, wrist, tip, up, robot.lower, robot.upper)
