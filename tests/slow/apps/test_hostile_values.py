"""Whatever a caller passes, wherever: an error of this package that says what was wrong, or an answer that holds."""

import datetime
import math

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import MairaError, OptionError


class Odd:
    """An object that refuses to be looked at."""

    def __repr__(self):
        raise RuntimeError("no repr")

    def __array__(self, *_, **__):
        raise RuntimeError("no array")


def nested(depth):
    """A list of 10^depth numbers that takes no room: each level holds the one below ten times."""
    value = [1.0]
    for _ in range(depth):
        value = [value] * 10
    return value


RAGGED = [[1.0, 2.0], [3.0]]
MASKED = np.ma.masked_array(np.ones(7), mask=[True] + [False] * 6)
HOSTILE = {
    "none": None,
    "bool": True,
    "complex": 1 + 0j,
    "text": "joint1",
    "bytes": b"abc",
    "huge": 10**400,
    "large": 10**30,
    "negative": -1,
    "nan": math.nan,
    "inf": math.inf,
    "zero_d": np.array(0.5),
    "empty": [],
    "ragged": RAGGED,
    "none_inside": [None] * 7,
    "one_none": [np.zeros(7), None],
    "masked": MASKED,
    "list_of_masked": [MASKED, MASKED],
    "objects": np.array([None, "x"], dtype=object),
    "odd": Odd(),
    "date": datetime.date(2020, 1, 2),
    "mapping": {"a": 1},
    "numbers_as_text": ["1"] * 7,
    "wrong_length": np.zeros(5),
    "longdouble": np.full(7, np.finfo(np.longdouble).max),
    "bools": np.ones(7, dtype=bool),
    "matrix": np.eye(3),
    "nan_pose": np.full((4, 4), np.nan),
    "set": {1, 2},
    "very_long": "x" * 10**6,
    "surrogate": "\ud800",
    "bomb": {"a": [nested(12)]},
    "boxed_bomb": np.array([{"a": nested(12)}, 1.0, 2.0], dtype=object),
}
"""Values by name. Those that are right in one place or another are answered there."""

ROBOT = mq.Robot.maira()
T = ROBOT.forward(np.full(7, 0.3)).homogeneous
Q = np.full(7, 0.2)


@pytest.fixture(scope="module")
def solver():
    return mq.Solver(ROBOT, options=mq.Options(max_restarts=20))


PLACES = {
    "forward": lambda s, v: ROBOT.forward(v),
    "frame": lambda s, v: ROBOT.forward(Q, v),
    "jacobian": lambda s, v: ROBOT.jacobian(v),
    "clip": lambda s, v: ROBOT.clip(v),
    "limited_lower": lambda s, v: ROBOT.limited(lower=v),
    "limited_margin": lambda s, v: ROBOT.limited(margin=v),
    "limited_velocity": lambda s, v: ROBOT.limited(velocity={"joint1": v}),
    "released": lambda s, v: ROBOT.released(v),
    "released_name": lambda s, v: ROBOT.released([v]),
    "from_dh": lambda s, v: mq.Robot.from_dh(v),
    "from_dh_row": lambda s, v: mq.Robot.from_dh([v]),
    "from_dh_key": lambda s, v: mq.Robot.from_dh([{"a": 0.1, "d": v}]),
    "from_dh_kind": lambda s, v: mq.Robot.from_dh([{"kind": v}]),
    "from_dh_limit": lambda s, v: mq.Robot.from_dh([{"upper": v}]),
    "from_dh_name": lambda s, v: mq.Robot.from_dh([{"a": 1}], name=v),
    "from_urdf": lambda s, v: mq.Robot.from_urdf(v),
    "from_model": lambda s, v: mq.Robot.from_model(v),
    "from_model_tip": lambda s, v: mq.Robot.from_model(ROBOT.model, v),
    "from_model_base": lambda s, v: mq.Robot.from_model(ROBOT.model, base=v),
    "from_model_limits": lambda s, v: mq.Robot.from_model(ROBOT.model, limits=v),
    "from_model_name": lambda s, v: mq.Robot.from_model(ROBOT.model, name=v),
    "from_model_acceleration": lambda s, v: mq.Robot.from_model(ROBOT.model, acceleration=v),
    "from_model_mimic": lambda s, v: mq.Robot.from_model(ROBOT.model, mimic=v),
    "from_model_coupling": lambda s, v: mq.Robot.from_model(ROBOT.model, mimic={"joint2": ("joint1", v, v)}),
    "integrate": lambda s, v: ROBOT.integrate(v, ROBOT.middle),
    "difference": lambda s, v: ROBOT.difference(ROBOT.middle, v),
    "from_urdf_tip": lambda s, v: mq.Robot.from_urdf(ROBOT.urdf, tip=v),
    "from_urdf_base": lambda s, v: mq.Robot.from_urdf(ROBOT.urdf, base=v),
    "from_urdf_limits": lambda s, v: mq.Robot.from_urdf(ROBOT.urdf, limits=v),
    "from_urdf_limit": lambda s, v: mq.Robot.from_urdf(ROBOT.urdf, limits={"joint1": v}),
    "from_file": lambda s, v: mq.DHTable.from_file(v),
    "pose_position": lambda s, v: mq.pose(v),
    "pose_quaternion": lambda s, v: mq.pose(quaternion=v),
    "pose_rpy": lambda s, v: mq.pose(rpy=v),
    "pose_matrix": lambda s, v: mq.pose(matrix=v),
    "pose_project": lambda s, v: mq.pose(matrix=T, project=v),
    "solve": lambda s, v: s.solve(v),
    "solve_q0": lambda s, v: s.solve(T, v),
    "solve_rng": lambda s, v: s.solve(T, rng=v),
    "solve_observe": lambda s, v: s.solve(T, observe=v),
    "solve_prefer": lambda s, v: s.solve(T, Q, prefer=v),
    "solve_metric": lambda s, v: s.solve(T, Q, prefer="closest", metric=v),
    "batch": lambda s, v: s.solve_batch(v),
    "batch_of": lambda s, v: s.solve_batch([T, v]),
    "batch_q0": lambda s, v: s.solve_batch([T, T], v),
    "batch_q0_of": lambda s, v: s.solve_batch([T, T], [Q, v]),
    "batch_seed": lambda s, v: s.solve_batch([T], seed=v),
    "batch_threads": lambda s, v: s.solve_batch([T], threads=v),
    "batch_progress": lambda s, v: s.solve_batch([T], progress=v),
    "step": lambda s, v: s.step(v, T, 0.01),
    "step_target": lambda s, v: s.step(Q, v, 0.01),
    "step_dt": lambda s, v: s.step(Q, T, v),
    "step_velocity": lambda s, v: s.step(Q, T, 0.01, velocity=v),
    "step_deadline": lambda s, v: s.step(Q, T, 0.01, deadline=v),
    "step_keep_direction": lambda s, v: s.step(Q, T, 0.01, keep_direction=v),
    "solutions": lambda s, v: s.solutions(v),
    "solutions_rng": lambda s, v: s.solutions(T, rng=v),
    "pose_error": lambda s, v: mq.pose_error(T, v),
    "compile": lambda s, v: mq.compile(v, verbs="none of these"),
    "compile_verbs": lambda s, v: mq.compile(ROBOT, verbs=[v]),
    "compile_processes": lambda s, v: mq.compile(ROBOT, verbs="none of these", processes=v),
    "collision_missing": lambda s, v: mq.CollisionLimit(missing=v),
    "paths_line": lambda s, v: mq.paths.line(T, v),
    "paths_step": lambda s, v: mq.paths.line(T, np.eye(4), step=v),
    "paths_turn": lambda s, v: mq.paths.line(T, np.eye(4), turn=v),
    "paths_frame": lambda s, v: mq.paths.line(T, T, frame=v),
    "paths_arc": lambda s, v: mq.paths.arc(T, v, np.eye(4)),
    "paths_radius": lambda s, v: mq.paths.circle(T, v),
    "paths_turns": lambda s, v: mq.paths.circle(T, 0.1, turns=v),
    "paths_tangent": lambda s, v: mq.paths.circle(T, 0.1, tangent=v),
    "paths_pitch": lambda s, v: mq.paths.spiral(T, 0.1, 0.2, pitch=v),
    "paths_polyline": lambda s, v: mq.paths.polyline(v),
    "paths_polyline_of": lambda s, v: mq.paths.polyline([T, v]),
    "paths_blend": lambda s, v: mq.paths.polyline([T, np.eye(4)], blend=v),
    "paths_cube": lambda s, v: mq.paths.cube(T, 0.1, tilt=v),
    "paths_letters": lambda s, v: mq.paths.letters(v, 0.1, T),
    "paths_waypoints": lambda s, v: mq.paths.waypoints(v, 0.1),
    "paths_dt": lambda s, v: mq.paths.waypoints([T, np.eye(4)], v),
    "paths_times": lambda s, v: mq.paths.waypoints([T, np.eye(4)], 0.1, times=v),
    "paths_speed": lambda s, v: mq.paths.waypoints([T, np.eye(4)], 0.1, speed=v),
    "paths_acceleration": lambda s, v: mq.paths.waypoints([T, np.eye(4)], 0.1, acceleration=v),
    "paths_stop": lambda s, v: mq.paths.waypoints([T, np.eye(4)], 0.1, stop=v),
    "paths_resampled": lambda s, v: mq.paths.resampled(v),
    "paths_length": lambda s, v: mq.paths.length([T, v]),
    "paths_in_frame": lambda s, v: mq.paths.in_frame([T], v),
    "paths_from_csv": lambda s, v: mq.paths.from_csv(v),
    "engine_for": lambda s, v: s.engine_for(v),
    "solver_robot": lambda s, v: mq.Solver(v),
    "solver_task": lambda s, v: mq.Solver(ROBOT, task=v),
    "solver_tasks": lambda s, v: mq.Solver(ROBOT, tasks=v),
    "solver_limits": lambda s, v: mq.Solver(ROBOT, limits=v),
    "solver_redundancy": lambda s, v: mq.Solver(ROBOT, redundancy=v),
    "solver_backend": lambda s, v: mq.Solver(ROBOT, backend=v),
    "solver_options": lambda s, v: mq.Solver(ROBOT, options=v),
    "backend_settings": lambda s, v: mq.Backend("daqp", v),
    "pose_task_target": lambda s, v: mq.PoseTask(target=v),
    "pose_task_frame": lambda s, v: mq.Solver(ROBOT, task=mq.PoseTask(frame=v)),
    "pose_task_weight": lambda s, v: mq.PoseTask(position_weight=v),
    "pose_task_priority": lambda s, v: mq.PoseTask(priority=v),
    "pose_task_gain": lambda s, v: mq.PoseTask(gain=v),
    "pose_task_damping": lambda s, v: mq.PoseTask(damping=v),
    "pose_task_axes": lambda s, v: mq.PoseTask(axes=v),
    "axis": lambda s, v: mq.AxisTask(axis=v),
    "look_at": lambda s, v: mq.LookAtTask(point=v),
    "coupling": lambda s, v: mq.JointCouplingTask(coefficients=v),
    "coupling_of": lambda s, v: mq.JointCouplingTask(coefficients={"joint1": v}),
    "coupling_value": lambda s, v: mq.JointCouplingTask(coefficients={"joint1": 1}, value=v),
    "damping_task": lambda s, v: mq.DampingTask(weight=v).of(ROBOT),
    "swivel": lambda s, v: mq.SwivelTask(shoulder=v, elbow="link4", wrist="link6", angle=0.1).of(ROBOT),
    "objective_task": lambda s, v: mq.ObjectiveTask(v),
    "limit_task": lambda s, v: mq.LimitTask(limit=v),
    "linear_limit": lambda s, v: mq.LinearLimit(v, [1.0]),
    "linear_limit_b": lambda s, v: mq.LinearLimit(np.ones((1, 7)), v),
    "posture": lambda s, v: mq.Posture(v).of(ROBOT),
    "posture_weights": lambda s, v: mq.Posture(weights=v).of(ROBOT),
    "manipulability": lambda s, v: mq.Manipulability(frame=v).of(ROBOT),
    "obstacle": lambda s, v: mq.ObstacleDistance(v).of(ROBOT),
    "obstacle_frames": lambda s, v: mq.ObstacleDistance([0, 0, 1], frames=v).of(ROBOT),
    "obstacle_sharpness": lambda s, v: mq.ObstacleDistance([0, 0, 1], sharpness=v).of(ROBOT),
    "weighted": lambda s, v: mq.Weighted(v),
    "weighted_weight": lambda s, v: mq.Weighted(mq.Posture(), v),
    "strict": lambda s, v: mq.Strict(v),
    "obstacles": lambda s, v: mq.CollisionLimit(obstacles=v),
    "collision_margin": lambda s, v: mq.CollisionLimit(margin=v),
    "collision_allowed": lambda s, v: mq.CollisionLimit(allowed=v).of(ROBOT),
    "collision_meshes": lambda s, v: mq.CollisionLimit(meshes=v),
    "sphere": lambda s, v: mq.Sphere(v),
    "capsule": lambda s, v: mq.Capsule(0.1, v),
    "cylinder": lambda s, v: mq.Cylinder(v, 1.0),
    "mesh_scale": lambda s, v: mq.Mesh("a.stl", scale=v),
    "condition_number": lambda s, v: ROBOT.condition_number(Q, v),
    "manipulability_of": lambda s, v: ROBOT.manipulability(v),
    "relative": lambda s, v: mq.Solver(ROBOT, task=mq.RelativePoseTask(frame="tool0", reference=v)),
    "box": lambda s, v: mq.Box(v),
    "shape_pose": lambda s, v: mq.Sphere(1.0, pose=v),
    "shape_name": lambda s, v: mq.Sphere(1.0, name=v),
    "mesh": lambda s, v: mq.CollisionLimit(obstacles=[mq.Mesh(v)]).of(ROBOT),
} | {f"options_{name}": lambda s, v, name=name: mq.Options(**{name: v}) for name in mq.Options.__dataclass_fields__}


@pytest.mark.parametrize("place", PLACES)
def test_a_hostile_value_is_answered_or_refused_in_words(place, solver):
    """Nothing but a `MairaError` comes out, whose message is short; answers keep what every answer promises."""
    for name, value in HOSTILE.items():
        answer = None
        try:
            answer = PLACES[place](solver, value)
        except MairaError as reason:
            is_short = 10 < len(str(reason)) < 2000
        except Exception as reason:  # the table's name goes into the report
            pytest.fail(f"{name}: {type(reason).__name__}: {reason!s:.300}")
        else:
            is_short = True
        assert is_short, name
        if isinstance(answer, (mq.Solution, mq.BatchSolution)):
            finite = np.isfinite(answer.q)
            assert (finite | (np.asarray(answer.status) == mq.Status.INVALID_TARGET).reshape(-1, 1)).all(), name
            assert ((ROBOT.lower <= answer.q) & (answer.q <= ROBOT.upper) | ~finite).all(), name


def test_counts_of_numpy_are_counts(solver):
    for threads in (np.int64(2), 2.0):
        assert solver.solve_batch([T, T], threads=threads).success.all()
    assert mq.Options(max_iterations=np.int32(7), max_restarts=3.0).max_restarts == 3


def test_a_tick_without_its_length_asks_for_it(solver):
    """Not in words of the NaN that stands for it; a NaN of the caller is named."""
    with pytest.raises(OptionError, match=r"needs its length dt in seconds: step\(q, target, dt\)"):
        solver.step(Q, T)
    with pytest.raises(OptionError, match="got nan"):
        solver.step(Q, T, np.nan)
