"""The tab "Robot": which one, and its tip."""

from __future__ import annotations

from typing import NamedTuple

import viser

from maira_qp.apps.arguments.robot_choice import CATALOG
from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask
from maira_qp.robots.model.robot import Robot


class Loaded(NamedTuple):
    """Where the robot that is shown comes from."""

    name: str
    """Of the catalog, or of a file"""
    tips: tuple[str, ...]
    """Links that may be its tip, the present one first"""
    notes: list[str]
    """What of it could not be drawn"""


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
