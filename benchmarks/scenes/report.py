"""The scenes for a person: a table each, the ratios, and under which conditions they came about."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from maira_qp.evaluation.contestant import Contestant
from maira_qp.evaluation.judge import Verdict
from maira_qp.evaluation.report import digits, machine, table_of, versions
from scenes.line_up import OURS
from scenes.problems import Scene
from scenes.race import Run

WIDTH = 150
"""Columns of text that the tables need."""
SLACK = 1e-9
"""By how much a limit may be exceeded [rad, rad/s]: q + v dt is rounded."""
PACKAGES = ("maira-qp", "pin-pink", "mink", "pin", "mujoco", "qpsolvers", "daqp")


def table(scene: Scene, contestants: Sequence[Contestant], runs: Sequence[Run], verdicts: Sequence[Verdict]) -> Table:
    """What came out of a scene, a row a library."""
    ticks = f"{len(scene.targets)} ticks of {1e3 * scene.dt:g} ms"
    names = ["mean [us]", "median [us]", "lines", "too fast", "outside"]
    names += [] if scene.looks else ["position off [mm]"]
    made = table_of(f"{scene.title}: {ticks}", ["library"], [*names, "angle off [mrad]", "travel [rad]"])
    for each, run, verdict in zip(contestants, runs, verdicts, strict=True):
        cells = [digits(1e6 * run.seconds.mean()), digits(1e6 * float(np.median(run.seconds))), f"{each.lines}"]
        cells += [_broken(verdict.speed_excess), _broken(verdict.limit_violation)]
        for errors in _errors(scene, verdict):
            cells.append("  ".join(f"{digits(1e3 * x):>7}" for x in scene.summary(errors)))
        cells.append(digits(run.travel))
        name = f"{each.name}, {run.failed} failed" if run.failed else each.name
        made.add_row(name, *cells, style="bold" if each.name == OURS else None)
    return made


def distances(scene: Scene, contestants: Sequence[Contestant], verdicts: Sequence[Verdict]) -> Table:
    """How near the links came to each other, and how many pairs each library looks at."""
    figures = ("nearest [mm]", "asked for [mm]", "pairs of shapes")
    made = table_of(f"{scene.title}: distances", ["library"], figures)
    for each, verdict in zip(contestants, verdicts, strict=True):
        assert each.pairs is not None
        cells = [f"{1e3 * verdict.distance:.4f}", f"{1e3 * scene.margin:g}", f"{each.pairs()}"]
        made.add_row(each.name, *cells, style="bold" if each.name == OURS else None)
    return made


def ratios(outcomes: Sequence[tuple[Scene, Sequence[Contestant], Sequence[Run], Sequence[Verdict]]]) -> Table:
    """How many times as long as ours each library takes for a tick, on average, a row a scene."""
    names = list(dict.fromkeys(each.name for _, contestants, _, _ in outcomes for each in contestants))
    made = table_of(f"mean time of a tick over that of {OURS}", ["scene"], names)
    for scene, contestants, runs, _ in outcomes:
        means = {each.name: run.seconds.mean() for each, run in zip(contestants, runs, strict=True)}
        cells = [digits(means[name] / means[OURS]) if name in means else "" for name in names]
        made.add_row(scene.title, *cells)
    return made


def markdown(outcomes: Sequence[tuple[Scene, Sequence[Contestant], Sequence[Run], Sequence[Verdict]]]) -> str:
    """The tables as one, for the page of the documentation."""
    lines = [
        "| scene | library | mean, median [us] | too fast | outside | off: mean, largest, end | nearest [mm] | lines |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scene, contestants, runs, verdicts in outcomes:
        for each, run, verdict in zip(contestants, runs, verdicts, strict=True):
            unit = "mrad" if scene.looks else "mm"
            off = ", ".join(digits(1e3 * x) for x in scene.summary(_errors(scene, verdict)[0]))
            times = f"{digits(1e6 * run.seconds.mean())}, {digits(1e6 * float(np.median(run.seconds)))}"
            limits = f"{_broken(verdict.speed_excess)} | {_broken(verdict.limit_violation)}"
            nearest = "" if scene.srdf is None else f"{1e3 * verdict.distance:.3f}"
            title = scene.title if each is contestants[0] else ""
            lines.append(f"| {title} | {each.name} | {times} | {limits} | {off} {unit} | {nearest} | {each.lines} |")
    return "\n".join(lines)


def between(text: str, mark: str, content: str) -> str:
    """A text with what stands between `<!-- mark -->` and `<!-- end -->` replaced. Raises `ValueError` without them."""
    begin = text.index(f"<!-- {mark} -->") + len(f"<!-- {mark} -->")
    end = text.index("<!-- end -->", begin)
    return f"{text[:begin]}\n\n{content}\n\n{text[end:]}"


def conditions(rounds: int) -> str:
    """What the tables mean, and on what they were measured."""
    found = ", ".join(f"{name} {own}" for name, own in versions(*PACKAGES).items() if own)
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
            "  how much at most; judged by a walk over the URDF on q before and after each tick, as are errors;"
            " distances by Pinocchio.",
            "off: mean and largest error while the target can be reached, and where it has stood still for long, or at"
            " the last tick;",
            "  of two hands the worse one. travel: of all joints together.",
            "nearest: the smallest distance of the links' convex hulls over all ticks.",
            "lines: code of the scene's function, without helpers that load models. look-at with Pink: a whole"
            " orientation, made by hand.",
            machine(),
            found,
        ]
    )


def _broken(excess: np.ndarray) -> str:
    """In how many ticks a limit is exceeded by excess (N,), and by how much at most."""
    ticks = int((excess > SLACK).sum())
    return f"{ticks} ({excess.max():.0e})" if ticks else "0"


def _errors(scene: Scene, verdict: Verdict) -> list[np.ndarray]:
    """Position [m], where the scene has one, and angle [rad] after each tick."""
    return [verdict.orientation_error] if scene.looks else [verdict.position_error, verdict.orientation_error]
