"""How near to a singularity a solve comes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from maira_qp.apps.plots.style import finish, line, styled


@styled
def condition_numbers(ax: Axes, series: Mapping[str, Sequence[float]], *, step: str = "iteration") -> None:
    """Condition number of the Jacobian over the steps of a solve, a line a method; infinite values leave a gap."""
    for i, (name, values) in enumerate(series.items()):
        values = np.asarray(values, dtype=float)
        finite = np.where(np.isfinite(values), values, np.nan)
        ax.plot(finite, **line(i), label=name)
    ax.set_yscale("log")
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.set(xlabel=step, ylabel="condition number [-]")
    finish(ax)
