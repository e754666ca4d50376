"""The controls beside the scene, in tabs. They ask for things; what is shown is what came of it."""

from __future__ import annotations

import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask
from maira_qp.apps.viewer.panel.joints import JointsTab
from maira_qp.apps.viewer.panel.obstacles import ObstaclesTab
from maira_qp.apps.viewer.panel.reach import ReachTab
from maira_qp.apps.viewer.panel.recorded import MotionControls
from maira_qp.apps.viewer.panel.robot import Loaded, RobotTab
from maira_qp.apps.viewer.paths.tab import PathTab
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View

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
