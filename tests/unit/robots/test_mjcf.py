"""Robots from MJCF, judged by MuJoCo's own forward kinematics, constraints and distances."""

import logging
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import maira_qp as mq
from maira_qp.errors import RobotError
from maira_qp.robots.collision.link_shapes import link_shapes

mujoco = pytest.importorskip("mujoco")


def words(numbers):
    return " ".join(repr(float(number)) for number in np.atleast_1d(numbers))


def orientation(rng):
    """One of MJCF's ways to say an orientation, in degrees."""
    x, y = Rotation.random(random_state=rng).as_matrix()[:2]
    return rng.choice(
        [
            f'quat="{words(rng.normal(size=4))}"',
            f'euler="{words(rng.uniform(-180, 180, 3))}"',
            f'axisangle="{words([*rng.normal(size=3), rng.uniform(-180, 180)])}"',
            f'xyaxes="{words([*x, *y])}"',
            f'zaxis="{words(rng.normal(size=3))}"',
        ]
    )


def random_mjcf(rng, bodies):
    """A chain of bodies with none to three joints each, anchors, references, limits, and a site on each."""
    text, end = "", ""
    for k in range(bodies):
        text += f'<body name="b{k}" pos="{words(rng.normal(size=3))}" {orientation(rng)}><geom size="0.1"/>'
        text += f'<site name="s{k}" pos="{words(rng.normal(size=3))}" {orientation(rng)}/>'
        for j in range(int(rng.integers(0, 4)) if k else 1):
            kind = rng.choice(["hinge", "slide"])
            anchor = f'pos="{words(rng.normal(size=3))}"' if rng.random() < 0.5 else ""
            reference = f'ref="{words(rng.uniform(-1, 1))}"' if rng.random() < 0.5 else ""
            text += f'<joint name="j{k}_{j}" type="{kind}" axis="{words(rng.normal(size=3))}" {anchor} {reference}'
            text += ' range="-2 3"/>' if kind == "slide" or rng.random() < 0.7 else "/>"
        end += "</body>"
    sequence = rng.choice(["xyz", "XYZ", "zyx", "ZXZ"])
    return f'<mujoco model="m"><compiler eulerseq="{sequence}"/><worldbody>{text}{end}</worldbody></mujoco>'


class Judge:
    """MuJoCo's own kinematics of a model."""

    def __init__(self, text):
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def place(self, **values):
        """Put joints at their values."""
        for name, value in values.items():
            self.data.joint(name).qpos[:] = value
        mujoco.mj_forward(self.model, self.data)

    def pose(self, name):
        """Where a body or a site is (4, 4)."""
        T = np.eye(4)
        try:
            body = self.data.body(name)
            T[:3, :3], T[:3, 3] = body.xmat.reshape(3, 3), body.xpos
        except KeyError:
            site = self.data.site(name)
            T[:3, :3], T[:3, 3] = site.xmat.reshape(3, 3), site.xpos
        return T

    def equality_error(self):
        """Largest violation of the equality constraints."""
        rows = self.data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        return float(np.abs(self.data.efc_pos[rows]).max(initial=0.0)), int(rows.sum())


def test_every_body_and_site_stands_where_mujoco_has_it(rng):
    """Random chains, with joint values that are MuJoCo's own qpos, references and anchors included."""
    for _ in range(25):
        text = random_mjcf(rng, int(rng.integers(1, 6)))
        judge = Judge(text)
        robot = mq.Robot.from_mjcf(text, tip=f"s{judge.model.nsite - 1}")
        assert robot.n == judge.model.njnt
        assert robot.base == "world"
        for _ in range(3):
            q = robot.random_configuration(rng)
            judge.place(**dict(zip(robot.joint_names, q, strict=True)))
            for name in (judge.model.body(k).name for k in range(judge.model.nbody)):
                assert np.abs(robot.forward(q, name).homogeneous - judge.pose(name)).max() < 1e-11
            assert np.abs(robot.forward(q).homogeneous - judge.pose(robot.tip)).max() < 1e-11


DEFAULTS = """<mujoco model="arm">
  <compiler angle="degree" autolimits="true"/>
  <default>
    <joint axis="0 1 0" range="-90 45"/>
    <default class="wide"><joint range="-170 170"/></default>
    <default class="rail"><joint type="slide" axis="1 0 0" range="0 0.5"/></default>
  </default>
  <worldbody>
    <body name="first" childclass="wide" pos="0 0 0.3">
      <joint name="a" actuatorfrcrange="-20 30"/><geom type="capsule" size="0.05 0.1"/>
      <body name="second" pos="0 0 0.4">
        <joint name="b" class="main"/><geom size="0.05"/>
        <include file="hand.xml"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""
HAND = """<mujocoinclude>
  <body name="hand" pos="0 0 0.2"><joint name="c" class="rail"/><joint name="d" class="main" limited="false"/>
    <geom size="0.05"/><site name="hand" pos="0 0 0.1"/></body>
</mujocoinclude>"""


def test_defaults_and_includes(tmp_path, rng):
    """Classes, the unit of angles and the folder of the file are MuJoCo's affair; the site has a body's name."""
    (tmp_path / "arm.xml").write_text(DEFAULTS)
    (tmp_path / "hand.xml").write_text(HAND)
    robot = mq.Robot.from_mjcf(tmp_path / "arm.xml", tip="hand_site")
    assert robot.joint_names == ("a", "b", "c", "d")
    assert robot.upper == pytest.approx([np.radians(170), np.radians(45), 0.5, np.inf])
    assert robot.lower == pytest.approx([-np.radians(170), -np.radians(90), 0, -np.inf])
    assert robot.effort_limit.tolist() == [30, np.inf, np.inf, np.inf]
    q = robot.random_configuration(rng)
    judge = Judge(DEFAULTS.replace('<include file="hand.xml"/>', HAND.split("\n", 1)[1].rsplit("\n", 1)[0]))
    judge.place(**dict(zip("abcd", q, strict=True)))
    assert np.abs(robot.forward(q, "hand").homogeneous - judge.pose("hand")).max() < 1e-12
    assert robot.forward(q).translation == pytest.approx(judge.data.site("hand").xpos)
    s = mq.Solver(robot).solve(robot.forward(q))
    assert s.success
    with pytest.raises(RobotError, match=r"(?i)MuJoCo cannot use the MJCF text: .*hand.xml"):
        mq.Robot.from_mjcf(DEFAULTS)


def fingers(equalities, bodies="left right third"):
    """A rail with fingers beside each other."""
    made = "".join(
        f'<body name="{name}"><joint name="{name}" type="slide" range="-1 1" ref="{0.1 * k}"/><geom size="0.1"/></body>'
        for k, name in enumerate(bodies.split())
    )
    return (
        f'<mujoco><worldbody><body name="rail"><joint name="rail" type="slide" axis="1 0 0" range="0 1"/>'
        f'<geom size="0.1"/>{made}</body></worldbody>{equalities}</mujoco>'
    )


TENDONS = (
    '<tendon><fixed name="t"><joint joint="left" coef="1"/><joint joint="right" coef="-0.5"/></fixed>'
    '<fixed name="u"><joint joint="third" coef="2"/></fixed></tendon>'
)


@pytest.mark.parametrize(
    ("equalities", "leaders"),
    [
        ('<equality><joint joint1="right" joint2="left" polycoef="0.1 -2"/></equality>', ("left", "third")),
        ('<equality><joint joint1="left" joint2="right" polycoef="0.1 -2"/></equality>', ("left", "third")),
        (
            '<equality><joint joint1="left" joint2="third" polycoef="0 0.5"/><joint joint1="third" joint2="right"'
            ' polycoef="0.2 1.5"/></equality>',
            ("left",),
        ),
        ('<equality><joint joint1="right" polycoef="0.3"/></equality>', ("left", "third")),
        (f'{TENDONS}<equality><tendon tendon1="t" polycoef="0.05"/></equality>', ("left", "third")),
        (f'{TENDONS}<equality><tendon tendon1="u" polycoef="0.05"/></equality>', ("left", "right")),
        ('<equality><joint joint1="right" joint2="left" active="false"/></equality>', ("left", "right", "third")),
    ],
)
def test_linear_equalities_make_mimic_joints(equalities, leaders, rng):
    """In either direction, in chains, as constants and of tendons: MuJoCo finds each kept wherever leaders stand."""
    text = fingers(equalities)
    tips = [name for name in ("left", "right", "third") if name != "right" or 'polycoef="0.3"' not in text]
    tips = [name for name in tips if name != "third" or 'tendon1="u"' not in text]
    robot, judge = mq.Robot.from_mjcf(text, tip=tips), Judge(text)
    assert robot.joint_names == ("rail", *leaders)
    for _ in range(5):
        q = robot.random_configuration(rng)
        placed = {name: robot.forward(q, name).translation for name in ("left", "right", "third")}
        judge.place(rail=q[0], **{name: placed[name][2] + 0.1 * k for k, name in enumerate(placed)})
        for name in placed:
            assert judge.pose(name)[:3, 3] == pytest.approx(placed[name])
        error, rows = judge.equality_error()
        assert rows == (0 if "false" in text else equalities.count("joint1") + equalities.count("tendon1"))
        assert error < 1e-9


def test_equalities_that_contradict_each_other_are_refused():
    text = fingers(
        '<equality><joint joint1="right" joint2="left"/>'
        '<joint joint1="right" joint2="left" polycoef="0.1 1"/></equality>'
    )
    with pytest.raises(RobotError, match="contradict each other, of the joints left, right"):
        mq.Robot.from_mjcf(text, tip="right")


@pytest.mark.parametrize(
    ("equalities", "told"),
    [
        ('<equality><connect body1="right" body2="left" anchor="0 0 0"/></equality>', "'number 0' closes a loop"),
        ('<equality><weld name="w" body1="right" body2="left"/></equality>', "'w' closes a loop"),
    ],
)
def test_what_is_not_kept_is_logged_where_it_matters(equalities, told, caplog):
    with caplog.at_level(logging.WARNING):
        robot = mq.Robot.from_mjcf(fingers(equalities), tip="right")
        assert told in caplog.text
        assert robot.n == 2
        caplog.clear()
        mq.Robot.from_mjcf(fingers(equalities), tip="rail")
        assert caplog.text == ""


FLOATING = """<mujoco><worldbody>
  <body name="ball"><freejoint/><geom size="0.1"/></body>
  <body name="trunk" pos="0 0 1"><freejoint name="root"/><geom size="0.1"/>
    <body name="hip" pos="0.1 0 0"><joint name="hip" range="-50 50"/><geom size="0.1"/>
      <body name="foot" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" range="-50 50"/><geom size="0.1"/></body></body>
    <body name="shoulder" pos="-0.1 0 0"><joint name="shoulder" type="ball"/><geom size="0.1"/>
      <body name="hand" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" range="-50 50"/><geom size="0.1"/></body></body>
  </body></worldbody></mujoco>"""


def test_the_base_is_the_body_on_the_free_joint(rng):
    robot, judge = mq.Robot.from_mjcf(FLOATING, tip="foot"), Judge(FLOATING)
    assert (robot.base, robot.joint_names) == ("trunk", ("hip", "knee"))
    q = robot.random_configuration(rng)
    judge.place(hip=q[0], knee=q[1], root=[1, 2, 3, *Rotation.random(random_state=rng).as_quat(scalar_first=True)])
    expected = np.linalg.inv(judge.pose("trunk")) @ judge.pose("foot")
    assert np.abs(robot.forward(q).homogeneous - expected).max() < 1e-12


def test_joints_of_several_numbers_on_the_way_are_refused():
    with pytest.raises(
        RobotError, match="'shoulder' is a ball joint, which is not supported; start behind it, base='sh"
    ):
        mq.Robot.from_mjcf(FLOATING, tip="hand")
    assert mq.Robot.from_mjcf(FLOATING, tip="hand", base="shoulder").joint_names == ("elbow",)
    with pytest.raises(RobotError, match=r"'root' is floating, .* base='trunk'"):
        mq.Robot.from_mjcf(FLOATING, tip="foot", base="world")


def test_limits_that_are_missing_are_given_at_load():
    text = (
        '<mujoco><worldbody><body name="b"><joint name="x" type="slide"/><geom size="1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(RobotError, match=r"joint 'x' is prismatic but has no limits.*limits=\{'x': \(lower, upper\)\}"):
        mq.Robot.from_mjcf(text)
    assert mq.Robot.from_mjcf(text, limits={"x": (-1, 2)}).upper.tolist() == [2]


SHAPES = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="0 0 1" pos="0 0 -2"/>
  <body name="a"><joint name="a" range="-180 180"/>
    <geom name="box" type="box" size="0.1 0.2 0.3" pos="0.5 0 0" euler="10 20 30" group="1"/>
    <body name="b" pos="1 0 0"><joint name="b" axis="0 1 0" range="-180 180"/>
      <geom name="capsule" type="capsule" fromto="0 0 0 0.3 0.2 0.1" size="0.05"/>
      <body name="c" pos="0 0.5 0"><joint name="c" axis="1 0 0" range="-180 180"/>
        <geom name="cylinder" type="cylinder" size="0.1 0.2" pos="0 0.1 0.3" quat="1 1 0 0"/>
        <geom name="look" type="sphere" size="0.3" contype="0" conaffinity="0" rgba="1 0 0 1"/>
        <body name="d" pos="0 0.5 0"><joint name="d" axis="0 0 1" range="-180 180"/>
          <geom name="ball" type="ellipsoid" size="0.07 0.12 0.03" pos="0.2 0 0" euler="40 20 0"/><site name="tip"/>
        </body></body></body></body>
  </worldbody>
  <contact><exclude body1="d" body2="a"/></contact>
  <keyframe><key name="home" qpos="0.1 0.2 0.3 0.4"/><key qpos="0 0 0 1"/></keyframe></mujoco>"""


def test_distances_are_those_of_mujoco(rng):
    """Of all pairs that may collide: primitives stand where MuJoCo has them, a plane as a box below it."""
    robot, judge = mq.Robot.from_mjcf(SHAPES, tip="tip"), Judge(SHAPES)
    limit = mq.CollisionLimit(margin=0.0, influence=10.0).of(robot)
    geoms = {"a": "box", "b": "capsule", "c": "cylinder", "d": "ball", "world": "floor"}
    pairs = {frozenset((limit.scene.parts[i].name, limit.scene.parts[j].name)) for i, j in limit.scene.pairs}
    assert pairs == {
        frozenset(each) for each in (("a", "c"), ("b", "d"), ("world", "b"), ("world", "c"), ("world", "d"))
    }
    for _ in range(10):
        q = robot.random_configuration(rng)
        judge.place(**dict(zip("abcd", q, strict=True)))
        contacts = limit.scene.contacts(q, 10.0)
        for index, distance in zip(contacts.pairs, contacts.distances, strict=True):
            first, second = (judge.model.geom(geoms[limit.scene.parts[k].name]).id for k in limit.scene.pairs[index])
            expected = mujoco.mj_geomDistance(judge.model, judge.data, first, second, 20.0, None)
            if min(expected, distance) > 0:
                assert distance == pytest.approx(expected, abs=1e-5)


def test_keyframes_are_states():
    robot = mq.Robot.from_mjcf(SHAPES, tip="tip")
    assert robot.states == ("home", "key1")
    assert robot.state("home").tolist() == [0.1, 0.2, 0.3, 0.4]
    assert mq.Robot.from_mjcf(SHAPES, tip="c").limited(margin=0.1).state("home").tolist() == [0.1, 0.2, 0.3]


def test_a_body_may_touch_the_one_that_carries_it():
    """Also where two joints are between them; the world does not count, as MuJoCo has it."""
    text = SHAPES.replace('<joint name="b" axis="0 1 0" range="-180 180"/>', '<joint name="b"/><joint name="e"/>')
    touching = mq.Robot.from_mjcf(text.split("<keyframe>")[0] + "</mujoco>", tip="tip").semantics.touching
    assert {frozenset(pair) for pair in ("ab", "bc", "cd", "ad")} == touching


def test_pairs_that_contype_keeps_apart_may_touch():
    text = SHAPES.replace('group="1"', 'contype="2" conaffinity="4"')
    robot = mq.Robot.from_mjcf(text, tip="tip")
    assert frozenset(("a", "c")) in robot.semantics.touching
    assert frozenset(("b", "d")) not in robot.semantics.touching


def test_files_of_meshes_are_not_opened_and_stand_where_mujoco_puts_them(tmp_path, rng):
    """Scale, reference position and rotation of a mesh are in the shape; a missing file matters only to collisions."""
    points = rng.normal(size=(5, 3))
    faces = "f 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 3 4\nf 5 2 3\nf 5 1 2\nf 5 1 3\nf 5 4 1\nf 5 3 4\nf 5 2 4\n"
    text = (
        '<mujoco><compiler meshdir="parts"/><asset><mesh name="m" file="m.obj" scale="0.5 0.5 0.5" refpos="1 2 3"'
        ' refquat="1 2 3 4" inertia="convex"/><texture name="t" type="2d" file="none.png"/>'
        '<material name="w" texture="t"/></asset>'
        '<worldbody><body name="a"><joint name="a" range="0 90"/>'
        '<geom type="mesh" mesh="m" pos="1 0 0" euler="30 40 50" material="w"/></body></worldbody></mujoco>'
    )
    (tmp_path / "arm.xml").write_text(text)
    robot = mq.Robot.from_mjcf(tmp_path / "arm.xml")
    assert 'filename="' + str(tmp_path / "parts" / "m.obj") in robot.urdf
    assert "<inertial>" not in robot.urdf
    (tmp_path / "parts").mkdir()
    vertices = "".join(f"v {words(point)}\n" for point in points)
    (tmp_path / "parts" / "m.obj").write_text(vertices + faces)
    (shape,) = (shape for _, shape in link_shapes(robot))
    model = mujoco.MjModel.from_xml_string(
        text.replace('<texture name="t" type="2d" file="none.png"/>', "").replace(' texture="t"', ""),
        {"m.obj": (vertices + faces).encode()},
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    expected = model.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    found = np.array([shape.pose.act(0.5 * point) for point in points])
    assert max(np.linalg.norm(found - point, axis=1).min() for point in expected) < 1e-5


def test_all_of_it_pickles_and_solves(rng):
    robot = mq.Robot.from_mjcf(SHAPES, tip="tip").limited(velocity=1.0)
    again = pickle.loads(pickle.dumps(robot))
    assert again == robot
    assert again.states == robot.states
    q = robot.random_configuration(rng)
    other = mq.Robot.from_urdf(robot.urdf, tip="tip")
    assert np.abs(other.forward(q).homogeneous - robot.forward(q).homogeneous).max() < 1e-12


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot name='r'/>", "outermost element is <robot>, not <mujoco>; a URDF goes to Robot.from_urdf"),
        ("<mujocoinclude/>", "not <mujoco>, a part that other files include"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "no joint moves|choose one|world"),
        ("<mujoco><worldbody><nonsense/></worldbody></mujoco>", "MuJoCo cannot use the MJCF text: .*nonsense"),
        ("<!DOCTYPE x [<!ENTITY a 'a'>]><mujoco/>", "document type"),
    ],
)
def test_what_is_no_model_is_refused(text, message):
    if "<joint/>" in text:
        assert mq.Robot.from_mjcf(text).tip == "body1"
        return
    with pytest.raises(RobotError, match=message):
        mq.Robot.from_mjcf(text)
