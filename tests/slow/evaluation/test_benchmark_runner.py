"""The runner and its file: rows that can be trusted, a run that goes on where it was killed, other settings refused."""

import csv
import json
import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from maira_qp.arrays import plain
from maira_qp.errors import BackendError, OptionError
from maira_qp.evaluation import runner
from maira_qp.evaluation.contestant import Answer, Contestant
from maira_qp.evaluation.records import RowFile, write_csv
from maira_qp.evaluation.runner import fingerprint, measure, plan, run
from maira_qp.evaluation.settings import METHODS, NO_BACKEND, Settings
from maira_qp.problem.options import Options
from maira_qp.robots.model.robot import Robot


def small_plan(robot, **changes):
    """Few targets, two quick methods."""
    chosen = {"methods": ("newton", "pose"), "strata": ("uniform", "out-of-reach"), "targets": 3} | changes
    return plan(robot, Settings(**chosen), Options(max_restarts=2))


def timeless(rows):
    """The rows without the one figure that differs from run to run."""
    return [{key: value for key, value in row.items() if key != "time"} for row in rows]


@pytest.fixture(scope="module")
def finished(maira, tmp_path_factory):
    """The rows of a run that was left alone, and what its file holds."""
    path = tmp_path_factory.mktemp("finished") / "rows.jsonl"
    return run(small_plan(maira), path), path.read_bytes()


def test_a_row_for_each_question(maira, tmp_path):
    """Each method answers each target once, in a fixed order, and the file holds what was returned."""
    made = small_plan(maira)
    told = []
    rows = run(made, tmp_path / "rows.jsonl", told.append)
    keys = [(row["stratum"], row["index"], row["method"]) for row in rows]
    assert keys == [(s, i, m) for s in ("uniform", "out-of-reach") for i in range(3) for m in ("newton", "pose")]
    assert told == list(range(made.rows + 1))
    lines = (tmp_path / "rows.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines[1:]] == rows
    assert json.loads(lines[0])["settings"]["targets"] == 3


@pytest.mark.parametrize("cut", [1, 17, 300, 900, 2500])
def test_goes_on_after_a_kill(maira, tmp_path, finished, cut):
    """A file cut anywhere, in the middle of a line too, ends up with the same rows as a run that was left alone."""
    (rows, content), torn = finished, tmp_path / "torn.jsonl"
    torn.write_bytes(content[:-cut])
    assert timeless(run(small_plan(maira), torn)) == timeless(rows)
    assert timeless(run(small_plan(maira), torn)) == timeless(rows)  # and can be read again
    kept = content[: content[:-cut].rfind(b"\n") + 1]
    assert torn.read_bytes().startswith(kept)  # what was whole was not touched


def test_a_finished_run_measures_nothing(maira, tmp_path, finished, monkeypatch):
    """Started again, a finished run returns its rows, times and all, without solving."""
    rows, content = finished
    (tmp_path / "rows.jsonl").write_bytes(content)
    monkeypatch.setattr(runner, "row_of", None)
    assert run(small_plan(maira), tmp_path / "rows.jsonl") == rows


def test_a_killed_process_loses_no_whole_row(tmp_path):
    """After os._exit in the middle of a run, every row that was told to the progress is in the file."""
    path = tmp_path / "rows.jsonl"
    code = (
        "import os, sys\n"
        "from maira_qp.evaluation.records import RowFile\n"
        "file = RowFile(sys.argv[1], {'a': 1})\n"
        "for i in range(100):\n"
        "    file.append({'i': i})\n"
        "os._exit(9)\n"
    )
    assert subprocess.run([sys.executable, "-c", code, str(path)], check=False).returncode == 9
    with RowFile(path, {"a": 1}) as file:
        assert [row["i"] for row in file.rows] == list(range(100))


@pytest.mark.parametrize(
    "changes", [{"seed": 1}, {"targets": 4}, {"methods": ("pose",)}, {"weight": 0.5}, {"loose_position": 3e-3}]
)
def test_other_settings_are_refused(maira, tmp_path, finished, changes):
    """Rows of other settings are not mixed: the error names what differs, and the file is left as it was."""
    path = tmp_path / "rows.jsonl"
    path.write_bytes(finished[1])
    with pytest.raises(OptionError, match=next(iter(changes))):
        run(small_plan(maira, **changes), path)
    assert path.read_bytes() == finished[1]


def test_other_options_and_robots_are_other_settings(maira, iiwa14):
    """The solver's options and the robot's limits count as settings."""
    base = fingerprint(small_plan(maira))
    assert base == fingerprint(small_plan(Robot.maira()))
    assert base != fingerprint(plan(maira, small_plan(maira).settings, Options(max_restarts=3)))
    assert base["robot_sha256"] != fingerprint(small_plan(iiwa14))["robot_sha256"]


def test_other_files_are_refused(tmp_path):
    """What is no file of rows is not written to."""
    for content, message in (
        (b"hello\n", "line 1"),
        (b'{"a": 1}\n', "no settings"),
        (b'{"settings": {}}\n[1]\n', "line 2"),
    ):
        path = tmp_path / "rows.jsonl"
        path.write_bytes(content)
        with pytest.raises(OptionError, match=message):
            RowFile(path, {})
        assert path.read_bytes() == content


def test_rows_are_on_the_disk_when_the_file_is_closed(tmp_path, monkeypatch):
    """Forced there with the settings at the beginning, and with all rows at the end."""
    sizes = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: sizes.append(os.fstat(descriptor).st_size))
    path = tmp_path / "rows.jsonl"
    with RowFile(path, {"a": 1}) as file:
        assert sizes == [path.stat().st_size]
        for k in range(3):
            file.append({"k": k})
    assert sizes[-1] == path.stat().st_size > sizes[0]


def test_one_writer_at_a_time(tmp_path):
    """A second process, or a second opening, is refused while the first holds the file; afterwards it may."""
    path = tmp_path / "rows.jsonl"
    with RowFile(path, {}), pytest.raises(OptionError, match="another process"):
        RowFile(path, {})
    with RowFile(path, {}) as file:
        assert file.rows == []


def test_json_never_holds_nan(tmp_path):
    """What is not finite becomes null, at any depth; the line is JSON by the letter."""
    path = tmp_path / "rows.jsonl"
    with RowFile(path, {"x": math.inf}) as file:
        file.append(
            {"a": math.nan, "b": [1.0, -math.inf], "c": np.array([np.nan, 2.0]), "d": np.float64("nan"), "e": (1,)}
        )
        assert file.rows == [{"a": None, "b": [1.0, None], "c": [None, 2.0], "d": None, "e": [1]}]

    def refuse(constant):
        raise AssertionError(constant)

    for line in path.read_text().splitlines():
        json.loads(line, parse_constant=refuse)
    assert plain({"n": np.int64(3), "t": np.bool_(True)}) == {"n": 3, "t": True}


def test_csv_holds_every_row(maira, tmp_path):
    """The table has a line a row and a column a field; the joint values of a row are one cell."""
    rows = run(small_plan(maira, targets=1), tmp_path / "rows.jsonl")
    write_csv(tmp_path / "rows.csv", rows)
    with open(tmp_path / "rows.csv", newline="") as file:
        read = list(csv.DictReader(file))
    assert len(read) == len(rows)
    assert list(read[0]) == list(rows[0])
    for a, b in zip(read, rows, strict=True):
        assert [float(word) for word in a["q"].split()] == b["q"]
        assert float(a["position_error"]) == b["position_error"]
    assert [path.name for path in tmp_path.iterdir() if path.name.endswith(".part")] == []


def test_all_methods_answer(maira):
    """Every method with two backends: what it claims within its own tolerance the judge confirms, limits are kept."""
    made = plan(maira, Settings(backends=("daqp", "proxqp"), strata=("uniform",), targets=3), Options())
    rows = list(measure(made))
    asked = {(row["method"], row["backend"]) for row in rows}
    assert asked == {(m, NO_BACKEND) for m in METHODS[:3]} | {(m, b) for m in METHODS[3:] for b in ("daqp", "proxqp")}
    for row in rows:
        assert row["reachable"]
        if row["method"] in ("pose", "strict"):
            assert row["strict"]
        if row["method"] in ("dh-clamped", "pose", "weighted", "strict"):
            assert row["limit_violation"] == 0
            assert row["confirmed"] or not row["claimed"]


def test_strict_beats_random_posture(maira):
    """On the same targets the strict hierarchy's posture costs less than the pose alone, at no less success."""
    made = plan(maira, Settings(methods=("pose", "strict"), strata=("uniform",), targets=8), Options())
    rows = list(measure(made))
    cost = {m: sum(row["posture_cost"] for row in rows if row["method"] == m) for m in ("pose", "strict")}
    assert cost["strict"] < cost["pose"]
    assert all(row["strict"] for row in rows)


def test_out_of_reach_is_never_solved(maira):
    """No method is said to reach what cannot be reached, and the error is at least the margin."""
    made = plan(maira, Settings(strata=("out-of-reach",), targets=1), Options(max_restarts=2))
    for row in measure(made):
        assert [row[key] for key in ("strict", "loose", "confirmed")] == [False, False, False]
        assert row["limit_violation"] > 0 or row["position_error"] >= 0.01 - 1e-12


def test_the_judge_overrules_a_liar(maira):
    """A method that claims success without solving is counted as a false claim and as a failure."""
    made = small_plan(maira, targets=2, strata=("uniform",))
    liar = Contestant(name="liar", solve=lambda target, start: start, answer=lambda q: Answer(q, True, "CONVERGED", 1))
    for row in measure(replace(made, methods=[liar])):
        assert row["claimed"]
        assert [row[key] for key in ("strict", "loose", "confirmed")] == [False, False, False]


def test_a_urdf_robot_has_no_dh_methods(maira):
    """The references need a DH table: for a robot from a URDF they are left out, and a note says so."""
    robot = Robot.from_urdf(maira.urdf)
    made = plan(robot, Settings(targets=1), Options())
    assert {method.name for method in made.methods} == {"pose", "weighted", "fading", "strict"}
    assert sum("needs a DH table" in note for note in made.notes) == 3
    with pytest.raises(OptionError, match="nothing to run"):
        plan(robot, Settings(methods=("newton",)), Options())


def test_bad_settings():
    """Each mistake has its own message."""
    for changes, message in (
        ({"targets": 0}, "targets"),
        ({"seed": -1}, "seed"),
        ({"weight": math.nan}, "weight"),
        ({"loose_position": 0.0}, "loose_position"),
        ({"methods": ()}, "methods"),
        ({"strata": ("uniform", "uniform")}, "strata"),
    ):
        with pytest.raises(OptionError, match=message):
            Settings(**changes)
    with pytest.raises(OptionError, match="did you mean 'strict'"):
        plan(Robot.maira(), Settings(methods=("strikt",)), Options())
    with pytest.raises(BackendError, match="daqp"):
        plan(Robot.maira(), Settings(backends=("nope",)), Options())
