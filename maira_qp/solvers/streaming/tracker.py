"""A tracker: targets come one at a time, and the arm follows, brakes or stands, within its limits whatever comes.

In each tick the newest target is checked and compared with the last one. What is followed goes through the clutch to
`Solver.step`, which keeps the limits; for anything else the arm brakes as hard as its limits allow, and stands. The
configuration and velocity that the next tick starts from are those that were commanded, never measured ones: these lag
behind, and a loop that is closed over them is slow or swings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.arrays import is_number, real_array
from maira_qp.display import Card, Shown, joint_entries
from maira_qp.errors import ConfigurationError, MairaError, OptionError, shown
from maira_qp.problem.limits.joint import Tick
from maira_qp.results.command import Command, command_of
from maira_qp.results.status import TrackerState
from maira_qp.robots.model.joint_values import joint_array
from maira_qp.solvers.solver import Solver
from maira_qp.solvers.streaming.clutch import Clutch
from maira_qp.wording import fixed

if TYPE_CHECKING:
    from maira_qp.solvers.streaming.hands import Hands

NO_CLUTCH = "the tracker has no clutch: mq.Tracker(solver, q, clutch=mq.Clutch())"


class Tracker(Shown):
    """Follows a stream of targets, a tick at a time. It has a state, and so belongs to one thread; it can be pickled.

    A target is a pose of the tool, or, with a `Clutch`, of the hand whose motion the tool repeats. It is not followed
    while its state is HOLDING; then the arm brakes and stands:

    - after `hold`, until `resume`; with a clutch, before `engage` and after `release`;
    - where it is no pose, or farther from the last one that was followed (at the beginning: from the tool) than
      `max_jump`, until one comes that is near to that, or `resume`;
    - if none comes for longer than `timeout`, or a tick lasts longer; with none in a shorter time the last one holds;
    - while the robot is farther behind its commands than `max_following_error`;
    - while the obstacles of a call cannot be taken.

    Every command keeps the limits of position, speed and acceleration as `Solver.step` does, whatever comes. The speed
    of the tool is limited by the solver: `mq.Solver(robot, limits=[mq.ToolSpeedLimit(linear=0.1)])`.

    ```python
    import maira_qp as mq

    robot = mq.Robot.maira()
    tracker = mq.Tracker(mq.Solver(robot), robot.middle)
    target = robot.forward(robot.middle)
    target.translation[2] -= 0.01
    command = tracker.update(target, dt=0.01)
    print(command.q, command.velocity, command.state, command.reason)
    ```
    """

    def __init__(
        self,
        solver: Solver,
        q: Any,
        *,
        velocity: Any = None,
        acceleration: Any = None,
        clutch: Clutch | None = None,
        max_jump: Any = (0.1, 0.5),
        timeout: float = 0.5,
        max_following_error: float = 0.2,
        tolerance: Any = (5e-3, 5e-2),
    ) -> None:
        """A tracker with the arm at rest at q (n,).

        Args:
            solver: the tasks, limits and redundancy of each tick.
            q: where the arm is (n,) [rad or m], or {joint name: value}.
            velocity, acceleration: limits of the joints [rad/s or m/s, rad/s^2 or m/s^2] as for `Robot.limited`; None:
                the solver's. Without a limit on its acceleration a joint stops at once.
            clutch: the tool moves relative to where it is, as the hand does; None: targets are poses of the tool.
            max_jump: (2,) how far a target may be from the last one [m; rad]; > 0, inf: anywhere.
            timeout: how long no target may come [s]; > 0.
            max_following_error: how far a joint may be from its last command [rad or m]; > 0. See `update`.
            tolerance: (2,) how near to the target the tool counts as there [m; rad]; > 0.

        Raises `OptionError`, `ConfigurationError`.
        """
        if not isinstance(solver, Solver):
            raise OptionError(f"solver must be something like mq.Solver(robot), got {shown(solver)}")
        if not isinstance(clutch, (Clutch, type(None))):
            raise OptionError(f"clutch must be something like mq.Clutch(scale=0.5), got {shown(clutch)}")
        if velocity is not None or acceleration is not None:
            solver = solver.limited(velocity=velocity, acceleration=acceleration)
        from maira_qp.solvers.streaming.hands import HandMap  # heavy: Numba comes with it

        self._solver, self._clutch = solver, clutch
        self._map = HandMap.of(solver.problem, clutch, _positive(max_jump, (2,), "max_jump"))
        self._keys = self._map.keys
        if clutch is not None and not self._keys:
            raise OptionError("a clutch moves targets, and the solver's tasks take none from the call")
        self._timeout = float(_positive(timeout, (), "timeout"))
        self._max_following_error = float(_positive(max_following_error, (), "max_following_error"))
        position, orientation = _positive(tolerance, (2,), "tolerance").tolist()
        self._tolerance = position, orientation
        self.reset(q)
        self._compile()

    def reset(self, q: Any, velocity: Any = None) -> None:
        """Start anew from q (n,) [rad or m] at a velocity (n,) [rad/s or m/s], None: at rest; the clutch is released.

        Obstacles are again where the solver has them.

        Raises `ConfigurationError`.
        """
        from maira_qp.solvers.streaming.limiting import Limiting  # heavy: Numba comes with it

        joints = self._solver.robot.joint_names
        self._q = joint_array(q, joints, "q")
        self._velocity = np.zeros(len(joints)) if velocity is None else joint_array(velocity, joints, "velocity")
        self._hold = ""
        self._is_engaged = self._clutch is None
        self._silence = 0.0
        self._values: dict[str, Any] = {}
        self._obstacles: dict[str, Any] | None = None
        self._engines = self._solver.engines
        self._limiting = Limiting.of(self._solver.problem)
        self._hands = self._map.at_tools(self._q) if self._clutch is None else self._map.anywhere()

    def _compile(self) -> None:
        """Run what a tick runs, so that kernels are compiled, or loaded, before the first one."""
        T = self._map.tools(self._q)
        if self._keys:
            self._map.moved(self._map.anywhere(), self._by_key(T), T)
        problem = self._solver.problem
        target = problem.followers(problem.robot.at(self._q)) or None
        step = self._solver.step(self._q, target, 1e-3, velocity=self._velocity)
        self._limiting.reason(self._q, self._velocity, step, 1e-3, self._tolerance)

    @property
    def solver(self) -> Solver:
        """What computes the ticks, with the limits of the tracker."""
        return self._solver

    @property
    def q(self) -> np.ndarray:
        """The configuration (n,) [rad or m] that was commanded last."""
        return self._q.copy()

    @property
    def velocity(self) -> np.ndarray:
        """The velocity (n,) [rad/s or m/s] that was commanded last."""
        return self._velocity.copy()

    @property
    def is_engaged(self) -> bool:
        """The tool moves with the hand; always without a clutch."""
        return self._is_engaged

    @property
    def is_held(self) -> bool:
        """`hold` was called, and `resume` was not."""
        return bool(self._hold)

    def _card(self) -> Card:
        clutch = "" if self._clutch is None else "engaged" if self._is_engaged else "released"
        return Card(
            title=f"Tracker of {self._solver.robot.title}",
            facts=(("clutch", clutch), ("held", self._hold)),
            entries=joint_entries(self._solver.robot.joint_names, [fixed(value, 4) for value in self._q]),
            headings=("joint", "q"),
            rows=[(name, fixed(q, 4)) for name, q in zip(self._solver.robot.joint_names, self._q, strict=True)],
        )

    def engage(self) -> None:
        """Engage the clutch: from the next target on the tool moves as the hand does, from where it is.

        Where the clutch is engaged this does nothing, so it can be called in every tick. Raises `OptionError` without a
        clutch.
        """
        if self._clutch is None:
            raise OptionError(NO_CLUTCH)
        if not self._is_engaged:
            self._is_engaged = True
            self._hands = self._map.anywhere()

    def release(self) -> None:
        """Release the clutch: the hand moves freely, the arm brakes and stands. Raises `OptionError` without one."""
        if self._clutch is None:
            raise OptionError(NO_CLUTCH)
        self._is_engaged = False

    def hold(self, reason: str = "hold() was called") -> None:
        """Brake and stand until `resume`, for a reason that the commands give. Raises `OptionError`."""
        if not isinstance(reason, str) or not reason.strip():
            raise OptionError(f"the reason of a hold must be text that is not empty, got {shown(reason)}")
        self._hold = reason

    def resume(self) -> None:
        """End a hold, and take the next target wherever it is, as after a jump: without a clutch the arm goes there.

        With a clutch the tool moves from where it is, as after `engage`; a clutch that is released remains so.
        """
        self._hold = ""
        self._hands = self._map.anywhere()

    def update(
        self, target: Any, dt: float, *, measured: Any = None, obstacles: Mapping[str, Any] | None = None
    ) -> Command:
        """Compute the command of a tick of dt [s]. Whatever the arguments are, it is a command and not an exception.

        Args:
            target: the newest pose, `pin.SE3` or (4, 4) [m], with several frames {frame: pose}; None: none came. In a
                mapping whatever else `Solver.step` takes by name, such as a posture or the point that a `LookAtTask` is
                to look at: it holds until another comes.
            dt: length of the tick [s]; it may vary. If it is no length of time, the arm keeps its last command.
            measured: where the robot is (n,) [rad or m]: while a joint is farther than `max_following_error` from its
                last command the tracker holds, so that it does not run away from a robot that is blocked or slow.
            obstacles: where obstacles stand now, {name: pose} as for `Solver.step`; they stay there until they are
                given again. The arm stands while they cannot be taken.
        """
        if not (is_number(dt) and 0 < dt < math.inf):
            return self._holding(f"the length of a tick must be a positive number of seconds, got {shown(dt)}")
        dt, values = float(dt), self._values
        if wrong := self._move_obstacles(obstacles):
            return self._brake(wrong, dt)
        try:
            target, given = self._map.sorted_out(target)
        except MairaError as error:
            return self._brake(str(error), dt)
        values = {**values, **given} if given else values
        self._silence = self._silence + dt if target is None else 0.0
        reason = self._hold or self._reason_to_wait(dt) or self._lag(measured)
        if reason:
            return self._brake(reason, dt)
        hands: Hands | str = self._hands
        if target is not None:
            if not self._keys:
                return self._brake(f"no task takes its target from the call, got {shown(target)}", dt)
            is_new = self._clutch is not None and hands.goals is None
            hands = self._map.moved(hands, target, self._stop() if is_new else None)
            if isinstance(hands, str):
                return self._brake(hands, dt)
        try:
            return self._follow(hands, values, dt)
        except MairaError as error:  # beyond the numbers, such as a target farther away than a thousand million arms
            return self._brake(str(error), dt)

    def _move_obstacles(self, poses: Any) -> str:
        """Obstacles stand elsewhere from now on; why they cannot, if so."""
        if poses is None:
            return ""
        try:
            moved = {**(self._obstacles or {}), **poses} if isinstance(poses, Mapping) else poses
            engines = self._solver.engines.with_obstacles(moved)
        except MairaError as error:
            return str(error)
        self._obstacles, self._engines = moved, engines
        self._limiting = replace(self._limiting, problem=engines.problem)
        return ""

    def _reason_to_wait(self, dt: float) -> str:
        """Why no target can be followed in this tick, whatever it is; empty: one can."""
        if not self._is_engaged:
            return "the clutch is released"
        if not self._keys:
            return ""
        if self._silence > self._timeout:
            return f"no target for {self._silence:.3g} s (timeout: {self._timeout:g} s)"
        if self._silence and self._hands.goals is None:
            return "no target yet"
        return f"the tick took {dt:.3g} s (timeout: {self._timeout:g} s)" if dt > self._timeout else ""

    def _lag(self, measured: Any) -> str:
        """Why a measured configuration is too far from the last command; empty: it is not, or was not measured."""
        if measured is None:
            return ""
        try:
            error = joint_array(measured, self._solver.robot.joint_names, "measured") - self._q
        except ConfigurationError as wrong:
            return str(wrong)
        i = int(np.abs(error).argmax())
        if abs(error[i]) <= self._max_following_error:
            return ""
        name, unit = self._solver.robot.joint_names[i], "m" if self._solver.robot.slides[i] else "rad"
        most = f"max_following_error: {self._max_following_error:g} {unit}"
        return f"{name} is {abs(error[i]):.3g} {unit} away from its command ({most})"

    def _stop(self) -> np.ndarray:
        """Where the tools (K, 4, 4) are once the arm has stopped."""
        robot = self._solver.robot
        way = self._velocity * np.abs(self._velocity) / (2 * robot.acceleration_limit)
        return self._map.tools(robot.clip(robot.kinematics.integrate(self._q, way)))

    def _follow(self, hands: Hands, values: dict[str, Any], dt: float) -> Command:
        """A step toward targets, and with other data of the solver's tasks."""
        target = None if hands.goals is None else self._by_key(hands.goals)
        q, velocity, asked = self._q, self._velocity, target
        if values or self._map.problem.aims:
            poses = () if hands.goals is None else zip(self._keys, hands.goals, strict=True)
            asked = {**dict(poses), **values}
        step = self._solver.step(q, asked, dt, velocity=velocity, obstacles=self._obstacles)
        self._hands, self._values = hands, values
        self._q, self._velocity = step.q, step.velocity
        state, reason, tolerance = TrackerState.FOLLOWING, "", self._tolerance
        if not (step.position_error <= tolerance[0] and step.orientation_error <= tolerance[1]):
            reason = self._limiting.reason(q, velocity, step, dt, tolerance)
            state = TrackerState.LIMITED if reason else TrackerState.FOLLOWING
        return self._command(state, reason, step.position_error, step.orientation_error, target)

    def _by_key(self, T: np.ndarray) -> np.ndarray | dict[str, np.ndarray]:
        """Poses (K, 4, 4) as `Solver.step` takes them."""
        return T[0] if len(T) == 1 else dict(zip(self._keys, T, strict=True))

    def _brake(self, reason: str, dt: float) -> Command:
        """A tick without a target."""
        robot = self._solver.robot
        if self._velocity.any() or not ((robot.lower <= self._q) & (self._q <= robot.upper)).all():
            self._q, self._velocity = self._engines.brake(self._q, Tick(dt, self._velocity))
        return self._holding(reason)

    def _holding(self, reason: str) -> Command:
        return self._command(TrackerState.HOLDING, reason, math.nan, math.nan, None)

    def _command(self, state: TrackerState, reason: str, position: float, orientation: float, target: Any) -> Command:
        return command_of(
            q=self._q.copy(),
            velocity=self._velocity.copy(),
            state=state,
            reason=reason,
            position_error=position,
            orientation_error=orientation,
            target=target,
            _origin=self._engines,
        )


def _positive(value: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    """Positive numbers of a shape, infinities among them. Raises `OptionError`."""
    array = real_array(value, shape, name, OptionError, finite=False)
    if not (array > 0).all():
        raise OptionError(f"{name} must be positive, got {shown(value)}")
    return array
