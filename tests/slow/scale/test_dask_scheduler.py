"""The scheduler of a Dask cluster is killed in the middle of a job: what was done is kept, and the job goes on."""

import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from support.marked_jobs import MarkedJob, files_of

from maira_qp.errors import JobError
from maira_qp.scale import run, state_of

pytest.importorskip("distributed")


def wait_for(path: Path) -> None:
    end = time.monotonic() + 60
    while not path.exists():
        assert time.monotonic() < end, f"{path} never came"
        time.sleep(0.02)


def test_a_scheduler_that_is_killed_is_told_and_the_job_goes_on(tmp_path):
    (tmp_path / "marks").mkdir()
    job, place = MarkedJob(marks=str(tmp_path / "marks"), waits_at=35), tmp_path / "scheduler.json"
    flags = ["--scheduler-file", str(place), "--no-dashboard"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    begin = {"env": environment, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    program = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", *flags]
    scheduler = subprocess.Popen(program, **begin)
    wait_for(place)
    worker = subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", *flags], **begin)

    def kill():
        wait_for(tmp_path / "marks" / "waiting-35")
        scheduler.kill()

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        address = json.loads(place.read_text())["address"]
        with pytest.raises(JobError, match="scheduler of Dask"):
            run(job, tmp_path / "job", engine="dask", address=address, shard=10, workers=1)
    finally:
        killer.join()
        for process in (scheduler, worker):
            process.kill()
            process.wait()
    assert state_of(tmp_path / "job", job).done == 30
    rest = replace(job, waits_at=-1)
    (tmp_path / "job" / "job.json").write_text(json.dumps(rest.manifest(), indent=2, allow_nan=False) + "\n")
    run(rest, tmp_path / "job", engine="here")
    run(rest, tmp_path / "here", engine="here")
    assert files_of(tmp_path / "job") == files_of(tmp_path / "here")
