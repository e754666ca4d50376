"""How a function is compiled is what its decorator says, and nothing that its name does."""

import numpy as np
import pytest
from numba import config

from maira_qp.kernels.jit.decorators import device_kernel, kernel


@device_kernel
def halved(x):
    return 0.5 * x


@device_kernel(allocates=True)
def row_of(count, x):
    row = np.empty(count)
    for i in range(count):
        row[i] = x
    return row


@kernel
def _plus_half(x):
    return x + halved(x)


@kernel(allocates=True)
def sum_of_row(count, x):
    total = 0.0
    for each in row_of(count, x):
        total += _plus_half(each)
    return total


def test_python_calls_kernels_and_these_call_each_other_and_those_of_the_device():
    assert _plus_half(2.0) == 3.0
    assert sum_of_row(4, 2.0) == 12.0
    assert [found.__name__ for found in (halved, _plus_half)] == ["halved", "_plus_half"]


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_only_kernels_are_kept_on_disk():
    assert _plus_half.stats.cache_path == sum_of_row.stats.cache_path is not None
    assert halved.stats.cache_path is row_of.stats.cache_path is None
