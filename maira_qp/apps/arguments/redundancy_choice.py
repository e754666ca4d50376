"""What the redundancy is used for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from maira_qp.apps.arguments.optional import Maybe, explained
from maira_qp.errors import OptionError

if TYPE_CHECKING:
    from maira_qp.problem.redundancy import Strict, Weighted

DEFAULT_WEIGHT = 1e-3


@explained
@dataclass(frozen=True, kw_only=True)
class RedundancyChoice:
    """What the redundancy is used for."""

    redundancy: Literal["none", "weighted", "fading", "strict"] = "none"
    """Keep the joints near mid-range: not at all (none), at some cost of the pose, see --weight (weighted), the same
    with a weight that fades as the pose is reached (fading), or as far as the pose allows (strict)."""
    weight: Maybe[float] = None
    """What the posture counts beside the squared pose error, with --redundancy weighted or fading; > 0; none: 1e-3."""

    def load(self) -> Weighted | Strict | None:
        """What a solver takes. Raises `OptionError`."""
        from maira_qp.problem.objectives import Posture
        from maira_qp.problem.redundancy import Strict, Weighted

        is_weighted = self.redundancy in ("weighted", "fading")
        if self.weight is not None and not is_weighted:
            raise OptionError("--weight only counts with --redundancy weighted or fading")
        if is_weighted:
            weight = DEFAULT_WEIGHT if self.weight is None else self.weight
            return Weighted(Posture(), weight, fading=self.redundancy == "fading")
        return Strict(Posture()) if self.redundancy == "strict" else None
