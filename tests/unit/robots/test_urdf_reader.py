"""The URDF reader: what is kept and fixed, and a clear error for every description that cannot be used."""

import math
import os
import threading
from itertools import pairwise, permutations
from math import pi
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from support.robots import load, urdf_file
from support.whole_model import WholeModel

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, RobotError
from maira_qp.orientation import pose_error
from maira_qp.robots.urdf.reader import read_urdf

LIMIT = '<limit lower="-1" upper="2" velocity="3" effort="4"/>'


def joint(name, parent, child, inside=LIMIT, kind="revolute", axis="0 0 1"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 1"/><axis xyz="{axis}"/>{inside}</joint>'
    )


def robot(*parts, links="abc"):
    return '<robot name="r">' + "".join(f'<link name="{link}"/>' for link in links) + "".join(parts) + "</robot>"


TWO = (joint("ab", "a", "b"), joint("bc", "b", "c", axis="0 2 0"))


def joint_elements(chain):
    return {element.get("name"): element for element in ElementTree.fromstring(chain.urdf).iter("joint")}


def test_a_chain_is_what_its_text_says():
    chain = read_urdf(robot(*TWO))
    assert (chain.name, chain.base, chain.tip) == ("r", "a", "c")
    assert chain.joint_names == ("ab", "bc")
    assert chain.frames == ("a", "b", "c")
    assert chain.lower.tolist() == [-1, -1]
    assert chain.upper.tolist() == [2, 2]
    assert chain.velocity.tolist() == [3, 3]
    assert chain.effort.tolist() == [4, 4]
    assert joint_elements(chain)["bc"].find("axis").get("xyz") == "0.0 1.0 0.0"


@pytest.mark.parametrize("encoding", ["gb2312", "latin-1", "utf-16-le", "utf-16-be", "utf-8"])
@pytest.mark.parametrize("start", ["", "\n", " \n\n"])
def test_files_are_read_right_in_encodings_that_they_do_not_declare(tmp_path, encoding, start):
    """Blank lines before the text, which may be a byte too many for UTF-16 read as something, change nothing."""
    name = "\u5173\u8282" if encoding == "gb2312" else "gr\u00f6\u00dfe"
    text = start + robot(*TWO).replace('name="r"', f'name="{name}"')
    path = tmp_path / "r.urdf"
    path.write_bytes(text.encode(encoding))
    assert read_urdf(path).name == name


def test_a_declaration_that_the_bytes_contradict_does_not_count(tmp_path):
    path = tmp_path / "r.urdf"
    text = robot(*TWO).replace('name="r"', 'name="r\u00f6"')
    for declared, encoding in (("utf-16", "utf-8"), ("utf-8", "latin-1"), ("gbk", "utf-8-sig"), ("utf-8", "utf-16")):
        path.write_bytes((f'<?xml version="1.0" encoding="{declared}"?>' + text).encode(encoding))
        assert read_urdf(path).name == "r\u00f6"
    path.write_bytes(('<?xml version="1.0" encoding="gbk"?>' + text.replace("\u00f6", "\u5173")).encode("gbk"))
    assert read_urdf(path).name == "r\u5173"


def test_text_may_begin_with_a_byte_order_mark_and_blank_lines():
    text = '\ufeff\n  <?xml version="1.0"?>\n' + robot(*TWO)
    assert read_urdf(text) == read_urdf(robot(*TWO))


@pytest.mark.parametrize(
    ("encoding", "declared"),
    [
        ("utf-8", None),
        ("utf-8-sig", "utf-8"),
        ("utf-16", "utf-16"),
        ("latin-1", "iso-8859-1"),
        ("cp1252", "windows-1252"),
    ],
)
def test_files_are_read_in_the_encoding_they_declare(tmp_path, encoding, declared):
    text = robot(*TWO).replace('name="r"', 'name="r\u00f6"')
    path = tmp_path / "r.urdf"
    path.write_bytes(((f'<?xml version="1.0" encoding="{declared}"?>' if declared else "") + text).encode(encoding))
    assert read_urdf(path).name == read_urdf(str(path)).name == "r\u00f6"


def test_only_the_chain_moves_and_the_rest_is_fixed_at_rest():
    """A joint beside the chain stands at zero, or at the limit nearest to zero, whatever its kind."""
    beside = [
        joint("bs", "b", "s", '<limit lower="0.5" upper="1" velocity="1" effort="1"/>', axis="0 0 3"),
        joint("sp", "s", "p", '<limit lower="-2" upper="-0.25" velocity="1" effort="1"/>', "prismatic", "1 0 0"),
        joint("pf", "p", "f", "", "floating"),
        joint("fl", "f", "l", "", "planar"),
        joint("lc", "l", "t", "", "continuous"),
    ]
    chain = read_urdf(robot(*TWO, *beside, links="abcspflt"), tip="c")
    joints = joint_elements(chain)
    assert chain.joint_names == ("ab", "bc")
    assert {name for name, element in joints.items() if element.get("type") == "fixed"} == {
        "bs",
        "sp",
        "pf",
        "fl",
        "lc",
    }
    T = mq.Robot.from_urdf(chain.urdf, tip=chain.tips, base=chain.base).forward([0, 0], "t")
    c, s = math.cos(0.5), math.sin(0.5)
    assert T.rotation == pytest.approx(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), abs=1e-15)
    assert T.translation == pytest.approx([-0.25 * c, -0.25 * s, 6], abs=1e-15)


def test_a_slide_beside_the_chain_rests_along_its_own_turned_axis():
    slide = joint("bs", "b", "s", '<limit lower="2" upper="3"/>', "prismatic", "1 0 0").replace(
        'xyz="0 0 1"', 'xyz="0 0 1" rpy="0 0 1.5707963267948966"', 1
    )
    made = mq.Robot.from_urdf(robot(*TWO, slide, links="abcs"), tip="c")
    assert made.forward([0, 0], "s").translation == pytest.approx([0, 2, 2], abs=1e-15)


def test_the_part_below_the_base_is_kept_and_no_more():
    chain = read_urdf(robot(*TWO, joint("ax", "a", "x"), joint("cd", "c", "d", "", "fixed"), links="abcdx"), "c", "b")
    assert chain.frames == ("b", "c", "d")
    assert chain.joint_names == ("bc",)


def test_bodies_stay_and_foreign_parts_go():
    body = '<link name="b"><visual><geometry><mesh filename="package://no/such.stl"/></geometry></visual><inertial/></link>'
    text = robot(*TWO, "<gazebo/><transmission/>", links="ac").replace('<link name="c"/>', body + '<link name="c"/>')
    chain = read_urdf(text)
    assert "package://no/such.stl" in chain.urdf
    assert "gazebo" not in chain.urdf
    assert "transmission" not in chain.urdf
    assert mq.Robot.from_urdf(chain.urdf, tip=chain.tips, base=chain.base).n == 2


def test_masses_that_make_no_sense_do_not_stop_kinematics(capfd):
    """Nor does Pinocchio print about them."""
    inertial = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" {}/></inertial>'
    for words in (("nan", 'ixy="0" ixz="0" iyz="0"'), ("1", ""), ("one", 'ixy="0" ixz="0" iyz="0"')):
        text = robot(*TWO).replace('<link name="b"/>', f'<link name="b">{inertial.format(*words)}</link>')
        assert mq.Robot.from_urdf(text).forward([0, 0]).translation.tolist() == [0, 0, 2]
    assert capfd.readouterr() == ("", "")


def test_axes_are_normalised_at_every_size():
    for size in (1e-200, 1e-5, 1, 3, 1e200):
        chain = read_urdf(robot(joint("ab", "a", "b", axis=f"{3 * size} 0 {-4 * size}"), links="ab"))
        axis = [float(word) for word in joint_elements(chain)["ab"].find("axis").get("xyz").split()]
        assert axis == pytest.approx([0.6, 0, -0.8], abs=1e-15)


def test_the_default_axis_is_x_and_the_default_origin_the_parent():
    text = robot(f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/>{LIMIT}</joint>', links="ab")
    assert mq.Robot.from_urdf(text).jacobian([0.0])[:, 0].tolist() == [0, 0, 0, 1, 0, 0]


def test_a_continuous_joint_has_no_limits_even_if_some_are_written():
    chain = read_urdf(robot(joint("ab", "a", "b", kind="continuous"), links="ab"))
    assert (chain.lower[0], chain.upper[0], chain.velocity[0]) == (-math.inf, math.inf, 3)
    assert joint_elements(chain)["ab"].get("type") == "continuous"


@pytest.mark.parametrize("ends", [("-inf", "inf"), ("-1e308", "1.797e308"), ("-1.8e16", "1e17")])
def test_a_revolute_joint_whose_limits_are_beyond_all_angles_is_continuous(ends):
    chain = read_urdf(robot(joint("ab", "a", "b", '<limit lower="{}" upper="{}"/>'.format(*ends)), links="ab"))
    assert (chain.lower[0], chain.upper[0]) == (-math.inf, math.inf)
    assert joint_elements(chain)["ab"].get("type") == "continuous"
    far = read_urdf(robot(joint("ab", "a", "b", '<limit lower="-1e16" upper="1e10"/>'), links="ab"))
    assert (far.lower[0], far.upper[0]) == (-1e16, 1e10)


def test_limits_given_at_load_take_the_place_of_those_in_the_text():
    """Of joints that have none, wrong ones or others, whatever the kind; beside the chain too."""
    for inside, kind in (
        ("", "revolute"),
        ("", "prismatic"),
        ('<limit lower="2" upper="1"/>', "revolute"),
        (LIMIT, "revolute"),
        ('<limit velocity="3"/>', "continuous"),
    ):
        text = robot(joint("ab", "a", "b", inside, kind), links="ab")
        made = mq.Robot.from_urdf(text, limits={"ab": (-0.5, 4)})
        assert (made.lower[0], made.upper[0]) == (-0.5, 4)
        assert made.limited(margin=0.5).upper == 3.5
    beside = robot(*TWO, joint("bs", "b", "s", "", "prismatic", "0 0 1"), links="abcs")
    made = mq.Robot.from_urdf(beside, tip="c", limits={"bs": (1, 2)})
    assert made.forward([0, 0], "s").translation.tolist() == [0, 0, 3]


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"no": (0, 1)}, "limits: 'no' is not a joint that moves; .*valid names: ab, bc"),
        ({"ab": (1, 0)}, "inverted"),
        ({"ab": 1}, "not the one number 1"),
        ({"ab": (0, math.inf)}, "must be finite"),
        ({"ab": (-1e300, 1e300)}, "too large"),
        ({None: (0, 1)}, "None is not a joint"),
        ([("ab", 0, 1)], "must be a mapping"),
    ],
)
def test_limits_given_at_load_must_make_sense(limits, message):
    with pytest.raises(OptionError, match=message):
        read_urdf(robot(*TWO), limits=limits)


UNNEEDED = [
    "<xacro:property name='x' value='${1}'/>",
    "<xacro:macro name='m' params='p'><link name='${p}'/></xacro:macro>",
    "<gazebo reference='b'><plugin file='$(find x)/y'/><xacro:if/></gazebo>",
    "<ros2_control><param>${x}</param></ros2_control>",
    "<!-- a -- b --->",
    joint("cd", "c", "d", '<limit lower="2" upper="1"/>'),
    joint("cd", "c", "d", ""),
    joint("cd", "c", "d", axis="0 0 0"),
    joint("cd", "c", "d", kind="hinge"),
    joint("cd", "c", "d", f"{LIMIT}<mimic/>"),
    joint("cd", "c", "d").replace("0 0 1", "${h}", 1),
    joint("cd", "c", "d").replace("0 0 1", "0 0 1e300", 1),
]


@pytest.mark.parametrize("part", UNNEEDED)
def test_what_the_chain_does_not_need_cannot_refuse_it(part):
    text = robot(*TWO, part, links="abc" + ("d" if "cd" in part else ""))
    made = mq.Robot.from_urdf(text, tip="c")
    assert made.joint_names == ("ab", "bc")
    assert made.forward([0, 0]).translation.tolist() == [0, 0, 2]
    assert mq.Robot.from_urdf(made.urdf, tip="c") == made


def test_what_cannot_be_placed_beside_the_chain_is_left_out_with_a_warning(caplog):
    nowhere = joint("cd", "c", "d").replace("0 0 1", "x y z", 1)
    made = mq.Robot.from_urdf(robot(*TWO, nowhere, joint("de", "d", "e"), links="abcde"), tip="c")
    assert made.frames == ("a", "b", "c")
    assert "joint 'cd', origin: xyz='x y z' is not made of numbers" in caplog.text
    with pytest.raises(RobotError, match="not made of numbers"):  # it carries a leader, and so what moves
        read_urdf(
            robot(
                joint("ab", "a", "b", f'{LIMIT}<mimic joint="de"/>'),
                joint("ad", "a", "d", "", "fixed").replace("0 0 1", "x y z", 1),
                joint("de", "d", "e"),
                links="abde",
            ),
            tip="b",
        )


def test_prefixes_that_the_root_declares_are_no_error_in_shapes():
    """Nor are those that nobody declares; foreign parts go."""
    shape = (
        '<visual my:id="1"><my:verbose/><geometry><box size="1 2 3"/></geometry></visual><collision><no:x/></collision>'
    )
    text = robot(*TWO).replace('<link name="b"/>', f'<link name="b">{shape}</link>')
    for declared in (text.replace("<robot", '<robot xmlns:my="http://x.y"'), text):
        chain = read_urdf(declared)
        assert 'size="1 2 3"' in chain.urdf
        assert "my:" not in chain.urdf
        assert mq.Robot.from_urdf(chain.urdf, tip=chain.tips, base=chain.base).limited(margin=0.1).n == 2


def test_a_relative_mesh_is_sought_beside_its_urdf(tmp_path, monkeypatch):
    """Not where the process runs; and still after the limits have changed, or the text has been written elsewhere."""
    body = '<link name="b"><collision><geometry><mesh filename="{}"/></geometry></collision></link>'
    text = robot(*TWO).replace(
        '<link name="b"/>', body.format("../meshes/b.stl") + body.format("no.stl").replace('"b"', '"x"')
    )
    text = text.replace("</robot>", joint("cx", "c", "x", "", "fixed") + "</robot>")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "urdf").mkdir()
    (tmp_path / "meshes" / "b.stl").write_bytes(b"")
    (tmp_path / "urdf" / "r.urdf").write_text(text)
    monkeypatch.chdir(tmp_path)
    made = mq.Robot.from_urdf("urdf/r.urdf", tip="c").limited(margin=0.1)
    names = [mesh.get("filename") for mesh in ElementTree.fromstring(made.urdf).iter("mesh")]
    assert names == [str(tmp_path / "meshes" / "b.stl"), "no.stl"]
    assert "../meshes/b.stl" in read_urdf(text, tip="c").urdf


def test_one_missing_limit_is_zero_as_the_format_says():
    chain = read_urdf(robot(joint("ab", "a", "b", '<limit upper="2" velocity="1" effort="1"/>'), links="ab"))
    assert (chain.lower[0], chain.upper[0]) == (0, 2)


def test_strange_names_survive():
    """Quotes, brackets, other alphabets, Pinocchio's own word, and one name for a link and a joint."""
    names = ['a"<&>', "关节", "universe", "0"]
    text = robot(
        joint("J0", "L0", "L1"), joint("J1", "L1", "L2"), joint("J2", "L2", "L3"), links=["L0", "L1", "L2", "L3"]
    )
    root = ElementTree.fromstring(text)
    for element in root.iter():
        for key, value in element.attrib.items():
            if value[0] in "LJ" and value[1:].isdigit():
                element.set(key, names[int(value[1:])])
    made = mq.Robot.from_urdf(ElementTree.tostring(root, encoding="unicode"))
    assert made.frames == tuple(names)
    assert made.joint_names == tuple(names[:3])
    assert made.forward(np.zeros(3), "universe").translation.tolist() == [0, 0, 2]


# Tips and bases


FORK = (*TWO, joint("bd", "b", "d"), joint("de", "d", "e"))


def test_several_tips_are_listed():
    both = r"2 tips, choose one \(tip='e'\) or several \(tip=\['e', 'c'\]\); valid names: e, c"
    with pytest.raises(FrameError, match=both):
        read_urdf(robot(*FORK, links="abcde"))


def test_the_tips_that_are_suggested_move_tools_first_then_the_deepest():
    """A camera that is fixed to the base is no tip; the link made for tools goes before the deeper finger."""
    parts = (joint("ac", "a", "camera", "", "fixed"), joint("bt", "c", "my_tcp", "", "fixed"), joint("cf", "c", "f"))
    links = ["a", "b", "c", "camera", "my_tcp", "f"]
    with pytest.raises(FrameError, match=r"2 tips, choose one \(tip='my_tcp'\) .*valid names: f, my_tcp$"):
        read_urdf(robot(*TWO, *parts, links=links))
    for name, tip in (("panda", "panda_hand_tcp"), ("ur5", "tool0"), ("pr2_arm", "r_gripper_tool_frame")):
        with pytest.raises(FrameError) as reason:
            read_urdf(urdf_file(name))
        assert "choose one (tip='" + tip in str(reason.value).replace("l_gripper", "r_gripper")
    still = robot(joint("ab", "a", "b", "", "fixed"), joint("ac", "a", "c", "", "fixed"))
    with pytest.raises(FrameError, match="no joint moves behind 'a'"):
        read_urdf(still)


def test_several_tips_make_a_tree_with_the_way_to_the_first_tip_first():
    text = robot(*FORK, joint("ax", "a", "x"), links="xabcde")
    for tips, joints in (
        (["c", "e"], ("ab", "bc", "bd", "de")),
        (("e", "c"), ("ab", "bd", "de", "bc")),
        (["d", "c"], ("ab", "bd", "bc")),
        (["x", "e", "c"], ("ax", "ab", "bd", "de", "bc")),
        (["c", "b", "x"], ("ab", "bc", "ax")),
        (["b", "e"], ("ab", "bd", "de")),
        (["c"], ("ab", "bc")),
    ):
        chain = read_urdf(text, tip=tips)
        assert chain.tips == tuple(tips)
        assert chain.tip == tips[0]
        assert chain.joint_names == joints
        moving = {name for name, element in joint_elements(chain).items() if element.get("type") == "revolute"}
        assert moving == set(joints)
    assert read_urdf(text, tip=["c"]) == read_urdf(text, tip="c") != read_urdf(text, tip=["c", "b"])


def test_the_order_of_the_file_does_not_decide_the_order_of_q():
    links = {read_urdf(robot(*parts, links="abcde"), ["e", "c"]).joint_names for parts in permutations(FORK)}
    assert links == {("ab", "bd", "de", "bc")}


def test_repeated_and_missing_tips_are_refused():
    with pytest.raises(FrameError, match=r"the tip 'c' is named twice in \['c', 'b', 'c'\]"):
        read_urdf(robot(*TWO), tip=["c", "b", "c"])
    for none in ([], ()):
        with pytest.raises(FrameError, match="the list of tips is empty; valid names: c, e"):
            read_urdf(robot(*FORK, links="abcde"), tip=none)


def test_every_tip_must_hang_on_the_base_and_move():
    text = robot(*FORK, joint("ax", "a", "x", "", "fixed"), links="abcdex")
    for still in ("a", "x"):
        with pytest.raises(RobotError, match=f"no joint moves between base and tip '{still}'"):
            read_urdf(text, tip=["c", still])


def test_unknown_tips_and_bases_are_refused_with_the_links_listed():
    with pytest.raises(FrameError, match="the tip 'gripper' is not a link of this robot; valid names: a, b, c"):
        read_urdf(robot(*TWO), tip="gripper")
    with pytest.raises(FrameError, match="the base 'cc' is not a link of this robot; did you mean 'c'"):
        read_urdf(robot(*TWO), base="cc")
    for wrong in (3, b"c", {"c"}, [["c"]], ["c", 3], [None], ["c", "no"]):
        with pytest.raises(FrameError, match=r"the tip .* is not a link"):
            read_urdf(robot(*TWO), tip=wrong)


def test_a_base_that_does_not_carry_the_tip_becomes_the_root():
    """The way up and down again, the whole way up, and a base that is a sibling of the chain's first link."""
    text = robot(*TWO, joint("bd", "b", "d"), joint("ax", "a", "x", "", "fixed"), links="abcdx")
    chain = read_urdf(text, tip="c", base="d")
    assert chain.joint_names == ("bd", "bc")
    assert chain.frames == ("d", "bd_origin", "b", "c", "a", "x")
    assert read_urdf(text, tip="a", base="c").joint_names == ("bc", "ab")
    assert read_urdf(text, tip="c", base="x").joint_names == ("ab", "bc")
    assert read_urdf(text, tip=["c", "d"], base="x").joint_names == ("ab", "bc", "bd")
    assert mq.Robot.from_urdf(text, tip="c", base="x").forward([0, 0]).translation.tolist() == [0, 0, 1]
    taken = text.replace('"x"', '"bd_origin"')
    assert read_urdf(taken, tip="c", base="d").frames == ("d", "bd_origin_", "b", "c", "a", "bd_origin")


@pytest.mark.parametrize(
    ("name", "base", "tip", "n"),
    [
        ("baxter_arms", "left_gripper", "right_gripper", 14),
        ("talos_arms", "arm_right_7_link", "arm_left_7_link", 14),
        ("pr2_arms", "l_gripper_tool_frame", "r_gripper_tool_frame", 14),
        ("tiago", "arm_tool_link", "base_footprint", 8),
        ("panda", "panda_leftfinger", "panda_link2", 6),
    ],
)
def test_a_way_that_goes_up_first_agrees_with_the_whole_model(name, base, tip, n, rng):
    """FK, Jacobian, names and limits, of revolute, sliding, continuous and fixed joints, there and back again."""
    whole, file = WholeModel(urdf_file(name).read_text()), urdf_file(name)
    made, back = mq.Robot.from_urdf(file, tip=tip, base=base), mq.Robot.from_urdf(file, tip=base, base=tip)
    assert made.n == n
    assert made.joint_names == back.joint_names[::-1]
    assert made.lower.tolist() == back.lower.tolist()[::-1]
    again = mq.Robot.from_urdf(made.urdf, tip=tip, base=base)
    assert again.frames == made.frames
    for _ in range(3):
        q = made.random_configuration(rng)
        T = whole.look(dict(zip(made.joint_names, q, strict=True)), base, tip)[0]
        assert made.forward(q).homogeneous == pytest.approx(T, abs=1e-12)
        assert again.forward(q).homogeneous == pytest.approx(T, abs=1e-12)
        assert (made.forward(q) * back.forward(q[::-1])).homogeneous == pytest.approx(np.eye(4), abs=1e-12)
        assert made.jacobian(q) == pytest.approx(central_differences(made, q), abs=1e-7)


def central_differences(made, q, step=1e-6):
    """The Jacobian (6, n) of the tip, by differences."""
    ends = [[made.forward(q + sign * dq).homogeneous for sign in (-1, 1)] for dq in step * np.eye(made.n)]
    return np.array([pose_error(*pair) for pair in ends]).T / (2 * step)


def test_a_follower_on_the_way_up_follows():
    text = robot(
        joint("ab", "a", "b", f'{LIMIT}<mimic joint="bc" multiplier="-0.5" offset="0.25"/>', axis="0 1 0"),
        joint("bc", "b", "c", axis="1 0 0"),
        joint("ad", "a", "d", axis="0 1 1"),
        links="abcd",
    )
    made, whole = mq.Robot.from_urdf(text, tip="d", base="c"), WholeModel(text)
    assert made.joint_names == ("bc", "ad")
    T = whole.look({"bc": 0.3, "ad": -0.4}, "c", "d")[0]
    assert made.forward([0.3, -0.4]).homogeneous == pytest.approx(T, abs=1e-14)


def test_hand_to_hand_is_solved(rng):
    made = mq.Robot.from_urdf(urdf_file("baxter_arms"), tip="right_gripper", base="left_gripper")
    targets = [made.forward(made.random_configuration(rng)) for _ in range(10)]
    assert mq.Solver(made).solve_batch(targets).success.all()


def test_a_chain_without_a_moving_joint_is_refused():
    fixed = robot(joint("ab", "a", "b", "", "fixed"), links="ab")
    for text, tip, base in (
        (fixed, None, None),
        ("<robot><link name='a'/></robot>", None, None),
        (robot(*TWO), "b", "b"),
    ):
        with pytest.raises(RobotError, match="no joint moves between base and tip"):
            read_urdf(text, tip, base)


# What is wrong with the text

BAD_NUMBER = [
    (joint("ab", "a", "b", axis="0 0 0"), "joint 'ab' has a zero axis"),
    (joint("ab", "a", "b", axis="0 0 nan"), "joint 'ab', axis: xyz='0 0 nan' is not finite"),
    (joint("ab", "a", "b", axis="0 0 1e999"), "not finite"),
    (joint("ab", "a", "b", axis="0 1"), "'0 1' should be 3 numbers"),
    (joint("ab", "a", "b", axis="z"), "is not made of numbers"),
    (joint("ab", "a", "b", axis="0 0 1_0"), "is not made of numbers"),
    (joint("ab", "a", "b").replace("0 0 1", "0 inf 1", 1), "joint 'ab', origin: xyz='0 inf 1' is not finite"),
    (joint("ab", "a", "b").replace('xyz="0 0 1"', 'rpy="0"', 1), "origin: rpy='0' should be 3 numbers"),
    (joint("ab", "a", "b", '<limit lower="2" upper="1"/>'), "inverted limits: lower 2.0 > upper 1.0"),
    (joint("ab", "a", "b", '<limit lower="nan" upper="1"/>'), "lower='nan' is not finite"),
    (joint("ab", "a", "b", '<limit lower="-inf" upper="inf"/>', "prismatic"), "has no limits"),
    (joint("ab", "a", "b", '<limit lower="-1e308" upper="1e308"/>', "prismatic"), "has no limits"),
    (joint("ab", "a", "b", '<limit lower="0" upper="1e308"/>'), "has no limits"),
    (joint("ab", "a", "b").replace("0 0 1", "0 0 1e308", 1), "origin: xyz='0 0 1e308' is beyond .*1e\\+09"),
    (joint("ab", "a", "b").replace('xyz="0 0 1"', 'rpy="0 -1e10 0"', 1), "origin: rpy='0 -1e10 0' is beyond"),
    (joint("ab", "a", "b", f'{LIMIT}<mimic joint="ab" multiplier="1e300"/>'), "mimic: multiplier='1e300' is beyond"),
    (joint("ab", "a", "b").replace("0 0 1", "0 0 ${h}", 1), "this is xacro .see joint 'ab', origin"),
    (joint("ab", "a", "b", f'{LIMIT}<xacro:insert_block name="o"/>'), "this is xacro .see <xacro:insert_block>"),
    (joint("ab", "a", "b", '<limit lower="" upper="1"/>'), "should be 1 number"),
    (joint("ab", "a", "b", '<limit lower="0" upper="1" velocity="nan"/>'), "velocity='nan' is not finite"),
    (joint("ab", "a", "b", ""), r"is revolute but has no limits: give it lower and upper \(type='continuous'"),
    (joint("ab", "a", "b", '<limit velocity="1" effort="1"/>'), "has no limits"),
    (joint("ab", "a", "b", "", "prismatic"), r"has no limits: .*; or at load, limits={'ab': \(lower, upper\)}$"),
    (joint("ab", "a", "b", "", "floating"), "is floating, which is not supported; start behind it, base='b'"),
    (joint("ab", "a", "b", "", "planar"), "is planar, which is not supported"),
    (joint("ab", "a", "b", kind="revolut"), "has the unknown type 'revolut'; did you mean 'revolute'"),
    (joint("ab", "a", "b").replace(' type="revolute"', ""), "joint 'ab' has no type; valid names: revolute"),
    (joint("ab", "a", "b").replace('<parent link="a"/>', ""), "joint 'ab' has no parent link"),
    (joint("ab", "a", "b").replace('<child link="b"/>', "<child/>"), "joint 'ab' has no child link"),
    (joint("ab", "a", "B"), "joint 'ab' names a link 'B' that does not exist; .*valid names: a, b"),
    (joint("", "a", "b"), "a joint has no name"),
    (joint("ab", "a", "b") * 2, "two joints have the name 'ab'"),
    (joint("ab", "a", "b") + joint("ba", "a", "b"), "link 'b' has two parents, by the joints 'ab' and 'ba'"),
    (joint("ab", "a", "b") + joint("ba", "b", "a"), "the joints form a cycle through a, b"),
    (joint("aa", "a", "a"), "cycle"),
    ("", "the links are not one tree, 2 have no parent: a, b"),
    ('<link name="a"/>', "two links have the name 'a'"),
    ("<link/>", "a link has no name"),
    (
        joint("ab", "a", "b", f'{LIMIT}<mimic joint="no"/>'),
        "joint 'ab' mimics 'no', which is not a joint; valid names: ab",
    ),
    (joint("ab", "a", "b", f'{LIMIT}<mimic joint="ab"/>'), "mimic each other in a circle"),
    (joint("ab", "a", "b", f"{LIMIT}<mimic/>"), "mimics a joint that is not named"),
    (joint("ab", "a", "b", f'{LIMIT}<mimic joint="ab" offset="x"/>'), "mimic: offset='x' is not made of numbers"),
]


@pytest.mark.parametrize(("part", "message"), BAD_NUMBER)
def test_a_description_that_makes_no_sense_is_refused_with_its_reason(part, message):
    with pytest.raises(RobotError, match=message):
        read_urdf(robot(part, links="ab"))


def test_a_joint_that_no_chain_can_have_is_avoided_in_the_words_of_either_interface():
    with pytest.raises(RobotError) as reason:
        read_urdf(robot(joint("ab", "a", "b", "", "floating"), links="ab"))
    assert reason.value.for_shell.endswith("start behind it, --base b")


def test_a_cycle_beside_a_good_tree_is_seen():
    with pytest.raises(RobotError, match="cycle through c, d"):
        read_urdf(robot(joint("ab", "a", "b"), joint("cd", "c", "d"), joint("dc", "d", "c"), links="abcd"), tip="b")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty text"),
        (" \n", "empty text"),
        ("<robot>\n<link name='a'>\n</robot>", "XML text is not well-formed XML, line 3: mismatched tag"),
        ("\n\n<robot>\n<link name='a'>\n</robot>", "line 5"),
        ("<robot", "line 1: unclosed token"),
        ("<robot/><robot/>", "junk after document element"),
        ("<sdf/>", "the outermost element is <sdf>, not <robot>"),
        ("<robot/>", "the robot has no links"),
        ("<robot><link name='\ud800'/></robot>", "not valid Unicode"),
        ("<robot>" + "<link>" * 100 + "</link>" * 100 + "</robot>", "nested deeper than 64"),
        ("<robot xmlns:xacro='x'><xacro:include filename='a'/></robot>", "this is xacro .*run `xacro"),
        ("<robot><link name='${name}'/></robot>", "this is xacro"),
        ("<robot><link name='$(arg name)'/></robot>", "this is xacro"),
    ],
)
def test_text_that_is_not_urdf_is_refused_with_its_reason(text, message):
    with pytest.raises(RobotError, match=message):
        read_urdf(text)


def test_comments_may_hold_what_xml_forbids_and_keep_the_lines_of_errors():
    text = robot(*TWO).replace("<link", "<!-- <robot> -- \n --\n<!-- x --><link", 1)
    assert read_urdf(text) == read_urdf(robot(*TWO))
    with pytest.raises(RobotError, match="line 3: mismatched tag"):
        read_urdf("<robot><!-- -- \n\n --></link>")
    with pytest.raises(RobotError, match="not well-formed"):
        read_urdf("<robot>" + "<!--" * 100_000)
    kept = robot(*TWO).replace("</robot>", "<x><![CDATA[ <!-- ]]></x><!-- --><y/></robot>")
    assert read_urdf(kept).tip == "c"


def test_a_namespace_that_xacro_left_behind_is_no_macro():
    assert read_urdf(robot(*TWO).replace("<robot", "<robot xmlns:xacro='http://wiki.ros.org/xacro'")).tip == "c"


BILLION_LAUGHS = '<!DOCTYPE robot [<!ENTITY a "ha">' + "".join(
    f'<!ENTITY {name} "{10 * ("&" + before + ";")}">' for before, name in pairwise("abcdefghijklm")
)


@pytest.mark.parametrize(
    "prolog",
    [
        BILLION_LAUGHS + "]>",
        '<!DOCTYPE robot [<!ENTITY m SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE robot SYSTEM "http://localhost/robot.dtd">',
        "<!DOCTYPE robot>",
    ],
)
def test_document_types_are_refused_before_anything_expands(prolog, tmp_path):
    """Entities can expand to terabytes (here two) and can read other files."""
    text = prolog + robot(*TWO).replace('name="r"', 'name="&m;"')
    (tmp_path / "r.urdf").write_text(text)
    for source in (text, tmp_path / "r.urdf"):
        with pytest.raises(RobotError, match="document type and entity declarations are refused"):
            read_urdf(source)


# Files


def test_a_file_is_read_by_its_path(tmp_path):
    path = tmp_path / "with spaces.urdf"
    path.write_text(robot(*TWO))
    assert read_urdf(path) == read_urdf(str(path)) == read_urdf(robot(*TWO))


def test_a_pipe_is_refused_without_waiting(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    seen = []

    def read():
        with pytest.raises(RobotError, match="is not a regular file"):
            read_urdf(path)
        seen.append(True)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    thread.join(timeout=20)
    assert seen == [True]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("/no/such/robot.urdf", r"cannot open .*No such file or directory \(XML text would start with '<'\)"),
        (Path("no_such.urdf"), "No such file"),
        (".", "is not a regular file"),
        (os.devnull, "is not a regular file"),
        ("a\0b", "cannot open"),
        ("x" * 10_000, "File name too long"),
        (None, "a path or XML text, not NoneType"),
        (b"<robot/>", "not bytes"),
        (3, "not int"),
    ],
)
def test_what_is_no_readable_file_is_refused(source, message):
    with pytest.raises(RobotError, match=message):
        read_urdf(source)


def test_a_file_beyond_the_cap_is_refused(tmp_path):
    path = tmp_path / "large.urdf"
    with path.open("wb") as file:
        file.truncate(64 * 2**20 + 1)  # sparse: it takes no room
    with pytest.raises(RobotError, match="larger than 64 MB"):
        read_urdf(path)


def test_a_file_in_an_unknown_encoding_is_refused(tmp_path):
    path = tmp_path / "r.urdf"
    for content in (b'<?xml version="1.0" encoding="klingon"?><robot/>', b"\xff\xfe<\0r"[:-1]):
        path.write_bytes(content)
        with pytest.raises(RobotError, match=r"r\.urdf"):
            read_urdf(path)


# Sizes


def chain_text(length, kind="fixed"):
    links = [f"l{i}" for i in range(length + 1)]
    parts = [joint("j0", "l0", "l1")] + [joint(f"j{i}", links[i], links[i + 1], "", kind) for i in range(1, length)]
    return robot(*parts, links=links)


def test_the_longest_chain_that_is_accepted_loads_and_a_longer_one_is_refused():
    """Pinocchio crashes on 5,000 links; on or beside the way to the tip makes no difference to it."""
    made = mq.Robot.from_urdf(chain_text(500))
    assert made.forward([0.0]).translation == pytest.approx([0, 0, 500])
    for tip in (None, "l1"):
        with pytest.raises(RobotError, match="longer than 500 links"):
            read_urdf(chain_text(501), tip=tip)


def test_a_hundred_thousand_links_are_refused():
    with pytest.raises(RobotError, match="more than the 10000"):
        read_urdf(robot(links=[str(i) for i in range(100_000)]))


# Mimic joints


def mimics(*pairs, lead=LIMIT, follow=LIMIT, lead_kind="revolute"):
    """A robot a-b-c whose second joint mimics the first, with multiplier and offset."""
    mimic = 'multiplier="{}" offset="{}"'.format(*pairs)
    return robot(
        joint("lead", "a", "b", lead, lead_kind), joint("follow", "b", "c", f'{follow}<mimic joint="lead" {mimic}/>')
    )


@pytest.mark.parametrize(
    ("multiplier", "offset", "expected"),
    [(1, 0, (-1, 2)), (2, 0, (-0.5, 1)), (-2, 0, (-1, 0.5)), (1, 1, (-1, 1)), (-1, 3, (1, 2)), (0.1, 0, (-1, 2))],
)
def test_the_leaders_limits_keep_the_follower_within_its_own(multiplier, offset, expected):
    chain = read_urdf(mimics(multiplier, offset))
    assert chain.joint_names == ("lead",)
    assert (chain.lower[0], chain.upper[0]) == pytest.approx(expected)
    assert chain.velocity[0] == min(3, 3 / abs(multiplier))


def test_a_narrowed_leader_is_said_and_never_ends_at_minus_zero(caplog):
    """A gripper of 0..0.8 whose follower has the other sign, and limits that leave nothing but zero."""
    follow = '<limit lower="0" upper="0.8"/>'
    chain = read_urdf(mimics(-1, 0, lead='<limit lower="0" upper="0.8"/>', follow=follow))
    assert (chain.lower.tolist(), chain.upper.tolist()) == ([0.0], [0.0])
    assert math.copysign(1, chain.upper[0]) == 1
    assert "joint 'follow' mimics 'lead' (multiplier -1, offset 0), whose limits so become [0, 0] in pl" in caplog.text
    caplog.clear()
    read_urdf(mimics(1, 0))
    assert not caplog.records


def test_no_position_within_both_limits_is_refused():
    with pytest.raises(RobotError, match="but no position is within the limits of both"):
        read_urdf(mimics(1, 5))


def test_a_multiplier_of_zero_fixes_the_follower_at_its_offset():
    made = mq.Robot.from_urdf(mimics(0, 0.5))
    assert made.joint_names == ("lead",)
    assert made.lower == -1
    R = made.forward([0.25]).rotation
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(0.75, abs=1e-15)


def test_a_continuous_leader_takes_the_limits_of_its_follower():
    chain = read_urdf(mimics(2, 0, lead="", lead_kind="continuous"))
    assert (chain.lower[0], chain.upper[0]) == (-0.5, 1)
    assert joint_elements(chain)["lead"].get("type") == "revolute"


def test_a_follower_that_carries_its_leader_is_refused_with_the_way_out():
    """Pinocchio computes leaders first; swapping the roles, as the message says, gives the same mechanism."""
    text = robot(
        joint("near", "a", "b", f'{LIMIT}<mimic joint="far" multiplier="2" offset="0.5"/>'), joint("far", "b", "c")
    )
    with pytest.raises(RobotError, match=r"let 'far' mimic 'near' \(multiplier 0.5, offset -0.25\)"):
        read_urdf(text)


def test_a_leader_that_cannot_lead_is_refused():
    fixed = robot(joint("ab", "a", "b", "", "fixed"), joint("bc", "b", "c", f'{LIMIT}<mimic joint="ab"/>'))
    with pytest.raises(RobotError, match="joint 'bc' mimics 'ab', which is fixed"):
        read_urdf(fixed)
    with pytest.raises(RobotError, match=r"joint 'lead' leads a mimic joint .* but stands before the base"):
        read_urdf(mimics(1, 0), base="b")
    unlimited = mimics(1, 0, lead="")
    with pytest.raises(RobotError, match="joint 'lead' is revolute but has no limits"):
        read_urdf(unlimited)


def branches(*first, second=()):
    """A robot a-b-c, a-d-e: two branches of two joints each, named by the mimic tags that they take."""
    names = ("ab", "bc", "ad", "de")
    tags = dict(zip(names, [*first, *second], strict=True))
    return robot(
        *(joint(name, *name, LIMIT + (f'<mimic joint="{tag}"/>' if tag else "")) for name, tag in tags.items()),
        links="abcde",
    )


def test_a_leader_in_another_branch_comes_first_whichever_tip_is_first():
    """Pinocchio needs the leader before its follower; both branches lead to tips, so both move."""
    text = branches(None, "de", second=(None, None))
    for tips in (["c", "e"], ["e", "c"], ["b", "c", "d"]):
        made = mq.Robot.from_urdf(text, tip=tips)
        assert made.joint_names == ("ad", "de", "ab")
        assert not made.is_chain
    assert read_urdf(text, tip="d").joint_names == ("ad",)


def test_a_leader_that_two_branches_share_leads_both():
    text = branches("de", "de", second=(None, None))
    assert read_urdf(text, tip=["c", "d"]).joint_names == ("ad", "de")
    slow = text.replace(LIMIT, '<limit lower="0" upper="2" velocity="1"/>', 1)  # of the first joint, a follower
    chain = read_urdf(slow, tip=["c", "d"])
    assert (chain.lower[1], chain.upper[1], chain.velocity[1]) == (0, 2, 1)
    assert chain.lower[0] == -1


def test_branches_that_lead_each_other_are_refused():
    """Whichever came first, a follower would come before its leader."""
    text = branches(None, "ad", second=(None, "ab"))
    with pytest.raises(RobotError, match="the branches behind the joints 'ab' and 'ad' mimic each other"):
        read_urdf(text, tip=["c", "e"])
    assert read_urdf(text, tip="c").joint_names == ("ad", "ab")


def test_circles_of_mimics_are_seen_on_the_chain_and_beside_it(caplog):
    circle = [
        joint("one", "a", "b", f'{LIMIT}<mimic joint="two"/>'),
        joint("two", "b", "c", f'{LIMIT}<mimic joint="one"/>'),
    ]
    with pytest.raises(RobotError, match="mimic each other in a circle"):
        read_urdf(robot(*circle), tip="c")
    assert read_urdf(robot(*circle, joint("ad", "a", "d"), links="abcd"), tip="d").joint_names == ("ad",)
    assert "mimic each other in a circle" in caplog.text


def test_a_follower_beside_the_chain_stands_where_its_resting_leader_puts_it():
    text = robot(
        joint("ab", "a", "b"),
        joint("lead", "a", "c", '<limit lower="0.5" upper="1" velocity="1" effort="1"/>'),
        joint("follow", "c", "d", f'{LIMIT}<mimic joint="lead" multiplier="2" offset="0.1"/>'),
        links="abcd",
    )
    R = mq.Robot.from_urdf(text, tip="b").forward([0.0], "d").rotation
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(0.5 + 1.1, abs=1e-15)


def test_a_follower_beside_the_chain_may_have_its_leader_before_the_base():
    text = robot(*TWO, joint("bd", "b", "d", f'{LIMIT}<mimic joint="ab" offset="0.25"/>'), links="abcd")
    R = mq.Robot.from_urdf(text, tip="c", base="b").forward([0.0], "d").rotation
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(0.25, abs=1e-15)


def test_a_lost_leader_beside_the_chain_is_warned_about_only(caplog):
    """As in a hand of a humanoid that is sold, whose arm is good."""
    text = robot(*TWO, joint("bd", "b", "d", f'{LIMIT}<mimic joint="no" offset="0.25"/>'), links="abcd")
    assert mq.Robot.from_urdf(text, tip="c").forward([0, 0], "d").rotation.tolist() == np.eye(3).tolist()
    assert "bd" in caplog.text


# Real robots


def test_published_limits_are_read():
    """UR10: ±2 pi, elbow ±pi; KUKA iiwa 14: ±170°, ±120°, flange ±175°."""
    ur10 = load("ur10")
    assert ur10.upper == pytest.approx([2 * pi, 2 * pi, pi, 2 * pi, 2 * pi, 2 * pi], abs=1e-3)
    degrees = np.rad2deg(load("iiwa14_urdf").upper)
    assert degrees == pytest.approx([170, 120, 170, 120, 170, 120, 175], abs=0.1)


def test_loading_prints_nothing(capfd):
    """Pinocchio and its parser are silent about real files, meshes or not."""
    for name in ("pr2_arm", "tiago", "talos_finger", "kr210"):
        mq.Robot.from_urdf(urdf_file(name), tip=load(name).tip)
    assert capfd.readouterr() == ("", "")
