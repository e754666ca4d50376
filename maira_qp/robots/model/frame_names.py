"""Names of frames that a caller gives: one tip, or several, and a base."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from maira_qp.errors import FrameError, listed, shown


def known_frame(name: Any, role: str, frames: Iterable[str]) -> str:
    """The name itself if it is a frame's. Raises `FrameError` that names the role, `tip` or `base`."""
    frames = list(frames)
    if not isinstance(name, str) or name not in frames:
        raise FrameError(f"the {role} {shown(name)} is not a link of this robot; {listed(frames, name)}")
    return name


def named_tips(tip: Any, frames: Iterable[str], ends: Sequence[str]) -> tuple[str, ...]:
    """The tips as a tuple: one name, or a list or tuple of names; `ends` are suggested where there are none.

    Raises `FrameError` if a name is not a frame's, if names are repeated or none are given.
    """
    frames = list(frames)
    if tip is None:
        raise FrameError(f"there are {len(ends)} tips, choose one (tip=...) or several (tip=[...]); {listed(ends)}")
    if not isinstance(tip, (list, tuple)):
        return (known_frame(tip, "tip", frames),)
    if not tip:
        raise FrameError(f"the list of tips is empty; {listed(ends)}")
    tips = tuple(known_frame(each, "tip", frames) for each in tip)
    for i, name in enumerate(tips):
        if name in tips[:i]:
            raise FrameError(f"the tip {name!r} is named twice in {list(tips)}")
    return tips
