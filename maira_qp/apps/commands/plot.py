"""`maira-qp plot`: pictures of one solve, of a trade-off, of a self-motion, of the reach, and of a path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import tyro

from maira_qp.apps.arguments.flags import PoseFlags, RedundancyFlags, RobotFlags, SolverFlags, checked_seed
from maira_qp.apps.arguments.numbers import JointValues, Quaternion, Rpy
from maira_qp.apps.arguments.optional import Flag, Maybe, command, explained
from maira_qp.apps.arguments.pose_choice import PoseChoice
from maira_qp.apps.arguments.redundancy_choice import RedundancyChoice
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.errors import OptionError, PoseError
from maira_qp.problem.options import Options

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from maira_qp.apps.arguments.output import Units
    from maira_qp.robots.model.robot import Robot

FINEST = 2400
"""Dots per inch at most: a picture of some 20,000 x 10,000."""
AT_REST = 1e-5
"""A path ends where no joint is faster than this [rad/s or m/s]."""


@explained
@dataclass(frozen=True, kw_only=True)
class Picture(ABC):
    """What every picture is asked with."""

    name: ClassVar[str]
    """On the command line, and of its file"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    options: SolverFlags = field(default_factory=Options)
    output: Maybe[Path] = None
    """File of the picture, .png, .svg or .pdf; none: a .png in the folder output."""
    dpi: float = 150.0
    """Dots per inch of a .png; > 0, at most 2400."""
    deg: Flag = False
    """Angles in degrees."""
    mm: Flag = False
    """Lengths in millimetres."""

    def run(self) -> int:
        """Draws and says where; 0."""
        from maira_qp.apps.arguments.output import Units, check_picture, console

        path = self.output or Path("output") / f"{self.name}.png"
        check_picture(path)
        if not 0 < self.dpi <= FINEST:
            raise OptionError(f"--dpi must be a positive number, at most {FINEST}, got {self.dpi}")
        robot = self.choice.load_with_one_tip(degrees=self.deg, millimetres=self.mm)
        from maira_qp.apps import plots  # not before it is known to be installed

        with plots.style():
            drawn = self.draw(robot, Units(robot, self.deg, self.mm))
        plots.save(drawn, path, dpi=self.dpi)
        console().print(f"picture: {path}", soft_wrap=True)
        return 0

    @abstractmethod
    def draw(self, robot: Robot, units: Units) -> Figure:
        """The picture."""


@explained
@dataclass(frozen=True, kw_only=True)
class Convergence(Picture):
    """Pose error against the iteration of one solve, by the reference engine."""

    name = "convergence"

    pose: PoseFlags = field(default_factory=PoseChoice)
    redundancy: RedundancyFlags = field(default_factory=RedundancyChoice)
    q0: JointValues = None
    """Joint values to start from [rad, or deg with --deg; m for a sliding joint]; none: the solver's own."""
    seed: int = 0
    """Seed of the random starts; >= 0."""

    def draw(self, robot: Robot, units: Units) -> Figure:
        """One solve, observed."""
        from maira_qp.apps import plots
        from maira_qp.solvers.solver import Solver

        seed, target = checked_seed(self.seed), self.pose.load(units)
        solver = Solver(robot, redundancy=self.redundancy.load(), options=self.options)
        visited: list[np.ndarray] = []
        q0 = None if self.q0 is None else units.read(self.q0, "--q0")
        solution = solver.solve(target, q0=q0, rng=seed, observe=visited.append)
        made = plots.figure(size=(7.0, 3.6))
        plots.convergence(made.axes[0], solver, target, np.array(visited))
        made.axes[0].set_title(f"{robot.name}: {solution.status.name}")
        return made


@explained
@dataclass(frozen=True, kw_only=True)
class TradeOff(Picture):
    """Pose error against posture cost: weighted by many weights, and strict."""

    name = "trade-off"

    pose: PoseFlags = field(default_factory=PoseChoice)
    weights: tuple[float, ...] = tuple(10.0**exponent for exponent in range(-8, 1))
    """What the posture counts beside the squared pose error; > 0."""
    seed: int = 0
    """Seed of the random starts; >= 0."""

    def draw(self, robot: Robot, units: Units) -> Figure:
        """The strict answer, and from there weighted ones, each from the one before."""
        from maira_qp.apps import plots
        from maira_qp.problem.objectives import Posture
        from maira_qp.problem.redundancy import Strict, Weighted
        from maira_qp.solvers.solver import Solver

        seed, target, weights = checked_seed(self.seed), self.pose.load(units), sorted(self.weights)
        if not weights:
            raise OptionError("--weights needs at least one weight")
        wishes = [Strict(Posture()), *(Weighted(Posture(), weight) for weight in weights)]
        answers = []
        for wish in wishes:
            q0 = answers[-1].q if answers else None
            answers.append(Solver(robot, redundancy=wish, options=self.options).solve(target, q0=q0, rng=seed))
        residuals = [float(np.hypot(s.position_error, s.orientation_error)) for s in answers]
        costs = [0.5 * float(np.sum((s.q - robot.middle) ** 2)) for s in answers]
        made = plots.figure(size=(7.0, 3.8))
        plots.trade_off(made.axes[0], weights, residuals[1:], costs[1:], strict=(residuals[0], costs[0]))
        made.axes[0].set_title(f"{robot.name}: what a better posture costs")
        return made


@explained
@dataclass(frozen=True, kw_only=True)
class SelfMotion(Picture):
    """All configurations of an S-R-S arm for one pose, over the swivel angle.

    What the joint limits leave of them is marked. Above: the joints of the branch that holds the best of all; below:
    the arcs of every branch."""

    name = "self-motion"

    pose: PoseFlags = field(default_factory=PoseChoice)

    def draw(self, robot: Robot, units: Units) -> Figure:
        """The joints of the best branch, above the arcs of all."""
        from maira_qp.analytic.srs.geometry import SRS
        from maira_qp.apps import plots
        from maira_qp.solvers.solver import Solver

        target = self.pose.load(units)
        refusal = SRS.refusal(robot)
        if refusal is not None:
            raise OptionError(f"self-motion pictures are for S-R-S arms: {refusal}")
        solutions = Solver(robot, options=self.options).solutions(target)
        if not solutions:
            raise PoseError("no configuration within the limits reaches this pose: there is no self-motion to draw")
        made = plots.figure(2, 1, size=(8.0, 6.2), heights=(2.0, 1.0))
        above, below = made.axes
        plots.self_motion(above, target, solutions[0])
        above.set_title(f"{robot.name}: the self-motion of the branch with the best posture")
        plots.arc_bars(below, solutions)
        below.set_title("what the limits leave of every branch")
        return made


@explained
@dataclass(frozen=True, kw_only=True)
class Reach(Picture):
    """Where the tool can be at one orientation, on a plane; or a map of the reach."""

    name = "reach"

    map: Maybe[Path] = None
    """Folder of a map of maira-qp reach, whose plane is drawn without a solve; none: no map."""
    quantity: str = "reachable"
    """What of the map is drawn: reachable, unreachable or undecided, a share of the orientations; directions_open, how
    many; manipulability or limit_distance, the largest that was found."""
    surface: Maybe[float] = None
    """In place of the plane the surface on which the quantity of the map has this value; needs maira-qp[surface]."""
    quaternion: Quaternion = None
    """Orientation of the tool as a unit quaternion, scalar first; without any: that of the base."""
    rpy: Rpy = None
    """Orientation as roll, pitch, yaw about fixed axes [rad, or deg with --deg]."""
    plane: Literal["xy", "xz", "yz"] = "xz"
    """The plane of positions, in the base."""
    at: float = 0.0
    """Where the plane is along the third axis [m, or mm with --mm]."""
    cells: int = 80
    """Cells along each side; >= 2."""
    seed: int = 0
    """Seed of the random starts; >= 0."""
    threads: Maybe[int] = None
    """Threads that solve; >= 1; none: one per processor. No answer depends on it."""

    def _of_map(self, folder: Path, units: Units) -> Figure:
        """The cells of a plane, or a surface. Raises `JobError`, `OptionError`."""
        from maira_qp.apps import plots
        from maira_qp.scale.reach.reach_map import ReachMap

        if self.choice != RobotChoice():
            raise OptionError("--map has its robot: leave out --robot, --tip, --base and --limits")
        reach = ReachMap.open(folder)
        if self.surface is not None:
            try:
                surface = reach.surface(self.quantity, self.surface)
            except OptionError as reason:
                raise reason.at("--surface") from None
            made = plots.figure(space=True, size=(6.4, 5.6))
            plots.map_surface(made.axes[0], *surface)
            quantity = self.quantity.replace("_", " ")
            made.axes[0].set_title(f"{reach.robot.name}: {quantity} = {self.surface:g}, cells of {reach.job.cell:g} m")
            return made
        cut = reach.slice(self.plane, self.at / units.metre, self.quantity)
        made = plots.figure(size=(6.4, 4.8))
        plots.map_slice(made.axes[0], cut.x, cut.y, cut.values, axes=self.plane, label=self.quantity)
        third = ({*"xyz"} - {*self.plane}).pop()
        made.axes[0].set_title(f"{reach.robot.name}: cells of {reach.job.cell:g} m, {third} = {cut.at:.4g} m")
        return made

    def draw(self, robot: Robot, units: Units) -> Figure:
        """A batch of poses, a cell each; or cells of a map."""
        if self.map is not None:
            return self._of_map(self.map, units)
        if self.surface is not None:
            raise OptionError("--surface is of a map: give --map")
        from maira_qp.apps import plots
        from maira_qp.apps.arguments.output import progress_bar
        from maira_qp.evaluation.reach_slice import reach_slice
        from maira_qp.problem.pose import pose
        from maira_qp.solvers.solver import Solver

        seed, rpy = checked_seed(self.seed), None if self.rpy is None else np.array(self.rpy) / units.radian
        rotation = pose((0.0, 0.0, 0.0), quaternion=self.quaternion, rpy=rpy).rotation
        solver = Solver(robot, options=self.options)
        with progress_bar("solving") as progress:
            found = reach_slice(
                solver,
                rotation,
                plane=self.plane,
                at=self.at / units.metre,
                cells=self.cells,
                progress=progress,
                seed=seed,
                threads=self.threads,
            )
        made = plots.figure(size=(7.4, 4.8))
        plots.reach_slice(made.axes[0], found.x, found.y, found.status, axes=self.plane)
        third = ({*"xyz"} - {*self.plane}).pop()
        made.axes[0].set_title(f"{robot.name}: where the tool can be, {third} = {self.at:g} {units.length}")
        return made


@explained
@dataclass(frozen=True, kw_only=True)
class JointPaths(Picture):
    """Joints over time, in their limits, while control ticks lead to a pose."""

    name = "path"

    pose: PoseFlags = field(default_factory=PoseChoice)
    redundancy: RedundancyFlags = field(default_factory=RedundancyChoice)
    q0: JointValues = None
    """Joint values to start from [rad, or deg with --deg; m for a sliding joint]; none: mid-range."""
    dt: float = 0.01
    """A tick [s]; > 0."""
    seconds: float = 10.0
    """How long at most [s]; > 0. The path ends earlier where the arm comes to rest."""

    def draw(self, robot: Robot, units: Units) -> Figure:
        """Ticks until the arm is at rest."""
        from maira_qp.apps import plots
        from maira_qp.solvers.solver import Solver

        if not 0 < self.dt <= self.seconds < np.inf:
            raise OptionError(f"--dt and --seconds must be positive, --dt the smaller; got {self.dt}, {self.seconds}")
        target = self.pose.load(units)
        solver = Solver(robot, redundancy=self.redundancy.load(), options=self.options)
        path = [robot.middle if self.q0 is None else robot.clip(units.read(self.q0, "--q0"))]
        velocity = np.zeros(robot.n)
        for _ in range(round(self.seconds / self.dt)):
            tick = solver.step(path[-1], target, self.dt, velocity=velocity)
            path.append(tick.q)
            velocity = tick.velocity
            if np.abs(velocity).max() < AT_REST:
                break
        made = plots.figure(size=(7.4, 3.8))
        plots.joint_paths(made.axes[0], robot, path, times=self.dt * np.arange(len(path)))
        made.axes[0].set_title(f"{robot.name}: control ticks of {1e3 * self.dt:g} ms")
        return made


Pictures = (
    command(Convergence, Convergence.name)
    | command(TradeOff, TradeOff.name)
    | command(SelfMotion, SelfMotion.name)
    | command(Reach, Reach.name)
    | command(JointPaths, JointPaths.name)
)


@explained
@dataclass(frozen=True, kw_only=True)
class Plot:
    """Draw a picture: convergence, trade-off, self-motion, reach or path.

    Example:

        maira-qp plot reach --quaternion 0 1 0 0 --output reach.pdf"""

    picture: tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[Pictures]]  # type: ignore[valid-type]
    """Which picture."""

    def run(self) -> int:
        """Draws the picture; 0."""
        return self.picture.run()
