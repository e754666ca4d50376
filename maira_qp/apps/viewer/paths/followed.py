"""What `track` says of a path, as the viewer shows it pose by pose.

Functions of what they are given, so that they may run in any thread.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from maira_qp.apps.viewer.paths.route import Route
from maira_qp.apps.viewer.saving import content
from maira_qp.errors import MairaError
from maira_qp.results.path_solution import PathFailure, PathSolution
from maira_qp.solvers.solver import Solver


@dataclass(frozen=True, eq=False)
class Followed:
    """A path of at least one pose, and the configurations that were found along it."""

    route: Route
    solution: PathSolution
    seconds: float
    """What it took to find them [s]"""
    proof: str | None = None
    """What proves that it cannot be followed further, in words; empty: no proof was found; None: none was looked for"""

    def __len__(self) -> int:
        return len(self.solution)

    @cached_property
    def failures(self) -> dict[int, tuple[PathFailure, ...]]:
        """What fails at which pose, in the order of the poses."""
        found = defaultdict[int, tuple[PathFailure, ...]](tuple)
        for failure in self.solution.failures:
            found[failure.index] += (failure,)
        return dict(found)

    @cached_property
    def lost(self) -> np.ndarray:
        """(N - 1,) of bool: the segments on which the arm leaves the path, or which lead to a pose it does not reach
        or from one"""
        reached = self.solution.success
        lost = ~(reached[:-1] & reached[1:])
        lost[self.solution.breaks - 1] = True
        return lost

    def next_failure(self, index: int) -> int:
        """The next pose behind `index` where poses are no longer reached, or before which the path is left.

        Counted round and round; `index` if the path is followed whole.
        """
        missed = ~self.solution.success
        begins = np.flatnonzero(missed & ~np.concatenate([[False], missed[:-1]]))
        indices = np.union1d(begins, self.solution.breaks).tolist()
        return next((k for k in indices if k > index), indices[0] if indices else index)

    def content(self, suffix: str) -> bytes:
        """A file of it, see `saving.content`, with the column `reached`, 1 or 0. Raises `OptionError`."""
        path = self.solution
        return content(suffix, {"reached": path.success.astype(int)}, self.route.poses, path.q, path.joint_names)


class Unwanted(Exception):
    """Nobody waits for the answer any more."""


def followed(
    solver: Solver, route: Route, q0: np.ndarray | None, is_wanted: Callable[[], bool]
) -> Followed | str | None:
    """Follow a path of at least one pose, from a start near q0 (n,) or from any; why it cannot be asked for, if so.

    None, soon, once `is_wanted` is False.
    """

    def leave(_: int, __: int) -> None:
        if not is_wanted():
            raise Unwanted

    begin = time.perf_counter()
    try:
        solution = solver.track(route.poses, q0, loop=route.is_closed, progress=leave)
    except Unwanted:
        return None
    except MairaError as reason:
        return str(reason)
    return Followed(route, solution, time.perf_counter() - begin)


def proved(path: Followed) -> Followed:
    """With its proof, if there is one: this takes up to some seconds."""
    proof = path.solution.proof
    return replace(path, proof="" if proof is None else proof.words)


@dataclass(frozen=True, eq=False)
class Station:
    """Where on a path the arm is shown."""

    path: Followed
    index: int
    is_playing: bool


class PathView(NamedTuple):
    """What there is to see of a path after a tick."""

    route: Route
    followed: Followed | None
    """None: it is not known how the path is followed"""
    station: Station | None
    """None: the arm is moved by something else"""
    is_sought: bool
    """It is being followed"""
    is_explained: bool
    """A proof is being looked for"""
    notice: str
    """Why it cannot be followed at all, if so"""
