"""Figures of configurations: those that the robot gives one by one, and the same in any company."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.scale.reach.metrics import limit_distances, manipulabilities

PLANAR = [{"kind": "revolute", "a": 0.4, "lower": -2.0, "upper": 3.0}, {"kind": "revolute", "a": 0.3}]


def robots() -> list[mq.Robot]:
    planar = mq.Robot.from_dh([{**PLANAR[0]}, {**PLANAR[1], "lower": -1.0, "upper": 1.0}], name="planar")
    return [mq.Robot.maira(), load("ur5"), load("pr2_arm"), planar]


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
def test_manipulability_is_the_product_of_the_singular_values(robot, rng):
    q = np.array([robot.random_configuration(rng) for _ in range(200)])
    wanted = [robot.manipulability(each) for each in q]
    np.testing.assert_allclose(manipulabilities(robot, q), wanted, rtol=1e-6, atol=2e-8)


def test_a_singular_configuration_has_no_manipulability():
    robot = mq.Robot.maira()
    assert manipulabilities(robot, np.zeros((1, 7)))[0] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
def test_the_distance_from_the_limits_is_0_at_one_and_1_midway(robot, rng):
    limited = np.isfinite(robot.upper - robot.lower)
    assert limit_distances(robot, robot.middle[None])[0] == pytest.approx(1.0)
    for i in np.flatnonzero(limited):
        for end, other, share in ((robot.lower, robot.upper, 0.25), (robot.upper, robot.lower, 0.0)):
            q = robot.middle.copy()
            q[i] = end[i] + 0.5 * share * (other[i] - end[i])
            assert limit_distances(robot, q[None])[0] == pytest.approx(share, abs=1e-12)


def test_figures_do_not_depend_on_what_else_is_computed(rng):
    robot = mq.Robot.maira()
    q = np.array([robot.random_configuration(rng) for _ in range(65)])
    for figure in (manipulabilities, limit_distances):
        together = figure(robot, q)
        for size in (1, 3, 16):
            parts = [figure(robot, q[k : k + size]) for k in range(0, len(q), size)]
            assert np.concatenate(parts).tobytes() == together.tobytes()
