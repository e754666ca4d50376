"""Fields of text that follow a pose, until somebody types into them, and say what was typed once that is confirmed."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import viser

from maira_qp.apps.viewer.panel.controls import UNTOUCHED
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
        self._typed: float | None = None

        @handle.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._typed = time.monotonic()

    @property
    def text(self) -> str | None:
        """What was typed; None: nothing."""
        return None if self._typed is None else self.handle.value

    def show(self, text: str) -> None:
        """Put a text into it."""
        if self._typed is None and text != self.handle.value:
            self.handle.value = text

    def forget(self, age: float = 0.0) -> None:
        """What was typed such a time [s] ago is used, or out of date."""
        if self._typed is not None and time.monotonic() - self._typed >= age:
            self._typed = None


class Typed(NamedTuple):
    """What was typed of a pose."""

    position: np.ndarray | None
    """(3,) [m]"""
    rotation: np.ndarray | None
    """(3, 3)"""

    def of(self, T: pin.SE3) -> np.ndarray:
        """The pose (4, 4) with what was typed; the rest stays exactly as it is."""
        changed = T.homogeneous.copy()
        if self.position is not None:
            changed[:3, 3] = self.position
        if self.rotation is not None:
            changed[:3, :3] = self.rotation
        return changed


class PoseFields:
    """Position [mm], roll, pitch and yaw [deg], and quaternion of a pose; each may be typed."""

    def __init__(self, gui: viser.GuiApi, T: pin.SE3) -> None:
        self._position = Field(gui.add_text("x, y, z [mm]", position_text(T), hint="In the base; Enter to go there"))
        self._rpy = Field(
            gui.add_text("r, p, y [deg]", rpy_text(T), hint="Roll, pitch, yaw about the fixed axes x, y, z, as in URDF")
        )
        self._quaternion = Field(gui.add_text("w, x, y, z", quaternion_text(T), hint="Quaternion, scalar first"))
        self._shown = T.homogeneous
        self._fields = self._position, self._rpy, self._quaternion

    def show(self, T: pin.SE3) -> None:
        """The pose is this; if it is another, what was typed and not confirmed is out of date."""
        if not np.array_equal(T.homogeneous, self._shown):
            self._shown = T.homogeneous
            self.forget(UNTOUCHED)
        for field, text in zip(self._fields, (position_text, rpy_text, quaternion_text), strict=True):
            field.show(text(T))

    def typed(self) -> Typed:
        """What was typed, a quaternion before roll, pitch and yaw; it counts as used. Raises `OptionError`."""
        position, rpy, quaternion = (field.text for field in self._fields)
        rotation = None if rpy is None else rotation_of_rpy(rpy)
        rotation = rotation if quaternion is None else rotation_of_quaternion(quaternion)
        found = Typed(None if position is None else position_of(position), rotation)
        self.forget()
        return found

    def forget(self, age: float = 0.0) -> None:
        """Nothing was typed, or nothing longer ago than this [s]."""
        for field in self._fields:
            field.forget(age)
