"""What is said of a path, as text and as HTML."""

from __future__ import annotations

from html import escape

import numpy as np

from maira_qp.apps.viewer.paths.followed import Followed, PathView, Station
from maira_qp.apps.viewer.paths.route import Route
from maira_qp.apps.viewer.quantities import UNITS, angle, length
from maira_qp.wording import in_units

MOST_PARTS = 4
"""Parts of a path that are listed."""


def at_pose(station: Station) -> str:
    """How the arm that is drawn stands to the pose of the path that it is drawn at, by the answer it is drawn from."""
    path, k = station.path, station.index
    where = f"pose {k} of 0 to {len(path) - 1}: {_error(path, k)}"
    reasons = [in_units(failure.reason, UNITS) for failure in path.failures.get(k, ())]
    return "; ".join([where, *reasons, *_step(path, k)])


def given(route: Route) -> str:
    """What a path is made of."""
    if not len(route):
        return "no path yet: add poses, or take a circle or a file"
    count, closed = len(route.given), ", closed" if route.is_closed else ""
    kinds = {
        "corners": _counted(count, "corner"),
        "circle": f"circle of {1e3 * route.radius:.4g} mm radius",
        "file": route.file,
    }
    return f"{kinds[route.kind]}{closed}: {_poses(len(route))}"


def outcome(view: PathView) -> str:
    """How a path is followed, and if not whole, up to where and why."""
    if view.is_sought:
        return "being followed ..."
    if view.followed is None:
        return view.notice
    path = view.followed.solution
    took = f"{1e3 * view.followed.seconds:.0f} ms" if view.followed.seconds < 1 else f"{view.followed.seconds:.1f} s"
    if path:
        return f"Followed whole, in {took}."
    missed = int((~path.success).sum())
    counts = [f"{_poses(missed)} not reached"] if missed else []
    counts += [_counted(path.reconfigurations, "step") + " not along the path"] if path.reconfigurations else []
    parts = [f"{first} to {last - 1}" if last - first > 1 else f"{first}" for first, last in path.parts]
    more = f" and {len(parts) - MOST_PARTS} more parts" if len(parts) > MOST_PARTS else ""
    kept = f"followed: {', '.join(parts[:MOST_PARTS]) or 'nothing'}{more}"
    fails = f"Fails at pose {path.first_failure}: {in_units(path.reason, UNITS)}."
    return f"{fails} In all, {', '.join(counts)}; {kept}; in {took}."


def why(view: PathView) -> str:
    """What proves that it cannot be followed further, as far as that was looked for."""
    if view.is_explained:
        return "looking for a proof ..."
    if view.followed is None or view.followed.proof is None:
        return ""
    if not view.followed.proof:
        return "No proof was found: with another start, or another redundancy, it may be followed further."
    return f"Proved: {in_units(view.followed.proof, UNITS)}."


def html(view: PathView, good: str, bad: str, quiet: str) -> str:
    """All of it, in three colours."""
    is_whole = view.followed is not None and bool(view.followed.solution)
    colour = good if is_whole else quiet if view.is_sought else bad
    lines = (given(view.route), quiet), (outcome(view), colour), (why(view), quiet)
    items = "".join(f'<div style="color:{colour}">{escape(text)}</div>' for text, colour in lines if text)
    return f'<div style="padding:0 0.75em 0.75em;font-size:0.8em;line-height:1.4;overflow-wrap:anywhere">{items}</div>'


def _error(path: Followed, k: int) -> str:
    position, orientation = float(path.solution.position_error[k]), float(path.solution.orientation_error[k])
    reached = "reached" if path.solution.success[k] else "not reached"
    return f"{reached}, {length(position)} and {angle(orientation)} off"


def _step(path: Followed, k: int) -> list[str]:
    """The largest joint step to a pose."""
    if not k:
        return []
    solution = path.solution
    steps = np.abs(solution.q[k] - solution.q[k - 1])
    joint = int((steps / solution.allowed_step).argmax())
    size = f"{np.degrees(steps[joint]):.3g}°" if solution.q_units[joint] == "rad" else f"{1e3 * steps[joint]:.3g} mm"
    return [f"largest joint step {size} ({solution.joint_names[joint]})"]


def _poses(count: int) -> str:
    return _counted(count, "pose")


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
