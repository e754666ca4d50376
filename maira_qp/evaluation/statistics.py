"""What the rows of a benchmark say together: success with its interval, errors, times, iterations, limits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.errors import OptionError

Z_95 = 1.959963984540054
"""The 97.5 % point of the normal distribution: 2.5 % lie beyond it on either side."""


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> tuple[float, float]:
    """Bounds of a success rate, 95 % sure: the rates p whose own spread would not make the count seen surprising.

    They solve (s / n - p)^2 = z^2 p (1 - p) / n. With no trials nothing is known: (0, 1).
    Source: Wilson, "Probable inference, the law of succession, and statistical inference", 1927.
    """
    if not 0 <= successes <= trials:
        raise OptionError(f"successes must be between 0 and the {trials} trials, got {successes}")
    if trials == 0:
        return (0.0, 1.0)
    rate, ratio = successes / trials, z * z / trials
    centre = rate + ratio / 2
    spread = math.sqrt(ratio * (rate * (1 - rate) + ratio / 4))
    low = 0.0 if successes == 0 else (centre - spread) / (1 + ratio)
    high = 1.0 if successes == trials else (centre + spread) / (1 + ratio)
    return (low, high)


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One method with one backend on one stratum. Where a row says null, the value was infinite."""

    stratum: str
    """Which targets."""
    method: str
    """Which method."""
    backend: str
    """Which QP backend; "-" for a method that solves none."""
    count: int
    """How many targets."""
    strict: int
    """Targets reached to the strict tolerance, inside the limits, says the judge."""
    loose: int
    """Targets reached to the loose tolerance, inside the limits, says the judge."""
    interval: tuple[float, float]
    """Wilson's 95 % interval of the strict success rate."""
    false_claims: int
    """Answers that claimed success, and the judge disagrees: the pose is off, or a joint outside of its limits."""
    statuses: dict[str, int]
    """How many answers ended in each status, in the method's own words, the most frequent first."""
    violations: int
    """Answers with a joint outside of its limits."""
    worst_violation: float
    """The worst of them [rad or m]."""
    position_error: tuple[float, float]
    """Median and maximum [m]."""
    orientation_error: tuple[float, float]
    """Median and maximum [rad]."""
    posture_cost: float | None
    """Mean over the answers that reach the target to the loose tolerance: 1/2 |q - middle|^2 [rad^2 or m^2]."""
    iterations: tuple[float, float]
    """Median and mean."""
    restarts: float
    """Mean."""
    condition_number: float
    """Median."""
    time: tuple[float, float, float]
    """Median, mean and 99th percentile of a solve [s]."""

    @property
    def rate(self) -> float:
        """Strict success rate, 0 to 1."""
        return self.strict / self.count


def summarise(rows: Iterable[Mapping[str, Any]]) -> list[Summary]:
    """One `Summary` a stratum, method and backend, in the order in which the rows first name them."""
    groups: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["stratum"], row["method"], row["backend"]), []).append(row)
    return [_summary(*key, group) for key, group in groups.items()]


def _summary(stratum: str, method: str, backend: str, rows: list[Mapping[str, Any]]) -> Summary:
    def measured(key: str) -> np.ndarray:
        return np.array([math.inf if row[key] is None else row[key] for row in rows], dtype=float)

    strict = sum(row["strict"] for row in rows)
    time, iterations = measured("time"), measured("iterations")
    costs = [row["posture_cost"] for row in rows if row["loose"]]
    return Summary(
        stratum=stratum,
        method=method,
        backend=backend,
        count=len(rows),
        strict=strict,
        loose=sum(row["loose"] for row in rows),
        interval=wilson_interval(strict, len(rows)),
        false_claims=sum(row["claimed"] and not row["confirmed"] for row in rows),
        statuses=dict(Counter(row["status"] for row in rows).most_common()),
        violations=sum(row["limit_violation"] != 0 for row in rows),
        worst_violation=float(measured("limit_violation").max()),
        position_error=_median_and_max(measured("position_error")),
        orientation_error=_median_and_max(measured("orientation_error")),
        posture_cost=float(np.mean(costs)) if costs else None,
        iterations=(_median(iterations), float(iterations.mean())),
        restarts=float(measured("restarts").mean()),
        condition_number=_median(measured("condition_number")),
        time=(_median(time), float(time.mean()), float(np.quantile(time, 0.99))),
    )


def _median(values: np.ndarray) -> float:
    """The middle value; the upper one of two, so that infinities do not meet."""
    return float(np.sort(values)[len(values) // 2])


def _median_and_max(values: np.ndarray) -> tuple[float, float]:
    return (_median(values), float(values.max()))
