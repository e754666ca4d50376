"""Every solution for a pose, and the closest one."""

import pickle
from xml.etree import ElementTree

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.analytic.eaik import Decomposition
from maira_qp.analytic.srs.arcs import arcs
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.robots.model.revolutions import WholeTurns

CLOSED = {"ur5": 10, "ur10": 10, "ur5_limited": 30, "kr210": 80, "puma560": 80, "kinova": 30}
"""Six-axis arms that EAIK decomposes, and how many poses are looked at."""


@pytest.fixture
def no_closed_form(monkeypatch):
    """As if EAIK were not installed."""
    monkeypatch.setattr(Decomposition, "of", staticmethod(lambda robot: None))


def check(robot, target, solutions):
    """Each is within the limits to the bit and reaches the pose; they come in order, and differ (arcs may touch)."""
    q = np.array([one.q for one in solutions]).reshape(-1, robot.n)
    assert ((robot.lower <= q) & (q <= robot.upper)).all()
    for one in solutions:
        e = mq.pose_error(robot.forward(one.q), target)
        assert one.position_error == pytest.approx(np.linalg.norm(e[:3]), abs=1e-12)
        assert one.orientation_error == pytest.approx(np.linalg.norm(e[3:]), abs=1e-12)
        assert max(one.position_error, one.orientation_error) < 1e-6
    costs = [one.cost for one in solutions]
    assert costs == sorted(costs)
    distances = 9.0 if "S-R-S" in solutions.method else np.abs(q[:, None] - q[None]).max(axis=-1) + 9 * np.eye(len(q))
    assert np.min(distances, initial=9.0) > 1e-5
    return q


def missing(solutions, others, robot):
    """How many of others are not among solutions, turns aside."""
    turns = WholeTurns(robot, robot.middle)
    return sum(not (turns.apart(q, solutions) <= 1e-6).any() for q in others)


@pytest.mark.parametrize("name", CLOSED)
def test_a_known_configuration_is_in_the_list(name, rng):
    """Wherever the joints stand, with the turns that they have made."""
    robot = load(name)
    solver, claimed = mq.Solver(robot), 0
    assert Decomposition.of(robot) is not None
    for _ in range(CLOSED[name]):
        known = robot.random_configuration(rng)
        target = robot.forward(known)
        solutions = solver.solutions(target)
        q = check(robot, target, solutions)
        assert np.abs(q - known).max(axis=1).min() < 1e-6
        assert solutions.method == "closed form (EAIK)"
        claimed += solutions.is_complete
    assert claimed > 0.9 * CLOSED[name]


@pytest.mark.parametrize("name", ["ur5_limited", "kr210", "puma560"])
def test_branches_and_descents_agree(name, rng, no_closed_form):
    """A list that claims to be complete misses nothing that descents find; here they find all of it too."""
    robot = load(name)
    solver = mq.Solver(robot)
    for _ in range(20):
        target = robot.forward(robot.random_configuration(rng))
        numerical = solver.solutions(target)
        q = check(robot, target, numerical)
        assert numerical.method == "numerical"
        assert not numerical.is_complete
        assert numerical.starts > numerical.starts_without_new >= 256
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Decomposition, "of", staticmethod(of))
            closed = solver.solutions(target)
        assert closed.method == "closed form (EAIK)"
        others = np.array([one.q for one in closed])
        assert missing(others, q, robot) == 0
        assert missing(q, others, robot) == 0


of = Decomposition.of


@pytest.mark.parametrize("name", ["irb140", "ur5_limited"])
def test_descents_find_a_known_configuration(name, rng, no_closed_form):
    """The first has a wrist whose axes do not meet: no closed form is known for it."""
    robot = load(name)
    solver = mq.Solver(robot)
    for _ in range(30):
        known = robot.random_configuration(rng)
        target = robot.forward(known)
        q = check(robot, target, solver.solutions(target))
        assert np.abs(q - known).max(axis=1).min() < 1e-6


def test_no_closed_form_is_claimed_for_a_wrist_that_does_not_meet(panda):
    assert Decomposition.of(load("irb140")) is None
    assert Decomposition.of(panda) is None


def test_a_known_configuration_of_few_joints_is_in_the_list(rng):
    """Four joints, one of them sliding, one continuous."""
    links = [
        mq.DHLink(kind="continuous", alpha=-1.5, d=0.4),
        mq.DHLink(kind="revolute", a=0.4, lower=-2.0, upper=2.0),
        mq.DHLink(kind="prismatic", a=0.1, alpha=1.0, lower=0.0, upper=0.5),
        mq.DHLink(kind="revolute", a=0.2, lower=-5.0, upper=5.0),
    ]
    robot = mq.Robot.from_dh(links)
    solver = mq.Solver(robot)
    for _ in range(10):
        known = robot.random_configuration(rng)
        q = check(robot, robot.forward(known), solver.solutions(robot.forward(known)))
        assert np.abs(q - known).max(axis=1).min() < 1e-6


def test_a_list_has_an_end_where_turns_have_none():
    """A hundred turns a joint: 4096 solutions at most, the nearest to the middle among them, and nothing is claimed."""
    kr210 = load("kr210")
    links = [
        mq.DHLink(kind="revolute", a=a, alpha=alpha, d=d, lower=-300.0, upper=300.0)
        for a, alpha, d in [(0, 1.57, 0.1), (0.4, 0, 0), (0.4, 0, 0.1), (0, 1.57, 0.1), (0, -1.57, 0.1), (0, 0, 0.1)]
    ]
    robot = mq.Robot.from_dh(links)
    solutions = mq.Solver(robot).solutions(robot.forward(np.full(6, 0.4)))
    assert 0 < len(solutions) <= 4096
    assert not solutions.is_complete
    assert np.abs(solutions[0].q).max() <= np.pi
    assert len(mq.Solver(kr210).solutions(kr210.forward(kr210.middle))) > 0


def test_nothing_is_listed_out_of_reach(maira, panda, no_closed_form):
    for robot, complete in ((maira, True), (panda, False), (load("irb140"), False)):
        solutions = mq.Solver(robot).solutions(mq.pose([9.0, 0, 0]))
        assert len(solutions) == 0
        assert solutions.is_complete is complete


@pytest.mark.parametrize("name", ["ur5_limited", "maira"])
def test_nothing_is_claimed_at_a_singular_pose(name, maira):
    """Two axes of a wrist or a shoulder are in line: solutions are not isolated, or some are not on the arcs."""
    robot = maira if name == "maira" else load(name)
    q = np.full(robot.n, 0.3)
    q[1 if name == "maira" else 4] = 0.0
    solutions = mq.Solver(robot).solutions(robot.forward(q))
    check(robot, robot.forward(q), solutions)
    assert len(solutions) > 0
    assert not solutions.is_complete


def test_an_srs_arm_lists_the_best_of_every_arc(maira, rng):
    """In order; none is better than the first, nor is what `solve` settles at."""
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    target = maira.forward(maira.random_configuration(rng))
    solutions = solver.solutions(target)
    check(maira, target, solutions)
    assert solutions.is_complete
    assert solutions.method == "closed form (S-R-S)"
    for seed in range(30):
        assert solutions[0].cost <= solver.solve(target, rng=seed).cost + 1e-9
    assert all(one.arc.contains(one.psi) for one in solutions)
    assert sorted(one.branch for one in solutions) == sorted(arc.branch for arc in arcs(SRS.of(maira), target))


@pytest.mark.parametrize("objective", [mq.Posture(), mq.LimitDistance()])
def test_a_redundant_arm_lists_local_optima(panda, rng, objective):
    """Each is where `solve` settles that begins there, and what `solve` settles at elsewhere is never better."""
    solver = mq.Solver(panda, redundancy=mq.Strict(objective))
    for _ in range(3):
        target = panda.forward(panda.random_configuration(rng))
        solutions = solver.solutions(target)
        check(panda, target, solutions)
        assert not solutions.is_complete
        for one in solutions:
            again = solver.solve(target, q0=one.q)
            assert again.optimal
            assert np.abs(again.q - one.q).max() < 1e-4
        assert min(solver.solve(target, rng=seed).cost for seed in range(20)) >= solutions[0].cost - 1e-9


def test_objectives_that_the_kernels_do_not_know_are_settled_too(panda, rng):
    solver = mq.Solver(panda, redundancy=mq.Strict(mq.Manipulability()))
    target = panda.forward(panda.random_configuration(rng))
    solutions = solver.solutions(target)
    check(panda, target, solutions)
    assert solutions[0].cost <= min(solver.solve(target, rng=seed).cost for seed in range(3)) + 1e-6


def test_a_list_is_the_same_each_time(panda, rng):
    """Whatever was asked before; another seed begins elsewhere."""
    solver, target = mq.Solver(panda), panda.forward(panda.random_configuration(rng))
    first, second, other = solver.solutions(target), solver.solutions(target, rng=0), solver.solutions(target, rng=5)
    assert np.array_equal([one.q for one in first], [one.q for one in second])
    assert other[0].cost == pytest.approx(first[0].cost, abs=1e-9)
    assert any(a.q.tolist() != b.q.tolist() for a, b in zip(first, other, strict=False))


def test_a_list_does_not_depend_on_who_solves_the_qps(panda, rng):
    target = panda.forward(panda.random_configuration(rng))
    compiled, daqp = (mq.Solver(panda, backend=name).solutions(target) for name in ("compiled", "daqp"))
    assert np.array_equal([one.q for one in compiled], [one.q for one in daqp])


def test_a_list_is_a_sequence(maira, ur5, rng):
    for robot in (maira, ur5):
        solutions = mq.Solver(robot).solutions(robot.forward(robot.random_configuration(rng)))
        assert isinstance(solutions[0], mq.ListedSolution)
        assert [one.cost for one in solutions[:2]] == [solutions[0].cost, solutions[1].cost]
        assert list(solutions)[-1] is solutions[-1]
        assert f"Solutions({len(solutions)}, closed form" in repr(solutions)
        assert pickle.loads(pickle.dumps(solutions))[0].q.tolist() == solutions[0].q.tolist()
        assert (solutions[0].branch is None) is (robot is ur5)


def distance(q, q0, metric):
    return 0.5 * np.sum(metric * (q - q0) ** 2, axis=-1)


@pytest.mark.parametrize("name", ["maira", "ur5", "kr210", "irb140", "panda", "pr2_arm", "xarm7"])
def test_nothing_is_closer_than_the_closest(name, maira, rng):
    """Of many solutions, from many starts, each settled toward q0, none is nearer to it."""
    robot = maira if name == "maira" else load(name)
    solver = mq.Solver(robot)
    for _ in range(3):
        target, q0 = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        metric = rng.uniform(0.5, 2.0, robot.n)
        closest = solver.solve(target, q0, prefer="closest", metric=metric)
        assert closest.status is mq.Status.CONVERGED
        assert closest.cost == pytest.approx(distance(closest.q, q0, metric), rel=1e-12)
        settling = mq.Solver(robot, redundancy=mq.Strict(mq.Posture(q0, metric)))
        starts = np.array([q0, *(robot.random_configuration(rng) for _ in range(100))])
        others = settling.solve_batch([target] * len(starts), starts)
        assert distance(others.q[others.success], q0, metric).min() >= closest.cost - 1e-6


@pytest.mark.parametrize("name", ["maira", "ur5", "irb140", "panda"])
def test_the_closest_to_a_solution_is_itself(name, maira, rng):
    robot = maira if name == "maira" else load(name)
    solver = mq.Solver(robot)
    for _ in range(4):
        q0 = robot.random_configuration(rng)
        closest = solver.solve(robot.forward(q0), q0, prefer="closest")
        assert np.abs(closest.q - q0).max() < 1e-6


def test_nothing_on_a_fine_swivel_grid_is_closer(iiwa14, rng):
    """Of the points on every arc."""
    solver, srs = mq.Solver(iiwa14), SRS.of(iiwa14)
    for _ in range(3):
        target, q0 = iiwa14.forward(iiwa14.random_configuration(rng)), iiwa14.random_configuration(rng)
        grid = np.concatenate([arc.at(np.linspace(arc.lower, arc.upper, 300)) for arc in arcs(srs, target)])
        closest = solver.solve(target, q0, prefer="closest")
        assert distance(grid, q0, 1.0).min() >= closest.cost - 1e-9


def test_a_batch_of_closest_is_each_of_them(panda, ur5, rng):
    """To the bit; a target with NaN costs no other anything."""
    for robot in (panda, ur5):
        solver = mq.Solver(robot)
        targets = np.array([robot.forward(robot.random_configuration(rng)).homogeneous for _ in range(3)])
        targets[1, 0, 3] = np.nan
        starts = np.array([robot.random_configuration(rng) for _ in range(3)])
        batch = solver.solve_batch(targets, starts, seed=7, prefer="closest", metric=np.arange(1.0, robot.n + 1))
        for i in (0, 2):
            one = solver.solve(targets[i], starts[i], 7, prefer="closest", metric=np.arange(1.0, robot.n + 1))
            assert one.q.tolist() == batch.q[i].tolist()
            assert one.cost == batch.cost[i]
        assert batch.status[1] == mq.Status.INVALID_TARGET


def test_without_a_solution_the_verdict_is_that_from_q0(maira, panda):
    for robot in (maira, panda):
        solver, target = mq.Solver(robot), mq.pose([9.0, 0.0, 0.0])
        plain, closest = solver.solve(target, robot.middle), solver.solve(target, robot.middle, prefer="closest")
        assert closest.status is plain.status
        assert closest.q.tolist() == plain.q.tolist()


def test_closest_has_to_be_meant(maira):
    solver, target, q0 = mq.Solver(maira), maira.forward(maira.middle), maira.middle
    for wrong, message in [
        ({"prefer": "nearest", "q0": q0}, "'closest'"),
        ({"metric": np.ones(7), "q0": q0}, "'closest'"),
        ({"prefer": "closest"}, "q0"),
        ({"prefer": "closest", "q0": q0, "metric": np.ones(6)}, "shape"),
        ({"prefer": "closest", "q0": q0, "metric": -np.ones(7)}, ">= 0"),
        ({"prefer": "closest", "q0": q0, "metric": np.zeros(7)}, "not all"),
    ]:
        with pytest.raises(mq.errors.OptionError, match=message):
            solver.solve(target, **wrong)
        with pytest.raises(mq.errors.OptionError, match=message):
            solver.solve_batch([target], **wrong)
    with pytest.raises(mq.errors.OptionError, match="observe"):
        solver.solve(target, q0, prefer="closest", observe=print)


def test_closest_of_a_point_is_no_farther_than_any_that_is_found():
    robot = mq.Robot.from_dh([mq.DHLink(a=0.5, lower=-3, upper=3) for _ in range(3)], name="three")
    solver, q0 = mq.Solver(robot, task=mq.PositionTask()), np.array([0.2, -0.4, 0.9])
    target = robot.forward([0.7, 0.5, 0.5])
    closest = solver.solve(target, q0, prefer="closest")
    starts = np.random.default_rng(0).uniform(-3, 3, (300, 3))
    others = solver.solve_batch([target] * 300, starts)
    assert closest.success
    assert 2 * closest.cost <= np.square(others.q[others.success] - q0).sum(axis=1).min() + 1e-9


@pytest.mark.parametrize("locked", [["joint6"], ["joint1", "joint4"], ["joint2", "joint3", "joint7"]], ids=str)
def test_arcs_that_are_points_are_closest_too(locked, iiwa14, rng):
    """Joints with no range at all leave isolated solutions, or none."""
    q = iiwa14.random_configuration(rng)
    values = {name: q[iiwa14.joint_names.index(name)] for name in locked}
    robot = iiwa14.limited(lower=values, upper=values)
    solver = mq.Solver(robot)
    for k in range(12):
        target, q0 = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        if k % 3 == 2:  # most likely out of reach
            target = iiwa14.forward(iiwa14.random_configuration(rng))
        closest, listed = solver.solve(target, q0, prefer="closest"), solver.solutions(target)
        assert closest.success == (len(listed) > 0) or k % 3 == 2
        check(robot, target, listed)
        if listed:
            assert distance(closest.q, q0, 1.0) <= distance(np.array([one.q for one in listed]), q0, 1.0).min() + 1e-5


def endless(robot: mq.Robot, limit: float) -> mq.Robot:
    """The arm with limits of so much [rad] on either side for all joints."""
    text = robot.urdf.replace('type="continuous"', 'type="revolute"')
    root = ElementTree.fromstring(text)
    for element in root.iter("limit"):
        element.attrib |= {"lower": repr(-limit), "upper": repr(limit)}
    return mq.Robot.from_urdf(ElementTree.tostring(root, encoding="unicode"), tip=robot.tip, base=robot.base)


@pytest.mark.parametrize("limit", [30.0, 1e10, 1e16])
@pytest.mark.parametrize("name", ["maira", "ur5", "panda"])
def test_whole_turns_without_end_are_counted_not_listed(name, limit, maira, rng):
    """Each joint of the closest is within half a turn of `q0`, and lists are bounded, and say so."""
    robot = endless(maira if name == "maira" else load(name), limit)
    solver = mq.Solver(robot)
    target = robot.forward(rng.uniform(-2.5, 2.5, robot.n))
    for _ in range(3):
        q0 = rng.uniform(-15.0, 15.0, robot.n)
        closest = solver.solve(target, q0, prefer="closest")
        assert closest.success
        assert np.abs(closest.q - q0).max() <= np.pi + 1e-6
    if limit < 1e16:
        return
    listed = solver.solutions(target)
    assert 0 < len(listed) <= 4096
    check(robot, target, listed)
    assert not listed.is_complete
    if name != "panda":
        assert "whole turns" in listed.reason
        assert listed.reason in repr(listed)


@pytest.mark.parametrize("name", ["maira", "ur5", "irb140"])
@pytest.mark.parametrize("backend", ["compiled", "daqp"])
def test_without_a_start_joints_end_at_the_turn_nearest_to_the_middle(name, backend, maira, rng):
    """Whatever is wished for beside the pose that is no posture; alone, and of a batch each."""
    robot = endless(maira if name == "maira" else load(name), 1e4)
    count = 200 if backend == "compiled" else 5
    targets = np.array([robot.forward(rng.uniform(-3, 3, robot.n)).homogeneous for _ in range(count)])
    batch = mq.Solver(robot, backend=backend).solve_batch(targets)
    assert batch.success.all()
    assert np.abs(batch.q).max() <= np.pi + 1e-9
    for posture in (mq.Posture(), mq.LimitDistance()):
        for wish in (mq.Strict(posture), mq.Weighted(posture, 1e-6)):
            solver = mq.Solver(robot, redundancy=wish, backend=backend)
            assert np.abs([solver.solve(T).q for T in targets[:3]]).max() < 1.5 * np.pi


def six_axes(rows):
    """An arm of six joints from its DH rows a, alpha, d."""
    links = [mq.DHLink(a=a, alpha=alpha, d=d, lower=-3.1, upper=3.1) for a, alpha, d in rows]
    return mq.Robot.from_dh(links)


def test_an_arm_whose_last_joints_are_in_line_is_never_said_to_be_listed(rng):
    """Rank 5: its solutions are no points, the closed form has none, and `solve` reaches the pose."""
    quarter = np.pi / 2
    robot = six_axes([(0, quarter, 0.1), (0.2, 0, 0), (0.2, 0, 0), (0, quarter, 0), (0, 0, 0.1), (0, 0, 0.05)])
    solver = mq.Solver(robot)
    for _ in range(4):
        target = robot.forward(robot.random_configuration(rng))
        listed = solver.solutions(target)
        assert len(listed) > 0
        check(robot, target, listed)
        assert not listed.is_complete
        assert listed.reason


def test_a_list_with_a_branch_less_is_not_called_complete(rng, monkeypatch):
    """A closed form that loses a branch, a pair of them, or all: descents find them, or the loss is noticed."""
    robot = load("kr210")
    solver, branches = mq.Solver(robot), Decomposition.branches
    for _ in range(5):
        target = robot.forward(robot.random_configuration(rng))
        whole = solver.solutions(target)
        if not whole.is_complete:
            continue
        for kept in (slice(1, None), slice(2, None), slice(0, 0)):
            monkeypatch.setattr(Decomposition, "branches", lambda self, T, kept=kept: branches(self, T)[kept])
            less = solver.solutions(target)
            monkeypatch.setattr(Decomposition, "branches", branches)
            known = [one.q for one in less]
            assert missing(np.reshape(known, (-1, 6)), [one.q for one in whole], robot) == 0 or not less.is_complete
            assert not (less.is_complete and kept != slice(2, None))
            assert less.is_complete or less.reason
    out = solver.solutions(mq.pose([9.0, 0.0, 0.0]))
    assert (len(out), out.is_complete, out.reason) == (0, True, "")
