"""Makers of paths: poses (N, 4, 4) in order, for `Solver.track`.

Positions are in metres, angles in radians; a pose is a `pin.SE3` or an array (4, 4). A path begins and ends exactly
where it is asked to. Options that most makers share:

- `step`: largest distance from one pose to the next [m], > 0; `inf`: none;
- `turn`: largest rotation from one pose to the next, on circles also that of the radius [rad], > 0; `inf`: none;
- `frame`: pose of the frame that the path is given in; the path comes back in the base.

Paths are joined by `np.concatenate`; `path @ T` with T (4, 4) turns or moves the tool in its own axes.

```python
import numpy as np

import maira_qp as mq

corners = [mq.pose([0.5, y, 0.6], rpy=[np.pi, 0, 0]) for y in (-0.2, 0.0, 0.2)]
there = mq.paths.polyline(corners, blend=0.05, step=0.005)
around = mq.paths.circle(corners[1], 0.1)
leaning = there @ mq.pose(rpy=[0.3, 0, 0]).homogeneous  # the tool leans by 0.3 rad about its x axis
```
"""

from maira_qp.paths.curves import arc, circle, spiral
from maira_qp.paths.files import from_csv
from maira_qp.paths.letters import letters
from maira_qp.paths.lines import cube, line, polyline, rectangle, square
from maira_qp.paths.sampling import in_frame, length, resampled
from maira_qp.paths.timing import waypoints

__all__ = [
    "arc",
    "circle",
    "cube",
    "from_csv",
    "in_frame",
    "length",
    "letters",
    "line",
    "polyline",
    "rectangle",
    "resampled",
    "spiral",
    "square",
    "waypoints",
]
