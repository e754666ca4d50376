"""Jobs from the command line: run, interrupted, gone on with, looked at, verified."""

import importlib.util
import json
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.command_line import heed_interrupts, misuse
from support.marked_jobs import files_of

from maira_qp.apps.cli import main
from maira_qp.scale import ReachMap

pytest.importorskip("zarr")
SMALL = ("reach", "--robot", "iiwa14", "--cell", "0.4", "--directions", "6")


@pytest.fixture
def maira_qp(capsys):
    """The command in this process: its exit code, and what it printed."""

    def run(*arguments: str) -> tuple[int, str, str]:
        code = main(list(arguments))
        return code, *capsys.readouterr()

    return run


def test_a_map_is_made_looked_at_and_verified(maira_qp, tmp_path):
    folder = str(tmp_path / "map")
    code, out, _ = maira_qp(*SMALL, "--output", folder, "--engine", "here", "--json")
    said = json.loads(out)
    assert code == 0
    assert said["finished"]
    assert said["done"] == said["done_now"] == said["poses"] == said["cells"] * 6
    assert said["reachable"] + said["unreachable"] + said["undecided"] == pytest.approx(1.0, abs=1e-5)
    assert ReachMap.open(folder).values("reachable").mean() == pytest.approx(said["reachable"], rel=1e-4)
    code, out, _ = maira_qp("job", "status", folder, "--json")
    assert (code, json.loads(out)["finished"], json.loads(out)["owner"]) == (0, True, None)
    code, out, _ = maira_qp("job", "verify", folder)
    assert (code, "0 damaged" in out) == (0, True)
    code, out, _ = maira_qp(*SMALL, "--output", folder, "--engine", "here")
    assert (code, "done now" in out) == (0, True)


def test_a_plane_of_a_map_is_drawn(maira_qp, tmp_path):
    pytest.importorskip("matplotlib")
    folder, picture = str(tmp_path / "map"), tmp_path / "plane.png"
    maira_qp(*SMALL, "--output", folder, "--engine", "here")
    flags = ("--map", folder, "--plane", "xy", "--at", "0.5", "--quantity", "manipulability", "--output", str(picture))
    assert maira_qp("plot", "reach", *flags)[0] == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    if importlib.util.find_spec("skimage") is not None:
        assert maira_qp("plot", "reach", *flags, "--surface", "0.03")[0] == 0
        assert "--surface: level must be" in misuse(maira_qp("plot", "reach", *flags, "--surface", "50"))
    assert "--surface is of a map" in misuse(maira_qp("plot", "reach", "--surface", "1", *flags[-2:]))
    assert "--at must be from" in misuse(maira_qp("plot", "reach", *flags, "--at", "50"))
    assert "--map has its robot" in misuse(maira_qp("plot", "reach", *flags, "--robot", "iiwa14"))


def test_parts_and_then_the_whole(maira_qp, tmp_path):
    folder = str(tmp_path / "map")
    for part in ("2/2", "1/2"):
        code, out, _ = maira_qp(*SMALL, "--output", folder, "--engine", "here", "--shard", part, "--json")
        assert (code, json.loads(out)["finished"]) == (0, False)
        code, out, _ = maira_qp("job", "status", folder)
        assert (code, "reach" in out) == (1, True)
    code, out, _ = maira_qp("job", "resume", folder, "--engine", "here", "--json")
    assert (code, json.loads(out)["finished"], json.loads(out)["done_now"]) == (0, True, 0)
    maira_qp(*SMALL, "--output", str(tmp_path / "whole"), "--engine", "here")
    assert files_of(tmp_path / "map") == files_of(tmp_path / "whole")


def test_damage_is_told_and_mended(maira_qp, tmp_path):
    folder = tmp_path / "map"
    maira_qp(*SMALL, "--output", str(folder), "--engine", "here")
    wanted = files_of(folder)
    (folder / "x" / "zarr.json").write_text("{}")
    code, out, _ = maira_qp("job", "verify", str(folder))
    assert code == 1
    assert "damaged: x/zarr.json" in out
    assert f"maira-qp job resume {folder}" in out
    assert maira_qp("job", "resume", str(folder), "--engine", "here")[0] == 0
    assert files_of(folder) == wanted


def test_a_data_set_is_made_and_verified(maira_qp, tmp_path):
    pytest.importorskip("pyarrow")
    folder, flags = str(tmp_path / "set"), ("--rows", "50", "--poses", "configurations", "--seed", "4")
    code, out, _ = maira_qp("dataset", *flags, "--output", folder, "--engine", "here", "--json")
    assert (code, json.loads(out)["finished"], json.loads(out)["poses"]) == (0, True, 50)
    assert maira_qp("job", "verify", folder)[0] == 0
    err = misuse(maira_qp("dataset", "--rows", "0", "--output", folder, "--engine", "here"))
    assert "--rows must be a positive" in err


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_map_says_how_to_go_on_and_goes_on(maira_qp, tmp_path, sign):
    """A map far too large for a test, of which some shards get done."""
    folder = tmp_path / "map"
    command = [sys.executable, "-m", "maira_qp", *SMALL[:-4], "--cell", "0.01", "--directions", "6"]
    command += ["--output", str(folder), "--engine", "here"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
    end = time.monotonic() + 60
    while not list(folder.glob("shards/*.shard")):
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(sign)
    _, err = process.communicate()
    assert process.returncode == 128 + sign
    assert f"what was done is kept: maira-qp job resume {folder}" in err
    code, out, _ = maira_qp("job", "status", str(folder), "--json")
    said = json.loads(out)
    assert code == 1
    assert 0 < said["done"] < said["total"]
    assert said["owner"] is None


def test_a_disk_that_is_full_is_told_with_its_folder_and_how_to_go_on(maira_qp, tmp_path):
    """A limit on the size of files stands for it; the manifest fits, the first shard does not."""
    folder, limits = tmp_path / "map", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        code, out, err = maira_qp(*SMALL[:-1], "100", "--output", str(folder), "--engine", "here")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (code, out) == (2, "")
    assert f"what was done is kept: maira-qp job resume {folder}" in err
    assert f"File too large: '{folder}'" in err


def test_mistakes_name_what_is_valid(maira_qp, tmp_path):
    folder = str(tmp_path / "map")
    assert "--shard takes I/N" in misuse(maira_qp(*SMALL, "--output", folder, "--shard", "3/2"))
    assert "--cell must be a positive" in misuse(maira_qp(*SMALL, "--cell", "-1", "--output", folder))
    assert "--workers must be a positive" in misuse(maira_qp(*SMALL, "--output", folder, "--workers", "0"))
    assert "did you mean 'verify'" in misuse(maira_qp("job", "verfy", folder))
    assert "holds no job" in misuse(maira_qp("job", "status", str(tmp_path)))
    Path(folder).mkdir()
    Path(folder, "notes.txt").touch()
    assert "is not empty and holds no job" in misuse(maira_qp(*SMALL, "--output", folder, "--engine", "here"))
