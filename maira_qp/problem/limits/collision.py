"""Collision as a limit: the arm keeps a margin from obstacles and from itself.

Each pair of shapes that is near gives one row. With d its distance and n = dd/dq,

    -n dq <= d - margin                                     where no time passes
    -n dq <= gain dt / (1 + gain dt) (d - margin)           in a control tick of dt

The second is the velocity damper of Faverjon and Tournassoud, "A local based approach for path planning of manipulators
with a high number of degrees of freedom", 1987, for what is left after the tick: the speed of approach is then at most
`gain` times that, which goes as exp(-gain t): the margin is reached, asymptotically and without chatter. Such an
approach slows down by at most `gain` times its speed, so with limited accelerations the gain is at most the smallest
ratio of acceleration to speed that a joint has: then no joint has to brake harder than it can, however dt varies.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import OptionError, listed, shown
from maira_qp.problem.limits.joint import KEPT, Limit, Tick
from maira_qp.problem.limits.placement import braking_gain
from maira_qp.problem.pose import as_place
from maira_qp.robots.collision.levers import levers
from maira_qp.robots.collision.link_shapes import link_shapes
from maira_qp.robots.collision.pairs import NamePair, always_near, movable_pairs, named_pairs, srdf_pairs, without
from maira_qp.robots.collision.scene import Contacts, Part, Scene, parts_of
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

ALLOWED = ("adjacent", "sampled")
DIFFERENCE = 1e-4
"""Step [rad or m] of differences of gradients, which are known to the tolerance of distances."""
ACTIVE_WITHIN = 1e-6
"""How near to the margin a pair counts as standing on it [m]."""


class Contact(NamedTuple):
    """Two shapes and how far they are apart."""

    first: str
    """Name of the link."""
    second: str
    """Name of the other link, or of the obstacle."""
    distance: float
    """[m], negative by the depth where they overlap"""
    first_point: np.ndarray
    """Point (3,) [m] of the first that is nearest to the second, in the base."""
    second_point: np.ndarray
    """Point (3,) [m] of the second that is nearest to the first, in the base."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CollisionLimit(Limit):
    """`distance >= margin` for all pairs of shapes of the robot and of obstacles that can move against each other.

    The robot's shapes are the `<collision>` elements of its URDF, with convex hulls for meshes.
    """

    obstacles: Any = ()
    """What stands around the robot, in the base: `Sphere`, `Ellipsoid`, `Box`, `Capsule`, `Cylinder`, `Mesh`, in a
    sequence or by their names, {"ball": mq.Sphere(0.1)}. One that has a name may stand elsewhere in a call; one of a
    mapping that is made without a pose needs one in each call."""
    margin: float = 0.01
    """Distance that every pair keeps [m]; >= 0"""
    influence: float = 0.1
    """Pairs with `distance >= margin + influence` are left out [m]; > 0. In a tick that limited accelerations call
    for more, it is made larger."""
    self_collision: bool = True
    """Whether the robot's links are kept from each other."""
    allowed: Any = "adjacent"
    """Which links may touch. "adjacent": those joined by a joint, links fixed to each other counted as one, and those
    that the robot's SRDF or MJCF allows to. In addition to these "sampled": those nearer than the margin in 95 % of
    1,000 random configurations, always the same ones; the path of an SRDF file: those of its `<disable_collisions>`; or
    pairs of names of links and obstacles."""
    meshes: Sequence[str | os.PathLike[str]] = ()
    """Directories in which `package://` and relative mesh files are sought, then above the robot's URDF file."""
    missing: Literal["error", "ignore"] = "error"
    """What happens if a mesh of the robot is not found: an `OptionError`, or it is left out with a warning."""
    name: str | None = None
    """What calls call it by; None: "collision_limit"."""
    gain: float = 10.0
    """After a tick, a pair approaches at no more than `gain (distance - margin)` [1/s]; > 0. Less where accelerations
    are limited."""
    _scene: Scene | None = field(default=None, repr=False)
    _braking: _Braking | None = field(default=None, repr=False)
    _unplaced: frozenset[str] = field(default=frozenset(), repr=False)

    def __post_init__(self) -> None:
        for name in ("margin", "influence", "gain"):
            value = float(real_array(getattr(self, name), (), f"{name} of a CollisionLimit", OptionError))
            if not (value > 0 or (name == "margin" and value == 0)):
                raise OptionError(f"{name} of a CollisionLimit must be positive, got {value}")
            object.__setattr__(self, name, value)
        given = self.obstacles
        object.__setattr__(self, "obstacles", _named_obstacles(given))
        if isinstance(given, Mapping):
            unplaced = frozenset(name for name, one in given.items() if not one.has_own_pose)
            object.__setattr__(self, "_unplaced", unplaced)
        object.__setattr__(self, "meshes", _directories(self.meshes))
        if not isinstance(self.missing, str) or self.missing not in ("error", "ignore"):
            raise OptionError(f"missing of a CollisionLimit; {listed(('error', 'ignore'), self.missing)}")
        is_path = isinstance(self.allowed, (str, os.PathLike)) and self.allowed not in ALLOWED
        if is_path and not os.path.isfile(self.allowed):
            raise OptionError(
                f"allowed={shown(os.fspath(self.allowed))} is neither {' nor '.join(map(repr, ALLOWED))} nor an SRDF "
                "file; or it is a sequence of pairs of names"
            )

    def of(self, robot: Robot) -> CollisionLimit:
        """The same with all shapes loaded and all pairs chosen.

        Raises `OptionError` for a robot without collision shapes, a mesh that is not found, or a name that no link and
        no obstacle has; `RobotError` for shapes or an SRDF file that make no sense.
        """
        own = parts_of(robot, link_shapes(robot, self.meshes, self.missing == "ignore"))
        if not own:
            raise OptionError(f"{robot.name} has no collision shapes: no link of its URDF has a <collision>")
        parts = [*own, *self._obstacle_parts(robot)]
        pairs = movable_pairs(robot, parts, len(own), bool(self.self_collision))
        scene = Scene(robot, parts, pairs)
        allowed = self._allowed_pairs(scene, len(own)) | robot.may_touch
        if allowed:
            scene = Scene(robot, parts, without(pairs, parts, allowed))
        return replace(self, _scene=scene, _braking=_braking(robot, own, self.gain))

    @property
    def obstacle_names(self) -> tuple[str, ...]:
        """What a call may move."""
        return tuple(obstacle.name for obstacle in self.obstacles)

    def with_value(self, value: Any) -> CollisionLimit:
        """The limit with obstacles elsewhere: {name: pose}. Raises `OptionError`, `PoseError`."""
        if not isinstance(value, Mapping):
            raise OptionError(f"obstacles of a call must be a mapping {{name: pose}}, got {shown(value)}")
        return self.with_obstacles(value)

    def with_obstacles(self, poses: Mapping[str, Any]) -> CollisionLimit:
        """The limit, made for a robot, with obstacles elsewhere: poses by their names. Nothing is loaded again.

        Raises `OptionError` for a name that no obstacle has, and `PoseError`.
        """
        names = self.obstacle_names
        places, obstacles = {}, list(self.obstacles)
        own = len(self.scene.parts) - len(names)
        for name, pose in poses.items():
            if name not in names:
                raise OptionError(f"no obstacle {shown(name)}; {listed(names, name)}")
            k = names.index(name)
            places[own + k] = as_place(pose, f"pose of {name!r}")
            obstacles[k] = _changed(obstacles[k], pose=places[own + k])
        unplaced = self._unplaced.difference(poses) if self._unplaced else self._unplaced
        return _changed(self, obstacles=tuple(obstacles), _scene=self.scene.moved(places), _unplaced=unplaced)

    def check_placed(self) -> None:
        """Check that each obstacle has a pose, its own or that of a call. Raises `OptionError`."""
        if self._unplaced:
            names = [name for name in self.obstacle_names if name in self._unplaced]
            poses = ", ".join(f'"{name}": pose' for name in names)
            lacking = ", ".join(map(repr, names))
            raise OptionError(f"no pose of {lacking}: give obstacles={{{poses}}} in the call, or make it with a pose")

    def _contacts(self, q: np.ndarray, within: float) -> Contacts:
        """Of the pairs nearer than a distance [m]. Raises `OptionError` for an obstacle without a pose."""
        self.check_placed()
        return self.scene.contacts(q, within)

    def _obstacle_parts(self, robot: Robot) -> list[Part]:
        """The obstacles as parts that do not move."""
        for obstacle in self.obstacles:
            if obstacle.name in robot.frames:
                raise OptionError(f"an obstacle has the name of a link of {robot.name}: {shown(obstacle.name)}")
        try:
            loaded = [obstacle.loaded(self.meshes) for obstacle in self.obstacles]
        except FileNotFoundError as reason:
            raise OptionError(f"an obstacle: {reason}") from None
        return [Part(obstacle.name, 0, obstacle.pose, obstacle) for obstacle in loaded]

    def _allowed_pairs(self, scene: Scene, own: int) -> set[NamePair]:
        """The pairs that may touch beside the adjacent ones."""
        known = set(scene.robot.semantics.touching)
        if isinstance(self.allowed, str) and self.allowed in ALLOWED:
            return known | (always_near(scene, own, self.margin) if self.allowed == "sampled" else set())
        if isinstance(self.allowed, (str, os.PathLike)):
            return known | srdf_pairs(self.allowed, scene.robot.frames)
        names = (*scene.robot.frames, *(obstacle.name for obstacle in self.obstacles))
        return known | named_pairs(self.allowed, names)

    @property
    def scene(self) -> Scene:
        """The robot among the obstacles, once the limit is made for a robot."""
        assert self._scene is not None
        return self._scene

    def rows(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray] | None:
        """One row `G dq <= h` for each pair nearer than `margin + influence`: G (m, n) minus the distance's gradient.

        In a tick, where accelerations are limited, also for those farther away that the arm could come near too fast.
        """
        if tick is None:
            contacts = self._near(at)
            return (-contacts.gradients, contacts.distances - self.margin) if len(contacts.pairs) else None
        assert self._braking is not None
        influence = self._braking.influence(self.influence, tick)
        contacts = self._contacts(at.q, self.margin + influence)
        if not len(contacts.pairs):
            return None
        left, G = contacts.distances - self.margin, -contacts.gradients
        h = np.where(left > 0, self._braking.share(tick.dt) * left, left)
        if influence == self.influence:
            return G, h
        kept = (left < self.influence) | (h <= self._braking.most(G, tick))
        return (G[kept], h[kept]) if kept.any() else None

    def violation(self, at: Configuration) -> float:
        """By how much the nearest pair is nearer than the margin [m]; >= 0."""
        distances = self._near(at).distances
        return max(0.0, self.margin - float(distances.min())) if distances.size else 0.0

    def violations(self, at: Configuration) -> np.ndarray:
        """By how much each pair of the scene is nearer than the margin (k,) [m]; >= 0."""
        missing, contacts = np.zeros(len(self.scene.pairs)), self._near(at)
        missing[contacts.pairs] = np.maximum(self.margin - contacts.distances, 0.0)
        return missing

    def residual(self, at: Configuration) -> tuple[float, float]:
        """What is missing of the margin, the norm over all pairs [m]."""
        return float(np.linalg.norm(np.minimum(self._near(at).distances - self.margin, 0.0))), 0.0

    def parts(self, at: Configuration) -> np.ndarray:
        """The pair of each row (m,)."""
        return self._near(at).pairs

    def broken(self, at: Configuration, name: str) -> dict[str, float]:
        """The pairs nearer than the margin, such as "link2 - ball", and what is missing of it [m]."""
        found: dict[str, float] = {}
        contacts = self._near(at)
        for pair, missing in zip(contacts.pairs, self.margin - contacts.distances, strict=True):
            if missing > KEPT:
                names = " - ".join(self._names(pair))
                found[names] = max(float(missing), found.get(names, 0.0))
        return found

    def active(self, at: Configuration) -> list[str]:
        """The pairs at the margin, or nearer, such as "link2 - ball"."""
        return list(dict.fromkeys(name for name, _ in self.touching(at)[0]))

    def touching(self, at: Configuration) -> tuple[list[tuple[str, float]], np.ndarray]:
        """Names and distances [m] of the k pairs at the margin, or nearer, and the gradients (k, n) of the distances.

        Links of several shapes may make several pairs of one name.
        """
        contacts = self._near(at)
        rows = np.flatnonzero(contacts.distances <= self.margin + ACTIVE_WITHIN)
        named = [(" - ".join(self._names(contacts.pairs[i])), float(contacts.distances[i])) for i in rows]
        return named, contacts.gradients[rows].reshape(-1, at.n)

    def distance(self, at: Configuration) -> float:
        """The smallest distance of all pairs [m], negative by the depth where shapes overlap; inf if there are none."""
        nearest = self.nearest(at)
        return math.inf if nearest is None else nearest.distance

    def nearest(self, at: Configuration) -> Contact | None:
        """The pair with the smallest distance; None if there are no pairs."""
        contacts = self._near(at)
        if not len(contacts.pairs):
            contacts = self._contacts(at.q, math.inf)
            if not len(contacts.pairs):
                return None
        index = int(contacts.distances.argmin())
        distance, point = float(contacts.distances[index]), contacts.points[index].copy()
        across = point + distance * contacts.normals[index]
        return Contact(*self._names(contacts.pairs[index]), distance, point, across)

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """By differences of the gradients of pairs that count; zero for a pair that is far at a step to either side."""
        counted = np.flatnonzero(multipliers)
        if not len(counted):
            return np.zeros((at.n, at.n))
        pairs, weights = self._near(at).pairs[counted], multipliers[counted]
        C = np.zeros((at.n, at.n))
        for j, dq in enumerate(DIFFERENCE * np.eye(at.n)):
            for sign in (1.0, -1.0):
                beside = self._contacts(at.q + sign * dq, self.margin + self.influence)
                row = dict(zip(beside.pairs.tolist(), beside.gradients, strict=True))
                for pair, weight in zip(pairs.tolist(), weights, strict=True):
                    if pair in row:
                        C[:, j] -= sign * weight * row[pair] / (2 * DIFFERENCE)
        return 0.5 * (C + C.T)

    def _near(self, at: Configuration) -> Contacts:
        """The pairs nearer than `margin + influence`, kept for a configuration."""
        kept = at.kept.get((id(self.scene), "near"))
        if kept is None:
            found = self._contacts(at.q, self.margin + self.influence)
            kept = at.kept[id(self.scene), "near"] = (self.scene, found)
        return kept[1]

    def _names(self, pair: int) -> tuple[str, str]:
        first, second = self.scene.pairs[pair]
        return self.scene.parts[first].name, self.scene.parts[second].name


# Braking


@dataclass(frozen=True)
class _Braking:
    """How hard a robot can brake, as far as it concerns collision."""

    gain: float
    """Of the velocity damper [1/s]"""
    levers: np.ndarray
    """(n,) No point of the robot moves faster than `levers @ |v|` [m/rad, or 1]."""
    acceleration: np.ndarray
    """(n,) [rad/s^2 or m/s^2]"""

    def share(self, dt: float) -> float:
        """Of what is left to the margin, the share that may be gone in a tick of dt [s]."""
        return self.gain * dt / (1 + self.gain * dt)

    def most(self, G: np.ndarray, tick: Tick) -> np.ndarray:
        """The largest `G dq` (m,) that the accelerations allow in a tick, for G (m, n)."""
        change = self.acceleration * tick.dt**2
        return G @ tick.velocity * tick.dt + (np.abs(G) * np.minimum(change, 1e9)).sum(axis=1)

    def influence(self, least: float, tick: Tick) -> float:
        """At what distance from the margin pairs begin to count [m]: `least`, doubled until the damper lets all go.

        Two parts of the robot approach no faster than the joints between them move either of them.
        """
        if not np.isfinite(self.acceleration).any():
            return least
        change = np.where(np.isfinite(self.acceleration), self.acceleration, 0.0) * tick.dt
        needed = float(self.levers @ (np.abs(tick.velocity) + change)) / self.gain
        return least * 2.0 ** max(0, math.ceil(math.log2(needed / least))) if needed > least else least


def _braking(robot: Robot, own: Sequence[Part], gain: float) -> _Braking:
    """Of a robot with these parts."""
    return _Braking(braking_gain(robot, gain), levers(robot.model, own), robot.acceleration_limit)


# What callers give


def _named_obstacles(obstacles: Any) -> tuple[Shape, ...]:
    """The obstacles, each with a name of its own. Raises `OptionError`."""
    if isinstance(obstacles, Mapping):
        obstacles = [
            replace(one, name=name) if isinstance(one, Shape) else one  # type: ignore[type-var]
            for name, one in obstacles.items()
        ]
    if isinstance(obstacles, Shape) or not is_listing(obstacles):
        raise OptionError(
            f"obstacles of a CollisionLimit must be shapes in a sequence, or by their names, not {shown(obstacles)}"
        )
    obstacles = tuple(obstacles)
    named: list[Shape] = []
    for count, obstacle in enumerate(obstacles, start=1):
        if not isinstance(obstacle, Shape):
            kinds = "Sphere, Ellipsoid, Box, Capsule, Cylinder or Mesh"
            raise OptionError(f"obstacle {count} is not a {kinds}: {shown(obstacle)}")
        named.append(obstacle if obstacle.name else replace(obstacle, name=f"obstacle{count}"))  # type: ignore[type-var]
    names = [obstacle.name for obstacle in named]
    for name in names:
        if names.count(name) > 1:
            raise OptionError(f"two obstacles have the name {shown(name)}")
    return tuple(named)


def _changed(one: Any, **values: Any) -> Any:
    """The same with some fields, which are not checked again; faster than `copy`."""
    other = object.__new__(type(one))
    other.__dict__.update(one.__dict__, **values)
    return other


def _directories(directories: Any) -> tuple[str, ...]:
    """The directories as text. Raises `OptionError` for what is no directory."""
    if isinstance(directories, (str, os.PathLike)):
        directories = (directories,)
    try:
        folders = tuple(os.fspath(folder) for folder in directories)
    except TypeError:
        raise OptionError(f"meshes must be a sequence of directories, not {shown(directories)}") from None
    for folder in folders:
        if not os.path.isdir(folder):
            raise OptionError(f"meshes: {shown(folder)} is not a directory")
    return folders
