"""What the solver is made for: the robot, how its redundancy is used, what stands around it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import numpy as np

from maira_qp.apps.viewer.answers import Fitted, Job, fitted, options_for
from maira_qp.apps.viewer.drawing.surroundings import (
    Clearance,
    Overlap,
    clearances,
    overlaps,
    self_collision_limit,
    too_near,
)
from maira_qp.errors import MairaError, OptionError
from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.objectives import Posture
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver

Method = Literal["strict", "weighted", "none"]
METHODS: tuple[Method, ...] = ("strict", "weighted", "none")
LOOKS_EVERY = 6
"""Ticks from one look for self-collisions to the next, which takes large robots some milliseconds."""


class Workplace:
    """A robot among obstacles. Solvers for other obstacles are made by jobs."""

    def __init__(self, robot: Robot, directories: Sequence[str]) -> None:
        """With nothing around it; meshes are sought in `directories`."""
        self.robot, self.directories = robot, tuple(directories)
        self.method: Method = "strict"
        self.weight = 1e-3
        self.obstacles: dict[str, Shape] = {}
        self.is_avoiding = False
        self.plain = Solver(robot, options=options_for(robot))
        """Knows of no obstacles."""
        self.solver = Solver(robot, redundancy=self.redundancy, options=options_for(robot))
        self.limit: CollisionLimit | None = None
        self.notice = ""
        self.clearances: list[Clearance] = []
        self.overlaps: list[Overlap] = []
        self.is_rebuilding = False
        """A solver for what is there now is asked for, and not there yet."""
        self._is_stale = False
        self._fitted_to = self.obstacles, self.is_avoiding
        self._against_itself: CollisionLimit | None = None
        self._is_against_itself_known = False
        self._looked: tuple[int, np.ndarray | None] = 0, None

    @property
    def redundancy(self) -> Strict | Weighted | None:
        """As the solver takes it."""
        if self.method == "none":
            return None
        return Strict(Posture()) if self.method == "strict" else Weighted(Posture(), self.weight)

    @property
    def is_fitted(self) -> bool:
        """The solver and the distances are those for the obstacles as they are."""
        obstacles, is_avoiding = self._fitted_to
        return obstacles is self.obstacles and is_avoiding == self.is_avoiding

    @property
    def too_near(self) -> list[Clearance]:
        """Obstacles inside the margin of the arm, if it is to keep clear of them; the nearest first."""
        return too_near(self.clearances) if self.is_avoiding else []

    def use(self, method: Method, weight: float) -> None:
        """How the redundancy is used, and the weight of "weighted". Raises `OptionError`."""
        if method not in METHODS:
            raise OptionError(f"the redundancy is used as {', '.join(METHODS)}, not {method!r}")
        Weighted(Posture(), weight)  # is it a weight?
        self.method, self.weight = method, weight
        self._rebuild()

    def put(self, shape: Shape) -> None:
        """An obstacle is there, or another than it was, by its name."""
        self.obstacles = {**self.obstacles, shape.name: shape}
        self._rebuild()

    def remove(self, name: str | None) -> None:
        """An obstacle is taken away; None: all. Raises `OptionError` for a name that none has."""
        if name is not None and name not in self.obstacles:
            raise OptionError(f"no obstacle is named {name!r}")
        self.obstacles = {} if name is None else {key: one for key, one in self.obstacles.items() if key != name}
        self._rebuild()

    def avoid(self, wanted: bool) -> None:
        """Whether the arm keeps clear of the obstacles."""
        self.is_avoiding = wanted
        self._rebuild()

    def look(self, q: np.ndarray) -> None:
        """How far the arm at q (n,) is from the obstacles, and where it runs into itself."""
        self.clearances = [] if self.limit is None else clearances(self.limit, q)
        ticks, last = self._looked
        if self._against_itself is not None and ticks >= LOOKS_EVERY and last is not q:
            self.overlaps, self._looked = overlaps(self._against_itself, q), (0, q)
        else:
            self._looked = ticks + 1, last

    def next_job(self, used: Callable[[], None]) -> Job | None:
        """A solver for what is there now, if another is needed; `used` is called when it is in use."""
        if not self._is_stale:
            return None
        self._is_stale = False
        given = self.robot, self.redundancy, self.obstacles, self.directories, self.is_avoiding

        def write(answer: Fitted) -> None:
            self._fitted_to = given[2], given[4]
            self.solver, self.limit, self.notice = answer
            self.is_rebuilding = self._is_stale
            used()

        return Job(partial(fitted, *given), write)

    def next_long_job(self) -> Job | None:
        """Which links may run into each other, once."""
        if self._is_against_itself_known:
            return None
        self._is_against_itself_known = True

        def write(limit: CollisionLimit | None) -> None:
            self._against_itself = limit

        return Job(self._think_of_itself, write)

    def _think_of_itself(self) -> CollisionLimit | None:
        try:
            return self_collision_limit(self.robot, self.directories)
        except MairaError:
            return None  # it has no shapes that could

    def _rebuild(self) -> None:
        self._is_stale = self.is_rebuilding = True
