"""Newton-Raphson: the lecture's figures on the iiwa14, exact cases, the null space, and singular starts."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maira_qp.errors import ConfigurationError, OptionError, PoseError
from maira_qp.evaluation import baselines
from maira_qp.orientation import nearest_rotation
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.catalog import iiwa14, maira

POINT = [0.526, 0.0, 0.78]  # Example 1 [m]
PRINTED_EXAMPLE_1 = [0, -95.584, 0, -68.874, 0, 61.447, 0]  # [deg]
PRINTED_EXAMPLE_2 = [173.98, 26.64, -61.56, -73.01, -114.87, 40.73, 37.9]
PRINTED_EXAMPLE_3 = [-87.28, -28.15, 65.39, 73.01, -148.2, -68.95, -171.69]
TARGET = np.array(
    [[0.997, 0.046, -0.063, 0.358], [-0.078, 0.527, -0.847, -0.484], [-0.006, 0.849, 0.528, 0.825], [0, 0, 0, 1]]
)
TARGET[:3, :3] = nearest_rotation(TARGET[:3, :3])

CARTESIAN = DHTable(
    [
        DHLink(kind="prismatic", alpha=np.pi / 2, lower=-2.0, upper=2.0),
        DHLink(kind="prismatic", theta=np.pi / 2, alpha=np.pi / 2, lower=-2.0, upper=2.0),
        DHLink(kind="prismatic", lower=-2.0, upper=2.0),
    ]
)
SCARA = DHTable(
    [
        DHLink(a=0.4),
        DHLink(a=0.3, alpha=np.pi),
        DHLink(kind="prismatic", lower=0.0, upper=0.5),
        DHLink(kind="fixed", d=0.05),
        DHLink(),
    ]
)


def pose_gap(table, q, target):
    """Distance [m] and angle [rad] between the tool at q and a target, by SciPy's rotations."""
    T = table.forward(q)
    angle = Rotation.from_matrix(T[:3, :3].T @ target[:3, :3]).magnitude()
    return np.linalg.norm(T[:3, 3] - target[:3, 3]), angle


def within_limits(table, q):
    return bool(((table.lower <= q) & (q <= table.upper)).all())


def test_example_1_comes_out_to_the_printed_digits():
    """Position only from zero: all of the lecture's joint angles, to its three decimals."""
    result = baselines.newton_position(iiwa14(), POINT, np.zeros(7), tolerance=1e-3)
    assert result.converged
    np.testing.assert_allclose(np.degrees(result.q), PRINTED_EXAMPLE_1, atol=5.1e-4)


def test_example_1_has_the_solution_that_the_lecture_names():
    """A quarter turn of the elbow alone reaches the same point, so Newton takes no step from there."""
    q = np.radians([0.0, 0, 0, 90, 0, 0, 0])
    result = baselines.newton_position(iiwa14(), POINT, q, tolerance=1e-9)
    assert result.iterations == 0
    assert result.converged


@pytest.mark.parametrize(("printed", "broken"), [(PRINTED_EXAMPLE_2, "joint1"), (PRINTED_EXAMPLE_3, "joint7")])
def test_the_printed_pose_solutions_reach_the_target(printed, broken):
    """Both of the lecture's solutions meet its tolerance, and each breaks one of its limits, A1 and (by 1.7°) A7."""
    table = iiwa14()
    q = np.radians(printed)
    assert baselines.newton_pose(table, TARGET, q, max_iterations=0).converged
    outside = (q < table.lower) | (q > table.upper)
    assert [name for name, out in zip(table.joint_names, outside, strict=True) if out] == [broken]


def test_example_2_reaches_the_pose_from_zero():
    """From the stretched arm, a singular start, the pose is reached to the lecture's tolerance."""
    result = baselines.newton_pose(iiwa14(), TARGET, np.zeros(7))
    assert result.converged
    assert max(pose_gap(iiwa14(), result.q, TARGET)) < 1e-3


def test_example_3_reaches_the_pose_within_the_limits():
    """With the distance from the limits climbed in the null space, the pose is reached inside all limits."""
    table = iiwa14()
    result = baselines.newton_null_space(
        table, TARGET, np.zeros(7), lambda q: baselines.limit_distance_gradient(table, q), alpha=10.0
    )
    assert result.converged
    assert max(pose_gap(table, result.q, TARGET)) < 1e-3
    assert within_limits(table, result.q)


def test_the_null_space_motion_keeps_more_solutions_within_the_limits():
    """Over 60 random starts of Example 3, the climb ends within the limits more often than Newton alone."""
    table = iiwa14()
    rng = np.random.default_rng(6)
    starts = rng.uniform(table.lower, table.upper, (60, 7))
    plain = [baselines.newton_pose(table, TARGET, q0) for q0 in starts]
    climbed = [
        baselines.newton_null_space(
            table, TARGET, q0, lambda q: baselines.limit_distance_gradient(table, q), alpha=100.0
        )
        for q0 in starts
    ]
    kept = [sum(r.converged and within_limits(table, r.q) for r in results) for results in (plain, climbed)]
    assert kept[1] >= kept[0] + 5


def test_the_null_space_motion_leaves_the_error_alone():
    """Near the solution, the climb changes the tool's motion only to second order in the step."""
    table = maira()
    rng = np.random.default_rng(7)
    for _ in range(10):
        q0 = rng.uniform(0.5 * table.lower, 0.5 * table.upper)
        target = table.forward(q0 + rng.uniform(-1e-7, 1e-7, 7))
        direction = rng.normal(size=7)
        gaps = []
        for alpha in (1e-3, 1e-4):
            result = baselines.newton_null_space(
                table, target, q0, lambda q, v=direction: v, alpha=alpha, position_tolerance=1e-12, max_iterations=1
            )
            plain = baselines.newton_pose(table, target, q0, position_tolerance=1e-12, max_iterations=1)
            assert np.linalg.norm(result.q - plain.q) > 0.02 * alpha
            gaps.append(np.linalg.norm(table.forward(result.q) - table.forward(plain.q)))
        assert gaps[0] < 50 * 1e-6
        assert gaps[1] < 0.05 * gaps[0]


def test_a_cartesian_robot_is_solved_in_one_step():
    """Newton on a linear map: three sliders reach any point with one full step, and half steps halve the error."""
    rng = np.random.default_rng(8)
    for _ in range(5):
        q_true, q0 = rng.uniform(-2, 2, (2, 3))
        point = CARTESIAN.forward(q_true)[:3, 3]
        result = baselines.newton_position(CARTESIAN, point, q0, tolerance=1e-12)
        assert result.iterations == 1
        np.testing.assert_allclose(result.q, q_true, atol=1e-14)
        half = baselines.newton_position(CARTESIAN, point, q0, step=0.5, tolerance=1e-12, max_iterations=3)
        np.testing.assert_allclose(half.q - q_true, (q0 - q_true) / 8, atol=1e-14)
        assert half.iterations == 3
        assert not half.converged


def test_it_agrees_with_the_closed_form_of_a_planar_arm():
    """On a 2R arm Newton lands on one of the two analytic solutions, elbow up or elbow down."""
    a1, a2 = 0.7, 0.5
    table = DHTable([DHLink(a=a1), DHLink(a=a2)])
    rng = np.random.default_rng(9)
    for _ in range(20):
        q = rng.uniform(-2.5, 2.5, 2)
        x, y, _ = point = table.forward(q)[:3, 3]
        result = baselines.newton_position(table, point, q + 0.1, tolerance=1e-12)
        assert result.converged
        cosine = (x * x + y * y - a1 * a1 - a2 * a2) / (2 * a1 * a2)
        gaps = []
        for q2 in (np.arccos(cosine), -np.arccos(cosine)):
            q1 = np.arctan2(y, x) - np.arctan2(a2 * np.sin(q2), a1 + a2 * np.cos(q2))
            gaps.append(np.abs(np.angle(np.exp(1j * (result.q - [q1, q2])))).max())
        assert min(gaps) < 1e-6


@pytest.mark.parametrize("table", [maira(), iiwa14(), SCARA], ids=["maira", "iiwa14", "scara"])
def test_reachable_poses_near_the_start_are_solved_to_the_last_digits(table):
    """Newton converges quadratically: a few steps reach 1e-9, with prismatic and fixed links in the chain as well."""
    rng = np.random.default_rng(10)
    for _ in range(10):
        q = rng.uniform(0.2, 0.4, table.n) * rng.choice([-1, 1], table.n)
        if table is SCARA:
            q = np.abs(q)
        target = table.forward(q + rng.uniform(-0.02, 0.02, table.n))
        result = baselines.newton_pose(table, target, q, position_tolerance=1e-9, orientation_tolerance=1e-9)
        assert result.converged
        assert result.iterations <= 8
        assert max(pose_gap(table, result.q, target)) < 2e-9


def test_the_two_tolerances_are_not_swapped():
    """A strict position with a loose orientation stops where the first holds, and the other way round."""
    table = maira()
    q0 = np.array([0.3, 0.5, -0.2, 1.0, 0.4, 0.8, 0.1])
    turned, moved = table.forward(q0), table.forward(q0)
    turned[:3, :3] = Rotation.from_rotvec([0, 0, 0.1]).as_matrix() @ turned[:3, :3]
    moved[:3, 3] += [0, 0, 0.1]
    loose = {"position_tolerance": 1e-6, "orientation_tolerance": 0.2}
    assert baselines.newton_pose(table, turned, q0, **loose).iterations == 0
    assert baselines.newton_pose(table, moved, q0, **loose).iterations > 0
    strict = {"position_tolerance": 0.2, "orientation_tolerance": 1e-6}
    assert baselines.newton_pose(table, turned, q0, **strict).iterations > 0
    assert baselines.newton_pose(table, moved, q0, **strict).iterations == 0


def test_the_sine_error_is_blind_to_half_a_turn():
    """The lecture's orientation error vanishes at 180 degrees: a tool the wrong way round counts as converged."""
    table = maira()
    q0 = np.full(7, 0.5)
    target = table.forward(q0)
    target[:3, :3] = target[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    result = baselines.newton_pose(table, target, q0)
    assert result.converged
    assert result.iterations == 0
    assert pose_gap(table, result.q, target)[1] == pytest.approx(np.pi)


def test_the_cap_holds_for_every_joint_and_keeps_the_direction():
    """No joint moves by more than the cap in a step (modulo a turn), and a capped step points the same way."""
    table = maira()
    rng = np.random.default_rng(11)
    for _ in range(5):
        q0 = rng.uniform(0.5 * table.lower, 0.5 * table.upper)
        point = table.forward(rng.uniform(table.lower, table.upper))[:3, 3]
        capped = baselines.newton_position(table, point, q0, max_step=0.05)
        steps = np.angle(np.exp(1j * np.diff(capped.history, axis=0)))
        assert np.abs(steps).max() <= 0.05 * (1 + 1e-12)
        assert capped.converged
        J = table.finite_difference_jacobian(q0)[:3]
        full = np.linalg.lstsq(J, point - table.forward(q0)[:3, 3], rcond=None)[0]
        np.testing.assert_allclose(steps[0] / np.linalg.norm(steps[0]), full / np.linalg.norm(full), atol=1e-6)


def test_singular_starts_stay_finite():
    """From the stretched arm, and towards targets out of reach, all is finite and each angle in its turn."""
    for table in (maira(), iiwa14()):
        for point in ([0.3, 0.2, 0.9], [0.0, 0.0, 5.0], [9.0, 0.0, 0.0], [0.0, 0.0, 0.0]):
            result = baselines.newton_position(table, point, np.zeros(7), max_iterations=50)
            assert np.isfinite(result.history).all()
            assert np.abs(result.history).max() <= np.pi
            gap = np.linalg.norm(np.array(point) - table.forward(result.q)[:3, 3])
            assert result.error == pytest.approx(gap)
            assert result.converged == (gap < 1e-3)


def test_a_diverging_slider_ends_at_its_last_good_step():
    """With a learning rate above 2 the error of a linear map grows: the loop ends, unconverged, with finite numbers."""
    result = baselines.newton_position(CARTESIAN, [1.0, 1.0, 1.0], np.zeros(3), step=1e8, max_iterations=1000)
    assert not result.converged
    assert result.iterations < 5
    assert np.isfinite(result.history).all()


def test_angles_come_back_into_their_turn():
    """A start several turns away gives the same answer as that within the limits, about the middle of each range."""
    table = DHTable([DHLink(a=0.7, lower=0.0, upper=6.0), DHLink(a=0.5)])
    point = table.forward(np.array([5.0, 1.0]))[:3, 3]
    near = baselines.newton_position(table, point, [4.9, 1.1], tolerance=1e-10)
    far = baselines.newton_position(table, point, [4.9 - 4 * np.pi, 1.1 + 2 * np.pi], tolerance=1e-10)
    np.testing.assert_allclose(near.q, [5.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(far.q, near.q, atol=1e-9)


def test_arguments_are_left_as_they_were():
    """Neither inputs nor the array that the gradient function sees lead back into the method's own state."""
    table = maira()
    target, q0 = table.forward(np.full(7, 0.5)), np.full(7, 0.2)

    def vandal(q):
        q[:] = 99.0
        return np.zeros(7)

    result = baselines.newton_null_space(table, target, q0, vandal, alpha=1.0)
    plain = baselines.newton_pose(table, target, q0)
    assert np.array_equal(result.q, plain.q)
    assert np.array_equal(q0, np.full(7, 0.2))
    assert np.array_equal(target, table.forward(np.full(7, 0.5)))


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"point": [1.0, 2.0]}, PoseError, r"point must be real numbers of shape \(3,\)"),
        ({"point": [1.0, 2.0, np.nan]}, PoseError, "finite"),
        ({"q0": np.zeros((1, 7))}, ConfigurationError, "q0"),
        ({"step": 0.0}, OptionError, "step"),
        ({"step": np.inf}, OptionError, "step"),
        ({"max_step": 0.0}, OptionError, "max_step"),
        ({"max_step": "1"}, OptionError, "max_step"),
        ({"tolerance": -1e-3}, OptionError, "tolerance"),
        ({"max_iterations": True}, OptionError, "max_iterations"),
    ],
)
def test_wrong_arguments_are_named(change, error, says):
    """Each wrong argument of the position method raises its own error, which names it."""
    with pytest.raises(error, match=says):
        baselines.newton_position(maira(), **({"point": POINT, "q0": np.zeros(7)} | change))


def test_a_wrong_gradient_is_named():
    """A gradient that is no function, or gives another shape or NaN, and a gain of zero are refused."""
    for gradient, alpha, says in (
        (np.zeros(7), 1.0, "gradient must be a function"),
        (lambda q: np.zeros(6), 1.0, r"shape \(7,\)"),
        (lambda q: np.full(7, np.nan), 1.0, "finite"),
        (lambda q: np.zeros(7), 0.0, "alpha"),
    ):
        with pytest.raises(OptionError, match=says):
            baselines.newton_null_space(maira(), np.eye(4), np.zeros(7), gradient, alpha=alpha)
    with pytest.raises(OptionError, match="orientation_tolerance"):
        baselines.newton_pose(maira(), np.eye(4), np.zeros(7), orientation_tolerance=0.0)
