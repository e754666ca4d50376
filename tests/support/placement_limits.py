"""Limits of where a frame is, about a pose that keeps them, and what they mean by NumPy alone."""

import numpy as np

import maira_qp as mq

OFFSET = np.array([0.03, 0.05, 0.1])


def limits_about(T, frame: str) -> dict[str, mq.Limit]:
    """Limits that a frame keeps at a pose T, by the words of `outside`."""
    p, R = T.translation, T.rotation
    return {
        "box": mq.BoxLimit(frame=frame, lower=[-0.05, -0.04, -np.inf], upper=[0.05, 0.04, 0.03], pose=T),
        "point in a box": mq.BoxLimit(
            frame=frame, offset=OFFSET, lower=[-0.05] * 3, upper=[0.05] * 3, pose=T * mq.pose(OFFSET)
        ),
        "half-space": mq.HalfSpaceLimit(frame=frame, normal=[1.0, -2.0, 0.5], point=p),
        "distance": mq.DistanceLimit(frame=frame, point=p + np.array([0.1, 0.0, 0.1]), lower=0.1, upper=0.2),
        "cone": mq.ConeLimit(frame=frame, direction=R[:, 2], angle=0.2),
        "range": mq.PoseRange(frame=frame, target=T, position=[0.03, 0.02, 0.05], orientation=[0.1, 0.05, 0.5]),
        "yaw": mq.PoseRange(frame=frame, target=T, position=0.03, orientation=[0.0, 0.0, 0.5]),
    }


def outside(kind: str, T, now) -> float:
    """By how much the pose `now` breaks a limit of `limits_about(T)` [m or rad]; negative inside."""
    p, d = T.translation, T.rotation.T @ (now.translation - T.translation)
    Q = T.rotation.T @ now.rotation
    if kind == "box":
        return float(max(np.max(d - [0.05, 0.04, 0.03]), np.max(-d[:2] - [0.05, 0.04])))
    if kind == "point in a box":
        return float(np.max(np.abs(d + Q @ OFFSET - OFFSET) - 0.05))
    if kind == "half-space":
        normal = np.array([1.0, -2.0, 0.5])
        return float(-(normal @ (now.translation - p)) / np.linalg.norm(normal))
    if kind == "distance":
        distance = np.linalg.norm(now.translation - p - [0.1, 0.0, 0.1])
        return float(max(0.1 - distance, distance - 0.2))
    if kind == "cone":
        return float(np.arctan2(np.linalg.norm(Q[:2, 2]), Q[2, 2]) - 0.2)
    tilt, yaw = tilt_and_yaw(Q)
    if kind == "range":
        return float(np.max([*(np.abs(d) - [0.03, 0.02, 0.05]), *(np.abs(tilt) - [0.1, 0.05]), abs(yaw) - 0.5]))
    return float(np.max([*(np.abs(d) - 0.03), *(np.abs(tilt) - 1e-6), abs(yaw) - 0.5]))


def tilt_and_yaw(Q: np.ndarray) -> tuple[np.ndarray, float]:
    """Rotation vector (2,) [rad] of the short turn that tilts z to where Q takes it, and the turn about z before it."""
    z, a = np.array([0.0, 0.0, 1.0]), Q[:, 2]
    across = np.cross(z, a)
    sine = np.linalg.norm(across)
    vector = across * (np.arctan2(sine, a[2]) / sine) if sine > 1e-12 else across
    rest = turn(-vector) @ Q
    return vector[:2], float(np.arctan2(rest[1, 0], rest[0, 0]))


def turn(v: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector (3,) [rad] by Rodrigues' formula."""
    angle = np.linalg.norm(v)
    x, y, z = v / angle if angle > 0 else v
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)
