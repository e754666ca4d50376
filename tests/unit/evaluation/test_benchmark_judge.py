"""The judge against Pinocchio, against hand-made robots, and against answers that it must refuse."""

import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin
import pytest
from support.robots import load

from maira_qp.errors import RobotError
from maira_qp.evaluation.judge import Judge, Verdict, angle_between, turn
from maira_qp.evaluation.runner import judge_of
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.robot import Robot


def random_urdf(rng: np.random.Generator, joints: int) -> str:
    """A chain with random origins, random axes, fixed joints in between and one mimic joint."""
    lines = ['<robot name="random"><link name="l0"/>']
    movable: list[str] = []
    for i in range(1, joints + 1):
        kind = str(rng.choice(["revolute", "continuous", "prismatic", "fixed"])) if i > 1 else "revolute"
        xyz, rpy, axis = (
            " ".join(map(repr, map(float, v))) for v in (rng.normal(size=3), rng.uniform(-7, 7, 3), rng.normal(size=3))
        )
        mimic = ""
        if kind == "revolute" and movable and i % 3 == 0:
            mimic = f'<mimic joint="{movable[0]}" multiplier="0.5" offset="0.25"/>'
        elif kind == "revolute":
            movable.append(f"j{i}")
        lines.append(
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/>'
            + (
                f'<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="1" effort="1"/>{mimic}'
                if kind != "fixed"
                else ""
            )
            + "</joint>"
        )
    return "".join([*lines, "</robot>"])


@pytest.mark.parametrize("seed", range(12))
def test_agrees_with_pinocchio_on_random_robots(seed):
    """The walk over the text and Pinocchio's model put the tool at the same place: two codes, one description."""
    rng = np.random.default_rng(seed)
    robot = Robot.from_urdf(random_urdf(rng, joints=9))
    judge = judge_of(robot)
    for _ in range(20):
        q = robot.random_configuration(rng)
        np.testing.assert_allclose(judge.forward(q), robot.forward(q).homogeneous, atol=1e-10)


def test_agrees_with_the_dh_table(maira, iiwa14, rng):
    """The walk over the URDF equals the product of the DH table that the URDF was written from."""
    for robot in (maira, iiwa14):
        for _ in range(20):
            q = robot.random_configuration(rng)
            np.testing.assert_allclose(judge_of(robot).forward(q), robot.dh.forward(q), atol=1e-12)


def test_a_wrong_configuration_is_refused(maira, rng):
    """The right answer passes at 1e-9; the same answer with one joint off by 1e-5 rad does not pass at 1e-6."""
    judge = judge_of(maira)
    for joint in range(maira.n):
        q = maira.clip(0.9 * maira.random_configuration(rng))
        target = maira.forward(q).homogeneous
        assert judge.verdict(q, target).within(1e-9, 1e-9)
        q[joint] += 1e-5
        assert not judge.verdict(q, target).within(1e-6, 1e-6)


def test_a_batch_is_judged_as_its_rows(maira, rng):
    """Figures of shape (N,) that are those of each row alone; a row that is not finite spoils no other."""
    judge = judge_of(maira)
    q = np.array([maira.random_configuration(rng) for _ in range(6)])
    targets = judge.forward(q[::-1])
    q[2, 3], q[4, 0] = np.nan, 9.0
    verdict = judge.verdict(q, targets)
    for k in range(6):
        alone = judge.verdict(q[k], targets[k])
        for figure in ("position_error", "orientation_error", "limit_violation"):
            assert getattr(verdict, figure)[k] == pytest.approx(getattr(alone, figure), abs=1e-12)
    assert verdict.within(9.0, 9.0).tolist() == [True, True, False, True, False, True]
    assert verdict.within(9.0, 9.0, slack=9.0).tolist() == [True, True, False, True, True, True]
    assert judge.verdict(np.empty((0, 7)), np.empty((0, 4, 4))).within(1, 1).shape == (0,)


def test_of_several_tips_the_worst_one_counts(rng):
    """Two arms on a torso: poses are Pinocchio's, and limits are those of all joints."""
    robot = load("tiago_arms")
    judge, q = judge_of(robot), robot.random_configuration(rng)
    targets = {tip: robot.forward(q, tip).homogeneous for tip in robot.tips}
    for tip in robot.tips:
        np.testing.assert_allclose(judge.forward(q, tip), targets[tip], atol=1e-12)
        moved = targets | {tip: pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.02])).homogeneous @ targets[tip]}
        assert judge.verdict(q, moved).position_error == pytest.approx(0.02)
    np.testing.assert_array_equal(judge.lower, robot.lower)
    np.testing.assert_array_equal(judge.upper, robot.upper)
    np.testing.assert_array_equal(judge.speed, robot.velocity_limit)
    q[-1] = robot.upper[-1] + 0.1
    assert judge.limit_violation(q) == pytest.approx(0.1)


def test_a_control_run_is_judged_tick_by_tick(maira):
    """By where each tick ends, and by how fast it went there."""
    judge, dt = judge_of(maira), 0.01
    q = np.zeros((4, 7))
    q[1, 2] = q[2, 2] = 1.5 * judge.speed[2] * dt  # too fast by a half, then at rest
    q[3, 2] = np.nan
    verdict = judge.verdict(q, np.tile(judge.forward(q[0]), (3, 1, 1)), dt)
    np.testing.assert_allclose(verdict.speed_excess, [0.5 * judge.speed[2], 0.0, np.inf])
    assert verdict.position_error.shape == (3,)
    np.testing.assert_array_equal(verdict.limit_violation, [0.0, 0.0, np.inf])


def test_errors_are_the_distance_and_the_angle(maira, rng):
    """A target moved by a known length and turned by a known angle is judged to be just that far."""
    q = maira.random_configuration(rng)
    for angle in (1e-9, 1e-3, 1.0, 3.1):
        axis = rng.normal(size=3)
        target = maira.forward(q).homogeneous
        target[:3, :3] = target[:3, :3] @ turn(axis / np.linalg.norm(axis), angle)
        target[:3, 3] += (0.3, 0.0, -0.4)
        verdict = judge_of(maira).verdict(q, target)
        assert verdict.position_error == pytest.approx(0.5, abs=1e-12)
        assert verdict.orientation_error == pytest.approx(angle, rel=1e-6, abs=1e-15)


def test_angle_agrees_with_pinocchio_and_never_exceeds_pi():
    """The angle by the chord equals the norm of the logarithm, up to half a turn."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        A, B = (pin.Quaternion(*_unit(rng)).matrix() for _ in range(2))
        assert angle_between(A, B) == pytest.approx(np.linalg.norm(pin.log3(A.T @ B)), abs=1e-7)
    assert angle_between(np.eye(3), np.diag([1.0, -1.0, -1.0])) == pytest.approx(math.pi)


def _unit(rng):
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def test_limits_are_judged_to_the_bit(maira):
    """At a limit a joint is inside; one representable number further it is outside."""
    judge = judge_of(maira)
    for joint in range(maira.n):
        for bound, beyond in ((maira.upper, np.inf), (maira.lower, -np.inf)):
            q = maira.middle.copy()
            q[joint] = bound[joint]
            assert judge.limit_violation(q) == 0
            q[joint] = np.nextafter(bound[joint], beyond)
            assert judge.limit_violation(q) > 0


def test_continuous_joints_have_no_limits_and_sliding_ones_do():
    """A continuous joint may turn as often as it likes, a sliding one may not leave its rail."""
    links = [DHLink(kind="continuous", alpha=1.0), DHLink(kind="prismatic", lower=-0.5, upper=0.25)]
    judge = judge_of(Robot.from_dh(DHTable(links)))
    assert judge.limit_violation(np.array([1e4, 0.25])) == 0
    assert judge.limit_violation(np.array([0.0, 0.75])) == pytest.approx(0.5)


def test_a_follower_outside_of_its_limits_is_a_violation():
    """A mimic joint is held to its own limits, not only the joint that it follows."""
    urdf = """<robot name="m"><link name="a"/><link name="b"/><link name="c"/>
      <joint name="lead" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
      <joint name="follow" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="lead" multiplier="2"/></joint></robot>"""
    judge = Judge(urdf, "a", "c", ["lead"])
    assert judge.limit_violation(np.array([0.5])) == 0
    assert judge.limit_violation(np.array([1.5])) == pytest.approx(2.0)
    np.testing.assert_allclose(judge.forward(np.array([0.5]))[:2, :2], turn(np.array([0, 0, 1.0]), 1.5)[:2, :2])


def test_axes_of_any_length_and_mimics_of_mimics():
    """An axis of length 2 turns no faster than one of length 1, and a mimic joint may follow a mimic joint."""
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 2"/>'
        '<limit lower="-9" upper="9" velocity="1" effort="1"/>{3}</joint>'
    )
    urdf = (
        '<robot name="m"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>'
        + joint.format("lead", "a", "b", "")
        + joint.format("second", "b", "c", '<mimic joint="lead" multiplier="2" offset="0.1"/>')
        + joint.format("third", "c", "d", '<mimic joint="second" multiplier="-3" offset="0.2"/>')
        + "</robot>"
    )
    q, second = 0.3, 2 * 0.3 + 0.1
    expected = turn(np.array([0.0, 0.0, 1.0]), q + second + (-3 * second + 0.2))
    np.testing.assert_allclose(Judge(urdf, "a", "d", ["lead"]).forward(np.array([q]))[:3, :3], expected, atol=1e-12)


def test_the_right_pose_outside_of_the_limits_is_no_success(maira):
    """A whole turn further the tool is at the target, and the answer is refused."""
    judge = judge_of(maira)
    q = np.full(maira.n, 0.5)
    target = maira.forward(q).homogeneous
    assert judge.verdict(q, target).within(1e-9, 1e-9)
    q[0] += 2 * math.pi
    verdict = judge.verdict(q, target)
    assert verdict.position_error < 1e-9
    assert not verdict.within(1e-9, 1e-9)


def test_what_is_not_finite_is_infinitely_wrong(maira):
    """NaN and infinity reach no target, and a vector of the wrong length neither."""
    wrong = Verdict(math.inf, math.inf, math.inf)
    for q in (np.full(7, np.nan), np.full(7, np.inf), np.zeros(6)):
        verdict = judge_of(maira).verdict(q, np.eye(4))
        assert verdict == wrong
        assert not verdict.within(1e9, 1e9)


def test_what_cannot_be_walked_is_an_error(maira):
    """No chain to the tip, a joint that q does not move, and a joint that the judge does not know."""
    with pytest.raises(RobotError, match="no chain"):
        Judge(maira.urdf, maira.base, "nowhere", maira.joint_names)
    with pytest.raises(RobotError, match=r"joint7.*moves the tool"):
        Judge(maira.urdf, maira.base, maira.tip, maira.joint_names[:-1])
    root = ElementTree.fromstring(maira.urdf)
    root.findall("joint")[2].set("type", "floating")
    with pytest.raises(RobotError, match="floating"):
        Judge(ElementTree.tostring(root, encoding="unicode"), maira.base, maira.tip, maira.joint_names)


def test_the_judge_shares_no_code_with_the_solver():
    """Its module imports neither Pinocchio nor anything of the package but the errors."""
    import ast
    import inspect

    from maira_qp.evaluation import judge

    imported = {
        name
        for node in ast.walk(ast.parse(inspect.getsource(judge)))
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names])
    }
    ours = {name for name in imported if name.split(".")[0] in ("maira_qp", "pinocchio", "pin", "scipy")}
    assert ours == {"maira_qp.errors"}
