"""The one rule of a status: for numbers and for arrays."""

from itertools import product

import numpy as np

import maira_qp as mq
from maira_qp.results.status import status_of, statuses_of

CASES = list(product([False, True], repeat=4))


def expected(reached: bool, breaks_limits: bool, proved: bool, stationary: bool) -> mq.Status:
    if reached:
        return mq.Status.CONVERGED
    if breaks_limits:
        return mq.Status.LIMITS_BROKEN
    if proved:
        return mq.Status.UNREACHABLE
    return mq.Status.NEAREST if stationary else mq.Status.BUDGET_SPENT


def test_what_is_reached_is_converged_and_a_proof_goes_before_a_nearest_point():
    names = ("reached", "breaks_limits", "proved", "stationary")
    assert [status_of(**dict(zip(names, case, strict=True))) for case in CASES] == [expected(*case) for case in CASES]
    columns = dict(zip(names, np.array(CASES).T, strict=True))
    assert statuses_of(**columns).tolist() == [int(expected(*case)) for case in CASES]


def test_statuses_have_the_names_of_optimisation_too():
    assert mq.Status.LOCAL_MINIMUM is mq.Status.NEAREST
    assert mq.Status.BUDGET_EXHAUSTED is mq.Status.BUDGET_SPENT
    assert [str(status) for status in mq.Status] == [status.name for status in mq.Status]
