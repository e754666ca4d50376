"""The benchmark of scenes, without the peers: what is asked, the clock, the judge, the lines, and what it reports."""

import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from maira_qp.evaluation.contestant import Contestant
from maira_qp.evaluation.report import digits

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from scenes import judging, line_up, ours, problems, race, report


@pytest.fixture(scope="module", params=problems.SCENES)
def scene(request):
    return problems.SCENES[request.param]()


@pytest.fixture(scope="module")
def reach():
    return problems.SCENES["reach"]()


def shortened(scene, ticks):
    """The first ticks of a scene alone."""
    return replace(scene, targets=scene.targets[:ticks], counted=np.ones(ticks, dtype=bool), ends=np.array([ticks - 1]))


def contestant(control, name="somebody"):
    return Contestant(name=name, control=control, lines=1, pairs=lambda: 0)


def run_of(q):
    return race.Run(np.ones(len(q) - 1), np.array(q), 0)


# What is asked


def test_a_scene_starts_within_limits_and_names_a_target_for_every_tick(scene):
    assert (scene.robot.lower <= scene.start).all()
    assert (scene.start <= scene.robot.upper).all()
    assert scene.counted.shape == (len(scene.targets),)
    assert scene.counted.any()
    assert scene.counted[scene.ends].all()
    assert scene.looks or all(set(target) == set(scene.tips) for target in scene.targets)


def test_ours_follow_every_scene_within_limits(scene):
    """A short run of each: no limit is broken, and the tool comes nearer to its target, says the walk over the URDF."""
    short = shortened(scene, 40)
    made = line_up.contestant("ours", short, ours, getattr(ours, scene.name))
    (run,) = race.race(short, [made], 1)
    verdict = judging.verdict(short, run.q)
    assert run.failed == 0
    assert max(verdict.speed_excess.max(), verdict.limit_violation.max()) <= report.SLACK
    assert scene.srdf is None or verdict.distance >= scene.margin - 1e-9
    stays = judging.verdict(short, np.array([scene.start] * 41))
    error = "orientation_error" if scene.looks else "position_error"
    assert getattr(verdict, error)[-1] < 0.9 * getattr(stays, error)[-1]


def test_the_description_that_all_get_is_the_robot_of_the_scene(scene):
    again = ours.mq.Robot.from_urdf(scene.urdf, tip=scene.tips)
    assert again.joint_names == scene.robot.joint_names
    np.testing.assert_array_equal(again.velocity_limit, scene.robot.velocity_limit)
    for tip in scene.tips:
        here, there = (robot.forward(scene.start, tip).homogeneous for robot in (again, scene.robot))
        np.testing.assert_allclose(here, there, atol=1e-12)


# The judge


def test_ticks_that_are_too_fast_or_end_outside_are_counted_with_their_size(reach):
    short = shortened(reach, 3)
    q = np.array([short.start] * 4)
    q[1:, 1] += 2.0 * short.robot.velocity_limit[1] * short.dt  # one tick at twice the speed
    q[3, 3] = short.robot.upper[3] + 1e-3  # which is too fast as well
    verdict = judging.verdict(short, q)
    assert (verdict.speed_excess > report.SLACK).tolist() == [True, False, True]
    assert verdict.speed_excess.max() > short.robot.velocity_limit[1]
    assert (verdict.limit_violation > report.SLACK).tolist() == [False, False, True]
    assert verdict.limit_violation[2] == pytest.approx(1e-3)
    assert run_of(q).travel == pytest.approx(np.abs(q[1] - q[0]).sum() + np.abs(q[3] - q[2]).sum())


def test_what_is_no_number_is_outside(reach):
    short = shortened(reach, 2)
    q = np.array([short.start] * 3)
    q[2, 0] = np.nan
    verdict = judging.verdict(short, q)
    assert verdict.limit_violation.tolist() == [0.0, np.inf]
    assert verdict.position_error[1] == verdict.speed_excess[1] == np.inf


def test_errors_are_those_of_the_worst_hand():
    scene = shortened(problems.SCENES["dual"](), 1)
    pose = {tip: scene.robot.forward(scene.start, tip) for tip in scene.tips}
    pose[scene.tips[1]].translation = pose[scene.tips[1]].translation + np.array([0.0, 0.03, 0.0])
    verdict = judging.verdict(replace(scene, targets=[pose]), np.array([scene.start] * 2))
    assert verdict.position_error == pytest.approx([0.03])
    assert verdict.orientation_error == pytest.approx([0.0], abs=1e-7)


def test_the_angle_of_a_look_is_pinocchios(rng):
    scene = shortened(problems.SCENES["look"](), 3)
    q = np.array([scene.robot.clip(scene.start + 0.2 * rng.standard_normal(7)) for _ in range(4)])
    for k, angle in enumerate(judging.verdict(scene, q).orientation_error):
        hand = scene.robot.forward(q[k + 1])
        sight = hand.actInv(scene.targets[k])
        assert angle == pytest.approx(np.arccos(sight @ problems.CAMERA / np.linalg.norm(sight)), abs=1e-9)


def test_only_ticks_that_count_are_in_the_mean(reach):
    scene = replace(reach, counted=np.array([True, True, False]), ends=np.array([0]))
    assert scene.summary(np.array([1.0, 3.0, 9.0])) == (2.0, 3.0, 1.0)


def test_the_judge_agrees_with_the_collision_limit_on_distances(rng):
    scene = problems.SCENES["collision"]()
    limit = ours.mq.CollisionLimit(margin=0.0, influence=5.0, meshes=[scene.package], allowed=scene.srdf)
    limit = limit.of(scene.robot)
    assert ours.pairs(scene) == len(limit.scene.pairs) == 44
    for _ in range(5):
        q = scene.start + 0.2 * rng.standard_normal(7)
        q = scene.robot.clip(q)
        found = judging.smallest_distance(scene, q[None])
        assert found == pytest.approx(limit.distance(scene.robot.at(q)), abs=1e-5)


# The clock


def test_everybody_gets_every_target_from_the_start_in_turns(reach):
    short, order = shortened(reach, 5), []

    def build(name):
        def make():
            order.append(name)
            given = []

            def tick(target):
                given.append(target)
                assert target is short.targets[len(given) - 1]
                return short.start + len(given)

            return tick

        return contestant(make, name)

    runs = race.race(short, [build("a"), build("b")], 2)
    assert "".join(order) == "ab" + "ab" + "ba"
    for run in runs:
        np.testing.assert_array_equal(run.q, short.start + np.arange(6.0)[:, None])
        assert run.failed == 0


def test_the_fastest_time_of_each_tick_counts(reach, monkeypatch):
    now, rounds = [0.0], []
    monkeypatch.setattr(race, "perf_counter", lambda: now[0])

    def make():
        rounds.append(1)
        costs = iter({1: [9.0, 9.0, 9.0], 2: [1.0, 3.0, 3.0], 3: [2.0, 1.0, 3.0]}[len(rounds)])  # first the warm-up

        def tick(target):
            now[0] += next(costs)
            return reach.start

        return tick

    (run,) = race.race(shortened(reach, 3), [contestant(make)], 2)
    np.testing.assert_array_equal(run.seconds, [1.0, 1.0, 3.0])


def test_a_tick_that_raises_stands_still_and_is_counted(reach):
    def make():
        def tick(target):
            raise RuntimeError("no solution")

        return tick

    short = shortened(reach, 3)
    (run,) = race.race(short, [contestant(make)], 1)
    assert run.failed == 3
    np.testing.assert_array_equal(run.q, np.array([short.start] * 4))


# Who takes part, and how much they write


def test_lines_of_code_are_those_with_code():
    def sample(x):
        """Not this one,

        nor these.
        """
        # nor this

        y = (
            x,
            "a string",
        )
        return y

    assert line_up.lines_of_code(sample) == 6
    assert line_up.lines_of_code(ours.reach) == line_up.lines_of_code(ours.circle) > 8


def test_a_peer_that_is_missing_leaves_a_remark(reach, monkeypatch):
    monkeypatch.setattr(line_up, "PEERS", {"Missing": ("no_such_module", "nothing", "scenes.nowhere")})
    made, remarks = line_up.line_up(reach)
    assert [each.name for each in made] == ["maira_qp", "maira_qp daqp", "maira_qp weighted"]
    assert remarks == ["Missing: skipped, not installed (pip install 'nothing')"]


@pytest.mark.parametrize(("module", "imported"), [("scenes.with_pink", "pink"), ("scenes.with_mink", "mink")])
def test_peers_that_are_installed_look_at_the_same_pairs_and_keep_to_their_start(module, imported):
    pytest.importorskip(imported)
    theirs = pytest.importorskip(module)
    scene = problems.SCENES["collision"]()
    assert theirs.pairs(scene) == ours.pairs(scene)
    short = shortened(problems.SCENES["reach"](), 40)
    (run,) = race.race(short, [line_up.contestant("theirs", short, theirs, theirs.reach)], 1)
    verdict = judging.verdict(short, run.q)
    assert run.failed == 0
    assert verdict.limit_violation.max() <= report.SLACK
    assert verdict.position_error[-1] < judging.verdict(short, np.array([short.start] * 41)).position_error[-1]


# What it reports


def test_the_tables_have_everybody_and_ours_as_the_unit(reach):
    short = shortened(reach, 4)
    made = [contestant(None, name) for name in ("maira_qp", "Other")]
    runs = [race.Run(np.full(4, seconds), np.array([short.start] * 5), 0) for seconds in (2e-5, 3e-4)]
    runs[1] = replace(runs[1], failed=1)
    verdicts = [judging.verdict(short, run.q) for run in runs]
    verdicts[1] = replace(verdicts[1], speed_excess=np.array([0.0, 1e-7, 2e-7, 1e-8]))
    console = Console(file=io.StringIO(), record=True, width=report.WIDTH)
    console.print(report.table(short, made, runs, verdicts))
    console.print(report.distances(short, made, [replace(verdict, distance=0.0201) for verdict in verdicts]))
    console.print(report.ratios([(short, made, runs, verdicts)]))
    console.print(report.conditions(3))
    text = console.export_text()
    rows = [[cell.strip() for cell in line.split("│")] for line in text.splitlines() if line.startswith("│")]
    assert rows[0][1:6] == ["maira_qp", "20.0", "20.0", "1", "0"]
    assert rows[1][1] == "Other, 1 failed"
    assert rows[1][5] == "3 (2e-07)"
    assert rows[2][1:4] == ["maira_qp", "20.1000", "20"]
    assert rows[4][1:4] == [short.title, "1.00", "15.0"]
    assert max(map(len, text.splitlines())) <= report.WIDTH
    *_, last = report.markdown([(short, made, runs, verdicts)]).splitlines()
    assert last.split(" | ")[1:5] == ["Other", "300, 300", "3 (2e-07)", "0"]
    assert report.between("a <!-- x --> old <!-- end --> b", "x", "new") == "a <!-- x -->\n\nnew\n\n<!-- end --> b"


def test_numbers_have_three_digits():
    assert [digits(x) for x in (0.0, 1.2e-13, 0.0123456, 1.5, 99.94, 1234.5)] == [
        "0",
        "1.2e-13",
        "0.0123",
        "1.50",
        "99.9",
        "1234",
    ]
