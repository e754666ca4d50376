"""In a notebook: the viewer in a cell, and a bar that shows how far a long call is.

The last line of a cell shows the viewer: `view(robot)`. A bar goes with every call that takes a `progress`:

```python
import maira_qp as mq
from maira_qp.apps.notebook import ProgressBar

solver = mq.Solver(mq.Robot.maira())
target = mq.pose([0.4, 0.2, 0.9], quaternion=[0, 1, 0, 0])
batch = solver.solve_batch([target] * 100, progress=ProgressBar("solved"))
```
"""

from __future__ import annotations

import html
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from maira_qp.errors import OptionError, shown
from maira_qp.robots.model.robot import Robot

if TYPE_CHECKING:
    from maira_qp.apps.viewer.server import Viewer

UPDATES = 0.1
"""Time [s] that passes between two pictures of a bar."""


class ViewerCell:
    """The viewer of a robot, shown by the cell whose last line it is; until `close` it is served to this machine."""

    def __init__(self, viewer: Viewer, height: int) -> None:
        self._viewer, self._height = viewer, height

    @property
    def url(self) -> str:
        """Where it is served."""
        return self._viewer.url

    @property
    def q(self) -> Any:
        """The configuration (n,) that is shown [rad or m]."""
        return self._viewer.current.q.copy()

    def close(self) -> None:
        """End it; the cell stays empty."""
        self._viewer.close()

    def _repr_html_(self) -> str:
        address = html.escape(self._viewer.address, quote=True)
        return f'<iframe src="{address}" width="100%" height="{self._height}" style="border: 0"></iframe>'

    def __repr__(self) -> str:
        return f"the viewer of {self._viewer.current.robot.name} is at {self._viewer.address}"


def view(robot: Robot, *, height: int = 600, port: int = 0) -> ViewerCell:
    """Serve a robot to this machine, for a cell of a notebook to show; needs the extra `view`.

    Args:
        robot: what is shown, with its tools, limits and objects.
        height: of the cell [pixels].
        port: where it is served, or the next that is free; 0: any.

    Raises `OptionError` for what is no robot, no height, or without viser; `OSError` if no port is free.
    """
    if not isinstance(robot, Robot):
        raise OptionError(f"robot must be a Robot, got {shown(robot)}")
    if isinstance(height, bool) or not isinstance(height, int) or height < 1:
        raise OptionError(f"height must be a whole number of pixels >= 1, got {shown(height)}")
    from maira_qp.apps.commands.view import check_viser

    check_viser()
    from maira_qp.apps.viewer.server import Viewer

    return ViewerCell(Viewer(robot, port=port), height)


@dataclass(frozen=True, repr=False)
class _Bar:
    """One picture of a bar; where there is no HTML, its text."""

    text: str
    done: int
    total: int

    def _repr_html_(self) -> str:
        return f'<progress value="{self.done}" max="{self.total}"></progress> {html.escape(self.text)}'

    def __repr__(self) -> str:
        return self.text


class ProgressBar:
    """A bar for `progress=` of long calls: in a notebook a bar below the cell, elsewhere a line of the terminal."""

    def __init__(self, title: str = "") -> None:
        """A bar with a title.

        Args:
            title: what stands before the bar.
        """
        self._title, self._handle, self._begin, self._next = title, None, 0.0, 0.0

    def __call__(self, done: int, total: int) -> None:
        """Show that so many are done, of so many."""
        now = time.monotonic()
        self._begin = self._begin or now
        if now < self._next and done < total:
            return
        self._next = now + UPDATES
        left = (now - self._begin) * (total - done) / done if done else float("nan")
        text = f"{self._title} {done:,} of {total:,}".strip() + (f", {left:.0f} s left" if 0 < done < total else "")
        if self._in_notebook():
            self._show(text, done, total)
        else:
            sys.stderr.write(f"\r{text:<79}" + ("\n" if done >= total else ""))
            sys.stderr.flush()

    @staticmethod
    def _in_notebook() -> bool:
        """The code runs in a kernel that shows HTML."""
        shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
        return shell is not None and getattr(shell, "kernel", None) is not None

    def _show(self, text: str, done: int, total: int) -> None:
        from IPython.display import display  # type: ignore[import-not-found]

        bar = _Bar(text, done, total)
        if self._handle is None:
            self._handle = display(bar, display_id=True)
        else:
            self._handle.update(bar)
