"""Pictures show what they were given: data, limits, intervals and units."""

import numpy as np
import pytest
from PIL import Image

from maira_qp.apps import plots
from maira_qp.apps.benchmark.statistics import wilson_interval
from maira_qp.errors import OptionError
from maira_qp.robots.catalog import maira


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
    htms = maira().compute_htms(np.full(7, 0.4))
    plots.draw_chain(space, htms, target=np.array([0.4, 0.2, 2.5]), trail=np.zeros((3, 3)), label="MAIRA")
    np.testing.assert_allclose(np.transpose(space.lines[0].get_data_3d()), htms[:, :3, 3])
    limits = np.array([space.get_xlim(), space.get_ylim(), space.get_zlim()])
    np.testing.assert_allclose(np.ptp(limits, axis=1), np.ptp(limits[0]))
    assert limits[2, 1] > 2.5
    assert [space.get_xlabel(), space.get_ylabel(), space.get_zlabel()] == ["x [m]", "y [m]", "z [m]"]


def test_the_tool_axes_are_those_of_the_last_frame(space):
    """Three short lines start at the tool, along its x, y and z; a target pose gets three too, and all is in view."""
    htms = maira().compute_htms(np.full(7, 0.4))
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
    table = maira()
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


@pytest.mark.parametrize("targets", [[], [np.zeros(3)] * 2])
def test_an_animation_needs_a_target_a_frame(tmp_path, targets):
    """No frames, or another number of targets, is refused."""
    frames = [np.eye(4)[None]] * min(len(targets), 1)
    with pytest.raises(OptionError, match="as many targets as frames"):
        plots.animate_chain(tmp_path / "arm.gif", frames, targets)


def test_the_tradeoff_curve_shows_every_weight_and_the_strict_point(axes):
    """Residuals and costs are the data, each weight is written at its point, and a residual of 0 has a place."""
    plots.tradeoff_curve(axes, [1e-3, 1e-1], [1e-4, 1e-2], [0.9, 0.4], strict=(0.0, 1.0))
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[1e-4, 0.9], [1e-2, 0.4]])
    np.testing.assert_allclose(axes.lines[1].get_xydata(), [[1e-16, 1.0]])
    assert [text.get_text() for text in axes.texts] == ["1e-3", "1e-1"]
    assert axes.get_xscale() == "log"
    assert "[" in axes.get_xlabel()
    assert "[rad²]" in axes.get_ylabel()


def test_joint_paths_are_shares_of_the_range(axes):
    """A joint at its lower limit is at 0, at its upper at 1; locked and unlimited joints stay finite."""
    lower, upper = np.array([-1.0, 0.2, -np.inf]), np.array([3.0, 0.2, np.inf])
    plots.joint_paths(axes, np.array([[-1.0, 0.2, 0.0], [3.0, 0.2, np.pi / 2]]), lower, upper, ["a", "b", "c"])
    drawn = [line.get_ydata() for line in axes.lines[:3]]
    np.testing.assert_allclose(drawn, [[0.0, 1.0], [0.0, 0.0], [0.5, 0.75]])
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["a", "b", "c"]
    assert axes.get_ylabel() == "joint, in its range [%]"


def test_no_two_of_many_lines_look_the_same():
    """Sixteen joints have sixteen pairs of colour and dashes."""
    assert len({str(plots._line(i)) for i in range(16)}) == 16


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
