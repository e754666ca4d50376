"""The compiled search: which attempt counts depends on its number alone, and a target on nothing but itself."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from support.compiled_problems import (
    arm,
    compiled,
    configurations,
    few,
    first_in_plain_python,
    nine_robots,
    reachable_rows,
    row_of,
    search_for,
)
from support.seeds import features_of, nearest_of, poses_of, start_of

import maira_qp as mq
from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.kinematics.unwrap import unwind
from maira_qp.kernels.layout import Joint, Outcome, Setting
from maira_qp.kernels.search.multi_start import FARTHEST_START, SEARCH, TOO_FAR, admit
from maira_qp.kernels.search.random_numbers import state_of, stream_of
from maira_qp.kernels.search.seeds import CORNER
from maira_qp.kernels.spatial.pose_validation import FINE, NOT_FINITE, NOT_RIGID, pose_row
from maira_qp.orientation import ORTHONORMAL_WITHIN, pose_error
from maira_qp.problem.targets import pose_of
from maira_qp.solvers.compiled.engine import Compiled

FAR = row_of(mq.pose([2.5, 0.1, 0.4]))
"""Out of MAIRA's reach."""


def hard_rows(robot: mq.Robot, rng, count: int) -> np.ndarray:
    """Poses (count, 12) that take attempts: every joint near a limit; one in six is out of reach."""
    lower, upper = robot.drawn_range
    q = np.where(rng.random((count, robot.n)) < 0.5, lower, upper)
    q = np.clip(q + 1e-3 * (upper - lower) * rng.normal(size=q.shape), lower, upper)
    rows = np.array([row_of(robot.forward(each)) for each in q])
    rows[::6, 9:] *= 3.0
    return rows


def attempts_of(problem: Compiled, row: np.ndarray, count: int, stream: int = 0, starts=None):
    """q (count, n) and outcomes (count, 7) of attempts at a target, each made alone."""
    stream = np.array([stream], dtype=np.uint64)
    parts = [search_for(problem, row[None], starts, stream, first=k, last=k) for k in range(count)]
    return np.concatenate([q for q, _ in parts]), np.concatenate([outcome for _, outcome in parts])


def best_of(q: np.ndarray, outcomes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a search should say, by its attempts one by one: the first that arrives, else the best of all."""
    arrived = np.flatnonzero(outcomes[:, Outcome.SUCCESS] > 0)
    last = arrived[0] if len(arrived) else len(q) - 1
    best = arrived[0] if len(arrived) else outcomes[:, Outcome.FINAL_COST].argmin()
    expected = outcomes[best].copy()
    expected[Outcome.ATTEMPT], expected[Outcome.SPENT] = last, outcomes[: last + 1, Outcome.SPENT].sum()
    return q[best], expected


@pytest.mark.parametrize("name", first_in_plain_python("tiago", "maira", "panda"))
@pytest.mark.parametrize("with_start", [False, True])
def test_a_search_is_its_attempts_in_order_until_one_arrives(name, with_start, rng):
    """The first that arrives, or else the best of all; the iterations are those of the attempts that count."""
    robot = arm(name)
    count, counted = 14, []
    problem = compiled(robot, max_restarts=count - 1, max_iterations=8)  # few: so that it takes attempts
    for row in np.concatenate([hard_rows(robot, rng, few(20)), reachable_rows(robot, rng, few(20))]):
        starts = configurations(robot, rng, 1) if with_start else None
        stream = rng.integers(0, 2**64 - 1, dtype=np.uint64)
        q, outcome = search_for(problem, row[None], starts, np.array([stream]))
        expected_q, expected = best_of(*attempts_of(problem, row, count, stream, starts))
        np.testing.assert_array_equal(q[0], expected_q)
        np.testing.assert_array_equal(outcome[0], expected)
        counted.append(int(outcome[0, Outcome.ATTEMPT]) if outcome[0, Outcome.SUCCESS] else -1)
    assert -1 in counted
    assert len(set(counted)) >= min(5, len(counted))


def test_a_search_cut_into_calls_is_the_same_search(rng):
    """Wherever it is cut: the first part that arrives, or the best of all parts."""
    robot, count = arm("maira"), 14
    problem = compiled(robot, max_restarts=count - 1)
    for row in [FAR, *hard_rows(robot, rng, few(12))]:
        whole_q, whole = search_for(problem, row[None])
        cuts = np.unique(np.r_[0, rng.integers(1, count, 4), count])
        spent, best = 0.0, None
        for first, after in pairwise(cuts):
            q, outcome = search_for(problem, row[None], first=int(first), last=int(after) - 1)
            spent += outcome[0, Outcome.SPENT]
            if (
                best is None
                or outcome[0, Outcome.SUCCESS]
                or outcome[0, Outcome.FINAL_COST] < best[1][Outcome.FINAL_COST]
            ):
                best = q[0], outcome[0]
            if outcome[0, Outcome.SUCCESS]:
                break
        np.testing.assert_array_equal(best[0], whole_q[0])
        assert spent == whole[0, Outcome.SPENT]
        assert outcome[0, Outcome.ATTEMPT] == whole[0, Outcome.ATTEMPT]
        told = [Outcome.SUCCESS, Outcome.FINAL_COST, Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR]
        np.testing.assert_array_equal(best[1][told], whole[0, told])


@pytest.mark.parametrize("name", first_in_plain_python("pr2_arm", "maira", "irb140"))
@pytest.mark.parametrize("shuffled", [False, True])
def test_a_batch_is_its_targets_one_by_one(name, shuffled, rng):
    """To the bit, in any order and any company, easy targets and hard ones, reachable or not, NaN among them."""
    robot, count = arm(name), few(60)
    problem = compiled(robot, max_restarts=12)
    rows = np.concatenate([reachable_rows(robot, rng, count), hard_rows(robot, rng, count // 3 + 1)])
    rows[1] = np.nan
    starts = configurations(robot, rng, len(rows)) if name == "pr2_arm" else None
    streams = rng.integers(0, 2**64 - 1, len(rows), dtype=np.uint64)

    def solved(picked):
        begin = None if starts is None else starts[picked]
        return np.hstack(search_for(problem, rows[picked], begin, streams[picked], shuffled))

    expected = solved(np.arange(len(rows)))
    for i in range(len(rows)):
        np.testing.assert_array_equal(solved(np.array([i])), expected[[i]])
    for size in (2, 5, LANES, LANES + 1, len(rows)):
        picked = rng.integers(0, len(rows), size)
        np.testing.assert_array_equal(solved(picked), expected[picked])


def test_an_earlier_attempt_that_arrives_goes_before_a_later_one_that_arrives_sooner(rng):
    """Attempt 1 begins at a configuration that solves it; attempt 0 needs iterations, and counts."""
    robot, seen = arm("maira"), 0
    for _ in range(few(20)):
        solution, start = configurations(robot, rng, 2)
        row = row_of(robot.forward(solution))
        library = configurations(robot, rng, LANES)
        library[rng.integers(LANES)] = solution
        problem = compiled(robot, max_restarts=3)
        features = features_of(problem, poses_of(problem, library))
        problem = replace(problem, seeds=SimpleNamespace(configurations=library, features=features))
        (first_q, second_q), outcomes = attempts_of(problem, row, 2, starts=start[None])
        assert outcomes[1, Outcome.SUCCESS] == 1
        assert outcomes[1, Outcome.SPENT] == 0
        np.testing.assert_array_equal(second_q, solution)
        q, outcome = search_for(problem, row[None], start[None])
        if outcomes[0, Outcome.SUCCESS]:
            seen += 1
            assert outcomes[0, Outcome.SPENT] > 0
            np.testing.assert_array_equal(q[0], first_q)
            np.testing.assert_array_equal(outcome[0], outcomes[0])
        else:
            np.testing.assert_array_equal(q[0], solution)
            assert outcome[0, Outcome.ATTEMPT] == 1
            assert outcome[0, Outcome.SPENT] == outcomes[0, Outcome.SPENT]
    assert seen > 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_target_that_is_not_finite_costs_only_itself(value, rng):
    robot = arm("maira")
    problem, rows = compiled(robot, max_restarts=5), reachable_rows(robot, rng, 20)
    expected = np.hstack(search_for(problem, rows, streams=np.zeros(20, np.uint64)))
    spoilt = rng.permutation(20)[:12]
    for k, i in enumerate(spoilt):
        rows[i, k] = value
    q, outcome = search_for(problem, rows, streams=np.zeros(20, np.uint64))
    fine = np.setdiff1d(np.arange(20), spoilt)
    np.testing.assert_array_equal(np.hstack([q, outcome])[fine], expected[fine])
    assert (q[spoilt] == 0.0).all()
    assert (outcome[spoilt][:, [Outcome.SUCCESS, Outcome.ATTEMPT, Outcome.SPENT]] == 0.0).all()
    assert np.isnan(outcome[spoilt][:, [Outcome.FINAL_COST, Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR]]).all()


def test_where_zero_is_not_within_the_limits_a_target_with_nan_is_left_as_near_as_they_allow():
    robot = arm("panda")  # its fourth joint is always bent
    q, _ = search_for(compiled(robot), np.full((1, 12), np.nan))
    np.testing.assert_array_equal(q[0], np.clip(np.zeros(7), robot.lower, robot.upper))


def test_a_target_too_far_to_measure_is_told_so_whatever_ran_before(rng):
    """1e200 m: finite, its cost is not. Of attempts that are equal the first counts."""
    robot = arm("maira")
    problem, rows = compiled(robot, max_restarts=9), reachable_rows(robot, rng, 3 * LANES)
    rows[::3, 9] = 1e200
    q, outcome = search_for(problem, rows)
    assert (outcome[::3, Outcome.FINAL_COST] == np.inf).all()
    assert (outcome[::3, Outcome.POSITION_ERROR] == np.inf).all()
    assert (outcome[::3, Outcome.SUCCESS] == 0.0).all()
    assert (np.delete(outcome, np.s_[::3], axis=0)[:, Outcome.SUCCESS] == 1.0).all()
    first, _ = search_for(problem, rows, last=0)
    np.testing.assert_array_equal(q[::3], first[::3])
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()


@nine_robots
def test_results_are_within_the_limits_to_the_bit_and_what_is_said_of_them_is_true(name, rng):
    """By Pinocchio: for easy targets and hard ones, out of reach, from starts on the limits and outside."""
    robot = arm(name)
    problem = compiled(robot, max_restarts=15)
    rows = np.concatenate([reachable_rows(robot, rng, few(40)), hard_rows(robot, rng, few(40))])
    starts = configurations(robot, rng, len(rows))
    starts[1::3] = np.where(rng.random((len(rows), robot.n)) < 0.5, *robot.drawn_range)[1::3]
    starts[2::3] *= 5.0
    q, outcome = search_for(problem, rows, starts)
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()
    outside = (starts < robot.lower) | (starts > robot.upper)
    np.testing.assert_array_equal(outcome[:, Outcome.MOVED] > 0, outside.any(axis=1))
    for i, row in enumerate(rows):
        e = pose_error(robot.forward(q[i]), pose_of(row))
        position, orientation = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
        assert outcome[i, Outcome.POSITION_ERROR] == pytest.approx(position, rel=1e-6, abs=1e-13)
        assert outcome[i, Outcome.ORIENTATION_ERROR] == pytest.approx(orientation, rel=1e-6, abs=1e-13)
        weighted = np.linalg.norm(problem.settings[[0, 0, 0, 1, 1, 1]] * e)
        assert np.sqrt(2 * outcome[i, Outcome.FINAL_COST]) == pytest.approx(weighted, rel=1e-6, abs=1e-12)
        assert (outcome[i, Outcome.SUCCESS] > 0) == (
            max(outcome[i, [Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR]]) <= 1e-6
        )
    assert outcome[: few(40), Outcome.SUCCESS].mean() > 0.9


@pytest.mark.parametrize("task", [mq.PositionTask(), mq.OrientationTask()], ids=lambda task: type(task).__name__)
def test_a_part_of_the_pose_that_is_not_asked_for_has_no_error(task, rng):
    robot = arm("panda")
    _, outcome = search_for(compiled(robot, task), reachable_rows(robot, rng, 20))
    free, asked = Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR
    if isinstance(task, mq.PositionTask):
        free, asked = asked, free
    assert (outcome[:, Outcome.SUCCESS] == 1.0).all()
    assert (outcome[:, free] == 0.0).all()
    assert (outcome[:, asked] <= 1e-6).all()
    assert (outcome[:, asked] > 0.0).any()


@pytest.mark.parametrize("count", [0, 1, 3, LANES, LANES + 1, 3 * LANES])
@pytest.mark.parametrize("restarts", [0, 1, 12])
def test_any_number_of_targets_and_of_attempts_will_do(count, restarts, rng):
    """Also none at all, and a single attempt each."""
    robot = arm("maira")
    rows = np.concatenate([reachable_rows(robot, rng, 3 * LANES)[:count], FAR[None]])[-max(count, 0) :][:count]
    problem = compiled(robot, max_restarts=restarts)
    q, outcome = search_for(problem, rows)
    assert q.shape == (count, 7)
    assert np.isfinite(q).all()
    assert (outcome[:, Outcome.ATTEMPT] <= restarts).all()
    if count:
        assert outcome[-1].tolist()[:2] == [0.0, float(restarts)]
        assert outcome[-1, Outcome.SPENT] <= 30 * (restarts + 1)
        assert (outcome[:-1, Outcome.SUCCESS] == 1.0).all() or restarts < 12


def test_it_works_in_memory_that_holds_anything_and_writes_nowhere_else(rng):
    """Numbers beside it are as they were, and what it held before does not matter."""
    robot = arm("maira")
    problem, rows = compiled(robot, max_restarts=12), hard_rows(robot, rng, few(20))
    expected = np.hstack(search_for(problem, rows))
    sizes = SEARCH.sizes(7, 13)
    for rubbish in (np.nan, 1.0, -np.inf, 1e308):
        for offset in rng.permutation(LANES)[: few(8)]:
            floats, integers = np.full(sizes[0] + 40, rubbish), np.full(sizes[1] + 40, int(rng.integers(-9, 9)))
            memory, before = (floats[offset : offset + sizes[0]], integers[20 : 20 + sizes[1]]), integers.copy()
            found = np.hstack(search_for(problem, rows, memory=memory))
            np.testing.assert_array_equal(found, expected)
            np.testing.assert_array_equal(floats[:offset], np.full(offset, rubbish))
            np.testing.assert_array_equal(floats[offset + sizes[0] :], np.full(40 - offset, rubbish))
            np.testing.assert_array_equal(np.delete(integers, np.s_[20:-20]), np.delete(before, np.s_[20:-20]))


def starts_of(problem: Compiled, row, count: int, stream: int, starts=None, shuffled: bool = False) -> np.ndarray:
    """Where the attempts 0, 1, ... (count, n) begin: a search without iterations ends there."""
    settings = problem.settings.copy()
    settings[Setting.MAX_ITERATIONS] = 0
    still, streams = replace(problem, settings=settings), np.array([stream], dtype=np.uint64)
    return np.concatenate([search_for(still, row[None], starts, streams, shuffled, k, k)[0] for k in range(count)])


@pytest.mark.parametrize("name", ["maira", "ur5_limited"])
@pytest.mark.parametrize("with_start", [False, True])
def test_attempts_begin_at_the_start_then_at_the_nearest_of_the_library_then_at_random(name, with_start, rng):
    """In this order; one random one in four is a corner of the limits."""
    robot = arm(name)
    problem = compiled(robot)
    for row in reachable_rows(robot, rng, few(10)):
        stream, count = int(rng.integers(0, 2**64 - 1, dtype=np.uint64)), 2 * LANES + 3
        starts = configurations(robot, rng, 1) if with_start else None
        found = starts_of(problem, row, count, stream, starts)
        expected = [] if starts is None else [starts[0]]
        expected += list(problem.seeds.configurations[nearest_of(problem, problem.seeds.features, row)])
        for attempt in range(len(expected), count):
            state = int(state_of(np.uint64(stream), attempt))
            expected.append(start_of(problem, row, problem.candidates, attempt % CORNER == 1, state))
        expected = np.array(expected)
        if starts is not None:
            unwind(problem.chain, starts, np.ones(count), expected)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
        if with_start:
            continue  # a corner may be turned off it
        corners = (
            (found[:, :, None] == problem.chain[:-1, [Joint.START_LOWER, Joint.START_UPPER]]).any(axis=2).all(axis=1)
        )
        assert corners[LANES:].sum() == sum(k % CORNER == 1 for k in range(LANES, count))


def test_shuffled_starts_differ_by_seed_and_are_the_nearest_ones_in_another_order(rng):
    problem = compiled(arm("maira"))
    row = reachable_rows(problem.robot, rng, 1)[0]
    streams = [int(stream_of(row, np.array([seed, 0], dtype=np.uint64))) for seed in range(40)]
    firsts = {tuple(starts_of(problem, row, 1, stream, shuffled=True)[0]) for stream in streams}
    plain = starts_of(problem, row, LANES, 5)
    assert firsts == set(map(tuple, plain))
    for stream in streams[: few(40)]:
        shuffled = starts_of(problem, row, LANES, stream, shuffled=True)
        np.testing.assert_array_equal(np.unique(shuffled, axis=0), np.unique(plain, axis=0))


def test_a_start_outside_the_limits_is_moved_onto_them(rng):
    problem = compiled(arm("maira"))
    row, start = reachable_rows(problem.robot, rng, 1)[0], np.array([[9.0, -9.0, 0.1, 9.0, 0.2, 0.3, -9.0]])
    found = starts_of(problem, row, 1, 5, start)
    np.testing.assert_array_equal(found, np.clip(start, problem.robot.lower, problem.robot.upper))


@pytest.mark.parametrize("seed", [(0, 0), (5, 0), (0, 5)])
def test_a_target_is_admitted_as_a_row_with_its_stream(seed, rng):
    """Rounded matrices are made exact."""
    words = np.array(seed, dtype=np.uint64)
    for T in [pose_of(row).homogeneous for row in reachable_rows(arm("panda"), rng, 20)]:
        T[:3, :3] += 1e-7 * rng.normal(size=(3, 3))
        fault, row, stream = admitted(T, rng.normal(size=rng.choice([0, 7])), words)
        expected = np.empty(12)
        assert fault == pose_row(T, ORTHONORMAL_WITHIN, expected) == FINE
        np.testing.assert_array_equal(row, expected)
        assert stream == stream_of(expected, words)


def test_what_cannot_be_searched_for_or_from_is_told(rng):
    words = np.zeros(2, dtype=np.uint64)
    T = pose_of(reachable_rows(arm("maira"), rng, 1)[0]).homogeneous
    spoilt, bent = T.copy(), T.copy()
    spoilt[1, 2], bent[0, :3] = np.nan, 1.1 * bent[0, :3]
    assert admitted(spoilt, np.empty(0), words)[0] == NOT_FINITE
    assert admitted(bent, np.empty(0), words)[0] == NOT_RIGID
    for value in (np.nan, np.inf, 1.001 * FARTHEST_START, -2 * FARTHEST_START):
        q0 = np.zeros(7)
        q0[rng.integers(7)] = value
        assert admitted(T, q0, words)[0] == TOO_FAR
    assert admitted(T, np.full(7, FARTHEST_START), words)[0] == FINE


def admitted(T: np.ndarray, q0: np.ndarray, seed: np.ndarray) -> tuple[int, np.ndarray, int]:
    """What `admit` returns, the row (12,) and the stream."""
    row, stream = np.full((1, 12), np.nan), np.zeros(1, dtype=np.uint64)
    fault = admit(T, ORTHONORMAL_WITHIN, 10.0, q0.reshape(-1, 7), seed, row, stream)
    return fault, row[0], int(stream[0])
