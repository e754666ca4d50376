"""Many poses on many machines, into files that survive a crash.

```python
import maira_qp as mq

job = mq.scale.ReachJob.of(mq.Robot.maira(), cell=0.5, directions=20)
mq.scale.run(job, "coarse.zarr", workers=1)
reach = mq.scale.ReachMap.open("coarse.zarr")
reach.query([mq.pose([0.4, 0.2, 0.9])])  # (1,) values of `mq.Reach`
```

A job is frozen data; `run` does it by an engine, and goes on after whatever interrupted it. The finished folder is the
same, byte for byte, for any engine, number of workers and length of the shards, on machines of one kind.
"""

from maira_qp.scale.dataset.job import DatasetJob
from maira_qp.scale.engines.engine import Engine
from maira_qp.scale.job import Job
from maira_qp.scale.placement.place import place
from maira_qp.scale.placement.placements import Placement, Placements
from maira_qp.scale.reach.job import ReachJob
from maira_qp.scale.reach.reach_map import MapSlice, ReachMap
from maira_qp.scale.reach.surface import MapSurface
from maira_qp.scale.run import JobState, Verification, resume, run, state_of, verify

__all__ = [
    "DatasetJob",
    "Engine",
    "Job",
    "JobState",
    "MapSlice",
    "MapSurface",
    "Placement",
    "Placements",
    "ReachJob",
    "ReachMap",
    "Verification",
    "place",
    "resume",
    "run",
    "state_of",
    "verify",
]
