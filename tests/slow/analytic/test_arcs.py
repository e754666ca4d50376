"""The limits of S-R-S arms as sets of the swivel angle, against sampling, Pinocchio and the numerical solver."""

from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from support.srs_arms import LIMITS, iiwa14_without_offset, random_arm, swivel_of, worst_error

import maira_qp as mq
from maira_qp.analytic.srs.arcs import MOST, Arc, arcs, arcs_near, without
from maira_qp.analytic.srs.geometry import BRANCHES, SRS, rotations, wrapped
from maira_qp.orientation import pose_error

PI = np.pi


@pytest.fixture(scope="module")
def arms() -> dict[str, mq.Robot]:
    """S-R-S arms of the catalog, of a URDF, and at random with limits of all kinds."""
    pin.seed(5)
    rng = np.random.default_rng(5)
    known = {"maira": mq.Robot.maira(), "iiwa14": mq.Robot.iiwa14(), "urdf": iiwa14_without_offset()}
    return known | {name: random_arm(rng, limits) for name, limits in LIMITS.items()}


NAMES = ["maira", "iiwa14", "urdf", *LIMITS]


def equivalents(robot: mq.Robot, q: np.ndarray) -> np.ndarray:
    """How many configurations (N,) within the limits are q (N, 7) up to whole turns; a continuous joint has one."""
    continuous = np.isinf(robot.lower)
    lower, upper = np.where(continuous, 0.0, robot.lower), np.where(continuous, 0.0, robot.upper)
    counts = np.floor((upper - q) / (2 * PI)) - np.ceil((lower - q) / (2 * PI)) + 1
    counts = np.where(continuous & ~np.isnan(q), 1, np.nan_to_num(counts))
    return counts.clip(0).prod(axis=-1)


def on_arcs(found: list[Arc], psi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How many of the arcs hold each psi (N,), and how far [rad] it is from the nearest end of any."""
    count, away = np.zeros(len(psi)), np.full(len(psi), np.inf)
    for arc in found:
        count += (arc.lower + np.mod(psi - arc.lower, 2 * PI)) <= arc.upper
        for end in (arc.lower, arc.upper):
            away = np.minimum(away, np.abs(wrapped(psi - end)))
    return count, away


def through(found: list[Arc], psi: float) -> np.ndarray:
    """The configurations (k, 7) at psi [rad] of the arcs that hold it, or end within 1e-6 rad of it."""
    turned = [(arc, psi + turn) for arc in found for turn in (-2 * PI, 0, 2 * PI)]
    return np.array([arc.at(p) for arc, p in turned if arc.lower - 1e-6 <= p <= arc.upper + 1e-6]).reshape(-1, 7)


def configurations_at(robot: mq.Robot, srs: SRS, T: np.ndarray, psi: float) -> np.ndarray:
    """All configurations (k, 7) within the limits at one swivel angle: every branch with every choice of turns."""
    found = []
    for q in srs.configurations(T, psi):
        turned = q + 2 * PI * np.arange(-3, 4)[:, None]
        within = (robot.lower - 1e-9 <= turned) & (turned <= robot.upper + 1e-9)
        choices = [each[fits] for each, fits in zip(turned.T, within.T, strict=True)]
        found += list(product(*choices))
    return np.reshape(found, (-1, 7))


def disagreements(robot: mq.Robot, T: np.ndarray, found: list[Arc], psi: np.ndarray) -> tuple[int, int]:
    """At how many of psi (N,) on the eight branches the arcs hold another number of configurations than there are.

    And how many there are.
    """
    srs, wrong, inside = SRS.of(robot), 0, 0
    for elbow in srs.elbow_branches(T):
        for k, q in enumerate(srs.evaluate(elbow, psi).swapaxes(0, 1)):
            branch = [b for b in BRANCHES if b.elbow == elbow.sign][k]
            count, away = on_arcs([arc for arc in found if arc.branch == branch], psi)
            truth = equivalents(robot, q)
            wrong += int(((count != truth) & (away > 1e-9)).sum())
            inside += int((truth > 0).sum())
    return wrong, inside


@pytest.mark.parametrize("name", NAMES)
def test_arcs_hold_what_is_within_the_limits_and_nothing_else(arms, rng, name):
    """So many arcs hold a swivel angle as there are configurations at it: 40,000 samples on each of seven arms."""
    robot = arms[name]
    inside = 0
    for _ in range(10):
        T = robot.forward(robot.random_configuration(rng)).homogeneous
        wrong, seen = disagreements(robot, T, arcs(SRS.of(robot), T), rng.uniform(-PI, PI, 500))
        assert wrong == 0
        inside += seen
    assert 100 < inside < 40_000 * 0.99


SYMMETRIC = {
    "down": mq.pose([0.4, 0.2, 0.9], quaternion=[0, 1, 0, 0]),
    "down, in the arm's plane": mq.pose([0.5, 0.0, 0.9], quaternion=[0, 1, 0, 0]),
    "down, behind": mq.pose([-0.5, 0.0, 0.9], quaternion=[0, 1, 0, 0]),
    "forward": mq.pose([0.6, 0.0, 0.8], rpy=[0, PI / 2, 0]),
    "up": mq.pose([0.3, 0.3, 1.0]),
    "sideways": mq.pose([0.0, 0.5, 0.7], rpy=[PI / 2, 0, 0]),
}
"""Poses at which several joints of an arm with axes at right angles are at 0 or 180 degrees at once."""


@pytest.mark.parametrize("name", SYMMETRIC)
def test_symmetric_poses_of_an_arm_whose_joints_end_at_a_turn(arms, rng, name):
    """The arcs hold what dense samples of the swivel find; next to the symmetry, and in it, no configuration is lost.

    An arc is of some length, or it is alone: then no other holds its configuration.
    """
    robot = arms["maira"]
    srs, T = SRS.of(robot), SYMMETRIC[name].homogeneous
    found = arcs(srs, T)
    away = rng.choice([-1, 1], 1_000) * 10 ** rng.uniform(-8, -1, 1_000)
    near = rng.choice([-PI, -PI / 2, 0, PI / 2], 1_000) + away
    assert disagreements(robot, T, found, np.concatenate([np.linspace(-PI, PI, 2_500), near]))[0] == 0
    ends = {float(wrapped(end)) for arc in found for end in (arc.lower, arc.upper)}
    for psi in {-PI, -PI / 2, 0.0, PI / 2, *ends}:
        there = through(found, psi)
        for q in configurations_at(robot, srs, T, psi):
            assert np.abs(there - q).max(axis=1).min() < 1e-5
    for arc in found:
        q = arc.at(arc.lower + np.array([0.0, 0.3, 1.0]) * arc.length)
        assert worst_error(robot, q, T) < 1e-12
        assert ((robot.lower <= q) & (q <= robot.upper)).all()
        assert arc.length == 0 or arc.length > 1e-6
        if arc.length == 0:
            others = through([other for other in found if other is not arc], arc.lower)
            assert np.abs(others - q[0]).max(axis=1).min() > 1e-3


def test_a_joint_that_touches_its_seam_is_there_on_both_sides(arms, rng):
    """A first joint that comes to 180 degrees and turns back: there -180 degrees is an isolated solution."""
    robot, hits = arms["maira"], 0
    srs = SRS.of(robot)
    for _ in range(12):
        T = robot.forward(robot.random_configuration(rng)).homogeneous
        elbow, fine = srs.elbow_branches(T)[0], np.linspace(-PI, PI, 20_001)
        first = np.unwrap(srs.evaluate(elbow, fine)[:, 0, 0])
        if np.ptp(first) > 5:
            continue
        about = pin.SE3(rotations(np.array([0.0, 0.0, 1.0]), PI - first.max()), np.zeros(3)).homogeneous
        turned = about @ T  # now the greatest value is 180 degrees, to the samples' resolution
        found = arcs(srs, turned)
        below = [arc for arc in found if arc.branch == BRANCHES[0] and arc.at(0.5 * (arc.lower + arc.upper))[0] < -3.1]
        inside = np.abs(srs.evaluate(elbow, fine[[first.argmax()]])[0, 0, 1:]) < robot.upper[1:]
        if inside.all():
            hits += 1
            assert below
            assert all(arc.length < 1e-2 for arc in below)
    assert hits >= 3


@pytest.mark.parametrize("name", NAMES)
def test_every_configuration_within_the_limits_is_on_an_arc(arms, rng, name):
    """Whatever the configuration, one of the arcs for its pose goes through it."""
    robot = arms[name]
    srs = SRS.of(robot)
    for _ in range(8):
        q = robot.random_configuration(rng)
        psi = swivel_of(srs, q)
        off = through(arcs(srs, robot.forward(q)), psi) - q
        off = np.where(np.isinf(robot.lower), wrapped(off), off)
        assert np.abs(off).max(axis=1).min() < 1e-8


@pytest.mark.parametrize("name", NAMES)
def test_all_of_an_arc_reaches_the_pose_within_the_limits(arms, rng, name):
    """To 1e-13, and inside the limits to the bit, its ends included; and it is one piece."""
    robot = arms[name]
    srs = SRS.of(robot)
    for _ in range(4):
        T = robot.forward(robot.random_configuration(rng)).homogeneous
        found = arcs(srs, T)
        for arc in [found[i] for i in rng.permutation(len(found))[:8]]:
            q = arc.at(np.linspace(arc.lower, arc.upper, 7))
            assert ((robot.lower <= q) & (q <= robot.upper)).all()
            assert worst_error(robot, q, T) < 1e-13
            assert -PI <= arc.lower <= PI
            assert arc.contains(arc.lower)
            assert arc.contains(arc.upper)
            assert arc.contains(0.5 * (arc.lower + arc.upper))
            assert (arc.lower, arc.upper) == (-PI, PI) or arc.length < 2 * PI + 1e-9


@pytest.mark.parametrize("name", ["maira", "iiwa14", "more than a turn"])
def test_an_arc_is_continuous(arms, rng, name):
    """Steps of a millionth of an arc, at its ends as well, move no joint by a turn."""
    robot = arms[name]
    srs = SRS.of(robot)
    places = np.array([[0.0, 1e-6], [0.5, 0.500001], [0.999999, 1.0]])
    for _ in range(2):
        found = arcs(srs, robot.forward(robot.random_configuration(rng)))
        for arc in [found[i] for i in rng.permutation(len(found))[:40]]:
            q = arc.at(arc.lower + places * arc.length)
            assert np.abs(q[:, 1] - q[:, 0]).max() < 1.0


def test_beyond_the_annulus_there_is_no_arc(arms, rng):
    """Not a micrometre beyond, in any direction; a micrometre before there are some, where no limit is in the way."""
    for name in ("maira", "iiwa14", "continuous"):
        robot = arms[name].limited()
        srs = SRS.of(robot)
        q = robot.random_configuration(rng)
        q[3] = srs.phase
        if not robot.lower[3] <= q[3] <= robot.upper[3]:
            continue
        T = robot.forward(q).homogeneous
        line = srs.wrist_centre(T) - srs.shoulder
        step = 1e-6 * line / np.linalg.norm(line)
        T[:3, 3] += step
        assert arcs(srs, T) == []
        T[:3, 3] -= 2 * step
        assert arcs(srs, T) != []


def test_the_solver_and_the_arcs_agree(arms, rng):
    """What the numerical solver reaches has arcs, through its answer; where there are none, it does not reach."""
    reached = 0
    for name in ("maira", "iiwa14"):
        robot = arms[name]
        half = robot.limited(lower=0.5 * robot.lower, upper=0.5 * robot.upper)
        srs, solver = SRS.of(half), mq.Solver(half, options=mq.Options(max_restarts=60))
        for _ in range(10):
            T = robot.forward(robot.random_configuration(rng))
            found, solution = arcs(srs, T), solver.solve(T, rng=rng)
            assert solution.success == bool(found)
            reached += solution.success
            if solution.success:
                psi = swivel_of(srs, solution.q)
                assert np.abs(through(found, psi) - solution.q).max(axis=1).min() < 1e-3
    assert 2 < reached < 18


@pytest.mark.parametrize("joint", [0, 1, 2, 4, 5, 6])
def test_a_locked_joint_leaves_isolated_solutions(arms, rng, joint):
    """With one joint locked the arm has six, and its poses have solutions in points, which are found."""
    robot = arms["iiwa14"]
    for _ in range(3):
        q = robot.random_configuration(rng)
        lower, upper = robot.lower.copy(), robot.upper.copy()
        lower[joint] = upper[joint] = q[joint]
        locked = robot.limited(lower=lower, upper=upper)
        found = arcs(SRS.of(locked), robot.forward(q))
        assert 1 <= len(found) <= 16
        assert max(arc.length for arc in found) < 1e-7
        assert min(np.abs(arc.at(arc.lower) - q).max() for arc in found) < 1e-8
        assert all((arc.at(arc.lower)[joint] == q[joint]) for arc in found)


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_slivers_are_found(arms, rng, width):
    """A joint that may turn by little leaves arcs as short, which are found."""
    robot = arms["maira"]
    for joint in (0, 1, 2, 4, 5, 6):
        q = robot.random_configuration(rng)
        lower, upper = robot.lower.copy(), robot.upper.copy()
        lower[joint], upper[joint] = q[joint] - 0.3 * width, q[joint] + 0.7 * width
        narrow = robot.limited(lower=lower.clip(robot.lower), upper=upper.clip(None, robot.upper))
        srs = SRS.of(narrow)
        psi = swivel_of(srs, q)
        found = arcs(srs, robot.forward(q))
        assert np.abs(through(found, psi) - q).max(axis=1).min() < max(1e-8, 1e-3 * width)


def test_a_tangency_is_found(arms, rng):
    """With a limit where a joint's greatest value over the circle is, that one point is inside."""
    robot = arms["iiwa14"]
    srs, hits = SRS.of(robot), 0
    for _ in range(10):
        q = robot.random_configuration(rng)
        T = robot.forward(q)
        elbow = srs.elbow_branches(T.homogeneous)[0]
        psi = np.linspace(-PI, PI, 2_001)
        values = srs.evaluate(elbow, psi)[:, 0]
        top = values[values[:, 1].argmax()]
        fine = psi[values[:, 1].argmax()] + np.linspace(-4e-3, 4e-3, 20_001)
        height = srs.evaluate(elbow, fine)[:, 0, 1].max()
        if not (np.abs(top) < robot.upper - 1e-3).all() or height - np.abs(values[:, 1]).min() < 0.01:
            continue
        lower = robot.lower.copy()
        lower[1] = height  # only the top is left of this branch
        branch = [a for a in arcs(SRS.of(robot.limited(lower=lower)), T) if a.branch == BRANCHES[0]]
        assert len(branch) >= 1
        assert min(np.abs(arc.at(arc.lower) - top).max() for arc in branch) < 1e-2
        assert sum(arc.length for arc in branch) < 1e-5
        hits += 1
    assert hits >= 3


def wide(lower: float, upper: float) -> mq.Robot:
    """MAIRA's geometry with the same limits [rad] for all joints."""
    links = [replace(link, lower=lower, upper=upper) for link in mq.Robot.maira().dh.links if link.kind != "fixed"]
    return mq.Robot.from_dh(links)


@pytest.mark.parametrize("limits", [(-2.9, 6.0), (-7.0, 7.0), (0.0, 7.0)], ids=str)
def test_arcs_of_more_than_a_turn_reach_singular_poses_too(rng, limits):
    """Shoulder or wrist or both stretched: all of each arc reaches the pose, its ends at the singularity as well."""
    robot = wide(*limits)
    srs = SRS.of(robot)
    for singular in ([1], [5], [1, 5]):
        q = robot.random_configuration(rng)
        q[singular] = 0.0
        T = robot.forward(q)
        found = arcs(srs, T)
        assert 0 < len(found) <= MOST
        for arc in [found[i] for i in rng.permutation(len(found))[:40]]:
            q = arc.at(np.linspace(arc.lower, arc.upper, 5))
            assert ((robot.lower <= q) & (q <= robot.upper)).all()
            assert max(np.abs(pose_error(robot.forward(each), T)).max() for each in q) < 1e-7


@pytest.mark.parametrize("name", ["maira", "iiwa14"])
def test_an_arc_is_no_sliver_that_rounding_splits_off_another(arms, rng, name):
    """Of joints on a grid of 45 degrees, where roots are double: what is as good as a point is on no other arc."""
    robot, points = arms[name], 0
    for _ in range(40):
        q = robot.clip(np.round(robot.random_configuration(rng) / (PI / 4)) * PI / 4)
        if abs(q[3]) < 0.1:
            continue
        found = arcs(SRS.of(robot), robot.forward(q))
        for arc in [each for each in found if each.length < 1e-5]:
            others = through([each for each in found if each is not arc], arc.lower)
            assert np.abs(others - arc.at(arc.lower)).max(axis=1, initial=0.0).min(initial=1.0) > 1e-3
            turned = np.ptp(arc.at(np.linspace(arc.lower, arc.upper, 9)), axis=0).max()
            assert arc.is_isolated == (turned < 1e-6)
            assert ("one configuration" in repr(arc)) == arc.is_isolated
            points += arc.is_isolated
    assert points > 3


def test_where_turns_have_no_end_the_nearest_are_listed(rng):
    """Limits of 1e16 rad: as exact as others, and bounded."""
    endless, T = wide(-1e16, 1e16), wide(-3.0, 3.0).forward(rng.uniform(-2.5, 2.5, 7))
    found, complete = arcs_near(SRS.of(endless), T, np.full(7, 30.0))
    assert not complete
    assert 100 < len(found) <= MOST
    for arc in [found[i] for i in rng.permutation(len(found))[:30]]:
        q = arc.at(np.linspace(arc.lower, arc.upper, 3))
        assert np.abs(q - 30.0).max() < 4 * PI
        assert max(np.abs(pose_error(endless.forward(each), T)).max() for each in q) < 1e-10


def test_boxes_without_others_hold_each_of_the_rest_once(rng):
    """Against all whole numbers one by one."""
    for _ in range(200):
        box, other = ((low, low + rng.integers(0, 3, 3)) for low in rng.integers(-2, 3, (2, 3)))
        inside = lambda b, p: bool(((b[0] <= p) & (p <= b[1])).all())  # noqa: E731
        parts = list(without(box, other))
        for point in product(range(-3, 7), repeat=3):
            expected = inside(box, np.array(point)) and not inside(other, np.array(point))
            assert sum(inside(part, np.array(point)) for part in parts) == expected
