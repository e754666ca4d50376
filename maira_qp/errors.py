"""What a caller can get wrong. A numerical outcome is a `Status` of the result, never an exception."""

from __future__ import annotations

import difflib
import itertools
import reprlib
from collections.abc import Iterable, Sequence


class MairaError(ValueError):
    """Base of every error that this package raises on purpose."""

    def __init__(self, message: str = "", *, python: str = "", shell: str = "") -> None:
        """A message, and what to type about it: as a call in Python, or as a flag on the command line."""
        super().__init__(f"{message}; {python}" if python else message)
        self.for_shell = f"{message}; {shell}" if shell else message
        """The message with the remedy of the command line."""

    def at(self, place: str) -> MairaError:
        """The same error, with a place before its message, such as the line of a file."""
        moved = type(self)(f"{place}: {self}")
        moved.for_shell = f"{place}: {self.for_shell}"
        return moved


class RobotError(MairaError):
    """The robot description cannot be used: malformed URDF or DH table, no joints, a cycle, bad limits."""


class FrameError(MairaError):
    """A frame (link or joint) of that name does not exist; the message lists those that do."""


class ConfigurationError(MairaError):
    """A joint vector has the wrong shape, the wrong type or values that are not finite."""


class PoseError(MairaError):
    """A target is not a rigid transformation."""


class OptionError(MairaError):
    """An option is outside its range, or a combination of options makes no sense."""


class BackendError(MairaError):
    """A QP backend is unknown or not installed; the message lists those that are."""


class CompilationError(MairaError):
    """Kernels cannot be compiled ahead of their use: there is no folder to keep them in."""


class JobError(MairaError):
    """A job cannot be begun or gone on with: another job in its folder, other versions, a part that fails each time."""


class SensitivityError(MairaError):
    """An answer has no derivative by its target, or none that is known: not optimal, singular, of another problem."""


def listed(names: Iterable[str], wanted: object = None, limit: int = 40) -> str:
    """Valid names as text for a message, the nearest to `wanted` first suggested, the list cut at `limit`."""
    names = list(names)
    return f"{hint(names, wanted)}valid names: {joined(names, limit)}"


def hint(names: Sequence[str], wanted: object) -> str:
    """Ask whether the one of `names` nearest to `wanted` was meant, with a space behind; empty where none is near."""
    close = difflib.get_close_matches(wanted[:200], names, n=1) if isinstance(wanted, str) else []
    return f"did you mean {close[0]!r}? " if close else ""


def joined(names: Sequence[str], limit: int = 40) -> str:
    """`names` as text for a message, cut at `limit`."""
    rest = f", ... ({len(names) - limit} more)" if len(names) > limit else ""
    return f"{', '.join(names[:limit])}{rest}"


class _Bounded(reprlib.Repr):
    """A repr that looks at a few entries of each container only: nested aliases of one list can mean terabytes."""

    def repr_instance(self, x: object, level: int) -> str:
        try:
            if getattr(getattr(x, "dtype", None), "hasobject", False):  # NumPy's own repr looks at all of each entry
                entries = list(itertools.islice(x.flat, self.maxlist + 1))  # type: ignore[attr-defined]
                return f"{type(x).__name__} of {self.repr1(entries, level)}"
            return super().repr_instance(x, level)
        except Exception:  # a caller's own class
            return f"<{type(x).__name__}>"


_bounded = _Bounded()
_bounded.maxlevel, _bounded.maxother, _bounded.maxstring = 3, 80, 80


def shown(value: object) -> str:
    """A value as text for a message, at most 80 characters in one line, made without a look at all of it."""
    return f"{' '.join(_bounded.repr(value).split()):.80}"
