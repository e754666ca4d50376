"""Lists of solutions within further limits, of mimic arms, trees and other tasks: by closed forms and by all arcs."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.analytic.srs.arcs import at_each
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.analytic.srs.optimum import SampledArcs

PLANAR = mq.Robot.from_dh([mq.DHLink(a=1.0, lower=-3, upper=3), mq.DHLink(a=0.8, lower=-2.5, upper=2.5)], name="two")


def reaches(robot, q, target):
    error = np.abs(robot.forward(q).homogeneous - target.homogeneous).max()
    return error < 3e-6 and (robot.lower <= q).all() and (q <= robot.upper).all()


def every_place(robot, target, count=500):
    arcs = SampledArcs.of(SRS.of(robot), target, mq.Posture().of(robot)).arcs
    each = [at_each(arcs, np.full(count, k), np.linspace(arc.lower, arc.upper, count)) for k, arc in enumerate(arcs)]
    return np.concatenate([np.empty((0, 7)), *each])


def test_pieces_of_arcs_hold_the_best_that_keeps_a_limit(maira, rng):
    """Of 500 places on every arc none that keeps the limits is better, and what is listed keeps them."""
    row = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]])
    wish = mq.Posture(maira.middle + 0.2)
    for _ in range(4):
        target = maira.forward(maira.random_configuration(rng))
        free = mq.Solver(maira, redundancy=mq.Strict(wish)).solutions(target)
        bound = row @ free[0].q - 0.1
        solver = mq.Solver(maira, redundancy=mq.Strict(wish), limits=[mq.LinearLimit(row, bound)])
        listed, places = solver.solutions(target), every_place(maira, target)
        kept = places[(places @ row.T <= bound).all(axis=1)]
        assert not listed.is_complete
        assert "may be missed" in listed.reason
        assert bool(len(listed)) == bool(len(kept))
        assert all(reaches(maira, one.q, target) for one in listed)
        assert all((row @ one.q <= bound).all() for one in listed)
        assert all(one.arc.lower <= one.psi <= one.arc.upper for one in listed)
        if len(kept):
            assert listed[0].cost <= wish.of(maira).costs(kept).min() + 1e-9
            near = solver.solve(target, maira.middle, prefer="closest")
            assert 2 * near.cost <= np.square(kept - maira.middle).sum(axis=1).min() * (1 + 1e-6)


def test_what_is_listed_stays_clear_of_a_ball(maira, rng):
    q = maira.middle + rng.uniform(-0.8, 0.8, 7)
    target, elbow = maira.forward(q), maira.forward(q, "link4")
    solver = mq.Solver(maira, limits=[mq.CollisionLimit(obstacles=[mq.Sphere(0.05, elbow)])])
    free, clear = mq.Solver(maira).solutions(target), solver.solutions(target)
    assert len(clear)
    limit = solver.problem.additional_limits[0]
    for one in clear:
        assert limit.violation(maira.at(one.q)) == 0.0
        assert reaches(maira, one.q, target)
    assert clear[0].cost >= free[0].cost - 1e-9


def test_isolated_solutions_are_those_that_keep_the_limits(ur5, rng):
    row = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    for _ in range(3):
        target = ur5.forward(rng.uniform(-1.5, 1.5, 6))
        free = mq.Solver(ur5).solutions(target)
        bounded = mq.Solver(ur5, limits=[mq.LinearLimit(row, [0.0])]).solutions(target)
        expected = [one.q.tolist() for one in free if one.q[2] <= 0]
        assert [one.q.tolist() for one in bounded] == expected
        assert 0 < len(expected) < len(free)
        assert bounded.is_complete == free.is_complete


def test_points_of_a_plane_have_two_solutions():
    """Two joints and a point: elbow up and down, by the law of cosines."""
    solver = mq.Solver(PLANAR, task=mq.PositionTask())
    for q in ([0.4, 1.1], [-1.2, 0.3], [0.0, 2.0]):
        p = PLANAR.forward(q).translation
        cosine = (p @ p - 1.0 - 0.64) / 1.6
        listed = solver.solutions(PLANAR.forward(q))
        assert sorted(one.q[1] for one in listed) == pytest.approx(sorted([-np.arccos(cosine), np.arccos(cosine)]))
        assert not listed.is_complete
        assert all(np.abs(PLANAR.forward(one.q).translation - p).max() < 1e-6 for one in listed)


def test_a_mimic_arm_has_the_solutions_of_its_twin():
    """Three joints of which the third follows the second: as two links whose angles are counted once and twice."""
    urdf = """<robot name="mimic"><link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/>
    <joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
      <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
    <joint name="j2" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/><origin xyz="1 0 0"/>
      <limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>
    <joint name="j3" type="revolute"><parent link="c"/><child link="d"/><axis xyz="0 0 1"/><origin xyz="1 0 0"/>
      <limit lower="-1.5" upper="1.5" effort="1" velocity="1"/><mimic joint="j2"/></joint>
    <joint name="end" type="fixed"><parent link="d"/><child link="e"/><origin xyz="1 0 0"/></joint></robot>"""
    robot = mq.Robot.from_urdf(urdf)
    assert robot.n == 2
    p = robot.forward([0.5, 0.7]).translation
    listed = mq.Solver(robot, task=mq.PositionTask()).solutions(robot.forward([0.5, 0.7]))
    # |p| = |1 + e^(i b) + e^(2 i b)| = |1 + 2 cos b|
    roots = {np.arccos((side * np.hypot(*p[:2]) - 1) / 2) for side in (1, -1) if abs(side * np.hypot(*p[:2]) - 1) <= 2}
    expected = sorted(sign * b for b in roots if b <= 1.5 for sign in (1, -1))
    assert sorted(one.q[1] for one in listed) == pytest.approx(expected, abs=1e-6)


def test_redundant_arms_and_tasks_below_are_settled(panda, rng):
    """Each of the list reaches the point, and nothing along its self-motion is better."""
    solver = mq.Solver(panda, redundancy=mq.Strict(mq.Posture()), limits=[mq.LinearLimit(np.eye(7)[:1], [0.2])])
    q = panda.middle + np.array([-0.4, 0.3, 0.2, 0.1, 0.2, 0.3, 0.1])
    listed = solver.solutions(panda.forward(q))
    usual = solver.solve(panda.forward(q), q)
    assert len(listed)
    assert listed[0].cost <= usual.cost + 1e-5
    assert all(reaches(panda, one.q, panda.forward(q)) and one.q[0] <= 0.2 + 1e-9 for one in listed)
    assert listed[0].q.tolist() == solver.solutions(panda.forward(q))[0].q.tolist()


def test_two_arms_have_lists_too():
    robot = load("tiago_arms")
    q = robot.middle + 0.1
    targets = {tip: robot.forward(q, tip) for tip in robot.tips}
    solver = mq.Solver(robot, task=[mq.PositionTask(frame=tip) for tip in robot.tips])
    listed = solver.solutions(targets)
    assert len(listed)
    for one in listed:
        for tip, target in targets.items():
            assert np.abs(robot.forward(one.q, tip).translation - target.translation).max() < 1e-6
