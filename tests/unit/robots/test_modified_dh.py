"""DH tables in the modified convention, against products of Craig's matrices and against Franka's own URDF."""

import pickle
from math import cos, pi, sin

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import approx_fprime
from support.made_robots import random_table
from support.robots import urdf_file

import maira_qp as mq
from maira_qp.errors import RobotError
from maira_qp.evaluation.baselines.objectives import obstacle_distance, obstacle_distance_gradient
from maira_qp.robots.urdf.writer import urdf_text

PANDA = [
    {"d": 0.333, "lower": -2.8973, "upper": 2.8973},
    {"alpha": -pi / 2, "lower": -1.7628, "upper": 1.7628},
    {"alpha": pi / 2, "d": 0.316, "lower": -2.8973, "upper": 2.8973},
    {"alpha": pi / 2, "a": 0.0825, "lower": -3.0718, "upper": -0.0698},
    {"alpha": -pi / 2, "a": -0.0825, "d": 0.384, "lower": -2.8973, "upper": 2.8973},
    {"alpha": pi / 2, "lower": -0.0175, "upper": 3.7525},
    {"alpha": pi / 2, "a": 0.088, "lower": -2.8973, "upper": 2.8973},
    {"kind": "fixed", "d": 0.107},
]
"""The Panda's parameters as its maker publishes them, in Craig's convention."""


def craig(link, q):
    """The matrix of Craig's "Introduction to Robotics", equation 3.6, of one row."""
    theta = link.theta + (q if link.kind in ("revolute", "continuous") else 0)
    d = link.d + (q if link.kind == "prismatic" else 0)
    ct, st, ca, sa = cos(theta), sin(theta), cos(link.alpha), sin(link.alpha)
    return np.array(
        [
            [ct, -st, 0, link.a],
            [st * ca, ct * ca, -sa, -sa * d],
            [st * sa, ct * sa, ca, ca * d],
            [0, 0, 0, 1],
        ]
    )


def test_transforms_are_products_of_craigs_matrices_and_the_frames_of_the_urdf(rng):
    """Row by row, for tables of all kinds of links: the plain chain, and each link of the robot made from it."""
    for _ in range(40):
        table = random_table(rng, int(rng.integers(1, 9)), "modified")
        robot = mq.Robot.from_dh(table)
        q = rng.uniform(-3, 3, table.n)
        values, expected, htms = iter(q), np.eye(4), table.compute_htms(q)
        for i, link in enumerate(table.links, start=1):
            expected = expected @ craig(link, 0 if link.kind == "fixed" else next(values))
            assert np.abs(htms[i] - expected).max() < 1e-13
            assert np.abs(robot.forward(q, f"link{i}").homogeneous - expected).max() < 1e-12
        assert np.abs(robot.forward(q).homogeneous - expected).max() < 1e-12


def test_both_jacobians_agree(rng):
    """Geometric and finite-difference columns, and Pinocchio's."""
    for _ in range(40):
        table = random_table(rng, int(rng.integers(1, 9)), "modified")
        q = rng.uniform(-3, 3, table.n)
        J = table.jacobian(q)
        assert np.abs(J - table.finite_difference_jacobian(q)).max() < 1e-8
        assert np.abs(J - mq.Robot.from_dh(table).jacobian(q)).max() < 1e-12


def test_the_published_table_of_the_panda_is_its_urdf(rng):
    """All seven links and the flange, at random configurations."""
    robot = mq.Robot.from_dh(PANDA, name="panda", convention="modified")
    other = mq.Robot.from_urdf(urdf_file("panda"), tip="panda_link8")
    for _ in range(20):
        q = other.random_configuration(rng)
        for i in range(1, 9):
            apart = robot.forward(q, f"link{i}").homogeneous - other.forward(q, f"panda_link{i}").homogeneous
            assert np.abs(apart).max() < 1e-12
    s = mq.Solver(robot).solve(other.forward(q))
    assert s.success
    assert np.abs(other.forward(s.q).homogeneous - other.forward(q).homogeneous).max() < 1e-5


def test_a_spherical_arm_is_found_in_either_convention(rng):
    """The iiwa14 in Craig's convention is the same arm, and is solved in closed form with as many arcs."""
    standard = mq.Robot.iiwa14()
    rows = standard.dh.links
    alphas = [0.0, *(link.alpha for link in rows[:-1])]
    modified = [
        mq.DHLink(alpha=alpha, d=link.d, lower=link.lower, upper=link.upper)
        for link, alpha in zip(rows, alphas, strict=True)
    ]
    robot = mq.Robot.from_dh(modified, convention="modified")
    q = standard.random_configuration(rng)
    target = standard.forward(q)
    assert np.abs(robot.forward(q).homogeneous - target.homogeneous).max() < 1e-12
    found, expected = (mq.Solver(each).solutions(target) for each in (robot, standard))
    assert found.is_complete
    assert len(found) == len(expected) > 0


def test_the_gradient_of_the_distance_from_an_obstacle(rng):
    """Of the baselines, whose frames move with their own axes in this convention."""
    for _ in range(20):
        table, obstacle = random_table(rng, 5, "modified"), rng.normal(size=3)
        q = rng.uniform(-1, 1, 5)
        slope = approx_fprime(q, lambda q: obstacle_distance(table, q, obstacle), 1e-7)  # noqa: B023
        assert np.abs(obstacle_distance_gradient(table, q, obstacle) - slope).max() < 1e-5


@pytest.mark.parametrize("suffix", ["toml", "yaml"])
def test_files_name_the_convention(tmp_path, suffix):
    content = {
        "toml": 'convention = "modified"\nlinks = [{a = 0.3, alpha = 1.0}, {a = 0.5}]\n',
        "yaml": "convention: modified\nlinks:\n- {a: 0.3, alpha: 1.0}\n- {a: 0.5}\n",
    }
    path = tmp_path / f"arm.{suffix}"
    path.write_text(content[suffix])
    table = mq.DHTable.from_file(path)
    assert table == mq.DHTable([mq.DHLink(a=0.3, alpha=1.0), mq.DHLink(a=0.5)], "arm", "modified")
    assert table != mq.DHTable(table.links, "arm")
    assert mq.Robot.from_dh(table).forward([0, 0]).translation == pytest.approx([0.8, 0, 0])


def test_the_convention_is_kept(rng):
    """By pickling, other limits, another name, and where it is not named."""
    table = mq.DHTable(PANDA, convention="modified")
    assert pickle.loads(pickle.dumps(table)) == table
    robot = mq.Robot.from_dh(table, name="other").limited(margin=0.01)
    assert (robot.dh.convention, robot.name) == ("modified", "other")
    assert pickle.loads(pickle.dumps(robot)) == robot
    q = robot.random_configuration(rng)
    assert np.abs(mq.Robot.from_urdf(robot.urdf).forward(q).homogeneous - table.forward(q)).max() < 1e-12
    assert mq.Robot.from_dh(table, convention="standard").dh == mq.DHTable(table.links)


def test_an_unknown_convention_is_refused():
    with pytest.raises(RobotError, match="unknown DH convention 'craig'; valid names: standard, modified"):
        mq.Robot.from_dh(PANDA, convention="craig")
    with pytest.raises(RobotError, match="unknown DH convention None"):
        mq.DHTable(PANDA, convention=None)


def test_rods_lead_from_joint_to_joint(rng):
    """Each joint's visual rods lead along z by d, then along x by the next row's a; balls stand in the joints."""
    links = [mq.DHLink(d=0.3), mq.DHLink(a=0.7, alpha=0.4, d=-0.2), mq.DHLink(a=0.4, alpha=1.0, theta=0.3, d=0.1)]
    table = mq.DHTable(links, convention="modified")
    robot = mq.Robot.from_dh(table)
    q = robot.random_configuration(rng)
    geometry = pin.buildGeomFromUrdfString(robot.model, urdf_text(table), pin.GeometryType.VISUAL)
    data, placed = robot.model.createData(), geometry.createData()
    pin.forwardKinematics(robot.model, data, q)
    pin.updateGeometryPlacements(robot.model, data, geometry, placed)
    frames = table.compute_htms(q)
    feet = [T[:3, 3] - link.d * T[:3, 2] for link, T in zip(links, frames[1:], strict=True)]
    expected = [end for k, T in enumerate(frames[1:]) for end in (feet[k], T[:3, 3], *feet[k + 1 : k + 2])]
    found, balls = [], []
    for shape, M in zip(geometry.geometryObjects, placed.oMg, strict=True):
        if shape.name.startswith("link"):
            if "radius" in dir(shape.geometry) and not hasattr(shape.geometry, "halfLength"):
                balls.append(M.translation)
            else:
                half = np.array([0, 0, shape.geometry.halfLength])
                found += [M.act(half), M.act(-half)]
    assert np.allclose(balls, feet, atol=1e-5)
    for point in expected:
        assert min(np.abs(point - end).max() for end in found) < 1e-5
