"""The help of every command as a person reads it: 80 columns, whole sentences, no words of Python's."""

import itertools
import re
import subprocess
import sys

import pytest

from maira_qp.apps.cli import COMMANDS, main
from maira_qp.apps.overview import CODES, GROUPS

PICTURES = ("convergence", "trade-off", "self-motion", "reach", "path")
PAGES = [
    *[(name,) for name in COMMANDS],
    *[("plot", picture) for picture in PICTURES],
    *[("job", action) for action in ("status", "resume", "verify")],
]


@pytest.fixture
def page(capsys, monkeypatch):
    """Exit code and lines of a call, at 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")

    def read(*arguments):
        capsys.readouterr()
        code = main(list(arguments))
        told = capsys.readouterr()
        return code, told.out.splitlines(), told.err.splitlines()

    return read


@pytest.mark.parametrize("command", PAGES, ids=" ".join)
def test_a_page_of_help_fits_and_is_in_plain_english(page, command):
    code, lines, errors = page(*command, "--help")
    assert code == 0
    assert not errors
    assert max(map(len, lines)) <= 80
    text = re.sub(r"--deadline.*\n.*", "", "\n".join(lines))  # in the words of `Options`
    assert not re.search(r"None|default: False|NoneType|type: ignore", text)
    assert not re.search(r"\b(?:one|row|dots|poses|targets) an? (?:row|answer|processor|second|inch|stratum)\b", text)
    summary = next(line for k, line in enumerate(lines) if k and not lines[k - 1] and not line.startswith("usage"))
    assert summary.endswith((".", ","))


def test_flags_are_explained_in_one_piece(page):
    """No line of a flag's help ends early, where the docstring's line did."""
    for command in (("solve",), ("track",), ("plot", "reach"), ("bench",)):
        lines = page(*command, "-h")[1]
        cells = [line[2:-2].rstrip() for line in lines if line.startswith("│ ")]
        for line, below in itertools.pairwise(cells):
            is_flag_alone = line.startswith("-") and "  " not in line
            is_text = below.startswith(" " * 12) and not is_flag_alone
            if is_text and not line.endswith((".", ")")):
                assert len(line) + 1 + len(below.split()[0]) > 76, (command, line, below)


def test_the_overview_names_every_command_and_code(page):
    code, lines, _ = page("--help")
    assert code == 0
    assert max(map(len, lines)) <= 80
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(COMMANDS)
    for name in (*COMMANDS, *CODES):
        assert sum(line.startswith(f"  {name} ") for line in lines) == 1
    assert lines == page("-h")[1]
    assert page()[0] == 2
    assert page()[2] == lines


@pytest.mark.parametrize("arguments", [("--help",), ("solve", "--help"), ("plot", "reach", "--help")])
def test_a_reader_who_leaves_does_not_change_the_exit_code(arguments):
    with subprocess.Popen([sys.executable, "-m", "maira_qp", *arguments], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.wait(60) == 0


@pytest.mark.parametrize("arguments", [("solv",), ("plot",), ("plot", "pie"), ("solve", "--positoin", "1", "2", "3")])
def test_wrong_use_is_2_and_says_so_on_stderr(page, arguments):
    code, lines, errors = page(*arguments)
    assert code == 2
    assert not lines
    assert errors
