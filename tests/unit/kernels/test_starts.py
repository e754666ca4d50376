"""Where descents begin: the nearest of a library by brute force, and the best of random draws by a twin."""

import numpy as np
import pytest
from support.compiled_problems import arm, compiled, descents, few, nine_robots, reachable_rows, row_of, three_tasks
from support.seeds import features_of, nearest_of, poses_of, splitmix, start_of

import maira_qp as mq
from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.layout import Feature, Joint
from maira_qp.kernels.search.random_numbers import state_of, stream_of
from maira_qp.kernels.search.seeds import find_nearest, random_start
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.targets import pose_of
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.solvers.compiled.engine import Compiled
from maira_qp.solvers.compiled.seed_library import MIDDLE_SHARE


def squared_distances(problem: Compiled, poses: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Of each pose (K, 12) twice the pose cost, with the turn measured by |R - R_d|^2 / 2."""
    position, orientation = problem.settings[:2]
    return np.square(position * (poses - row)[:, 9:]).sum(1) + 0.5 * np.square(orientation * (poses - row)[:, :9]).sum(
        1
    )


@three_tasks
@nine_robots
def test_the_nearest_of_each_list_are_found_and_sorted(name, task, rng):
    """By brute force; lists of one, of five and of sixty-four."""
    robot = arm(name)
    problem = compiled(robot, task)
    for blocks in (1, 5, 64):
        poses = reachable_rows(robot, rng, LANES * blocks)
        features = features_of(problem, poses)
        for row in reachable_rows(robot, rng, few(20)):
            distances = squared_distances(problem, poses, row)
            nearest = nearest_of(problem, features, row)
            np.testing.assert_allclose(
                distances[nearest], np.sort(distances.reshape(blocks, LANES).min(axis=0)), rtol=1e-9, atol=1e-11
            )
            assert sorted(nearest % LANES) == list(range(LANES))
            assert distances[nearest[0]] == pytest.approx(distances.min(), rel=1e-9, abs=1e-11)


def test_a_pose_of_the_library_is_nearest_to_itself(rng):
    problem = compiled(arm("panda"))
    poses = reachable_rows(problem.robot, rng, 128)
    features = features_of(problem, poses)
    for k in range(128):
        assert nearest_of(problem, features, poses[k])[0] == k


def test_what_is_found_does_not_depend_on_what_stood_there(rng):
    problem = compiled(arm("maira"))
    row, features = reachable_rows(problem.robot, rng, 1)[0], problem.seeds.features
    expected = nearest_of(problem, features, row)
    for rubbish in (-(2**62), 2**62, 3):
        nearest = np.full(LANES, rubbish)
        find_nearest(problem.settings, features, row, rng.normal(size=(2, LANES)), nearest)
        assert nearest.tolist() == expected.tolist()


@nine_robots
def test_the_library_lies_within_the_limits_and_knows_its_poses(name):
    problem = compiled(arm(name))
    lower, upper = WholeTurns(problem.robot, problem.robot.middle).window
    np.testing.assert_array_equal(
        problem.chain[:-1, [Joint.START_LOWER, Joint.START_UPPER]], np.column_stack([lower, upper])
    )
    corners = (problem.seeds.configurations[:, None] == np.stack([lower, upper])).any(axis=1).all(axis=1)
    assert 2 <= corners.sum() <= 128
    assert (problem.seeds.configurations[~corners] >= lower).all()
    assert (problem.seeds.configurations[~corners] <= upper).all()
    assert len(np.unique(problem.seeds.configurations, axis=0)) > 0.95 * len(
        problem.seeds.configurations
    )  # corners may be in it twice
    poses = poses_of(problem, problem.seeds.configurations)
    np.testing.assert_array_equal(
        features_of(problem, poses)[:, : Feature.SQUARE], problem.seeds.features[:, : Feature.SQUARE]
    )
    poses[:, :9] *= problem.settings[1] * np.sqrt(0.5)
    poses[:, 9:] *= problem.settings[0]
    limited = upper - lower < 2 * np.pi - 1e-9
    off = np.square(problem.seeds.configurations - problem.robot.middle) @ limited
    off = np.minimum(off, off.mean())
    off *= MIDDLE_SHARE * np.square(poses - poses.mean(axis=0)).sum(axis=1).mean() / max(off.mean(), 1e-300)
    expected = np.column_stack([poses, (poses**2).sum(axis=1) + off]).reshape(-1, LANES, Feature.WIDTH).swapaxes(1, 2)
    np.testing.assert_allclose(problem.seeds.features, expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("weights", [1.0, 1e6, [0.0, 0.0, 3.0, 0.0, 0.0, 1.0, 0.0]])
def test_starts_are_near_the_posture_that_is_wished_for(weights, panda, rng):
    """Nearer than without a wish, and none the farther for the size of the weights."""
    posture = mq.Posture(panda.random_configuration(rng), weights).of(panda)
    rows, mean = reachable_rows(panda, rng, 50), []
    for wish in (None, mq.Strict(posture)):
        problem = compiled(panda, mq.PoseTask(), wish)
        starts = np.array(
            [problem.seeds.configurations[nearest_of(problem, problem.seeds.features, row)[0]] for row in rows]
        )
        mean.append((np.square(starts - posture.q_ref) @ posture.weights).mean())
    assert mean[1] < 0.7 * mean[0]


def draws(problem: Compiled, state: int, count: int, at_corner: bool) -> np.ndarray:
    """The configurations (count, n) that a stream's numbers make: the slow twin of what `random_start` looks at."""
    q = np.empty((count, problem.robot.n))
    lower, upper = problem.chain[:-1, Joint.START_LOWER], problem.chain[:-1, Joint.START_UPPER]
    for k in range(count):
        for i in range(problem.robot.n):
            bits, state = splitmix(state)[0], (state + 0x9E3779B97F4A7C15) % 2**64
            share = (bits >> 11) / 2**53
            share = float(share >= 0.5) if at_corner else share
            q[k, i] = (1 - share) * lower[i] + share * upper[i]
    return q


@pytest.mark.parametrize("at_corner", [False, True])
@pytest.mark.parametrize("candidates", [1, 2, 8, 11, 24])
@pytest.mark.parametrize("name", ["maira", "ur5_limited", "tiago"])
def test_a_random_start_is_the_best_of_its_draws(name, candidates, at_corner, rng):
    """The draws those of the twin, the cost that of the task."""
    robot, task = arm(name), mq.PoseTask()
    problem = compiled(robot)
    for row in reachable_rows(robot, rng, few(20)):
        state = int(rng.integers(0, 2**64 - 1, dtype=np.uint64))
        cost = TaskCost((task.of(robot).toward({robot.tip: pose_of(row)}),))
        q = draws(problem, state, candidates, at_corner)
        values = np.array([cost.value(robot.at(each)) for each in q])
        found = start_of(problem, row, candidates, at_corner, state)
        assert cost.value(robot.at(found)) == pytest.approx(values.min(), rel=1e-12)
        assert np.abs(q - found).max(axis=1).min() < 1e-14
        if at_corner:
            ends = problem.chain[:-1, [Joint.START_LOWER, Joint.START_UPPER]]
            assert (found[:, None] == ends).any(axis=1).all()


def test_a_random_start_toward_nan_is_a_configuration_all_the_same():
    problem = compiled(arm("maira"))
    found = start_of(problem, np.full(12, np.nan), 11, False, 3)
    np.testing.assert_allclose(found, draws(problem, 3, 1, False)[0], atol=1e-15)


def test_random_starts_fill_the_limits_and_differ_by_seed_target_and_attempt():
    problem = compiled(arm("maira"))
    robot, starts = problem.robot, []
    for seed in range(3):
        for place in range(20):
            row = row_of(mq.pose([0.1 * place, 0, 0]))
            stream = np.uint64(stream_of(row, np.array([seed, 0], dtype=np.uint64)))
            starts += [start_of(problem, row, 1, False, int(state_of(stream, attempt))) for attempt in range(few(20))]
    starts, count = np.array(starts), 60 * few(20)
    assert len(np.unique(starts, axis=0)) == count
    share = (starts - robot.lower) / (robot.upper - robot.lower)
    assert (share >= 0).all()
    assert (share <= 1).all()
    # mean and spread of uniform draws, within 4 standard errors
    assert np.abs(share.mean(axis=0) - 0.5).max() < 4 / np.sqrt(12 * count)
    assert np.abs(share.std(axis=0) - 1 / np.sqrt(12)).max() < 4 / np.sqrt(60 * count)


def test_starts_are_within_the_limits_to_the_bit_wherever_the_draws_fall(rng):
    """Limits that differ by a few units of the last place, among them: rounding must not lead out."""
    problem = compiled(arm("maira"))
    chain = problem.chain.copy()
    for _ in range(few(400)):
        lower = rng.normal(size=7) * 10.0 ** rng.integers(-3, 3, 7)
        upper = lower + rng.integers(0, 4, 7) * np.spacing(np.abs(lower))
        chain[:7, Joint.START_LOWER], chain[:7, Joint.START_UPPER] = lower, upper
        q, work = np.empty(7), descents(7)
        state = rng.integers(0, 2**64 - 1, dtype=np.uint64)
        random_start(chain, problem.settings, np.zeros(12), 1, bool(rng.random() < 0.5), state, work, q)
        assert (q >= lower).all()
        assert (q <= upper).all()
