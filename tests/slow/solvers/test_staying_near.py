"""With a start the answer stays near it, and says where it does not: held against descents from the start alone."""

import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq

ALONE = mq.Options(max_restarts=0)
TOLERANCE = 1e-6


def robot_of(name):
    """One of the built-in robots, or of the real ones."""
    return {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14}.get(name, lambda: load(name))()


def outward(robot, q, steps, stretch):
    """Poses from that of q (n,) outward and back, at last `stretch` times as far from the base."""
    for k in range(steps):
        pose = robot.forward(q).copy()
        pose.translation = pose.translation * (1 + (stretch - 1) * np.sin(np.pi * (k + 1) / steps) ** 2)
        yield pose


def gained(answer, other):
    """One of the errors is smaller than that of the other answer by more than its tolerance."""
    position = other.position_error - answer.position_error
    return position > TOLERANCE or other.orientation_error - answer.orientation_error > TOLERANCE


@pytest.mark.parametrize(
    "settings",
    [{}, {"redundancy": mq.Strict(mq.Posture())}, {"backend": "daqp", "options": mq.Options(max_restarts=3)}],
    ids=["compiled", "strict", "daqp"],
)
@pytest.mark.parametrize("prefer", [None, "closest"])
def test_the_arm_does_not_swing_at_the_edge_of_the_workspace(iiwa14, settings, prefer):
    """Along a straight line out of reach nearest points follow each other."""
    solver = mq.Solver(iiwa14, **settings)
    q = solver.solve(iiwa14.forward([0.1, 0.9, 0.2, -0.9, 0.3, 0.9, 0.4]), [0.1, 0.9, 0.2, -0.9, 0.3, 0.9, 0.4]).q
    start = iiwa14.forward(q)
    for x in np.arange(0.30, 0.42, 0.01 if settings.get("backend") else 0.005):
        target = start.copy()
        target.translation = target.translation + np.array([x, 0.0, 0.0])
        answer = solver.solve(target, q, prefer=prefer)
        assert x < 0.301 or np.abs(answer.q - q).max() < 0.4
        assert not answer.left_q0
        q = answer.q


@pytest.mark.parametrize("name", ["maira", "iiwa14", "panda", "ur5", "xarm7"])
def test_an_answer_moves_far_only_for_a_gain(name, rng):
    """Out of the workspace and back: no joint moves by 0.5 rad where a descent from the start alone ends as near."""
    robot = robot_of(name)
    solver, alone = mq.Solver(robot), mq.Solver(robot, options=ALONE)
    q = robot.middle + 0.5 * (robot.clip(rng.uniform(-1, 1, robot.n)) - robot.middle)
    for target in outward(robot, q, 120, 1.6):
        answer = solver.solve(target, q)
        if answer.max_joint_change > 0.5:
            there = alone.solve(target, q)
            assert gained(answer, there) or there.max_joint_change >= answer.max_joint_change - 1e-6
            assert answer.left_q0 or answer.q == pytest.approx(there.q)
        q = answer.q


@pytest.mark.rounding
@pytest.mark.parametrize("name", ["maira", "ur5"])
def test_what_leaves_says_so_and_is_better(name, rng):
    """Far starts and far targets: what a batch answers is never worse than the descent from the start alone."""
    robot = robot_of(name)
    starts = np.array([robot.random_configuration(rng) for _ in range(30)])
    targets = np.array([robot.forward(robot.random_configuration(rng)).homogeneous for _ in starts])
    targets[::2, :3, 3] *= 1.5
    batch = mq.Solver(robot).solve_batch(targets, starts)
    alone = mq.Solver(robot, options=ALONE).solve_batch(targets, starts)
    assert batch.left_q0.any()
    assert not batch.left_q0.all()
    for answer, near in zip(batch, alone, strict=True):
        assert gained(answer, near) or not gained(near, answer)
        if answer.left_q0 and not near.left_q0:
            assert gained(answer, near)
        elif near.success:
            assert answer.success


@pytest.mark.parametrize("name", ["ur5", "xarm7"])
@pytest.mark.parametrize("backend", [None, "daqp"])
def test_no_joint_ends_a_turn_too_far_from_the_start(name, backend, rng):
    """Every joint is at the whole turn within its limits that is nearest to the start, reached or not."""
    robot = robot_of(name)
    solver = mq.Solver(robot, backend=backend, options=mq.Options(max_restarts=2 if backend else 50))
    for k in range(8 if backend else 40):
        target, q0 = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        target.translation = target.translation * (1.5 if k % 4 == 0 else 1.0)
        q = solver.solve(target, q0).q
        for turned in (q - 2 * np.pi, q + 2 * np.pi):
            fits = (turned >= robot.lower) & (turned <= robot.upper)
            assert not (fits & (np.abs(turned - q0) < np.abs(q - q0) - 1e-6)).any()


def wide_urdf(mimic: str = "") -> str:
    """Two arms of six joints on a torso, all limits 7 rad; the fifth joint on the left as the element says."""
    ways = [("0 0 0.3", 3), ("0 0 0.1", 2), ("0.4 0 0", 2), ("0.3 0 0", 1), ("0.1 0 0", 2), ("0.1 0 0", 1)]
    names = [("torso", "base", "chest", "0 0 0.5", 3)]
    for side in ("left", "right"):
        links = ["chest", *(f"{side}_link{k}" for k in range(6))]
        y = 0.2 if side == "left" else -0.2
        names += [(f"{side}{k}", links[k], links[k + 1], xyz, axis) for k, (xyz, axis) in enumerate(ways)]
        names[-6] = (*names[-6][:3], f"0 {y} 0.3", 3)
    joints = [
        f'<link name="{child}"/><joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{" ".join(str(int(axis == i)) for i in (1, 2, 3))}"/>'
        f'<limit lower="-7" upper="7" velocity="3" effort="9"/>{mimic if name == "left4" else ""}</joint>'
        for name, parent, child, xyz, axis in names
    ]
    return f'<robot name="wide"><link name="base"/>{"".join(joints)}</robot>'


@pytest.mark.parametrize("multiplier", [None, 1, -1, 2, 0.5])
def test_no_joint_of_a_tree_or_that_leads_another_ends_a_turn_too_far_from_the_start(multiplier, rng):
    """Two arms on a torso; one arm of which a joint follows another, so that not every turn of that is a whole one."""
    follows = "" if multiplier is None else f'<mimic joint="left2" multiplier="{multiplier}"/>'
    tips = ["left_link5", "right_link5"] if multiplier is None else "left_link5"
    robot = mq.Robot.from_urdf(wide_urdf(follows), tip=tips)
    solver, farther = mq.Solver(robot), 0
    for _ in range(3):
        q, q0 = robot.random_configuration(rng), robot.random_configuration(rng)
        answer = solver.solve({tip: robot.forward(q, tip) for tip in robot.tips}, q0)
        assert answer.success
        for i, turn in ((i, turn) for i in range(robot.n) for turn in (-2, -1, 1, 2)):
            turned = answer.q.copy()
            turned[i] += 2 * np.pi * turn
            is_within = robot.lower[i] <= turned[i] <= robot.upper[i]
            errors = [mq.pose_error(robot.forward(turned, t), robot.forward(answer.q, t)) for t in robot.tips]
            if is_within and np.abs(errors).max() < 1e-9:
                farther += 1
                assert abs(turned[i] - q0[i]) > abs(answer.q[i] - q0[i]) - 1e-9
    assert farther > 2


def test_a_far_start_keeps_the_turn_it_has(ur5):
    """The last joint stands a turn below zero, and its solution there is within the limits."""
    target = ur5.forward([-2, -1, 1.5, 0.3, 1, -6])
    q0 = [1.34, 2.884, 0.274, 5.467, 3.969, -6.249]
    answer = mq.Solver(ur5).solve(target, q0)
    assert answer.success
    assert abs(answer.q[5] - q0[5]) < np.pi


def test_how_far_an_answer_went_is_said(maira, rng):
    """As a number of a solution and of a batch, kept by pickles, and NaN without a start."""
    solver, target = mq.Solver(maira), maira.forward(maira.random_configuration(rng))
    q0 = maira.random_configuration(rng)
    answer, batch = solver.solve(target, q0), solver.solve_batch([target] * 3, q0)
    for each in (answer, pickle.loads(pickle.dumps(answer)), batch[1], batch[1:][0]):
        assert each.max_joint_change == pytest.approx(np.abs(answer.q - q0).max())
        assert each.left_q0 == answer.left_q0
        assert each.as_dict()["max_joint_change"] == each.max_joint_change
    assert batch.max_joint_change.shape == batch.left_q0.shape == (3,)
    without = solver.solve(target)
    assert np.isnan(without.max_joint_change)
    assert not without.left_q0
    assert np.isnan(solver.solve_batch([target]).max_joint_change).all()


@pytest.mark.parametrize("redundancy", [mq.Strict(mq.Posture()), mq.Weighted(mq.Posture(), weight=1e-3)])
def test_the_closest_takes_the_place_of_the_redundancy(maira, redundancy, rng):
    """For one call: the same answer as that of a solver without."""
    for _ in range(3):
        target, q0 = maira.forward(maira.random_configuration(rng)), maira.random_configuration(rng)
        plain = mq.Solver(maira).solve(target, q0, prefer="closest")
        both = mq.Solver(maira, redundancy=redundancy).solve(target, q0, prefer="closest")
        assert both.success
        assert both.q == pytest.approx(plain.q, abs=1e-7)
        assert both.max_joint_change == pytest.approx(np.abs(both.q - q0).max())


def test_small_moves_stay_small(panda, rng):
    """Around a loop within the workspace no joint moves ten times further than to the closest solution."""
    solver, q = mq.Solver(panda), panda.middle + 0.3 * rng.uniform(-1, 1, 7)
    begin, swing = q.copy(), 0.3 * rng.uniform(-1, 1, (2, 7))
    for angle in np.linspace(0, 2 * np.pi, 100):
        target = panda.forward(begin + swing[0] * (np.cos(angle) - 1) + swing[1] * np.sin(angle))
        answer = solver.solve(target, q)
        assert answer.success
        assert answer.max_joint_change < 0.3
        q = answer.q


def turns_of(robot, q, near):
    """Whole turns of single joints of q (n,) within the limits that are nearer to a reference (n,): each as a q."""
    for turn in (-2 * np.pi, 2 * np.pi):
        fits = (q + turn >= robot.lower) & (q + turn <= robot.upper) & ~robot.slides
        for i in np.flatnonzero(fits & (np.abs(q + turn - near) < np.abs(q - near) - 1e-3)):
            yield np.where(np.arange(robot.n) == i, q + turn, q)


WISHES = {
    "strict": mq.Strict(mq.Posture()),
    "distance": mq.Strict(mq.LimitDistance()),
    "weighted": mq.Weighted(mq.Posture(), weight=1e-3),
    "none": None,
}


@pytest.mark.parametrize("name", ["ur5", "xarm7"])
@pytest.mark.parametrize("wish", WISHES)
@pytest.mark.parametrize("backend", [None, "daqp"])
def test_without_a_start_every_joint_ends_at_the_turn_nearest_to_the_posture(name, wish, backend, rng):
    """Of what is settled on a self-motion as of nearest points: a self-motion may lead past half a turn."""
    robot = robot_of(name)
    solver = mq.Solver(
        robot, redundancy=WISHES[wish], backend=backend, options=mq.Options(max_restarts=2 if backend else 50)
    )
    poses = [robot.forward(robot.random_configuration(rng)).homogeneous for _ in range(6 if backend else 100)]
    targets = np.array(poses)
    targets[::3, :3, 3] *= 1.5
    for q in solver.solve_batch(targets).q:
        assert not list(turns_of(robot, q, robot.middle))


@pytest.mark.parametrize("wish", ["strict", "distance"])
@pytest.mark.parametrize("backend", [None, "daqp"])
def test_a_turn_too_far_is_a_gain_of_the_redundancy(wish, backend, rng):
    """From a start what is settled is at the nearest turns too, but where these are worse for what was wished."""
    robot = robot_of("xarm7")
    solver = mq.Solver(
        robot, redundancy=WISHES[wish], backend=backend, options=mq.Options(max_restarts=2 if backend else 50)
    )
    objective = WISHES[wish].objectives[0].of(robot)
    for _ in range(6 if backend else 100):
        target, q0 = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        answer = solver.solve(target, q0)
        for turned in turns_of(robot, answer.q, q0):
            assert objective.cost(robot.at(turned)) > objective.cost(robot.at(answer.q))


def weighted_error(solver, answer):
    """|W e|"""
    return np.hypot(
        *np.asarray(solver.tasks[0].all_weights)[[0, 3]] * (answer.position_error, answer.orientation_error)
    )


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_a_trade_off_is_left_for_no_worse_a_pose(ur5, backend, rng):
    """A pose that is reached elsewhere only to be traded off for the posture is no gain over a nearest point here."""
    wish = mq.Weighted(mq.Posture(), weight=1e-3)
    options = mq.Options(max_restarts=2 if backend else 20)
    solver = mq.Solver(ur5, redundancy=wish, backend=backend, options=options)
    alone = mq.Solver(ur5, redundancy=wish, backend=backend, options=ALONE)
    q0, far = [], 10 if backend else 150
    for _ in range(far):
        q = ur5.middle + 0.3 * (ur5.random_configuration(rng) - ur5.middle)
        q[2] = 0.01 * rng.uniform(-1, 1)  # nearly stretched
        q0.append(q)
    targets = np.array([ur5.forward(q).homogeneous for q in q0])
    targets[:, :3, 3] += 0.005 * rng.uniform(-1, 1, (far, 3))
    found, near = solver.solve_batch(targets, np.array(q0)), alone.solve_batch(targets, np.array(q0))
    assert found.left_q0.any() or backend
    for answer, stayed in zip(found[found.left_q0], near[found.left_q0], strict=True):
        assert weighted_error(solver, answer) < weighted_error(solver, stayed)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_the_closest_is_no_farther_than_what_a_solve_finds(name, rng):
    """A list of solutions that is not complete may lack the nearest one, to which a descent from the start leads."""
    robot = robot_of(name)
    solver = mq.Solver(robot)
    for _ in range(12):
        target, q0 = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        found, closest = solver.solve(target, q0), solver.solve(target, q0, prefer="closest")
        assert closest.success >= found.success
        assert np.square(closest.q - q0).sum() <= np.square(found.q - q0).sum() + 1e-3
