"""What came out for an arm: the judge's verdicts and the times, as the tables show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maira_qp.evaluation.contestant import Contestant
from maira_qp.evaluation.judge import Judge
from paths.judging import Criterion, Verdict, verdict
from paths.motions import Path
from paths.race import Run


@dataclass(frozen=True)
class Row:
    """One contestant along all paths, from starts of one kind."""

    name: str
    settings: str
    verdicts: list[Verdict]
    seconds: np.ndarray
    """(paths,)"""
    errors: list[str]
    """What it raised."""

    @property
    def whole(self) -> float:
        """Share of paths that it followed whole."""
        return float(np.mean([each.whole for each in self.verdicts]))

    @property
    def median(self) -> float:
        """Median time of a path [s]."""
        return float(np.median(self.seconds))


def judged(
    contestants: Sequence[Contestant],
    runs: Sequence[Sequence[Run]],
    paths: Sequence[Path],
    judge: Judge,
    criterion: Criterion,
) -> list[Row]:
    """Each contestant's runs as the judge sees them."""
    rows = []
    for contestant, along in zip(contestants, runs, strict=True):
        verdicts = [
            verdict(judge, path, run.q, criterion, run.start, contestant.slack)
            for path, run in zip(paths, along, strict=True)
        ]
        seconds = np.array([run.seconds for run in along])
        errors = [run.error for run in along if run.error]
        rows.append(Row(contestant.name, contestant.settings, verdicts, seconds, errors))
    return rows
