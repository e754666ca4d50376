"""Why a solve ended as it did: what is left of the pose error, and which limits of the joints stand in the way.

At a stationary point the gradient of what was minimised is held up by limits alone; what a limit holds up, its
multiplier, is what the cost would fall by, per rad or m, if the limit gave way (Nocedal and Wright, "Numerical
Optimization", 2006, section 12.8). That is the first order, so each limit is then released in earnest, and the target
solved again from where the solve had ended.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.problem.costs import multipliers
from maira_qp.problem.objectives import Posture
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.frame import FrameTask, frame_error
from maira_qp.robots.configuration import Configuration
from maira_qp.solvers.priorities import Priorities, Targets
from maira_qp.solvers.setting import Setting
from maira_qp.solvers.solution import ACTIVE_WITHIN, Solution, Status

if TYPE_CHECKING:
    from maira_qp.solvers.proofs import Proof

OTHERS_COUNT = 1e-3
"""What the motion of joints whose limits hold counts against that of a released one, as it goes no further than it
must."""

MOSTLY = 0.9
"""Share of a direction along an axis, from which on the axis stands for it."""

NEGLIGIBLE = 1e-9
"""Errors below this [m or rad] are not worth a word."""


@dataclass(frozen=True)
class ActiveLimit:
    """A limit that a joint stands on, and what it costs."""

    name: str
    """Such as "joint4 upper" """
    multiplier: float
    """What the minimised cost would fall by [per rad or m]; 0 where the limit holds nothing up"""
    position: float
    """What releasing it alone takes off the position error [m]"""
    orientation: float
    """And off the orientation error [rad]"""
    further: float | None
    """How much further [rad or m] the joint has to go to reach the target, if that limit alone gives way; else None"""
    unit: str
    """Of `further`: "rad" or "m" """


@dataclass(frozen=True, eq=False)
class Explanation:
    """Why a solve ended as it did; `str()` says it in words."""

    status: Status
    position_error: float
    """What is left [m]"""
    orientation_error: float
    """[rad]"""
    limits: tuple[ActiveLimit, ...]
    """The joint limits that the answer stands on, the most costly first"""
    blocked: np.ndarray
    """What the limits that cost something keep of the way to the target together (6,): position [m] and rotation [rad]
    in the axes of the tool; zero where the task is none of a pose"""
    is_reached_without: bool
    """Without these limits the target would be reached"""
    proof: Proof | None
    """What proves `UNREACHABLE`"""
    is_compromise: bool
    """`Weighted` holds the tool off a pose that can be reached"""

    def as_dict(self) -> dict[str, Any]:
        """As plain values, the words with them."""
        return {
            "text": str(self),
            "limits": [asdict(limit) for limit in self.limits],
            "blocked": self.blocked,
            "is_reached_without": self.is_reached_without,
            "is_compromise": self.is_compromise,
            "proof": None if self.proof is None else self.proof.words,
        }

    @property
    def blocking(self) -> tuple[str, ...]:
        """Names of the limits that cost something."""
        return tuple(limit.name for limit in self.limits if limit.multiplier > 0)

    def __str__(self) -> str:
        return " ".join(_sentences(self))


def explain(priorities: Priorities, targets: Targets, solution: Solution, setting: Setting) -> Explanation:
    """Of a solution of these tasks toward these targets."""
    robot, question = setting.robot, _Question(priorities, targets, setting, solution.q)
    force = _force(priorities, targets, robot.at(solution.q), solution)
    least = 10 * setting.options.stationarity_tolerance
    limits = []
    for end, stands, forces in (
        ("lower", solution.q <= robot.lower + ACTIVE_WITHIN, force),
        ("upper", solution.q >= robot.upper - ACTIVE_WITHIN, -force),
    ):
        for i in np.flatnonzero(stands):
            multiplier = float(forces[i]) if forces[i] > least else 0.0
            name, unit = f"{robot.joint_names[i]} {end}", "m" if robot.slides[i] else "rad"
            position = orientation = 0.0
            further = None
            if multiplier > 0 and not solution.success:
                free = question.solved_without([name])
                position = solution.position_error - free.position_error
                orientation = solution.orientation_error - free.orientation_error
                further = float(abs(free.q[i] - solution.q[i])) if free.success else None
            limits.append(ActiveLimit(name, multiplier, position, orientation, further, unit))
    limits.sort(key=lambda limit: -limit.multiplier)
    blocking = [limit.name for limit in limits if limit.multiplier > 0]
    blocked, without = np.zeros(6), False
    if blocking and not solution.success:
        free = question.solved_without(blocking)
        blocked, without = question.way_to(free.q), free.success
    weighs = isinstance(priorities.redundancy, Weighted) and not solution.success
    return Explanation(
        status=solution.status,
        position_error=solution.position_error,
        orientation_error=solution.orientation_error,
        limits=tuple(limits),
        blocked=blocked,
        is_reached_without=without,
        proof=solution.proof,
        is_compromise=weighs and question.solved_without([]).success,
    )


def _force(priorities: Priorities, targets: Targets, at: Configuration, solution: Solution) -> np.ndarray:
    """The gradient (n,) of what was minimised that limits hold up: at a lower one it is positive."""
    cost, wish = priorities.costs(targets)
    if isinstance(wish, Weighted):
        return cost.level(at).c + wish.weight * wish.objective.gradient(at)
    if not solution.success:
        return cost.level(at).c
    if wish is None:
        return np.zeros(at.n)
    robot, gradient, rows = priorities.robot, wish.objectives[0].gradient(at), cost.rows(at)[0]
    held = (at.q <= robot.lower + ACTIVE_WITHIN) | (at.q >= robot.upper - ACTIVE_WITHIN)
    return gradient + rows.T @ multipliers(rows, gradient, held)


@dataclass(frozen=True)
class _Question:
    """What was asked, to be asked again from where the solve had ended."""

    priorities: Priorities
    targets: Targets
    setting: Setting
    q: np.ndarray

    def solved_without(self, limits: list[str]) -> Solution:
        """The tasks solved from q (n,), without these limits; past them the joints go no further than they must."""
        from maira_qp.solvers.solver import Solver  # which knows this module

        robot, held = self.setting.robot, np.full(len(self.q), OTHERS_COUNT)
        for name in limits:
            held[robot.joint_names.index(name.rsplit(" ", 1)[0])] = 1.0
        solver = Solver(
            robot.released(limits) if limits else robot,
            task=self.priorities.first,
            limits=self.setting.further,
            redundancy=Strict(Posture(self.q, held)),
            backend=self.setting.backend,
            options=replace(self.setting.options, max_restarts=0, deadline=None),
        )
        return solver.solve(dict(self.targets) or None, q0=self.q)

    def way_to(self, q: np.ndarray) -> np.ndarray:
        """From the answer to q (n,), the frame's displacement (6,) in its own axes, for a task of a pose; else zero."""
        task, robot = self.priorities.first[0], self.setting.robot
        if len(self.priorities.first) > 1 or not isinstance(task, FrameTask):
            return np.zeros(6)
        here = robot.forward(self.q, task.frame)
        way = frame_error(here, robot.forward(q, task.frame)).reshape(2, 3) @ here.rotation
        return (way * [[task.kept[:3].any()], [task.kept[3:].any()]]).ravel()


def _sentences(why: Explanation) -> Iterator[str]:
    """The explanation in words."""
    if why.status is Status.CONVERGED:
        yield "The target is reached."
    elif why.is_compromise:
        yield f"The target can be reached, but the weight of the posture holds the tool {_off(why)} off it."
    elif why.status is Status.UNREACHABLE:
        proof = "" if why.proof is None else f": {why.proof.words}"
        yield f"The target is proved to be out of reach{proof}; the answer is {_off(why)} away."
    elif why.status is Status.NEAREST:
        yield f"The answer is {_off(why)} away from the target, and nothing near it is closer."
    else:
        yield f"The answer is {_off(why)} away from the target; the budget was spent before a nearest point was found."
    if why.status is Status.CONVERGED or why.is_compromise:
        for limit in why.limits:
            cost = f", which costs {limit.multiplier:.3g} per {limit.unit}" if limit.multiplier > 0 else ""
            yield f"It stands on {limit.name}{cost}."
        return
    if not why.blocking:
        yield "No joint limit holds it back."
        return
    names = " and ".join(why.blocking)
    if np.linalg.norm(why.blocked) > 0:
        yield f"{names} {'block' if len(why.blocking) > 1 else 'blocks'} {_way(why.blocked)}."
    else:
        yield f"{names} {'stand' if len(why.blocking) > 1 else 'stands'} in the way."
    alone = [limit for limit in why.limits if limit.further is not None]
    if alone:
        least = min(alone, key=lambda limit: limit.further or 0.0)
        joint, end = least.name.rsplit(" ", 1)
        further = _amount(least.further or 0.0, least.unit)
        yield f"With {joint} {further} beyond its {end} limit the target would be reached."
    elif why.is_reached_without:
        yield "Without these limits the target would be reached."
    else:
        yield "Without these limits it would not be reached either."


def _off(why: Explanation) -> str:
    """The errors that are left, as far as they are errors."""
    parts = [
        _amount(value, unit)
        for value, unit in ((why.position_error, "m"), (why.orientation_error, "rad"))
        if value > NEGLIGIBLE
    ]
    return " and ".join(parts) or "nearly nothing"


def _way(displacement: np.ndarray) -> str:
    """A displacement (6,) in the axes of the tool."""
    parts = []
    for vector, unit, word in ((displacement[:3], "m", "along"), (displacement[3:], "rad", "about")):
        size = float(np.linalg.norm(vector))
        if size > NEGLIGIBLE:
            axis = int(np.abs(vector).argmax())
            share = vector / size
            name = f"tool {'-' if share[axis] < 0 else ''}{'xyz'[axis]}"
            if abs(share[axis]) < MOSTLY:
                name = f"({', '.join(f'{x + 0.0:.2f}' for x in share.round(2))}) of the tool"
            parts.append(f"{_amount(size, unit)} {word} {name}")
    return " and ".join(parts) or "nearly nothing"


def _amount(value: float, unit: str) -> str:
    """A length or an angle in the unit that people use."""
    if unit == "rad":
        return f"{math.degrees(value):.3g} degrees"
    return f"{value:.3g} m" if value >= 1 else f"{1e3 * value:.3g} mm"
