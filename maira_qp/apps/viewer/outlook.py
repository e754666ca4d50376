"""What the solver says of the targets, and another way to them where control ticks get no further."""

from __future__ import annotations

from functools import partial

import numpy as np

from maira_qp.apps.viewer.answers import Job, Verdict, explained, verdict_on
from maira_qp.apps.viewer.drawing.surroundings import Clearance, first_in_the_way
from maira_qp.apps.viewer.motion.arm import Arm
from maira_qp.apps.viewer.motion.motions import Go
from maira_qp.apps.viewer.paths.followed import Station
from maira_qp.apps.viewer.targets import Targets, errors_between, tools_at
from maira_qp.apps.viewer.view import Standing
from maira_qp.apps.viewer.workplace import Workplace
from maira_qp.results.solution import Solution

STUCK = 15
"""Ticks of standing still, after which an arm goes to the solver's answer, if that is nearer to the target."""
AWAY = 1e-4
"""An error [m, or rad] above this is not what is left of a motion that fades away."""


class Outlook:
    """A verdict on the targets, and what follows from it for the arm. Another arm or target makes it out of date."""

    def __init__(self, workplace: Workplace, arm: Arm, targets: Targets) -> None:
        """With a verdict on the targets."""
        self._workplace, self._arm, self._targets = workplace, arm, targets
        self.verdict = verdict_on(workplace.solver, workplace.plain, targets, arm.q)
        self._is_stale = True
        self._tried: Solution | None = None
        self._in_the_way: Clearance | None = None

    def targets_are(self, targets: Targets) -> None:
        """The targets are others."""
        self._targets, self._is_stale = targets, True

    def solver_is_another(self) -> None:
        """Another solver may say something else."""
        self._arm.still, self._is_stale = 0, True

    @property
    def in_the_way(self) -> Clearance | None:
        """What keeps the arm from a better configuration that is known, if something does."""
        return self._in_the_way if self._answer is self._tried else None

    def verdict_job(self) -> Job | None:
        """A verdict, where there is none on the targets as they are."""
        if not self._is_stale:
            return None
        self._is_stale = False
        given = self._workplace.solver, self._workplace.plain, self._targets, self._arm.q
        return Job(partial(verdict_on, *given), self._use)

    def reason_job(self) -> Job | None:
        """Why the targets are not reached."""
        return Job(partial(explained, self.verdict), self._use) if self.verdict.lacks_reason else None

    def other_way_job(self) -> Job | None:
        """Whether the way to an answer that was not tried yet is clear, if it has to be; the arm goes there if so."""
        answer, arm, workplace = self._answer, self._arm, self._workplace
        if arm.motion is not None or answer is None or answer is self._tried:
            return None
        is_stuck = arm.is_following and arm.still >= STUCK and self._is_worse_than(answer)
        if not (is_stuck or (arm.still > 0 and workplace.too_near)):
            return None
        self._tried = answer
        q, limit = arm.q, workplace.limit if workplace.is_avoiding else None

        def write(blocking: Clearance | None) -> None:
            if self._answer is answer and arm.motion is None:
                self._in_the_way = blocking
                if blocking is None:
                    arm.motion, arm.still = Go(arm.robot, answer.q), 0

        return Job(lambda: None if limit is None else first_in_the_way(limit, q, answer.q), write)

    def standing(self, station: Station | None, position: float, orientation: float) -> Standing:
        """Of the arm as it is drawn, perhaps at a pose of a path, with what is left of the errors [m, rad]."""
        options, answer, arm = self._workplace.solver.options, self._answer, self._arm
        if station is not None and station.index in station.path.failures:
            return Standing.OFF_PATH
        if self._workplace.too_near:
            return Standing.TOO_NEAR
        if station is not None:
            return Standing.ON_PATH
        if not self._workplace.is_fitted:
            return Standing.UNKNOWN
        if position <= options.position_tolerance and orientation <= options.orientation_tolerance:
            return Standing.REACHED
        if answer is None:
            return Standing.UNKNOWN
        if answer is self._tried and arm.motion is None and arm.still >= STUCK and self._is_worse_than(answer):
            return Standing.HELD_UP
        return Standing.MOVING if answer.success else Standing.ANSWERED

    @property
    def _answer(self) -> Solution | None:
        """What the solver says of the targets as they are, among the obstacles as they are."""
        if self.verdict.targets is not self._targets or self._is_stale or not self._workplace.is_fitted:
            return None
        return None if self._workplace.is_rebuilding else self.verdict.solution

    def _is_worse_than(self, answer: Solution) -> bool:
        """The tools are farther from the targets than they would be there."""
        position, orientation = self._errors_at(self._arm.q)
        least_position, least_orientation = self._errors_at(answer.q)
        return position > least_position + AWAY or orientation > least_orientation + AWAY

    def _errors_at(self, q: np.ndarray) -> tuple[float, float]:
        return errors_between(tools_at(self._arm.robot, q), self._targets)

    def _use(self, verdict: Verdict) -> None:
        self.verdict = verdict
