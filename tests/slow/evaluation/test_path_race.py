"""The benchmark of paths, without the peers: the paths, the criterion, the clock, who follows, and what it reports."""

import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from maira_qp.errors import OptionError
from maira_qp.evaluation.contestant import Contestant
from maira_qp.evaluation.judge import turn

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from paths import judging, line_up, local, motions, ours, race, report, results
from paths.judging import Criterion, verdict
from paths.with_roboplan import nearest
from peers import arms


@pytest.fixture(scope="module", params=arms.SOURCES)
def arm(request, tmp_path_factory):
    return arms.load(request.param, tmp_path_factory.mktemp("arms"))


@pytest.fixture(scope="module")
def maira(tmp_path_factory):
    return arms.load("maira", tmp_path_factory.mktemp("maira"))


@pytest.fixture
def slow(maira):
    """A motion of MAIRA of 50 poses, in the middle of its limits, and its path."""
    q = np.linspace(0.2, 0.7, 50)[:, None] * np.array([1.0, 0.5, -0.5, 1.0, 0.3, 0.8, -1.0])
    return motions.Path("slow", maira.judge.forward(q), q)


def whole(arm, path, q, criterion=None, **given):
    return verdict(arm.judge, path, q, criterion or Criterion(), **given).whole


# The paths


def test_a_made_path_is_followed_whole_by_the_motion_that_it_was_made_from(arm):
    for path in motions.made(arm, 8, 200, 0):
        found = verdict(arm.judge, path, path.motion, Criterion(), path.start)
        assert found == judging.Verdict(200, 0, True)
        assert (path.motion >= arm.lower).all()
        assert (path.motion <= arm.upper).all()
        assert 0.0 < judging.largest_step(path.motion) < 0.5


def test_the_poses_are_those_of_the_motion_says_pinocchio(arm):
    (path,) = motions.made(arm, 1, 20, 3)
    for q, pose in zip(path.motion, path.poses, strict=True):
        np.testing.assert_allclose(arm.robot.forward(q).homogeneous, pose, atol=1e-12)


def test_a_quarter_of_the_motions_has_control_points_at_limits(arm):
    """A curve begins and ends at control points, and in between it stays clear of limits that it does not begin at."""
    for number, path in enumerate(motions.made(arm, 16, 50, 1)):
        ends = path.motion[[0, -1]]
        at = np.isclose(ends, arm.lower, atol=1e-9) | np.isclose(ends, arm.upper, atol=1e-9)
        assert at.any() == (number % 4 == 3)


def test_paths_are_those_of_the_seed_however_many_there_are(maira):
    few, many, other = motions.made(maira, 2, 30, 5), motions.made(maira, 4, 30, 5), motions.made(maira, 2, 30, 6)
    for a, b, c in zip(few, many, other, strict=False):
        np.testing.assert_array_equal(a.motion, b.motion)
        assert np.abs(a.motion - c.motion).max() > 1e-3
    assert np.abs(few[0].motion - few[1].motion).max() > 1e-3


def test_curves_between_limits_do_not_leave_them_by_rounding(maira):
    q = np.vstack([path.motion for path in motions.made(maira, 400, 30, 2)])
    assert (q >= maira.lower).all()
    assert (q <= maira.upper).all()


def test_paths_come_from_files(maira, slow, tmp_path):
    header = ",".join(f"m{row}{column}" for row in range(3) for column in range(4))
    for name in ("b", "a"):
        np.savetxt(
            tmp_path / f"{name}.csv", slow.poses[:, :3].reshape(-1, 12), delimiter=",", header=header, comments=""
        )
    found = motions.read(tmp_path)
    assert [path.name for path in found] == ["a", "b"]
    for path in found:
        np.testing.assert_allclose(path.poses, slow.poses, atol=1e-12)
        assert path.motion is path.start is None
        assert whole(maira, path, slow.motion)
    with pytest.raises(OptionError, match=r"holds no \.csv file"):
        motions.read(tmp_path / "nothing")


# The criterion


def test_a_jump_is_refused_where_every_pose_is_reached(tmp_path):
    """A joint that makes a whole turn from one pose to the next."""
    arm = arms.load("xarm7", tmp_path)
    q = np.tile(0.5 * (arm.lower + arm.upper), (20, 1))
    q[:, 0] = -1.0
    path = motions.Path("still", arm.judge.forward(q))
    assert whole(arm, path, q)
    q[10:, 0] += 2.0 * np.pi
    assert verdict(arm.judge, path, q, Criterion()) == judging.Verdict(20, 1, False)
    assert whole(arm, path, q, Criterion(reconfigurations=1))
    q[12, 0] -= 2.0 * np.pi
    assert not whole(arm, path, q, Criterion(reconfigurations=1))


def test_a_step_counts_up_to_three_times_that_of_the_motion_and_up_to_its_size(maira, slow):
    step = judging.largest_step(slow.motion)
    for slower, followed in ((2.9, True), (3.1, False)):
        motion = slow.motion[0] + (slow.motion - slow.motion[0]) / slower
        assert whole(maira, replace(slow, motion=motion), slow.motion) is followed
    for largest, followed in ((1.01 * step, True), (0.99 * step, False)):
        assert whole(maira, slow, slow.motion, Criterion(step=largest)) is followed


@pytest.mark.parametrize("joint", range(7))
def test_a_limit_that_is_broken_is_refused(maira, slow, joint):
    for limit, outwards in ((maira.upper, 1.0), (maira.lower, -1.0)):
        q = slow.motion.copy()
        q[:, joint] = limit[joint]
        assert whole(maira, motions.Path("on the limit", maira.judge.forward(q)), q)
        q[30, joint] += outwards * 1e-10
        path = motions.Path("beyond", maira.judge.forward(q))
        assert not whole(maira, path, q)
        assert whole(maira, path, q, slack=1e-9)


@pytest.mark.parametrize(("factor", "followed"), [(0.99, True), (1.01, False)])
def test_errors_count_up_to_their_tolerances(maira, slow, factor, followed):
    moved, turned = slow.poses.copy(), slow.poses.copy()
    moved[17, 1, 3] += factor * 1e-4
    turned[49, :3, :3] = turned[49, :3, :3] @ turn(np.array([0.0, 0.6, 0.8]), factor * 1e-3)
    for poses in (moved, turned):
        found = verdict(maira.judge, replace(slow, poses=poses), slow.motion, Criterion())
        assert (found.reached, found.whole) == (50 if followed else 49, followed)
        assert whole(maira, replace(slow, poses=poses), slow.motion, Criterion(position=2e-4, orientation=2e-3))


def test_the_way_from_a_given_start_is_a_step(maira, slow):
    assert whole(maira, slow, slow.motion, start=slow.motion[0])
    assert not whole(maira, slow, slow.motion, start=slow.motion[0] + 0.1)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_who_gives_up_has_not_followed(maira, slow, bad):
    q = slow.motion.copy()
    assert not whole(maira, slow, None)
    assert not whole(maira, slow, q[:0])
    assert verdict(maira.judge, slow, q[:49], Criterion()) == judging.Verdict(49, 0, False)
    q[20, 3] = bad
    found = verdict(maira.judge, slow, q, Criterion())
    assert (found.reached, found.whole) == (49, False)


# The clock


def test_everybody_follows_every_path_in_turns_from_the_start_that_is_meant(slow):
    order, seen = [], []

    def contestant(name):
        def follow(poses, start):
            order.append(name)
            seen.append(start)
            if name == "c":
                raise RuntimeError("no idea")
            return slow.motion

        return Contestant(name=name, follow=follow)

    for given in (False, True):
        order.clear()
        seen.clear()
        runs = race.race([slow, slow], [contestant(name) for name in "abc"], starts_given=given, advance=lambda: None)
        assert "".join(order) == "abc" + "bca"
        assert all((start is not None) is given for start in seen)
        assert [[run.error for run in along] for along in runs][2] == ["RuntimeError: no idea"] * 2
        assert all(run.q is None for run in runs[2])
        assert all(run.q is slow.motion and run.seconds >= 0.0 for along in runs[:2] for run in along)


def test_the_conversion_of_a_path_is_not_timed(slow, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(race, "process_time", lambda: now[0])

    def native(poses):
        now[0] += 100.0
        return poses

    def follow(poses, start):
        now[0] += 2.0
        return slow.motion

    ((run,),) = race.race(
        [slow], [Contestant(name="a", native=native, follow=follow)], starts_given=False, advance=lambda: None
    )
    assert run.seconds == 2.0


# Who follows


@pytest.mark.parametrize("given", [False, True])
def test_ours_follow_an_easy_path(maira, slow, given):
    contestants = ours.followers(maira, Criterion())
    assert [each.name for each in contestants] == [ours.TRACK, "maira_qp greedy", "maira_qp step"]
    runs = race.race([slow], contestants, starts_given=given, advance=lambda: None)
    rows = results.judged(contestants, runs, [slow], maira.judge, Criterion())
    assert not any(row.errors for row in rows)
    followed = [row.whole == 1.0 for row in rows]
    assert followed[0]
    if given:
        assert all(followed)


def test_greedy_stops_where_it_finds_nothing(slow):
    answers = iter([slow.motion[0], slow.motion[1], None])
    made = local.greedy(Contestant(name="peer solve", solve=lambda target, q: next(answers)))
    assert made.name == "peer greedy"
    np.testing.assert_array_equal(made.follow(list(slow.poses), None), slow.motion[:2])
    assert local.greedy(Contestant(name="x", solve=lambda target, q: None)).follow(list(slow.poses), None) is None


def test_a_peer_that_is_missing_leaves_a_remark(maira, monkeypatch):
    monkeypatch.setattr(line_up, "PEERS", {"Missing": ("no_such_module", "nothing", "paths.nowhere", "nobody")})
    contestants, remarks = line_up.line_up(maira, Criterion())
    assert len(contestants) == 3
    assert remarks == ["Missing: skipped, not installed (pip install 'nothing')"]


@pytest.mark.parametrize(("imported", "build"), [("pink", local.pink), ("mink", local.mink)])
def test_peers_that_are_installed_follow_an_easy_path(maira, slow, imported, build):
    pytest.importorskip(imported)
    made = build(maira)
    q = made.follow(made.native(slow.poses), slow.start)
    assert whole(maira, slow, q, start=slow.start, slack=made.slack)


def test_a_trajectory_is_read_off_where_it_comes_nearest_to_each_pose(maira, slow):
    """The trajectory has other samples than the path has poses, and passes the poses in between two of them."""
    (fine,) = motions.made(maira, 1, 2000, 2)
    poses = fine.poses[3::11]
    found = nearest(maira, fine.motion[::7], poses)
    assert whole(maira, motions.Path("", poses), found)
    assert np.abs(found - fine.motion[3::11]).max() < 1e-3
    np.testing.assert_array_equal(nearest(maira, slow.motion[:1], poses[:3]), slow.motion[[0, 0, 0]])


# What it reports


def rows_of(*shares):
    """A row for each share of ten paths that is followed whole, each slower than the one before."""
    return [
        results.Row(
            name=(ours.TRACK, "Other step", "Third")[k],
            settings="none",
            verdicts=[judging.Verdict(5, 0, i < 10 * share) for i in range(10)],
            seconds=np.full(10, 1e-3 * (k + 1)),
            errors=["ValueError: no idea"] if k == 2 else [],
        )
        for k, share in enumerate(shares)
    ]


def printed(*tables):
    console = Console(file=io.StringIO(), record=True, width=report.WIDTH)
    for table in tables:
        console.print(table)
    text = console.export_text()
    return text, [[cell.strip() for cell in line.split("│")][1:-1] for line in text.splitlines() if line[:1] == "│"]


def test_the_tables_have_everybody_who_follows_most_first_and_ours_as_the_unit(slow):
    free, true = rows_of(0.9, 0.5, 1.0), rows_of(1.0, 0.6, 1.0)
    text, cells = printed(report.of_motions("arm", [slow] * 10, free, true), report.conditions(Criterion()))
    assert "arm: 10 paths of 50 poses" in text
    assert cells == [
        ["Third", "none", "100.0 %", "100.0 %", "3.00", "3.00", "3.00"],
        [ours.TRACK, "none", "90.0 %", "100.0 %", "1.00", "1.00", "1.00"],
        ["Other step", "none", "50.0 %", "60.0 %", "2.00", "2.00", "2.00"],
    ]
    assert report.errors(*free, *true) == ["Third: 2 runs raised, first ValueError: no idea"]
    assert max(map(len, text.splitlines())) <= report.WIDTH


def test_a_table_of_files_has_a_row_for_each_file_and_method(slow):
    rows = rows_of(0.1, 1.0)
    _, cells = printed(report.of_files("arm", "set", [replace(slow, name="one"), replace(slow, name="two")], rows))
    assert cells == [
        ["one", ours.TRACK, "50", "5", "0", "yes", "1.00"],
        ["one", "Other step", "50", "5", "0", "yes", "2.00"],
        ["two", "Other step", "50", "5", "0", "yes", "2.00"],
        ["two", ours.TRACK, "50", "5", "0", "no", "1.00"],
    ]


def test_a_table_of_long_paths_has_seconds():
    _, cells = printed(report.of_lengths([report.Length("maira", 10000, True, 1.234)]))
    assert cells == [["maira", "10000", "yes", "1.23"]]
