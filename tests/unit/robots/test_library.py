"""Robots by name: each name means one robot, whatever is installed, and nothing is downloaded."""

import sys
import types

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import FrameError, RobotError
from maira_qp.robots.library import packages
from maira_qp.robots.library.names import ENTRIES, entry_of

ARM = (
    '<robot name="arm"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    '<child link="b"/><limit lower="-1" upper="1"/></joint></robot>'
)


def test_every_listed_robot_loads(rng):
    """With its own tips, by its short name and with its package."""
    assert set(mq.Robot.available()) == {entry.name for entry in ENTRIES}
    for name in ("maira", "panda", "tiago_dual", "kr210", "talos", "z1"):
        robot = mq.Robot.load(name)
        assert robot == mq.Robot.load(entry_of(name).qualified)
        assert robot.n >= 6
    assert len({entry.name for entry in ENTRIES}) == len(ENTRIES)


def test_a_name_is_the_robot_of_the_file():
    panda = mq.Robot.load("panda")
    assert panda.urdf == load("panda").urdf
    assert panda.state("default").shape == (7,)
    assert mq.Robot.load("maira") == mq.Robot.maira() == mq.Robot.load("MAIRA")
    assert entry_of("UR5") == entry_of("Example-Robot-Data/ur5") == entry_of("ur5")
    assert mq.Robot.load("maira", tip="link4").n == 4
    assert mq.Robot.load("panda", tip="panda_link4", base="panda_link1").joint_names == (
        *("panda_joint2", "panda_joint3", "panda_joint4"),
    )
    assert mq.Robot.load("ur5", limits={"elbow_joint": (-1, 1)}).upper[2] == 1
    with pytest.raises(FrameError, match="the tip 'nope' is not a link"):
        mq.Robot.load("ur5", tip="nope")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pandda", "unknown robot 'pandda'; did you mean 'panda'"),
        ("UR55", "unknown robot 'UR55'; did you mean 'ur5'"),
        ("rtb-data/panda", "unknown robot 'rtb-data/panda'; did you mean 'panda'"),
        ("", "unknown robot ''; valid names: maira, iiwa14, .*ur5e_description"),
        (None, "unknown robot None"),
        ("../x_description", "unknown robot"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest(name, message):
    with pytest.raises(RobotError, match=message):
        mq.Robot.load(name)


def test_a_name_never_means_the_robot_of_another_package(monkeypatch):
    """Where its package is not installed, the message says which to install."""
    monkeypatch.setattr(packages, "distribution", lambda name: (_ for _ in ()).throw(packages.PackageNotFoundError))
    with pytest.raises(RobotError, match="a package that is not installed: pip install example"):
        mq.Robot.load("panda")
    assert "panda" not in mq.Robot.available()
    assert "kr210" in mq.Robot.available()


@pytest.fixture
def descriptions(monkeypatch, tmp_path):
    """A package like `robot_descriptions`; the folder of its cache."""
    package = types.ModuleType("robot_descriptions")
    package.__path__ = []
    parts = {"_descriptions": types.ModuleType("d"), "_repositories": types.ModuleType("r")}
    parts["_descriptions"].DESCRIPTIONS = {"arm_description": types.SimpleNamespace(repository="arms")}
    parts["_repositories"].REPOSITORIES = {"arms": types.SimpleNamespace(cache_path="arms", commit="abc", url="")}
    module = types.ModuleType("m")
    module.URDF_PATH = str(tmp_path / "arms" / "arm.urdf")
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    for name, part in {**parts, "arm_description": module}.items():
        monkeypatch.setitem(sys.modules, f"robot_descriptions.{name}", part)
    monkeypatch.setattr(packages, "find_spec", lambda name: package)
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path))
    monkeypatch.delenv("ROBOT_DESCRIPTION_COMMIT", raising=False)
    return tmp_path


def test_robot_descriptions_are_taken_from_its_cache_alone(descriptions):
    cache = descriptions
    missing = "not downloaded unasked: python -m robot_descriptions pull arm_description"
    with pytest.raises(RobotError, match=missing):
        mq.Robot.load("arm_description")
    (cache / "arms" / ".git" / "refs" / "tags").mkdir(parents=True)
    (cache / "arms" / "arm.urdf").write_text(ARM)
    (cache / "arms" / ".git" / "HEAD").write_text("another\n")
    with pytest.raises(RobotError, match=missing):
        mq.Robot.load("arm_description")
    (cache / "arms" / ".git" / "HEAD").write_text("abc\n")
    assert mq.Robot.load("arm_description").n == 1
    assert mq.Robot.load("robot_descriptions/arm_description").tip == "b"
    (cache / "arms" / ".git" / "refs" / "tags" / "abc").write_text("def\n")
    with pytest.raises(RobotError, match=missing):
        mq.Robot.load("arm_description")
    with pytest.raises(RobotError, match=r"robot_descriptions has no 'leg_description'; .*arm_description"):
        mq.Robot.load("leg_description")


def test_an_srdf_beside_a_description_belongs_to_the_robot():
    """By rule: of several that of its name, else the only one of whose robot it is; none of another robot's."""
    touching = {name: len(mq.Robot.load(name).semantics.touching) for name in ("baxter", "pr2", "talos", "ur5", "ur3")}
    assert touching == {"baxter": 397, "pr2": 1161, "talos": 459, "ur5": 10, "ur3": 0}
    for name, state in (("z1", "home"), ("talos", "half_sitting"), ("kinova", "arm_up"), ("xarm7", "home")):
        assert state in mq.Robot.load(name).states
    for name in ("baxter", "talos", "ur5"):  # whose shapes overlap without it
        robot = mq.Robot.load(name)
        limit = mq.CollisionLimit(margin=0.0).of(robot)
        assert limit.distance(robot.at(robot.middle)) > 0


def test_which_srdf_it_is(tmp_path):
    (tmp_path / "arm" / "urdf").mkdir(parents=True)
    (tmp_path / "arm" / "srdf").mkdir()
    urdf = tmp_path / "arm" / "urdf" / "long_arm.urdf"

    def beside(*names, **files):
        for old in (tmp_path / "arm").glob("*/*.srdf"):
            old.unlink()
        for name, robot in files.items():
            (tmp_path / "arm" / "srdf" / f"{name}.srdf").write_text(
                robot if "<" in robot else f'<robot name="{robot}"/>'
            )
        found = packages.srdf_beside(urdf, *names)
        return None if found is None else found.stem

    assert beside("arm", "long_arm") is None
    assert beside("arm", "long_arm", long_arm="x", arm_gripper="arm") == "long_arm"
    assert beside("arm", "long_arm", long_arm="x", arm="x") == "arm"
    assert beside("arm", "long_arm", arm_gripper="arm", other="legs", broken="<robot") == "arm_gripper"
    assert beside("arm", "long_arm", one="arm", two="arm") is None


XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="length" default="1"/>
  <link name="a"/><link name="b"/><link name="c"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit lower="-1" upper="${pi / 2}"/></joint>
  <joint name="f" type="fixed"><parent link="b"/><child link="c"/><origin xyz="$(arg length) 0 0"/></joint></robot>"""


def test_xacro_is_expanded(tmp_path):
    pytest.importorskip("xacro")
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(XACRO)
    robot = mq.Robot.from_urdf(path, xacro_args={"length": 2.5})
    assert robot.upper == pytest.approx([np.pi / 2])
    assert robot.forward([0]).translation == pytest.approx([2.5, 0, 0])
    assert mq.Robot.from_urdf(path, tip="b").n == 1
    path.write_text(XACRO.replace("pi / 2", "nonsense"))
    with pytest.raises(RobotError, match=r"xacro cannot expand arm.urdf.xacro: .*nonsense"):
        mq.Robot.from_urdf(path)


def test_xacro_where_it_cannot_be_used(tmp_path, monkeypatch):
    path = tmp_path / "arm.urdf.xacro"
    with pytest.raises(RobotError, match="cannot open the robot description"):
        mq.Robot.from_urdf(path)
    path.write_text(XACRO)
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(RobotError, match=r"arm.urdf.xacro is xacro, .* pip install 'maira-qp\[xacro\]'"):
        mq.Robot.from_urdf(path)
    with pytest.raises(ValueError, match="xacro_args must be a mapping"):
        mq.Robot.from_urdf(path, xacro_args=[1])
    with pytest.raises(ValueError, match=r"xacro_args go with the path of a \.xacro file"):
        mq.Robot.from_urdf(ARM, xacro_args={})
