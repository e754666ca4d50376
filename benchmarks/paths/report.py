"""The race for a person: tables in the terminal, and under which conditions they came about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import shorten

import numpy as np
from rich.table import Table

from maira_qp.evaluation.report import digits, machine, percent, table_of, versions
from paths.judging import TIMES_THE_MOTION, Criterion
from paths.line_up import PEERS
from paths.motions import AT_LIMITS, Path
from paths.ours import TRACK
from paths.results import Row

WIDTH, LONGEST = 130, 80
"""Columns of text that the tables need; characters of what somebody raised."""


@dataclass(frozen=True)
class Length:
    """A long path, followed by `Solver.track` from a free start."""

    arm: str
    poses: int
    whole: bool
    seconds: float


def of_motions(arm: str, paths: Sequence[Path], free: Sequence[Row], true: Sequence[Row]) -> Table:
    """Rows from free and from true starts, in the same order; who follows most comes first, then the fastest."""
    table = table_of(
        f"{arm}: {len(paths)} paths of {len(paths[0].poses)} poses",
        ("method", "settings"),
        ("whole, free", "whole, true", "free [ms]", "true [ms]", "x ours"),
    )
    ours = next((row.median for row in free if row.name == TRACK), np.nan)
    pairs = zip(free, true, strict=True)
    for row, other in sorted(pairs, key=lambda pair: (-pair[0].whole - pair[1].whole, pair[0].median)):
        figures = [percent(row.whole), percent(other.whole), _milliseconds(row.median), _milliseconds(other.median)]
        _add(table, row.name, row.settings, *figures, digits(row.median / ours))
    return table


def of_files(arm: str, title: str, paths: Sequence[Path], rows: Sequence[Row]) -> Table:
    """Every path by itself: for each the methods, who follows it first, then the fastest."""
    table = table_of(
        f"{arm}: {title}", ("path", "method"), ("poses", "reached", "reconfigurations", "whole", "time [ms]")
    )
    for k, path in enumerate(paths):
        for row in sorted(rows, key=lambda row: (not row.verdicts[k].whole, row.seconds[k])):
            each = row.verdicts[k]
            figures = [str(len(path.poses)), str(each.reached), str(each.reconfigurations)]
            figures += ["yes" if each.whole else "no", _milliseconds(row.seconds[k])]
            _add(table, path.name, row.name, *figures, bold=row.name == TRACK)
        table.add_section()
    return table


def of_lengths(lengths: Sequence[Length]) -> Table:
    """Long paths in seconds."""
    table = table_of(f"{TRACK}, long paths", ("arm",), ("poses", "whole", "time [s]"))
    for each in lengths:
        table.add_row(each.arm, str(each.poses), "yes" if each.whole else "no", digits(each.seconds))
    return table


def errors(*rows: Row) -> list[str]:
    """A line of text about each that raised something: in how many runs, and the first of it."""
    raised: dict[str, list[str]] = {}
    for row in rows:
        raised.setdefault(row.name, []).extend(row.errors)
    return [
        f"{name}: {len(each)} runs raised, first {shorten(each[0], LONGEST)}" for name, each in raised.items() if each
    ]


def conditions(criterion: Criterion) -> str:
    """What the tables mean, and on what they were measured."""
    packages = dict.fromkeys(package.partition("[")[0] for _, package, _, _ in PEERS.values())
    found = [f"{package} {own}" for package, own in versions("maira-qp", *packages).items() if own]
    return "\n".join(
        [
            f"whole: every pose within {criterion.position:g} m and {criterion.orientation:g} rad, inside the limits,"
            f" and at most {criterion.reconfigurations}",
            f"  reconfigurations, which are steps of a joint over {criterion.step:g} rad,"
            " says the judge (a walk over the URDF);",
            "  a peer's answer may be 1e-9 rad out of limits, ours not at all.",
            "made paths: those of cubic Bezier curves between random configurations, every"
            f" {AT_LIMITS}th with control points at limits;",
            f"  a step over {TIMES_THE_MOTION:g} times the largest of that motion counts as well. free: from any start;"
            " true: from the motion's own.",
            f"times: medians of processor time, called from Python. x ours: that of a free start over {TRACK}'s.",
            machine(),
            ", ".join(found),
        ]
    )


def _add(table: Table, *cells: str, bold: bool | None = None) -> None:
    bold = cells[0].startswith("maira_qp") if bold is None else bold
    table.add_row(*cells, style="bold" if bold else None)


def _milliseconds(seconds: float) -> str:
    return digits(1e3 * seconds)
