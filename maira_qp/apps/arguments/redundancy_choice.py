"""What the redundancy is used for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from maira_qp.errors import OptionError

if TYPE_CHECKING:
    from maira_qp.problem.redundancy import Strict, Weighted

DEFAULT_WEIGHT = 1e-3


@dataclass(frozen=True, kw_only=True)
class RedundancyChoice:
    """What the redundancy is used for."""

    redundancy: Literal["none", "weighted", "strict"] = "none"
    """Joints near mid-range: no wish (none), traded for the pose at --weight, or as far as the pose allows (strict)."""
    weight: float | None = None
    """What the posture counts with --redundancy weighted beside the squared pose error; > 0; none: 1e-3."""

    def load(self) -> Weighted | Strict | None:
        """What a solver takes. Raises `OptionError`."""
        from maira_qp.problem.objectives import Posture
        from maira_qp.problem.redundancy import Strict, Weighted

        if self.weight is not None and self.redundancy != "weighted":
            raise OptionError("--weight only counts with --redundancy weighted")
        if self.redundancy == "weighted":
            return Weighted(Posture(), DEFAULT_WEIGHT if self.weight is None else self.weight)
        return Strict(Posture()) if self.redundancy == "strict" else None
