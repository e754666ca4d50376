"""What is known of a path while it is made, followed and explained: each is asked for, found by a job, and forgotten
once the path is another."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from maira_qp.apps.viewer.answers import Job
from maira_qp.apps.viewer.paths.followed import Followed, PathView, Station, followed, proved
from maira_qp.apps.viewer.paths.route import Route
from maira_qp.errors import OptionError
from maira_qp.solvers.solver import Solver


class Sought(NamedTuple):
    """A path that is to be followed."""

    route: Route
    start: np.ndarray | None
    """(n,) near which it begins; None: anywhere"""
    found: Callable[[Followed], None]
    """Is called with the answer"""


class Pursuit:
    """A path, and how the arm follows it."""

    def __init__(self) -> None:
        """No path."""
        self.route = Route()
        self.followed: Followed | None = None
        self._sought: Sought | None = None
        self._is_explained = False
        self._is_waiting = False
        self._notice = ""

    def lay(self, route: Route) -> None:
        """The path is another. Raises `OptionError` if it is too long."""
        len(route)
        self.forget()
        self.route = route

    def seek(self, start: np.ndarray | None, found: Callable[[Followed], None]) -> None:
        """It is to be followed from near a start (n,), or from any. Raises `OptionError` without a path."""
        if not len(self.route):
            raise OptionError("there is no path yet: add poses, or take a circle or a file")
        self.forget()
        self._sought, self._is_waiting = Sought(self.route, start, found), True

    def explain(self) -> None:
        """A proof is wanted that it cannot be followed further. Raises `OptionError` for a path that does not fail."""
        if self.followed is None or self.followed.solution:
            raise OptionError("there is no path that fails")
        if self.followed.proof is None and not self._is_explained:
            self._is_explained = self._is_waiting = True

    def forget(self) -> None:
        """What was found is no more, and what is being found is not waited for: the path or the problem is another."""
        self.followed, self._sought, self._notice = None, None, ""
        self._is_explained = self._is_waiting = False

    def cancel(self) -> None:
        """It is not to be followed any more. Raises `OptionError` unless it is being followed."""
        if self._sought is None:
            raise OptionError("no path is being followed")
        self.forget()
        self._notice = "Cancelled: how the path is followed is not known."

    def next_job(self, solver: Solver) -> Job | None:
        """What is to be found out, once."""
        if not self._is_waiting:
            return None
        self._is_waiting = False
        if (sought := self._sought) is not None:
            think = partial(followed, solver, sought.route, sought.start, lambda: self._sought is sought)
            return Job(think, partial(self._use, sought))
        assert self.followed is not None
        return Job(partial(proved, self.followed), self._use_proof)

    def view(self, station: Station | None) -> PathView:
        """What there is to see, the arm being at a pose of the path or elsewhere."""
        return PathView(self.route, self.followed, station, self._sought is not None, self._is_explained, self._notice)

    def _use(self, sought: Sought, answer: Followed | str | None) -> None:
        if sought is not self._sought or answer is None:
            return
        self._sought = None
        if isinstance(answer, str):
            self._notice = answer
        else:
            self.followed = answer
            sought.found(answer)

    def _use_proof(self, answer: Followed) -> None:
        if self.followed is not None and answer.solution is self.followed.solution:
            self.followed, self._is_explained = answer, False
