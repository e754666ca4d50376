"""The search without a start: the closed form where there is one, descents from the seed library where not."""

from __future__ import annotations

from threading import Event

import numpy as np

from maira_qp.kernels.kinematics.unwrap import unwind
from maira_qp.kernels.layout import Outcome
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.closed_form import find_in_closed_form
from maira_qp.solvers.compiled.multi_start import find_by_descents
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays


def find_anywhere(arrays: ProblemArrays, batch: Batch, q: np.ndarray, outcome: np.ndarray, halted: Event) -> None:
    """Search for q (N, n) that reach the targets, and certify those that cannot be reached.

    A joint whose range is a turn or more ends at the turn nearest to the posture of the redundancy.
    """
    if arrays.proofs.srs is not None:
        find_in_closed_form(arrays, batch, q, outcome, halted)
    else:
        find_by_descents(arrays, batch, q, outcome, halted)
    if arrays.turns is not None:
        unwind(arrays.chain, arrays.turns.aim[None], outcome[:, Outcome.SUCCESS], q)
