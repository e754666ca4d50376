"""What stands in README.md runs as it stands."""

import re
import shlex
from pathlib import Path

import pytest

from maira_qp.apps.cli import parse

README = (Path(__file__).parents[3] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", README, flags=re.MULTILINE | re.DOTALL)
COMMANDS = re.findall(r"^    (maira-qp [^|>\n]*)", README, flags=re.MULTILINE)


def test_its_python_runs_from_top_to_bottom(tmp_path, monkeypatch):
    """In one namespace, as by a reader who types along; files are those that it shows."""
    monkeypatch.chdir(tmp_path)
    seen: dict = {}
    for language, text in BLOCKS:
        if language == "toml":
            name, call = re.match(r"# (\S+\.toml): (mq\.[\w.]+\(.*?\)),", text).groups()
            Path(name).write_text(text)
            assert eval(call, seen).links
        if language == "python":
            exec(compile(text, "README.md", "exec"), seen)
    assert {language for language, _ in BLOCKS} == {"python", "toml"}
    assert seen["t"].q.shape == (7,)


@pytest.mark.parametrize("line", COMMANDS)
def test_its_commands_have_the_flags_that_they_use(line):
    assert parse(shlex.split(line)[1:]) is not None


def test_there_are_commands():
    assert len(COMMANDS) > 10
