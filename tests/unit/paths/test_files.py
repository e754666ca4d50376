"""Paths from CSV files."""

import numpy as np
import pinocchio as pin
import pytest
from support.paths import random_pose, random_poses

from maira_qp import paths
from maira_qp.errors import OptionError, PoseError


def written(file, header, rows):
    file.write_text("\n".join([header, *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n")
    return file


def test_a_path_comes_back_from_its_quaternions_matrices_and_angles(rng, tmp_path):
    poses = random_poses(rng, 20)
    quaternions = [pin.Quaternion(T[:3, :3]) for T in poses]
    rows = [[*T[:3, 3], q.w, q.x, q.y, q.z, 7.0] for T, q in zip(poses, quaternions, strict=True)]
    file = written(tmp_path / "a.csv", "x,y,z,qw,qx,qy,qz,q0_joint1", rows)
    np.testing.assert_allclose(paths.from_csv(file), poses, atol=1e-12)
    np.testing.assert_allclose(paths.from_csv(str(file)), poses, atol=1e-12)
    frame = random_pose(rng)
    np.testing.assert_allclose(paths.from_csv(file, frame=frame), frame.homogeneous @ poses, atol=1e-12)
    names = ",".join(f"m{i}{j}" for i in range(3) for j in range(4))
    file = written(tmp_path / "b.csv", names, [T[:3].ravel() for T in poses])
    np.testing.assert_allclose(paths.from_csv(file), poses, atol=1e-12)
    angles = [[*T[:3, 3], *np.degrees(pin.rpy.matrixToRpy(T[:3, :3]))] for T in poses]
    file = written(tmp_path / "c.csv", "x,y,z,roll,pitch,yaw", angles)
    np.testing.assert_allclose(paths.from_csv(file, degrees=True), poses, atol=1e-9)
    assert not np.allclose(paths.from_csv(file), poses)
    rows = [[*1e3 * T[:3, 3], q.w, q.x, q.y, q.z] for T, q in zip(poses, quaternions, strict=True)]
    file = written(tmp_path / "d.csv", "x,y,z,qw,qx,qy,qz", rows)
    np.testing.assert_allclose(paths.from_csv(file, millimetres=True), poses, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,0\n0,0,,1,0,0,0\n", "line 3: a pose of a path has an empty cell"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,nan\n", "line 2: a pose of a path has an empty cell, NaN"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,1,0,0\n", "line 2: the quaternion's norm is .* project=True"),
        ("x,y,z,qw,qx,qy,qz\n", "holds no pose"),
        ("x,y,z\n0,0,0\n", "no column of an orientation"),
        ("", "is empty"),
    ],
)
def test_a_bad_line_is_named(tmp_path, text, message):
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(PoseError, match=message):
        paths.from_csv(file)


def test_only_names_of_csv_files_are_taken(tmp_path):
    for file in (tmp_path / "path.npz", 3, None):
        with pytest.raises(OptionError, match=r"\.csv"):
            paths.from_csv(file)
    with pytest.raises(PoseError):
        paths.from_csv(tmp_path / "missing.csv")
