"""A Pinocchio model made ready for many evaluations: frames by name, working memory by thread."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from maira_qp.errors import FrameError, listed, shown

MAX_JOINTS = 100
"""Most joints that may move: Pinocchio's working memory grows with their cube, to 1.4 GB at 300."""


class Scratch:
    """Pinocchio's working memory, and the configuration whose forward kinematics it holds."""

    __slots__ = ("data", "q")

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()
        self.q: np.ndarray | None = None


class PerThread(threading.local):
    """A `Scratch` for each thread that asks."""

    def __init__(self, model: pin.Model) -> None:
        self.scratch = Scratch(model)


class Kinematics:
    """What a `Configuration` needs of its robot: the model, its frames, and memory that no two threads share."""

    def __init__(self, model: pin.Model, frames: Mapping[str, int], tip: str, name: str) -> None:
        """`frames` are those that may be asked for, with Pinocchio's index; `tip` is one of them."""
        self.model = model
        self.nq, self.n = model.nq, model.nv
        self.has_mimic = any(joint.shortname() == "JointModelMimic" for joint in model.joints)
        self._per_thread = PerThread(model)
        self._name, self._frames = name, tuple(frames)
        self._ids: dict[str | None, int] = dict(frames)
        self._ids[None] = self._ids[tip]

    @property
    def scratch(self) -> Scratch:
        """This thread's working memory."""
        return self._per_thread.scratch

    def integrate(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """The configuration (nq,) that the displacement dq (n,) leads to from q (nq,), unchecked."""
        return q + dq

    def difference(self, q0: np.ndarray, q1: np.ndarray) -> np.ndarray:
        """The displacement (n,) that leads from q0 (nq,) to q1 (nq,), unchecked: `integrate(q0, difference)` is q1."""
        return q1 - q0

    def frame_id(self, frame: str | None) -> int:
        """Pinocchio's index of a frame (None: the tip). Raises `FrameError`."""
        try:
            return self._ids[frame]
        except (KeyError, TypeError):
            raise FrameError(f"{shown(frame)} is not a frame of {self._name}; {listed(self._frames, frame)}") from None
