"""An S-R-S arm as the array that the kernels of its closed form work on."""

from __future__ import annotations

import numpy as np

from maira_qp.analytic.srs.geometry import SRS, SphericalJoint, rotations
from maira_qp.kernels.layout import Axis, Elbow, Limit, Part, Range, Spherical
from maira_qp.kernels.srs import spherical_joint as joint_row
from maira_qp.robots.model.revolutions import WholeTurns

ROUNDING = 1e-11
"""Half a range [rad] that is less than half a turn by less is half a turn."""


def srs_array(srs: SRS) -> np.ndarray:
    """The arm (3, 80) of `kernels.srs.swivel`: the elbow, the shoulder and the wrist.

    Of a joint with more than a turn it holds the turn around the middle of its limits.
    """
    (lower, upper), turned = WholeTurns(srs.robot, srs.robot.middle).around(0), srs.tip[:3, :3].T
    elbow = _elbow_axes(srs).T
    arm = np.zeros((3, Spherical.WIDTH))
    arm[Part.ELBOW] = _elbow(srs, elbow, lower[3], upper[3])
    arm[Part.SHOULDER] = _spherical(srs.axes[:3], lower[:3], upper[:3], np.eye(3), elbow)
    arm[Part.WRIST] = _spherical(-srs.axes[:3:-1], lower[:3:-1], upper[:3:-1], turned, elbow)
    return arm


def _elbow_axes(srs: SRS) -> np.ndarray:
    """x from the shoulder to the elbow, y, and z along the elbow's axis, as columns (3, 3)."""
    x = (srs.elbow - srs.shoulder) / np.linalg.norm(srs.elbow - srs.shoulder)
    return np.column_stack([x, np.cross(srs.axes[3], x), srs.axes[3]])


def _elbow(srs: SRS, to_elbow: np.ndarray, lower: float, upper: float) -> np.ndarray:
    """The elbow's row from its limits [rad]; to_elbow (3, 3) turns base axes into the elbow's."""
    row = np.zeros(Spherical.WIDTH)
    centre, half = _range(lower, upper)
    lever = srs.tip[:3, :3].T @ (srs.wrist - srs.tip[:3, 3])
    row[Elbow.CENTRE : Elbow.LEVER] = srs.shoulder
    row[Elbow.LEVER : Elbow.REFERENCE] = lever
    row[Elbow.REFERENCE : Elbow.UPPER_ARM] = srs.reference
    row[Elbow.UPPER_ARM] = np.linalg.norm(srs.elbow - srs.shoulder)
    row[Elbow.FOREARM : Elbow.SMALLEST] = to_elbow @ (srs.wrist - srs.elbow)
    row[Elbow.SMALLEST], row[Elbow.LARGEST] = srs.reach
    row[Elbow.COS_PHASE], row[Elbow.SIN_PHASE] = np.cos(srs.phase), np.sin(srs.phase)
    row[Elbow.COS_FROM_MIDDLE], row[Elbow.SIN_FROM_MIDDLE] = _pair(srs.phase - centre)
    row[Elbow.MIDDLE], row[Elbow.COS_HALF], row[Elbow.SIN_HALF] = centre, _cosine(half), np.sin(half)
    row[Elbow.LOWER], row[Elbow.UPPER] = lower, upper
    row[Elbow.LENGTH] = srs.robot.length
    return row


def _spherical(
    axes: np.ndarray, lower: np.ndarray, upper: np.ndarray, first_turn: np.ndarray, last_turn: np.ndarray
) -> np.ndarray:
    """A spherical joint's row from its axes (3, 3) and limits (3,); its two frames turned into axes of their own."""
    row = np.zeros(Spherical.WIDTH)
    a, b, c = axes
    joint = SphericalJoint(a, b, c)
    ranges = [_range(*limits) for limits in zip(lower, upper, strict=True)]
    e, e_last = (_direction_across(b, a, ranges[0][0]), _direction_across(b, c, -ranges[2][0]))
    first, last = np.array([a, e, np.cross(a, e)]), np.array([c, e_last, np.cross(e_last, c)])
    row[Spherical.FIRST_FRAME : Spherical.LAST_FRAME] = (first @ first_turn.T).ravel()
    row[Spherical.LAST_FRAME : Spherical.COS_FIRST] = (last @ last_turn.T).ravel()
    row[Spherical.COS_FIRST], row[Spherical.SIN_FIRST] = a @ b, np.linalg.norm(np.cross(a, b))
    row[Spherical.COS_LAST], row[Spherical.SIN_LAST] = b @ c, np.linalg.norm(np.cross(b, c))
    delta, total = joint.angles
    row[Spherical.NEAREST], row[Spherical.FARTHEST] = abs(delta), np.pi - abs(np.pi - total)
    row[Spherical.COS_PHASE], row[Spherical.SIN_PHASE] = _pair(joint.phase - ranges[1][0])
    for k, (centre, half) in enumerate(ranges):
        at = Spherical.RANGES + k * Range.WIDTH
        row[at : at + Range.WIDTH] = centre, _cosine(half), lower[k], upper[k]
        for side, sign in enumerate((-1, 1)):
            at = Spherical.LIMITS + (2 * k + side) * Limit.WIDTH
            row[at : at + Limit.WIDTH] = _limit(joint, row, k, centre, half, sign)
    return row


def _limit(joint: SphericalJoint, row: np.ndarray, k: int, centre: float, half: float, sign: int) -> tuple:
    """wz, wp, wr, value, sp, sr, s0 of the limit of joint k that is half a range beyond its middle on one side."""
    if k == Axis.MIDDLE:
        from_phase = centre + sign * half - joint.phase
        return 1.0, 0.0, 0.0, joint.constant + joint.amplitude * np.cos(from_phase), 0.0, 0.0, -np.sin(from_phase)
    own, other = Spherical.COS_FIRST, Spherical.COS_LAST
    if k == Axis.LAST:
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
