"""An S-R-S arm as the array that the kernels of its closed form work on."""

from __future__ import annotations

import numpy as np

from maira_qp.analytic.srs.geometry import SRS, SphericalJoint, rotations
from maira_qp.kernels.srs import spherical_joint as joint_row
from maira_qp.kernels.srs import swivel as elbow_row
from maira_qp.robots.model.revolutions import WholeTurns

ROUNDING = 1e-11
"""Half a range [rad] that is less than half a turn by less is half a turn."""


def srs_array(srs: SRS) -> np.ndarray:
    """The arm (3, 80) of `kernels.srs.swivel`: the elbow, the shoulder and the wrist.

    Of a joint with more than a turn it holds the turn around the middle of its limits.
    """
    (lower, upper), turned = WholeTurns(srs.robot, srs.robot.middle).around(0), srs.tip[:3, :3].T
    elbow = _elbow_axes(srs).T
    arm = np.zeros((3, joint_row.ROW))
    arm[elbow_row.ELBOW] = _elbow(srs, elbow, lower[3], upper[3])
    arm[elbow_row.SHOULDER] = _spherical(srs.axes[:3], lower[:3], upper[:3], np.eye(3), elbow)
    arm[elbow_row.WRIST] = _spherical(-srs.axes[:3:-1], lower[:3:-1], upper[:3:-1], turned, elbow)
    return arm


def _elbow_axes(srs: SRS) -> np.ndarray:
    """x from the shoulder to the elbow, y, and z along the elbow's axis, as columns (3, 3)."""
    x = (srs.elbow - srs.shoulder) / np.linalg.norm(srs.elbow - srs.shoulder)
    return np.column_stack([x, np.cross(srs.axes[3], x), srs.axes[3]])


def _elbow(srs: SRS, to_elbow: np.ndarray, lower: float, upper: float) -> np.ndarray:
    """The elbow's row from its limits [rad]; to_elbow (3, 3) turns base axes into the elbow's."""
    row = np.zeros(joint_row.ROW)
    centre, half = _range(lower, upper)
    lever = srs.tip[:3, :3].T @ (srs.wrist - srs.tip[:3, 3])
    row[elbow_row.CENTRE : elbow_row.LEVER] = srs.shoulder
    row[elbow_row.LEVER : elbow_row.REFERENCE] = lever
    row[elbow_row.REFERENCE : elbow_row.UPPER_ARM] = srs.reference
    row[elbow_row.UPPER_ARM] = np.linalg.norm(srs.elbow - srs.shoulder)
    row[elbow_row.FOREARM : elbow_row.SMALLEST] = to_elbow @ (srs.wrist - srs.elbow)
    row[elbow_row.SMALLEST], row[elbow_row.LARGEST] = srs.reach
    row[elbow_row.COS_PHASE], row[elbow_row.SIN_PHASE] = np.cos(srs.phase), np.sin(srs.phase)
    row[elbow_row.COS_FROM_MIDDLE], row[elbow_row.SIN_FROM_MIDDLE] = _pair(srs.phase - centre)
    row[elbow_row.MIDDLE], row[elbow_row.COS_HALF], row[elbow_row.SIN_HALF] = centre, _cosine(half), np.sin(half)
    row[elbow_row.LOWER], row[elbow_row.UPPER] = lower, upper
    row[elbow_row.LENGTH] = srs.robot.length
    return row


def _spherical(
    axes: np.ndarray, lower: np.ndarray, upper: np.ndarray, first_turn: np.ndarray, last_turn: np.ndarray
) -> np.ndarray:
    """A spherical joint's row from its axes (3, 3) and limits (3,); its two frames turned into axes of their own."""
    row = np.zeros(joint_row.ROW)
    a, b, c = axes
    joint = SphericalJoint(a, b, c)
    ranges = [_range(*limits) for limits in zip(lower, upper, strict=True)]
    e, e_last = (_direction_across(b, a, ranges[0][0]), _direction_across(b, c, -ranges[2][0]))
    first, last = np.array([a, e, np.cross(a, e)]), np.array([c, e_last, np.cross(e_last, c)])
    row[joint_row.FIRST_FRAME : joint_row.LAST_FRAME] = (first @ first_turn.T).ravel()
    row[joint_row.LAST_FRAME : joint_row.COS_FIRST] = (last @ last_turn.T).ravel()
    row[joint_row.COS_FIRST], row[joint_row.SIN_FIRST] = a @ b, np.linalg.norm(np.cross(a, b))
    row[joint_row.COS_LAST], row[joint_row.SIN_LAST] = b @ c, np.linalg.norm(np.cross(b, c))
    delta, total = joint.angles
    row[joint_row.NEAREST], row[joint_row.FARTHEST] = abs(delta), np.pi - abs(np.pi - total)
    row[joint_row.COS_PHASE], row[joint_row.SIN_PHASE] = _pair(joint.phase - ranges[1][0])
    for k, (centre, half) in enumerate(ranges):
        at = joint_row.RANGES + k * joint_row.RANGE
        row[at : at + joint_row.RANGE] = centre, _cosine(half), lower[k], upper[k]
        for side, sign in enumerate((-1, 1)):
            at = joint_row.LIMITS + (2 * k + side) * joint_row.LIMIT
            row[at : at + joint_row.LIMIT] = _limit(joint, row, k, centre, half, sign)
    return row


def _limit(joint: SphericalJoint, row: np.ndarray, k: int, centre: float, half: float, sign: int) -> tuple:
    """wz, wp, wr, value, sp, sr, s0 of the limit of joint k that is half a range beyond its middle on one side."""
    if k == joint_row.MIDDLE:
        from_phase = centre + sign * half - joint.phase
        return 1.0, 0.0, 0.0, joint.constant + joint.amplitude * np.cos(from_phase), 0.0, 0.0, -np.sin(from_phase)
    own, other = joint_row.COS_FIRST, joint_row.COS_LAST
    if k == joint_row.LAST:
        own, other = other, own
    cosine, sine = _pair(sign * half)
    return row[own], row[own + 1] * cosine, row[own + 1] * sine, row[other], -sine, cosine, 0.0


def _range(lower: float, upper: float) -> tuple[float, float]:
    """Middle and half of a range [rad], of at most a turn but for rounding; a continuous joint's is one around 0."""
    if not np.isfinite(lower):
        return 0.0, np.pi
    half = 0.5 * upper - 0.5 * lower
    return 0.5 * lower + 0.5 * upper, np.pi if half > np.pi - ROUNDING else half


def _cosine(half: float) -> float:
    return float(np.cos(half)) if half < np.pi else joint_row.UNLIMITED


def _pair(angle: float) -> tuple[float, float]:
    return float(np.cos(angle)), float(np.sin(angle))


def _direction_across(b: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """The unit vector (3,) nearest to b across a unit axis, turned about that by an angle [rad]."""
    across = b - (axis @ b) * axis
    return rotations(axis, np.array(angle)) @ (across / np.linalg.norm(across))
