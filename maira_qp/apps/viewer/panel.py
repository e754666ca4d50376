"""The controls beside the scene, in tabs. They ask for things; what is shown is what came of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import viser

from maira_qp.apps.arguments.output import Units
from maira_qp.apps.arguments.robot_choice import CATALOG
from maira_qp.apps.viewer import readout
from maira_qp.apps.viewer.controls import Ask, Slider, add_saving
from maira_qp.apps.viewer.paths.tab import PathTab
from maira_qp.apps.viewer.session import Method, Session
from maira_qp.apps.viewer.view import View
from maira_qp.robots.collision.shapes import Box, Shape, Sphere
from maira_qp.robots.model.robot import Robot

METHODS: dict[str, Method] = {
    "Strict hierarchy": "strict",
    "Weighted trade-off": "weighted",
    "Pose alone": "none",
}
KEYS_OF_SLIDERS = """
<img hidden alt="" src="data:," onerror="
  if (!window.keysOfSliders) {
    window.keysOfSliders = true;
    document.body.addEventListener('keydown', event => {
      if (event.key.startsWith('Arrow') && event.target.closest('[role=slider], [role=tab]')) event.stopPropagation();
    });
  }
">
"""
"""Arrow keys that move a slider do not turn the camera too, which listens at the document. A page of viser takes no
scripts of its server in another way."""
WHOLE_TURN = 360.0
"""Range of the slider of a joint without limits, to either side [deg]."""


class Loaded(NamedTuple):
    """Where the robot that is shown comes from."""

    name: str
    """Of the catalog, or of a file"""
    tips: tuple[str, ...]
    """Links that may be its tip, the present one first"""
    notes: list[str]
    """What of it could not be drawn"""


class Panel:
    """All controls, for one session."""

    def __init__(self, gui: viser.GuiApi, session: Session, loaded: Loaded, ask: Ask) -> None:
        gui.add_html(KEYS_OF_SLIDERS)
        self._readout = gui.add_html("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Reach"):
            self._reach = ReachTab(gui, session, ask)
        with tabs.add_tab("Joints"):
            self._joints = JointsTab(gui, session, ask)
        with tabs.add_tab("Obstacles"):
            self._obstacles = ObstaclesTab(gui, session, ask)
        with tabs.add_tab("Path"):
            self._path = PathTab(gui, session, ask)
            with gui.add_folder("Recorded motion", expand_by_default=False):
                self._motion = MotionControls(gui, ask)
        with tabs.add_tab("Robot"):
            self._robot = RobotTab(gui, session.robot, loaded, ask)

    def show(self, session: Session, view: View) -> None:
        """What there is to see."""
        self._readout.content = readout.readout(view)
        self._reach.show(session, view)
        self._joints.show(view)
        self._obstacles.show(view)
        self._path.show(view)
        self._motion.show(session)


class ReachTab:
    """How the redundancy is used, the elbow, all solutions."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        names = tuple(METHODS)
        chosen = names[list(METHODS.values()).index(session.method)]
        method = gui.add_dropdown(
            "Redundancy", names, initial_value=chosen, hint="What the arm does with the freedom the pose leaves"
        )
        self._method = method
        self._weight = gui.add_slider(
            "log10 weight", -6.0, 0.0, 0.1, float(np.log10(session.weight)), hint="Of the posture against the pose"
        )
        swivel = gui.add_slider("Swivel [deg]", -180.0, 360.0, 0.5, 0.0, hint="Moves the elbow; the tool stands still")
        self._swivel = Slider(
            swivel,
            lambda degrees: ask.session("swivel", lambda session: session.set_swivel(float(np.radians(degrees)))),
        )
        self._ends = gui.add_html("")
        ghosts = gui.add_checkbox("Show all solutions", session.shows_ghosts)
        self._next = gui.add_button("Go to the next solution", visible=False)
        self._solutions = gui.add_html("")
        self._count = 0

        def use(_: viser.GuiEvent) -> None:
            chosen, weight = METHODS[method.value], 10.0**self._weight.value
            ask.session("method", lambda session: session.use(chosen, weight))

        method.on_update(use)
        self._weight.on_update(use)

        @ghosts.on_update
        def _(_: viser.GuiEvent) -> None:
            wanted = ghosts.value
            ask.session("ghosts", lambda session: session.show_ghosts(wanted))

        @self._next.on_click
        def _(_: viser.GuiEvent) -> None:
            self._count += 1
            index = self._count
            ask.session("ghost", lambda session: session.go_to_ghost(index))

    def show(self, session: Session, view: View) -> None:
        """The elbow and the solutions."""
        self._weight.visible = session.method == "weighted"
        elbow = view.elbow
        self._swivel.handle.visible = self._ends.visible = session.has_swivel
        self._swivel.handle.disabled = elbow is None
        if elbow is not None:
            self._swivel.handle.min = round(float(np.degrees(elbow.curve.lower)), 1)
            self._swivel.handle.max = round(float(np.degrees(elbow.curve.upper)), 1)
            self._swivel.show(float(np.degrees(elbow.psi)))
        self._ends.content = readout.ends(session.robot, elbow)
        self._solutions.content = readout.solutions(session, view)
        self._next.visible = view.ghosts is not None and len(view.ghosts.q) > 1


class JointsTab:
    """A slider for each joint, in degrees, or in metres where it slides."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        robot, units = session.robot, Units(session.robot, degrees=True)
        self._scale = units.scale
        self._sliders: list[Slider] = []
        for i, name in enumerate(robot.joint_names):
            step = 0.1 if units.joints[i] == "deg" else 0.001
            lower, upper = robot.lower[i] * self._scale[i], robot.upper[i] * self._scale[i]
            if np.isfinite(upper - lower):  # rounded outwards: the session keeps the limits
                lower, upper = step * np.floor(lower / step + 1e-6), step * np.ceil(upper / step - 1e-6)
            else:
                lower, upper = -WHOLE_TURN, WHOLE_TURN
            lower, upper = round(float(lower), 4), round(float(upper), 4)
            value = min(max(float(session.q[i] * self._scale[i]), lower), upper)
            handle = gui.add_slider(f"{name} [{units.joints[i]}]", lower, upper, step, value)
            self._sliders.append(Slider(handle, self._setter(ask, i)))

    def _setter(self, ask: Ask, index: int) -> Callable[[float], None]:
        def moved(value: float) -> None:
            ask.session(f"joint {index}", lambda session: session.set_joint(index, value / self._scale[index]))

        return moved

    def show(self, view: View) -> None:
        """The joints are there."""
        for slider, value in zip(self._sliders, view.q * self._scale, strict=True):
            slider.show(float(value))


class ObstaclesTab:
    """Balls and boxes that are put into the way."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        length = session.robot.length
        self._count = 0
        ball, box = gui.add_button("Add a ball"), gui.add_button("Add a box")
        remove = gui.add_button("Remove all", color="gray")
        avoid = gui.add_checkbox("Keep clear of them", session.is_avoiding)
        self._distances = gui.add_html("")

        def add(kind: Callable[[pin.SE3, str], Shape], name: str) -> None:
            self._count += 1
            angle = 2.4 * self._count  # golden: no two in the same place
            place = pin.SE3(np.eye(3), 0.45 * length * np.array([np.cos(angle), np.sin(angle), 0.9]))
            shape = kind(place, f"{name} {self._count}")
            ask.session(f"add {self._count}", lambda session: session.put_obstacle(shape))

        @ball.on_click
        def _(_: viser.GuiEvent) -> None:
            add(lambda place, name: Sphere(0.06 * length, place, name=name), "ball")

        @box.on_click
        def _(_: viser.GuiEvent) -> None:
            add(lambda place, name: Box(np.full(3, 0.12 * length), place, name=name), "box")

        @remove.on_click
        def _(_: viser.GuiEvent) -> None:
            ask.session("remove", lambda session: session.remove_obstacles())

        @avoid.on_update
        def _(_: viser.GuiEvent) -> None:
            wanted = avoid.value
            ask.session("avoid", lambda session: session.avoid(wanted))

    def show(self, view: View) -> None:
        """How far away they are."""
        self._distances.content = readout.distances(view)


class MotionControls:
    """A motion is recorded, played, saved where the viewer runs, or downloaded."""

    def __init__(self, gui: viser.GuiApi, ask: Ask) -> None:
        self._record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD)
        play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        stop = gui.add_button("Stop the arm", color="gray", icon=viser.Icon.PLAYER_STOP)
        add_saving(gui, "motion.csv", lambda: self._recording, ask)
        self._state = gui.add_html("")
        self._is_recording = False

        @self._record.on_click
        def _(_: viser.GuiEvent) -> None:
            wanted = not self._is_recording
            ask.session("record", lambda session: session.record(wanted))

        @play.on_click
        def _(_: viser.GuiEvent) -> None:
            ask.session("play", lambda session: session.play())

        @stop.on_click
        def _(_: viser.GuiEvent) -> None:
            ask.session("stop", lambda session: session.stop())

    def show(self, session: Session) -> None:
        """How long the recording is."""
        self._recording, self._is_recording = session.recording, session.is_recording
        self._record.label = "End the recording" if session.is_recording else "Record"
        self._state.content = readout.recording(session.recording)


class RobotTab:
    """Which robot: the one that is loaded, one of the catalog, a URDF file, a DH table."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, loaded: Loaded, ask: Ask) -> None:
        gui.add_html(readout.robot(robot, loaded.name))
        tips = gui.add_dropdown("Tip", loaded.tips, initial_value=robot.tip, hint="The link that goes to the target")
        catalog = gui.add_dropdown("Catalog", CATALOG)
        show = gui.add_button("Show it")
        path = gui.add_text("File", "", hint="A URDF (.urdf, .xml) or a DH table (.toml, .yaml) where the viewer runs")
        tip = gui.add_text("Tip of it", "", hint="Empty: its end; of several the one behind most joints")
        load = gui.add_button("Load the file")
        upload = gui.add_upload_button("Upload a file", mime_type=".urdf,.xml,.toml,.yaml,.yml", icon=viser.Icon.UPLOAD)
        gui.add_html(readout.notes(loaded.notes))

        @tips.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None and tips.value != robot.tip:
                ask.tip(tips.value, event.client)

        @show.on_click
        def _(event: viser.GuiEvent) -> None:
            ask.robot(catalog.value, None, event.client)

        @load.on_click
        def _(event: viser.GuiEvent) -> None:
            ask.robot(path.value.strip(), tip.value.strip() or None, event.client)

        @upload.on_upload
        def _(event: viser.GuiEvent) -> None:
            ask.uploaded_robot(upload.value.name, upload.value.content, tip.value.strip() or None, event.client)
