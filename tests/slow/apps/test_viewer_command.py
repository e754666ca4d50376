"""`maira-qp view`: what it needs, what it says, how it ends."""

import importlib.util
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest
from support.command_line import heed_interrupts, misuse

from maira_qp.apps.cli import main

needs_viser = pytest.mark.skipif(importlib.util.find_spec("viser") is None, reason="the viewer needs viser")


@pytest.fixture
def refused(capsys):
    """Runs a command that is a misuse, and returns what it says."""

    def run(*arguments: str) -> str:
        code = main(arguments)
        return misuse((code, *capsys.readouterr()))

    return run


def test_without_its_extra_it_says_how_to_get_it(refused, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "viser" else find(name, *rest))
    assert "pip install 'maira-qp[view]'" in refused("view")


@needs_viser
def test_what_cannot_be_served_is_told(refused):
    assert "65535" in refused("view", "--port", "70000")
    assert "unknown robot" in refused("view", "--robot", "nobody")
    assert refused("view", "--host", "203.0.113.1", "--port", "0")  # an address of no machine (RFC 5737)


@needs_viser
def test_it_serves_its_page_until_it_is_interrupted(tmp_path):
    command = [sys.executable, "-m", "maira_qp", "view", "--port", "0", "--token", "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, **pipes, text=True, env=os.environ, preexec_fn=heed_interrupts)
    try:
        line = process.stdout.readline()
        url = line.split(" is at ")[1].split()[0]
        address, token = url.split("/?token=")
        assert address.startswith("http://127.0.0.1:")
        assert len(token) > 20
        with urllib.request.urlopen(url, timeout=30) as page:
            assert b"<html" in page.read(2000).lower()
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(address, timeout=30)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130
    assert "Traceback" not in err
