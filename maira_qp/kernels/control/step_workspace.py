"""The arrays that a tick works in, parts of two that whoever calls it made: that costs less than to make each."""

from __future__ import annotations

from collections import namedtuple

from maira_qp.kernels.jit.decorators import inner_kernel

TickWork = namedtuple(
    "TickWork",
    (
        *("poses", "tools", "targets"),  # (12,) each: of joints, of up to three frames a task, and of tasks
        *("e", "pull", "off", "levers", "J"),  # six numbers each: by task; others; (3, 6, 6); by task the Jacobian
        *("inverse", "S"),  # (3, 3) of a rotation vector
        *("H", "C", "A", "V", "Z", "M"),  # (n, n) each: by level, and others
        *("c", "displacements", "rows", "row_memory"),  # lines of n: by level, by level, by row of a task, of a QP
        *("lower", "upper", "low", "high", "dq", "step", "part", "trial", "g", "y", "z", "b"),  # (n,)
        *("F", "tau", "x", "multipliers"),  # of factored rows
        *("mu", "values", "trial_values", "highest"),  # by level
        *("paths", "row_index"),  # lines of n, of int64: the joints that carry a task; of a QP
        *("free", "side", "held", "locked", "joints"),  # (n,) of int64
        *("gram", "factor"),  # (m, m) of the rows of all levels
        *("balances", "errors", "errors_there", "left", "weights"),  # lines of m: by level, and others
        *(
            "near_poses",
            "near_tools",
            "near_rows",
            "near_J",
        ),  # (n, 12), (3, 12), (6, n), (n, 6) near q
        *("kept", "saddle", "gradients", "left_norms", "flat", "still"),  # (T, 2) of errors by task; by level
        *("order", "counts", "ends"),  # of int64: of factored rows; how long a task's path is; where a level's rows end
    ),
)
"""A kernel takes what it needs into local names first: it is slow to ask for a field in a loop."""


def memory_sizes(n, tasks, rows, levels):
    """How many numbers, and how many of int64, the work of a tick needs; `rows` of all tasks together."""
    most = max(rows, n)
    lines = 2 * levels + rows + 4 * n + 4 + 12
    floats = 12 * (n + 4 * tasks) + 6 * (tasks + 20 + tasks * n) + 18 + (levels + 5) * n * n + lines * n
    floats += (most + 3) * (most + n) + 9 * levels
    floats += 2 * rows * rows + (levels + 4) * rows + 24 * n + 36 + 2 * tasks
    return floats, (tasks + 8) * n + most + n + tasks + levels


@inner_kernel
def make_work(n, tasks, rows, levels, memory, index):
    """The work for n joints in the memory, both as long as `memory_sizes` says."""
    most = max(rows, n)
    wide, line_count = most + n, 2 * levels + rows + 4 * n + 4 + 12
    a = 12 * (n + 4 * tasks)
    b = a + 6 * (tasks + 20)
    c = b + 6 * tasks * n + 18
    d = c + (levels + 5) * n * n
    e = d + line_count * n
    f = e + (most + 3) * wide
    poses, sixes, nines = memory[:a].reshape(-1, 12), memory[a:b].reshape(-1, 6), memory[c - 18 : c].reshape(2, 3, 3)
    squares, lines = memory[c:d].reshape(-1, n, n), memory[d:e].reshape(-1, n)
    wides, by_level, whole = memory[e:f].reshape(-1, wide), memory[f:], index[: (tasks + 8) * n].reshape(-1, n)
    rest, single = index[(tasks + 8) * n :], lines[2 * levels + rows + 4 * n + 4 :]
    g = f + 9 * levels
    h = g + 2 * rows * rows
    i = h + (levels + 4) * rows
    j = i + 24 * n + 36
    grams, by_row = memory[g:h].reshape(2, rows, rows), memory[h:i].reshape(levels + 4, rows)
    near = memory[i:j]
    return TickWork(
        poses[:n],
        poses[n : n + 3 * tasks].reshape(tasks, 3, 12),
        poses[n + 3 * tasks :],
        sixes[:tasks],
        sixes[tasks],
        sixes[tasks + 1],
        sixes[tasks + 2 :].reshape(3, 6, 6),
        memory[b : c - 18].reshape(tasks, n, 6),
        nines[0],
        nines[1],
        squares[:levels],
        squares[levels],
        squares[levels + 1],
        squares[levels + 2],
        squares[levels + 3],
        squares[levels + 4],
        lines[:levels],
        lines[levels : 2 * levels],
        lines[2 * levels : 2 * levels + rows],
        lines[2 * levels + rows : 2 * levels + rows + 4 * n + 4],
        single[0],
        single[1],
        single[2],
        single[3],
        single[4],
        single[5],
        single[6],
        single[7],
        single[8],
        single[9],
        single[10],
        single[11],
        wides[:most],
        wides[most],
        wides[most + 1],
        wides[most + 2],
        by_level[:levels],
        by_level[levels : 2 * levels],
        by_level[2 * levels : 3 * levels],
        by_level[3 * levels : 4 * levels],
        whole[:tasks],
        whole[tasks : tasks + 3],
        whole[tasks + 3],
        whole[tasks + 4],
        whole[tasks + 5],
        whole[tasks + 6],
        whole[tasks + 7],
        grams[0],
        grams[1],
        by_row[:levels],
        by_row[levels],
        by_row[levels + 1],
        by_row[levels + 2],
        by_row[levels + 3],
        near[: 12 * n].reshape(n, 12),
        near[12 * n : 12 * n + 36].reshape(3, 12),
        near[12 * n + 36 : 18 * n + 36].reshape(6, n),
        near[18 * n + 36 :].reshape(n, 6),
        memory[j:].reshape(tasks, 2),
        by_level[4 * levels : 5 * levels],
        by_level[5 * levels : 6 * levels],
        by_level[6 * levels : 7 * levels],
        by_level[7 * levels : 8 * levels],
        by_level[8 * levels : 9 * levels],
        rest[:wide],
        rest[wide : wide + tasks],
        rest[wide + tasks :],
    )
