"""The benchmark against peers, without the peers: its judge, its clock, who may take part, and what it reports."""

import io
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from rich.console import Console

from maira_qp.evaluation.contestant import Contestant
from maira_qp.evaluation.judge import turn
from maira_qp.evaluation.targets import FAR_AWAY, NEARBY

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from peers import arms, clock, line_up, picture, report, results


@pytest.fixture(scope="module", params=arms.SOURCES)
def arm(request, tmp_path_factory):
    return arms.load(request.param, tmp_path_factory.mktemp("arms"))


@pytest.fixture(scope="module")
def maira(tmp_path_factory):
    return arms.load("maira", tmp_path_factory.mktemp("maira"))


def contestant(arm, solve, name="somebody", **changes):
    """A contestant that means the arm and answers as it is told."""
    return Contestant(name=name, settings="none", forward=arm.judge.forward, solve=solve, **changes)


class FakeClock:
    """Time that passes when it is told to."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(clock, "perf_counter", lambda: self.now)


# The judge


def test_the_judge_agrees_with_pinocchio_on_the_lean_urdf_that_the_peers_get(arm, rng):
    full = pin.buildModelFromXML(arm.urdf)
    others = [i for i in range(1, full.njoints) if full.names[i] not in arm.robot.joint_names]
    model = pin.buildReducedModel(full, others, pin.neutral(full))
    assert list(model.names)[1:] == list(arm.robot.joint_names)
    data, tip = model.createData(), model.getFrameId(arm.robot.tip)
    for q in arm.configurations(20, rng):
        pin.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(arm.judge.forward(q), data.oMf[tip].homogeneous, atol=1e-12)
    np.testing.assert_array_equal(arm.lower, model.lowerPositionLimit)
    np.testing.assert_array_equal(arm.upper, model.upperPositionLimit)
    np.testing.assert_array_equal(arm.judge.speed, model.velocityLimit)


def test_the_solver_means_the_same_arm_as_the_judge_limits_to_the_bit(arm):
    ours = Contestant(name="ours", forward=lambda q: arm.robot.forward(q).homogeneous)
    assert line_up.disagreement(ours, arm) == ""
    np.testing.assert_array_equal(arm.robot.lower, arm.lower)
    np.testing.assert_array_equal(arm.robot.upper, arm.upper)


def test_a_position_counts_up_to_its_tolerance_and_not_beyond(maira, rng):
    q = maira.configurations(2, rng)
    targets = np.array([maira.judge.forward(row) for row in q])
    targets[:, 2, 3] += [0.99e-6, 1.01e-6]
    verdicts = maira.judge.verdict(q, targets)
    np.testing.assert_allclose(verdicts.position_error, [0.99e-6, 1.01e-6], rtol=1e-6)
    assert verdicts.within(*results.TOLERANCES).tolist() == [True, False]


@pytest.mark.parametrize("angle", [1e-9, 0.99e-6, 1.01e-6, 1e-3, 3.0, np.pi])
def test_an_orientation_counts_up_to_its_tolerance_and_not_beyond(maira, rng, angle):
    q = maira.configurations(1, rng)
    targets = np.array([maira.judge.forward(q[0])])
    axis = rng.standard_normal(3)
    targets[0, :3, :3] = targets[0, :3, :3] @ turn(axis / np.linalg.norm(axis), angle)
    verdicts = maira.judge.verdict(q, targets)
    assert verdicts.orientation_error[0] == pytest.approx(angle, rel=1e-6)
    assert verdicts.within(*results.TOLERANCES)[0] == (angle <= 1e-6)


def test_a_joint_counts_on_its_limit_and_beyond_it_only_with_slack(maira):
    q = np.array([maira.upper, np.nextafter(maira.upper, 9.0), maira.upper + 0.9e-9, maira.lower - 1.1e-9])
    targets = np.array([maira.judge.forward(row) for row in q])
    verdicts = maira.judge.verdict(q, targets)
    assert verdicts.within(*results.TOLERANCES).tolist() == [True, False, False, False]
    assert verdicts.within(*results.TOLERANCES, 1e-9).tolist() == [True, True, True, False]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_answer_with_one_number_that_is_none_is_infinitely_wrong(maira, bad):
    q = np.zeros((2, 7))
    q[1, 3] = bad
    verdicts = maira.judge.verdict(q, np.array([maira.judge.forward(q[0])] * 2))
    assert verdicts.within(*results.TOLERANCES, 1e9).tolist() == [True, False]
    assert np.isinf([verdicts.position_error[1], verdicts.orientation_error[1], verdicts.limit_violation[1]]).all()


def test_no_answers_are_no_verdicts(maira):
    assert maira.judge.verdict(np.empty((0, 7)), np.empty((0, 4, 4))).within(*results.TOLERANCES).shape == (0,)


def test_the_screws_are_the_arm_as_a_product_of_exponentials(arm, rng):
    axes, points, home = arm.screws()
    for q in arm.configurations(5, rng):
        T = np.eye(4)
        for axis, point, angle in zip(axes, points, q, strict=True):
            motion = np.eye(4)
            motion[:3, :3] = turn(axis, angle)
            motion[:3, 3] = point - motion[:3, :3] @ point
            T = T @ motion
        np.testing.assert_allclose(T @ home, arm.judge.forward(q), atol=1e-12)


def test_no_tool_is_further_away_than_the_reach_which_maira_attains_at_zero(arm, rng):
    centre, reach = arm.targets.reach
    tools = np.array([arm.judge.forward(q)[:3, 3] for q in arm.configurations(200, rng)])
    assert np.linalg.norm(tools - centre, axis=1).max() <= reach
    if arm.name == "maira":
        assert np.linalg.norm(arm.judge.forward(np.zeros(7))[:3, 3] - centre) == pytest.approx(reach, rel=1e-12)


# The questions


def test_targets_far_away_are_out_of_reach_and_the_others_within(arm):
    centre, reach = arm.targets.reach
    far, near = (arm.ask(stratum, 20, 0).targets for stratum in (FAR_AWAY, "uniform"))
    np.testing.assert_allclose(np.linalg.norm(far[:, :3, 3] - centre, axis=1), 1.1 * reach)
    assert (np.linalg.norm(near[:, :3, 3] - centre, axis=1) <= reach).all()


def test_a_nearby_target_is_as_near_as_a_tenth_of_a_radian_lets_it_be(arm):
    asked = arm.ask(NEARBY, 50, 0)
    angles = arm.judge.verdict(asked.starts, asked.targets).orientation_error
    assert angles.max() <= 0.1 * np.sqrt(arm.robot.n)  # every axis turns the tool by its own angle at most
    assert angles.min() > 0


# Who takes part


def test_a_peer_whose_arm_is_another_one_is_refused(maira):
    shifted = Contestant(name="x", forward=lambda q: maira.judge.forward(q) + 2e-9)
    assert "forward kinematics is off by 2.0e-09" in line_up.disagreement(shifted, maira)
    broken = Contestant(name="x", forward=lambda q: np.full((4, 4), np.nan))
    assert "forward kinematics" in line_up.disagreement(broken, maira)
    wider = contestant(maira, None, limits=(maira.lower, maira.upper + 1e-5))
    assert "limits are off by 1.0e-05" in line_up.disagreement(wider, maira)
    same = contestant(maira, None, limits=(maira.lower, maira.upper))
    assert line_up.disagreement(same, maira) == ""


def test_a_peer_that_is_missing_or_fails_leaves_a_remark_and_the_others_go_on(maira, monkeypatch):
    def fails(arm):
        raise RuntimeError("no idea")

    module = SimpleNamespace(
        good=lambda arm: contestant(arm, None, name="good"),
        other=lambda arm: contestant(arm, None, limits=(arm.lower - 1, arm.upper)),
        fails=fails,
    )
    monkeypatch.setitem(sys.modules, "peers.pretended", module)
    peers = {"Missing": ("no_such_module", "nothing", "peers.pretended", "good")}
    peers |= {name: ("json", "", "peers.pretended", name) for name in ("fails", "other", "good")}
    monkeypatch.setattr(line_up, "PEERS", peers)
    monkeypatch.setattr(line_up, "one_at_a_time", lambda arm: [])
    taking_part, remarks = line_up.line_up(maira)
    assert [each.name for each in taking_part] == ["good"]
    assert remarks[0] == "Missing: skipped, not installed (pip install 'nothing')"
    assert remarks[1] == "fails: cannot do this arm: RuntimeError: no idea"
    assert remarks[2].startswith("other: refused, its joint limits")


def test_ours_on_another_arm_is_an_error(maira, monkeypatch):
    wrong = contestant(maira, None, name="maira_qp solve", limits=(maira.lower, maira.lower))
    monkeypatch.setattr(line_up, "one_at_a_time", lambda arm: [wrong])
    with pytest.raises(RuntimeError, match="maira_qp solve: its joint limits"):
        line_up.line_up(maira)


# The clock


def race(contestants, count, rounds=1, given_starts=False):
    targets = np.array([np.eye(4)] * count)
    targets[:, 0, 3] = np.arange(count)
    advanced = []
    runs = clock.race(
        contestants,
        targets,
        np.arange(2.0 * count).reshape(count, 2),
        given_starts=given_starts,
        rounds=rounds,
        advance=lambda: advanced.append(1),
    )
    assert len(advanced) == clock.turns(contestants, count, rounds)
    return runs


def test_everybody_answers_every_target_once_a_round_in_turns(maira):
    asked = {name: [] for name in "abc"}
    order = []

    def solve(name):
        def answer(target, start):
            asked[name].append(int(target[0, 3]))
            order.append(name)
            return np.full(2, target[0, 3])

        return contestant(maira, answer, name=name)

    runs = race([solve(name) for name in "abc"], 120, rounds=2)
    for name, run in zip("abc", runs, strict=True):
        assert sorted(asked[name]) == sorted(list(range(120)) * 2)
        np.testing.assert_array_equal(run.q, np.arange(120.0)[:, None].repeat(2, axis=1))
        assert run.claimed.all()
    turns = [order[i] for i in range(len(order)) if i == 0 or order[i] != order[i - 1]]
    assert "".join(turns[:3]) == "abc"
    assert len(set(turns[:12:3])) > 1, "the same one is always first"


def test_who_draws_starts_gets_none_unless_starts_are_given(maira):
    seen = {}

    def solve(name):
        return lambda target, start: seen.setdefault(name, start)

    for given in (False, True):
        seen.clear()
        who = [contestant(maira, solve("draws"), draws_starts=True), contestant(maira, solve("needs"))]
        race(who, 1, given_starts=given)
        assert (seen["draws"] is None) is (not given)
        assert seen["needs"] is not None


def test_the_fastest_round_counts_with_its_own_answers(maira, monkeypatch):
    time = FakeClock(monkeypatch)
    calls = []

    def solve(target, start):
        calls.append(1)
        number = (len(calls) - 1) // 3
        time.now += (3.0, 1.0, 2.0)[number]
        return np.full(2, float(number)) if number == 1 else None

    run = race([contestant(maira, solve)], 3, rounds=3)[0]
    np.testing.assert_array_equal(run.seconds, [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(run.q, np.ones((3, 2)))


def test_a_batch_shares_its_time_among_its_targets(maira, monkeypatch):
    time = FakeClock(monkeypatch)

    def solve_all(targets):
        time.now += 6.0
        return np.vstack([np.zeros((len(targets) - 1, 2)), [[np.nan, np.nan]]])

    run = race([Contestant(name="b", solve_all=solve_all)], 3)[0]
    np.testing.assert_array_equal(run.seconds, [2.0, 2.0, 2.0])
    assert run.claimed.tolist() == [True, True, False]
    assert not run.individual


def test_the_conversion_of_targets_is_not_timed(maira, monkeypatch):
    time = FakeClock(monkeypatch)

    def native(target):
        time.now += 100.0
        return target

    run = race([contestant(maira, lambda target, start: None, native=native)], 2)[0]
    np.testing.assert_array_equal(run.seconds, [0.0, 0.0])


# What comes out


def test_a_wrong_claim_is_false_and_no_claim_is_not(maira, rng):
    q = maira.configurations(3, rng)
    asked = arms.Questions(np.array([maira.judge.forward(row) for row in q]), q.copy())
    answers = q.copy()
    answers[1] = maira.lower
    answers[2] = np.nan
    run = clock.Run(np.ones(3), answers, individual=True)
    row = results.judged([contestant(maira, None)], [run], asked, maira.judge)[0]
    assert row.solved.tolist() == [True, False, False]
    assert row.false.tolist() == [False, True, False]
    assert row.jumped.tolist() == [False, True, False]


def test_slack_is_for_peers_only(maira):
    q = maira.upper[None] + 1e-10
    asked = arms.Questions(np.array([maira.judge.forward(q[0])]), q)
    run = clock.Run(np.ones(1), q, individual=True)
    peer, ours = contestant(maira, None), contestant(maira, None, slack=0.0)
    rows = results.judged([peer, ours], [run, run], asked, maira.judge)
    assert [bool(row.solved[0]) for row in rows] == [True, False]


def test_a_tick_is_out_of_limits_if_it_is_too_fast_or_ends_outside(maira):
    q = np.array([maira.upper, maira.upper, np.zeros(7)])
    v = np.zeros((3, 7))
    v[1, 2], v[2, 0] = 0.1, maira.judge.speed[0] * 1.01
    tick = results.ticked(contestant(maira, None), 1e-6, v, q, 0.01, maira.judge)
    assert tick.violations == pytest.approx(2 / 3)


def outcome(rng):
    def row(name, mean, solved, individual=True):
        seconds = mean * rng.exponential(size=50) if individual else np.full(50, mean)
        none = np.zeros(50, dtype=bool)
        return results.Row(name, "as it comes", seconds, individual, np.arange(50) < solved, none, none)

    rows = [
        row("slow", 1e-2, 0),
        row("maira_qp solve", 1e-5, 50),
        row("other", 1e-4, 49),
        row("maira_qp batch", 4e-6, 50, individual=False),
    ]
    ticks = [results.Tick("maira_qp solve", 2e-5, 0.0), results.Tick("Pink", 1e-4, 0.01)]
    return results.Outcome("arm", [], rows, rows[:3], rows[:3], ticks)


def test_the_tables_have_everybody_the_fastest_first_and_ours_as_the_unit(rng):
    made = outcome(rng)
    console = Console(file=io.StringIO(), record=True, width=report.WIDTH)
    for table in report.tables(made):
        console.print(table)
    lines = [line.split("│") for line in console.export_text().splitlines() if line.startswith("│")]
    first = [[cell.strip() for cell in line] for line in lines[:4]]
    assert [line[1] for line in first] == ["maira_qp batch", "maira_qp solve", "other", "slow"]
    assert [line[3] for line in first] == ["100.0 %", "100.0 %", "98.0 %", "0.0 %"]
    ratio = made.anywhere[2].mean / made.anywhere[1].mean
    assert float(first[2][8]) == pytest.approx(ratio, rel=1e-2)
    assert first[1][8] == "1.00"
    assert first[0][6] == "-", "a batch has no median"
    assert len(lines) == 4 + 3 + 2 + 3


def test_the_picture_has_a_row_an_arm_and_survives_a_solver_that_solves_nothing(rng, tmp_path):
    from PIL import Image

    sizes = []
    for rows in (1, 2):
        with Image.open(picture.draw([outcome(rng)] * rows, tmp_path / "race.png")) as drawn:
            sizes.append(drawn.size)
            assert np.asarray(drawn.convert("L")).std() > 10, "it is empty"
    assert sizes[1][0] == sizes[0][0]
    assert sizes[1][1] > 1.7 * sizes[0][1]
