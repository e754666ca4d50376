"""Where the settling of S-R-S arms begins, against all configurations of the same swivel angles, and the optimum."""

import numpy as np
import pytest
from support.compiled_problems import few, row_of, rubbish
from support.srs_arms import ARMS, Arm, anywhere, hard_configurations, memory, poses_of, srs_arm

import maira_qp as mq
from maira_qp.analytic.srs.geometry import wrapped
from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.kinematics.serial_chain import KINEMATICS
from maira_qp.kernels.layout import Axis, Outcome, Range, Setting, Spherical
from maira_qp.kernels.srs.posture_seed import ROUNDS, SEEDING, half_square, reach_near_posture

ANGLES = 2 * np.pi * np.arange(LANES * ROUNDS) / (LANES * ROUNDS)


def begun(arm: Arm, poses: np.ndarray, reference: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (N, 7) for poses (N, 4, 4), and which were found (N,)."""
    q, outcome = np.full((len(poses), 7), np.nan), np.full((len(poses), Outcome.WIDTH), np.nan)
    settings = np.array([1.0, 1.0, 1e-6, 1e-6, *np.zeros(Setting.WIDTH - 4)])
    work = *memory(), *rubbish(SEEDING), *rubbish(KINEMATICS, 7)
    rows, chain = np.array([row_of(T) for T in poses]), arm.robot.chain
    problem = chain, settings, arm.array, rows, reference, weights
    reach_near_posture(*problem, *work, q, outcome)
    return q, outcome[:, Outcome.SUCCESS] > 0


def cost(q: np.ndarray, reference: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The objective (...) of configurations (..., 7)."""
    return 0.5 * (weights * (q - reference) ** 2).sum(axis=-1)


def every_candidate(arm: Arm, T: np.ndarray) -> np.ndarray:
    """All configurations (k, 7) within the limits at the swivel angles that are tried, each joint around its middle."""
    lower, upper = arm.robot.drawn_range
    middle = 0.5 * (lower + upper)
    q = np.concatenate([arm.srs.evaluate(branch, ANGLES).reshape(-1, 7) for branch in arm.srs.elbow_branches(T)])
    q = middle + wrapped(q - middle)
    return q[((arm.robot.lower <= q) & (q <= arm.robot.upper)).all(axis=1)]


def some_posture(arm: Arm, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A reference within the limits and weights, some of them 0."""
    return arm.robot.random_configuration(rng), rng.uniform(0.2, 3.0, 7) * (rng.random(7) < 0.8)


@pytest.mark.parametrize("name", ARMS)
def test_what_is_found_reaches_the_pose_within_the_limits(rng, name):
    arm = srs_arm(name)
    q = np.concatenate(
        [hard_configurations(arm, rng, few(100)), [arm.robot.random_configuration(rng) for _ in range(9)]]
    )
    poses = np.concatenate([poses_of(arm.robot, q), anywhere(arm, rng, few(100))])
    q, found = begun(arm, poses, *some_posture(arm, rng))
    assert found.any()
    assert (q[found] >= arm.robot.lower).all()
    assert (q[found] <= arm.robot.upper).all()
    assert np.abs(poses_of(arm.robot, q[found]) - poses[found]).max() < 2e-6


@pytest.mark.parametrize("name", ARMS)
def test_it_is_about_the_best_of_its_candidates(rng, name):
    """The squares are rough where joints are far from the posture, so now and then it is the second best."""
    arm, worse, count = srs_arm(name), 0, 0
    reference, weights = some_posture(arm, rng)
    poses = poses_of(arm.robot, np.array([arm.robot.random_configuration(rng) for _ in range(few(60))]))
    for T, q, found in zip(poses, *begun(arm, poses, reference, weights), strict=True):
        candidates = every_candidate(arm, T)
        assert found == (len(candidates) > 0)
        if found:
            least = cost(candidates, reference, weights).min()
            worse += cost(q, reference, weights) > 1.05 * least + 0.05
            count += 1
    assert worse <= 1 + 0.05 * count


def test_squares_of_angles_without_the_angle(rng):
    """Near the posture exact, farther on roughly; beyond half a turn more than anywhere within; none outside limits."""
    reference = rng.uniform(-2.5, 2.5, few(2000))
    joint, posture = np.zeros(Spherical.RANGES + 12), np.empty((3, 3))
    angles = rng.uniform(-np.pi, np.pi, len(reference))
    for a, b in zip(reference, angles, strict=True):
        posture[Axis.FIRST] = np.cos(a), np.sin(a), 0.5
        joint[Spherical.RANGES + Range.COS_HALF] = np.cos(3.0)
        found, exact = half_square(joint, posture, Axis.FIRST, np.cos(b), np.sin(b)), 0.5 * (a - b) ** 2
        if abs(b) > 3.0:
            assert found == np.inf
        elif abs(a - b) > np.pi:
            assert 0.5 * np.pi**2 <= found <= exact + 0.01
        else:
            assert found == pytest.approx(exact, rel=0.16, abs=0.02)
            assert abs(a - b) > 0.2 or found == pytest.approx(exact, rel=0.02, abs=1e-9)


@pytest.mark.parametrize("name", ["maira", "iiwa14", "urdf"])
def test_a_strict_solution_is_mostly_the_best_there_is(rng, name):
    """Of all arcs of the self-motion, and without q0."""
    robot, best = srs_arm(name).robot, 0
    posture = mq.Posture(robot.random_configuration(rng), rng.uniform(0.3, 3.0, 7))
    solver = mq.Solver(robot, redundancy=mq.Strict(posture))
    for _ in range(few(20)):
        T = robot.forward(robot.random_configuration(rng))
        found, least = solver.solve(T).cost, min(each.cost for each in solver.solutions(T))
        assert found >= least - 1e-6 * (1 + least)
        best += found <= least + 1e-6 * (1 + least)
    assert best >= 0.7 * few(20) - 1
