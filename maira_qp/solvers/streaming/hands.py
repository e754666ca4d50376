"""The hands that are followed: the poses of a target, checked, compared with the last ones, and through the clutch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_native
from maira_qp.errors import MairaError
from maira_qp.kernels.control.hand_motion import JUMPED, follow_hands
from maira_qp.kernels.spatial.pose_validation import FINE
from maira_qp.orientation import ORTHONORMAL_WITHIN
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import checked_target
from maira_qp.solvers.streaming.clutch import Clutch


@dataclass(frozen=True, eq=False)
class Hands:
    """Where hands and targets are: what the next target is compared with, and what a clutch moves."""

    rows: np.ndarray
    """The hands (K, 12), R by rows and p; NaN: the next ones may be anywhere"""
    goals: np.ndarray | None = None
    """The targets (K, 4, 4); None: there are none yet"""


@dataclass(frozen=True, eq=False)
class HandMap:
    """What a problem's targets are made of."""

    problem: Problem
    max_jump: np.ndarray
    """(2,) [m; rad]"""
    is_relative: bool
    """Targets move as hands do; False: they are the hands"""
    alignment: np.ndarray
    """(3, 3), see `Clutch`, as are the next"""
    scale: float
    rotation_scale: float

    @staticmethod
    def of(problem: Problem, clutch: Clutch | None, max_jump: np.ndarray) -> HandMap:
        """That of a clutch, or of none; `max_jump` (2,) [m; rad]."""
        like = Clutch() if clutch is None else clutch
        alignment = like.alignment.copy()  # writable, as kernels are compiled for
        return HandMap(problem, max_jump, clutch is not None, alignment, like.scale, like.rotation_scale)

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """The K keys of the targets that frames follow; what an axis points at or along is none."""
        return tuple(key for key in self.problem.target_keys if key not in self.problem.aims)

    @cached_property
    def _turn_freely(self) -> np.ndarray:
        """Of which of the keys (K,) the position alone counts."""
        return np.array([key in self.problem.takers for key in self.keys], dtype=bool)

    def sorted_out(self, target: Any) -> tuple[Any, dict[str, Any]]:
        """The poses that frames follow out of a target, None for none, and other data. Raises `MairaError`."""
        problem = self.problem
        if not (problem.takers or isinstance(target, Mapping)) or target is None:
            return target, {}
        poses, values = problem.split(target)
        if not isinstance(target, Mapping):
            is_aim = len(problem.target_keys) == 1 and bool(problem.aims)
            return (None, {problem.target_keys[0]: poses}) if is_aim else (poses, {})
        aims = {key: value for key, value in poses.items() if key in problem.aims}
        return {key: value for key, value in poses.items() if key not in aims} or None, {**values, **aims}

    def anywhere(self) -> Hands:
        """No hands to compare with."""
        return Hands(np.full((len(self.keys), 12), np.nan))

    def at_tools(self, q: np.ndarray) -> Hands:
        """Hands that are where the tools are at q (n,)."""
        T = self.tools(q)
        return Hands(np.concatenate([T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]], axis=1))

    def tools(self, q: np.ndarray) -> np.ndarray:
        """Where the tools (K, 4, 4) are at q (n,)."""
        followers = self.problem.followers(self.problem.robot.at(q))
        T = [followers[key].homogeneous for key in self.keys]
        return np.array(T).reshape(-1, 4, 4)

    def moved(self, hands: Hands, target: Any, tools: np.ndarray | None) -> Hands | str:
        """The hands and targets after a target from the caller, or why it is not followed.

        With a clutch and without targets, the tools (K, 4, 4) are moved from where they are.
        """
        given = self._native(target)
        after = None if given is None else self._followed(hands, given, tools)
        if after is None:  # rounded, or to be refused in words
            try:
                rows = checked_target(target, self.keys, self.problem.robot.length).rows[0]
            except MairaError as error:
                return str(error)
            after = self._followed(hands, _matrices(rows), tools)
            assert after is not None
        return after

    def _native(self, target: Any) -> np.ndarray | None:
        """The poses of a target (K, 4, 4), unchecked; None for what may be none."""
        frames = self.keys
        if isinstance(target, Mapping):
            given = [_matrix(target.get(frame)) for frame in frames]
            matrices = [T for T in given if T is not None]
            return np.array(matrices) if len(matrices) == len(frames) == len(target) else None
        T = _matrix(target) if len(frames) == 1 else None
        return None if T is None else T[None].copy()

    def _followed(self, hands: Hands, T: np.ndarray, tools: np.ndarray | None) -> Hands | str | None:
        """`moved` for hands T (K, 4, 4), None where one is not rigid to rounding."""
        count = len(T)
        turned = np.isfinite(hands.rows[:, 0]) & self._turn_freely
        if turned.any():  # a position has no orientation that could jump
            T = T.copy()
            T[turned, :3, :3] = hands.rows[turned, :9].reshape(-1, 3, 3)
        seen, goals, out = np.empty((count, 12)), np.empty((count, 4, 4)), np.empty(9)
        last = T if not self.is_relative else tools if hands.goals is None else hands.goals
        fault = follow_hands(
            T,
            ORTHONORMAL_WITHIN,
            self.max_jump,
            hands.rows,
            self.alignment,
            self.scale,
            self.rotation_scale,
            self.is_relative,
            last,
            seen,
            goals,
            out,
        )
        if fault == FINE:
            return Hands(seen, goals)
        return self._jump(hands, out) if fault == JUMPED else None

    def _jump(self, hands: Hands, out: np.ndarray) -> str:
        """In words how far the hand of `out` (9,), see `follow_hands`, is from the last."""
        index, distance, angle = out[:3].tolist()
        frames, (most, widest) = self.keys, self.max_jump.tolist()
        name = "target" if len(frames) == 1 else f"target of {frames[int(index)]!r}"
        last = "tool" if hands.goals is None and not self.is_relative else "last one"
        allowed = f"max_jump: {1e3 * most:.4g} mm, {math.degrees(widest):.4g} degrees"
        far = f"{1e3 * distance:.1f} mm and {math.degrees(angle):.1f} degrees"
        return f"the {name} is {far} from the {last} ({allowed})"


def _matrix(pose: Any) -> np.ndarray | None:
    """A pose (4, 4) as it is; None for what may be none."""
    if isinstance(pose, pin.SE3):
        return np.ascontiguousarray(pose.homogeneous)
    return pose if is_native(pose, (4, 4)) else None


def _matrices(rows: np.ndarray) -> np.ndarray:
    """Poses (K, 12) as transformations (K, 4, 4)."""
    T = np.zeros((len(rows), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = rows[:, :9].reshape(-1, 3, 3), rows[:, 9:], 1.0
    return T
