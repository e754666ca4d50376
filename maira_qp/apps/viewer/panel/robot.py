"""The tab "Robot": which one, and its tip."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask
from maira_qp.robots.model.robot import Robot

OTHER = "of a file"
"""Of a robot that is none of those by name."""


class Loaded(NamedTuple):
    """Where the robot that is shown comes from."""

    name: str
    """Of the catalog, or of a file"""
    tips: Mapping[str, str | None]
    """What may be its tip, the present one first: as it is named, and the link; None: those that it has by its name"""
    notes: list[str]
    """What of it could not be drawn"""


def tips_text(robot: Robot) -> str:
    """Its tips, as they are named."""
    return ", ".join(robot.tips)


class RobotTab:
    """Which robot: the one that is loaded, one by its name, a URDF file, a DH table."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, loaded: Loaded, ask: Ask) -> None:
        gui.add_html(readout.robot(robot, loaded.name))
        names = Robot.available()
        now = loaded.name if loaded.name in names else OTHER
        which = gui.add_dropdown(
            "Robot", names if now != OTHER else (OTHER, *names), initial_value=now, hint="Those that are installed"
        )
        tips = gui.add_dropdown(
            "Tip", tuple(loaded.tips), initial_value=tips_text(robot), hint="The link that goes to the target"
        )
        with gui.add_folder("From a file", expand_by_default=now == OTHER):
            path = gui.add_text("File", "", hint="URDF, xacro, MJCF or DH table (.toml, .yaml) where the viewer runs")
            tip = gui.add_text("Tip of it", "", hint="Empty: its end; of several the one behind most joints")
            load = gui.add_button("Load the file")
            upload = gui.add_upload_button(
                "Upload a file", mime_type=".urdf,.xml,.toml,.yaml,.yml", icon=viser.Icon.UPLOAD
            )
        gui.add_html(readout.notes(loaded.notes))

        @which.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None and which.value not in (now, OTHER):
                ask.robot(which.value, None, event.client)

        @tips.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None and tips.value != tips_text(robot):
                ask.tip(loaded.tips[tips.value], event.client)

        @load.on_click
        def _(event: viser.GuiEvent) -> None:
            ask.robot(path.value.strip(), tip.value.strip() or None, event.client)

        @upload.on_upload
        def _(event: viser.GuiEvent) -> None:
            ask.uploaded_robot(upload.value.name, upload.value.content, tip.value.strip() or None, event.client)
