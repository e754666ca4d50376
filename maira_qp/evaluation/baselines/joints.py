"""The ranges of a chain's joints, where they have one."""

from __future__ import annotations

import math

import numpy as np

from maira_qp.robots.dh.table import DHTable

TURN = 2 * math.pi


def revolute(table: DHTable) -> np.ndarray:
    """Which of the n moving joints turn (n,) bool; the others slide."""
    return np.array([link.kind != "prismatic" for link in table.links if link.kind != "fixed"])


def middle(table: DHTable) -> np.ndarray:
    """Middle of each joint's range (n,) [rad or m]; 0 for a joint without limits."""
    limited = np.isfinite(table.lower)
    return np.where(limited, 0.5 * np.where(limited, table.lower, 0.0) + 0.5 * np.where(limited, table.upper, 0.0), 0.0)


def pull_to_middle(table: DHTable, q: np.ndarray) -> np.ndarray:
    """q - q_mid (n,) [rad or m]; 0 for a joint without limits, which has no middle."""
    return np.where(np.isfinite(table.lower), q - middle(table), 0.0)


def within_a_turn(table: DHTable, q: np.ndarray) -> np.ndarray:
    """q (n,) with each angle in the turn about the middle of its range.

    The pose is the same, and the angle is inside its limits if any of its turns is.
    """
    turns = np.round((q - middle(table)) / TURN)
    return np.where(revolute(table), q - TURN * turns, q)
