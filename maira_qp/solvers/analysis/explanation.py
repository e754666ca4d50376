"""Why a solve ended as it did: what is left of the pose error, and which limits of joints, which bodies are in the way.

At a stationary point the gradient of what was minimised is held up by limits alone; what a limit holds up, its
multiplier, is what the cost would fall by, per rad or m, if the limit gave way (Nocedal and Wright, "Numerical
Optimization", 2006, section 12.8). That is the first order, so the limits are then released in earnest, and the target
solved again: from where the solve had ended, and then from as many starts as any solve. That a target is not reached
without its limits is called a fact only where it is proved; else it is told how many starts did not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import nnls

from maira_qp.arrays import plain
from maira_qp.display import Card, Shown
from maira_qp.problem.levels import Priorities, Targets
from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.costs import multipliers
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.frame import FrameTask, frame_error
from maira_qp.results.solution import ACTIVE_WITHIN, Solution, Status
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.reference.context import Setting

if TYPE_CHECKING:
    from maira_qp.solvers.certificates import Proof

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
    """How far beyond the limit [rad or m] the joint reaches the target, if that limit alone gives way; else None"""
    unit: str
    """Of `further`: "rad" or "m" """


@dataclass(frozen=True)
class ActivePair:
    """Two bodies that a `CollisionLimit` holds apart, and what it costs."""

    name: str
    """Such as "link5 - ball" """
    distance: float
    """[m]"""
    multiplier: float
    """What the minimised cost would fall by [per m] if they could be nearer; 0 where they are in nobody's way"""


@dataclass(frozen=True)
class BrokenLimit:
    """A limit beside those of the joints that no configuration was found to keep."""

    name: str
    """Such as "link5 - table" """
    amount: float
    """By how much the answer breaks it"""
    unit: str
    """Of `amount`: "m" for a pair of bodies, whose margin is meant; "" where it is the limit's own"""


@dataclass(frozen=True, eq=False, repr=False)
class Explanation(Shown):
    """Why a solve ended as it did; `str()` says it in words."""

    status: Status
    position_error: float
    """What is left [m]"""
    orientation_error: float
    """[rad]"""
    limits: tuple[ActiveLimit, ...]
    """The joint limits that the answer stands on, the most costly first"""
    pairs: tuple[ActivePair, ...]
    """The pairs of bodies as near as their margin allows, the most costly first"""
    blocked: np.ndarray
    """What the limits that cost something keep of the way to the target together (6,): position [m] and rotation [rad]
    in the axes of the tool; zero where the task is none of a pose"""
    is_reached_without: bool
    """Without these limits the target would be reached"""
    is_unreachable_without: bool
    """It is proved that without these limits the target would not be reached either"""
    starts_without: int
    """From so many starts the target was looked for without these limits"""
    is_reached_within: bool
    """On the way the target was found to be within the limits: the solve had missed it"""
    proof: Proof | None
    """What proves `UNREACHABLE`"""
    is_compromise: bool
    """`Weighted` holds the tool off a pose that can be reached"""
    hints: tuple[str, ...] = ()
    """What looks like another unit than metres and radians, a sentence each"""
    broken: tuple[BrokenLimit, ...] = ()
    """What the answer breaks, the worst first: for `LIMITS_BROKEN`"""

    def as_dict(self) -> dict[str, Any]:
        """As plain values that `json.dumps` takes, the words with them; None for numbers that are not known."""
        values = {
            "text": str(self),
            "status": self.status,
            "position_error": self.position_error,
            "orientation_error": self.orientation_error,
            "limits": [asdict(limit) for limit in self.limits],
            "pairs": [asdict(pair) for pair in self.pairs],
            "broken": [asdict(limit) for limit in self.broken],
            "blocked": self.blocked,
            "is_reached_without": self.is_reached_without,
            "is_unreachable_without": self.is_unreachable_without,
            "starts_without": self.starts_without,
            "is_reached_within": self.is_reached_within,
            "is_compromise": self.is_compromise,
            "hints": self.hints,
            "proof": None if self.proof is None else self.proof.words,
        }
        return plain(values)

    @property
    def blocking(self) -> tuple[str, ...]:
        """Names of the limits and pairs that cost something."""
        return tuple(one.name for one in (*self.limits, *self.pairs) if one.multiplier > 0)

    def __str__(self) -> str:
        return " ".join(_sentences(self))

    def _card(self) -> Card:
        return Card(
            title=f"Explanation: {self.status.name}",
            words=str(self),
            headings=("limit", "multiplier", "its release gains [m]", "[rad]", "reached with it so much further"),
            rows=[
                (
                    limit.name,
                    f"{limit.multiplier:.3g}",
                    f"{limit.position:.3g}",
                    f"{limit.orientation:.3g}",
                    "" if limit.further is None else f"{limit.further:.3g} {limit.unit}",
                )
                for limit in self.limits
            ]
            + [(pair.name, f"{pair.multiplier:.3g}", "", "", "") for pair in self.pairs],
        )


def explain(priorities: Priorities, targets: Targets, solution: Solution, setting: Setting) -> Explanation:
    """Of a solution of these tasks toward these targets."""
    if solution.status is Status.LIMITS_BROKEN:
        return _of_broken_limits(solution, setting)
    robot, question = setting.robot, _Question(priorities, targets, setting, solution.q)
    force = _force(priorities, targets, robot.at(solution.q), solution)
    least = 10 * setting.options.stationarity_tolerance
    pairs, force = _pairs(priorities, targets, setting, solution, force, least)
    standing = []
    for end, stands, forces in (
        ("lower", solution.q <= robot.lower + ACTIVE_WITHIN, force),
        ("upper", solution.q >= robot.upper - ACTIVE_WITHIN, -force),
    ):
        for i in np.flatnonzero(stands):
            multiplier = float(forces[i]) if forces[i] > least else 0.0
            unit = "m" if robot.slides[i] else "rad"
            standing.append(ActiveLimit(f"{robot.joint_names[i]} {end}", multiplier, 0.0, 0.0, None, unit))
    blocking = [limit.name for limit in standing if limit.multiplier > 0]
    touching = any(pair.multiplier > 0 for pair in pairs)
    blocked, free, alone = np.zeros(6), None, {}
    if not solution.success and (blocking or touching or solution.status is not Status.UNREACHABLE):
        free = question.solved_without(blocking, collisions=not touching)
        blocked = question.way_to(free.q) if blocking or touching else blocked
        # one limit alone is of use only if all together are
        alone = {name: question.solved_without([name], everywhere=free.success) for name in blocking}
    limits = [
        replace(
            limit,
            position=solution.position_error - alone[limit.name].position_error,
            orientation=solution.orientation_error - alone[limit.name].orientation_error,
            further=question.beyond(limit.name, alone[limit.name]),
        )
        if limit.name in alone
        else limit
        for limit in sorted(standing, key=lambda limit: -limit.multiplier)
    ]
    weighs = isinstance(priorities.redundancy, Weighted) and not solution.success
    found = [one for one in (free, *alone.values()) if one is not None and one.success]
    return Explanation(
        status=solution.status,
        position_error=solution.position_error,
        orientation_error=solution.orientation_error,
        limits=tuple(limits),
        pairs=pairs,
        blocked=blocked,
        is_reached_without=free is not None and free.success,
        is_unreachable_without=free is not None and free.status is Status.UNREACHABLE,
        starts_without=0 if free is None else free.restarts + 1,
        is_reached_within=any(question.is_within(one.q) for one in found) and not weighs,
        proof=solution.proof,
        is_compromise=weighs and question.solved_without([]).success,
        hints=solution.hints,
    )


def _of_broken_limits(solution: Solution, setting: Setting) -> Explanation:
    """Where no configuration keeps the limits nothing was minimised that others could hold up."""
    at = setting.robot.at(solution.q)
    collisions = [limit.broken(at, "") for limit in setting.further if isinstance(limit, CollisionLimit)]
    broken = [
        BrokenLimit(name, amount, "m" if any(name in pairs for pairs in collisions) else "")
        for name, amount in solution.broken_limits.items()
    ]
    return Explanation(
        status=solution.status,
        position_error=solution.position_error,
        orientation_error=solution.orientation_error,
        limits=(),
        pairs=(),
        blocked=np.zeros(6),
        is_reached_without=False,
        is_unreachable_without=False,
        starts_without=0,
        is_reached_within=False,
        proof=None,
        is_compromise=False,
        broken=tuple(broken),
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


def _pairs(
    priorities: Priorities, targets: Targets, setting: Setting, solution: Solution, force: np.ndarray, least: float
) -> tuple[tuple[ActivePair, ...], np.ndarray]:
    """The pairs at their margin, the most costly first, and what they leave of the force (n,) to the joint limits.

    The multipliers are those, none negative, of pairs and joint limits together that balance the force best; where the
    target is reached, of what of it is along the self-motion. Of pairs that share a name the sum counts.
    """
    robot, at = setting.robot, setting.robot.at(solution.q)
    found = [limit.touching(at) for limit in setting.further if isinstance(limit, CollisionLimit)]
    named = [pair for pairs, _ in found for pair in pairs]
    if not named:
        return (), force
    gradients = np.vstack([gradients for _, gradients in found])
    lower, upper = at.q <= robot.lower + ACTIVE_WITHIN, at.q >= robot.upper - ACTIVE_WITHIN
    slopes = np.vstack([gradients, np.eye(at.n)[lower], -np.eye(at.n)[upper]])
    kept = np.eye(at.n)
    if solution.success:
        rows = priorities.costs(targets)[0].rows(at)[0]
        kept -= np.linalg.pinv(rows) @ rows
    size = max(1.0, float(np.abs(force).max()))
    held = nnls((slopes @ kept).T, kept @ force / size)[0][: len(named)] * size
    pairs = []
    for name in dict.fromkeys(name for name, _ in named):
        own = [i for i, (other, _) in enumerate(named) if other == name]
        multiplier = float(held[own].sum())
        pairs.append(ActivePair(name, min(named[i][1] for i in own), multiplier if multiplier > least else 0.0))
    return tuple(sorted(pairs, key=lambda pair: -pair.multiplier)), force - held @ gradients


@dataclass(frozen=True)
class _Question:
    """What was asked, to be asked again from where the solve had ended."""

    priorities: Priorities
    targets: Targets
    setting: Setting
    q: np.ndarray

    def solved_without(self, limits: list[str], collisions: bool = True, everywhere: bool = True) -> Solution:
        """The tasks solved from q (n,), without these limits; past them the joints go no further than they must.

        Without `collisions`, bodies may touch as well. `everywhere`: where that fails, from as many starts as a solve.
        """
        from maira_qp.solvers.solver import Solver  # which knows this module

        robot, held = self.setting.robot, np.full(len(self.q), OTHERS_COUNT)
        options = self.setting.options
        restarts = max(options.max_restarts, Options().max_restarts)
        for name in limits:
            held[robot.joint_names.index(name.rsplit(" ", 1)[0])] = 1.0
        solver = Solver(
            robot.released(limits) if limits else robot,
            task=self.priorities.first,
            limits=[one for one in self.setting.further if collisions or not isinstance(one, CollisionLimit)],
            redundancy=Strict(Posture(self.q, held)),
            # in compiled code where that is possible, unless somebody else was asked for
            backend=None if self.setting.backend == Backend("daqp") else self.setting.backend,
            options=replace(options, max_restarts=restarts if everywhere else 0, deadline=None),
        )
        return solver.solve(dict(self.targets) or None, q0=self.q)

    def is_within(self, q: np.ndarray) -> bool:
        """Whether q (n,), which solves the tasks without some limits, keeps all of them."""
        robot, at = self.setting.robot, self.setting.robot.at(q)
        return bool(((robot.lower <= q) & (q <= robot.upper)).all()) and not self.setting.broken(at)

    def beyond(self, limit: str, free: Solution) -> float | None:
        """How far beyond a limit [rad or m] the target is reached without it; None: it is not, or that far not."""
        joint, end = limit.rsplit(" ", 1)
        i, robot = self.setting.robot.joint_names.index(joint), self.setting.robot
        further = float(free.q[i] - robot.upper[i] if end == "upper" else robot.lower[i] - free.q[i])
        return further if free.success and further > 0 else None

    def way_to(self, q: np.ndarray) -> np.ndarray:
        """From the answer to q (n,), the frame's displacement (6,) in its own axes, for a task of a pose; else zero."""
        task, robot = self.priorities.first[0], self.setting.robot
        if len(self.priorities.first) > 1 or not isinstance(task, FrameTask):
            return np.zeros(6)
        here = robot.forward(self.q, task.frame)
        way = frame_error(here, robot.forward(q, task.frame)).reshape(2, 3) @ here.rotation
        return (way * [[task.kept[:3].any()], [task.kept[3:].any()]]).ravel()


def _sentences(why: Explanation) -> Iterator[str]:
    """The explanation in words, and what may be behind it."""
    yield from _reasons(why)
    yield from why.hints


def _reasons(why: Explanation) -> Iterator[str]:
    if why.status is Status.LIMITS_BROKEN:
        broken = " and ".join(f"{one.name} by {_amount(one.amount, one.unit)}" for one in why.broken)
        yield f"No configuration was found that keeps the limits beside those of the joints: this one breaks {broken}."
        yield f"It is {_off(why)} away from the target."
        return
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
        for pair in why.pairs:
            cost = f", which costs {pair.multiplier:.3g} per m" if pair.multiplier > 0 else ""
            yield f"{_apart(pair)}{cost}."
        return
    if why.is_reached_within:
        yield "From another start the target is reached within the limits."
    if not why.blocking:
        yield f"No {'joint ' if not why.pairs else ''}limit holds it back."
        return
    names = " and ".join(why.blocking)
    if np.linalg.norm(why.blocked) > 0:
        yield f"{names} {'block' if len(why.blocking) > 1 else 'blocks'} {_way(why.blocked)}."
    else:
        yield f"{names} {'stand' if len(why.blocking) > 1 else 'stands'} in the way."
    for pair in why.pairs:
        if pair.multiplier > 0:
            yield f"{_apart(pair)}."
    alone = [limit for limit in why.limits if limit.further is not None]
    if alone:
        least = min(alone, key=lambda limit: limit.further or 0.0)
        joint, end = least.name.rsplit(" ", 1)
        further = _amount(least.further or 0.0, least.unit)
        yield f"With {joint} {further} beyond its {end} limit the target would be reached."
    elif why.is_reached_without:
        yield "Without these limits the target would be reached."
    elif why.is_unreachable_without:
        yield "It is proved that without these limits it would not be reached either."
    else:
        starts = "one start" if why.starts_without == 1 else f"any of {why.starts_without} starts"
        yield f"Without these limits it was not reached either, from {starts}."


def _apart(pair: ActivePair) -> str:
    """How far two bodies are apart."""
    if pair.distance < 0:
        return f"{pair.name} overlap by {_amount(-pair.distance, 'm')}"
    return f"{pair.name} are {_amount(pair.distance, 'm')} apart"


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
    """A length or an angle in the unit that people use, or a number of no known unit."""
    if not unit:
        return f"{value:.3g}"
    if unit == "rad":
        return f"{math.degrees(value):.3g} degrees"
    return f"{value:,.0f} m" if value >= 1000 else f"{value:.3g} m" if value >= 1 else f"{1e3 * value:.3g} mm"
