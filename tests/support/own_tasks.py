"""Tasks of a user's own."""

import dataclasses

import numpy as np

import maira_qp as mq


def height_task():
    """A task of a user's own."""

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class HeightTask(mq.Task):
        height: float

        def error(self, at):
            return np.array([self.height - at.placement().translation[2]])

        def jacobian(self, at):
            return at.jacobian()[2:3]

    return HeightTask(height=0.3)
