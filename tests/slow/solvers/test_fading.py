"""`Weighted(..., fading=True)`: the posture steers the way, and the pose is exact at the end."""

import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq

WEIGHTS = [1e-3, 0.1, 10.0]


def fading(weight: float = 1e-3) -> mq.Weighted:
    return mq.Weighted(mq.Posture(), weight, fading=True)


def robot_of(name: str) -> mq.Robot:
    return mq.Robot.maira() if name == "maira" else load(name)


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_every_pose_is_reached_and_the_posture_is_better_than_without(name, weight, rng):
    robot = robot_of(name)
    targets = np.array([robot.forward(robot.random_configuration(rng)).homogeneous for _ in range(60)])
    faded, plain, best = (
        mq.Solver(robot, redundancy=wish).solve_batch(targets)
        for wish in (fading(weight), None, mq.Strict(mq.Posture()))
    )
    assert faded.success.all()
    assert (robot.lower <= faded.q).all()
    assert (faded.q <= robot.upper).all()
    costs = [0.5 * np.square(batch.q - robot.middle).sum(axis=1) for batch in (best, faded, plain)]
    assert faded.cost == pytest.approx(costs[1])
    if robot.n > 6:
        assert costs[1].mean() < costs[2].mean()
    if name == "maira":  # whose strict optimum is mostly the global one
        assert costs[0].mean() <= costs[1].mean() + 1e-6


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("backend", [None, "daqp"])
def test_ticks_arrive_exactly_where_a_weight_that_stays_does_not(weight, backend, rng):
    robot = load("panda")
    q = robot.clip(robot.middle + 0.2 * rng.normal(size=robot.n))
    target = robot.forward(robot.clip(q + 0.3 * rng.normal(size=robot.n)))
    ends = {}
    for wish in (fading(weight), mq.Weighted(mq.Posture(), weight)):
        solver, at = mq.Solver(robot, redundancy=wish, backend=backend), q
        for _ in range(150):
            step = solver.step(at, target, 0.02)
            at = step.q
        ends[wish.fading] = step
    assert ends[True].status is mq.StepStatus.ARRIVED
    assert ends[True].backend == ("compiled" if backend is None else "daqp")
    assert ends[False].status is not mq.StepStatus.ARRIVED


def test_the_pull_that_is_left_is_at_most_half_of_the_pose_gradient(rng):
    for scale in 10.0 ** rng.uniform(-9, 3, 200):
        slope, pull, weight = scale * rng.normal(size=7), rng.normal(size=7), 10.0 ** rng.uniform(-6, 3)
        faded = fading(weight).faded(slope, pull)
        assert not faded.fading
        assert 0 < faded.weight <= weight
        assert faded.weight * np.linalg.norm(pull) <= 0.5 * np.linalg.norm(slope) * (1 + 1e-12)
    assert fading().faded(np.zeros(7), np.ones(7)) is None


def test_a_target_out_of_reach_ends_at_the_nearest_point_of_the_pose_alone(rng):
    robot = load("panda")
    target = robot.forward(robot.random_configuration(rng))
    target.translation *= 3.0
    plain, faded = (mq.Solver(robot, redundancy=wish).solve(target, robot.middle) for wish in (None, fading()))
    assert faded.status is mq.Status.UNREACHABLE is plain.status
    assert faded.position_error == pytest.approx(plain.position_error, abs=1e-6)


def test_both_engines_and_a_copy_answer_alike(rng):
    robot = mq.Robot.maira()
    target = robot.forward(robot.random_configuration(rng))
    compiled, general = (mq.Solver(robot, redundancy=fading(), backend=backend) for backend in (None, "daqp"))
    q0 = robot.random_configuration(rng)
    answers = [solver.solve(target, q0) for solver in (compiled, general, pickle.loads(pickle.dumps(compiled)))]
    assert [each.success for each in answers] == [True] * 3
    for other in answers[1:]:
        assert other.q == pytest.approx(answers[0].q, abs=1e-4)


def test_fading_is_yes_or_no():
    with pytest.raises(mq.errors.OptionError, match="fading must be True or False"):
        mq.Weighted(mq.Posture(), fading="yes")
