"""Batches whose calls differ in more than the poses of their targets: the engines of each call, and their answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing
from maira_qp.errors import MairaError, OptionError
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import Targets, is_pose
from maira_qp.solvers.dispatch import Engines

Values = Mapping[str, Any]
"""Data of parts of a problem by their keys"""

OfCalls = Engines | list[Engines]
"""The engines of all calls, or of each"""


def of_calls(engines: Engines, targets: Any, weights: Any = None) -> tuple[OfCalls, Any, int]:
    """The engines of N calls, the poses that they need, unchecked, and N, 0 where these say so.

    Targets as for `Solver.solve_batch`. Raises `PoseError`, `FrameError`, `OptionError`.
    """
    problem = engines.problem
    if isinstance(targets, Mapping):
        poses, own, common = _of_mapping(problem, targets)
    elif isinstance(targets, Sequence) and targets and all(isinstance(one, Mapping) for one in targets):
        poses, own, common = _of_list(problem, targets)
    else:
        of_all, poses = engines.of_call(targets, weights)
        return of_all, poses, len(targets) if poses is None and is_listing(targets) else 0
    if common or weights:
        engines = engines.with_problem(problem.of_call(common, weights)[0])
    if not any(own):
        return engines, poses, len(own) or next(iter(_counts(poses).values()), 0)
    return [engines.with_problem(engines.problem.with_values(each)) for each in own], poses, len(own)


def about_targets(of_each: OfCalls, asked: Targets) -> OfCalls:
    """The engines of N calls with hard limits about the target of each, where some need it."""
    if not len(asked) or not first_of(of_each).problem.limits_need_targets:
        return of_each
    each = [of_each] * len(asked) if isinstance(of_each, Engines) else of_each
    return [one.about(asked[i]) for i, one in enumerate(each)]


def first_of(of_each: OfCalls) -> Engines:
    """The engines of the first call."""
    return of_each if isinstance(of_each, Engines) else of_each[0]


def _of_list(problem: Problem, targets: Sequence[Values]) -> tuple[Any, list[dict[str, Any]], Values]:
    """N mappings as poses and N mappings of other data."""
    both = [problem.split(each) for each in targets]
    return [poses for poses, _ in both], [values for _, values in both], {}


def _of_mapping(problem: Problem, targets: Values) -> tuple[Any, list[dict[str, Any]], Values]:
    """A mapping as poses, N mappings of data that belong to each call, and data that are the same for all."""
    poses, values = problem.split(targets)
    common, each = {}, {}
    for key, value in values.items():
        try:
            problem.with_values({key: value})
            common[key] = value
        except MairaError:  # one for each call, then, if any of them can be
            if not is_listing(value) or (len(value) and not any(_is_datum(problem, key, one) for one in value)):
                raise
            each[key] = value
    counts = {key: len(value) for key, value in each.items()}
    several = _counts(poses)
    counts.update(several if each else {})
    if each and not several:
        count = next(iter(counts.values()))
        poses = {key: [value] * count for key, value in poses.items()}
    if len(set(counts.values())) > 1:
        raise OptionError(f"as many values for each, not {', '.join(f'{n} for {key!r}' for key, n in counts.items())}")
    count = next(iter(counts.values()), 0)
    return poses, [{key: value[i] for key, value in each.items()} for i in range(count)], common


def _counts(poses: Mapping[str, Any]) -> dict[str, int]:
    """How many poses there are for the keys that have more than a single one for all."""
    return {key: len(value) for key, value in poses.items() if is_listing(value) and not is_pose(value)}


def _is_datum(problem: Problem, key: str, value: Any) -> bool:
    """Whether the part of this key takes a value."""
    try:
        problem.with_values({key: value})
    except MairaError:
        return False
    return True


def targets_of(problem: Problem, poses: Any, count: int) -> Targets:
    """The poses of N calls, checked, those left out of tasks that are switched off. Raises `PoseError`."""
    keys = problem.target_keys
    if not keys and count:
        return Targets(keys, np.empty((count, 0, 12)), np.zeros(count))
    if isinstance(poses, Sequence) and poses and all(isinstance(one, Mapping) for one in poses):
        return problem.targets([{key: value for key, value in each.items() if key in keys} for each in poses])
    if isinstance(poses, Mapping):
        poses = {key: value for key, value in poses.items() if key in keys}
    return problem.targets(poses)
