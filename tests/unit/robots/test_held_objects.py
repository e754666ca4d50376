"""Objects in the hand: where they are, what they collide with, and how they are given up."""

import pickle

import coal
import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, PoseError

POSE = mq.pose([0.02, 0.01, 0.15], rpy=[0.3, 0.2, 0.1])
TABLE = mq.Box([2.0, 2.0, 0.1], mq.pose([0, 0, -0.3]), name="table")
SHAPES = (
    mq.Box([0.05, 0.1, 0.3], mq.pose([0, 0, 0.1], rpy=[0, 0.4, 0])),
    mq.Sphere(0.07),
    mq.Ellipsoid([0.03, 0.05, 0.1]),
    mq.Cylinder(0.03, 0.2),
    mq.Capsule(0.02, 0.2, mq.pose([0.1, 0, 0])),
)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_what_is_held_is_as_far_from_the_table_as_coal_says(maira, shape, rng):
    """Distance between the two solids where forward kinematics puts them."""
    made = maira.holding(shape, POSE)
    assert made.held == ("held",)
    limit = mq.CollisionLimit(obstacles=[TABLE], self_collision=False, margin=0.0, influence=9.0).of(made)
    for _ in range(5):
        q = maira.random_configuration(rng)
        at = made.at(q)
        place = maira.forward(q) * POSE * shape.pose
        np.testing.assert_allclose(
            made.forward(q, "held").homogeneous, (maira.forward(q) * POSE).homogeneous, rtol=0, atol=1e-14
        )
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        places = [coal.Transform3s(T.rotation, T.translation) for T in (place, TABLE.pose)]
        distance = coal.distance(shape.solid(), places[0], TABLE.solid(), places[1], request, result)
        contacts = limit.scene.contacts(at.q, np.inf)
        names = [{limit.scene.parts[k].name for k in limit.scene.pairs[pair]} for pair in contacts.pairs]
        assert contacts.distances[names.index({"held", "table"})] == pytest.approx(distance, abs=1e-5)


def test_a_solve_keeps_what_is_held_clear(maira):
    """The tool alone may stand near the table; a bar in it may not hang through it."""
    table = mq.Box([0.4, 0.8, 0.1], mq.pose([0.65, 0, 0.25]), name="table")
    limits = [mq.CollisionLimit(obstacles=[table], self_collision=False)]
    bar = mq.Box([0.02, 0.02, 0.4], mq.pose([0, 0, 0.2]))
    target = mq.pose([0.6, 0.0, 0.5], rpy=[np.pi, 0, 0])
    assert mq.Solver(maira, limits=limits).solve(target).success
    s = mq.Solver(maira.holding(bar), limits=limits).solve(target)
    assert not s.success
    assert any("held" in name for name in s.active_limits)


def test_links_next_to_the_hand_may_touch_and_others_by_name(maira):
    shape = mq.Sphere(0.3)

    def partners(robot):
        scene = mq.CollisionLimit().of(robot).scene
        names = [{scene.parts[i].name, scene.parts[j].name} for i, j in scene.pairs]
        return {name for pair in names if "held" in pair for name in pair} - {"held"}

    plain, last = partners(maira.holding(shape)), maira.joint_names.index("joint7")
    assert "tool0" not in plain
    assert maira.moved_links[last] not in plain
    assert maira.moved_links[last - 1] not in plain
    assert {"base_link", "link1", "link2"} <= plain
    assert partners(maira.holding(shape, touching=["link2"])) == plain - {"link2"}


def test_an_object_is_given_up(maira, rng):
    first = maira.holding(mq.Sphere(0.1), POSE)
    second = first.with_tool(POSE).limited(margin=0.01).holding(mq.Box([0.1, 0.1, 0.1]), frame="link4", name="box")
    assert second.held == ("held", "box")
    left = second.holding(None)
    assert left.held == ("box",)
    assert left.tip == "tool"
    np.testing.assert_array_equal(left.upper, second.upper)
    assert first.holding(None) == maira
    q = maira.random_configuration(rng)
    np.testing.assert_allclose(left.forward(q).homogeneous, second.forward(q).homogeneous, rtol=0, atol=1e-15)
    assert pickle.loads(pickle.dumps(second)) == second
    again = mq.Robot.from_urdf(second.urdf, tip="tool")
    assert again.urdf == second.urdf
    with pytest.raises(OptionError, match="no object 'cup' is held; held: 'held', 'box'"):
        second.holding(None, name="cup")
    with pytest.raises(OptionError, match="'held' carries 'lid'"):
        first.holding(mq.Sphere(0.1), frame="held", name="lid").holding(None)


def test_what_cannot_be_held(maira):
    with pytest.raises(OptionError, match="not a shape"):
        maira.holding("cup")
    with pytest.raises(OptionError, match="save the mesh to a file"):
        maira.holding(mq.Mesh((np.eye(3), [[0, 1, 2]])))
    with pytest.raises(FrameError, match="'hand' is not a frame"):
        maira.holding(mq.Sphere(0.1), frame="hand")
    with pytest.raises(FrameError, match="'hand' is not a frame"):
        maira.holding(mq.Sphere(0.1), touching=["hand"])
    with pytest.raises(FrameError, match="there is a link 'link4' already"):
        maira.holding(mq.Sphere(0.1), name="link4")
    with pytest.raises(PoseError):
        maira.holding(mq.Sphere(0.1), np.eye(3))


def test_a_gripper_with_fingers_that_follow_holds_something(rng):
    robot = load("panda_finger")
    made = robot.holding(mq.Sphere(0.02), frame="panda_hand_tcp")
    q = robot.random_configuration(rng)
    expected = robot.forward(q, "panda_hand_tcp").homogeneous
    np.testing.assert_allclose(made.forward(q, "held").homogeneous, expected, rtol=0, atol=1e-14)
