"""The scenes for a person: a table each, the ratios, and under which conditions they came about."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from rich.table import Table

from scenes.judge import SLACK, Verdict
from scenes.players import OURS, Player
from scenes.problems import Scene
from scenes.race import Run

WIDTH = 150
"""Columns of text that the tables need."""
PACKAGES = ("maira-qp", "pin-pink", "mink", "pin", "mujoco", "qpsolvers", "daqp")


def table(scene: Scene, players: Sequence[Player], runs: Sequence[Run], verdicts: Sequence[Verdict]) -> Table:
    """What came out of a scene, a row a library."""
    ticks = f"{len(scene.targets)} ticks of {1e3 * scene.dt:g} ms"
    made = Table(title=f"{scene.title}: {ticks}", title_justify="left", title_style="bold")
    made.add_column("library", no_wrap=True)
    names = ["mean [us]", "median [us]", "lines", "too fast", "outside"]
    names += [] if scene.looks else ["position off [mm]"]
    names += ["angle off [mrad]", "travel [rad]"]
    for name in names:
        made.add_column(name, justify="right", no_wrap=True)
    for player, run, verdict in zip(players, runs, verdicts, strict=True):
        cells = [digits(1e6 * run.seconds.mean()), digits(1e6 * float(np.median(run.seconds))), f"{player.lines}"]
        cells += [_broken(verdict.too_fast, verdict.excess), _broken(verdict.outside, verdict.beyond)]
        for kind in (1,) if scene.looks else (0, 1):
            cells.append("  ".join(f"{digits(1e3 * x):>7}" for x in verdict.summary(kind)))
        cells.append(digits(verdict.travel))
        name = f"{player.name}, {verdict.failed} failed" if verdict.failed else player.name
        made.add_row(name, *cells, style="bold" if player.name == OURS else None)
    return made


def distances(scene: Scene, players: Sequence[Player], verdicts: Sequence[Verdict]) -> Table:
    """How near the links came to each other, and how many pairs each library looks at."""
    made = Table(title=f"{scene.title}: distances", title_justify="left", title_style="bold")
    made.add_column("library", no_wrap=True)
    for name in ("nearest [mm]", "asked for [mm]", "pairs of shapes"):
        made.add_column(name, justify="right", no_wrap=True)
    for player, verdict in zip(players, verdicts, strict=True):
        cells = [f"{1e3 * verdict.distance:.4f}", f"{1e3 * scene.margin:g}", f"{player.pairs(scene)}"]
        made.add_row(player.name, *cells, style="bold" if player.name == OURS else None)
    return made


def ratios(outcomes: Sequence[tuple[Scene, Sequence[Player], Sequence[Run], Sequence[Verdict]]]) -> Table:
    """How many times as long as ours each library takes for a tick, on average, a row a scene."""
    names = list(dict.fromkeys(player.name for _, players, _, _ in outcomes for player in players))
    made = Table(title=f"mean time of a tick over that of {OURS}", title_justify="left", title_style="bold")
    made.add_column("scene", no_wrap=True)
    for name in names:
        made.add_column(name, justify="right", no_wrap=True)
    for scene, players, runs, _ in outcomes:
        means = {player.name: run.seconds.mean() for player, run in zip(players, runs, strict=True)}
        cells = [digits(means[name] / means[OURS]) if name in means else "" for name in names]
        made.add_row(scene.title, *cells)
    return made


def markdown(outcomes: Sequence[tuple[Scene, Sequence[Player], Sequence[Run], Sequence[Verdict]]]) -> str:
    """The tables as one, for the page of the documentation."""
    lines = [
        "| scene | library | mean, median [us] | too fast | outside | off: mean, largest, end | nearest [mm] | lines |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scene, players, runs, verdicts in outcomes:
        for player, run, verdict in zip(players, runs, verdicts, strict=True):
            unit = "mrad" if scene.looks else "mm"
            off = ", ".join(digits(1e3 * x) for x in verdict.summary(1 if scene.looks else 0))
            times = f"{digits(1e6 * run.seconds.mean())}, {digits(1e6 * float(np.median(run.seconds)))}"
            limits = f"{_broken(verdict.too_fast, verdict.excess)} | {_broken(verdict.outside, verdict.beyond)}"
            nearest = "" if scene.srdf is None else f"{1e3 * verdict.distance:.3f}"
            title = scene.title if player is players[0] else ""
            lines.append(
                f"| {title} | {player.name} | {times} | {limits} | {off} {unit} | {nearest} | {player.lines} |"
            )
    return "\n".join(lines)


def between(text: str, mark: str, content: str) -> str:
    """A text with what stands between `<!-- mark -->` and `<!-- end -->` replaced. Raises `ValueError` without them."""
    begin = text.index(f"<!-- {mark} -->") + len(f"<!-- {mark} -->")
    end = text.index("<!-- end -->", begin)
    return f"{text[:begin]}\n\n{content}\n\n{text[end:]}"


def conditions(rounds: int) -> str:
    """What the tables mean, and on what they were measured."""
    versions = ", ".join(f"{name} {version_of(name)}" for name in PACKAGES if version_of(name))
    return "\n".join(
        [
            f"times: a tick called from Python, one thread, the best of the same tick in {rounds} rounds in turns; Pink"
            " and Mink with daqp;",
            "  each library updates its own model in it. Targets are in its own type before the clock starts"
            " (maira_qp: arrays).",
            "maira_qp: the posture below the other tasks (Strict). weighted: posture beside the pose, as Pink and Mink."
            " daqp: backend='daqp'.",
            f"too fast, outside: ticks in which a joint exceeds its limits of speed and position by more than {SLACK:g}"
            " rad/s or rad, and by",
            "  how much at most; judged by Pinocchio on q before and after each tick, as are errors and distances.",
            "off: mean and largest error while the target can be reached, and where it has stood still for long, or at"
            " the last tick;",
            "  of two hands the worse one. travel: of all joints together.",
            "nearest: the smallest distance of the links' convex hulls over all ticks.",
            "lines: code of the scene's function, without helpers that load models. look-at with Pink: a whole"
            " orientation, made by hand.",
            f"{_processor()}, Python {platform.python_version()}",
            versions,
        ]
    )


def digits(value: float) -> str:
    """Three digits; an exponent for what is very small."""
    if value == 0 or not np.isfinite(value):
        return f"{value:g}"
    if abs(value) < 1e-3:
        return f"{value:.1e}"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def version_of(package: str) -> str:
    """The version that is installed, or nothing."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _broken(ticks: int, by: float) -> str:
    return f"{ticks} ({by:.0e})" if ticks else "0"


def _processor() -> str:
    """The processor's name, where the system tells it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
