"""What is proved of paths that cannot be followed, checked with solutions that descents from random starts find."""

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.results.path_proof import PathProof
from maira_qp.solvers.paths.impossibility import boxes_at, path_proof

WITHIN = (1e-6, 1e-6)
"""Tolerances [m, rad]"""

ARMS = {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14}


def around_the_base(radius: float, height: float, first: float, last: float, count: int) -> np.ndarray:
    """Poses (count, 4, 4) on a circle about the base, the tool down and turning with it."""
    return np.array(
        [
            mq.pose(
                [radius * np.cos(a), radius * np.sin(a), height], quaternion=[0, np.cos(a / 2), np.sin(a / 2), 0]
            ).homogeneous
            for a in np.linspace(first, last, count)
        ]
    )


def solutions(robot: mq.Robot, T: np.ndarray, rng: np.random.Generator, count: int = 200) -> np.ndarray:
    """Configurations within the limits that reach a pose: one descent each from random starts, no closed form."""
    solver = mq.Solver(robot, options=mq.Options(max_restarts=0))
    found = [solver.solve(T, q0=rng.uniform(robot.lower, robot.upper)) for _ in range(count)]
    return np.array([each.q for each in found if each.success])


def check(proof: PathProof, robot: mq.Robot, targets: np.ndarray, rng: np.random.Generator) -> int:
    """Look at some poses of a proof as its docstring says. Returns how many configurations were looked at."""
    count, slack = 0, 1e-5  # descents end within the tolerances of a pose
    assert len(proof.boxes[-1]) == 0
    for k in rng.choice(np.arange(proof.is_start_given, len(proof.at)), size=5, replace=False):
        for q in solutions(robot, targets[proof.at[k]], rng):
            boxes = proof.boxes[k]
            inside = ((boxes[:, 0] <= q + slack) & (q - slack <= boxes[:, 1])).all(axis=1).any()
            if not inside:
                assert k > 0
                before, allowed = proof.boxes[k - 1], (proof.at[k] - proof.at[k - 1]) * proof.step
                gap = np.maximum(before[:, 0] - q, q - before[:, 1])
                assert (gap > allowed - slack).any(axis=1).all()
            count += 1
    return count


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("max_step", [0.5, 0.1])
def test_a_turn_too_many_is_proved(name, max_step, rng):
    """More than a turn about the base, and no joint has room for it: where the arm stops, nothing goes on."""
    robot = ARMS[name]()
    targets = around_the_base(0.55, 0.5, -3.0, 8.0, 150)
    path = mq.Solver(robot).track(targets, max_step=max_step)
    assert not path
    assert path.success.all()
    proof = path.proof
    assert isinstance(proof, PathProof)
    assert "out of reach of the allowed steps" in proof.words
    assert proof.at[-1] >= path.first_failure
    assert check(proof, robot, targets, rng) > 100


def test_a_given_start_is_proved_to_lead_nowhere(rng):
    robot = mq.Robot.maira()
    targets = around_the_base(0.55, 0.5, -2.0, 3.0, 120)
    solver = mq.Solver(robot)
    assert solver.track(targets)
    lost = [path for each in solver.solutions(targets[0])[:5] if not (path := solver.track(targets, q0=each.q))]
    proved = [path.proof for path in lost[:2] if isinstance(path.proof, PathProof)]
    assert proved
    for proof in proved:
        assert proof.is_start_given
        assert check(proof, robot, targets, rng) > 100


def moved(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A pose (4, 4) beside another, within the tolerances."""
    shift, turn = (
        size * rng.uniform(0.5, 1.0) * each / np.linalg.norm(each)
        for size, each in zip(WITHIN, rng.normal(size=(2, 3)), strict=True)
    )
    return pin.SE3(T[:3, :3] @ pin.exp3(turn), T[:3, 3] + shift).homogeneous


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("is_stretched", [False, True])
def test_what_an_arm_has_done_is_not_proved_impossible(name, is_stretched, rng):
    """With steps hardly larger than those of the motion; poses within the tolerances, some of a straight arm."""
    robot = ARMS[name]()
    t = np.linspace(0.0, 1.0, 40)[:, None]
    for _ in range(4):
        a, b, c = rng.uniform(robot.lower, robot.upper, size=(3, 7))
        if is_stretched:
            a[3], b[3], c[3] = 0.0, 0.2, rng.choice([-0.3, 0.5])
        motion = (1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c
        targets = np.array([moved(robot.forward(q).homogeneous, rng) for q in motion])
        step = 1.001 * np.abs(np.diff(motion, axis=0)).max(axis=0)
        assert path_proof(SRS.of(robot), targets, WITHIN, step, None, 0) is None
        assert path_proof(SRS.of(robot), targets, WITHIN, step, motion[0], 0) is None


@pytest.mark.parametrize("name", ARMS)
def test_boxes_hold_all_solutions(name, rng):
    robot = ARMS[name]()
    for _ in range(60):
        q = rng.uniform(robot.lower, robot.upper)
        q[rng.choice([0, 1, 2, 4, 5, 6])] *= rng.choice([1.0, 1e-3])  # near singularities as well
        q[3] = np.copysign(max(abs(q[3]), 0.1), q[3])
        T = moved(robot.forward(q).homogeneous, rng)
        boxes = boxes_at(SRS.of(robot), T, WITHIN, int(rng.choice([64, 256])))
        assert ((boxes[:, 0] <= q) & (q <= boxes[:, 1])).all(axis=1).any()
        assert (boxes[:, 0] >= robot.lower - 1e-8).all()
        assert (boxes[:, 1] <= robot.upper + 1e-8).all()


def test_nothing_is_proved_of_a_stretched_arm():
    """A jump follows, and before it the poses are half a micrometre out of reach: that is within the tolerances."""
    robot = mq.Robot.iiwa14()
    srs, q = SRS.of(robot), np.array([0.3, 0.5, 0.2, 0.0, 0.4, 0.6, 0.1])
    targets = np.array([robot.forward(q + 0.002 * k * np.eye(7)[0]).homogeneous for k in range(12)])
    for T in targets:
        arm = srs.wrist_centre(T) - srs.shoulder
        T[:3, 3] += 5e-7 * arm / np.linalg.norm(arm)
    other = np.array([2.5, -0.9, 0.2, 1.0, 0.4, 0.6, 0.1])
    targets[8:] = [robot.forward(other + 0.002 * k).homogeneous for k in range(4)]
    path = mq.Solver(robot).track(targets, q0=q)
    assert path.parts == [(0, 8), (8, 12)]
    assert path.proof is None


def test_a_pose_out_of_reach_is_proved():
    targets = [mq.pose([x, 0.1, 0.5], quaternion=[0, 1, 0, 0]) for x in np.linspace(0.4, 1.6, 60)]
    path = mq.Solver(mq.Robot.maira()).track(targets)
    assert not path
    assert path.failures[0].is_proved
    assert path.proof is not None
    assert path.proof.words


def test_a_path_that_is_followed_has_no_proof():
    path = mq.Solver(mq.Robot.maira()).track(around_the_base(0.55, 0.5, -1.0, 1.0, 50))
    assert path
    assert path.proof is None
