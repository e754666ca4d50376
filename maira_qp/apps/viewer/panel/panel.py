"""The controls beside the scene, in tabs. They ask for things; what is shown is what came of it."""

from __future__ import annotations

import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask
from maira_qp.apps.viewer.panel.joints import JointsTab
from maira_qp.apps.viewer.panel.keyboard import Keyboard
from maira_qp.apps.viewer.panel.obstacles import ObstaclesTab
from maira_qp.apps.viewer.panel.recorded import MotionControls
from maira_qp.apps.viewer.panel.robot import Loaded, RobotTab
from maira_qp.apps.viewer.panel.solutions import SolutionsTab
from maira_qp.apps.viewer.panel.target import TargetTab
from maira_qp.apps.viewer.paths.tab import PathTab
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View

WIDTH = 380.0
"""[pixels]"""
ON_PHONES = """
<style>
  @media (max-width: 767px) {
    .mantine-Paper-root:has(.maira-qp-panel) { left: 0 !important; width: 100% !important; }
    .mantine-Paper-root:has(.maira-qp-panel) .mantine-ScrollArea-viewport { max-height: 48vh !important; }
    .mantine-Paper-root:has(.maira-qp-panel) div:has(.maira-qp-panel) { width: 100% !important; }
  }
</style>
<div class="maira-qp-panel" hidden></div>
"""
"""On a narrow page the panel is a sheet at the bottom: as wide as the page, and no higher than its lower half."""


class Panel:
    """All controls, for one session."""

    def __init__(self, gui: viser.GuiApi, session: Session, loaded: Loaded, ask: Ask) -> None:
        gui.set_panel_label(f"{session.robot.name} ({', '.join(session.robot.tips)})")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self._keyboard = Keyboard(gui, ask)
        gui.add_html(ON_PHONES)
        self._readout = gui.add_html("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Target"):
            self._target = TargetTab(gui, session, ask)
        with tabs.add_tab("Joints"):
            self._joints = JointsTab(gui, session, ask)
        with tabs.add_tab("Solutions"):
            self._solutions = SolutionsTab(gui, session, ask)
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
        self._target.show(view)
        self._joints.show(view)
        self._solutions.show(session, view)
        self._obstacles.show(session, view)
        self._path.show(view)
        self._motion.show(session)
