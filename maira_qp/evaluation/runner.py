"""Asks every method about every target and writes down what the judge says.

For each stratum and target all methods come in turn, so that whatever slows the machine slows them alike. Only the call
of the method is timed; the judge works after the clock has stopped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.evaluation.contestant import Contestant
from maira_qp.evaluation.judge import Judge
from maira_qp.evaluation.methods import methods
from maira_qp.evaluation.records import RowFile
from maira_qp.evaluation.report import versions
from maira_qp.evaluation.settings import Settings
from maira_qp.evaluation.targets import Target, TargetSource
from maira_qp.problem.options import Options
from maira_qp.robots.model.robot import Robot
from maira_qp.version import __version__

SLACK = 1e-9
"""A claim is false only if it is off by more than this [m, rad]: solver and judge round differently."""

Key = tuple[str, int, str, str]


@dataclass(frozen=True)
class Plan:
    """Everything that a run needs, made and checked before it starts."""

    robot: Robot
    settings: Settings
    options: Options
    judge: Judge
    source: TargetSource
    methods: list[Contestant]
    strata: list[str]
    notes: list[str]
    """What is left out, and why."""

    @property
    def rows(self) -> int:
        """How many rows a whole run has."""
        return len(self.methods) * len(self.strata) * self.settings.targets


def plan(robot: Robot, settings: Settings, options: Options) -> Plan:
    """The plan of a benchmark. Raises `OptionError` if nothing is left of it, `BackendError` for an unknown backend."""
    judge = judge_of(robot)
    source = TargetSource(robot, judge)
    chosen, notes = methods(robot, settings.methods, settings.backends, settings.weight, options)
    reasons = {stratum: source.missing(stratum) for stratum in settings.strata}
    notes += [f"stratum {stratum} is left out: {reason}" for stratum, reason in reasons.items() if reason]
    strata = [stratum for stratum, reason in reasons.items() if reason is None]
    if not chosen or not strata:
        raise OptionError(f"there is nothing to run: {'; '.join(notes)}")
    return Plan(robot, settings, options, judge, source, chosen, strata, notes)


def judge_of(robot: Robot) -> Judge:
    """A judge for a robot, from its URDF text alone."""
    return Judge(robot.urdf, robot.base, robot.tips, robot.joint_names)


def run(plan: Plan, path: str | Path, progress: Callable[[int], None] | None = None) -> list[dict[str, Any]]:
    """All rows of a plan, those that the file already holds taken as they are, the rest measured and appended.

    `progress` is told how many rows there are after each. Raises `OptionError` if the file is of other settings.
    """
    with RowFile(path, fingerprint(plan)) as file:
        if progress is not None:
            progress(len(file.rows))
        for row in measure(plan, done={key_of(row) for row in file.rows}):
            file.append(row)
            if progress is not None:
                progress(len(file.rows))
        return file.rows


def fingerprint(plan: Plan) -> dict[str, Any]:
    """What the rows depend on: settings, options, robot, and the versions of the packages that compute them."""
    robot = plan.robot
    identity = f"{robot.urdf}\n{robot.base}\n{robot.tip}"
    return {
        **asdict(plan.settings),
        "options": asdict(plan.options),
        "robot": robot.name,
        "robot_sha256": sha256(identity.encode()).hexdigest(),
        "versions": {
            "maira_qp": __version__,
            **versions("numpy", "pin", "qpsolvers", *map(_package, plan.settings.backends)),
        },
    }


def _package(backend: str) -> str:
    return {"proxqp": "proxsuite", "compiled": "numba"}.get(backend, backend)


def key_of(row: dict[str, Any]) -> Key:
    """What makes a row one of its kind."""
    return (row["stratum"], row["index"], row["method"], row["backend"])


def measure(plan: Plan, done: Collection[Key] = ()) -> Iterator[dict[str, Any]]:
    """The rows of a plan that are not done yet, one at a time."""
    warmed: set[int] = set()
    for stratum in plan.strata:
        for index in range(plan.settings.targets):
            pending = [m for m in plan.methods if (stratum, index, m.name, m.settings) not in done]
            if not pending:
                continue
            target = plan.source.target(stratum, index, plan.settings.seed)
            for method in pending:
                if id(method) not in warmed:
                    row_of(plan, target, method)  # the first call also imports and allocates; it is not timed
                    warmed.add(id(method))
                yield row_of(plan, target, method)


def row_of(plan: Plan, target: Target, method: Contestant) -> dict[str, Any]:
    """One method's answer to one target, timed and judged."""
    assert method.solve is not None
    asked, start = method.native(target), target.start
    begin = time.perf_counter()
    result = method.solve(asked, start)
    seconds = time.perf_counter() - begin
    answer = method.answer(result)
    settings, options, robot = plan.settings, plan.options, plan.robot
    strict = (options.position_tolerance, options.orientation_tolerance)
    verdict = plan.judge.verdict(answer.q, target.pose)
    return {
        "stratum": target.stratum,
        "index": target.index,
        "method": method.name,
        "backend": method.settings,
        "reachable": target.reachable,
        "claimed": bool(answer.claimed),
        "confirmed": bool(verdict.within(strict[0] + SLACK, strict[1] + SLACK)),
        "strict": bool(verdict.within(*strict)),
        "loose": bool(verdict.within(settings.loose_position, settings.loose_orientation)),
        "status": answer.status,
        "position_error": float(verdict.position_error),
        "orientation_error": float(verdict.orientation_error),
        "limit_violation": float(verdict.limit_violation),
        "iterations": int(answer.iterations),
        "restarts": int(answer.restarts),
        "condition_number": robot.condition_number(answer.q),
        "posture_cost": float(0.5 * np.sum((answer.q - robot.middle) ** 2)),
        "time": seconds,
        "q": answer.q.tolist(),
    }
