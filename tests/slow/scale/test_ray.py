"""The engine that is Ray, whose cluster takes some seconds to begin."""

import os
import sys

import pytest
from support.marked_jobs import MarkedJob, files_of

from maira_qp.scale import run

pytest.importorskip("ray")


@pytest.mark.filterwarnings("ignore")
def test_ray_makes_the_same_output_though_a_worker_dies(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # where its workers find the job's class
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    (tmp_path / "marks").mkdir()
    job = MarkedJob(marks=str(tmp_path / "marks"), killed=(12,))
    run(job, tmp_path / "ray", engine="ray", workers=1, shard=10)
    run(job, tmp_path / "here", engine="here")
    assert os.listdir(job.marks) == ["killed-12"]
    assert files_of(tmp_path / "ray") == files_of(tmp_path / "here")
