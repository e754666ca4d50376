"""MJCF where MuJoCo is not installed."""

import sys

import pytest

import maira_qp as mq
from maira_qp.errors import RobotError


def test_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RobotError, match=r"MuJoCo, which is not installed: pip install 'maira-qp\[mujoco\]'"):
        mq.Robot.from_mjcf("<mujoco/>")
