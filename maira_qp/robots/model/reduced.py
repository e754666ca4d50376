"""The part of a Pinocchio model that a robot is: the joints between a base and its tips, each moved by one number.

All other joints are fixed where they stand at zero, or at the limit nearest to it, as Pinocchio's `buildReducedModel`
does; a continuous joint, in Pinocchio a pair (cos, sin), becomes one angle without limits. The model that is given is
left as it is.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from maira_qp.arrays import real_array
from maira_qp.errors import FrameError, RobotError, listed, shown
from maira_qp.robots.model.frame_names import known_frame, named_tips
from maira_qp.robots.model.joint_limits import ENDLESS, JointLimits, Limits, SumLimit, given_limits
from maira_qp.robots.model.joint_types import is_unbounded, one_number
from maira_qp.robots.model.kinematics import MAX_JOINTS
from maira_qp.robots.model.pinocchio_versions import (
    check_mimic,
    copy_velocity_arrays,
    mimic_couplings,
    mimic_joint,
    model_from_pickle,
    model_to_pickle,
)

Couplings = Mapping[str, tuple[str, float, float]]
"""Followers by name, each with its leader, multiplier and offset: q = multiplier * q_leader + offset."""

UNIVERSE = "universe"
"""Pinocchio's name of the frame that does not move."""
_FRAMES = (pin.FrameType.BODY, pin.FrameType.OP_FRAME, pin.FrameType.SENSOR)


class Reduced(NamedTuple):
    """What is left of a model between a base and its tips."""

    model: pin.Model
    """Followers move on their own in it; see `coupled`."""
    mimic: dict[str, tuple[str, float, float]]
    base: str
    tips: tuple[str, ...]
    resting: Mapping[str, tuple[float, float]] = {}
    """Limits [rad, or m] of the joints that could stand elsewhere, of followers their leaders alone."""
    sums: tuple[SumLimit, ...] = ()
    """Of the joints that are no followers"""

    def __reduce__(self) -> tuple[Callable[..., Reduced], tuple[object, ...]]:
        return _unpickled, (*model_to_pickle(self.model), *self[1:])

    @property
    def independent(self) -> list[int]:
        """Places in q of the joints that are no followers."""
        return independent(self.model, self.mimic)

    @property
    def limits(self) -> JointLimits:
        """Limits of the joints that are no followers; a model has none of acceleration."""
        model, places = self.model, self.independent
        positions = model.lowerPositionLimit[places], model.upperPositionLimit[places]
        names = tuple(model.names[place + 1] for place in places)
        return JointLimits(names, *positions, model.velocityLimit[places], np.full(len(places), np.inf))


def _unpickled(model: pin.Model, arrays: dict[str, np.ndarray], *rest: Any) -> Reduced:
    return Reduced(model_from_pickle(model, arrays), *rest)


def frames_of(model: pin.Model) -> dict[str, int]:
    """Indices of the frames that have a name of their own: links, and what was added as a tool or a sensor.

    Of two with one name it is the link.
    """
    named = [(_FRAMES.index(f.type), k, f.name) for k, f in enumerate(model.frames) if f.type in _FRAMES]
    found = dict[str, int]()
    for _, index, name in sorted(named):
        found.setdefault(name, index)
    return dict(sorted(found.items(), key=lambda item: item[1]))


def reduced(
    model: pin.Model,
    tip: str | Sequence[str] | None = None,
    base: str | None = None,
    limits: Limits | None = None,
    mimic: Couplings | None = None,
    rest: Mapping[str, float] | None = None,
) -> Reduced:
    """The joints from `base` (None: the universe) to `tip` (None: the only frame at the end of the joints).

    `limits` {joint name: (lower, upper)} take the place of the model's, `mimic` couples joints beside those that are
    coupled in the model, `rest` {joint name: value} places joints that do not move.

    Raises `RobotError`, `FrameError`, `OptionError` as `Robot.from_model`.
    """
    if not isinstance(model, pin.Model):
        raise RobotError(f"model must be a pinocchio.Model, got {shown(model)}; a URDF goes to Robot.from_urdf")
    model = _with_frames(model)
    frames = frames_of(model)
    base = (_link_at_origin(model) or UNIVERSE) if base is None else known_frame(base, "base", {**frames, UNIVERSE: 0})
    root = model.frames[frames.get(base, 0)]
    below = {*model.subtrees[root.parentJoint], root.parentJoint}
    ends = _ends_of(model, frames, below)
    tips = named_tips(tip, frames, ends) if tip is not None or len(ends) != 1 else (ends[0],)
    couplings = _couplings(model, mimic)
    paths = {name: _path(model, frames[name], root.parentJoint, base, name) for name in tips}
    moving = _moving(model, paths, couplings, below - {root.parentJoint})
    kinds = {j: one_number(model, j) for j in sorted(moving)}
    ranges = _ranges(model, {j: kind for j, kind in kinds.items() if j not in couplings}, limits)
    still = below - {root.parentJoint} - moving
    placed = _at_rest(model, couplings, rest or {}) if still else None
    new = _built(model, root, sorted(below), kinds, placed, {})
    pairs = [ranges.get(name, (-np.inf, np.inf)) for name in new.names[1:]]
    new.lowerPositionLimit, new.upperPositionLimit = np.transpose(pairs)
    for key in ("velocityLimit", "effortLimit"):
        setattr(new, key, _bounds(new, key))
    _check_finite(new)
    kept = {model.names[j]: (model.names[couplings[j][0]], *couplings[j][1:]) for j in kinds if j in couplings}
    resting = {model.names[j]: _range(model, j) for j in sorted(still.difference(couplings)) if _is_scalar(model, j)}
    return Reduced(new, kept, base, tips, resting)


def plain(model: pin.Model, mimic: Couplings | None, part: Reduced) -> Reduced:
    """All of a model, of which a part was made, each joint moved by a number of its own, with what is coupled in it.

    Joints of other types are fixed. So it can be pickled, which Pinocchio's mimic joints cannot.
    """
    model = _with_frames(model)
    couplings = _couplings(model, mimic)
    kinds = dict[int, pin.JointModel]()
    for j in range(1, model.njoints):
        with contextlib.suppress(RobotError):
            kinds[j] = one_number(model, j)
    new = _built(model, model.frames[0], list(range(model.njoints)), kinds, _at_rest(model, couplings, {}), {})
    own = [_range(model, j) if model.joints[j].nq else (-np.inf, np.inf) for j in kinds]
    new.lowerPositionLimit, new.upperPositionLimit = np.reshape(own, (-1, 2)).T
    left = {j: coupling for j, coupling in couplings.items() if j in kinds and coupling[0] in kinds}
    named = {model.names[j]: (model.names[leader], m, offset) for j, (leader, m, offset) in left.items()}
    return part._replace(model=new, mimic=named)


def locked(part: Reduced, values: Mapping[str, float]) -> Reduced:
    """The part with some of its joints fixed at values [rad, or m], and what follows them where that leads to.

    Raises `RobotError` if nothing moves a tip any more.
    """
    model, mimic = part.model, part.mimic
    followed = {name: coupling for name, coupling in mimic.items() if coupling[0] in values}
    placed = {**values, **{name: m * values[leader] + offset for name, (leader, m, offset) in followed.items()}}
    kinds = {j: model.joints[j] for j in range(1, model.njoints) if model.names[j] not in placed}
    for tip in part.tips:
        joint = model.frames[frames_of(model)[tip]].parentJoint
        if not set(model.supports[joint]) & set(kinds):
            raise RobotError(f"no joint is left that moves the tip {tip!r}; leave one of those before it unlocked")
    data = model.createData()
    pin.forwardKinematics(model, data, np.array([placed.get(name, 0.0) for name in model.names[1:]]))
    new = _built(model, model.frames[0], list(range(model.njoints)), kinds, data, {})
    places = [j - 1 for j in kinds]
    new.lowerPositionLimit, new.upperPositionLimit = model.lowerPositionLimit[places], model.upperPositionLimit[places]
    left = {name: coupling for name, coupling in mimic.items() if name not in placed}
    sums = tuple(each for limit in part.sums if (each := limit.placed(values)).coefficients)
    return Reduced(new, left, part.base, part.tips, sums=sums)


def coupled(model: pin.Model, mimic: Couplings) -> pin.Model:
    """The model with followers that follow: the same one where there are none. Raises `RobotError`."""
    if not mimic:
        return model
    for follower, (leader, _, _) in mimic.items():
        check_mimic(follower, leader)
    ids = {model.getJointId(name): (model.getJointId(mimic[name][0]), *mimic[name][1:]) for name in mimic}
    kinds = {j: model.joints[j] for j in range(1, model.njoints)}
    new = _built(model, model.frames[0], [0, *kinds], kinds, None, ids)
    free = independent(model, mimic)
    new.lowerPositionLimit, new.upperPositionLimit = model.lowerPositionLimit[free], model.upperPositionLimit[free]
    return new


def independent(model: pin.Model, mimic: Couplings) -> list[int]:
    """Places in q of the joints of an uncoupled model that are no followers."""
    return [j - 1 for j in range(1, model.njoints) if model.names[j] not in mimic]


# Frames


def _link_at_origin(model: pin.Model) -> str | None:
    """The first link that stands where the universe is."""
    here = (f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == 0)
    return next((f.name for f in here if f.placement == pin.SE3.Identity()), None)


def _with_frames(model: pin.Model) -> pin.Model:
    """A copy in which every joint carries a frame that can be named, a link with the joint's name if need be."""
    model = model.copy()
    carrying = {model.frames[index].parentJoint for index in frames_of(model).values()}
    for joint in range(1, model.njoints):
        if joint not in carrying:
            model.addFrame(pin.Frame(model.names[joint], joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    return model


def _ends_of(model: pin.Model, frames: Mapping[str, int], below: set[int]) -> list[str]:
    """The frames on the last joints, but those that carry another of these."""
    last = [j for j in below if j and len(model.subtrees[j]) == 1]
    on_them = {index: name for name, index in frames.items() if model.frames[index].parentJoint in last}
    carriers = set[int]()
    for index in on_them:
        while (index := model.frames[index].parentFrame) not in carriers and index:
            carriers.add(index)
    return [name for index, name in on_them.items() if index not in carriers]


# What moves


def _path(model: pin.Model, frame: int, root: int, base: str, tip: str) -> list[int]:
    """The joints between the one that carries the base and a frame. Raises `FrameError` if it does not carry it."""
    path = list(model.supports[model.frames[frame].parentJoint])
    if root not in path:
        raise FrameError(
            f"the tip {tip!r} does not hang on the base {base!r}; from_model does not turn a tree round, from_urdf does"
        )
    return path[path.index(root) + 1 :]


def _couplings(model: pin.Model, mimic: Couplings | None) -> dict[int, tuple[int, float, float]]:
    """Leader, multiplier and offset of followers, of the model and of those that are given. Raises `RobotError`."""
    couplings = {}
    for follower, leader in mimic_couplings(model):
        joint = model.joints[follower].extract()
        couplings[follower] = leader, float(joint.scaling), float(joint.offset)
    if not isinstance(mimic, (Mapping, type(None))):
        raise RobotError(f"mimic must be a mapping {{follower: (leader, multiplier, offset)}}, got {shown(mimic)}")
    known = list(model.names)[1:]
    for follower, coupling in (mimic or {}).items():
        if not isinstance(coupling, (tuple, list)) or len(coupling) != 3:
            raise RobotError(f"mimic of {shown(follower)} must be (leader, multiplier, offset), got {shown(coupling)}")
        for name in (follower, coupling[0]):
            if not isinstance(name, str) or name not in known:
                raise RobotError(f"mimic: {shown(name)} is not a joint; {listed(known, name)}")
        numbers = real_array(coupling[1:], (2,), f"multiplier and offset of {follower!r}", RobotError).tolist()
        couplings[model.getJointId(follower)] = (model.getJointId(coupling[0]), *numbers)
    for follower, (leader, _, _) in couplings.items():
        if leader in couplings or leader >= follower:
            names = model.names[follower], model.names[leader]
            raise RobotError("joint {!r} mimics {!r}, which must move on its own and come before it".format(*names))
    return couplings


def _moving(
    model: pin.Model,
    paths: Mapping[str, list[int]],
    couplings: Mapping[int, tuple[int, float, float]],
    below: set[int],
) -> set[int]:
    """The joints that move: those on the paths, and the leaders of followers among them. Raises `RobotError`."""
    still = {j for j, (_, multiplier, _) in couplings.items() if multiplier == 0}
    moving = {j for path in paths.values() for j in path} - still
    for tip, path in paths.items():
        if not moving.intersection(path):
            raise RobotError(f"no joint moves between base and tip {tip!r}")
    for follower in moving.intersection(couplings):
        leader = couplings[follower][0]
        if leader not in below:
            names = model.names[follower], model.names[leader]
            raise RobotError("joint {!r} mimics {!r}, which the base stands on".format(*names))
        moving.add(leader)
    count = len(moving.difference(couplings))
    if count > MAX_JOINTS:
        raise RobotError(f"{count} joints move between base and tip, more than the {MAX_JOINTS} that are supported")
    names = [model.names[j] for j in moving]
    if "" in names or len(set(names)) < len(names):
        raise RobotError(f"the joints that move need names that differ, got {', '.join(map(repr, sorted(names)))}")
    return moving


def _ranges(
    model: pin.Model, kinds: Mapping[int, pin.JointModel], limits: Limits | None
) -> dict[str, tuple[float, float]]:
    """Lower and upper limit of joints by name, infinite where a revolute joint has none. Raises `RobotError`."""
    given = given_limits(limits, [model.names[j] for j in kinds])
    ranges = {}
    for j, kind in kinds.items():
        name = model.names[j]
        lower, upper = given.get(name) or _range(model, j)
        python = f"give it some, limits={{{name!r}: (lower, upper)}}"
        if not lower <= upper:
            raise RobotError(f"joint {name!r} has inverted limits, or NaN: {lower:g} and {upper:g}", python=python)
        is_endless = lower == -np.inf and upper == np.inf and kind.shortname().startswith("JointModelR")
        if not (is_endless or np.isfinite(upper - lower)):
            raise RobotError(f"joint {name!r} has no lower and upper limit: {lower:g} and {upper:g}", python=python)
        ranges[name] = lower, upper
    return ranges


def _range(model: pin.Model, joint: int) -> tuple[float, float]:
    """Limits of a joint that one number moves [rad, or m], infinite beyond `ENDLESS`."""
    if is_unbounded(model.joints[joint]):
        return -np.inf, np.inf
    index = model.joints[joint].idx_q
    lower, upper = float(model.lowerPositionLimit[index]), float(model.upperPositionLimit[index])
    return -np.inf if lower < -ENDLESS else lower, np.inf if upper > ENDLESS else upper


def _bounds(model: pin.Model, key: str) -> np.ndarray:
    """Velocity or effort limits (n,): inf where one is missing or not positive. Raises `RobotError` for NaN."""
    values = np.array(getattr(model, key))
    for j in np.flatnonzero(np.isnan(values)):
        raise RobotError(f"joint {model.names[int(j) + 1]!r}: its {key} is NaN")
    return np.where((values > 0) & (values <= ENDLESS), values, np.inf)


def _is_scalar(model: pin.Model, joint: int) -> bool:
    """Whether one number says where a joint stands, be it as cosine and sine."""
    return model.joints[joint].nq == 1 or is_unbounded(model.joints[joint])


def _at_rest(
    model: pin.Model, couplings: Mapping[int, tuple[int, float, float]], rest: Mapping[str, float]
) -> pin.Data:
    """Pinocchio's data in which `liMi` places the joints that do not move: at `rest`, else at zero, or near it."""
    q = pin.neutral(model)
    scalar = [j for j in range(1, model.njoints) if model.joints[j].nq == 1]
    for j in scalar:
        lower, upper = _range(model, j)
        q[model.joints[j].idx_q] = min(max(0.0, lower), upper) if lower <= upper else 0.0
    for name, value in rest.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
    for j, (leader, multiplier, offset) in couplings.items():
        if j in scalar:  # mimic joints of Pinocchio follow by themselves
            of_leader = rest.get(model.names[leader], _value(q, model.joints[leader]))
            q[model.joints[j].idx_q] = multiplier * of_leader + offset
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return data


def _value(q: np.ndarray, joint: pin.JointModel) -> float:
    """Where a joint of one number stands, 0 for others."""
    if joint.nq == 1:
        return float(q[joint.idx_q])
    return float(np.arctan2(q[joint.idx_q + 1], q[joint.idx_q])) if is_unbounded(joint) else 0.0


# The new model


def _built(
    model: pin.Model,
    root: pin.Frame,
    joints: Sequence[int],
    kinds: Mapping[int, pin.JointModel],
    rest: pin.Data | None,
    couplings: Mapping[int, tuple[int, float, float]],
) -> pin.Model:
    """A model of some joints, the first of which carries the frame `root` that becomes the origin.

    Those in `kinds` move, the others stand as `rest` has them; `couplings` make joints follow others. Limits of
    position are left to the caller.
    """
    new = pin.Model()
    new.name, new.gravity = model.name, model.gravity
    carriers = {joints[0]: (0, root.placement.inverse())}
    for j in joints[1:]:
        parent, placement = carriers[model.parents[j]]
        if j not in kinds:
            assert rest is not None
            carriers[j] = parent, placement * rest.liMi[j]
            continue
        kind = kinds[j] if j not in couplings else _follower(kinds[j], new, carriers, couplings[j])
        index = new.addJoint(parent, kind, placement * model.jointPlacements[j], model.names[j])
        carriers[j] = index, pin.SE3.Identity()
    for j, (parent, placement) in carriers.items():
        new.appendBodyToJoint(parent, model.inertias[j], placement)
    places = [model.joints[j].idx_v for j in joints[1:] if j in kinds and j not in couplings]
    copy_velocity_arrays(model, new, places)
    indices = {0: 0}
    for index, frame in enumerate(model.frames):
        if index > 0 and frame.parentJoint in carriers:
            parent, placement = carriers[frame.parentJoint]
            is_fixed = frame.type == pin.FrameType.JOINT and frame.parentJoint not in kinds
            kind = pin.FrameType.FIXED_JOINT if is_fixed else frame.type
            above = indices.get(frame.parentFrame, 0)
            made = pin.Frame(frame.name, parent, above, placement * frame.placement, kind, frame.inertia)
            indices[index] = new.addFrame(made, False)
    return new


def _follower(
    kind: pin.JointModel,
    model: pin.Model,
    carriers: Mapping[int, tuple[int, Any]],
    coupling: tuple[int, float, float],
) -> pin.JointModel:
    """A joint that follows the leader that stands in a model already."""
    leader, multiplier, offset = coupling
    return mimic_joint(kind, model.joints[carriers[leader][0]], multiplier, offset)


def _check_finite(model: pin.Model) -> None:
    """Raises `RobotError` for a joint or frame that stands nowhere."""
    placements = [(f"joint {model.names[j]!r}", model.jointPlacements[j]) for j in range(1, model.njoints)]
    placements += [(f"frame {frame.name!r}", frame.placement) for frame in model.frames]
    for what, placement in placements:
        if not np.isfinite(placement.homogeneous).all():
            raise RobotError(f"the placement of {what} is not finite")
