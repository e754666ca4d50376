"""maira_qp: constrained inverse kinematics by quadratic programming.

```python
import maira_qp as mq

robot = mq.Robot.maira()
solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
solution = solver.solve(mq.pose([0.4, 0.2, 0.9], quaternion=[1, 0, 0, 0]))
```
"""

from maira_qp import errors, paths, scale
from maira_qp.field_docs import show_fields as _show_fields
from maira_qp.io.save import save
from maira_qp.orientation import pose_error
from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.limits.joint import Limit, Tick
from maira_qp.problem.limits.linear import LinearLimit
from maira_qp.problem.limits.orientation import ConeLimit, PoseRange
from maira_qp.problem.limits.regions import BoxLimit, DistanceLimit, HalfSpaceLimit
from maira_qp.problem.limits.tool_speed import ToolSpeedLimit
from maira_qp.problem.objectives import LimitDistance, Manipulability, ObstacleDistance, Posture
from maira_qp.problem.options import Options
from maira_qp.problem.pose import pose
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.axis import AxisTask, LookAtTask
from maira_qp.problem.tasks.frame import OrientationTask, PoseTask, PositionTask
from maira_qp.problem.tasks.joints import DampingTask, JointCouplingTask, JointVelocityTask
from maira_qp.problem.tasks.limit import LimitTask
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.relative import RelativePoseTask
from maira_qp.problem.tasks.swivel import SwivelTask
from maira_qp.problem.tasks.task import Task
from maira_qp.results.batch import BatchSolution
from maira_qp.results.command import Command
from maira_qp.results.path_proof import PathProof
from maira_qp.results.path_solution import PathFailure, PathSolution
from maira_qp.results.solution import Solution
from maira_qp.results.solution_set import ListedSolution, Solutions
from maira_qp.results.status import Reach, Status, StepStatus, TrackerState
from maira_qp.results.step import Step
from maira_qp.results.trajectory import Trajectory
from maira_qp.robots.collision.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Sphere
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.ahead import compile
from maira_qp.solvers.solver import Solver
from maira_qp.solvers.streaming.clutch import Clutch
from maira_qp.solvers.streaming.tracker import Tracker
from maira_qp.version import __version__ as __version__

__all__ = [
    "AxisTask",
    "Backend",
    "BatchSolution",
    "Box",
    "BoxLimit",
    "Capsule",
    "Clutch",
    "CollisionLimit",
    "Command",
    "ConeLimit",
    "Cylinder",
    "DHLink",
    "DHTable",
    "DampingTask",
    "DistanceLimit",
    "Ellipsoid",
    "HalfSpaceLimit",
    "JointCouplingTask",
    "JointVelocityTask",
    "Limit",
    "LimitDistance",
    "LimitTask",
    "LinearLimit",
    "ListedSolution",
    "LookAtTask",
    "Manipulability",
    "Mesh",
    "ObjectiveTask",
    "ObstacleDistance",
    "Options",
    "OrientationTask",
    "PathFailure",
    "PathProof",
    "PathSolution",
    "PoseRange",
    "PoseTask",
    "PositionTask",
    "Posture",
    "Reach",
    "RelativePoseTask",
    "Robot",
    "Solution",
    "Solutions",
    "Solver",
    "Sphere",
    "Status",
    "Step",
    "StepStatus",
    "Strict",
    "SwivelTask",
    "Task",
    "Tick",
    "ToolSpeedLimit",
    "Tracker",
    "TrackerState",
    "Trajectory",
    "Weighted",
    "compile",
    "errors",
    "paths",
    "pose",
    "pose_error",
    "save",
    "scale",
]

_show_fields([globals()[name] for name in __all__])
