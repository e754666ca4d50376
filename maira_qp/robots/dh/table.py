"""A serial chain from its Denavit-Hartenberg table: plain NumPy kinematics, independent of Pinocchio.

Standard (distal) convention: link i is `A_i = Rz(theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i)` (Denavit and Hartenberg, 1955;
Siciliano et al., "Robotics", 2009, section 2.8). Modified (proximal) convention: `A_i = Rx(alpha_i) Tx(a_i) Rz(theta_i)
Tz(d_i)`, where row i holds what Craig calls alpha_{i-1}, a_{i-1}, d_i and theta_i ("Introduction to Robotics", 1989,
section 3.4). In both a revolute joint adds q to theta, a prismatic joint adds q to d. This is the second opinion that
the Pinocchio model is tested against, and all that the baselines use.
"""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from maira_qp.arrays import is_listing, is_number, real_array
from maira_qp.errors import ConfigurationError, RobotError, listed, shown
from maira_qp.orientation import orientation_error
from maira_qp.regular_files import read_text
from maira_qp.robots.dh.plain_yaml import plain_yaml
from maira_qp.robots.unit_hints import degrees_hint_of_angles

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports]

log = logging.getLogger(__name__)

JointKind = Literal["revolute", "prismatic", "continuous", "fixed"]
KINDS: tuple[str, ...] = ("revolute", "prismatic", "continuous", "fixed")
Convention = Literal["standard", "modified"]
CONVENTIONS: tuple[str, ...] = ("standard", "modified")
LARGEST = 1e9
"""Largest length [m] and angle [rad] of a table: beyond it a double has no micrometre left."""
LARGEST_LIMIT = 1e16
"""Largest limit [rad, or m]: beyond it a double steps by more than a radian."""
MAX_BYTES = 2**20
"""Largest file of a table that is read [bytes]."""


@dataclass(frozen=True, kw_only=True)
class DHLink:
    """One row of a DH table: a joint and a link. Lengths in m, angles in rad.

    In the standard convention a and alpha are those of the link behind the joint, in the modified one of the link
    before it.
    """

    kind: JointKind = "revolute"
    """What moves: theta (revolute, or continuous: without limits), d (prismatic), or nothing (fixed)."""
    a: float = 0.0
    """Length along the x axis [m]: the new one, in the modified convention the one before."""
    alpha: float = 0.0
    """Twist about the x axis [rad]: the new one, in the modified convention the one before."""
    d: float = 0.0
    """Offset along the joint axis z [m]; for a prismatic joint the offset at q = 0."""
    theta: float = 0.0
    """Angle about the joint axis z [rad]; for a revolute joint the angle at q = 0."""
    lower: float | None = None
    """Lower limit [rad, or m if prismatic]; None: -pi if revolute, must be given if prismatic."""
    upper: float | None = None
    """Upper limit [rad, or m if prismatic]; None: pi if revolute, must be given if prismatic."""
    velocity: float = math.pi
    """Largest speed [rad/s, or m/s]; > 0."""
    effort: float = 100.0
    """Largest torque or force [N m, or N]; > 0."""
    acceleration: float | None = None
    """Largest acceleration [rad/s^2, or m/s^2]; > 0; None: no limit."""
    name: str | None = None
    """Joint name; None: `joint<k>`, counted from 1."""

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise RobotError(f"unknown joint kind {shown(self.kind)}; {listed(KINDS, shown(self.kind))}")
        for key in ("a", "alpha", "d", "theta"):
            value = getattr(self, key)
            if not is_number(value) or not math.isfinite(value):
                raise RobotError(f"DH parameter {key} must be a finite number, got {shown(value)}")
            if abs(value) > LARGEST:
                raise RobotError(f"DH parameter {key} is beyond the largest that makes sense, {LARGEST:g}: {value:g}")
        default = {"revolute": math.pi, "continuous": math.inf, "fixed": 0.0}.get(self.kind)
        if self.kind in ("continuous", "fixed") and (self.lower is not None or self.upper is not None):
            raise RobotError(f"a {self.kind} joint has no limits; use kind='revolute' for a limited one")
        for key, sign in (("lower", -1), ("upper", 1)):
            value = getattr(self, key)
            if value is None:
                if default is None:
                    raise RobotError("a prismatic joint needs both of its limits, lower and upper [m]")
                object.__setattr__(self, key, sign * default)
            elif not is_number(value) or not abs(value) <= LARGEST_LIMIT:
                told = f"must be a finite number, at most {LARGEST_LIMIT:g}, got {shown(value)}"
                raise RobotError(f"limit {key} {told} (no limit: kind='continuous')")
        if not self.lower <= self.upper:  # type: ignore[operator]
            raise RobotError(f"joint limits are inverted: lower {self.lower} > upper {self.upper}")
        for key in ("velocity", "effort", "acceleration"):
            value = getattr(self, key)
            if key == "acceleration" and value is None:
                continue
            if not is_number(value) or not 0 < value < math.inf:
                raise RobotError(f"{key} limit must be a positive number, got {shown(value)}")
        if self.name is not None and (not isinstance(self.name, str) or not self.name.strip()):
            raise RobotError(f"a joint name must be text that is not empty, got {shown(self.name)}")


@dataclass(frozen=True)
class DHTable:
    """A serial chain of `DHLink`s with n moving joints and N links in all (fixed ones included)."""

    links: tuple[DHLink, ...]
    name: str = "arm"
    convention: Convention = "standard"
    """Whether a row turns and slides first, then goes along its link ("standard"), or the other way ("modified")."""
    joint_names: tuple[str, ...] = field(init=False)
    """Names of the n moving joints, from the base to the tool."""
    lower: np.ndarray = field(init=False, repr=False, compare=False)
    """Lower limits (n,) [rad or m], read-only."""
    upper: np.ndarray = field(init=False, repr=False, compare=False)
    """Upper limits (n,) [rad or m], read-only."""

    def __init__(
        self,
        links: Iterable[DHLink | Mapping[str, Any]],
        name: str = "arm",
        convention: Convention = "standard",
    ) -> None:
        """Links as `DHLink`s or as mappings of their fields. Raises `RobotError`."""
        if not isinstance(convention, str) or convention not in CONVENTIONS:
            raise RobotError(f"unknown DH convention {shown(convention)}; {listed(CONVENTIONS, convention)}")
        if not is_listing(links):
            raise RobotError(f"a DH table is made from a list of links, got {shown(links)}")
        made = tuple(link if isinstance(link, DHLink) else _link(link, i) for i, link in enumerate(links, start=1))
        moving = [link for link in made if link.kind != "fixed"]
        if not moving:
            raise RobotError("the DH table has no moving joint")
        if not isinstance(name, str) or not name.strip():
            raise RobotError(f"a robot's name must be text that is not empty, got {shown(name)}")
        names = tuple(link.name or f"joint{k}" for k, link in enumerate(moving, start=1))
        if len(set(names)) < len(names):
            raise RobotError(f"joint names must differ, got {', '.join(names)}")
        lower = np.array([link.lower for link in moving], dtype=float)
        upper = np.array([link.upper for link in moving], dtype=float)
        lower.flags.writeable = upper.flags.writeable = False
        hint = degrees_hint_of_angles([angle for link in made for angle in (link.alpha, link.theta)], "the DH table")
        if hint:
            log.warning("%s: %s", name, hint)
        known = {"links": made, "name": name, "convention": convention, "joint_names": names}
        for key, value in {**known, "lower": lower, "upper": upper}.items():
            object.__setattr__(self, key, value)

    def __reduce__(self) -> tuple[type[DHTable], tuple[tuple[DHLink, ...], str, Convention]]:
        return DHTable, (self.links, self.name, self.convention)

    @staticmethod
    def from_file(path: str | Path) -> DHTable:
        """Read a table from the file `path`, TOML or YAML: `name`, `convention`, and a list `links` of mappings of
        `DHLink`'s fields.

        Numbers in YAML are those of version 1.2, so that 1e-3 is one. Raises `RobotError` if the file is not such a
        table, or cannot be read.
        """
        if not isinstance(path, (str, os.PathLike)):
            raise RobotError(f"a DH file is named by its path, got {shown(path)}")
        path = Path(path)
        parse = {".toml": tomllib.loads, ".yaml": plain_yaml, ".yml": plain_yaml}.get(path.suffix.lower())
        if parse is None:
            raise RobotError(f"{path.name:.100}: a DH file ends in .toml, .yaml or .yml")
        text = read_text(path, "the DH table", RobotError, MAX_BYTES)
        try:
            content = parse(text)
        except (yaml.YAMLError, ValueError, RecursionError) as reason:
            raise RobotError(f"{path.name} cannot be parsed: {reason!s:.500}") from None
        if not isinstance(content, dict) or not isinstance(content.get("links"), list):
            raise RobotError(f"{path.name}: needs a list `links`, one entry a link")
        unknown = set(content) - {"name", "convention", "links"}
        if unknown:
            raise RobotError(
                f"{path.name}: unknown entries {', '.join(sorted(map(shown, unknown)))}; valid: name, convention, links"
            )
        return DHTable(content["links"], content.get("name", path.stem), content.get("convention", "standard"))

    @property
    def n(self) -> int:
        """Number of moving joints."""
        return len(self.joint_names)

    @cached_property
    def _columns(self) -> dict[str, np.ndarray]:
        """The table as arrays over links, and where q enters."""
        moving = np.array([i for i, link in enumerate(self.links) if link.kind != "fixed"])
        prismatic = np.array([self.links[i].kind == "prismatic" for i in moving])
        columns = {key: np.array([getattr(link, key) for link in self.links]) for key in ("a", "alpha", "d", "theta")}
        return columns | {"moving": moving, "prismatic": prismatic}

    @cached_property
    def axis_frames(self) -> np.ndarray:
        """For each moving joint (n,) which transform of `compute_htms` has its axis as its z axis."""
        return self._columns["moving"] + (self.convention == "modified")

    def link_transforms(self, q: np.ndarray) -> np.ndarray:
        """Each link's own transform A_i (N, 4, 4) at the configuration q (n,)."""
        q = real_array(q, (self.n,), "q", ConfigurationError)
        c = self._columns
        theta, d = c["theta"].copy(), c["d"].copy()
        theta[c["moving"]] += np.where(c["prismatic"], 0.0, q)
        d[c["moving"]] += np.where(c["prismatic"], q, 0.0)
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(c["alpha"]), np.sin(c["alpha"])
        A = np.zeros((len(self.links), 4, 4))
        A[:, 3, 3] = 1.0
        if self.convention == "modified":
            A[:, 0, 0], A[:, 0, 1], A[:, 0, 3] = ct, -st, c["a"]
            A[:, 1, 0], A[:, 1, 1], A[:, 1, 2], A[:, 1, 3] = st * ca, ct * ca, -sa, -sa * d
            A[:, 2, 0], A[:, 2, 1], A[:, 2, 2], A[:, 2, 3] = st * sa, ct * sa, ca, ca * d
            return A
        A[:, 0, 0], A[:, 0, 1], A[:, 0, 2], A[:, 0, 3] = ct, -st * ca, st * sa, c["a"] * ct
        A[:, 1, 0], A[:, 1, 1], A[:, 1, 2], A[:, 1, 3] = st, ct * ca, -ct * sa, c["a"] * st
        A[:, 2, 1], A[:, 2, 2], A[:, 2, 3] = sa, ca, d
        return A

    def compute_htms(self, q: np.ndarray) -> np.ndarray:
        """Transforms (N + 1, 4, 4) at `q` (n,) from the base to the end of each link; the first is the identity."""
        htms = np.empty((len(self.links) + 1, 4, 4))
        htms[0] = np.eye(4)
        for i, A in enumerate(self.link_transforms(q)):
            htms[i + 1] = htms[i] @ A
        return htms

    def forward(self, q: np.ndarray) -> np.ndarray:
        """Tool pose T_base_tool (4, 4) at q (n,)."""
        return self.compute_htms(q)[-1]

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Geometric Jacobian (6, n) at `q` in base axes: linear rows [m/rad or m/m] over angular rows [rad/rad or 0].

        Column i is [z x (p - p_i); z] for a revolute joint and [z; 0] for a prismatic one (Siciliano, section 3.1.3).
        """
        return self.jacobian_of(self.compute_htms(q))

    def jacobian_of(self, htms: np.ndarray) -> np.ndarray:
        """The Jacobian (6, n) of `jacobian`, from the transforms `htms` (N + 1, 4, 4) of `compute_htms`."""
        z = htms[self.axis_frames, :3, 2]
        arm = htms[-1, :3, 3] - htms[self.axis_frames, :3, 3]
        prismatic = self._columns["prismatic"][:, None]
        linear = np.where(prismatic, z, np.cross(z, arm))
        angular = np.where(prismatic, 0.0, z)
        return np.hstack([linear, angular]).T

    def finite_difference_jacobian(self, q: np.ndarray, step: float = 1e-6) -> np.ndarray:
        """The same Jacobian (6, n) at `q` by central differences of `forward`; error about step^2 + 1e-16/step."""
        q = real_array(q, (self.n,), "q", ConfigurationError)
        if not (is_number(step) and 0 < step < 1):
            raise ConfigurationError(f"the finite-difference step must be between 0 and 1, got {shown(step)}")
        J = np.empty((6, self.n))
        for i, dq in enumerate(step * np.eye(self.n)):
            back, ahead = self.forward(q - dq), self.forward(q + dq)
            J[:3, i] = ahead[:3, 3] - back[:3, 3]
            J[3:, i] = orientation_error(back[:3, :3], ahead[:3, :3])
        return J / (2 * step)


def _link(row: Any, number: int) -> DHLink:
    """A `DHLink` from a mapping, its errors naming the row (counted from 1)."""
    if not isinstance(row, Mapping):
        raise RobotError(f"link {number} must be a DHLink or a mapping of its fields, got {shown(row)}")
    valid = [f.name for f in fields(DHLink)]
    for key in row:
        if key not in valid:
            raise RobotError(f"link {number} has an unknown field {shown(key)}; {listed(valid, shown(key))}")
    try:
        return DHLink(**row)
    except RobotError as reason:
        raise reason.at(f"link {number}") from None
