"""The tab "Joints": a slider for each, and all of them to be copied."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from maira_qp.apps.arguments.output import Units
from maira_qp.apps.viewer.panel.controls import Ask, Slider
from maira_qp.apps.viewer.panel.copying import copied_lines
from maira_qp.apps.viewer.quantities import listing
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View

EXACT = 9
"""Decimals of radians and metres that are copied."""
WHOLE_TURN = 360.0
"""Range of the slider of a joint without limits, to either side [deg]."""


class JointsTab:
    """A slider for each joint, in degrees, or in millimetres where it slides, and the configuration to be copied."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        robot, units = session.robot, Units(session.robot, degrees=True, millimetres=True)
        self._scale = units.scale
        self._sliders: list[Slider] = []
        for i, name in enumerate(robot.joint_names):
            step = 0.1
            lower, upper = robot.lower[i] * self._scale[i], robot.upper[i] * self._scale[i]
            if np.isfinite(upper - lower):  # rounded outwards: the session keeps the limits
                lower, upper = step * np.floor(lower / step + 1e-6), step * np.ceil(upper / step - 1e-6)
            else:
                lower, upper = -WHOLE_TURN, WHOLE_TURN
            lower, upper = round(float(lower), 4), round(float(upper), 4)
            value = min(max(float(session.q[i] * self._scale[i]), lower), upper)
            handle = gui.add_slider(f"{name} [{units.joints[i]}]", lower, upper, step, value)
            self._sliders.append(Slider(handle, self._setter(ask, i)))
        self._units = " and ".join(dict.fromkeys(units.joints))
        self._copied = gui.add_html("")

    def _setter(self, ask: Ask, index: int) -> Callable[[float], None]:
        def moved(value: float) -> None:
            ask.session(f"joint {index}", lambda session: session.set_joint(index, value / self._scale[index]))

        return moved

    def show(self, view: View) -> None:
        """The joints are there."""
        for slider, value in zip(self._sliders, view.q * self._scale, strict=True):
            slider.show(float(value))
        self._copied.content = copied_lines(self.lines(view.q))

    def lines(self, q: np.ndarray) -> list[tuple[str, str]]:
        """A configuration (n,) as it is copied: name and text."""
        numbers = listing(q, EXACT)
        return [
            (f"q [{self._units}]", listing(q * self._scale)),
            ("q as a Python list [rad, m]", f"[{numbers}]"),
            ("q as a line of CSV [rad, m]", numbers.replace(" ", "")),
        ]
