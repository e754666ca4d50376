"""Fields of text that follow a pose, until somebody types into them, and say what was typed once that is confirmed."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import viser

from maira_qp.apps.viewer.quantities import (
    position_of,
    position_text,
    quaternion_text,
    rotation_of_quaternion,
    rotation_of_rpy,
    rpy_text,
)


class Field:
    """A field of text that shows what it is given, unless it was typed into since the last `forget`."""

    def __init__(self, handle: viser.GuiTextHandle) -> None:
        self.handle = handle
        self.is_typed = False

        @handle.on_update
        async def _(event: viser.GuiEvent) -> None:
            self.is_typed = self.is_typed or event.client is not None

    @property
    def text(self) -> str:
        """What is in it."""
        return self.handle.value

    def show(self, text: str) -> None:
        """Put a text into it."""
        if not self.is_typed and text != self.handle.value:
            self.handle.value = text

    def forget(self) -> None:
        """What was typed is used, or out of date."""
        self.is_typed = False


class PoseFields:
    """Position [mm], roll, pitch and yaw [deg], and quaternion of a pose; each may be typed."""

    def __init__(self, gui: viser.GuiApi, T: pin.SE3) -> None:
        self._position = Field(gui.add_text("x, y, z [mm]", position_text(T), hint="In the base; Enter to go there"))
        self._rpy = Field(
            gui.add_text("r, p, y [deg]", rpy_text(T), hint="Roll, pitch, yaw about the fixed axes x, y, z, as in URDF")
        )
        self._quaternion = Field(gui.add_text("w, x, y, z", quaternion_text(T), hint="Quaternion, scalar first"))
        self._last = T
        self._fields = self._position, self._rpy, self._quaternion

    def show(self, T: pin.SE3) -> None:
        """The pose is this; if it is another, what was typed and not confirmed is out of date."""
        if np.abs(T.homogeneous - self._last.homogeneous).max() > 0:
            self._last = T
            self.forget()
        for field, text in zip(self._fields, (position_text, rpy_text, quaternion_text), strict=True):
            field.show(text(T))

    def typed(self) -> np.ndarray:
        """The pose (4, 4) that was typed: what was not typed stays exactly as it is. Raises `OptionError`."""
        T = self._last.homogeneous.copy()
        if self._position.is_typed:
            T[:3, 3] = position_of(self._position.text)
        if self._quaternion.is_typed:
            T[:3, :3] = rotation_of_quaternion(self._quaternion.text)
        elif self._rpy.is_typed:
            T[:3, :3] = rotation_of_rpy(self._rpy.text)
        self.forget()
        return T

    def forget(self) -> None:
        """Nothing was typed."""
        for field in self._fields:
            field.forget()
