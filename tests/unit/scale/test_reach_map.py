"""A map says of each pose of its grid what a solve says, however it was made, and others can read it."""

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from support.marked_jobs import files_of

import maira_qp as mq
from maira_qp.errors import JobError, OptionError, PoseError, RobotError
from maira_qp.scale import ReachJob, ReachMap, resume, run, state_of, verify
from maira_qp.solvers.reachability import reachability

zarr = pytest.importorskip("zarr")
CELL, DIRECTIONS, ROLLS = 0.4, 15, 2


@pytest.fixture(scope="module")
def job() -> ReachJob:
    return ReachJob.of(mq.Robot.iiwa14(), cell=CELL, directions=DIRECTIONS, rolls=ROLLS)


@pytest.fixture(scope="module")
def folder(job, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("maps") / "iiwa14.zarr"
    assert run(job, folder, engine="here").finished
    return folder


@pytest.fixture(scope="module")
def reach_map(folder) -> ReachMap:
    return ReachMap.open(folder)


def grid_poses(job: ReachJob) -> np.ndarray:
    """All poses of the grid (cells, orientations, 4, 4), made without the job's own loop."""
    T = np.tile(np.eye(4), (job.count, job.units_per_item, 1, 1))
    X = np.stack(np.meshgrid(*(job.positions.axis(k) for k in range(3)), indexing="ij"), axis=-1)
    T[..., :3, 3] = X.reshape(-1, 1, 3)
    T[..., :3, :3] = job.orientations.rotations.reshape(-1, 3, 3)
    return T


def test_each_verdict_is_that_of_a_solve(job, reach_map):
    T = grid_poses(job)
    batch = mq.Solver(mq.Robot.iiwa14()).solve_batch(T.reshape(-1, 4, 4))
    verdict = reach_map.verdict.reshape(-1)
    assert 0.02 < batch.success.mean() < 0.5
    np.testing.assert_array_equal(verdict == mq.Reach.REACHABLE, batch.success)
    np.testing.assert_array_equal(verdict == mq.Reach.UNREACHABLE, batch.status == mq.Status.UNREACHABLE)


def test_quantities_of_cells_follow_from_the_verdicts_and_the_configurations(job, reach_map):
    verdict, shape = reach_map.verdict, job.shape
    assert verdict.shape == (*shape, DIRECTIONS, ROLLS)
    for kind in mq.Reach:
        np.testing.assert_allclose(reach_map.values(kind.name.lower()), (verdict == kind).mean(axis=(3, 4)), atol=1e-6)
    reached = verdict == mq.Reach.REACHABLE
    np.testing.assert_array_equal(reach_map.values("directions_open"), reached.any(axis=4).sum(axis=3))
    robot = mq.Robot.iiwa14()
    batch = mq.Solver(robot).solve_batch(grid_poses(job).reshape(-1, 4, 4))
    figures = np.full(len(batch), -1.0)
    figures[batch.success] = [robot.manipulability(q) for q in batch.q[batch.success]]
    best = figures.reshape(*shape, -1).max(axis=3)
    best[best < 0] = np.nan
    np.testing.assert_allclose(reach_map.values("manipulability"), best, rtol=1e-5)
    distance = reach_map.values("limit_distance")
    assert (np.isnan(distance) == np.isnan(best)).all()
    assert ((distance[~np.isnan(distance)] >= 0) & (distance[~np.isnan(distance)] <= 1)).all()


def test_the_grid_holds_all_that_can_be_reached(job, rng):
    robot = mq.Robot.iiwa14()
    tips = np.array([robot.forward(robot.random_configuration(rng)).translation for _ in range(500)])
    assert (job.positions.index(tips) >= 0).all()
    assert (np.linalg.norm(tips - job.centre, axis=1) <= job.radius).all()


def test_a_query_of_the_nearest_poses_of_the_grid_gives_their_verdicts(job, reach_map, rng):
    T = grid_poses(job)
    T[..., :3, 3] += rng.uniform(-0.49, 0.49, (*T.shape[:-2], 3)) * CELL
    np.testing.assert_array_equal(reach_map.query(T.reshape(-1, 4, 4), nearest=True), reach_map.verdict.reshape(-1))


def random_poses(job: ReachJob, count: int) -> np.ndarray:
    """Poses (count, 4, 4) uniform over the grid and over all rotations."""
    rng, T = np.random.default_rng(7), np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.from_quat(rng.normal(size=(count, 4))).as_matrix()
    T[:, :3, 3] = CELL * (job.lower + rng.random((count, 3)) * job.shape)
    return T


def naive_weights(job: ReachJob, T: np.ndarray) -> np.ndarray:
    """The weights of all poses of the grid (X, Y, Z, directions, rolls) around a pose (4, 4)."""
    axes = [job.positions.axis(k) for k in range(3)]
    hats = [
        np.maximum(0.0, 1.0 - np.abs(np.clip(p, axis[0], axis[-1]) - axis) / job.cell)
        for p, axis in zip(T[:3, 3], axes, strict=True)
    ]
    vectors = job.orientations.vectors
    chord = np.linalg.norm(vectors - T[:3, 2], axis=1)
    of_directions = np.maximum(0.0, 1.0 - (chord / np.sort(chord)[5]) ** 2)
    of_rolls = np.zeros((job.directions, job.rolls))
    for direction, own in enumerate(job.orientations.rotations):
        along = T[:3, 0] - T[:3, 0] @ vectors[direction] * vectors[direction]
        for roll, R in enumerate(own):
            angle = np.arccos(np.clip(R[:, 0] @ along / np.linalg.norm(along), -1.0, 1.0))
            of_rolls[direction, roll] = max(0.0, 1.0 - angle * job.rolls / (2 * np.pi))
    return np.einsum("x,y,z,d,dr->xyzdr", *hats, of_directions / of_directions.sum(), of_rolls)


def test_a_query_is_what_has_most_of_the_weight_around_a_pose(job, reach_map):
    T = random_poses(job, 300)
    said = reach_map.query(T)
    for one, kind in zip(T, said, strict=True):
        weights = naive_weights(job, one)
        of_kinds = np.array([weights[reach_map.verdict == each].sum() for each in mq.Reach])
        assert of_kinds.sum() == pytest.approx(1.0)
        assert of_kinds[kind] > 0.5 - 1e-9
    assert 0.01 < np.mean(said == mq.Reach.REACHABLE) < 0.5


def test_a_query_errs_less_than_the_nearest_pose(job, reach_map):
    T = random_poses(job, 5000)
    truth = reachability(mq.Solver(mq.Robot.iiwa14()), T).verdict
    around, nearest = reach_map.query(T) != truth, reach_map.query(T, nearest=True) != truth
    assert 0 < around.sum() < 0.7 * nearest.sum()


@pytest.mark.parametrize(
    ("kinds", "said"),
    [
        ((0, 0, 0, 0, 0, 1, 1, 2), mq.Reach.REACHABLE),
        ((2, 1, 1, 0, 1, 0, 1, 1), mq.Reach.UNREACHABLE),
        ((0, 0, 0, 1, 1, 1, 2, 2), mq.Reach.UNDECIDED),
    ],
)
def test_what_a_query_says_has_more_than_half_of_the_weight(kinds, said, job, folder):
    """At a corner of eight cells each has an eighth."""
    reach = ReachMap.open(folder)
    parity = np.indices(job.shape) % 2
    of_cells = np.array(kinds)[4 * parity[0] + 2 * parity[1] + parity[2]]
    reach.verdict = np.broadcast_to(of_cells[..., None, None], reach.verdict.shape).astype(np.int8)
    T = np.eye(4)
    T[:3, 3] = CELL * (np.array(job.lower) + np.array(job.shape) // 2)
    assert reach.query([T]).tolist() == [said]


@pytest.mark.parametrize("pose", [np.eye(4), pin.SE3.Identity()])
def test_a_query_of_one_pose_says_how(reach_map, pose):
    with pytest.raises(PoseError, match=r"for one pose: query\(\[pose\]\)$"):
        reach_map.query(pose)
    assert reach_map.query([pose]).shape == (1,)


def test_a_query_outside_of_the_grid_is_unreachable_only_beyond_the_reach(tmp_path):
    small = ReachJob.of(mq.Robot.iiwa14(), cell=0.2, directions=4, box=[(0.0, 0.4), (0.0, 0.2), (0.2, 0.4)])
    assert small.shape == (2, 1, 1)
    run(small, tmp_path, engine="here")
    T = np.tile(np.eye(4), (6, 1, 1))
    T[:5, :3, 3] = [[0.1, 0.1, 0.3], [-0.1, 0.1, 0.3], [9.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]]
    T[5, :3] = [0.0, 0.0, np.inf, 0.1], [0.0, 1.0, 0.0, 0.1], [0.0, 0.0, 1.0, 0.3]
    for nearest in (False, True):
        found = ReachMap.open(tmp_path).query(T, nearest=nearest)
        assert found[0] in (mq.Reach.REACHABLE, mq.Reach.UNREACHABLE)
        assert found[1:3].tolist() == [mq.Reach.UNDECIDED, mq.Reach.UNREACHABLE]
        assert (found[3:] == mq.Reach.UNDECIDED).all()


def test_places_and_planes(job, reach_map):
    at = [[0.1, 0.1, 0.5], [50.0, 0.0, 0.0]]
    values = reach_map.at(at, "reachable")
    cell = np.unravel_index(job.positions.index(np.array(at[:1])), job.shape)
    assert values[0] == reach_map.values("reachable")[cell][0]
    assert np.isnan(values[1])
    for plane, axes in (("xy", (0, 1)), ("xz", (0, 2)), ("yz", (1, 2))):
        cut = reach_map.slice(plane, 0.3, "directions_open")
        assert cut.values.shape == (job.shape[axes[1]], job.shape[axes[0]])
        assert abs(cut.at - 0.3) <= CELL / 2
        across = ({0, 1, 2} - set(axes)).pop()
        index = [slice(None)] * 3
        index[across] = int(np.argmin(np.abs(job.positions.axis(across) - cut.at)))
        np.testing.assert_array_equal(cut.values.T, reach_map.values("directions_open")[tuple(index)])
    with pytest.raises(OptionError, match="at must be from"):
        reach_map.slice("xy", 99.0)
    with pytest.raises(OptionError, match="did you mean 'reachable'"):
        reach_map.values("reachabel")


def test_a_surface_is_between_the_cells_that_have_more_and_those_that_have_less(job, reach_map):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("skimage")
    share = reach_map.values("reachable")
    vertices, faces = reach_map.surface("reachable", 0.3)
    closed = trimesh.Trimesh(vertices, faces)
    assert closed.is_watertight
    about = np.array(job.centre)
    assert (np.linalg.norm(vertices - about, axis=1) < job.radius + CELL).all()
    first = np.array([job.positions.axis(k)[0] for k in range(3)])
    assert (vertices.min(axis=0) > first - CELL).all()
    volume = (share >= 0.3).sum() * CELL**3
    assert 0.4 * volume < closed.volume < 1.6 * volume
    assert reach_map.surface("manipulability", 0.05).faces.shape[1] == 3
    for level in (0.0, 1.01, np.nan):
        with pytest.raises(OptionError, match="level must be between 0 and"):
            reach_map.surface("reachable", level)


def test_the_store_is_the_same_for_any_cut_and_engine(job, folder, tmp_path):
    run(job, tmp_path / "cut", engine="here", part=(2, 3), shard=17)
    run(job, tmp_path / "cut", engine="processes", workers=1, shard=50)
    assert files_of(tmp_path / "cut") == files_of(folder)


def test_blocks_of_the_store_are_planes(job, folder, tmp_path, monkeypatch):
    """Chunks of one plane each hold what one chunk holds."""
    monkeypatch.setattr("maira_qp.scale.reach.job.BLOCK", 1)
    run(job, tmp_path / "planes", engine="here")
    planes = zarr.open_group(tmp_path / "planes", mode="r")
    assert planes["verdict"].chunks[0] == 1
    np.testing.assert_array_equal(planes["verdict"][...], ReachMap.open(folder).verdict)


def test_a_finished_map_that_was_damaged_is_made_again(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "map")
    chunk = next(path for path in (tmp_path / "map" / "verdict").rglob("*") if path.is_file() and path.parent != "c")
    chunk.write_bytes(b"")
    assert len(verify(tmp_path / "map").damaged) == 1
    resume(tmp_path / "map", engine="here")
    assert files_of(tmp_path / "map") == files_of(folder)
    assert verify(tmp_path / "map")


def test_the_metadata_say_what_was_computed(job, folder):
    metadata = json.loads((folder / "zarr.json").read_text())
    assert metadata["zarr_format"] == 3
    assert {"verdict", "reachable", "x", "direction_vector"} <= set(metadata["consolidated_metadata"]["metadata"])
    said = metadata["attributes"]
    assert said["robot"] == "iiwa14"
    assert said["cell"] == CELL
    assert said["options"]["position_tolerance"] == 1e-6
    assert said["joint_limits"]["joint1"] == pytest.approx(np.radians([-170, 170]).tolist())
    assert mq.Robot.from_urdf(said["urdf"], tip=said["tip"], base=said["base"]).n == 7
    assert set(said["versions"]) >= {"maira-qp", "numpy", "numba", "source"}


@pytest.mark.filterwarnings("ignore")
def test_xarray_reads_it(folder, reach_map):
    xarray = pytest.importorskip("xarray")
    with xarray.open_zarr(folder) as data:
        assert data["reachable"].dims == ("x", "y", "z")
        assert data["verdict"].dims == ("x", "y", "z", "direction", "roll")
        np.testing.assert_array_equal(data["reachable"].values, reach_map.values("reachable"))
        near = data["reachable"].sel(x=0.2, y=0.2, z=0.6, method="nearest")
        assert float(near) == reach_map.at([[0.2, 0.2, 0.6]])[0]


def test_a_map_is_shown_and_pickles(reach_map):
    assert "ReachMap of iiwa14" in repr(reach_map)
    again = pickle.loads(pickle.dumps(reach_map))
    np.testing.assert_array_equal(again.verdict, reach_map.verdict)


def test_what_is_no_finished_map_is_refused(job, tmp_path):
    with pytest.raises(JobError, match="holds no job"):
        ReachMap.open(tmp_path)
    run(job, tmp_path / "map", engine="here", part=(1, 9))
    with pytest.raises(JobError, match="not finished: maira-qp job resume"):
        ReachMap.open(tmp_path / "map")
    assert state_of(tmp_path / "map").done < job.count * job.units_per_item


def test_jobs_that_make_no_sense_are_refused(maira):
    for options, said in (
        ({"cell": 0.0}, "cell must be a positive number"),
        ({"cell": np.nan}, "cell must be a positive number"),
        ({"directions": 0}, "directions must be a positive"),
        ({"rolls": 1.5}, "rolls must be a positive"),
        ({"seed": -1}, "seed must be a non-negative"),
        ({"proof_boxes": -1}, "proof_boxes must be a non-negative"),
        ({"box": [(0, 1), (0, 1)]}, "box must be"),
        ({"box": [(1, 0), (0, 1), (0, 1)]}, "box must be"),
        ({"cell": 1e-6}, "too large"),
    ):
        with pytest.raises(OptionError, match=said):
            ReachJob.of(maira, **options)
    with pytest.raises(RobotError):
        ReachJob.of(mq.Robot.from_model(maira.model, tip=maira.tip))


def test_the_reach_of_an_arm_with_a_slide_is_bounded_by_its_range():
    links = [{"kind": "revolute", "d": 0.1}, {"kind": "prismatic", "lower": 0.0, "upper": 0.5}]
    job = ReachJob.of(mq.Robot.from_dh(links, name="slide"), cell=0.2, directions=3)
    assert 0.25 < job.radius < 1.0
