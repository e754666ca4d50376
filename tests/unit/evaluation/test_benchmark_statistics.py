"""Wilson's interval against SciPy and against its definition; summaries against rows counted by hand."""

import io
import math

import pytest
from rich.console import Console
from scipy.stats import binomtest

from maira_qp.errors import OptionError
from maira_qp.evaluation.report import flat, percent, tables
from maira_qp.evaluation.settings import STRATA
from maira_qp.evaluation.statistics import Z_95, summarise, wilson_interval


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 1), (1, 1), (0, 50), (50, 50), (1, 7), (200, 300), (9999, 10000)]
)
def test_wilson_agrees_with_scipy(successes, trials):
    """Our formula and SciPy's give the same bounds."""
    theirs = binomtest(successes, trials).proportion_ci(confidence_level=0.95, method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_wilson_bounds_solve_the_defining_equation():
    """At a bound p the observed rate is exactly z standard deviations of p away."""
    for successes, trials in ((3, 10), (1, 1000), (700, 701)):
        for p in wilson_interval(successes, trials):
            assert abs(successes / trials - p) == pytest.approx(Z_95 * math.sqrt(p * (1 - p) / trials), rel=1e-9)


def test_wilson_at_the_ends():
    """All or none leave a bound at exactly 1 or 0 and the other inside; no trials leave everything open."""
    assert wilson_interval(0, 10)[0] == 0 < wilson_interval(0, 10)[1] < 1
    assert 0 < wilson_interval(10, 10)[0] < wilson_interval(10, 10)[1] == 1
    assert wilson_interval(0, 0) == (0.0, 1.0)
    for successes, trials in ((-1, 5), (6, 5)):
        with pytest.raises(OptionError, match="successes"):
            wilson_interval(successes, trials)


def row(**changes):
    """A row of a solved target, with changes."""
    return {
        "stratum": "uniform",
        "index": 0,
        "method": "strict",
        "backend": "daqp",
        "reachable": True,
        "claimed": True,
        "confirmed": True,
        "strict": True,
        "loose": True,
        "status": "CONVERGED",
        "position_error": 1e-9,
        "orientation_error": 2e-9,
        "limit_violation": 0.0,
        "iterations": 10,
        "restarts": 0,
        "condition_number": 5.0,
        "posture_cost": 2.0,
        "time": 0.001,
        "q": [0.0],
    } | changes


def test_summary_counts():
    """Four rows of one group and one of another, counted by hand."""
    rows = [
        row(),
        row(strict=False, confirmed=False, iterations=30, time=0.003, posture_cost=4.0),
        row(strict=False, loose=False, claimed=False, confirmed=False, limit_violation=0.5, posture_cost=100.0),
        row(strict=False, loose=False, claimed=False, confirmed=False, position_error=None, limit_violation=None),
        row(method="pose"),
    ]
    first, second = summarise(rows)
    assert (first.method, first.count, first.strict, first.loose) == ("strict", 4, 1, 2)
    assert (first.false_claims, first.violations) == (1, 2)
    assert first.statuses == {"CONVERGED": 4}
    assert first.worst_violation == math.inf
    assert first.position_error == (1e-9, math.inf)
    assert first.posture_cost == 3.0  # what is not at the target has no posture worth counting
    assert first.iterations == (10, 15)
    assert first.time[1] == pytest.approx(0.0015)
    assert first.rate == 0.25
    assert (second.method, second.count, second.rate) == ("pose", 1, 1.0)


def test_no_posture_cost_where_nothing_was_reached():
    """A method that reaches nothing has no mean posture cost, and the tables still print."""
    summaries = summarise([row(strict=False, loose=False)])
    assert summaries[0].posture_cost is None
    assert len(tables(summaries)) == 1
    assert flat(summaries[0])["posture_cost"] is None


def test_percent_does_not_round_a_failure_away():
    """One failure in ten thousand is not 100 %, one success is not 0 %."""
    assert percent(1.0) == "100.0 %"
    assert percent(0.9999) == "99.9900 %"
    assert percent(0.0001) == "0.0100 %"
    assert percent(0.0) == "0.0 %"


def test_tables_fit_the_terminal():
    """In 80 columns the tables keep their figures whole, with several backends too; a wide one tells every figure."""
    rows = [row(stratum=s, method=m, backend=b) for s in STRATA for m in ("pose", "strict") for b in ("daqp", "proxqp")]
    for width, wanted in ((80, "1.0e-09"), (160, "1.0e-09 / 1.0e-09")):
        console = Console(width=width, file=io.StringIO(), record=True)
        for table in tables(summarise(rows), width):
            console.print(table)
        text = console.export_text()
        assert text.count(wanted) >= 4 * len(STRATA)
        assert "\u2026" not in text  # nothing is cut
        assert text.count("1 converged") == 4  # out of reach: what was said, no success rate
