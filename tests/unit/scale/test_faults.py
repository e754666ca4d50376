"""What may happen to a job: nothing is lost, nothing is there twice, and the output is that of an undisturbed run."""

import errno
import json
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command_line import heed_interrupts
from support.marked_jobs import MarkedJob, files_of

import maira_qp as mq
from maira_qp.errors import JobError, OptionError
from maira_qp.scale import ReachJob, resume, run, state_of, verify
from maira_qp.scale.engines.processes import Processes
from maira_qp.scale.ownership import owned

TESTS = Path(__file__).parents[2]
CLIENT = """
import sys
sys.path.insert(0, {tests!r})
from support.marked_jobs import MarkedJob
from maira_qp.scale import run
run(MarkedJob(marks={marks!r}, waits_at={waits_at}), {folder!r}, engine={engine!r}, workers=1, shard=10)
"""


@pytest.fixture
def marks(tmp_path) -> str:
    (tmp_path / "marks").mkdir()
    return str(tmp_path / "marks")


def undisturbed(job: MarkedJob, folder: Path) -> dict[str, bytes]:
    run(job, folder, engine="here")
    return files_of(folder)


def wait_for(there, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.01)


def client(marks: str, folder: Path, waits_at: int, engine: str) -> subprocess.Popen:
    """Another process that runs a job of 60 items, 10 a shard, and waits at one of them."""
    code = CLIENT.format(tests=str(TESTS), marks=marks, waits_at=waits_at, folder=str(folder), engine=engine)
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, preexec_fn=heed_interrupts)
    wait_for(Path(marks, f"waiting-{waits_at}").exists)
    return process


def test_the_output_is_the_same_for_any_engine_number_of_workers_and_length_of_shards(marks, tmp_path):
    job = MarkedJob(marks=marks)
    wanted = undisturbed(job, tmp_path / "here")
    assert {"job.json", "SHA256SUMS", "end", "block-000000", "block-000056"} <= set(wanted)
    for k, options in enumerate([{"workers": 2, "shard": 1}, {"workers": 1, "shard": 11}]):
        state = run(job, tmp_path / str(k), **options)
        assert state.finished
        assert (state.done, state.total, state.owner) == (60, 60, None)
        assert files_of(tmp_path / str(k)) == wanted
    numbers = b"".join(wanted[f"block-{first:06d}"][: 8 * min(7, 60 - first)] for first in range(0, 60, 7))
    np.testing.assert_array_equal(np.frombuffer(numbers, np.int64), np.arange(60))


def test_parts_on_machines_that_know_nothing_of_each_other_make_the_same_output(marks, tmp_path):
    job = MarkedJob(marks=marks)
    for i in (3, 1):
        state = run(job, tmp_path / "parts", engine="here", part=(i, 3), shard=4)
        assert not state.finished
    assert state.done == 40
    assert run(job, tmp_path / "parts", engine="here", part=(2, 3)).done == 60
    assert run(job, tmp_path / "parts", engine="here").finished
    assert files_of(tmp_path / "parts") == undisturbed(job, tmp_path / "here")


def test_the_shard_of_a_worker_that_was_killed_is_done_again(marks, tmp_path):
    job = MarkedJob(marks=marks, killed=(7, 33))
    run(job, tmp_path / "job", workers=2, shard=10)
    assert sorted(os.listdir(marks)) == ["killed-33", "killed-7"]
    assert files_of(tmp_path / "job") == undisturbed(job, tmp_path / "here")  # the marks are there: no accident


def test_a_worker_that_hangs_is_ended_and_its_shard_done_again(marks, tmp_path):
    job = MarkedJob(marks=marks, hanging=(25,))
    run(job, tmp_path / "job", engine=Processes(1, time_limit=0.5), shard=20)
    assert "hung-25" in os.listdir(marks)
    assert files_of(tmp_path / "job") == undisturbed(job, tmp_path / "here")


def test_an_item_that_kills_each_time_ends_the_run_and_all_else_is_kept(marks, tmp_path):
    job = MarkedJob(marks=marks, deadly=(55,))
    with pytest.raises(JobError, match=r"items 50 to 59 failed 3 times: the worker ended with exit code -9"):
        run(job, tmp_path / "job", workers=1, shard=10)
    assert state_of(tmp_path / "job", job).done == 50


def test_an_error_of_the_job_is_told_with_its_place_and_not_tried_again(marks, tmp_path):
    job = MarkedJob(marks=marks, broken=(41,))
    with pytest.raises(JobError, match=r"(?s)items 40 to 49 failed:.*ArithmeticError: item 41 cannot be"):
        run(job, tmp_path / "job", workers=1, shard=10)
    assert state_of(tmp_path / "job", job).done == 40


@pytest.mark.parametrize(("sign", "engine"), [(signal.SIGKILL, "here"), (signal.SIGINT, "processes")])
def test_a_client_that_is_ended_leaves_a_job_that_goes_on(marks, tmp_path, sign, engine):
    folder, job = tmp_path / "job", MarkedJob(marks=marks, waits_at=45)
    process = client(marks, folder, 45, engine)
    process.send_signal(sign)
    process.communicate()
    assert process.returncode != 0
    assert state_of(folder, job).done == 40
    assert sign == signal.SIGKILL or not (folder / "job.lock").exists()
    rest = replace(job, waits_at=-1)
    (folder / "job.json").write_text(json.dumps(rest.manifest(), indent=2, allow_nan=False) + "\n")
    run(rest, folder, engine="here")
    assert files_of(folder) == undisturbed(rest, tmp_path / "here")


def test_one_client_at_a_time_and_a_dead_one_counts_no_more(marks, tmp_path):
    folder, job = tmp_path / "job", MarkedJob(marks=marks, waits_at=45)
    process = client(marks, folder, 45, "here")
    with pytest.raises(JobError, match=rf"in use by process {process.pid} of the machine"):
        run(job, folder, engine="here")
    assert state_of(folder, job).owner["pid"] == process.pid
    process.kill()
    process.communicate()
    assert (folder / "job.lock").exists()
    assert state_of(folder, job).owner is None
    with owned(folder):
        assert state_of(folder, job).owner["pid"] == os.getpid()
    assert not (folder / "job.lock").exists()


def test_workers_end_with_their_client(marks, tmp_path):
    process = client(marks, tmp_path / "job", 45, "processes")
    workers = children(process.pid)
    assert workers
    process.kill()
    process.communicate()
    wait_for(lambda: not any(is_alive(pid) for pid in workers))


def children(pid: int) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_damaged_shard_is_found_and_done_again(marks, tmp_path):
    folder, job = tmp_path / "job", MarkedJob(marks=marks)
    run(job, folder, engine="here", part=(1, 2), shard=10)
    victim = sorted((folder / "shards").iterdir())[1]
    content = bytearray(victim.read_bytes())
    content[-30] ^= 4
    victim.write_bytes(content)
    found = verify(folder)
    assert not found
    assert (found.checked, found.damaged) == (3, (f"shards/{victim.name}",))
    run(job, folder, engine="here")
    assert files_of(folder) == undisturbed(job, tmp_path / "here")
    assert verify(folder)


def test_a_finished_output_that_was_changed_is_found(marks, tmp_path):
    folder = tmp_path / "job"
    run(MarkedJob(marks=marks), folder, engine="here")
    assert verify(folder)
    (folder / "block-000014").write_bytes(b"?")
    (folder / "block-000021").unlink()
    assert verify(folder).damaged == ("block-000014", "block-000021")
    listed = subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=folder, capture_output=True)
    assert listed.returncode != 0
    sums = (folder / "SHA256SUMS").read_bytes()
    for damaged in (b"", b"\xd1\x00 no text", sums[:-9], sums[: sums.rindex(b"\n", 0, -1) + 1], sums + sums):
        (folder / "SHA256SUMS").write_bytes(damaged)
        assert verify(folder).damaged == ("SHA256SUMS",)


@pytest.mark.parametrize(
    "manifest",
    [
        {"kind": ["reach"]},
        {"versions": 3},
        {"job": 7},
        {"format": "1"},
        {"kind": "nope"},
        {"job": {}},
        {"job": {"cell": "wide"}},
        {"job": {"shape": [3, -1, 2]}},
        {"job": {"shape": 4}},
        {"job": {"directions": 0}},
    ],
)
def test_a_manifest_of_no_job_is_told(tmp_path, manifest):
    there = ReachJob.of(mq.Robot.iiwa14(), cell=0.5, directions=3).manifest()
    job = manifest.get("job")
    wrong = there | manifest | ({"job": there["job"] | job} if isinstance(job, dict) and job else {})
    (tmp_path / "job.json").write_text(json.dumps(wrong))
    for action in (state_of, resume):
        with pytest.raises(JobError, match=r"manifest|no job 'nope'"):
            action(tmp_path)
    assert os.listdir(tmp_path) == ["job.json"]


def test_a_job_of_other_versions_is_refused(marks, tmp_path):
    folder, job = tmp_path / "job", MarkedJob(marks=marks)
    run(job, folder, engine="here", part=(1, 2))
    manifest = json.loads((folder / "job.json").read_text())
    manifest["versions"] |= {"maira-qp": "0.0.9", "numba": "0.1"}
    (folder / "job.json").write_text(json.dumps(manifest))
    before = files_of(folder)
    with pytest.raises(JobError, match=r"begun by other versions: maira-qp 0\.0\.9, here .*, numba 0\.1, here"):
        run(job, folder, engine="here")
    assert files_of(folder) == before


def test_a_job_of_the_same_sources_goes_on_whatever_their_version_is_called(marks, tmp_path):
    """A clone has a version of its own after each commit, also where nothing that answers depend on was changed."""
    folder, job = tmp_path / "job", MarkedJob(marks=marks)
    run(job, folder, engine="here", part=(1, 2))
    manifest = json.loads((folder / "job.json").read_text())
    manifest["versions"]["maira-qp"] = "0.0.9"
    (folder / "job.json").write_text(json.dumps(manifest))
    run(job, folder, engine="here")
    assert verify(folder)


def test_a_folder_is_of_one_job(marks, tmp_path):
    job = MarkedJob(marks=marks)
    run(job, tmp_path / "job", engine="here", part=(1, 2))
    with pytest.raises(JobError, match="holds another job: count is 60 there and 61 here"):
        run(replace(job, count=61), tmp_path / "job", engine="here")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").touch()
    with pytest.raises(JobError, match=r"not empty and holds no job: it has 'thesis\.tex'"):
        run(job, tmp_path / "other", engine="here")
    with pytest.raises(JobError, match="holds no job"):
        resume(tmp_path / "other")
    (tmp_path / "job" / "job.json").write_text("{")
    with pytest.raises(JobError, match="is damaged"):
        state_of(tmp_path / "job")


@pytest.mark.parametrize("engine", ["here", "processes"])
def test_a_disk_that_is_full_is_told_and_breaks_nothing(marks, tmp_path, engine):
    """A limit on the size of files stands for it: writing fails in the middle of a file, as on a full disk."""
    folder, job = tmp_path / "job", MarkedJob(marks=marks, count=3000, block=1000)
    run(job, folder, engine="here", part=(1, 100))
    kept = files_of(folder)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large") as raised:
            run(job, folder, engine=engine, shard=2970)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert raised.value.errno == errno.EFBIG
    assert files_of(folder) == kept
    run(job, folder, engine="here")
    assert files_of(folder) == undisturbed(job, tmp_path / "here")


def test_progress_counts_what_was_done_before(marks, tmp_path):
    told, job = [], MarkedJob(marks=marks)
    run(job, tmp_path / "job", engine="here", part=(1, 3), shard=10)
    run(job, tmp_path / "job", engine="here", shard=10, progress=lambda done, total: told.append((done, total)))
    assert told == [(20, 60), (30, 60), (40, 60), (50, 60), (60, 60)]


def test_options_that_make_no_sense_are_refused(marks, tmp_path):
    job = MarkedJob(marks=marks)
    for options, said in (
        ({"engine": "procesess"}, "did you mean 'processes'"),
        ({"workers": 0}, "workers must be a positive"),
        ({"engine": "here", "workers": 2}, "this process alone"),
        ({"part": (4, 3)}, r"part must be \(i, n\)"),
        ({"shard": 0}, "shard must be a positive"),
        ({"threads": 0}, "threads must be a positive"),
        ({"time_limit": 0.0}, "time_limit must be positive"),
        ({"time_limit": 9.0, "engine": "here"}, "time_limit is for the engine 'processes' alone"),
        ({"time_limit": 9.0, "engine": Processes(1)}, "time_limit is for the engine 'processes' alone"),
        ({"address": "tcp://head:8786"}, "address is for the engines 'dask' and 'ray'"),
    ):
        with pytest.raises(OptionError, match=said):
            run(job, tmp_path / "job", **options)
    with pytest.raises(OptionError, match="job must be a job"):
        run({"cell": 0.1}, tmp_path / "job")
    assert not (tmp_path / "job").exists()


def test_workers_write_the_same_output_though_one_of_them_dies_over_a_block(marks, tmp_path, monkeypatch):
    monkeypatch.setattr("maira_qp.scale.output.LARGE", 0)
    job = MarkedJob(marks=marks, writer_killed=(14,))
    run(job, tmp_path / "job", engine="here", part=(1, 1), shard=13)
    run(job, tmp_path / "job", workers=1)
    assert os.listdir(marks) == ["writer-killed-14"]
    assert files_of(tmp_path / "job") == undisturbed(job, tmp_path / "here")
