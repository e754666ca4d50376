"""The layout of every array that crosses between kernels, or between Python and kernels: its columns, by name.

A class is one array, or one kind of row; `WIDTH` is how long a row is, where that does not depend on the problem. Poses
(12,) are R by rows, then p; errors, twists and weights (6,) are position first. Thresholds stand where they are used.
"""

from __future__ import annotations

from maira_qp.kernels.jit.columns import Columns


class Joint(Columns):
    """A joint of a chain (n + 1, 17) or a tree (n, 19), see `kinematics.serial_chain` and `kinematics.kinematic_tree`.

    Its placement (12,) comes first. The range from START_LOWER to START_UPPER is that of random configurations.
    """

    PRISMATIC, LOWER, UPPER, START_LOWER, START_UPPER = 12, 13, 14, 15, 16
    WIDTH = 17
    VELOCITY, ACCELERATION = 17, 18
    TREE_WIDTH = 19


class Setting(Columns):
    """`settings` of a descent, see `search.levenberg_marquardt`."""

    POSITION_WEIGHT, ORIENTATION_WEIGHT = 0, 1
    POSITION_TOLERANCE, ORIENTATION_TOLERANCE = 2, 3
    MAX_ITERATIONS, DAMPING, STALL_STEPS, STALL_RATIO = 4, 5, 6, 7
    ACCEPTED, REFUSED, LEAST_FACTOR, MOST_FACTOR, LEAST_DAMPING = 8, 9, 10, 11, 12
    LONGEST, NEAR, NEAR_BY_ERROR = 13, 14, 15
    WIDTH = 16


class Descent(Columns):
    """Rows of the `state` of eight descents, a number a lane; of STARTING, ENDED and REACHED 1.0 says yes, 0.0 no.

    FIRST_COST is the cost of the start.
    """

    COST, FACTOR, STALL_LEFT, ITERATIONS, LARGEST, POSITION, ORIENTATION = 0, 1, 2, 3, 4, 5, 6
    STARTING, ENDED, REACHED = 7, 8, 9
    FIRST_COST = 10
    WIDTH = 11


class Newton(Descent):
    """The same rows in `refinement.newton_simd`: LEFT is the projected gradient, EXACT says whether H is exact."""

    LEFT, EXACT = 2, 9


class Outcome(Columns):
    """`outcome` of a search, see `search.multi_start.search`.

    LEFT: the answer left the neighbourhood or the turn of its start.
    """

    SUCCESS, ATTEMPT, SPENT, FINAL_COST, POSITION_ERROR, ORIENTATION_ERROR, MOVED = 0, 1, 2, 3, 4, 5, 6
    WANDERED, LEFT = 7, 8
    WIDTH = 9
    PROVED = -1.0
    """In place of SUCCESS, written by whoever proves it: the target cannot be reached."""


class Slot(Columns):
    """`slots` of a search, the targets that are open: a target's number, or that the slot is free; the next attempt.

    Then how many attempts are under way, the first that arrived (past the last: none), and which the best is from.
    """

    TARGET, FOLLOWING, RUNNING, WINNER, BEST = 0, 1, 2, 3, 4
    WIDTH = 5


class Lane(Columns):
    """`lane_of` of a search: the slot that a lane serves, or none, and which attempt it makes."""

    SERVES, MAKES = 0, 1
    WIDTH = 2


class SlotBest(Columns):
    """`found` of a search, by slot: cost, squared errors, cost of the start; then q (n,)."""

    COST, POSITION, ORIENTATION, FIRST_COST = 0, 1, 2, 3
    Q = 4


class Feature(Columns):
    """Numbers kept of a pose in the library of starts, see `search.seeds`: R and p, and their SQUARE.

    They are weighted so that half a squared distance is near the pose cost. To the square may be added what else counts
    against starting there, as twice a cost.
    """

    SQUARE = 12
    WIDTH = 13


class Settling(Columns):
    """`settling` of a refinement, see `refinement.stabilized_sqp_simd` and `refinement.null_space_sqp`."""

    MAX_SETTLING, STATIONARITY_TOLERANCE = 0, 1
    FIRST_RADIUS, LEAST_RADIUS, RESTORING, RESTORED, RESOLUTION = 2, 3, 4, 5, 6
    WIDTH = 7


class Refinement(Columns):
    """`outcome` of a refinement."""

    REACHED, ITERATIONS, PROJECTED_GRADIENT, OBJECTIVE, POSITION_ERROR, ORIENTATION_ERROR = 0, 1, 2, 3, 4, 5
    WIDTH = 6


class Walk(Columns):
    """Rows of the `state` of eight walks, a number a lane; of the last three 1.0 says yes and 0.0 no."""

    COST, VALUE, LEFT, RADIUS, FACTOR, STEPS = 0, 1, 2, 3, 4, 5
    STARTING, ENDED, CONVERGED = 6, 7, 8
    WIDTH = 9


class Step(Columns):
    """`numbers` of a control step, see `control.step`.

    FIRST: how many tasks are of the first priority. ROWS: how many rows all tasks can have, with those in which levels
    bend. FADING: the gradient below which the first level's posture fades; 0: it does not.
    """

    DAMPING, LEAST_DAMPING, HALVINGS, WITHIN, FARTHEST, FEASIBILITY, IS_SLOW = 0, 1, 2, 3, 4, 5, 6
    FIRST, ROWS = 7, 8
    POSITION_LOSS, ORIENTATION_LOSS, POSITION_WITHIN, ORIENTATION_WITHIN, STATIONARITY = 9, 10, 11, 12, 13
    FADING = 14
    WIDTH = 15


class TaskRow(Columns):
    """`tasks` of a control step (T, 60 + n), see `control.task_jacobians`.

    PLACEMENTS: of up to three frames behind their joints (12,) each. TARGET (12,): its own. AXIS (3,): the axis that
    points, or what a swivel angle counts from. VALUE: a joints' value, or that angle. COEFFICIENTS: one a joint (n,).
    """

    WEIGHTS, GAIN, DAMPING = 0, 6, 7
    PLACEMENTS, TARGET = 8, 44
    AXIS, VALUE, COEFFICIENTS = 56, 59, 60


class Place(Columns):
    """`places` of a control step (T, 7) of int64.

    SOURCE: which target of the call the task takes, or OWN. JOINTS (3,): those that carry its frames, ABSENT for none.
    """

    KIND, LEVEL, SOURCE, AXES, JOINTS = 0, 1, 2, 3, 4
    WIDTH = 7
    OWN, ABSENT = -1, -2


class Kind(Columns):
    """The KIND of a task."""

    POSE, AXIS_ALONG, AXIS_AT, RELATIVE, SWIVEL, COUPLING, STILL = 0, 1, 2, 3, 4, 5, 6


class Axes(Columns):
    """The AXES in which the weights of a task count."""

    BASE, TARGET = 0, 1


class Level(Columns):
    """`objectives` of a control step (L, 2 + 2 n), see `control.level_models`.

    A posture's weight, or 0; its gain; its reference (n,); and then its weights (n,).
    """

    WEIGHT, GAIN, REFERENCE = 0, 1, 2


class Part(Columns):
    """Rows of an S-R-S arm (3, 80): `Elbow`, and two of `Spherical`."""

    ELBOW, SHOULDER, WRIST = 0, 1, 2


class Elbow(Columns):
    """The elbow of an S-R-S arm, see `srs.swivel`."""

    CENTRE, LEVER, REFERENCE = 0, 3, 6
    """The shoulder's centre [m] in the base, the wrist's in the tip's frame, and the direction that psi counts from"""
    UPPER_ARM, FOREARM = 9, 10
    """From the shoulder to the elbow [m], along x; from the elbow to the wrist (3,) [m]; in the axes of the elbow"""
    SMALLEST, LARGEST = 13, 14
    """Distance of shoulder and wrist [m], folded and stretched"""
    COS_PHASE, SIN_PHASE = 15, 16
    """of phi, the angle of q_4 that stretches the arm"""
    COS_FROM_MIDDLE, SIN_FROM_MIDDLE, MIDDLE, COS_HALF, SIN_HALF, LOWER, UPPER = 17, 18, 19, 20, 21, 22, 23
    """of phi less the middle of q_4's range; that middle, half the range (UNLIMITED: a turn or more), both limits"""
    LENGTH = 24
    """Length of the arm [m]"""


class Axis(Columns):
    """The joints of a spherical joint, as they turn about its axes a, b and c."""

    FIRST, MIDDLE, LAST = 0, 1, 2


class Clipped(Axis):
    """The angles of a spherical joint, clipped, and how far they were beyond their limits in all [rad]."""

    MISS = 3
    WIDTH = 4


class Range(Columns):
    """The range of a joint of a spherical one: its middle [rad], cos of half of it, or UNLIMITED, and both limits."""

    CENTRE, COS_HALF, LOWER, UPPER = 0, 1, 2, 3
    WIDTH = 4


class Limit(Columns):
    """One limit of a joint of a spherical one, see `srs.spherical_joint`."""

    WZ, WP, WR, VALUE, SP, SR, S0 = 0, 1, 2, 3, 4, 5, 6
    WIDTH = 7


class Spherical(Columns):
    """A spherical joint, see `srs.spherical_joint`."""

    FIRST_FRAME, LAST_FRAME = 0, 9
    """(a, e, h) and (c, e', h'), nine numbers each"""
    COS_FIRST, SIN_FIRST, COS_LAST, SIN_LAST = 18, 19, 20, 21
    """of the angle between a and b, and between b and c"""
    NEAREST, FARTHEST = 22, 23
    """The angles between a and R c [rad] are in this interval"""
    COS_PHASE, SIN_PHASE = 24, 25
    """of phi less the middle of the middle joint's range"""
    RANGES, LIMITS = 26, 38
    """of each `Axis` a `Range`, and a `Limit` for its lower and for its upper limit"""
    WIDTH = 80


class Sinusoid(Columns):
    """`circles` of shoulder or wrist (15,): constant, cosine and sine of each sinusoid, see `srs.swivel`."""

    Z, P, R, P_LAST, R_LAST = 0, 3, 6, 9, 12
    WIDTH = 15


class Arc(Columns):
    """A blocked arc of swivel angles [rad], and its REASON, 3 joint + `Hindrance`: the joint's place in the chain."""

    LOWER, UPPER, REASON = 0, 1, 2
    WIDTH = 3


class Hindrance(Columns):
    """What blocks an arc."""

    LOWER_LIMIT, UPPER_LIMIT, NO_SOLUTION = 0, 1, 2


class CriticalArc(Columns):
    """A critical arc: its ends [rad], the branch that it concerns, or both, and the joint, or all."""

    LOWER, UPPER, TAU, JOINT = 0, 1, 2, 3
    WIDTH = 4
    BOTH, ALL = 0.0, -1.0


class SeedLanes(Columns):
    """Rows of `lanes` in `srs.posture_seed`, a number a lane."""

    COSINE, SINE, LEAST, CHOICE = 0, 1, 2, 3
    WIDTH = 4


class Davenport(Columns):
    """The axes a, b, c, a unit vector across c, phi, difference and sum of the angles between them: `srs.davenport`."""

    A, B, C, ACROSS = 0, 3, 6, 9
    PHASE, DIFFERENCE, SUM = 12, 13, 14
    WIDTH = 15


class Point(Columns):
    """`points` of a box proof, fixed in the tool: where it is [m], and how far it may be from its place [m]."""

    TOLERANCE = 3
    WIDTH = 4


class Pivot(Columns):
    """`pivots` of a box proof: the joint on whose axis it is, and how far along it from the joint's origin [m]."""

    JOINT, ALONG = 0, 1
    WIDTH = 2


class Side(Columns):
    """Where a variable or row of a QP stands."""

    FREE, AT_LOWER, AT_UPPER = 0, -1, 1
