"""Robots shared by all tests, the random stream of each, and what is skipped beside an old Pinocchio."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import RobotError
from maira_qp.robots.model.pinocchio_versions import HAS_MIMIC


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup():
    """Skip tests with a robot that this version of Pinocchio cannot hold."""
    try:
        return (yield)
    except RobotError as reason:
        _skip_without_mimic(reason)
        raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call():
    """Skip tests that make such a robot themselves."""
    try:
        return (yield)
    except RobotError as reason:
        _skip_without_mimic(reason)
        raise


def _skip_without_mimic(reason: RobotError) -> None:
    if not HAS_MIMIC and " mimics " in str(reason):
        pytest.skip(str(reason))


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
