"""The viewer in a cell, and progress bars, without a notebook: what a cell is given to show."""

import io
import re
import sys
import types
from urllib.request import urlopen

import numpy as np
import pytest
import rich

import maira_qp as mq
from maira_qp.apps.notebook import ProgressBar, view
from maira_qp.errors import OptionError


def test_a_cell_frames_the_page_of_the_robot_with_its_tool():
    pytest.importorskip("viser")
    robot = mq.Robot.maira().with_tool([0.0, 0.0, 0.1])
    cell = view(robot, height=400)
    try:
        (address,) = re.findall('src="([^"]*)"', cell._repr_html_())
        assert 'height="400"' in cell._repr_html_()
        assert b"<html" in urlopen(address, timeout=10).read()
        assert address == cell.url
        assert robot.name in repr(cell)
        np.testing.assert_allclose(cell.q, np.clip(cell.q, robot.lower, robot.upper))
    finally:
        cell.close()


def test_the_viewer_says_nothing_when_it_starts_and_ends():
    """Neither on the standard output nor where rich writes to, which in a notebook is the cell."""
    pytest.importorskip("viser")
    said = io.StringIO()
    rich.reconfigure(file=said)
    try:
        view(mq.Robot.maira()).close()
    finally:
        rich.reconfigure()
    assert said.getvalue() == ""


@pytest.mark.parametrize(
    ("robot", "height"), [("maira", 600), (None, 600), (mq.Robot.maira(), 0), (mq.Robot.maira(), 1.5)]
)
def test_what_is_no_robot_or_no_height_is_said(robot, height):
    with pytest.raises(OptionError, match=r"(robot|height) must be"):
        view(robot, height=height)


def test_in_a_notebook_one_picture_is_renewed(monkeypatch):
    shown = []

    class Handle:
        def update(self, picture):
            shown.append(picture)

    def display(picture, display_id):
        shown.append(picture)
        return Handle()

    shell = types.SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", types.SimpleNamespace(display=display))
    solver = mq.Solver(mq.Robot.maira())
    target = mq.pose([0.4, 0.2, 0.9], quaternion=[0, 1, 0, 0])
    solver.solve_batch([target] * 3, progress=ProgressBar("<solve>"))
    assert shown[-1]._repr_html_() == '<progress value="3" max="3"></progress> &lt;solve&gt; 3 of 3'
    assert repr(shown[-1]) == "<solve> 3 of 3"


def test_elsewhere_it_is_a_line_of_the_terminal(capsys):
    bar = ProgressBar()
    for done in range(5):
        bar(done, 4)
    out = capsys.readouterr().err
    assert out.endswith("4 of 4" + " " * 73 + "\n")
    assert all(len(line) <= 80 for line in out.split("\r"))
