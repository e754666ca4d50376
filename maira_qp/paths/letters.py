"""Letters drawn by strokes, the pen lifted between them."""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.errors import OptionError, listed, shown
from maira_qp.paths.arguments import checked_pose, finite_positive, with_rotations
from maira_qp.paths.lines import polyline
from maira_qp.paths.sampling import STEP, TURN

UNITS = 6
"""Height of a letter on the grid of its strokes."""
GAP = 2
"""Between two letters, on the same grid."""
LONGEST = 1000
"""Most characters of a text."""
STROKES = {
    "A": "00 26 40/13 33",
    "B": "33 03/00 06 36 45 44 33 42 41 30 00",
    "C": "45 36 16 05 01 10 30 41",
    "D": "00 06 26 44 42 20 00",
    "E": "46 06 00 40/03 33",
    "F": "46 06 00/03 33",
    "G": "45 36 16 05 01 10 30 41 43 23",
    "H": "06 00/03 43/46 40",
    "I": "06 00",
    "J": "46 41 30 10 01",
    "K": "06 00/46 03 40",
    "L": "06 00 40",
    "M": "00 06 23 46 40",
    "N": "00 06 40 46",
    "O": "16 05 01 10 30 41 45 36 16",
    "P": "00 06 36 45 44 33 03",
    "Q": "16 05 01 10 30 41 45 36 16/22 40",
    "R": "00 06 36 45 44 33 03/33 40",
    "S": "45 36 16 05 04 13 33 42 41 30 10 01",
    "T": "06 46/26 20",
    "U": "06 01 10 30 41 46",
    "V": "06 20 46",
    "W": "06 10 23 30 46",
    "X": "06 40/46 00",
    "Y": "06 23 46/23 20",
    "Z": "06 46 00 40",
    "0": "16 05 01 10 30 41 45 36 16/45 01",
    "1": "05 16 10",
    "2": "05 16 36 45 44 00 40",
    "3": "05 16 36 45 44 33 42 41 30 10 01/33 13",
    "4": "40 46 02 42",
    "5": "46 06 03 33 42 41 30 10 01",
    "6": "45 36 16 05 01 10 30 41 42 33 03",
    "7": "06 46 10",
    "8": "13 04 05 16 36 45 44 33 13 02 01 10 30 41 42 33",
    "9": "43 13 04 05 16 36 45 41 30 10 01",
    " ": "",
}
"""Of each letter its strokes, points xy on a grid 4 wide and 6 high; a letter is as wide as its strokes."""


def letters(
    text: str,
    height: float,
    origin: Any,
    *,
    lift: float = 0.02,
    step: float = STEP,
    turn: float = TURN,
    frame: Any = None,
) -> np.ndarray:
    """Make the strokes of a text, the pen lifted between them: poses (N, 4, 4).

    The tool looks at the text along its z-axis, as a pen does: the text runs along the x-axis of `origin` and stands
    along -y, and the pen is lifted along -z. The path begins and ends with the pen lifted.

    Args:
        text: letters A to Z, digits and blanks, 1000 at most; small letters are drawn as capitals.
        height: of a letter [m], > 0.
        origin: pose of the tool at the lower left corner of the text; it keeps the orientation.
        lift: how far the pen is lifted [m], > 0.
        step, turn, frame: see `maira_qp.paths`.

    Raises `PoseError`, `OptionError`.
    """
    T = checked_pose(origin, "origin")
    unit = finite_positive(height, "height", "metres") / UNITS
    up = np.array([0.0, 0.0, -finite_positive(lift, "lift", "metres")])
    points = []
    for stroke in _strokes(text):
        drawn = stroke * (unit, -unit, 0.0)
        points += [drawn[:1] + up, drawn, drawn[-1:] + up]
    if not points:
        raise OptionError(f"there is nothing to draw in the text {shown(text)}")
    return polyline(T @ with_rotations(np.concatenate(points), np.eye(3)), step=step, turn=turn, frame=frame)


def _strokes(text: Any) -> list[np.ndarray]:
    """Strokes (K, 3) of a text in units of the grid, z = 0. Raises `OptionError`."""
    if not isinstance(text, str) or len(text) > LONGEST:
        raise OptionError(f"text must be a string of at most {LONGEST} characters, got {shown(text)}")
    strokes, x = [], 0
    for letter in text.upper():
        if letter not in STROKES:
            raise OptionError(f"no strokes are known for {letter!r}; {listed(sorted(STROKES.keys() - {' '}), letter)}")
        drawn = [[(int(a), int(b), 0) for a, b in stroke.split()] for stroke in STROKES[letter].split("/") if stroke]
        strokes += [np.add(stroke, (x, 0.0, 0.0)) for stroke in drawn]
        x += max((a for stroke in drawn for a, _, _ in stroke), default=GAP) + GAP
    return strokes
