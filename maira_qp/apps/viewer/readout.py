"""The numbers and words beside the arm, as HTML. Names come from files: all of them are escaped."""

from __future__ import annotations

from html import escape

from maira_qp.apps.viewer.answers import Verdict
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.surroundings import MARGIN
from maira_qp.apps.viewer.view import View
from maira_qp.solvers.solution import Solution, Status

GOOD, POOR, BAD, QUIET = "#1a7f4b", "#b26a00", "#c92a2a", "#868e96"
_COLOURS = {Status.CONVERGED: GOOD, Status.NEAREST: POOR, Status.BUDGET_SPENT: POOR, Status.UNREACHABLE: BAD}


def readout(view: View) -> str:
    """The verdict with its reason, and the state of the arm in a table."""
    verdict = view.verdict
    rows = [
        ("position error", length(view.position_error)),
        ("orientation error", f"{view.orientation_error:.2e} rad"),
        ("condition number", f"{view.condition_number:.3g}"),
        ("active limits", _listed(view.at_limit)),
        ("time", _times(view)),
    ]
    cells = "".join(
        f'<tr><td style="color:{QUIET};padding-right:1em">{name}</td><td>{cell}</td></tr>' for name, cell in rows
    )
    table = f'<table style="font-size:0.8em;line-height:1.5;font-variant-numeric:tabular-nums">{cells}</table>'
    return f'<div style="padding:0 0.75em 0.75em">{_headline(verdict)}{table}</div>'


def reason(solution: Solution) -> str:
    """What became of the target and why, for a person."""
    return solution.status.meaning


def length(metres: float) -> str:
    """A length as it is best read."""
    return f"{metres:.2e} m" if metres < 1e-4 else f"{1e3 * metres:.1f} mm" if metres < 1 else f"{metres:.2f} m"


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
    """How many solutions are shown, or why none are."""
    if not session.shows_ghosts:
        return ""
    if view.ghosts is None:
        text = "looking for all solutions ..."
    elif view.ghosts.note:
        text = view.ghosts.note
    else:
        text = f"{view.ghosts.count} arcs of solutions, {len(view.ghosts.q)} that differ are shown"
    return f'<div style="padding:0 0.75em;font-size:0.8em;color:{QUIET}">{escape(text)}</div>'


def notes(lines: list[str]) -> str:
    """What could not be drawn, the first few lines of it."""
    shown = [*lines[:4], *([f"and {len(lines) - 4} more"] if len(lines) > 4 else [])]
    items = "".join(f"<p>{escape(line[:300])}</p>" for line in shown)
    return f'<div style="padding:0 0.75em;font-size:0.75em;color:{POOR};overflow-wrap:anywhere">{items}</div>'


def _headline(verdict: Verdict | None) -> str:
    if verdict is None:
        return f'<p style="color:{QUIET};margin:0 0 0.4em">...</p>'
    status, colour = verdict.solution.status, _COLOURS[verdict.solution.status]
    badge = f'<b style="color:{colour}">{status.name.replace("_", " ")}</b>'
    return (
        f'<p style="margin:0 0 0.4em;line-height:1.3">{badge}<br/><small>{escape(reason(verdict.solution))}</small></p>'
    )


def _listed(names: list[str]) -> str:
    if not names:
        return "none"
    return f'<span style="color:{BAD}">{escape(", ".join(names))}</span>'


def _times(view: View) -> str:
    tick = f"tick {1e6 * view.tick_seconds:.0f} µs" if view.tick_seconds else ""
    solve = "" if view.verdict is None else f"solve {1e3 * view.verdict.seconds:.2f} ms"
    return ", ".join(part for part in (tick, solve) if part) or "-"
