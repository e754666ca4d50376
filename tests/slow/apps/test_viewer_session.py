"""The viewer's session: what the arm does with what is asked of it, without a browser."""

import contextlib
import csv
import io

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.apps.viewer.answers import ghosts_of
from maira_qp.apps.viewer.drawing.surroundings import MARGIN, first_in_the_way
from maira_qp.apps.viewer.motion.elbow import elbow_of
from maira_qp.apps.viewer.motion.recording import Recording
from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.quantities import length
from maira_qp.apps.viewer.saving import save
from maira_qp.apps.viewer.session import FARTHEST, Session
from maira_qp.apps.viewer.start import bent_configuration
from maira_qp.apps.viewer.tips import tips_in
from maira_qp.apps.viewer.view import Standing, View
from maira_qp.errors import MairaError, OptionError, PoseError
from maira_qp.io.columns import layout

DT = 1 / 60


def run(session: Session, seconds: float) -> View:
    """Ticks, with all jobs done at once between them."""
    for _ in range(round(seconds / DT)):
        before = session.q
        view = session.tick(DT)
        robot = session.robot
        assert ((robot.lower <= view.q) & (view.q <= robot.upper)).all()
        assert (np.abs(view.q - before) <= robot.velocity_limit * DT * (1 + 1e-12)).all()
        while (job := session.next_job() or session.next_long_job()) is not None:
            job.write(job.think())
    return view


@pytest.mark.parametrize("name", ["maira", "panda"])
def test_the_arm_follows_the_target_wherever_it_can_be_reached(name, rng, request):
    """Also where ticks alone would be stuck at a limit.

    While the elbow is still on its way to the posture the tool may be off by `Options.level_position_tolerance`.
    """
    robot = request.getfixturevalue(name)
    for _ in range(3):
        session, T = Session(robot), robot.forward(robot.random_configuration(rng))
        session.move_target(T.homogeneous)
        assert run(session, 8).verdict.solution.success
        assert np.abs(mq.pose_error(robot.forward(session.q), T)).max() < 1e-6


def test_home_can_be_undone_before_the_arm_came_to_rest_on_its_way(maira):
    session = Session(maira)
    session.move_target((session.target * mq.pose([0.05, 0.02, -0.1])).homogeneous)
    run(session, 0.1)
    asked = session.target
    session.go_home()
    run(session, 6.0)
    session.undo()
    np.testing.assert_array_equal(session.target.homogeneous, asked.homogeneous)
    run(session, 6.0)
    assert np.abs(mq.pose_error(asked, maira.forward(session.q))).max() < 1e-5


def test_a_target_out_of_reach_is_told_and_the_arm_rests_at_the_nearest_point(maira):
    session = Session(maira)
    session.move_target(mq.pose([1000.0, 0.0, 0.4]).homogeneous)
    view = run(session, 5)
    assert np.linalg.norm(view.target.translation) == pytest.approx(FARTHEST * maira.length)
    assert not view.verdict.solution.success
    stretched = 0.7 + 0.7 + 0.115  # from the shoulder, of which the tool's part may point elsewhere
    assert stretched - 0.115 < np.linalg.norm(view.tool.translation - [0, 0, 0.438]) < stretched + 1e-9
    rest = view.q
    assert np.abs(run(session, 0.5).q - rest).max() < 1e-6


def test_why_a_target_is_not_reached_is_told_once_it_rests(maira):
    """The joint that has to go further, by as much as it was bent too far, and its limit."""
    q = bent_configuration(maira)
    q[3] = maira.upper[3] + np.radians(3)
    session = Session(maira)
    session.move_target(maira.released(["joint4 upper"]).forward(q).homogeneous)
    assert run(session, 0.2).verdict.reason is None
    verdict = run(session, 1).verdict
    assert verdict.reason.blocking == ("joint4 upper",)
    assert readout.reason(verdict) in readout.readout(session.tick(DT))
    assert "With joint4 3.00° beyond its upper limit it would be reached." in readout.reason(verdict)
    session.move_target(mq.pose([1000.0, 0, 0.4]).homogeneous)
    verdict = run(session, 1).verdict
    assert verdict.solution.status is mq.Status.UNREACHABLE
    away = length(verdict.solution.proof.distance)
    assert away.endswith(" mm")
    assert f"the wrist would be {away} from the shoulder, where the arm spans" in readout.reason(verdict)
    assert " m " not in readout.readout(session.tick(DT))
    session.move_target(maira.forward(session.q).homogeneous)
    assert run(session, 1).verdict.reason is None


def test_a_weight_that_holds_the_tool_off_is_the_reason(maira):
    session = Session(maira)
    session.use("weighted", 1e-1)
    assert "weight of the posture" in readout.reason(run(session, 1).verdict)


def test_a_target_that_is_no_pose_is_refused_and_moves_nothing(maira):
    session = Session(maira)
    q = session.q
    with pytest.raises(PoseError):
        session.move_target(np.full((4, 4), np.nan))
    assert (run(session, 0.1).q == q).all()


def test_a_joint_set_by_hand_stays_in_its_limits_and_takes_the_target_along(maira):
    session = Session(maira)
    session.set_joint(3, 100.0)
    view = session.tick(DT)
    assert view.q[3] == maira.upper[3]
    assert view.at_limit == ["joint4 upper"]
    assert view.position_error == view.orientation_error == 0


@pytest.mark.parametrize("name", ["maira", "iiwa14"])
def test_the_place_on_an_arc_is_that_of_the_configuration(name, rng, request):
    robot = request.getfixturevalue(name)
    srs = SRS.of(robot)
    for _ in range(8):
        q = robot.random_configuration(rng)
        elbow = elbow_of(srs, q)
        assert elbow is not None
        assert elbow.curve.contains(elbow.psi)
        np.testing.assert_allclose(elbow.curve.at(np.array(elbow.psi)), q, atol=1e-7)


@pytest.mark.parametrize(("name", "link"), [("maira", "link4"), ("panda", "panda_link4")])
def test_the_swivel_moves_the_elbow_while_the_tool_stands_still(name, link, request):
    """In closed form, and along a self-motion that was walked."""
    robot = request.getfixturevalue(name)
    session = Session(robot)
    before = run(session, 0.1)
    elbow = robot.forward(before.q, link).translation
    session.set_swivel(before.elbow.psi + 0.8)
    for _ in range(120):
        view = session.tick(DT)
        assert np.abs(mq.pose_error(view.tool, before.tool)).max() < 1e-6
    assert view.elbow.psi == pytest.approx(before.elbow.psi + 0.8)
    assert np.linalg.norm(robot.forward(view.q, link).translation - elbow) > 0.05
    view = run(session, 0.2)
    assert view.elbow.psi == pytest.approx(before.elbow.psi + 0.8)
    assert view.elbow.curve is before.elbow.curve


def test_the_swivel_ends_at_a_limit_that_is_named(panda):
    session = Session(panda)
    elbow = run(session, 0.1).elbow
    for end in (elbow.curve.upper, elbow.curve.lower):
        session.set_swivel(end + np.sign(end))
        view = run(session, 10)
        assert view.elbow.psi == end
        assert view.at_limit
        assert view.at_limit[0] in readout.ends(panda, view.elbow)


def test_an_arm_that_is_not_redundant_has_no_swivel(ur5):
    session = Session(ur5)
    run(session, 0.1)
    assert not session.has_swivel
    with pytest.raises(OptionError, match="elbow"):
        session.set_swivel(0.0)


def test_a_weight_trades_the_pose_for_the_posture_and_strict_does_not(maira):
    session = Session(maira)
    errors = []
    for method, weight in (("weighted", 1e-2), ("weighted", 1e-4), ("strict", 1e-2)):
        session.use(method, weight)
        view = run(session, 4)
        errors.append(max(view.position_error, view.orientation_error))
    assert 1e-4 < errors[1] < 0.1 * errors[0]
    assert errors[2] < 1e-9


def test_the_redundancy_is_one_of_three_and_the_weight_positive(maira):
    session = Session(maira)
    with pytest.raises(OptionError, match="strict, weighted, none"):
        session.use("both", 1e-3)
    with pytest.raises(OptionError, match="weight"):
        session.use("weighted", -1.0)
    assert session.workplace.method == "strict"


def through_the_tool(session: Session) -> mq.Sphere:
    """A ball on the straight way from the tool to a place across the arm."""
    return mq.Sphere(0.12, mq.pose(session.target.translation + np.array([0.0, 0.3, 0.0])), name="ball")


def test_distances_are_those_of_the_arm_to_the_ball(maira, rng):
    session = Session(maira)
    session.put_obstacle(through_the_tool(session))
    run(session, 0.05)
    (clearance,) = session.tick(DT).clearances
    first, second = clearance.points
    assert clearance.obstacle == "ball"
    assert np.linalg.norm(second - first) == pytest.approx(clearance.distance, abs=1e-6)
    assert np.linalg.norm(second - session.workplace.obstacles["ball"].pose.translation) == pytest.approx(
        0.12, abs=1e-6
    )
    session.move_obstacle("ball", mq.pose([3.0, 0, 0]).homogeneous)
    run(session, 0.05)
    assert session.tick(DT).clearances[0].distance > clearance.distance + 1
    session.remove_obstacles()
    run(session, 0.05)
    assert session.tick(DT).clearances == []


@pytest.mark.parametrize("is_avoiding", [True, False])
def test_the_arm_keeps_clear_of_a_ball_only_if_it_is_to(maira, is_avoiding):
    session = Session(maira)
    session.put_obstacle(through_the_tool(session))
    session.avoid(is_avoiding)
    run(session, 0.05)
    T = session.target.homogeneous.copy()
    T[1, 3] += 0.3
    session.move_target(T)
    least = np.inf
    for _ in range(60):
        least = min(least, run(session, DT).clearances[0].distance)
    assert (least > MARGIN - 1e-4) == is_avoiding


@pytest.mark.parametrize("radius", [0.03, 0.12])
def test_what_is_said_holds_for_the_arm_that_is_drawn(maira, radius):
    """A ball on the elbow of an arm that is to keep clear, the target raised by 50 mm: at every tick REACHED is said
    of a tool at the target and an arm that is clear, by other distances; an arm that is not clear is said to be so."""
    session = Session(maira)
    ball = mq.Sphere(radius, mq.pose(maira.forward(session.q, "link4").translation), name="ball")
    session.put_obstacle(ball)
    session.avoid(True)
    limit = mq.CollisionLimit(obstacles=[ball], margin=MARGIN, self_collision=False).of(maira)
    seen = set()
    for k in range(60):
        if k == 5:
            T = session.target.homogeneous.copy()
            T[2, 3] += 0.05
            session.move_target(T)
        view = run(session, DT)
        distance = limit.scene.contacts(view.q, np.inf).distances.min()
        error = np.abs(mq.pose_error(maira.forward(view.q), session.target)).max()
        seen.add(view.standing)
        if view.standing is Standing.REACHED:
            assert error < 1e-6
            assert distance > MARGIN - 2e-4
        if view.standing is not Standing.UNKNOWN:
            assert (view.standing is Standing.TOO_NEAR) == (distance < MARGIN - 1e-4)
        if view.standing is Standing.TOO_NEAR:
            assert "ball" in readout.sentence(view)
        assert ("REACHED" in readout.readout(view)) == (view.standing is Standing.REACHED)
    assert Standing.TOO_NEAR in seen


def test_what_keeps_the_arm_from_a_better_configuration_is_named(maira):
    """An arm that stands still short of a target, to whose solution the straight way leads through a ball."""
    session = Session(maira)
    goal = session.q + np.array([1.2, 0, 0, 0, 0, 0, 0])
    half_way = maira.forward(session.q + np.array([0.6, 0, 0, 0, 0, 0, 0]), "link4").translation
    limit = mq.CollisionLimit(obstacles=[mq.Sphere(0.1, mq.pose(half_way), name="ball")], margin=MARGIN).of(maira)
    assert first_in_the_way(limit, session.q, goal).obstacle == "ball"
    assert first_in_the_way(limit, session.q, session.q - 0.05) is None
    inside = session.q + np.array([0.6, 0, 0, 0, 0, 0, 0])
    assert first_in_the_way(limit, inside, goal) is None  # out of it


def test_among_obstacles_a_target_out_of_reach_is_told_as_without_them(maira):
    session = Session(maira)
    session.put_obstacle(through_the_tool(session))
    session.avoid(True)
    session.move_target(mq.pose([1.9, 0.0, 0.4]).homogeneous)
    view = run(session, 1)
    assert view.verdict.solution.status in (mq.Status.NEAREST, mq.Status.UNREACHABLE)


def test_a_robot_without_collision_shapes_says_why_distances_are_not_known():
    text = mq.Robot.maira().urdf.replace("collision>", "ignored>")
    session = Session(mq.Robot.from_urdf(text))
    session.put_obstacle(mq.Sphere(0.1, name="ball"))
    session.avoid(True)
    view = run(session, 0.1)
    assert view.clearances == []
    assert "no collision shapes" in view.notice


def test_every_ghost_is_a_solution_and_the_arm_goes_to_it(iiwa14):
    session = Session(iiwa14)
    session.show_ghosts(True)
    view = run(session, 0.5)
    ghosts = view.ghosts
    assert len(ghosts.q) > 1
    for q in ghosts.q:
        assert np.abs(mq.pose_error(iiwa14.forward(q), view.target)).max() < 1e-9
    session.go_to_ghost(1)
    view = run(session, 6)
    np.testing.assert_allclose(view.q, ghosts.q[1], atol=1e-12)
    assert view.ghosts is ghosts
    session.move_target(iiwa14.forward(iiwa14.middle).homogeneous)
    assert session.tick(DT).ghosts is None


def test_where_no_solution_exists_the_reason_is_given(maira):
    ghosts = ghosts_of(mq.Solver(maira), {maira.tip: mq.pose([5, 0, 0])})
    assert (len(ghosts.q), len(ghosts.found)) == (0, 0)
    assert "no configuration" in ghosts.note


@pytest.mark.parametrize(("name", "method"), [("ur5", "closed form"), ("panda", "numerical")])
def test_arms_of_all_kinds_have_ghosts_that_look_different(name, method, request):
    """Solutions of UR5 that differ by whole turns look alike, and are shown once."""
    if name == "ur5":
        pytest.importorskip("eaik")
    robot = request.getfixturevalue(name)
    session = Session(robot)
    session.show_ghosts(True)
    view = run(session, 0.5)
    assert method in view.ghosts.found.method
    places = [np.array([robot.forward(q, link).homogeneous for link in robot.moved_links]) for q in view.ghosts.q]
    for i, place in enumerate(places):
        assert np.abs(mq.pose_error(robot.forward(view.ghosts.q[i]), view.target)).max() < 1e-6
        assert all(np.abs(place - other).max() > 0.05 for other in places[:i])
    assert 1 < len(places) <= len(view.ghosts.found)
    assert method in readout.solutions(session, view)
    assert ("maybe not all" in readout.solutions(session, view)) != view.ghosts.found.is_complete


def test_a_recording_is_played_as_it_was(maira, rng):
    session = Session(maira)
    session.record(True)
    session.move_target(maira.forward(maira.random_configuration(rng)).homogeneous)
    run(session, 2)
    session.record(False)
    q = session.recording.q
    assert len(q) == 120
    assert session.recording.duration == pytest.approx(119 * DT)
    session.set_joint(0, 0.0)
    session.play()
    played = np.array([session.tick(DT).q for _ in range(600)])
    assert session.tick(DT).position_error < 1e-12  # the target went along
    at = [int(np.abs(played - row).max(axis=1).argmin()) for row in q]
    assert np.abs(played[at] - q).max() < 1e-6
    moves = np.flatnonzero(np.abs(np.diff(q, axis=0)).max(axis=1) > 1e-3)  # where rows can be told apart
    assert len(moves) > 20
    assert (np.diff(np.array(at)[moves]) > 0).all()
    np.testing.assert_allclose(played[-1], q[-1], atol=1e-12)


def test_nothing_is_played_or_shown_that_is_not_there(maira):
    session = Session(maira)
    for asked in (session.play, lambda: session.go_to_ghost(0)):
        with pytest.raises(OptionError):
            asked()


def test_the_tips_of_a_file_are_listed_with_its_tool_first(tmp_path, maira):
    file = tmp_path / "arm.urdf"
    file.write_text(maira.urdf)
    tips = tips_in(file)
    assert tips[0] == "tool0"
    assert set(tips) == {"tool0", *maira.moved_links}
    file.write_text("<robot")
    assert tips_in(file) == ()


def recorded(robot: mq.Robot, rng: np.random.Generator, count: int = 5) -> Recording:
    recording = Recording(robot)
    for _ in range(count):
        recording.add(robot.random_configuration(rng), 0.25)
    return recording


def test_a_saved_recording_reads_back(maira, rng, tmp_path):
    recording = recorded(maira, rng)
    csv_file, npz_file = save(recording, "way.csv", tmp_path), save(recording, "way.npz", tmp_path)
    rows = list(csv.DictReader(io.StringIO(csv_file.read_text())))
    assert layout(list(rows[0]), maira.joint_names).form == "quaternion"  # `solve --batch` takes it
    q = np.array([[float(row[f"q_{name}"]) for name in maira.joint_names] for row in rows])
    with np.load(npz_file) as arrays:
        np.testing.assert_array_equal(arrays["q"], q)
        np.testing.assert_array_equal(arrays["time"], 0.25 * np.arange(5))
        np.testing.assert_array_equal(arrays["targets"], [maira.forward(row).homogeneous for row in recording.q])
    np.testing.assert_array_equal(q, recording.q)
    np.testing.assert_array_equal([float(row["time"]) for row in rows], recording.times)


@pytest.mark.parametrize(
    "name",
    ["../way.csv", "/tmp/way.csv", "way.py", ".way.csv", "a/b.csv", "a\\b.csv", "", ".csv", "way.csv\n", "x" * 200],
)
def test_a_recording_cannot_be_saved_elsewhere(name, maira, rng, tmp_path):
    with pytest.raises(OptionError, match="name"):
        save(recorded(maira, rng), name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_replaces_no_file(maira, rng, tmp_path):
    (tmp_path / "way.csv").write_text("mine")
    (tmp_path / "link.csv").symlink_to(tmp_path / "nowhere")
    for name in ("way.csv", "link.csv"):
        with pytest.raises(OptionError, match="already"):
            save(recorded(maira, rng), name, tmp_path)
    assert (tmp_path / "way.csv").read_text() == "mine"
    with pytest.raises(OptionError, match="nothing"):
        save(Recording(maira), "empty.csv", tmp_path)


def test_the_session_stands_whatever_is_asked_of_it_in_whatever_order(maira, rng):
    """No sequence of requests leaves anything but a finite configuration within the limits."""
    session = Session(maira)
    requests = [
        lambda: session.move_target(mq.pose(rng.uniform(-3, 3, 3), rpy=rng.uniform(-3, 3, 3)).homogeneous),
        lambda: session.set_joint(int(rng.integers(7)), rng.uniform(-4, 4)),
        lambda: session.set_swivel(rng.uniform(-4, 4)),
        lambda: session.use(str(rng.choice(["strict", "weighted", "none"])), 10 ** rng.uniform(-6, 0)),
        lambda: session.put_obstacle(mq.Sphere(0.1, mq.pose(rng.uniform(-1, 1, 3)), name="ball")),
        lambda: session.remove_obstacles(),
        lambda: session.record(bool(rng.integers(2))),
        lambda: session.play(),
        lambda: session.stop(),
    ]
    for _ in range(80):
        with contextlib.suppress(MairaError):
            requests[int(rng.integers(len(requests)))]()
        for _ in range(int(rng.integers(4))):
            view = session.tick(DT)
            job = session.next_job()
            if job is not None:
                job.write(job.think())
            assert ((maira.lower <= view.q) & (view.q <= maira.upper)).all()
            assert np.isfinite([view.position_error, view.orientation_error]).all()
