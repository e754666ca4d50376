"""Objectives for the redundancy: what the arm should prefer among all configurations that reach the target.

Each is a cost to be made small, with its gradient and Hessian in joint space. The criteria that the literature climbs
(Siciliano et al., "Robotics", 2009, section 3.5.1) stand here with their sign turned.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from maira_qp.arrays import is_listing, is_native, is_number, real_array, semidefinite_matrix
from maira_qp.errors import OptionError, listed, shown
from maira_qp.problem.naming import NO_DATUM, POINT, check_name, word_for
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.joint_values import joint_array, joint_values
from maira_qp.robots.model.robot import Robot


class Objective(ABC):
    """A cost over configurations. Angles in rad, lengths in m."""

    is_off: ClassVar[bool] = False
    """An objective of a level of its own always counts; see `naming.Off`."""
    name: str | None = None
    """What calls call it by; None: a word for its class, such as "posture"."""

    @property
    def key(self) -> str:
        """What a call calls the objective by."""
        return word_for(self) if self.name is None else self.name

    @property
    def datum(self) -> str:
        """What it takes from a call that stands in the base, "pose", "point" or "direction"; empty: nothing does."""
        return ""

    def with_value(self, value: Any) -> Objective:
        """The objective, bound to a robot, with another datum, such as its reference. Raises `OptionError`."""
        raise OptionError(f"{self.key!r}, a {type(self).__name__}, {NO_DATUM}")

    def scaled(self, factor: float) -> Objective:
        """The same: alone in its level it is minimised whatever its weight > 0."""
        return self

    @abstractmethod
    def of(self, robot: Robot) -> Objective:
        """The objective with everything that depends on the robot filled in and checked. Raises `OptionError`."""

    @abstractmethod
    def cost(self, at: Configuration) -> float:
        """The value to be made small."""

    @abstractmethod
    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) of the cost."""

    @abstractmethod
    def hessian(self, at: Configuration) -> np.ndarray:
        """Hessian (n, n) of the cost, symmetric, of any definiteness."""

    def share(self, dt: float) -> float:
        """Share of Newton's step that a control tick of dt [s] takes, in (0, 1]: all of it, unless there is a gain."""
        return 1.0


def check_objective(objective: object) -> None:
    """Raises `OptionError` for what is no objective."""
    if not isinstance(objective, Objective):
        raise OptionError(
            f"not an objective: {shown(objective)}; "
            "valid: Posture(), LimitDistance(), Manipulability(), ObstacleDistance(...)"
        )


TINY = 1e-300
"""The least share of a step: 0 would be none."""


def checked_gain(gain: Any, name: str) -> float | None:
    """A gain [1/s], > 0, or None. Raises `OptionError`."""
    if gain is not None and not (is_number(gain) and 0 < gain < math.inf):
        raise OptionError(f"gain of {name} must be a positive number [1/s], or None, got {shown(gain)}")
    return None if gain is None else float(gain)


def share_of(gain: float | None, dt: float) -> float:
    """Share of an error that a gain [1/s] takes away in a tick of dt [s], in (0, 1]; without a gain all of it."""
    return 1.0 if gain is None else max(min(1.0, gain * dt), TINY)


@dataclass(frozen=True)
class Posture(Objective):
    """Stay near a reference: `1/2 sum_i w_i (q_i - q_ref_i)^2`, or `1/2 (q - q_ref)^T M (q - q_ref)`."""

    q_ref: Any = None
    """Reference configuration (n,) [rad or m], or {joint name: value}, in which joints that are not named do not count;
    None: the middle of the limits (0 for a continuous joint)."""
    weights: Any = None
    """Weights (n,), >= 0, or one for all, or {joint name: weight}, in which others count 1; None: 1. Or a matrix M
    (n, n), symmetric and positive semidefinite, such as a mass matrix; with one that is not diagonal the reference
    engine takes the redundancy, and the control ticks."""
    gain: float | None = None
    """A control tick moves by gain dt (q_ref - q), as far as what goes before it allows, and by no more than all of
    q_ref - q; > 0 [1/s]. None: it goes all the way in one tick, as fast as the limits allow. `solve` does not use it.
    """
    name: str | None = field(default=None, kw_only=True)
    """What calls call it by; None: "posture"."""
    _joint_names: tuple[str, ...] = field(default=(), kw_only=True, repr=False)

    def __post_init__(self) -> None:
        """Raises `OptionError`."""
        check_name(self.name, self)

    def of(self, robot: Robot) -> Posture:
        """With the reference and weights as arrays of the robot's size."""
        q_ref = robot.middle if self.q_ref is None else self.q_ref
        given = 1.0 if self.weights is None else self.weights
        weights = checked_joint_weights(given, "weights of Posture", robot.joint_names)
        if isinstance(q_ref, Mapping):  # a weight that is zero, or a row and a column of the matrix
            counts = np.array([name in q_ref for name in robot.joint_names], dtype=float)
            weights = weights * (counts if weights.ndim == 1 else np.outer(counts, counts))
        q_ref = joint_array(q_ref, robot.joint_names, "q_ref of Posture", OptionError, robot.middle)
        gain = checked_gain(self.gain, "Posture")
        return replace(self, q_ref=q_ref, weights=weights, gain=gain, _joint_names=robot.joint_names)

    def with_value(self, value: Any) -> Posture:
        """The same with another reference configuration, (n,) or by name; others stay. Raises `OptionError`."""
        if is_native(value, self.q_ref.shape) and np.isfinite(value).all():
            q_ref = value.copy()
        else:
            q_ref = joint_array(value, self._joint_names, f"reference of {self.key!r}", OptionError, self.q_ref)
        posture = copy(self)
        object.__setattr__(posture, "q_ref", q_ref)
        return posture

    @property
    def is_diagonal(self) -> bool:
        """The weights are one for each joint, and no matrix."""
        return self.weights.ndim == 1

    @property
    def joint_weights(self) -> np.ndarray:
        """One weight for each joint (n,): of a matrix its diagonal."""
        return self.weights if self.is_diagonal else np.diag(self.weights)

    def costs(self, q: np.ndarray) -> np.ndarray:
        """The costs (N,) of configurations (N, n)."""
        d = q - self.q_ref
        return 0.5 * d**2 @ self.weights if self.is_diagonal else 0.5 * ((d @ self.weights) * d).sum(axis=1)

    def cost(self, at: Configuration) -> float:
        """Weighted squared distance, halved."""
        return float(0.5 * at.displacement(self.q_ref) @ self.gradient(at))

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) [rad]."""
        d = at.displacement(self.q_ref)
        return self.weights * d if self.is_diagonal else self.weights @ d

    def hessian(self, at: Configuration) -> np.ndarray:
        """The weights on the diagonal (n, n), or their matrix."""
        return np.diag(self.weights) if self.is_diagonal else self.weights

    def share(self, dt: float) -> float:
        """That of the gain."""
        return share_of(self.gain, dt)


def checked_joint_weights(value: Any, name: str, joint_names: tuple[str, ...]) -> np.ndarray:
    """Weights of joints: (n,), >= 0, from one for all, one each, or {joint name: weight}, in which others count 1; or a
    matrix (n, n) that is not diagonal.

    Raises `OptionError`.
    """
    n = len(joint_names)
    if isinstance(value, (list, tuple, np.ndarray)) and is_listing(value) and any(map(is_listing, value)):
        M = semidefinite_matrix(value, n, name, OptionError)
        diagonal = np.diag(M)
        return diagonal.copy() if np.array_equal(M, np.diag(diagonal)) else M
    weights = np.array(joint_values(joint_names, value, name, np.ones(n), finite=True))
    if (weights < 0).any():
        raise OptionError(f"{name} must not be negative, but >= 0, got {weights.tolist()}")
    return weights


@dataclass(frozen=True)
class LimitDistance(Objective):
    """Stay away from the joint limits: `1/(2n) sum_i ((q_i - mid_i) / range_i)^2` (Liegeois, 1977).

    Continuous and locked joints do not count.
    """

    gain: float | None = None
    """As for `Posture` [1/s]: a control tick moves by gain dt (mid - q)."""
    _posture: Posture | None = None
    name: str | None = field(default=None, kw_only=True)
    """What calls call it by; None: "limit_distance"."""

    def __post_init__(self) -> None:
        """Raises `OptionError`."""
        check_name(self.name, self)

    def of(self, robot: Robot) -> LimitDistance:
        """With the robot's middle and ranges: it is a posture, weighted by the ranges."""
        extent = robot.upper - robot.lower
        counts = np.isfinite(extent) & (extent > 0)
        weights = np.where(counts, 1.0 / (robot.n * np.where(counts, extent, 1.0) ** 2), 0.0)
        gain = checked_gain(self.gain, "LimitDistance")
        return replace(self, gain=gain, _posture=Posture(robot.middle, weights, gain).of(robot))

    @property
    def as_posture(self) -> Posture:
        """The posture that it is, once made for a robot."""
        assert self._posture is not None
        return self._posture

    def cost(self, at: Configuration) -> float:
        """Half of the mean squared distance from the middle, in ranges (no unit)."""
        return self.as_posture.cost(at)

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) [1/rad or 1/m]."""
        return self.as_posture.gradient(at)

    def hessian(self, at: Configuration) -> np.ndarray:
        """Diagonal (n, n)."""
        return self.as_posture.hessian(at)

    def share(self, dt: float) -> float:
        """That of the gain."""
        return share_of(self.gain, dt)


TWIST_AXES = ("x", "y", "z", "rx", "ry", "rz")
"""The rows of a Jacobian: translation along the base's axes, rotation about them."""

AXES_OF = {"translation": TWIST_AXES[:3], "rotation": TWIST_AXES[3:]}


@dataclass(frozen=True)
class Manipulability(Objective):
    """Stay away from singularities: `-sqrt(det(J J^T))` (Yoshikawa, 1985); with more rows than joints `J^T J`.

    J has the rows of the `axes` alone.
    """

    frame: str | None = None
    """The frame whose Jacobian counts; None: the tip."""
    axes: Any = None
    """What the frame is to be able to do: "translation", "rotation", or some of "x", "y", "z" and "rx", "ry", "rz", as
    in ("x", "y", "rz"): along and about the base's axes; None: all six."""
    name: str | None = field(default=None, kw_only=True)
    """What calls call it by; None: "manipulability"."""

    def __post_init__(self) -> None:
        """Raises `OptionError`."""
        check_name(self.name, self)

    def of(self, robot: Robot) -> Manipulability:
        """With the names of the frame and of the axes checked."""
        robot.frame_id(self.frame)
        return replace(self, axes=_checked_axes(self.axes))

    def cost(self, at: Configuration) -> float:
        """Minus the product of the Jacobian's singular values."""
        return -float(np.prod(np.linalg.svd(at.jacobian(self.frame)[self._rows], compute_uv=False)))

    def gradient(self, at: Configuration) -> np.ndarray:
        """`-sum_k (product of the other singular values) u_k^T dJ/dq_i v_k` (n,), finite at singularities too."""
        U, s, Vt = np.linalg.svd(at.jacobian(self.frame)[self._rows], full_matrices=False)
        others = np.array([np.prod(np.delete(s, k)) for k in range(len(s))])
        return -np.einsum("iab,ab->i", at.jacobian_derivative(self.frame)[:, self._rows], (U * others) @ Vt)

    @property
    def _rows(self) -> list[int]:
        """The rows of the Jacobian that count."""
        return [TWIST_AXES.index(axis) for axis in self.axes]

    def hessian(self, at: Configuration) -> np.ndarray:
        """By central differences of the gradient (n, n)."""
        return finite_difference_hessian(self, at)


def _checked_axes(axes: Any) -> tuple[str, ...]:
    """The axes that count, in the order of a Jacobian's rows. Raises `OptionError`."""
    if axes is None:
        return TWIST_AXES
    if isinstance(axes, str) and axes in AXES_OF:
        return AXES_OF[axes]
    names = (axes,) if isinstance(axes, str) else tuple(axes) if is_listing(axes) else ()
    wrong = [each for each in names if not isinstance(each, str) or each not in TWIST_AXES]
    if wrong or not names:
        known = (*AXES_OF, *TWIST_AXES)
        raise OptionError(f"axes of Manipulability cannot be {shown(axes)}; {listed(known, wrong[0] if wrong else '')}")
    return tuple(axis for axis in TWIST_AXES if axis in names)


@dataclass(frozen=True)
class ObstacleDistance(Objective):
    """Stay away from a point: minus the distance of the nearest of the arm's frames, smoothed where two are as near.

    The smooth minimum is `-1/k log sum_i exp(-k d_i)`, below the true one by at most log(number of frames) / k.
    """

    obstacle: Any
    """The point (3,) in the base [m]."""
    frames: tuple[str, ...] | None = None
    """Links whose origins count; None: the one behind each moving joint, and the tip."""
    sharpness: float = 50.0
    """k [1/m]; > 0."""
    name: str | None = field(default=None, kw_only=True)
    """What calls call it by; None: "obstacle_distance"."""

    def __post_init__(self) -> None:
        """Raises `OptionError`."""
        check_name(self.name, self)

    @property
    def datum(self) -> str:
        """The obstacle."""
        return POINT

    def with_value(self, value: Any) -> ObstacleDistance:
        """The same with the obstacle at another point (3,) [m]. Raises `OptionError`."""
        objective = copy(self)
        object.__setattr__(objective, "obstacle", real_array(value, (3,), f"point of {self.key!r}", OptionError))
        return objective

    def of(self, robot: Robot) -> ObstacleDistance:
        """With the point as an array and the frames' names checked."""
        point = real_array(self.obstacle, (3,), "obstacle of ObstacleDistance", OptionError)
        if not (is_number(self.sharpness) and 0 < self.sharpness < math.inf):
            raise OptionError(
                f"sharpness of ObstacleDistance must be a positive number [1/m], got {shown(self.sharpness)}"
            )
        if self.frames is not None and not is_listing(self.frames):
            raise OptionError(f"frames of ObstacleDistance must be a list of links, got {shown(self.frames)}")
        frames = (*robot.moved_links, robot.tip) if self.frames is None else tuple(self.frames)
        if not frames:
            raise OptionError("frames of ObstacleDistance is an empty list")
        for frame in frames:
            robot.frame_id(frame)
        return replace(self, obstacle=point, frames=frames)

    def _distances(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (k, 3) [m] of the frames from the obstacle and their norms (k,)."""
        offsets = np.array([at.placement(frame).translation - self.obstacle for frame in self.frames or ()])
        return offsets, np.linalg.norm(offsets, axis=1)

    def distance(self, at: Configuration) -> float:
        """The true distance of the nearest frame [m]."""
        return float(self._distances(at)[1].min())

    def cost(self, at: Configuration) -> float:
        """Minus the smooth distance [m]."""
        d = self._distances(at)[1]
        return float(np.log(np.exp(-self.sharpness * (d - d.min())).sum()) / self.sharpness - d.min())

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) [m/rad]."""
        offsets, d = self._distances(at)
        share = np.exp(-self.sharpness * (d - d.min()))
        away = offsets / np.maximum(d, 1e-12)[:, None] * (share / share.sum())[:, None]
        jacobians = np.array([at.jacobian(frame)[:3] for frame in self.frames or ()])
        return -np.einsum("kij,ki->j", jacobians, away)

    def hessian(self, at: Configuration) -> np.ndarray:
        """By central differences of the gradient (n, n)."""
        return finite_difference_hessian(self, at)


def finite_difference_hessian(objective: Objective, at: Configuration, step: float = 1e-5) -> np.ndarray:
    """Hessian (n, n) of an objective by central differences of its gradient, made symmetric; error about step^2."""
    nudges = step * np.eye(at.n)
    H = np.array([objective.gradient(at.moved(dq)) - objective.gradient(at.moved(-dq)) for dq in nudges]) / (2 * step)
    return 0.5 * (H + H.T)
