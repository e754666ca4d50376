"""What a benchmark is asked to do: one frozen class, which is its part of the command line too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from maira_qp.errors import OptionError

MethodName = Literal["dh-clamped", "newton", "gradient", "pose", "weighted", "fading", "strict"]
METHODS: tuple[MethodName, ...] = get_args(MethodName)
Stratum = Literal["uniform", "near-limits-1e-2", "near-limits-1e-4", "stretched-elbow", "aligned-wrist", "out-of-reach"]
STRATA: tuple[Stratum, ...] = get_args(Stratum)
OUT_OF_REACH: Stratum = "out-of-reach"
NO_BACKEND = "-"
"""The backend of a method that solves no QP."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What to compare, on which targets."""

    methods: tuple[MethodName, ...] = METHODS
    """The textbook methods on the plain DH chain; the solver with the pose alone, or a weighted or strict posture."""
    backends: tuple[str, ...] = ("daqp",)
    """QP backends of the solver's methods: compiled, daqp, ..."""
    strata: tuple[Stratum, ...] = STRATA
    """Kinds of targets."""
    targets: int = 200
    """Targets per stratum; > 0."""
    seed: int = 0
    """Seed of the targets and starts; >= 0."""
    weight: float = 1e-3
    """What the posture counts in the method `weighted`; > 0."""
    loose_position: float = 1e-2
    """The loose tolerance [m]; > 0. The strict ones are the solver's own."""
    loose_orientation: float = 1e-2
    """The loose tolerance [rad]; > 0."""

    def __post_init__(self) -> None:
        for key in ("methods", "backends", "strata"):
            names = getattr(self, key)
            if not names or len(set(names)) < len(names):
                raise OptionError(f"{key} must be one name or more, each once, got {' '.join(names) or 'none'}")
        for key, least in (("targets", 1), ("seed", 0)):
            if not getattr(self, key) >= least:
                raise OptionError(f"{key} must be at least {least}, got {getattr(self, key)}")
        for key in ("weight", "loose_position", "loose_orientation"):
            if not 0 < getattr(self, key) < float("inf"):
                raise OptionError(f"{key} must be a positive number, got {getattr(self, key)}")
