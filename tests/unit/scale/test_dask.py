"""The engine that is Dask: the same output, and shards of workers that died are done again."""

import pytest
from support.marked_jobs import MarkedJob, files_of

from maira_qp.errors import JobError
from maira_qp.scale import run, state_of


@pytest.fixture
def marks(tmp_path) -> str:
    (tmp_path / "marks").mkdir()
    return str(tmp_path / "marks")


def test_dask_makes_the_same_output_though_a_worker_dies(marks, tmp_path):
    pytest.importorskip("distributed")
    job = MarkedJob(marks=marks, killed=(12,))
    run(job, tmp_path / "dask", engine="dask", workers=1, shard=10)
    run(job, tmp_path / "here", engine="here")
    assert files_of(tmp_path / "dask") == files_of(tmp_path / "here")


def test_dask_tells_what_the_job_raises_and_keeps_what_was_done(marks, tmp_path):
    distributed = pytest.importorskip("distributed")
    job = MarkedJob(marks=marks, broken=(35,))
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        pytest.raises(ArithmeticError, match="item 35 cannot be"),
    ):
        run(job, tmp_path / "job", engine="dask", address=cluster.scheduler_address, shard=10, workers=1)
    assert state_of(tmp_path / "job", job).done >= 30


def test_a_scheduler_that_is_not_there_is_told(marks, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("maira_qp.scale.engines.dask_cluster.TIMEOUT", 0.5)
    with pytest.raises(JobError, match="scheduler of Dask is not reached"):
        run(MarkedJob(marks=marks), tmp_path / "job", engine="dask", address="tcp://127.0.0.1:9", shard=10)
