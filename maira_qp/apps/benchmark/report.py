"""A benchmark for a person: tables in the terminal, a picture, and its figures as rows for CSV and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from maira_qp.apps.benchmark.records import jsonable
from maira_qp.apps.benchmark.settings import Settings
from maira_qp.apps.benchmark.statistics import Summary
from maira_qp.solvers.options import Options

OUT_OF_REACH, NO_BACKEND = "out-of-reach", "-"


def tables(summaries: Sequence[Summary]) -> list[Table]:
    """One table a stratum, the methods in rows."""
    return [_table(stratum, group) for stratum, group in by_stratum(summaries).items()]


def legend(settings: Settings, options: Options) -> str:
    """What the tables count as solved."""
    return (
        f"solved: within {options.position_tolerance:g} m and {options.orientation_tolerance:g} rad, inside the limits"
        f"\nloosely: within {settings.loose_position:g} m and {settings.loose_orientation:g} rad, inside the limits"
    )


def by_stratum(summaries: Iterable[Summary]) -> dict[str, list[Summary]]:
    """The summaries of each stratum, in their order."""
    groups: dict[str, list[Summary]] = {}
    for summary in summaries:
        groups.setdefault(summary.stratum, []).append(summary)
    return groups


def _table(stratum: str, group: list[Summary]) -> Table:
    remark = ", no solution exists" if stratum == OUT_OF_REACH else ""
    table = Table(title=f"{stratum} ({group[0].count} targets{remark})", title_justify="left", title_style="bold")
    solved = ("said",) if stratum == OUT_OF_REACH else ("solved", "95 % interval", "loosely")
    table.add_column("method")
    table.add_column("QP by")
    for heading in (
        *solved,
        "false\nclaims",
        "out of\nlimits",
        "position error\nmedian / max [m]",
        "orientation error\nmedian / max [rad]",
        "iterations\nmedian / mean",
        "time [ms]\nmedian / mean / p99",
    ):
        table.add_column(heading, justify="right")
    for s in group:
        table.add_row(
            s.method,
            s.backend,
            *(_said(s) if stratum == OUT_OF_REACH else _solved(s)),
            str(s.false_claims),
            str(s.violations),
            f"{short(s.position_error[0])} / {short(s.position_error[1])}",
            f"{short(s.orientation_error[0])} / {short(s.orientation_error[1])}",
            f"{s.iterations[0]:.0f} / {s.iterations[1]:.1f}",
            " / ".join(f"{1e3 * seconds:#.3g}".rstrip(".") for seconds in s.time),
        )
    return table


def picture(summaries: Sequence[Summary], path: str | Path) -> None:
    """Strict success rates with their intervals, a block a stratum; that out of reach only if there is no other."""
    from maira_qp.apps import plots

    groups = by_stratum(summaries)
    shown = {stratum: group for stratum, group in groups.items() if stratum != OUT_OF_REACH} or groups
    backends = {s.backend for s in summaries} - {NO_BACKEND}
    counts = {
        stratum: {_name(s, len(backends) > 1): (s.strict, s.count) for s in group} for stratum, group in shown.items()
    }
    bars = sum(len(group) for group in counts.values())
    made = plots.figure(size=(8.0, 1.2 + 0.22 * bars))
    plots.success_bars(made.axes[0], counts)
    plots.save(made, path)


def _name(summary: Summary, with_backend: bool) -> str:
    return f"{summary.method}, {summary.backend}" if with_backend and summary.backend != NO_BACKEND else summary.method


def _solved(s: Summary) -> tuple[str, str, str]:
    return percent(s.rate), f"{100 * s.interval[0]:.1f} - {100 * s.interval[1]:.1f} %", percent(s.loose / s.count)


def _said(s: Summary) -> tuple[str]:
    return (", ".join(f"{count} {status.lower().replace('_', ' ')}" for status, count in s.statuses.items()),)


def percent(rate: float) -> str:
    """A rate from 0 to 1 in percent, never rounded to 100 or to 0 where it is neither."""
    text = f"{100 * rate:.1f}"
    if (text == "100.0" and rate < 1) or (text == "0.0" and rate > 0):
        text = f"{100 * rate:.4f}"
    return f"{text} %"


def short(value: float | None) -> str:
    """Two digits of an error; a dash where there is none."""
    return "-" if value is None else f"{value:.1e}" if math.isfinite(value) else "inf"


def flat(summary: Summary) -> dict[str, Any]:
    """A summary as one row of plain values for CSV and JSON: pairs and triples have a column each."""
    parts = {
        "interval": ("low", "high"),
        "position_error": ("median", "max"),
        "orientation_error": ("median", "max"),
        "iterations": ("median", "mean"),
        "time": ("median", "mean", "p99"),
    }
    row: dict[str, Any] = {}
    for key, value in asdict(summary).items():
        if key in parts:
            row |= {f"{key}_{part}": entry for part, entry in zip(parts[key], value, strict=True)}
        else:
            row[key] = value
    return jsonable(row)
