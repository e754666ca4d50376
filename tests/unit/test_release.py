"""What a release says of itself: one version, the interpreters that it runs on, links that exist."""

import ast
import importlib.metadata
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import maira_qp

ROOT = Path(__file__).parents[2]
INSTALL = runpy.run_path(str(ROOT / ".ci" / "install.py"))
tomllib = pytest.importorskip("tomllib" if sys.version_info >= (3, 11) else "tomli")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def version_of(folder: Path) -> str:
    """The version of what would be built from a folder."""
    shown = [sys.executable, "-m", "hatchling", "version"]
    return subprocess.run(shown, cwd=folder, capture_output=True, text=True, check=True).stdout.strip()


def test_the_version_is_that_of_the_tag(tmp_path):
    """Of the archive of a tag too; a clone without tags, and a copy without git, have versions before the first."""
    pytest.importorskip("hatch_vcs")
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitattributes", ".git_archival.txt"):
        shutil.copy(ROOT / name, tmp_path)

    def git(*words: str) -> bytes:
        own = ["-c", "user.name=somebody", "-c", "user.email=somebody@localhost", "-c", "commit.gpgsign=false"]
        return subprocess.run(["git", *own, *words], cwd=tmp_path, capture_output=True, check=True).stdout

    assert re.match(r"0\.0", version_of(tmp_path))
    git("init")
    git("add", ".")
    git("commit", "--message", "all")
    assert re.match(r"0\.0", version_of(tmp_path))
    git("tag", "v0.9.0")
    assert version_of(tmp_path) == "0.9.0"
    (tmp_path / "archive.zip").write_bytes(git("archive", "--format=zip", "v0.9.0"))
    shutil.unpack_archive(tmp_path / "archive.zip", tmp_path / "archive")
    assert version_of(tmp_path / "archive") == "0.9.0"


def test_the_version_is_that_of_what_is_installed():
    """No file names one; the sources of a job, not their version, say which code it is."""
    assert PROJECT["dynamic"] == ["version"]
    assert maira_qp.__version__ == importlib.metadata.version("maira-qp")
    assert "version:" not in (ROOT / "CITATION.cff").read_text(encoding="utf-8").replace("cff-version:", "")


def test_classifiers_name_the_interpreters_that_are_supported():
    least, most = map(int, re.findall(r"3\.(\d+)", PROJECT["requires-python"]))
    named = [re.fullmatch(r"Programming Language :: Python :: 3\.(\d+)", each) for each in PROJECT["classifiers"]]
    assert [int(each[1]) for each in named if each] == list(range(least, most))
    assert INSTALL["SUPPORTED"] == tuple(f"3.{minor}" for minor in range(least, most))


def executable(path: Path, does: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{does}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


def test_interpreters_that_do_not_run_are_passed_over(tmp_path, monkeypatch):
    """As pyenv puts them on PATH; one that pyenv has is found all the same; of those that run the first is taken."""
    find_python = INSTALL["find_python"]
    monkeypatch.setenv("PATH", f"{tmp_path / 'shims'}:{tmp_path / 'bin'}")
    executable(tmp_path / "shims" / "python3.12", "echo 'command not found' >&2; exit 127")
    executable(tmp_path / "bin" / "python3.10", "echo Python 3.1.0")
    assert find_python("3.12") is None
    assert find_python("3.10") is None
    executable(tmp_path / "shims" / "pyenv", f"echo {tmp_path}/$1-$2")
    assert find_python("3.12") is None
    by_pyenv = executable(tmp_path / "prefix-3.12" / "bin" / "python", "echo Python 3.12.1")
    assert find_python("3.12") == str(by_pyenv)
    on_path = executable(tmp_path / "bin" / "python3.12", "echo Python 3.12.13")
    assert find_python("3.12") == str(on_path)


def test_the_command_and_all_that_it_needs_is_installed_with_the_package():
    """Each module that is imported without an extra is of the standard library or of a dependency."""
    needed = {re.split(r"[><=\[; ]", each)[0].lower().replace("-", "_") for each in PROJECT["dependencies"]}
    provided = {"pin": {"pinocchio", "coal"}, "pyyaml": {"yaml"}, "numba": {"numba", "llvmlite"}}
    modules = set().union(*(provided.get(name, {name}) for name in needed)) | {"maira_qp"}
    for path in (ROOT / "maira_qp").rglob("*.py"):
        if path.relative_to(ROOT / "maira_qp").parts[:2] in {("apps", "plots"), ("apps", "viewer")}:
            continue  # imported only where their extra is known to be installed
        for node in ast.parse(path.read_text(encoding="utf-8")).body:  # the top of a module alone
            names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            for name in [*names, *([str(node.module)] if isinstance(node, ast.ImportFrom) else [])]:
                first = name.partition(".")[0]
                assert first in sys.stdlib_module_names | modules, f"{path}: {name}"


def test_no_link_of_the_project_leads_to_a_host_that_may_not_exist():
    assert not PROJECT.get("urls")
