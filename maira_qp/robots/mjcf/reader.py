"""MJCF made into a `Chain`, by way of URDF."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from maira_qp.errors import RobotError
from maira_qp.robots.mjcf.compiled import compiled, package
from maira_qp.robots.mjcf.converter import Names, urdf_of
from maira_qp.robots.mjcf.couplings import couplings_of, is_single, joints_above
from maira_qp.robots.model.joint_limits import Limits, given_limits
from maira_qp.robots.srdf.semantics import Semantics
from maira_qp.robots.urdf.joint import MOVING
from maira_qp.robots.urdf.reader import Chain, read_urdf

log = logging.getLogger(__name__)


def read_mjcf(
    source: str | os.PathLike[str],
    tip: str | Sequence[str] | None = None,
    base: str | None = None,
    limits: Limits | None = None,
) -> tuple[Chain, Semantics]:
    """The `Chain` from `base` to `tip`, bodies or sites, of an MJCF file or of text, and what else the model says.

    The base None is the body on a free joint, if the tips hang on one, else the world. Keyframes are named
    configurations; pairs of bodies that MuJoCo does not let collide are links that may touch. Raises what `read_urdf`
    raises, and `RobotError` if MuJoCo is missing or refuses the model.
    """
    made = compiled(source)
    model, names = made.model, Names(made.model)
    single = {names.joints[joint]: joint for joint in range(model.njnt) if is_single(model, joint)}
    given = {single[name]: pair for name, pair in given_limits(limits, single).items()}
    couplings = couplings_of(model, names.joints, given)
    start = _floating_base(model, names, tip) if base is None else base
    chain = read_urdf(urdf_of(made, names, couplings), tip=tip, base=start)
    joints = ElementTree.fromstring(chain.urdf).iterfind("joint")
    moving = {single[name] for each in joints if each.get("type") in MOVING and (name := each.attrib["name"]) in single}
    for what, joints in couplings.curved.items():
        if joints & moving:
            remedy = 'make it linear, or inactive (active="false") where it does not matter'
            raise RobotError(f"{chain.name}: {what}, and determines {_listed(joints & moving, names)}; {remedy}")
    for what, joints in couplings.notes.items():
        if joints & moving:
            log.warning("%s: %s (%s)", chain.name, what, _listed(joints & moving, names))
    return chain, Semantics(states=_keyframes(model, names), touching=_touching(model, names))


def _listed(joints: set[int], names: Names) -> str:
    """The names of joints, the first of many."""
    told = [names.joints[joint] for joint in sorted(joints)]
    return ", ".join(told[:8]) + (f" and {len(told) - 8} more" if len(told) > 8 else "")


def _floating_base(model: Any, names: Names, tip: Any) -> str | None:
    """The body on the last free joint above all tips, without tips above all joints of one number; None: the world."""
    bodies = {name: body for body, name in enumerate(names.bodies)}
    bodies |= {name: int(model.site_bodyid[site]) for site, name in names.sites.items()}
    tips = [tip] if isinstance(tip, str) else tip
    if tips is None:
        ends = [int(model.jnt_bodyid[joint]) for joint in range(model.njnt) if is_single(model, joint)]
    else:
        ends = [bodies[name] for name in tips if isinstance(name, str) and name in bodies]
    above = [{joint for joint in joints_above(model, end) if _is_free(model, joint)} for end in ends]
    shared = set.intersection(*above) if above else set()
    return names.bodies[model.jnt_bodyid[max(shared)]] if shared else None


def _is_free(model: Any, joint: int) -> bool:
    return int(model.jnt_type[joint]) == package().mjtJoint.mjJNT_FREE


def _keyframes(model: Any, names: Names) -> dict[str, dict[str, float]]:
    """Joint values by the name of each keyframe."""
    single = [joint for joint in range(model.njnt) if is_single(model, joint)]
    return {
        (model.key(k).name or f"key{k}").replace("/", "_"): {
            names.joints[joint]: float(model.key_qpos[k, model.jnt_qposadr[joint]]) for joint in single
        }
        for k in range(model.nkey)
    }


def _touching(model: Any, names: Names) -> frozenset[frozenset[str]]:
    """Pairs of bodies between which MuJoCo makes no contacts.

    They are excluded, one carries the other directly, or no two of their geoms fit by `contype` and `conaffinity`.
    """
    pairs = {divmod(int(signature), 1 << 16) for signature in model.exclude_signature}
    types, affinities = np.array(model.geom_contype), np.array(model.geom_conaffinity)
    solid = np.flatnonzero(types | affinities)
    masks = {
        body: {(int(types[g]), int(affinities[g])) for g in solid if model.geom_bodyid[g] == body}
        for body in np.unique(model.geom_bodyid[solid]).tolist()
    }
    for first in masks:
        for second in (body for body in masks if body > first):
            fit = any(t & b or s & a for t, a in masks[first] for s, b in masks[second])
            if not fit or _carries(model, first, second) or _carries(model, second, first):
                pairs.add((first, second))
    return frozenset(frozenset((names.bodies[first], names.bodies[second])) for first, second in pairs)


def _carries(model: Any, first: int, second: int) -> bool:
    """Whether a body that is not fixed to the world carries another with nothing between them that moves."""
    carrier, carried = model.body_weldid[first], model.body_weldid[second]
    return bool(carrier and carrier == model.body_weldid[model.body_parentid[carried]])
