"""The tab "Target": a pose is typed, read and copied; home, undo, and the axes of the gizmo."""

from __future__ import annotations

import pinocchio as pin
import viser

from maira_qp.apps.viewer.panel.controls import Ask, Control, when_pressed
from maira_qp.apps.viewer.panel.copying import copied_lines
from maira_qp.apps.viewer.panel.fields import PoseFields
from maira_qp.apps.viewer.quantities import listing, position_text, rpy_text
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View
from maira_qp.orientation import quaternion_from_matrix

HOME, UNDO, REDO = "Home", "Undo", "Redo"
TOOL_AXES, BASE_AXES = "Axes of the tool", "Axes of the base"


class TargetTab:
    """Where the tool is to be, and where it is."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        tips = session.robot.tips
        tip = gui.add_dropdown("Tip", tips, initial_value=session.selected, visible=len(tips) > 1)
        self._tip = Control(tip, lambda tip: ask.each(lambda session: session.select(tip)))
        with gui.add_form(None) as form:
            self._fields = PoseFields(gui, session.target)
            go = gui.add_button("Go there", icon=viser.Icon.TARGET_ARROW)
        self._steps = gui.add_button_group("Arm", (HOME, UNDO, REDO))
        stop = gui.add_button(
            "Put the target to the tool", color="gray", hint="The arm stops where it is, and the target with it"
        )
        axes = gui.add_dropdown(
            "Arrows along", (TOOL_AXES, BASE_AXES), hint="The axes that the target is dragged along, and moved by keys"
        )
        self._axes = Control(axes, lambda axes: ask.each(lambda session: session.use_axes(axes == BASE_AXES)))
        self._tool = gui.add_html("")

        go.on_click(lambda _: form.submit())

        @form.on_submit
        def _(event: viser.GuiEvent) -> None:
            with ask.failures(event.client):
                typed = self._fields.typed()
                ask.each(lambda session: session.move_target(typed.of(session.target)))

        steps = {HOME: Session.go_home, UNDO: Session.undo, REDO: Session.redo}
        when_pressed(self._steps, lambda step: ask.each(steps[step]))

        @stop.on_click
        def _(_: viser.GuiEvent) -> None:
            ask.session("stop", Session.stop)

    def show(self, view: View) -> None:
        """The target, and where the tool is."""
        self._tip.show(view.selected)
        self._axes.show(BASE_AXES if view.has_base_axes else TOOL_AXES)
        self._fields.show(view.target)
        self._tool.content = copied_lines(lines_of(view.tool))


def lines_of(tool: pin.SE3) -> list[tuple[str, str]]:
    """A pose as it is copied: name and text."""
    T, R = tool.translation, quaternion_from_matrix(tool.rotation)
    return [
        ("Tool is at x, y, z [mm]; roll, pitch, yaw [deg]", f"{position_text(tool)}; {rpy_text(tool)}"),
        ("in Python", f"mq.pose([{listing(T, 6)}], quaternion=[{listing(R, 8)}])"),
    ]
