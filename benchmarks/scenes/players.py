"""Who takes part: maira_qp in its variants, and the peers that are installed."""

from __future__ import annotations

import inspect
import io
import tokenize
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from scenes import ours
from scenes.problems import Scene

OURS = "maira_qp"
"""The name of the row that all others are compared with."""
PEERS = {"Pink": ("pink", "pin-pink", "scenes.with_pink"), "Mink": ("mink", "mink", "scenes.with_mink")}
"""For each peer: what it is imported as, what pip calls it, and the module with its scenes."""


@dataclass(frozen=True)
class Player:
    """A library in one scene."""

    name: str
    build: Callable[[Scene], Callable[[Any], np.ndarray]]
    """Makes everything, and returns what takes a target to the next configuration (n,), from the scene's start on."""
    native: Callable[[Scene, Any], Any]
    """A target in the library's own type. This is not timed."""
    lines: int
    """Lines of code of the scene's function."""
    pairs: Callable[[Scene], int]
    """How many pairs of shapes it looks at in the collision scene."""


def players(scene: Scene) -> tuple[list[Player], list[str]]:
    """Everybody in a scene, ours first, and a line of text about each peer that is missing."""
    build = getattr(ours, scene.name)
    made = [
        Player(OURS, build, ours.native, lines_of_code(build), ours.pairs),
        Player(f"{OURS} daqp", partial(build, backend="daqp"), ours.native, lines_of_code(build), ours.pairs),
    ]
    weighted = getattr(ours, f"{scene.name}_weighted", None)
    if weighted is not None:
        made.append(Player(f"{OURS} weighted", weighted, ours.native, lines_of_code(weighted), ours.pairs))
    remarks = []
    for name, (imported, package, module) in PEERS.items():
        if find_spec(imported) is None:
            remarks.append(f"{name}: skipped, not installed (pip install '{package}')")
            continue
        theirs = import_module(module)
        function = getattr(theirs, scene.name)
        made.append(Player(name, function, theirs.native, lines_of_code(function), theirs.pairs))
    return made, remarks


def lines_of_code(function: Callable) -> int:
    """Lines of a function that hold code: no blank lines, no comments, no docstring."""
    tokens = list(tokenize.generate_tokens(io.StringIO(inspect.getsource(function)).readline))
    lines: set[int] = set()
    blank = (tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.COMMENT, tokenize.ENDMARKER)
    for k, token in enumerate(tokens):
        alone = token.type == tokenize.STRING and tokens[k - 1].type in blank and tokens[k + 1].type == tokenize.NEWLINE
        if token.type not in blank and not alone:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines)
