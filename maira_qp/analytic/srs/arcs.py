"""The joint limits of an S-R-S arm as exact sets of the swivel angle psi: all configurations for a pose, as arcs.

For one elbow angle, shoulder and wrist are rotations R(psi) = R_0 + R_c cos psi + R_s sin psi, each made by rotations
about axes a, b, c (`analytic.srs.geometry`). A joint stands at the angle L, or half a turn away or on the other branch,
only where

    (exp(L a) b) . R c = b . c            first joint
    a . R c = k_0 + rho cos(L - phi)      middle joint
    a . R (exp(-L c) b) = a . b           last joint

each of the form alpha cos psi + beta sin psi + gamma = 0 with at most two roots. The roots for both limits of each
joint, and those where the two branches of a spherical joint meet (a . R c at its ends k_0 +- rho), cut the circle into
cells in which no joint enters or leaves its limits; one point inside decides. So that a tangency is not lost to
rounding, an equation without roots gives the point where it comes nearest: a cut too many is harmless.

Angles are known up to whole turns. A joint whose range is a turn or more is looked at from its lower limit on, its
*seam*; where it passes the seam an arc ends, and on the other side begins one that has the joint a turn further. Every
whole turn that fits between the limits makes a further arc. A continuous joint is given in (-pi, pi].

Both limits of a range of exactly a turn cut at one place, and where a joint no more than touches its seam there may be
two cuts of one point: cuts between which a joint does not leave its seam are made one. A configuration within the
limits at a cut that is on no arc of the cells beside it is an isolated solution, an arc of length zero: what a locked
joint leaves, and where a joint touches its seam from below the same a turn less.

Source: Shimizu et al., "Analytical inverse kinematic computation for 7-DOF redundant manipulators with joint limits",
2008, section IV, where the limits of such arms are intervals of psi, for axes at right angles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from maira_qp.analytic.srs.geometry import (
    BRANCHES,
    SRS,
    Branch,
    Circle,
    ElbowBranch,
    SphericalJoint,
    checked_pose,
    rotations,
    wrapped,
)
from maira_qp.display import Card, Shown, joint_entries
from maira_qp.orientation import pose_error
from maira_qp.robots.model.revolutions import WholeTurns, first_choices
from maira_qp.robots.model.robot import Robot
from maira_qp.wording import fixed

WITHIN = 1e-12
"""A joint beyond a limit by at most this [rad] is at the limit: it is clipped."""
MOST, FARTHEST_TURN = 1024, 64
"""Arcs of a list at most, those included that differ by whole turns, and how many turns away they may be."""
_TURN = 2 * np.pi
_NEAR = 1e-9
"""A joint nearer [rad] to its seam is there, a spherical joint nearer to its singularity is singular."""
_NARROW, _ROUNDING, _SPLIT = 1e-3, 1e-14, 1e-6
"""A joint that stays on its seam over a wider cell [rad] is there everywhere; cuts closer to each other [rad], or to a
singularity, are the same."""


@dataclass(frozen=True, eq=False, repr=False)
class Arc(Shown):
    """Configurations that reach one pose, a closed interval of psi on one branch; all within the limits."""

    branch: Branch
    lower: float
    """[rad], in (-pi, pi], or -pi for a whole circle"""
    upper: float
    """[rad], from `lower` to `lower` + 2 pi: beyond pi where the arc passes pi"""
    turns: tuple[int, ...]
    """Whole turns (7,) of the joints, counted from the first that is within the limits"""
    room: tuple[int, ...]
    """How many turns further (7,) the joints could be; none in what `arcs` lists"""
    _knots: np.ndarray
    """The ends and the cuts between them (k,) [rad]"""
    _angles: np.ndarray
    """Joint angles (k, 7) [rad] at the knots, without `turns`"""
    _elbow: ElbowBranch
    _srs: SRS

    @property
    def robot(self) -> Robot:
        """Whose configurations these are."""
        return self._srs.robot

    def _card(self) -> Card:
        names, ends = self.robot.joint_names, self.at(np.array([self.lower, self.upper]))
        ranges = [
            fixed(begin, 4) if self.is_isolated else f"{fixed(begin, 4)} .. {fixed(end, 4)}" for begin, end in ends.T
        ]
        branch = ", ".join(f"{part} {sign:+d}" for part, sign in self.branch._asdict().items())
        return Card(
            title=f"Arc: psi {self.in_words()}; {branch}",
            facts=(("joints" if self.is_isolated else "joints from its lower to its upper end", "[rad]"),),
            entries=joint_entries(names, ranges),
            headings=("joint", "[rad]" if self.is_isolated else "from .. to [rad]", "whole turns"),
            rows=[(*each, str(turns)) for *each, turns in zip(names, ranges, self.turns, strict=True)],
        )

    def in_words(self, digits: int = 4) -> str:
        """Its swivel angles, with so many decimals."""
        low, high = (f"{round(end, digits) + 0.0:.{digits}f}" for end in (self.lower, self.upper))  # no -0.0
        return f"{low} rad, one configuration" if self.is_isolated else f"{low} .. {high} rad"

    @property
    def length(self) -> float:
        """[rad]; 0 for an isolated solution."""
        return self.upper - self.lower

    @cached_property
    def is_isolated(self) -> bool:
        """It is one configuration, to 1e-6 rad: whichever way the elbow swivels, a joint leaves its limits."""
        return self.length == 0 or (self.length <= _SPLIT and bool(np.ptp(self._sides, axis=0).max() <= _SPLIT))

    @property
    def _sides(self) -> np.ndarray:
        """The configurations (3, 7) at both ends, and between."""
        return self.at(np.array([self.lower, 0.5 * (self.lower + self.upper), self.upper]))

    def contains(self, psi: float) -> bool:
        """Whether psi [rad], or psi and some whole turns, is on the arc, its ends included."""
        return bool(self.lower + np.mod(psi - self.lower, _TURN) <= self.upper or psi in (self.lower, self.upper))

    def at(self, psi: np.ndarray) -> np.ndarray:
        """Configurations (..., 7) [rad] at psi (...) [rad], within the limits exactly; psi outside is moved inside.

        Continuous in psi, but where a continuous joint passes pi.
        """
        psi = np.asarray(psi, dtype=float)
        return at_each([self], np.zeros(psi.size, int), psi.ravel()).reshape(*psi.shape, 7)

    def _on_seam(self, psi: float, q: np.ndarray) -> np.ndarray:
        """Angles (7,) with the joints that are at their seam on that side of it where the nearest knot has them."""
        nearest, seam = self._angles[np.abs(psi - self._knots).argmin()], self._srs.lower
        return np.where(_is_at(self._srs, seam, q) & _is_at(self._srs, seam, nearest), nearest, q)

    def _polished(self, q: np.ndarray) -> np.ndarray:
        """Angles (7,) at an end, where some are moved to their limits, with the rest moved so that the pose is kept."""
        robot, lower, upper = self.robot, self._srs.lower, self._srs.upper
        free = (lower < q) & (q < upper)
        J = robot.jacobian(q)[:, free]
        q = q.copy()
        q[free] += np.linalg.lstsq(J, pose_error(robot.forward(q), self._elbow.target), rcond=1e-6)[0]
        return np.clip(q, lower, upper)


def arcs(srs: SRS, T: np.ndarray | pin.SE3) -> list[Arc]:
    """All configurations within the limits that put the tip at T (4, 4); empty where there are none.

    Where whole turns make more than `MOST` of them, those are left out that are the most turns away from the middle of
    the limits. Raises `PoseError`. See `analytic.srs.geometry` for the exact singularities that are not covered.
    """
    return arcs_near(srs, T, srs.robot.middle)[0]


def arcs_near(srs: SRS, T: np.ndarray | pin.SE3, reference: np.ndarray) -> tuple[list[Arc], bool]:
    """`arcs`, and whether these are all: else the most turns away from a reference (7,) [rad] are left out.

    No joint is looked at more than `FARTHEST_TURN` turns away from it.
    """
    turns = WholeTurns(srs.robot, reference)
    lower, upper = turns.around(FARTHEST_TURN)
    lower, upper = np.maximum(lower, srs.lower), np.minimum(upper, srs.upper)
    complete = bool((lower == srs.lower).all() and (upper == srs.upper).all())
    srs = srs.limited(lower, upper)
    found = [arc for elbow in srs.elbow_branches(checked_pose(T)) for arc in _arcs_of_elbow(srs, elbow)]
    each = [_turned(arc, turns.aim, MOST // len(found)) for arc in found]
    return [arc for some, _ in each for arc in some], complete and all(all_of_them for _, all_of_them in each)


def _turned(arc: Arc, reference: np.ndarray, most: int) -> tuple[list[Arc], bool]:
    """An arc at all whole turns that there is room for, but at most so many, and whether these are all."""
    middle = arc._angles[len(arc._angles) // 2]
    nearest = np.round((reference - middle) / _TURN)
    turns = [np.arange(first, first + more + 1) for first, more in zip(arc.turns, arc.room, strict=True)]
    turns = [each[np.argsort(np.abs(each - near), kind="stable")] for each, near in zip(turns, nearest, strict=True)]
    chosen, complete = first_choices(turns, most)
    return [replace(arc, turns=tuple(int(k) for k in each), room=(0,) * 7) for each in chosen], complete


def at_each(found: Sequence[Arc], which: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """`Arc.at` at each psi (N,) [rad], on the arc of the number `which` (N,), of arcs for one pose: (N, 7) [rad]."""
    if not len(psi):
        return np.empty((0, 7))
    srs = found[0]._srs
    lower, upper = np.array([(arc.lower, arc.upper) for arc in found])[which].T
    turns = _TURN * np.array([arc.turns for arc in found])[which]
    places = np.array([BRANCHES.index(arc.branch) % 4 for arc in found])[which]
    psi, q = np.clip(psi, lower, upper), np.empty((len(psi), 7))
    for elbow in {id(arc._elbow): arc._elbow for arc in found}.values():
        rows = np.flatnonzero(np.array([arc._elbow is elbow for arc in found])[which])
        q[rows] = srs.evaluate(elbow, psi[rows])[np.arange(len(rows)), places[rows]]
    q = from_seam(srs, q)
    within = q.copy()
    for k in np.flatnonzero(_is_at(srs, srs.lower, q).any(axis=1)):
        within[k] = found[which[k]]._on_seam(psi[k], q[k])
    within = np.clip(within + turns, srs.lower, srs.upper)
    for k in np.flatnonzero((within != q + turns).any(axis=1)):
        within[k] = found[which[k]]._polished(within[k])
    return within


def _arcs_of_elbow(srs: SRS, elbow: ElbowBranch) -> Iterator[Arc]:
    """The arcs with one elbow angle."""
    cuts = _distinct(srs, elbow, _refined(srs, elbow, _cuts(srs, elbow)))
    widths = _widths(cuts)
    q, middle = np.split(from_seam(srs, srs.evaluate(elbow, np.concatenate([cuts, cuts + 0.5 * widths]))), 2)
    after, before = (_towards(srs, elbow, cuts, q, step) for step in (widths, -np.roll(widths, 1)))
    singular = _is_singular(srs, elbow, cuts)
    for k, branch in enumerate(b for b in BRANCHES if b.elbow == elbow.sign):
        sides = before[:, k], after[:, k]
        yield from _Cells(srs, elbow, branch, cuts, q[:, k], *sides, middle[:, k], singular).arcs()


@dataclass(frozen=True, eq=False)
class _Cells:
    """One branch, cut into k cells, of which each begins at the cut of its number; k >= 1."""

    srs: SRS
    elbow: ElbowBranch
    branch: Branch
    cuts: np.ndarray
    """(k,) [rad] in [-pi, pi), ascending"""
    at_cut: np.ndarray
    """Angles (k, 7) [rad] at the cuts, from the seam on"""
    before: np.ndarray
    """The same, on the side of the seam where the cell before the cut has them"""
    after: np.ndarray
    """The same for the cell after it"""
    middle: np.ndarray
    """Angles (k, 7) [rad] in the middle of the cells"""
    singular: np.ndarray
    """At which cuts (k,) shoulder or wrist are"""

    @cached_property
    def inside(self) -> np.ndarray:
        """Which cells (k,) are within the limits."""
        return is_inside(self.srs, self.middle)

    @cached_property
    def room(self) -> np.ndarray:
        """How many whole turns further (k, 7) the joints can be in the cells."""
        return _room(self.srs, self.middle)

    @cached_property
    def begins(self) -> np.ndarray:
        """At which cuts (k,) an arc begins.

        None goes on where a joint passes its seam, where the turns that fit change, and at a singularity.
        """
        passed = np.abs(self.after - self.before) > np.pi
        changed = self.room != np.roll(self.room, 1, axis=0)
        return self.inside & (~np.roll(self.inside, 1) | (passed | changed).any(axis=1) | self.singular)

    def arcs(self) -> Iterator[Arc]:
        """All of the branch."""
        count = len(self.cuts)
        if self.inside.all() and not self.begins.any():
            yield from self._arcs_over(0, count)
        for i in np.flatnonzero(self.begins):
            cells = 1
            while self.inside[(i + cells) % count] and not self.begins[(i + cells) % count]:
                cells += 1
            yield from self._arcs_over(int(i), cells)
        yield from self._isolated()

    def _arcs_over(self, first: int, cells: int) -> Iterator[Arc]:
        """The arcs over some cells, one for each choice of whole turns that fit between the limits."""
        count, places = len(self.cuts), np.arange(first, first + cells + 1)
        knots, angles = self.cuts[places % count] + _TURN * (places // count), self.after[places % count]
        if self.begins[first]:
            angles[-1] = self.before[places[-1] % count]
            knots, steps = knots.copy(), np.diff(knots)
            for end, cut, step in ((0, first, steps[0]), (-1, first + cells, -steps[-1])):
                if self.singular[cut % count]:
                    knots[end], angles[end] = self._regular_from(knots[end], step)
            outside = ~is_inside(self.srs, angles)
            lower = self._inside_from(knots[0], steps[0]) if outside[0] else float(knots[0])
            upper = self._inside_from(knots[-1], -steps[-1]) if outside[-1] else float(knots[-1])
        else:
            knots, angles = np.concatenate([knots - _TURN, knots]), np.concatenate([angles, angles])
            lower, upper = -np.pi, np.pi
        shift = _TURN if lower == -np.pi and upper < np.pi else 0.0  # -pi itself is written pi
        ends, room = (lower + shift, upper + shift), tuple(int(more) for more in self.room[first])
        yield Arc(self.branch, *ends, (0,) * 7, room, knots + shift, angles, self.elbow, self.srs)

    def _isolated(self) -> Iterator[Arc]:
        """The configurations at the cuts that are within the limits, and on no arc of the cells beside them."""
        srs = self.srs
        at_end = _is_at(srs, srs.lower, self.at_cut) | _is_at(srs, srs.upper, self.at_cut)
        alone = ~(self.inside | np.roll(self.inside, 1)) | at_end.any(axis=1)
        for i in np.flatnonzero(is_inside(srs, self.at_cut) & alone):
            boxes = [(np.zeros(7, int), _room(srs, self.at_cut[i]).astype(int))]
            for angles, cell in ((self.before[i], i - 1), (self.after[i], i)):
                further = np.round((angles - self.at_cut[i]) / _TURN)
                if self.inside[cell] and np.abs(angles - self.at_cut[i] - _TURN * further).max() <= _NEAR:
                    known = further.astype(int), (further + self.room[cell]).astype(int)
                    boxes = [part for box in boxes for part in without(box, known)]
            psi = float(self.cuts[i]) if self.cuts[i] > -np.pi else np.pi
            for first, last in boxes:
                turns, room = tuple(first.tolist()), tuple((last - first).tolist())
                yield Arc(self.branch, psi, psi, turns, room, np.array([psi]), self.at_cut[[i]], self.elbow, srs)

    def _regular_from(self, end: float, step: float) -> tuple[float, np.ndarray]:
        """Where next to a singular end [rad] the joints' angles (7,) can be told, and these: `step` is as below."""
        psi = end + 0.5 * step * 0.5 ** np.arange(48, -1, -2.0)
        regular = ~_is_singular(self.srs, self.elbow, psi, 10 * _NEAR)
        first = int(regular.argmax()) if regular.any() else len(psi) - 1
        q = self.srs.evaluate(self.elbow, psi[first : first + 1])[0, BRANCHES.index(self.branch) % 4]
        return float(psi[first]), from_seam(self.srs, q)

    def _inside_from(self, end: float, step: float) -> float:
        """The end of an arc [rad] that rounding put outside, moved inwards; `step` [rad] is its cell, from there on."""
        place = BRANCHES.index(self.branch) % 4
        outside, within = end, end + 0.5 * step
        for _ in range(60):
            half = 0.5 * (outside + within)
            if half in (outside, within):
                break
            q = from_seam(self.srs, self.srs.evaluate(self.elbow, np.array([half]))[:, place])
            outside, within = (outside, half) if is_inside(self.srs, q)[0] else (half, within)
        return float(within)


def _cuts(srs: SRS, elbow: ElbowBranch) -> np.ndarray:
    """Angles psi (k,) [rad] in [-pi, pi), ascending, k >= 1, between which no joint passes a limit."""
    robot = srs.robot
    equations = [
        _equations(joint, circle, robot.lower[part], robot.upper[part])
        for joint, circle, part in zip(
            srs.joints, (elbow.shoulder, elbow.wrist), (slice(0, 3), slice(4, 7)), strict=True
        )
    ]
    cosine, sine, constant = np.concatenate(equations).T
    amplitude = np.hypot(cosine, sine)
    varies = amplitude > 1e-14
    apex = np.arctan2(sine, cosine)[varies]
    away = np.arccos(np.clip(-constant[varies] / amplitude[varies], -1, 1))
    roots = np.sort(-wrapped(-np.concatenate([apex + away, apex - away])))
    return roots[np.diff(roots, prepend=-np.inf) > 0] if len(roots) else np.array([-np.pi])


def _refined(srs: SRS, elbow: ElbowBranch, cuts: np.ndarray) -> np.ndarray:
    """The cuts (k,) with those moved onto the limit where a joint turns so fast that a root's rounding is seen in it.

    Newton's method on the joint that is next to its limit, by central differences; few cuts need it.
    """
    robot, nudge = srs.robot, 1e-7
    q = from_seam(srs, srs.evaluate(elbow, cuts))
    beyond = np.where(np.isfinite(robot.upper), q - robot.upper, -np.inf)
    beyond = np.where(beyond > np.pi, np.where(np.isfinite(robot.lower), q - robot.lower - _TURN, 0.0), beyond)
    rounding = np.where(np.isnan(beyond) | (np.abs(beyond) > 1e-7), 0.0, beyond)
    rounding = np.where(np.abs(rounding) > 0.1 * WITHIN, rounding, 0.0)
    found = np.argwhere(rounding != 0.0)
    for i, k, j in found[np.diff(found[:, 0], prepend=-1) > 0]:  # branches that share the joint's angle share the cut
        both = srs.evaluate(elbow, cuts[i] + np.array([nudge, -nudge]))[:, k, j]
        slope = float(wrapped(both[0] - both[1])) / (2 * nudge)
        if abs(slope) > 1:  # NaN where the branch ends
            cuts[i] -= rounding[i, k, j] / slope
    return np.unique(cuts)


def _equations(joint: SphericalJoint, circle: Circle, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Coefficients (k, 3) of `x cos psi + y sin psi + z = 0` wherever a joint is at a limit, or two branches meet.

    lower, upper: of the three joints (3,) [rad].
    """
    a, b, c = joint.a, joint.b, joint.c
    delta, total = joint.angles
    rows = [(a, c, np.cos(delta)), (a, c, np.cos(total))]
    for limit in (lower, upper):
        if np.isfinite(limit[0]):
            rows.append((rotations(a, limit[0]) @ b, c, b @ c))
        if np.isfinite(limit[1]):
            rows.append((a, c, joint.constant + joint.amplitude * np.cos(limit[1] - joint.phase)))
        if np.isfinite(limit[2]):
            rows.append((a, rotations(c, -limit[2]) @ b, a @ b))
    return np.array(
        [(u @ circle.cosine @ w, u @ circle.sine @ w, u @ circle.constant @ w - value) for u, w, value in rows]
    )


def _widths(cuts: np.ndarray) -> np.ndarray:
    """How wide (k,) [rad] the cells are that begin at the cuts (k,)."""
    return np.append(cuts[1:], cuts[0] + _TURN) - cuts


def _distinct(srs: SRS, elbow: ElbowBranch, cuts: np.ndarray) -> np.ndarray:
    """The cuts (k,), one in place of those between which some joint does not leave its seam, or those of a singularity.

    It is in their middle, or at the singularity: a double root, which rounding splits by its own square root.
    """
    widths = _widths(cuts)
    singular = _singularities(srs, elbow)
    close = (np.abs(wrapped(cuts[:, None] - singular)) < _SPLIT).any(axis=1)
    q = from_seam(srs, srs.evaluate(elbow, np.concatenate([cuts, cuts + 0.5 * widths])))
    start, middle = np.split(_is_at(srs, srs.lower, q, WITHIN), 2)
    stays = (start & middle & np.roll(start, -1, axis=0)).any(axis=(1, 2)) & (widths < _NARROW)
    split = close & np.roll(close, -1) & (widths < 2 * _SPLIT)
    pinched = stays | split | (widths < _ROUNDING)
    first, last = np.flatnonzero(~np.roll(pinched, 1)), np.flatnonzero(~pinched)
    last = np.roll(last, -1) if last[0] < first[0] else last
    half = 0.5 * np.mod(cuts[last] - cuts[first], _TURN)
    middles = -wrapped(-(cuts[first] + half))
    for place in singular:
        middles[np.abs(wrapped(middles - place)) < _SPLIT] = -wrapped(-place)
    return np.unique(middles)


def _singularities(srs: SRS, elbow: ElbowBranch) -> np.ndarray:
    """Where (k,) [rad] the shoulder or the wrist is singular: a . R c is at an end of its range over the circle."""
    found = [np.empty(0)]
    for joint, circle in zip(srs.joints, (elbow.shoulder, elbow.wrist), strict=True):
        apex = np.arctan2(joint.a @ circle.sine @ joint.c, joint.a @ circle.cosine @ joint.c)
        both = np.array([apex, apex + np.pi])
        found.append(both[joint.nearness(circle.at(both)) < _NEAR])
    return np.concatenate(found)


def _is_singular(srs: SRS, elbow: ElbowBranch, cuts: np.ndarray, within: float = _NEAR) -> np.ndarray:
    """At which cuts (k,) shoulder or wrist are singular to so much [rad]."""
    pairs = zip(srs.joints, (elbow.shoulder, elbow.wrist), strict=True)
    return np.any([joint.nearness(circle.at(cuts)) < within for joint, circle in pairs], axis=0)


Box = tuple[np.ndarray, np.ndarray]
"""The first and the last turns (7,) of the joints."""


def without(box: Box, other: Box) -> Iterator[Box]:
    """The turns of a box that are not in another, as boxes."""
    (first, last), (low, high) = box, other
    if (np.maximum(first, low) > np.minimum(last, high)).any():
        yield box
        return
    for i in range(len(first)):
        for begin, end in ((first[i], low[i] - 1), (high[i] + 1, last[i])):
            if begin <= end:
                part = first.copy(), last.copy()
                part[0][i], part[1][i] = begin, end
                yield part
        first, last = first.copy(), last.copy()
        first[i], last[i] = max(first[i], low[i]), min(last[i], high[i])


def _room(srs: SRS, q: np.ndarray) -> np.ndarray:
    """How many whole turns further than q (..., 7), within the turn from the seam on, the joints can be; NaN: none."""
    finite = np.isfinite(srs.upper)
    beyond = np.where(finite, np.where(finite, srs.upper, 0.0) - q + WITHIN, 0.0)
    return np.floor(np.fmax(beyond, 0.0) / _TURN)


def from_seam(srs: SRS, q: np.ndarray) -> np.ndarray:
    """The same angles (..., 7) within the turn that begins at the seam; in (-pi, pi] of a continuous joint."""
    lower = srs.lower
    finite = np.isfinite(lower)
    start = np.where(finite, lower, 0.0) - WITHIN
    turned = start + np.mod(q - start, _TURN)
    return np.where(finite, turned, wrapped(q))


def is_inside(srs: SRS, q: np.ndarray) -> np.ndarray:
    """Whether each of q (..., 7), within the turn from the seam on, or NaN for none, is within the limits."""
    return np.asarray((q <= srs.upper + WITHIN).all(axis=-1))


def _is_at(srs: SRS, limits: np.ndarray, q: np.ndarray, within: float = _NEAR) -> np.ndarray:
    """Which joints (..., 7) with a range of a turn or more are at one of their limits (7,) [rad], turns aside."""
    robot = srs.robot
    whole = np.isfinite(robot.lower) & (robot.upper - robot.lower >= _TURN - 2 * WITHIN)
    return np.asarray(whole & (np.abs(wrapped(q - np.where(whole, limits, 0.0))) < within))


def _towards(srs: SRS, elbow: ElbowBranch, cuts: np.ndarray, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The angles q (k, 4, 7) [rad] at the cuts (k,), seen from the cell that lies on the side of `steps` (k,) [rad].

    A joint that is at its seam is at the lower limit or a whole turn further, whichever it leaves on the way into the
    cell.
    """
    q = q.copy()
    at_seam = _is_at(srs, srs.lower, q)
    rows = np.flatnonzero(at_seam.any(axis=(1, 2)))
    psi = cuts[rows, None] + steps[rows, None] * 0.5 ** np.arange(48, 0, -2.0)
    path = from_seam(srs, srs.evaluate(elbow, psi.ravel())).reshape(*psi.shape, 4, 7)
    past = path - np.where(np.isfinite(srs.lower), srs.lower, 0.0)
    departed = (past > _NEAR) & (past < _TURN - _NEAR)
    first = np.take_along_axis(past, departed.argmax(axis=1)[:, None], axis=1)[:, 0]
    further = departed.any(axis=1) & (first > np.pi)
    q[rows] = np.where(at_seam[rows], srs.lower + np.where(further, _TURN, 0.0), q[rows])
    return q
