"""Paths in the viewer's session: made, followed, scrubbed, played, explained, saved and left, without a browser."""

import contextlib

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.apps.viewer.drawing.path import MOST_SEGMENTS, segments, thinned
from maira_qp.apps.viewer.drawing.surroundings import MARGIN
from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.paths import words
from maira_qp.apps.viewer.paths.route import MOST_CORNERS, MOST_POSES, Route
from maira_qp.apps.viewer.quantities import UNITS
from maira_qp.apps.viewer.saving import save
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import Standing, View
from maira_qp.errors import MairaError, OptionError, PoseError
from maira_qp.wording import in_units

DT = 1 / 60


def tick(session: Session, count: int = 1) -> View:
    """Ticks, with all jobs done at once between them; each is looked at."""
    for _ in range(count):
        view = session.tick(DT)
        check(session, view)
        while (job := session.next_job() or session.next_long_job()) is not None:
            job.write(job.think())
    return view


def check(session: Session, view: View) -> None:
    """What is drawn is what is said: at a pose of the path the arm is exactly that of the answer, its errors are those
    of a fresh forward kinematics, and a pose that is not reached, or is behind a break, is said to be so."""
    robot, station, text = session.robot, view.path.station, readout.readout(view)
    assert ((robot.lower <= view.q) & (view.q <= robot.upper)).all()
    assert (station is not None) == (view.standing in (Standing.ON_PATH, Standing.OFF_PATH))
    if station is None:
        assert "of 0 to" not in text
        return
    path, k = station.path.solution, station.index
    np.testing.assert_array_equal(view.q, path.q[k])
    np.testing.assert_array_equal(view.target.homogeneous, station.path.route.poses[k])
    error = mq.pose_error(robot.forward(view.q), view.target)
    position, orientation = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
    is_reached = position < 1.1e-6 and orientation < 1.1e-6
    assert (view.standing is Standing.ON_PATH) == (is_reached and k not in {failure.index for failure in path.failures})
    assert f"pose {k} of 0 to {len(path) - 1}: {'reached' if is_reached else 'not reached'}" in text
    assert all(in_units(failure.reason, UNITS) in text for failure in path.failures if failure.index == k)


def moved(T: np.ndarray, *way: float) -> np.ndarray:
    """A pose (4, 4) elsewhere, with the same orientation."""
    T = T.copy()
    T[:3, 3] += way
    return T


def recorded(session: Session, *poses: np.ndarray) -> None:
    """Corners, each after the arm was moved there."""
    for T in poses:
        session.move_target(T)
        tick(session, 5)
        session.lay(session.route.with_corner(session.target.homogeneous))


@pytest.fixture
def session(maira) -> Session:
    return Session(maira)


@pytest.fixture
def home(session) -> np.ndarray:
    return session.target.homogeneous


def turn_too_many() -> np.ndarray:
    """Poses (150, 4, 4) on more than a turn about the base, for which no joint has room."""
    angles = np.linspace(-3.0, 8.0, 150)
    return np.array(
        [
            mq.pose(
                [0.55 * np.cos(a), 0.55 * np.sin(a), 0.5], quaternion=[0, np.cos(a / 2), np.sin(a / 2), 0]
            ).homogeneous
            for a in angles
        ]
    )


def test_recorded_corners_are_joined_by_lines_and_followed(session, home):
    corners = home, moved(home, 0, 0.2, 0), moved(home, 0, 0.2, 0.2)
    recorded(session, *corners)
    np.testing.assert_array_equal(session.route.given, corners)
    session.follow_path(True)
    view = tick(session, 2)
    path = view.path.station.path.solution
    assert path
    assert (view.path.station.index, len(path)) == (0, 81)  # 0.4 m, each 5 mm
    assert "Followed whole" in readout.path(view)
    for T in corners:
        assert min(np.abs(session.route.poses - T).max(axis=(1, 2))) < 1e-12
    session.stand_at(40)
    view = tick(session)
    np.testing.assert_allclose(view.tool.homogeneous, corners[1], atol=1e-9)


def test_a_path_that_is_being_followed_can_be_cancelled(session, home):
    """The work ends soon, in whichever thread it is, and its answer is not waited for."""
    recorded(session, home, moved(home, 0, 0.1, 0))
    with pytest.raises(OptionError, match="no path is being followed"):
        session.cancel_path()
    session.follow_path(True)
    job = session.next_long_job()
    session.cancel_path()
    assert job.think() is None
    job.write(None)
    view = tick(session, 2)
    assert view.path.station is None
    assert not view.path.is_sought
    assert "Cancelled" in readout.path(view)
    session.follow_path(True)
    assert tick(session, 2).path.station.path.solution


def test_while_it_is_sought_the_tab_says_so_and_the_arm_goes_on(session, home):
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.follow_path(True)
    job = session.next_long_job()
    assert session.next_long_job() is None
    for _ in range(20):
        view = session.tick(DT)
        check(session, view)
        assert view.path.is_sought
        assert "being followed" in readout.path(view)
    job.write(job.think())
    assert session.tick(DT).path.station is not None


def test_what_the_arm_does_meanwhile_is_not_interrupted(session, home):
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.follow_path(True)
    job = session.next_long_job()
    session.move_target(moved(home, 0, 0, 0.1))
    job.write(job.think())
    view = tick(session, 5)
    assert view.path.station is None
    assert view.path.followed is not None
    session.stand_at(3)
    assert tick(session).path.station.index == 3


@pytest.mark.parametrize("change", ["undo", "method", "avoid", "again"])
def test_an_answer_that_comes_too_late_is_not_shown(session, home, change):
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.follow_path(True)
    job = session.next_long_job()
    {
        "undo": lambda: session.lay(session.route.without_last()),
        "method": lambda: session.use("none", 1e-3),
        "avoid": lambda: session.avoid(True),
        "again": lambda: session.follow_path(False),
    }[change]()
    job.write(job.think())
    view = session.tick(DT)
    assert view.path.followed is view.path.station is None
    assert view.path.is_sought == (change == "again")


def test_undo_and_clear(session, home):
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.follow_path(True)
    tick(session, 2)
    session.lay(session.route.without_last())
    view = tick(session)
    assert view.path.station is None
    assert "1 corner: 1 pose" in readout.path(view)
    for _ in range(2):
        session.lay(session.route.without_last())
    assert len(session.route) == 0
    assert "no path yet" in readout.path(tick(session))
    recorded(session, home)
    session.lay(session.route.cleared())
    assert len(session.route) == 0


def test_without_a_path_nothing_is_followed_scrubbed_played_or_explained(session):
    before = session.q
    requests = (
        lambda: session.follow_path(True),
        lambda: session.stand_at(0),
        lambda: session.play_path(10.0),
        session.stand_at_next_failure,
        session.explain_path,
    )
    for request in requests:
        with pytest.raises(OptionError, match="path"):
            request()
    session.pause_path()
    np.testing.assert_array_equal(tick(session).q, before)


@pytest.mark.parametrize("repeats", [1, 3])
@pytest.mark.parametrize("is_closed", [False, True])
def test_one_pose_is_a_path(session, home, repeats, is_closed):
    recorded(session, *[home] * repeats)
    session.lay(session.route.closed(is_closed))
    session.follow_path(True)
    view = tick(session, 2)
    assert len(view.path.followed) == 1
    assert view.path.followed.solution
    session.play_path(10.0)
    view = tick(session, 3)
    assert (view.path.station.index, view.path.station.is_playing) == (0, False)
    assert segments(1, None)[0].size == 0


def test_poses_out_of_reach_are_named_and_visited(session, home):
    far = home.copy()
    far[:3, 3] *= 2.0 / np.linalg.norm(far[:3, 3])
    recorded(session, home, far)
    session.follow_path(True)
    view = tick(session, 2)
    followed = view.path.followed
    path = followed.solution
    distance = np.linalg.norm(session.route.poses[:, :3, 3] - [0, 0, 0.438], axis=1)
    assert not path.success[distance > 1.4 + 0.115].any()  # spans of the arm and of the tool
    first = path.first_failure
    assert f"Fails at pose {first}: " in readout.path(view)
    assert f"{int((~path.success).sum())} poses not reached" in readout.path(view)
    assert followed.lost.tolist() == (~path.success[:-1] | ~path.success[1:]).tolist()
    for begin in (0, first, len(path) - 1):  # all poses behind the first failure fail: there is one place to look at
        session.stand_at(begin)
        session.stand_at_next_failure()
        assert tick(session).path.station.index == first
    session.explain_path()
    assert "looking for a proof" in readout.path(session.tick(DT))
    view = tick(session, 2)
    assert in_units(path.proof.words, UNITS) in readout.path(view)
    assert " m " not in readout.path(view)
    assert view.path.station.index == first  # and the arm is where it was


def test_a_step_that_breaks_is_named_and_proved(session):
    """And the segment before it is the only one that is red."""
    session.lay(session.route.with_file("turn.csv", turn_too_many()))
    session.follow_path(False)
    view = tick(session, 2)
    path = view.path.followed.solution
    assert path.success.all()
    assert path.reconfigurations > 0
    assert (np.flatnonzero(view.path.followed.lost) + 1).tolist() == path.breaks.tolist()
    assert " rad" in path.reason
    assert in_units(path.reason, UNITS) in readout.path(view)
    assert " rad" not in readout.path(view)
    assert "not along the path" in readout.path(view)
    for index in (*path.breaks, path.first_failure):
        session.stand_at_next_failure()
        view = tick(session)
        assert view.path.station.index == index
        assert view.standing is Standing.OFF_PATH
    session.explain_path()
    assert f"Proved: {path.proof.words}." in readout.path(tick(session, 2))


def test_what_is_not_proved_is_not_said_to_be(panda):
    """Of other arms nothing is proved of steps: a circle that runs round more than a turn of the first joint."""
    session = Session(panda)
    session.lay(session.route.with_file("turn.csv", turn_too_many()))
    session.follow_path(False)
    view = tick(session, 2)
    assert view.path.followed.solution.success.all()
    assert not view.path.followed.solution
    session.explain_path()
    assert "No proof was found" in readout.path(tick(session, 2))


def test_a_loop_ends_as_it_begins(session, home):
    """Corners are closed by a line; a circle is closed already."""
    recorded(session, home, moved(home, 0, 0.1, 0), moved(home, 0, 0.1, 0.1))
    count = len(session.route)
    session.lay(session.route.closed(True))
    assert len(session.route) > count
    for route in (
        session.route,
        session.route.with_circle(home, 0.1, 1.0),
        session.route.with_file("a.csv", home[None]),
    ):
        session.lay(route)
        session.follow_path(True)
        path = tick(session, 2).path.followed.solution
        assert path
        np.testing.assert_allclose(path.q[-1], path.q[0], atol=1e-6)
        np.testing.assert_allclose(route.poses[-1], route.poses[0], atol=1e-9)
    assert len(session.route) == 1
    assert len(session.route.with_circle(home, 0.1, 1.0)) == len(
        session.route.closed(False).with_circle(home, 0.1, 1.0)
    )


def test_a_loop_that_does_not_close_is_told(session):
    turn = turn_too_many()[:86]  # a whole turn of the base
    session.lay(session.route.with_file("turn.csv", turn).closed(True))
    session.follow_path(False)
    view = tick(session, 2)
    assert not view.path.followed.solution
    assert "meets its beginning" in readout.path(view) or "joint1" in readout.path(view)
    session.stand_at(10**9)
    tick(session)


def test_the_start_is_that_of_the_arm_or_any(session, home):
    """Without an objective an arm that is at the first pose begins as it is."""
    session.use("none", 1e-3)
    tick(session)
    session.set_joint(2, 1.0)
    tick(session)
    here = session.q
    recorded(session, session.target.homogeneous)
    session.lay(session.route.with_corner(moved(session.target.homogeneous, 0, 0, -0.05)))
    session.follow_path(True)
    np.testing.assert_allclose(tick(session, 2).path.followed.solution.q[0], here, atol=1e-6)
    session.follow_path(False)
    assert not tick(session, 2).path.followed.solution.rules.is_start_given


def test_scrubbing_ends_at_the_ends(session, home):
    """And the solver is not asked about the poses: the answer for the path says what there is to say."""
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.follow_path(True)
    verdict = tick(session, 2).verdict
    for asked, there in ((-5, 0), (10**9, 20), (7, 7), (20, 20), (0, 0)):
        session.stand_at(asked)
        view = tick(session)
        assert view.path.station.index == there
        assert view.verdict is verdict


def test_a_path_waits_for_the_solver_of_the_obstacles_as_they_are(session, home):
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.avoid(True)
    session.put_obstacle(mq.Sphere(0.05, mq.pose([3.0, 0, 0]), name="ball"))
    session.follow_path(True)
    rebuilding = session.next_job()
    assert session.next_long_job() is None
    rebuilding.write(rebuilding.think())
    assert session.next_long_job() is not None


def test_it_plays_to_the_end_stops_and_begins_again(session, home):
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.follow_path(True)
    tick(session, 2)
    session.play_path(30.0)
    seen = [tick(session).path.station for _ in range(50)]
    indices = [station.index for station in seen]
    assert indices == sorted(indices)
    assert set(indices) == set(range(21))
    assert indices.index(20) == pytest.approx(20 * 60 / 30, abs=2)
    assert [station.is_playing for station in seen] == [k < 20 for k in indices]
    session.play_path(30.0)
    assert tick(session).path.station.index == 0
    tick(session, 10)
    session.pause_path()
    paused = tick(session).path.station
    assert 0 < paused.index < 20
    assert not paused.is_playing
    assert tick(session, 10).path.station.index == paused.index
    session.play_path(1e9)
    assert tick(session, 60).path.station.index == 20


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_speed_that_is_none_is_refused(session, home, rate):
    recorded(session, home)
    session.follow_path(True)
    tick(session, 2)
    with pytest.raises(OptionError, match="speed"):
        session.play_path(rate)


def test_playing_is_no_faster_than_the_joints(session, home):
    """However fast it is asked for: what is gone by a time is gone within the velocity limits."""
    recorded(session, home, moved(home, -0.2, 0.4, 0))
    session.follow_path(True)
    tick(session, 2)
    session.play_path(1e6)
    limit, seen, is_playing = session.robot.velocity_limit, [session.q], True
    while is_playing and len(seen) < 500:
        view = tick(session)
        is_playing = view.path.station.is_playing
        seen.append(view.q)
    assert view.path.station.index == len(session.route) - 1
    travelled = np.abs(np.diff(seen, axis=0)).sum(axis=0)
    assert (travelled <= limit * DT * (len(seen) + 1)).all()


@pytest.mark.parametrize("leave", ["target", "joint", "swivel", "stop", "play", "lay", "method"])
def test_whatever_moves_the_arm_leaves_the_path(session, home, leave):
    """Also while it plays; the path is kept unless it is another, and the slider leads back to it."""
    session.record(True)
    recorded(session, home, moved(home, 0, 0.1, 0))
    session.record(False)
    session.follow_path(True)
    tick(session, 5)
    session.play_path(20.0)
    tick(session, 20)
    if leave == "swivel":  # which is known of an arm that stands still
        session.pause_path()
        tick(session, 3)
    {
        "target": lambda: session.move_target(moved(home, 0, 0, 0.1)),
        "joint": lambda: session.set_joint(0, 0.3),
        "swivel": lambda: session.set_swivel(session.elbow.psi + 0.3),
        "stop": session.stop,
        "play": session.play,
        "lay": lambda: session.lay(session.route.with_corner(home)),
        "method": lambda: session.use("none", 1e-3),
    }[leave]()
    for _ in range(60):
        view = tick(session)
        assert view.path.station is None
    if leave in ("lay", "method"):
        assert view.path.followed is None
    else:
        session.stand_at(5)
        assert tick(session).path.station.index == 5


def test_an_obstacle_on_a_path_that_is_to_be_clear_asks_for_another_answer(session, home):
    """Without avoidance the answer stands; with it the next answer keeps the margin at every pose that is reached."""
    recorded(session, home, moved(home, 0, 0.2, 0))
    ball = mq.Sphere(0.05, mq.pose(home[:3, 3] + [0, 0.1, 0.3]), name="ball")
    session.follow_path(True)
    tick(session, 2)
    session.put_obstacle(ball)
    assert tick(session, 3).path.station is not None
    session.avoid(True)
    assert session.tick(DT).path.followed is None
    session.follow_path(False)
    view = tick(session, 3)
    scene = mq.CollisionLimit(obstacles=[ball], margin=MARGIN, self_collision=False).of(session.robot).scene
    path = view.path.followed.solution
    assert path.success.any()
    for q in path.q[path.success]:
        assert scene.contacts(q, np.inf).distances.min() > MARGIN - 1e-4
    session.move_obstacle("ball", mq.pose(np.array([3.0, 0, 0])).homogeneous)
    assert session.tick(DT).path.followed is None


def test_a_file_with_nan_is_refused_and_changes_nothing(session, home, tmp_path):
    recorded(session, home)
    route, file = session.route, tmp_path / "path.csv"
    file.write_text("x,y,z,qw,qx,qy,qz\n0.5,0,0.5,0,1,0,0\nnan,0,0.5,0,1,0,0\n")
    with pytest.raises(PoseError, match="NaN"):
        session.lay(session.route.with_file("path.csv", mq.paths.from_csv(file)))
    assert session.route is route


def test_what_is_saved_reads_back(session, home, tmp_path):
    far = home.copy()
    far[:3, 3] *= 2.0 / np.linalg.norm(far[:3, 3])
    recorded(session, home, far)
    session.follow_path(True)
    followed = tick(session, 2).path.followed
    csv_file, npz_file = save(followed, "way.csv", tmp_path), save(followed, "way.npz", tmp_path)
    np.testing.assert_allclose(mq.paths.from_csv(csv_file), session.route.poses, atol=1e-12)
    rows = np.genfromtxt(csv_file, delimiter=",", names=True)
    np.testing.assert_array_equal(rows["q_joint4"], followed.solution.q[:, 3])
    np.testing.assert_array_equal(rows["reached"], followed.solution.success)
    with np.load(npz_file) as arrays:
        np.testing.assert_array_equal(arrays["q"], followed.solution.q)
        np.testing.assert_array_equal(arrays["targets"], session.route.poses)
    with pytest.raises(OptionError, match="already"):
        save(followed, "way.csv", tmp_path)


def test_paths_that_are_too_long_are_refused_before_they_are_made(session, home):
    with pytest.raises(OptionError, match="spacing"):
        session.lay(session.route.spaced(1e-9))
    for spacing in (np.nan, np.inf, -1.0):
        with pytest.raises(OptionError, match="spacing"):
            session.lay(session.route.spaced(spacing))
    route = session.route.spaced(1e-3)
    for k in range(MOST_CORNERS):
        route = route.with_corner(moved(home, 0, 0.5 * (k % 2), 0))
    with pytest.raises(OptionError, match="99500 poses"):
        session.lay(route)
    with pytest.raises(OptionError, match="corners"):
        route.with_corner(home)
    with pytest.raises(OptionError, match=f"at most {MOST_POSES}"):
        session.lay(session.route.with_file("long.csv", np.repeat(home[None], MOST_POSES + 1, axis=0)))
    for radius in (0.0, -1.0, np.nan, 1e6):
        with pytest.raises(OptionError, match="radius"):
            session.route.with_circle(home, radius, 1.0)
    assert len(session.route) == 0


def test_a_circle_runs_about_the_target_at_its_radius(session, home):
    session.lay(session.route.with_circle(home, 0.1, 1.0))
    points = (session.route.poses[:, :3, 3] - home[:3, 3]) @ home[:3, :3]
    np.testing.assert_allclose(np.linalg.norm(points[:, :2], axis=1), 0.1, atol=1e-12)
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-12)
    assert "circle of 100 mm radius" in readout.path(tick(session))
    session.lay(session.route.with_corner(home))
    assert session.route.kind == "corners"
    assert len(session.route) == 1


def test_names_of_files_are_escaped(session, home):
    session.lay(session.route.with_file("<script>.csv", home[None]))
    assert "<script>" not in readout.path(tick(session))


@pytest.mark.parametrize("count", [0, 1, 2, 3, MOST_SEGMENTS, MOST_SEGMENTS + 1, MOST_SEGMENTS + 2, MOST_POSES])
def test_a_line_of_few_segments_hides_no_break(count, rng):
    """Each segment begins where the last ended, and one is red if and only if something on it is lost."""
    lost = rng.random(max(count - 1, 0)) < 0.001
    begins, ends, red = segments(count, lost)
    assert len(begins) == min(max(count - 1, 0), MOST_SEGMENTS)
    assert red.tolist() == [bool(lost[a:b].any()) for a, b in zip(begins, ends, strict=True)]
    if count > 1:
        assert begins[0] == 0
        assert ends[-1] == count - 1
        np.testing.assert_array_equal(begins[1:], ends[:-1])


def test_of_many_points_the_first_and_the_last_are_kept():
    assert thinned([3, 5, 9], 400) == [3, 5, 9]
    chosen = thinned(range(10_000), 400)
    assert (len(chosen), chosen[0], chosen[-1]) == (400, 0, 9999)


def test_the_route_of_a_new_session_is_empty():
    assert len(Route()) == 0
    assert "no path yet" in words.given(Route())
    assert len(Route().closed(True)) == 0


def test_the_session_stands_whatever_is_asked_of_it_and_of_a_path_in_whatever_order(maira, rng):
    """And says of every arm that is drawn what it is, see `check`."""
    session = Session(maira)
    requests = [
        lambda: session.move_target(maira.forward(maira.random_configuration(rng)).homogeneous),
        lambda: session.set_joint(int(rng.integers(7)), rng.uniform(-4, 4)),
        lambda: session.set_swivel(rng.uniform(-4, 4)),
        lambda: session.use(str(rng.choice(["strict", "none"])), 1e-3),
        lambda: session.stop(),
        lambda: session.lay(session.route.with_corner(session.target.homogeneous)),
        lambda: session.lay(session.route.with_corner(session.target.homogeneous)),
        lambda: session.lay(session.route.without_last()),
        lambda: session.lay(session.route.closed(bool(rng.integers(2)))),
        lambda: session.lay(session.route.spaced(rng.uniform(0.02, 0.2))),
        lambda: session.lay(session.route.with_corner(mq.pose(rng.uniform(-2, 2, 3)).homogeneous)),
        lambda: session.lay(session.route.with_circle(session.target.homogeneous, 0.1, 1.0)),
        lambda: session.follow_path(bool(rng.integers(2))),
        lambda: session.follow_path(bool(rng.integers(2))),
        lambda: session.follow_path(bool(rng.integers(2))),
        lambda: session.stand_at(int(rng.integers(-5, 100))),
        session.stand_at_next_failure,
        lambda: session.play_path(rng.uniform(1, 100)),
        session.pause_path,
        session.explain_path,
    ]
    pending, states = [], set()
    for _ in range(150):
        with contextlib.suppress(MairaError):
            requests[int(rng.integers(len(requests)))]()
        for _ in range(int(rng.integers(4))):
            view = session.tick(DT)
            check(session, view)
            states.add(view.standing)
            while (job := session.next_job()) is not None:
                job.write(job.think())
            if not pending and (job := session.next_long_job()) is not None:
                pending.append(job)
            if pending and rng.integers(2):
                job = pending.pop()
                job.write(job.think())
    assert {Standing.ON_PATH, Standing.OFF_PATH, Standing.MOVING} <= states
