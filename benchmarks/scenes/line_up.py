"""Who takes part: maira_qp in its variants, and the peers that are installed."""

from __future__ import annotations

import inspect
import io
import tokenize
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from maira_qp.evaluation.contestant import Contestant
from scenes import ours
from scenes.problems import Scene

OURS = "maira_qp"
"""The name of the row that all others are compared with."""
PEERS = {"Pink": ("pink", "pin-pink", "scenes.with_pink"), "Mink": ("mink", "mink", "scenes.with_mink")}
"""For each peer: what it is imported as, what pip calls it, and the module with its scenes."""


def line_up(scene: Scene) -> tuple[list[Contestant], list[str]]:
    """Everybody in a scene, ours first, and a line of text about each peer that is missing."""
    build, weighted = getattr(ours, scene.name), getattr(ours, f"{scene.name}_weighted", None)
    made = [
        contestant(OURS, scene, ours, build),
        contestant(f"{OURS} daqp", scene, ours, build, backend="daqp"),
        *([] if weighted is None else [contestant(f"{OURS} weighted", scene, ours, weighted)]),
    ]
    remarks = []
    for name, (imported, package, module) in PEERS.items():
        if find_spec(imported) is None:
            remarks.append(f"{name}: skipped, not installed (pip install '{package}')")
        else:
            theirs = import_module(module)
            made.append(contestant(name, scene, theirs, getattr(theirs, scene.name)))
    return made, remarks


def contestant(name: str, scene: Scene, library: ModuleType, build: Callable, **settings: str) -> Contestant:
    """A library in one scene, by its module of scenes and the function that a user would write."""
    return Contestant(
        name=name,
        control=partial(build, scene, **settings),
        native=partial(library.native, scene),
        lines=lines_of_code(build),
        pairs=partial(library.pairs, scene),
    )


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
