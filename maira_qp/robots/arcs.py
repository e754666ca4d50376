"""The joint limits of an S-R-S arm as exact sets of the swivel angle psi: all configurations for a pose, as arcs.

For one elbow angle, shoulder and wrist are rotations R(psi) = R_0 + R_c cos psi + R_s sin psi, each made by rotations
about axes a, b, c (`maira_qp.robots.srs`). A joint stands at the angle L, or half a turn away or on the other branch,
only where

    (exp(L a) b) . R c = b . c            first joint
    a . R c = k_0 + rho cos(L - phi)      middle joint
    a . R (exp(-L c) b) = a . b           last joint

each of the form alpha cos psi + beta sin psi + gamma = 0 with at most two roots. The roots for both limits of each
joint, and those where the two branches of a spherical joint meet (a . R c at its ends k_0 +- rho), cut the circle into
cells in which no joint enters or leaves its limits; one look inside tells a cell. So that a tangency is not lost to
rounding, an equation without roots gives the point where it comes nearest: a cut too many is harmless. A cut between
two cells that are outside may itself be inside: an isolated solution, an arc of length zero (what a locked joint
leaves).

Angles are known up to whole turns. A joint whose range is a turn or more is looked at from its lower limit on; where it
passes that limit an arc ends, and on the other side begins one that has the joint a turn further. Every whole turn that
fits between the limits makes a further arc. A continuous joint is given in (-pi, pi].

Source: Shimizu et al., "Analytical inverse kinematic computation for 7-DOF redundant manipulators with joint limits",
2008, section IV, where the limits of such arms are intervals of psi, for axes at right angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import pinocchio as pin

from maira_qp.orientation import pose_error
from maira_qp.robots.robot import Robot
from maira_qp.robots.srs import (
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

WITHIN = 1e-12
"""A joint beyond a limit by at most this [rad] is at the limit: it is clipped."""
_TURN = 2 * np.pi
_NEAR = 1e-9
"""A joint nearer [rad] to the start of its range is there, a spherical joint nearer to its singularity is singular."""


@dataclass(frozen=True, eq=False)
class Arc:
    """Configurations that reach one pose, a closed interval of psi on one branch; all within the limits."""

    branch: Branch
    lower: float
    """[rad], in (-pi, pi], or -pi for a whole circle"""
    upper: float
    """[rad], from `lower` to `lower` + 2 pi: beyond pi where the arc passes pi"""
    turns: tuple[int, ...]
    """Whole turns (7,) of the joints, counted from the first that is within the limits"""
    _ends: np.ndarray
    """Joint angles (2, 7) [rad] at the ends, without `turns`"""
    _elbow: ElbowBranch
    _srs: SRS

    @property
    def robot(self) -> Robot:
        """Whose configurations these are."""
        return self._srs.robot

    @property
    def length(self) -> float:
        """[rad]; 0 for an isolated solution."""
        return self.upper - self.lower

    def contains(self, psi: float) -> bool:
        """Whether psi [rad], or psi and some whole turns, is on the arc, its ends included."""
        return bool(self.lower + np.mod(psi - self.lower, _TURN) <= self.upper or psi in (self.lower, self.upper))

    def at(self, psi: np.ndarray) -> np.ndarray:
        """Configurations (..., 7) [rad] at psi (...) [rad], within the limits to the bit; psi outside is moved inside.

        Continuous in psi, but where a continuous joint passes pi.
        """
        robot = self.robot
        psi = np.clip(np.asarray(psi, dtype=float), self.lower, self.upper)
        turns = _TURN * np.array(self.turns)
        q = _from_lower(self._srs, self._srs.evaluate(self._elbow, psi.ravel())[:, BRANCHES.index(self.branch) % 4])
        within = np.clip(self._at_its_end(psi.ravel(), q) + turns, robot.lower, robot.upper)
        for k in np.flatnonzero((within != q + turns).any(axis=1)):
            within[k] = self._polished(within[k])
        return within.reshape(*psi.shape, 7)

    def _polished(self, q: np.ndarray) -> np.ndarray:
        """Angles (7,) at an end, where some are moved to their limits, with the rest moved so that the pose is kept."""
        robot = self.robot
        free = (robot.lower < q) & (q < robot.upper)
        J = robot.jacobian(q)[:, free]
        q = q.copy()
        q[free] += np.linalg.lstsq(J, pose_error(robot.forward(q), self._elbow.target), rcond=1e-6)[0]
        return np.clip(q, robot.lower, robot.upper)

    def _at_its_end(self, psi: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Angles (N, 7) with the joints that are at the start of their range taken from the nearer end of the arc."""
        ends = self._ends[(psi > 0.5 * (self.lower + self.upper)).astype(int)]
        return np.where(_at_start(self._srs, q) & _at_start(self._srs, ends), ends, q)


def arcs(srs: SRS, T: np.ndarray | pin.SE3) -> list[Arc]:
    """All configurations within the limits that put the tip at T (4, 4); empty where there are none.

    Raises `PoseError`. See `maira_qp.robots.srs` for the exact singularities that are not covered.
    """
    return [arc for elbow in srs.elbow_branches(checked_pose(T)) for arc in _arcs_of_elbow(srs, elbow)]


def _arcs_of_elbow(srs: SRS, elbow: ElbowBranch) -> Iterator[Arc]:
    """The arcs with one elbow angle."""
    cuts = _refined(srs, elbow, _cuts(srs, elbow))
    count = len(cuts)
    widths = np.append(cuts[1:], cuts[0] + _TURN) - cuts
    q = _from_lower(srs, srs.evaluate(elbow, np.concatenate([cuts, cuts + 0.5 * widths])))
    inside = _is_inside(srs, q)
    parted = _is_parted(srs, elbow, cuts, q[:count])
    after, before = (_towards(srs, elbow, cuts, q[:count], step) for step in (widths, -np.roll(widths, 1)))
    for k, branch in enumerate(b for b in BRANCHES if b.elbow == elbow.sign):
        for first, cells in _runs(inside[count:, k], inside[:count, k], parted[:, k]):
            last, rounds = (first + cells) % count, (first + cells) // count
            lower, upper = float(cuts[first]), float(cuts[last] + _TURN * rounds)
            ends = np.array([after[first, k], before[last, k] if cells else after[first, k]])
            if cells and not inside[first, k]:
                lower = _polished(srs, elbow, k, lower, float(widths[first]))
            if cells and not inside[last, k]:
                upper = _polished(srs, elbow, k, upper, -float(widths[last - 1]))
            if cells == count and inside[first, k] and not parted[first, k]:
                lower, upper = -np.pi, np.pi
            inner = q[count + first, k] if cells else ends[0]
            yield from _arcs_of_run(srs, elbow, branch, (lower, upper), ends, inner)


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
    q = _from_lower(srs, srs.evaluate(elbow, cuts))
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


def _from_lower(srs: SRS, q: np.ndarray) -> np.ndarray:
    """The same angles (..., 7) within the turn that begins at the lower limit; in (-pi, pi] of a continuous joint."""
    lower = srs.robot.lower
    finite = np.isfinite(lower)
    start = np.where(finite, lower, 0.0) - WITHIN
    turned = start + np.mod(q - start, _TURN)
    return np.where(finite, turned, wrapped(q))


def _is_inside(srs: SRS, q: np.ndarray) -> np.ndarray:
    """Whether each of q (..., 7), within the turn from the lower limit on, or NaN for none, is within the limits."""
    return np.asarray((q <= srs.robot.upper + WITHIN).all(axis=-1))


def _at_start(srs: SRS, q: np.ndarray) -> np.ndarray:
    """Which joints (..., 7) of a range of a turn or more are at its lower limit, or a turn further."""
    robot = srs.robot
    whole = np.isfinite(robot.lower) & (robot.upper - robot.lower >= _TURN - 2 * WITHIN)
    return np.asarray(whole & (np.abs(wrapped(q - np.where(whole, robot.lower, 0.0))) < _NEAR))


def _is_parted(srs: SRS, elbow: ElbowBranch, cuts: np.ndarray, q: np.ndarray) -> np.ndarray:
    """At which cuts (k,), with angles q (k, 4, 7), no arc goes on: (k, 4).

    There a joint of a range of a turn or more passes one of its limits, or a spherical joint is singular.
    """
    robot = srs.robot
    whole = np.isfinite(robot.lower) & (robot.upper - robot.lower >= _TURN - 2 * WITHIN)
    upper = np.where(whole, robot.upper, 0.0)
    parted = np.asarray((_at_start(srs, q) | (whole & (np.abs(wrapped(q - upper)) < _NEAR))).any(axis=-1))
    for joint, circle in zip(srs.joints, (elbow.shoulder, elbow.wrist), strict=True):
        parted |= (joint.nearness(circle.at(cuts)) < _NEAR)[:, None]
    return parted


def _runs(in_cell: np.ndarray, at_cut: np.ndarray, parted: np.ndarray) -> Iterator[tuple[int, int]]:
    """The arcs of one branch: the cut at which one begins, and over how many cells it goes, 0 for a point.

    in_cell, at_cut, parted (k,) of bool: inside the cell that begins at the cut, inside at the cut, and whether no arc
    goes on there.
    """
    count, before = len(in_cell), np.roll(in_cell, 1)
    begins = in_cell & (~before | parted)
    if in_cell.all() and not begins.any():
        yield 0, count
    for i in np.flatnonzero(begins):
        cells = 1
        while in_cell[(i + cells) % count] and not begins[(i + cells) % count]:
            cells += 1
        yield int(i), cells
    for i in np.flatnonzero(at_cut & ~in_cell & ~before):
        yield int(i), 0


def _arcs_of_run(
    srs: SRS, elbow: ElbowBranch, branch: Branch, interval: tuple[float, float], ends: np.ndarray, inner: np.ndarray
) -> Iterator[Arc]:
    """The arcs over one interval of psi, one for each choice of whole turns that fit between the limits.

    ends (2, 7), inner (7,): joint angles [rad] at the ends and in between, within the turn from the lower limit on.
    """
    robot = srs.robot
    room = np.where(np.isfinite(robot.upper), robot.upper - inner + WITHIN, 0.0)
    shift = _TURN if interval[0] == -np.pi and interval[1] - interval[0] < _TURN else 0.0  # -pi itself is written pi
    for turns in product(*(range(int(most) + 1) for most in np.floor(room / _TURN))):
        yield Arc(branch, interval[0] + shift, interval[1] + shift, turns, ends, elbow, srs)


def _polished(srs: SRS, elbow: ElbowBranch, k: int, end: float, step: float) -> float:
    """The end of an arc [rad], moved inwards, `step` [rad] being the way across, as far as rounding put it outside."""

    def is_inside(psi: float) -> bool:
        return bool(_is_inside(srs, _from_lower(srs, srs.evaluate(elbow, np.array([psi]))[:, k]))[0])

    if is_inside(end):
        return end
    outside, within = end, end + 0.5 * step
    for _ in range(60):
        half = 0.5 * (outside + within)
        if half in (outside, within):
            break
        outside, within = (outside, half) if is_inside(half) else (half, within)
    return within


def _towards(srs: SRS, elbow: ElbowBranch, cuts: np.ndarray, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The angles q (k, 4, 7) [rad] at the cuts (k,), seen from the cell that lies on the side of `steps` (k,) [rad].

    A joint that is at the start of its range is at the lower limit or a whole turn further, whichever it leaves on the
    way into the cell.
    """
    q = q.copy()
    at_start = _at_start(srs, q)
    rows = np.flatnonzero(at_start.any(axis=(1, 2)))
    psi = cuts[rows, None] + steps[rows, None] * 0.5 ** np.arange(48, 0, -1.0)
    path = _from_lower(srs, srs.evaluate(elbow, psi.ravel())).reshape(*psi.shape, 4, 7)
    past = path - np.where(np.isfinite(srs.robot.lower), srs.robot.lower, 0.0)
    departed = (past > _NEAR) & (past < _TURN - _NEAR)
    first = np.take_along_axis(past, departed.argmax(axis=1)[:, None], axis=1)[:, 0]
    further = departed.any(axis=1) & (first > np.pi)
    q[rows] = np.where(at_start[rows], srs.robot.lower + np.where(further, _TURN, 0.0), q[rows])
    return q
