"""`maira-qp doctor` tells what is there and what is wrong, and does not fall over what is missing."""

import importlib.metadata
import importlib.util
import json
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numba import config

from maira_qp.apps import doctor
from maira_qp.apps.cli import main
from maira_qp.apps.doctor import State
from maira_qp.kernels.jit import code_cache
from maira_qp.problem.qp import backends
from maira_qp.problem.qp.qp import QPSolution
from maira_qp.solvers.solver import Solver


@pytest.fixture
def without(monkeypatch):
    """Makes a module look as if it were not installed."""
    find = importlib.util.find_spec

    def hide(*names):
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name in names else find(name))

    return hide


def found(look):
    return {finding.name: finding for finding in look()}


def test_all_is_well_here(capsys):
    """Exit code 0; versions are those that pip says; the table shows what the JSON holds."""
    assert main(["doctor", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["well"] is True
    seen = {finding["name"]: finding for finding in told["findings"]}
    assert seen["numpy"]["told"] == importlib.metadata.version("numpy")
    assert seen["daqp"]["state"] == seen["self-check"]["state"] == seen["compiled code"]["state"] == "ok"
    assert "CONVERGED" in seen["self-check"]["told"]
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert "all is well" in out
    for finding in told["findings"]:
        assert finding["name"] in out


def test_what_is_optional_may_be_absent(without, monkeypatch, capsys):
    """Without the extras and a backend the exit code is still 0, and what to install is said."""
    without("matplotlib", "pyarrow", "viser", "toppra", "ruckig", "rerun", "eaik", "piqp", "clarabel")
    monkeypatch.setattr(backends, "available", lambda: ("daqp",))
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    for advice in ("pip install 'maira-qp[plot]'", "pip install 'maira-qp[closed-form]'", "pip install proxsuite"):
        assert advice in out


def test_the_extras_are_those_that_pip_knows():
    """But those for work on the project itself."""
    text = (Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8")
    section = re.split(r"^\[.*\]$", text.split("[project.optional-dependencies]")[1], flags=re.MULTILINE)[0]
    names = set(re.findall(r"^([\w-]+) = \[", section, flags=re.MULTILINE))
    assert set(doctor.EXTRAS) == names - {"bench", "docs", "dev"}
    assert set(found(doctor.extras)) == set(doctor.EXTRAS)


def test_what_is_needed_may_not(without, capsys):
    """A missing dependency is a fault, exit code 1, with what to do about it."""
    without("coal")
    assert main(["doctor"]) == 1
    assert "coal: not installed; pip install" in capsys.readouterr().out


def test_a_backend_that_errs_is_a_fault(monkeypatch):
    """A backend that is off, or that fails, is told; the others are still looked at."""
    solve = backends.Backend.solve

    def wrong(self, qp):
        if self.name == "osqp":
            return QPSolution(qp, True, np.full(2, -0.4), np.empty(0), np.zeros(2))
        if self.name == "proxqp":
            return QPSolution(qp, False, np.zeros(2), np.empty(0), np.zeros(2), "broken")
        return solve(self, qp)

    monkeypatch.setattr(backends.Backend, "solve", wrong)
    seen = found(doctor.backends)
    assert (seen["osqp"].state, seen["proxqp"].state, seen["daqp"].state) == (State.FAULT, State.FAULT, State.WELL)
    assert "1e-01" in seen["osqp"].told
    assert "broken" in seen["proxqp"].told
    assert "proxsuite" in seen["proxqp"].advice


def test_the_self_check_does_not_believe_the_solver(monkeypatch):
    """An answer that says it is solved but is off by a hundredth of a radian is a fault; so is a crash."""
    solve = Solver.solve

    def off(self, target):
        s = solve(self, target)
        s.q[3] += 0.01
        return s

    monkeypatch.setattr(Solver, "solve", off)
    assert found(doctor.self_check)["self-check"].state is State.FAULT
    monkeypatch.setattr(Solver, "solve", lambda self, target: 1 / 0)
    last = list(doctor.examine())[-1]
    assert (last.group, last.state) == ("self_check", State.FAULT)
    assert "ZeroDivisionError" in last.told


def test_the_kernels_whose_compilation_is_told_are_there():
    for name in doctor.FIRST:
        module, function = name.rsplit(".", 1)
        assert callable(getattr(import_module(f"maira_qp.kernels.{module}"), function))


@pytest.mark.parametrize(("kept", "told"), [((), "10 seconds"), (("search.multi_start.search-1.kernel",), "10 more")])
def test_a_compile_to_come_is_told(monkeypatch, tmp_path, kept, told):
    """What has not been compiled yet is said to take its time; without a folder for it there is advice."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    (folder,) = code_cache.folders()
    folder.mkdir(parents=True)
    for name in kept:
        (folder / name).write_bytes(bytes(1_000_000))
    seen = found(doctor.cache)["compiled code"]
    assert seen.state is State.WELL
    assert f"{len(kept)} files, {len(kept)} MB, in {folder}" in seen.told
    assert told in seen.told
    assert ("10 seconds" in seen.told) == (not kept)
    assert "--clear" not in seen.told
    other = folder.with_name("0" * 16)
    other.mkdir()
    (other / "search.search-1.kernel").write_bytes(bytes(2_000_000))
    told = found(doctor.cache)["compiled code"].told
    assert f"{len(kept)} files, {len(kept)} MB" in told
    assert f"{len(kept) + 2} MB with what is older" in told
    assert sorted(path.name for path in folder.iterdir()) == sorted(kept)
    monkeypatch.setattr(config, "CACHE_DIR", __file__)
    seen = found(doctor.cache)["compiled code"]
    assert seen.state is State.FAULT
    assert "NUMBA_CACHE_DIR" in seen.advice
