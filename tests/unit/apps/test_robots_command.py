"""`maira-qp robots`, and robots by name and as MJCF on the command line."""

import json

import pytest

import maira_qp as mq
from maira_qp.apps import cli
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.robots.library import packages
from maira_qp.robots.library.names import entry_of

FEW = tuple(map(entry_of, ("maira", "panda", "tiago_dual")))


def test_the_list_fits_a_terminal_and_says_what_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(packages, "installed", lambda: FEW)
    monkeypatch.setenv("COLUMNS", "80")
    assert cli.main(["robots"]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    for word in ("panda", "panda_hand_tcp", "example-robot-data", "arm_right_tool_link", "pip install rtb-data"):
        assert word in out
    assert cli.main(["robots", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [robot["name"] for robot in told["robots"]] == ["maira", "panda", "tiago_dual"]
    assert told["robots"][1]["joints"] == 7
    assert told["robots"][1]["states"] == ["default"]
    assert "kr210" in told["not_installed"]["rtb-data"]


def test_commands_take_names(capsys):
    assert RobotChoice(robot="panda").load() == mq.Robot.load("panda")
    assert RobotChoice(robot="rtb-data/kr210", tip="link_4").load().n == 4
    assert cli.main(["fk", "--robot", "pandda"]) == 2
    assert "did you mean 'panda'" in capsys.readouterr().err


def test_an_xml_file_is_mjcf_where_it_says_so(tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body name="b"><joint range="-9 9"/><geom size="1"/></body></worldbody></mujoco>'
    )
    assert RobotChoice(robot=str(path)).load().tip == "b"
    path.write_text(mq.Robot.maira().urdf)
    assert RobotChoice(robot=str(path)).load().n == 7


@pytest.mark.parametrize("command", [["fk"], ["solve", "--position", "0.5", "0", "0.5"]])
def test_a_robot_with_several_tips_needs_one_named(command, capsys):
    assert cli.main([*command, "--robot", "baxter"]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "baxter has two tips; name one: --tip left_gripper or --tip right_gripper" in told
    assert cli.main(["fk", "--robot", "baxter", "--tip", "left_gripper"]) == 0
