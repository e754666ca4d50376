"""The plain DH chain against closed forms, finite differences and an independent product of elementary matrices."""

from math import cos, inf, pi, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.made_robots import random_table

from maira_qp.errors import ConfigurationError, RobotError
from maira_qp.robots.dh.table import DHLink, DHTable


def elementary(link, q):
    """Rz(theta) Tz(d) Tx(a) Rx(alpha), one matrix at a time."""

    def motion(axis, angle=0.0, length=0.0):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
        T["xyz".index(axis), 3] = length
        return T

    theta = link.theta + (q if link.kind in ("revolute", "continuous") else 0)
    d = link.d + (q if link.kind == "prismatic" else 0)
    return motion("z", theta) @ motion("z", length=d) @ motion("x", length=link.a) @ motion("x", link.alpha)


def test_transforms_are_the_product_of_elementary_motions(rng):
    """Row by row, for tables of all kinds of links; the first transform is the identity."""
    for _ in range(50):
        table = random_table(rng, int(rng.integers(1, 9)))
        q = rng.uniform(-3, 3, table.n)
        htms = table.compute_htms(q)
        assert htms.shape == (len(table.links) + 1, 4, 4)
        assert (htms[0] == np.eye(4)).all()
        values, expected = iter(q), np.eye(4)
        for link, T in zip(table.links, htms[1:], strict=True):
            expected = expected @ elementary(link, 0 if link.kind == "fixed" else next(values))
            assert np.abs(T - expected).max() < 1e-13
        assert (table.forward(q) == htms[-1]).all()


def test_a_planar_arm_of_two_links():
    """The textbook's closed form."""
    a, b = 0.7, 0.4
    table = DHTable([DHLink(a=a), DHLink(a=b)])
    for q1, q2 in ((0, 0), (0.3, 1.1), (-2, 0.5), (pi, -pi / 2)):
        T, J = table.forward([q1, q2]), table.jacobian([q1, q2])
        assert T[:3, 3] == pytest.approx([a * cos(q1) + b * cos(q1 + q2), a * sin(q1) + b * sin(q1 + q2), 0])
        second = [-b * sin(q1 + q2), b * cos(q1 + q2), 0, 0, 0, 1]
        assert J[:, 1] == pytest.approx(second, abs=1e-15)
        assert J[:, 0] == pytest.approx(np.add(second, [-a * sin(q1), a * cos(q1), 0, 0, 0, 0]), abs=1e-15)


def test_a_prismatic_joint_slides_along_z_and_does_not_turn():
    table = DHTable([DHLink(alpha=pi / 2), DHLink(kind="prismatic", d=0.2, lower=-1, upper=1)])
    T, J = table.forward([0.0, 0.5]), table.jacobian([0.0, 0.5])
    assert T[:3, 3] == pytest.approx([0, -0.7, 0])
    assert J[:, 1] == pytest.approx([0, -1, 0, 0, 0, 0], abs=1e-15)
    assert J[:, 0] == pytest.approx([0.7, 0, 0, 0, 0, 1], abs=1e-15)


def test_both_jacobians_agree(rng):
    """Geometric and finite-difference columns, on tables of all kinds of links."""
    for _ in range(60):
        table = random_table(rng, int(rng.integers(1, 9)))
        q = rng.uniform(-3, 3, table.n)
        J = table.jacobian(q)
        assert J.shape == (6, table.n)
        assert np.abs(J - table.finite_difference_jacobian(q)).max() < 1e-8
        assert np.abs(J - table.finite_difference_jacobian(q, step=1e-4)).max() < 1e-6
        assert (table.jacobian_of(table.compute_htms(q)) == J).all()


def test_names_limits_and_defaults():
    table = DHTable(
        [
            DHLink(),
            {"kind": "fixed", "d": 1},
            {"kind": "prismatic", "lower": 0, "upper": 0.5, "name": "slide"},
            DHLink(kind="continuous"),
            DHLink(lower=-1, upper=-1),
        ],
        name="mixed",
    )
    assert table.n == 4
    assert table.joint_names == ("joint1", "slide", "joint3", "joint4")
    assert table.lower.tolist() == [-pi, 0, -inf, -1]
    assert table.upper.tolist() == [pi, 0.5, inf, -1]
    for limits in (table.lower, table.upper):
        with pytest.raises(ValueError, match="read-only"):
            limits[0] = 0


def test_tables_compare_by_their_rows():
    assert DHTable([DHLink(a=1)]) == DHTable([{"a": 1.0}])
    assert DHTable([DHLink(a=1)]) != DHTable([DHLink(a=2)])
    assert DHTable([DHLink(a=1)], name="x") != DHTable([DHLink(a=1)], name="y")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"kind": "hinge"}, "unknown joint kind 'hinge'; valid names: revolute, prismatic, continuous, fixed"),
        ({"kind": None}, "unknown joint kind None"),
        ({"a": np.nan}, "DH parameter a must be a finite number, got nan"),
        ({"alpha": inf}, "alpha must be a finite number"),
        ({"d": "1"}, "d must be a finite number, got '1'"),
        ({"theta": True}, "theta must be a finite number, got True"),
        ({"lower": 1, "upper": -1}, "inverted: lower 1 > upper -1"),
        ({"lower": 4}, "inverted"),
        ({"upper": inf}, r"upper must be a finite number, at most 1e\+16, got inf \(no limit: kind='continuous'\)"),
        ({"lower": np.nan}, "lower must be a finite number"),
        ({"kind": "prismatic"}, "a prismatic joint needs both of its limits"),
        ({"kind": "prismatic", "lower": 0}, "needs both of its limits"),
        ({"kind": "continuous", "upper": 1}, "a continuous joint has no limits; use kind='revolute'"),
        ({"kind": "fixed", "lower": 0}, "a fixed joint has no limits"),
        ({"velocity": 0}, "velocity limit must be a positive number, got 0"),
        ({"effort": np.nan}, "effort limit must be a positive number"),
        ({"name": " "}, "a joint name must be text that is not empty"),
        ({"name": 3}, "a joint name must be text"),
        ({"thetta": 0}, "link 1 has an unknown field 'thetta'; did you mean 'theta'"),
        ("revolute", "link 1 must be a DHLink or a mapping"),
    ],
)
def test_rows_that_make_no_sense_are_refused(row, message):
    """As mappings, where the message also says which row it is."""
    with pytest.raises(RobotError, match=message) as caught:
        DHTable([row])
    assert "link 1" in str(caught.value)


def test_tables_that_make_no_sense_are_refused():
    with pytest.raises(RobotError, match="no moving joint"):
        DHTable([])
    with pytest.raises(RobotError, match="no moving joint"):
        DHTable([DHLink(kind="fixed")])
    with pytest.raises(RobotError, match="joint names must differ, got joint2, joint2"):
        DHTable([DHLink(name="joint2"), DHLink()])
    for name in ("", "  ", 3, None):
        with pytest.raises(RobotError, match="a robot's name must be text"):
            DHTable([DHLink()], name=name)


@pytest.mark.parametrize("q", [[0.0], [0.0, np.nan], [0.0, inf], [[0.0, 0.0]], "00", None, [1j, 0], [True, False]])
def test_bad_configurations_are_refused(q):
    table = DHTable([DHLink(), DHLink()])
    for ask in (
        table.link_transforms,
        table.compute_htms,
        table.forward,
        table.jacobian,
        table.finite_difference_jacobian,
    ):
        with pytest.raises(ConfigurationError, match="q "):
            ask(q)


def test_the_difference_step_must_be_one():
    for step in (0, -1e-6, np.nan, 1, "1e-6"):
        with pytest.raises(ConfigurationError, match="finite-difference step"):
            DHTable([DHLink()]).finite_difference_jacobian([0.0], step=step)


TOML = """
name = "scara"
links = [
    { a = 0.3, d = 0.2 },
    { a = 0.25, alpha = 3.141592653589793, name = "elbow" },
    { kind = "prismatic", lower = 0, upper = 0.15 },
    { kind = "fixed", d = 0.05 },
]
"""
YAML = """
name: scara
links:
  - {a: 0.3, d: 0.2}
  - {a: 0.25, alpha: 3.141592653589793, name: elbow}
  - {kind: prismatic, lower: 0, upper: 0.15}
  - {kind: fixed, d: 0.05}
"""


def test_tables_come_from_files(tmp_path):
    """TOML and YAML say the same; a file without a name gives its own."""
    expected = DHTable(
        [
            DHLink(a=0.3, d=0.2),
            DHLink(a=0.25, alpha=pi, name="elbow"),
            DHLink(kind="prismatic", lower=0, upper=0.15),
            DHLink(kind="fixed", d=0.05),
        ],
        name="scara",
    )
    for name, text in (("a.toml", TOML), ("a.yaml", YAML), ("a.YML", YAML)):
        (tmp_path / name).write_text(text, encoding="utf-8")
        assert DHTable.from_file(tmp_path / name) == DHTable.from_file(str(tmp_path / name)) == expected
    (tmp_path / "crane.yaml").write_text("links: [{a: 1}]")
    assert DHTable.from_file(tmp_path / "crane.yaml").name == "crane"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{}", r"a\.json: a DH file ends in \.toml, \.yaml or \.yml"),
        ("a.toml", "links = [", r"a\.toml cannot be parsed"),
        ("a.yaml", "links: [", r"a\.yaml cannot be parsed"),
        ("a.yaml", "links: !!python/object/apply:os.getcwd []", "cannot be parsed"),
        ("a.yaml", "", "needs a list `links`"),
        ("a.yaml", "links: 3", "needs a list `links`"),
        ("a.yaml", "links: [3]", "link 1 must be a DHLink or a mapping"),
        ("a.yaml", "links: [{a: 1}, {a: x}]", "link 2: DH parameter a must be a finite number, got 'x'"),
        ("a.toml", "links = [{a = nan}]", "link 1: DH parameter a must be a finite number"),
        ("a.toml", "limks = []\nlinks = [{a = 1}]", "unknown entries 'limks'; valid: name, convention, links"),
    ],
)
def test_files_that_make_no_sense_are_refused(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(RobotError, match=message):
        DHTable.from_file(tmp_path / name)


def test_files_that_are_not_text_are_refused(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"links: [{name: \xff}]")
    with pytest.raises(RobotError, match=r"a\.yaml is not UTF-8 text"):
        DHTable.from_file(tmp_path / "a.yaml")
    (tmp_path / "a.toml").write_text("links = " + "[" * 100_000)
    with pytest.raises(RobotError, match="cannot be parsed"):
        DHTable.from_file(tmp_path / "a.toml")
    with pytest.raises(RobotError, match=r"cannot open the DH table .*No such file"):
        DHTable.from_file(tmp_path / "b.toml")
