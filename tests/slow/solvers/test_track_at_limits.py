"""Paths of motions that stand on limits, go through the whole range of joints with turns, pass singular poses, or
break."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq


def bezier(points: np.ndarray, count: int) -> np.ndarray:
    """A motion (count, n) through the box of four configurations (4, n)."""
    t = np.linspace(0.0, 1.0, count)[:, None]
    return np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]) @ points


@pytest.mark.parametrize("seed", [5, 50, 53, 72, 89])
def test_a_motion_that_begins_in_a_corner_of_the_limits_is_followed_from_anywhere(seed):
    """Joints whose range is more than a turn have one turn there: the limit itself, not what is 1e-7 beyond it."""
    rng, robot = np.random.default_rng(seed), load("kr210")
    stands, is_upper = rng.random(6) < 0.7, rng.random(6) < 0.5
    corner = np.where(stands, np.where(is_upper, robot.upper, robot.lower), robot.random_configuration(rng))
    a, b, c, d = [corner, *(robot.random_configuration(rng) for _ in range(3))]
    motion = bezier(np.array([a, b, c, d]), 100)
    path = mq.Solver(robot).track([robot.forward(q) for q in np.clip(motion, robot.lower, robot.upper)])
    assert path, path.reason


@pytest.mark.parametrize("seed", [9, 26])
def test_a_motion_that_ends_in_a_corner_of_limits_with_turns_is_followed_from_its_start(seed):
    """Only the corner itself is within the limits there, at one of the turns of the joints."""
    robot, rng = load("xarm7"), np.random.default_rng(seed)
    start = robot.lower + (robot.upper - robot.lower) * rng.uniform(0.3, 0.7, size=7)
    corner = np.where(rng.random(7) < 0.5, robot.lower, robot.upper)
    a, b = rng.uniform(robot.lower, robot.upper, size=(2, 7))
    motion = bezier(np.array([start, a, b, corner]), 150)
    p = mq.Solver(robot).track([robot.forward(q) for q in motion], motion[0])
    assert p, p.reason
    assert ((robot.lower <= p.q) & (p.q <= robot.upper)).all()


@pytest.mark.parametrize(
    ("name", "seed", "is_start_given"),
    [
        ("xarm7", (1000, 93), False),
        ("xarm7", (2000, 89), False),
        ("xarm7", (2000, 91), True),
        ("xarm7", (2000, 195), True),
        ("xarm7", (2000, 286), True),
        ("xarm7", (2000, 359), True),
        ("xarm7", (2000, 556), True),
        ("xarm7", (2000, 735), True),
        ("maira", (2000, 91), True),
        ("maira", (2000, 899), True),
        ("maira", (2000, 95), True),
        ("maira", (2000, 707), False),
        ("talos_arm", (2000, 575), True),
        ("ur5_limited", (2000, 111), False),
        ("ur5_limited", (2000, 111), True),
    ],
)
def test_a_motion_through_the_whole_range_of_joints_is_followed(name, seed, is_start_given):
    """Of these the best line without regard to turns does not fit, or what is near limits leads on from one side alone,
    or many links beside one another jump, or all that leads on has a joint on a limit, or hardly leaves one from end to
    end, or poses at the end are not reached by themselves."""
    robot, rng = mq.Robot.maira() if name == "maira" else load(name), np.random.default_rng(seed)
    points = rng.uniform(robot.lower, robot.upper, (4, robot.n))
    if seed[1] % 4 == 3:  # stands on limits
        ends = np.where(rng.random(points.shape) < 0.5, robot.lower, robot.upper)
        points = np.where(rng.random(points.shape) < 0.5, ends, points)
    motion = np.clip(bezier(points, 200), robot.lower, robot.upper)
    step = min(0.5, 3.0 * np.abs(np.diff(motion, axis=0)).max())
    poses = [robot.forward(q) for q in motion]
    p = mq.Solver(robot).track(poses, motion[0] if is_start_given else None, max_step=step)
    assert p, p.reason
    assert p.max_joint_step <= step + 1e-12
    assert ((robot.lower <= p.q) & (p.q <= robot.upper)).all()


def test_no_large_step_stands_in_the_place_of_many_small_ones():
    """A motion past a singular configuration of an arm that could turn about it at once."""
    robot, rng = mq.Robot.load("iiwa14"), np.random.default_rng(123)

    def drawn() -> np.ndarray:
        at_limit, is_lower = rng.random(7) < 0.5, rng.random(7) < 0.5
        return np.where(at_limit, np.where(is_lower, robot.lower, robot.upper), robot.random_configuration(rng))

    motion = bezier(np.array([drawn() for _ in range(4)]), 120)
    p = mq.Solver(robot).track([robot.forward(q) for q in motion])
    assert p
    assert p.max_joint_step < 3 * np.abs(np.diff(motion, axis=0)).max()


def test_links_that_do_not_lead_are_no_more_reconfigurations():
    """Two motions from branch to branch at one pose: one reconfiguration is enough, wherever links of layers jump."""
    robot, rng = load("kr210"), np.random.default_rng(5)
    first, second = rng.uniform(robot.lower, robot.upper, (2, 4, 6))
    solver, middle = mq.Solver(robot), robot.forward(first[3])
    others = [solver.solve(middle, seed=seed).q for seed in range(6)]
    second[0] = max(others, key=lambda q: np.abs(q - first[3]).max())
    motion = np.concatenate([bezier(first, 1000), bezier(second, 1000)])
    p = solver.track([robot.forward(q) for q in motion], max_step=0.03, max_reconfigurations=1)
    assert p, p.reason
    assert p.success.all()
    assert p.reconfigurations == 1
