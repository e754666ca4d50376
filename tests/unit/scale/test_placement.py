"""Bases ranked for tool poses: what is reported of them is what a solver finds, and nothing better is left out."""

import csv
import json
import pickle

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.errors import OptionError, PoseError
from maira_qp.scale.placement.candidates import Candidates, poses_of_bases, seen_from
from maira_qp.scale.reach.metrics import limit_distances

BASE = mq.pose([0.7, -0.4, 0.2], rpy=[0.0, 0.0, np.pi / 3])
GRID = {"x": (0.3, 1.1), "y": (-0.8, 0.0), "z": 0.2, "step": 0.4, "turn": np.pi / 3}
"""It has `BASE` in it."""


@pytest.fixture(scope="module")
def poses(iiwa14) -> np.ndarray:
    """Tool poses (12, 4, 4) that are reached from `BASE`."""
    rng = np.random.default_rng(5)
    return np.array([(BASE * iiwa14.forward(iiwa14.random_configuration(rng))).homogeneous for _ in range(12)])


@pytest.fixture(scope="module")
def found(iiwa14, poses) -> mq.scale.Placements:
    return mq.scale.place(iiwa14, poses, **GRID, keep=9)


@pytest.fixture(scope="module")
def reach_map(iiwa14, tmp_path_factory) -> mq.scale.ReachMap:
    pytest.importorskip("zarr")
    folder = tmp_path_factory.mktemp("maps") / "iiwa14.zarr"
    mq.scale.run(mq.scale.ReachJob.of(iiwa14, cell=0.2, directions=40), folder, engine="here")
    return mq.scale.ReachMap.open(folder)


def test_the_base_that_the_poses_were_made_from_comes_first(found):
    assert found
    assert found[0].reached == 12
    np.testing.assert_allclose(found[0].values[:3], BASE.translation, atol=1e-12)  # another turn may do as well
    assert len(found) == 9
    assert [each.share for each in found] == sorted((each.share for each in found), reverse=True)
    assert len({tuple(each.values[:3]) for each in found}) == 9


def test_joint_values_put_the_tool_there(iiwa14, poses, found):
    """Seen from the world, by Pinocchio."""
    for each in found:
        for T, s in zip(poses, each.solution, strict=True):
            if s.success:
                at = each.base * pin.SE3(iiwa14.forward(s.q))
                assert np.linalg.norm(pin.log6(at.actInv(pin.SE3(T))).vector) < 1e-5


def test_every_base_is_compared(iiwa14, poses, found):
    """By a loop over all bases, each solved alone."""
    solver = mq.Solver(iiwa14, redundancy=mq.Strict(mq.LimitDistance()))
    scores = {}
    for x in found.axes[0]:
        for y in found.axes[1]:
            for yaw in found.axes[3]:
                base = mq.pose([x, y, 0.2], rpy=[0, 0, yaw])
                batch = solver.solve_batch(np.array([base.actInv(pin.SE3(T)).homogeneous for T in poses]))
                distance = limit_distances(iiwa14, batch.q[batch.success])
                worth = batch.success.mean(), distance.min(initial=2.0), distance.mean() if len(distance) else 0.0
                scores[x, y] = max(scores.get((x, y), (0.0, 0.0, 0.0)), worth)
    assert len(scores) == 9
    ranked = sorted(scores.values(), reverse=True)
    np.testing.assert_allclose([(each.share, each.least, each.mean) for each in found], ranked, rtol=1e-6)
    best = max(scores, key=scores.__getitem__)
    np.testing.assert_allclose(found[0].values[:2], best, atol=1e-12)


def test_a_map_finds_the_same_base_and_what_is_said_is_solved(iiwa14, poses, reach_map):
    by_map = mq.scale.place(reach_map, poses, **GRID, keep=3)
    np.testing.assert_allclose(by_map[0].values[:3], BASE.translation, atol=1e-12)
    assert by_map[0].estimate != by_map[0].share == 1.0  # the cells are coarse
    again = mq.Solver(iiwa14).solve_batch(seen_from(poses_of_bases(by_map[1].values[None]), poses)[0])
    assert by_map[1].reached == again.success.sum()
    assert by_map[1].unreachable == (again.status == mq.Status.UNREACHABLE).sum()


def test_an_arm_that_is_no_srs_arm(panda):
    rng = np.random.default_rng(7)
    poses = [BASE * panda.forward(panda.random_configuration(rng)) for _ in range(4)]
    found = mq.scale.place(panda, poses, **(GRID | {"y": -0.4, "yaw": np.pi / 3}), quality="manipulability", keep=2)
    assert found[0].base.isApprox(BASE, 1e-9)
    q = found[0].solution.q
    assert found[0].least == pytest.approx(min(map(panda.manipulability, q)), rel=1e-9)
    assert found[0].mean == pytest.approx(np.mean([*map(panda.manipulability, q)]), rel=1e-9)


def test_without_ranges_all_bases_are_there_that_reach_something(iiwa14, poses):
    found = mq.scale.place(iiwa14, poses[:1], z=0.2, step=0.5, turn=np.pi, keep=1)
    assert found[0].reached == 1
    floor = found.floor
    assert floor.max() == 1.0
    assert not floor[[0, -1]].any()
    assert not floor[:, [0, -1]].any()


def test_nothing_is_reached_from_afar(iiwa14, poses):
    found = mq.scale.place(iiwa14, poses, x=9.0, y=(9.0, 9.1), keep=5)
    assert not found
    assert len(found) == 2
    assert (found[0].reached, found[0].unreachable, found[0].share) == (0, 12, 0.0)
    assert np.isnan(found[0].least)
    assert found[0].as_dict()["least"] is None


def test_bases_in_files(found, tmp_path):
    rows = list(csv.DictReader(found.save(tmp_path / "bases.csv").read_text().splitlines()))
    assert [int(row["rank"]) for row in rows] == list(range(1, 10))
    assert [int(row["reached"]) for row in rows] == [each.reached for each in found]
    values = [[float(row[name]) for name in ("x", "y", "z", "yaw")] for row in rows]
    np.testing.assert_array_equal(values, [each.values for each in found])
    said = json.loads(found.save(tmp_path / "bases.json").read_text())
    assert said["bases"] == [each.as_dict() for each in found]
    assert said["compared"] == 3 * 3 * 6
    with pytest.raises(OptionError, match=r"ends in \.csv or \.json, not 'bases.txt'"):
        found.save(tmp_path / "bases.txt")


def test_it_is_shown_in_80_columns_and_pickles(found):
    for shown in (repr(found), repr(found[0])):
        assert max(map(len, shown.splitlines())) <= 80
    again = pickle.loads(pickle.dumps(found))
    assert repr(again) == repr(found)
    np.testing.assert_array_equal(again.floor, found.floor)


def test_a_whole_turn_has_its_end_once():
    grid = Candidates.of(1.0, (0.0, 1.0), 0.0, (-np.pi, np.pi), 0.3, np.radians(30.0))
    assert grid.shape == (1, 5, 1, 12)
    np.testing.assert_allclose(np.diff(grid.axes[3]), np.radians(30.0))
    assert np.diff(grid.axes[1]).max() <= 0.3
    np.testing.assert_allclose(grid.values([13]), [[1.0, 0.25, 0.0, -np.pi + np.radians(30.0)]])
    assert Candidates.of(1.0, 0.0, 0.0, (0.0, np.pi), 0.3, np.pi / 2).shape == (1, 1, 1, 3)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"x": (1.0, 0.0)}, "x must be a number or a range, the lower end first"),
        ({"z": np.nan}, "z must be a number"),
        ({"yaw": (0.0, 7.0)}, "yaw must be a range of at most a turn"),
        ({"step": 0.0}, "step must be a positive number"),
        ({"turn": -1.0}, "turn must be a positive number"),
        ({"step": 1e-9}, "are too many, at most 10000000 are compared: make step or turn larger"),
        ({"keep": 0}, "keep must be a positive whole number"),
        ({"quality": "manipulabilty"}, "did you mean 'manipulability'"),
        ({"progress": 3}, "progress must be a function"),
    ],
)
def test_mistakes_are_said(iiwa14, poses, wrong, words):
    with pytest.raises(OptionError, match=words):
        mq.scale.place(iiwa14, poses, **(GRID | wrong))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_poses_that_are_none_are_said(iiwa14, poses, value):
    with pytest.raises(PoseError, match="there is no pose"):
        mq.scale.place(iiwa14, [], **GRID)
    with pytest.raises(PoseError, match=r"place\(reach, \[pose\]\)"):
        mq.scale.place(iiwa14, poses[0], **GRID)
    broken = poses.copy()
    broken[3, 0, 3] = value
    with pytest.raises(PoseError, match="pose 3 must be finite"):
        mq.scale.place(iiwa14, broken, **GRID)
    with pytest.raises(OptionError, match="reach must be a ReachMap or a Robot"):
        mq.scale.place("iiwa14", poses)  # type: ignore[arg-type]
