"""A test of one's own, several starts, limits about the start: judged by many random solves and by closed forms."""

import json
import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.analytic.srs.arcs import at_each
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.analytic.srs.optimum import SampledArcs
from maira_qp.errors import ConfigurationError, OptionError

TWO_JOINTS = mq.Robot.from_dh(
    [mq.DHLink(a=1.0, lower=-3, upper=3), mq.DHLink(a=0.8, lower=-2.5, upper=2.5)], name="two"
)


def arm(name):
    return mq.Robot.maira() if name == "maira" else load(name)


def reaches(robot, q, target):
    error = np.abs(robot.forward(q).homogeneous - target.homogeneous).max()
    return error < 3e-6 and (robot.lower <= q).all() and (q <= robot.upper).all()


def every_place(robot, target, count=400):
    """Configurations (k, 7) all along the arcs of an S-R-S arm."""
    arcs = SampledArcs.of(SRS.of(robot), target, mq.Posture().of(robot)).arcs
    each = [at_each(arcs, np.full(count, k), np.linspace(arc.lower, arc.upper, count)) for k, arc in enumerate(arcs)]
    return np.concatenate(each)


@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
@pytest.mark.parametrize("far", [True, False], ids=["start", "no start"])
def test_an_accepted_answer_is_found_where_random_solves_find_one(name, far, rng):
    """A half of joint space is accepted: the answer is there, reaches the pose, and says what was rejected."""
    robot = arm(name)
    solver = mq.Solver(robot)
    for _ in range(4):
        q = robot.random_configuration(rng)
        target, a = robot.forward(q), rng.normal(size=robot.n)
        usual = solver.solve(target, q if far else None)
        accept = lambda x, a=a, b=a @ usual.q: bool(a @ x > b + 0.3)  # noqa: E731
        s = solver.solve(target, q if far else None, accept=accept)
        starts = [robot.random_configuration(rng) for _ in range(200)]
        others = mq.Solver(robot).solve_batch([target] * 200, starts)
        there = any(accept(x) for x in others.q[others.success])
        assert s.success or not there
        if s.success:
            assert accept(s.q)
            assert reaches(robot, s.q, target)
            assert s.rejected >= 1
            assert s.left_q0 is far
        else:
            assert s.status is mq.Status.REJECTED
            assert reaches(robot, s.q, target)
        assert solver.solve(target, q if far else None, accept=accept).q.tolist() == s.q.tolist()


@pytest.mark.parametrize("redundancy", [mq.Strict, lambda wish: mq.Weighted(wish, 1e-6)], ids=["strict", "weighted"])
def test_the_accepted_answer_is_the_best_along_all_arcs(maira, redundancy, rng):
    """By all arcs at 400 places each: no accepted one has a lower cost."""
    wish = mq.Posture(maira.middle + 0.1)
    solver = mq.Solver(maira, redundancy=redundancy(wish))
    for _ in range(4):
        target = maira.forward(maira.random_configuration(rng))
        usual = solver.solve(target)
        joint = int(rng.integers(7))
        accept = lambda x, k=joint, b=usual.q[joint]: bool(x[k] > b + 0.2)  # noqa: E731
        s, places = solver.solve(target, accept=accept), every_place(maira, target)
        costs = wish.of(maira).costs(places)[[accept(x) for x in places]]
        assert s.success == bool(len(costs)) or s.status is mq.Status.NEAREST
        if len(costs):
            assert accept(s.q)
            assert s.cost <= costs.min() + 1e-5 * (1 + costs.min())


def test_what_the_test_sees_says_and_raises(maira):
    target, q0 = maira.forward(maira.middle + 0.3), maira.middle + 0.3
    solver, seen = mq.Solver(maira), []

    def accept(q):
        seen.append(q)
        assert not q.flags.writeable
        assert reaches(maira, q, target)
        return len(seen) > 5

    s = solver.solve(target, q0, accept=accept)
    assert s.success
    assert s.rejected == 5
    assert json.loads(json.dumps(s.as_dict()))["rejected"] == 5
    assert pickle.loads(pickle.dumps(s)).rejected == 5
    assert solver.solve(target, q0, accept=lambda q: True).q.tolist() == solver.solve(target, q0).q.tolist()

    def raises(q):
        raise ZeroDivisionError("of my own")

    with pytest.raises(ZeroDivisionError, match="of my own"):
        solver.solve(target, q0, accept=raises)
    with pytest.raises(OptionError, match="accept must return True or False, got None"):
        solver.solve(target, q0, accept=lambda q: None)
    with pytest.raises(OptionError, match="accept must be a function"):
        solver.solve(target, q0, accept=True)
    with pytest.raises(OptionError, match="accept cannot be observed"):
        solver.solve(target, q0, accept=accept, observe=print)
    none = solver.solve(target, q0, accept=lambda q: False)
    assert none.status is mq.Status.REJECTED
    assert not none
    assert none.rejected > 100
    assert none.q.tolist() == solver.solve(target, q0).q.tolist()
    assert "accept rejected every" in str(none.explain())
    calls = []
    far = solver.solve(mq.pose([9.0, 0, 0]), q0, accept=calls.append)
    assert far.status is mq.Status.UNREACHABLE
    assert not calls


def test_a_batch_is_that_of_single_calls_and_closest_is_of_what_is_accepted(maira, rng):
    solver = mq.Solver(maira)
    targets = [maira.forward(maira.random_configuration(rng)) for _ in range(3)]
    q0, accept = maira.middle, lambda q: bool(q[2] > 0.5)
    batch = solver.solve_batch([t.homogeneous for t in targets], q0, accept=accept)
    for one, target in zip(batch, targets, strict=True):
        single = solver.solve(target, q0, accept=accept)
        assert one.q.tolist() == single.q.tolist()
        assert one.status == single.status
        assert one.rejected == single.rejected
        near = solver.solve(target, q0, prefer="closest", accept=accept)
        places = every_place(maira, target)
        distances = np.square(places - q0).sum(axis=1)[places[:, 2] > 0.5]
        if len(distances):
            assert accept(near.q)
            assert 2 * near.cost <= distances.min() * (1 + 1e-4)


def test_whole_turns_are_further_candidates(ur5, rng):
    """A UR5 turns by +-2 pi: with joint 6 above pi, where the usual answer is not."""
    wide = [name for name, high in zip(ur5.joint_names, ur5.upper, strict=True) if high > 6]
    assert wide
    k = ur5.joint_names.index(wide[-1])
    q = rng.uniform(-1, 1, 6)
    s = mq.Solver(ur5).solve(ur5.forward(q), q, accept=lambda x: bool(x[k] > 3.5))
    assert s.success
    assert s.q[k] > 3.5
    assert reaches(ur5, s.q, ur5.forward(q))


def test_a_test_goes_with_other_tasks_limits_and_engines(maira, rng):
    """Two tasks, a tree of engines: the reference engine, further limits, and a task below."""
    q = maira.middle + 0.4
    below = mq.Solver(maira, tasks=[mq.PositionTask(frame="link4", priority=2, target=maira.forward(q + 0.1, "link4"))])
    limited = mq.Solver(maira, limits=[mq.LinearLimit(np.eye(7)[1:2], [1.0])])
    two = mq.Solver(maira, task=[mq.PositionTask(), mq.OrientationTask()])
    for solver in (below, limited, two, mq.Solver(maira, backend="daqp")):
        usual = solver.solve(maira.forward(q), q)
        s = solver.solve(maira.forward(q), q, accept=lambda x, b=usual.q[0]: bool(x[0] > b + 0.1))
        assert s.success
        assert s.q[0] > usual.q[0] + 0.1
        assert reaches(maira, s.q, maira.forward(q))
        assert solver is not limited or s.q[1] <= 1.0 + 1e-9


@pytest.mark.parametrize("name", ["maira", "panda", "ur5", "pr2_arm"])
@pytest.mark.parametrize("redundancy", [None, mq.Strict(mq.Posture()), mq.Weighted(mq.Posture(), 1e-3)], ids=str)
def test_no_joint_changes_by_more_than_is_allowed(name, redundancy, rng):
    """Whatever the target and the verdict, and a target that was made within the box is reached."""
    robot = arm(name)
    solver = mq.Solver(robot, redundancy=redundancy)
    for k in range(4):
        q0 = robot.random_configuration(rng)
        change = rng.uniform(0.05, 0.6, robot.n)
        inside = robot.clip(q0 + rng.uniform(-1, 1, robot.n) * 0.999 * change)
        target = robot.forward(inside if k % 2 else robot.random_configuration(rng))
        s = solver.solve(target, q0, max_joint_change=change)
        assert (np.abs(s.q - q0) <= change).all()
        assert (robot.lower <= s.q).all()
        assert (s.q <= robot.upper).all()
        assert s.scope == "within max_joint_change of q0"
        if k % 2 and not isinstance(redundancy, mq.Weighted):
            assert s.success
        if s.success:
            assert reaches(robot, s.q, target)
        stands = {
            f"{joint} max_joint_change"
            for joint, x, start, most in zip(robot.joint_names, s.q, q0, change, strict=True)
            if abs(abs(x - start) - most) < 1e-12
        }
        assert stands == {each for each in s.active_limits if each.endswith("max_joint_change")}


def test_a_verdict_on_the_box_says_that_it_is_one(maira):
    """Out of the box, but not out of reach: proved of the box alone, here, in words, in a dict and in a pickle."""
    q0 = maira.middle + 0.3
    target = maira.forward(maira.middle - 0.5)
    s = mq.Solver(maira).solve(target, q0, max_joint_change=0.1)
    assert s.status is mq.Status.UNREACHABLE
    assert mq.Solver(maira).solve(target, q0).success
    for text in (str(s), str(s.explain()), json.dumps(s.as_dict()), str(pickle.loads(pickle.dumps(s)))):
        assert "within max_joint_change of q0" in " ".join(text.split())
    assert mq.Solver(maira).solve(target, q0).scope == ""
    assert s.robot == maira
    assert s.proof is not None


def test_boxes_of_a_batch_are_those_of_single_calls(panda, rng):
    solver = mq.Solver(panda, redundancy=mq.Strict(mq.Posture()))
    starts = np.array([panda.random_configuration(rng) for _ in range(2)])[[0, 1, 0, 1]]
    targets = np.array([panda.forward(panda.clip(q + 0.2)).homogeneous for q in starts])
    targets[3, 0, 0] = np.nan
    done = []
    batch = solver.solve_batch(targets, starts, max_joint_change=0.25, progress=lambda *each: done.append(each))
    assert done[-1] == (4, 4)
    assert batch.status[3] == mq.Status.INVALID_TARGET
    for one, target, start in list(zip(batch, targets, starts, strict=True))[:3]:
        single = solver.solve(target, start, max_joint_change=0.25)
        assert one.q.tolist() == single.q.tolist()
        assert one.active_limits == single.active_limits
        assert str(one.explain()) == str(single.explain())
    assert batch.scope == batch[0].scope == "within max_joint_change of q0"
    assert batch[:3].active_limits == [batch[k].active_limits for k in range(3)]
    assert pickle.loads(pickle.dumps(batch)).scope == batch.scope


def test_bad_changes_are_named(maira):
    solver, target, q0 = mq.Solver(maira), maira.forward(maira.middle), maira.middle
    for change, message in [
        (-0.1, "not be negative"),
        (np.nan, "NaN"),
        ("far", "real number"),
        ([0.1, 0.2], r"shape \(7,\)"),
        ({"joint9": 0.1}, "'joint9' is not a joint"),
    ]:
        with pytest.raises(OptionError, match=message):
            solver.solve(target, q0, max_joint_change=change)
    with pytest.raises(OptionError, match="max_joint_change needs q0"):
        solver.solve(target, max_joint_change=0.1)
    with pytest.raises(ConfigurationError, match="'joint1', 9, is farther outside its limits"):
        solver.solve(target, np.full(7, 9.0), max_joint_change=0.1)
    s = solver.solve(target, q0 + 0.2, max_joint_change={"joint1": 0.05})
    assert s.success
    assert abs(s.q[0] - q0[0] - 0.2) <= 0.05
    still = solver.solve(target, q0 + 0.2, max_joint_change=0.0)
    assert not still.success
    assert not still.jacobian().any()  # no joint can follow
    assert still.q.tolist() == (q0 + 0.2).tolist()


@pytest.mark.parametrize("redundancy", [None, mq.Strict(mq.Posture()), mq.Weighted(mq.Posture(), 1e-2)], ids=str)
def test_of_several_starts_the_best_answer_counts(panda, redundancy, rng):
    solver = mq.Solver(panda, redundancy=redundancy)
    for reachable in (True, True, True, False):
        target = panda.forward(panda.random_configuration(rng)) if reachable else mq.pose([1.5, 0.3, 0.2])
        starts = np.array([panda.random_configuration(rng) for _ in range(5)])
        s, each = solver.solve(target, starts), [solver.solve(target, q) for q in starts]
        k = [q.tolist() for q in starts].index(s.q0.tolist())
        assert s.q.tolist() == each[k].q.tolist()
        assert s.left_q0 == each[k].left_q0
        assert s.max_joint_change == each[k].max_joint_change
        assert s.iterations == sum(one.iterations for one in each)
        assert s.success == any(one.success for one in each)
        if reachable and redundancy is None:
            assert s.max_joint_change == min(one.max_joint_change for one in each if one.success)
        elif reachable and isinstance(redundancy, mq.Strict):
            assert s.cost <= min(one.cost for one in each if one.success) + 1e-8
    one = solver.solve(target, starts[:1])
    assert one.q.tolist() == each[0].q.tolist()
    assert solver.solve(target, starts.tolist()).q.tolist() == s.q.tolist()
    with pytest.raises(ConfigurationError, match="empty"):
        solver.solve(target, np.empty((0, 7)))
    with pytest.raises(ConfigurationError, match="shape"):
        solver.solve(target, np.zeros((2, 6)))


def test_several_starts_with_boxes_and_a_test(maira, rng):
    """Only the start whose box holds an accepted configuration leads to one."""
    q = maira.middle + 0.3
    starts = np.array([q + 1.0, q + 0.05, q - 0.9])
    s = mq.Solver(maira).solve(maira.forward(q), starts, max_joint_change=0.1, accept=lambda x: True)
    assert s.success
    assert s.q0.tolist() == starts[1].tolist()
    assert s.max_joint_change <= 0.1
    none = mq.Solver(maira).solve(maira.forward(q), starts, max_joint_change=0.1, accept=lambda x: False)
    assert none.status is mq.Status.REJECTED


def test_branches_of_a_small_arm_are_accepted_one_by_one():
    """Two joints, a point: elbow up and elbow down in closed form."""
    q = np.array([0.4, 1.1])
    solver, target = mq.Solver(TWO_JOINTS, task=mq.PositionTask()), TWO_JOINTS.forward(q)
    usual = solver.solve(target, q)
    other = solver.solve(target, q, accept=lambda x: bool(x[1] < 0))
    assert usual.q == pytest.approx(q, abs=1e-6)
    assert other.q[1] == pytest.approx(-1.1, abs=1e-5)
    assert other.rejected == 1
    assert solver.solve(target, q, accept=lambda x: bool(abs(x[1]) < 0.5)).status is mq.Status.REJECTED
