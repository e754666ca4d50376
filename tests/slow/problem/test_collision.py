"""The collision limit against `coal` called pair by pair, against finite differences, and in a control loop."""

import logging
import math
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from support.robots import load, urdf_file

import maira_qp as mq
from maira_qp.errors import MairaError, OptionError, RobotError
from maira_qp.problem.limits.collision import CollisionLimit, Contact
from maira_qp.problem.limits.joint import Tick
from maira_qp.robots.collision.levers import levers
from maira_qp.robots.collision.scene import Part
from maira_qp.robots.collision.shapes import Box, Capsule, Sphere

OBSTACLES = (
    Sphere(0.1, mq.pose([0.5, 0, 0.5]), name="ball"),
    Box([0.2, 0.3, 0.4], mq.pose([-0.5, 0.1, 0.5], rpy=[0.1, 0.2, 0.3]), name="crate"),
    Capsule(0.05, 0.5, mq.pose([0, 0.5, 0.4], rpy=[0.5, 0, 0]), name="pipe"),
)
SHARE = urdf_file("panda").parents[4]
ROBOTS = ["maira", "panda", "ur5", "xarm7", "panda_finger"]
WITHIN = {"maira": 2e-3}
"""What gradients are good to: `coal` finds the direction between two round edges to the root of its tolerance."""


@cache
def robot_of(name: str) -> mq.Robot:
    return mq.Robot.maira() if name == "maira" else load(name)


@cache
def limit_of(name: str, allowed: str = "adjacent") -> CollisionLimit:
    return CollisionLimit(obstacles=OBSTACLES, allowed=allowed, meshes=[SHARE]).of(robot_of(name))


def srdf(name: str) -> Path:
    return SHARE / "example-robot-data" / "robots" / name


def arm(*links: str, kind: str = "revolute", velocity: float = 1.0) -> mq.Robot:
    """A planar arm of links 1 m long, each with the shapes given, all joints about z (or along x)."""
    text = '<link name="l0"/>'
    for i, shapes in enumerate(links, start=1):
        text += f'<link name="l{i}">{shapes}</link><joint name="j{i}" type="{kind}">'
        text += f'<origin xyz="{int(i > 1)} 0 0"/><parent link="l{i - 1}"/><child link="l{i}"/>'
        text += f'<axis xyz="{"0 0 1" if kind == "revolute" else "1 0 0"}"/>'
        text += f'<limit lower="-3" upper="3" velocity="{velocity}" effort="1"/></joint>'
    return mq.Robot.from_urdf(f'<robot name="arm">{text}</robot>')


def ball(radius: float, x: float = 0.0) -> str:
    return f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius="{radius}"/></geometry></collision>'


def plain_distances(limit: CollisionLimit, q: np.ndarray) -> dict[tuple[int, int], float]:
    """The distance of every pair by a call of its own, from placements by Pinocchio's frames."""
    robot, scene = limit.scene.robot, limit.scene
    placements, solids = [], []
    for part in scene.parts:
        link = robot.forward(q, part.name) if part.name in robot.frames else pin.SE3.Identity()
        T = link * part.shape.pose
        placements.append(coal.Transform3s(T.rotation, T.translation))
        solids.append(part.shape.solid())
    found = {}
    for a, b in scene.pairs:
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        found[a, b] = coal.distance(solids[a], placements[a], solids[b], placements[b], request, result)
    return found


def limit_parts(robot: mq.Robot) -> list[Part]:
    """The robot's own parts."""
    return [part for part in CollisionLimit().of(robot).scene.parts if part.name in robot.frames]


# Distances and gradients


@pytest.mark.parametrize("name", ROBOTS)
def test_near_pairs_are_those_of_a_plain_loop(name, rng):
    """Every pair within the reach is found, none beyond, and the smallest of all distances."""
    limit, robot = limit_of(name), robot_of(name)
    for _ in range(10):
        at = robot.at(robot.random_configuration(rng))
        expected = plain_distances(limit, at.q)
        contacts = limit.scene.contacts(at.q, 0.11)
        found = {limit.scene.pairs[pair]: d for pair, d in zip(contacts.pairs, contacts.distances, strict=True)}
        assert found.keys() >= {pair for pair, d in expected.items() if d < 0.11 - 1e-5}
        assert all(expected[pair] < 0.11 + 1e-5 for pair in found)
        assert max((abs(expected[pair] - d) for pair, d in found.items()), default=0.0) < 5e-6
        assert limit.distance(at) == pytest.approx(min(expected.values()), abs=5e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_rows_are_minus_the_gradients_of_the_distances(name, rng):
    """Central differences, wherever the two one-sided differences agree: no jump of the nearest points."""
    limit, robot = limit_of(name), robot_of(name)
    compared, step = 0, 1e-6
    for _ in range(40):
        q = robot.random_configuration(rng)
        here = limit.scene.contacts(q, 0.11)
        if not len(here.pairs):
            continue
        G, h = limit.rows(robot.at(q), None)
        np.testing.assert_array_equal(h, here.distances - limit.margin)
        ahead, back = np.empty(G.shape), np.empty(G.shape)
        for j, dq in enumerate(step * np.eye(robot.n)):
            for side, column in ((dq, ahead), (-dq, back)):
                there = limit.scene.contacts(q + side, 0.2)
                column[:, j] = there.distances[np.isin(there.pairs, here.pairs)]
        smooth = (np.abs(ahead + back - 2 * here.distances[:, None]) < 1e-10).all(axis=1)
        differences = (ahead - back) / (2 * step)
        np.testing.assert_allclose(G[smooth], -differences[smooth], atol=WITHIN.get(name, 1e-6))
        compared += int(smooth.sum())
    assert compared > 20


@pytest.mark.parametrize("name", ["maira", "panda", "panda_finger"])
def test_gradient_is_that_of_the_point_jacobians(name, rng):
    """`n^T (J_b(p) - J_a(p))` with the Jacobians of the two links; a mimic joint counts for its leader."""
    limit, robot = limit_of(name), robot_of(name)
    at = robot.at(robot.random_configuration(rng))
    contacts = limit.scene.contacts(at.q, math.inf)
    for pair, n, p, gradient in zip(contacts.pairs, contacts.normals, contacts.points, contacts.gradients, strict=True):
        expected = np.zeros(robot.n)
        for part, sign in zip(limit.scene.pairs[pair], (-1, 1), strict=True):
            link = limit.scene.parts[part].name
            if link in robot.frames:
                J, arm = at.jacobian(link), p - at.placement(link).translation
                expected += sign * (n @ J[:3] + np.cross(arm, n) @ J[3:])
        np.testing.assert_allclose(gradient, expected, atol=1e-12)


@pytest.mark.rounding
def test_answers_depend_on_q_alone(rng):
    """Not on what was asked before, nor on how far was looked; to rounding, which where an array begins may change."""
    limit, robot = limit_of("panda"), robot_of("panda")
    qs = [robot.random_configuration(rng) for _ in range(20)]
    first = [limit.rows(robot.at(q), None) for q in qs]
    for q, rows in reversed(list(zip(qs, first, strict=True))):
        limit.distance(robot.at(q))
        at = robot.at(q)
        limit.scene.contacts(at.q, 1.0)
        again = limit.rows(at, None)
        assert (rows is None) == (again is None)
        if rows is not None:
            np.testing.assert_allclose(again[0], rows[0], rtol=0, atol=1e-14)
            np.testing.assert_allclose(again[1], rows[1], rtol=0, atol=1e-14)


def test_distances_are_found_once_a_configuration():
    limit, robot = limit_of("panda"), robot_of("panda")
    at = robot.at(np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785]))
    assert limit.rows(at, None) is not None
    contacts = limit.scene.contacts(at.q, limit.margin + limit.influence)
    limit.violation(at), limit.active(at), limit.rows(at, None)
    assert limit.scene.contacts(at.q, limit.margin + limit.influence) is contacts


@pytest.fixture
def hasty_threads():
    """Threads take turns after every few instructions."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


@pytest.mark.usefixtures("hasty_threads")
def test_threads_share_a_limit(rng):
    """Eight threads at once find what one finds."""
    limit, robot = limit_of("panda"), robot_of("panda")
    qs = [robot.random_configuration(rng) for _ in range(60)]
    one = [limit.distance(robot.at(q)) for q in qs]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(lambda q: limit.distance(robot.at(q)), qs * 4)) == one * 4


def test_pickled_limit_needs_no_files(tmp_path, rng):
    """It carries its hulls."""
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    robot = arm('<collision><geometry><mesh filename="m.obj"/></geometry></collision>')
    limit = CollisionLimit(obstacles=[Sphere(0.1, mq.pose([1.5, 0, 0]), name="ball")], meshes=[tmp_path]).of(robot)
    (tmp_path / "m.obj").unlink()
    copy = pickle.loads(pickle.dumps(limit))
    at = robot.at(np.array([0.3]))
    assert copy.nearest(at).distance == limit.nearest(at).distance == pytest.approx(limit.distance(at))


# What is told


def test_violation_active_and_nearest():
    """A ball on a slide before a wall: by name, to the millionth of a metre."""
    robot = arm(ball(0.1), kind="prismatic")
    wall = Box([0.2, 2, 2], mq.pose([1.1, 0, 0]), name="wall")
    limit = CollisionLimit(obstacles=[wall], margin=0.02).of(robot)
    for x, violation, active in [(0.7, 0, []), (0.88, 0, ["l1 - wall"]), (0.885, 0.005, ["l1 - wall"]), (0, 0, [])]:
        at = robot.at(np.array([x]))
        assert limit.violation(at) == pytest.approx(violation, abs=1e-8)
        assert limit.active(at) == active
        assert limit.distance(at) == pytest.approx(0.9 - x, abs=1e-8)
        contact = limit.nearest(at)
        assert isinstance(contact, Contact)
        assert contact[:2] == ("l1", "wall")
        np.testing.assert_allclose([contact.first_point[0], contact.second_point[0]], [x + 0.1, 1.0], atol=1e-8)


def test_shapes_of_one_link_are_named_once():
    robot = arm(ball(0.1) + ball(0.1, 0.05), kind="prismatic")
    limit = CollisionLimit(obstacles=[Sphere(0.1, mq.pose([0.2, 0, 0]))]).of(robot)
    assert limit.active(robot.at(np.zeros(1))) == ["l1 - obstacle1"]
    assert len(limit.rows(robot.at(np.zeros(1)), None)[1]) == 2


@pytest.mark.parametrize("shape", [Sphere(0.1), Box([0.1, 0.2, 0.3]), Capsule(0.1, 0.3)])
@pytest.mark.parametrize("own", ['<sphere radius="0.1"/>', '<cylinder radius="0.1" length="0.3"/>'])
def test_concentric_and_touching_shapes_have_finite_rows(shape, own):
    """A distance, and a gradient of unit length or zero where the way out is across the slide."""
    robot = arm(f"<collision><geometry>{own}</geometry></collision>", kind="prismatic")
    limit = CollisionLimit(obstacles=[shape]).of(robot)
    for x in (0.0, 1e-12, 1e-9, 1e-6, 0.15, 0.2, 0.2 - 1e-12, 0.2 + 1e-12):
        G, h = limit.rows(robot.at(np.array([x])), None)
        assert np.isfinite(G).all()
        assert np.isfinite(h).all()
        assert np.abs(G).max() <= 1 + 1e-9
        contacts = limit.scene.contacts(np.array([x]), 0.11)
        np.testing.assert_allclose(np.linalg.norm(contacts.normals, axis=1), 1, atol=1e-6)
        assert -0.5 < h[0] < 0.1


def test_overlapping_shapes_are_pushed_apart():
    """Inside the ball, the row asks for the way out, on either side of its middle."""
    robot = arm(ball(0.1), kind="prismatic")
    limit = CollisionLimit(obstacles=[Sphere(0.1)]).of(robot)
    for x in (-0.05, 0.05):
        G, h = limit.rows(robot.at(np.array([x])), None)
        np.testing.assert_allclose(G, [[-np.sign(x)]], atol=1e-6)
        np.testing.assert_allclose(h, [-0.15 - 0.01], atol=1e-6)


# Pairs


def names_of(limit: CollisionLimit) -> set[tuple[str, str]]:
    return {(limit.scene.parts[a].name, limit.scene.parts[b].name) for a, b in limit.scene.pairs}


def test_adjacent_links_may_touch():
    """Links joined by a joint, and what is fixed to either of them; the base and obstacles do not move."""
    text = arm(*[ball(0.1)] * 4).urdf.replace("</robot>", "")
    text = text.replace('<link name="l0" />', f'<link name="l0">{ball(0.1)}</link>')
    text += f'<link name="tool">{ball(0.1)}</link><joint name="f" type="fixed"><parent link="l4"/>'
    robot = mq.Robot.from_urdf(text + '<child link="tool"/></joint></robot>')
    limit = CollisionLimit(obstacles=[Sphere(0.1, name="ball")]).of(robot)
    links = {("l0", "l2"), ("l0", "l3"), ("l0", "l4"), ("l0", "tool"), ("l1", "l3"), ("l1", "l4"), ("l1", "tool")}
    links |= {("l2", "l4"), ("l2", "tool")}
    assert names_of(limit) == links | {(link, "ball") for link in ("l1", "l2", "l3", "l4", "tool")}
    alone = CollisionLimit(obstacles=[Sphere(0.1, name="ball")], self_collision=False).of(robot)
    assert names_of(alone) == names_of(limit) - links
    fewer = CollisionLimit(obstacles=[Sphere(0.1, name="ball")], allowed=[("l2", "l0"), ("ball", "tool")]).of(robot)
    assert names_of(limit) - names_of(fewer) == {("l0", "l2"), ("tool", "ball")}


def test_srdf_allows_pairs(caplog):
    """Panda's own: its hand may touch what the file says, also where links are not neighbours."""
    all_pairs, fewer = names_of(limit_of("panda")), limit_of("panda", str(srdf("panda_description/srdf/panda.srdf")))
    removed = all_pairs - names_of(fewer)
    assert ("panda_link5", "panda_link7") in removed
    assert names_of(fewer) < all_pairs
    assert {pair for pair in all_pairs if pair[1] in ("ball", "crate", "pipe")} <= names_of(fewer)
    assert not caplog.records
    with caplog.at_level(logging.WARNING):
        CollisionLimit(allowed=srdf("talos_data/srdf/talos.srdf")).of(robot_of("maira"))
    assert "allows no pair of links of this robot" in caplog.text


def test_sampled_pairs_are_those_that_always_touch():
    """A ball at the end of the first link is in that of the third at every angle, in that of the fourth at some."""
    robot = arm(ball(0.1, 1.0), "", ball(1.2), ball(0.5))
    adjacent, sampled = CollisionLimit().of(robot), CollisionLimit(allowed="sampled").of(robot)
    assert names_of(adjacent) == {("l1", "l3"), ("l1", "l4")}
    assert names_of(sampled) == {("l1", "l4")}


def test_sampled_pairs_are_always_the_same():
    """Whoever asks: of a pair that is near in 95 % of all configurations, a draw of its own would tell now and then."""
    radius = 2 * math.cos(0.075) - 0.11  # the distance 2 cos(q3 / 2) at 5 % of 3 rad
    limits = [CollisionLimit(allowed="sampled").of(arm(ball(0.1, 1.0), "", "", ball(radius))) for _ in range(10)]
    assert len({limit.scene.pairs for limit in limits}) == 1


def test_maira_stands_free_of_itself(maira):
    """Her shapes are made so that neighbours do not touch, with the arm bent a little."""
    limit = CollisionLimit().of(maira)
    assert limit.distance(maira.at(np.array([0, 0.5, 0, 1.0, 0, 0.5, 0]))) > limit.margin


# Ticks


def test_approach_slows_down_and_reaches_the_margin():
    """At the full speed that the row allows, what is left shrinks to `1 / (1 + gain dt)` a tick, to nothing."""
    robot = arm(ball(0.1), kind="prismatic")
    limit = CollisionLimit(obstacles=[Box([0.2, 2, 2], mq.pose([1.1, 0, 0]))], margin=0.02, gain=8).of(robot)
    q, left, dt = np.array([0.80]), [], 0.01
    for _ in range(270):
        G, h = limit.rows(robot.at(q), Tick(dt=dt, velocity=np.zeros(1)))
        left.append(0.88 - q[0])
        q = q + h / G[0, 0]
    assert all(b == pytest.approx(a / 1.08, abs=1e-8) for a, b in pairwise(left))
    assert 0 <= left[-1] < 1e-8
    G, h = limit.rows(robot.at(np.array([0.8])), Tick(dt=1.0, velocity=np.zeros(1)))
    np.testing.assert_allclose(h, [0.08 * 8 / 9], atol=1e-8)  # a long tick goes most of the way
    G, h = limit.rows(robot.at(np.array([0.89])), Tick(dt=dt, velocity=np.zeros(1)))
    np.testing.assert_allclose(h, [-0.01], atol=1e-8)  # what is broken is told in full


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_limited_acceleration_stops_before_the_margin(speed):
    """From full speed toward a wall, each tick as fast as the rows and the acceleration allow."""
    robot = arm(ball(0.1), kind="prismatic", velocity=speed).limited(acceleration=1.5)
    limit = CollisionLimit(obstacles=[Box([0.2, 2, 2], mq.pose([2.9, 0, 0]))], margin=0.02, influence=0.05).of(robot)
    q, v, dt = np.array([-2.0]), np.array([speed]), 0.004
    for _ in range(int(12 / dt)):
        rows = limit.rows(robot.at(q), Tick(dt=dt, velocity=v))
        allowed = np.inf if rows is None else rows[1][0] / rows[0][0, 0] / dt
        assert allowed >= v[0] - 1.5 * dt - 1e-9  # braking as hard as it can is always enough
        v = np.clip(np.minimum(allowed, speed), v - 1.5 * dt, v + 1.5 * dt)
        q = q + v * dt
    assert limit.violation(robot.at(q)) == pytest.approx(0.0, abs=1e-7)
    assert q[0] == pytest.approx(2.68, abs=1e-3)


def test_fast_arm_looks_farther(rng):
    """With limited accelerations, rows come for all pairs that could be too fast after a tick, and only for those."""
    robot = robot_of("panda").limited(acceleration=5.0)
    limit = CollisionLimit(obstacles=OBSTACLES, allowed="sampled", meshes=[SHARE]).of(robot)
    gain, dt = float((5.0 / robot.velocity_limit).min()), 0.01
    beyond = dropped = 0
    for _ in range(20):
        at = robot.at(robot.random_configuration(rng))
        v = rng.uniform(-1, 1, 7) * robot.velocity_limit
        rows = limit.rows(at, Tick(dt=dt, velocity=v))
        G, h = rows or (np.empty((0, 7)), np.empty(0))
        every = limit.scene.contacts(at.q, math.inf)
        left = every.distances - limit.margin
        allowed = np.where(left > 0, gain * dt / (1 + gain * dt) * left, left)
        most = -every.gradients @ v * dt + 5.0 * dt**2 * np.abs(every.gradients).sum(axis=1)
        wanted = (left < limit.influence) | (allowed <= most)
        np.testing.assert_array_equal(h, allowed[wanted])
        np.testing.assert_array_equal(G, -every.gradients[wanted])
        beyond, dropped = beyond + (wanted & (left > limit.influence)).sum(), dropped + (~wanted).sum()
    assert beyond > 20
    assert dropped > 20


def test_control_loop_stays_clear():
    """Sent into the ball by a solver that was pickled, the arm comes to rest at the margin."""
    robot = robot_of("panda")
    limit = CollisionLimit(obstacles=[Sphere(0.08, mq.pose([0.5, 0.15, 0.45]), name="ball")], meshes=[SHARE])
    solver = pickle.loads(pickle.dumps(mq.Solver(robot, limits=[limit])))
    limit, q = limit.of(robot), np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
    target = robot.forward(q)
    target.translation = np.array([0.5, 0.15, 0.45])
    violations = []
    for _ in range(150):
        step = solver.step(q, target, 0.01)
        q = step.q
        violations.append(limit.violation(robot.at(q)))
    assert max(violations) < 1e-4
    assert np.abs(step.velocity).max() < 0.05
    assert limit.nearest(robot.at(q)).second == "ball"
    assert limit.distance(robot.at(q)) == pytest.approx(limit.margin, abs=1e-4)


@pytest.mark.parametrize("name", ["maira", "panda", "panda_finger", "tiago"])
def test_levers_bound_the_speed_of_every_shape(name, rng):
    """The velocity of the middle of a shape, by differences."""
    robot = robot_of(name)
    parts = [part for part in limit_of(name).scene.parts if part.name in robot.frames]
    bound = levers(robot.model, parts)
    for _ in range(5):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.n)
        for part in parts[:: max(1, len(parts) // 10)]:
            ends = [(robot.forward(q + dt * v, part.name) * part.shape.pose).translation for dt in (-1e-6, 1e-6)]
            assert np.linalg.norm(ends[1] - ends[0]) / 2e-6 <= bound @ np.abs(v) + 1e-6


def test_levers_of_a_stretched_arm():
    """As long as what the joint carries, or 1 for a slide."""
    turning, sliding = arm("", "", ball(0.1)), arm(ball(0.1), kind="prismatic")
    found = levers(turning.model, limit_parts(turning))
    assert (found >= [2.1, 1.1, 0.1]).all()
    assert (found <= [2.2, 1.2, 0.2]).all()
    np.testing.assert_allclose(levers(sliding.model, limit_parts(sliding)), [1.0])


# Degenerate cases and mistakes


def test_no_pairs_at_all():
    """Nothing to hit: no rows, no violation, infinitely far."""
    robot = arm(ball(0.1), ball(0.1))
    for limit in (CollisionLimit().of(robot), CollisionLimit(self_collision=False).of(robot)):
        at = robot.at(np.zeros(2))
        assert limit.rows(at, None) is None
        assert limit.rows(at, Tick(dt=0.01, velocity=np.zeros(2))) is None
        assert (limit.violation(at), limit.distance(at), limit.nearest(at), limit.active(at)) == (0, math.inf, None, [])


def test_robot_without_shapes_is_refused():
    with pytest.raises(OptionError, match="arm has no collision shapes"):
        CollisionLimit(obstacles=[Sphere(0.1)]).of(arm("", ""))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"margin": -0.01}, "margin of a CollisionLimit must be positive"),
        ({"margin": np.nan}, "finite"),
        ({"influence": 0}, "influence of a CollisionLimit must be positive"),
        ({"gain": -1}, "gain of a CollisionLimit must be positive"),
        ({"obstacles": Sphere(0.1)}, "must be shapes in a sequence"),
        ({"obstacles": 3}, "must be shapes in a sequence"),
        ({"obstacles": ["ball"]}, "obstacle 1 is not a Sphere, Ellipsoid, Box"),
        ({"obstacles": [Sphere(0.1, name="a"), Sphere(0.2, name="a")]}, "two obstacles have the name 'a'"),
        ({"obstacles": [Sphere(0.1, name="l1")]}, "the name of a link of arm: 'l1'"),
        ({"allowed": "ajacent"}, "neither 'adjacent' nor 'sampled' nor an SRDF file"),
        ({"allowed": Path("none.srdf")}, "nor an SRDF file"),
        ({"allowed": 3}, "a sequence of pairs of names, not 3"),
        ({"allowed": ["l1"]}, "not a pair of names: 'l1'"),
        ({"allowed": [("l1", "l2", "l3")]}, "not a pair of names"),
        ({"allowed": [("l1", "l22")]}, "'l22' is not a link or an obstacle; did you mean 'l2'"),
        ({"meshes": ["/no/such/folder"]}, "'/no/such/folder' is not a directory"),
        ({"meshes": 3}, "sequence of directories"),
        ({"missing": "skip"}, "valid names: error, ignore"),
    ],
)
def test_mistakes_are_told(options, words):
    with pytest.raises(OptionError, match=words):
        CollisionLimit(**options).of(arm(ball(0.1), ball(0.1), ball(0.1)))


def test_srdf_that_is_none(tmp_path):
    for text, words in [("<urdf/>", "not an SRDF"), ("<robot><disable_collisions link1='a'/></robot>", "lacks link2")]:
        (tmp_path / "a.srdf").write_text(text)
        with pytest.raises(RobotError, match=words):
            CollisionLimit(allowed=tmp_path / "a.srdf").of(arm(ball(0.1), ball(0.1)))
    assert issubclass(RobotError, MairaError)
