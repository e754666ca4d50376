"""The numbers and words beside the arm, as HTML. Names come from files: all of them are escaped."""

from __future__ import annotations

from html import escape

import numpy as np

from maira_qp.apps.viewer.answers import Verdict
from maira_qp.apps.viewer.drawing.ghosts import ghost_colour
from maira_qp.apps.viewer.drawing.surroundings import MARGIN, Clearance, Overlap
from maira_qp.apps.viewer.motion.elbow import Elbow
from maira_qp.apps.viewer.motion.recording import Recording
from maira_qp.apps.viewer.paths import words
from maira_qp.apps.viewer.quantities import UNITS, angle, length
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import Standing, View, limits_at
from maira_qp.results.status import Status
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.analysis.explanation import Explanation
from maira_qp.wording import figures, in_units

GOOD, POOR, BAD, QUIET = "#1a7f4b", "#b26a00", "#c92a2a", "#5c6670"
SINGULAR = 1e6
"""A condition number from here on is that of a singular arm."""
_COLOURS_OF_STANDING = {
    Standing.UNKNOWN: QUIET,
    Standing.REACHED: GOOD,
    Standing.TOO_NEAR: BAD,
    Standing.MOVING: QUIET,
    Standing.HELD_UP: POOR,
    Standing.ANSWERED: POOR,
    Standing.ON_PATH: GOOD,
    Standing.OFF_PATH: BAD,
}


def readout(view: View) -> str:
    """The verdict with its reason, and the state of the arm in a table."""
    rows = [
        ("position error", length(view.position_error)),
        ("orientation error", angle(view.orientation_error)),
        ("condition number", _condition(view.condition_number)),
        ("joints at a limit", _listed(view.at_limit)),
        ("self-collision", _listed([_overlap(one) for one in view.overlaps[:1]]) + _more(len(view.overlaps) - 1)),
        ("computed in", _times(view)),
    ]
    cells = "".join(
        f'<tr style="vertical-align:top"><td style="color:{QUIET};padding-right:1em;white-space:nowrap">{name}</td>'
        f"<td>{cell}</td></tr>"
        for name, cell in rows
    )
    table = f'<table style="font-size:0.8em;line-height:1.5;font-variant-numeric:tabular-nums">{cells}</table>'
    return f'<div style="padding:0 0.75em 0.75em">{_headline(view)}{table}</div>'


def reason(verdict: Verdict) -> str:
    """What became of the target and why, for a person: in a sentence or two, the errors stand below."""
    why = verdict.reason
    if why is None:
        return verdict.solution.status.meaning
    if why.is_compromise:
        return "the pose can be reached, but the weight of the posture holds the tool off it"
    if why.broken:
        return in_units(why.words, UNITS)
    what = why.status.meaning if why.proof is None else f"proved out of reach: {in_units(why.proof.words, UNITS)}"
    return f"{what}. {_limits(why)}"


def distances(view: View) -> str:
    """How far the arm is from each obstacle."""
    if view.notice:
        return f'<div style="padding:0 0.75em;font-size:0.8em;color:{BAD}">{escape(view.notice)}</div>'
    rows = "".join(
        f'<tr><td style="padding-right:1em">{escape(one.obstacle)} - {escape(one.link)}</td>'
        f'<td style="color:{BAD if one.distance < MARGIN else GOOD}">{1e3 * one.distance:.0f} mm</td></tr>'
        for one in view.clearances
    )
    return f'<table style="margin:0 0.75em;font-size:0.8em;font-variant-numeric:tabular-nums">{rows}</table>'


def solutions(session: Session, view: View) -> str:
    """The solutions that are shown, with their colours and costs, how they were found, or why there are none."""
    if not session.shows_ghosts:
        return ""
    ghosts = view.ghosts
    if ghosts is None:
        return _line("looking for all solutions ...")
    if not ghosts.found:
        return _line(ghosts.note)
    found, shown = ghosts.found, len(ghosts.shown)
    what = "arcs of solutions" if found[0].arc is not None else "solutions"
    alike = "" if shown == len(found) else f", {shown} that differ are shown"
    complete = "complete" if found.is_complete else "maybe not all"
    head = _line(f"{len(found)} {what}{alike}; {found.method}, {complete}")
    rows = "".join(
        f'<tr><td><span style="display:inline-block;width:0.8em;height:0.8em;border-radius:50%;'
        f'background:rgb{ghost_colour(rank)}"></span></td>'
        f'<td style="padding:0 1em 0 0.4em">{escape(name)}</td><td>cost {figures(one.cost)}</td></tr>'
        for name, rank, one in zip(ghosts.names, ghosts.ranks.tolist(), ghosts.shown, strict=True)
    )
    return f'{head}<table style="margin:0.3em 0.75em;font-size:0.8em;font-variant-numeric:tabular-nums">{rows}</table>'


def ends(robot: Robot, elbow: Elbow | None) -> str:
    """What ends the way of the elbow to either side."""
    if elbow is None:
        return _line("\u00a0")  # its line is kept, so that nothing below it jumps
    curve = elbow.curve
    places = curve.lower, curve.upper, 0.5 * (curve.lower + curve.upper)
    lower, upper, all_along = (limits_at(robot, curve.at(np.array(place))) for place in places)
    sides = [", ".join(name for name in names if name not in all_along) for names in (lower, upper)]
    return _line(f"ends at {' and '.join(sides)}" if all(sides) else "\u00a0")


def path(view: View) -> str:
    """What the path is, how it is followed, and why no further."""
    return words.html(view.path, GOOD, BAD, QUIET)


def recording(recording: Recording) -> str:
    """How long a recording is."""
    rows, seconds = len(recording), recording.duration
    return _line(f"{seconds:.1f} s, {rows} configurations" if rows else "nothing is recorded yet")


def robot(robot: Robot, source: str) -> str:
    """Which robot is loaded."""
    base = f"{robot.n} joints from {robot.base} to {', '.join(robot.tips)}"
    words = base if source == robot.name else f"{source}: {base}"
    return f'<div style="padding:0 0.75em"><b>{escape(robot.name)}</b></div>{_line(words)}'


def notes(lines: list[str]) -> str:
    """What could not be drawn, the first few lines of it."""
    shown = [*lines[:4], *([f"and {len(lines) - 4} more"] if len(lines) > 4 else [])]
    items = "".join(f"<p>{escape(line[:300])}</p>" for line in shown)
    return f'<div style="padding:0 0.75em;font-size:0.75em;color:{POOR};overflow-wrap:anywhere">{items}</div>'


def _line(text: str) -> str:
    return f'<div style="padding:0 0.75em;font-size:0.8em;color:{QUIET};overflow-wrap:anywhere">{escape(text)}</div>'


def _headline(view: View) -> str:
    """How the arm that is drawn stands to its target, in a word or two and a sentence."""
    verdict, standing = view.verdict, view.standing
    name, colour, full = standing.value, _COLOURS_OF_STANDING[standing], ""
    if standing is Standing.ANSWERED:
        status = verdict.solution.status
        name, colour = (
            status.name.replace("_", " "),
            BAD if status in (Status.UNREACHABLE, Status.LIMITS_BROKEN) else POOR,
        )
        full = "" if verdict.reason is None else escape(in_units(verdict.reason.words, UNITS))
    colour = BAD if view.overlaps else colour
    badge = f'<b style="color:{colour}">{name}</b>'
    words = f'<small style="overflow-wrap:anywhere" title="{full}">{escape(sentence(view))}</small>'
    return f'<p style="margin:0 0 0.4em;line-height:1.3;min-height:3.9em">{badge}<br/>{words}</p>'


def sentence(view: View) -> str:
    """How the arm that is drawn stands to its target, for a person."""
    standing, blocking = view.standing, "" if view.in_the_way is None else f": {_pair(view.in_the_way)} is in the way"
    pose = "" if view.path.station is None else words.at_pose(view.path.station)
    if standing is Standing.TOO_NEAR:
        near = "; ".join(f"{_pair(one)} {_apart(one.distance)}" for one in view.too_near)
        return "; ".join(filter(None, [f"{near}, where {1e3 * MARGIN:.0f} mm are to be kept", pose]))
    if pose:
        return pose
    there = "the tool is at the target" if len(view.verdict.targets) == 1 else "all tools are at their targets"
    if standing is Standing.REACHED and view.overlaps:
        one = view.overlaps[0]
        return f"{there}, but {one.first} and {one.second} are in each other"
    if standing is Standing.REACHED:
        return f"{there} within the tolerances"
    if standing is Standing.HELD_UP:
        return f"the arm comes no nearer from here, though a better configuration is known{blocking}"
    if standing is Standing.MOVING:
        return "the target can be reached, the arm is on its way"
    return "..." if standing is Standing.UNKNOWN else reason(view.verdict)


def _pair(one: Clearance) -> str:
    return f"{one.link} - {one.obstacle}"


def _apart(distance: float) -> str:
    return f"are {1e3 * distance:.0f} mm apart" if distance > 0 else f"overlap by {-1e3 * distance:.0f} mm"


def _limits(why: Explanation) -> str:
    """What the limits of the joints have to do with it."""
    alone = [(limit.further, limit) for limit in why.limits if limit.further is not None]
    if alone:
        further, least = min(alone, key=lambda pair: pair[0])
        joint, end = least.name.rsplit(" ", 1)
        amount = length(further) if least.unit == "m" else angle(further)
        return f"With {joint} {amount} beyond its {end} limit it would be reached."
    names = ", ".join(why.blocking)
    if not names:
        return "No joint limit holds the arm back."
    return f"{names}: without these limits it would {'' if why.is_reached_without else 'not '}be reached."


def _listed(names: list[str]) -> str:
    if not names:
        return "none"
    return f'<span style="color:{BAD}">{escape(", ".join(names))}</span>'


def _overlap(one: Overlap) -> str:
    return f"{one.first} and {one.second}, {length(one.depth)} deep"


def _more(count: int) -> str:
    return f", and {count} more" if count > 0 else ""


def _condition(number: float) -> str:
    return f"{number:.3g}" if number < SINGULAR else "singular"


def _times(view: View) -> str:
    if view.path.station is not None:
        return f"path {1e3 * view.path.station.path.seconds:.0f} ms"
    tick = f"tick {1e6 * view.tick_seconds:.0f} µs" if view.tick_seconds else ""
    solve = f"solve {1e3 * view.verdict.seconds:.2f} ms"
    return ", ".join(part for part in (tick, solve) if part) or "-"
