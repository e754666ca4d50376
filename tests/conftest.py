"""Robots shared by all tests, and the random stream of each."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq


@pytest.fixture
def rng() -> np.random.Generator:
    """A stream of its own for each test."""
    return np.random.default_rng(20240607)


@pytest.fixture(scope="session")
def maira() -> mq.Robot:
    return mq.Robot.maira()


@pytest.fixture(scope="session")
def iiwa14() -> mq.Robot:
    return mq.Robot.iiwa14()


@pytest.fixture(scope="session")
def panda() -> mq.Robot:
    return load("panda")


@pytest.fixture(scope="session")
def ur5() -> mq.Robot:
    return load("ur5")


@pytest.fixture(scope="session")
def pr2_arm() -> mq.Robot:
    """Seven joints, two of them continuous."""
    return load("pr2_arm")
