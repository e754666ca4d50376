"""The targets of a benchmark: where the arm is asked to go, and from where it starts.

Every target has a random stream of its own, made from the seed, the stratum's name and the target's number: it is the
same whatever else is asked for, and in whatever order. Poses come from the judge's forward kinematics, so that each
reachable target has a solution inside the limits that owes nothing to a solver. The strata mean the same on any arm:

- uniform: each joint uniform between its limits (a joint without limits: between -pi and pi).
- near-limits-1e-2, near-limits-1e-4: each joint within that many rad (or m) of one of its limits, drawn by a coin.
- stretched-elbow: uniform, then the elbow is set, to within 1e-3 rad, so that the arm is as long as it can be. The
  elbow is the turning joint which alone changes the distance from shoulder (the second joint) to wrist (the last joint
  but one; the tool where an arm has no wrist) the most.
- aligned-wrist: uniform, then the last joint but one is set, to within 1e-3 rad, so that the axes on either side of it
  are as parallel as they can be, near mid-range where several values do. A six-joint arm loses a direction there; a
  seven-joint arm keeps it by its elbow.
- out-of-reach: each joint in turn is set so that the tool is as far as it can be from the arm's centre, and the tool is
  then pushed outwards to 0.01 m beyond a bound that no configuration exceeds (reach.py). An arm without lateral offsets
  attains that bound; for others the target is a little further away.
- nearby: the start, moved by 0.1 rad (or m) as a norm, in any direction, and back into the limits.
- far-away: the orientation of a uniform configuration, in any direction at 1.1 times the reach.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from maira_qp.errors import OptionError, listed
from maira_qp.evaluation.judge import Judge
from maira_qp.evaluation.reach import reach
from maira_qp.evaluation.settings import OUT_OF_REACH, STRATA
from maira_qp.robots.model.robot import Robot

NEARNESS = 1e-3
"""How near to a singularity [rad]."""
MARGIN = 0.01 + 1e-6
"""How far beyond the reach [m]: more than counts as loosely reached, so that the nearest point never does."""


NEARBY, FAR_AWAY = "nearby", "far-away"
KINDS = (*STRATA, NEARBY, FAR_AWAY)
"""All strata: those of the command line, and those of the race against peers."""
STEP, BEYOND = 0.1, 1.1
"""How far a nearby target is from its start, as a norm of all joints, and a far one from the arm, in reaches."""


@dataclass(frozen=True)
class Target:
    """One question of a benchmark."""

    stratum: str
    """The stratum that it belongs to."""
    index: int
    """Its number in the stratum, from 0."""
    pose: np.ndarray
    """The wanted tool pose (4, 4) in the base."""
    start: np.ndarray
    """The configuration (n,) from which every method starts: uniform inside the limits."""
    witness: np.ndarray | None
    """A configuration (n,) inside the limits that reaches the pose; None where none does."""
    seed: tuple[int, ...]
    """Seed of the stream that a method may draw its restarts from."""

    @property
    def reachable(self) -> bool:
        """Whether a configuration inside the limits reaches the pose."""
        return self.witness is not None


class TargetSource:
    """Targets for one robot."""

    def __init__(self, robot: Robot, judge: Judge) -> None:
        """The judge must be that of the robot."""
        self.robot = robot
        self.judge = judge
        self._low = np.where(np.isfinite(robot.lower), robot.lower, -math.pi)
        self._high = np.where(np.isfinite(robot.upper), robot.upper, math.pi)
        self._joint_of = {joint.driver: k for k, joint in reversed(list(enumerate(judge.path)))}

    def missing(self, stratum: str) -> str | None:
        """Why this robot has no such stratum; None if it has it. Raises `OptionError` for an unknown name."""
        if stratum not in KINDS:
            raise OptionError(f"unknown stratum {stratum!r}; {listed(KINDS, stratum)}")
        if stratum == "stretched-elbow" and not self._elbows():
            return "no turning joint between shoulder and wrist"
        if stratum == "aligned-wrist" and not self._has_wrist():
            return "the arm does not end in three turning joints after three others"
        if stratum in (OUT_OF_REACH, FAR_AWAY) and not math.isfinite(self.reach[1]):
            return "the reach has no bound"
        return None

    def target(self, stratum: str, index: int, seed: int) -> Target:
        """Target number `index` of a stratum. Raises `OptionError` where the robot has no such stratum."""
        reason = self.missing(stratum)
        if reason is not None:
            raise OptionError(f"{self.robot.name} has no stratum {stratum!r}: {reason}")
        stream = (seed, zlib.crc32(stratum.encode()), index)
        rng = np.random.default_rng(stream)
        start, q = self._uniform(rng), self._uniform(rng)
        if stratum in (OUT_OF_REACH, FAR_AWAY):
            pose = self._pushed_out(q) if stratum == OUT_OF_REACH else self._far_away(q, rng)
            return Target(stratum, index, pose, start, None, (*stream, 1))
        q = self._draws()[stratum](start if stratum == NEARBY else q, rng)
        return Target(stratum, index, self.judge.forward(q), start, q, (*stream, 1))

    def batch(self, stratum: str, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Poses (count, 4, 4) and starts (count, n) of a stratum's first targets."""
        drawn = [self.target(stratum, index, seed) for index in range(count)]
        return np.array([target.pose for target in drawn]), np.array([target.start for target in drawn])

    def around(self, count: int, seed: int) -> np.ndarray:
        """Poses (count, 4, 4) on both sides of what the arm reaches, by an unknown witness or none.

        Those of configurations with some joints on their limits, each moved by 1e-6 to 1 m and rad; and, one in ten,
        any orientation at any position of a cube around the arm.
        """
        rng = np.random.default_rng(seed)
        q = rng.uniform(self._low, self._high, (count, self.robot.n))
        on_limit = rng.random(q.shape) < rng.choice([0.0, 0.3, 0.6], (count, 1))
        poses = self.judge.forward(np.where(on_limit, np.where(rng.random(q.shape) < 0.5, self._low, self._high), q))
        size = 10.0 ** rng.uniform(-6, 0, (count, 1))
        poses[:, :3, 3] += size * rng.normal(size=(count, 3)) / np.sqrt(3)
        moved = Rotation.from_rotvec(size * rng.normal(size=(count, 3)) / np.sqrt(3)).as_matrix()
        poses[:, :3, :3] = moved @ poses[:, :3, :3]
        tenth = len(poses[::10])
        poses[::10, :3, :3] = Rotation.random(tenth, rng=rng).as_matrix()
        poses[::10, :3, 3] = self.robot.length * rng.uniform(-1, 1, (tenth, 3))
        return poses

    @cached_property
    def reach(self) -> tuple[np.ndarray, float]:
        """A centre (3,) in the base and a distance [m] from it that the tool exceeds in no configuration."""
        return reach(self.judge.path, self._low, self._high)

    def _draws(self) -> dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]]:
        """How each reachable stratum makes its configuration (n,) from a uniform one."""
        return {
            "uniform": lambda q, rng: q,
            "near-limits-1e-2": lambda q, rng: self._near_limits(q, rng, 1e-2),
            "near-limits-1e-4": lambda q, rng: self._near_limits(q, rng, 1e-4),
            "stretched-elbow": self._stretched,
            "aligned-wrist": self._aligned,
            NEARBY: self._nearby,
        }

    def _uniform(self, rng: np.random.Generator) -> np.ndarray:
        return self.robot.clip(rng.uniform(self._low, self._high))

    def _near_limits(self, q: np.ndarray, rng: np.random.Generator, margin: float) -> np.ndarray:
        away = rng.uniform(0.0, np.minimum(margin, self._high - self._low))
        near = np.where(rng.random(q.size) < 0.5, self._low + away, self._high - away)
        limited = np.isfinite(self.robot.lower) & np.isfinite(self.robot.upper)
        return self.robot.clip(np.where(limited, near, q))

    def _nearby(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        direction = rng.standard_normal(q.size)
        return self.robot.clip(q + STEP * direction / np.linalg.norm(direction))

    def _far_away(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """A pose (4, 4) beyond the reach, in any direction, with the orientation at q (n,)."""
        pose, (centre, reach), outwards = self.judge.forward(q), self.reach, rng.standard_normal(3)
        pose[:3, 3] = centre + outwards * (BEYOND * reach / np.linalg.norm(outwards))
        return pose

    def _elbows(self) -> list[int]:
        """Joints that may be the elbow: turning ones after the shoulder and before the wrist."""
        n = self.robot.n
        return [
            i for i in range(2, n - 2 if self._has_wrist() else n) if not self.judge.path[self._joint_of[i]].sliding
        ]

    def _has_wrist(self) -> bool:
        n = self.robot.n
        return n >= 6 and not any(self.judge.path[self._joint_of[i]].sliding for i in range(n - 3, n))

    def _stretched(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        found = []
        for joint in self._elbows():
            lengths = {
                value: self._arm_length(_with(q, joint, value)) for value in self._turns(q, joint, self._arm_length)
            }
            longest = max(lengths, key=lambda value: lengths[value])
            found.append((lengths[longest] - min(lengths.values()), joint, longest))
        _, joint, longest = max(found)
        return self._set_near(q, joint, longest, rng)

    def _arm_length(self, q: np.ndarray) -> float:
        """Squared distance from shoulder to wrist, or to the tool of an arm without a wrist [m^2]."""
        before, tool = self.judge.frames(q)
        wrist = before[self._joint_of[self.robot.n - 2]] if self._has_wrist() else tool
        return float(np.sum((wrist[:3, 3] - before[self._joint_of[1]][:3, 3]) ** 2))

    def _aligned(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        joint = self.robot.n - 2
        values = self._turns(q, joint, self.alignment)
        best = max(values, key=lambda value: round(abs(self.alignment(_with(q, joint, value))), 9))
        return self._set_near(q, joint, best, rng)

    def alignment(self, q: np.ndarray) -> float:
        """Cosine between the axes of the last joint and the last but two."""
        before, _ = self.judge.frames(q)
        a, b = (self._joint_of[self.robot.n - 3], self._joint_of[self.robot.n - 1])
        axes = [before[k][:3, :3] @ self.judge.path[k].axis for k in (a, b)]
        return float(axes[0] @ axes[1])

    def _pushed_out(self, q: np.ndarray) -> np.ndarray:
        """A pose (4, 4) beyond the reach, in the direction in which the arm is stretched from q (n,)."""
        centre, reach = self.reach

        def distance(q: np.ndarray) -> float:
            return float(np.sum((self.judge.forward(q)[:3, 3] - centre) ** 2))

        for joint in list(range(self.robot.n)) * 2:
            q = max([q, *(_with(q, joint, value) for value in self._turns(q, joint, distance))], key=distance)
        pose = self.judge.forward(q)
        outwards = pose[:3, 3] - centre
        pose[:3, 3] = centre + outwards * ((reach + MARGIN) / np.linalg.norm(outwards))
        return pose

    def _turns(self, q: np.ndarray, joint: int, height: Callable[[np.ndarray], float]) -> list[float]:
        """Where one joint alone may make a height largest or smallest, the value nearest to mid-range first.

        The height must be a squared distance or a cosine between what is before and after the joint. For a turning
        joint it is then a + b cos(q) + c sin(q), which three values determine, with its extremes at atan2(c, b) and
        half a turn from there, or at the limits; for a sliding joint the ends are the extremes that count.
        """
        low, high = self._low[joint], self._high[joint]
        values = [low, high]
        path_joint = self.judge.path[self._joint_of[joint]]
        if not path_joint.sliding:
            thirds = [2 * math.pi * k / 3 for k in range(3)]
            heights = [height(_with(q, joint, angle)) for angle in thirds]
            b, c = (sum(h * of(t) for h, t in zip(heights, thirds, strict=True)) for of in (math.cos, math.sin))
            if math.hypot(b, c) < 1e-9:
                return [float(q[joint])]  # the joint has no say
            extreme = math.atan2(c, b)
            halves = range(math.ceil((low - extreme) / math.pi), math.floor((high - extreme) / math.pi) + 1)
            values += [extreme + k * math.pi for k in halves]
        return sorted(values, key=lambda value: abs(value - (low + high) / 2))

    def _set_near(self, q: np.ndarray, joint: int, value: float, rng: np.random.Generator) -> np.ndarray:
        return self.robot.clip(_with(q, joint, value + rng.uniform(-NEARNESS, NEARNESS)))


def _with(q: np.ndarray, joint: int, value: float) -> np.ndarray:
    """A copy of q (n,) with one joint at another value."""
    changed = q.copy()
    changed[joint] = value
    return changed
