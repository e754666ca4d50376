"""Benchmarks for a person: tables in the terminal, figures as text and as rows for CSV and JSON."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rich.table import Table

from maira_qp.arrays import plain
from maira_qp.evaluation.settings import NO_BACKEND, OUT_OF_REACH, Settings
from maira_qp.evaluation.statistics import Summary
from maira_qp.problem.options import Options

WORDS = ("method", "QP by")
WIDE = 150
"""Columns of text that a table with every figure needs; below, it has the most important ones only."""


def tables(summaries: Sequence[Summary], width: int = WIDE) -> list[Table]:
    """One table a stratum, the methods in rows, for a console so many characters wide."""
    return [_table(stratum, group, width >= WIDE) for stratum, group in by_stratum(summaries).items()]


def table_of(title: str, words: Iterable[str], figures: Iterable[str], **looks: Any) -> Table:
    """An empty table: columns of words to the left, of figures to the right. Further arguments are those of `Table`."""
    table = Table(title=title or None, title_justify="left", title_style="bold", **looks)
    for heading in words:
        table.add_column(heading)
    for heading in figures:
        table.add_column(heading, justify="right")
    return table


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


def _table(stratum: str, group: list[Summary], wide: bool) -> Table:
    remark = ", no solution exists" if stratum == OUT_OF_REACH else ""
    several = len({s.backend for s in group} - {NO_BACKEND}) > 1
    rows = [_wide(s) if wide else _narrow(s, several) for s in group]
    dropped = {"said"} if stratum != OUT_OF_REACH else {"solved", "95 % interval", "loosely"}
    shown = [heading for heading in rows[0] if heading not in dropped]
    title = f"{stratum} ({group[0].count} targets{remark})"
    table = table_of(title, [word for word in shown if word in WORDS], [word for word in shown if word not in WORDS])
    for row in rows:
        table.add_row(*(row[heading] for heading in shown))
    return table


def _wide(s: Summary) -> dict[str, str]:
    """Every figure under its heading."""
    return {
        "method": s.method,
        "QP by": s.backend,
        "said": _said(s),
        "solved": percent(s.rate),
        "95 % interval": f"{100 * s.interval[0]:.1f} - {100 * s.interval[1]:.1f} %",
        "loosely": percent(s.loose / s.count),
        "false\nclaims": str(s.false_claims),
        "out of\nlimits": str(s.violations),
        "position error\nmedian / max [m]": f"{short(s.position_error[0])} / {short(s.position_error[1])}",
        "orientation error\nmedian / max [rad]": f"{short(s.orientation_error[0])} / {short(s.orientation_error[1])}",
        "iterations\nmedian / mean": f"{s.iterations[0]:.0f} / {s.iterations[1]:.1f}",
        "time [ms]\nmedian / mean / p99": " / ".join(f"{1e3 * seconds:#.3g}".rstrip(".") for seconds in s.time),
    }


def _narrow(s: Summary, several: bool) -> dict[str, str]:
    """The most important figures: medians."""
    return {
        "method": _name(s, several),
        "said": _said(s),
        "solved": percent(s.rate),
        "95 % interval": f"{100 * s.interval[0]:.0f} - {100 * s.interval[1]:.0f} %",
        "out of\nlimits": str(s.violations),
        "position\nerror [m]": short(s.position_error[0]),
        "steps": f"{s.iterations[0]:.0f}",
        "time\n[ms]": f"{1e3 * s.time[0]:#.3g}".rstrip("."),
    }


def _name(summary: Summary, with_backend: bool) -> str:
    return f"{summary.method}, {summary.backend}" if with_backend and summary.backend != NO_BACKEND else summary.method


def _said(s: Summary) -> str:
    return ", ".join(f"{count} {status.lower().replace('_', ' ')}" for status, count in s.statuses.items())


def percent(rate: float) -> str:
    """A rate from 0 to 1 in percent, never rounded to 100 or to 0 where it is neither."""
    text = f"{100 * rate:.1f}"
    if (text == "100.0" and rate < 1) or (text == "0.0" and rate > 0):
        text = f"{100 * rate:.4f}"
    return f"{text} %"


def short(value: float) -> str:
    """Two digits of an error."""
    return f"{value:.1e}" if math.isfinite(value) else "inf"


def digits(value: float) -> str:
    """Three digits; an exponent for what is very small."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    if abs(value) < 1e-3:
        return f"{value:.1e}"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def machine() -> str:
    """The processor, by the name that the system gives it, and the version of Python."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, Python {platform.python_version()}"


def versions(*packages: str) -> dict[str, str | None]:
    """The versions of the packages that are installed; None of one that is not."""
    found: dict[str, str | None] = {}
    for package in packages:
        try:
            found[package] = version(package)
        except (PackageNotFoundError, ValueError):  # or no name of a package
            found[package] = None
    return found


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
    return plain(row)
