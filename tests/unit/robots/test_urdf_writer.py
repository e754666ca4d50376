"""The URDF that a DH table becomes: accepted by others, the same arm to 1e-12, clean to look at, up to date."""

import io
import re
import shutil
import subprocess
from math import pi
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from support.made_robots import random_table

import maira_qp as mq
from maira_qp.errors import RobotError
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model import catalog
from maira_qp.robots.urdf.writer import urdf_text

EVERYTHING = DHTable(
    [
        DHLink(d=0.4, alpha=-pi / 2, theta=pi / 2, velocity=2.5, effort=77.0),
        DHLink(kind="fixed", a=0.1, alpha=0.3, theta=-0.7, name="spacer"),
        DHLink(kind="prismatic", d=0.1, lower=-0.05, upper=0.6, name="slide"),
        DHLink(kind="continuous", a=-0.3, alpha=pi / 2, theta=pi / 2),
        DHLink(a=0.2, theta=0.4, lower=-1.2345678901234567, upper=2),
        DHLink(kind="fixed", d=-0.1),
    ],
    name="everything",
)


def joints(text):
    return {joint.get("name"): joint for joint in ElementTree.fromstring(text).iter("joint")}


def test_the_file_at_the_root_is_up_to_date():
    """Remake it with `maira-qp urdf --output maira.urdf` when the table or the writer changes."""
    path = Path(__file__).parents[3] / "maira.urdf"
    assert path.read_text(encoding="utf-8") == urdf_text(catalog.maira())


@pytest.mark.skipif(shutil.which("check_urdf") is None, reason="check_urdf, of Debian's liburdfdom-tools, is missing")
@pytest.mark.parametrize("table", [catalog.maira(), catalog.iiwa14(), EVERYTHING], ids=lambda table: table.name)
def test_check_urdf_accepts_it(table, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(urdf_text(table), encoding="utf-8")
    done = subprocess.run(["check_urdf", path], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Successfully Parsed XML" in done.stdout
    assert not re.search("error|warn", done.stdout + done.stderr, re.IGNORECASE)
    assert len(re.findall(r"child\(\d", done.stdout)) == len(table.links) + 1


@pytest.mark.parametrize("table", [catalog.maira(), catalog.iiwa14(), EVERYTHING], ids=lambda table: table.name)
def test_a_second_library_computes_the_same_poses(table, rng):
    """yourdfpy shares no code with Pinocchio nor with us."""
    other = yourdfpy.URDF.load(io.StringIO(urdf_text(table)), load_meshes=False)
    assert tuple(other.actuated_joint_names) == table.joint_names
    for _ in range(50):
        q = rng.uniform(-1, 1, table.n)
        other.update_cfg(q)
        assert np.abs(other.get_transform("tool0", "base_link") - table.forward(q)).max() < 1e-12


def test_limits_axes_and_kinds_are_the_tables():
    found = joints(urdf_text(EVERYTHING))
    assert [joint.get("type") for joint in found.values()] == [
        *("revolute", "fixed", "prismatic", "continuous", "revolute", "fixed", "fixed")
    ]
    assert list(found) == ["joint1", "spacer", "slide", "joint3", "joint4", "fixed6", "tool0_joint"]
    limits = {name: joint.find("limit") for name, joint in found.items() if joint.get("type") != "fixed"}
    assert limits["joint1"].attrib == {"lower": repr(-pi), "upper": repr(pi), "effort": "77", "velocity": "2.5"}
    assert limits["slide"].attrib["lower"] == "-0.05"
    assert set(limits["joint3"].attrib) == {"effort", "velocity"}
    assert float(limits["joint4"].get("lower")) == -1.2345678901234567
    assert all(joint.find("axis").get("xyz") == "0 0 1" for name, joint in found.items() if name in limits)


def test_numbers_are_exact_and_zeros_are_zeros(rng):
    """Every length and angle of the table is in the text to the bit; no -0, no 6e-17 that means 0."""
    for table in (catalog.maira(), catalog.iiwa14()):
        text = urdf_text(table)
        origins = [joint.find("origin") for joint in joints(text).values()]
        assert [float(origin.get("xyz").split()[2]) for origin in origins[1:]] == [link.d for link in table.links]
        assert [float(origin.get("rpy").split()[0]) for origin in origins[1:]] == [link.alpha for link in table.links]
    for table in (catalog.maira(), EVERYTHING, *(random_table(rng, 6) for _ in range(30))):
        assert not re.findall(r'[" ](-0|-0\.0|[-\d.]+e-1[5-9])[" ]', urdf_text(table))


def test_rows_that_meet_at_a_gimbal_lock(rng):
    """Rx(alpha) Rz(theta) with both at ±90° has a pitch of ±90°, where roll and yaw are not unique."""
    for alpha in (pi / 2, -pi / 2):
        for theta in (pi / 2, -pi / 2, pi / 2 + 1e-9, pi / 2 - 1e-5):
            table = DHTable([DHLink(a=1, d=0.5, alpha=alpha), DHLink(a=1, theta=theta, alpha=0.3), DHLink(a=1, d=0.2)])
            robot = mq.Robot.from_dh(table)
            q = robot.random_configuration(rng)
            assert np.abs(robot.forward(q).homogeneous - table.forward(q)).max() < 1e-14


def test_the_text_is_always_the_same():
    assert urdf_text(EVERYTHING) == urdf_text(DHTable(EVERYTHING.links, name="everything"))
    assert urdf_text(EVERYTHING).endswith("</robot>\n")


def test_names_are_escaped(tmp_path):
    """Quotes, brackets and ampersands in names come back as they were."""
    table = DHTable([DHLink(name="a\"<&>'b"), DHLink(name="ä b")], name='<robot name="x">')
    robot = mq.Robot.from_dh(table)
    assert robot.name == table.name
    assert robot.joint_names == table.joint_names
    assert ElementTree.fromstring(urdf_text(table)).get("name") == table.name


@pytest.mark.parametrize("name", ["a\x00b", "a\nb", "\x1b[31m", "\ud800", "\uffff"])
def test_names_that_xml_cannot_hold_are_refused(name):
    for make in (lambda: urdf_text(DHTable([DHLink()], name=name)), lambda: urdf_text(DHTable([DHLink(name=name)]))):
        with pytest.raises(RobotError, match="holds characters that URDF cannot"):
            make()


def test_fixed_rows_get_names_of_their_own():
    """Whatever the moving joints, and other fixed rows, are called."""
    table = DHTable(
        [
            DHLink(name="tool0_joint"),
            DHLink(kind="fixed", name="tool0_joint"),
            DHLink(name="fixed4"),
            DHLink(kind="fixed"),
            DHLink(kind="fixed", name="fixed4"),
        ]
    )
    names = list(joints(urdf_text(table)))
    assert len(set(names)) == len(names) == 6
    assert mq.Robot.from_dh(table).joint_names == ("tool0_joint", "fixed4")


def shapes(robot, kind):
    return pin.buildGeomFromUrdfString(robot.model, robot.urdf, kind).geometryObjects


@pytest.mark.parametrize("scale", [1e-3, 1, 1e3])
def test_shapes_are_scaled_to_the_arm(scale):
    links = [DHLink(d=link.d * scale, alpha=link.alpha) for link in catalog.maira().links]
    robot = mq.Robot.from_dh(DHTable(links))
    for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION):
        radii = [shape.geometry.radius for shape in shapes(robot, kind)]
        assert min(radii) > 0.01 * scale
        assert max(radii) < 0.15 * scale


def test_an_arm_without_lengths_still_has_shapes():
    assert shapes(mq.Robot.from_dh([{}]), pin.GeometryType.VISUAL)[0].geometry.radius > 0


LEGS = [DHLink(a=0.7, d=0.3, alpha=0.4), DHLink(a=-0.4), DHLink(d=-0.2, alpha=1.0), DHLink(a=0.3, d=0.1)]


@pytest.mark.parametrize("table", [catalog.maira(), DHTable(LEGS, name="legs")], ids=lambda table: table.name)
def test_rods_lead_from_joint_to_joint(table, rng):
    """In any posture the visual rods lead from each DH frame along z by d, then along x by a, to the next."""
    robot = mq.Robot.from_dh(table)
    q = robot.random_configuration(rng)
    expected = []
    for link, before, after in zip(table.links, table.compute_htms(q)[:-1], table.compute_htms(q)[1:], strict=True):
        corner = before[:3, 3] + link.d * before[:3, 2]
        expected += [(before[:3, 3], corner)] if link.d else []
        expected += [(corner, after[:3, 3])] if link.a else []
    geometry = pin.buildGeomFromUrdfString(robot.model, robot.urdf, pin.GeometryType.VISUAL)
    data, geometry_data = robot.model.createData(), geometry.createData()
    pin.forwardKinematics(robot.model, data, q)
    pin.updateGeometryPlacements(robot.model, data, geometry, geometry_data)
    radius = 0.03 * sum(np.hypot(link.a, link.d) for link in table.links)
    ends = []
    for shape, placement in zip(geometry.geometryObjects, geometry_data.oMg, strict=True):
        if shape.name.startswith("link") and shape.geometry.radius == pytest.approx(radius, rel=1e-2):
            half = np.array([0, 0, shape.geometry.halfLength])
            ends.append((placement.act(-half), placement.act(half)))
    assert len(ends) == len(expected)
    for found, wanted in zip(ends, expected, strict=True):
        apart = [np.abs(np.subtract(found, order)).max() for order in (wanted, wanted[::-1])]
        assert min(apart) < 1e-5


@pytest.mark.parametrize("make", [mq.Robot.maira, mq.Robot.iiwa14])
def test_links_apart_from_each_other_do_not_touch_in_plain_postures(make):
    """Upright, with shoulder or elbow at a right angle: no two links that are not neighbours collide."""
    robot = make()
    geometry = pin.buildGeomFromUrdfString(robot.model, robot.urdf, pin.GeometryType.COLLISION)
    ranks = [robot.frames.index(robot.model.frames[shape.parentFrame].name) for shape in geometry.geometryObjects]
    assert set(ranks) == set(range(8))
    for i, first in enumerate(ranks):
        for j, second in enumerate(ranks):
            if second - first > 1:
                geometry.addCollisionPair(pin.CollisionPair(i, j))
    data, geometry_data = robot.model.createData(), geometry.createData()

    def collides(**degrees):
        q = np.zeros(7)
        for joint, angle in degrees.items():
            q[int(joint[1:]) - 1] = np.deg2rad(angle)
        return pin.computeCollisions(robot.model, data, geometry, geometry_data, q, False)

    assert not collides()
    assert not any(collides(A2=a, A4=b, A6=c) for a in (-90, 0, 90) for b in (-90, 0, 90) for c in (-60, 0, 60))
    assert collides(A2=60, A4=179)  # folded up
