"""What `Step.status` says of an arm that stands: STUCK where the QPs ask for a motion that is not made, and only there.

The levels below may add nothing to the errors above them here, not a digit: so no share of what they ask for is safe.
"""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.solvers.reference.step import resting_speed

NOTHING = mq.Options(level_position_tolerance=1e-300, level_orientation_tolerance=1e-300)
ENGINES = {"compiled": None, "reference": "daqp"}


@pytest.fixture(params=["maira", "panda"])
def robot(request) -> mq.Robot:
    return mq.Robot.maira() if request.param == "maira" else load(request.param)


def elbow_aside(robot: mq.Robot, q: np.ndarray, rng: np.random.Generator, **keys) -> mq.Solver:
    """A solver that holds the tool where it is at q (n,), and below that moves the elbow 0.2 m aside."""
    elbow = robot.moved_links[3]
    aside = rng.normal(size=3)
    there = robot.forward(q, elbow).translation + 0.2 * aside / np.linalg.norm(aside)
    tasks = [mq.PoseTask(target=robot.forward(q)), mq.PositionTask(frame=elbow, target=mq.pose(there), priority=2)]
    return mq.Solver(robot, task=tasks, **keys)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_arm_is_stuck_where_no_share_of_what_the_levels_ask_for_is_safe(robot, engine, rng):
    """It stands, says so, and goes on saying so; with the usual tolerances the same arm moves.

    What the tool loses is given back, to the last digit but for rounding: where that is in its favour the arm moves on.
    """
    stuck = 0
    for _ in range(10):
        q = robot.random_configuration(rng)
        draws = rng.integers(2**32)
        solvers = [
            elbow_aside(robot, q, np.random.default_rng(draws), backend=ENGINES[engine], options=options)
            for options in (NOTHING, mq.Options())
        ]
        held, free = (solver.step(q, dt=0.01) for solver in solvers)
        assert {held.backend, free.backend} == {ENGINES[engine] or "compiled"}
        assert free.status == mq.StepStatus.MOVING
        assert (np.abs(free.velocity) > resting_speed(robot)).any()
        if (np.abs(held.velocity) <= resting_speed(robot)).all():
            assert held.status == mq.StepStatus.STUCK
            again = solvers[0].step(held.q, dt=0.01)
            stands = (np.abs(again.velocity) <= resting_speed(robot)).all()
            assert again.status == (mq.StepStatus.STUCK if stands else mq.StepStatus.MOVING)
            stuck += 1
        else:
            assert held.status == mq.StepStatus.MOVING
    assert stuck >= 3


@pytest.mark.parametrize("engine", ENGINES)
def test_an_arm_that_moves_arrives_or_is_at_a_nearest_point_is_not_stuck(robot, engine, rng):
    """On the way to a target, there, and as near as it gets to one out of reach."""
    solver, seen = mq.Solver(robot, backend=ENGINES[engine]), set()
    for scale in (1.0, 3.0):
        q = robot.clip(robot.middle + 0.3)
        target = robot.forward(robot.clip(q + 0.1 * rng.normal(size=robot.n)))
        target.translation *= scale
        for _ in range(150):
            step = solver.step(q, target, 0.05)
            is_at_rest = (np.abs(step.velocity) <= resting_speed(robot)).all()
            assert step.status != mq.StepStatus.STUCK
            assert is_at_rest or step.status in (mq.StepStatus.MOVING, mq.StepStatus.ARRIVED)
            seen.add(step.status)
            q = step.q
    assert seen == {mq.StepStatus.MOVING, mq.StepStatus.ARRIVED, mq.StepStatus.NEAREST}


def test_a_backend_that_fails_leaves_the_arm_stuck(maira):
    """Of the reference engine: the arm stands, and the status is neither that of arrival nor of a nearest point."""
    solver = mq.Solver(maira, backend=mq.Backend("daqp", {"iter_limit": 1}))
    q = maira.clip(maira.middle + 0.3)
    step = solver.step(q, maira.forward(maira.upper), 0.05)
    assert step.status == mq.StepStatus.STUCK
    assert not step.velocity.any()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_gain_that_lets_the_error_fall_slowly_is_no_rest(robot, engine, rng):
    """Slower than what counts as at rest, the arm is on its way all the same."""
    task = mq.PoseTask(gain=1e-7)
    solver = mq.Solver(robot, task=task, redundancy=None, backend=ENGINES[engine])
    q = robot.clip(robot.middle + 0.3)
    step = solver.step(q, robot.forward(robot.clip(q + 0.1 * rng.normal(size=robot.n))), 0.1)
    assert (np.abs(step.velocity) <= resting_speed(robot)).all()
    assert step.status == mq.StepStatus.MOVING
