"""The viewer's session with targets that are typed, moved by keys and taken back, several tips, and self-collision."""

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.apps.viewer.answers import ghosts_of
from maira_qp.apps.viewer.branches import elbow_word
from maira_qp.apps.viewer.drawing.ghosts import ghost_colour
from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import Standing, View
from maira_qp.errors import FrameError, OptionError

DT = 1 / 60


def run(session: Session, seconds: float) -> View:
    """Ticks, with all jobs done at once between them."""
    for _ in range(round(seconds / DT)):
        view = session.tick(DT)
        while (job := session.next_job() or session.next_long_job()) is not None:
            job.write(job.think())
    return view


def test_undo_and_home_bring_the_arm_and_its_target_back(maira):
    session = Session(maira)
    home, places = session.q, [session.target]
    for way in (0.05, -0.08):
        session.nudge(0, way)
        run(session, 2)
        places.append(session.target)
    for place in reversed(places[:-1]):
        session.undo()
        view = run(session, 1.5)
        np.testing.assert_array_equal(session.target.homogeneous, place.homogeneous)
        assert view.standing is Standing.REACHED
    np.testing.assert_allclose(session.q, home, atol=1e-12)
    with pytest.raises(OptionError, match="nothing to undo"):
        session.undo()
    session.redo()
    run(session, 1.5)
    np.testing.assert_array_equal(session.target.homogeneous, places[1].homogeneous)
    session.set_joint(0, 1.0)
    session.go_home()
    view = run(session, 2.5)
    np.testing.assert_allclose(session.q, home, atol=1e-12)
    assert view.position_error < 1e-9


def test_keys_move_the_target_along_the_axes_that_were_chosen(maira):
    session = Session(maira)
    for has_base_axes in (False, True):
        session.use_axes(has_base_axes)
        before = session.target
        session.nudge(1, 0.01)
        axes = np.eye(3) if has_base_axes else before.rotation
        np.testing.assert_allclose(session.target.translation - before.translation, 0.01 * axes[:, 1], atol=1e-15)
        np.testing.assert_array_equal(session.target.rotation, before.rotation)


def test_each_tip_of_a_tree_follows_its_own_target():
    robot = mq.Robot.load("baxter")
    session = Session(robot)
    left, right = robot.tips
    before = session.targets
    session.select(right)
    T = session.target.homogeneous.copy()
    T[2, 3] += 0.05
    session.move_target(T)
    view = run(session, 3)
    assert view.standing is Standing.REACHED
    assert readout.sentence(view).startswith("all tools are at their targets")  # baxter's arms may touch, too
    for tip, wanted in ((left, before[left].homogeneous), (right, T)):
        assert np.abs(mq.pose_error(robot.forward(session.q, tip), pin.SE3(wanted))).max() < 1e-5
    assert np.abs(mq.pose_error(before[right], robot.forward(session.q, right))).max() > 0.04
    with pytest.raises(FrameError, match=left):
        session.select("hand")


def test_links_that_are_in_each_other_are_found_as_pinocchio_finds_them(maira, rng, tmp_path):
    """Those that are not neighbours: these are in each other by design."""
    file = tmp_path / "arm.urdf"
    file.write_text(maira.urdf)
    geometry = pin.buildGeomFromUrdf(maira.model, str(file), pin.GeometryType.COLLISION)
    geometry.addAllCollisionPairs()
    data, geometry_data = maira.model.createData(), geometry.createData()
    links = [maira.model.frames[one.parentFrame].name for one in geometry.geometryObjects]
    place = {name: i for i, name in enumerate(["base_link", *maira.moved_links, "tool0"])}
    session = Session(maira)
    run(session, 0.2)
    seen = 0
    for _ in range(40):
        session.arm.put(maira.random_configuration(rng))
        for _ in range(8):
            view = session.tick(DT)
        pin.updateGeometryPlacements(maira.model, data, geometry, geometry_data, session.q)
        pin.computeDistances(geometry, geometry_data)
        near = {1: set(), -1: set()}
        for pair, result in zip(geometry.collisionPairs, geometry_data.distanceResults, strict=True):
            names = links[pair.first], links[pair.second]
            if abs(place[names[0]] - place[names[1]]) > 1 and abs(result.min_distance) > 1e-3:
                near[1 if result.min_distance < 0 else -1].add(frozenset(names))
        found = {frozenset((one.first, one.second)) for one in view.overlaps}
        assert near[1] <= found
        assert not found & (near[-1] - near[1])
        seen += bool(near[1])
    assert seen > 3


def test_solutions_are_named_and_coloured_by_what_they_are(maira):
    session = Session(maira)
    ghosts = ghosts_of(mq.Solver(maira), session.targets)
    assert len(set(ghosts.names)) == len(ghosts.names) == len(ghosts.q) > 1
    for name, q in zip(ghosts.names, ghosts.q, strict=True):
        shoulder, elbow, wrist = (maira.forward(q, link).translation for link in ("link2", "link4", "link6"))
        line = wrist - shoulder
        height = (elbow - shoulder - line * ((elbow - shoulder) @ line / (line @ line)))[2]
        assert elbow_word(maira, q) in name
        if abs(height) > 0.05:
            assert ("elbow up" if height > 0 else "elbow down") in name
    costs = [one.cost for one in ghosts.shown]
    assert (np.diff(costs) >= 0).all()
    assert (ghosts.ranks[0], ghosts.ranks[-1]) == (0, 1)
    assert ghost_colour(0.0) != ghost_colour(0.5) != ghost_colour(1.0)


def test_an_obstacle_is_turned_and_taken_away_alone(maira):
    session = Session(maira)
    for k, name in enumerate(("near", "far")):
        session.put_obstacle(mq.Box([0.05, 0.05, 0.4], mq.pose([0.9 + k, 0.9, 0.4]), name=name))
    run(session, 0.1)
    upright = {one.obstacle: one.distance for one in session.tick(DT).clearances}
    session.move_obstacle("near", mq.pose([0.9, 0.9, 0.4], rpy=[0, np.pi / 2, 0]).homogeneous)
    run(session, 0.1)
    turned = {one.obstacle: one.distance for one in session.tick(DT).clearances}
    assert abs(turned["near"] - upright["near"]) > 1e-3
    assert turned["far"] == upright["far"]
    session.remove_obstacles("near")
    session.move_obstacle("near", np.eye(4))  # dragged when it was taken away
    run(session, 0.1)
    assert [one.obstacle for one in session.tick(DT).clearances] == ["far"]
    with pytest.raises(OptionError, match="near"):
        session.remove_obstacles("near")
