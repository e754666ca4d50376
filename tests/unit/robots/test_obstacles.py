"""Shapes: what they refuse, where they come from, and distances that are known in closed form."""

import logging
import pickle
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.errors import OptionError, PoseError, RobotError
from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.robots.collision.link_shapes import link_shapes
from maira_qp.robots.collision.meshes import THICKNESS, convex_hull, find_mesh
from maira_qp.robots.collision.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Sphere
from maira_qp.robots.collision.urdf_geometry import collision_element, without_ellipsoids

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = [[0, 1, 2], [5, 6, 7], [3, 4, 0]]


def gantry(collision: str) -> mq.Robot:
    """Three joints that carry a shape along x, y and z: q is where it is."""
    joints = "".join(
        f'<link name="l{i}">{collision if i == 3 else ""}</link>'
        + f'<joint name="j{i}" type="prismatic"><parent link="l{i - 1}"/><child link="l{i}"/><axis xyz="{axis}"/>'
        + '<limit lower="-5" upper="5" velocity="1" effort="1"/></joint>'
        for i, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"), start=1)
    )
    return mq.Robot.from_urdf(f'<robot name="gantry"><link name="l0"/>{joints}</robot>')


def collision(geometry: str, origin: str = "") -> str:
    return f"<collision>{origin}<geometry>{geometry}</geometry></collision>"


def segment_distance(p: np.ndarray, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> float:
    """Distance of the segments p + s u and q + t v with s, t in [-1, 1]: the best of the interior and the four ends."""

    def to_point(point, middle, half):
        return np.linalg.norm(point - middle - np.clip((point - middle) @ half / (half @ half), -1, 1) * half)

    ends = [to_point(q + t * v, p, u) for t in (-1, 1)] + [to_point(p + s * u, q, v) for s in (-1, 1)]
    A = np.array([[u @ u, -u @ v], [-u @ v, v @ v]])
    s, t = np.linalg.solve(A, [u @ (q - p), -v @ (q - p)])
    inside = [np.linalg.norm(p + s * u - q - t * v)] if max(abs(s), abs(t)) <= 1 else []
    return min(ends + inside)


def test_distance_of_two_spheres(rng):
    """The distance of the middles less the radii, negative where they overlap, and its gradient the unit vector."""
    robot = gantry(collision('<sphere radius="0.2"/>'))
    middle = np.array([0.1, -0.2, 0.3])
    limit = CollisionLimit(obstacles=[Sphere(0.3, mq.pose(middle), name="ball")], influence=20).of(robot)
    for scale in (1e-3, 0.1, 0.4, 0.6, 2.0):
        q = middle + scale * rng.normal(size=3)
        at, way = robot.at(q), q - middle
        assert limit.distance(at) == pytest.approx(np.linalg.norm(way) - 0.5, abs=1e-9)
        G, h = limit.rows(at, None)
        np.testing.assert_allclose(G, [-way / np.linalg.norm(way)], atol=1e-9)
        np.testing.assert_allclose(h, [np.linalg.norm(way) - 0.5 - 0.01], atol=1e-9)
        contact = limit.nearest(at)
        assert contact[:2] == ("l3", "ball")
        np.testing.assert_allclose(contact.first_point, q - 0.2 * way / np.linalg.norm(way), atol=1e-9)
        np.testing.assert_allclose(contact.second_point, middle + 0.3 * way / np.linalg.norm(way), atol=1e-9)


def test_distance_of_sphere_and_box(rng):
    """Outside, the distance of the point to the box; inside, the way to the nearest face."""
    robot = gantry(collision('<sphere radius="0.05"/>'))
    pose, half = mq.pose([0.3, 0.1, -0.2], rpy=[0.4, -0.3, 1.0]), np.array([0.1, 0.2, 0.3])
    limit = CollisionLimit(obstacles=[Box(2 * half, pose)], influence=20).of(robot)
    for scale in (0.1, 0.3, 1.0) * 10:
        q = pose.act(scale * rng.normal(size=3))
        beyond = np.abs(pose.actInv(q)) - half
        expected = np.linalg.norm(np.maximum(beyond, 0)) + min(beyond.max(), 0) - 0.05
        assert limit.distance(robot.at(q)) == pytest.approx(expected, abs=1e-6 if expected < 0 else 1e-8)


def test_distance_of_two_capsules(rng):
    """The distance of their lines less the radii."""
    origin = '<origin xyz="0.1 0.2 0.3" rpy="0.5 0.2 -0.7"/>'
    robot = gantry(collision('<capsule radius="0.05" length="0.4"/>', origin))
    own = mq.pose([0.1, 0.2, 0.3], rpy=[0.5, 0.2, -0.7])
    for _ in range(30):
        pose = mq.pose(0.3 * rng.normal(size=3), rpy=rng.uniform(-3, 3, 3))
        limit = CollisionLimit(obstacles=[Capsule(0.07, 0.6, pose)], influence=20).of(robot)
        q = 0.5 * rng.normal(size=3)
        u, v = 0.2 * own.rotation[:, 2], 0.3 * pose.rotation[:, 2]
        expected = segment_distance(q + own.translation, u, pose.translation, v) - 0.12
        assert limit.distance(robot.at(q)) == pytest.approx(expected, abs=1e-6)


def test_distance_of_two_ellipsoids(rng):
    """It is their gap along the normal, by the support function `sqrt(n^T (a n))`: no other direction has a larger one.

    So no point of either is nearer than is said, apart or overlapping, for flat and long ones too.
    """
    deep = 0
    for _ in range(60):
        radii, others = np.exp(rng.uniform(np.log(0.003), np.log(0.4), (2, 3)))
        own = mq.pose([0.1, 0.2, 0.3], rpy=rng.uniform(-3, 3, 3))
        robot = gantry(ElementTree.tostring(collision_element(Ellipsoid(radii, own)), encoding="unicode"))
        q = 0.3 * rng.normal(size=3)
        pose = mq.pose(q + own.translation + 0.2 * rng.normal(size=3), rpy=rng.uniform(-3, 3, 3))
        limit = CollisionLimit(obstacles=[Ellipsoid(others, pose)], influence=20).of(robot)
        contact = limit.nearest(robot.at(q))
        normal = (contact.second_point - contact.first_point) / contact.distance
        reach = np.linalg.norm(radii * (own.rotation.T @ normal)) + np.linalg.norm(others * (pose.rotation.T @ normal))
        gap = normal @ (pose.translation - q - own.translation) - reach
        assert contact.distance == pytest.approx(gap, abs=1e-8 if gap > 0 else 3e-5)
        deep += contact.distance < 0
    assert 5 < deep < 55


def test_a_box_around_stands_in_for_an_ellipsoid_for_other_readers():
    robot = gantry(collision('<ellipsoid radii="0.1 0.2 0.3"/>'))
    assert '<box size="0.2 0.4 0.6"' in without_ellipsoids(robot.urdf)
    assert without_ellipsoids(robot.urdf).count("<ellipsoid") == 0
    plain = gantry(collision('<sphere radius="0.1"/>')).urdf
    assert without_ellipsoids(plain) == plain


def test_cylinder_and_its_pose(rng):
    """A ball beside a cylinder and above it."""
    robot = gantry(collision('<sphere radius="0.1"/>'))
    pose = mq.pose([1, 2, 3], rpy=[0.3, 1.1, -0.2])
    limit = CollisionLimit(obstacles=[Cylinder(0.2, 0.8, pose)], influence=20).of(robot)
    assert limit.distance(robot.at(pose.act(np.array([0, 0.5, 0.1])))) == pytest.approx(0.2, abs=1e-7)
    assert limit.distance(robot.at(pose.act(np.array([0.1, 0, 0.9])))) == pytest.approx(0.4, abs=1e-7)


def test_mesh_is_its_hull(rng):
    """A scaled cube as a mesh, with points inside and one mirrored axis, is the box of that size."""
    robot = gantry(collision('<sphere radius="0.1"/>'))
    vertices = np.vstack([CORNERS, rng.uniform(-0.9, 0.9, (50, 3))])
    faces = np.arange(57).reshape(19, 3)
    pose = mq.pose([0.2, 0, 0], rpy=[0.1, 0.2, 0.3])
    mesh = CollisionLimit(obstacles=[Mesh((vertices, faces), pose, [0.1, -0.2, 0.3])], influence=20).of(robot)
    box = CollisionLimit(obstacles=[Box([0.2, 0.4, 0.6], pose)], influence=20).of(robot)
    for _ in range(20):
        at = robot.at(rng.uniform(-1, 1, 3))
        assert mesh.distance(at) == pytest.approx(box.distance(at), abs=1e-6)


def test_hull_of_a_large_mesh_keeps_its_corners_only(rng):
    """100,000 points in a cube are its corners."""
    hull = convex_hull(np.vstack([rng.uniform(-1, 1, (100_000, 3)), CORNERS * 1.001]))
    assert len(hull) == 8


@pytest.mark.parametrize("flatness", [[1, 1, 0], [1, 0, 0], [0, 0, 0]])
def test_flat_mesh_is_thickened(rng, flatness):
    """A sheet, a thread and a point have hulls, a millionth of a metre thick."""
    points = rng.normal(size=(20, 3)) * flatness
    hull = convex_hull(points)
    assert np.ptp(hull, axis=0) == pytest.approx(np.maximum(np.ptp(points, axis=0), THICKNESS), abs=THICKNESS)
    robot = gantry(collision('<sphere radius="0.1"/>'))
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    limit = CollisionLimit(obstacles=[Mesh((points, faces))]).of(robot)
    assert limit.distance(robot.at(np.array([0.0, 0.0, 5.0]))) > 1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Sphere(-0.1), "radius of a Sphere must be positive"),
        (lambda: Sphere(0), "must be positive"),
        (lambda: Sphere(np.nan), "must be finite"),
        (lambda: Sphere("0.1"), "radius of a Sphere must be a real number, not str"),
        (lambda: Box([1, 2]), "shape"),
        (lambda: Box([1, 2, -3]), "must be positive"),
        (lambda: Capsule(0.1, np.inf), "must be finite"),
        (lambda: Cylinder(0.1, -1), "length of a Cylinder must be positive"),
        (lambda: Sphere(1, name=3), "must be text"),
        (lambda: Mesh(3), "a file, or of"),
        (lambda: Mesh((CORNERS, [[0, 1, 8]])), "indices of its 8 vertices"),
        (lambda: Mesh((CORNERS, [[0.5, 1, 2]])), "indices"),
        (lambda: Mesh((np.empty((0, 3)), np.empty((0, 3)))), "at least one"),
        (lambda: Mesh((CORNERS * np.nan, FACES)), "must be finite"),
        (lambda: Mesh((CORNERS, FACES), scale=0), "must not be zero"),
        (lambda: Mesh((CORNERS, FACES), scale=[1, 2]), "shape"),
    ],
)
def test_shapes_refuse(make, words):
    with pytest.raises(OptionError, match=words):
        make()


def test_shape_refuses_what_is_no_pose():
    with pytest.raises(PoseError):
        Sphere(0.1, np.eye(4) * 2)


def test_shape_keeps_its_own_pose():
    """A pose that the caller moves later does not move the obstacle; (4, 4) and `pin.SE3` are the same."""
    T = mq.pose([1, 2, 3])
    sphere, other = Sphere(0.1, T), Sphere(0.1, T.homogeneous)
    T.translation = np.zeros(3)
    assert sphere.pose == other.pose == mq.pose([1, 2, 3])


def test_shapes_pickle():
    mesh = Mesh((CORNERS, FACES)).loaded(())
    for shape in (Sphere(0.1), Ellipsoid([1, 2, 3]), Box([1, 2, 3]), Capsule(0.1, 1), Cylinder(1, 2), mesh):
        copy = pickle.loads(pickle.dumps(shape))
        assert copy.pose == shape.pose == pin.SE3.Identity()
        assert type(copy.solid()) is type(shape.solid())


# Shapes of links


def test_all_shapes_of_a_link_are_read():
    """Several a link, each with its origin and size."""
    origin = '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'
    text = collision('<sphere radius="0.2"/>') + collision('<box size="1 2 3"/>', origin)
    text += collision('<cylinder radius="0.1" length="2"/>') + collision('<capsule radius="0.1" length="2"/>')
    (ball, box, cylinder, capsule) = [shape for link, shape in link_shapes(gantry(text)) if link == "l3"]
    assert (ball.radius, box.size, cylinder.length, capsule.length) == (0.2, (1.0, 2.0, 3.0), 2.0, 2.0)
    assert isinstance(cylinder.solid(), coal.Cylinder)
    assert isinstance(capsule.solid(), coal.Capsule)
    np.testing.assert_allclose(box.pose.homogeneous, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("geometry", "reach"),
    [
        ('<sphere radius="0"/>', 0.0),
        ('<box size="0.2 0 0.4"/>', 0.1),
        ('<cylinder radius="0.3" length="0"/>', 0.3),
        ('<capsule radius="0.3" length="0.0"/>', 0.3),
    ],
)
def test_a_link_shape_of_size_zero_is_a_point_a_sheet_or_a_ball(geometry, reach):
    """A ball 2 m along x is as far as what is left of the shape says."""
    robot = gantry(collision(geometry))
    limit = CollisionLimit(obstacles=[Sphere(0.5, mq.pose([2, 0, 0]))], influence=20).of(robot)
    assert limit.distance(robot.at(np.zeros(3))) == pytest.approx(1.5 - reach, abs=3 * THICKNESS)


@pytest.mark.parametrize(
    ("scale", "reach"), [("0 0 0", 0.0), ("0.2 0.2 0", 0.2), ("0 200 200", 0.0), ("-0.2 0 0", 0.2)]
)
def test_a_mesh_of_scale_zero_is_as_flat_as_that(tmp_path, scale, reach):
    """As other sizes of zero; a mesh in millimetres is no thicker."""
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {i + 1} {j + 1} {k + 1}" for i, j, k in FACES]
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    robot = gantry(collision(f'<mesh filename="cube.obj" scale="{scale}"/>'))
    limit = CollisionLimit(obstacles=[Sphere(0.5, mq.pose([2, 0, 0]))], meshes=[tmp_path], influence=20).of(robot)
    assert limit.distance(robot.at(np.zeros(3))) == pytest.approx(1.5 - reach, abs=3 * THICKNESS)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<collision/>", "no geometry; valid names: sphere"),
        (collision("<cone/>"), "no geometry"),
        (collision('<sphere radius="-1"/>'), "'l3': radius of a Sphere must be positive"),
        (collision('<sphere radius="nan"/>'), "not finite"),
        (collision('<sphere radius="1 2"/>'), "one number"),
        (collision("<sphere/>"), "one number"),
        (collision('<box size="1 2"/>'), "shape"),
        (collision('<box size="a b c"/>'), "not made of numbers"),
        (collision("<mesh/>"), "names no file"),
        (collision('<sphere radius="1"/>', '<origin xyz="1 2"/>'), "3 numbers each"),
        (collision('<sphere radius="1"/>', '<origin rpy="inf 0 0"/>'), "not finite"),
    ],
)
def test_link_shapes_refuse(text, words):
    """The message names the link."""
    with pytest.raises(RobotError, match=words):
        link_shapes(gantry(text))


def write_cube(path, size=1.0):
    """An OBJ file of a cube with edges of `size`."""
    lines = [f"v {' '.join(map(str, 0.5 * size * corner))}" for corner in CORNERS]
    faces = [(1, 2, 3), (4, 2, 3), (5, 6, 7), (8, 6, 7), (1, 2, 5), (6, 2, 5), (3, 4, 7)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines + [f"f {a} {b} {c}" for a, b, c in faces]) + "\n")


def test_mesh_of_a_link_is_found_read_and_scaled(tmp_path):
    """By package, by package when the directory is the package, relative, absolute and as a file URL."""
    file = tmp_path / "parts" / "meshes" / "cube.obj"
    write_cube(file)
    for name, folder in [
        ("package://parts/meshes/cube.obj", tmp_path),
        ("package://parts/meshes/cube.obj", tmp_path / "parts"),
        ("meshes/cube.obj", tmp_path / "parts"),
        (str(file), tmp_path),
        (f"file://{file}", tmp_path),
    ]:
        robot = gantry(collision(f'<mesh filename="{name}" scale="0.1 0.2 0.4"/>'))
        limit = CollisionLimit(obstacles=[Sphere(0.1)], meshes=[folder], influence=20).of(robot)
        assert limit.distance(robot.at(np.array([2.0, 0, 0]))) == pytest.approx(2 - 0.05 - 0.1, abs=1e-7)
        assert limit.distance(robot.at(np.array([0, 0, 2.0]))) == pytest.approx(2 - 0.2 - 0.1, abs=1e-7)
    obstacle = CollisionLimit(obstacles=[Mesh("meshes/cube.obj")], meshes=[tmp_path / "parts"], influence=20)
    robot = gantry(collision('<sphere radius="0.1"/>'))
    assert obstacle.of(robot).distance(robot.at(np.array([2.0, 0, 0]))) == pytest.approx(2 - 0.5 - 0.1, abs=1e-7)


def test_missing_mesh_is_an_error_or_a_warning(tmp_path, caplog):
    """The error names the link, the file and where it was looked for; ignored, the other shapes remain."""
    text = collision('<mesh filename="package://arm/lost.stl"/>') + collision('<sphere radius="0.1"/>')
    robot = gantry(text)
    with pytest.raises(OptionError, match=r"'l3'.*package://arm/lost\.stl.*" + str(tmp_path / "arm" / "lost.stl")):
        CollisionLimit(meshes=[tmp_path]).of(robot)
    with pytest.raises(OptionError, match="no directories are given"):
        CollisionLimit().of(robot)
    with caplog.at_level(logging.WARNING):
        limit = CollisionLimit(obstacles=[Sphere(0.1)], missing="ignore").of(robot)
    assert "lost.stl" in caplog.text
    assert len(limit.scene.pairs) == 1
    with pytest.raises(OptionError, match=r"an obstacle: the mesh 'lost\.stl' is not found"):
        CollisionLimit(obstacles=[Mesh("lost.stl")], missing="ignore").of(robot)


def test_mesh_that_is_none(tmp_path):
    (tmp_path / "bad.stl").write_text("this is no mesh")
    robot = gantry(collision('<mesh filename="bad.stl"/>'))
    with pytest.raises(RobotError, match=r"'l3'.*bad\.stl' cannot be read"):
        CollisionLimit(meshes=[tmp_path]).of(robot)


def test_find_mesh_prefers_the_first_directory(tmp_path):
    for folder in ("a", "b"):
        write_cube(tmp_path / folder / "cube.obj")
    assert find_mesh("cube.obj", [tmp_path / "b", tmp_path / "a"]) == tmp_path / "b" / "cube.obj"
