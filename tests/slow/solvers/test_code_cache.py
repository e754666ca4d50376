"""The machine code on disk: never older than its source, and never in the way of an answer."""

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import config

import maira_qp
from maira_qp.apps.cli import main
from maira_qp.kernels.jit import code_cache
from maira_qp.kernels.jit.decorators import kernel

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")


def twice_and_one(x):
    return 2.0 * x + 1.0


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The folder of the key, in a cache that is empty."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "maira_qp" / code_cache.KEY


@pytest.fixture
def use(folder, monkeypatch, caplog):
    """Call the kernel as a new process would: result, hits of the cache, and what is logged."""

    def run(argument=1.0):
        monkeypatch.setattr(code_cache, "_told", set())
        caplog.clear()
        compiled = kernel(twice_and_one)
        value = compiled(argument)
        return value, sum(compiled.stats.cache_hits.values()), "\n".join(caplog.messages)

    return run


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_code_is_compiled_once_for_each_type_of_argument(use, folder):
    """The compilation is announced by a warning, which is seen where nothing is said about logging."""
    assert use() == (3.0, 0, code_cache.ANNOUNCEMENT)
    assert use() == (3.0, 1, "")
    assert use(1) == (3.0, 0, code_cache.ANNOUNCEMENT)
    assert use(1) == use() == (3.0, 1, "")
    assert len(files(folder)) == 2


def test_the_announcement_is_made_once_in_a_process(use, caplog):
    use()
    caplog.clear()
    assert kernel(twice_and_one)(1) == 3.0
    assert caplog.messages == []


@pytest.mark.parametrize("damage", ["truncated", "emptied", "garbage", "foreign", "one bit"])
def test_what_is_damaged_or_foreign_is_made_anew(use, folder, damage):
    """With a word in the log that names the file; the next process finds it whole."""
    use()
    (file,) = files(folder)
    content = file.read_bytes()
    flipped = content[:500] + bytes([content[500] ^ 1]) + content[501:]
    pickled = b"\x80\x04cbuiltins\nexit\n)R."
    damaged = {"truncated": content[:-7], "emptied": b"", "garbage": bytes(range(256)), "foreign": pickled}
    file.write_bytes(damaged.get(damage, flipped))
    value, hits, logged = use()
    assert (value, hits) == (3.0, 0)
    assert f"{file} is damaged" in logged
    assert use() == (3.0, 1, "")


def test_what_is_whole_but_cannot_be_loaded_is_made_anew(use, folder):
    use()
    (file,) = files(folder)
    data = b"no pickle"
    file.write_bytes(code_cache.CHECKSUM(data).digest() + data)
    value, hits, logged = use()
    assert (value, hits) == (3.0, 0)
    assert f"{file} cannot be loaded" in logged
    assert use() == (3.0, 1, "")


def test_a_folder_in_the_place_of_a_file(use, folder):
    use()
    (file,) = files(folder)
    file.unlink()
    (file / "within").mkdir(parents=True)
    value, hits, logged = use()
    assert (value, hits) == (3.0, 0)
    assert "compiled code is not kept" in logged


def test_no_room_means_no_cache(use, folder):
    """A disk that takes but the beginning of a file: an answer, a word in the log, and nothing is left."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        value, hits, logged = use()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (value, hits) == (3.0, 0)
    assert "not kept, each process compiles anew" in logged
    assert files(folder) == []
    assert use() == (3.0, 0, code_cache.ANNOUNCEMENT)


def test_a_folder_that_cannot_be_written_is_still_read(use, folder, monkeypatch):
    """Code may come with an image of which nothing can be changed."""
    use()

    def refuse(*arguments, **options):
        raise PermissionError("read-only")

    monkeypatch.setattr(Path, "write_bytes", refuse)
    monkeypatch.setattr(os, "utime", refuse)
    assert use() == (3.0, 1, "")
    value, hits, logged = use(1)
    assert (value, hits) == (3.0, 0)
    assert "not kept, each process compiles anew: read-only" in logged


def test_a_cache_that_cannot_be_made(use, tmp_path, monkeypatch):
    """A file where a folder is needed, which stops root too."""
    (tmp_path / "file").touch()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "file"))
    value, hits, logged = use()
    assert (value, hits) == (3.0, 0)
    assert str(tmp_path / "file") in logged


def test_the_user_s_cache_and_where_it_cannot_be_written_a_temporary_folder(use, tmp_path, monkeypatch):
    """The folder among everybody's is used only if nobody else can have put code into it."""
    home, nowhere, temporary = tmp_path / "home", tmp_path / "nowhere", tmp_path / "temporary"
    nowhere.touch()
    temporary.mkdir()
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(home))
    assert use() == (3.0, 0, code_cache.ANNOUNCEMENT)
    assert len(files(home / ".cache" / "maira_qp")) == 1
    assert not files(temporary)
    monkeypatch.setenv("HOME", str(nowhere))
    assert use() == (3.0, 0, code_cache.ANNOUNCEMENT)
    (private,) = temporary.iterdir()
    assert len(files(private)) == 1
    assert private.stat().st_mode & 0o777 == 0o700
    assert use() == (3.0, 1, "")
    private.chmod(0o777)
    value, hits, logged = use()
    assert (value, hits) == (3.0, 0)
    assert "others may write" in logged


def test_the_keys_that_were_not_used_for_longest_are_forgotten(use, folder):
    root = folder.parent
    for age in range(9):
        old = root / f"{age:016x}"
        old.mkdir(parents=True)
        os.utime(old, (1e9 - age, 1e9 - age))
    (root / "something else").mkdir()
    use()
    others = {f"{age:016x}" for age in range(code_cache.KEPT - 1)}
    assert {path.name for path in root.iterdir()} == {"something else", folder.name, *others}


def test_what_is_edited_while_a_process_runs_is_not_kept(use, folder, monkeypatch):
    """Kernels are imported late: what is edited before that belongs to neither key."""
    monkeypatch.setattr(code_cache, "source_digest", lambda: "edited")
    assert use() == (3.0, 0, code_cache.ANNOUNCEMENT)
    assert files(folder) == []


def test_without_sources_nothing_is_kept(use, folder, monkeypatch):
    """Nothing would tell that they have changed."""
    monkeypatch.setattr(code_cache, "SOURCES", "")
    monkeypatch.setattr(code_cache, "source_digest", lambda: "")
    value, hits, logged = use()
    assert (value, hits) == (3.0, 0)
    assert "not kept" in logged
    assert files(folder) == []


def test_the_command_shows_and_clears(use, folder, capsys):
    use()
    (file,) = files(folder)
    old = folder.with_name("0" * 16) / file.name
    old.parent.mkdir()
    old.write_bytes(bytes(2_000_000))
    (folder.parent / "something else").mkdir()
    assert main(["cache"]) == 0
    out = capsys.readouterr().out
    assert f"2 files, 2.0 MB, in {folder.parent}\n1 of them" in out
    assert main(["cache", "--clear"]) == 0
    assert f"cleared 2 files, 2.0 MB, from {folder.parent}" in capsys.readouterr().out
    assert [path.name for path in folder.parent.iterdir()] == ["something else"]
    assert main(["cache"]) == 0
    assert "0 files" in capsys.readouterr().out
    assert use() == (3.0, 0, code_cache.ANNOUNCEMENT)


KERNELS = Path(maira_qp.__file__).parent / "kernels"
INNER = """
from maira_qp.kernels.jit.decorators import kernel

@kernel
def twice(x):
    return 2.0 * x
"""
OUTER = """
from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.inner import twice

@kernel
def twice_and_one(x):
    return twice(x) + 1.0
"""
USE = """
from maira_qp.kernels.outer import twice_and_one
print(twice_and_one(1.0), sum(twice_and_one.stats.cache_hits.values()))
"""


@pytest.fixture
def package(tmp_path) -> Path:
    """Kernels of a copy of the package that is but what compiles, and two of a few lines in place of all others."""
    kernels = tmp_path / "site" / "maira_qp" / "kernels"
    kernels.mkdir(parents=True)
    (kernels.parent / "__init__.py").touch()
    shutil.copy(KERNELS / "__init__.py", kernels)
    (kernels / "jit").mkdir()
    for name in ("__init__", "decorators", "code_cache", "inlining"):
        shutil.copy(KERNELS / "jit" / f"{name}.py", kernels / "jit")
    (kernels / "inner.py").write_text(INNER)
    (kernels / "outer.py").write_text(OUTER)
    return kernels


@pytest.fixture
def start(package, tmp_path):
    """Start a process that calls the outer kernel and prints the result and the hits of the cache."""

    def popen(**environment):
        places = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(package.parent.parent)}
        variables = {**os.environ, **places, "PYTHONDONTWRITEBYTECODE": "1", **environment}
        command = [sys.executable, "-W", "error", "-c", USE]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        return subprocess.Popen(command, cwd=tmp_path, env=variables, text=True, **pipes)

    return popen


def test_an_edit_of_a_kernel_inside_another_is_never_missed(start, package, tmp_path):
    """In processes of their own: compiled, found again, compiled after the edit, and found when that is taken back."""
    announced = f"{code_cache.ANNOUNCEMENT}\n"
    assert start().communicate() == ("3.0 0\n", announced)
    assert start().communicate() == ("3.0 1\n", "")
    (package / "inner.py").write_text(INNER.replace("2.0", "3.0"))
    assert start().communicate() == ("4.0 0\n", announced)
    (package / "inner.py").write_text(INNER)
    assert start().communicate() == ("3.0 1\n", "")
    assert start(NUMBA_OPT="1").communicate() == ("3.0 0\n", announced)
    assert start(MAIRA_QP_INLINE="0").communicate() == ("3.0 0\n", announced)


def test_processes_that_compile_at_the_same_time(start, tmp_path):
    """Each answers, and what they leave is whole."""
    processes = [start() for _ in range(3)]
    for process in processes:
        out, err = process.communicate()
        assert process.returncode == 0, err
        assert out.startswith("3.0 ")
    assert start().communicate() == ("3.0 1\n", "")
    assert len(files(tmp_path / "cache")) == 1
