"""Pictures show what they were given: data, limits, intervals and units."""

import re

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgba
from PIL import Image

import maira_qp as mq
from maira_qp.analytic.srs.geometry import BRANCHES, SRS
from maira_qp.apps import plots
from maira_qp.apps.plots import reach
from maira_qp.errors import OptionError, RobotError
from maira_qp.evaluation.reach_slice import reach_slice
from maira_qp.evaluation.statistics import wilson_interval


@pytest.fixture
def axes():
    return plots.figure().axes[0]


@pytest.fixture
def space():
    return plots.figure(space=True).axes[0]


def test_a_figure_has_the_axes_asked_for():
    """Rows times columns, flat or in space."""
    assert len(plots.figure(2, 3).axes) == 6
    assert [ax.name for ax in plots.figure(1, 2, space=True).axes] == ["3d", "3d"]


def test_a_saved_figure_is_a_picture(tmp_path):
    """Missing folders are made, and the file can be read back."""
    path = plots.save(plots.figure(), tmp_path / "new" / "empty.png")
    with Image.open(path) as picture:
        assert picture.size == (750, 540)


def test_a_chain_goes_through_its_origins(space):
    """The first line drawn has the origins of all frames, and the scales are the same on the three axes."""
    htms = mq.Robot.maira().dh.compute_htms(np.full(7, 0.4))
    plots.draw_chain(space, htms, target=np.array([0.4, 0.2, 2.5]), trail=np.zeros((3, 3)), label="MAIRA")
    np.testing.assert_allclose(np.transpose(space.lines[0].get_data_3d()), htms[:, :3, 3])
    limits = np.array([space.get_xlim(), space.get_ylim(), space.get_zlim()])
    np.testing.assert_allclose(np.ptp(limits, axis=1), np.ptp(limits[0]))
    assert limits[2, 1] > 2.5
    assert [space.get_xlabel(), space.get_ylabel(), space.get_zlabel()] == ["x [m]", "y [m]", "z [m]"]


def test_the_tool_axes_are_those_of_the_last_frame(space):
    """Three short lines start at the tool, along its x, y and z; a target pose gets three too, and all is in view."""
    htms = mq.Robot.maira().dh.compute_htms(np.full(7, 0.4))
    plots.draw_chain(space, htms)
    for line, direction in zip(space.lines[-3:], htms[-1, :3, :3].T, strict=True):
        ends = np.transpose(line.get_data_3d())
        np.testing.assert_allclose(ends[0], htms[-1, :3, 3])
        np.testing.assert_allclose((ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0]), direction, atol=1e-12)
    before, low = len(space.lines), space.get_xlim()[0]
    plots.draw_chain(space, htms, target=np.eye(4), index=1)
    assert len(space.lines) == 2 * before + 4
    shifted = htms.copy()
    shifted[:, 0, 3] -= 5.0
    plots.draw_chain(space, shifted)
    assert space.get_xlim()[0] < low - 4.0


def test_a_flat_and_a_tiny_chain_can_be_drawn(space):
    """All origins in one plane, or in one point, still give a cube that is not empty."""
    plots.draw_chain(space, np.tile(np.eye(4), (3, 1, 1)))
    assert np.ptp(space.get_zlim()) > 0
    space.figure.canvas.draw()


def test_an_animation_has_every_frame(tmp_path):
    """One picture a frame, at the rate asked for, each different from the last while the arm moves."""
    table = mq.Robot.maira().dh
    frames = [table.compute_htms(np.full(7, angle)) for angle in (0.1, 0.3, 0.5)]
    targets = [np.array([0.5, 0.0, 0.9])] * 2 + [np.eye(4)]
    path = plots.animate_chain(tmp_path / "gif" / "arm.gif", frames, targets, rate=20.0)
    with Image.open(path) as film:
        assert film.n_frames == 3
        assert film.info["duration"] == 50
        assert film.info["loop"] == 0
        pictures = []
        for k in range(3):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB")))
    assert (pictures[0] != pictures[1]).any()
    assert (pictures[1] != pictures[2]).any()
    assert path.stat().st_size < 40_000


def test_a_film_in_mp4_goes_through_ffmpeg(tmp_path, monkeypatch):
    """A stand-in for ffmpeg is given whole pictures of even size, as many as there are frames, and names its file."""
    stand_in = tmp_path / "ffmpeg"
    stand_in.write_text('#!/bin/sh\nfor last; do :; done\necho "$@" > "$last"\nwc -c >> "$last"\n')
    stand_in.chmod(0o755)
    monkeypatch.setitem(matplotlib.rcParams, "animation.ffmpeg_path", str(stand_in))
    frames = [np.array([np.eye(4), mq.pose([0.1 * k, 0.2, 0.5]).homogeneous]) for k in range(3)]
    film = plots.animate_chain(tmp_path / "arm.mp4", frames, [np.zeros(3)] * 3, rate=20.0)
    told, count = film.read_text().splitlines()
    width, height = map(int, re.search(r"-s (\d+)x(\d+) -r 20 ", told).groups())
    assert width % 2 == height % 2 == 0
    assert int(count) == 3 * 3 * width * height
    stand_in.write_text("#!/bin/sh\ncat > /dev/null\necho no such codec >&2\nexit 1\n")
    with pytest.raises(OptionError, match="ffmpeg made no film: no such codec"):
        plots.animate_chain(tmp_path / "bad.mp4", frames, [np.zeros(3)] * 3)
    monkeypatch.setitem(matplotlib.rcParams, "animation.ffmpeg_path", str(tmp_path / "nowhere"))
    with pytest.raises(OptionError, match="needs ffmpeg"):
        plots.animate_chain(tmp_path / "bad.mp4", frames, [np.zeros(3)] * 3)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["arm.mp4", "ffmpeg"]


@pytest.mark.parametrize("targets", [[], [np.zeros(3)] * 2])
def test_an_animation_needs_a_target_a_frame(tmp_path, targets):
    """No frames, or another number of targets, is refused."""
    frames = [np.eye(4)[None]] * min(len(targets), 1)
    with pytest.raises(OptionError, match="as many targets as frames"):
        plots.animate_chain(tmp_path / "arm.gif", frames, targets)


def test_the_tradeoff_curve_shows_every_weight_and_the_strict_point(axes):
    """Residuals and costs are the data, each weight is written at its point, and a residual of 0 has a place."""
    plots.trade_off(axes, [1e-3, 1e-1], [1e-4, 1e-2], [0.9, 0.4], strict=(0.0, 1.0))
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[1e-4, 0.9], [1e-2, 0.4]])
    np.testing.assert_allclose(axes.lines[1].get_xydata(), [[1e-16, 1.0]])
    assert [text.get_text() for text in axes.texts] == ["1e-3", "1e-1"]
    assert axes.get_xscale() == "log"
    assert "[" in axes.get_xlabel()
    assert "[rad²]" in axes.get_ylabel()


def test_joint_paths_are_shares_of_the_range(axes):
    """A joint at its lower limit is at 0, at its upper at 1; locked and unlimited joints stay finite."""
    robot = mq.Robot.from_dh(
        [
            mq.DHLink(kind="revolute", a=1.0, lower=-1.0, upper=3.0),
            mq.DHLink(kind="revolute", a=1.0, lower=0.2, upper=0.2),
            mq.DHLink(kind="continuous", a=1.0),
        ]
    )
    plots.joint_paths(axes, robot, [[-1.0, 0.2, 0.0], [3.0, 0.2, np.pi / 2]], times=[0.0, 0.5])
    drawn = [line.get_ydata() for line in axes.lines[:3]]
    np.testing.assert_allclose(drawn, [[0.0, 1.0], [0.0, 0.0], [0.5, 0.75]])
    np.testing.assert_allclose(axes.lines[0].get_xdata(), [0.0, 0.5])
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(robot.joint_names)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "joint, in its range [%]")


def test_no_two_of_many_lines_look_the_same():
    """Sixteen joints have sixteen pairs of colour and dashes."""
    assert len({str(plots.line(i)) for i in range(16)}) == 16


def test_infinite_condition_numbers_leave_a_gap(axes):
    """Singular iterates are not drawn, the others are."""
    plots.condition_numbers(axes, {"Newton": [np.inf, 100.0, 3.0], "Strict": [5.0, 4.0]})
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), [np.nan, 100.0, 3.0])
    np.testing.assert_array_equal(axes.lines[1].get_ydata(), [5.0, 4.0])
    assert axes.get_yscale() == "log"
    axes.figure.canvas.draw()


def test_success_bars_carry_their_wilson_intervals(axes):
    """A bar's length is its rate, its whisker the interval; the legend names each method once."""
    counts = {"uniform": {"plain": (38, 100), "ours": (100, 100)}, "near limits": {"ours": (0, 0)}}
    plots.success_bars(axes, counts)
    assert sorted(bar.get_width() for bar in axes.patches) == [0.0, 0.38, 1.0]
    whiskers = axes.containers[1].lines[2][0].get_segments()[0][:, 0]
    np.testing.assert_allclose(whiskers, wilson_interval(38, 100))
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["plain", "ours"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["uniform", "near limits"]
    assert "38 %" in [text.get_text() for text in axes.texts]
    axes.figure.canvas.draw()


def test_the_style_ends_with_its_block():
    """Nothing global is changed by a figure, a drawing or the block; inside, the style is on."""
    before = dict(matplotlib.rcParams)
    made = plots.figure()
    plots.condition_numbers(made.axes[0], {"a": [1.0, 2.0]})
    assert dict(matplotlib.rcParams) == before
    with plots.style():
        assert dict(matplotlib.rcParams) != before
    assert dict(matplotlib.rcParams) == before
    assert made.axes[0].lines[0].get_linewidth() == 1.8


def test_a_picture_is_whole_or_not_there(tmp_path):
    """A picture that cannot be written leaves the old one, and nothing beside it; each kind is what its name says."""
    for kind, head in (("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")):
        assert plots.save(plots.figure(), tmp_path / f"a.{kind}").read_bytes().startswith(head)
    made, path = plots.figure(), tmp_path / "a.png"
    made.axes[0].set_title("$\\nonsense{$")
    before = path.read_bytes()
    with pytest.raises(ValueError, match="nonsense"):
        plots.save(made, path)
    assert path.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.pdf", "a.png", "a.svg"]


def test_convergence_draws_the_errors_of_what_was_visited(axes, maira, rng):
    """Position in m and orientation in rad of every configuration; the tolerances are drawn."""
    target = maira.forward(maira.random_configuration(rng))
    solver = mq.Solver(maira, options=mq.Options(position_tolerance=1e-4))
    visited = []
    s = solver.solve(target, maira.random_configuration(rng), observe=visited.append)
    plots.convergence(axes, solver, target, visited)
    position, orientation = axes.lines[0].get_ydata(), axes.lines[2].get_ydata()
    assert len(position) == len(orientation) == len(visited)
    there = maira.forward(visited[1])
    assert position[1] == pytest.approx(np.linalg.norm(there.translation - target.translation))
    turned = there.rotation.T @ target.rotation
    assert orientation[1] == pytest.approx(np.arccos((np.trace(turned) - 1) / 2))
    assert position[-1] == pytest.approx(max(s.position_error, 1e-17), abs=1e-15)
    assert [axes.lines[k].get_ydata()[0] for k in (1, 3)] == [1e-4, 1e-6]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("iteration", "pose error [m], [rad]")
    assert axes.get_yscale() == "log"


@pytest.mark.parametrize("name", ["maira", "iiwa14"])
def test_the_shaded_part_of_a_self_motion_is_outside_the_limits(axes, rng, name):
    """At any swivel angle: shaded if and only if no turn of the branch's configuration is within the limits."""
    robot = getattr(mq.Robot, name)()
    srs = SRS.of(robot)
    shades = 0
    for _ in range(3):
        target = robot.forward(robot.random_configuration(rng)).homogeneous
        for one in mq.Solver(robot).solutions(target)[:3]:
            axes.clear()
            plots.self_motion(axes, target, one)
            spans = np.radians([[patch.get_x(), patch.get_x() + patch.get_width()] for patch in axes.patches])
            spans = spans.reshape(-1, 2)
            shades += len(spans)
            psi = rng.uniform(-np.pi, np.pi, 200)
            psi = psi[np.abs(spans.reshape(-1, 1) - psi).min(axis=0, initial=1.0) > 1e-6]
            elbow = next(e for e in srs.elbow_branches(target) if e.sign == one.branch.elbow)
            q = srs.evaluate(elbow, psi)[:, BRANCHES.index(one.branch) % 4]
            turned = q + 2 * np.pi * np.arange(-2, 3)[:, None, None]
            within = ((robot.lower <= turned) & (turned <= robot.upper)).any(axis=0).all(axis=1)
            shaded = ((spans[:, :1] < psi) & (psi < spans[:, 1:])).any(axis=0)
            np.testing.assert_array_equal(shaded, ~within)
            drawn = np.array([line.get_ydata() for line in axes.lines if line.get_linewidth() == 2.2])
            assert np.nanmin(drawn) >= 0.0
            assert np.nanmax(drawn) <= 1.0
            solution = next(line for line in axes.lines if line.get_label() == "solution")
            assert np.radians(solution.get_xdata()[0]) == pytest.approx((one.psi + np.pi) % (2 * np.pi) - np.pi)
    assert shades > 0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("swivel angle ψ [deg]", "joint, in its range [%]")


def test_arc_bars_are_the_arcs(axes, iiwa14, rng):
    """A bar an arc, as long in all, and a point on each; a star at the first; another arm is refused."""
    target = iiwa14.forward(iiwa14.random_configuration(rng))
    solutions = mq.Solver(iiwa14).solutions(target)
    plots.arc_bars(axes, solutions)
    length = sum(bar.get_width() for bar in axes.patches)
    assert length == pytest.approx(np.degrees(sum(one.arc.length for one in solutions)))
    assert [line.get_marker() for line in axes.lines] == ["*", *"o" * (len(solutions) - 1)]
    for point in axes.lines:
        (x,), (y,) = point.get_data()
        bars = [bar for bar in axes.patches if abs(bar.get_y() + 0.25 - y) < 1e-9]
        assert any(bar.get_x() - 1e-9 <= x <= bar.get_x() + bar.get_width() + 1e-9 for bar in bars)
    assert "[sign]" in axes.get_ylabel()
    with pytest.raises(RobotError, match="S-R-S"):
        plots.arc_bars(axes, [mq.ListedSolution(np.zeros(7), 0.0, 0.0, 0.0)])


def test_a_reach_slice_is_coloured_by_status(axes):
    """Reached, proved unreachable, and open: a nearest point or a spent budget; the legend tells the shares."""
    status = np.array([[mq.Status.CONVERGED, mq.Status.UNREACHABLE], [mq.Status.NEAREST, mq.Status.BUDGET_SPENT]])
    plots.reach_slice(axes, np.array([0.0, 1.0]), np.array([0.0, 1.0]), status, axes="yz")
    (mesh,) = axes.collections
    colors = mesh.to_rgba(mesh.get_array()).reshape(2, 2, 4)
    fills = [to_rgba(fill) for fill in reach.FILLS]
    np.testing.assert_allclose(colors, [[fills[0], fills[1]], [fills[2], fills[2]]])
    shares = [text.get_text() for text in axes.get_legend().get_texts()]
    assert shares == ["reached (25.0 %)", "proved unreachable (25.0 %)", "open: neither (50.0 %)"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("y [m]", "z [m]")
    greys = [np.dot(fill[:3], [0.299, 0.587, 0.114]) for fill in fills]
    assert np.diff(sorted(greys)).min() > 0.15  # told apart in grey


def test_a_plane_of_a_map_has_a_scale_and_nothing_where_nothing_is_known(axes):
    plots.map_slice(
        axes, np.arange(3.0), np.arange(2.0), np.array([[0, 0.5, 1], [np.nan, 1, 0]]), axes="xy", label="a_b"
    )
    mesh = axes.collections[0]
    np.testing.assert_array_equal(np.ma.getmaskarray(mesh.get_array()).ravel(), [False] * 3 + [True] + [False] * 2)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    scale = next(other for other in axes.figure.axes if other is not axes)
    assert scale.get_ylabel() == "a b"
    assert scale.get_ylim() == (0.0, 1.0)


def test_a_reach_slice_asks_for_every_cell(maira):
    """Each cell has the verdict of its own pose, the window holds what can be reached, progress comes to its end."""
    told, rotation = [], np.diag([1.0, -1.0, -1.0])
    solver = mq.Solver(maira)
    found = reach_slice(solver, rotation, plane="yz", at=0.3, cells=9, progress=lambda *a: told.append(a))
    assert found.status.shape == (9, 9)
    assert told[-1] == (81, 81)
    for i, j in ((0, 0), (4, 1), (2, 6), (6, 4)):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation, [0.3, found.x[j], found.y[i]]
        assert solver.solve(T).status == found.status[i, j]
    assert found.status[[0, -1]].min() > 0  # nothing is reached at the edge
    assert found.status[:, [0, -1]].min() > 0
    assert (found.status == 0).any()
    for wrong in ({"plane": "zz"}, {"cells": 1}):
        with pytest.raises(OptionError, match=next(iter(wrong))):
            reach_slice(solver, rotation, **wrong)


def test_a_path_picture_shows_what_was_followed(maira):
    """A panel more for an S-R-S arm, whose swivel angle lies in the bars at every pose; time where there is one."""
    line = [mq.pose([0.5, y, 0.6], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.1, 0.1, 12)]
    path = mq.Solver(maira).track(line)
    made = plots.path_picture(path)
    assert len(made.axes) == 5
    assert made.axes[-1].get_xlabel() == "pose"
    np.testing.assert_allclose(made.axes[2].lines[0].get_ydata(), np.maximum(path.position_error, 1e-17))
    swivel = made.axes[-1].lines[0].get_xydata()
    bars = made.axes[-1].patches
    assert len(swivel) == 12
    for q, (x, psi) in zip(path.q, swivel, strict=True):
        turned = SRS.of(maira).configurations(maira.forward(q), np.radians(psi)) - q
        assert np.abs(np.remainder(turned + np.pi, 2 * np.pi) - np.pi).max(axis=1).min() < 1e-5
        here = [bar for bar in bars if np.isclose(bar.get_x(), x)]
        assert any(bar.get_y() - 1e-6 <= psi <= bar.get_y() + bar.get_height() + 1e-6 for bar in here)
    trajectory = path.timed(acceleration=5.0)
    made = plots.path_picture(path, trajectory)
    assert made.axes[-1].get_xlabel() == "time [s]"
    np.testing.assert_allclose(made.axes[0].lines[0].get_xdata(), trajectory.times)
    shares = [line.get_ydata() for line in made.axes[1].lines[:7]]
    np.testing.assert_allclose(np.transpose(shares), trajectory.velocity / maira.velocity_limit)
