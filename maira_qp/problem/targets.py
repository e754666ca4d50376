"""Targets as the numbers that engines work with, and the random streams that belong to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, is_native, real_array
from maira_qp.errors import ConfigurationError, FrameError, OptionError, PoseError, listed, shown
from maira_qp.orientation import A_POSE, ORTHONORMAL_WITHIN, rigid, rounding_of
from maira_qp.problem.pose import as_pose
from maira_qp.robots.model.joint_values import check_joints, joint_array

FARTHEST = 1e9
"""Targets farther away than this many lengths of the arm are a mistake, and beyond the numbers."""

Poses = Mapping[str, pin.SE3]
"""One target by key: the name of a task, or its frame"""

WORD = 2**64

MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)
"""Odd, so that no pose of a target is lost when the poses are mixed: 2^64 over the golden ratio (Knuth, "The Art of
Computer Programming", volume 3, section 6.4)."""


@dataclass(frozen=True, eq=False)
class Targets:
    """The targets of N calls, checked: K poses each, one for each key that needs one."""

    keys: tuple[str, ...]
    """(K,)"""
    rows: np.ndarray
    """(N, K, 12): R by rows, then p; NaN for a target with NaN or inf in it"""
    deviations: np.ndarray
    """(N,) how far each was from rotations, see `rounding_of`"""

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, which: int | np.ndarray) -> Targets:
        some = np.atleast_1d(which)
        return Targets(self.keys, self.rows[some], self.deviations[some])

    def poses(self, i: int = 0) -> dict[str, pin.SE3]:
        """The i-th target by key."""
        return poses_of(self.keys, self.rows[i])

    @property
    def is_finite(self) -> np.ndarray:
        """Which of them (N,) hold no NaN or inf."""
        return np.asarray(np.isfinite(self.rows).all(axis=(1, 2)))


def checked_target(target: Any, frames: tuple[str, ...], length: float) -> Targets:
    """The targets of one call, N = 1, for an arm of a length [m]. Raises `PoseError`, `FrameError`."""
    if not isinstance(target, Mapping):
        if target is None and not frames:
            return Targets(frames, np.empty((1, 0, 12)), np.zeros(1))
        if target is None or len(frames) != 1:
            needed = ("no target", "a target")[len(frames)] if len(frames) < 2 else "a mapping {frame: pose}"
            raise PoseError(_instead(frames, needed))
        target = {frames[0]: target}
    for name in target:
        if name not in frames:
            raise FrameError(f"no task takes its target from the call for {shown(name)}; {listed(frames, name)}")
    if len(target) < len(frames):
        missing = ", ".join(repr(frame) for frame in frames if frame not in target)
        raise PoseError(_instead(frames, f"a mapping {{frame: pose}}, in which {missing} is missing"))
    names = {frame: "target" if len(frames) == 1 else f"target of {frame!r}" for frame in frames}
    poses = {frame: as_pose(target[frame], name) for frame, name in names.items()}
    for frame, pose in poses.items():
        check_distance(pose.translation, length, names[frame])
    deviation = max((rounding_of(getattr(each, "homogeneous", each)) for each in target.values()), default=0.0)
    rows = np.reshape([row_of(pose) for pose in poses.values()], (1, len(frames), 12))
    return Targets(frames, rows, np.array([deviation]))


def checked_targets(targets: Any, frames: tuple[str, ...], length: float, name: str = "target") -> Targets:
    """The targets of a batch, for an arm of a length [m]; a message calls one by a name.

    They come as (N, 4, 4) for one frame, else as {frame: (N, 4, 4), or one for all}, or as N mappings {frame: pose}.
    Raises `PoseError`, `FrameError`.
    """
    if not frames:
        raise PoseError("the tasks take no target from the call, so there is nothing to make a batch of")
    if isinstance(targets, Sequence) and targets and all(isinstance(each, Mapping) for each in targets):
        for each in targets:
            if set(each) != set(frames):
                checked_target(each, frames, length)  # which says what is wrong
        targets = {frame: [each[frame] for each in targets] for frame in frames}
    if not isinstance(targets, Mapping):
        if len(frames) != 1:
            raise PoseError(_instead(frames, "a mapping {frame: poses}"))
        targets = {frames[0]: targets}
    if set(targets) != set(frames):
        raise PoseError(_instead(frames, "a mapping {frame: poses} of just these frames"))
    listed_each = _one_each({frame: targets[frame] for frame in frames})
    made = [rows_of(poses_of_batch(value, name), name) for value in listed_each]
    each, deviations = [rows for rows, _ in made], [deviation for _, deviation in made]
    if len({len(rows) for rows in each}) > 1:
        raise PoseError(f"as many poses for each frame, not {[len(rows) for rows in each]}")
    rows = np.stack(each, axis=1) if len(each) > 1 else each[0][:, None]
    far = np.abs(rows[:, :, 9:]) > FARTHEST * length
    for i in np.flatnonzero(far.any(axis=(1, 2))) if far.any() else ():
        check_distance(rows[i, :, 9:], length, f"{name} {i}")
    rows[np.isnan(rows[:, :, 0]).any(axis=1)] = np.nan
    return Targets(frames, rows, np.max(deviations, axis=0))


def _one_each(values: Mapping[str, Any]) -> list[Any]:
    """The poses of a batch for each key, where one pose may be for all, unless all are single ones."""
    is_single = [is_pose(value) for value in values.values()]
    if all(is_single) or not any(is_single):
        return list(values.values())
    count = next(len(value) for value, single in zip(values.values(), is_single, strict=True) if not single)
    return [[value] * count if single else value for value, single in zip(values.values(), is_single, strict=True)]


def is_pose(value: Any) -> bool:
    """Whether a value has the form of a single pose: `pin.SE3`, or four rows of numbers."""
    if isinstance(value, (pin.SE3, np.ndarray)):
        return isinstance(value, pin.SE3) or value.ndim == 2
    rows = list(value) if is_listing(value) else []
    return bool(rows) and all(is_listing(row) and not any(map(is_listing, row)) for row in rows)


def check_distance(p: np.ndarray, length: float, name: str) -> None:
    """Raises `PoseError` for a position (..., 3) [m] that cannot be meant for an arm of that length [m]."""
    if np.abs(p).max() > FARTHEST * length:
        raise PoseError(f"the {name} is {np.abs(p).max():.3g} m away, more than {FARTHEST:g} times the arm's length")


def _instead(frames: tuple[str, ...], needed: str) -> str:
    names = ", ".join(map(repr, frames)) or "none"
    return f"the tasks need {needed} (frames without a target of their own: {names})"


def poses_of(frames: tuple[str, ...], row: np.ndarray) -> dict[str, pin.SE3]:
    """The target of a row (K, 12) by key."""
    return {frame: pose_of(each) for frame, each in zip(frames, row, strict=True)}


def row_of(target: pin.SE3) -> np.ndarray:
    """A pose as (12,): R by rows, then p."""
    return np.concatenate([target.rotation.ravel(), target.translation])


def pose_of(row: np.ndarray) -> pin.SE3:
    """The pose of a row (12,)."""
    return pin.SE3(row[:9].reshape(3, 3).copy(), row[9:].copy())


def rows_of(T: np.ndarray, name: str = "target") -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, 4, 4) as rows (N, 12), their rotations made exact; one with NaN or inf becomes NaN.

    And how far each (N,) was from a rotation, see `rounding_of`.

    Raises `PoseError`, naming the first that is no rigid transformation.
    """
    from maira_qp.kernels.spatial.pose_validation import FINE, NOT_FINITE, pose_rows  # heavy: Numba comes with it

    rows, faults, deviations = np.empty((len(T), 12)), np.empty(len(T), dtype=np.int64), np.zeros(len(T))
    pose_rows(T, ORTHONORMAL_WITHIN, rows, faults)
    if (faults != FINE).any():
        for i in np.flatnonzero(faults > NOT_FINITE):
            rows[i] = row_of(pin.SE3(rigid(T[i], f"{name} {i}")))
            deviations[i] = rounding_of(T[i])
        rows[faults == NOT_FINITE] = np.nan
    return rows, deviations


def seed_words(seed: int) -> np.ndarray:
    """A seed as two words (2,). Raises `OptionError` if it does not fit."""
    if seed >= WORD**2:
        raise OptionError("a seed must be below 2^128")
    return np.array([seed % WORD, seed // WORD], dtype=np.uint64)


SEED_0 = seed_words(0)


def streams(rows: np.ndarray, words: np.ndarray) -> np.ndarray:
    """64 bits (N,) that begin the random stream of each of N targets (N, 12), or of K poses each (N, K, 12).

    They depend on the target and the seed's words (2,) alone.
    """
    from maira_qp.kernels.search.random_numbers import streams_of

    if rows.ndim == 3:
        mixed = np.zeros(len(rows), dtype=np.uint64)
        for k in range(rows.shape[1]):
            mixed = mixed * MULTIPLIER + streams(np.ascontiguousarray(rows[:, k]), words)
        return mixed
    result = np.empty(len(rows), dtype=np.uint64)
    streams_of(rows, words, result)
    return result


def poses_of_batch(targets: Any, name: str = "target", of_one: str = "for one target use solve") -> np.ndarray:
    """The targets of a batch as (N, 4, 4), checked; not a copy where none is needed.

    Raises `PoseError`; where there is one pose, with what to do in words.
    """
    is_one = isinstance(targets, pin.SE3) or (isinstance(targets, np.ndarray) and targets.shape == (4, 4))
    if is_one or not is_listing(targets):
        raise PoseError(f"{name}s must be a sequence of poses, (N, 4, 4); {of_one}")
    if not isinstance(targets, np.ndarray):
        targets = [each.homogeneous if isinstance(each, pin.SE3) else each for each in targets]
    if not len(targets):
        return np.empty((0, 4, 4))
    if is_native(targets, (len(targets), 4, 4)):
        return targets
    try:
        return real_array(targets, (None, 4, 4), f"{name}s", PoseError, finite=None)
    except PoseError:
        poses = [
            real_array(T, (4, 4), f"{name} {i}", PoseError, finite=None, wanted=A_POSE) for i, T in enumerate(targets)
        ]
        return np.array(poses).reshape(-1, 4, 4)


def checked_seed(value: Any) -> np.ndarray:
    """A seed or a generator as two words (2,). Raises `OptionError`."""
    if isinstance(value, np.random.Generator):
        value = value.integers(2**63)
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 0:
        raise OptionError(f"a seed must be a non-negative integer (or, for rng, a Generator), got {shown(value)}")
    return seed_words(int(value))


def checked_starts(q0: Any, count: int, joint_names: tuple[str, ...], default: np.ndarray) -> np.ndarray | None:
    """The starts (count, n) of a batch from one for all or one each; None: none. Raises `ConfigurationError`.

    They come as (n,), (count, n), {joint name: value, or values (count,)}, or as `count` mappings; joints that a
    mapping does not name are at `default` (n,).
    """
    if q0 is None:
        return None
    if isinstance(q0, Mapping):
        return _starts_by_joint(q0, count, joint_names, default)
    if not is_listing(q0) or not any(is_listing(each) or isinstance(each, Mapping) for each in q0):
        return np.tile(joint_array(q0, joint_names, "q0", ConfigurationError), (count, 1))
    if any(isinstance(each, Mapping) for each in q0):
        starts = [joint_array(each, joint_names, f"q0 {i}", ConfigurationError, default) for i, each in enumerate(q0)]
        return real_array(np.array(starts), (count, len(joint_names)), "q0", ConfigurationError)
    return real_array(q0, (count, len(joint_names)), "q0", ConfigurationError)


def _starts_by_joint(
    q0: Mapping[str, Any], count: int, joint_names: tuple[str, ...], default: np.ndarray
) -> np.ndarray:
    check_joints(q0, joint_names, "q0", ConfigurationError)
    starts = np.tile(default, (count, 1))
    for joint, values in q0.items():
        shape = (count,) if is_listing(values) else ()
        starts[:, joint_names.index(joint)] = real_array(values, shape, f"q0 of joint {joint!r}", ConfigurationError)
    return starts
