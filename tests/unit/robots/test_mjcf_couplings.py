"""Couplings and tendons of MJCF, judged by MuJoCo's own equality residuals, tendon lengths and limits."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import RobotError

mujoco = pytest.importorskip("mujoco")


def words(numbers):
    return " ".join(repr(float(number)) for number in np.atleast_1d(numbers))


class Drawn:
    """A random tree with couplings and tendons that a random configuration keeps, or the one at zero.

    `rows @ (q - qpos0) = sides` are its equalities, by the names of all joints.
    """

    def __init__(self, rng, joints=7, equalities=2, tendons=2, at_zero=False):
        self.rng, self.names = rng, [f"j{k}" for k in range(joints)]
        self.reference = rng.uniform(-1, 1, joints) * (rng.random(joints) < 0.5)
        self.inside = np.zeros(joints) if at_zero else rng.uniform(-1, 1, joints)
        kinds = rng.choice(["hinge", "slide"], joints)
        self.ends = self.inside[:, None] + np.array([-1, 1]) * rng.uniform(0.3, 2, (joints, 2))
        self.rows, tendon, equality = [], "", ""
        for k in range(tendons):
            row = self._row()
            ends = row @ self.inside + np.array([-1, 1]) * rng.uniform(0.1, 1, 2)
            tendon += f'<fixed name="t{k}" range="{words(ends)}">{self._terms(row)}</fixed>'
        for k in range(equalities):
            made, more = self._tendons(k) if rng.random() < 0.5 else (self._joints(), "")
            equality, tendon = equality + made, tendon + more
        self.sides = np.array([row @ (self.inside - self.reference) for row in self.rows])
        parents = [int(rng.integers(-1, k)) for k in range(joints)]

        def body(k):
            inner = "".join(body(child) for child in range(joints) if parents[child] == k)
            limited = f'range="{words(self.ends[k])}"' if kinds[k] == "slide" or rng.random() < 0.8 else ""
            return (
                f'<body name="b{k}" pos="{words(rng.normal(size=3))}" quat="{words(rng.normal(size=4))}">'
                f'<joint name="j{k}" type="{kinds[k]}" axis="{words(rng.normal(size=3))}" {limited}'
                f' ref="{words(self.reference[k])}" pos="{words(rng.normal(size=3))}"/>'
                f'<geom size="0.1"/>{inner}</body>'
            )

        tree = "".join(body(k) for k in range(joints) if parents[k] < 0)
        self.text = (
            f'<mujoco model="drawn"><compiler angle="radian"/><worldbody>{tree}</worldbody>'
            f"<tendon>{tendon}</tendon><equality>{equality}</equality></mujoco>"
        )
        self.leaves = [f"b{k}" for k in range(joints) if k not in parents]

    def _row(self):
        count = int(self.rng.integers(1, 4))
        row = np.zeros(len(self.names))
        row[self.rng.choice(len(row), count, replace=False)] = self.rng.uniform(0.5, 2, count)
        return row * self.rng.choice([-1, 1])

    def _terms(self, row):
        return "".join(f'<joint joint="j{k}" coef="{words(row[k])}"/>' for k in np.flatnonzero(row))

    def _joints(self):
        first, second = self.rng.choice(len(self.names), 2, replace=False)
        slope, row = self.rng.uniform(0.5, 2), np.zeros(len(self.names))
        row[first], row[second] = 1.0, -slope
        self.rows.append(row)
        side = row @ (self.inside - self.reference)
        return f'<joint joint1="j{first}" joint2="j{second}" polycoef="{words([side, slope, 0, 0, 0])}"/>'

    def _tendons(self, k):
        first, second, slope = self._row(), self._row(), self.rng.uniform(0.5, 2)
        row = first - slope * second
        self.rows.append(row)
        side = row @ (self.inside - self.reference)
        made = "".join(f'<fixed name="e{k}_{i}">{self._terms(each)}</fixed>' for i, each in enumerate((first, second)))
        return (
            f'<tendon tendon1="e{k}_0" tendon2="e{k}_1" polycoef="{words([side, slope, 0, 0, 0])}"/>',
            made,
        )

    def completed(self, values):
        """All joints (njnt,) where some have values and the equalities hold for the others."""
        q, rows = np.array([values.get(name, np.nan) for name in self.names]), np.reshape(self.rows, (-1, len(values)))
        missing = np.isnan(q)
        side = self.sides - rows[:, ~missing] @ (q - self.reference)[~missing]
        q[missing] = np.linalg.lstsq(rows[:, missing], side, rcond=None)[0] + self.reference[missing]
        return q


class Judge:
    """MuJoCo's own residuals."""

    def __init__(self, text):
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def broken(self, q):
        """For values of j0, j1, ... the largest residual of an equality, and the largest excess over a range."""
        for k, value in enumerate(q):
            self.data.joint(f"j{k}").qpos[:] = value
        mujoco.mj_forward(self.model, self.data)
        kinds = mujoco.mjtConstraint
        equal = self.data.efc_type == int(kinds.mjCNSTR_EQUALITY)
        limits = np.isin(self.data.efc_type, [int(kinds.mjCNSTR_LIMIT_JOINT), int(kinds.mjCNSTR_LIMIT_TENDON)])
        return (
            float(np.abs(self.data.efc_pos[equal]).max(initial=0.0)),
            float(-self.data.efc_pos[limits].min(initial=0.0)),
        )

    def pose(self, body):
        """Where a body is (4, 4)."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.data.body(body).xmat.reshape(3, 3), self.data.body(body).xpos
        return T


def loaded(drawn, tip):
    """The robot; None where equalities leave no joint that moves a tip."""
    try:
        return mq.Robot.from_mjcf(drawn.text, tip=tip)
    except RobotError as reason:
        if "no joint moves" in str(reason):
            return None
        raise


def expanded(drawn, robot, q):
    """All of MuJoCo's joints where the robot's have the values q."""
    values = dict.fromkeys(drawn.names, np.nan) | dict(zip(robot.joint_names, q, strict=True))
    return drawn.completed(values)


def test_random_trees_keep_all_couplings_and_ranges(rng):
    """Wherever a robot's limits let it be, every equality holds and no joint or tendon is beyond its range."""
    several = 0
    for _ in range(30):
        drawn = Drawn(rng, joints=int(rng.integers(4, 9)), equalities=int(rng.integers(0, 4)))
        robot = loaded(drawn, drawn.leaves)
        if robot is None:
            continue
        judge, rank = Judge(drawn.text), np.linalg.matrix_rank(np.reshape(drawn.rows, (-1, len(drawn.names))))
        assert robot.n == len(drawn.names) - rank
        several += "_2" in robot.urdf
        for _ in range(3):
            q = robot.random_configuration(rng)
            residual, beyond = judge.broken(expanded(drawn, robot, q))
            assert residual < 1e-11
            assert beyond < 1e-11
            for body in (f"b{k}" for k in range(len(drawn.names))):
                assert np.abs(robot.forward(q, body).homogeneous - judge.pose(body)).max() < 1e-10
    assert several > 3


def test_limits_are_no_narrower_than_those_of_mujoco(rng):
    """A configuration that MuJoCo finds nothing wrong with is within the robot's limits."""
    seen = 0
    for _ in range(8):
        drawn = Drawn(rng, joints=5, equalities=1)
        robot, judge = loaded(drawn, drawn.leaves), Judge(drawn.text)
        if robot is None:
            continue
        for _ in range(200):
            low, high = robot.drawn_range
            q = robot.middle + (rng.random(robot.n) - 0.5) * 1.5 * (high - low)
            if judge.broken(expanded(drawn, robot, q))[1] < 1e-9:
                seen += 1
                assert (q >= robot.lower - 1e-8).all()
                assert (q <= robot.upper + 1e-8).all()
                for limit in robot.sum_limits:
                    sum_ = sum(factor * q[robot.joint_names.index(k)] for k, factor in limit.coefficients.items())
                    assert limit.lower - 1e-8 <= sum_ <= limit.upper + 1e-8
    assert seen > 30


def test_joints_beside_the_chain_stand_in_sums_where_they_rest(rng):
    """A tendon over joints that do not move limits those that do; a leader outside comes along with its follower."""
    seen = 0
    for _ in range(25):
        drawn = Drawn(rng, joints=7, equalities=1, tendons=3, at_zero=True)
        tip = str(rng.choice(drawn.leaves))
        robot = loaded(drawn, tip)
        if robot is None:
            continue
        judge = Judge(drawn.text)
        coupled = [name for row in drawn.rows for name in np.array(drawn.names)[row != 0]]
        follower = max(coupled, key=lambda name: judge.model.joint(name).id)
        assert follower not in robot.joint_names
        seen += bool(robot.sum_limits)
        for _ in range(3):
            q = robot.random_configuration(rng)
            values = dict.fromkeys(drawn.names, 0.0) | dict(zip(robot.joint_names, q, strict=True))
            values[follower] = np.nan
            residual, beyond = judge.broken(drawn.completed(values))
            assert residual < 1e-11
            assert beyond < 1e-11
            assert np.abs(robot.forward(q).homogeneous - judge.pose(tip)).max() < 1e-10
    assert seen > 5


# Models that mean ill


def arm(more, joints="x y z"):
    """A chain of hinges, each with a body of its name, `b` before it, and what comes behind them."""
    inner, end = "", ""
    for name in joints.split():
        inner += (
            f'<body name="b{name}" pos="0 0 0.3"><joint name="{name}" axis="0 1 0" range="-1 1"/><geom size="0.1"/>'
        )
        end += "</body>"
    return f'<mujoco><compiler angle="radian"/><worldbody>{inner}{end}</worldbody>{more}</mujoco>'


@pytest.mark.parametrize(
    ("more", "names"),
    [
        # each twice the other: both stand at their references
        (
            '<equality><joint joint1="x" joint2="y" polycoef="0 2"/>'
            '<joint joint1="y" joint2="x" polycoef="0 2"/></equality>',
            "z",
        ),
        ('<equality><joint joint1="y" joint2="x" polycoef="0.2 0"/></equality>', "x z"),  # a slope of zero
        ('<equality><joint joint1="y" joint2="x" polycoef="0 1" active="false"/></equality>', "x y z"),
        # a coefficient of zero couples nothing
        (
            '<tendon><fixed name="t"><joint joint="x" coef="0"/><joint joint="y" coef="1"/></fixed></tendon>'
            '<equality><tendon tendon1="t" polycoef="0.3"/></equality>',
            "x z",
        ),
        # several equalities on one follower leave fewer leaders
        (
            '<equality><joint joint1="z" joint2="x" polycoef="0.1 0.5"/>'
            '<joint joint1="z" joint2="y" polycoef="0 1"/></equality>',
            "x",
        ),
        # a square of what stands still
        (
            '<equality><joint joint1="x" polycoef="0.4"/><joint joint1="z" joint2="x" polycoef="0.1 0 1"/></equality>',
            "y",
        ),
    ],
)
def test_equalities_that_leave_joints_no_choice(more, names, rng):
    """The joints that are left, and where MuJoCo has the last body: no residual of an equality."""
    text = arm(more)
    robot, judge = mq.Robot.from_mjcf(text, tip="bz"), Judge(text)
    assert robot.joint_names == tuple(names.split())
    q = robot.random_configuration(rng)
    axes = [robot.forward(q, f"b{name}").rotation[:, 0] for name in "xyz"]  # turned about y alone
    angles = [-np.arctan2(each[2], each[0]) for each in axes]
    values = np.diff([0.0, *np.unwrap(angles)])
    for name, value in zip("xyz", values, strict=True):
        judge.data.joint(name).qpos[:] = value
    mujoco.mj_forward(judge.model, judge.data)
    equal = judge.data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    assert np.abs(judge.data.efc_pos[equal]).max(initial=0.0) < 1e-9


def test_polynomials_are_refused_where_they_determine_a_joint_that_moves(caplog):
    """Behind the chain they do not matter; of a joint that only leads, it is said that they are not kept."""
    curved = '<equality><joint name="cam" joint1="y" joint2="x" polycoef="0 1 0 2"/></equality>'
    with pytest.raises(
        RobotError, match=r"equality 'cam' is a polynomial of degree 3, .* determines y; make it linear"
    ):
        mq.Robot.from_mjcf(arm(curved), tip="bz")
    assert caplog.text == ""
    assert mq.Robot.from_mjcf(arm(curved), tip="bx").joint_names == ("x",)
    assert "equality 'cam' is a polynomial of degree 3, which is not supported, and not kept (x)" in caplog.text
    caplog.clear()
    assert mq.Robot.from_mjcf(arm(curved), tip="bz", base="by").joint_names == ("z",)
    assert caplog.text == ""
    through = curved.replace("</equality>", '<joint joint1="z" joint2="y"/></equality>')
    with pytest.raises(RobotError, match="determines y"):
        mq.Robot.from_mjcf(arm(through), tip="bz", base="bx")


def test_cables_and_loops_that_are_not_kept_are_said(caplog):
    """A tendon through sites is no sum of joints."""
    cable = (
        '<tendon><spatial name="cable" limited="true" range="0 1"><site site="s"/><site site="t"/></spatial></tendon>'
        '<equality><tendon name="taut" tendon1="cable"/><weld name="loop" body1="bz"/></equality>'
    )
    text = arm(cable).replace('<geom size="0.1"/>', '<geom size="0.1"/><site name="s"/>', 1)
    text = text.replace("</body></body></body>", '<site name="t" pos="0.1 0 0"/></body></body></body>')
    robot = mq.Robot.from_mjcf(text, tip="bz")
    assert robot.n == 3
    assert "tendon 'cable' is limited and no sum of joints, and its range is not kept (y, z)" in caplog.text
    assert "equality 'taut' is of a tendon that is no sum of joints, and is not kept (y, z)" in caplog.text
    assert (
        "equality 'loop' closes a loop, which stays open: the joints in it move on their own (x, y, z)" in caplog.text
    )
    caplog.clear()
    mq.Robot.from_mjcf(text, tip="bx", base="world")
    assert "cable" not in caplog.text


def test_ranges_of_tendons_are_not_angles():
    """MJCF's `angle` leaves them and polynomials alone; `autolimits` and a margin change no range."""
    text = arm(
        '<tendon><fixed name="t" limited="true" range="-0.5 1" margin="0.2"><joint joint="x" coef="1"/>'
        '<joint joint="y" coef="2"/></fixed>'
        '<fixed name="one" limited="true" range="-0.1 0.6"><joint joint="z" coef="-2"/></fixed></tendon>'
    ).replace('angle="radian"', 'angle="degree" autolimits="false"')
    text = text.replace('range="-1 1"', 'limited="true" range="-90 90" margin="0.1"')
    robot = mq.Robot.from_mjcf(text, tip="bz")
    (limit,) = robot.sum_limits
    assert (limit.lower, limit.upper, dict(limit.coefficients)) == (-0.5, 1.0, {"x": 1.0, "y": 2.0})
    assert (robot.lower[2], robot.upper[2]) == pytest.approx((-0.3, 0.05))
    free = mq.Robot.from_mjcf(text, tip="bz", limits={"z": (-0.2, 0.02)})
    assert (free.lower[2], free.upper[2]) == pytest.approx((-0.2, 0.02))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            '<equality><joint joint1="x" joint2="y" polycoef="inf 1"/></equality>',
            "equality 'number 0' has coefficients",
        ),
        (
            '<tendon><fixed name="t" range="0 1"><joint joint="x" coef="inf"/></fixed></tendon>',
            "tendon 't' has coefficients that are not finite",
        ),
        (
            '<equality><joint joint1="z" joint2="y" polycoef="5 1"/></equality>',
            "'z' mimics 'y' .* but no position is within the limits of both",
        ),
    ],
)
def test_numbers_that_make_no_sense_are_refused(more, message):
    with pytest.raises(RobotError, match=message):
        mq.Robot.from_mjcf(arm(more), tip="bz")


def test_tendons_that_leave_a_joint_no_room_are_said(caplog):
    alone = '<tendon><fixed name="t" range="5 6"><joint joint="x" coef="1"/></fixed></tendon>'
    assert mq.Robot.from_mjcf(arm(alone), tip="bz").upper.tolist() == [1, 1, 1]
    assert "'t' leaves the joint that it depends on no room, and its range is not kept (x)" in caplog.text


def test_soft_bodies_and_their_equalities_do_not_matter():
    cloth = (
        '<flexcomp name="f" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2"><edge equality="true"/></flexcomp>'
        "</body></body></body>"
    )
    text = arm("").replace("</body></body></body>", cloth)
    assert mq.Robot.from_mjcf(text, tip="bz").joint_names == ("x", "y", "z")
