"""The race for a person: tables in the terminal, and under which conditions they came about."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from maira_qp.evaluation.report import machine, percent, table_of, versions
from maira_qp.evaluation.targets import BEYOND, STEP
from peers.line_up import PEERS
from peers.ours import SOLVE
from peers.results import JUMP, TOLERANCES, Outcome, Row, Tick

WIDTH = 130
"""Columns of text that the tables need."""


def tables(outcome: Outcome) -> list[Table]:
    """The four tables of an arm; a table without rows is left out."""
    made = [_anywhere(outcome), _nearby(outcome), _ticks(outcome), _out_of_reach(outcome)]
    return [table for table in made if table.row_count]


def conditions(targets: int, rounds: int) -> str:
    """What the tables mean, and on what they were measured."""
    packages = [package.partition("[")[0] for _, package, _, _ in PEERS.values()]
    found = [f"{package} {own}" for package, own in versions("maira-qp", *packages).items() if own]
    return "\n".join(
        [
            f"solved: within {TOLERANCES[0]:g} m and {TOLERANCES[1]:g} rad, and inside the limits, says"
            " the judge (a walk over the URDF);",
            "  a peer's answer may be 1e-9 rad out of limits, ours not at all. false: claimed as solved, and is not.",
            f"near: {STEP:g} rad away, as a norm. out of reach: at {BEYOND:g} times the reach.",
            f"times: {targets} targets, the best of {rounds} rounds, one thread (but TRAC-IK two), called from Python;",
            "  peers get targets in their own types, converted before the clock starts, maira_qp gets arrays.",
            f"x ours: mean time over that of {SOLVE}. jumped: a joint moved by more than {JUMP:g} rad (maira_qp strict",
            "  means to, along the self-motion toward its posture).",
            machine(),
            *(", ".join(found[k : k + 5]) for k in range(0, len(found), 5)),
        ]
    )


def _anywhere(outcome: Outcome) -> Table:
    table = table_of(
        f"{outcome.arm}: {_count(outcome.anywhere)} random targets, random starts",
        ("solver", "settings"),
        ("solved", "false", "mean [us]", "median [us]", "p99 [us]", "x ours"),
    )
    ours = _ours(outcome.anywhere)
    for row in sorted(outcome.anywhere, key=lambda row: row.mean):
        spread = [_time(1e6 * t) for t in np.percentile(row.seconds, (50, 99))] if row.individual else ["-", "-"]
        cells = [row.settings, percent(row.solved.mean()), percent(row.false.mean()), _time(1e6 * row.mean), *spread]
        _add(table, row.name, *cells, _time(row.mean / ours))
    return table


def _nearby(outcome: Outcome) -> Table:
    table = table_of(
        f"{outcome.arm}: {_count(outcome.nearby)} targets near a given start",
        ("solver",),
        ("solved", "false", "jumped", "mean [us]", "median [us]", "x ours"),
    )
    ours = _ours(outcome.nearby)
    for row in sorted(outcome.nearby, key=lambda row: row.mean):
        shares = [percent(share.mean()) for share in (row.solved, row.false, row.jumped)]
        _add(table, row.name, *shares, *_times(row, 1e6), _time(row.mean / ours))
    return table


def _ticks(outcome: Outcome) -> Table:
    table = table_of(f"{outcome.arm}: one control tick", ("solver",), ("mean [us]", "out of limits", "x ours"))
    ours = next((tick.mean for tick in outcome.ticks if tick.name == SOLVE), np.nan)
    rows: Sequence[Tick] = sorted(outcome.ticks, key=lambda tick: tick.mean)
    for tick in rows:
        name = tick.name.replace(" solve", " step")
        _add(table, name, _time(1e6 * tick.mean), percent(tick.violations), _time(tick.mean / ours))
    return table


def _out_of_reach(outcome: Outcome) -> Table:
    table = table_of(
        f"{outcome.arm}: {_count(outcome.out_of_reach)} targets out of reach",
        ("solver",),
        ("false", "mean [ms]", "median [ms]"),
    )
    for row in sorted(outcome.out_of_reach, key=lambda row: float(np.median(row.seconds))):
        _add(table, row.name, percent(row.false.mean()), *_times(row, 1e3))
    return table


def _add(table: Table, name: str, *cells: str) -> None:
    table.add_row(name, *cells, style="bold" if name.startswith("maira_qp") else None)


def _times(row: Row, unit: float) -> list[str]:
    """Mean and median in units a second."""
    return [_time(unit * row.mean), _time(unit * float(np.median(row.seconds)))]


def _time(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.0f}" if value >= 100 else f"{value:#.3g}"


def _ours(rows: Sequence[Row]) -> float:
    return next((row.mean for row in rows if row.name == SOLVE), np.nan)


def _count(rows: Sequence[Row]) -> int:
    return len(rows[0].seconds) if rows else 0
