"""An independent truth about any part of a robot: Pinocchio's own model of its whole URDF, in which all joints move."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

MOVING = ("revolute", "continuous", "prismatic")


class WholeModel:
    """All joints of a URDF text, with mimic joints as joints of their own that are set to what they mimic."""

    def __init__(self, text: str) -> None:
        self.model = pin.buildModelFromXML(text)
        self.data = self.model.createData()
        elements = [e for e in ElementTree.fromstring(text.encode()).iter("joint") if e.find("parent") is not None]
        self.joints = {e.get("name"): e for e in elements if e.get("type") in MOVING}

    def followed(self, name: str) -> tuple[str, float, float]:
        """The leader, multiplier and offset of a joint; of one that mimics none itself, 1 and 0."""
        mimic = self.joints[name].find("mimic")
        if mimic is None or mimic.get("joint") not in self.joints:
            return name, 1.0, 0.0
        leader, multiplier, offset = self.followed(mimic.get("joint"))
        m, o = float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
        return leader, m * multiplier, m * offset + o

    def rest(self, name: str) -> float:
        """Zero, or the limit nearest to it."""
        limit = self.joints[name].find("limit")
        if limit is None or self.joints[name].get("type") == "continuous":
            return 0.0
        return float(np.clip(0, float(limit.get("lower", 0)), float(limit.get("upper", 0))))

    def look(self, values: dict[str, float], base: str, frame: str) -> tuple[np.ndarray, np.ndarray]:
        """Pose (4, 4) of a frame in the base and Jacobian (6, n) in its axes for the joints that have values.

        The base must not move with them. Joints without a value rest.
        """
        q = pin.neutral(self.model)
        columns = []
        for name in self.joints:
            leader, multiplier, offset = self.followed(name)
            joint = self.model.joints[self.model.getJointId(name)]
            value = multiplier * values.get(leader, self.rest(leader)) + offset
            q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
            columns.append((leader, multiplier, joint.idx_v))
        ends = [self.model.getFrameId(link, pin.FrameType.BODY) for link in (base, frame)]
        full = pin.computeFrameJacobian(self.model, self.data, q, ends[1], pin.LOCAL_WORLD_ALIGNED)
        pin.framesForwardKinematics(self.model, self.data, q)
        start, end = (self.data.oMf[each] for each in ends)
        J = np.zeros((6, len(values)))
        for leader, multiplier, k in columns:
            if leader in values:
                J[:, list(values).index(leader)] += multiplier * full.reshape(6, -1)[:, k]
        turned = np.vstack([start.rotation.T @ J[:3], start.rotation.T @ J[3:]])
        return (start.inverse() * end).homogeneous, turned
