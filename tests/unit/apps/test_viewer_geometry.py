"""What the viewer draws: surfaces of shapes, and the bodies of robots."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from support.robots import load, urdf_file

import maira_qp as mq
from maira_qp.apps.viewer.drawing.geometry import PLAIN, geometry_of, stick_figure
from maira_qp.apps.viewer.drawing.triangles import joined, triangles
from maira_qp.robots.model.catalog import maira as maira_table
from maira_qp.robots.urdf.writer import urdf_text

TETRAHEDRON = """solid t
facet normal 0 0 -1\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet
facet normal -1 0 0\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendloop\nendfacet
facet normal 0 -1 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet
facet normal 1 1 1\nouter loop\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\nendfacet
endsolid t
"""


def volume(surface) -> float:
    """Of what a surface encloses: positive only where it is seen from outside (divergence theorem)."""
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (mq.Sphere(0.5), 4 / 3 * pi * 0.125),
        (mq.Ellipsoid([0.5, 1.0, 2.0]), 4 / 3 * pi),
        (mq.Box([1.0, 2.0, 3.0]), 6.0),
        (mq.Cylinder(0.5, 2.0), pi * 0.5),
        (mq.Capsule(0.5, 2.0), pi * 0.5 + 4 / 3 * pi * 0.125),
    ],
)
def test_a_surface_encloses_the_shape_wherever_it_is(shape, expected):
    here, there = triangles(shape), triangles(replace(shape, pose=mq.pose([5, 6, 7])))
    assert 0.97 * expected < volume(here) < expected * (1 + 1e-12)
    assert volume(there) == pytest.approx(volume(here))
    np.testing.assert_allclose(there.vertices - [5, 6, 7], here.vertices, atol=1e-12)


@pytest.mark.parametrize(
    "shape", [mq.Sphere(1), mq.Ellipsoid([1, 2, 3]), mq.Box([1, 1, 1]), mq.Cylinder(1, 1), mq.Capsule(1, 1)]
)
def test_a_surface_is_closed(shape):
    """Every edge is met once from either side, vertices in one place counted as one."""
    surface = triangles(shape)
    _, place = np.unique(surface.vertices.round(9), axis=0, return_inverse=True)
    faces = place.ravel()[surface.faces]
    edges = [(a, b) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True) if a != b]
    counts = {edge: edges.count(edge) for edge in edges}
    flat = [face for face in faces if len(set(face.tolist())) < 3]
    assert len(flat) < len(faces)
    assert all(counts.get((b, a), 0) == count for (a, b), count in counts.items())


def test_surfaces_are_joined_without_a_change():
    parts = [triangles(mq.Sphere(0.1)), triangles(mq.Box([1, 1, 1]))]
    assert volume(joined(parts)) == pytest.approx(sum(map(volume, parts)))


def test_maira_is_drawn_from_its_own_primitives_in_its_colours(maira):
    geometry = geometry_of(maira)
    assert geometry.notes == []
    assert {body.link for body in geometry.bodies} == {"base_link", "tool0", *(f"link{i}" for i in range(1, 8))}
    assert (41, 115, 204) in {body.colour for body in geometry.bodies}
    for body in geometry.bodies:
        assert volume(body.surface) > 0


def test_a_robot_with_meshes_is_drawn_from_them():
    panda = load("panda")
    geometry = geometry_of(panda, urdf_file("panda").parents)
    assert geometry.notes == []
    hand = [body for body in geometry.bodies if body.link == "panda_hand"]
    vertices = np.concatenate([body.surface.vertices for body in hand])
    assert 0.15 < np.ptp(vertices, axis=0).max() < 0.3  # the width of Panda's hand is some 0.2 m


def test_meshes_that_are_not_found_are_told_and_a_stick_figure_takes_their_place():
    panda = load("panda")
    geometry = geometry_of(panda)
    assert any("panda_link0" in note and "not found" in note for note in geometry.notes)
    assert [body.link for body in geometry.bodies] == [body.link for body in stick_figure(panda)]


def test_a_mirrored_mesh_is_not_inside_out(tmp_path):
    (tmp_path / "t.stl").write_text(TETRAHEDRON)
    for scale in ("1 1 1", "-2 1 1"):
        mesh = f'<geometry><mesh filename="t.stl" scale="{scale}"/></geometry>'
        geometry = geometry_of(one_joint(f"<visual>{mesh}</visual>"), [str(tmp_path)])
        (body,) = geometry.bodies
        assert volume(body.surface) == pytest.approx(abs(float(scale.split()[0])) / 6)
        assert body.colour == PLAIN


def one_joint(shapes: str) -> mq.Robot:
    """An arm of one joint; the tip has these shapes."""
    return mq.Robot.from_urdf(
        f'<robot name="one"><link name="base"/><link name="tip">{shapes}</link><joint name="j" type="revolute">'
        '<parent link="base"/><child link="tip"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )


def test_collision_shapes_stand_in_for_visual_ones():
    box = '<geometry><box size="1 2 3"/></geometry>'
    lost = '<visual><geometry><mesh filename="nowhere.stl"/></geometry></visual>'
    for visual in ("", lost):
        (body,) = geometry_of(one_joint(f"{visual}<collision>{box}</collision>")).bodies
        assert volume(body.surface) == pytest.approx(6)


@pytest.mark.parametrize("rgba", ["1 0 0 1", "1 0 0", "red", "nan 0 0 1"])
def test_a_colour_that_cannot_be_read_is_plain(rgba):
    material = f'<material name="m"><color rgba="{rgba}"/></material>'
    (body,) = geometry_of(one_joint(f'<visual><geometry><sphere radius="1"/></geometry>{material}</visual>')).bodies
    assert body.colour == ((255, 0, 0) if rgba == "1 0 0 1" else PLAIN)


def test_the_stick_figure_leads_from_joint_to_joint_to_the_tip(rng):
    """Its rods, put where the links are, meet: all of them hang together from the base to the tip."""
    robot = mq.Robot.from_urdf(urdf_text(maira_table()).replace("visual>", "x>").replace("collision>", "x>"))
    geometry = geometry_of(robot)
    assert geometry.notes == ["no link has a shape: a stick figure is drawn"]
    at = robot.at(robot.random_configuration(rng))
    ends = []
    for body in geometry.bodies:
        T = at.placement(body.link).homogeneous
        ends.append(body.surface.moved(T).vertices)
    points = np.concatenate(ends)
    for link in (*robot.moved_links, robot.tip):
        assert np.linalg.norm(points - at.placement(link).translation, axis=1).min() < 0.05 * robot.length
