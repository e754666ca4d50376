"""Random numbers that belong to a target: the same whatever else is solved, in any order, on any number of threads."""

from __future__ import annotations

import numpy as np
from numba import uint64

from maira_qp.kernels.jit.decorators import kernel


@kernel
def next_random(state):
    """The next 64 bits of a stream, and its new state (Steele, Lea and Flood, "splitmix64", OOPSLA 2014)."""
    state = uint64(state + uint64(0x9E3779B97F4A7C15))
    z = uint64((state ^ (state >> uint64(30))) * uint64(0xBF58476D1CE4E5B9))
    z = uint64((z ^ (z >> uint64(27))) * uint64(0x94D049BB133111EB))
    return uint64(z ^ (z >> uint64(31))), state


@kernel
def mixed(state, bits):
    """A stream's state with 64 more bits stirred in."""
    return next_random(uint64(state ^ bits))[0]


@kernel
def stream_of(target, seed):
    """64 bits that begin the stream of a target (12,) under a seed (2,) of uint64: of these two alone."""
    state = mixed(mixed(uint64(0), seed[0]), seed[1])
    for i in range(len(target)):
        state = mixed(state, np.float64(target[i] + 0.0).view(np.uint64))  # -0.0 + 0.0 is 0.0
    return state


@kernel
def streams_of(targets, seed, streams):
    """`stream_of` each of the targets (N, 12) into streams (N,)."""
    for k in range(len(targets)):
        streams[k] = stream_of(targets[k], seed)


@kernel
def state_of(stream, attempt):
    """The first state of the random numbers of one attempt at a target with this stream."""
    bits, _ = next_random(uint64(stream))
    bits, _ = next_random(uint64(bits ^ uint64(attempt)))
    return bits
