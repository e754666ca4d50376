"""Meshes of a robot that was read from a file are found above it; a limit's own directories come first."""

import pickle

import pytest
from support.robots import urdf_file

import maira_qp as mq
from maira_qp.robots.collision.link_shapes import link_shapes


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_robots_by_name_have_their_meshes(name):
    robot = mq.Robot.load(name)
    shapes = link_shapes(robot)
    assert len(shapes) >= robot.n
    changed = pickle.loads(pickle.dumps(robot.with_tool(mq.pose([0, 0, 0.1])).limited(margin=0.1)))
    assert [shape.link for shape in link_shapes(changed)] == [shape.link for shape in shapes]
    assert mq.Solver(robot, limits=[mq.CollisionLimit()]).limits


def test_a_file_and_its_text_differ_in_where_meshes_are_sought():
    file = urdf_file("ur5")
    assert link_shapes(mq.Robot.from_urdf(file, tip="tool0"))
    with pytest.raises(mq.errors.OptionError, match="is not found"):
        link_shapes(mq.Robot.from_urdf(file.read_text(), tip="tool0"))
