"""The plain reference: Algorithm 1 of the first seed, against a literal transcription and its properties."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maira_qp.errors import ConfigurationError, OptionError, PoseError
from maira_qp.evaluation import baselines
from maira_qp.orientation import rigid
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.catalog import iiwa14, maira

SLIDER = DHTable(
    [
        DHLink(kind="prismatic", alpha=-np.pi / 2, lower=-0.5, upper=1.5),
        DHLink(kind="fixed", d=0.2),
        *maira().links[1:],
    ]
)
UNLIMITED = DHTable([DHLink(kind="continuous", alpha=-np.pi / 2, d=0.4), *maira().links[1:]])


def reference_step(table, target, q, damping=1e-6, alpha=0.01):
    """One pass of the algorithm as it is printed, with the finite-difference Jacobian and SciPy's rotation vector."""
    T = table.forward(q)
    J = table.finite_difference_jacobian(q)
    phi = Rotation.from_matrix(target[:3, :3] @ T[:3, :3].T).as_rotvec()
    e = np.concatenate([target[:3, 3] - T[:3, 3], phi])
    J_pinv = J.T @ np.linalg.inv(J @ J.T + damping * np.eye(6))
    N = np.eye(table.n) - J_pinv @ J
    q_sec = -alpha * (q - (table.lower + table.upper) / 2)
    return np.clip(q + J_pinv @ e + N @ q_sec, table.lower, table.upper)


@pytest.mark.parametrize("table", [maira(), iiwa14(), SLIDER], ids=["maira", "iiwa14", "slider"])
def test_every_step_is_that_of_the_printed_algorithm(table):
    """The damping, the null-space pull and the clip agree with a literal transcription, step by step."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        target = table.forward(rng.uniform(table.lower, table.upper))
        result = baselines.dh_clamped(table, target, rng.uniform(table.lower, table.upper), max_iterations=10)
        for before, after in zip(result.history[:-1], result.history[1:], strict=True):
            np.testing.assert_allclose(after, reference_step(table, target, before), atol=2e-6)


def test_damping_and_pull_are_those_asked_for():
    """Far from the defaults, too, the step is that of the formula."""
    table = maira()
    rng = np.random.default_rng(2)
    target, q0 = (table.forward(rng.uniform(table.lower, table.upper)), rng.uniform(table.lower, table.upper))
    for damping, alpha in ((0.1, 0.0), (1.0, 0.5)):
        result = baselines.dh_clamped(table, target, q0, damping=damping, alpha=alpha, max_iterations=1)
        np.testing.assert_allclose(result.q, reference_step(table, target, q0, damping, alpha), atol=1e-7)


@pytest.mark.parametrize(
    "table", [maira(), iiwa14(), SLIDER, UNLIMITED], ids=["maira", "iiwa14", "slider", "unlimited"]
)
def test_it_finds_reachable_targets_and_never_leaves_the_limits(table):
    """From a start near the solution it converges, and all of its history lies within the limits to the bit."""
    rng = np.random.default_rng(3)
    finite_lower, finite_upper = np.maximum(table.lower, -np.pi), np.minimum(table.upper, np.pi)
    solved = 0
    for _ in range(20):
        q_true = rng.uniform(0.6 * finite_lower, 0.6 * finite_upper)
        target = table.forward(q_true)
        result = baselines.dh_clamped(table, target, q_true + rng.uniform(-0.1, 0.1, table.n), tolerance=1e-5)
        assert (table.lower <= result.history).all()
        assert (result.history <= table.upper).all()
        if result.converged:
            solved += 1
            T = table.forward(result.q)
            assert np.linalg.norm(T[:3, 3] - target[:3, 3]) < 1e-5
            assert Rotation.from_matrix(T[:3, :3].T @ target[:3, :3]).magnitude() < 1e-5
    assert solved >= 12


def test_the_clip_binds_where_a_limit_is_in_the_way():
    """A target that only a joint beyond its limit would reach is approached with that joint at its limit, exactly."""
    table = DHTable([DHLink(a=1.0, lower=-0.5, upper=0.5), DHLink(a=0.5, lower=-0.1, upper=0.1)])
    free = DHTable([DHLink(a=1.0), DHLink(a=0.5)])
    result = baselines.dh_clamped(table, free.forward(np.array([1.0, 0.3])), [0.0, 0.0])
    assert not result.converged
    assert result.q[0] == 0.5


def test_running_out_of_iterations_is_said():
    """An unreachable target is not converged, and the error reported is that of the configuration returned."""
    table = maira()
    target = np.eye(4)
    target[:3, 3] = [3.0, 0.0, 0.0]
    result = baselines.dh_clamped(table, target, np.full(7, 0.3), max_iterations=40)
    assert not result.converged
    assert result.iterations == 40
    assert result.history.shape == (41, 7)
    assert np.array_equal(result.history[-1], result.q)
    T = table.forward(result.q)
    phi = Rotation.from_matrix(target[:3, :3] @ T[:3, :3].T).as_rotvec()
    np.testing.assert_allclose(result.error, np.linalg.norm([*(target[:3, 3] - T[:3, 3]), *phi]), rtol=1e-9)


def test_a_start_at_the_target_takes_no_step():
    """The error is tested before the first step."""
    table = maira()
    q0 = np.full(7, 0.4)
    result = baselines.dh_clamped(table, table.forward(q0), q0, max_iterations=0)
    assert result.converged
    assert result.iterations == 0
    assert np.array_equal(result.q, q0)


def test_a_start_outside_the_limits_is_clipped():
    """Even with no iteration at all the answer lies within the limits."""
    table = maira()
    result = baselines.dh_clamped(table, table.forward(np.zeros(7)), np.full(7, 9.0), max_iterations=0)
    np.testing.assert_array_equal(result.history, [table.upper])


def test_singular_starts_stay_finite():
    """From the stretched arm, and for a planar arm whose J J^T is singular everywhere, no value is lost."""
    for table in (maira(), iiwa14(), DHTable([DHLink(a=1.0), DHLink(a=0.5)])):
        rng = np.random.default_rng(4)
        target = table.forward(rng.uniform(table.lower, table.upper))
        result = baselines.dh_clamped(table, target, np.zeros(table.n), max_iterations=50)
        assert np.isfinite(result.history).all()
    no_damping = baselines.dh_clamped(table, target, np.zeros(2), damping=1e-300, max_iterations=50)
    assert np.isfinite(no_damping.history).all()


def test_a_joint_without_limits_is_not_pulled():
    """A continuous joint has no middle: with the pose kept, the pull leaves a lone continuous redundancy at rest."""
    table = DHTable([DHLink(kind="continuous"), DHLink(kind="continuous", a=1.0)])
    q0 = np.array([2.0, -1.0])
    target = table.forward(q0 + np.array([0.1, 0.0]))
    result = baselines.dh_clamped(table, target, q0, alpha=0.5)
    assert result.converged
    np.testing.assert_allclose(result.q, q0 + 0.05, atol=1e-5)


def test_arguments_are_left_as_they_were():
    """Neither the target nor the start is written to, and the result shares no memory with them."""
    table = maira()
    rng = np.random.default_rng(5)
    target, q0 = table.forward(rng.uniform(table.lower, table.upper)), rng.uniform(table.lower, table.upper)
    copies = target.copy(), q0.copy()
    result = baselines.dh_clamped(table, target, q0, max_iterations=5)
    assert np.array_equal(target, copies[0])
    assert np.array_equal(q0, copies[1])
    result.q[:] = 0
    assert np.array_equal(q0, copies[1])


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"target": np.eye(3)}, PoseError, r"\(4, 4\) array"),
        ({"target": np.full((4, 4), np.nan)}, PoseError, "finite"),
        ({"target": np.diag([1.0, 1.0, 1.001, 1.0])}, PoseError, r"project=True"),
        ({"target": np.diag([1.0, 1.0, -1.0, 1.0])}, PoseError, "reflection"),
        ({"target": np.ones((4, 4))}, PoseError, "last row"),
        ({"q0": np.zeros(6)}, ConfigurationError, r"shape \(7,\)"),
        ({"q0": np.full(7, np.inf)}, ConfigurationError, "finite"),
        ({"q0": ["a"] * 7}, ConfigurationError, "numbers"),
        ({"damping": 0.0}, OptionError, "damping"),
        ({"damping": np.nan}, OptionError, "damping"),
        ({"alpha": -1.0}, OptionError, "alpha"),
        ({"alpha": np.inf}, OptionError, "alpha"),
        ({"tolerance": np.inf}, OptionError, "tolerance"),
        ({"tolerance": True}, OptionError, "tolerance"),
        ({"max_iterations": -1}, OptionError, "max_iterations"),
        ({"max_iterations": 1.5}, OptionError, "max_iterations"),
    ],
)
def test_wrong_arguments_are_named(change, error, says):
    """Each wrong argument raises its own error, which names it."""
    arguments = {"target": np.eye(4), "q0": np.zeros(7)} | change
    with pytest.raises(error, match=says):
        baselines.dh_clamped(maira(), **arguments)


def test_a_slightly_rounded_rotation_is_taken_as_the_nearest():
    """A rotation rounded to six digits becomes the nearest exact one, as SciPy finds it; the caller's array stays."""
    table = maira()
    q = np.array([0.3, 0.5, -0.2, 1.0, 0.4, 0.8, 0.1])
    rounded = table.forward(q).round(6)
    copy = rounded.copy()
    R = rigid(rounded, "target")[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(R, Rotation.from_matrix(rounded[:3, :3]).as_matrix(), atol=1e-11)
    assert np.array_equal(rounded, copy)
    assert baselines.dh_clamped(table, rounded, q + 0.01).converged
